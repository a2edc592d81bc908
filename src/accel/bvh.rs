//! Binary bounding volume hierarchy by the surface area heuristic.
//!
//! Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", IEEE Symposium on Interactive Ray Tracing
//! 2007: large nodes sort centroids into bins ([`bins`]); small ones try every split of the sorted centroids
//! ([`sweep`]), which is as fast there and better. A node is a leaf when no split pays, and not before it is small
//! enough. Nodes side by side, and the bins and the partition of the largest ones, use all cores. What such splits put
//! into a bad place [`reinsert`] moves to a better one.
//!
//! Triangles that are much larger than their neighbours, or long and oblique, have boxes that overlap those of others.
//! A kd-tree cuts them, and so does this build on request ([`spatial`]): up to a given number of parts, for which there
//! is room from the start. A subtree gets its share of what is left, so that what one uses does not depend on others,
//! nor on who builds them. Whether that pays, [`weigh`] finds out.
//!
//! Which of two children is best searched first where any hit will do, [`worth`] estimates for those that pack the
//! tree.
//!
//! What all relies on: each point of a triangle is in the box of a leaf that lists the triangle, and in all boxes above
//! it.
//!
//! Knows nothing of how nodes are packed.

mod bins;
mod items;
mod object;
mod refit;
mod reinsert;
mod spatial;
mod sweep;
mod weigh;
mod worth;

use super::subtree::ascending;
use super::{Aabb, BuildOptions};
use crate::error::{Error, Result};
use crate::options::{BvhOptions, KdOptions, SpatialSplits, StructureKind, TraceOptions};
use crate::parallel;
use glam::Vec3;
use items::{Extent, Item, PARALLEL_ITEMS, halve};
use object::ObjectSplit;
pub use refit::{KeptBvh, tree_of};
use spatial::SpatialSplit;
pub use weigh::SplitsChosen;
#[cfg(test)]
pub(super) use worth::before_a_wall;
pub use worth::worths;

/// A node of a [`Bvh`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BvhNode {
    /// The smallest box around its triangles, or, where splits of space have cut them, around the parts that are here.
    pub bounds: Aabb,
    /// Of a leaf its first triangle, as an index into [`Bvh::order`]; of an inner node its second child. The first
    /// child is the next node.
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

/// A binary tree of boxes over triangles. Each point of a triangle is in the box of a leaf that lists the triangle, and
/// in all boxes above it; without splits of space each triangle is in one leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Bvh {
    /// Depth first, the root first; of two children that with the larger surface first. Empty without triangles.
    pub nodes: Vec<BvhNode>,
    /// The triangles, a range for each leaf, ascending within a leaf.
    pub order: Vec<u32>,
    /// The expected cost with splits of space by that without, by which [`SpatialSplits::Auto`] has chosen the tree;
    /// `None` where there was nothing to choose.
    pub splits_ratio: Option<f64>,
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

    /// Expected cost of a ray through the root's box (MacDonald and Booth 1990): steps and triangle tests, at the two
    /// costs of `options`. 0 without triangles; NaN when the root's box has no surface.
    pub fn expected_cost(&self, options: &BuildOptions) -> f64 {
        let of = |node: &BvhNode| match node.count {
            0 => f64::from(options.cost_traverse) * node.bounds.half_area(),
            count => f64::from(options.cost_intersect) * f64::from(count) * node.bounds.half_area(),
        };
        let whole = self.nodes.first().map_or(1.0, |root| root.bounds.half_area());
        self.nodes.iter().map(of).sum::<f64>() / whole
    }

    /// Checks what a leaf of packed kind `accel` has room for, before anything is packed.
    pub(super) fn check_leaves(&self, accel: StructureKind, most: u32) -> Result<()> {
        let largest = self.nodes.iter().map(|node| node.count).max().unwrap_or(0);
        if largest > most {
            let message =
                format!("there is a leaf of {largest} triangles, and `structure = {accel}` has room for {most} in one");
            return Err(Error::option("leaf_size", message));
        }
        Ok(())
    }
}

/// The most triangles: their places in `order` leave room for a count in a packed link.
pub(crate) const MAX_TRIANGLES: usize = (1 << 27) - 16;

/// Checks that links can number `count` triangles when they can number `limit`.
pub(crate) fn check_triangle_count(count: usize, limit: usize) -> Result<()> {
    if count > limit {
        let reason =
            format!("it has {count} triangles, and a hierarchy of boxes can number {limit}; take `structure = kd`");
        return Err(Error::Scene(reason));
    }
    Ok(())
}

/// Nodes of at least this many triangles build their children side by side; smaller ones cost less than handing them
/// over.
const PARALLEL_CHILDREN: usize = 2048;

/// A split of space is tried where the boxes of the two halves of the triangles have so much in common, as a share of
/// the root's surface: alpha of the paper.
const LEAST_OVERLAP: f64 = 1e-5;

