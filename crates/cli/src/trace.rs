//! `raybrook trace`.

use super::code::{Code, SUCCESS};
use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::keep::{KeepArgs, journal_of, refuse_journal};
use super::keep_rays::{LazyId, RayKeeper};
use super::limit::{Limit, LimitArgs};
use super::loss::LossArgs;
use super::open::Loaded;
use super::part::PartChoice;
use super::progress::Bar;
use super::several::{self, Built};
use super::{DeviceArgs, MethodArgs, SceneArgs, Talk, heading, open, work};
use glam::Vec3;
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::choose::Chosen;
use raybrook::low_level::crossings::require_exact;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::extreme::TracingBatch;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::Kernels;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::rays::RayBatch;
use raybrook::low_level::renderer::Part;
use raybrook::low_level::runs::{Answers, Asked, BatchId, BatchJob, Found, RunRays, Runs, Took, write_answers};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::stats::{RayCount, RunStats, WorkStats};
use raybrook::low_level::tracer::{AllHits, AllHitsJob, Backend, Progress, Task, is_hit};
use raybrook::low_level::work::{RayWork, WorkSum};
use raybrook::{Error, Result};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::thread::Builder;
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
    /// Trace part I of N alone, for `raybrook merge`: into HITS.npz.part-I-of-N, by as many machines as there are
    /// parts.
    ///
    /// Every Nth run of the batch; a run has 1,048,576 rays. `auto` takes I and N from what runs the program, as for
    /// `render`. Such a file is a journal, so that the same command goes on after whatever stopped it.
    #[arg(
        long,
        help_heading = heading::OUTPUT,
        hide_short_help = true,
        value_name = "I/N|auto",
        requires = "output",
        conflicts_with_all = ["counters", "repeat", "stats"],
    )]
    part: Option<PartChoice>,
    #[command(flatten)]
    keep: KeepArgs,
    #[command(flatten)]
    limit: LimitArgs,
    /// Trace the batch N times, for timing.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    loss: LossArgs,
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
    fn claim(&self, part: Option<Part>, mut files: Files) -> Result<()> {
        files.write_if(self.output.as_deref(), "-o")?;
        refuse_journal(self.output.as_deref(), "-o")?;
        let journal = self.output.as_deref().map(|output| journal_of(output, part));
        files.write_if(journal.as_deref(), "-o, on its way,")?;
        files.write_if(self.stats.as_deref(), "--stats")
    }

    fn asked(&self) -> Asked {
        match self.all_hits {
            Some(most) => Asked::All(most),
            None if self.any_hit => Asked::Any,
            None if self.count => Asked::Count,
            None if self.crossings => Asked::Crossings,
            None => Asked::Closest,
        }
    }

    /// The output, if the batch is kept on the way to it: nothing else than its answers is asked for.
    fn kept_output(&self) -> Option<&Path> {
        self.output.as_deref().filter(|_| !self.measures())
    }

    /// Whether what is told is of the device: counted work, or times.
    fn measures(&self) -> bool {
        self.counters || self.repeat > 1
    }

    /// The option, if there is one, with which there are no secondary rays.
    fn without_secondary_rays(&self) -> Option<&'static str> {
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
    /// The work on rays and on secondary rays.
    work: Option<[Vec<RayWork>; 2]>,
    kernel_s: Vec<f64>,
    second_pass: Option<u64>,
    sort_s: Option<f64>,
    extreme_s: Option<f64>,
    upload_s: f64,
    read_s: f64,
}

impl Told {
    /// Of runs that were kept.
    fn of_runs(asked: Asked, (found, took): (Found, Took)) -> Told {
        let Took { kernel_s, upload_s, read_s, sort_s, extreme_s, second_pass } = took;
        let Found { rays_that_hit, hits } = found;
        let all_hits = asked.most().map(|_| hits);
        let kernel_s = vec![kernel_s];
        Told { rays_that_hit, all_hits, work: None, kernel_s, second_pass, sort_s, extreme_s, upload_s, read_s }
    }

