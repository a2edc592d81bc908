//! What point queries go through: a binary hierarchy of boxes over all triangles, also those without area, which rays
//! never hit but which have a closest point.
//!
//! That is the tracer's own structure where it is such a hierarchy and all triangles are in it. Else one is built when
//! the first point is asked for, and kept.

use super::SceneBuffers;
use super::space::tracing_scale;
use crate::accel::{Aabb, BuildOptions, StructureArrays, build_bvh, pack_bvh2};
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
    scale: f32,
    /// Triangles that have a closest point.
    count: usize,
}

/// A hierarchy for points alone.
#[derive(Debug, Clone)]
struct OwnArrays {
    structure: StructureArrays,
    vertices: Vec<Float4>,
}

impl PointScene {
    /// Of a scene that is packed; `given` tells the vertices of each triangle in world units, also of one without area.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory) when what has to be built takes more than `budget` has;
    /// [`Scene`](crate::Error::Scene) when there are too many triangles.
    pub fn new(
        buffers: &Arc<SceneBuffers>,
        given: impl Fn(u32) -> [Vec3; 3] + Sync,
        budget: &MemoryBudget,
    ) -> Result<PointScene> {
        let count = buffers.triangle_count();
        let buffers = buffers.clone();
        if buffers.made_for.accel == StructureKind::Bvh2 && buffers.left_out.is_empty() {
            return Ok(PointScene { own: None, scale: buffers.params.scale, count, buffers });
        }
        check_memory("a hierarchy of boxes for points", count, budget)?;
        let sound = |i: usize| given(i as u32).iter().all(|corner| corner.is_finite()).then_some(i as u32);
        let sound = parallel::flat_map_numbers(count, sound);
        let bounds_of = |i: usize| Aabb::of_triangle(&given(sound[i]));
        let bounds = parallel::reduce_numbers(sound.len(), Aabb::EMPTY, bounds_of, Aabb::union);
        let scale = if sound.is_empty() { 1.0 } else { tracing_scale(bounds.low, bounds.high) };
        let scaled = |i: usize| given(i as u32).map(|p| if p.is_finite() { p * scale + 0.0 } else { Vec3::ZERO });
        let triangles = parallel::map_numbers(count, scaled);
        let options = BuildOptions::bvh(&BvhOptions::DEFAULT, StructureKind::Bvh2);
        // Its nodes are searched the nearest first, and by no ray.
        let structure = pack_bvh2(&build_bvh(&triangles, &sound, &options)?, &[], 0, 0.0)?;
        let vertices = triangles.iter().flatten().map(|&p| Float4::new(p, 0.0)).collect();
        Ok(PointScene { own: Some(OwnArrays { structure, vertices }), scale, count: sound.len(), buffers })
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

    /// The nodes, as `src/accel/bvh2.rs` has them.
    pub fn nodes(&self) -> &[KdNode] {
        self.own.as_ref().map_or(&self.buffers.nodes, |own| &own.structure.nodes)
    }

    /// Triangle numbers: the leaves' ranges.
    pub fn references(&self) -> &[u32] {
        self.own.as_ref().map_or(&self.buffers.references, |own| &own.structure.references)
    }

    /// Vertices, three for each triangle.
    pub fn all_vertices(&self) -> &[Float4] {
        self.own.as_ref().map_or(&self.buffers.vertices, |own| &own.vertices)
    }

    /// The vertices of a triangle.
    #[inline(always)]
    pub fn vertices(&self, primitive: u32) -> [Vec3; 3] {
        let first = 3 * primitive as usize;
        let vertices = self.all_vertices();
        [vertices[first].xyz(), vertices[first + 1].xyz(), vertices[first + 2].xyz()]
    }
}

/// Bytes of each triangle that point queries take at the most at a time: a binary hierarchy while it is built (270, as
/// `src/accel/memory.rs` has measured), the triangle itself twice, and what a device on the host has of both.
const POINT_TRIANGLE_BYTES: usize = 270 + 2 * 48 + 130;

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
