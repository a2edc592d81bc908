//! kd-tree by the surface area heuristic in O(N log N), or by the thesis's heuristic of volumes.
//!
//! Wald and Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", IEEE Symposium on
//! Interactive Ray Tracing 2006. Every bound of a clipped triangle is a candidate plane ([`super::cost`]); a node is
//! split while that is cheaper than a leaf ([`super::stop`]). Large nodes sweep sorted event lists ([`super::events`]),
//! small ones count ([`super::small`]); triangles are clipped to the cells they straddle ([`super::clip`]).
//!
//! Bad at: scenes that change with every frame (the median build is faster), and gains that need two splits, none of
//! which pays alone: the choice is greedy. By volumes P_L + P_R is 1 for every plane, as if no ray met both sides, so
//! it splits where that does not pay, and cuts off too little of what is flat: on seven models 7 to 164 % more nodes,
//! and 3 to 204 % more expected cost (by areas).

use super::clip::Reference;
use super::cost::{Costs, Measure, Split};
use super::events::{EventNode, MAX_REFERENCES};
use super::memory::GrowthLimit;
use super::small::{self, SmallNode};
use super::stop::{Place, Stops};
use super::subtree::{Cell, Subtree, ascending};
use super::{BuildOptions, KdTree};
use glam::Vec3;
use rayon::prelude::*;

/// Nodes of at least this many references build their children side by side; smaller ones cost less than handing them
/// over.
const PARALLEL_REFERENCES: usize = 1024;

/// Builds the tree; see [`super::build_kd_tree`].
pub(super) fn build(
    measure: Measure,
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    growth: &GrowthLimit,
) -> KdTree {
    build_with(measure, vertices, primitives, options, small::CAPACITY, growth)
}

/// As [`build`], with the largest number of references of the nodes that [`super::small`] builds.
fn build_with(
    measure: Measure,
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    small_count: usize,
    growth: &GrowthLimit,
) -> KdTree {
    assert!(primitives.len() < MAX_REFERENCES, "more triangles than an event can number");
    let costs = Costs::new(measure, options);
    let builder = SahBuilder { vertices, costs, stops: Stops::new(costs, options, growth), small_count };
    let cell = Cell::around(vertices, primitives);
    let triangles = ascending(primitives);
    let references = triangles.par_iter().map(|&triangle| Reference::whole(vertices, triangle)).collect();
    let mut tree = Subtree::default();
    builder.build_large(EventNode::new(references), &Place::root(cell), &mut tree);
    tree.into_tree(&cell)
}

struct SahBuilder<'a> {
    vertices: &'a [[Vec3; 3]],
    costs: Costs,
    stops: Stops<'a>,
    small_count: usize,
}

impl SahBuilder<'_> {
    /// Appends a node that has event lists, and all below it.
    fn build_large(&self, node: EventNode, place: &Place, tree: &mut Subtree) {
        let count = node.references.len();
        if count <= self.small_count {
            return self.build_small(&SmallNode::new(&node.references), place, tree);
        }
        let best = || node.best_split(&place.cell, &self.costs);
        let Some((split, left_place, right_place)) = self.worthwhile(count, place, best) else {
            return tree.push_leaf(node.references.iter().map(|reference| reference.triangle));
        };
        let (left, right) = node.split(self.vertices, &place.cell, &split);
        let node_index = tree.push_inner(split.axis, split.plane);
        if count >= PARALLEL_REFERENCES {
            let mut right_tree = Subtree::default();
            rayon::join(
                || self.build_large(left, &left_place, tree),
                || self.build_large(right, &right_place, &mut right_tree),
            );
            tree.start_right(node_index);
            tree.append(right_tree);
        } else {
            self.build_large(left, &left_place, tree);
            tree.start_right(node_index);
            self.build_large(right, &right_place, tree);
        }
    }

    /// Appends a node of few references, and all below it.
    fn build_small(&self, node: &SmallNode, place: &Place, tree: &mut Subtree) {
        let best = || node.best_split(&place.cell, &self.costs);
        let Some((split, left_place, right_place)) = self.worthwhile(node.triangles().len(), place, best) else {
            return tree.push_leaf(node.triangles().iter().copied());
        };
        let (left, right) = node.split(self.vertices, &place.cell, &split);
        let node_index = tree.push_inner(split.axis, split.plane);
        self.build_small(&left, &left_place, tree);
        tree.start_right(node_index);
        self.build_small(&right, &right_place, tree);
    }

    /// The best split and its children's places, unless a stop makes the node a leaf.
    fn worthwhile(
        &self,
        count: usize,
        place: &Place,
        best_split: impl FnOnce() -> Option<Split>,
    ) -> Option<(Split, Place, Place)> {
        if self.stops.ends_at(count, place) {
            return None;
        }
        let split = best_split()?;
        let (left, right) = self.stops.children(count, place, &split)?;
        Some((split, left, right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Stop, TraceOptions};

    #[test]
    fn small_and_large_nodes_give_the_same_tree() {
        // Oblique triangles, and every fourth one in a plane across an axis, at few different coordinates: many ties.
        let vertices: Vec<[Vec3; 3]> = (0..600u32)
            .map(|i| {
                let at = Vec3::new((i * 37 % 101) as f32, (i * 53 % 103) as f32, (i * 71 % 97) as f32);
                let normal_axis = if i % 4 == 0 { 0.0 } else { 5.0 };
                [at, at + Vec3::new(normal_axis, 9.0, 2.0), at + Vec3::new(0.0, (i % 7) as f32, -8.0)]
            })
            .collect();
        let primitives: Vec<u32> = (0..vertices.len() as u32).collect();
        let by_cost = BuildOptions::new(&TraceOptions::DEFAULT, vertices.len());
        let by_size = BuildOptions { stop: Stop::Size, ..by_cost };
        for (measure, options) in [(Measure::Surface, by_cost), (Measure::Volume, by_cost), (Measure::Surface, by_size)]
        {
            let no_limit = GrowthLimit::none();
            let default = build(measure, &vertices, &primitives, &options, &no_limit);
            for small_count in [0, 1, 7, small::CAPACITY - 1] {
                let other = build_with(measure, &vertices, &primitives, &options, small_count, &no_limit);
                assert!(
                    other == default,
                    "{measure:?}, {options:?}: small nodes of up to {small_count} change the tree"
                );
            }
        }
    }
}
