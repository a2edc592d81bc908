//! How much memory packing a scene takes, and whether there is so much.

use super::SceneBuffers;
use crate::accel::{GrowthLimit, TRIANGLE_BYTES, structure_bytes};
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::Result;
use crate::features::Features;
use crate::layout::Float4;
use crate::options::{StructureKind, TraceOptions};
use crate::scene::{Scene, Texture};
use crate::shared::Shading;

/// Bytes for each texel of a picture: it and its smaller levels, and the largest of these as it is before it is
/// rounded.
const TEXEL_BYTES: u64 = 10;

impl SceneBuffers {
    /// About how many bytes [`SceneBuffers::within`] takes at the most at a time, beside the scene: rarely half of it,
    /// and never more than a tenth more, but for trees and grids of triangles that lie badly, which are watched while
    /// they are built.
    pub fn estimated_bytes(scene: &Scene, options: &TraceOptions) -> u64 {
        let texels: usize = scene.textures.iter().filter_map(Texture::image).map(|image| image.rgba.len()).sum();
        let (triangles, instances) = match options.kind() {
            StructureKind::Instances => (stored_triangles(scene), scene.instances.placed().len()),
            _ => (scene.triangle_count(), 0),
        };
        let copy = if options.kind() == StructureKind::Instances { 0 } else { scene.flattened_bytes() };
        structure_bytes(options, triangles, instances) + copy + TEXEL_BYTES * texels as u64
    }

    /// Checks that there is memory for a scene on a device that shares the host's: for building it, and for the
    /// device's copy, while `more_bytes` are taken by others.
    pub(crate) fn check_memory(
        scene: &Scene,
        options: &TraceOptions,
        budget: &MemoryBudget,
        more_bytes: u64,
    ) -> Result<()> {
        let triangles = match options.kind() {
            StructureKind::Instances => stored_triangles(scene),
            _ => scene.triangle_count(),
        } as u64;
        let bytes = Self::estimated_bytes(scene, options);
        let shades = Features::of_scene(scene).in_kernels(options.picture.features).need_shading_data();
        let of_triangle =
            (3 * size_of::<Float4>() + if shades { size_of::<Shading>() } else { size_of::<u32>() }) as u64;
        // Of what building takes a structure is what triangles do not; the copy comes when it is done.
        let structure = bytes.saturating_sub(scene.flattened_bytes() + TRIANGLE_BYTES as u64 * triangles);
        StructureBudget::new(scene, options, budget)
            .check_structure(bytes + structure + of_triangle * triangles + more_bytes)
    }
}

/// Triangles that are there once, however often they stand in the scene.
fn stored_triangles(scene: &Scene) -> usize {
    scene.triangles.len() + scene.instances.shared_triangle_count()
}

/// What a scene may take while it is packed.
pub(super) struct StructureBudget<'a> {
    budget: &'a MemoryBudget,
    options: &'a TraceOptions,
    what: String,
    remedy: &'static str,
}

