//! A growing tree in left pre-order, and the cell and reference types that the builders share.
//!
//! A subtree numbers its nodes and references from 0, so that threads can build subtrees apart and [`Subtree::append`]
//! can shift one behind the other: the result does not depend on the number of threads.

use super::{Aabb, KdTree};
use crate::shared::{KD_LEAF, KdNode};
use glam::Vec3;

/// The most references that a tree may have per triangle.
///
/// Meshes took 3 to 5 by surface areas, and 9 to 43 by medians in leaves of 8, where the limit lowers the expected
/// cost. It bounds time and memory where neither builder's own rule does: 1000 triangles around one centroid in one
/// plane got 12.8 million references by surface areas, and by medians 10,000 triangles as large as the scene, 88 % of
/// them on both sides of every plane, would get 10^10.
///
/// Each split multiplies the growth of the path from the root by (left + right) / count; none may lift it above this.
pub(super) const MAX_GROWTH: f64 = 32.0;

/// The growth of the paths through a node of `count` references with `growth` after a split into `parts` altogether, or
/// `None` when that is too much.
pub(super) fn growth_after(growth: f64, count: usize, parts: usize) -> Option<f64> {
    let grown = growth * parts as f64 / count as f64;
    (grown <= MAX_GROWTH).then_some(grown)
}

/// The triangles of a tree, ascending, so that they ascend in every leaf, and each once.
pub(super) fn ascending(primitives: &[u32]) -> Vec<u32> {
    let mut triangles = primitives.to_vec();
    triangles.sort_unstable();
    triangles.dedup();
    triangles
}

/// A node's box; arrays, because the axis is a variable everywhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    pub low: [f32; 3],
    pub high: [f32; 3],
}

impl Cell {
    /// The box around all `primitives`; low corner above the high one when there is none.
    pub fn around(vertices: &[[Vec3; 3]], primitives: &[u32]) -> Cell {
        let bounds = primitives
            .iter()
            .fold(Aabb::EMPTY, |bounds, &triangle| bounds.union(Aabb::of_triangle(&vertices[triangle as usize])));
        // Adding 0 turns -0 into +0, so that equal coordinates have equal bits.
        Cell { low: (bounds.low + 0.0).to_array(), high: (bounds.high + 0.0).to_array() }
    }

    /// The parts below and above a plane.
    pub fn split(&self, axis: usize, plane: f32) -> (Cell, Cell) {
        let (mut left, mut right) = (*self, *self);
        left.high[axis] = plane;
        right.low[axis] = plane;
        (left, right)
    }

    /// Whether a plane leaves some room on both sides; false for NaN.
    pub fn is_split_by(&self, axis: usize, plane: f32) -> bool {
        self.low[axis] < plane && plane < self.high[axis]
    }

    /// Length along an axis; exact but for one f64 rounding, and never negative.
    pub fn extent(&self, axis: usize) -> f64 {
        (f64::from(self.high[axis]) - f64::from(self.low[axis])).max(0.0)
    }

    /// The middle between the two faces across an axis; it may round onto one of them.
    pub fn middle(&self, axis: usize) -> f32 {
        self.low[axis] * 0.5 + self.high[axis] * 0.5
    }
}

/// Nodes in left pre-order with their references, both numbered from 0.
#[derive(Debug, Default)]
pub(super) struct Subtree {
    nodes: Vec<KdNode>,
    references: Vec<u32>,
}

impl Subtree {
    /// Appends a leaf.
    pub fn push_leaf(&mut self, triangles: impl Iterator<Item = u32>) {
        let first = self.references.len();
        self.references.extend(triangles);
        let count = self.references.len() - first;
        self.nodes.push(KdNode { flags: KD_LEAF, left: first as u32, right: count as u32, split: 0.0 });
    }

    /// Appends an inner node whose left child will be the next node; returns its index for [`Subtree::start_right`].
    pub fn push_inner(&mut self, axis: usize, plane: f32) -> usize {
        let node_index = self.nodes.len();
        self.nodes.push(KdNode { flags: axis as u32, left: node_index as u32 + 1, right: 0, split: plane });
        node_index
    }

    /// Makes the next node the right child of `node_index`.
    pub fn start_right(&mut self, node_index: usize) {
        self.nodes[node_index].right = self.nodes.len() as u32;
    }

    /// Where the next node and the next reference will be.
    pub fn size(&self) -> (usize, usize) {
        (self.nodes.len(), self.references.len())
    }

    /// Takes away all that was appended since the tree had this [`Subtree::size`].
    pub fn cut(&mut self, (nodes, references): (usize, usize)) {
        self.nodes.truncate(nodes);
        self.references.truncate(references);
    }

    /// Appends a whole subtree; its root becomes the next node.
    pub fn append(&mut self, other: Subtree) {
        let node_offset = self.nodes.len() as u32;
        let reference_offset = self.references.len() as u32;
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            if node.flags == KD_LEAF {
                node.left += reference_offset;
            } else {
                node.left += node_offset;
                node.right += node_offset;
            }
            node
        }));
        self.references.extend(other.references);
    }

    /// The finished tree of the whole scene.
    ///
    /// # Panics
    /// When the node or reference numbers do not fit into 32 bits.
    pub fn into_tree(mut self, cell: &Cell) -> KdTree {
        let limit = u32::MAX as usize;
        assert!(
            self.nodes.len() < limit && self.references.len() < limit,
            "the kd-tree is too large for 32-bit indices"
        );
        self.nodes.shrink_to_fit();
        self.references.shrink_to_fit();
        KdTree {
            nodes: self.nodes,
            references: self.references,
            bounds: Aabb { low: Vec3::from_array(cell.low), high: Vec3::from_array(cell.high) },
        }
    }
}
