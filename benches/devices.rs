//! How much sooner several devices are done than one: a batch of rays from memory to memory, and a picture, by wall
//! clock, through the front door. Each list of devices in turn, the least of some rounds; the answers are compared bit
//! for bit.
//!
//! `cargo bench --bench devices -- 0 0,1 rays=100000000 side=8192 samples=64 rounds=3`; with `shuffled` no ray of the
//! batch is near the one before.

mod common;

use common::own_scene;
use glam::Vec3;
use raybrook::low_level::parallel;
use raybrook::{Hit, Ray, Result, Scene, Tracer, View};
use std::time::Instant;

/// What is asked for.
struct Asked {
    devices: Vec<String>,
    rays: usize,
    side: u32,
    samples: u32,
    rounds: u32,
    is_shuffled: bool,
}

impl Asked {
    fn of_arguments() -> Asked {
        let mut asked =
            Asked { devices: Vec::new(), rays: 8_000_000, side: 1024, samples: 4, rounds: 3, is_shuffled: false };
        // Cargo says --bench.
        for argument in std::env::args().skip(1).filter(|argument| !argument.starts_with("--")) {
            match argument.split_once('=') {
                Some(("rays", value)) => asked.rays = value.parse().expect("a number of rays"),
                Some(("side", value)) => asked.side = value.parse().expect("pixels of a side"),
                Some(("samples", value)) => asked.samples = value.parse().expect("samples of a pixel"),
                Some(("rounds", value)) => asked.rounds = value.parse().expect("a number of rounds"),
                _ if argument == "shuffled" => asked.is_shuffled = true,
                _ => asked.devices.push(argument),
            }
        }
        if asked.devices.is_empty() {
            asked.devices = ["cpu", "all"].map(str::to_owned).to_vec();
        }
        asked
    }
}

/// A number that has no factor in common with most others.
const STRIDE: usize = 0x9e37_79b1;

/// Rays from a point beside the scene through a square around it, row by row or shuffled.
fn ray_of(scene: &Scene, count: usize, is_shuffled: bool) -> impl Fn(usize) -> Ray + Sync + use<> {
    let (low, high) = scene.bounds().expect("the scene has triangles");
    let (middle, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
    let away = Vec3::new(1.0, 0.7, 1.3).normalize();
    let (eye, right) = (middle + 3.0 * radius * away, away.any_orthonormal_vector());
    let up = away.cross(right);
    let side = (count as f64).sqrt().ceil() as usize;
    let part = move |i: usize| radius * (2.0 * i as f32 / side as f32 - 1.0);
    move |i| {
        let i = if is_shuffled { i * STRIDE % count } else { i };
        let through = middle + part(i % side) * right + part(i / side) * up;
        Ray::new(eye.to_array(), (through - eye).to_array())
    }
}

/// What a list of devices took.
struct Turn {
    tracer: Tracer,
    batch_s: f64,
    picture_s: f64,
}

fn main() -> Result<()> {
    let asked = Asked::of_arguments();
    let scene = own_scene("showcase.toml");
    let ray = ray_of(&scene, asked.rays, asked.is_shuffled);
    let rays: Vec<Ray> = parallel::map_numbers(asked.rays, ray);
    let view = View::new(asked.side, asked.side).samples(asked.samples);
    let open = |devices: &String| {
        let tracer = Tracer::builder(&scene).device(devices).build()?;
        Ok(Turn { tracer, batch_s: f64::INFINITY, picture_s: f64::INFINITY })
    };
    let mut turns = asked.devices.iter().map(open).collect::<Result<Vec<_>>>()?;
    let mut known = None;
    // The first round compiles, and is not timed.
    for round in 0..=asked.rounds {
        for turn in &mut turns {
            let start = Instant::now();
            let hits = turn.tracer.closest_hits_of(rays.len(), |i| rays[i])?;
            let (batch_s, start) = (start.elapsed().as_secs_f64(), Instant::now());
            let picture = turn.tracer.render(&view)?;
            let picture_s = start.elapsed().as_secs_f64();
            if round > 0 {
                turn.batch_s = turn.batch_s.min(batch_s);
                turn.picture_s = turn.picture_s.min(picture_s);
            }
            let (known_hits, known_picture) = known.get_or_insert_with(|| (hits.clone(), picture.clone()));
            let bits = |hit: Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.triangle];
            let is_same = |ray: usize| hits.get(ray).map(bits) == known_hits.get(ray).map(bits);
            assert!((0..asked.rays).all(is_same) && picture.pixels() == known_picture.pixels(), "other answers");
        }
    }
    let Asked { side, samples, .. } = asked;
    println!(
        "| devices | {} rays, s | of the first | {side}x{side}, {samples} samples, s | of the first |",
        rays.len()
    );
    println!("|---|--:|--:|--:|--:|");
    for Turn { tracer, batch_s, picture_s } in &turns {
        let (batch, picture) = (turns[0].batch_s / batch_s, turns[0].picture_s / picture_s);
        println!("| {} | {batch_s:.3} | {batch:.2} | {picture_s:.3} | {picture:.2} |", tracer.device_name());
        tracer.notes().iter().for_each(|note| println!("note: {note}"));
    }
    Ok(())
}
