//! Building every structure of scenes of three sizes: the seconds that `SceneBuffers::build_s` reports, without the
//! scene's other arrays.

mod common;

use common::{balls, group, measure, own_scene};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use raybrook::low_level::options::{Build, KdOptions, Structure, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;

/// Every structure that is built (brute force has none), kd-trees by every build.
fn structures() -> Vec<(String, TraceOptions)> {
    let mut all = Vec::new();
    for &accel in StructureKind::ALL {
        let options = TraceOptions::of(accel);
        match accel {
            StructureKind::Brute => (),
            StructureKind::Kd => {
                all.extend(Build::ALL.iter().map(|&build| {
                    (
                        format!("kd-{build}"),
                        TraceOptions { structure: Structure::Kd(KdOptions { build, ..options.kd() }), ..options },
                    )
                }));
            }
            _ => all.push((accel.to_string(), options)),
        }
    }
    all
}

fn build(criterion: &mut Criterion) {
    let scenes = [("balls-10k", balls(22)), ("showcase", own_scene("showcase.toml")), ("balls-100k", balls(64))];
    for (name, scene) in &scenes {
        let mut group = group(criterion, name);
        group.throughput(Throughput::Elements(scene.triangles.len() as u64));
        for (name, options) in structures() {
            measure(&mut group, &name, |repeat| {
                (0..repeat).map(|_| SceneBuffers::new(scene, &options).expect("a structure").build_s).sum()
            });
        }
        group.finish();
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = build }
criterion_main!(benches);
