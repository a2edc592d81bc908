//! What all benches share: scenes, the device, and how a time that the library reports becomes criterion's.
#![allow(dead_code)] // every bench uses another part

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, SamplingMode};
use glam::Vec3;
use raybrook::device::{Cache, DeviceHandle, Selection, select};
use raybrook::options::{Accel, TraceOptions};
use raybrook::pack::SceneBuffers;
use raybrook::reference::{ReferenceTracer, render::camera_direction};
use raybrook::scene::{Builder, Camera, LightKind, Samples, Scene, load};
use raybrook::session::{complete, open_tracer};
use raybrook::shared::TraceRay;
use raybrook::stress::Random;
use raybrook::tracer::{TraceJob, Tracer, is_hit};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Short enough that a whole table is made over a cup of coffee; options such as `--measurement-time` change it.
pub fn criterion() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .nresamples(10_000)
        .without_plots()
}

/// Samples of one number of iterations each: criterion's default of 1, 2, 3, ... wants 55 where 10 will do.
pub fn group<'a>(criterion: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = criterion.benchmark_group(name);
    group.sampling_mode(SamplingMode::Flat);
    group
}

/// Measures `run`, which does the work so many times and tells the seconds that count.
pub fn measure(group: &mut BenchmarkGroup<WallTime>, name: &str, mut run: impl FnMut(u32) -> f64) {
    let mut is_ready = false;
    group.bench_function(name, |bencher| {
        // Structures, kernels and what drivers do at a first launch: as a part of the warm-up it would make criterion think that an
        // iteration takes that long. Here, and not before the bench, so that what a filter leaves out is not made.
        if !std::mem::replace(&mut is_ready, true) {
            run(1);
        }
        bencher.iter_custom(|iterations| {
            Duration::from_secs_f64(run(u32::try_from(iterations).expect("fewer repeats than a TraceJob can have")))
        });
    });
}

/// Where rays are traced.
pub struct Place {
    /// As names of benches have it: `cpu`, `gpu`, ..., or `reference`.
    pub name: String,
    /// `None`: the reference.
    pub device: Option<DeviceHandle>,
}

/// The device that `RAYBROOK_DEVICE` names, else a CPU, unless there is none, which is told; and the reference.
pub fn places() -> Vec<Place> {
    let spec = std::env::var("RAYBROOK_DEVICE").ok();
    let device = match select(Some(spec.as_deref().unwrap_or("cpu"))) {
        Ok(Selection::OpenCl(device)) => {
            eprintln!("{}: {}, {}", device.info.kind.name(), device.info.name, device.info.driver_version);
            Some(Place { name: device.info.kind.name().to_owned(), device: Some(device) })
        }
        Ok(Selection::Reference { .. }) => None,
        Err(error) => {
            eprintln!("SKIPPED, no device: {error}");
            None
        }
    };
    device.into_iter().chain([Place { name: "reference".to_owned(), device: None }]).collect()
}

impl Place {
    /// A tracer of `buffers`, which were built with `options`. Compiled kernels are kept, as the program keeps them.
    pub fn open(&self, buffers: &Arc<SceneBuffers>, options: &TraceOptions, max_depth: u32) -> Box<dyn Tracer> {
        let cache = Cache::open().expect("RAYBROOK_CACHE_MB is a number");
        open_tracer(self.device.as_ref(), buffers, options, max_depth, cache.as_ref()).expect("a tracer")
    }
}

/// 25 balls of `segments` around on a floor: 50 `segments` (`segments`/2 - 1) + 2 triangles. Shadow rays and diffuse ones meet
/// something, as a ball alone would not have it.
pub fn balls(segments: u32) -> Scene {
    const SIDE: u8 = 5;
    let mut builder = Builder::new();
    for (x, z) in (0..SIDE).flat_map(|x| (0..SIDE).map(move |z| (f32::from(x), f32::from(z)))) {
        builder.push().translate(Vec3::new(x, 0.5, z)).sphere(0.5, segments).pop();
    }
    builder.quad(Vec3::new(-1.0, 0.0, 5.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 1);
    // Near enough that the floor fills most of the picture.
    let (eye, target) = (Vec3::new(3.5, 7.0, 7.0), Vec3::new(2.0, 0.3, 2.0));
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 40.0 });
    completed(builder.finish().expect("balls"))
}

