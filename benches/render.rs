//! Small pictures of the project's own scenes on a device and on the reference: the seconds that the kernels took.

mod common;

use common::{Place, group, measure, own_scene, places};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use raybrook::low_level::options::{Kernels, PacketSize, PictureOptions, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{DEFAULT_DEPTH, Picture, render};
use raybrook::low_level::scene::Samples;
use std::sync::Arc;

const SIZE: (u32, u32) = (160, 120);
const SCENES: [&str; 5] = ["cornell", "spheres", "glass", "showcase", "chess"];

/// The kernels with the structure that is fastest there, and one or sixteen pixels at a time; the reference knows but
/// one way.
fn methods(place: &Place) -> Vec<(String, TraceOptions)> {
    let options = TraceOptions { packet_size: PacketSize::One, ..place.options(None) };
    if place.device.is_none() {
        return vec![(options.kind().to_string(), options)];
    }
    let mut all = Vec::new();
    for &kernels in Kernels::ALL {
        for &packet_size in PacketSize::ALL {
            let options =
                TraceOptions { picture: PictureOptions { kernels, ..options.picture }, packet_size, ..options };
            // The wavefront kernels trace pictures one ray at a time, whatever the packets of batches are.
            if kernels == Kernels::Wavefront && packet_size != PacketSize::One || options.validate().is_err() {
                continue;
            }
            let packets = if packet_size == PacketSize::One { "" } else { &format!("-packets-{packet_size}") };
            all.push((format!("{}-{kernels}{packets}", options.kind()), options));
        }
    }
    all
}

fn pictures(criterion: &mut Criterion) {
    let places = places();
    for scene_name in SCENES {
        let scene = own_scene(&format!("{scene_name}.toml"));
        let picture = Picture {
            camera: scene.camera.expect("a completed scene has a camera"),
            size: SIZE,
            samples: Samples::PerPixel(1),
            depth: DEFAULT_DEPTH,
            kill_weight: None,
        };
        let mut group = group(criterion, scene_name);
        group.throughput(Throughput::Elements(u64::from(SIZE.0 * SIZE.1)));
        for place in &places {
            for (method, options) in methods(place) {
                let mut opened = None;
                measure(&mut group, &format!("{}/{method}", place.name), |repeat| {
                    let (buffers, tracer) = opened.get_or_insert_with(|| {
                        let buffers = Arc::new(SceneBuffers::new(&scene, &options).expect("a structure"));
                        let tracer = place.open(&buffers, &options, picture.depth);
                        (buffers, tracer)
                    });
                    let mut render =
                        || render(tracer.as_mut(), buffers, &picture, &|_| ()).expect("a picture").kernel_s;
                    (0..repeat).map(|_| render()).sum()
                });
            }
        }
        group.finish();
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = pictures }
criterion_main!(benches);
