//! Builds and packs the structure that traversals go through: one function for each kind.

use super::CONSTANT_NODES;
use super::instances::{PackedInstances, pack_instances};
use super::memory::StructureBudget;
use super::space::TracingSpace;
use crate::accel::{
    BuildOptions, KeptBvh, Padding, SplitsChosen, StructureArrays, build_boxes, build_grid_within,
    build_kd_tree_within, build_octree_within, build_spheres, link_leaves, near_reach, pack_bvh2, pack_bvh8,
    pack_kd_leaves, reorder, tree_of, worths,
};
use crate::bounds::{padding_of_boxes, padding_within};
use crate::error::Result;
use crate::layout::Float4;
use crate::options::{GridOptions, KdOptions, Memory, NodeOrder, PacketSize, Structure, TraceOptions, Traversal};
use crate::scene::{MaterialId, Scene};
use crate::shared::{BVH_NODE_RECORDS, KD_LEAF, KdNode, Shading};
use glam::Vec3;

/// What a structure is built from.
pub(super) struct StructureInput<'a> {
    pub options: &'a TraceOptions,
    pub build_options: &'a BuildOptions,
    pub space: &'a TracingSpace,
    pub memory: &'a StructureBudget<'a>,
    /// How far most triangles reach where few others reach very much farther, else 0.
    pub near_reach: f32,
    /// By how much boxes are larger than what they hold.
    pub padding: f32,
}

/// A structure, packed.
pub(super) struct PackedStructure {
    pub structure: StructureArrays,
    /// The most entries that a traversal's stack of nodes has.
    pub stack_entries: u32,
    /// What [`Structure::Instances`] has in place of the scene's own triangles.
    pub objects: Option<PackedObjects>,
    /// What [`SpatialSplits::Auto`](crate::options::SpatialSplits::Auto) has chosen.
    pub splits_chosen: Option<SplitsChosen>,
}

/// Objects, each of which is there once.
pub(super) struct PackedObjects {
    pub vertices: Vec<Float4>,
    pub shading: Vec<Shading>,
    /// How many instances there are: [`SceneParams::reference_count`](crate::shared::SceneParams).
    pub reference_count: u32,
}

impl From<StructureArrays> for PackedStructure {
    /// One whose traversal has no stack.
    fn from(structure: StructureArrays) -> Self {
        PackedStructure { structure, stack_entries: 1, objects: None, splits_chosen: None }
    }
}

impl<'a> StructureInput<'a> {
    /// For what is in `space`.
    pub fn new(
        options: &'a TraceOptions,
        build_options: &'a BuildOptions,
        space: &'a TracingSpace,
        memory: &'a StructureBudget<'a>,
    ) -> Self {
        let near_reach = near_reach(&space.triangles, &space.primitives, options);
        let padding = match near_reach {
            0.0 => padding_of_boxes(space.bounds.low, space.bounds.high),
            reach => padding_within(reach),
        };
        StructureInput { options, build_options, space, memory, near_reach, padding }
    }

    /// Builds the structure that the options ask for. `scene` and its `used` materials are those of instances; `kept`
    /// are the hierarchies of boxes of the same scene when it was packed before, if it moves.
    pub fn pack(&self, scene: &Scene, used: &[MaterialId], kept: Option<&mut Vec<KeptBvh>>) -> Result<PackedStructure> {
        Ok(match self.options.structure {
            Structure::Instances(_) => self.pack_objects(scene, used, kept)?,
            Structure::Brute => self.pack_brute().into(),
            Structure::Kd(kd) => self.pack_kd(&kd)?,
            Structure::Bvh2(_) => self.pack_bvh2(only(kept))?,
            Structure::Bvh8(_) => self.pack_bvh8(only(kept))?,
            Structure::Grid(grid) => self.pack_grid(&grid)?.into(),
            Structure::Octree(_) => self.pack_octree()?,
            Structure::Boxes(clusters) => {
                build_boxes(self.triangles(), self.primitives(), clusters.leaf_size, self.near_reach).into()
            }
            Structure::Spheres(clusters) => {
                build_spheres(self.triangles(), self.primitives(), clusters.leaf_size, self.near_reach).into()
            }
        })
    }

    fn triangles(&self) -> &[[Vec3; 3]] {
        &self.space.triangles
    }

    fn primitives(&self) -> &[u32] {
        &self.space.primitives
    }

    /// Nodes that go to constant memory, and so come first.
    fn top_nodes(&self) -> usize {
        if self.options.arrays.memory == Memory::Constant { CONSTANT_NODES } else { 0 }
    }

