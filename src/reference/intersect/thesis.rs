//! Twin of `cl/intersect/thesis.cl`: the test of the thesis, with its faults. The reasons are there.

use super::moller_trumbore::Intersection;
use crate::reference::shared::math::{cross3, dot3};
use crate::reference::shared::ray::Ray;
use crate::shared::constants::THESIS_EPSILON;
use glam::Vec3;

/// Where the ray meets the triangle; `scale` is that of tracing space.
#[inline(always)]
pub fn intersect_thesis(ray: &Ray, [a, b, c]: [Vec3; 3], scale: f32) -> Option<Intersection> {
    let area_epsilon = THESIS_EPSILON * scale * scale;
    let det_epsilon = area_epsilon * dot3(ray.direction, ray.direction).sqrt();
    let dist_epsilon = area_epsilon * scale;

    let edge1 = b - a;
    let edge2 = c - a;
    let pvec = cross3(ray.direction, edge2);
    let det = dot3(edge1, pvec);
    if det < det_epsilon {
        return None;
    }
    let tvec = ray.origin - a;
    let u = dot3(tvec, pvec);
    if u < 0.0 || u > det {
        return None;
    }
    let qvec = cross3(tvec, edge1);
    let v = dot3(ray.direction, qvec);
    if v < 0.0 || u + v > det {
        return None;
    }
    let dist = dot3(edge2, qvec);
    if dist < dist_epsilon {
        return None;
    }
    Some(Intersection { t: dist / det, u: u / det, v: v / det })
}
