//! Constants of the arithmetic that kernels (`cl/`) and twin (`src/reference/`) do alike: typed here, and nowhere else.
//!
//! `cl/shared/constants.cl` is generated from this file. Why a constant has its value is said where it is used: in the
//! file of `cl/` that its group names.

#![allow(clippy::excessive_precision)] // decimals as their sources have them

use crate::bounds::EPSILON;
use crate::layout::{ConstantGroup, device_const};
use glam::Vec3;

/// 2 to the power of `exponent`, which is that of a float.
pub(super) const fn power_of_two(exponent: i32) -> f32 {
    assert!(-149 <= exponent && exponent <= 127);
    f32::from_bits(if exponent < -126 { 1 << (exponent + 149) } else { ((exponent + 127) as u32) << 23 })
}

device_const! {
    /// Rays: `cl/shared/ray.cl`.
    pub group RAYS;
    /// A direction whose components are all below this is lifted by LIFT.
    pub const SHORT_DIRECTION: f32 = power_of_two(-100);
    /// What a direction is lifted by where its least component would lose bits.
    pub const SMALL_TURN_LIFT: f32 = power_of_two(60);
    /// What a rounded triangle test may be off from the plane of a neighbour, times the largest component of the edges.
    pub const POINT_ERROR: f32 = 4.0 * EPSILON;
}

device_const! {
    /// The point that a ray leaves a triangle from: `cl/shared/rounding_errors.cl`.
    pub group POINTS;
    /// Summands of the point.
    pub const POINT_TERMS: usize = 9;
    /// Passes of error-free sums over them.
    pub const POINT_PASSES: usize = 3;
}

device_const! {
    /// Vector arithmetic and elementary functions: `cl/shared/math.cl`.
    pub group MATH;
    /// Below this a squared length would lose bits to underflow.
    pub const SMALLEST_SCALED: f32 = 1.0e-30;
    /// Above this a squared length would overflow.
    pub const LARGEST_SCALED: f32 = 1.0e18;
    /// Brings the smallest subnormal number into the normal range.
    pub const LIFT: f32 = power_of_two(64);
    /// From so many turns on a float is a multiple of half a turn.
    pub const MOST_TURNS: f32 = power_of_two(22);
    /// (2 pi)^13 / 13!
    pub const SIN_13: f32 = 3.81995259;
    /// -(2 pi)^11 / 11!
    pub const SIN_11: f32 = -15.0946426;
    /// (2 pi)^9 / 9!
    pub const SIN_9: f32 = 42.0586939;
    /// -(2 pi)^7 / 7!
    pub const SIN_7: f32 = -76.7058598;
    /// (2 pi)^5 / 5!
    pub const SIN_5: f32 = 81.6052493;
    /// -(2 pi)^3 / 3!
    pub const SIN_3: f32 = -41.3417022;
    /// 2 pi
    pub const SIN_1: f32 = std::f32::consts::TAU;
    /// The largest significand of which the logarithm's series is taken.
    pub const LOG2_MOST: f32 = std::f32::consts::SQRT_2;
    /// 2 / (9 ln 2)
    pub const LOG2_9: f32 = 0.32059889;
    /// 2 / (7 ln 2)
    pub const LOG2_7: f32 = 0.41219858;
    /// 2 / (5 ln 2)
    pub const LOG2_5: f32 = 0.57707802;
    /// 2 / (3 ln 2)
    pub const LOG2_3: f32 = 0.96179669;
    /// 2 / ln 2
    pub const LOG2_1: f32 = 2.88539008;
    /// (ln 2)^7 / 7!
    pub const EXP2_7: f32 = 1.52527338e-5;
    /// (ln 2)^6 / 6!
    pub const EXP2_6: f32 = 1.54035304e-4;
    /// (ln 2)^5 / 5!
    pub const EXP2_5: f32 = 1.33335581e-3;
    /// (ln 2)^4 / 4!
    pub const EXP2_4: f32 = 9.61812911e-3;
    /// (ln 2)^3 / 3!
    pub const EXP2_3: f32 = 5.55041087e-2;
    /// (ln 2)^2 / 2!
    pub const EXP2_2: f32 = 2.40226507e-1;
    /// ln 2
    pub const EXP2_1: f32 = 6.93147181e-1;
}

device_const! {
    /// Ropes: `cl/traverse/kd_ropes.cl`.
    pub group ROPES;
    /// The axis of the face that a ray has crossed last, before it has crossed one.
    pub const NO_AXIS: usize = 3;
}

device_const! {
    /// Errors of edge functions: `cl/intersect/edges.cl`.
    pub group EDGES;
    /// Times extent and distance.
    pub const EDGE_ERROR: f32 = 13.0 * EPSILON;
    /// The same of a ray that does not start at its origin.
    pub const EDGE_ERROR_LOW: f32 = 38.0 * EPSILON;
    /// Times the extent's square.
    pub const EDGE_ERROR_EXTENT: f32 = 8.0 * EPSILON;
    /// Times the distance's square.
    pub const EDGE_ERROR2: f32 = 220.0 * EPSILON * EPSILON;
    /// What underflows.
    pub const LEAST_EDGE: f32 = power_of_two(-60);
}

