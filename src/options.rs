//! What can be chosen: structure, build, traversal, triangle test, and the numbers that go with them.
//!
//! The enums here are the one list of what exists: the CLI, the tests and the benches loop over `ALL`. Adding a variant means
//! one kernel file, its twin in `reference/`, and one line here.

use crate::error::{Error, Result};
use crate::shared::{BVH_COUNT_SHIFT, BVH_LEAF};

/// Defines an enum of methods: its `ALL`, `name` (as the user types it) and documentation, which `raybrook methods` prints.
macro_rules! methods {
    ($(#[doc = $doc:literal])* pub enum $enum:ident ($option:literal) {
        $($(#[doc = $variant_doc:literal])* $variant:ident = $name:literal,)+
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum $enum { $($(#[doc = $variant_doc])* $variant,)+ }

        impl $enum {
            /// The option that takes the names.
            pub const OPTION: &'static str = $option;

            /// What the table of options ([`crate::options::OPTIONS`]) tells about it.
            pub(crate) const NAMES: $crate::options::Names = $crate::options::Names {
                option: $option,
                doc: &[$($doc),*],
                values: &[$(($name, &[$($variant_doc),*])),+],
            };

            /// Every variant, in the order of the documentation.
            pub const ALL: &'static [$enum] = &[$($enum::$variant),+];

            /// The name as the user types it.
            pub fn name(self) -> &'static str {
                match self { $($enum::$variant => $name),+ }
            }

            /// What it is, for people: the first paragraph of its documentation, without marks and links.
            pub fn about(self) -> String {
                Self::NAMES.about(self as usize)
            }

            /// All names, for messages: "a, b, c".
            pub fn names() -> String {
                [$($name),+].join(", ")
            }
        }

        impl std::fmt::Display for $enum {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $enum {
            type Err = $crate::error::Error;

            fn from_str(text: &str) -> $crate::error::Result<Self> {
                $enum::ALL.iter().copied().find(|m| m.name() == text).ok_or_else(|| {
                    $crate::error::Error::option($option, format!("no '{text}'; possible: {}", $enum::names()))
                })
            }
        }
    };
}
pub(crate) use methods;

mod automatic;
mod combinations;
mod kd;
mod request;
mod size;
mod table;

pub use automatic::Workload;
pub(crate) use automatic::{who_decides, work_group_size};
pub use combinations::{NeverTogether, fewest_changes, needs, never_together};
pub use kd::{KdOptions, SplitAxis, Stop};
pub use request::{Chosen, Decision, Origin, Request, TunedChoice};
pub use size::SceneSize;
pub(crate) use table::Names;
pub use table::{Choice, MethodOption, OPTIONS, choices};

methods! {
    /// The structure that rays are traced through.
    pub enum Accel ("--accel") {
        /// Every triangle is tested against every ray.
        Brute = "brute",
        /// A kd-tree.
        Kd = "kd",
        /// A binary hierarchy of boxes, the two of a node's children side by side (Aila and Laine 2009).
        Bvh2 = "bvh2",
        /// A hierarchy of boxes with eight children a node, tested at once (Dammertz, Hanika and Keller 2008); for CPUs.
        Bvh8 = "bvh8",
        /// A binary hierarchy of boxes for each object, in its own coordinates, and one of the objects' instances (Rubin and Whitted 1980):
        /// memory for one copy of what stands in a scene many times.
        Instances = "instances",
        /// A uniform grid (Amanatides and Woo 1987).
        Grid = "grid",
        /// Every cell divided at its centre into eight (Glassner 1984).
        Octree = "octree",
        /// Boxes around clusters of triangles, in a flat list (thesis, section 2.2.2).
        Boxes = "boxes",
        /// Spheres around clusters of triangles, in a flat list (thesis, section 2.2.2).
        Spheres = "spheres",
    }
}

methods! {
    /// How the kd-tree's planes are chosen.
    pub enum Build ("--build") {
        /// Axes in turn, plane between the two middle centroids (thesis, section 5.5.1).
        Median = "median",
        /// The median of a random sample (thesis, section 5.5).
        SampledMedian = "sampled-median",
        /// Plane in the middle of the cell (Kaplan 1985).
        SpatialMedian = "spatial-median",
        /// Surface area heuristic over sorted event lists (Wald and Havran 2006).
        Sah = "sah",
        /// The same with volumes for areas, as the thesis has it (section 5.5). To study, not to use.
        Volume = "volume",
    }
}

methods! {
    /// How a ray finds its way through the kd-tree.
    pub enum Traversal ("--traversal") {
        /// A full stack of far children.
        Stack = "stack",
        /// No stack: after each leaf again from the root (Foley and Sugerman 2005).
        Restart = "restart",
        /// Restarts from the deepest node that holds all the rest (Horn et al. 2007).
        PushDown = "push-down",
        /// A stack of a few entries, and restarts when it has forgotten some (Horn et al. 2007).
        ShortStack = "short-stack",
        /// From leaf to leaf by links between neighbours (Popov et al. 2007).
        Ropes = "ropes",
        /// kd-restart as the thesis prints it, which loses hits. To study, not to use.
        ThesisRestart = "thesis-restart",
    }
}

methods! {
    /// The ray-triangle test. On a CPU all but exact are slower: only with exact hits do rays go in packets.
    pub enum Intersector ("--intersector") {
        /// Right: exact arithmetic decides hit or miss and which of two hits is nearer, wherever rounded arithmetic cannot; t, u and v
        /// are the exact ones rounded once.
        Exact = "exact",
        /// Two edges and one reciprocal (Möller and Trumbore 1997), two-sided, no epsilon.
        MollerTrumbore = "moller-trumbore",
        /// Sheared edge functions (Woop, Benthin and Wald 2013), with exact signs by fma: no ray slips between neighbours.
        Watertight = "watertight",
        /// Volumes of ray and edges (Amanatides and Choi 1997), alike to the bit for the two triangles of an edge.
        Plucker = "plucker",
        /// A transform for each triangle, computed beforehand (Baldwin and Weber 2016).
        Precomputed = "precomputed",
        /// Listing 5.1 of the thesis with its faults: no back faces, no small triangles, a near limit that grows with 1/area.
        Thesis = "thesis",
    }
}

methods! {
    /// How many rays a work-item traces together. The closest hits, and the pixels, are the same; of several hits of a ray, where any
    /// will do, another one may be found. The split kernels trace pictures one ray at a time.
    pub enum PacketSize ("--packet-size") {
        /// Each ray by itself.
        One = "1",
        /// Sixteen rays in the lanes of vectors (Wald et al. 2001), for CPUs: pixels of a tile, and neighbours in a batch, which should
        /// be neighbours in space.
        Sixteen = "16",
    }
}

impl PacketSize {
    /// The number.
    pub const fn rays(self) -> usize {
        match self {
            PacketSize::One => 1,
            PacketSize::Sixteen => 16,
        }
    }
}

methods! {
    /// The order in which the rays of a batch are traced; hits come back in the caller's. The closest hits are the same; of several
    /// hits of a ray, where any will do, packets may find another one. Pictures have an order of their own.
    pub enum RayOrder ("--ray-order") {
        /// Sorted where that pays: a large batch that looks shuffled, in packets on a CPU, unless its rays leave the scene at once.
        Auto = "auto",
        /// The caller's.
        Kept = "kept",
        /// Neighbours in space one after the other, by origin and then by direction (Meister et al. 2020).
        Sorted = "sorted",
    }
}

methods! {
    /// Where on the device nodes, references, vertices and the structures' other arrays lie (thesis, section 5.3). The reference
    /// has one kind of memory: the choice changes nothing there.
    pub enum Memory ("--memory") {
        /// Buffers in global memory.
        Global = "global",
        /// As much as fits into constant memory: the top of the tree, then references, then vertices.
        Constant = "constant",
        /// Images made of buffers, which GPUs read through their texture caches.
        BufferImage = "buffer-image",
        /// Images of two dimensions, for devices whose buffer images are small.
        Image2d = "image2d",
    }
}

methods! {
    /// Where a triangle's normals, texture coordinates and material lie (thesis, section 5.3).
    pub enum Layout ("--layout") {
        /// In an array of their own, so that traversal does not fill caches with them.
        Split = "split",
        /// Behind the triangle's vertices.
        Whole = "whole",
    }
}

methods! {
    /// The order of the kd-tree's nodes in memory.
    pub enum NodeOrder ("--node-order") {
        /// A node, all below its lower child, all below its upper child.
        Preorder = "preorder",
        /// Subtrees of half the height together, and so on within them: few cache lines on the way down, whatever their size.
        VanEmdeBoas = "van-emde-boas",
        /// Level by level.
        BreadthFirst = "breadth-first",
    }
}

methods! {
    /// How the triangle tests find their vertices.
    pub enum TriangleOrder ("--triangles") {
        /// By the triangle's number in the leaf's list.
        Indexed = "indexed",
        /// In a copy for each reference, in the order of the leaves: no jump in memory, at 4 to 5 times the vertices in a kd-tree.
        LeafOrder = "leaf-order",
    }
}

methods! {
    /// How the work of a picture is shared out among kernels (thesis, section 5.2.1). The pixels are the same; the reference does the
    /// work of either in one way.
    pub enum Kernels ("--kernels") {
        /// One kernel does everything for a pixel.
        Mega = "mega",
        /// One kernel for each step of a ray, with queues in memory between them.
        Split = "split",
    }
}

methods! {
    /// What the kernels that shade can do; textures, mirrors and the like that a scene does without cost registers and time even so.
    /// The pixels are the same; the reference has all features.
    pub enum KernelFeatures ("--features") {
        /// What the scene needs, and no more.
        Scene = "scene",
        /// Everything: one kernel for all scenes, which need not be compiled for each combination of features.
        All = "all",
    }
}

methods! {
    /// Where shadow rays start on triangles with smooth normals. The same where normals are flat.
    pub enum Terminator ("--terminator") {
        /// At the height that the normals claim (Hanika 2021): light ends smoothly on coarse meshes.
        Smooth = "smooth",
        /// On the triangle: exact shadows of the mesh as it is, whose own one ends along the triangles' edges, in stairs.
        Hard = "hard",
    }
}

methods! {
    /// Who evaluates textures (thesis, section 5.2.2). The pixels are the same; on the reference both are the same, too.
    pub enum TexturePass ("--textures") {
        /// The kernel that shades.
        InKernel = "in-kernel",
        /// The host, between tracing and shading; only with [`Kernels::Split`].
        HostPass = "host-pass",
    }
}

methods! {
    /// What colour a ray takes from a texture that is a picture. The same where texels are larger than pixels.
    pub enum TextureFilter ("--texture-filter") {
        /// The mean over what the ray stands for, from levels of the texture (Williams 1983; ray cones: Akenine-Möller et al. 2021):
        /// keeps far textures from flickering.
        Footprint = "footprint",
        /// The colour of a point, between its four texels.
        Bilinear = "bilinear",
    }
}

methods! {
    /// Who decides what is traced next of a picture whose error is asked for. The pixels are the same; on the reference both are the same,
    /// too, and where the work on pixels is counted the host decides.
    pub enum Decisions ("--decisions") {
        /// The device, if it is a GPU that divides as the host does and has the memory for it.
        Auto = "auto",
        /// The host, between lists of rays.
        Host = "host",
        /// The device, which keeps all that is known of the pixels.
        Device = "device",
    }
}

impl Traversal {
    /// Whether it finds every hit. Only [`Traversal::ThesisRestart`] does not.
    pub fn is_exact(self) -> bool {
        self != Traversal::ThesisRestart
    }
}

impl Intersector {
    /// The test that took least time in whole frames (bunny, sponza, gears) on PoCL and an H200.
    pub const FASTEST: Intersector = Intersector::MollerTrumbore;

    /// The function in `cl/intersect/` that does it; none for [`Intersector::Exact`], which has more than one.
    pub fn cl_function(self) -> Option<&'static str> {
        match self {
            Intersector::Exact => None,
            Intersector::MollerTrumbore => Some("intersect_moller_trumbore"),
            Intersector::Watertight => Some("intersect_watertight"),
            Intersector::Plucker => Some("intersect_plucker"),
            Intersector::Precomputed => Some("intersect_precomputed"),
            Intersector::Thesis => Some("intersect_thesis"),
        }
    }

    /// What `HITS` is in `cl/traverse/leaf.cl`.
    pub fn cl_hits(self) -> &'static str {
        if self == Intersector::Exact { "exactly" } else { "rounded" }
    }

    /// What `FILTER` is in `cl/intersect/filter.cl`.
    pub fn cl_filter(self) -> &'static str {
        if self.is_sheared() { "sheared" } else { "none" }
    }

    /// Whether it never finds a hit where sheared edge functions are surely of different signs.
    pub fn is_sheared(self) -> bool {
        matches!(self, Intersector::Exact | Intersector::Watertight)
    }

    /// Whether t stays right when the ray lies in the triangle's plane. Then every structure gives the hits of brute force; else a
    /// traversal may stop before a leaf whose triangle has a t that is nearer than the leaf.
    ///
    /// `watertight` weighs the vertices' own distances and `precomputed` takes u and v from the point at t: neither had such a
    /// ray in the tests. With the others t is a quotient of two numbers that may both be rounding errors: of 160,000 hits, three
    /// quarters of them of rays in a triangle's plane or close to it, 43 (`moller-trumbore`) and 195 (`plucker`) were others than
    /// brute force's.
    pub fn is_robust(self) -> bool {
        matches!(self, Intersector::Exact | Intersector::Watertight | Intersector::Precomputed)
    }

    /// Whether it reads [`crate::pack::SceneBuffers::transforms`].
    pub fn needs_transforms(self) -> bool {
        self == Intersector::Precomputed
    }
}

/// Which parts trace the rays, and the numbers of the build.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TraceOptions {
    /// The structure.
    #[serde(serialize_with = "as_name")]
    pub accel: Accel,
    /// The kd-tree's build.
    #[serde(serialize_with = "as_name")]
    pub build: Build,
    /// The kd-tree's traversal.
    #[serde(serialize_with = "as_name")]
    pub traversal: Traversal,
    /// Entries of the short stack, 1 to [`TraceOptions::MAX_DEPTH`]; `None`: [`TraceOptions::SHORT_STACK`]. Only for
    /// [`Traversal::ShortStack`].
    pub stack_size: Option<u32>,
    /// How many rays are traced together; more than one only with [`Accel::Bvh8`] and [`Intersector::Exact`].
    #[serde(serialize_with = "as_name")]
    pub packet_size: PacketSize,
    /// The order in which a batch's rays are traced.
    #[serde(serialize_with = "as_name")]
    pub ray_order: RayOrder,
    /// The ray-triangle test.
    #[serde(serialize_with = "as_name")]
    pub intersector: Intersector,
    /// A node with at most this many triangles is not split, and a leaf of a hierarchy of boxes or a cluster has no more; at least 1
    /// (and at most [`TraceOptions::BVH2_MAX_LEAF`] for [`Accel::Bvh2`], [`TraceOptions::BVH8_MAX_LEAF`] for [`Accel::Bvh8`]).
    /// `None`: the build's own default: 1 for a kd-tree that stops by cost, else 12 for the median and the sampled median, 8 for the spatial median, an octree and a hierarchy
    /// of boxes, 4 for the others; the square root of the triangles for clusters.
    pub leaf_size: Option<u32>,
    /// No leaf is deeper than this, the root counted as 0; at most [`TraceOptions::MAX_DEPTH`]. `None`: 8 + 1.3 log2(triangles) for
    /// a kd-tree, 4 + 0.5 log2(triangles) for an octree.
    pub max_depth: Option<u32>,
    /// Passes over a finished hierarchy of boxes, each of which moves large subtrees to where they fit better, or fewer when nothing is
    /// left to gain; `None`: 5.
    pub reinsert: Option<u32>,
    /// The most references that splits of space may add to a hierarchy of boxes, as a share of the triangles: each part of a triangle that
    /// is cut has one. 0 (none) to [`TraceOptions::MAX_SPATIAL_SPLITS`]; `None`: 0.
    pub spatial_splits: Option<f32>,
    /// How the kd-tree is split, and when no more.
    #[serde(flatten)]
    pub kd: KdOptions,
    /// Cells of the grid along x, y, z; their product at most [`TraceOptions::MAX_GRID_CELLS`]. An axis along which the scene has
    /// no extent gets 1. `None`: nearly cubic ones, about 8 for each triangle.
    pub grid_size: Option<[u32; 3]>,
    /// Where the arrays lie.
    #[serde(serialize_with = "as_name")]
    pub memory: Memory,
    /// Where shading data lies.
    #[serde(serialize_with = "as_name")]
    pub layout: Layout,
    /// The order of a kd-tree's nodes.
    #[serde(serialize_with = "as_name")]
    pub node_order: NodeOrder,
    /// How triangle tests find their vertices; [`TriangleOrder::LeafOrder`] only with [`Layout::Split`].
    #[serde(serialize_with = "as_name")]
    pub triangles: TriangleOrder,
    /// One kernel or several for pictures; batches of rays have one kernel anyway.
    #[serde(serialize_with = "as_name")]
    pub kernels: Kernels,
    /// Who evaluates textures; [`TexturePass::HostPass`] only with [`Kernels::Split`].
    #[serde(serialize_with = "as_name")]
    pub textures: TexturePass,
    /// What colour a ray takes from a texture that is a picture.
    #[serde(serialize_with = "as_name")]
    pub texture_filter: TextureFilter,
    /// Who decides what is traced next of a picture whose error is asked for.
    #[serde(serialize_with = "as_name")]
    pub decisions: Decisions,
    /// What the kernels that shade can do.
    #[serde(serialize_with = "as_name")]
    pub features: KernelFeatures,
    /// Where shadow rays start on smooth normals; only pictures have light.
    #[serde(serialize_with = "as_name")]
    pub terminator: Terminator,
    /// How many paths (a sample of a pixel and all rays that come of it) the split kernels follow at a time, at least 1; `None`: as
    /// many as a device has memory for. Only with [`Kernels::Split`].
    pub paths_in_flight: Option<u32>,
    /// Whether to count the work on every ray ([`crate::shared::WorkCounter`]), by kernels of their own: nothing else changes.
    #[serde(skip_serializing_if = "is_off")]
    pub counters: bool,
}

fn is_off(option: &bool) -> bool {
    !option
}

pub(crate) fn as_name<T: std::fmt::Display, S: serde::Serializer>(
    value: &T,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

impl TraceOptions {
    /// The deepest tree that a traversal stack is made for.
    pub const MAX_DEPTH: u32 = 60;

    /// What is used unless something else is asked for; a constant for tables of options.
    pub const DEFAULT: TraceOptions = TraceOptions {
        accel: Accel::Kd,
        build: Build::Sah,
        traversal: Traversal::Stack,
        stack_size: None,
        packet_size: PacketSize::One,
        ray_order: RayOrder::Auto,
        intersector: Intersector::Exact,
        leaf_size: None,
        max_depth: None,
        reinsert: None,
        spatial_splits: None,
        kd: KdOptions::DEFAULT,
        grid_size: None,
        memory: Memory::Global,
        layout: Layout::Split,
        node_order: NodeOrder::Preorder,
        triangles: TriangleOrder::Indexed,
        kernels: Kernels::Mega,
        textures: TexturePass::InKernel,
        texture_filter: TextureFilter::Footprint,
        decisions: Decisions::Auto,
        features: KernelFeatures::Scene,
        terminator: Terminator::Smooth,
        paths_in_flight: None,
        counters: false,
    };

    /// Entries of the short stack unless something else is asked for.
    pub const SHORT_STACK: u32 = 8;

    /// Entries of the short stack.
    pub fn short_stack_size(&self) -> u32 {
        self.stack_size.unwrap_or(Self::SHORT_STACK)
    }

    /// The most triangles in a leaf of [`Accel::Bvh2`] and [`Accel::Instances`]: what a link has room for.
    pub const BVH2_MAX_LEAF: u32 = (BVH_LEAF >> BVH_COUNT_SHIFT) - 1;

    /// The most triangles in a leaf of [`Accel::Bvh8`]: those that are looked at together.
    pub const BVH8_MAX_LEAF: u32 = 8;

    /// The most references that splits of space may add per triangle. A sixth as many as a kd-tree may have.
    pub const MAX_SPATIAL_SPLITS: f32 = 4.0;

    /// The most cells of a grid: 256 MiB of them, and numbers that are exact in float32.
    pub const MAX_GRID_CELLS: u32 = 1 << 24;

    /// The function in `cl/traverse/` that does it.
    pub fn cl_traverse(&self) -> &'static str {
        match (self.accel, self.traversal) {
            (Accel::Brute, _) => "traverse_brute_force",
            (Accel::Kd, Traversal::Stack) => "traverse_kd_stack",
            (Accel::Kd, Traversal::Restart) => "traverse_kd_restart",
            (Accel::Kd, Traversal::PushDown) => "traverse_kd_push_down",
            (Accel::Kd, Traversal::ShortStack) => "traverse_kd_short_stack",
            (Accel::Kd, Traversal::Ropes) => "traverse_kd_ropes",
            (Accel::Kd, Traversal::ThesisRestart) => "traverse_thesis_restart",
            (Accel::Bvh2, _) => "traverse_bvh2",
            (Accel::Bvh8, _) => "traverse_bvh8",
            (Accel::Instances, _) => "traverse_instances",
            (Accel::Grid, _) => "traverse_grid",
            (Accel::Octree, _) => "traverse_octree",
            (Accel::Boxes, _) => "traverse_boxes",
            (Accel::Spheres, _) => "traverse_spheres",
        }
    }

    /// The function in `cl/packets/` that does it for packets of rays; `None` where there is none.
    pub fn cl_traverse_packets(&self) -> Option<&'static str> {
        match (self.accel, self.traversal) {
            (Accel::Kd, Traversal::Stack) => Some("traverse_kd_packets"),
            (Accel::Bvh8, _) => Some("traverse_bvh8_packets"),
            _ => None,
        }
    }

    /// Checks the numbers, and that every option means something to the structure.
    ///
    /// # Errors
    /// [`Error::Option`] names the option that is out of its range or has no meaning, and what is possible.
    pub fn validate(&self) -> Result<()> {
        self.check_that_all_apply()?;
        self.kd.validate(self.build)?;
        if self.leaf_size == Some(0) {
            return Err(Error::option("--leaf-size", "must be at least 1"));
        }
        let most_in_leaf = match self.accel {
            Accel::Bvh2 | Accel::Instances => Self::BVH2_MAX_LEAF,
            Accel::Bvh8 => Self::BVH8_MAX_LEAF,
            _ => u32::MAX,
        };
        if let Some(size) = self.leaf_size.filter(|&size| size > most_in_leaf) {
            let message = format!("{size}: a leaf of --accel {} has room for {most_in_leaf} at most", self.accel);
            return Err(Error::option("--leaf-size", message));
        }
        if let Some(depth) = self.max_depth.filter(|&d| d > Self::MAX_DEPTH) {
            return Err(Error::option("--max-depth", format!("{depth} is over the limit of {}", Self::MAX_DEPTH)));
        }
        if let Some(share) = self.spatial_splits.filter(|share| !(0.0..=Self::MAX_SPATIAL_SPLITS).contains(share)) {
            let message = format!("{share} is not a number from 0 to {}", Self::MAX_SPATIAL_SPLITS);
            return Err(Error::option("--spatial-splits", message));
        }
        if let Some([x, y, z]) = self.grid_size {
            let cells = [x, y, z].iter().try_fold(1u32, |product, &n| product.checked_mul(n));
            if cells.is_none_or(|cells| cells == 0 || cells > Self::MAX_GRID_CELLS) {
                let message =
                    format!("{x},{y},{z}: must be at least 1,1,1 and no more than {} cells", Self::MAX_GRID_CELLS);
                return Err(Error::option("--grid-size", message));
            }
        }
        if let Some(size) = self.stack_size.filter(|size| !(1..=Self::MAX_DEPTH).contains(size)) {
            return Err(Error::option("--stack-size", format!("{size} is not in 1 to {}", Self::MAX_DEPTH)));
        }
        if let Some(size) = self.stack_size.filter(|_| self.traversal != Traversal::ShortStack) {
            let reason = format!(
                "only the short stack's size can be chosen, a full stack is as large as the tree is deep; nearest: --accel kd \
                 --traversal short-stack --stack-size {size}"
            );
            return Err(Error::option("--stack-size", reason));
        }
        if self.triangles == TriangleOrder::LeafOrder && self.layout == Layout::Whole {
            let reason = "leaf-order copies vertices alone, because shading data is looked up by triangle; nearest: --layout split";
            return Err(Error::option("--triangles", reason));
        }
        self.check_packets()?;
        self.check_instances()?;
        self.check_split()
    }

    /// Checks what is not there for triangles that are placed when a ray comes near.
    fn check_instances(&self) -> Result<()> {
        if self.accel != Accel::Instances || !self.intersector.needs_transforms() {
            return Ok(());
        }
        let reason = format!(
            "{} reads data that is computed of every triangle beforehand, and instances have none; nearest: --intersector exact, or \
             --accel bvh2",
            self.intersector
        );
        Err(Error::option(Intersector::OPTION, reason))
    }

    /// Checks what packets of rays cannot do.
    fn check_packets(&self) -> Result<()> {
        if self.packet_size == PacketSize::One {
            return Ok(());
        }
        if self.intersector != Intersector::Exact {
            let reason = format!(
                "packets leave what float32 does not decide to the exact test; nearest: --intersector exact, or --packet-size 1 \
                 --intersector {}",
                self.intersector
            );
            return Err(Error::option(PacketSize::OPTION, reason));
        }
        if self.cl_traverse_packets().is_none() {
            let reason =
                "packets of rays keep what is far on a full stack; nearest: --traversal stack, or --packet-size 1";
            return Err(Error::option(Traversal::OPTION, reason));
        }
        if self.counters {
            let reason = "work is counted for each ray by itself; nearest: --packet-size 1";
            return Err(Error::option("--counters", reason));
        }
        Ok(())
    }

    /// Checks what only the split kernels know.
    fn check_split(&self) -> Result<()> {
        if self.paths_in_flight == Some(0) {
            return Err(Error::option("--paths-in-flight", "must be at least 1"));
        }
        if self.kernels == Kernels::Split {
            let reason = "only the mega-kernel counts work, and rays take the same in either; nearest: --kernels mega";
            return if self.counters { Err(Error::option("--counters", reason)) } else { Ok(()) };
        }
        if self.textures == TexturePass::HostPass {
            let reason =
                "the mega-kernel does not stop between hit and shading; nearest: --kernels split --textures host-pass";
            return Err(Error::option("--textures", reason));
        }
        if let Some(pixels) = self.paths_in_flight {
            let reason = format!(
                "the mega-kernel has as many as the device runs work-items; nearest: --kernels split --paths-in-flight {pixels}"
            );
            return Err(Error::option("--paths-in-flight", reason));
        }
        Ok(())
    }

    /// An option that the structure does not read must have its default: a measurement of it would measure nothing.
    fn check_that_all_apply(&self) -> Result<()> {
        for option in OPTIONS {
            if option.is_set(self) && !option.structures.contains(&self.accel) {
                let names: Vec<_> = option.structures.iter().map(|accel| accel.name()).collect();
                // The limits that octrees have, too, are what a grid has its number of cells for.
                let nearest = match self.accel {
                    Accel::Grid if option.structures.contains(&Accel::Octree) => {
                        "; a grid's cells are set by --grid-size X,Y,Z"
                    }
                    _ => "",
                };
                let message = format!(
                    "means nothing to --accel {}; leave it out, or take --accel {}{nearest}",
                    self.accel,
                    names.join(" or ")
                );
                return Err(Error::option(option.name, message));
            }
        }
        Ok(())
    }
}

impl Default for TraceOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_go_together_is_refused_with_the_nearest_that_does() {
        let base = TraceOptions::DEFAULT;
        let short = TraceOptions { traversal: Traversal::ShortStack, ..base };
        let split = TraceOptions { kernels: Kernels::Split, ..base };
        for good in [
            base,
            TraceOptions { textures: TexturePass::HostPass, paths_in_flight: Some(1), ..split },
            TraceOptions { accel: Accel::Brute, ..base },
            TraceOptions { stack_size: Some(1), ..short },
            TraceOptions { stack_size: Some(60), ..short },
        ] {
            good.validate().unwrap();
        }
        for (bad, option, hint) in [
            (TraceOptions { accel: Accel::Brute, ..short }, "--traversal", "take --accel kd"),
            (TraceOptions { stack_size: Some(4), ..base }, "--stack-size", "--traversal short-stack --stack-size 4"),
            (TraceOptions { accel: Accel::Brute, stack_size: Some(4), ..base }, "--stack-size", "take --accel kd"),
            (TraceOptions { stack_size: Some(0), ..short }, "--stack-size", "1 to 60"),
            (TraceOptions { stack_size: Some(61), ..short }, "--stack-size", "1 to 60"),
            (
                TraceOptions { accel: Accel::Grid, node_order: NodeOrder::BreadthFirst, ..base },
                "--node-order",
                "take --accel kd",
            ),
            (
                TraceOptions { layout: Layout::Whole, triangles: TriangleOrder::LeafOrder, ..base },
                "--triangles",
                "--layout split",
            ),
            (
                TraceOptions { textures: TexturePass::HostPass, ..base },
                "--textures",
                "--kernels split --textures host-pass",
            ),
            (
                TraceOptions { paths_in_flight: Some(9), ..base },
                "--paths-in-flight",
                "--kernels split --paths-in-flight 9",
            ),
            (TraceOptions { counters: true, ..split }, "--counters", "--kernels mega"),
            (TraceOptions { paths_in_flight: Some(0), ..split }, "--paths-in-flight", "at least 1"),
        ] {
            let message = bad.validate().unwrap_err().to_string();
            assert!(message.contains(option) && message.contains(hint), "{message}");
        }
    }
}