impl BuildOptions {
    /// The most triangles of a leaf, unless something else is asked for: the costs stop most nodes earlier.
    const BVH_LEAF_SIZE: u32 = 8;

    /// Cost of a triangle test where eight are looked at together, in steps.
    const WIDE_COST_INTERSECT: f32 = 0.25;

    /// Passes of reinsertion unless something else is asked for. In bvh2, 1, 3 and 5 passes spared sponza's shadow rays
    /// 3, 6 and 7 % of their steps and its camera rays 17, 29 and 30 %; later ones moved nothing, and none found
    /// anything to move in bunny and gears. Five made the builds of these up to 17 % longer, and that of a million
    /// triangles up to half.
    const REINSERT: u32 = 5;

    /// The parts that splits of space may add unless something else is asked for.
    const SPATIAL_SPLITS: SpatialSplits = SpatialSplits::NONE;

    /// What `bvh` asks for in a bounding volume hierarchy of that kind.
    pub fn bvh(bvh: &BvhOptions, kind: StructureKind) -> Self {
        BuildOptions {
            leaf_size: bvh.leaf_size.unwrap_or(Self::BVH_LEAF_SIZE),
            max_depth: TraceOptions::MAX_DEPTH,
            reinsert: bvh.reinsert.unwrap_or(Self::REINSERT),
            spatial_splits: bvh.spatial_splits.unwrap_or(Self::SPATIAL_SPLITS),
            cost_traverse: bvh.cost_traverse.unwrap_or(KdOptions::COST),
            cost_intersect: bvh.cost_intersect.unwrap_or(match kind {
                StructureKind::Bvh8 => Self::WIDE_COST_INTERSECT,
                _ => KdOptions::COST,
            }),
            ..BuildOptions::new(&TraceOptions::DEFAULT, 0)
        }
    }
}

/// Builds a hierarchy over the triangles `primitives` (indices into `vertices`; each finite), of which one that is
/// listed twice counts once. Reads `leaf_size`, the most triangles of a leaf, the two costs, `spatial_splits` and
/// `reinsert`.
///
/// The tree does not depend on the order of `primitives` or on the number of threads (rayon's current pool). No leaf is
/// deeper than [`TraceOptions::MAX_DEPTH`], and all leaves together have at most 2^27 - 16 triangles.
///
/// # Errors
/// [`Error::Scene`] when there are more than 2^27 - 16 of them.
pub fn build_bvh(vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> Result<Bvh> {
    let triangles = ascending(primitives);
    check_triangle_count(triangles.len(), MAX_TRIANGLES)?;
    Ok(match options.spatial_splits {
        SpatialSplits::Share(share) => grow(vertices, &triangles, share, options),
        SpatialSplits::Auto => weigh::cheaper(|share| grow(vertices, &triangles, share, options), options),
    })
}

/// The tree of `triangles`, ascending, where splits of space may add so many parts per triangle.
fn grow(vertices: &[[Vec3; 3]], triangles: &[u32], share: f32, options: &BuildOptions) -> Bvh {
    let item = |&triangle: &u32| Item::new(&vertices[triangle as usize], triangle);
    let mut items = parallel::map_slice(triangles, item);
    let mut nodes = Vec::new();
    if !items.is_empty() {
        let extent = Extent::of(&items);
        let builder = Builder {
            vertices,
            leaf_size: options.leaf_size.max(1) as usize,
            cost_traverse: f64::from(options.cost_traverse),
            cost_intersect: f64::from(options.cost_intersect),
            least_overlap: LEAST_OVERLAP * extent.bounds.half_area(),
        };
        let count = items.len();
        let room = (f64::from(share) * count as f64) as usize;
        items.resize(count + room.min(MAX_TRIANGLES - count), items[0]);
        builder.build(List { slots: &mut items, count, first: 0, depth: 0, extent }, &mut nodes);
    }
    // Subtrees tell how far on the second child is, so that they can be moved as a whole, and leaves where among the
    // items theirs are.
    let mut order = Vec::with_capacity(triangles.len());
    for (index, node) in nodes.iter_mut().enumerate() {
        if node.is_leaf() {
            let first = order.len() as u32;
            order.extend(items[node.first as usize..][..node.count as usize].iter().map(Item::triangle));
            node.first = first;
        } else {
            node.first += index as u32;
        }
    }
    let mut tree = Bvh { nodes, order, splits_ratio: None };
    tree.reinsert(options.reinsert);
    tree
}

struct Builder<'a> {
    vertices: &'a [[Vec3; 3]],
    leaf_size: usize,
    cost_traverse: f64,
    cost_intersect: f64,
    /// Half of the surface that two children must have in common before a split of space is tried.
    least_overlap: f64,
}

/// The items of a node, with room for the parts that splits of space may add below it.
struct List<'a> {
    /// The items, and then the room.
    slots: &'a mut [Item],
    count: usize,
    /// Where the first slot is among all.
    first: usize,
    depth: u32,
    extent: Extent,
}

