//! Packs a scene and its tree into the flat arrays that the kernels and the scalar twin read: one packing for both.

mod arrangement;
mod instances;
mod memory;
mod shading;
mod texture_levels;
mod textures;
mod transforms;

pub use arrangement::{Arrangement, CONSTANT_BYTES, CONSTANT_NODES};
pub use transforms::triangle_transform;

use crate::accel::{
    Aabb, BuildOptions, Padding, Structure, build_boxes, build_bvh, build_grid_within, build_kd_tree_within,
    build_octree_within, build_spheres, link_leaves, near_reach, pack_bvh2, pack_bvh8, pack_kd_leaves, reorder,
};
use crate::bounds::{padding_of_boxes, padding_within};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::features::Features;
use crate::io::film::SRGB_TO_LINEAR;
use crate::layout::Float4;
use crate::options::{Accel, Intersector, Memory, NodeOrder, PacketSize, TextureFilter, TraceOptions, Traversal};
use crate::scene::{Camera, PictureDefaults, Samples, Scene};
use crate::shared::Feature;
use crate::shared::{
    BVH_NODE_RECORDS, CameraSample, KD_LEAF, KdNode, Light, MAX_RADIANCE, Material, RenderParams, SceneParams, Shading,
    TextureInfo,
};
use glam::{DVec3, Vec3};
use instances::pack_instances;
use memory::StructureBudget;
use rayon::prelude::*;
use shading::{ShadingArrays, shading_of};
use std::borrow::Cow;
use std::time::Instant;

const _: () = assert!(
    MAX_RADIANCE * PictureDefaults::MAX_SAMPLES as f32 * (2 * PictureDefaults::MAX_DEPTH) as f32 <= f32::MAX,
    "the brightest pixel must be a number, with a factor of 2 for the weights' roundings"
);

/// A scene ready to be traced, in tracing space (see [`crate::shared`]).
#[derive(Debug, Clone)]
pub struct SceneBuffers {
    /// What the kernels need to know of the scene as a whole.
    pub params: SceneParams,
    /// kd-tree nodes in the chosen order, the root first; one unused leaf for brute force; for other structures see their files in
    /// `cl/traverse/`.
    pub nodes: Vec<KdNode>,
    /// Triangle numbers: the leaves' ranges, every triangle that can be hit at least once; for brute force exactly once.
    pub references: Vec<u32>,
    /// Three for each triangle, w = 0; zeros for a triangle that cannot be hit. With [`Accel::Instances`] those of the objects, each of
    /// which is there once, in its own coordinates.
    pub vertices: Vec<Float4>,
    /// Boxes, spheres, links, packets of triangles or instances of the structure; empty for those that need none.
    pub bounds: Vec<Float4>,
    /// Precomputed data of triangles, for the triangle tests that want it; else empty.
    pub transforms: Vec<Float4>,
    /// One for each triangle, of each object once like `vertices`.
    pub shading: Vec<Shading>,
    /// The materials that triangles have.
    pub materials: Vec<Material>,
    /// The lights that shine.
    pub lights: Vec<Light>,
    /// Where each texture lies in `texels`.
    pub textures: Vec<TextureInfo>,
    /// Texels of all textures: R in bits 0-7, G 8-15, B 16-23, A 24-31; sRGB.
    pub texels: Vec<u32>,
    /// Linear value of each 8-bit sRGB code.
    pub srgb_to_linear: Vec<f32>,
    /// Largest radiance that one surface can send along a ray from the lights, per unit of weight; infinite when there is no bound.
    pub brightest: f32,
    /// What the scene needs of the kernels that shade.
    pub features: Features,
    /// The most entries that a traversal's stack of nodes has: the depth of the tree, or its limit; 1 without such a stack.
    pub stack_entries: u32,
    /// What the tree was built with.
    pub build_options: BuildOptions,
    /// Seconds the structure took to build.
    pub build_s: f64,
    made_for: MadeFor,
    /// The triangles in world units, where those in tracing space have lost bits.
    given_vertices: Option<Vec<[Vec3; 3]>>,
    triangle_count: usize,
}

/// What the arrays depend on of the options: kernels would read beyond the ends of those for others.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MadeFor {
    accel: Accel,
    has_ropes: bool,
    has_packets: bool,
    has_transforms: bool,
    has_texture_levels: bool,
}

impl MadeFor {
    fn of(options: &TraceOptions) -> MadeFor {
        let is_kd = options.accel == Accel::Kd;
        MadeFor {
            accel: options.accel,
            has_ropes: is_kd && options.traversal == Traversal::Ropes,
            has_packets: is_kd && options.packet_size != PacketSize::One,
            has_transforms: options.intersector.needs_transforms(),
            has_texture_levels: options.texture_filter == TextureFilter::Footprint,
        }
    }
}

