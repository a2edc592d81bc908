//! The structs and constants that host and kernels share. `cl/shared/types.cl` and `constants.cl` are generated from
//! this file and those in its folder.
//!
//! All coordinates in these structs are in *tracing space*: world units times [`SceneParams::scale`], a power of two,
//! so that the change of units is exact and the kernels' products neither over- nor underflow for very large or small
//! scenes. Directions stay as they are, and with them t is scaled like the coordinates.

pub mod constants;
mod feature;
mod wavefront;

pub use feature::Feature;
pub use wavefront::*;

use crate::bounds::{DISTANCE_BOUNDS, ROUNDING_BOUNDS, SLAB_BOUNDS, SPHERE_BOUNDS};
use crate::layout::{ConstantGroup, Float4, Int4, StructLayout, device_const, device_struct};
use crate::names::names;

device_const! {
    /// Nodes and links of the structures.
    pub group RECORDS_OF_NODES;
    /// `Hit::primitive` of a miss, and `skip` of a ray that skips nothing.
    pub const NO_PRIMITIVE: u32 = u32::MAX;
    /// `KdNode::flags` of a leaf; an inner node has its split axis 0, 1 or 2 there.
    pub const KD_LEAF: u32 = 3;
    /// A rope that leads out of the scene. The root's number, because no rope leads to the root.
    pub const NO_ROPE: u32 = 0;
    /// Records of `nodes` that a node of a binary hierarchy of boxes takes.
    pub const BVH_NODE_RECORDS: u32 = 4;
    /// Bit of a link to a leaf of such a hierarchy; without it a link is a node's number.
    pub const BVH_LEAF: u32 = 1 << 31;
    /// Bits of a link to a leaf that number its first reference.
    pub const BVH_FIRST_MASK: u32 = (1 << BVH_COUNT_SHIFT) - 1;
    /// The bits above them, up to [`BVH_LEAF`], are how many references there are.
    pub const BVH_COUNT_SHIFT: u32 = 27;
    /// Where there is no more: the link of a leaf that no tree has.
    pub const BVH_END: u32 = u32::MAX;
    /// Where an instance ends: the link that leads a traversal back out of it.
    pub const BVH_LEAVE: u32 = u32::MAX - 1;
    /// Records of `nodes` that a node of a hierarchy of eight children takes.
    pub const BVH8_NODE_RECORDS: u32 = 16;
    /// The first of these with links.
    pub const BVH8_LINKS: u32 = 12;
    /// Records of `bounds` that a packet of eight triangles takes.
    pub const BVH8_PACKET_RECORDS: u32 = 18;
    /// Bits of a key on the stack of such a hierarchy that are a child's number in its node.
    pub const KEY_LANE: u32 = 7;
    /// The key of what is entered before everything: the bits of -infinity.
    pub const FIRST_KEY: u32 = 0xff80_0000;
}

device_const! {
    /// Records of instances.
    pub group RECORDS_OF_INSTANCES;
    /// Records of `bounds` that an instance takes; what they are, `src/pack/instances.rs` says.
    pub const INSTANCE_RECORDS: u32 = 11;
    /// The first of these with the transform to the world.
    pub const INSTANCE_TO_WORLD: u32 = 0;
    /// The first with the transform from tracing space.
    pub const INSTANCE_TO_OBJECT: u32 = 3;
    /// The one with how far differences of tracing space reach in the object.
    pub const INSTANCE_REACH: u32 = 6;
    /// The one with the padding of its boxes whatever the ray.
    pub const INSTANCE_BLUR: u32 = 7;
    /// The first with the transform of normals.
    pub const INSTANCE_NORMALS: u32 = 8;
    /// The material of an instance whose triangles have their own.
    pub const NO_MATERIAL: u32 = u32::MAX;
}

