//! `raybrook distance`.

use super::points::{OpenedPoints, PointArgs};
use super::progress::Bar;
use super::{Talk, heading};
use raybrook::Result;
use raybrook::low_level::closest::{Closest, closest_points, distances, point_scene, take_signs};
use raybrook::low_level::crossings::require_exact;
use raybrook::low_level::rays::ClosestBatch;
use raybrook::low_level::tracer::Task;
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct DistanceArgs {
    #[command(flatten)]
    points: PointArgs,
    /// Answers: the arrays `distance` float32, `closest` float32 [n,3], `primitive` int32, `u` and `v` float32.
    #[arg(short, long, value_name = "CLOSEST.npz", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    /// Distances inside of the scene, which must be closed, are negative.
    #[arg(long)]
    signed: bool,
}

/// Bytes of a point's answer, and of the arrays that are written.
const POINT_BYTES: usize = size_of::<Option<Closest>>() + 7 * size_of::<f32>();

pub fn run(args: &DistanceArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    let tasks = if args.signed { &[Task::Points, Task::Batch, Task::AllHits][..] } else { &[Task::Points] };
    if args.signed {
        require_exact(args.points.method.check(false)?.intersector)?;
    }
    let OpenedPoints { points, mut opened, is_for_processor, budget } =
        args.points.open(args.output.as_deref(), tasks, POINT_BYTES, talk)?;
    if args.signed {
        args.points.require_closed(&opened)?;
    }
    let scene = point_scene(&opened.buffers, is_for_processor, &budget)?;

    let bar = Bar::new("find", talk);
    let share = if args.signed { 0.5 } else { 1.0 };
    let million_points = points.len() as f64 / 1e6;
    let progress = |done: f64| bar.update(share * done, million_points, "M points");
    let closest = closest_points(opened.tracer.as_mut(), &scene, &points, &progress)?;
    let mut distance = distances(&points, &closest);
    if args.signed {
        let progress = |done: f64| bar.update(0.5 + 0.5 * done, million_points, "M points");
        let tracer = opened.tracer.as_mut();
        take_signs(tracer, &opened.buffers, &points, &mut distance, Some(budget), &progress)?;
    }
    drop(bar);
    let (least, most) = distance
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(least, most), &distance| (least.min(distance), most.max(distance)));
    if let Some(output) = &args.output {
        batch(distance, &closest).write(output)?;
    }
    if !talk.quiet {
        let range = if least <= most { format!("distances {least} to {most}, ") } else { String::new() };
        let (triangles, name) = (opened.stats.triangle_count, &opened.stats.device);
        let seconds = start.elapsed().as_secs_f64();
        say!("{} points, {range}{triangles} triangles on {name}, {seconds:.2} s", points.len());
    }
    Ok(())
}

fn batch(distance: Vec<f32>, closest: &[Option<Closest>]) -> ClosestBatch {
    let number = |get: fn(&Closest) -> f32| closest.iter().map(|c| c.as_ref().map_or(0.0, get)).collect();
    ClosestBatch {
        distance,
        closest: closest.iter().map(|c| c.map_or([f32::NAN; 3], |c| c.point.to_array())).collect(),
        primitive: closest.iter().map(|c| c.map_or(-1, |c| c.triangle as i32)).collect(),
        u: number(|c| c.u),
        v: number(|c| c.v),
    }
}