/// Tracing space has its largest coordinate in [1, 2): products of three coordinates of a scene, and of triangles a billion times
/// smaller than it, stay far from both ends of float32, and a ray may start 2^126 times its size away. Being relative to the scene,
/// it also makes every result independent of the scene's unit when that changes by a power of two.
const LARGEST_COORDINATE_EXPONENT: i32 = 0;
const LARGEST_SCALE_EXPONENT: i32 = 100;

/// The power of two that takes `bounds` to tracing space.
fn tracing_scale(low: Vec3, high: Vec3) -> f32 {
    let largest = low.abs().max(high.abs()).max_element();
    if largest == 0.0 {
        return 1.0;
    }
    let exponent = f64::from(largest).log2().floor() as i32;
    // t changes by this factor, too: the largest and smallest scenes keep some distance to 1, so that it stays a normal float.
    2f32.powi((LARGEST_COORDINATE_EXPONENT - exponent).clamp(-LARGEST_SCALE_EXPONENT, LARGEST_SCALE_EXPONENT))
}

/// The triangles in world units where one of them loses bits on its way to tracing space; zeros for those that cannot be hit. Only numbers
/// that become smaller can.
fn vertices_that_lose_bits(scene: &Scene, scale: f32) -> Option<Vec<[Vec3; 3]>> {
    if scale >= 1.0 {
        return None;
    }
    let loses = |vertices: [Vec3; 3]| vertices.into_iter().any(|p| p * scale / scale != p);
    let all = || (0..scene.triangle_count()).into_par_iter();
    let is_hittable = |i: usize| scene.drop_reason(i).is_none();
    let given = |i: usize| if is_hittable(i) { scene.vertices(i) } else { [Vec3::ZERO; 3] };
    all().any(|i| loses(scene.vertices(i)) && is_hittable(i)).then(|| all().map(given).collect())
}

/// The power of two that takes a scene to tracing space.
pub fn scale_of(scene: &Scene) -> f32 {
    let (low, high) = scene.bounds().unwrap_or_default();
    tracing_scale(low, high)
}

impl SceneBuffers {
    /// Builds the structure that `options` asks for and packs everything, in what memory there is
    /// ([`MemoryBudget::available`]).
    ///
    /// # Errors
    /// As [`SceneBuffers::within`].
    pub fn new(scene: &Scene, options: &TraceOptions) -> Result<SceneBuffers> {
        Self::within(scene, options, &MemoryBudget::available())
    }

