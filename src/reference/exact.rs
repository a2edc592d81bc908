//! Twin of `cl/intersect/exact.cl`: the ray-triangle test that is right. The reasons are there.

use super::integer::{Integer, MAX_LIMBS, float_significand, integer_quotient, widen_exponents};
use super::intersect::{Intersection, ShearedTriangle, shear_triangle};
use super::math::{abs3, dot3, max_or, min_or};
use super::memory::{Work, load_vertices};
use super::ray::{EPSILON, Ray};
use crate::pack::SceneBuffers;
use crate::shared::Hit;
use glam::{DVec3, Vec3};

const SHEAR_ERROR: f32 = 64.0 * EPSILON;
const SHEAR_ERROR2: f32 = 320.0 * EPSILON * EPSILON;

#[inline(always)]
fn surely_misses(s: &ShearedTriangle, distance: f32) -> bool {
    let [weight0, weight1, weight2] = s.weights;
    let bound = distance * SHEAR_ERROR.mul_add(s.extent, SHEAR_ERROR2 * distance);
    let low = min_or(weight0, min_or(weight1, weight2));
    let high = max_or(weight0, max_or(weight1, weight2));
    low < -bound && high > bound
}

/// The relative error of one operation of `f64`, the twin's only kind of wide numbers.
const WIDE_EPSILON: f32 = (f64::EPSILON / 2.0) as f32;
const WIDE_ERROR: f32 = 10.0 * WIDE_EPSILON;
const WIDE_ERROR_W: f32 = 14.0 * WIDE_EPSILON;
const LEAST_MAGNITUDE: f32 = 1.0 / (1u128 << 80) as f32;

#[inline(always)]
fn sure_sign(number: f64, bound: f32) -> i32 {
    let value = number as f32;
    if bound > LEAST_MAGNITUDE * WIDE_EPSILON { i32::from(value > bound) - i32::from(value < -bound) } else { 0 }
}

/// The float that the quotient, its parts off by no more than their bounds, surely rounds to.
#[inline(always)]
fn rounds_surely(numerator: f64, numerator_bound: f32, denominator: f64, denominator_bound: f32) -> Option<f32> {
    let relative = numerator_bound / (numerator as f32).abs() + denominator_bound / (denominator as f32).abs();
    let quotient = numerator / denominator;
    let error = f64::from((quotient as f32).abs() * 1.01f32.mul_add(relative, 8.0 * WIDE_EPSILON));
    let rounded = quotient as f32;
    let is_sure =
        relative < 1.0 / 1024.0 && (quotient + error) as f32 == rounded && (quotient - error) as f32 == rounded;
    is_sure.then_some(rounded)
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

/// What arithmetic of twice the precision finds out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    /// Surely outside.
    Miss,
    /// Surely inside, with t, u and v rounded for certain.
    Hit(Intersection),
    /// Not certain.
    Doubtful,
}

