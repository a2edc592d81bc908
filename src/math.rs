//! Plain arithmetic with the same bits everywhere: the operations of `cl/shared/math.cl` in their order. The reasons
//! are there. Builders use it, and the twin.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x > 0)` is also true for NaN, and that is meant

use crate::shared::constants::{
    EXP2_1, EXP2_2, EXP2_3, EXP2_4, EXP2_5, EXP2_6, EXP2_7, LARGEST_SCALED, LOG2_1, LOG2_3, LOG2_5, LOG2_7, LOG2_9,
    LOG2_MOST, MOST_TURNS, SIN_1, SIN_3, SIN_5, SIN_7, SIN_9, SIN_11, SIN_13, SMALLEST_SCALED,
};
use glam::Vec3;

pub use crate::shared::constants::LIFT;

/// `a*b - c*d` with an error of at most 1.5 ulp (Kahan).
#[inline(always)]
pub fn difference_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let cd = c * d;
    let rounding = (-c).mul_add(d, cd);
    a.mul_add(b, -cd) + rounding
}

/// Scalar product.
#[inline(always)]
pub fn dot3(a: Vec3, b: Vec3) -> f32 {
    a.x.mul_add(b.x, a.y.mul_add(b.y, a.z * b.z))
}

/// Vector product.
#[inline(always)]
pub fn cross3(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    )
}

/// `a*s + b`.
#[inline(always)]
pub fn fma3(a: Vec3, s: f32, b: Vec3) -> Vec3 {
    Vec3::new(a.x.mul_add(s, b.x), a.y.mul_add(s, b.y), a.z.mul_add(s, b.z))
}

/// The larger; `b` when `a` is NaN.
#[inline(always)]
pub fn max_or(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller; `b` when `a` is NaN.
#[inline(always)]
pub fn min_or(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The largest component.
#[inline(always)]
pub fn max_component(v: Vec3) -> f32 {
    max_or(v.x, max_or(v.y, v.z))
}

/// Component-wise magnitude.
#[inline(always)]
pub fn abs3(v: Vec3) -> Vec3 {
    Vec3::new(v.x.abs(), v.y.abs(), v.z.abs())
}

/// `x` limited to 0..1; NaN becomes 0.
#[inline(always)]
pub fn clamp01(x: f32) -> f32 {
    if x > 0.0 { if x < 1.0 { x } else { 1.0 } } else { 0.0 }
}

/// Whether every component is a number.
#[inline(always)]
pub fn is_finite3(v: Vec3) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}

/// What x > 0 would have in its exponent's bits if they had no lower end.
#[inline(always)]
pub fn exponent_field(x: f32) -> i32 {
    let bits = x.to_bits();
    if bits >= 0x0080_0000 { (bits >> 23) as i32 } else { 9 - bits.leading_zeros() as i32 }
}

/// The power of two that brings `magnitude` into [1, 2).
#[inline(always)]
pub fn power_of_two_scale(magnitude: f32) -> f32 {
    f32::from_bits((254 - (magnitude.to_bits() >> 23)) << 23)
}

/// Brings `v` to a largest component in [1, 2); `None` when it is zero, infinite or NaN. Returns the vector and the
/// factor.
#[inline(always)]
pub fn scale_to_unit(mut v: Vec3) -> Option<(Vec3, f32)> {
    let mut magnitude = max_component(abs3(v));
    let mut scale = 1.0;
    if !(magnitude > 0.0) || !is_finite3(v) {
        return None;
    }
    if magnitude < SMALLEST_SCALED {
        v *= LIFT;
        scale *= LIFT;
        magnitude *= LIFT;
    }
    if magnitude > LARGEST_SCALED {
        v *= 1.0 / LIFT;
        scale *= 1.0 / LIFT;
        magnitude *= 1.0 / LIFT;
    }
    let s = power_of_two_scale(magnitude);
    Some((v * s, scale * s))
}

/// `v / |v|`, or `otherwise` when `v` has no direction.
#[inline(always)]
pub fn normalize3(v: Vec3, otherwise: Vec3) -> Vec3 {
    match scale_to_unit(v) {
        Some((v, _)) => v * (1.0 / dot3(v, v).sqrt()),
        None => otherwise,
    }
}

/// The normals of a triangle's corners at unit length, so that interpolation weighs them alike; all zero where one has
/// no direction.
#[inline(always)]
pub fn unit_normals(normals: [Vec3; 3]) -> [Vec3; 3] {
    let unit = normals.map(|n| normalize3(n, Vec3::ZERO) + 0.0);
    if unit.contains(&Vec3::ZERO) { [Vec3::ZERO; 3] } else { unit }
}

/// Sine of `x` turns.
#[inline(always)]
pub fn sin_turns(x: f32) -> f32 {
    let turns = x.abs();
    let mut r = if turns < MOST_TURNS { turns - turns.floor() } else { 0.0 };
    r = if r > 0.75 {
        r - 1.0
    } else if r > 0.25 {
        0.5 - r
    } else {
        r
    };
    r = if x < 0.0 { -r } else { r };
    let r2 = r * r;
    let mut p = SIN_13;
    p = p.mul_add(r2, SIN_11);
    p = p.mul_add(r2, SIN_9);
    p = p.mul_add(r2, SIN_7);
    p = p.mul_add(r2, SIN_5);
    p = p.mul_add(r2, SIN_3);
    p = p.mul_add(r2, SIN_1);
    p * r
}

/// Logarithm of a normal `x > 0` to base 2.
#[inline(always)]
pub fn log2_fixed(x: f32) -> f32 {
    let bits = x.to_bits();
    let mut m = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    let mut e = (bits >> 23) as i32 - 127;
    if m > LOG2_MOST {
        m *= 0.5;
        e += 1;
    }
    let f = (m - 1.0) / (m + 1.0);
    let f2 = f * f;
    let mut p = LOG2_9;
    p = p.mul_add(f2, LOG2_7);
    p = p.mul_add(f2, LOG2_5);
    p = p.mul_add(f2, LOG2_3);
    p = p.mul_add(f2, LOG2_1);
    p.mul_add(f, e as f32)
}

/// 2 to the power of `x <= 0`; 0 below -126.
#[inline(always)]
pub fn exp2_fixed(x: f32) -> f32 {
    if !(x >= -126.0) {
        return 0.0;
    }
    let n = (x + 0.5).floor();
    let r = x - n;
    let mut p = EXP2_7;
    p = p.mul_add(r, EXP2_6);
    p = p.mul_add(r, EXP2_5);
    p = p.mul_add(r, EXP2_4);
    p = p.mul_add(r, EXP2_3);
    p = p.mul_add(r, EXP2_2);
    p = p.mul_add(r, EXP2_1);
    p = p.mul_add(r, 1.0);
    p * f32::from_bits(((n as i32 + 127) as u32) << 23)
}

/// `base` (0..1) to the power of `exponent >= 0`.
#[inline(always)]
pub fn power_fixed(base: f32, exponent: f32) -> f32 {
    if !(exponent > 0.0) || base >= 1.0 {
        return 1.0;
    }
    if !(base >= f32::MIN_POSITIVE) {
        return 0.0;
    }
    exp2_fixed(exponent * log2_fixed(base))
}

/// The middle value, or the mean of the two; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => None,
        n if n % 2 == 1 => Some(sorted[middle]),
        _ => Some((sorted[middle - 1] + sorted[middle]) / 2.0),
    }
}
