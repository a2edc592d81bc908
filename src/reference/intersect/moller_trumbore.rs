//! Twin of `cl/intersect/moller_trumbore.cl`, and what every rounded test finds. The reasons are there.

use crate::reference::shared::math::{cross3, dot3};
use crate::reference::shared::ray::Ray;
use glam::Vec3;

/// Distance and weights of vertices 1 and 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intersection {
    /// In the ray's units.
    pub t: f32,
    /// Weight of vertex 1.
    pub u: f32,
    /// Weight of vertex 2.
    pub v: f32,
}

/// Where the ray's line meets the closed triangle.
#[inline(always)]
pub fn intersect_moller_trumbore(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Option<Intersection> {
    let edge1 = p1 - p0;
    let edge2 = p2 - p0;
    let p = cross3(ray.direction, edge2);
    let inv_det = 1.0 / dot3(edge1, p);
    let from_p0 = -ray.from_origin(p0);
    let u = dot3(from_p0, p) * inv_det;
    let q = cross3(from_p0, edge1);
    let v = dot3(ray.direction, q) * inv_det;
    let t = dot3(edge2, q) * inv_det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t.is_finite()).then_some(Intersection { t, u, v })
}
