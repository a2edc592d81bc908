//! Twin of `cl/shared/ray.cl`: rays, their limits, and how a ray leaves a surface. The reasons are there. A ray's shear
//! is not kept here: `shear_triangle` in `watertight.rs` computes it.

use super::math::{LIFT, abs3, exponent_field, fma3, is_finite3, max_component, max_or, min_or, scale_to_unit};
use crate::bounds::{PLANE_ERROR, WIDEN_DOWN, WIDEN_UP};
use crate::shared::Hit;
use crate::shared::constants::{POINT_ERROR, POINT_PASSES, POINT_TERMS, SHORT_DIRECTION, SMALL_TURN_LIFT};
use glam::Vec3;

/// `v` with the component along `axis` exchanged with z.
#[inline(always)]
pub fn swap_to_z(v: Vec3, axis: usize) -> Vec3 {
    match axis {
        0 => Vec3::new(v.z, v.y, v.x),
        1 => Vec3::new(v.x, v.z, v.y),
        _ => v,
    }
}

/// The axis of the largest component of a direction.
#[inline(always)]
pub fn major_axis(direction: Vec3) -> usize {
    let size = abs3(direction);
    if size.x >= size.y {
        if size.x >= size.z { 0 } else { 2 }
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

/// By how much z moves x along a direction.
#[inline(always)]
pub fn shear_towards(x: f32, z: f32, inv_z: f32) -> f32 {
    let shear = x * inv_z;
    (-shear).mul_add(z, x).mul_add(inv_z, shear)
}

/// A ray ready for traversal.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Tracing space.
    pub origin: Vec3,
    /// The ray starts at `origin + origin_low`.
    pub origin_low: Vec3,
    /// Largest component in [1, 2), or in [2^60, 2^61) where another one would lose bits.
    pub direction: Vec3,
    /// Component-wise reciprocal.
    pub inv_direction: Vec3,
    /// Start of the closed interval.
    pub t_near: f32,
    /// End of the closed interval.
    pub t_far: f32,
    /// The interval as the caller gave it, in the caller's units.
    pub t_min: f32,
    /// Its end.
    pub t_max: f32,
    /// Factor from the ray's t to the caller's.
    pub t_scale: f32,
    /// Another one.
    pub t_lift: f32,
    /// Triangle that is never hit: the one that the ray starts on.
    pub skip: u32,
    /// Where on it, as weights of its vertices; the largest is -1. All 0: at `origin`.
    pub start_weights: Vec3,
    /// What was found before, as a traversal leaves it: hits that do not come after it do not count.
    pub after: Hit,
    /// So many hits are counted, and no more; 0: the closest or any hit is wanted.
    pub most: u32,
}

#[inline(always)]
fn clamp_to_floats(t: f32) -> f32 {
    min_or(max_or(t, -f32::MAX), f32::MAX)
}

#[inline(always)]
fn reciprocal_or_nan(x: f32) -> f32 {
    let r = 1.0 / x;
    if x != 0.0 && !r.is_finite() { f32::NAN } else { r }
}

impl Ray {
    /// A ray with NaN or infinite parts or without direction misses everything.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3, t_near: f32, t_far: f32, skip: u32) -> Ray {
        let is_short = max_component(abs3(direction)) < SHORT_DIRECTION;
        let (direction, t_lift) = if is_short { (direction * LIFT, LIFT) } else { (direction, 1.0) };
        let scaled = scale_to_unit(direction);
        let given = direction;
        let (mut direction, mut t_scale) = scaled.unwrap_or((direction, 1.0));
        let lifted = given * (t_scale * SMALL_TURN_LIFT);
        if (0..3).any(|k| given[k] != 0.0 && direction[k].abs() < f32::MIN_POSITIVE && lifted[k] != 0.0) {
            t_scale *= SMALL_TURN_LIFT;
            direction = lifted;
        }
        let sound = scaled.is_some() && is_finite3(origin) && t_near <= t_far;
        let direction = direction + Vec3::ZERO; // -0 becomes +0
        let mut ray = Ray {
            origin,
            origin_low: Vec3::ZERO,
            direction,
            inv_direction: Vec3::new(
                reciprocal_or_nan(direction.x),
                reciprocal_or_nan(direction.y),
                reciprocal_or_nan(direction.z),
            ),
            t_near: f32::INFINITY,
            t_far: f32::NEG_INFINITY,
            t_min: t_near,
            t_max: t_far,
            t_scale,
            t_lift,
            skip,
            start_weights: Vec3::ZERO,
            after: NO_HIT,
            most: 0,
        };
        if sound {
            ray.limit(t_near, t_far);
        }
        ray
    }

    /// Sets the interval, in the caller's units.
    #[inline(always)]
    pub fn limit(&mut self, t_near: f32, t_far: f32) {
        (self.t_min, self.t_max) = (t_near, t_far);
        self.t_near = self.own_limit(t_near);
        self.t_far = self.own_limit(t_far);
    }

    /// Twin of `own_limit`.
    #[inline(always)]
    fn own_limit(&self, limit: f32) -> f32 {
        let limit = clamp_to_floats(limit);
        let own = clamp_to_floats(limit / self.t_lift / self.t_scale);
        if own == 0.0 && limit != 0.0 { f32::from_bits(1).copysign(limit) } else { own }
    }

    /// The power of two by which the caller's t is the ray's.
    pub fn t_exponent(&self) -> i32 {
        exponent_field(self.t_lift) + exponent_field(self.t_scale) - 254
    }

    /// Whether it starts at an exact point of triangle `skip`.
    #[inline(always)]
    pub fn starts_on_triangle(&self) -> bool {
        self.start_weights.min_element() < 0.0
    }

    /// `t` in the caller's units.
    #[inline(always)]
    pub fn callers_t(&self, t: f32) -> f32 {
        t * self.t_lift * self.t_scale
    }

    /// Where `p` lies as seen from the start of the ray.
    #[inline(always)]
    pub fn from_origin(&self, p: Vec3) -> Vec3 {
        (p - self.origin) - self.origin_low
    }

    /// The part of the ray inside the box, or `None`.
    #[inline(always)]
    pub fn clip_to_box(&self, low: Vec3, high: Vec3) -> Option<(f32, f32)> {
        let (mut t_near, mut t_far) = (self.t_near, self.t_far);
        let (to_low, to_high) = (self.from_origin(low), self.from_origin(high));
        for axis in 0..3 {
            let inv_direction = self.inv_direction[axis];
            let t_low = (to_low[axis] - PLANE_ERROR) * inv_direction;
            let t_high = (to_high[axis] + PLANE_ERROR) * inv_direction;
            narrow_interval(t_low, t_high, inv_direction, &mut t_near, &mut t_far);
        }
        (t_near <= t_far).then_some((t_near, t_far))
    }

    /// As [`Ray::clip_to_box`], for a box that is larger by `slack` on all sides.
    #[inline(always)]
    pub fn clip_to_thick_box(&self, slack: f32, low: Vec3, high: Vec3) -> Option<(f32, f32)> {
        let (mut t_near, mut t_far) = (self.t_near, self.t_far);
        let (to_low, to_high) = (self.from_origin(low), self.from_origin(high));
        for axis in 0..3 {
            let inv_direction = self.inv_direction[axis];
            let t_low = (to_low[axis] - slack) * inv_direction;
            let t_high = (to_high[axis] + slack) * inv_direction;
            narrow_interval(t_low, t_high, inv_direction, &mut t_near, &mut t_far);
        }
        (t_near <= t_far).then_some((t_near, t_far))
    }

    /// No corner of the box is farther from the origin on any axis.
    #[inline(always)]
    pub fn farthest_distance(&self, low: Vec3, high: Vec3) -> f32 {
        let to_low = abs3(self.from_origin(low));
        let to_high = abs3(self.from_origin(high));
        let farthest = max_or(max_component(to_low), max_component(to_high));
        if is_finite3(self.origin) { farthest } else { f32::NAN }
    }

    /// Whether a hit at `t` on `primitive` is inside the limits and nearer than `hit`, which began as `no_hit_yet`.
    #[inline(always)]
    pub fn is_nearer(&self, hit: &Hit, t: f32, primitive: u32) -> bool {
        t >= self.t_near && (t < hit.t || (t == hit.t && primitive < hit.primitive))
    }
}

