//! What all benches share: scenes, the device, and how a time that the library reports becomes criterion's.
#![allow(dead_code)] // every bench uses another part

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, SamplingMode};
pub use raybrook::low_level::choose::tune::Batch;
use raybrook::low_level::choose::{Request, Workload};
use raybrook::low_level::device::{Cache, DeviceHandle, Selection, select};
use raybrook::low_level::options::{StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{complete, open_tracer};
use raybrook::low_level::scene::{Scene, load};
use raybrook::low_level::tracer::Backend;
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
        // Structures, kernels and what drivers do at a first launch: as a part of the warm-up it would make criterion
        // think that an iteration takes that long. Here, and not before the bench, so that what a filter leaves out is
        // not made.
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
    /// What is fastest here, with `accel` if it is given.
    pub fn options(&self, accel: Option<StructureKind>) -> TraceOptions {
        let device = self.device.as_ref().map(|device| &device.info);
        let workload = Workload::without_scene(device);
        let request = accel.map_or_else(Request::default, |kind| Request::of(&TraceOptions::of(kind)));
        request.choose(&workload, None).expect("valid options").options
    }

    /// A tracer of `buffers`, which were built with `options`. Compiled kernels are kept, as the program keeps them.
    pub fn open(&self, buffers: &Arc<SceneBuffers>, options: &TraceOptions, max_depth: u32) -> Box<dyn Backend> {
        let cache = Cache::open().expect("RAYBROOK_CACHE_MB is a number");
        open_tracer(self.device.as_ref(), buffers, options, max_depth, cache.as_ref()).expect("a tracer")
    }
}

/// See [`raybrook::low_level::choose::tune::balls`].
pub fn balls(segments: u32) -> Scene {
    raybrook::low_level::choose::tune::balls(segments).expect("balls")
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

/// Width and height of the picture whose rays are traced.
const SIDE: u32 = 256;
const SEED: u64 = 20_081_121;

/// See [`raybrook::low_level::choose::tune::batches`].
pub fn batches(scene: &Scene) -> [Batch; 3] {
    raybrook::low_level::choose::tune::batches(scene, SIDE, SEED).expect("rays")
}
