//! Twin of `cl/intersect/exact_filter.cl`: the steps of the exact test in rounded arithmetic. The reasons are there.

use super::edges::Edges;
use super::moller_trumbore::Intersection;
use super::watertight::ShearedTriangle;
use crate::bounds::EPSILON;
use crate::fma::with_fma;
use crate::reference::shared::math::{abs3, dot3, fma3, max_or, min_or};
use crate::reference::shared::ray::Ray;
use crate::shared::Hit;
use crate::shared::constants::{
    DEPTH_ERROR, LEAST_DEPTH, LEAST_MAGNITUDE, MOST_DET_ERROR, QUOTIENT_MARGIN, SPREAD_ERROR,
};
// `f64` is the twin's only kind of extended numbers.
use crate::shared::constants::{
    DOUBLE_EPSILON as EXTENDED_EPSILON, DOUBLE_ERROR as EXTENDED_ERROR, DOUBLE_ERROR_W as EXTENDED_ERROR_W,
    DOUBLE_LEAST_FROM as LEAST_FROM, DOUBLE_START_ERROR as START_ERROR,
};
use glam::{DVec3, Vec3};

/// What a step finds out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    /// Surely no hit, or none that matters.
    Miss,
    /// Surely a hit, its t within these limits.
    Hit([f32; 2]),
    /// Not certain.
    Undecided,
}

/// `None`: surely no hit. Else whether it is one for sure, and limits of its t.
#[inline(always)]
pub fn decide_rounded(s: &ShearedTriangle) -> Option<(bool, [f32; 2])> {
    let [a, b, c] = s.vertices;
    let edges = Edges::new(s.error, s.vertices);
    if edges.surely_missed() {
        return None;
    }
    let Edges { weights: [weight0, weight1, weight2], low, high, bound } = edges;
    let (nearest, farthest) = (min_or(a.z, min_or(b.z, c.z)), max_or(a.z, max_or(b.z, c.z)));
    let depth_error = DEPTH_ERROR.mul_add(max_or(nearest.abs(), farthest.abs()), LEAST_DEPTH);
    let is_inside = low > bound || high < -bound;
    if !is_inside {
        let (t_nearest, t_farthest) = (nearest * s.inv_direction_z, farthest * s.inv_direction_z);
        let limits = [min_or(t_nearest, t_farthest) - depth_error, max_or(t_nearest, t_farthest) + depth_error];
        return Some((false, limits));
    }
    let det = weight0 + weight1 + weight2;
    let z_weighted = weight0.mul_add(a.z, weight1.mul_add(b.z, weight2 * c.z));
    let inv_det = 1.0 / det;
    let t = z_weighted * inv_det * s.inv_direction_z;
    let error = (SPREAD_ERROR * bound).mul_add((farthest - nearest) * inv_det.abs(), depth_error);
    Some((true, [t - error, t + error]))
}

/// What limits of its t say of a hit.
#[inline(always)]
pub fn place_hit(ray: &Ray, hit: &Hit, limits: [f32; 2]) -> Decision {
    let [t_low, t_high] = limits;
    if t_high < ray.t_near || t_low > hit.t {
        return Decision::Miss;
    }
    if t_low > ray.t_near && t_high < hit.u { Decision::Hit(limits) } else { Decision::Undecided }
}

#[inline(always)]
fn magnitude_dot(a: Vec3, b: Vec3) -> f32 {
    dot3(abs3(a), abs3(b))
}

#[inline(always)]
fn magnitude_cross(a: Vec3, b: Vec3) -> Vec3 {
    let (x, y) = (abs3(a), abs3(b));
    Vec3::new(x.y * y.z + x.z * y.y, x.z * y.x + x.x * y.z, x.x * y.y + x.y * y.x)
}

/// A number and a bound of its error.
#[derive(Debug, Clone, Copy)]
struct Bounded(f64, f32);

/// The numbers behind every answer.
struct ExtendedNumbers {
    distance: Bounded,
    det: Bounded,
    weights: [Bounded; 3],
}