#[inline(always)]
fn narrow_interval(t_low: f32, t_high: f32, inv_direction: f32, t_near: &mut f32, t_far: &mut f32) {
    let ascending = inv_direction >= 0.0;
    let t_enter = widen_down(if ascending { t_low } else { t_high });
    let t_leave = widen_up(if ascending { t_high } else { t_low });
    if t_enter > *t_near {
        *t_near = t_enter;
    }
    if t_leave < *t_far {
        *t_far = t_leave;
    }
}

/// The hit of a ray that missed.
pub const NO_HIT: Hit = Hit::NONE;

/// What a traversal begins with: no hit, but nothing behind the ray's end is nearer.
#[inline(always)]
pub fn no_hit_yet(ray: &Ray) -> Hit {
    Hit { t: ray.t_far, u: ray.t_far, ..NO_HIT }
}

/// `t` rounded up by more than its error.
#[inline(always)]
pub fn widen_up(t: f32) -> f32 {
    t * if t > 0.0 { WIDEN_UP } else { WIDEN_DOWN }
}

/// `t` rounded down by more than its error.
#[inline(always)]
pub fn widen_down(t: f32) -> f32 {
    t * if t > 0.0 { WIDEN_DOWN } else { WIDEN_UP }
}

/// A point of a triangle, exactly: the first of `vertices` plus `weights` times the edges from there to the other two.
#[derive(Debug, Clone, Copy)]
pub struct TrianglePoint {
    /// The one with the largest weight first, the others in their order.
    pub vertices: [Vec3; 3],
    /// Of the other two.
    pub weights: [f32; 2],
}

