//! `raybrook inside`.

use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, SceneArgs, Talk, heading, open};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::crossings::{check_closed, contains, require_exact};
use raybrook::low_level::output::check_writable;
use raybrook::low_level::rays::{read_points, write_inside};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::Task;
use raybrook::{Error, Result};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct InsideArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Points: the array `point` float32 [n,3].
    #[arg(value_name = "POINTS.npz")]
    points: PathBuf,
    /// Answers: the array `inside` uint8 [n], 1 inside and on the surface.
    #[arg(short, long, value_name = "INSIDE.npz", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    explain: ExplainArgs,
}

/// Bytes of a point as a ray and its hit, once more where these are sorted or on a device.
const POINT_BYTES: usize = 3 * (size_of::<TraceRay>() + size_of::<Hit>()) + 2;

fn check_memory(count: usize, args: &InsideArgs, budget: &MemoryBudget) -> Result<()> {
    let what = format!("finding {count} points of {}", args.points.display());
    let remedy = "split the points, or raise --memory-limit";
    let bytes = (count * POINT_BYTES) as u64;
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
}

pub fn run(args: &InsideArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    require_exact(args.method.check(false)?.intersector)?;
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    files.read(&args.points, "the file of points");
    files.clone().write_if(args.output.as_deref(), "-o")?;
    if let Some(output) = &args.output {
        check_writable(output)?;
    }
    let device = open::choose(&args.device, talk)?;
    let budget = args.scene.memory.budget();
    let (points, ignored) = read_points(&args.points, &budget)?;
    if talk.verbose && !ignored.is_empty() {
        tell!("note: {}: arrays that mean nothing here: {}", args.points.display(), ignored.join(", "));
    }
    let loaded = open::load_for_rays(&args.scene.scene, args.scene.allow_empty, &budget, talk)?;
    files.read_scene(&loaded.scene);
    files.write_if(args.output.as_deref(), "-o")?;
    let chosen =
        Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk).choose(&loaded.scene)?;
    let tasks = (&[Task::Batch, Task::AllHits][..], &budget);
    let mut opened = open::open(&loaded, device.as_ref(), &args.device, chosen, 1, tasks, talk)?;
    check_closed(&opened.buffers).map_err(|error| match error {
        Error::Scene(message) => Error::input(&args.scene.scene, None, message),
        other => other,
    })?;
    check_memory(points.len(), args, &budget)?;

    let bar = Bar::new("trace", talk);
    let million_points = points.len() as f64 / 1e6;
    let progress = |done: f64| bar.update(done, million_points, "M points");
    let inside = contains(opened.tracer.as_mut(), &opened.buffers, &points, Some(budget), &progress)?;
    drop(bar);
    if let Some(output) = &args.output {
        write_inside(output, &inside)?;
    }
    if !talk.quiet {
        let count = inside.iter().filter(|&&is_inside| is_inside).count();
        let (triangles, name) = (opened.stats.triangle_count, &opened.stats.device);
        let seconds = start.elapsed().as_secs_f64();
        say!("{} points, {count} inside, {triangles} triangles on {name}, {seconds:.2} s", points.len());
    }
    Ok(())
}
