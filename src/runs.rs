//! Batches of rays in runs: pieces of a fixed number of rays, which are traced in any order, by any tracer, with the
//! answers of the whole batch. What is finished is kept in a journal ([`BatchJournal`]).
//!
//! Exact hits, lists and counts are the same bits whatever else is traced with a ray. There as many runs are traced
//! together as take about a second: short launches keep no GPU busy, and rays are sorted best among many. Which
//! triangle the hit of an any-hit ray names, and what a method answers that is not exact, may depend on which rays
//! share a packet. Where rays share packets such runs are traced one by one, so that their bits depend on the scene,
//! the options and the run alone.
//!
//! Bad at: batches of few runs on many machines, because a part has whole runs.

mod answers;
mod kept;
mod several;
mod stored;

pub use answers::{Answers, Asked, CountedWork, write_answers};
pub use kept::{BatchId, BatchJournal, KeptRuns, RunEntry, TakeRun, read_kept_runs};
pub use several::{TakeRuns, trace_by_several};
pub use stored::StoredRuns;

use crate::budget::MemoryBudget;
use crate::crossings::count_crossings;
use crate::error::Result;
use crate::io::rays::RayBatch;
use crate::options::{PacketSize, TraceOptions};
use crate::pack::SceneBuffers;
use crate::parallel::lock;
use crate::reference::extreme::{TracingBatch, WorldRay};
use crate::renderer::Part;
use crate::several::Pace;
use crate::shared::Hit;
use crate::streamed::stream_hits;
use crate::tracer::{
    AllHits, AllHitsJob, Backend, ExtremeRay, Progress, TakeHits, TraceJob, TraceResult, is_hit, take_in_pieces,
};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Rays of a run: what two cores trace in a tenth of a second to a few seconds, 16 MiB of hits. Shuffled any-hit rays
/// that are sorted run by run take no longer than four runs that are sorted together (bunny, PoCL, two cores).
pub const RUN_RAYS: usize = 1 << 20;

/// So long take runs that are traced together, about: what is lost when the program is stopped.
const GROUP_TIME: Duration = Duration::from_secs(1);
/// How many times as many runs are traced together next, at the most.
const GROWTH: usize = 64;
/// The most runs that are traced together, so that a device need not have room for all rays: 33 million, a gigabyte,
/// and half of one for their hits.
const MOST_TOGETHER: usize = 32;

/// How a batch is cut into runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Runs {
    rays: usize,
    /// Rays of each run but the last.
    length: usize,
}

impl Runs {
    /// Of a batch of so many rays.
    pub fn new(rays: usize) -> Runs {
        Runs::of_length(rays, RUN_RAYS)
    }

    /// Of so many rays, with runs of another length than all batches have; at least 1.
    pub fn of_length(rays: usize, length: usize) -> Runs {
        Runs { rays, length: length.max(1) }
    }

    /// How many runs there are.
    pub fn count(self) -> usize {
        self.rays.div_ceil(self.length)
    }

    /// The numbers of the rays of neighbouring runs.
    pub fn rays_of(self, runs: Range<usize>) -> Range<usize> {
        let begin = |run: usize| run.saturating_mul(self.length).min(self.rays);
        begin(runs.start)..begin(runs.end)
    }

    /// How many rays a run has.
    pub fn len_of(self, run: usize) -> usize {
        self.rays_of(run..run + 1).len()
    }

    /// The runs that a part of the work has: every so many.
    pub fn of_part(self, part: Part) -> Vec<usize> {
        (part.number.max(1) as usize - 1..self.count()).step_by(part.of.max(1) as usize).collect()
    }
}

/// Rays in world units.
pub trait GivenRays: Sync {
    /// Origin and direction of one.
    fn ray(&self, number: usize) -> (Vec3, Vec3);
}

impl GivenRays for RayBatch {
    fn ray(&self, number: usize) -> (Vec3, Vec3) {
        (self.origins[number].into(), self.directions[number].into())
    }
}

/// The rays of a batch as the tracers take them.
#[derive(Clone, Copy)]
pub enum RunRays<'a> {
    /// All of them.
    Made(&'a TracingBatch),
    /// Those of one run at a time, when it is traced: a batch need not be in memory twice.
    OnDemand(&'a RaysOnDemand<'a>),
}

