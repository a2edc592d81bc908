//! What can be chosen, as data: which parts trace the rays, and the numbers that go with them. What does not go
//! together is refused here and nowhere else; what is taken where nobody asks for anything is chosen in
//! [`crate::choose`].

use crate::error::{Error, Result};
use serde::ser::SerializeMap;

mod combinations;
mod grammar;
mod kd;
mod methods;
mod spatial_splits;
mod structures;
mod table;

pub use combinations::{NeverTogether, combine, fewest_changes, needs, never_together};
pub use grammar::parse_method;
pub use kd::KdOptions;
pub use methods::{
    Build, Decisions, Intersector, KernelFeatures, Kernels, Layout, Memory, NodeOrder, PacketSize, RayOrder, SplitAxis,
    Stop, StructureKind, Terminator, TextureFilter, TexturePass, Traversal, TriangleOrder,
};
pub use spatial_splits::SpatialSplits;
pub use structures::{BvhOptions, ClusterOptions, GridOptions, OctreeOptions, Structure};
pub use table::{Choice, Heading, MethodOption, OPTIONS, Value, choices};

/// Which parts trace the rays, and the numbers of the build.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceOptions {
    /// The structure, and what it alone reads.
    pub structure: Structure,
    /// The ray-triangle test.
    pub intersector: Intersector,
    /// How many rays are traced together; more than one only with [`Structure::Bvh8`] and [`Structure::Kd`], and where
    /// [`Intersector::has_packets`].
    pub packet_size: PacketSize,
    /// The order in which a batch's rays are traced.
    pub ray_order: RayOrder,
    /// How arrays lie in a device's memory.
    pub arrays: ArrayOptions,
    /// How pictures are made; batches of rays do not read it.
    pub picture: PictureOptions,
    /// Whether to count the work on every ray ([`crate::shared::WorkCounter`]), by kernels of their own: nothing else
    /// changes.
    pub counters: bool,
}

/// How the arrays of scene and structure lie in a device's memory. The reference has one kind of memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArrayOptions {
    /// In which kind of memory.
    pub memory: Memory,
    /// Where shading data lies.
    pub layout: Layout,
    /// How triangle tests find their vertices; [`TriangleOrder::LeafOrder`] only with [`Layout::Split`].
    pub triangles: TriangleOrder,
}

impl ArrayOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: ArrayOptions =
        ArrayOptions { memory: Memory::Global, layout: Layout::Split, triangles: TriangleOrder::Indexed };
}

/// The least weight of [`PictureOptions::roulette`] but for 0: times the random number, of 24 bits, it is no subnormal
/// number yet, which some devices take for 0.
pub const LEAST_ROULETTE: f32 = f32::MIN_POSITIVE * (1 << 24) as f32;

/// How pictures are made of rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureOptions {
    /// One kernel or several.
    pub kernels: Kernels,
    /// Who evaluates textures; [`TexturePass::HostPass`] only with [`Kernels::Wavefront`].
    pub textures: TexturePass,
    /// What colour a ray takes from a texture that is a picture.
    pub texture_filter: TextureFilter,
    /// Who decides what is traced next of a picture whose error is asked for.
    pub decisions: Decisions,
    /// What the kernels that shade can do.
    pub features: KernelFeatures,
    /// Where shadow rays start on smooth normals.
    pub terminator: Terminator,
    /// Russian roulette: a secondary ray of less weight than this is cast with a probability of its weight divided by
    /// this, and then weighs this. 0 or `None`: every one is cast. 0, or [`LEAST_ROULETTE`] to 1.
    pub roulette: Option<f32>,
    /// How many paths (a sample of a pixel and all rays that come of it) the wavefront kernels follow at a time, at
    /// least 1; `None`: as many as a device has memory for. Only with [`Kernels::Wavefront`].
    pub paths_in_flight: Option<u32>,
}

impl PictureOptions {
    /// What is used unless something else is asked for.
    pub const DEFAULT: PictureOptions = PictureOptions {
        kernels: Kernels::Mega,
        textures: TexturePass::InKernel,
        texture_filter: TextureFilter::Footprint,
        decisions: Decisions::Auto,
        features: KernelFeatures::Scene,
        terminator: Terminator::Smooth,
        roulette: None,
        paths_in_flight: None,
    };
}