device_const! {
    /// Kinds of lights and textures.
    pub group KINDS;
    /// `Light::kind` of a point light.
    pub const LIGHT_POINT: u32 = 0;
    /// `Light::kind` of a directional light.
    pub const LIGHT_DIRECTIONAL: u32 = 1;
    /// `Light::kind` of a spot light.
    pub const LIGHT_SPOT: u32 = 2;
    /// `Material::texture` of an untextured material.
    pub const NO_TEXTURE: u32 = u32::MAX;
    /// `TextureInfo::kind` of a picture.
    pub const TEXTURE_IMAGE: u32 = 0;
    /// `TextureInfo::kind` of a chequerboard in space.
    pub const TEXTURE_CHECKER: u32 = 1;
    /// `TextureInfo::kind` of fractal noise.
    pub const TEXTURE_NOISE: u32 = 2;
    /// `TextureInfo::kind` of marble.
    pub const TEXTURE_MARBLE: u32 = 3;
    /// `TextureInfo::kind` of wood.
    pub const TEXTURE_WOOD: u32 = 4;
}

device_const! {
    /// Pictures and batches: how they are divided, counted and limited.
    pub group PICTURES;
    /// How many packets of sixteen rays, of a batch or of the camera, a work-item traces together.
    pub const PACKETS_OF_ITEM: u32 = 4;
    /// Hits of a ray up to which packets list them.
    pub const MOST_LISTED: u32 = 128;
    /// Where the hits of a ray begin that packets have not listed.
    pub const NOT_LISTED: u32 = u32::MAX;
    /// Side of the square tile of pixels that neighbouring work-items render: their rays run close together.
    pub const TILE_SIDE: u32 = 8;
    /// Pixels of a tile.
    pub const TILE_PIXELS: u32 = TILE_SIDE * TILE_SIDE;
    /// How many ray counters there are.
    pub const COUNTERS: usize = 8;
    /// The ray counters exist this many times on a device, so that work-items seldom meet at one.
    pub const COUNTER_SLOTS: u32 = 256;
    /// Where behind the ray counters there is how many tiles of a launch are taken.
    pub const TAKEN_TILES: u32 = COUNTER_SLOTS * COUNTERS as u32;
    /// Transparent surfaces that one shadow ray passes before it counts as blocked.
    pub const MAX_SHADOW_LAYERS: u32 = 256;
    /// The most places at which a texture is read along a footprint. Of a floor out to the horizon one sample erred by
    /// 1.3 times as much with 4 as with 8, by 0.93 of it with 16.
    pub const MOST_TAPS: u32 = 8;
    /// The kind of ray in `WaitingRay::weight_kind_depth` takes this many low bits of w, the depth the ones above.
    pub const RAY_KIND_BITS: u32 = 8;
    /// With roulette the depth takes this many of these, the ray's way the rest.
    pub const RAY_DEPTH_BITS: u32 = 8;
    /// How many work counters there are.
    pub const WORK_COUNTERS: usize = WorkCounter::ALL.len();
    /// The largest radiance of one surface, or of the background, along a ray; what is brighter counts as this. Then no
    /// sum overflows: a pixel is the sum of up to 2^16 samples, and of each of these the weights of all rays of one
    /// depth add up to at most 1 (with roulette: on average), at up to 2^6 depths. An infinity would become NaN where
    /// its weight is 0. White is 1, the sun in candela per square metre 1.6e9: 2^100 is out of reach for all but a lamp
    /// that touches the surface, whose light grows with 1 / distance^2 beyond all bounds.
    pub const MAX_RADIANCE: f32 = constants::power_of_two(100);
}

/// Names of the ray counters, in the kernels' order: kind and what happened.
pub const COUNTER_NAMES: [&str; COUNTERS] = [
    "CAMERA_CAST",
    "CAMERA_HIT",
    "SHADOW_CAST",
    "SHADOW_HIT",
    "REFLECTED_CAST",
    "REFLECTED_HIT",
    "REFRACTED_CAST",
    "REFRACTED_HIT",
];