impl TrianglePoint {
    /// `p` itself.
    pub fn at(p: Vec3) -> Self {
        TrianglePoint { vertices: [p; 3], weights: [0.0; 2] }
    }

    /// The point of weights as [`Ray`] has them.
    #[inline(always)]
    pub fn of_weights([p0, p1, p2]: [Vec3; 3], weights: Vec3) -> Self {
        if weights.x < 0.0 {
            TrianglePoint { vertices: [p0, p1, p2], weights: [weights.y, weights.z] }
        } else if weights.y < 0.0 {
            TrianglePoint { vertices: [p1, p2, p0], weights: [weights.z, weights.x] }
        } else {
            TrianglePoint { vertices: [p2, p0, p1], weights: [weights.x, weights.y] }
        }
    }
}

#[inline(always)]
fn two_sum3(a: Vec3, b: Vec3) -> (Vec3, Vec3) {
    let sum = a + b;
    let part = sum - a;
    (sum, (a - (sum - part)) + (b - part))
}

#[inline(always)]
fn two_product3(v: Vec3, s: f32) -> (Vec3, Vec3) {
    let high = v * s;
    (high, fma3(v, s, -high))
}

/// The point, rounded, and the rest, rounded.
#[inline(always)]
pub fn start_on_triangle(point: &TrianglePoint) -> (Vec3, Vec3) {
    let ([base, other1, other2], [weight1, weight2]) = (point.vertices, point.weights);
    let mut terms = [Vec3::ZERO; POINT_TERMS];
    (terms[7], terms[3]) = two_product3(other1, weight1);
    (terms[6], terms[2]) = two_product3(base, -weight1);
    (terms[5], terms[1]) = two_product3(other2, weight2);
    (terms[4], terms[0]) = two_product3(base, -weight2);
    terms[8] = base;
    for _ in 0..POINT_PASSES {
        for i in 1..POINT_TERMS {
            (terms[i], terms[i - 1]) = two_sum3(terms[i], terms[i - 1]);
        }
    }
    let mut rest = terms[0];
    for &term in &terms[1..POINT_TERMS - 1] {
        rest += term;
    }
    two_sum3(terms[POINT_TERMS - 1], rest)
}

/// How far from its triangle a ray that starts there may meet the neighbours, by a rounded test.
#[inline(always)]
pub fn point_error([p0, p1, p2]: [Vec3; 3]) -> f32 {
    POINT_ERROR * max_or(max_component(abs3(p1 - p0)), max_component(abs3(p2 - p0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::EPSILON;
    use crate::random::Random;

    const SEED: u64 = 20_081_121;

    /// Whatever a device's division is off by, and for components of directions of any size.
    #[test]
    fn a_shear_is_off_by_no_more_than_a_rounding_whatever_the_reciprocal() {
        let mut random = Random::new(SEED);
        for i in 0..300_000 {
            let z = random.sign() * random.size(0, 1) * [1.0, (1u64 << 60) as f32][i % 2];
            let x = (z * random.signed()) * if i % 3 == 0 { random.size(-80, 0) } else { 1.0 };
            let inv_z = (1.0 / z) * (1.0 + 5.0 * EPSILON * random.signed());
            let exact = f64::from(x) / f64::from(z);
            let error = (f64::from(shear_towards(x, z, inv_z)) - exact).abs();
            assert!(error <= 1.001 * f64::from(EPSILON) * exact.abs(), "{x} / {z} by {inv_z}: {error} (seed {SEED})");
        }
    }
}