    /// Has it in the statistics of a batch of so many rays.
    fn put(&self, rays: usize, stats: &mut RunStats) {
        let hits = self.rays_that_hit;
        // The rays of a batch count as camera rays, whatever the caller makes of them.
        stats.rays.camera = RayCount { cast: rays as u64, hit: hits };
        if let Some([first, next]) = &self.work {
            // A ray that missed has no second one.
            let next_count = if next.is_empty() { 0 } else { hits };
            stats.work = Some(WorkStats {
                camera: WorkSum::new(rays as u64, first.iter().copied()),
                all: WorkSum::new(rays as u64 + next_count, first.iter().chain(next).copied()),
                aovs: Vec::new(),
            });
        }
        stats.sort_s = self.sort_s;
        stats.extreme_s = self.extreme_s;
        stats.second_pass = self.second_pass;
        stats.upload_s = Some(stats.upload_s.unwrap_or(0.0) + self.upload_s);
        stats.read_s = Some(self.read_s);
    }
}

/// Traces closest hits, or any, and writes them.
fn trace(
    args: &TraceArgs,
    (job, rays): (&BatchJob, &TracingBatch),
    tracer: &mut dyn Backend,
    progress: Progress,
) -> Result<Told> {
    let result = tracer.trace(&rays.job(args.any_hit, args.repeat), progress)?;
    let rays_that_hit = result.hits.iter().filter(|hit| is_hit(hit)).count() as u64;
    if let Some(output) = &args.output {
        let work = [result.work.as_deref(), result.next_work.as_deref()];
        let (hits, next_hits) = (result.hits, result.next_hits.unwrap_or_default());
        let answers = Answers { counts: Vec::new(), hits, next_hits };
        write_answers(output, &[answers], (job.asked, rays.next_directions.is_some()), work)?;
    }
    Ok(Told {
        rays_that_hit,
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
    (job, rays, most): (&BatchJob, &TracingBatch, u32),
    (tracer, buffers): (&mut (dyn Backend + 'static), &SceneBuffers),
    progress: Progress,
) -> Result<Told> {
    let (budget, wants_hits) = (Some(job.budget), !args.count);
    let all_hits = AllHitsJob { most, wants_hits, budget, ..AllHitsJob::of(&rays.job(false, 1)) };
    let mut kernel_s = Vec::new();
    let mut pass = |number: u32| -> Result<AllHits> {
        let progress = |done: f64| progress((f64::from(number) + done) / f64::from(args.repeat));
        let found = tracer.trace_all(&all_hits, &progress)?;
        kernel_s.push(found.kernel_s.iter().sum());
        Ok(found)
    };
    for number in 1..args.repeat {
        pass(number - 1)?;
    }
    let mut found = pass(args.repeat - 1)?;
    let told = Told {
        rays_that_hit: (0..rays.rays.len()).filter(|&ray| found.count(ray) > 0).count() as u64,
        all_hits: found.starts.last().map(|&all| all as u64),
        work: found.work.take().map(|work| [work, Vec::new()]),
        kernel_s,
        second_pass: None,
        sort_s: found.sort_s,
        extreme_s: found.extreme_s,
        upload_s: found.upload_s,
        read_s: found.read_s,
    };
    if let Some(output) = &args.output {
        let counts = job.counts((buffers, &found), 0);
        let hits = if job.asked.lists_hits() { found.hits } else { Vec::new() };
        let (answers, work) = (Answers { counts, hits, next_hits: Vec::new() }, told.work.as_ref());
        write_answers(output, &[answers], (job.asked, false), [work.map(|[work, _]| &work[..]), None])?;
    }
    Ok(told)
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

/// Has a thread read rays, while drivers are loaded. What is returned waits for them.
fn begin_reading(path: &Path, budget: MemoryBudget) -> impl FnOnce() -> Result<RayBatch> {
    let path = path.to_owned();
    let read = move || RayBatch::read_within(&path, &budget);
    let thread = Builder::new().spawn(read.clone());
    move || thread.map_or_else(|_| read(), |thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
}

/// Frees rays while hits are written: gigabytes take tenths of a second.
fn free_meanwhile(rays: TracingBatch) {
    // Where there is no thread, they are freed at once.
    let _ = Builder::new().spawn(move || drop(rays));
}

/// Bytes of a ray and of its hit as the tracers take them, and once more where they are sorted or on a device.
const RAY_BYTES: usize = 3 * (size_of::<TraceRay>() + size_of::<Hit>());

/// The same of a secondary ray.
const NEXT_BYTES: usize = 3 * (size_of::<Float4>() + size_of::<Hit>());

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

/// What is to be traced.
struct Work<'a> {
    args: &'a TraceArgs,
    batch: &'a RayBatch,
    asked: Asked,
    budget: MemoryBudget,
    limit: Limit,
    talk: Talk,
}

/// What was traced, and what is told of it; nothing when the time was up before.
type Traced = Option<(Told, RunStats)>;

impl Work<'_> {
    /// The rays as the tracers of the scene take them.
    fn rays(&self, buffers: &SceneBuffers) -> TracingBatch {
        let rays = tracing_batch(self.batch, buffers);
        if !rays.extreme.is_empty() && !self.talk.quiet {
            let count = rays.extreme.len();
            tell!(
                "note: {count} rays have numbers beyond what kernels hold and are traced on the host, as exactly (see \
                 the page on exactness in the book)"
            );
        }
        rays
    }

    fn job<'j>(&'j self, rays: &'j TracingBatch) -> BatchJob<'j> {
        BatchJob { given: self.batch, rays: RunRays::Made(rays), asked: self.asked, budget: self.budget }
    }

    /// What tracers are to be prepared for.
    fn task(&self) -> Task {
        match self.asked {
            Asked::Count => Task::Counts,
            asked if asked.most().is_some() => Task::AllHits,
            _ => Task::Batch,
        }
    }

    /// Traces on one device.
    fn by_one(
        &self,
        keeper: Option<&mut RayKeeper>,
        (loaded, device): (&Loaded, Option<&DeviceHandle>),
        chosen: Chosen,
    ) -> Result<Traced> {
        let (args, talk) = (self.args, self.talk);
        let tasks = (&[self.task()][..], &self.budget);
        let opened = open::open(loaded, device, &args.device, chosen, 1, tasks, talk)?;
        check_memory(self.batch, args, &self.budget)?;
        let mut opened = args.loss.strict_if(args.measures()).guard(opened, device, talk);
        let rays = self.rays(&opened.buffers);
        let job = self.job(&rays);
        let told = match keeper {
            Some(keeper) => match self.limit.within(|| keeper.trace(&mut opened, &job, talk))? {
                Some(traced) => Told::of_runs(self.asked, traced),
                None => return Ok(None),
            },
            None => self.at_once((&job, &rays), &mut opened)?,
        };
        free_meanwhile(rays);
        let mut stats = std::mem::take(&mut opened.stats);
        told.put(self.batch.len(), &mut stats);
        opened.note_times(told.kernel_s.clone(), &mut stats, talk);
        Ok(Some((told, stats)))
    }

    /// Traces a batch of which more is told than its answers, and which is not kept on its way.
    fn at_once(&self, (job, rays): (&BatchJob, &TracingBatch), opened: &mut open::Opened) -> Result<Told> {
        let (args, bar) = (self.args, Bar::new("trace", self.talk));
        let million_rays = rays.rays.len() as f64 * f64::from(args.repeat) / 1e6;
        let progress = |done: f64| bar.update(done, million_rays, "M rays");
        match job.asked.most() {
            Some(most) => {
                let tracer = (opened.tracer.as_mut(), opened.buffers.as_ref());
                trace_all(args, (job, rays, most), tracer, &progress)
            }
            None => trace(args, (job, rays), opened.tracer.as_mut(), &progress),
        }
    }

    /// Traces on several devices.
    fn by_several(
        &self,
        keeper: &mut RayKeeper,
        (loaded, devices): (&Loaded, &[Option<DeviceHandle>]),
        chosen: &[Chosen],
    ) -> Result<Traced> {
        let (args, talk) = (self.args, self.talk);
        let built = Built::new(loaded, (devices, chosen), &self.budget)?;
        check_memory(self.batch, args, &self.budget)?;
        let devices = built.devices(&args.device, (self.task(), 1), args.loss)?;
        let traced = std::thread::scope(|scope| {
            let devices = devices.opened_by(scope);
            // Tracing space is the same for every structure.
            let rays = self.rays(built.first());
            let traced = keeper.trace_by(devices, &self.job(&rays), (args.loss, talk));
            free_meanwhile(rays);
            traced
        });
        let (traced, shares, lost) = match traced {
            Err(Error::Stopped) if self.limit.is_over() => return Ok(None),
            other => other?,
        };
        let told = Told::of_runs(self.asked, traced);
        let mut stats = built.stats(shares, lost);
        told.put(self.batch.len(), &mut stats);
        Ok(Some((told, stats)))
    }
}

pub fn run(args: &TraceArgs, talk: Talk) -> Result<Code> {
    let start = Instant::now();
    let limit = args.limit.begin(start);
    if limit.is_set() && args.kept_output().is_none() {
        let message = "what is finished is kept beside the output of -o, and neither with --repeat nor with --counters";
        return Err(Error::option(limit.option(), message));
    }
    let options = args.method.check(args.counters)?;
    if options.picture.kernels != Kernels::Mega {
        let message =
            format!("{} is for pictures: a batch of rays has one kernel, {}", options.picture.kernels, Kernels::Mega);
        return Err(Error::option("--kernels", message));
    }
    let part = args.part.map(PartChoice::part).transpose()?;
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    files.read(&args.rays, "the file of rays");
    args.claim(part, files.clone())?;
    for output in args.output.iter().chain(&args.stats) {
        check_writable(output)?;
    }
    let budget = args.scene.memory.budget();
    let rays = begin_reading(&args.rays, budget);
    let devices = several::choose(&args.device, talk)?;
    if devices.len() > 1 && args.measures() {
        let message = "work is counted, and batches are timed again and again, on one device; name one";
        return Err(Error::option("--device", message));
    }
    let device = devices.first().cloned().flatten();
    let batch = rays()?;
    if let Some(option) = args.without_secondary_rays()
        && batch.next_directions.is_some()
    {
        let message = "cannot be combined with the array 'next_direction': a secondary ray starts at the closest hit";
        return Err(Error::option(option, message));
    }
    if talk.verbose && !batch.ignored.is_empty() {
        tell!("note: {}: arrays that mean nothing here: {}", args.rays.display(), batch.ignored.join(", "));
    }
    let loaded = open::load_for_rays(&args.scene.scene, args.scene.allow_empty, &budget, talk)?;
    files.read_scene(&loaded.scene);
    args.claim(part, files)?;
    let chooser = Chooser {
        counters: args.counters,
        ..Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk)
    };
    let mut chosen = several::choose_methods(&chooser, &devices, &loaded)?;
    if args.crossings {
        require_exact(chosen[0].options.intersector)?;
    }
    let asked = args.asked();
    let runs = Runs::new(batch.len());
    let (scene, given, options) = (&loaded.scene, &batch, chosen[0].options);
    let id = LazyId::new(Box::new(move || BatchId::new(scene, (given, runs), asked, &options)));
    let mut keeper = match (args.kept_output(), devices.len()) {
        (Some(output), _) => Some(RayKeeper::open((&args.keep, limit), (output, part), (id, runs), talk)?),
        (None, 1) => None,
        // Without an output there is no place for a journal.
        (None, _) => Some(RayKeeper::open((&KeepArgs::nothing(), limit), (Path::new(""), None), (id, runs), talk)?),
    };
    let work = Work { args, batch: &batch, asked, budget, limit, talk };
    let traced = match (&mut keeper, devices.len()) {
        (Some(keeper), 2..) => work.by_several(keeper, (&loaded, &devices), &chosen)?,
        (keeper, _) => work.by_one(keeper.as_mut(), (&loaded, device.as_ref()), chosen.swap_remove(0))?,
    };
    let Some((told, mut stats)) = traced else { return Ok(limit.end(talk)) };
    match (keeper, part, args.kept_output()) {
        (Some(keeper), Some(part), _) => return keeper.finish_part(part, talk).map(|()| SUCCESS),
        (Some(keeper), None, Some(output)) => keeper.write(output, asked, batch.next_directions.is_some())?,
        _ => {}
    }
    stats.total_s = start.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        stats.write(path)?;
    }
    say_traced(batch.len(), &told, &stats, talk);
    Ok(SUCCESS)
}

/// Tells what came of a batch of so many rays.
fn say_traced(rays: usize, told: &Told, stats: &RunStats, talk: Talk) {
    if !talk.quiet {
        let sorted = stats.sort_s.map_or(String::new(), |s| format!(" (sorted in {s:.3} s)"));
        say!(
            "{rays} rays{sorted}, {} hit{}, {} triangles on {}{}, {:.2} s",
            told.rays_that_hit,
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
}
