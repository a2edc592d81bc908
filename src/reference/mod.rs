//! The scalar reference tracer: the same algorithms as the kernels, file for file, in plain Rust.
//!
//! The f32 twin repeats every operation of the kernels in their order (`mul_add` for `fma`), so that hits and pictures
//! agree bit for bit with a device of IEEE arithmetic. The [`oracle`] is another matter: hits in f64, against which
//! accuracy is measured.

pub mod extreme;
pub mod first_hits;
pub mod intersect;
pub mod kernels;
pub mod oracle;
mod points;
pub mod shade;
pub mod shared;
pub mod traverse;

use crate::bounds::MOST_CANDIDATES;
use crate::error::{Error, Result};
use crate::fma::with_fma;
use crate::io::film::Film;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::parallel;
use crate::ray_order::{SortRoom, go_far, sorted, trace_sorted};
use crate::shared::{COUNTERS, CameraSample, Light, RenderParams, TextureRequest};
use crate::tracer::{
    AllHits, AllHitsJob, Backend, Candidates, CandidatesJob, Progress, RenderResult, TraceJob, TraceResult,
    check_lights,
};
use extreme::{all_extreme, answer_extreme};
use kernels::closest_point::list_candidates;
use kernels::count_hits::count_chunk;
use kernels::list_hits::list_hits;
use kernels::render::{PixelRow, render_row};
use kernels::trace::{trace_chunk, trace_next_chunk};
use shade::local_light::requested_colour;
use shared::ray::NO_HIT;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// Rays that one task traces: long enough to hide the scheduler, short enough to share out evenly.
const CHUNK: usize = 256;

/// The reference tracer over one scene, on all cores.
pub struct ReferenceBackend {
    buffers: Arc<SceneBuffers>,
    options: TraceOptions,
    /// What stops calls, if something may.
    stop: Option<Arc<AtomicBool>>,
}

impl ReferenceBackend {
    /// A tracer of `buffers`, which were built with `options`.
    pub fn new(buffers: Arc<SceneBuffers>, options: TraceOptions) -> Self {
        ReferenceBackend { buffers, options, stop: None }
    }
}

impl ReferenceBackend {
    /// Room for the work on `count` rays or pixels, if it is to be counted.
    fn room_for_work<T: Clone + Default>(&self, count: usize) -> Option<Vec<T>> {
        self.options.counters.then(|| vec![T::default(); count])
    }
}

/// The parts of `work` that belong to parts of `size` items each; `None` for each of them where there is none.
fn work_of_parts<T: Send>(
    work: &mut Option<Vec<T>>,
    parts: usize,
    size: usize,
) -> impl ExactSizeIterator<Item = Option<&mut [T]>> {
    let mut all = work.as_mut().map(|work| work.chunks_mut(size.max(1)));
    (0..parts).map(move |_| all.as_mut().and_then(Iterator::next))
}

with_fma! {
    /// Evaluates the textures of some hits.
    fn texture_chunk(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        requests: &[TextureRequest],
        colours: &mut [Float4],
    ) {
        for (request, colour) in requests.iter().zip(colours) {
            *colour = Float4::new(requested_colour(buffers, options, request), 0.0);
        }
    }
}

/// The colours that textures give hits of a device, on all cores: the host's part of
/// [`TexturePass::HostPass`](crate::options::TexturePass::HostPass).
pub fn texture_colours(buffers: &SceneBuffers, options: &TraceOptions, requests: &[TextureRequest]) -> Vec<Float4> {
    let mut colours = vec![Float4::default(); requests.len()];
    let chunks = colours.chunks_mut(CHUNK).zip(requests.chunks(CHUNK));
    parallel::each(chunks, |(colours, requests)| texture_chunk(buffers, options, requests, colours));
    colours
}

impl Backend for ReferenceBackend {
    fn device_name(&self) -> &str {
        "reference"
    }

    fn options(&self) -> &TraceOptions {
        &self.options
    }

