//! Twin of `cl/shade/surface.cl`: what a hit is, and how rays leave it. The reasons are there.

use super::normal::{interpolated_normal, smooth_lift, triangle_normal};
use crate::options::{Intersector, Terminator, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::intersect::exact::weight0_exactly;
use crate::reference::shared::math::{abs3, dot3, max_component, max_or, normalize3};
use crate::reference::shared::memory::{load_shading, vertices};
use crate::reference::shared::ray::{Ray, TrianglePoint, point_error, start_on_triangle};
use crate::shared::{Hit, SurfaceHit};
use glam::Vec3;

/// A point on a triangle, as rays start from it.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// Tracing space, rounded.
    pub position: Vec3,
    /// What that leaves out.
    pub position_low: Vec3,
    /// Where it is, as weights of the vertices.
    pub weights: Vec3,
    /// How far from it, on each axis, the triangle test may meet what should only touch it.
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
    /// Of the triangle's vertices, without sign.
    pub largest_coordinate: f32,
    /// Texture coordinates.
    pub texture_uv: [f32; 2],
    /// Index of the material.
    pub material: u32,
    /// The ray came from the side on which the vertices run counter-clockwise.
    pub front: bool,
}

#[inline(always)]
fn is_nearest_vertex0(u: f32, v: f32) -> bool {
    let rest = (1.0 - u) - v;
    rest >= u && rest >= v
}

/// What a ray has hit, as surfaces want to know it.
#[inline(always)]
pub fn surface_hit(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, hit: &Hit) -> SurfaceHit {
    let rest = (1.0 - hit.u) - hit.v;
    let weight0 = if is_nearest_vertex0(hit.u, hit.v) {
        rest
    } else if options.intersector == Intersector::Exact {
        weight0_exactly(buffers, ray, hit)
    } else {
        max_or(0.0, rest)
    };
    SurfaceHit { weight0, u: hit.u, v: hit.v, primitive: hit.primitive }
}

/// The weights of a hit as a ray that leaves it has them.
#[inline(always)]
pub fn start_weights(hit: &SurfaceHit) -> Vec3 {
    if is_nearest_vertex0(hit.u, hit.v) {
        Vec3::new(-1.0, hit.u, hit.v)
    } else if hit.u >= hit.v {
        Vec3::new(hit.weight0, -1.0, hit.v)
    } else {
        Vec3::new(hit.weight0, hit.u, -1.0)
    }
}

/// Where a hit lies.
#[inline(always)]
pub fn surface_point(buffers: &SceneBuffers, options: &TraceOptions, hit: &SurfaceHit) -> SurfacePoint {
    let triangle = vertices(buffers, hit.primitive);
    let weights = start_weights(hit);
    let (position, position_low) = start_on_triangle(&TrianglePoint::of_weights(triangle, weights));
    let error = if options.intersector == Intersector::Exact { 0.0 } else { point_error(triangle) };
    SurfacePoint { position, position_low, weights, error, primitive: hit.primitive }
}

/// What a hit is.
#[inline(always)]
pub fn surface_at(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, hit: &SurfaceHit) -> Surface {
    let at = load_shading(buffers, hit.primitive);
    let w = (1.0 - hit.u) - hit.v;
    let [p0, p1, p2] = vertices(buffers, hit.primitive);
    let mut outward = triangle_normal([p0, p1, p2]);
    if outward == Vec3::ZERO {
        outward = normalize3(-ray.direction, Vec3::Z);
    }
    let front = dot3(outward, ray.direction) < 0.0;
    let geometric_normal = if front { outward } else { -outward };
    let normals = [at.normal0_u0.xyz(), at.normal1_u1.xyz(), at.normal2_u2.xyz()];
    Surface {
        point: surface_point(buffers, options, hit),
        geometric_normal,
        normal: interpolated_normal(normals, [w, hit.u, hit.v], geometric_normal),
        lift: match options.picture.terminator {
            Terminator::Smooth => smooth_lift(p1 - p0, p2 - p0, normals, [w, hit.u, hit.v], geometric_normal),
            Terminator::Hard => Vec3::ZERO,
        },
        largest_coordinate: [p0, p1, p2].map(|p| max_component(abs3(p))).into_iter().fold(0.0, max_or),
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
    if lift != Vec3::ZERO {
        point.position += lift;
        point.position_low = Vec3::ZERO;
        point.weights = Vec3::ZERO;
    }
}

/// A ray that leaves a surface.
#[inline(always)]
pub fn leave_surface(point: &SurfacePoint, direction: Vec3, t_far: f32) -> Ray {
    let mut ray = Ray::new(point.position, direction, 0.0, t_far, point.primitive);
    ray.origin_low = point.position_low;
    ray.start_weights = point.weights;
    ray.t_near = max_or(ray.t_near, 2.0 * point.error);
    ray
}
