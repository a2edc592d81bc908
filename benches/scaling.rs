//! How time and memory grow with triangles, pixels, lights and depth: tables of single measurements, not statistics. A
//! structure that is a tree takes a time for a ray that grows like the logarithm of the triangles, brute force like
//! their number.
//!
//! `cargo bench --bench scaling -- 1000000` stops at so many triangles; 6 million unless told.

mod common;

use common::{Batch, Place, balls, batches, own_scene, places};
use glam::Vec3;
use raybrook::low_level::options::{StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{DEFAULT_DEPTH, Picture, render};
use raybrook::low_level::scene::{Light, Samples, Scene};
use raybrook::low_level::tracer::{Backend, TraceJob};
use std::sync::Arc;

/// Segments of [`balls`]: 202 to 5,040,002 triangles.
const SEGMENTS: [u32; 6] = [4, 8, 20, 64, 200, 450];
/// Brute force ends in time up to so many triangles.
const MOST_FOR_BRUTE_FORCE: usize = 2000;
const MOST_TRIANGLES: usize = 6_000_000;
/// Passes, of which the median counts.
const REPEAT: u32 = 5;
/// Segments of the scene of 99,202 triangles whose pictures are taken.
const PICTURE_SEGMENTS: u32 = 64;
const SIDE: u32 = 512;

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

fn triangles(most: usize, places: &[Place]) {
    println!(
        "\n## Triangles\n\nns a ray: camera / shadow / diffuse; how much more of a camera ray for each doubling of the \
         triangles. Builds and bytes are those of each device in turn.\n"
    );
    println!("| triangles | structure | build s | bytes a triangle | {} |", names(places));
    println!("|--:|---|--:|--:|{}", "--:|".repeat(places.len()));
    let mut before: Vec<(StructureKind, usize, usize, f64)> = Vec::new();
    for segments in SEGMENTS {
        let scene = balls(segments);
        let count = scene.triangles.len();
        if count > most {
            break;
        }
        let batches = batches(&scene);
        for accel in [StructureKind::Brute, StructureKind::Kd, StructureKind::Bvh2, StructureKind::Bvh8] {
            if accel == StructureKind::Brute && count > MOST_FOR_BRUTE_FORCE {
                continue;
            }
            let built = places.iter().map(|place| {
                let options = place.options(Some(accel));
                (options, Arc::new(SceneBuffers::new(&scene, &options).expect("a structure")))
            });
            let built: Vec<_> = built.collect();
            let build_s: Vec<_> = built.iter().map(|(_, buffers)| format!("{:.3}", buffers.build_s)).collect();
            let bytes = built.iter().map(|(options, buffers)| buffers.size_bytes(options) as f64 / count as f64);
            let bytes: Vec<_> = bytes.map(|bytes| format!("{bytes:.0}")).collect();
            let mut row = format!("| {count} | {accel} | {} | {} |", build_s.join(" / "), bytes.join(" / "));
            for (number, (place, (options, buffers))) in places.iter().zip(&built).enumerate() {
                let times = trace(place, buffers, options, &batches);
                let now = (accel, number, count, times[0]);
                let growth = before.iter().rev().find(|known| (known.0, known.1) == (accel, number)).map(|known| {
                    let doublings = (count as f64 / known.2 as f64).log2();
                    format!(" ({:+.0} %)", 100.0 * ((times[0] / known.3).powf(1.0 / doublings) - 1.0))
                });
                before.push(now);
                let times = times.map(|time| format!("{time:.1}")).join(" / ");
                row += &format!(" {times}{} |", growth.unwrap_or_default());
            }
            println!("{row}");
        }
    }
}

/// Nanoseconds a ray of each batch.
fn trace(place: &Place, buffers: &Arc<SceneBuffers>, options: &TraceOptions, batches: &[Batch; 3]) -> [f64; 3] {
    let mut tracer = place.open(buffers, options, 1);
    batches.each_ref().map(|Batch { rays, any_hit, .. }| {
        let mut run = |repeat| {
            let job = TraceJob { extreme: &[], rays, next_directions: None, any_hit: *any_hit, repeat };
            tracer.trace(&job, &|_| ()).expect("hits").kernel_s
        };
        run(1);
        1e9 * median(run(REPEAT)) / rays.len() as f64
    })
}

/// Nanoseconds a ray, and the rays, of a square picture.
fn picture(place: &Place, scene: &Scene, side: u32, depth: u32) -> (f64, u64) {
    let options = place.options(None);
    let buffers = Arc::new(SceneBuffers::new(scene, &options).expect("a structure"));
    let camera = scene.camera.expect("a completed scene has a camera");
    let picture = Picture { camera, size: (side, side), samples: Samples::PerPixel(1), depth, kill_weight: None };
    let mut tracer: Box<dyn Backend> = place.open(&buffers, &options, depth);
    let mut run = || {
        let result = render(tracer.as_mut(), &buffers, &picture, &|_| ()).expect("a picture");
        (result.kernel_s, result.counts.iter().step_by(2).sum::<u64>())
    };
    let (_, rays) = run();
    (1e9 * median((0..REPEAT).map(|_| run().0).collect()) / rays as f64, rays)
}

fn pictures(places: &[Place]) {
    let table = |title: &str, what: &str| {
        println!("\n## {title}\n\nns a ray of a picture, in the fastest structure.\n");
        println!("| {what} | rays | {} |\n|--:|--:|{}", names(places), "--:|".repeat(places.len()));
    };
    let row = |what: u32, scene: &Scene, side: u32, depth: u32| {
        let measured: Vec<_> = places.iter().map(|place| picture(place, scene, side, depth)).collect();
        let times: String = measured.iter().map(|(time, _)| format!(" {time:.1} |")).collect();
        println!("| {what} | {} |{times}", measured[0].1);
    };
    let scene = balls(PICTURE_SEGMENTS);
    table("Pixels", "pixels a side");
    for side in [64, 128, 256, 512, 1024, 2048] {
        row(side, &scene, side, 1);
    }
    table("Lights", "lights");
    for count in [1, 2, 4, 8, 16, 32] {
        let mut lit = scene.clone();
        let place = |i: u32| Vec3::new(2.0 + 6.0 * (i as f32).cos(), 8.0, 2.0 + 6.0 * (i as f32).sin());
        lit.lights = (0..count).map(|i| Light::point(place(i), Vec3::splat(1.0 / count as f32))).collect();
        row(count, &lit, SIDE, 1);
    }
    table("Depth (scenes/showcase.toml)", "longest chain");
    let scene = own_scene("showcase.toml");
    for depth in [1, 2, 3, 4, 6, DEFAULT_DEPTH, 12, 16] {
        row(depth, &scene, SIDE / 2, depth);
    }
}

fn names(places: &[Place]) -> String {
    places.iter().map(|place| place.name.as_str()).collect::<Vec<_>>().join(" | ")
}

fn main() {
    // Cargo passes `--bench`.
    let most = std::env::args().skip(1).find(|word| !word.starts_with('-')).map(|word| match word.parse() {
        Ok(most) => most,
        Err(_) => {
            eprintln!("'{word}' is no number of triangles");
            std::process::exit(2)
        }
    });
    let places = places();
    triangles(most.unwrap_or(MOST_TRIANGLES), &places);
    pictures(&places);
}
