//! How much memory packing a scene takes, and whether there is so much.

use super::SceneBuffers;
use crate::accel::{GrowthLimit, TRIANGLE_BYTES, structure_bytes};
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::Result;
use crate::features::Features;
use crate::layout::Float4;
use crate::options::{Accel, TraceOptions};
use crate::scene::{Scene, Texture};
use crate::shared::Shading;

/// Bytes for each texel of a picture: it and its smaller levels, and the largest of these as it is before it is rounded.
const TEXEL_BYTES: u64 = 10;

impl SceneBuffers {
    /// About how many bytes [`SceneBuffers::within`] takes at the most at a time, beside the scene: rarely half of it, and never more than
    /// a tenth more, but for trees and grids of triangles that lie badly, which are watched while they are built.
    pub fn estimated_bytes(scene: &Scene, options: &TraceOptions) -> u64 {
        let texels: usize = scene.textures.iter().filter_map(Texture::image).map(|image| image.rgba.len()).sum();
        let (triangles, instances) = match options.accel {
            Accel::Instances => (stored_triangles(scene), scene.instances.placed().len()),
            _ => (scene.triangle_count(), 0),
        };
        let copy = if options.accel == Accel::Instances { 0 } else { scene.flattened_bytes() };
        structure_bytes(options, triangles, instances) + copy + TEXEL_BYTES * texels as u64
    }

    /// Checks that there is memory for a scene on a device that shares the host's: for building it, and for the device's copy, while
    /// `more_bytes` are taken by others.
    pub(crate) fn check_memory(
        scene: &Scene,
        options: &TraceOptions,
        budget: &MemoryBudget,
        more_bytes: u64,
    ) -> Result<()> {
        let triangles = match options.accel {
            Accel::Instances => stored_triangles(scene),
            _ => scene.triangle_count(),
        } as u64;
        let bytes = Self::estimated_bytes(scene, options);
        let shades = Features::of_scene(scene).in_kernels(options.features).need_shading_data();
        let of_triangle =
            (3 * size_of::<Float4>() + if shades { size_of::<Shading>() } else { size_of::<u32>() }) as u64;
        // Of what building takes a structure is what triangles do not; the copy comes when it is done.
        let structure = bytes.saturating_sub(scene.flattened_bytes() + TRIANGLE_BYTES as u64 * triangles);
        Room::new(scene, options, budget).check_structure(bytes + structure + of_triangle * triangles + more_bytes)
    }
}

/// Triangles that are there once, however often they stand in the scene.
fn stored_triangles(scene: &Scene) -> usize {
    scene.triangles.len() + scene.instances.shared_triangle_count()
}

/// What a scene may take while it is packed.
pub(super) struct Room<'a> {
    budget: &'a MemoryBudget,
    options: &'a TraceOptions,
    what: String,
    remedy: &'static str,
}

impl<'a> Room<'a> {
    /// Checks that there is as much as the scene is expected to take.
    pub fn for_scene(scene: &Scene, options: &'a TraceOptions, budget: &'a MemoryBudget) -> Result<Room<'a>> {
        let room = Self::new(scene, options, budget);
        room.check_structure(SceneBuffers::estimated_bytes(scene, options))?;
        Ok(room)
    }

    fn new(scene: &Scene, options: &'a TraceOptions, budget: &'a MemoryBudget) -> Room<'a> {
        let what = format!("--accel {} of {} triangles", options.accel, scene.triangle_count());
        let remedy = match (options.accel, scene.instances.is_empty()) {
            (Accel::Instances, _) => "take a scene of fewer triangles, or raise --memory-limit",
            (_, false) => "take --accel instances or a scene of fewer triangles, or raise --memory-limit",
            (Accel::Bvh2, true) => "take a scene of fewer triangles or segments, or raise --memory-limit",
            (_, true) => "take --accel bvh2 or a scene of fewer triangles or segments, or raise --memory-limit",
        };
        Room { budget, options, what, remedy }
    }

    /// Checks that there is room for so many bytes.
    pub fn check_structure(&self, bytes: u64) -> Result<()> {
        let (what, remedy) = (&self.what, self.remedy);
        self.budget.check(&Need { what, bytes, decided_by: DecidedBy::Input, remedy })
    }

    /// How many references a tree may have with what is left.
    pub fn growth_limit(&self) -> GrowthLimit {
        GrowthLimit::of_bytes(self.budget.left(), self.options)
    }

    /// Checks that a tree was finished.
    pub fn check_growth(&self, limit: &GrowthLimit) -> Result<()> {
        if limit.is_exceeded() { self.check_structure(limit.added_bytes().max(self.budget.left() + 1)) } else { Ok(()) }
    }
}
