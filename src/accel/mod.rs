//! Acceleration structures: what every builder returns, and its checks. Knows nothing of devices.

mod bvh;
mod bvh2;
mod bvh8;
mod clip;
mod cost;
mod divide;
mod events;
mod grid;
mod leaf_packets;
mod link;
mod median;
mod memory;
mod near;
mod node_order;
mod octree;
mod ropes;
mod sah;
mod sampled_median;
mod small;
mod spatial_median;
mod stats;
mod stop;
mod structure;
mod subtree;
mod validate;
mod volumes;

pub use bvh::{Bvh, BvhNode, KeptBvh, SplitsChosen, build_bvh, tree_of, worths};
#[cfg(test)]
pub(crate) use bvh2::{Middle, NOWHERE};
pub use bvh2::{move_links, pack_bvh2};
pub use bvh8::{Bvh8, pack_bvh8};
pub use cost::Measure;
pub use grid::build_grid;
pub use leaf_packets::pack_kd_leaves;
pub use near::{Padding, near_reach};
pub use node_order::reorder;
pub use octree::build_octree;
pub use ropes::link_leaves;
pub use stats::{TreeStats, expected_cost};
pub use structure::{StructureArrays, StructureStats};
pub use validate::check_tree;
pub use volumes::{build_boxes, build_spheres};

pub(crate) use bvh::{MAX_TRIANGLES, check_triangle_count};
pub(crate) use grid::build_grid_within;
pub(crate) use link::{instance_link, instance_of, leaf_link, leaf_range};
pub(crate) use memory::{GrowthLimit, TRIANGLE_BYTES, structure_bytes};
pub(crate) use octree::build_octree_within;

use crate::options::{Build, KdOptions, PacketSize, SpatialSplits, SplitAxis, Stop, Structure, TraceOptions};
use crate::shared::KdNode;
use glam::Vec3;

/// An axis-aligned box; empty when a low coordinate exceeds the high one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Low corner.
    pub low: Vec3,
    /// High corner.
    pub high: Vec3,
}

impl Aabb {
    /// The box that contains nothing.
    pub const EMPTY: Aabb = Aabb { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    /// The smallest box around both.
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// The smallest box around a triangle.
    pub fn of_triangle(vertices: &[Vec3; 3]) -> Aabb {
        Aabb { low: vertices[0].min(vertices[1]).min(vertices[2]), high: vertices[0].max(vertices[1]).max(vertices[2]) }
    }

    /// Half of the surface; means nothing when the box is empty.
    #[inline]
    pub fn half_area(&self) -> f64 {
        half_area((self.high - self.low).to_array().map(f64::from))
    }
}

/// Half of the surface of a box with sides of these lengths; in f64, where products of float32 lengths neither over-
/// nor underflow.
#[inline(always)]
fn half_area([x, y, z]: [f64; 3]) -> f64 {
    x * y + (x + y) * z
}

/// What a builder needs to know beside the triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BuildOptions {
    /// A node with at most this many triangles is not split.
    pub leaf_size: u32,
    /// No leaf is deeper than this, the root counted as 0.
    pub max_depth: u32,
    /// Whether a split must also pay.
    pub stop: Stop,
    /// A split is refused when both children keep more than this share of the triangles; 1: none is.
    pub similar_children: f32,
    /// Cost of one traversal step.
    pub cost_traverse: f32,
    /// Cost of one triangle test.
    pub cost_intersect: f32,
    /// Factor by which the cost of a split with an empty side is reduced, in 0..1 (0: not at all).
    pub empty_bonus: f32,
    /// Which axis the builds that do not weigh costs split first.
    pub split_axis: SplitAxis,
    /// Triangles that the sampled median is taken of.
    pub sample_size: u32,
    /// Passes of reinsertion over a hierarchy of boxes.
    pub reinsert: u32,
    /// How many references splits of space may add to a hierarchy of boxes.
    pub spatial_splits: SpatialSplits,
}

impl BuildOptions {
    /// What `options` ask for in their structure of `triangle_count` triangles, and the defaults of its build for the
    /// rest.
    pub fn of(options: &TraceOptions, triangle_count: usize) -> Self {
        match options.structure {
            Structure::Octree(octree) => Self::octree(triangle_count, octree.leaf_size, octree.max_depth),
            Structure::Bvh2(bvh) | Structure::Bvh8(bvh) | Structure::Instances(bvh) => Self::bvh(&bvh, options.kind()),
            Structure::Boxes(clusters) | Structure::Spheres(clusters) => BuildOptions {
                leaf_size: clusters.leaf_size.unwrap_or_else(|| volumes::cluster_size(triangle_count)),
                ..Self::new(options, triangle_count)
            },
            Structure::Brute | Structure::Kd(_) | Structure::Grid(_) => Self::new(options, triangle_count),
        }
    }