impl<'a> StructureBudget<'a> {
    /// Checks that there is as much as the scene is expected to take.
    pub fn for_scene(
        scene: &Scene,
        options: &'a TraceOptions,
        budget: &'a MemoryBudget,
    ) -> Result<StructureBudget<'a>> {
        let room = Self::new(scene, options, budget);
        room.check_structure(SceneBuffers::estimated_bytes(scene, options))?;
        Ok(room)
    }

    fn new(scene: &Scene, options: &'a TraceOptions, budget: &'a MemoryBudget) -> StructureBudget<'a> {
        let what = format!("`structure = {}` of {} triangles", options.kind(), scene.triangle_count());
        let remedy = match (options.kind(), scene.instances.is_empty()) {
            (StructureKind::Instances, _) => "take a scene of fewer triangles, or raise `memory_limit`",
            (_, false) => "take `structure = instances` or a scene of fewer triangles, or raise `memory_limit`",
            (StructureKind::Bvh2, true) => "take a scene of fewer triangles or segments, or raise `memory_limit`",
            (_, true) => "take `structure = bvh2` or a scene of fewer triangles or segments, or raise `memory_limit`",
        };
        StructureBudget { budget, options, what, remedy }
    }

    /// Checks that there is room for so many bytes.
    pub fn check_structure(&self, bytes: u64) -> Result<()> {
        self.budget.check(&self.need(bytes))
    }

    fn need(&self, bytes: u64) -> Need<'_> {
        Need { what: &self.what, bytes, decided_by: DecidedBy::Input, remedy: self.remedy }
    }

    /// How many references a tree may have with what is left.
    pub fn growth_limit(&self) -> GrowthLimit {
        GrowthLimit::of_bytes(self.budget.left(), self.options)
    }

    /// Checks that a tree was finished.
    pub fn check_growth(&self, limit: &GrowthLimit) -> Result<()> {
        if limit.is_exceeded() { Err(self.need(limit.added_bytes()).too_much(*self.budget)) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::BudgetOrigin;
    use crate::error::Error;
    use crate::options::Build;
    use crate::options::{BvhOptions, KdOptions, SpatialSplits, Structure};
    use crate::scene::Builder;
    use glam::Vec3;

    fn ball() -> Scene {
        let mut builder = Builder::new();
        builder.sphere(1.0, 64);
        builder.finish().unwrap()
    }

    /// Bytes of the arrays of a packed scene.
    fn kept(buffers: &SceneBuffers) -> usize {
        size_of_val(&buffers.nodes[..])
            + size_of_val(&buffers.references[..])
            + size_of_val(&buffers.vertices[..])
            + size_of_val(&buffers.bounds[..])
            + size_of_val(&buffers.transforms[..])
            + size_of_val(&buffers.shading[..])
            + size_of_val(&buffers.texels[..])
    }

    #[test]
    fn estimates_hold_what_is_kept_and_not_much_more() {
        let scene = ball();
        for &accel in StructureKind::ALL {
            for leaf_size in [None, Some(1)] {
                let options =
                    TraceOptions { structure: Structure::of(accel).with_leaf_size(leaf_size), ..TraceOptions::DEFAULT };
                if options.validate().is_err() {
                    continue;
                }
                let buffers = SceneBuffers::within(&scene, &options, &MemoryBudget::UNLIMITED).unwrap();
                let (kept, estimated) = (kept(&buffers) as u64, SceneBuffers::estimated_bytes(&scene, &options));
                assert!(kept <= estimated && estimated < 5 * kept, "{accel} {leaf_size:?}: {kept} of {estimated}");
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused_with_numbers_before_it_is_built() {
        let scene = ball();
        for &accel in StructureKind::ALL {
            let options = TraceOptions::of(accel);
            let budget = MemoryBudget::of_bytes(1000);
            let error = SceneBuffers::within(&scene, &options, &budget).map(drop).unwrap_err();
            assert_eq!(error.exit_code(), 3);
            let Error::OutOfMemory { what, needed_bytes, budget, .. } = error else { panic!("{error}") };
            assert!(what.contains(accel.name()) && what.contains("3968 triangles"), "{what}");
            assert!(needed_bytes >= SceneBuffers::estimated_bytes(&scene, &options));
            assert_eq!((budget.bytes(), budget.origin()), (1000, BudgetOrigin::Given));
        }
    }

    /// Where splits of space are weighed, a finished tree is there while the one with them is built.
    #[test]
    fn two_trees_count_as_two() {
        let scene = ball();
        for kind in [StructureKind::Bvh2, StructureKind::Bvh8, StructureKind::Instances] {
            let bytes = |splits: SpatialSplits| {
                let bvh = BvhOptions { spatial_splits: Some(splits), ..BvhOptions::DEFAULT };
                let structure = match kind {
                    StructureKind::Bvh2 => Structure::Bvh2(bvh),
                    StructureKind::Bvh8 => Structure::Bvh8(bvh),
                    _ => Structure::Instances(bvh),
                };
                SceneBuffers::estimated_bytes(&scene, &TraceOptions { structure, ..TraceOptions::DEFAULT })
            };
            assert!(bytes(SpatialSplits::Auto) > bytes(SpatialSplits::AUTO_SHARE.into()), "{kind}");
        }
    }

    /// Instances are what they take where they are flattened, and not where they are shared.
    #[test]
    fn instances_count_as_often_as_they_are_placed() {
        let mut builder = Builder::new();
        let object = builder.begin_object().sphere(1.0, 64).end_object();
        for i in 0..100 {
            builder.push().translate(Vec3::X * i as f32).instance(object, None).pop();
        }
        let scene = builder.finish().unwrap();
        let bytes = |accel| SceneBuffers::estimated_bytes(&scene, &TraceOptions::of(accel));
        assert!(bytes(StructureKind::Bvh2) > 60 * bytes(StructureKind::Instances));
        let flat = scene.flattened().unwrap();
        let lists = size_of_val(&flat.positions[..]) + size_of_val(&flat.normals[..]) + size_of_val(&flat.uvs[..]);
        assert_eq!(scene.flattened_bytes(), (lists + size_of_val(&flat.triangles[..])) as u64);
    }

    #[test]
    fn trees_that_grow_too_large_end_early() {
        let scene = ball();
        let primitives = scene.hittable();
        let vertices: Vec<_> = primitives.iter().map(|&i| scene.vertices(i as usize)).collect();
        let (low, high) = scene.bounds().unwrap();
        for (accel, build) in
            [(StructureKind::Kd, Build::Median), (StructureKind::Kd, Build::Sah), (StructureKind::Octree, Build::Sah)]
        {
            let options = TraceOptions {
                structure: match Structure::of(accel).with_leaf_size(Some(1)) {
                    Structure::Kd(kd) => Structure::Kd(KdOptions { build, ..kd }),
                    other => other,
                },
                ..TraceOptions::DEFAULT
            };
            let whole = SceneBuffers::within(&scene, &options, &MemoryBudget::UNLIMITED).unwrap();
            let added = whole.references.len() - primitives.len();
            assert!(added > 100, "{accel} {build}: {added}");
            let limit = GrowthLimit::of_bytes(80 * added as u64 / 2, &options);
            let build_options = crate::accel::BuildOptions::of(&options, primitives.len());
            let bounds = crate::accel::Aabb { low, high };
            if accel == StructureKind::Kd {
                crate::accel::build_kd_tree_within(build, &vertices, &primitives, &build_options, &limit);
            } else {
                crate::accel::build_octree_within(&vertices, &primitives, bounds, &build_options, 0.0, &limit);
            }
            assert!(limit.is_exceeded(), "{accel} {build}");
            let room = StructureBudget::new(&scene, &options, &MemoryBudget::UNLIMITED);
            room.check_growth(&GrowthLimit::none()).unwrap();
            let small = MemoryBudget::of_bytes(1 << 10);
            assert!(StructureBudget::new(&scene, &options, &small).check_growth(&limit).is_err());
        }
    }
}