    fn stop_when(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop);
    }

    fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        check_lights(&self.buffers, lights)?;
        // Once a copy, where others have the scene, too.
        Arc::make_mut(&mut self.buffers).lights.copy_from_slice(lights);
        Ok(())
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        let pays = self.options.gains_by_sorted_rays(None);
        let trial = |job: &TraceJob, options| Self::new(self.buffers.clone(), options).trace_batch(job, &|_| ());
        let trace = |job: &TraceJob| self.trace_batch(job, progress);
        let go_far = || go_far(job, &self.options, trial);
        let (asked, params, mut room) = (self.options.ray_order, &self.buffers.params, SortRoom::default());
        let mut result = match sorted(job.rays, asked, params, pays, go_far, &mut room)? {
            Some(sorted) => trace_sorted(job, &sorted, trace)?,
            None => trace(job)?,
        };
        answer_extreme(job, &self.options, &self.buffers, &mut result);
        Ok(result)
    }

    fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits> {
        let extreme = all_extreme(job, &self.buffers);
        let start = Instant::now();
        let mut counts = vec![0; job.rays.len()];
        let mut work = self.room_for_work(counts.len());
        let done = AtomicUsize::new(0);
        let passes = if job.wants_hits { 2 } else { 1 };
        let parts = self.parts(progress, &done, passes * job.rays.len());
        let chunks = counts.chunks_mut(CHUNK).zip(work_of_parts(&mut work, job.rays.len().div_ceil(CHUNK), CHUNK));
        parallel::each(chunks.zip(job.rays.chunks(CHUNK)), |((counts, work), rays)| {
            parts.part(rays.len(), || count_chunk(&self.buffers, &self.options, rays, job.most, counts, work));
        });
        let count_s = start.elapsed().as_secs_f64();
        extreme.count_in(&mut counts);

        let mut result = AllHits { work, ..AllHits::of_counts(&counts, job.wants_hits, job.budget)? };
        let start = Instant::now();
        if job.wants_hits {
            let mut rest = result.hits.as_mut_slice();
            let of_rays = counts.iter().map(|&count| {
                let (hits, others) = std::mem::take(&mut rest).split_at_mut(count as usize);
                rest = others;
                hits
            });
            let mut of_rays: Vec<_> = of_rays.collect();
            parallel::each(of_rays.chunks_mut(CHUNK).zip(job.rays.chunks(CHUNK)), |(lists, rays)| {
                parts.part(rays.len(), || {
                    rays.iter().zip(lists).for_each(|(ray, hits)| list_hits(&self.buffers, &self.options, ray, hits));
                });
            });
        }
        parts.check_done()?;
        result.kernel_s = [count_s, start.elapsed().as_secs_f64()];
        extreme.list_in(&mut result);
        Ok(result)
    }

    fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates> {
        let start = Instant::now();
        let (total, most) = (job.points.len(), MOST_CANDIDATES as usize);
        let (mut counts, mut listed) = (vec![0; total], vec![0; most * total]);
        let done = AtomicUsize::new(0);
        let parts = self.parts(progress, &done, total);
        let chunks = counts.chunks_mut(CHUNK).zip(listed.chunks_mut(most * CHUNK));
        parallel::each(chunks.zip(job.points.chunks(CHUNK)), |((counts, listed), points)| {
            parts.part(points.len(), || list_candidates(job.scene, points, counts, listed));
        });
        parts.check_done()?;
        Ok(Candidates { counts, listed, kernel_s: start.elapsed().as_secs_f64() })
    }

    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult> {
        let start = Instant::now();
        let width = params.width as usize;
        let mut pixels = Film::try_pixels(params.film_len())?;
        let mut work = self.room_for_work(pixels.len());
        let done = AtomicUsize::new(0);
        let parts = self.parts(progress, &done, params.height as usize);
        let rows = pixels.chunks_mut(width).zip(work_of_parts(&mut work, params.height as usize, width)).enumerate();
        let counts = parallel::map(rows, |(y, (row, work))| {
            let mut counts = [0; COUNTERS];
            let row = PixelRow { y, pixels: row, counts: &mut counts };
            parts.part(1, || render_row(&self.buffers, &self.options, params, samples, row, work));
            counts
        });
        let counts = counts.into_iter().fold([0; COUNTERS], |a, b| std::array::from_fn(|i| a[i] + b[i]));
        parts.check_done()?;
        let (width, height) = params.film_size();
        let film = Film { width, height, pixels };
        let kernel_s = start.elapsed().as_secs_f64();
        Ok(RenderResult { counts, work, kernel_s, ..RenderResult::of_film(film) })
    }
}

/// Parts of a job that threads take one by one.
struct Parts<'a> {
    progress: Progress<'a>,
    done: &'a AtomicUsize,
    total: usize,
    stop: Option<&'a AtomicBool>,
}

impl Parts<'_> {
    /// Does a part of `size`, unless the job is stopped. Progress is told before it, too: where that unwinds, to stop
    /// the job, parts that other threads have not begun are not done first.
    fn part(&self, size: usize, work: impl FnOnce()) {
        let tell = |done: usize| (self.progress)(done as f64 / self.total as f64);
        tell(self.done.load(Ordering::Relaxed));
        if self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return;
        }
        work();
        tell(self.done.fetch_add(size, Ordering::Relaxed) + size);
    }

    /// Refuses a job of which parts were left out.
    fn check_done(&self) -> Result<()> {
        if self.done.load(Ordering::Relaxed) < self.total { Err(Error::Stopped) } else { Ok(()) }
    }
}

impl ReferenceBackend {
    fn parts<'a>(&'a self, progress: Progress<'a>, done: &'a AtomicUsize, total: usize) -> Parts<'a> {
        Parts { progress, done, total, stop: self.stop.as_deref() }
    }

    /// Traces a batch in the order of the job.
    fn trace_batch(&self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        let mut result = TraceResult { hits: vec![NO_HIT; job.rays.len()], ..TraceResult::default() };
        let mut next_hits = vec![NO_HIT; job.next_directions.map_or(0, <[_]>::len)];
        result.work = self.room_for_work(job.rays.len());
        result.next_work = job.next_directions.and_then(|directions| self.room_for_work(directions.len()));
        let chunks = job.rays.len().div_ceil(CHUNK);
        let done = AtomicUsize::new(0);
        let parts = self.parts(progress, &done, job.rays.len() * job.repeat as usize);
        for _ in 0..job.repeat {
            let start = Instant::now();
            let work = work_of_parts(&mut result.work, chunks, CHUNK);
            let hits = result.hits.chunks_mut(CHUNK).zip(work);
            parallel::each(hits.zip(job.rays.chunks(CHUNK)), |((hits, work), rays)| {
                parts.part(rays.len(), || trace_chunk(&self.buffers, &self.options, rays, job.any_hit, hits, work));
            });
            if let Some(directions) = job.next_directions {
                let rays = job.rays.chunks(CHUNK).zip(directions.chunks(CHUNK));
                let from = rays.zip(result.hits.chunks(CHUNK));
                let work = work_of_parts(&mut result.next_work, chunks, CHUNK);
                let next = next_hits.chunks_mut(CHUNK).zip(work).zip(from);
                parallel::each(next, |((next_hits, work), ((rays, directions), hits))| {
                    trace_next_chunk(&self.buffers, &self.options, rays, directions, hits, next_hits, work);
                });
            }
            result.kernel_s.push(start.elapsed().as_secs_f64());
        }
        parts.check_done()?;
        result.next_hits = job.next_directions.map(|_| next_hits);
        Ok(result)
    }
}
