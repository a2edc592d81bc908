//! What a picture knows beside light: depth, normals, numbers of primitives and the like, one value a pixel.
//!
//! Most are of the first hit on the ray through the middle of a pixel (of a picture through corners: the pixel's
//! corner), whatever samples the picture has. These rays are a batch as any other; the hits of an exact tracer are the
//! same bits on every device, and all else is computed of them on the host (`reference/first_hits.rs`). Two tell how
//! the pixels were sampled. Whoever asks for no layer pays nothing.
//!
//! Bad at: edges. A mean of depths or numbers of what meets in a pixel would be neither, so that layers have no smooth
//! ones.

mod colours;

pub use colours::{Colours, false_colours};

use crate::budget::{DecidedBy, Need, try_repeat};
use crate::error::{Error, Result};
use crate::io::planes::{Plane, PlaneGroup};
use crate::names::names;
use crate::pack::{SceneBuffers, sample_positions};
use crate::parallel;
use crate::reference::extreme::TracingBatch;
use crate::reference::first_hits::{CameraRays, FirstHit, directions_of, first_hits};
use crate::renderer::{Crop, Picture};
use crate::scene::{Numbering, Samples};
use crate::tracer::{Backend, Progress, Sampling};
use glam::Vec3;
use std::ops::Range;

names! {
    /// What can be told of a pixel, beside its light: most of it of the first hit on the ray through its middle.
    pub enum Layer ("layers") {
        /// Distance along the view, world units; infinite where nothing is hit.
        Depth = "depth",
        /// Where it is, world units.
        Position = "position",
        /// Unit normal, interpolated where the mesh has normals, towards the camera's side.
        Normal = "normal",
        /// Unit normal of the triangle, towards the camera's side.
        GeometricNormal = "geometric-normal",
        /// Diffuse colour, texture included, linear.
        Albedo = "albedo",
        /// Texture coordinates.
        Uv = "uv",
        /// Number of the triangle, as in batches of rays.
        Primitive = "primitive",
        /// Number of the object in the scene file.
        Object = "object",
        /// Number of the instance, where it is of one.
        Instance = "instance",
        /// Number of the material.
        Material = "material",
        /// How many samples the pixel has; 0: it is interpolated.
        Samples = "samples",
        /// The pixel's error as estimated, in steps of 8-bit sRGB; of pictures by their error.
        Error = "error",
    }
}

impl Layer {
    /// The letters of its channels in files.
    pub fn channels(self) -> &'static [char] {
        match self {
            Layer::Depth => &['Z'],
            Layer::Position | Layer::Normal | Layer::GeometricNormal => &['X', 'Y', 'Z'],
            Layer::Albedo => &['R', 'G', 'B'],
            Layer::Uv => &['U', 'V'],
            _ => &['X'],
        }
    }

    /// Whether it tells of what is hit, and not of how the pixel was sampled.
    pub fn is_of_hit(self) -> bool {
        !matches!(self, Layer::Samples | Layer::Error)
    }

    /// Whether it has whole numbers in place of measures: where nothing is hit [`Numbering::NONE`].
    pub fn is_whole(self) -> bool {
        matches!(self, Layer::Primitive | Layer::Object | Layer::Instance | Layer::Material | Layer::Samples)
    }

    /// Channel `k` of a layer of measures.
    fn measure(self, hit: &FirstHit, k: usize) -> f32 {
        match self {
            Layer::Position => hit.position[k],
            Layer::Normal => hit.normal[k],
            Layer::GeometricNormal => hit.geometric_normal[k],
            Layer::Albedo => hit.albedo[k],
            Layer::Uv => hit.uv[k],
            _ => hit.depth,
        }
    }

    /// The number of a layer of numbers.
    fn number(self, hit: &FirstHit, numbering: &Numbering) -> u32 {
        if hit.primitive == FirstHit::NONE.primitive {
            return Numbering::NONE;
        }
        match self {
            Layer::Object => numbering.object(hit.primitive),
            Layer::Instance => numbering.instance(hit.primitive),
            Layer::Material => numbering.material(hit.material),
            _ => hit.primitive,
        }
    }
}

/// Rays of a batch: what is known of each hit, some 200 bytes with the ray, then takes less than most pictures.
const BATCH_RAYS: usize = 1 << 17;

/// Bytes that a ray of a batch takes, with its hit on the way to the host and back.
const RAY_BYTES: u64 = 256;

