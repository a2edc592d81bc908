//! How far off a float32 method may be that is as good as float32 allows, on one ray and one triangle.
//!
//! The bounds are those of the watertight test (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT
//! 2013; derived for `cl/intersect/watertight.cl` in `cl/intersect/exact.cl` and `cl/shared/ray.cl`). With eps = 2^-24
//! and M the distance of the triangle's farthest corner from the origin, to first order:
//!
//! * Its edge functions have exact signs for corners that are off by 10 eps M on each of two axes: the hit or miss is
//!   the exact one of a triangle whose corners are displaced sideways by no more than sqrt(2) 10 eps M: [`LATERAL`].
//! * t. With the angle i between ray and normal: the sideways displacement moves the plane's crossing by 14.2 eps M tan
//!   i. The three weights are each off by 3 eps, relative to their sum by 6, which moves the point within the triangle
//!   by up to 6 * 2 eps M, along the ray 12 eps M sin i. The corners' distances along the ray are off by 8 eps M. The
//!   sum is largest at i = 45 degrees, where (14.2 sin i + 12 sin i cos i + 8 cos i) eps M / cos i = 21.7 eps M / cos
//!   i: [`ALONG`]. The quotient and the conversion to the caller's units round t itself: [`OF_T`].
//! * u and v. The sideways displacement is one of up to 1 / cos i as much in the plane, which changes the weight of a
//!   corner by its part of the corner's height above the opposite edge; the weights' own 6 eps double for a weight near
//!   1: [`OF_WEIGHT`].

use super::exact::Line;
use glam::DVec3;

/// Half the distance from 1 to the next float32.
pub const EPSILON: f64 = 1.0 / 16_777_216.0;
/// Sideways, in units of EPSILON M.
const LATERAL: f64 = 15.0;
/// Along the ray, in units of EPSILON M / cos i.
const ALONG: f64 = 24.0;
/// In units of EPSILON t.
const OF_T: f64 = 8.0;
/// 2^-126: a t below it is rounded as this one is.
const LEAST_NORMAL: f64 = f32::MIN_POSITIVE as f64;
/// In units of EPSILON.
const OF_WEIGHT: f64 = 12.0;

/// The bounds for one ray and one triangle.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    /// How far from the triangle the ray may pass and still be taken to hit it; world units.
    pub lateral: f64,
    /// Of t, without the part that grows with t.
    along: f64,
    /// Of u and v.
    pub weights: [f64; 2],
}

impl Tolerance {
    /// The bounds for `line` and a triangle; `origin_error`: how far the ray's origin may be off, for rays that start
    /// at a computed hit.
    pub fn new(line: &Line, corners: [DVec3; 3], origin_error: f64) -> Tolerance {
        Tolerance::of_ray(line.origin, line.direction, corners, origin_error)
    }

    /// The same for a ray in doubles.
    pub fn of_ray(origin: DVec3, direction: DVec3, corners: [DVec3; 3], origin_error: f64) -> Tolerance {
        let [a, b, c] = corners.map(|p| p - origin);
        let farthest = a.length().max(b.length()).max(c.length());
        let normal = (b - a).cross(c - a);
        let length = direction.length();
        // Doubles may take a triangle that has an area for a line. Then t and the weights may be anything.
        let is_line = normal == DVec3::ZERO;
        let cosine = if is_line { 0.0 } else { (normal.dot(direction) / (normal.length() * length)).abs() };
        let lateral = LATERAL * EPSILON * farthest + origin_error;
        let heights = [(c - a).length(), (b - a).length()].map(|opposite| normal.length() / opposite);
        Tolerance {
            lateral,
            along: (ALONG * EPSILON * farthest + origin_error) / (cosine * length),
            weights: heights.map(|height| lateral / (cosine * height) + OF_WEIGHT * EPSILON),
        }
    }

    /// How far t may be off.
    pub fn of_t(&self, t: f64) -> f64 {
        self.along + OF_T * EPSILON * t.abs().max(LEAST_NORMAL)
    }
}

/// How far `line` passes from a triangle, and t where it is nearest to it.
pub fn distance_to(line: &Line, corners: [DVec3; 3]) -> (f64, f64) {
    let length = line.direction.length();
    let ahead = line.direction / length;
    let (right, up) = ahead.any_orthonormal_pair();
    // Seen along the ray, which is the origin of this plane; z is the distance along it.
    let seen = corners.map(|p| p - line.origin).map(|p| DVec3::new(p.dot(right), p.dot(up), p.dot(ahead)));
    let volume = |p: DVec3, q: DVec3| p.x * q.y - p.y * q.x;
    let weights = [volume(seen[1], seen[2]), volume(seen[2], seen[0]), volume(seen[0], seen[1])];
    let sum: f64 = weights.iter().sum();
    if sum != 0.0 && weights.iter().all(|weight| weight * sum >= 0.0) {
        let z: f64 = weights.iter().zip(&seen).map(|(weight, p)| weight / sum * p.z).sum();
        return (0.0, z / length);
    }
    let on_edge = |k: usize| {
        let (p, q) = (seen[k], seen[(k + 1) % 3]);
        let (start, edge) = (p.truncate(), (q - p).truncate());
        let along = (-start.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let nearest = if along.is_nan() { p } else { p + (q - p) * along };
        (nearest.truncate().length(), nearest.z / length)
    };
    (0..3).map(on_edge).min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((f64::INFINITY, f64::INFINITY))
}

/// How far off the point of a computed hit may be, at which a secondary ray starts. Its coordinates are off by EPSILON
/// of the largest one and 4 EPSILON of the triangle's size on each axis (`cl/shared/ray.cl`, point_error; 2 more for
/// the weights' own roundings), and the weights' error moves it sideways by `tolerance`'s lateral part, within the
/// plane by 1 / cosine as much, though never out of the triangle.
pub fn point_error(line: &Line, corners: [DVec3; 3], tolerance: &Tolerance) -> f64 {
    const AXES: f64 = 1.8; // above sqrt(3)
    let largest = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let [a, b, c] = corners;
    let edge = (b - a).length().max((c - a).length());
    let normal = (b - a).cross(c - a);
    let cosine = (normal.dot(line.direction) / (normal.length() * line.direction.length())).abs();
    AXES * EPSILON * (largest + (6.0 + OF_WEIGHT) * edge) + (tolerance.lateral / cosine).min(edge)
}
