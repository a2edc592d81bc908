//! Twin of `cl/intersect/watertight.cl`: edge functions in sheared space. The reasons are there.

use super::edges::edge_error;
use super::moller_trumbore::Intersection;
use crate::reference::shared::math::difference_of_products;
use crate::reference::shared::ray::{Ray, major_axis, shear_towards, swap_to_z};
use glam::Vec3;

/// A triangle in the space where the ray is the z axis.
#[derive(Debug, Clone, Copy)]
pub struct ShearedTriangle {
    /// The vertices; z is the depth along the major axis.
    pub vertices: [Vec3; 3],
    /// By which t is scaled.
    pub direction_z: f32,
    /// Its reciprocal.
    pub inv_direction_z: f32,
    /// See [`edge_error`].
    pub error: f32,
}

#[inline(always)]
fn shear(ray: &Ray, axis: usize, [x, y]: [f32; 2], p: Vec3) -> Vec3 {
    let p = swap_to_z(ray.from_origin(p), axis);
    Vec3::new((-x).mul_add(p.z, p.x), (-y).mul_add(p.z, p.y), p.z)
}

/// Brings a triangle into that space.
#[inline(always)]
pub fn shear_triangle(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> ShearedTriangle {
    let axis = major_axis(ray.direction);
    let direction = swap_to_z(ray.direction, axis);
    let inv_z = 1.0 / direction.z;
    let by = [shear_towards(direction.x, direction.z, inv_z), shear_towards(direction.y, direction.z, inv_z)];
    ShearedTriangle {
        vertices: [shear(ray, axis, by, p0), shear(ray, axis, by, p1), shear(ray, axis, by, p2)],
        direction_z: direction.z,
        inv_direction_z: inv_z,
        error: edge_error(ray.origin_low),
    }
}

/// Where the ray's line meets the closed triangle.
#[inline(always)]
pub fn intersect_watertight(ray: &Ray, triangle: [Vec3; 3]) -> Option<Intersection> {
    let ShearedTriangle { vertices: [a, b, c], direction_z, .. } = shear_triangle(ray, triangle);
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
    let t = z_weighted / (det * direction_z);
    t.is_finite().then_some(Intersection { t, u: weight1 / det, v: weight2 / det })
}
