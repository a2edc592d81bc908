//! The stated errors of the elementary functions, against f64: the bounds are those of the comments in
//! `cl/shared/math.cl`. That devices return the same bits is the business of `tests/device/kernels.rs`.

use raybrook::low_level::reference::shared::math::{exp2_fixed, log2_fixed, power_fixed, sin_turns};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Half the distance from 1 to the next float: the largest relative error of one rounding.
const EPSILON: f64 = 1.0 / 16_777_216.0;

/// An error and where it occurs.
#[derive(Debug, Clone, Copy)]
struct Worst {
    error: f64,
    at: f32,
}

/// How far `got` is from `exact` in units in the last place of floats of that size.
fn ulps(got: f32, exact: f64) -> f64 {
    if exact == 0.0 {
        return if got == 0.0 { 0.0 } else { f64::INFINITY };
    }
    // Subnormal ones are as far apart.
    let exponent = ((exact.abs().to_bits() >> 52) as i32 - 1023).max(f32::MIN_EXP - 1);
    (f64::from(got) - exact).abs() / 2f64.powi(exponent - 23)
}

/// The largest error of `function` on every `stride`-th float from `low` to `high`, both positive.
fn worst(stride: u32, low: f32, high: f32, error: impl Fn(f32) -> f64 + Sync) -> Worst {
    let steps = (high.to_bits() - low.to_bits()) / stride;
    let of = |i: u32| {
        let at = f32::from_bits(low.to_bits() + i * stride);
        Worst { error: error(at), at }
    };
    // A NaN must win: total_cmp puts it above all numbers.
    (0..=steps).into_par_iter().map(of).max_by(|a, b| a.error.total_cmp(&b.error)).expect("at least one argument")
}

/// Every `stride`-th argument. Sine and exponential are those of arguments that are reduced without rounding; so larger
/// arguments of the sine lead to the same errors, and only their reduction needs a test.
fn functions_keep_their_bounds(stride: u32) {
    let sine = worst(stride, 1e-30, 1.0, |x| ulps(sin_turns(x), sine_of_turns(x)));
    println!("sin_turns: {:.3} ulp at {:e}", sine.error, sine.at);
    let log = worst(stride, f32::MIN_POSITIVE, f32::MAX, |x| ulps(log2_fixed(x), f64::from(x).log2()));
    println!("log2_fixed: {:.3} ulp at {:e}", log.error, log.at);
    let exp = worst(stride, 1e-30, 126.0, |x| ulps(exp2_fixed(-x), f64::from(-x).exp2()));
    println!("exp2_fixed: {:.3} ulp at {:e}", exp.error, exp.at);
    let exponents = [0.01, 0.3, 0.5, 1.0, 2.0, 3.3, 8.0, 10.0, 33.0, 50.0, 100.0, 333.3, 1000.0, 10_000.0];
    let powers = exponents.map(|exponent: f32| {
        let smallest = 2f64.powf(-125.9 / f64::from(exponent)) as f32;
        worst(stride.max(5), smallest.max(f32::MIN_POSITIVE), 1f32.next_down(), |x| power_error(x, exponent))
    });
    let power = powers.into_iter().max_by(|a, b| a.error.total_cmp(&b.error)).expect("an exponent");
    println!("power_fixed: {:.3} EPSILON (1 + |ln result|) at {:e}", power.error, power.at);
    // The bounds that cl/shared/math.cl states.
    for (name, worst, bound) in [("sine", sine, 3.3), ("log2", log, 3.1), ("exp2", exp, 0.9), ("power", power, 4.0)] {
        assert!(worst.error <= bound, "{name}: {worst:?}");
    }
}

/// The sine of 2 pi x, in f64 right to its last bits also next to its zeros.
fn sine_of_turns(x: f32) -> f64 {
    let half_turns = (2.0 * f64::from(x)).round();
    let sine = (TAU * (f64::from(x) - half_turns / 2.0)).sin();
    if half_turns.rem_euclid(2.0) == 0.0 { sine } else { -sine }
}

/// The relative error of a power in units of EPSILON (1 + |ln result|).
fn power_error(base: f32, exponent: f32) -> f64 {
    let exact = f64::from(base).powf(exponent.into());
    (f64::from(power_fixed(base, exponent)) - exact).abs() / (exact * EPSILON * (1.0 - exact.ln()))
}

#[test]
fn elementary_functions_keep_their_bounds() {
    functions_keep_their_bounds(61);
}

#[test]
#[ignore = "all float32 arguments, of the power every fifth: minutes"]
fn elementary_functions_keep_their_bounds_everywhere() {
    functions_keep_their_bounds(1);
}

/// Around every eighth of a turn the reduced argument is the true one: each sign and each zero is right.
#[test]
fn sines_are_reduced_without_error() {
    let turns =
        (0..=64).chain([4095, 262_143, 2_097_152, 4_194_303].map(|whole| 8 * whole + 3)).map(|i| i as f32 / 8.0);
    for x in turns.flat_map(|x| [x, x.next_up(), x.next_down(), -x, -x.next_up(), -x.next_down()]) {
        assert!(ulps(sin_turns(x), sine_of_turns(x)) <= 3.3, "{x:e}: {:e}, not {:e}", sin_turns(x), sine_of_turns(x));
    }
    for x in [0.0, 0.5, -1.0, 4_194_303.5, 8_388_609.0, 1e30, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(sin_turns(x), 0.0, "the sine of {x} turns");
    }
}

#[test]
fn powers_are_defined_where_they_have_no_bound() {
    for (base, exponent, power) in [
        (0.5, 0.0, 1.0),
        (0.0, 0.0, 1.0),
        (0.0, 1e-45, 0.0),
        (1e-45, 0.5, 0.0),
        (f32::NAN, 2.0, 0.0),
        (1.0, 10_000.0, 1.0),
        (f32::INFINITY, 10_000.0, 1.0),
        (0.5, f32::NAN, 1.0),
        (0.5, f32::INFINITY, 0.0),
        (1e-30, 10_000.0, 0.0),
        (-1.0, 2.0, 0.0),
    ] {
        assert_eq!(power_fixed(base, exponent), power, "{base} ^ {exponent}");
    }
}
