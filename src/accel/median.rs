//! kd-tree by the object median, as the thesis builds it (section 5.5.1): axes x, y, z in turn, plane midway between
//! the two middle centroids, and a triangle on every side that owns one of its vertices ([`super::divide`]).
//!
//! Bad at: everything but building fast. Planes go where many triangles are, not where empty space can be cut off, and
//! triangles are not clipped. Both make rays visit more leaves than the surface area heuristic does ([`super::sah`]).
//!
//! Two things keep the tree finite where the thesis' rule alone does not: a split whose children are nearly alike is
//! refused (thesis, section 5.5.2: "at most ~5 %"), and references are limited ([`super::stop`]).

use super::memory::GrowthLimit;
use super::{BuildOptions, KdTree, divide};
use glam::Vec3;

/// Builds the tree; see [`super::build_kd_tree`].
pub(super) fn build(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    growth: &GrowthLimit,
) -> KdTree {
    divide::build(vertices, primitives, options, growth, |axis, triangles, _| {
        median_plane(vertices, axis, triangles.iter().copied())
    })
}

/// Midway between the two middle centroids. The order is found by selection: the thesis' full sort is not needed.
///
/// # Panics
/// Without a triangle.
pub(super) fn median_plane(vertices: &[[Vec3; 3]], axis: usize, triangles: impl Iterator<Item = u32>) -> f32 {
    // Three times the centroid, in f64: the sum of three float32 then neither overflows nor loses the order.
    let mut centroids: Vec<f64> = triangles
        .map(|triangle| {
            let [a, b, c] = vertices[triangle as usize].map(|p| f64::from(p[axis]));
            a + b + c
        })
        .collect();
    let middle = centroids.len() / 2;
    let (below, &mut upper, _) = centroids.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp);
    ((lower.unwrap_or(upper) + upper) / 6.0) as f32 + 0.0 // + 0: never -0
}
