//! The scalar reference tracer: the same algorithms as the kernels, file for file, in plain Rust.
//!
//! The f32 twin repeats every operation of the kernels in their order (`mul_add` for `fma`), so that hits and pictures agree bit
//! for bit with a device of IEEE arithmetic. The [`oracle`] is another matter: hits in f64, against which accuracy is
//! measured.

pub mod edges;
pub mod exact;
pub mod exact_integers;
mod fma;
pub mod footprint;
pub mod instances;
pub mod integer;
pub mod intersect;
pub mod light;
pub mod math;
pub mod memory;
pub mod normal;
pub mod oracle;
pub mod procedural;
pub mod ray;
pub mod render;
pub mod slab;
pub mod surface;
pub mod texture;
pub mod ties;
pub mod traverse;
pub mod whitted;

use crate::error::Result;
use crate::film::Film;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::ray_order::trace_in_order;
use crate::shared::{COUNTERS, CameraSample, Hit, NO_PRIMITIVE, RenderParams, TextureRequest, TraceRay};
use crate::tracer::{Progress, RenderResult, TraceJob, TraceResult, Tracer, is_hit};
use crate::work::{PixelWork, RayWork};
use fma::with_fma;
use glam::Vec3;
use math::{abs3, exponent_field, max_component};
use memory::{NoWork, Work};
use ray::Ray;
use rayon::prelude::*;
use render::{RenderedPixel, render_pixel};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use surface::{leave_surface, surface_hit, surface_point};
use traverse::{NO_HIT, closest_hit, finish, traverse};

/// Rays that one task traces: long enough to hide the scheduler, short enough to share out evenly.
const CHUNK: usize = 256;

/// The reference tracer over one scene, on all cores.
pub struct ReferenceTracer {
    buffers: Arc<SceneBuffers>,
    options: TraceOptions,
}

impl ReferenceTracer {
    /// A tracer of `buffers`, which were built with `options`.
    pub fn new(buffers: Arc<SceneBuffers>, options: TraceOptions) -> Self {
        ReferenceTracer { buffers, options }
    }
}

with_fma! {
    /// Renders one row of pixels and adds its rays to `counts`; counts the work if there is room for it.
    fn render_row(
        tracer: &ReferenceTracer,
        params: &RenderParams,
        samples: &[CameraSample],
        y: usize,
        row: &mut [[f32; 3]],
        counts: &mut [u64; COUNTERS],
        work: Option<&mut [PixelWork]>,
    ) {
        match work {
            None => tracer.render_row::<NoWork>(params, samples, y, row, counts, |_, _| ()),
            Some(work) => tracer.render_row::<RayWork>(params, samples, y, row, counts, |x, pixel| {
                work[x] = PixelWork { camera: pixel.camera_work, secondary: pixel.secondary_work };
            }),
        }
    }
}

with_fma! {
    /// Traces some rays; counts the work if there is room for it.
    fn trace_chunk(
        tracer: &ReferenceTracer,
        rays: &[TraceRay],
        any_hit: bool,
        hits: &mut [Hit],
        work: Option<&mut [RayWork]>,
    ) {
        let queries = rays.iter().zip(hits);
        match work {
            None => queries.for_each(|(ray, hit)| *hit = tracer.trace_query(ray, any_hit, &mut NoWork)),
            Some(work) => queries.zip(work).for_each(|((ray, hit), work)| {
                *work = RayWork::default();
                *hit = tracer.trace_query(ray, any_hit, work);
            }),
        }
    }
}

with_fma! {
    /// Traces the second rays of some hits; counts the work if there is room for it.
    fn trace_next_chunk(
        tracer: &ReferenceTracer,
        rays: &[TraceRay],
        directions: &[Float4],
        hits: &[Hit],
        next_hits: &mut [Hit],
        work: Option<&mut [RayWork]>,
    ) {
        let queries = rays.iter().zip(directions).zip(hits).zip(next_hits);
        match work {
            None => queries.for_each(|(((ray, to), from), hit)| {
                *hit = tracer.trace_next_query(ray, to, from, &mut NoWork);
            }),
            Some(work) => queries.zip(work).for_each(|((((ray, to), from), hit), work)| {
                *work = RayWork::default();
                *hit = tracer.trace_next_query(ray, to, from, work);
            }),
        }
    }
}