/// Rays that are made when they are traced: where a device takes them, or always in the same memory, as new memory is
/// cleared first, page by page, which takes as long as to make the rays.
pub struct RaysOnDemand<'a> {
    /// Makes each by its number, in world units; no secondary rays.
    ray: &'a (dyn Fn(usize) -> WorldRay + Sync),
    /// Takes their hits, if they are not wanted as answers.
    take: Option<TakeHits<'a>>,
    /// Memory of such that have been traced.
    traced: Mutex<Vec<TracingBatch>>,
}

impl<'a> RaysOnDemand<'a> {
    /// Of what makes each ray by its number: origin, direction, `t_min` and `t_max`, in world units.
    pub fn new(ray: &'a (dyn Fn(usize) -> WorldRay + Sync)) -> RaysOnDemand<'a> {
        RaysOnDemand { ray, take: None, traced: Mutex::default() }
    }

    /// The same of rays whose hits `take` is given, by many threads and in any order, while others are traced: the
    /// number of the first ray, and the hits of some. Where several devices trace the same run, they come more than
    /// once. Answers, and what was found, are empty.
    pub fn taken_by(ray: &'a (dyn Fn(usize) -> WorldRay + Sync), take: TakeHits<'a>) -> RaysOnDemand<'a> {
        RaysOnDemand { take: Some(take), ..RaysOnDemand::new(ray) }
    }

    fn with<T>(&self, buffers: &SceneBuffers, rays: Range<usize>, work: impl FnOnce(&TracingBatch) -> T) -> T {
        let mut batch = lock(&self.traced).pop().unwrap_or_default();
        buffers.batch_into(&mut batch, rays.len(), |i| (self.ray)(rays.start + i), None);
        let done = work(&batch);
        lock(&self.traced).push(batch);
        done
    }

    /// Traces some and has their hits taken by `take`; what that took.
    fn trace_taken(
        &self,
        (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
        (rays, any_hit): (Range<usize>, bool),
        take: TakeHits,
        progress: Progress,
    ) -> Result<TraceResult> {
        let ray = |i| (self.ray)(rays.start + i);
        let take_later = |first: usize, hits: &[Hit]| take(rays.start + first, hits);
        let given = (rays.len(), ray);
        if let Some(took) = stream_hits((&mut *tracer, buffers), given, any_hit, &take_later, progress)? {
            return Ok(took);
        }
        self.with(buffers, rays.clone(), |batch| {
            let mut result = tracer.trace(&batch.job(any_hit, 1), progress)?;
            take_in_pieces(take, rays.start, &std::mem::take(&mut result.hits));
            Ok(result)
        })
    }
}

impl GivenRays for RaysOnDemand<'_> {
    fn ray(&self, number: usize) -> (Vec3, Vec3) {
        let (origin, direction, ..) = (self.ray)(number);
        (origin, direction)
    }
}

/// Rays to be traced in runs.
#[derive(Clone, Copy)]
pub struct BatchJob<'a> {
    /// The rays as they were given; asked for their crossings alone.
    pub given: &'a dyn GivenRays,
    /// The same as the tracers take them.
    pub rays: RunRays<'a>,
    /// What is asked of each.
    pub asked: Asked,
    /// How much memory lists of hits may take.
    pub budget: MemoryBudget,
}

/// What was found in a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Found {
    /// Rays that hit anything.
    pub rays_that_hit: u64,
    /// Hits of all rays, as far as they were looked for.
    pub hits: u64,
}

impl Found {
    fn of_hits(hits: &[Hit]) -> Found {
        let count = hits.iter().filter(|hit| is_hit(hit)).count() as u64;
        Found { rays_that_hit: count, hits: count }
    }

    fn of_list(all: &AllHits, rays: Range<usize>) -> Found {
        let hits = (all.starts[rays.end] - all.starts[rays.start]) as u64;
        Found { rays_that_hit: rays.filter(|&ray| all.count(ray) > 0).count() as u64, hits }
    }

    /// Adds what was found in other runs. A journal may say anything: sums end at the largest number.
    pub fn add(&mut self, other: &Found) {
        self.rays_that_hit = self.rays_that_hit.saturating_add(other.rays_that_hit);
        self.hits = self.hits.saturating_add(other.hits);
    }
}