/// A scene of `scenes/`.
pub fn own_scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    completed(load(path).expect("the project's own scene"))
}

/// With camera and light where it has none; all pictures here are square or have their own camera.
fn completed(mut scene: Scene) -> Scene {
    complete(&mut scene, 1.0);
    scene
}

/// Width and height of the picture whose rays are traced; a power of two.
const SIDE: u32 = 256;
const SEED: u64 = 20_081_121;
/// How far above the surface shadow and diffuse rays start, in diagonals of the scene: far enough that none of them meets the
/// triangle that it leaves, since a batch cannot say that a ray leaves one.
const LIFT: f32 = 1.0 / 4096.0;

/// Rays of one kind.
pub struct Batch {
    /// `camera`, `shadow`, `diffuse`.
    pub name: &'static str,
    /// In tracing space.
    pub rays: Vec<TraceRay>,
    /// Whether any hit will do.
    pub any_hit: bool,
}

/// Camera rays, and from what they hit one shadow ray and one diffuse ray each.
pub fn batches(scene: &Scene) -> [Batch; 3] {
    let options = TraceOptions { accel: Accel::Bvh2, ..TraceOptions::DEFAULT };
    let buffers = Arc::new(SceneBuffers::new(scene, &options).expect("a structure"));
    let camera = scene.camera.expect("a completed scene has a camera");
    let params = buffers.render_params(&camera, (SIDE, SIDE), Samples::PerPixel(1), 1, None);
    // Along Z-curves: neighbours in the batch, however many, are those of a tile, as in pictures.
    let directions: Vec<_> = (0..SIDE * SIDE)
        .map(|i| camera_direction(&params, every_second_bit(i) as f32 + 0.5, every_second_bit(i >> 1) as f32 + 0.5))
        .collect();
    let camera_rays: Vec<_> =
        directions.iter().map(|&direction| buffers.trace_ray(camera.eye, direction, 0.0, f32::INFINITY)).collect();
    let job = TraceJob { rays: &camera_rays, next_directions: None, any_hit: false, repeat: 1 };
    let hits = ReferenceTracer::new(buffers.clone(), options).trace(&job, &|_| ()).expect("hits").hits;

    let (low, high) = scene.bounds().expect("a scene with triangles");
    let lift = (high - low).length() * LIFT;
    let mut random = Random(SEED);
    let (mut shadow_rays, mut diffuse_rays) = (Vec::new(), Vec::new());
    for (hit, &direction) in hits.iter().zip(&directions).filter(|(hit, _)| is_hit(hit)) {
        let [p0, p1, p2] = scene.vertices(hit.primitive as usize);
        let normal = (p1 - p0).cross(p2 - p0).normalize();
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        let origin = camera.eye + direction * hit.t + normal * lift;
        let (to_light, t_max) = to_light(scene, origin);
        shadow_rays.push(buffers.trace_ray(origin, to_light, 0.0, t_max));
        // Normal and a point of the unit sphere make a cosine lobe.
        diffuse_rays.push(buffers.trace_ray(origin, normal + random.direction(), 0.0, f32::INFINITY));
    }
    [
        Batch { name: "camera", rays: camera_rays, any_hit: false },
        Batch { name: "shadow", rays: shadow_rays, any_hit: true },
        Batch { name: "diffuse", rays: diffuse_rays, any_hit: false },
    ]
}

/// Bits 0, 2, 4, ... as one number.
fn every_second_bit(number: u32) -> u32 {
    (0..16).map(|bit| (number >> (2 * bit) & 1) << bit).sum()
}

/// From `point` to the scene's first light, and the t at which it is.
fn to_light(scene: &Scene, point: Vec3) -> (Vec3, f32) {
    match scene.lights[0].kind {
        LightKind::Directional { direction } => (-direction, f32::INFINITY),
        LightKind::Point { position } | LightKind::Spot { position, .. } => (position - point, 1.0),
    }
}