/// A hit in the caller's units of t, in which what is farther than every float is not hit.
#[inline(always)]
fn batch_hit(hit: Hit) -> Hit {
    if is_hit(&hit) && hit.t.is_finite() { hit } else { NO_HIT }
}

/// Twin of `use_callers_units` in `cl/traverse/batch.cl`.
#[inline(always)]
fn use_callers_units(ray: &mut Ray, direction: Vec3, scale: f32) {
    let highest = |v: Vec3| exponent_field(max_component(abs3(v)));
    let exponent = highest(ray.direction) - highest(direction) + 127 - exponent_field(scale);
    let power = |exponent: i32| f32::from_bits(((exponent + 127) as u32) << 23);
    ray.t_lift = power(exponent / 2);
    ray.t_scale = power(exponent - exponent / 2);
}

/// The ray of a query.
#[inline(always)]
fn batch_ray(query: &TraceRay, scale: f32) -> Ray {
    let (origin, direction) = (query.origin_t_min, query.direction_t_max);
    let mut ray = Ray::new(origin.xyz(), direction.xyz(), 0.0, f32::INFINITY, NO_PRIMITIVE);
    if ray.t_near <= ray.t_far {
        use_callers_units(&mut ray, direction.xyz(), scale);
        if origin.w <= direction.w {
            ray.limit(origin.w, direction.w);
        } else {
            (ray.t_near, ray.t_far) = (f32::INFINITY, f32::NEG_INFINITY);
        }
    }
    ray
}

impl ReferenceTracer {
    #[inline(always)]
    fn render_row<W: Work>(
        &self,
        params: &RenderParams,
        samples: &[CameraSample],
        y: usize,
        row: &mut [[f32; 3]],
        counts: &mut [u64; COUNTERS],
        mut done: impl FnMut(usize, RenderedPixel<W>),
    ) {
        for (x, out) in row.iter_mut().enumerate() {
            let pixel = render_pixel(&self.buffers, &self.options, params, samples, x, y);
            *out = pixel.radiance.to_array();
            for (total, count) in counts.iter_mut().zip(pixel.counts) {
                *total += u64::from(count);
            }
            done(x, pixel);
        }
    }

    #[inline(always)]
    fn trace_query(&self, query: &TraceRay, any_hit: bool, work: &mut impl Work) -> Hit {
        let ray = batch_ray(query, self.buffers.params.scale);
        let mut hit = traverse(&self.buffers, &self.options, &ray, any_hit, work);
        if any_hit {
            return if is_hit(&hit) { Hit { t: 0.0, u: 0.0, v: 0.0, ..hit } } else { NO_HIT };
        }
        finish(&self.buffers, &self.options, &ray, &mut hit);
        batch_hit(hit)
    }

    #[inline(always)]
    fn trace_next_query(&self, query: &TraceRay, direction: &Float4, from: &Hit, work: &mut impl Work) -> Hit {
        if !is_hit(from) {
            return NO_HIT;
        }
        let scale = self.buffers.params.scale;
        let left = surface_hit(&self.buffers, &self.options, &batch_ray(query, scale), from);
        let point = surface_point(&self.buffers, &self.options, &left);
        let mut ray = leave_surface(&point, direction.xyz(), f32::INFINITY);
        if ray.t_near <= ray.t_far {
            use_callers_units(&mut ray, direction.xyz(), scale);
        }
        batch_hit(closest_hit(&self.buffers, &self.options, &ray, work))
    }

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
) -> impl IndexedParallelIterator<Item = Option<&mut [T]>> {
    let mut all = work.as_mut().map(|work| work.chunks_mut(size.max(1)));
    (0..parts).map(|_| all.as_mut().and_then(Iterator::next)).collect::<Vec<_>>().into_par_iter()
}

