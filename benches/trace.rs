//! Every structure and traversal, with exact hits, on a device and on the reference: the seconds that the kernels took.

mod common;

use common::{Batch, balls, batches, group, measure, own_scene, places};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use raybrook::low_level::options::{KdOptions, PacketSize, StructureKind, TraceOptions, Traversal};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::tracer::TraceJob;
use std::cell::OnceCell;
use std::sync::Arc;

/// Every structure, kd-trees with every traversal, and every size of packets that it knows.
fn methods() -> Vec<(String, TraceOptions)> {
    let mut all = Vec::new();
    for &accel in StructureKind::ALL {
        let traversals =
            if accel == StructureKind::Kd { Traversal::ALL } else { &[TraceOptions::DEFAULT.kd().traversal] };
        for (&traversal, &packet_size) in traversals.iter().flat_map(|it| PacketSize::ALL.iter().map(move |n| (it, n)))
        {
            let options = TraceOptions {
                packet_size,
                ..match accel {
                    StructureKind::Kd => TraceOptions::of_kd(KdOptions { traversal, ..KdOptions::DEFAULT }),
                    other => TraceOptions::of(other),
                }
            };
            let walk = if accel == StructureKind::Kd { format!("-{traversal}") } else { String::new() };
            let packets =
                if packet_size == PacketSize::One { String::new() } else { format!("-packets-{packet_size}") };
            if options.validate().is_ok() {
                all.push((format!("{accel}{walk}{packets}"), options));
            }
        }
    }
    all
}

/// Takes time in proportion to the triangles, or nearly so.
fn is_slow(accel: StructureKind) -> bool {
    matches!(accel, StructureKind::Brute | StructureKind::Boxes | StructureKind::Spheres)
}

fn trace(criterion: &mut Criterion) {
    let places = places();
    for (scene_name, scene, is_small) in [("balls-1k", balls(8), true), ("showcase", own_scene("showcase.toml"), false)]
    {
        let batches = batches(&scene);
        let mut group = group(criterion, scene_name);
        for (method, options) in methods().into_iter().filter(|(_, options)| is_small || !is_slow(options.kind())) {
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
                        let job = TraceJob { extreme: &[], rays, next_directions: None, any_hit: *any_hit, repeat };
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