device_const! {
    /// The first two steps of the exact test: `cl/intersect/exact_filter.cl`.
    pub group FILTERS;
    /// What the error of edge functions makes of t, times the triangle's extent in depth.
    pub const SPREAD_ERROR: f32 = 3.1;
    /// What t is off by beside that, times the largest depth.
    pub const DEPTH_ERROR: f32 = 26.0 * EPSILON;
    /// What underflows of it.
    pub const LEAST_DEPTH: f32 = power_of_two(-64);
    /// With double: the relative error of one operation.
    pub const DOUBLE_EPSILON: f32 = power_of_two(-53);
    /// Errors of T, D, U and V.
    pub const DOUBLE_ERROR: f32 = EXTENDED_ROUNDINGS * DOUBLE_EPSILON;
    /// Those of W.
    pub const DOUBLE_ERROR_W: f32 = EXTENDED_ROUNDINGS_W * DOUBLE_EPSILON;
    /// The error of a start's second part, in units of that of T.
    pub const DOUBLE_START_ERROR: f32 = SECOND_PART_ERROR / DOUBLE_ERROR;
    /// What no float is small enough for of it, in units of the relative error.
    pub const DOUBLE_LEAST_FROM: f32 = LEAST_START / DOUBLE_EPSILON;
    /// The same five with pairs of floats: the relative error of one operation.
    pub const PAIR_EPSILON: f32 = power_of_two(-44);
    /// Errors of T, D, U and V.
    pub const PAIR_ERROR: f32 = EXTENDED_ROUNDINGS * PAIR_EPSILON;
    /// Those of W.
    pub const PAIR_ERROR_W: f32 = EXTENDED_ROUNDINGS_W * PAIR_EPSILON;
    /// The error of a start's second part.
    pub const PAIR_START_ERROR: f32 = SECOND_PART_ERROR / PAIR_ERROR;
    /// What no float is small enough for of it.
    pub const PAIR_LEAST_FROM: f32 = LEAST_START / PAIR_EPSILON;
    /// Below this a product of floats may have underflowed.
    pub const LEAST_MAGNITUDE: f32 = power_of_two(-80);
    /// A denominator that is off by more, relative to itself, tells no quotient.
    pub const MOST_DET_ERROR: f32 = power_of_two(-10);
    /// The first order of a quotient's error, times this, is more than all of it.
    pub const QUOTIENT_MARGIN: f32 = 1.01;
}

/// Errors of T, D, U and V, in units of the relative error of one operation; `cl/intersect/exact_filter.cl` counts
/// them.
const EXTENDED_ROUNDINGS: f32 = 10.0;
/// Those of W.
const EXTENDED_ROUNDINGS_W: f32 = 14.0;
/// What the second part of a start is off by, relative to itself.
const SECOND_PART_ERROR: f32 = 4.0 * EPSILON;
/// What no float is small enough for of it.
const LEAST_START: f32 = power_of_two(-145);

device_const! {
    /// The last step of the exact test: `cl/intersect/exact_integers.cl`.
    pub group INTEGERS;
    /// Numbers from this times a power of two on have no nearest float: FLT_MAX and half of its last bit.
    pub const INFINITE_SIGNIFICAND: u32 = (1 << 25) - 1;
    /// The power's exponent.
    pub const INFINITE_EXPONENT: i32 = 103;
    /// Bits of a quotient beside those of its positions and directions.
    pub const QUOTIENT_BITS: i32 = 34;
    /// The same of a comparison of two t.
    pub const COMPARISON_BITS: i32 = 40;
}

device_const! {
    /// The triangle test of the thesis: `cl/intersect/thesis.cl`.
    pub group THESIS;
    /// Below this the test takes determinants and distances, in world units, for zero.
    pub const THESIS_EPSILON: f32 = 1.0e-6;
}

device_const! {
    /// Shading: `cl/shade/normal.cl`, `light.cl`, `footprint.cl`, `texture.cl` and `roulette.cl`.
    pub group SHADING;
    /// Where all components of an interpolated normal are smaller than this, none needs to have the right sign.
    pub const LARGEST_NORMAL_NOISE: f32 = 8.0 * EPSILON;
    /// The strength from which on a smooth highlight is one of a cartoon.
    pub const TOON_HIGHLIGHT: f32 = 0.5;
    /// What the cosine between a cone and a surface counts as at least.
    pub const LEAST_CONE_COSINE: f32 = power_of_two(-7);
    /// More texels than any texture has on a side.
    pub const MORE_TEXELS: f32 = power_of_two(31);
    /// What 1 is in units of the random numbers of Russian roulette.
    pub const ROULETTE_UNITS: f32 = power_of_two(24);
}

device_const! {
    /// Procedural textures: `cl/shade/procedural.cl`.
    pub group PATTERNS;
    /// From here on a coordinate is in no cell of its own: no int could number it.
    pub const CELL_LIMIT: f32 = power_of_two(31);
    /// Of a cell's hash: the factor of x.
    pub const HASH_X: u32 = 0x9e37_79b1;
    /// That of y.
    pub const HASH_Y: u32 = 0x85eb_ca77;
    /// That of z.
    pub const HASH_Z: u32 = 0xc2b2_ae3d;
    /// That of the seed.
    pub const HASH_SEED: u32 = 0x27d4_eb2f;
    /// The first factor of the finaliser.
    pub const HASH_FIRST: u32 = 0x85eb_ca6b;
    /// The second one.
    pub const HASH_SECOND: u32 = 0xc2b2_ae35;
    /// By how much an octave of noise is moved against the one before.
    pub const OCTAVE_SHIFT: Vec3 = Vec3::new(0.8191725, 0.6710436, 0.5497005);
    /// Share of a year's ring that is early wood.
    pub const EARLY_WOOD: f32 = 0.85;
    /// The frequencies of the noise that bends the rings.
    pub const WOOD_NOISE: Vec3 = Vec3::new(0.25, 0.03125, 0.25);
    /// How far beneath the surface a solid texture is looked at, times the triangle's largest coordinate.
    pub const SOLID_DEPTH: f32 = 12.0 * EPSILON;
}

/// The constants of this file.
pub(super) const ARITHMETIC: [ConstantGroup; 10] =
    [RAYS, POINTS, MATH, ROPES, EDGES, FILTERS, INTEGERS, THESIS, SHADING, PATTERNS];