    /// Builds the structure that `options` asks for and packs everything, unless that takes more memory than `budget`
    /// has.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory) when it does, before anything is built;
    /// [`Scene`](crate::Error::Scene) when an array or a hierarchy of boxes outgrows its indices, as
    /// [`Scene::check_values`], or when a light is too far away to be a point; [`Option`](crate::Error::Option) when
    /// the options are out of range.
    pub fn within(scene: &Scene, options: &TraceOptions, budget: &MemoryBudget) -> Result<SceneBuffers> {
        options.validate()?;
        scene.check_values()?;
        let memory = StructureBudget::for_scene(scene, options, budget)?;
        let is_flat = options.accel != Accel::Instances;
        let flat = if is_flat { scene.flattened()? } else { Cow::Borrowed(scene) };
        let scene = flat.as_ref();
        let primitives = if is_flat { scene.hittable() } else { Vec::new() };
        // Without a triangle that can be hit every ray misses; any box will do.
        let bounds = if is_flat { scene.bounds_of(&primitives) } else { scene.bounds() };
        let (low, high) = bounds.unwrap_or_default();
        let scale = tracing_scale(low, high);
        let given_vertices = vertices_that_lose_bits(scene, scale);
        let used = scene.used_materials();
        let mut triangles = Vec::new();
        if is_flat {
            triangles.resize(scene.triangles.len(), [Vec3::ZERO; 3]);
            // No coordinate is a negative zero: the sum of one and zero is not.
            primitives
                .iter()
                .for_each(|&i| triangles[i as usize] = scene.vertices(i as usize).map(|p| p * scale + 0.0));
        }

        let start = Instant::now();
        let build_options = BuildOptions::of(options, if is_flat { primitives.len() } else { scene.triangle_count() });
        let mut stack_entries = match (options.accel, options.traversal) {
            (Accel::Octree, _) | (Accel::Kd, Traversal::Stack) => build_options.max_depth.max(1),
            _ => 1,
        };
        let top = if options.memory == Memory::Constant { CONSTANT_NODES } else { 0 };
        let bounding_box = Aabb { low: low * scale, high: high * scale };
        let near_reach = near_reach(&triangles, &primitives, options);
        let padding = match near_reach {
            0.0 => padding_of_boxes(bounding_box.low, bounding_box.high),
            reach => padding_within(reach),
        };
        let mut instances = None;
        let Structure { nodes, references, bounds } = match options.accel {
            Accel::Instances => {
                let packed = pack_instances(scene, &used, scale, &build_options)?;
                stack_entries = packed.stack_entries;
                instances = Some((packed.vertices, packed.shading, packed.instance_count));
                packed.structure
            }
            Accel::Brute => {
                let leaf = KdNode { flags: KD_LEAF, left: 0, right: primitives.len() as u32, split: 0.0 };
                Structure { nodes: vec![leaf], references: primitives, bounds: Vec::new() }
            }
            Accel::Kd => {
                let limit = memory.growth_limit();
                let mut tree = build_kd_tree_within(options.build, &triangles, &primitives, &build_options, &limit);
                memory.check_growth(&limit)?;
                if top > 0 || options.node_order != NodeOrder::Preorder {
                    tree.nodes = reorder(&tree.nodes, options.node_order, top);
                }
                let bounds = match (options.traversal, options.packet_size) {
                    (Traversal::Ropes, _) => link_leaves(&mut tree.nodes, &tree.bounds),
                    (_, PacketSize::Sixteen) => pack_kd_leaves(&mut tree, &triangles),
                    (_, PacketSize::One) => Vec::new(),
                };
                Structure { nodes: tree.nodes, references: tree.references, bounds }
            }
            Accel::Bvh2 => {
                let tree = build_bvh(&triangles, &primitives, &build_options)?;
                stack_entries = tree.depth() + 1; // the last entry says that there are no more
                pack_bvh2(&tree, top / BVH_NODE_RECORDS as usize, Padding { everywhere: padding, near_reach })?
            }
            Accel::Bvh8 => {
                let tree = build_bvh(&triangles, &primitives, &build_options)?;
                let packed = pack_bvh8(&tree, &triangles, Padding { everywhere: 0.0, near_reach })?;
                stack_entries = packed.stack_entries;
                packed.structure
            }
            Accel::Grid => {
                let check = |bytes| memory.check_structure(bytes);
                build_grid_within(&triangles, &primitives, bounding_box, options.grid_size, near_reach, &check)?
            }
            Accel::Octree => {
                let limit = memory.growth_limit();
                let octree =
                    build_octree_within(&triangles, &primitives, bounding_box, &build_options, near_reach, &limit);
                memory.check_growth(&limit)?;
                octree
            }
            Accel::Boxes => build_boxes(&triangles, &primitives, options.leaf_size, near_reach),
            Accel::Spheres => build_spheres(&triangles, &primitives, options.leaf_size, near_reach),
        };
        let build_s = start.elapsed().as_secs_f64();

        let (vertices, shading, reference_count) = instances.unwrap_or_else(|| {
            let vertices = triangles.iter().flatten().map(|&p| Float4::new(p, 0.0)).collect();
            (vertices, shading_of(scene, &used), references.len() as u32)
        });
        let ShadingArrays { materials, lights, textures, texels, brightest } =
            ShadingArrays::new(scene, &used, scale, options.texture_filter)?;
        let features = Features::of_materials(scene, &used);
        let mut made_for = MadeFor::of(options);
        made_for.has_texture_levels |= !features.has(Feature::ImageTextures);
        Ok(SceneBuffers {
            params: SceneParams {
                low: Float4::new(low * scale, padding),
                high: Float4::new(high * scale, near_reach),
                background_bottom: Float4::new(scene.background.bottom, 0.0),
                background_top: Float4::new(scene.background.top, 0.0),
                reference_count,
                light_count: lights.len() as u32,
                has_transparent: u32::from(features.has(Feature::Transparency)),
                scale,
            },
            nodes,
            references,
            vertices,
            bounds,
            transforms: match options.intersector.needs_transforms() {
                true => triangles.iter().flat_map(|&triangle| triangle_transform(triangle)).collect(),
                false => Vec::new(),
            },
            shading,
            materials,
            lights,
            textures,
            texels,
            srgb_to_linear: SRGB_TO_LINEAR.to_vec(),
            brightest,
            features,
            stack_entries,
            build_options,
            build_s,
            made_for,
            given_vertices,
            triangle_count: scene.triangle_count(),
        })
    }

    /// Whether tracing space holds all vertices exactly.
    pub(crate) fn keeps_vertices(&self) -> bool {
        self.given_vertices.is_none()
    }