/// About how many bytes of the host's memory `layers` of a picture take, once more where they are written.
pub fn layers_bytes((width, height): (u32, u32), layers: &[Layer]) -> u64 {
    if layers.is_empty() {
        return 0;
    }
    let pixels = u64::from(width) * u64::from(height);
    let channels: usize = layers.iter().map(|layer| layer.channels().len()).sum();
    let batch = RAY_BYTES * pixels.min(BATCH_RAYS as u64);
    let noted = if layers.iter().all(|layer| layer.is_of_hit()) { 0 } else { size_of::<[f32; 2]>() };
    batch + pixels * (channels * size_of::<f32>() + size_of::<[f32; 3]>() + noted) as u64
}

/// Room for a layer.
fn room_for(layer: Layer, pixels: usize) -> Result<PlaneGroup> {
    let what = format!("the layer {layer} of {pixels} pixels");
    let bytes = (4 * layer.channels().len() * pixels) as u64;
    let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "lower `size`" };
    let plane = || match layer.is_whole() {
        true => try_repeat(Numbering::NONE, pixels).map(Plane::Uint),
        false => try_repeat(0.0, pixels).map(Plane::Float),
    };
    let planes = layer.channels().iter().map(|&letter| Ok((letter, plane().map_err(|_| need.refused())?)));
    Ok(PlaneGroup { name: layer.name().to_owned(), planes: planes.collect::<Result<_>>()? })
}

/// Puts into `group` what is known of the pixels from `first` on.
fn fill(group: &mut PlaneGroup, layer: Layer, first: usize, hits: &[FirstHit], numbering: &Numbering) {
    for (k, (_, plane)) in group.planes.iter_mut().enumerate() {
        match plane {
            Plane::Float(values) => {
                let values = &mut values[first..][..hits.len()];
                parallel::each_mut(values, |i, value| *value = layer.measure(&hits[i], k));
            }
            Plane::Uint(values) => {
                let values = &mut values[first..][..hits.len()];
                parallel::each_mut(values, |i, value| *value = layer.number(&hits[i], numbering));
            }
        }
    }
}

/// What a layer tells of how the pixels were sampled.
fn sampled(layer: Layer, picture: &Picture, pixels: usize, sampling: Option<&Sampling>) -> Result<PlaneGroup> {
    let mut group = room_for(layer, pixels)?;
    for (_, plane) in &mut group.planes {
        match (plane, sampling) {
            (Plane::Uint(values), Some(sampling)) => values.copy_from_slice(&sampling.samples),
            (Plane::Uint(_), None) if matches!(picture.samples, Samples::Error(_)) => return Err(not_noted()),
            (Plane::Uint(values), None) => values.fill(picture.samples.per_pixel()),
            (Plane::Float(values), Some(sampling)) => values.copy_from_slice(&sampling.errors),
            (Plane::Float(_), None) => return Err(no_estimate()),
        }
    }
    Ok(group)
}

fn not_noted() -> Error {
    let message = "samples: of a picture by its `error` they must be noted while it is rendered; leave it out";
    Error::option(Layer::OPTION, message)
}

fn no_estimate() -> Error {
    let message = "error: only a picture by its `error` has an estimate of it, not one of `samples`; leave it out";
    Error::option(Layer::OPTION, message)
}

/// The `layers` of a picture of the scene that `tracer` was opened with, or of a `part` of it. `numbering`: that of the
/// scene; `sampling`: how a picture by its error was sampled.
///
/// # Errors
/// The picture has no such samples or no such part, a layer is asked for twice, one of `sampling` without it, or the
/// device failed or cannot hold a batch of its rays.
pub fn trace_layers(
    tracer: &mut dyn Backend,
    (buffers, numbering): (&SceneBuffers, &Numbering),
    picture: &Picture,
    part: Option<Crop>,
    layers: &[Layer],
    sampling: Option<&Sampling>,
    progress: Progress,
) -> Result<Vec<PlaneGroup>> {
    check_layers(layers, picture.samples)?;
    let rays = PixelRays::new(buffers, picture, part)?;
    let pixels = rays.count();
    let group = |&layer: &Layer| match layer.is_of_hit() {
        true => room_for(layer, pixels),
        false => sampled(layer, picture, pixels, sampling),
    };
    let mut groups = layers.iter().map(group).collect::<Result<Vec<_>>>()?;
    let traced = if layers.iter().any(|layer| layer.is_of_hit()) { pixels } else { 0 };
    for first in (0..traced).step_by(BATCH_RAYS) {
        let end = pixels.min(first + BATCH_RAYS);
        let part_done = |done: f64| progress((first as f64 + done * (end - first) as f64) / pixels as f64);
        let wants_albedo = layers.contains(&Layer::Albedo);
        let found = hits_of(tracer, buffers, &rays, first..end, wants_albedo, &part_done)?;
        for (group, &layer) in groups.iter_mut().zip(layers).filter(|(_, layer)| layer.is_of_hit()) {
            fill(group, layer, first, &found, numbering);
        }
    }
    Ok(groups)
}

