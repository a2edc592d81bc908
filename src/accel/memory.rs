//! How much memory structures take, estimated from numbers of triangles before they are built.
//!
//! The figures are bytes for each triangle at the worst moment of packing a scene, the triangles themselves and what
//! shading reads of them included. They were measured on closed surfaces, loose triangles and long loose triangles,
//! 10^4 to 10^6 of each, as the largest resident size of the process; the least was two thirds of the largest, and no
//! figure is more than a tenth below that. What depends on how triangles lie (references of kd-trees and octrees) is
//! limited while it is built, by [`GrowthLimit`]; a grid counts its references before it makes them.
//!
//! Bad at: scenes of few triangles, where they hardly matter.

use super::{BuildOptions, BvhNode, grid};
use crate::options::{PacketSize, SpatialSplits, Stop, StructureKind, TraceOptions, Traversal};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Vertices as the builders and as the tracers take them, shading data, and two numbers: what every structure needs.
pub(crate) const TRIANGLE_BYTES: f64 = 160.0;

/// What the rows of precomputed transforms take.
const TRANSFORM_BYTES: f64 = 48.0;

/// What an instance takes: its record, and its place in the hierarchy of instances while that is built.
const INSTANCE_BYTES: f64 = 600.0;

/// What a finished hierarchy of boxes takes at worst while another one is built: two nodes and a number for a triangle.
const OTHER_TREE_BYTES: f64 = (2 * size_of::<BvhNode>() + size_of::<u32>()) as f64;

/// A further reference of a tree: its number, and at worst two nodes for it alone, in lists that grow by doubling.
const REFERENCE_BYTES: u64 = 80;

/// What ropes, or the packets of leaves, add to that.
const BOUND_REFERENCE_BYTES: u64 = 120;

/// Bytes that building and packing take at the most at a time, of so many stored triangles and placed instances.
pub(crate) fn structure_bytes(options: &TraceOptions, triangle_count: usize, instance_count: usize) -> u64 {
    let build = BuildOptions::of(options, triangle_count);
    let leaf_size = f64::from(build.leaf_size.max(1));
    let added_references = f64::from(build.spatial_splits.most());
    let of_structure = match options.kind() {
        StructureKind::Brute => TRIANGLE_BYTES,
        StructureKind::Boxes | StructureKind::Spheres => 170.0,
        StructureKind::Kd => kd_bytes(options, &build, leaf_size),
        StructureKind::Octree => 220.0 + 700.0 / leaf_size,
        StructureKind::Grid => TRIANGLE_BYTES + grid::DEFAULT_BYTES,
        StructureKind::Bvh2 if leaf_size < 2.0 => 350.0,
        StructureKind::Bvh2 => 270.0 + 110.0 * added_references.min(1.0),
        StructureKind::Bvh8 => (150.0 + 800.0 / leaf_size).max(300.0) + 40.0 * added_references,
        StructureKind::Instances => 365.0,
    };
    let of_transforms = if options.intersector.needs_transforms() { TRANSFORM_BYTES } else { 0.0 };
    let of_other_tree = if build.spatial_splits == SpatialSplits::Auto { OTHER_TREE_BYTES } else { 0.0 };
    ((of_structure + of_transforms + of_other_tree) * triangle_count as f64 + INSTANCE_BYTES * instance_count as f64)
        as u64
}

fn kd_bytes(options: &TraceOptions, build: &BuildOptions, leaf_size: f64) -> f64 {
    let of_tree = match (build.stop, options.kd().build.weighs_costs(), options.packet_size) {
        (Stop::Cost, _, PacketSize::Sixteen) => 450.0,
        (Stop::Cost, _, PacketSize::One) => 560.0,
        (Stop::Size, true, _) => 250.0 + 580.0 / leaf_size.sqrt(),
        (Stop::Size, false, _) => 180.0 + 500.0 / leaf_size.sqrt(),
    };
    of_tree + if options.kd().traversal == Traversal::Ropes { 70.0 } else { 0.0 }
}

/// How many references a tree may have beside one for each triangle; counted by all threads that build it.
#[derive(Debug)]
pub(crate) struct GrowthLimit {
    most: usize,
    added: AtomicUsize,
}

impl GrowthLimit {
    /// No limit but that of every build.
    pub const fn none() -> GrowthLimit {
        GrowthLimit { most: usize::MAX, added: AtomicUsize::new(0) }
    }

    /// What so many bytes have room for.
    pub fn of_bytes(bytes: u64, options: &TraceOptions) -> GrowthLimit {
        let has_bounds = options.kd().traversal == Traversal::Ropes || options.packet_size != PacketSize::One;
        let of_reference = REFERENCE_BYTES + if has_bounds { BOUND_REFERENCE_BYTES } else { 0 };
        GrowthLimit { most: (bytes / of_reference) as usize, added: AtomicUsize::new(0) }
    }

    /// Takes note of a node of `count` references that is split into `parts`; false when that is too much, and from
    /// then on.
    pub fn allows(&self, count: usize, parts: usize) -> bool {
        let added = parts.saturating_sub(count);
        self.added.fetch_add(added, Ordering::Relaxed).saturating_add(added) <= self.most
    }

    /// Whether it was met: what was built then is no finished tree. It does not depend on the order in which threads
    /// came.
    pub fn is_exceeded(&self) -> bool {
        self.added.load(Ordering::Relaxed) > self.most
    }

    /// Bytes that the references take which were asked for when it was met, and those that are there.
    pub fn added_bytes(&self) -> u64 {
        (self.added.load(Ordering::Relaxed) as u64).saturating_mul(REFERENCE_BYTES)
    }
}
