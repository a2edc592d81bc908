//! Twin of `cl/intersect/filter.cl`, one triangle after the other: which triangles of a wide leaf a ray may hit. The
//! reasons are there.

use super::edges::Edges;
use super::watertight::shear_triangle;
use crate::reference::shared::ray::Ray;
use glam::Vec3;

/// Whether the ray may hit the triangle, for tests that agree with the edge functions.
#[inline(always)]
pub fn filter_sheared(ray: &Ray, triangle: [Vec3; 3]) -> bool {
    let sheared = shear_triangle(ray, triangle);
    !Edges::new(sheared.error, sheared.vertices).surely_missed()
}
