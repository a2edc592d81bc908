//! Packs a scene and its tree into the flat arrays that the kernels and the scalar twin read: one packing for both.

mod arrangement;
mod instances;
mod memory;
mod points;
mod shading;
mod space;
mod structures;
mod texture_levels;
mod textures;
mod transforms;

pub use arrangement::{Arrangement, CONSTANT_BYTES, CONSTANT_NODES};
pub use points::PointScene;
pub(crate) use points::check_memory as check_point_memory;
pub use space::scale_of;
pub use transforms::triangle_transform;

use crate::accel::{BuildOptions, KeptBvh, SplitsChosen};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::features::Features;
use crate::io::film::SRGB_TO_LINEAR;
use crate::layout::Float4;
use crate::options::{Intersector, PacketSize, StructureKind, TextureFilter, TraceOptions, Traversal};
use crate::scene::{self, Camera, MaterialId, PictureDefaults, Samples, Scene, Sky};
use crate::shared::{
    CameraSample, Feature, KdNode, Light, MAX_RADIANCE, Material, RenderParams, SceneParams, Shading, TextureInfo,
};
use glam::{DVec3, Vec3};
use memory::StructureBudget;
use shading::{ShadingArrays, pack_colour, pack_direction, pack_light, shading_of};
use space::{TracingSpace, vertices_that_lose_bits};
use std::borrow::Cow;
use std::time::Instant;
use structures::{PackedObjects, PackedStructure, StructureInput};

const _: () = assert!(
    MAX_RADIANCE * PictureDefaults::MAX_SAMPLES as f32 * (2 * PictureDefaults::MAX_DEPTH) as f32 <= f32::MAX,
    "the brightest pixel must be a number, with a factor of 2 for the weights' roundings"
);

/// A scene ready to be traced, in tracing space (see [`crate::low_level::shared`]).
#[derive(Debug, Clone)]
pub struct SceneBuffers {
    /// What the kernels need to know of the scene as a whole.
    pub params: SceneParams,
    /// kd-tree nodes in the chosen order, the root first; one unused leaf for brute force; for other structures see
    /// their files in `cl/traverse/`.
    pub nodes: Vec<KdNode>,
    /// Triangle numbers: the leaves' ranges, every triangle that can be hit at least once; for brute force exactly
    /// once.
    pub references: Vec<u32>,
    /// Three for each triangle, w = 0; zeros for a triangle that cannot be hit. With [`StructureKind::Instances`] those
    /// of the objects, each of which is there once, in its own coordinates.
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
    /// Largest radiance that one surface can send along a ray from the lights, per unit of weight; infinite when there
    /// is no bound.
    pub brightest: f32,
    /// What the scene needs of the kernels that shade.
    pub features: Features,
    /// The most entries that a traversal's stack of nodes has: the depth of the tree, or its limit; 1 without such a
    /// stack.
    pub stack_entries: u32,
    /// What the tree was built with.
    pub build_options: BuildOptions,
    /// What [`SpatialSplits::Auto`](crate::options::SpatialSplits::Auto) has chosen, where it was asked for.
    pub splits_chosen: Option<SplitsChosen>,
    /// The scene's materials that there are in `materials`, by their packed numbers.
    pub used_materials: Vec<MaterialId>,
    /// Seconds the structure took to build.
    pub build_s: f64,
    made_for: MadeFor,
    /// The triangles in world units, where those in tracing space have lost bits.
    given_vertices: Option<Vec<[Vec3; 3]>>,
    /// The triangles of a scene without instances that cannot be hit, world units; those of objects are in `vertices`.
    left_out: Vec<(u32, [Vec3; 3])>,
    triangle_count: usize,
}

/// What the arrays depend on of the options: kernels would read beyond the ends of those for others.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MadeFor {
    accel: StructureKind,
    has_ropes: bool,
    has_packets: bool,
    has_transforms: bool,
    has_texture_levels: bool,
}

/// What of a packed scene depends on the light that goes with the camera.
pub(crate) struct Relit {
    light: Light,
    sky_up: Float4,
    features: Features,
}

