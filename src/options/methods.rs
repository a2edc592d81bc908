//! The interchangeable parts, by name. This is the one list of what exists: command line, tests and benches loop over
//! `ALL`. A new variant means one kernel file, its twin in `reference/`, and one line here.

use crate::names::names;

names! {
    /// The structures that rays are traced through.
    pub enum StructureKind ("structure") {
        /// Every triangle is tested against every ray.
        Brute = "brute",
        /// A kd-tree.
        Kd = "kd",
        /// A binary hierarchy of boxes, the two of a node's children side by side (Aila and Laine 2009).
        Bvh2 = "bvh2",
        /// A hierarchy of boxes with eight children a node, tested at once (Dammertz, Hanika and Keller 2008); for
        /// CPUs.
        Bvh8 = "bvh8",
        /// A binary hierarchy of boxes for each object, in its own coordinates, and one of the objects' instances
        /// (Rubin and Whitted 1980): memory for one copy of what stands in a scene many times.
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

names! {
    /// How the kd-tree's planes are chosen.
    pub enum Build ("build") {
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

names! {
    /// How a ray finds its way through the kd-tree.
    pub enum Traversal ("traversal") {
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

names! {
    /// The ray-triangle test. On a CPU precomputed and thesis are slower: their rays do not go in packets.
    pub enum Intersector ("intersector") {
        /// Right: exact arithmetic decides hit or miss and which of two hits is nearer, wherever rounded arithmetic
        /// cannot; t, u and v are the exact ones rounded once.
        Exact = "exact",
        /// Two edges and one reciprocal (Möller and Trumbore 1997), two-sided, no epsilon.
        MollerTrumbore = "moller-trumbore",
        /// Sheared edge functions (Woop, Benthin and Wald 2013), with exact signs by fma: no ray slips between
        /// neighbours.
        Watertight = "watertight",
        /// Volumes of ray and edges (Amanatides and Choi 1997), alike to the bit for the two triangles of an edge.
        Plucker = "plucker",
        /// A transform for each triangle, computed beforehand (Baldwin and Weber 2016).
        Precomputed = "precomputed",
        /// Listing 5.1 of the thesis with its faults: no back faces, no small triangles, a near limit that grows with
        /// 1/area.
        Thesis = "thesis",
    }
}

names! {
    /// How many rays a work-item traces together. The closest hits, and the pixels, are the same, but with
    /// moller-trumbore and plucker on some triangles that are seen edge-on; of several hits of a ray, where any will
    /// do, another one may be found. The wavefront kernels trace pictures one ray at a time.
    pub enum PacketSize ("packet_size") {
        /// Each ray by itself.
        One = "1",
        /// Sixteen rays in the lanes of vectors (Wald et al. 2001), for CPUs: pixels of a tile, and neighbours in a
        /// batch, which should be neighbours in space.
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

names! {
    /// The order in which the rays of a batch are traced; hits come back in the caller's. The closest hits are the
    /// same; of several hits of a ray, where any will do, packets may find another one. Pictures have an order of their
    /// own.
    pub enum RayOrder ("ray_order") {
        /// Sorted where that pays: a large batch that looks shuffled, in packets on a CPU, unless its rays go all ways
        /// or leave the scene soon.
        Auto = "auto",
        /// The caller's.
        Kept = "kept",
        /// Neighbours in space one after the other, by origin and then by direction (Meister et al. 2020).
        Sorted = "sorted",
    }
}

names! {
    /// Where on the device nodes, references, vertices and the structures' other arrays lie (thesis, section 5.3). The
    /// reference has one kind of memory: the choice changes nothing there.
    pub enum Memory ("memory") {
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

names! {
    /// Where a triangle's normals, texture coordinates and material lie (thesis, section 5.3).
    pub enum Layout ("layout") {
        /// In an array of their own, so that traversal does not fill caches with them.
        Split = "split",
        /// Behind the triangle's vertices.
        Whole = "whole",
    }
}

names! {
    /// The order of the kd-tree's nodes in memory.
    pub enum NodeOrder ("node_order") {
        /// A node, all below its lower child, all below its upper child.
        Preorder = "preorder",
        /// Subtrees of half the height together, and so on within them: few cache lines on the way down, whatever their
        /// size.
        VanEmdeBoas = "van-emde-boas",
        /// Level by level.
        BreadthFirst = "breadth-first",
    }
}

names! {
    /// How the triangle tests find their vertices.
    pub enum TriangleOrder ("triangles") {
        /// By the triangle's number in the leaf's list.
        Indexed = "indexed",
        /// In a copy for each reference, in the order of the leaves: no jump in memory, at 4 to 5 times the vertices in
        /// a kd-tree.
        LeafOrder = "leaf-order",
    }
}

names! {
    /// How the work of a picture is shared out among kernels (thesis, section 5.2.1). The pixels are the same; the
    /// reference does the work of either in one way.
    pub enum Kernels ("kernels") {
        /// One kernel does everything for a pixel.
        Mega = "mega",
        /// One kernel for each step of a ray, with queues in memory between them (Laine, Karras and Aila 2013).
        Wavefront = "wavefront" or "split",
    }
}

names! {
    /// What the kernels that shade can do; textures, mirrors and the like that a scene does without cost registers and
    /// time even so. The pixels are the same; the reference has all features.
    pub enum KernelFeatures ("features") {
        /// What the scene needs, and no more.
        Scene = "scene",
        /// Everything: one kernel for all scenes, which need not be compiled for each combination of features.
        All = "all",
    }
}

names! {
    /// Where shadow rays start on triangles with smooth normals. The same where normals are flat.
    pub enum Terminator ("terminator") {
        /// At the height that the normals claim (Hanika 2021): light ends smoothly on coarse meshes.
        Smooth = "smooth",
        /// On the triangle: exact shadows of the mesh as it is. Where it shades itself the shadow ends in stairs, along
        /// the triangles' edges.
        Hard = "hard",
    }
}

names! {
    /// Who evaluates textures (thesis, section 5.2.2). The pixels are the same; on the reference both are the same,
    /// too.
    pub enum TexturePass ("textures") {
        /// The kernel that shades.
        InKernel = "in-kernel",
        /// The host, between tracing and shading; only with wavefront kernels.
        HostPass = "host-pass",
    }
}

names! {
    /// What colour a ray takes from a texture that is a picture. The same where texels are larger than pixels.
    pub enum TextureFilter ("texture_filter") {
        /// The mean over what the ray stands for, from levels of the texture (Williams 1983; ray cones: Akenine-Möller
        /// et al. 2021): keeps far textures from flickering.
        Footprint = "footprint",
        /// The colour of a point, between its four texels.
        Bilinear = "bilinear",
    }
}

names! {
    /// Who decides what is traced next of a picture whose error is asked for. The pixels are the same; on the reference
    /// both are the same, too, and where the work on pixels is counted the host decides.
    pub enum Decisions ("decisions") {
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

    /// What `PACKET_TEST` is in `cl/packets/`; `None` for the exact test, which has functions of its own, and for those
    /// whose rays do not go in packets: their numbers of triangles are not in the leaves, or are not worth it.
    pub fn cl_packet_test(self) -> Option<&'static str> {
        match self {
            Intersector::MollerTrumbore => Some("moller_trumbore"),
            Intersector::Watertight => Some("watertight"),
            Intersector::Plucker => Some("plucker"),
            Intersector::Exact | Intersector::Precomputed | Intersector::Thesis => None,
        }
    }

    /// Whether its rays may go in packets.
    pub fn has_packets(self) -> bool {
        self == Intersector::Exact || self.cl_packet_test().is_some()
    }

    /// What `FILTER` is in `cl/intersect/filter.cl`.
    pub fn cl_filter(self) -> &'static str {
        if self.is_sheared() { "sheared" } else { "none" }
    }

    /// Whether it never finds a hit where sheared edge functions are surely of different signs.
    pub fn is_sheared(self) -> bool {
        matches!(self, Intersector::Exact | Intersector::Watertight)
    }

    /// Whether t stays right when the ray lies in the triangle's plane. Then every structure gives the hits of brute
    /// force; else a traversal may stop before a leaf whose triangle has a t that is nearer than the leaf.
    ///
    /// `watertight` weighs the vertices' own distances and `precomputed` takes u and v from the point at t: neither had
    /// such a ray in the tests. With the others t is a quotient of two numbers that may both be rounding errors: of
    /// 160,000 hits, three quarters of them of rays in a triangle's plane or close to it, 43 (`moller-trumbore`) and
    /// 195 (`plucker`) were others than brute force's.
    pub fn is_robust(self) -> bool {
        matches!(self, Intersector::Exact | Intersector::Watertight | Intersector::Precomputed)
    }

    /// Whether it reads [`crate::pack::SceneBuffers::transforms`].
    pub fn needs_transforms(self) -> bool {
        self == Intersector::Precomputed
    }
}

names! {
    /// The axis that a build without costs splits first; where a stop refuses that, it tries the others.
    pub enum SplitAxis ("split_axis") {
        /// x, y, z in turn, by depth.
        Turn = "turn",
        /// The longest one of the cell.
        Longest = "longest",
    }
}

names! {
    /// What makes a node a leaf before the tree is too deep.
    pub enum Stop ("stop") {
        /// It has few triangles, or a split costs more than it saves.
        Cost = "cost",
        /// It has few triangles.
        Size = "size",
    }
}

impl Build {
    /// Whether it weighs the costs of planes, and therefore stops by cost unless something else is asked for.
    pub fn weighs_costs(self) -> bool {
        matches!(self, Build::Sah | Build::Volume)
    }
}