/// Checks that no layer is asked for twice, and that a picture of these samples has all of them.
///
/// # Errors
/// [`Error::Option`].
pub fn check_layers(layers: &[Layer], samples: Samples) -> Result<()> {
    if layers.contains(&Layer::Error) && !matches!(samples, Samples::Error(_)) {
        return Err(no_estimate());
    }
    let twice = layers.iter().enumerate().find(|(i, layer)| layers[..*i].contains(layer));
    match twice {
        Some((_, layer)) => Err(Error::option(Layer::OPTION, format!("{layer} is there twice; leave one out"))),
        None => Ok(()),
    }
}

/// Pixels that one thread looks at.
const CHUNK: usize = 1024;

/// The rays of a picture that its layers are of, one a pixel, row by row: through its middle, of a picture through
/// corners through its corner. All that tells what a pixel shows has these rays.
#[derive(Debug, Clone, Copy)]
pub struct PixelRays {
    /// World units.
    eye: Vec3,
    rays: CameraRays,
}

impl PixelRays {
    /// Those of `picture`, or of a `part` of it.
    ///
    /// # Errors
    /// [`Error::Option`] where the picture has no such samples or no such part.
    pub fn new(buffers: &SceneBuffers, picture: &Picture, part: Option<Crop>) -> Result<PixelRays> {
        picture.samples.check(picture.size)?;
        let crop = part.unwrap_or(Crop { place: (0, 0), size: picture.size });
        crop.check(picture.size)?;
        // That of a picture of one sample.
        let samples = if picture.samples == Samples::Corners { Samples::Corners } else { Samples::PerPixel(1) };
        let whole = buffers.render_params(&picture.camera, picture.size, samples, 1, None);
        let rays = CameraRays { params: whole.cropped(crop.place, crop.size), centre: sample_positions(samples)[0] };
        Ok(PixelRays { eye: picture.camera.eye, rays })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.rays.params.film_len()
    }

    /// Origin and direction of a pixel's ray, world units; the direction's part along the view is 1.
    pub fn ray(&self, pixel: usize) -> (Vec3, Vec3) {
        (self.eye, directions_of(&self.rays, pixel..pixel + 1)[0])
    }

    /// The rays of `pixels` as tracers take them.
    pub fn batch(&self, buffers: &SceneBuffers, pixels: Range<usize>) -> TracingBatch {
        let chunks: Vec<_> = pixels.clone().step_by(CHUNK).map(|start| start..pixels.end.min(start + CHUNK)).collect();
        let directions = parallel::map(chunks.into_iter(), |chunk| directions_of(&self.rays, chunk));
        let ray = |i: usize| (self.eye, directions[i / CHUNK][i % CHUNK], 0.0, f32::INFINITY);
        buffers.batch(pixels.len(), ray, None)
    }
}