names! {
    /// What kernels built with `COUNT_WORK`, and the twin, count while they trace a ray; the values index the counters.
    ///
    /// | structure | a step is | a leaf is | entries of the stack |
    /// |---|---|---|---|
    /// | kd-tree | an inner node visited | a leaf visited | far children (`stack`, `short-stack`); else none |
    /// | hierarchy of boxes | an inner node visited, and its children's boxes tested | a leaf visited | far children |
    /// | instances | the same, of either level | a leaf of an object visited | far children, and for each ray in an instance the way back |
    /// | octree | a child cell tested against the ray | a leaf visited | open nodes |
    /// | grid | a move to the next cell | a cell visited, so with the first one a leaf more than steps | none |
    /// | boxes, spheres | a volume tested | a cluster whose volume was met | none |
    /// | brute force | none | none: its one list is no leaf | none |
    ///
    /// What is visited again after a restart counts again. A ray that starts too far from a grid tests its list of all
    /// triangles and counts no leaf. Shading reads vertices, too; those do not count.
    pub enum WorkCounter ("aov") {
        /// Steps through the structure from one leaf to the next.
        Steps = "steps",
        /// Leaves visited.
        Leaves = "leaves",
        /// Those of them without triangles.
        EmptyLeaves = "empty-leaves",
        /// Ray-triangle tests. The triangle that a ray starts on is not tested.
        Tests = "tests",
        /// Those of them that `exact` takes to twice the precision, because float32 bounds leave them open.
        ExtendedTests = "extended-tests",
        /// Those of these that it takes further: to pairs of doubles, where there are doubles, and to exact integers.
        CloseTests = "close-tests",
        /// Descents that began anew; with ropes rays that `push-down` traces again, and its restarts.
        Restarts = "restarts",
        /// Entries that the short stack forgot.
        Overflows = "overflows",
        /// Bytes of nodes, boxes, spheres, planes and ropes that were read.
        NodeBytes = "node-bytes",
        /// Bytes of references, vertices and precomputed data of triangles that were read for tests.
        TriangleBytes = "triangle-bytes",
        /// The most entries on the traversal's stack: a maximum where the others are sums.
        DeepestStack = "deepest-stack",
    }
}

impl WorkCounter {
    /// The name as keys of JSON and arrays have it: `empty_leaves`.
    pub fn key(self) -> String {
        self.name().replace('-', "_")
    }

    /// Whether it is a maximum and not a sum.
    pub fn is_maximum(self) -> bool {
        self == WorkCounter::DeepestStack
    }
}

device_struct! {
    /// One ray of a batch query.
    pub struct TraceRay {
        /// Origin in x, y, z (tracing space) and t_min (world units) in w.
        pub origin_t_min: Float4,
        /// Direction in x, y, z (world units, any length) and t_max (world units) in w.
        pub direction_t_max: Float4,
    }
}

device_struct! {
    /// The nearest intersection found.
    pub struct Hit {
        /// Distance in units of |direction|; infinity on a miss.
        pub t: f32,
        /// Barycentric weight of vertex 1.
        pub u: f32,
        /// Barycentric weight of vertex 2.
        pub v: f32,
        /// Triangle number in file order, NO_PRIMITIVE on a miss.
        pub primitive: u32,
    }
}

impl Hit {
    /// That of a ray that misses.
    pub const NONE: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };
}

device_struct! {
    /// What a ray has hit, as surfaces want to know it.
    pub struct SurfaceHit {
        /// Weight of vertex 0.
        pub weight0: f32,
        /// Weight of vertex 1.
        pub u: f32,
        /// Weight of vertex 2.
        pub v: f32,
        /// Triangle number in file order, NO_PRIMITIVE on a miss.
        pub primitive: u32,
    }
}

device_struct! {
    /// A kd-tree node: inner {axis, left, right, split} or leaf {KD_LEAF, first, count, 0}; 16 bytes, read as one int4.
    ///
    /// ```text
    /// flags: bits 0-1  split axis 0..2, or 3 = leaf; the rest 0
    /// inner: left, right = node indices; split = plane coordinate
    /// leaf:  left = first entry in the reference array; right = number of entries; split = 0, with ropes the leaf's
    ///        number as bits
    /// ```
    pub struct KdNode {
        /// Split axis, or KD_LEAF.
        pub flags: u32,
        /// Inner: index of the child below the plane. Leaf: first reference.
        pub left: u32,
        /// Inner: index of the child above the plane. Leaf: number of references.
        pub right: u32,
        /// Inner: the plane's coordinate, tracing space.
        pub split: f32,
    }
}

