//! Twins of `cl/intersect/`: the ray-triangle tests. The reasons are there.

use super::math::{abs3, cross3, difference_of_products, dot3};
use super::ray::Ray;
use super::traverse::vertices;
use crate::options::Intersector;
use crate::pack::SceneBuffers;
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

/// Where the ray's line meets the closed triangle, by the chosen test.
#[inline(always)]
pub fn intersect(buffers: &SceneBuffers, intersector: Intersector, ray: &Ray, primitive: u32) -> Option<Intersection> {
    match intersector {
        Intersector::MollerTrumbore => intersect_moller_trumbore(ray, vertices(buffers, primitive)),
        Intersector::Watertight => intersect_watertight(ray, vertices(buffers, primitive)),
    }
}

/// Twin of `cl/intersect/moller_trumbore.cl`.
#[inline(always)]
pub fn intersect_moller_trumbore(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Option<Intersection> {
    let edge1 = p1 - p0;
    let edge2 = p2 - p0;
    let p = cross3(ray.direction, edge2);
    let inv_det = 1.0 / dot3(edge1, p);
    let from_p0 = ray.origin - p0;
    let u = dot3(from_p0, p) * inv_det;
    let q = cross3(from_p0, edge1);
    let v = dot3(ray.direction, q) * inv_det;
    let t = dot3(edge2, q) * inv_det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t.is_finite()).then_some(Intersection { t, u, v })
}

#[inline(always)]
fn rotate_to_z(v: Vec3, axis: usize) -> Vec3 {
    match axis {
        0 => Vec3::new(v.y, v.z, v.x),
        1 => Vec3::new(v.z, v.x, v.y),
        _ => v,
    }
}

/// Twin of `cl/intersect/watertight.cl`.
#[inline(always)]
pub fn intersect_watertight(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Option<Intersection> {
    let size = abs3(ray.direction);
    let axis = if size.x >= size.y {
        if size.x >= size.z { 0 } else { 2 }
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let direction = rotate_to_z(ray.direction, axis);
    let inv_z = 1.0 / direction.z;
    let shear_x = direction.x * inv_z;
    let shear_y = direction.y * inv_z;
    let shear = |p: Vec3| {
        let p = rotate_to_z(p - ray.origin, axis);
        Vec3::new((-shear_x).mul_add(p.z, p.x), (-shear_y).mul_add(p.z, p.y), p.z)
    };
    let (a, b, c) = (shear(p0), shear(p1), shear(p2));

    let weight0 = difference_of_products(c.x, b.y, c.y, b.x);
    let weight1 = difference_of_products(a.x, c.y, a.y, c.x);
    let weight2 = difference_of_products(b.x, a.y, b.y, a.x);
    let all_positive = weight0 >= 0.0 && weight1 >= 0.0 && weight2 >= 0.0;
    let all_negative = weight0 <= 0.0 && weight1 <= 0.0 && weight2 <= 0.0;
    if !(all_positive || all_negative) {
        return None;
    }
    let det = weight0 + weight1 + weight2;
    let z_weighted = weight0.mul_add(a.z, weight1.mul_add(b.z, weight2 * c.z));
    let t = z_weighted / (det * direction.z);
    t.is_finite().then_some(Intersection { t, u: weight1 / det, v: weight2 / det })
}