/// Step 2.
#[inline(always)]
pub fn intersect_wide(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Decision {
    let wide = DVec3::from;
    let (edge1, edge2) = (wide(p1) - wide(p0), wide(p2) - wide(p0));
    let (from, direction) = (wide(p0) - wide(ray.origin) - wide(ray.origin_low), wide(ray.direction));
    let (normal, moment) = (edge1.cross(edge2), from.cross(direction));
    let dot = |a: DVec3, b: DVec3| a.x * b.x + a.y * b.y + a.z * b.z;
    let (distance, det) = (dot(normal, from), dot(normal, direction));
    let (weight1, weight2) = (dot(edge2, moment), -dot(edge1, moment));
    let weight0 = det - weight1 - weight2;

    let (magnitude1, magnitude2, from_magnitude) = (edge1.as_vec3(), edge2.as_vec3(), from.as_vec3());
    let normal_magnitude = magnitude_cross(magnitude1, magnitude2);
    let moment_magnitude = magnitude_cross(from_magnitude, ray.direction);
    let det_magnitude = magnitude_dot(normal_magnitude, ray.direction);
    let magnitude_1 = magnitude_dot(magnitude2, moment_magnitude);
    let magnitude_2 = magnitude_dot(magnitude1, moment_magnitude);
    let det_bound = WIDE_ERROR * det_magnitude;
    let (bound1, bound2) = (WIDE_ERROR * magnitude_1, WIDE_ERROR * magnitude_2);

    let sign = sure_sign(det, det_bound);
    let sign0 = sure_sign(weight0, WIDE_ERROR_W * (det_magnitude + magnitude_1 + magnitude_2));
    let sign1 = sure_sign(weight1, bound1);
    let sign2 = sure_sign(weight2, bound2);
    if sign0 * sign1 < 0 || sign1 * sign2 < 0 || sign2 * sign0 < 0 {
        return Decision::Miss;
    }
    if sign == 0 || sign0 != sign || sign1 != sign || sign2 != sign {
        return Decision::Doubtful;
    }
    let distance_bound = WIDE_ERROR * magnitude_dot(normal_magnitude, from_magnitude);
    let rounded = (
        rounds_surely(distance, distance_bound, det, det_bound),
        rounds_surely(weight1, bound1, det, det_bound),
        rounds_surely(weight2, bound2, det, det_bound),
    );
    match rounded {
        (Some(t), Some(u), Some(v)) => Decision::Hit(Intersection { t, u, v }),
        _ => Decision::Doubtful,
    }
}

/// The units in which positions and directions are whole, as exponents of 2, and the limbs that hold every number.
#[derive(Debug, Clone, Copy)]
struct WholeUnits {
    position: i32,
    direction: i32,
    n: usize,
}

impl WholeUnits {
    fn new(ray: &Ray, triangles: &[[Vec3; 3]]) -> WholeUnits {
        let (mut low_p, mut high_p, mut low_d, mut high_d) = (1000, -1000, 1000, -1000);
        for p in triangles.iter().flatten().chain([&ray.origin, &ray.origin_low]) {
            p.to_array().iter().for_each(|&x| widen_exponents(x, &mut low_p, &mut high_p));
        }
        ray.direction.to_array().iter().for_each(|&x| widen_exponents(x, &mut low_d, &mut high_d));
        let mut position = low_p;
        let mut bits_p = (high_p - low_p).max(1);
        let bits_d = (high_d - low_d).max(1);
        let most = (32 * MAX_LIMBS as i32 - 40 - bits_d) / 5;
        if bits_p > most {
            position += bits_p - most;
            bits_p = most;
        }
        let bits = if triangles.len() > 1 { 5 * bits_p + bits_d + 40 } else { 3 * bits_p.max(bits_d) + 34 };
        WholeUnits { position, direction: low_d, n: (bits as usize).div_ceil(32) }
    }
}

/// The numbers behind every answer.
struct WholeNumbers {
    distance: Integer,
    det: Integer,
    weight1: Integer,
    weight2: Integer,
}

impl WholeNumbers {
    fn new(ray: &Ray, [p0, p1, p2]: [Vec3; 3], units: &WholeUnits) -> WholeNumbers {
        let n = units.n;
        let whole = |v: Vec3, exponent: i32| v.to_array().map(|x| Integer::from_float(x, exponent, n));
        let minus = |mut a: [Integer; 3], b: &[Integer; 3]| {
            a.iter_mut().zip(b).for_each(|(a, b)| a.add(b, -1, n));
            a
        };
        let corner = whole(p0, units.position);
        let edge1 = minus(whole(p1, units.position), &corner);
        let edge2 = minus(whole(p2, units.position), &corner);
        let from = minus(corner, &whole(ray.origin, units.position));
        let from = minus(from, &whole(ray.origin_low, units.position));
        let direction = whole(ray.direction, units.direction);
        let zero = Integer::ZERO;
        let mut numbers = WholeNumbers { distance: zero, det: zero, weight1: zero, weight2: zero };
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let mut normal = zero;
            normal.add_product(&edge1[i], &edge2[j], 1, n);
            normal.add_product(&edge1[j], &edge2[i], -1, n);
            numbers.distance.add_product(&normal, &from[k], 1, n);
            numbers.det.add_product(&normal, &direction[k], 1, n);
            let mut moment = zero;
            moment.add_product(&from[i], &direction[j], 1, n);
            moment.add_product(&from[j], &direction[i], -1, n);
            numbers.weight1.add_product(&moment, &edge2[k], 1, n);
            numbers.weight2.add_product(&moment, &edge1[k], -1, n);
        }
        numbers
    }

    /// The sign of t minus `limit`, which is the float nearest to t; det > 0.
    fn compare_with_limit(&self, units: &WholeUnits, limit: f32) -> i32 {
        let (significand, exponent) = float_significand(limit);
        let n = units.n;
        let mut scaled = Integer::ZERO;
        let factor = Integer::from_float(if limit < 0.0 { -(significand as f32) } else { significand as f32 }, 0, n);
        scaled.add_product(&factor, &self.det, 1, n);
        let mut distance = self.distance;
        let shift = if significand == 0 { 0 } else { units.position - units.direction - exponent };
        if shift > 0 {
            distance.shift_up(shift as usize, n);
        }
        if shift < 0 {
            scaled.shift_up(-shift as usize, n);
        }
        distance.add(&scaled, -1, n);
        distance.sign(n)
    }
}