device_struct! {
    /// Shading data of one triangle, apart from its vertices so that traversal never reads it.
    pub struct Shading {
        /// Normal at vertex 0 in x, y, z (zero: use the geometric one) and texture u of vertex 0 in w.
        pub normal0_u0: Float4,
        /// Normal at vertex 1 and texture u of vertex 1.
        pub normal1_u1: Float4,
        /// Normal at vertex 2 and texture u of vertex 2.
        pub normal2_u2: Float4,
        /// Texture v of vertex 0.
        pub v0: f32,
        /// Texture v of vertex 1.
        pub v1: f32,
        /// Texture v of vertex 2.
        pub v2: f32,
        /// Index of the material.
        pub material: u32,
    }
}

device_struct! {
    /// A material; colours are linear RGB.
    pub struct Material {
        /// Ambient colour times the scene's ambient light in x, y, z; w unused.
        pub ambient: Float4,
        /// Diffuse colour in x, y, z; w unused.
        pub diffuse: Float4,
        /// Specular colour in x, y, z and Blinn-Phong exponent in w.
        pub specular_shininess: Float4,
        /// Mirror reflectance in x, y, z; w unused.
        pub mirror: Float4,
        /// Transmission colour in x, y, z and index of refraction in w.
        pub transmission_ior: Float4,
        /// Emitted light in x, y, z; w unused.
        pub emission: Float4,
        /// Index of the diffuse texture, or NO_TEXTURE.
        pub texture: u32,
        /// 1 when light passes through (transmission above zero), else 0.
        pub transparent: u32,
        /// Tones above dark of the diffuse light, or 0 for smooth shading.
        pub toon_steps: u32,
        /// Cosine from which there is light at all; only with toon_steps.
        pub toon_threshold: f32,
    }
}

device_struct! {
    /// A light source.
    pub struct Light {
        /// Position (point, spot) in x, y, z, tracing space; w unused.
        pub position: Float4,
        /// Unit direction the light shines along (directional, spot) in x, y, z; w unused.
        pub direction: Float4,
        /// Intensity, linear RGB; w unused.
        pub intensity: Float4,
        /// LIGHT_POINT, LIGHT_DIRECTIONAL or LIGHT_SPOT.
        pub kind: u32,
        /// Tracing space's scale for a falloff with the squared distance in world units, 0 for none.
        pub falloff_scale: f32,
        /// Spot: cosine of the angle within which intensity is full.
        pub cos_inner: f32,
        /// Spot: cosine of the angle beyond which there is none.
        pub cos_outer: f32,
    }
}

device_struct! {
    /// A texture: where its picture lies in the texel array, or the parameters of a procedural one.
    pub struct TextureInfo {
        /// Procedural: how x of the texture's own space comes from a position (factors in x, y, z and a summand in w).
        pub to_x: Float4,
        /// Procedural: the same for y.
        pub to_y: Float4,
        /// Procedural: the same for z.
        pub to_z: Float4,
        /// Procedural: first colour in x, y, z and strength of the turbulence in w.
        pub colour0_turbulence: Float4,
        /// Procedural: second colour in x, y, z; w unused.
        pub colour1: Float4,
        /// TEXTURE_IMAGE or the kind of procedural texture.
        pub kind: u32,
        /// Image: index of its first texel.
        pub first: u32,
        /// Image: texels a row.
        pub width: u32,
        /// Image: rows.
        pub height: u32,
        /// Procedural: octaves of the noise.
        pub octaves: u32,
        /// Procedural: which noise.
        pub seed: u32,
        /// Procedural: 1 when the position is (u, v, 0) of the texture coordinates, 0 when it is the hit's in tracing
        /// space.
        pub in_uv: u32,
        /// Image: itself, and pictures of it that are half as wide and high, each behind the one before, as small as a
        /// ray may want it.
        pub levels: u32,
    }
}

device_struct! {
    /// A place in a picture through which a camera ray passes.
    pub struct CameraSample {
        /// Pixels to the right of its pixel's upper left corner; in a list of rays, of the picture's.
        pub x: f32,
        /// Pixels down from there.
        pub y: f32,
        /// Side in pixels of the square that the sample stands for.
        pub footprint: f32,
    }
}