/// What is known of `pixels`.
fn hits_of(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    rays: &PixelRays,
    pixels: Range<usize>,
    wants_albedo: bool,
    progress: Progress,
) -> Result<Vec<FirstHit>> {
    let batch = rays.batch(buffers, pixels.clone());
    let options = *tracer.options();
    let hits = tracer.trace(&batch.job(false, 1), progress)?.hits;
    let chunks = batch.rays.chunks(CHUNK).zip(hits.chunks(CHUNK)).enumerate();
    let of_chunk = |(i, (traced, hits)): (usize, (&[_], &[_]))| {
        first_hits(buffers, &options, &rays.rays, pixels.start + i * CHUNK, traced, hits, wants_albedo)
    };
    Ok(parallel::map(chunks, of_chunk).concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::reference::ReferenceBackend;
    use crate::renderer::render_part;
    use crate::scene::{Builder, Camera, Material, Scene};
    use std::sync::Arc;

    const SIZE: (u32, u32) = (8, 6);

    struct Pictured {
        tracer: ReferenceBackend,
        buffers: Arc<SceneBuffers>,
        numbering: Numbering,
        picture: Picture,
    }

    impl Pictured {
        fn new(scene: &Scene, camera: Camera, samples: Samples) -> Pictured {
            let buffers = Arc::new(SceneBuffers::new(scene, &TraceOptions::DEFAULT).unwrap());
            let tracer = ReferenceBackend::new(buffers.clone(), TraceOptions::DEFAULT);
            let picture = Picture { camera, size: SIZE, samples, depth: 1, kill_weight: None };
            let numbering = Numbering::of(scene, &buffers.used_materials);
            Pictured { tracer, buffers, numbering, picture }
        }

        fn layers(&mut self, part: Option<Crop>, layers: &[Layer]) -> Result<Vec<PlaneGroup>> {
            let Pictured { tracer, buffers, numbering, picture } = self;
            trace_layers(tracer, (buffers, numbering), picture, part, layers, None, &|_| ())
        }

        fn of_hits(&mut self, part: Option<Crop>) -> Vec<PlaneGroup> {
            let layers: Vec<_> = Layer::ALL.iter().copied().filter(|layer| layer.is_of_hit()).collect();
            self.layers(part, &layers).unwrap()
        }
    }

    fn floats(group: &PlaneGroup, k: usize) -> &[f32] {
        match &group.planes[k].1 {
            Plane::Float(values) => values,
            Plane::Uint(_) => panic!("{group:?}"),
        }
    }

    fn numbers(group: &PlaneGroup) -> &[u32] {
        match &group.planes[0].1 {
            Plane::Uint(values) => values,
            Plane::Float(_) => panic!("{group:?}"),
        }
    }

    /// Straight down on the right half of the plane y = -3, from y = 1.
    fn half_plane() -> (Scene, Camera) {
        let mut builder = Builder::new();
        builder.material(Material::matt(Vec3::new(0.5, 0.25, 0.125)));
        builder.quad(Vec3::new(0.0, -3.0, 50.0), Vec3::X * 100.0, Vec3::NEG_Z * 100.0, 1);
        let camera = Camera { eye: Vec3::Y, target: Vec3::NEG_Y, up: Vec3::NEG_Z, fov_degrees: 90.0 };
        (builder.finish().unwrap(), camera)
    }

    #[test]
    fn a_plane_has_its_depth_position_and_normal_and_what_is_missed_has_nothing() {
        let (scene, camera) = half_plane();
        let mut pictured = Pictured::new(&scene, camera, Samples::Error(1.0));
        let groups = pictured.of_hits(None);
        let group = |layer: Layer| groups.iter().find(|group| group.name == layer.name()).unwrap();
        let whole = |layer: Layer, pixel: usize| numbers(group(layer))[pixel];
        let place = |layer: Layer, pixel: usize| [0, 1, 2].map(|k| floats(group(layer), k)[pixel]);
        for pixel in 0..48 {
            let (x, y) = ((pixel % 8) as f32, (pixel / 8) as f32);
            let depth = floats(group(Layer::Depth), 0)[pixel];
            if x < 4.0 {
                assert_eq!(depth, f32::INFINITY);
                assert!(
                    [Layer::Primitive, Layer::Object, Layer::Material].iter().all(|&l| whole(l, pixel) == u32::MAX)
                );
                for layer in [Layer::Position, Layer::Normal, Layer::GeometricNormal, Layer::Albedo] {
                    assert_eq!(place(layer, pixel), [0.0; 3], "{layer}");
                }
                continue;
            }
            // Along the view, so the same for all pixels; 4 is exact.
            assert_eq!(depth, 4.0);
            let expected = [4.0 * (x - 3.5) / 3.0, -3.0, 4.0 * (y - 2.5) / 3.0];
            let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-5);
            assert!(near(place(Layer::Position, pixel), expected), "{:?} {expected:?}", place(Layer::Position, pixel));
            assert_eq!(
                (place(Layer::Normal, pixel), place(Layer::GeometricNormal, pixel)),
                ([0.0, 1.0, 0.0], [0.0, 1.0, 0.0])
            );
            assert_eq!(place(Layer::Albedo, pixel), [0.5, 0.25, 0.125]);
            let uv = [0, 1].map(|k| floats(group(Layer::Uv), k)[pixel]);
            let expected = [expected[0] / 100.0, (50.0 - expected[2]) / 100.0];
            assert!((uv[0] - expected[0]).abs() < 1e-6 && (uv[1] - expected[1]).abs() < 1e-6, "{uv:?} {expected:?}");
            assert!(whole(Layer::Primitive, pixel) < 2);
            assert_eq!((whole(Layer::Object, pixel), whole(Layer::Instance, pixel)), (0, u32::MAX));
        }
    }

    /// Triangles that shine in colours of their own, before one another.
    fn shining() -> Scene {
        let mut random = crate::random::Random::new(20_081_121);
        let mut builder = Builder::new();
        builder.add_material(Material::matt(Vec3::X)); // that nothing has
        for i in 0..40 {
            let emission = Vec3::new(i as f32, 1.0 + random.unit(), random.unit());
            builder.material(Material { emission, diffuse: Vec3::ZERO, ..Material::default() });
            let corners = [(); 3].map(|()| random.vec3() * 2.0);
            builder.mesh(&corners, crate::scene::Normals::Flat, &[], &[[0, 1, 2]]);
        }
        builder.finish().unwrap()
    }

    #[test]
    fn layers_are_of_what_the_picture_shows_whole_or_in_part() {
        let scene = shining();
        let camera = Camera { eye: Vec3::Z * 6.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
        for samples in [Samples::PerPixel(1), Samples::Corners] {
            let mut pictured = Pictured::new(&scene, camera, samples);
            let whole = pictured.of_hits(None);
            let material = whole.iter().find(|group| group.name == "material").unwrap();
            let Pictured { tracer, buffers, picture, .. } = &mut pictured;
            let film = render_part(tracer, buffers, picture, None, &|_| ()).unwrap().film;
            for (pixel, &material) in film.pixels.iter().zip(numbers(material)) {
                let shown = scene.materials.get(material as usize).map(|material| material.emission);
                assert_eq!(*pixel, shown.unwrap_or(scene.background.bottom).to_array(), "{samples:?} {material}");
            }
            assert!(numbers(material).contains(&u32::MAX) && numbers(material).iter().any(|&m| m < 41));
            let crop = Crop { place: (3, 2), size: (4, 3) };
            let part = pictured.of_hits(Some(crop));
            let at = |i: usize| (2 + i / 4) * 8 + 3 + i % 4;
            for (part, whole) in part.iter().zip(&whole) {
                for ((_, part), (_, whole)) in part.planes.iter().zip(&whole.planes) {
                    match (part, whole) {
                        (Plane::Float(part), Plane::Float(whole)) => {
                            assert!((0..12).all(|i| part[i].to_bits() == whole[at(i)].to_bits()));
                        }
                        (Plane::Uint(part), Plane::Uint(whole)) => assert!((0..12).all(|i| part[i] == whole[at(i)])),
                        other => panic!("{other:?}"),
                    }
                }
            }
        }
    }

    /// Tracing space holds neither this eye nor, of the second scene, its vertices.
    #[test]
    fn scenes_of_extreme_numbers_have_layers_too() {
        let (scene, camera) = half_plane();
        let far = Camera { eye: Vec3::Y * 1e38, fov_degrees: 1e-30, ..camera };
        let mut pictured = Pictured::new(&scene, far, Samples::PerPixel(1));
        let groups = pictured.layers(None, &[Layer::Depth, Layer::Position, Layer::Primitive]).unwrap();
        assert!(floats(&groups[0], 0).iter().all(|&depth| depth == 1e38 || depth == f32::INFINITY), "{groups:?}");
        assert!((0..48).all(|i| (floats(&groups[0], 0)[i] == 1e38) == (numbers(&groups[2])[i] < 2)));

        let mut builder = Builder::new();
        let tiny = [Vec3::ZERO, Vec3::new(1e-42, 0.0, 0.0), Vec3::new(0.0, 1e-42, 0.0)];
        let large = [Vec3::new(-1e30, -1e30, -1e30), Vec3::new(1e30, -1e30, -1e30), Vec3::new(0.0, 1e30, -1e30)];
        for triangle in [large, tiny] {
            builder.mesh(&triangle, crate::scene::Normals::Flat, &[], &[[0, 1, 2]]);
        }
        let scene = builder.finish().unwrap();
        let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
        let mut pictured = Pictured::new(&scene, camera, Samples::PerPixel(1));
        let groups = pictured.of_hits(None);
        assert_eq!(floats(&groups[0], 0)[5 * 8 + 4], 1e30);
    }

    #[test]
    fn a_layer_is_asked_for_once() {
        let (scene, camera) = half_plane();
        let mut pictured = Pictured::new(&scene, camera, Samples::PerPixel(1));
        assert!(pictured.layers(None, &[]).unwrap().is_empty());
        let error = pictured.layers(None, &[Layer::Depth, Layer::Uv, Layer::Depth]).unwrap_err();
        assert_eq!((error.exit_code(), error.to_string().contains("layers: depth is there twice")), (2, true));
        // What is told of samples needs no rays; their error is not known of fixed ones.
        assert_eq!(numbers(&pictured.layers(None, &[Layer::Samples]).unwrap()[0]), [1; 48]);
        let error = pictured.layers(None, &[Layer::Error]).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("layers: error: only a picture"), "{error}");
        let beyond = Crop { place: (7, 0), size: (2, 1) };
        assert_eq!(pictured.layers(Some(beyond), &[Layer::Depth]).unwrap_err().exit_code(), 2);
    }
}