#[inline(always)]
fn extended_numbers(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> ExtendedNumbers {
    let extended = DVec3::from;
    let (edge1, edge2) = (extended(p1) - extended(p0), extended(p2) - extended(p0));
    let (from, direction) = (extended(p0) - extended(ray.origin) - extended(ray.origin_low), extended(ray.direction));
    let (normal, moment) = (edge1.cross(edge2), from.cross(direction));
    let dot = |a: DVec3, b: DVec3| a.x * b.x + a.y * b.y + a.z * b.z;
    let (distance, det) = (dot(normal, from), dot(normal, direction));
    let (weight1, weight2) = (dot(edge2, moment), -dot(edge1, moment));
    let weight0 = det - weight1 - weight2;

    let (magnitude1, magnitude2) = (p1 - p0, p2 - p0);
    let from_magnitude = fma3(abs3(ray.origin_low), START_ERROR, abs3((p0 - ray.origin) - ray.origin_low)) + LEAST_FROM;
    let normal_magnitude = magnitude_cross(magnitude1, magnitude2);
    let moment_magnitude = magnitude_cross(from_magnitude, ray.direction);
    let det_magnitude = magnitude_dot(normal_magnitude, ray.direction);
    let magnitude_1 = magnitude_dot(magnitude2, moment_magnitude);
    let magnitude_2 = magnitude_dot(magnitude1, moment_magnitude);
    ExtendedNumbers {
        distance: Bounded(distance, EXTENDED_ERROR * magnitude_dot(normal_magnitude, from_magnitude)),
        det: Bounded(det, EXTENDED_ERROR * det_magnitude),
        weights: [
            Bounded(weight0, EXTENDED_ERROR_W * (det_magnitude + magnitude_1 + magnitude_2)),
            Bounded(weight1, EXTENDED_ERROR * magnitude_1),
            Bounded(weight2, EXTENDED_ERROR * magnitude_2),
        ],
    }
}

#[inline(always)]
fn is_bound(bound: f32) -> bool {
    bound > LEAST_MAGNITUDE * EXTENDED_EPSILON && bound <= f32::MAX
}

#[inline(always)]
fn sure_sign(Bounded(number, bound): Bounded) -> i32 {
    let value = number as f32;
    if is_bound(bound) { i32::from(value > bound) - i32::from(value < -bound) } else { 0 }
}

with_fma! {
    /// Step 2.
    pub fn decide_extended(ray: &Ray, triangle: [Vec3; 3]) -> Decision {
        let n = extended_numbers(ray, triangle);
        let sign = sure_sign(n.det);
        let [sign0, sign1, sign2] = n.weights.map(sure_sign);
        if sign0 * sign1 < 0 || sign1 * sign2 < 0 || sign2 * sign0 < 0 {
            return Decision::Miss;
        }
        let is_inside = sign != 0 && sign0 == sign && sign1 == sign && sign2 == sign;
        if !is_inside || !is_bound(n.distance.1) {
            return Decision::Undecided;
        }
        let t = (n.distance.0 / n.det.0) as f32;
        let error = QUOTIENT_MARGIN * t.abs().mul_add(n.det.1, n.distance.1) / ((n.det.0 as f32).abs() - n.det.1);
        if t.abs() > LEAST_MAGNITUDE {
            let half = (4.0 * EPSILON).mul_add(t.abs(), error);
            Decision::Hit([t - half, t + half])
        } else {
            Decision::Undecided
        }
    }
}

/// The float that the quotient, its parts off by no more than their bounds, surely rounds to.
#[inline(always)]
fn rounds_surely(
    Bounded(numerator, numerator_bound): Bounded,
    Bounded(denominator, denominator_bound): Bounded,
) -> Option<f32> {
    if !is_bound(numerator_bound) || !is_bound(denominator_bound) {
        return None;
    }
    let inverse = 1.0 / denominator;
    let det_error = denominator_bound / (denominator as f32).abs();
    let quotient = numerator * inverse;
    let relative = QUOTIENT_MARGIN.mul_add(det_error, 8.0 * EXTENDED_EPSILON);
    let error = f64::from(
        (QUOTIENT_MARGIN * numerator_bound).mul_add((inverse as f32).abs(), (quotient as f32).abs() * relative),
    );
    let rounded = (quotient + error) as f32;
    let is_sure = det_error < MOST_DET_ERROR && (quotient - error) as f32 == rounded && rounded.abs() > LEAST_MAGNITUDE;
    is_sure.then_some(rounded)
}

/// t in the caller's units, u and v of a triangle that is hit, where step 2 is sure how they round.
#[inline(always)]
pub fn finish_extended(ray: &Ray, triangle: [Vec3; 3]) -> Option<Intersection> {
    let n = extended_numbers(ray, triangle);
    let [_, weight1, weight2] = n.weights;
    let t = ray.callers_t(rounds_surely(n.distance, n.det)?);
    t.is_normal().then_some(())?;
    Some(Intersection { t, u: rounds_surely(weight1, n.det)?, v: rounds_surely(weight2, n.det)? })
}

/// The weight of vertex 0, likewise.
#[inline(always)]
pub fn weight0_extended(ray: &Ray, triangle: [Vec3; 3]) -> Option<f32> {
    let n = extended_numbers(ray, triangle);
    rounds_surely(n.weights[0], n.det)
}