device_struct! {
    /// A ray that waits to be traced. It ends nowhere.
    pub struct WaitingRay {
        /// Origin in x, y, z and t_near in w.
        pub origin_t_near: Float4,
        /// What that leaves out of the origin in x, y, z and the width of the ray's cone there in w.
        pub origin_low_width: Float4,
        /// Where it lies on the triangle, as weights of the vertices, in x, y, z and by how much the cone widens in w.
        pub start_weights_spread: Float4,
        /// Bits of the direction in x, y, z and the triangle that it starts on in w.
        pub direction_skip: Int4,
        /// Bits of the weight in x, y, z and depth << RAY_KIND_BITS | kind in w.
        pub weight_kind_depth: Int4,
    }
}

device_struct! {
    /// What the kernels need to know of the scene as a whole.
    pub struct SceneParams {
        /// Low corner of the box around all triangles in x, y, z, tracing space; w: the padding of the boxes of bvh2.
        pub low: Float4,
        /// High corner of that box; w: how far from 0 most triangles reach, where few others reach very much farther,
        /// else 0.
        pub high: Float4,
        /// Background straight down, linear RGB; w unused.
        pub background_bottom: Float4,
        /// Background straight up; w unused.
        pub background_top: Float4,
        /// Light of the sky on a surface that faces down, linear RGB; w unused.
        pub sky_bottom: Float4,
        /// Light of the sky on a surface that faces up; w unused.
        pub sky_top: Float4,
        /// Light from the viewer on a surface that faces the viewer; w unused.
        pub sky_viewer: Float4,
        /// Which way is up for sky and background, length 1; w unused.
        pub sky_up: Float4,
        /// Length of the reference list; with brute force the number of triangles that can be hit; with instances their
        /// number.
        pub reference_count: u32,
        /// Number of lights that shine.
        pub light_count: u32,
        /// 1 when the material of some triangle is transparent, so that shadow rays must look for the tint.
        pub has_transparent: u32,
        /// Tracing space = world units times this power of two.
        pub scale: f32,
    }
}

device_struct! {
    /// What the render kernel needs to know of the picture.
    pub struct RenderParams {
        /// Camera position in x, y, z, tracing space; w unused.
        pub eye: Float4,
        /// Direction to the middle of the picture, length 1; w unused.
        pub forward: Float4,
        /// Half the picture's width at distance 1, to the right; w unused.
        pub right: Float4,
        /// Half the picture's height at distance 1, upwards; w unused.
        pub up: Float4,
        /// Pixels a row.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// Samples per pixel.
        pub sample_count: u32,
        /// Longest chain of rays, the camera ray counted as 1.
        pub max_depth: u32,
        /// A secondary ray whose weight is below this in every channel is not cast.
        pub kill_weight: f32,
        /// 2 / width; for rays through corners 2 / (width - 1).
        pub pixel_width: f32,
        /// 2 / height; for rays through corners 2 / (height - 1).
        pub pixel_height: f32,
        /// 1 / sample_count.
        pub sample_weight: f32,
        /// 0, or of a list of camera rays in place of a picture how many there are. Number i, at `x + width * y` of the
        /// film, passes through the position `samples[i]`, in pixels of the picture.
        pub ray_count: u32,
        /// Side of a pixel at distance 1 in the middle of the picture.
        pub pixel_size: f32,
        /// A secondary ray of less weight lives with probability weight / this, and then weighs this; 0: all live.
        pub roulette_weight: f32,
        /// Of a part of a picture the place of its first pixel in the picture: column | row << 16.
        pub first_pixel: u32,
        /// 0, or where each sample of a pixel is an item of its own for how many of them there is room. Another kernel
        /// adds them to the pixels.
        pub samples_apart: u32,
        /// Fill the struct up to a multiple of 16 bytes.
        pub pad_x: u32,
        /// 0.
        pub pad_y: u32,
        /// 0.
        pub pad_z: u32,
    }
}

impl RenderParams {
    /// Whether rays play Russian roulette.
    pub fn plays_roulette(&self) -> bool {
        self.roulette_weight > 0.0
    }