/// Flat, by the names of [`OPTIONS`]; the structure is called `accel`, as it always was. What the structure does not
/// read is left out.
impl serde::Serialize for TraceOptions {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for option in OPTIONS {
            let key = if option.name == StructureKind::OPTION { "accel" } else { option.name };
            match option.value(self) {
                None => {}
                Some(None) => map.serialize_entry(key, &None::<u32>)?,
                Some(Some(value)) => option.serialize_value(&mut map, key, value)?,
            }
        }
        if self.counters {
            map.serialize_entry("counters", &true)?;
        }
        map.end()
    }
}

impl TraceOptions {
    /// The deepest tree that a traversal stack is made for.
    pub const MAX_DEPTH: u32 = 60;

    /// What is used unless something else is asked for; a constant for tables of options.
    pub const DEFAULT: TraceOptions = TraceOptions::of(StructureKind::Kd);

    /// The defaults of a structure.
    pub const fn of(kind: StructureKind) -> TraceOptions {
        TraceOptions {
            structure: Structure::of(kind),
            intersector: Intersector::Exact,
            packet_size: PacketSize::One,
            ray_order: RayOrder::Auto,
            arrays: ArrayOptions::DEFAULT,
            picture: PictureOptions::DEFAULT,
            counters: false,
        }
    }

    /// The defaults with a kd-tree that is built and walked in this way.
    pub const fn of_kd(kd: KdOptions) -> TraceOptions {
        TraceOptions { structure: Structure::Kd(kd), ..TraceOptions::DEFAULT }
    }

    /// The same with another structure and its defaults.
    #[must_use]
    pub const fn with_structure(self, kind: StructureKind) -> TraceOptions {
        TraceOptions { structure: Structure::of(kind), ..self }
    }

    /// Which structure.
    pub const fn kind(&self) -> StructureKind {
        self.structure.kind()
    }

    /// What a kd-tree is built and walked by: the defaults where the structure is another one.
    pub const fn kd(&self) -> KdOptions {
        match self.structure {
            Structure::Kd(kd) => kd,
            _ => KdOptions::DEFAULT,
        }
    }

    /// Whether every hit is the exact one: then pictures have the same bits with every structure.
    pub fn is_exact(&self) -> bool {
        self.intersector == Intersector::Exact && self.kd().traversal.is_exact()
    }

    /// Whether what a ray hits does not depend on which rays are traced with it. In packets of rays it may, where hits
    /// are not exact.
    pub fn has_independent_hits(&self) -> bool {
        self.packet_size == PacketSize::One || self.is_exact()
    }

    /// Whether a triangle may be in several leaves, so that a ray may meet it more than once. Kernels are compiled for
    /// the answer while the structure is built, so [`SpatialSplits::Auto`] is a yes, whatever the builder will choose:
    /// the same hits, but counts and lists of all hits then take a traversal for each hit.
    pub fn repeats_triangles(&self) -> bool {
        match self.structure {
            Structure::Kd(_) | Structure::Grid(_) | Structure::Octree(_) => true,
            Structure::Bvh2(bvh) | Structure::Bvh8(bvh) | Structure::Instances(bvh) => {
                bvh.spatial_splits.is_some_and(|splits| splits.most() > 0.0)
            }
            Structure::Brute | Structure::Boxes(_) | Structure::Spheres(_) => false,
        }
    }

