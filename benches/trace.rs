//! Every structure and traversal, with exact hits, on a device and on the reference: the seconds that the kernels took.

mod common;

use common::{balls, group, measure, own_scene, places};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use raybrook::options::{Accel, PacketSize, TraceOptions, Traversal};
use raybrook::pack::SceneBuffers;
use raybrook::reference::{ReferenceTracer, render::camera_direction};
use raybrook::scene::{LightKind, Samples, Scene};
use raybrook::shared::TraceRay;
use raybrook::stress::Random;
use raybrook::tracer::{TraceJob, Tracer, is_hit};
use std::cell::OnceCell;
use std::sync::Arc;

/// Width and height of the picture whose rays are traced; a power of two.
const SIDE: u32 = 256;
const SEED: u64 = 20_081_121;
/// How far above the surface shadow and diffuse rays start, in diagonals of the scene: far enough that none of them meets the
/// triangle that it leaves, since a batch cannot say that a ray leaves one.
const LIFT: f32 = 1.0 / 4096.0;

/// Rays of one kind.
struct Batch {
    name: &'static str,
    rays: Vec<TraceRay>,
    any_hit: bool,
}

/// Every structure, kd-trees with every traversal, and every size of packets that it knows.
fn methods() -> Vec<(String, TraceOptions)> {
    let mut all = Vec::new();
    for &accel in Accel::ALL {
        let options = TraceOptions { accel, ..TraceOptions::DEFAULT };
        if accel == Accel::Kd {
            let traversals = Traversal::ALL.iter();
            all.extend(traversals.map(|&it| (format!("kd-{it}"), TraceOptions { traversal: it, ..options })));
            continue;
        }
        for &packet_size in PacketSize::ALL {
            let options = TraceOptions { packet_size, ..options };
            let name = if packet_size == PacketSize::One { String::new() } else { format!("-packets-{packet_size}") };
            if options.validate().is_ok() {
                all.push((format!("{accel}{name}"), options));
            }
        }
    }
    all
}

/// Takes time in proportion to the triangles, or nearly so.
fn is_slow(accel: Accel) -> bool {
    matches!(accel, Accel::Brute | Accel::Boxes | Accel::Spheres)
}

/// Camera rays, and from what they hit one shadow ray and one diffuse ray each.
fn batches(scene: &Scene) -> [Batch; 3] {
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

fn trace(criterion: &mut Criterion) {
    let places = places();
    for (scene_name, scene, is_small) in [("balls-1k", balls(8), true), ("showcase", own_scene("showcase.toml"), false)]
    {
        let batches = batches(&scene);
        let mut group = group(criterion, scene_name);
        for (method, options) in methods().into_iter().filter(|(_, options)| is_small || !is_slow(options.accel)) {
            let buffers = OnceCell::new();
            for place in &places {
                // The reference has no lanes: packets are single rays to it.
                if place.device.is_none() && options.packet_size != PacketSize::One {
                    continue;
                }
                let mut tracer = None;
                for Batch { name, rays, any_hit } in &batches {
                    group.throughput(Throughput::Elements(rays.len() as u64));
                    measure(&mut group, &format!("{}/{name}/{method}", place.name), |repeat| {
                        let buffers =
                            buffers.get_or_init(|| Arc::new(SceneBuffers::new(&scene, &options).expect("a structure")));
                        let tracer = tracer.get_or_insert_with(|| place.open(buffers, &options, 1));
                        let job = TraceJob { rays, next_directions: None, any_hit: *any_hit, repeat };
                        tracer.trace(&job, &|_| ()).expect("hits").kernel_s.iter().sum()
                    });
                }
            }
        }
        group.finish();
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = trace }
criterion_main!(benches);
