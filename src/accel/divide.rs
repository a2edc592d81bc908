//! kd-trees of the rules that name one plane for an axis without weighing others: what [`super::median`],
//! [`super::sampled_median`] and [`super::spatial_median`] have in common.
//!
//! A triangle goes to every side that owns one of its vertices, as in the thesis (section 5.5.1). So triangles keep
//! their full extent, and a node also lists some that only pass by its cell; clipping them is what [`super::sah`] does.

use super::cost::{Costs, Measure, Split};
use super::memory::GrowthLimit;
use super::stop::{Place, Stops};
use super::subtree::{Cell, Subtree, ascending};
use super::{BuildOptions, KdTree};
use crate::options::SplitAxis;
use glam::Vec3;

/// Subtrees of at least this many triangles are built side by side; smaller ones cost less than handing them over.
const PARALLEL_TRIANGLES: usize = 4096;

/// Builds the tree; see [`super::build_kd_tree`].
///
/// `plane` tells where to split the given triangles of a node across an axis; a plane outside of the node's cell, or
/// NaN, does not split it. It must depend on nothing else, so that the tree does not depend on the number of threads.
pub(super) fn build(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    growth: &GrowthLimit,
    plane: impl Fn(usize, &[u32], &Place) -> f32 + Sync,
) -> KdTree {
    let costs = Costs::new(Measure::Surface, options);
    let stops = Stops::new(costs, options, growth);
    let builder = Divider { vertices, plane, costs, stops, split_axis: options.split_axis };
    let cell = Cell::around(vertices, primitives);
    let mut tree = Subtree::default();
    builder.build_node(ascending(primitives), &Place::root(cell), &mut tree);
    tree.into_tree(&cell)
}

struct Divider<'a, P> {
    vertices: &'a [[Vec3; 3]],
    plane: P,
    costs: Costs,
    stops: Stops<'a>,
    split_axis: SplitAxis,
}

/// A side of a split: its triangles and its place.
type Half = (Vec<u32>, Place);

impl<P: Fn(usize, &[u32], &Place) -> f32 + Sync> Divider<'_, P> {
    /// Appends the node of `triangles` and all below it.
    fn build_node(&self, triangles: Vec<u32>, place: &Place, tree: &mut Subtree) {
        let Some((split, left, right)) = self.find_split(&triangles, place) else {
            tree.push_leaf(triangles.into_iter());
            return;
        };
        let parallel = triangles.len() >= PARALLEL_TRIANGLES;
        drop(triangles);

        let node_index = tree.push_inner(split.axis, split.plane);
        if parallel {
            let mut right_tree = Subtree::default();
            rayon::join(
                || self.build_node(left.0, &left.1, tree),
                || self.build_node(right.0, &right.1, &mut right_tree),
            );
            tree.start_right(node_index);
            tree.append(right_tree);
        } else {
            self.build_node(left.0, &left.1, tree);
            tree.start_right(node_index);
            self.build_node(right.0, &right.1, tree);
        }
    }

    /// Splits on the axis whose turn it is, or on the first of the others that no stop refuses.
    fn find_split(&self, triangles: &[u32], place: &Place) -> Option<(Split, Half, Half)> {
        if self.stops.ends_at(triangles.len(), place) {
            return None;
        }
        axes(self.split_axis, place).into_iter().find_map(|axis| self.split_on(axis, triangles, place))
    }

    fn split_on(&self, axis: usize, triangles: &[u32], place: &Place) -> Option<(Split, Half, Half)> {
        let plane = (self.plane)(axis, triangles, place);
        if !place.cell.is_split_by(axis, plane) {
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
        let plane_cost = self.costs.across(&place.cell, axis)?;
        let split = plane_cost.split(plane, left.len() as u32, 0, right.len() as u32);
        let [left_place, right_place] = self.stops.children(triangles.len(), place, &split)?;
        Some((split, (left, left_place), (right, right_place)))
    }
}

/// The axes in the order in which they are tried; of equally long ones the first comes first.
fn axes(order: SplitAxis, place: &Place) -> [usize; 3] {
    match order {
        SplitAxis::Turn => [0, 1, 2].map(|turn| (place.depth() as usize + turn) % 3),
        SplitAxis::Longest => {
            let mut axes = [0, 1, 2];
            axes.sort_by(|&a, &b| place.cell.extent(b).total_cmp(&place.cell.extent(a)));
            axes
        }
    }
}
