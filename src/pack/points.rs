//! What point queries go through: a hierarchy of boxes over all triangles, also those without area, which rays never
//! hit but which have a closest point. It is binary, or of eight children a node ("wide"), for processors.
//!
//! That is the tracer's own structure where it is such a hierarchy and all triangles are in it. Else one is built when
//! the first point is asked for, and kept.

use super::SceneBuffers;
use super::space::tracing_scale;
use crate::accel::{Aabb, BuildOptions, Bvh8, Padding, StructureArrays, build_bvh, pack_bvh2, pack_bvh8};
use crate::budget::{CHECKED_FROM_BYTES, DecidedBy, MemoryBudget, Need};
use crate::error::Result;
use crate::layout::Float4;
use crate::options::{BvhOptions, StructureKind};
use crate::parallel;
use crate::shared::KdNode;
use glam::Vec3;
use std::sync::Arc;

/// A scene as point queries want it.
#[derive(Debug, Clone)]
pub struct PointScene {
    buffers: Arc<SceneBuffers>,
    /// What was built for points; `None`: the arrays are those of rays.
    own: Option<OwnArrays>,
    is_wide: bool,
    scale: f32,
    /// Triangles that have a closest point.
    count: usize,
}

/// A hierarchy for points alone.
#[derive(Debug, Clone)]
struct OwnArrays {
    structure: StructureArrays,
    /// Of a binary one: three for each triangle. A wide one has its own in `structure`.
    vertices: Vec<Float4>,
    stack_entries: u32,
}

/// The structure of rays that points share, if it is of a kind and has all triangles.
fn shared_kind(buffers: &SceneBuffers) -> Option<StructureKind> {
    buffers.left_out.is_empty().then_some(buffers.made_for.accel)
}

impl PointScene {
    /// Of a scene that is packed; `given` tells the vertices of each triangle in world units, also of one without area.
    /// `prefers_wide`: whether who answers is sooner done with eight boxes at a time, as processors are.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory) when what has to be built takes more than `budget` has;
    /// [`Scene`](crate::Error::Scene) when there are too many triangles.
    pub fn new(
        buffers: &Arc<SceneBuffers>,
        given: impl Fn(u32) -> [Vec3; 3] + Sync,
        prefers_wide: bool,
        budget: &MemoryBudget,
    ) -> Result<PointScene> {
        let count = buffers.triangle_count();
        let buffers = buffers.clone();
        let is_wide = PointScene::is_wide_for(&buffers, prefers_wide);
        let kind = if is_wide { StructureKind::Bvh8 } else { StructureKind::Bvh2 };
        if shared_kind(&buffers) == Some(kind) {
            return Ok(PointScene { own: None, is_wide, scale: buffers.params.scale, count, buffers });
        }
        check_memory("a hierarchy of boxes for points", count, budget)?;
        let sound = |i: usize| given(i as u32).iter().all(|corner| corner.is_finite()).then_some(i as u32);
        let sound = parallel::flat_map_numbers(count, sound);
        let bounds_of = |i: usize| Aabb::of_triangle(&given(sound[i]));
        let bounds = parallel::reduce_numbers(sound.len(), Aabb::EMPTY, bounds_of, Aabb::union);
        let scale = if sound.is_empty() { 1.0 } else { tracing_scale(bounds.low, bounds.high) };
        let scaled = |i: usize| given(i as u32).map(|p| if p.is_finite() { p * scale + 0.0 } else { Vec3::ZERO });
        let triangles = parallel::map_numbers(count, scaled);
        let tree = build_bvh(&triangles, &sound, &BuildOptions::bvh(&BvhOptions::DEFAULT, kind))?;
        let own = if is_wide {
            let Bvh8 { structure, stack_entries } = pack_bvh8(&tree, &triangles, Padding::from(0.0))?;
            OwnArrays { structure, vertices: Vec::new(), stack_entries }
        } else {
            // Its nodes are searched the nearest first, and by no ray.
            let structure = pack_bvh2(&tree, &[], 0, 0.0)?;
            let vertices = triangles.iter().flatten().map(|&p| Float4::new(p, 0.0)).collect();
            OwnArrays { structure, vertices, stack_entries: tree.depth() + 1 }
        };
        Ok(PointScene { own: Some(own), is_wide, scale, count: sound.len(), buffers })
    }

