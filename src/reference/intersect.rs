//! Twins of `cl/intersect/`: the ray-triangle tests. The reasons are there.

use super::edges::{edge_error, shear_towards};
use super::math::{abs3, cross3, difference_of_products, dot3};
use super::memory::{Work, load_transform, load_vertices};
use super::ray::Ray;
use crate::layout::Float4;
use crate::options::Intersector;
use crate::pack::SceneBuffers;
use crate::shared::constants::THESIS_EPSILON;
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
pub fn intersect(
    buffers: &SceneBuffers,
    intersector: Intersector,
    ray: &Ray,
    primitive: u32,
    work: &mut impl Work,
) -> Option<Intersection> {
    match intersector {
        Intersector::Exact => unreachable!("it has a test of its own"),
        Intersector::MollerTrumbore => intersect_moller_trumbore(ray, load_vertices(buffers, primitive, work)),
        Intersector::Watertight => intersect_watertight(ray, load_vertices(buffers, primitive, work)),
        Intersector::Plucker => intersect_plucker(ray, load_vertices(buffers, primitive, work)),
        Intersector::Precomputed => intersect_precomputed(ray, load_transform(buffers, primitive, work)),
        Intersector::Thesis => intersect_thesis(ray, load_vertices(buffers, primitive, work), buffers.params.scale),
    }
}

/// Twin of `cl/intersect/moller_trumbore.cl`.
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

#[inline(always)]
pub(super) fn swap_to_z(v: Vec3, axis: usize) -> Vec3 {
    match axis {
        0 => Vec3::new(v.z, v.y, v.x),
        1 => Vec3::new(v.x, v.z, v.y),
        _ => v,
    }
}

/// The axis of the largest component of a direction.
#[inline(always)]
pub(super) fn major_axis(direction: Vec3) -> usize {
    let size = abs3(direction);
    if size.x >= size.y {
        if size.x >= size.z { 0 } else { 2 }
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

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

/// Brings a triangle into that space.
#[inline(always)]
pub fn shear_triangle(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> ShearedTriangle {
    let axis = major_axis(ray.direction);
    let direction = swap_to_z(ray.direction, axis);
    let inv_z = 1.0 / direction.z;
    let shear_x = shear_towards(direction.x, direction.z, inv_z);
    let shear_y = shear_towards(direction.y, direction.z, inv_z);
    let shear = |p: Vec3| {
        let p = swap_to_z(ray.from_origin(p), axis);
        Vec3::new((-shear_x).mul_add(p.z, p.x), (-shear_y).mul_add(p.z, p.y), p.z)
    };
    ShearedTriangle {
        vertices: [shear(p0), shear(p1), shear(p2)],
        direction_z: direction.z,
        inv_direction_z: inv_z,
        error: edge_error(ray.origin_low),
    }
}

/// Twin of `cl/intersect/watertight.cl`.
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

/// Twin of `cl/intersect/plucker.cl`.
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

#[inline(always)]
fn rotate_to_x(v: Vec3, axis: u32) -> Vec3 {
    match axis {
        0 => v,
        1 => Vec3::new(v.y, v.z, v.x),
        _ => Vec3::new(v.z, v.x, v.y),
    }
}

/// Twin of `cl/intersect/precomputed.cl`; takes what [`crate::pack::triangle_transform`] made.
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

/// Twin of `cl/intersect/thesis.cl`; `scale` is that of tracing space.
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
