//! The structures with the options that each of them reads, and no others.

use super::{KdOptions, SpatialSplits, StructureKind, TraceOptions};
use crate::error::{Error, Result};
use crate::shared::{BVH_COUNT_SHIFT, BVH_LEAF};

/// What rays are traced through, and how it is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Structure {
    /// [`StructureKind::Brute`].
    Brute,
    /// [`StructureKind::Kd`].
    Kd(KdOptions),
    /// [`StructureKind::Bvh2`].
    Bvh2(BvhOptions),
    /// [`StructureKind::Bvh8`].
    Bvh8(BvhOptions),
    /// [`StructureKind::Instances`].
    Instances(BvhOptions),
    /// [`StructureKind::Grid`].
    Grid(GridOptions),
    /// [`StructureKind::Octree`].
    Octree(OctreeOptions),
    /// [`StructureKind::Boxes`].
    Boxes(ClusterOptions),
    /// [`StructureKind::Spheres`].
    Spheres(ClusterOptions),
}

/// How a hierarchy of boxes is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BvhOptions {
    /// The most triangles of a leaf, at least 1 and at most [`BvhOptions::MAX_LEAF`], with eight children
    /// [`BvhOptions::BVH8_MAX_LEAF`]; `None`: 8.
    pub leaf_size: Option<u32>,
    /// Passes over the finished hierarchy, each of which moves large subtrees to where they fit better, or fewer when
    /// nothing is left to gain; `None`: 5.
    pub reinsert: Option<u32>,
    /// How many references splits of space may add; `None`: none.
    pub spatial_splits: Option<SpatialSplits>,
    /// Cost of one traversal step, 0 or more; `None`: [`KdOptions::COST`].
    pub cost_traverse: Option<f32>,
    /// Cost of one triangle test, above 0; `None`: [`KdOptions::COST`], less where eight triangles are tested at once.
    pub cost_intersect: Option<f32>,
}

impl BvhOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: BvhOptions =
        BvhOptions { leaf_size: None, reinsert: None, spatial_splits: None, cost_traverse: None, cost_intersect: None };

    /// The most triangles in a leaf of [`Structure::Bvh2`] and [`Structure::Instances`]: what a link has room for.
    pub const MAX_LEAF: u32 = (BVH_LEAF >> BVH_COUNT_SHIFT) - 1;

    /// The most triangles in a leaf of [`Structure::Bvh8`]: those that are looked at together.
    pub const BVH8_MAX_LEAF: u32 = 8;

    /// The most references that splits of space may add per triangle. A sixth as many as a kd-tree may have.
    pub const MAX_SPATIAL_SPLITS: f32 = 4.0;

    fn validate(&self, kind: StructureKind, most_in_leaf: u32) -> Result<()> {
        check_leaf_size(self.leaf_size)?;
        if let Some(size) = self.leaf_size.filter(|&size| size > most_in_leaf) {
            let message = format!("{size}: a leaf of `structure = {kind}` has room for {most_in_leaf} at most");
            return Err(Error::option("leaf_size", message));
        }
        self.spatial_splits.map_or(Ok(()), SpatialSplits::validate)?;
        check_costs(self.cost_traverse, self.cost_intersect)
    }
}

/// How a uniform grid is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridOptions {
    /// Cells along x, y, z; their product at most [`GridOptions::MAX_CELLS`]. An axis along which the scene has no
    /// extent gets 1. `None`: nearly cubic ones, about 8 for each triangle.
    pub size: Option<[u32; 3]>,
}

impl GridOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: GridOptions = GridOptions { size: None };

    /// The most cells of a grid: 256 MiB of them, and numbers that are exact in float32.
    pub const MAX_CELLS: u32 = 1 << 24;

    fn validate(&self) -> Result<()> {
        let Some([x, y, z]) = self.size else { return Ok(()) };
        let cells = [x, y, z].iter().try_fold(1u32, |product, &n| product.checked_mul(n));
        if cells.is_none_or(|cells| cells == 0 || cells > Self::MAX_CELLS) {
            let message = format!("{x},{y},{z}: must be at least 1,1,1 and no more than {} cells", Self::MAX_CELLS);
            return Err(Error::option("grid_size", message));
        }
        Ok(())
    }
}

/// How an octree is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OctreeOptions {
    /// A cell with at most this many triangles is not divided; at least 1. `None`: 8.
    pub leaf_size: Option<u32>,
    /// No cell is deeper than this, the root counted as 0; at most [`TraceOptions::MAX_DEPTH`]. `None`: 4 + 0.5
    /// log2(triangles).
    pub max_depth: Option<u32>,
}

impl OctreeOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: OctreeOptions = OctreeOptions { leaf_size: None, max_depth: None };
}

/// How triangles are put into clusters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterOptions {
    /// The most triangles of a cluster, at least 1; `None`: the square root of the triangles.
    pub leaf_size: Option<u32>,
}

impl ClusterOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: ClusterOptions = ClusterOptions { leaf_size: None };
}

impl Structure {
    /// A structure with its defaults.
    pub const fn of(kind: StructureKind) -> Structure {
        match kind {
            StructureKind::Brute => Structure::Brute,
            StructureKind::Kd => Structure::Kd(KdOptions::DEFAULT),
            StructureKind::Bvh2 => Structure::Bvh2(BvhOptions::DEFAULT),
            StructureKind::Bvh8 => Structure::Bvh8(BvhOptions::DEFAULT),
            StructureKind::Instances => Structure::Instances(BvhOptions::DEFAULT),
            StructureKind::Grid => Structure::Grid(GridOptions::DEFAULT),
            StructureKind::Octree => Structure::Octree(OctreeOptions::DEFAULT),
            StructureKind::Boxes => Structure::Boxes(ClusterOptions::DEFAULT),
            StructureKind::Spheres => Structure::Spheres(ClusterOptions::DEFAULT),
        }
    }

