//! Twin of `cl/shade/surface.cl`: what a hit is, and how rays leave it. The reasons are there.

use super::math::{dot3, max_or, normalize3};
use super::normal::{interpolated_normal, smooth_lift, triangle_normal};
use super::ray::{Ray, point_error, point_on_triangle};
use super::traverse::vertices;
use crate::options::Terminator;
use crate::pack::SceneBuffers;
use crate::shared::Hit;
use glam::Vec3;

/// A point on a triangle, as rays start from it.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// Tracing space, rounded.
    pub position: Vec3,
    /// What that leaves out.
    pub position_low: Vec3,
    /// Bound of its distance from the triangle's plane, on each axis.
    pub error: f32,
    /// The triangle.
    pub primitive: u32,
}

/// A hit with all that shading needs.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Where it is.
    pub point: SurfacePoint,
    /// Unit, towards the side the ray came from.
    pub geometric_normal: Vec3,
    /// Unit, interpolated, on the same side.
    pub normal: Vec3,
    /// From the triangle to where shadow rays start.
    pub lift: Vec3,
    /// Texture coordinates.
    pub texture_uv: [f32; 2],
    /// Index of the material.
    pub material: u32,
    /// The ray came from the side on which the vertices run counter-clockwise.
    pub front: bool,
}

/// Where a hit lies.
#[inline(always)]
pub fn surface_point(buffers: &SceneBuffers, hit: &Hit) -> SurfacePoint {
    let triangle = vertices(buffers, hit.primitive);
    let (position, position_low) = point_on_triangle(triangle, hit.u, hit.v);
    SurfacePoint { position, position_low, error: point_error(triangle), primitive: hit.primitive }
}

/// What a hit is.
#[inline(always)]
pub fn surface_at(buffers: &SceneBuffers, terminator: Terminator, ray: &Ray, hit: &Hit) -> Surface {
    let at = &buffers.shading[hit.primitive as usize];
    let w = (1.0 - hit.u) - hit.v;
    let towards_ray = normalize3(-ray.direction, Vec3::Z);
    let [p0, p1, p2] = vertices(buffers, hit.primitive);
    let outward = triangle_normal([p0, p1, p2], towards_ray);
    let front = dot3(outward, ray.direction) < 0.0;
    let geometric_normal = if front { outward } else { -outward };
    let normals = [at.normal0_u0.xyz(), at.normal1_u1.xyz(), at.normal2_u2.xyz()];
    Surface {
        point: surface_point(buffers, hit),
        geometric_normal,
        normal: interpolated_normal(normals, [w, hit.u, hit.v], geometric_normal),
        lift: match terminator {
            Terminator::Smooth => smooth_lift(p1 - p0, p2 - p0, normals, [w, hit.u, hit.v], geometric_normal),
            Terminator::Hard => Vec3::ZERO,
        },
        texture_uv: [
            at.normal0_u0.w.mul_add(w, at.normal1_u1.w.mul_add(hit.u, at.normal2_u2.w * hit.v)),
            at.v0.mul_add(w, at.v1.mul_add(hit.u, at.v2 * hit.v)),
        ],
        material: at.material,
        front,
    }
}

/// Moves the point to where shadow rays start.
#[inline(always)]
pub fn lift_point(point: &mut SurfacePoint, lift: Vec3) {
    let position = point.position + lift;
    point.position_low += lift - (position - point.position);
    point.position = position;
}

/// A ray that leaves a surface.
#[inline(always)]
pub fn leave_surface(point: &SurfacePoint, direction: Vec3, t_far: f32) -> Ray {
    let mut ray = Ray::new(point.position, direction, 0.0, t_far, point.primitive);
    ray.origin_low = point.position_low;
    ray.t_near = max_or(ray.t_near, 2.0 * point.error);
    ray
}
