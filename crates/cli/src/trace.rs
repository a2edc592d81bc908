//! `raybrook trace`.

use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, SceneArgs, Talk, heading, open, work};
use glam::Vec3;
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::extreme::TracingBatch;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::Kernels;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::rays::{HitBatch, RayBatch};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::stats::{RayCount, WorkStats};
use raybrook::low_level::tracer::{Task, TraceResult, is_hit};
use raybrook::low_level::work::{RayWork, WorkSum};
use raybrook::{Error, Result};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct TraceArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Rays: arrays `origin` and `direction` float32 [n,3]; optional `t_min`, `t_max` float32 [n] (in units of
    /// |direction|) and `next_direction` float32 [n,3].
    #[arg(value_name = "RAYS.npz")]
    rays: PathBuf,
    /// Hits: arrays `t` (inf on a miss), `primitive` (-1 on a miss), `u`, `v`.
    ///
    /// With --any-hit `hit`, and t, u, v are 0 on a hit; with next_direction `next_t` and `next_primitive`; with
    /// --counters `work_steps` and so on, and `next_work_steps` and so on.
    #[arg(short, long, value_name = "HITS.npz", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    /// Only find out whether each ray hits anything.
    #[arg(long)]
    any_hit: bool,
    /// Trace the batch N times, for timing.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    explain: ExplainArgs,
    /// Count the work on every ray: steps, leaves, tests, bytes, ... (slower; the hits stay the same).
    #[arg(long, hide_short_help = true, help_heading = heading::DIAGNOSIS)]
    counters: bool,
    /// Write device, options and times to a JSON file.
    #[arg(long, value_name = "FILE", help_heading = heading::OUTPUT)]
    stats: Option<PathBuf>,
}

impl TraceArgs {
    /// Checks that nothing is written that is read as one of `files`, or written twice.
    fn claim(&self, mut files: Files) -> Result<()> {
        files.write_if(self.output.as_deref(), "-o")?;
        files.write_if(self.stats.as_deref(), "--stats")
    }
}

/// The rays as the tracers take them.
fn tracing_batch(batch: &RayBatch, buffers: &SceneBuffers) -> TracingBatch {
    let limit = |values: &Option<Vec<f32>>, i: usize, default: f32| values.as_ref().map_or(default, |v| v[i]);
    let ray = |i: usize| {
        let (t_min, t_max) = (limit(&batch.t_min, i, 0.0), limit(&batch.t_max, i, f32::INFINITY));
        (Vec3::from(batch.origins[i]), Vec3::from(batch.directions[i]), t_min, t_max)
    };
    match &batch.next_directions {
        Some(next) => buffers.batch(batch.len(), ray, Some(&|i| Vec3::from(next[i]))),
        None => buffers.batch(batch.len(), ray, None),
    }
}

/// The hits as NumPy users take them.
fn hit_batch(result: &TraceResult, any_hit: bool) -> HitBatch {
    let times = |hits: &[Hit]| hits.iter().map(|hit| hit.t).collect();
    let primitives = |hits: &[Hit]| hits.iter().map(|hit| hit.primitive as i32).collect(); // NO_PRIMITIVE becomes -1
    let (hits, next) = (&result.hits, result.next_hits.as_deref());
    HitBatch {
        t: times(hits),
        primitive: primitives(hits),
        u: hits.iter().map(|hit| hit.u).collect(),
        v: hits.iter().map(|hit| hit.v).collect(),
        hit: any_hit.then(|| hits.iter().map(|hit| u8::from(is_hit(hit))).collect()),
        next_t: next.map(times),
        next_primitive: next.map(primitives),
        work: result.work.clone(),
        next_work: result.next_work.clone(),
    }
}

/// Bytes of a ray and of its hit as the tracers take them, once more where they are sorted or on a device, and as NumPy
/// takes hits.
const RAY_BYTES: usize = 3 * (size_of::<TraceRay>() + size_of::<Hit>()) + 16;

/// The same of a second ray.
const NEXT_BYTES: usize = 3 * (size_of::<Float4>() + size_of::<Hit>()) + 8;

/// Checks that there is memory for tracing `batch`.
fn check_memory(batch: &RayBatch, args: &TraceArgs, budget: &MemoryBudget) -> Result<()> {
    let second = if batch.next_directions.is_some() { NEXT_BYTES } else { 0 };
    let rays = if batch.next_directions.is_some() { 2 } else { 1 };
    let work = if args.counters { 3 * rays * size_of::<RayWork>() } else { 0 };
    let what = format!("tracing {} rays of {}", batch.len(), args.rays.display());
    let bytes = batch.len() as u64 * (RAY_BYTES + second + work) as u64;
    let remedy = "split the batch, or raise --memory-limit";
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
}