/// What runs took, as in [`TraceResult`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Took {
    /// Seconds of device time.
    pub kernel_s: f64,
    /// Seconds that it took to send rays.
    pub upload_s: f64,
    /// Seconds that it took to fetch answers.
    pub read_s: f64,
    /// Seconds that sorting took, where rays were sorted.
    pub sort_s: Option<f64>,
    /// Seconds that the host took for extreme rays, where there were any.
    pub extreme_s: Option<f64>,
    /// Rays that were decided in a second pass, where there is one.
    pub second_pass: Option<u64>,
}

impl Took {
    /// Adds what other runs took.
    pub fn add(&mut self, other: &Took) {
        let sum = |a: Option<f64>, b: Option<f64>| a.map_or(b, |a| Some(a + b.unwrap_or(0.0)));
        self.kernel_s += other.kernel_s;
        self.upload_s += other.upload_s;
        self.read_s += other.read_s;
        self.sort_s = sum(self.sort_s, other.sort_s);
        self.extreme_s = sum(self.extreme_s, other.extreme_s);
        if let Some(second) = other.second_pass {
            self.second_pass = Some(self.second_pass.unwrap_or(0).saturating_add(second));
        }
    }
}

/// Neighbouring runs that are traced.
#[derive(Debug, Clone)]
pub struct TracedRuns {
    /// Their numbers.
    pub runs: Range<usize>,
    /// The answers of all their rays.
    pub answers: Answers,
    /// What was found in each.
    pub found: Vec<Found>,
    /// What they took together.
    pub took: Took,
}

impl TracedRuns {
    /// Of one hit of each ray.
    fn of(result: TraceResult, (runs, now): (Runs, Range<usize>)) -> TracedRuns {
        let found = result.hits.chunks(runs.length).map(Found::of_hits).collect();
        TracedRuns { runs: now, found, took: Took::of(&result), answers: Answers::of(result) }
    }
}

/// Traces the `wanted` runs of a batch, in ascending order, and hands them to `done` as soon as they are finished.
///
/// # Errors
/// As [`Backend::trace`] and [`Backend::trace_all`], and those of `done`.
pub fn trace_runs(
    tracer: (&mut dyn Backend, &SceneBuffers),
    job: &BatchJob,
    wanted: (Runs, &[usize]),
    done: &mut dyn FnMut(TracedRuns) -> Result<()>,
    progress: Progress,
) -> Result<()> {
    trace_runs_at(&mut None, tracer, job, wanted, done, progress)
}