impl<'a> List<'a> {
    fn items(&mut self) -> &mut [Item] {
        &mut self.slots[..self.count]
    }

    /// The lists of two children, of which the first one's `low_count` items are in front, and the other's are those
    /// `behind`, or else all others. Each gets room by its items.
    fn divide(self, low_count: usize, behind: Option<Vec<Item>>) -> [List<'a>; 2] {
        let high_count = behind.as_ref().map_or(self.count - low_count, Vec::len);
        let room = self.slots.len() - low_count - high_count;
        let middle = low_count + (room as u64 * low_count as u64 / (low_count + high_count) as u64) as usize;
        match behind {
            Some(behind) => self.slots[middle..middle + high_count].copy_from_slice(&behind),
            None => self.slots.copy_within(low_count..self.count, middle),
        }
        let (low, high) = self.slots.split_at_mut(middle);
        let extents = match low_count + high_count >= PARALLEL_ITEMS {
            true => rayon::join(|| Extent::of(&low[..low_count]), || Extent::of(&high[..high_count])),
            false => (Extent::of(&low[..low_count]), Extent::of(&high[..high_count])),
        };
        let depth = self.depth + 1;
        [
            List { slots: low, count: low_count, first: self.first, depth, extent: extents.0 },
            List { slots: high, count: high_count, first: self.first + middle, depth, extent: extents.1 },
        ]
    }
}

impl Builder<'_> {
    /// Appends the node of a list and all below it.
    fn build(&self, mut list: List, nodes: &mut Vec<BvhNode>) {
        let count = list.count;
        let node_index = nodes.len();
        let bounds = list.extent.bounds.to_aabb();
        let Some((low_count, behind)) = self.split(&mut list) else {
            list.items().sort_unstable_by_key(Item::triangle);
            nodes.push(BvhNode { bounds, first: list.first as u32, count: count as u32 });
            return;
        };
        nodes.push(BvhNode { bounds, first: 0, count: 0 });
        let [low, high] = list.divide(low_count, behind);
        let high_is_larger = high.extent.bounds.half_area() > low.extent.bounds.half_area();
        let (first, second) = if high_is_larger { (high, low) } else { (low, high) };
        if count >= PARALLEL_CHILDREN {
            let mut second_nodes = Vec::new();
            rayon::join(|| self.build(first, nodes), || self.build(second, &mut second_nodes));
            nodes[node_index].first = (nodes.len() - node_index) as u32;
            nodes.append(&mut second_nodes);
        } else {
            self.build(first, nodes);
            nodes[node_index].first = (nodes.len() - node_index) as u32;
            self.build(second, nodes);
        }
    }

    /// Brings the items of one child to the front and returns how many these are, and those of the other child when
    /// they are not just the rest; `None`: the node is a leaf.
    fn split(&self, list: &mut List) -> Option<(usize, Option<Vec<Item>>)> {
        let (count, extent) = (list.count, list.extent);
        let may_be_leaf = count <= self.leaf_size;
        // Halves end in leaves of one triangle after so many levels.
        let levels = count.next_power_of_two().trailing_zeros();
        if list.depth + levels >= TraceOptions::MAX_DEPTH {
            return (!may_be_leaf).then(|| (halve(list.items(), &extent), None));
        }
        if count == 1 {
            return None;
        }
        let object = ObjectSplit::best(list.items(), &extent);
        let spatial = self.spatial_split(list, object.as_ref());
        let area = extent.bounds.half_area();
        let pays = |children_cost: f64| {
            self.cost_traverse * area + self.cost_intersect * children_cost < self.cost_intersect * area * count as f64
        };
        match (spatial, object) {
            (Some(split), _) if !may_be_leaf || pays(split.cost()) => {
                let (low_count, behind) = split.apply(self.vertices, list.items());
                Some((low_count, Some(behind)))
            }
            (None, Some(split)) if !may_be_leaf || pays(split.cost()) => Some((split.apply(list.items()), None)),
            (None, None) if !may_be_leaf => Some((halve(list.items(), &extent), None)),
            _ => None,
        }
    }

    /// A split of space that is better than that of the triangles, where this one is bad enough and there is room for
    /// parts.
    fn spatial_split(&self, list: &mut List, object: Option<&ObjectSplit>) -> Option<SpatialSplit> {
        let (room, bounds) = (list.slots.len() - list.count, list.extent.bounds);
        if room == 0 {
            return None;
        }
        let overlap = object.map_or(bounds, |object| object.overlap(list.items()));
        let is_large = !overlap.is_empty() && overlap.half_area() > self.least_overlap;
        if !is_large {
            return None;
        }
        // Where all centroids are alike, it need only be better than a leaf.
        let cost = object.map_or_else(|| bounds.half_area() * list.count as f64, ObjectSplit::cost);
        SpatialSplit::best(self.vertices, list.items(), &bounds, room).filter(|split| split.cost() < cost)
    }
}

#[cfg(test)]
mod tests;
