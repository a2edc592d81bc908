//! `raybrook trace`.

use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, SceneArgs, Talk, heading, open, work};
use glam::Vec3;
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::crossings::{count_crossings, require_exact};
use raybrook::low_level::extreme::TracingBatch;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::Kernels;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::rays::{AllHitsBatch, HitBatch, RayBatch};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::stats::{RayCount, WorkStats};
use raybrook::low_level::tracer::{AllHits, AllHitsJob, Backend, Progress, Task, TraceResult, is_hit};
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
    /// With --any-hit `hit`, and t, u, v are 0 on a hit; with --all-hits, --count and --crossings what is said there;
    /// with next_direction `next_t` and `next_primitive`; with --counters `work_steps` and so on, and `next_work_steps`
    /// and so on.
    #[arg(short, long, value_name = "HITS.npz", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    /// Only find out whether each ray hits anything.
    #[arg(long)]
    any_hit: bool,
    /// Find all hits of each ray, or the N closest ones.
    ///
    /// The arrays are then `count` of each ray, and `t`, `primitive`, `u`, `v` of all hits, those of the first ray
    /// first, the closest first; of hits at the same t that of the lower triangle number.
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, conflicts_with = "any_hit")]
    #[arg(default_missing_value = "4294967295", value_parser = clap::value_parser!(u32).range(1..))]
    all_hits: Option<u32>,
    /// Only count all hits of each ray: the array `count`.
    #[arg(long, conflicts_with_all = ["any_hit", "all_hits"])]
    count: bool,
    /// Count how often each ray crosses a surface: the array `count`.
    ///
    /// Through an edge or a vertex once, and not where it only touches one: of a closed mesh a ray from inside to
    /// outside has an odd number.
    #[arg(long, conflicts_with_all = ["any_hit", "all_hits", "count"])]
    crossings: bool,
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

impl TraceArgs {
    /// How many hits of each ray are looked for, if not the closest one alone, or any.
    fn most(&self) -> Option<u32> {
        if self.count || self.crossings { Some(u32::MAX) } else { self.all_hits }
    }

    /// The option, if there is one, with which there are no second rays.
    fn without_second_rays(&self) -> Option<&'static str> {
        let given = [
            (self.any_hit, "--any-hit"),
            (self.count, "--count"),
            (self.crossings, "--crossings"),
            (self.all_hits.is_some(), "--all-hits"),
        ];
        given.into_iter().find_map(|(is_given, option)| is_given.then_some(option))
    }
}

/// What is told of a traced batch.
struct Told {
    rays_that_hit: u64,
    /// Hits of all rays, where they were counted.
    all_hits: Option<u64>,
    /// The work on rays and on second rays.
    work: Option<[Vec<RayWork>; 2]>,
    kernel_s: Vec<f64>,
    second_pass: Option<u64>,
    sort_s: Option<f64>,
    extreme_s: Option<f64>,
    upload_s: f64,
    read_s: f64,
}

/// Traces closest hits, or any, and writes them.
fn trace(args: &TraceArgs, rays: &TracingBatch, tracer: &mut dyn Backend, progress: Progress) -> Result<Told> {
    let result = tracer.trace(&rays.job(args.any_hit, args.repeat), progress)?;
    if let Some(output) = &args.output {
        hit_batch(&result, args.any_hit).write(output)?;
    }
    Ok(Told {
        rays_that_hit: result.hits.iter().filter(|hit| is_hit(hit)).count() as u64,
        all_hits: None,
        work: result.work.map(|work| [work, result.next_work.unwrap_or_default()]),
        kernel_s: result.kernel_s,
        second_pass: result.second_pass,
        sort_s: result.sort_s,
        extreme_s: result.extreme_s,
        upload_s: result.upload_s,
        read_s: result.read_s,
    })
}

