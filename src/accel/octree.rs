//! Octree: every cell is divided at its centre into eight, as long as it is worth it. Glassner, "Space Subdivision for
//! Fast Ray Tracing", IEEE Computer Graphics and Applications 4(10), 1984; thesis, section 2.2.3.
//!
//! A triangle goes to the children in which clipping (`clip.rs`) finds a part of it. Each division is three cuts one
//! after the other, so that the cuts of the kd-tree serve here, too. The root is a cube, so all cells are cubes, up to
//! rounding.
//!
//! Bad at: triangles around one point or through one line, which no division separates; the limits below end that.

use super::clip::Reference;
use super::memory::GrowthLimit;
use super::near::few_outside;
use super::subtree::{Cell, ascending, growth_after};
use super::{Aabb, BuildOptions, StructureArrays};
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::shared::KdNode;
use glam::Vec3;

/// Triangles that are not worth a division: it costs some eight plane and four child tests of a ray that meets the
/// cell.
const LEAF_SIZE: u32 = 8;

impl BuildOptions {
    /// The defaults of an octree of `triangle_count` triangles; `leaf_size` and `max_depth` override them.
    ///
    /// A level quarters the triangles of a cell that a surface runs through: after log4(n) levels there is about one in
    /// each. Four more are for details smaller than that.
    pub fn octree(triangle_count: usize, leaf_size: Option<u32>, max_depth: Option<u32>) -> Self {
        let depth = 4.0 + 0.5 * (triangle_count.max(1) as f32).log2();
        BuildOptions {
            leaf_size: leaf_size.unwrap_or(LEAF_SIZE),
            max_depth: max_depth.unwrap_or(depth as u32),
            ..BuildOptions::new(&TraceOptions::DEFAULT, triangle_count)
        }
    }
}

/// A part of a cell, and what is in it.
type Part = (Cell, Vec<Reference>);

/// A cell that waits to be divided or made a leaf.
struct Open {
    node: usize,
    cell: Cell,
    references: Vec<Reference>,
    depth: u32,
    growth: f64,
}

/// Builds an octree over the triangles `primitives` (indices into `vertices`) in `bounds`, the box around them all.
/// Where few reach beyond `near_reach`, which is that of [`near_reach`](super::near_reach), they are listed for every
/// ray instead.
///
/// No leaf is deeper than the options say, and there are at most 32 references for each triangle.
///
/// # Panics
/// When there are more nodes or references than 32 bits can number.
pub fn build_octree(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    bounds: Aabb,
    options: &BuildOptions,
    near_reach: f32,
) -> StructureArrays {
    build_octree_within(vertices, primitives, bounds, options, near_reach, &GrowthLimit::none())
}

/// As [`build_octree`], unless there are more references than `limit` has room for: the octree is then not finished.
pub(crate) fn build_octree_within(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    bounds: Aabb,
    options: &BuildOptions,
    near_reach: f32,
    limit: &GrowthLimit,
) -> StructureArrays {
    let (outside, primitives, bounds) =
        few_outside(vertices, primitives, near_reach).unwrap_or_else(|| (Vec::new(), primitives.to_vec(), bounds));
    let outside_count = f32::from_bits(outside.len() as u32);
    let around = vec![Float4::new(bounds.low, f32::from_bits(0)), Float4::new(bounds.high, outside_count)];
    let mut structure = StructureArrays { nodes: vec![KdNode::default()], references: outside, bounds: around };
    let side = (bounds.high - bounds.low).max_element();
    // The sum may round below the high corner.
    let cell = Cell { low: bounds.low.to_array(), high: (bounds.low + side).max(bounds.high).to_array() };
    let references = ascending(&primitives).into_iter().map(|i| Reference::whole(vertices, i)).collect();
    let mut open = vec![Open { node: 0, cell, references, depth: 0, growth: 1.0 }];
    while let Some(Open { node, cell, references, depth, growth }) = open.pop() {
        let count = references.len();
        let divided = (count > options.leaf_size as usize && depth < options.max_depth.min(TraceOptions::MAX_DEPTH))
            .then(|| divide(vertices, &cell, &references))
            .flatten()
            .and_then(|(centre, children)| {
                let parts = children.iter().map(|(_, references)| references.len()).sum();
                let growth = growth_after(growth, count, parts)?;
                limit.allows(count, parts).then_some((centre, children, growth))
            });
        let Some((centre, children, growth)) = divided else {
            let first = structure.references.len();
            structure.references.extend(references.iter().map(|reference| reference.triangle));
            structure.nodes[node] = StructureArrays::leaf(first, structure.references.len());
            continue;
        };
        let first = structure.nodes.len();
        structure.nodes.resize(first + children.len(), KdNode::default());
        structure.nodes[node] =
            KdNode { flags: 0, left: first as u32, right: structure.bounds.len() as u32, split: 0.0 };
        structure.bounds.push(Float4::new(centre, 0.0));
        for (i, (cell, references)) in children.into_iter().enumerate().rev() {
            open.push(Open { node: first + i, cell, references, depth: depth + 1, growth });
        }
    }
    let limit = u32::MAX as usize;
    assert!(
        structure.nodes.len() < limit && structure.references.len() < limit,
        "the octree is too large for 32-bit indices"
    );
    structure
}

/// The centre of a cell and its eight parts in the order of the children, or `None` when float32 has no number between
/// the cell's faces on any axis. An axis of which that is true is cut at its upper face, with everything below.
fn divide(vertices: &[[Vec3; 3]], cell: &Cell, references: &[Reference]) -> Option<(Vec3, Vec<Part>)> {
    let mut centre = Vec3::from_array(cell.high);
    let mut parts = vec![(*cell, references.to_vec())];
    let mut is_cut = false;
    // The last axis cut is bit 0 of a part's number.
    for axis in [2, 1, 0] {
        let middle = cell.middle(axis);
        let cuts = cell.is_split_by(axis, middle);
        if cuts {
            centre[axis] = middle;
            is_cut = true;
        }
        parts = parts
            .into_iter()
            .flat_map(|(cell, references)| {
                let (low, high) = cell.split(axis, centre[axis]);
                if !cuts {
                    return [(low, references), (high, Vec::new())];
                }
                let (mut below, mut above) = (Vec::new(), Vec::new());
                for reference in &references {
                    let (left, right) = cut(vertices, reference, &cell, axis, middle);
                    below.extend(left);
                    above.extend(right);
                }
                [(low, below), (high, above)]
            })
            .collect();
    }
    is_cut.then_some((centre, parts))
}

/// The parts of a reference below and above a plane; clipped only when it reaches over it.
fn cut(
    vertices: &[[Vec3; 3]],
    reference: &Reference,
    cell: &Cell,
    axis: usize,
    plane: f32,
) -> (Option<Reference>, Option<Reference>) {
    if reference.high[axis] <= plane {
        (Some(*reference), None)
    } else if reference.low[axis] >= plane {
        (None, Some(*reference))
    } else {
        reference.split(vertices, cell, axis, plane)
    }
}
