//! kd-tree by the spatial median: every cell is cut in its middle, on the axes in turn or on its longest one.
//!
//! Kaplan, "Space-Tracing: A Constant Time Ray-Tracer", SIGGRAPH '85 course notes, 1985. Planes do not depend on the
//! triangles, so the cells of one depth are alike, and large empty ones are cut off early. Triangles are handed down as
//! in the thesis ([`super::divide`]), so that the plane is the only difference to [`super::median`].
//!
//! Bad at: scenes of uneven detail. A small model in a large scene takes a level for each halving down to it, and there
//! the depth ends before the triangles are apart.

use super::memory::GrowthLimit;
use super::{BuildOptions, KdTree, divide};
use glam::Vec3;

/// Builds the tree; see [`super::build_kd_tree`].
pub(super) fn build(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    growth: &GrowthLimit,
) -> KdTree {
    divide::build(vertices, primitives, options, growth, |axis, _, place| place.cell.middle(axis))
}
