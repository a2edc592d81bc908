//! Twin of `cl/shade/normal.cl`: normals of triangles, interpolated ones, and the height that these claim. The reasons
//! are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x > 0)` is also true for NaN, and that is meant

use crate::reference::shared::math::{abs3, cross3, dot3, fma3, max_component, max_or, normalize3, scale_to_unit};
use crate::shared::constants::LARGEST_NORMAL_NOISE;
use glam::Vec3;

/// What `a - b` leaves out beside its rounding.
#[inline(always)]
pub fn difference_low(a: Vec3, b: Vec3) -> Vec3 {
    let difference = a - b;
    let b_part = a - difference;
    (a - (difference + b_part)) + (b_part - b)
}

/// The unit normal of the plane through three points, or zero.
#[inline(always)]
pub fn triangle_normal([p0, p1, p2]: [Vec3; 3]) -> Vec3 {
    let (Some((edge1, scale1)), Some((edge2, scale2))) = (scale_to_unit(p1 - p0), scale_to_unit(p2 - p0)) else {
        return Vec3::ZERO;
    };
    let (low1, low2) = (difference_low(p1, p0) * scale1, difference_low(p2, p0) * scale2);
    normalize3(cross3(edge1, edge2) + (cross3(edge1, low2) + cross3(low1, edge2)), Vec3::ZERO)
}

/// The interpolated normal on the side of the geometric one, or that.
#[inline(always)]
pub fn interpolated_normal(normals: [Vec3; 3], [w, u, v]: [f32; 3], geometric_normal: Vec3) -> Vec3 {
    let sum = fma3(normals[0], w, fma3(normals[1], u, normals[2] * v));
    if !(max_component(abs3(sum)) > LARGEST_NORMAL_NOISE) {
        return geometric_normal;
    }
    let normal = normalize3(sum, geometric_normal);
    if dot3(normal, geometric_normal) < 0.0 { -normal } else { normal }
}

/// From a point of the triangle to the smooth surface that the vertices' normals claim above it.
#[inline(always)]
pub fn smooth_lift(edge1: Vec3, edge2: Vec3, normals: [Vec3; 3], [w, u, v]: [f32; 3], geometric_normal: Vec3) -> Vec3 {
    let from_p0 = fma3(edge1, u, edge2 * v);
    let sides = normals.map(|normal| if dot3(normal, geometric_normal) < 0.0 { -1.0f32 } else { 1.0 });
    let height0 = max_or(sides[0] * dot3(-from_p0, normals[0]), 0.0);
    let height1 = max_or(sides[1] * dot3(edge1 - from_p0, normals[1]), 0.0);
    let height2 = max_or(sides[2] * dot3(edge2 - from_p0, normals[2]), 0.0);
    fma3(
        normals[0],
        sides[0] * (w * height0),
        fma3(normals[1], sides[1] * (u * height1), normals[2] * (sides[2] * (v * height2))),
    )
}