    fn pack_objects(
        &self,
        scene: &Scene,
        used: &[MaterialId],
        kept: Option<&mut Vec<KeptBvh>>,
    ) -> Result<PackedStructure> {
        let PackedInstances { structure, vertices, shading, instance_count, stack_entries, splits_chosen } =
            pack_instances(scene, used, self.space.scale, self.build_options, kept)?;
        let objects = PackedObjects { vertices, shading, reference_count: instance_count };
        Ok(PackedStructure { structure, stack_entries, objects: Some(objects), splits_chosen })
    }

    /// One leaf, whose list is that of all triangles that can be hit.
    fn pack_brute(&self) -> StructureArrays {
        let references = self.primitives().to_vec();
        let leaf = KdNode { flags: KD_LEAF, left: 0, right: references.len() as u32, split: 0.0 };
        StructureArrays { nodes: vec![leaf], references, bounds: Vec::new() }
    }

    /// With ropes, or packets of triangles for packets of rays, where the traversal wants them.
    fn pack_kd(&self, kd: &KdOptions) -> Result<PackedStructure> {
        let limit = self.memory.growth_limit();
        let mut tree = build_kd_tree_within(kd.build, self.triangles(), self.primitives(), self.build_options, &limit);
        self.memory.check_growth(&limit)?;
        let top = self.top_nodes();
        if top > 0 || kd.node_order != NodeOrder::Preorder {
            tree.nodes = reorder(&tree.nodes, kd.node_order, top);
        }
        let bounds = match (kd.traversal, self.options.packet_size) {
            (Traversal::Ropes, _) => link_leaves(&mut tree.nodes, &tree.bounds),
            (_, PacketSize::Sixteen) => pack_kd_leaves(&mut tree, self.triangles()),
            (_, PacketSize::One) => Vec::new(),
        };
        let stack_entries = if kd.traversal == Traversal::Stack { self.depth_limit() } else { 1 };
        let structure = StructureArrays { nodes: tree.nodes, references: tree.references, bounds };
        Ok(PackedStructure { stack_entries, ..structure.into() })
    }

    /// The depth that no tree exceeds.
    fn depth_limit(&self) -> u32 {
        self.build_options.max_depth.max(1)
    }

    fn pack_bvh2(&self, kept: Option<&mut KeptBvh>) -> Result<PackedStructure> {
        let tree = tree_of(kept, self.triangles(), self.primitives(), self.build_options)?;
        let stack_entries = tree.depth() + 1; // the last entry says that there are no more
        let padding = Padding { everywhere: self.padding, near_reach: self.near_reach };
        let structure =
            pack_bvh2(&tree, &worths(&tree, self.triangles()), self.top_nodes() / BVH_NODE_RECORDS as usize, padding)?;
        Ok(PackedStructure { stack_entries, splits_chosen: SplitsChosen::of(tree.splits_ratio), ..structure.into() })
    }

    fn pack_bvh8(&self, kept: Option<&mut KeptBvh>) -> Result<PackedStructure> {
        let tree = tree_of(kept, self.triangles(), self.primitives(), self.build_options)?;
        let padding = Padding { everywhere: 0.0, near_reach: self.near_reach };
        let packed = pack_bvh8(&tree, self.triangles(), padding)?;
        Ok(PackedStructure {
            stack_entries: packed.stack_entries,
            splits_chosen: SplitsChosen::of(tree.splits_ratio),
            ..packed.structure.into()
        })
    }

    fn pack_grid(&self, grid: &GridOptions) -> Result<StructureArrays> {
        let (bounds, size) = (self.space.bounds, grid.size);
        let check = |bytes| self.memory.check_structure(bytes);
        build_grid_within(self.triangles(), self.primitives(), bounds, size, self.near_reach, &check)
    }

    fn pack_octree(&self) -> Result<PackedStructure> {
        let limit = self.memory.growth_limit();
        let structure = build_octree_within(
            self.triangles(),
            self.primitives(),
            self.space.bounds,
            self.build_options,
            self.near_reach,
            &limit,
        );
        self.memory.check_growth(&limit)?;
        Ok(PackedStructure { stack_entries: self.depth_limit(), ..structure.into() })
    }
}

/// The one hierarchy of a scene without instances.
fn only(kept: Option<&mut Vec<KeptBvh>>) -> Option<&mut KeptBvh> {
    let kept = kept?;
    kept.resize_with(1, KeptBvh::default);
    kept.first_mut()
}
