//! Binary bounding volume hierarchy by the surface area heuristic.
//!
//! Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", IEEE Symposium on Interactive Ray Tracing 2007: large nodes
//! sort centroids into bins ([`bins`]); small ones try every split of the sorted centroids ([`sweep`]), which is as fast there and
//! better. A node is a leaf when no split pays, and not before it is small enough. Nodes side by side, and the bins and the partition
//! of the largest ones, use all cores. What such splits put into a bad place [`reinsert`] moves to a better one.
//!
//! Knows nothing of how nodes are packed. Bad at: triangles that are much larger than their neighbours, or long and oblique: their
//! boxes overlap those of others, where a kd-tree would cut them.

mod bins;
mod items;
mod reinsert;
mod sweep;

use super::subtree::ascending;
use super::{Aabb, BuildOptions};
use crate::error::{Error, Result};
use crate::options::{Accel, KdOptions, TraceOptions};
use bins::Binning;
use glam::Vec3;
use items::{Extent, Item, PARALLEL_ITEMS, halve, partition};
use rayon::prelude::*;
use sweep::Sweep;

/// A node of a [`Bvh`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BvhNode {
    /// The smallest box around its triangles.
    pub bounds: Aabb,
    /// Of a leaf its first triangle, as an index into [`Bvh::order`]; of an inner node its second child. The first child is the next
    /// node.
    pub first: u32,
    /// Triangles of a leaf; 0 for an inner node.
    pub count: u32,
}

impl BvhNode {
    /// Whether it has triangles instead of children.
    pub fn is_leaf(&self) -> bool {
        self.count > 0
    }
}

/// A binary tree of boxes over triangles, each of which is in one leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Bvh {
    /// Depth first, the root first; of two children that with the larger surface first. Empty without triangles.
    pub nodes: Vec<BvhNode>,
    /// The triangles, a range for each leaf, ascending within a leaf.
    pub order: Vec<u32>,
}

impl Bvh {
    /// The children of inner node `index`.
    pub fn children(&self, index: usize) -> [usize; 2] {
        [index + 1, self.nodes[index].first as usize]
    }

    /// The triangles of leaf `index`.
    pub fn triangles(&self, index: usize) -> &[u32] {
        let node = &self.nodes[index];
        &self.order[node.first as usize..(node.first + node.count) as usize]
    }

    /// The most inner nodes on a path from the root to a leaf; 0 for a tree of one leaf or none.
    pub fn depth(&self) -> u32 {
        let mut deepest = 0;
        let mut depths = vec![0; self.nodes.len()];
        for index in 0..self.nodes.len() {
            deepest = deepest.max(depths[index]);
            if !self.nodes[index].is_leaf() {
                for child in self.children(index) {
                    depths[child] = depths[index] + 1;
                }
            }
        }
        deepest
    }

    /// Expected cost of a ray through the root's box (MacDonald and Booth 1990): steps and triangle tests, at the two costs of `options`.
    /// 0 without triangles; NaN when the root's box has no surface.
    pub fn expected_cost(&self, options: &BuildOptions) -> f64 {
        let of = |node: &BvhNode| match node.count {
            0 => f64::from(options.cost_traverse) * node.bounds.half_area(),
            count => f64::from(options.cost_intersect) * f64::from(count) * node.bounds.half_area(),
        };
        let whole = self.nodes.first().map_or(1.0, |root| root.bounds.half_area());
        self.nodes.iter().map(of).sum::<f64>() / whole
    }

    /// Checks what a leaf of packed kind `accel` has room for, before anything is packed.
    pub(super) fn check_leaves(&self, accel: Accel, most: u32) -> Result<()> {
        let largest = self.nodes.iter().map(|node| node.count).max().unwrap_or(0);
        if largest > most {
            let message =
                format!("there is a leaf of {largest} triangles, and --accel {accel} has room for {most} in one");
            return Err(Error::option("--leaf-size", message));
        }
        Ok(())
    }
}

/// The most triangles: their places in `order` leave room for a count in a packed link.
pub(super) const MAX_TRIANGLES: usize = (1 << 27) - 16;

/// Checks that links can number `count` triangles when they can number `limit`.
pub(super) fn check_triangle_count(count: usize, limit: usize) -> Result<()> {
    if count > limit {
        let reason = format!("it has {count} triangles, and a hierarchy of boxes can number {limit}; take --accel kd");
        return Err(Error::Scene(reason));
    }
    Ok(())
}

/// Nodes of at least this many triangles build their children side by side; smaller ones cost less than handing them over.
const PARALLEL_CHILDREN: usize = 2048;

impl BuildOptions {
    /// The most triangles of a leaf, unless something else is asked for: the costs stop most nodes earlier.
    const BVH_LEAF_SIZE: u32 = 8;

    /// Cost of a triangle test where eight are looked at together, in steps.
    const WIDE_COST_INTERSECT: f32 = 0.25;

    /// Passes of reinsertion unless something else is asked for. In bvh2, 1, 3 and 5 passes spared sponza's shadow rays 3, 6 and 7 % of
    /// their steps and its camera rays 17, 29 and 30 %; later ones moved nothing, and none found anything to move in bunny and gears. Five
    /// made the builds of these up to 17 % longer, and that of a million triangles up to half.
    const REINSERT: u32 = 5;