    /// The triangles in world units, where those in tracing space have lost bits.
    pub(crate) fn given_vertices(&self) -> Option<&[[Vec3; 3]]> {
        self.given_vertices.as_deref()
    }

    /// Triangles that hits can name, each of an instance counted for itself.
    pub(crate) fn triangle_count(&self) -> usize {
        self.triangle_count
    }

    /// Whether vertices and shading data are those of objects, to be placed by instances.
    pub(crate) fn has_instances(&self) -> bool {
        self.made_for.accel == Accel::Instances
    }

    /// Checks that `options` can be traced with: that they ask for the structure that was built, and for no array that it was built
    /// without.
    ///
    /// # Errors
    /// [`Error::Option`].
    pub fn check_made_for(&self, options: &TraceOptions) -> Result<()> {
        let (made, asked) = (self.made_for, MadeFor::of(options));
        let missing = [
            (Accel::OPTION, made.accel == asked.accel, options.accel.name()),
            (Traversal::OPTION, made.has_ropes || !asked.has_ropes, options.traversal.name()),
            (PacketSize::OPTION, made.has_packets || !asked.has_packets, options.packet_size.name()),
            (Intersector::OPTION, made.has_transforms || !asked.has_transforms, options.intersector.name()),
            (
                TextureFilter::OPTION,
                made.has_texture_levels || !asked.has_texture_levels,
                options.texture_filter.name(),
            ),
        ];
        match missing.into_iter().find(|(_, is_there, _)| !is_there) {
            None => Ok(()),
            Some((option, _, value)) => {
                let reason = format!("{value}: the scene was packed for another one; pack it with the same options");
                Err(Error::option(option, reason))
            }
        }
    }

    /// The picture's parameters for `camera`; `size` must be one that [`Samples::check`] accepts.
    ///
    /// `kill_weight`: secondary rays of less weight are not cast; `None` chooses the largest weight that cannot change an 8-bit
    /// sRGB pixel (half a step at black, where steps are smallest) however bright the scene is, and of [`Samples::Error`] the one that
    /// cannot change it by half of that error.
    pub fn render_params(
        &self,
        camera: &Camera,
        size: (u32, u32),
        samples: Samples,
        max_depth: u32,
        kill_weight: Option<f32>,
    ) -> RenderParams {
        const HALF_STEP_AT_BLACK: f32 = 0.5 / 255.0 / 12.92; // 12.92: slope of the sRGB curve at black
        let steps = match samples {
            Samples::Error(error) => error,
            _ => 1.0,
        };
        let eye: DVec3 = camera.eye.into();
        let forward = (DVec3::from(camera.target) - eye).normalize_or(DVec3::NEG_Z);
        let right = forward.cross(camera.up.into()).normalize_or(forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let half_height = (f64::from(camera.fov_degrees).to_radians() / 2.0).tan();
        let half_width = half_height * samples.aspect(size);
        let (width, height) = size;
        RenderParams {
            eye: Float4::new(camera.eye * self.params.scale, 0.0),
            forward: Float4::new(forward.as_vec3(), 0.0),
            right: Float4::new((right * half_width).as_vec3(), 0.0),
            up: Float4::new((up * half_height).as_vec3(), 0.0),
            width,
            height,
            sample_count: samples.per_pixel(),
            max_depth,
            kill_weight: kill_weight.unwrap_or(steps * HALF_STEP_AT_BLACK / self.brightest.max(1.0)).max(0.0),
            pixel_width: 2.0 / samples.intervals(width) as f32,
            pixel_height: 2.0 / samples.intervals(height) as f32,
            sample_weight: 1.0 / samples.per_pixel() as f32,
            ray_count: 0,
            pixel_size: {
                let side = |half: f64, pixels| 2.0 * half / f64::from(samples.intervals(pixels));
                (side(half_width, width) * side(half_height, height)).sqrt() as f32
            },
            pad0: 0,
            pad1: 0,
        }
    }
}

/// Positions of the samples in a pixel, each in [0, 1)^2: the Hammersley set, shifted so that a single sample is the centre; or
/// the pixel's upper left corner. Of [`Samples::Error`] the centre.
pub fn sample_positions(samples: Samples) -> Vec<CameraSample> {
    if samples == Samples::Corners {
        return vec![CameraSample { x: 0.0, y: 0.0, footprint: 1.0 }];
    }
    let count = samples.per_pixel();
    let footprint = 1.0 / (count as f32).sqrt();
    (0..count)
        .map(|i| {
            let x = (f64::from(i) + 0.5) / f64::from(count);
            let y = f64::from(i.reverse_bits()) / 2f64.powi(32) + 0.5 / f64::from(count.next_power_of_two());
            CameraSample { x: x as f32, y: y as f32, footprint }
        })
        .collect()
}