impl Relit {
    /// Whether `buffers` are lit so.
    pub fn is_of(&self, buffers: &SceneBuffers) -> bool {
        buffers.lights == [self.light] && buffers.params.sky_up == self.sky_up && buffers.features == self.features
    }

    /// Lights `buffers` so.
    pub fn replace(self, buffers: &mut SceneBuffers) {
        (buffers.lights, buffers.features) = (vec![self.light], self.features);
        buffers.params.sky_up = self.sky_up;
    }
}

/// What the kernels need to know of the scene as a whole.
fn pack_params(
    scene: &Scene,
    StructureInput { space, padding, near_reach, .. }: &StructureInput,
    (reference_count, light_count): (u32, usize),
    features: Features,
) -> SceneParams {
    let sky = scene.sky.unwrap_or_default();
    SceneParams {
        low: Float4::new(space.bounds.low, *padding),
        high: Float4::new(space.bounds.high, *near_reach),
        background_bottom: Float4::new(scene.background.bottom, 0.0),
        background_top: Float4::new(scene.background.top, 0.0),
        sky_bottom: pack_colour(sky.bottom),
        sky_top: pack_colour(sky.top),
        sky_viewer: pack_colour(sky.viewer),
        sky_up: pack_direction(sky.up),
        reference_count,
        light_count: light_count as u32,
        has_transparent: u32::from(features.has(Feature::Transparency)),
        scale: space.scale,
    }
}