with_fma! {
    /// Evaluates the textures of some hits.
    fn texture_chunk(buffers: &SceneBuffers, options: &TraceOptions, requests: &[TextureRequest], colours: &mut [Float4]) {
        for (request, colour) in requests.iter().zip(colours) {
            *colour = Float4::new(render::requested_colour(buffers, options, request), 0.0);
        }
    }
}

/// The colours that textures give hits of a device, on all cores: the host's part of
/// [`TexturePass::HostPass`](crate::options::TexturePass::HostPass).
pub fn texture_colours(buffers: &SceneBuffers, options: &TraceOptions, requests: &[TextureRequest]) -> Vec<Float4> {
    let mut colours = vec![Float4::default(); requests.len()];
    let chunks = colours.par_chunks_mut(CHUNK).zip(requests.par_chunks(CHUNK));
    chunks.for_each(|(colours, requests)| texture_chunk(buffers, options, requests, colours));
    colours
}

impl Tracer for ReferenceTracer {
    fn device_name(&self) -> &str {
        "reference"
    }

    fn compile_s(&self) -> f64 {
        0.0
    }

    fn upload_s(&self) -> f64 {
        0.0
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        trace_in_order(job, &self.options, None, &self.buffers, |job| Ok(self.trace_batch(job, progress)))
    }

    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult> {
        let start = Instant::now();
        let width = params.width as usize;
        let mut pixels = Film::try_pixels(params.film_len())?;
        let mut work = self.room_for_work(pixels.len());
        let done = AtomicUsize::new(0);
        let counts = pixels
            .par_chunks_mut(width)
            .zip(work_of_parts(&mut work, params.height as usize, width))
            .enumerate()
            .map(|(y, (row, work))| {
                let mut counts = [0; COUNTERS];
                render_row(self, params, samples, y, row, &mut counts, work);
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / f64::from(params.height));
                counts
            })
            .reduce(|| [0; COUNTERS], |a, b| std::array::from_fn(|i| a[i] + b[i]));
        let (width, height) = params.film_size();
        let film = Film { width, height, pixels };
        let kernel_s = start.elapsed().as_secs_f64();
        Ok(RenderResult {
            film,
            counts,
            work,
            second_pass: None,
            kernel_s,
            read_s: 0.0,
            wavefront: None,
            adaptive: None,
        })
    }
}

impl ReferenceTracer {
    /// Traces a batch in the order of the job.
    fn trace_batch(&self, job: &TraceJob, progress: Progress) -> TraceResult {
        let mut result = TraceResult { hits: vec![NO_HIT; job.rays.len()], ..TraceResult::default() };
        let mut next_hits = vec![NO_HIT; job.next_directions.map_or(0, <[_]>::len)];
        result.work = self.room_for_work(job.rays.len());
        result.next_work = job.next_directions.and_then(|directions| self.room_for_work(directions.len()));
        let chunks = job.rays.len().div_ceil(CHUNK);
        let done = AtomicUsize::new(0);
        let total = job.rays.len() * job.repeat as usize;
        for _ in 0..job.repeat {
            let start = Instant::now();
            let work = work_of_parts(&mut result.work, chunks, CHUNK);
            let hits = result.hits.par_chunks_mut(CHUNK).zip(work);
            hits.zip(job.rays.par_chunks(CHUNK)).for_each(|((hits, work), rays)| {
                trace_chunk(self, rays, job.any_hit, hits, work);
                progress((done.fetch_add(rays.len(), Ordering::Relaxed) + rays.len()) as f64 / total as f64);
            });
            if let Some(directions) = job.next_directions {
                let rays = job.rays.par_chunks(CHUNK).zip(directions.par_chunks(CHUNK));
                let from = rays.zip(result.hits.par_chunks(CHUNK));
                let work = work_of_parts(&mut result.next_work, chunks, CHUNK);
                let next = next_hits.par_chunks_mut(CHUNK).zip(work).zip(from);
                next.for_each(|((next_hits, work), ((rays, directions), hits))| {
                    trace_next_chunk(self, rays, directions, hits, next_hits, work);
                });
            }
            result.kernel_s.push(start.elapsed().as_secs_f64());
        }
        result.next_hits = job.next_directions.map(|_| next_hits);
        result
    }
}
