//! What a kd-tree looks like in numbers.
//!
//! The expected cost is that of MacDonald and Booth, "Heuristics for ray tracing using space subdivision", The Visual
//! Computer 1990: a ray that meets the root's box meets a node's with the ratio of their surface areas as probability.
//! It knows neither that rays end at their first hit nor where they start, so it compares trees of one scene and is no
//! prediction of time.

use super::cost::Measure;
use super::subtree::Cell;
use super::{BuildOptions, KdTree};
use crate::shared::{KD_LEAF, KdNode};

/// Counts and costs of a kd-tree.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TreeStats {
    /// Nodes of both kinds.
    pub nodes: usize,
    /// Inner nodes.
    pub inner: usize,
    /// Leaves, the empty ones included.
    pub leaves: usize,
    /// Leaves without triangles.
    pub empty_leaves: usize,
    /// Entries of all leaves together.
    pub references: usize,
    /// Leaves that a triangle is in, on average over the triangles in the tree; 0 without any.
    pub references_per_triangle: f64,
    /// Depth of the deepest leaf, the root counted as 0.
    pub max_depth: u32,
    /// Mean depth of the leaves.
    pub mean_leaf_depth: f64,
    /// Triangles in the fullest leaf.
    pub largest_leaf: u32,
    /// Mean number of triangles of the leaves that are not empty; 0 without any.
    pub mean_leaf_triangles: f64,
    /// Expected cost of a ray through the root's box, in the units of the build's `cost_traverse` and `cost_intersect`.
    pub sah_cost: f64,
    /// Memory of nodes and references.
    pub bytes: usize,
}

impl TreeStats {
    /// The numbers of `tree`; `options` gives the two costs.
    ///
    /// # Panics
    /// When the tree is not one that [`super::check_tree`] accepts.
    pub fn new(tree: &KdTree, options: &BuildOptions) -> TreeStats {
        let (mut leaves, mut empty_leaves, mut largest_leaf, mut references) = (0, 0, 0, 0);
        let (mut max_depth, mut depth_sum) = (0, 0.0);
        visit(tree, |node, _, depth| {
            if node.flags == KD_LEAF {
                leaves += 1;
                empty_leaves += usize::from(node.right == 0);
                largest_leaf = largest_leaf.max(node.right);
                references += node.right as usize;
                max_depth = max_depth.max(depth);
                depth_sum += f64::from(depth);
            }
        });

        TreeStats {
            nodes: tree.nodes.len(),
            inner: tree.nodes.len() - leaves,
            leaves,
            empty_leaves,
            references,
            references_per_triangle: ratio(references, distinct(&tree.references)),
            max_depth,
            mean_leaf_depth: depth_sum / leaves as f64,
            largest_leaf,
            mean_leaf_triangles: ratio(references, leaves - empty_leaves),
            sah_cost: expected_cost(tree, Measure::Surface, options),
            bytes: tree.nodes.len() * size_of::<KdNode>() + tree.references.len() * size_of::<u32>(),
        }
    }
}

/// Expected cost of a ray through the root's box if rays meet cells by `measure`; `options` gives the two costs. That
/// rays meet them by volume is not so: what the thesis's law expects is here to be compared with what happens.
///
/// # Panics
/// When the tree is not one that [`super::check_tree`] accepts.
pub fn expected_cost(tree: &KdTree, measure: Measure, options: &BuildOptions) -> f64 {
    let whole = measure.of(&root_cell(tree));
    let mut cost = 0.0;
    visit(tree, |node, cell, _| {
        // A root without any area is met by the rays that the cost is about.
        let probability = if whole > 0.0 { measure.of(cell) / whole } else { 1.0 };
        cost += probability
            * match node.flags {
                KD_LEAF => f64::from(node.right) * f64::from(options.cost_intersect),
                _ => f64::from(options.cost_traverse),
            };
    });
    cost
}

fn root_cell(tree: &KdTree) -> Cell {
    Cell { low: tree.bounds.low.to_array(), high: tree.bounds.high.to_array() }
}

/// Calls `visit_node` for every node with its cell and its depth.
fn visit(tree: &KdTree, mut visit_node: impl FnMut(&KdNode, &Cell, u32)) {
    let mut open = vec![(0, root_cell(tree), 0)];
    while let Some((node_index, cell, depth)) = open.pop() {
        let node = &tree.nodes[node_index as usize];
        visit_node(node, &cell, depth);
        if node.flags != KD_LEAF {
            let (left, right) = cell.split(node.flags as usize, node.split);
            open.push((node.left, left, depth + 1));
            open.push((node.right, right, depth + 1));
        }
    }
}

fn ratio(count: usize, of: usize) -> f64 {
    count as f64 / of.max(1) as f64
}

fn distinct(references: &[u32]) -> usize {
    let size = references.iter().max().map_or(0, |&max| max as usize + 1);
    let mut seen = vec![false; size];
    references.iter().filter(|&&triangle| !std::mem::replace(&mut seen[triangle as usize], true)).count()
}
