//! Twin of `cl/intersect/precomputed.cl`: a transform that the host computed. The reasons are there.

use super::moller_trumbore::Intersection;
use crate::layout::Float4;
use crate::reference::shared::ray::Ray;
use glam::Vec3;

#[inline(always)]
fn rotate_to_x(v: Vec3, axis: u32) -> Vec3 {
    match axis {
        0 => v,
        1 => Vec3::new(v.y, v.z, v.x),
        _ => Vec3::new(v.z, v.x, v.y),
    }
}

/// Where the ray's line meets the closed triangle; takes what [`crate::pack::triangle_transform`] made.
#[inline(always)]
pub fn intersect_precomputed(ray: &Ray, [corner_axis, normal_u, gradient_v]: [Float4; 3]) -> Option<Intersection> {
    let axis = corner_axis.w.to_bits();
    let from = rotate_to_x(-ray.from_origin(corner_axis.xyz()), axis);
    let direction = rotate_to_x(ray.direction, axis);

    let height = normal_u.x.mul_add(from.y, normal_u.y.mul_add(from.z, from.x));
    let descent = normal_u.x.mul_add(direction.y, normal_u.y.mul_add(direction.z, direction.x));
    let t = -height / descent;
    let x = t.mul_add(direction.y, from.y);
    let y = t.mul_add(direction.z, from.z);
    let u = normal_u.z.mul_add(x, normal_u.w * y);
    let v = gradient_v.x.mul_add(x, gradient_v.y * y);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t.is_finite()).then_some(Intersection { t, u, v })
}