    /// Whether a scene's points go through eight children a node: not where rays have a binary hierarchy that points
    /// share.
    pub fn is_wide_for(buffers: &SceneBuffers, prefers_wide: bool) -> bool {
        prefers_wide && shared_kind(buffers) != Some(StructureKind::Bvh2)
    }

    /// Whether nodes are those of `src/accel/bvh8.rs`.
    pub fn is_wide(&self) -> bool {
        self.is_wide
    }

    /// The most entries of a traversal's stack.
    pub fn stack_entries(&self) -> u32 {
        self.own.as_ref().map_or(self.buffers.stack_entries, |own| own.stack_entries)
    }

    /// The scene as rays want it.
    pub fn buffers(&self) -> &Arc<SceneBuffers> {
        &self.buffers
    }

    /// Whether the arrays are those of rays.
    pub fn is_shared(&self) -> bool {
        self.own.is_none()
    }

    /// Tracing space of point queries is world units times this.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Triangles that have a closest point.
    pub fn triangle_count(&self) -> usize {
        self.count
    }

    /// The nodes, as `src/accel/bvh2.rs` or, where they are wide, `src/accel/bvh8.rs` has them.
    pub fn nodes(&self) -> &[KdNode] {
        self.own.as_ref().map_or(&self.buffers.nodes, |own| &own.structure.nodes)
    }

    /// Triangle numbers: the leaves' ranges.
    pub fn references(&self) -> &[u32] {
        self.own.as_ref().map_or(&self.buffers.references, |own| &own.structure.references)
    }

    /// What kernels read of triangles: vertices, three for each triangle; or, where nodes are wide, packets of eight
    /// triangles (`src/accel/leaf_packets.rs`).
    pub fn triangles(&self) -> &[Float4] {
        match (&self.own, self.is_wide) {
            (None, false) => &self.buffers.vertices,
            (None, true) => &self.buffers.bounds,
            (Some(own), false) => &own.vertices,
            (Some(own), true) => &own.structure.bounds,
        }
    }

    /// The vertices of a triangle, where nodes are binary.
    #[inline(always)]
    pub fn vertices(&self, primitive: u32) -> [Vec3; 3] {
        let first = 3 * primitive as usize;
        let vertices = self.triangles();
        [vertices[first].xyz(), vertices[first + 1].xyz(), vertices[first + 2].xyz()]
    }
}

/// Bytes of each triangle that point queries take at the most at a time: a hierarchy while it is built (a wide one 300,
/// as `src/accel/memory.rs` has measured, a binary one less), the triangle itself twice, and what a device on the host
/// has of both.
const POINT_TRIANGLE_BYTES: usize = 300 + 2 * 48 + 130;

/// Checks that there is memory for a hierarchy of so many triangles that is built for points.
pub(crate) fn check_memory(what: &str, triangles: usize, budget: &MemoryBudget) -> Result<()> {
    let bytes = (triangles * POINT_TRIANGLE_BYTES) as u64;
    if bytes < CHECKED_FROM_BYTES {
        return Ok(());
    }
    let what = format!("{what} of {triangles} triangles");
    let remedy = "raise the memory limit";
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
}

/// The triangles that rays cannot hit, and what they are where they lie: by number.
pub(super) fn left_out(
    triangle_count: usize,
    hittable: &[u32],
    vertices: impl Fn(usize) -> [Vec3; 3],
) -> Vec<(u32, [Vec3; 3])> {
    if hittable.len() == triangle_count {
        return Vec::new();
    }
    let mut hittable = hittable.iter().peekable();
    let is_left_out = |i: &u32| hittable.next_if_eq(&i).is_none();
    (0..triangle_count as u32).filter(is_left_out).map(|i| (i, vertices(i as usize))).collect()
}
