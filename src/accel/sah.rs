//! kd-tree by the surface area heuristic in O(N log N), or by the thesis's heuristic of volumes.
//!
//! Wald and Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", IEEE Symposium on
//! Interactive Ray Tracing 2006. Every bound of a clipped triangle is a candidate plane ([`super::cost`]); a node is
//! split while that is cheaper than a leaf, and once more to see whether two splits are ([`super::stop`]); in the end a
//! node that costs no less than a leaf becomes one, as Havran and Bittner, "On Improving KD-Trees for Ray Shooting",
//! WSCG 2002, prune. Large nodes sweep sorted event lists ([`super::events`]), small ones count ([`super::small`]);
//! triangles are clipped to the cells they straddle ([`super::clip`]).
//!
//! Bad at: scenes that change with every frame (the median build is faster), and gains that need three splits, none of
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
use crate::parallel;
use glam::Vec3;

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
    let costs = Costs::new(measure, options);
    let stops = Stops::new(costs, options, growth).with_trials();
    SahBuilder { vertices, costs, stops, small_count }.build(primitives)
}

struct SahBuilder<'a> {
    vertices: &'a [[Vec3; 3]],
    costs: Costs,
    stops: Stops<'a>,
    small_count: usize,
}

impl SahBuilder<'_> {
    fn build(&self, primitives: &[u32]) -> KdTree {
        assert!(primitives.len() < MAX_REFERENCES, "more triangles than an event can number");
        let cell = Cell::around(self.vertices, primitives);
        let triangles = ascending(primitives);
        let references = parallel::map_slice(&triangles, |&triangle| Reference::whole(self.vertices, triangle));
        let mut tree = Subtree::default();
        self.build_large(EventNode::new(references), &Place::root(cell), &mut tree);
        tree.into_tree(&cell)
    }

    /// Appends a node that has event lists, and all below it; returns what it costs.
    fn build_large(&self, node: EventNode, place: &Place, tree: &mut Subtree) -> f64 {
        let count = node.references.len();
        if count <= self.small_count {
            return self.build_small(&SmallNode::new(&node.references), place, tree);
        }
        let triangles = || node.references.iter().map(|reference| reference.triangle);
        let best = || node.best_split(&place.cell, &self.costs);
        let Some((split, children)) = self.worthwhile(count, place, best) else {
            return self.push_leaf(triangles(), count, tree);
        };
        let whole = self.stops.are_pruned().then(|| triangles().collect::<Vec<u32>>());
        let (left, right) = node.split(self.vertices, &place.cell, &split);
        let start = tree.size();
        let node_index = tree.push_inner(split.axis, split.plane);
        let costs = if count >= PARALLEL_REFERENCES {
            let mut right_tree = Subtree::default();
            let costs = rayon::join(
                || self.build_large(left, &children[0], tree),
                || self.build_large(right, &children[1], &mut right_tree),
            );
            tree.start_right(node_index);
            tree.append(right_tree);
            [costs.0, costs.1]
        } else {
            let left_cost = self.build_large(left, &children[0], tree);
            tree.start_right(node_index);
            [left_cost, self.build_large(right, &children[1], tree)]
        };
        let cost = self.costs.inner(&place.cell, [&children[0].cell, &children[1].cell], costs);
        match whole {
            Some(whole) if cost >= self.costs.leaf(count) => {
                tree.cut(start);
                self.push_leaf(whole.into_iter(), count, tree)
            }
            _ => cost,
        }
    }

    /// Appends a node of few references, and all below it; returns what it costs.
    fn build_small(&self, node: &SmallNode, place: &Place, tree: &mut Subtree) -> f64 {
        let count = node.triangles().len();
        let best = || node.best_split(&place.cell, &self.costs);
        let Some((split, children)) = self.worthwhile(count, place, best) else {
            return self.push_leaf(node.triangles().iter().copied(), count, tree);
        };
        let (left, right) = node.split(self.vertices, &place.cell, &split);
        let start = tree.size();
        let node_index = tree.push_inner(split.axis, split.plane);
        let left_cost = self.build_small(&left, &children[0], tree);
        tree.start_right(node_index);
        let right_cost = self.build_small(&right, &children[1], tree);
        let cost = self.costs.inner(&place.cell, [&children[0].cell, &children[1].cell], [left_cost, right_cost]);
        if self.stops.are_pruned() && cost >= self.costs.leaf(count) {
            tree.cut(start);
            return self.push_leaf(node.triangles().iter().copied(), count, tree);
        }
        cost
    }

    /// Appends a leaf of `count` triangles; returns what it costs.
    fn push_leaf(&self, triangles: impl Iterator<Item = u32>, count: usize, tree: &mut Subtree) -> f64 {
        tree.push_leaf(triangles);
        self.costs.leaf(count)
    }

    /// The best split and its children's places, unless a stop makes the node a leaf.
    fn worthwhile(
        &self,
        count: usize,
        place: &Place,
        best_split: impl FnOnce() -> Option<Split>,
    ) -> Option<(Split, [Place; 2])> {
        if self.stops.ends_at(count, place) {
            return None;
        }
        let split = best_split()?;
        let children = self.stops.children(count, place, &split)?;
        Some((split, children))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::stats::expected_cost;
    use crate::options::{Stop, TraceOptions};
    use crate::shared::KD_LEAF;
    use glam::Quat;
    use std::collections::BTreeSet;

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

    /// Columns of long thin triangles, each leaning its own way.
    fn columns() -> Vec<[Vec3; 3]> {
        const SIDES: u32 = 24;
        let side_of_column = |column: u32, side: u32| {
            let lean =
                Quat::from_euler(glam::EulerRot::XZY, 0.1 * (column % 3) as f32, 0.07 * (column % 5) as f32, 0.0);
            let at = Vec3::new((column % 4) as f32, 0.0, (column / 4) as f32);
            let corner = |side: u32, y: f32| {
                let (sin, cos) = (side as f32 * std::f32::consts::TAU / SIDES as f32).sin_cos();
                at + lean * Vec3::new(0.15 * cos, y, 0.15 * sin)
            };
            let [a, b, c, d] = [corner(side, 0.0), corner(side + 1, 0.0), corner(side, 4.0), corner(side + 1, 4.0)];
            [[a, b, d], [a, d, c]]
        };
        (0..16).flat_map(|column| (0..SIDES).flat_map(move |side| side_of_column(column, side))).collect()
    }

    #[test]
    fn no_node_costs_more_than_a_leaf() {
        let vertices = columns();
        let primitives: Vec<u32> = (0..vertices.len() as u32).collect();
        let options = BuildOptions::new(&TraceOptions::DEFAULT, vertices.len());
        for measure in [Measure::Surface, Measure::Volume] {
            let tree = build(measure, &vertices, &primitives, &options, &GrowthLimit::none());
            let costs = Costs::new(measure, &options);
            let root = Cell { low: tree.bounds.low.to_array(), high: tree.bounds.high.to_array() };
            check_node(&tree, &costs, 0, &root);
        }
    }

    /// Cost and triangles of a node, every node below being checked.
    fn check_node(tree: &KdTree, costs: &Costs, index: u32, cell: &Cell) -> (f64, BTreeSet<u32>) {
        let node = &tree.nodes[index as usize];
        if node.flags == KD_LEAF {
            let range = node.left as usize..(node.left + node.right) as usize;
            return (costs.leaf(range.len()), tree.references[range].iter().copied().collect());
        }
        let (left, right) = cell.split(node.flags as usize, node.split);
        let (left_cost, mut triangles) = check_node(tree, costs, node.left, &left);
        let (right_cost, of_right) = check_node(tree, costs, node.right, &right);
        triangles.extend(of_right);
        let cost = costs.inner(cell, [&left, &right], [left_cost, right_cost]);
        assert!(cost < costs.leaf(triangles.len()), "node {index} of {} triangles costs {cost}", triangles.len());
        (cost, triangles)
    }

    #[test]
    fn a_second_split_may_pay_for_both() {
        let vertices = columns();
        let primitives: Vec<u32> = (0..vertices.len() as u32).collect();
        let options = BuildOptions::new(&TraceOptions::DEFAULT, vertices.len());
        let (costs, no_limit) = (Costs::new(Measure::Surface, &options), GrowthLimit::none());
        let greedy = Stops::new(costs, &options, &no_limit);
        let [greedy, tried] = [greedy, greedy.with_trials()].map(|stops| {
            let tree =
                SahBuilder { vertices: &vertices, costs, stops, small_count: small::CAPACITY }.build(&primitives);
            expected_cost(&tree, Measure::Surface, &options)
        });
        assert!(tried < 0.99 * greedy, "{tried} after {greedy}");
    }
}