pub fn run(args: &TraceArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    let options = args.method.check(args.counters)?;
    if options.picture.kernels != Kernels::Mega {
        let message =
            format!("{} is for pictures: a batch of rays has one kernel, {}", options.picture.kernels, Kernels::Mega);
        return Err(Error::option("--kernels", message));
    }
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    files.read(&args.rays, "the file of rays");
    args.claim(files.clone())?;
    for output in args.output.iter().chain(&args.stats) {
        check_writable(output)?;
    }
    let device = open::choose(&args.device, talk)?;
    let budget = args.scene.memory.budget();
    let batch = RayBatch::read_within(&args.rays, &budget)?;
    if args.any_hit && batch.next_directions.is_some() {
        let message = "cannot be combined with the array 'next_direction': a second ray starts at the closest hit";
        return Err(Error::option("--any-hit", message));
    }
    if talk.verbose && !batch.ignored.is_empty() {
        tell!("note: {}: arrays that mean nothing here: {}", args.rays.display(), batch.ignored.join(", "));
    }
    let loaded = open::load_for_rays(&args.scene.scene, args.scene.allow_empty, &budget, talk)?;
    files.read_scene(&loaded.scene);
    args.claim(files)?;
    let chooser = Chooser {
        method: &args.method,
        counters: args.counters,
        pictures: false,
        device: device.as_ref(),
        device_args: &args.device,
        explain: &args.explain,
        talk,
    };
    let chosen = chooser.choose(&loaded.scene)?;
    let tasks = (&[Task::Batch][..], &budget);
    let mut opened = open::open(&loaded, device.as_ref(), &args.device, chosen, 1, tasks, talk)?;
    check_memory(&batch, args, &budget)?;

    let rays = tracing_batch(&batch, &opened.buffers);
    if !rays.extreme.is_empty() && !talk.quiet {
        let count = rays.extreme.len();
        tell!(
            "note: {count} rays have numbers beyond what kernels hold and are traced on the host, as exactly (see the page on exactness in the book)"
        );
    }
    let job = rays.job(args.any_hit, args.repeat);
    let bar = Bar::new("trace", talk);
    let million_rays = batch.len() as f64 * f64::from(args.repeat) / 1e6;
    let result = opened.tracer.trace(&job, &|done| bar.update(done, million_rays, "M rays"))?;
    drop(bar);

    if let Some(output) = &args.output {
        hit_batch(&result, args.any_hit).write(output)?;
    }
    let hits = result.hits.iter().filter(|hit| is_hit(hit)).count();
    let stats = &mut opened.stats;
    // The rays of a batch count as camera rays, whatever the caller makes of them.
    stats.rays.camera = RayCount { cast: batch.len() as u64, hit: hits as u64 };
    if let Some(first) = &result.work {
        let next = result.next_work.as_deref().unwrap_or_default();
        // A ray that missed has no second one.
        let next_count = if next.is_empty() { 0 } else { hits as u64 };
        stats.work = Some(WorkStats {
            camera: WorkSum::new(batch.len() as u64, first.iter().copied()),
            all: WorkSum::new(batch.len() as u64 + next_count, first.iter().chain(next).copied()),
            aovs: Vec::new(),
        });
    }
    stats.kernel_s = open::device_times(opened.tracer.as_ref(), result.kernel_s, talk);
    stats.sort_s = result.sort_s;
    stats.extreme_s = result.extreme_s;
    stats.second_pass = result.second_pass;
    stats.compile_s = Some(opened.tracer.compile_s()); // the second pass is compiled when it is needed
    stats.set_rate();
    stats.upload_s = stats.upload_s.map(|s| s + result.upload_s);
    stats.read_s = Some(result.read_s);
    stats.total_s = start.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        stats.write(path)?;
    }
    if !talk.quiet {
        let sorted = stats.sort_s.map_or(String::new(), |s| format!(" (sorted in {s:.3} s)"));
        say!(
            "{} rays{sorted}, {hits} hit, {} triangles on {}{}, {:.2} s",
            batch.len(),
            stats.triangle_count,
            stats.device,
            open::rate(stats),
            stats.total_s
        );
    }
    if let Some(counted) = &stats.work {
        work::say_work(counted, talk);
    }
    Ok(())
}