/// Traces all hits, or the `most` closest ones, and writes them, or how many there are, or how often surfaces are
/// crossed.
fn trace_all(
    args: &TraceArgs,
    (given, rays, most): (&RayBatch, &TracingBatch, u32),
    budget: &MemoryBudget,
    (tracer, buffers): (&mut (dyn Backend + 'static), &SceneBuffers),
    progress: Progress,
) -> Result<Told> {
    let (budget, wants_hits) = (Some(*budget), !args.count);
    let job = AllHitsJob { most, wants_hits, budget, ..AllHitsJob::of(&rays.job(false, 1)) };
    let mut kernel_s = Vec::new();
    let mut pass = |number: u32| -> Result<AllHits> {
        let progress = |done: f64| progress((f64::from(number) + done) / f64::from(args.repeat));
        let found = tracer.trace_all(&job, &progress)?;
        kernel_s.push(found.kernel_s.iter().sum());
        Ok(found)
    };
    for number in 1..args.repeat {
        pass(number - 1)?;
    }
    let found = pass(args.repeat - 1)?;
    if let Some(output) = &args.output {
        let count = match args.crossings {
            true => count_crossings(buffers, &found, |i| (given.origins[i].into(), given.directions[i].into())),
            false => (0..rays.rays.len()).map(|ray| found.count(ray) as u32).collect(),
        };
        let hits = args.all_hits.map(|_| &found.hits[..]);
        AllHitsBatch::new(count, hits, found.work.clone()).write(output)?;
    }
    Ok(Told {
        rays_that_hit: (0..rays.rays.len()).filter(|&ray| found.count(ray) > 0).count() as u64,
        all_hits: found.starts.last().map(|&all| all as u64),
        work: found.work.map(|work| [work, Vec::new()]),
        kernel_s,
        second_pass: None,
        sort_s: None,
        extreme_s: found.extreme_s,
        upload_s: found.upload_s,
        read_s: found.read_s,
    })
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
    if let Some(option) = args.without_second_rays()
        && batch.next_directions.is_some()
    {
        let message = "cannot be combined with the array 'next_direction': a second ray starts at the closest hit";
        return Err(Error::option(option, message));
    }
    if talk.verbose && !batch.ignored.is_empty() {
        tell!("note: {}: arrays that mean nothing here: {}", args.rays.display(), batch.ignored.join(", "));
    }
    let loaded = open::load_for_rays(&args.scene.scene, args.scene.allow_empty, &budget, talk)?;
    files.read_scene(&loaded.scene);
    args.claim(files)?;
    let chooser = Chooser {
        counters: args.counters,
        ..Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk)
    };
    let chosen = chooser.choose(&loaded)?;
    if args.crossings {
        require_exact(chosen.options.intersector)?;
    }
    let task = if args.most().is_some() { Task::AllHits } else { Task::Batch };
    let tasks = (&[task][..], &budget);
    let mut opened = open::open(&loaded, device.as_ref(), &args.device, chosen, 1, tasks, talk)?;
    check_memory(&batch, args, &budget)?;

    let rays = tracing_batch(&batch, &opened.buffers);
    if !rays.extreme.is_empty() && !talk.quiet {
        let count = rays.extreme.len();
        tell!(
            "note: {count} rays have numbers beyond what kernels hold and are traced on the host, as exactly (see the page on exactness in the book)"
        );
    }
    let bar = Bar::new("trace", talk);
    let million_rays = batch.len() as f64 * f64::from(args.repeat) / 1e6;
    let progress = |done: f64| bar.update(done, million_rays, "M rays");
    let told = match args.most() {
        Some(most) => {
            let tracer = (opened.tracer.as_mut(), opened.buffers.as_ref());
            trace_all(args, (&batch, &rays, most), &budget, tracer, &progress)?
        }
        None => trace(args, &rays, opened.tracer.as_mut(), &progress)?,
    };
    drop(bar);

    let hits = told.rays_that_hit;
    let stats = &mut opened.stats;
    // The rays of a batch count as camera rays, whatever the caller makes of them.
    stats.rays.camera = RayCount { cast: batch.len() as u64, hit: hits };
    if let Some([first, next]) = &told.work {
        // A ray that missed has no second one.
        let next_count = if next.is_empty() { 0 } else { hits };
        stats.work = Some(WorkStats {
            camera: WorkSum::new(batch.len() as u64, first.iter().copied()),
            all: WorkSum::new(batch.len() as u64 + next_count, first.iter().chain(next).copied()),
            aovs: Vec::new(),
        });
    }
    stats.kernel_s = open::device_times(opened.tracer.as_ref(), told.kernel_s, talk);
    stats.sort_s = told.sort_s;
    stats.extreme_s = told.extreme_s;
    stats.second_pass = told.second_pass;
    stats.compile_s = Some(opened.tracer.compile_s()); // the second pass is compiled when it is needed
    stats.set_rate();
    stats.upload_s = stats.upload_s.map(|s| s + told.upload_s);
    stats.read_s = Some(told.read_s);
    stats.total_s = start.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        stats.write(path)?;
    }
    if !talk.quiet {
        let sorted = stats.sort_s.map_or(String::new(), |s| format!(" (sorted in {s:.3} s)"));
        say!(
            "{} rays{sorted}, {hits} hit{}, {} triangles on {}{}, {:.2} s",
            batch.len(),
            told.all_hits.map_or(String::new(), |all| format!(" {all} times")),
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