impl MadeFor {
    fn of(options: &TraceOptions) -> MadeFor {
        let is_kd = options.kind() == StructureKind::Kd;
        MadeFor {
            accel: options.kind(),
            has_ropes: is_kd && options.kd().traversal == Traversal::Ropes,
            has_packets: is_kd && options.packet_size != PacketSize::One,
            has_transforms: options.intersector.needs_transforms(),
            has_texture_levels: options.picture.texture_filter == TextureFilter::Footprint,
        }
    }
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
        Self::made(None, scene, options, budget)
    }

    /// As [`SceneBuffers::within`], of a scene that moves: `kept` is what the last call has left, and hierarchies
    /// of boxes are refitted where that is as good as building them.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn after(
        kept: &mut Vec<KeptBvh>,
        scene: &Scene,
        options: &TraceOptions,
        budget: &MemoryBudget,
    ) -> Result<SceneBuffers> {
        Self::made(Some(kept), scene, options, budget)
    }

    fn made(
        kept: Option<&mut Vec<KeptBvh>>,
        scene: &Scene,
        options: &TraceOptions,
        budget: &MemoryBudget,
    ) -> Result<SceneBuffers> {
        options.validate()?;
        scene.check_values()?;
        let memory = StructureBudget::for_scene(scene, options, budget)?;
        let is_flat = options.kind() != StructureKind::Instances;
        let flat = if is_flat { scene.flattened()? } else { Cow::Borrowed(scene) };
        let scene = flat.as_ref();
        let space = if is_flat { TracingSpace::of_triangles(scene) } else { TracingSpace::of_objects(scene) };
        let given_vertices = vertices_that_lose_bits(scene, space.scale);
        let used = scene.used_materials();

        let start = Instant::now();
        let traced_count = if is_flat { space.primitives.len() } else { scene.triangle_count() };
        let build_options = BuildOptions::of(options, traced_count);
        let input = StructureInput::new(options, &build_options, &space, &memory);
        let PackedStructure { structure, stack_entries, objects, splits_chosen } = input.pack(scene, &used, kept)?;
        let build_s = start.elapsed().as_secs_f64();

        let PackedObjects { vertices, shading, reference_count } = objects.unwrap_or_else(|| PackedObjects {
            vertices: space.triangles.iter().flatten().map(|&p| Float4::new(p, 0.0)).collect(),
            shading: shading_of(scene, &used),
            reference_count: structure.references.len() as u32,
        });
        let transforms = match options.intersector.needs_transforms() {
            true => space.triangles.iter().flat_map(|&triangle| triangle_transform(triangle)).collect(),
            false => Vec::new(),
        };
        let left_out = match is_flat {
            true => points::left_out(scene.triangle_count(), &space.primitives, |i| scene.vertices(i)),
            false => Vec::new(),
        };
        let ShadingArrays { materials, lights, textures, texels, brightest } =
            ShadingArrays::new(scene, &used, space.scale, options.picture.texture_filter)?;
        let features = Features::of_materials(scene, &used);
        let mut made_for = MadeFor::of(options);
        made_for.has_texture_levels |= !features.has(Feature::ImageTextures);
        Ok(SceneBuffers {
            params: pack_params(scene, &input, (reference_count, lights.len()), features),
            nodes: structure.nodes,
            references: structure.references,
            vertices,
            bounds: structure.bounds,
            transforms,
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
            splits_chosen,
            used_materials: used,
            build_s,
            made_for,
            given_vertices,
            left_out,
            triangle_count: scene.triangle_count(),
        })
    }

    /// Light number 0 as the kernels read it.
    ///
    /// # Errors
    /// [`Error::Scene`] when it is too far away to be a point.
    pub fn packed_light(&self, light: &scene::Light) -> Result<Light> {
        pack_light(0, light, self.params.scale)
    }

    /// The scene in the light of this one lamp and a sky as bright as it has, where that is up.
    ///
    /// # Errors
    /// As [`SceneBuffers::packed_light`].
    pub(crate) fn relit(&self, lamp: &scene::Light, sky: Option<Sky>) -> Result<Relit> {
        Ok(Relit {
            light: self.packed_light(lamp)?,
            sky_up: pack_direction(sky.unwrap_or_default().up),
            features: self.features.with_lights([lamp].into_iter()),
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

    /// The vertices of a triangle that cannot be hit, world units; none of one that can, nor with instances.
    pub(crate) fn left_out(&self, primitive: u32) -> Option<[Vec3; 3]> {
        let place = self.left_out.binary_search_by_key(&primitive, |(number, _)| *number);
        place.ok().map(|place| self.left_out[place].1)
    }

    /// Triangles that hits can name, each of an instance counted for itself.
    pub(crate) fn triangle_count(&self) -> usize {
        self.triangle_count
    }

    /// Whether vertices and shading data are those of objects, to be placed by instances.
    pub(crate) fn has_instances(&self) -> bool {
        self.made_for.accel == StructureKind::Instances
    }

    /// Checks that `options` can be traced with: that they ask for the structure that was built, and for no array that
    /// it was built without.
    ///
    /// # Errors
    /// [`Error::Option`].
    pub fn check_made_for(&self, options: &TraceOptions) -> Result<()> {
        let (made, asked) = (self.made_for, MadeFor::of(options));
        let missing = [
            (StructureKind::OPTION, made.accel == asked.accel, options.kind().name()),
            (Traversal::OPTION, made.has_ropes || !asked.has_ropes, options.kd().traversal.name()),
            (PacketSize::OPTION, made.has_packets || !asked.has_packets, options.packet_size.name()),
            (Intersector::OPTION, made.has_transforms || !asked.has_transforms, options.intersector.name()),
            (
                TextureFilter::OPTION,
                made.has_texture_levels || !asked.has_texture_levels,
                options.picture.texture_filter.name(),
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
    /// `kill_weight`: secondary rays of less weight are not cast; `None` chooses the largest weight that cannot change
    /// an 8-bit sRGB pixel (half a step at black, where steps are smallest) however bright the scene is, and of
    /// [`Samples::Error`] the one that cannot change it by half of that error.
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
            pixel_size: {
                let side = |half: f64, pixels| 2.0 * half / f64::from(samples.intervals(pixels));
                (side(half_width, width) * side(half_height, height)).sqrt() as f32
            },
            ..RenderParams::default()
        }
    }
}

/// Positions of the samples in a pixel, each in [0, 1)^2: the Hammersley set, shifted so that a single sample is the
/// centre; or the pixel's upper left corner. Of [`Samples::Error`] the centre.
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