    /// What `options` ask for in a kd-tree of `triangle_count` triangles, and the defaults of their build for the rest.
    pub fn new(options: &TraceOptions, triangle_count: usize) -> Self {
        // Havran (2000, section 4.4): depth 8 + 1.3 log2 N. On the bunny and sponza 12 levels more gain 0.1 % of cost.
        let depth = 8.0 + 1.3 * (triangle_count.max(1) as f32).log2();
        let kd = options.kd();
        let (build, stop) = (kd.build, kd.stop());
        // By size: within 3 % of the least expected cost of 1, 2, 4, 8, 12, 16, 24 and 32 on bunny, sponza, teapot and
        // gears.
        let default_leaf = match (stop, build) {
            (Stop::Cost, _) => 1, // the cost decides
            (Stop::Size, Build::Median | Build::SampledMedian) => 12,
            (Stop::Size, Build::SpatialMedian) => 8,
            (Stop::Size, Build::Sah | Build::Volume) => 4,
        };
        let default_share = if build.weighs_costs() { 1.0 } else { KdOptions::SIMILAR_CHILDREN };
        BuildOptions {
            leaf_size: kd.leaf_size.unwrap_or(default_leaf),
            max_depth: kd.max_depth.unwrap_or(depth as u32),
            stop,
            similar_children: kd.similar_children.unwrap_or(default_share),
            cost_traverse: kd.cost_traverse.unwrap_or(match options.packet_size {
                PacketSize::One => KdOptions::COST,
                PacketSize::Sixteen => KdOptions::PACKET_COST_TRAVERSE,
            }),
            cost_intersect: kd.cost_intersect.unwrap_or(KdOptions::COST),
            empty_bonus: kd.empty_bonus.unwrap_or(KdOptions::EMPTY_BONUS),
            split_axis: kd.split_axis,
            sample_size: kd.sample_size.unwrap_or(KdOptions::SAMPLE_SIZE),
            reinsert: 0,
            spatial_splits: SpatialSplits::NONE,
        }
    }
}

/// A kd-tree over triangles.
///
/// Every point of every triangle lies in a leaf that refers to that triangle: a point on a split plane belongs to both
/// sides, so a triangle that touches a plane from one side only may be listed on that side only, and one that lies in
/// the plane is listed on at least one side. Traversals therefore must visit both sides of a plane that is hit exactly.
#[derive(Debug, Clone, PartialEq)]
pub struct KdTree {
    /// Nodes in left pre-order; the root is node 0.
    pub nodes: Vec<KdNode>,
    /// Triangle numbers, a range for each leaf, ascending within a leaf.
    pub references: Vec<u32>,
    /// The box around all triangles.
    pub bounds: Aabb,
}

/// Builds a kd-tree over the triangles `primitives` (indices into `vertices`; each finite and not of zero area).
///
/// An empty list gives a tree of one empty leaf. A primitive that is listed twice counts once. The tree does not depend
/// on the order of `primitives` or on the number of threads (rayon's current pool). No leaf is deeper than
/// [`crate::options::TraceOptions::MAX_DEPTH`], whatever the options say, and there are at most 32 references per
/// triangle.
///
/// # Panics
/// When there are more than 2^30 primitives, or more nodes or references than 32 bits can number.
pub fn build_kd_tree(build: Build, vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> KdTree {
    build_kd_tree_within(build, vertices, primitives, options, &GrowthLimit::none())
}

/// As [`build_kd_tree`], unless there are more references than `limit` has room for: the tree is then not finished.
pub(crate) fn build_kd_tree_within(
    build: Build,
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    limit: &GrowthLimit,
) -> KdTree {
    match build {
        Build::Median => median::build(vertices, primitives, options, limit),
        Build::SampledMedian => sampled_median::build(vertices, primitives, options, limit),
        Build::SpatialMedian => spatial_median::build(vertices, primitives, options, limit),
        Build::Sah => sah::build(Measure::Surface, vertices, primitives, options, limit),
        Build::Volume => sah::build(Measure::Volume, vertices, primitives, options, limit),
    }
}