    /// What `options` ask for in a bounding volume hierarchy of `triangle_count` triangles.
    pub fn bvh(options: &TraceOptions, triangle_count: usize) -> Self {
        BuildOptions {
            leaf_size: options.leaf_size.unwrap_or(Self::BVH_LEAF_SIZE),
            max_depth: TraceOptions::MAX_DEPTH,
            reinsert: options.reinsert.unwrap_or(Self::REINSERT),
            cost_traverse: options.kd.cost_traverse.unwrap_or(KdOptions::COST),
            cost_intersect: options.kd.cost_intersect.unwrap_or(match options.accel {
                Accel::Bvh8 => Self::WIDE_COST_INTERSECT,
                _ => KdOptions::COST,
            }),
            ..BuildOptions::new(&TraceOptions { leaf_size: None, max_depth: None, ..*options }, triangle_count)
        }
    }
}

/// Builds a hierarchy over the triangles `primitives` (indices into `vertices`; each finite), of which one that is listed twice
/// counts once. Reads `leaf_size`, the most triangles of a leaf, the two costs, and `reinsert`.
///
/// The tree does not depend on the order of `primitives` or on the number of threads (rayon's current pool). No leaf is deeper than
/// [`TraceOptions::MAX_DEPTH`].
///
/// # Errors
/// [`Error::Scene`] when there are more than 2^27 - 16 of them.
pub fn build_bvh(vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> Result<Bvh> {
    let triangles = ascending(primitives);
    check_triangle_count(triangles.len(), MAX_TRIANGLES)?;
    let mut items: Vec<_> =
        triangles.par_iter().map(|&triangle| Item::new(&vertices[triangle as usize], triangle)).collect();
    let mut nodes = Vec::new();
    if !items.is_empty() {
        let extent = Extent::of(&items);
        let builder = Builder {
            leaf_size: options.leaf_size.max(1) as usize,
            cost_traverse: f64::from(options.cost_traverse),
            cost_intersect: f64::from(options.cost_intersect),
        };
        builder.build(&mut items, Place { first: 0, depth: 0 }, &extent, &mut nodes);
    }
    // Subtrees tell how far on the second child is, so that they can be moved as a whole.
    for (index, node) in nodes.iter_mut().enumerate().filter(|(_, node)| !node.is_leaf()) {
        node.first += index as u32;
    }
    let mut tree = Bvh { nodes, order: items.iter().map(Item::triangle).collect() };
    tree.reinsert(options.reinsert);
    Ok(tree)
}

struct Builder {
    leaf_size: usize,
    cost_traverse: f64,
    cost_intersect: f64,
}

/// Where a node is: the index of its first item, and its depth.
#[derive(Clone, Copy)]
struct Place {
    first: usize,
    depth: u32,
}

impl Builder {
    /// Appends the node of `items` and all below it.
    fn build(&self, items: &mut [Item], place: Place, extent: &Extent, nodes: &mut Vec<BvhNode>) {
        let count = items.len();
        let node_index = nodes.len();
        let bounds = extent.bounds.to_aabb();
        let Some(middle) = self.split(items, place.depth, extent) else {
            items.sort_unstable_by_key(Item::triangle);
            nodes.push(BvhNode { bounds, first: place.first as u32, count: count as u32 });
            return;
        };
        nodes.push(BvhNode { bounds, first: 0, count: 0 });
        let (low, high) = items.split_at_mut(middle);
        let extents = match count >= PARALLEL_ITEMS {
            true => rayon::join(|| Extent::of(low), || Extent::of(high)),
            false => (Extent::of(low), Extent::of(high)),
        };
        let depth = place.depth + 1;
        let low = (low, Place { first: place.first, depth }, extents.0);
        let high = (high, Place { first: place.first + middle, depth }, extents.1);
        let high_is_larger = high.2.bounds.half_area() > low.2.bounds.half_area();
        let (first, second) = if high_is_larger { (high, low) } else { (low, high) };
        if count >= PARALLEL_CHILDREN {
            let mut second_nodes = Vec::new();
            rayon::join(
                || self.build(first.0, first.1, &first.2, nodes),
                || self.build(second.0, second.1, &second.2, &mut second_nodes),
            );
            nodes[node_index].first = (nodes.len() - node_index) as u32;
            nodes.append(&mut second_nodes);
        } else {
            self.build(first.0, first.1, &first.2, nodes);
            nodes[node_index].first = (nodes.len() - node_index) as u32;
            self.build(second.0, second.1, &second.2, nodes);
        }
    }

    /// Brings the items of one child before those of the other and returns how many these are; `None`: the node is a leaf.
    fn split(&self, items: &mut [Item], depth: u32, extent: &Extent) -> Option<usize> {
        let count = items.len();
        let may_be_leaf = count <= self.leaf_size;
        // Halves end in leaves of one triangle after so many levels.
        let levels = count.next_power_of_two().trailing_zeros();
        if depth + levels >= TraceOptions::MAX_DEPTH {
            return (!may_be_leaf).then(|| halve(items, extent));
        }
        let pays = |children_cost: f64| {
            let area = extent.bounds.half_area();
            self.cost_traverse * area + self.cost_intersect * children_cost < self.cost_intersect * area * count as f64
        };
        if count == 1 {
            None
        } else if count <= sweep::CAPACITY {
            match Sweep::best(items, extent) {
                Some(best) if !may_be_leaf || pays(best.cost) => Some(best.apply(items)),
                None if !may_be_leaf => Some(halve(items, extent)),
                _ => None,
            }
        } else {
            let binning = Binning::new(extent);
            match binning.best_split(items) {
                Some(best) if !may_be_leaf || pays(best.cost) => {
                    Some(partition(items, &|item| binning.is_before(item, &best)))
                }
                None if !may_be_leaf => Some(halve(items, extent)),
                _ => None,
            }
        }
    }
}

#[cfg(test)]
mod tests;
