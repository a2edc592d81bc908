//! Twin of `cl/intersect/plucker.cl`: volumes of ray and edges. The reasons are there.

use super::moller_trumbore::Intersection;
use crate::reference::shared::math::{cross3, dot3};
use crate::reference::shared::ray::Ray;
use glam::Vec3;

/// Scalar triple product of direction and two vertices, each with its moment and that one's squared length.
#[inline(always)]
fn edge_volume(a: Vec3, b: Vec3, moment_a: Vec3, moment_b: Vec3, distance_a: f32, distance_b: f32) -> f32 {
    let by_a = dot3(b, moment_a);
    let by_b = dot3(a, moment_b);
    if distance_a < distance_b {
        by_a
    } else if distance_b < distance_a {
        -by_b
    } else {
        0.5 * (by_a - by_b)
    }
}

/// Where the ray's line meets the closed triangle.
#[inline(always)]
pub fn intersect_plucker(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Option<Intersection> {
    let (a, b, c) = (ray.from_origin(p0), ray.from_origin(p1), ray.from_origin(p2));
    let moment = |vertex| cross3(ray.direction, vertex);
    let (moment_a, moment_b, moment_c) = (moment(a), moment(b), moment(c));
    let (distance_a, distance_b, distance_c) =
        (dot3(moment_a, moment_a), dot3(moment_b, moment_b), dot3(moment_c, moment_c));

    let volume0 = edge_volume(b, c, moment_b, moment_c, distance_b, distance_c);
    let volume1 = edge_volume(c, a, moment_c, moment_a, distance_c, distance_a);
    let volume2 = edge_volume(a, b, moment_a, moment_b, distance_a, distance_b);
    let all_positive = volume0 >= 0.0 && volume1 >= 0.0 && volume2 >= 0.0;
    let all_negative = volume0 <= 0.0 && volume1 <= 0.0 && volume2 <= 0.0;
    if !(all_positive || all_negative) {
        return None;
    }
    let normal = cross3(b - a, c - a);
    let t = dot3(normal, a) / dot3(normal, ray.direction);
    let sum = volume0 + volume1 + volume2;
    (t.is_finite() && sum != 0.0).then_some(Intersection { t, u: volume1 / sum, v: volume2 / sum })
}
