//! What a structure other than the kd-tree looks like on the device, and in numbers.

use super::{bvh2, bvh8};
use crate::layout::Float4;
use crate::options::StructureKind;
use crate::shared::{KD_LEAF, KdNode};

/// A structure as the kernels read it; what the arrays mean, its file in `cl/traverse/` says.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureArrays {
    /// Cells, clusters or nodes; those that list triangles are leaf records, but in packed hierarchies of boxes.
    pub nodes: Vec<KdNode>,
    /// Triangle numbers, a range for each leaf record, ascending in each; behind a grid's, all triangles.
    pub references: Vec<u32>,
    /// Boxes, spheres or planes.
    pub bounds: Vec<Float4>,
}

impl StructureArrays {
    /// A record of the triangles from `first` up to the end of the list.
    pub(super) fn leaf(first: usize, end: usize) -> KdNode {
        KdNode { flags: KD_LEAF, left: first as u32, right: (end - first) as u32, split: 0.0 }
    }
}

/// Counts of a structure.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct StructureStats {
    /// Cells, clusters or leaves.
    pub cells: usize,
    /// Those without triangles.
    pub empty_cells: usize,
    /// Entries of all lists together.
    pub references: usize,
    /// Lists that a triangle is in, on average; 0 without triangles.
    pub references_per_triangle: f64,
    /// Triangles in the longest list.
    pub largest_cell: u32,
    /// Memory of nodes, references and bounds.
    pub bytes: usize,
}

impl StructureStats {
    /// The numbers of a structure of kind `accel` over `triangle_count` triangles.
    pub fn new(
        accel: StructureKind,
        nodes: &[KdNode],
        references: &[u32],
        bounds: &[Float4],
        triangle_count: usize,
    ) -> StructureStats {
        let counts: Vec<u32> = match accel {
            StructureKind::Bvh2 | StructureKind::Instances => bvh2::leaf_counts(nodes).collect(),
            StructureKind::Bvh8 => bvh8::leaf_counts(nodes).collect(),
            _ => nodes.iter().filter(|node| node.flags == KD_LEAF).map(|node| node.right).collect(),
        };
        let listed: usize = counts.iter().map(|&count| count as usize).sum();
        StructureStats {
            cells: counts.len(),
            empty_cells: counts.iter().filter(|&&count| count == 0).count(),
            references: listed,
            references_per_triangle: listed as f64 / triangle_count.max(1) as f64,
            largest_cell: counts.iter().copied().max().unwrap_or(0),
            bytes: size_of_val(nodes) + size_of_val(references) + size_of_val(bounds),
        }
    }
}