    /// The function in `cl/traverse/` that does it.
    pub fn cl_traverse(&self) -> &'static str {
        match self.structure {
            Structure::Brute => "traverse_brute_force",
            Structure::Kd(kd) => match kd.traversal {
                Traversal::Stack => "traverse_kd_stack",
                Traversal::Restart => "traverse_kd_restart",
                Traversal::PushDown => "traverse_kd_push_down",
                Traversal::ShortStack => "traverse_kd_short_stack",
                Traversal::Ropes => "traverse_kd_ropes",
                Traversal::ThesisRestart => "traverse_thesis_restart",
            },
            Structure::Bvh2(_) => "traverse_bvh2",
            Structure::Bvh8(_) => "traverse_bvh8",
            Structure::Instances(_) => "traverse_instances",
            Structure::Grid(_) => "traverse_grid",
            Structure::Octree(_) => "traverse_octree",
            Structure::Boxes(_) => "traverse_boxes",
            Structure::Spheres(_) => "traverse_spheres",
        }
    }

    /// The function in `cl/packets/` that does it for packets of rays; `None` where there is none.
    pub fn cl_traverse_packets(&self) -> Option<&'static str> {
        match self.structure {
            Structure::Kd(KdOptions { traversal: Traversal::Stack, .. }) => Some("traverse_kd_packets"),
            Structure::Bvh8(_) => Some("traverse_bvh8_packets"),
            _ => None,
        }
    }

    /// Checks the numbers, and that every option means something to the structure.
    ///
    /// # Errors
    /// [`Error::Option`] names the option that is out of its range or has no meaning, and what is possible.
    pub fn validate(&self) -> Result<()> {
        self.check_that_all_apply()?;
        self.structure.validate()?;
        if self.arrays.triangles == TriangleOrder::LeafOrder && self.arrays.layout == Layout::Whole {
            let reason = "leaf-order copies vertices alone, because shading data is looked up by triangle; nearest: \
                          `layout = split`";
            return Err(Error::option("triangles", reason));
        }
        self.check_roulette()?;
        self.check_packets()?;
        self.check_instances()?;
        self.check_wavefront()
    }

    /// An option that the structure does not read must have its default: a measurement of it would measure nothing.
    pub(crate) fn check_that_all_apply(&self) -> Result<()> {
        let foreign = |option: &&MethodOption| option.is_set(self) && !option.structures.contains(&self.kind());
        OPTIONS.iter().find(foreign).map_or(Ok(()), |option| Err(option.means_nothing_to(self.kind())))
    }

    /// Checks what is not there for triangles that are placed when a ray comes near.
    fn check_instances(&self) -> Result<()> {
        if self.kind() != StructureKind::Instances || !self.intersector.needs_transforms() {
            return Ok(());
        }
        let reason = format!(
            "{} reads data that is computed of every triangle beforehand, and instances have none; nearest: \
             `intersector = exact`, or `structure = bvh2`",
            self.intersector
        );
        Err(Error::option(Intersector::OPTION, reason))
    }

    /// Checks the weight of the roulette.
    fn check_roulette(&self) -> Result<()> {
        match self.picture.roulette {
            Some(weight) if weight != 0.0 && !(LEAST_ROULETTE..=1.0).contains(&weight) => {
                let reason = format!(
                    "{weight} is no weight of a ray, which is at most 1; must be 0, or {LEAST_ROULETTE:.0e} to 1"
                );
                Err(Error::option("roulette", reason))
            }
            _ => Ok(()),
        }
    }

    /// Checks what packets of rays cannot do.
    fn check_packets(&self) -> Result<()> {
        if self.packet_size == PacketSize::One {
            return Ok(());
        }
        if !self.intersector.has_packets() {
            let reason = format!(
                "{} tests one ray at a time; nearest: `intersector = moller-trumbore`, or `packet_size = 1` \
                 `intersector = {}`",
                self.intersector, self.intersector
            );
            return Err(Error::option(PacketSize::OPTION, reason));
        }
        if self.cl_traverse_packets().is_none() {
            let reason =
                "packets of rays keep what is far on a full stack; nearest: `traversal = stack`, or `packet_size = 1`";
            return Err(Error::option(Traversal::OPTION, reason));
        }
        if self.counters {
            let reason = "work is counted for each ray by itself; nearest: `packet_size = 1`";
            return Err(Error::option("counters", reason));
        }
        Ok(())
    }

    /// Checks what only the wavefront kernels know.
    fn check_wavefront(&self) -> Result<()> {
        let PictureOptions { kernels, textures, paths_in_flight, .. } = self.picture;
        if paths_in_flight == Some(0) {
            return Err(Error::option("paths_in_flight", "must be at least 1"));
        }
        if kernels == Kernels::Wavefront {
            let reason =
                "only the mega-kernel counts work, and rays take the same in either; nearest: `kernels = mega`";
            return if self.counters { Err(Error::option("counters", reason)) } else { Ok(()) };
        }
        if textures == TexturePass::HostPass {
            let reason = "the mega-kernel does not stop between hit and shading; nearest: `kernels = wavefront` \
                          `textures = host-pass`";
            return Err(Error::option("textures", reason));
        }
        if let Some(paths) = paths_in_flight {
            let reason = format!(
                "the mega-kernel has as many as the device runs work-items; nearest: `kernels = wavefront` \
                 `paths_in_flight = {paths}`"
            );
            return Err(Error::option("paths_in_flight", reason));
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
        let kd = |kd: KdOptions| TraceOptions { structure: Structure::Kd(kd), ..base };
        let short = KdOptions { traversal: Traversal::ShortStack, ..KdOptions::DEFAULT };
        let of_picture = |picture: PictureOptions| TraceOptions { picture, ..base };
        let plain = PictureOptions::DEFAULT;
        let wavefront = PictureOptions { kernels: Kernels::Wavefront, ..plain };
        for good in [
            base,
            of_picture(PictureOptions { textures: TexturePass::HostPass, paths_in_flight: Some(1), ..wavefront }),
            of_picture(PictureOptions { roulette: Some(0.0), ..plain }),
            of_picture(PictureOptions { roulette: Some(LEAST_ROULETTE), ..plain }),
            of_picture(PictureOptions { roulette: Some(1.0), ..wavefront }),
            TraceOptions::of(StructureKind::Brute),
            kd(KdOptions { stack_size: Some(1), ..short }),
            kd(KdOptions { stack_size: Some(60), ..short }),
        ] {
            good.validate().unwrap();
        }
        let arrays = ArrayOptions { layout: Layout::Whole, triangles: TriangleOrder::LeafOrder, ..base.arrays };
        let whole = ArrayOptions { layout: Layout::Whole, ..base.arrays };
        for (bad, option, hint) in [
            (
                kd(KdOptions { stack_size: Some(4), ..KdOptions::DEFAULT }),
                "stack_size",
                "`traversal = short-stack` `stack_size = 4`",
            ),
            (kd(KdOptions { stack_size: Some(0), ..short }), "stack_size", "1 to 60"),
            (kd(KdOptions { stack_size: Some(61), ..short }), "stack_size", "1 to 60"),
            (TraceOptions { arrays, ..base }, "triangles", "`layout = split`"),
            (
                TraceOptions { arrays: whole, ..TraceOptions::of(StructureKind::Instances) },
                "layout",
                "means nothing to `structure = instances`",
            ),
            (
                of_picture(PictureOptions { textures: TexturePass::HostPass, ..plain }),
                "textures",
                "`kernels = wavefront` `textures = host-pass`",
            ),
            (
                of_picture(PictureOptions { paths_in_flight: Some(9), ..plain }),
                "paths_in_flight",
                "`kernels = wavefront` `paths_in_flight = 9`",
            ),
            (TraceOptions { counters: true, ..of_picture(wavefront) }, "counters", "`kernels = mega`"),
            (of_picture(PictureOptions { paths_in_flight: Some(0), ..wavefront }), "paths_in_flight", "at least 1"),
            (of_picture(PictureOptions { roulette: Some(1.1), ..plain }), "roulette", "at most 1"),
            (of_picture(PictureOptions { roulette: Some(-0.5), ..plain }), "roulette", "must be 0, or 2e-31 to 1"),
            (of_picture(PictureOptions { roulette: Some(f32::NAN), ..plain }), "roulette", "NaN"),
            (of_picture(PictureOptions { roulette: Some(1e-40), ..plain }), "roulette", "2e-31"),
            (
                TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::of(StructureKind::Grid) },
                "packet_size",
                "take `structure = kd` or `structure = bvh8`",
            ),
            (
                TraceOptions {
                    packet_size: PacketSize::Sixteen,
                    intersector: Intersector::Thesis,
                    ..TraceOptions::of(StructureKind::Bvh8)
                },
                "packet_size",
                "`packet_size = 1` `intersector = thesis`",
            ),
        ] {
            let message = bad.validate().unwrap_err().to_string();
            assert!(message.contains(option) && message.contains(hint), "{message}");
        }
    }

    #[test]
    fn options_are_written_flat_and_by_name() {
        let kd = KdOptions { stop: Some(Stop::Size), cost_traverse: Some(0.5), ..KdOptions::DEFAULT };
        let json =
            serde_json::to_value(TraceOptions { structure: Structure::Kd(kd), ..TraceOptions::DEFAULT }).unwrap();
        assert_eq!(
            (&json["accel"], &json["stop"], &json["cost_traverse"]),
            (&"kd".into(), &"size".into(), &0.5.into())
        );
        assert_eq!((&json["split_axis"], &json["empty_bonus"]), (&"turn".into(), &serde_json::Value::Null));
        assert!(json.get("grid_size").is_none() && json.get("counters").is_none(), "{json}");
        let grid = GridOptions { size: Some([4, 5, 6]) };
        let json =
            serde_json::to_value(TraceOptions { structure: Structure::Grid(grid), ..TraceOptions::DEFAULT }).unwrap();
        assert_eq!(json["grid_size"], serde_json::json!([4, 5, 6]));
    }
}