/// The same at a device's pace, in runs, which is learnt.
fn trace_runs_at(
    pace: &mut Pace,
    (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
    job: &BatchJob,
    (runs, wanted): (Runs, &[usize]),
    done: &mut dyn FnMut(TracedRuns) -> Result<()>,
    progress: Progress,
) -> Result<()> {
    let go_together = job.go_together(tracer.options());
    let (mut most, mut before) = (pace.map_or(1, |runs| runs as usize), 0);
    for neighbours in wanted.chunk_by(|a, b| a + 1 == *b) {
        let (mut next, end) = (neighbours[0], neighbours[0] + neighbours.len());
        while next < end {
            let now = next..end.min(next + most);
            let progress = |part: f64| progress((before as f64 + part * now.len() as f64) / wanted.len() as f64);
            let start = Instant::now();
            let traced = job.trace((&mut *tracer, buffers), (runs, now.clone()), &progress)?;
            if go_together {
                most = next_most(now.len(), start.elapsed());
                *pace = Some(most as u64);
            }
            done(traced)?;
            (next, before) = (now.end, before + now.len());
        }
    }
    Ok(())
}

/// How many runs are traced together next, if so many took so long.
fn next_most(runs: usize, took: Duration) -> usize {
    let in_time = runs as f64 * GROUP_TIME.as_secs_f64() / took.as_secs_f64().max(1e-3);
    (in_time as usize).clamp(1, runs.saturating_mul(GROWTH).min(MOST_TOGETHER))
}

impl BatchJob<'_> {
    /// Whether several runs are traced together: where the bits of an answer are the same whatever else is traced with
    /// its ray, and all rays are in memory in any case.
    fn go_together(&self, options: &TraceOptions) -> bool {
        let is_own = options.packet_size == PacketSize::One || (options.is_exact() && self.asked != Asked::Any);
        is_own && matches!(self.rays, RunRays::Made(_))
    }

    fn trace(
        &self,
        tracer: (&mut dyn Backend, &SceneBuffers),
        (runs, now): (Runs, Range<usize>),
        progress: Progress,
    ) -> Result<TracedRuns> {
        let (rays, any_hit) = (runs.rays_of(now.clone()), self.asked == Asked::Any);
        match self.rays {
            RunRays::Made(all) => {
                let extreme = extreme_of(all, &rays);
                // Secondary rays start at closest hits.
                let next = all.next_directions.as_deref().filter(|_| self.asked == Asked::Closest);
                let job = TraceJob {
                    rays: &all.rays[rays.clone()],
                    next_directions: next.map(|next| &next[rays]),
                    extreme: &extreme,
                    any_hit,
                    repeat: 1,
                };
                self.trace_job(tracer, &job, (runs, now), progress)
            }
            RunRays::OnDemand(made) => match made.take.filter(|_| self.asked.most().is_none()) {
                Some(take) => made
                    .trace_taken(tracer, (rays, any_hit), take, progress)
                    .map(|took| TracedRuns::of(took, (runs, now))),
                None => made.with(tracer.1, rays, |batch| {
                    self.trace_job(tracer, &batch.job(any_hit, 1), (runs, now), progress)
                }),
            },
        }
    }

    fn trace_job(
        &self,
        (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
        job: &TraceJob,
        (runs, now): (Runs, Range<usize>),
        progress: Progress,
    ) -> Result<TracedRuns> {
        let Some(most) = self.asked.most() else {
            return Ok(TracedRuns::of(tracer.trace(job, progress)?, (runs, now)));
        };
        let wants_hits = self.asked != Asked::Count;
        let job = AllHitsJob { most, wants_hits, budget: Some(self.budget), ..AllHitsJob::of(job) };
        let all = tracer.trace_all(&job, progress)?;
        let first = runs.rays_of(now.clone()).start;
        let of_run = |run: usize| {
            let Range { start, end } = runs.rays_of(run..run + 1);
            Found::of_list(&all, start - first..end - first)
        };
        let (found, took) = (now.clone().map(of_run).collect(), Took::of_list(&all));
        let counts = self.counts((buffers, &all), first);
        let hits = if self.asked.lists_hits() { all.hits } else { Vec::new() };
        Ok(TracedRuns { runs: now, answers: Answers { counts, hits, next_hits: Vec::new() }, found, took })
    }

    /// How many hits rays have, or how often they cross surfaces: those from number `first` of the batch on.
    pub fn counts(&self, (buffers, all): (&SceneBuffers, &AllHits), first: usize) -> Vec<u32> {
        match self.asked {
            Asked::Crossings => count_crossings(buffers, all, |i| self.given.ray(first + i)),
            _ => (0..all.starts.len().saturating_sub(1)).map(|ray| all.count(ray) as u32).collect(),
        }
    }
}

/// The extreme ones among some rays of a batch, numbered from the first of these on.
fn extreme_of(batch: &TracingBatch, rays: &Range<usize>) -> Vec<ExtremeRay> {
    let place = |index: usize| batch.extreme.partition_point(|ray| ray.index < index);
    let those = &batch.extreme[place(rays.start)..place(rays.end)];
    those.iter().map(|ray| ExtremeRay { index: ray.index - rays.start, ..*ray }).collect()
}

impl Took {
    fn of(result: &TraceResult) -> Took {
        let TraceResult { upload_s, read_s, sort_s, extreme_s, second_pass, .. } = *result;
        Took { kernel_s: result.kernel_s.iter().sum(), upload_s, read_s, sort_s, extreme_s, second_pass }
    }

    fn of_list(all: &AllHits) -> Took {
        let AllHits { upload_s, read_s, sort_s, extreme_s, .. } = *all;
        Took { kernel_s: all.kernel_s.iter().sum(), upload_s, read_s, sort_s, extreme_s, ..Took::default() }
    }
}

#[cfg(test)]
mod tests;
