//! `raybrook inside`.

use super::points::{OpenedPoints, PointArgs};
use super::progress::Bar;
use super::{Talk, heading};
use raybrook::Result;
use raybrook::low_level::crossings::{contains, require_exact};
use raybrook::low_level::rays::write_inside;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::Task;
use raybrook::low_level::winding::WindingTree;
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct InsideArgs {
    #[command(flatten)]
    points: PointArgs,
    /// Answers: the array `inside` uint8 [n], 1 inside and on the surface.
    #[arg(short, long, value_name = "INSIDE.npz", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    /// Inside is what the mesh winds around often enough: at least 0.5 times, or THRESHOLD. It may be open.
    ///
    /// The generalised winding number is 1 inside of a closed mesh whose triangles are turned outwards, 0 outside, and
    /// between them near the holes of an open one. The output also has it, as the array `winding` float64.
    #[arg(
        long,
        value_name = "THRESHOLD",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0.5",
        value_parser = parse_threshold,
    )]
    winding: Option<f64>,
}

/// Bytes of a point as a ray and its hit, once more where these are sorted or on a device; and of a winding number.
const POINT_BYTES: usize = 3 * (size_of::<TraceRay>() + size_of::<Hit>()) + 2 + size_of::<f64>();

fn parse_threshold(text: &str) -> std::result::Result<f64, String> {
    match text.parse() {
        Ok(number) if f64::is_finite(number) => Ok(number),
        _ => Err("expected a number, such as 0.5".into()),
    }
}

pub fn run(args: &InsideArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    let tasks = if args.winding.is_some() { &[][..] } else { &[Task::Batch, Task::AllHits] };
    if args.winding.is_none() {
        require_exact(args.points.method.check(false)?.intersector)?;
    }
    let OpenedPoints { points, mut opened, budget, .. } =
        args.points.open(args.output.as_deref(), tasks, POINT_BYTES, talk)?;
    let (inside, winding) = match args.winding {
        Some(threshold) => {
            let winding = WindingTree::new(&opened.buffers, &budget)?.winding_numbers(&points);
            (winding.iter().map(|&number| number >= threshold).collect(), Some(winding))
        }
        None => {
            args.points.require_closed(&opened)?;
            let bar = Bar::new("trace", talk);
            let million_points = points.len() as f64 / 1e6;
            let progress = |done: f64| bar.update(done, million_points, "M points");
            (contains(opened.tracer.as_mut(), &opened.buffers, &points, Some(budget), &progress)?, None)
        }
    };
    if let Some(output) = &args.output {
        write_inside(output, &inside, winding.as_deref())?;
    }
    if !talk.quiet {
        let count = inside.iter().filter(|&&is_inside| is_inside).count();
        let (triangles, name) = (opened.stats.triangle_count, &opened.stats.device);
        let seconds = start.elapsed().as_secs_f64();
        say!("{} points, {count} inside, {triangles} triangles on {name}, {seconds:.2} s", points.len());
    }
    Ok(())
}
