//! kd-tree by the object median, as the thesis builds it (section 5.5.1): axes x, y, z in turn, plane midway between the
//! two middle centroids, and a triangle on every side that owns one of its vertices.
//!
//! Bad at: everything but building fast. Planes go where many triangles are, not where empty space can be cut off, and
//! triangles keep their full extent, so that a node also lists some that only pass by. Both make rays visit more leaves than the
//! surface area heuristic does ([`super::sah`]).
//!
//! Two things keep the tree finite where the thesis' rule alone does not: a split whose children are nearly alike is
//! refused (thesis, section 5.5.2: "at most ~5 %"), and references are limited ([`super::subtree::MAX_GROWTH`]).

use super::subtree::{Cell, Subtree, ascending, growth_after};
use super::{BuildOptions, KdTree};
use crate::options::TraceOptions;
use glam::Vec3;

/// A split is useless when both children keep more than this share of the triangles (thesis, section 5.5.2).
const SIMILAR_CHILDREN: f64 = 0.95;

/// Subtrees of at least this many triangles are built side by side; smaller ones cost less than handing them over.
const PARALLEL_TRIANGLES: usize = 4096;

/// Builds the tree; see [`super::build_kd_tree`].
pub(super) fn build(vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> KdTree {
    let builder = MedianBuilder {
        vertices,
        leaf_size: options.leaf_size as usize,
        max_depth: options.max_depth.min(TraceOptions::MAX_DEPTH),
    };
    let cell = Cell::around(vertices, primitives);
    let mut tree = Subtree::default();
    builder.build_node(ascending(primitives), &cell, 0, 1.0, &mut tree);
    tree.into_tree(&cell)
}

struct MedianBuilder<'a> {
    vertices: &'a [[Vec3; 3]],
    leaf_size: usize,
    max_depth: u32,
}

/// A plane and the triangles on its sides.
struct Split {
    axis: usize,
    plane: f32,
    left: Vec<u32>,
    right: Vec<u32>,
    growth: f64,
}

impl MedianBuilder<'_> {
    /// Appends the node of `triangles` and all below it. `growth`: see [`super::subtree::MAX_GROWTH`].
    fn build_node(&self, triangles: Vec<u32>, cell: &Cell, depth: u32, growth: f64, tree: &mut Subtree) {
        let is_leaf = triangles.len() <= self.leaf_size || depth >= self.max_depth;
        let split = if is_leaf { None } else { self.find_split(&triangles, cell, depth, growth) };
        let Some(split) = split else {
            tree.push_leaf(triangles.into_iter());
            return;
        };
        let parallel = triangles.len() >= PARALLEL_TRIANGLES;
        drop(triangles);

        let node_index = tree.push_inner(split.axis, split.plane);
        let (left_cell, right_cell) = cell.split(split.axis, split.plane);
        if parallel {
            let mut right_tree = Subtree::default();
            rayon::join(
                || self.build_node(split.left, &left_cell, depth + 1, split.growth, tree),
                || self.build_node(split.right, &right_cell, depth + 1, split.growth, &mut right_tree),
            );
            tree.start_right(node_index);
            tree.append(right_tree);
        } else {
            self.build_node(split.left, &left_cell, depth + 1, split.growth, tree);
            tree.start_right(node_index);
            self.build_node(split.right, &right_cell, depth + 1, split.growth, tree);
        }
    }

    /// Splits on the axis whose turn it is, or on the first of the others that separates anything.
    fn find_split(&self, triangles: &[u32], cell: &Cell, depth: u32, growth: f64) -> Option<Split> {
        (0..3).map(|turn| (depth as usize + turn) % 3).find_map(|axis| self.split_on(axis, triangles, cell, growth))
    }

    fn split_on(&self, axis: usize, triangles: &[u32], cell: &Cell, growth: f64) -> Option<Split> {
        let plane = self.median_plane(axis, triangles);
        if !cell.is_split_by(axis, plane) {
            return None;
        }
        let (mut left, mut right) = (Vec::new(), Vec::new());
        for &triangle in triangles {
            let coordinates = self.vertices[triangle as usize].map(|p| p[axis]);
            // A triangle that lies in the plane goes left; one that only touches it stays on its own side.
            let on_left = coordinates.iter().any(|&x| x < plane);
            let on_right = coordinates.iter().any(|&x| x > plane);
            if on_left || !on_right {
                left.push(triangle);
            }
            if on_right {
                right.push(triangle);
            }
        }
        let similar = SIMILAR_CHILDREN * triangles.len() as f64;
        let is_useless = left.len().min(right.len()) as f64 > similar;
        let growth = growth_after(growth, triangles.len(), left.len() + right.len())?;
        (!is_useless).then_some(Split { axis, plane, left, right, growth })
    }

    /// Midway between the two middle centroids. The order is found by selection: the thesis' full sort is not needed.
    fn median_plane(&self, axis: usize, triangles: &[u32]) -> f32 {
        // Three times the centroid, in f64: the sum of three float32 then neither overflows nor loses the order.
        let mut centroids: Vec<f64> = triangles
            .iter()
            .map(|&triangle| {
                let [a, b, c] = self.vertices[triangle as usize].map(|p| f64::from(p[axis]));
                a + b + c
            })
            .collect();
        let middle = centroids.len() / 2;
        let (below, &mut upper, _) = centroids.select_nth_unstable_by(middle, f64::total_cmp);
        let lower = below.iter().copied().max_by(f64::total_cmp);
        ((lower.unwrap_or(upper) + upper) / 6.0) as f32 + 0.0 // + 0: never -0
    }
}