/// Step 3.
#[inline(never)]
pub fn intersect_whole(ray: &Ray, triangle: [Vec3; 3]) -> Option<Intersection> {
    let has_interval = ray.t_near <= ray.t_far;
    if !has_interval {
        return None;
    }
    let units = WholeUnits::new(ray, &[triangle]);
    let n = units.n;
    let numbers = WholeNumbers::new(ray, triangle, &units);
    let mut weight0 = numbers.det;
    weight0.add(&numbers.weight1, -1, n);
    weight0.add(&numbers.weight2, -1, n);
    let sign = numbers.det.sign(n);
    if sign == 0 || [&weight0, &numbers.weight1, &numbers.weight2].iter().any(|weight| sign * weight.sign(n) < 0) {
        return None;
    }
    let t = integer_quotient(numbers.distance, numbers.det, units.position - units.direction, n);
    let u = integer_quotient(numbers.weight1, numbers.det, 0, n);
    let v = integer_quotient(numbers.weight2, numbers.det, 0, n);
    t.is_finite().then_some(Intersection { t, u, v })
}

/// Twin of `intersect_exact`.
#[inline(always)]
pub fn intersect_exact(buffers: &SceneBuffers, ray: &Ray, triangle: [Vec3; 3]) -> Option<Intersection> {
    let distance = ray.farthest_distance(buffers.params.low.xyz(), buffers.params.high.xyz());
    if surely_misses(&shear_triangle(ray, triangle), distance) {
        return None;
    }
    match intersect_wide(ray, triangle) {
        Decision::Miss => None,
        Decision::Hit(found) => Some(found),
        Decision::Doubtful => intersect_whole(ray, triangle),
    }
}

#[inline(never)]
fn is_nearer_whole(buffers: &SceneBuffers, ray: &Ray, hit: &Hit, t: f32, primitive: u32, work: &mut impl Work) -> bool {
    let is_tie = t == hit.t;
    let triangle = load_vertices(buffers, primitive, work);
    let other = if is_tie { load_vertices(buffers, hit.primitive, work) } else { triangle };
    let units = WholeUnits::new(ray, &[triangle, other]);
    let n = units.n;
    let mut numbers = WholeNumbers::new(ray, triangle, &units);
    if numbers.det.take_sign(n) < 0 {
        numbers.distance = numbers.distance.negated(n);
    }
    if t == ray.t_near && numbers.compare_with_limit(&units, ray.t_near) < 0 {
        return false;
    }
    if t == ray.t_far && numbers.compare_with_limit(&units, ray.t_far) > 0 {
        return false;
    }
    if !is_tie {
        return true;
    }
    let best = WholeNumbers::new(ray, other, &units);
    let best_sign = best.det.sign(n);
    let mut difference = Integer::ZERO;
    difference.add_product(&numbers.distance, &best.det, best_sign, n);
    difference.add_product(&best.distance, &numbers.det, -best_sign, n);
    let order = difference.sign(n);
    order < 0 || (order == 0 && primitive < hit.primitive)
}

/// Twin of `is_nearer_exactly`.
#[inline(always)]
pub fn is_nearer_exactly(
    buffers: &SceneBuffers,
    ray: &Ray,
    hit: &Hit,
    t: f32,
    primitive: u32,
    work: &mut impl Work,
) -> bool {
    let is_possible = t >= ray.t_near && t <= ray.t_far && t <= hit.t;
    if !is_possible {
        return false;
    }
    if t > ray.t_near && t < ray.t_far && t < hit.t {
        return true;
    }
    if primitive == hit.primitive {
        return false;
    }
    is_nearer_whole(buffers, ray, hit, t, primitive, work)
}