    /// Which one it is.
    pub const fn kind(&self) -> StructureKind {
        match self {
            Structure::Brute => StructureKind::Brute,
            Structure::Kd(_) => StructureKind::Kd,
            Structure::Bvh2(_) => StructureKind::Bvh2,
            Structure::Bvh8(_) => StructureKind::Bvh8,
            Structure::Instances(_) => StructureKind::Instances,
            Structure::Grid(_) => StructureKind::Grid,
            Structure::Octree(_) => StructureKind::Octree,
            Structure::Boxes(_) => StructureKind::Boxes,
            Structure::Spheres(_) => StructureKind::Spheres,
        }
    }

    /// The most triangles of a leaf or cluster, where that was set.
    pub fn leaf_size(mut self) -> Option<u32> {
        self.leaf_size_mut().and_then(|size| *size)
    }

    /// The same with leaves of other sizes, where the structure has any.
    #[must_use]
    pub fn with_leaf_size(mut self, size: Option<u32>) -> Structure {
        if let Some(leaf_size) = self.leaf_size_mut() {
            *leaf_size = size;
        }
        self
    }

    pub(super) fn kd_mut(&mut self) -> Option<&mut KdOptions> {
        if let Structure::Kd(kd) = self { Some(kd) } else { None }
    }

    pub(super) fn bvh_mut(&mut self) -> Option<&mut BvhOptions> {
        match self {
            Structure::Bvh2(bvh) | Structure::Bvh8(bvh) | Structure::Instances(bvh) => Some(bvh),
            _ => None,
        }
    }

    pub(super) fn grid_size_mut(&mut self) -> Option<&mut Option<[u32; 3]>> {
        if let Structure::Grid(grid) = self { Some(&mut grid.size) } else { None }
    }

    pub(super) fn leaf_size_mut(&mut self) -> Option<&mut Option<u32>> {
        match self {
            Structure::Kd(kd) => Some(&mut kd.leaf_size),
            Structure::Bvh2(bvh) | Structure::Bvh8(bvh) | Structure::Instances(bvh) => Some(&mut bvh.leaf_size),
            Structure::Octree(octree) => Some(&mut octree.leaf_size),
            Structure::Boxes(clusters) | Structure::Spheres(clusters) => Some(&mut clusters.leaf_size),
            Structure::Brute | Structure::Grid(_) => None,
        }
    }

    pub(super) fn max_depth_mut(&mut self) -> Option<&mut Option<u32>> {
        match self {
            Structure::Kd(kd) => Some(&mut kd.max_depth),
            Structure::Octree(octree) => Some(&mut octree.max_depth),
            _ => None,
        }
    }

    pub(super) fn cost_traverse_mut(&mut self) -> Option<&mut Option<f32>> {
        match self {
            Structure::Kd(kd) => Some(&mut kd.cost_traverse),
            other => other.bvh_mut().map(|bvh| &mut bvh.cost_traverse),
        }
    }

    pub(super) fn cost_intersect_mut(&mut self) -> Option<&mut Option<f32>> {
        match self {
            Structure::Kd(kd) => Some(&mut kd.cost_intersect),
            other => other.bvh_mut().map(|bvh| &mut bvh.cost_intersect),
        }
    }

    /// Checks the numbers.
    pub(super) fn validate(&self) -> Result<()> {
        match self {
            Structure::Brute => Ok(()),
            Structure::Kd(kd) => kd.validate(),
            Structure::Bvh2(bvh) | Structure::Instances(bvh) => bvh.validate(self.kind(), BvhOptions::MAX_LEAF),
            Structure::Bvh8(bvh) => bvh.validate(self.kind(), BvhOptions::BVH8_MAX_LEAF),
            Structure::Grid(grid) => grid.validate(),
            Structure::Octree(octree) => {
                check_leaf_size(octree.leaf_size).and_then(|()| check_max_depth(octree.max_depth))
            }
            Structure::Boxes(clusters) | Structure::Spheres(clusters) => check_leaf_size(clusters.leaf_size),
        }
    }
}

pub(super) fn check_leaf_size(leaf_size: Option<u32>) -> Result<()> {
    if leaf_size == Some(0) { Err(Error::option("leaf_size", "must be at least 1")) } else { Ok(()) }
}

pub(super) fn check_max_depth(max_depth: Option<u32>) -> Result<()> {
    let most = TraceOptions::MAX_DEPTH;
    match max_depth.filter(|&depth| depth > most) {
        Some(depth) => Err(Error::option("max_depth", format!("{depth} is over the limit of {most}"))),
        None => Ok(()),
    }
}

pub(super) fn check_costs(traverse: Option<f32>, intersect: Option<f32>) -> Result<()> {
    check_number("cost_traverse", traverse, 0.0..=f32::MAX, "a finite number, 0 or more")?;
    check_number("cost_intersect", intersect, f32::from_bits(1)..=f32::MAX, "a finite number above 0")
}

/// That a number is in `range`; NaN is in none.
pub(super) fn check_number(
    option: &str,
    value: Option<f32>,
    range: std::ops::RangeInclusive<f32>,
    words: &str,
) -> Result<()> {
    match value.filter(|value| !range.contains(value)) {
        Some(value) => Err(Error::option(option, format!("{value} is not {words}"))),
        None => Ok(()),
    }
}