    /// The same camera for a list of `count` rays of their own in place of a picture. The list lies in rows as long as
    /// a tile, so that work-items take it in its order, and neighbours in it run beside each other.
    #[must_use]
    pub fn of_list(self, count: u32) -> RenderParams {
        let (width, height) = (TILE_SIDE, count.div_ceil(TILE_SIDE));
        RenderParams { width, height, sample_count: 1, sample_weight: 1.0, ray_count: count, ..self }
    }

    /// The same camera for one sample of every pixel of a part of the picture, which has so many columns and rows from
    /// this one on; at most 65,535 of them lie before.
    #[must_use]
    pub fn of_part(self, place: (u32, u32), size: (u32, u32)) -> RenderParams {
        RenderParams { sample_count: 1, sample_weight: 1.0, ..self.cropped(place, size) }
    }

    /// The same camera for all samples of such a part.
    #[must_use]
    pub fn cropped(self, (x, y): (u32, u32), (width, height): (u32, u32)) -> RenderParams {
        debug_assert!(x <= 0xffff && y <= 0xffff);
        RenderParams { width, height, first_pixel: x | y << 16, ..self }
    }

    /// Of a part of a picture the column and row of its first pixel.
    pub fn place(&self) -> (u32, u32) {
        (self.first_pixel & 0xffff, self.first_pixel >> 16)
    }

    /// Width and height of the film: of a list one row.
    pub fn film_size(&self) -> (u32, u32) {
        if self.ray_count == 0 { (self.width, self.height) } else { (self.ray_count, 1) }
    }

    /// Values of the film.
    pub fn film_len(&self) -> usize {
        let (width, height) = self.film_size();
        width as usize * height as usize
    }
}

/// Every shared struct, in the order in which `cl/shared/types.cl` defines them.
pub const SHARED_STRUCTS: [StructLayout; 17] = [
    TraceRay::LAYOUT,
    Hit::LAYOUT,
    SurfaceHit::LAYOUT,
    KdNode::LAYOUT,
    Shading::LAYOUT,
    Material::LAYOUT,
    Light::LAYOUT,
    TextureInfo::LAYOUT,
    CameraSample::LAYOUT,
    SceneParams::LAYOUT,
    RenderParams::LAYOUT,
    WavefrontSlot::LAYOUT,
    WaitingRay::LAYOUT,
    WavefrontSurface::LAYOUT,
    WavefrontYield::LAYOUT,
    WavefrontShadow::LAYOUT,
    TextureRequest::LAYOUT,
];

/// The text of `cl/shared/types.cl`.
pub fn types_cl() -> String {
    let mut text = String::from(
        "// GENERATED from src/shared.rs by `UPDATE=1 cargo test --test device layout`; do not edit.\n\
         // The structs that host and kernels share; documentation is in src/shared.rs and src/shared/.\n",
    );
    for layout in SHARED_STRUCTS {
        text += &format!("\n{}", layout.cl_typedef());
    }
    text
}

/// The constants that are no arithmetic's.
const RECORDS: [ConstantGroup; 5] = [RECORDS_OF_NODES, RECORDS_OF_INSTANCES, KINDS, PICTURES, QUEUES];

/// The text of `cl/shared/constants.cl`.
pub fn constants_cl() -> String {
    let mut text = String::from(
        "// GENERATED from src/bounds.rs and src/shared/ by `UPDATE=1 cargo test --test device layout`; do not edit.\n\
         // The constants that host and kernels share; the rest of their documentation is there.\n",
    );
    let bounds = [ROUNDING_BOUNDS, SPHERE_BOUNDS, SLAB_BOUNDS, DISTANCE_BOUNDS];
    for group in RECORDS.iter().chain(&bounds).chain(&constants::ARITHMETIC) {
        text += &format!("\n{}", group.cl_definitions());
    }
    text += "\n// Counters of rays and of work, and what a scene needs of kernels.\n";
    for (index, name) in COUNTER_NAMES.iter().enumerate() {
        text += &format!("#define COUNT_{name} {index}u\n");
    }
    for &counter in WorkCounter::ALL {
        text += &format!("#define WORK_{} {}u\n", counter.key().to_uppercase(), counter as u32);
    }
    for &feature in Feature::ALL {
        text += &format!("#define {} {}u\n", feature.cl_name(), feature.bit());
    }
    text
}
