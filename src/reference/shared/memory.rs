//! Twin of `cl/memory/`: what traversals read of the scene (`records.cl`, `shading.cl`), and how that and their work is
//! counted (`work.cl`). The twin's arrays lie in one place, and it defers nothing.

use super::instances::{instance_records, placed_shading, placed_vertices};
use crate::layout::Float4;
use crate::pack::SceneBuffers;
use crate::shared::{BVH8_LINKS, BVH8_NODE_RECORDS, BVH8_PACKET_RECORDS, Hit, KdNode, Shading, WorkCounter};
use crate::work::RayWork;
use glam::Vec3;

/// Where a traversal counts its work.
pub trait Work: Default {
    /// Counts `n` more; of a maximum, raises it to `n`.
    fn count(&mut self, counter: WorkCounter, n: u32);

    /// The list that hits are put into, where all are wanted: room for them, and how many there are.
    #[inline(always)]
    fn list(&mut self) -> Option<(&mut [Hit], &mut usize)> {
        None
    }
}

/// Counts nothing and costs nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoWork;

impl Work for NoWork {
    #[inline(always)]
    fn count(&mut self, _: WorkCounter, _: u32) {}
}

impl Work for RayWork {
    #[inline(always)]
    fn count(&mut self, counter: WorkCounter, n: u32) {
        RayWork::count(self, counter, n);
    }
}

/// The hits of a ray found so far, as a test leaves them, the closest first. Counts nothing.
#[derive(Debug, Default)]
pub struct HitList<'a> {
    /// Room for those that are kept.
    pub hits: &'a mut [Hit],
    /// How many there are.
    pub count: usize,
}

impl Work for HitList<'_> {
    #[inline(always)]
    fn count(&mut self, _: WorkCounter, _: u32) {}

    #[inline(always)]
    fn list(&mut self) -> Option<(&mut [Hit], &mut usize)> {
        Some((self.hits, &mut self.count))
    }
}

#[inline(always)]
fn read<T: Copy>(array: &[T], index: usize, counter: WorkCounter, work: &mut impl Work) -> T {
    work.count(counter, size_of::<T>() as u32);
    array[index]
}

/// Three records of a triangle.
#[inline(always)]
fn read_three(array: &[Float4], first: usize, work: &mut impl Work) -> [Float4; 3] {
    let counter = WorkCounter::TriangleBytes;
    [read(array, first, counter, work), read(array, first + 1, counter, work), read(array, first + 2, counter, work)]
}

/// A node.
#[inline(always)]
pub fn load_node(buffers: &SceneBuffers, index: usize, work: &mut impl Work) -> KdNode {
    read(&buffers.nodes, index, WorkCounter::NodeBytes, work)
}

/// A record of `bounds`.
#[inline(always)]
pub fn load_bounds(buffers: &SceneBuffers, index: usize, work: &mut impl Work) -> Float4 {
    read(&buffers.bounds, index, WorkCounter::NodeBytes, work)
}

/// The words of the wide node whose first record is `first`: its planes, which are counted, and its links, which are
/// not.
#[inline(always)]
pub fn load_wide_node<'a>(buffers: &'a SceneBuffers, first: usize, work: &mut impl Work) -> &'a [u32] {
    work.count(WorkCounter::NodeBytes, BVH8_LINKS * size_of::<KdNode>() as u32);
    bytemuck::cast_slice(&buffers.nodes[first..first + BVH8_NODE_RECORDS as usize])
}

/// The link to child `lane` of the wide node with that number.
#[inline(always)]
pub fn load_wide_link(buffers: &SceneBuffers, node: u32, lane: usize, work: &mut impl Work) -> u32 {
    work.count(WorkCounter::NodeBytes, size_of::<u32>() as u32);
    let first = (BVH8_NODE_RECORDS * node + BVH8_LINKS) as usize;
    bytemuck::cast_slice::<_, u32>(&buffers.nodes[first..first + 2])[lane]
}

/// The records of the instance that a ray enters, whose box it meets.
#[inline(always)]
pub fn load_instance<'a>(buffers: &'a SceneBuffers, instance: u32, work: &mut impl Work) -> &'a [Float4] {
    let records = instance_records(buffers, instance);
    work.count(WorkCounter::NodeBytes, size_of_val(records) as u32);
    records
}

/// Counts a packet of eight triangles, whose numbers the twin reads elsewhere.
#[inline(always)]
pub fn count_packet(work: &mut impl Work) {
    work.count(WorkCounter::TriangleBytes, BVH8_PACKET_RECORDS * size_of::<Float4>() as u32);
}

/// The triangle of a reference.
#[inline(always)]
pub fn load_reference(buffers: &SceneBuffers, index: usize, work: &mut impl Work) -> u32 {
    read(&buffers.references, index, WorkCounter::TriangleBytes, work)
}

/// The vertices of a triangle, tracing space; not counted.
#[inline(always)]
pub fn vertices(buffers: &SceneBuffers, primitive: u32) -> [Vec3; 3] {
    if buffers.has_instances() {
        return placed_vertices(buffers, primitive);
    }
    let first = 3 * primitive as usize;
    [buffers.vertices[first].xyz(), buffers.vertices[first + 1].xyz(), buffers.vertices[first + 2].xyz()]
}

/// The vertices of a triangle, tracing space, for a test.
#[inline(always)]
pub fn load_vertices(buffers: &SceneBuffers, primitive: u32, work: &mut impl Work) -> [Vec3; 3] {
    if buffers.has_instances() {
        work.count(WorkCounter::TriangleBytes, 3 * size_of::<Float4>() as u32);
        return placed_vertices(buffers, primitive);
    }
    let first = 3 * primitive as usize;
    let [a, b, c] = read_three(&buffers.vertices, first, work);
    [a.xyz(), b.xyz(), c.xyz()]
}

/// The shading data of a triangle.
#[inline(always)]
pub fn load_shading(buffers: &SceneBuffers, primitive: u32) -> Shading {
    match buffers.has_instances() {
        true => placed_shading(buffers, primitive),
        false => buffers.shading[primitive as usize],
    }
}

/// The precomputed data of a triangle.
#[inline(always)]
pub fn load_transform(buffers: &SceneBuffers, primitive: u32, work: &mut impl Work) -> [Float4; 3] {
    read_three(&buffers.transforms, 3 * primitive as usize, work)
}
