//! Traces aimed rays by the billion: batches are made on all cores while the device traces the one before.

use super::super::case::{Case, StressRay};
use super::super::judge::{Answers, Fault};
use super::super::tolerance::Tolerance;
use super::{AimedRay, ClosedMesh};
use raybrook::Result;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::extreme::TracingBatch;
use raybrook::low_level::options::{Intersector, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::parallel;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::{Backend, TraceResult, is_hit};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::time::Instant;

/// Rays of a batch: some 170 MB on the host, of which there are two at a time, and as much on the device.
const BATCH: u64 = 1 << 22;
/// A run ends before the next suspect after so many: each takes a look at all triangles, and more tell no more.
pub const MAX_SUSPECTS: usize = 1000;

/// What became of rays that must hit.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Leaks {
    /// Rays that were traced and judged.
    pub rays: u64,
    /// Of these, how many started inside.
    pub from_inside: u64,
    /// Of these, how many were aimed at vertices; the others at edges.
    pub at_vertices: u64,
    /// Rays, traced ones, that only exact integers could decide; `None` where they are not counted
    /// ([`TraceResult::second_pass`]).
    pub second_pass: Option<u64>,
    /// Rays that hit nothing.
    pub misses: u64,
    /// Rays that hit something else than what is due, behind where they must have hit.
    pub behind: u64,
    /// Rays that seemed to be one of these, and of which the exact answer says that the method may err so much.
    pub cleared: u64,
    /// Whether there were more than [`MAX_SUSPECTS`] suspects: the rays before the next one are all that count.
    pub is_cut_short: bool,
    /// The rays that went wrong, and how.
    #[serde(skip)]
    pub wrong: Vec<(StressRay, Fault)>,
    /// Seconds of device time.
    pub kernel_s: f64,
    /// Seconds in all.
    pub total_s: f64,
}

/// What is to be known of a ray when its hit comes back.
#[derive(Clone, Copy, Default)]
struct Promise {
    /// Rounded, as the t of hits are, which keeps their order.
    by: f32,
    is_inside: bool,
    is_at_vertex: bool,
}

struct Batch {
    first: u64,
    rays: TracingBatch,
    promises: Vec<Promise>,
}

/// Traces the rays 0 to `count` - 1 of `seed` through `closed`, on `device`, or on the reference when there is none,
/// and counts those that miss or hit too late. Whatever seems to do so is judged by exact arithmetic: strictly for
/// [`Intersector::Exact`], else as [`Answers::judge`] does it for float32 methods.
///
/// `so_far` is called from time to time with what was found until then.
///
/// # Errors
/// The options contradict each other, the device failed, or what `so_far` reports.
pub fn find_leaks(
    closed: &ClosedMesh,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    cache: Option<&Cache>,
    seed: u64,
    count: u64,
    so_far: &dyn Fn(&Leaks) -> Result<()>,
) -> Result<Leaks> {
    let start = Instant::now();
    let buffers = Arc::new(SceneBuffers::new(&closed.mesh.scene(), options)?);
    let mut tracer = open_tracer(device, &buffers, options, 1, cache)?;
    let watch = Watch { closed, buffers: &buffers, seed, is_strict: options.intersector == Intersector::Exact };
    let mut leaks = Leaks::default();
    std::thread::scope(|scope| {
        // No queue: a batch that is ready waits for the tracer, so that there are never more than two.
        let (sender, receiver) = sync_channel(0);
        let watch = &watch;
        scope.spawn(move || {
            let mut firsts = (0..count).step_by(BATCH as usize);
            // It fails when the receiver has seen enough.
            firsts.all(|first| sender.send(watch.batch(first, BATCH.min(count - first))).is_ok())
        });
        for batch in receiver {
            watch.trace(batch, tracer.as_mut(), &mut leaks)?;
            leaks.total_s = start.elapsed().as_secs_f64();
            so_far(&leaks)?;
            if leaks.is_cut_short {
                break;
            }
        }
        Ok(())
    })?;
    leaks.total_s = start.elapsed().as_secs_f64();
    Ok(leaks)
}

/// What judges a run.
struct Watch<'a> {
    closed: &'a ClosedMesh,
    buffers: &'a SceneBuffers,
    seed: u64,
    is_strict: bool,
}

impl Watch<'_> {
    fn batch(&self, first: u64, count: u64) -> Batch {
        let aimed = parallel::map_numbers(count as usize, |i| self.closed.ray(self.seed, first + i as u64));
        let ray = |i: usize| (aimed[i].origin, aimed[i].direction, 0.0, f32::INFINITY);
        let promise = |&AimedRay { by, is_inside, is_at_vertex, .. }: &AimedRay| Promise {
            by: by as f32,
            is_inside,
            is_at_vertex,
        };
        Batch {
            first,
            rays: self.buffers.batch(count as usize, ray, None),
            promises: aimed.iter().map(promise).collect(),
        }
    }

    fn trace(&self, batch: Batch, tracer: &mut dyn Backend, leaks: &mut Leaks) -> Result<()> {
        let TraceResult { hits, second_pass, kernel_s, .. } = tracer.trace(&batch.rays.job(false, 1), &|_| ())?;
        leaks.kernel_s += kernel_s.iter().sum::<f64>();
        leaks.second_pass = second_pass.map(|rays| leaks.second_pass.unwrap_or_default() + rays);

        let suspect = |i: usize| self.is_suspect(&batch, i, &hits[i]).then_some(i);
        let mut suspects = parallel::flat_map_numbers(hits.len(), suspect);
        let room = MAX_SUSPECTS - leaks.wrong.len() - leaks.cleared as usize;
        let mut judged = hits.len();
        if suspects.len() > room {
            leaks.is_cut_short = true;
            judged = suspects[room];
            suspects.truncate(room);
        }
        self.judge(&batch, &suspects, &hits, leaks);
        let count = |is_so: fn(&Promise) -> bool| {
            parallel::reduce_numbers(judged, 0, |i| u64::from(is_so(&batch.promises[i])), |a, b| a + b)
        };
        leaks.rays += judged as u64;
        leaks.from_inside += count(|promise| promise.is_inside);
        leaks.at_vertices += count(|promise| promise.is_at_vertex);
        Ok(())
    }

    /// Whether `hit`, in world units, breaks the ray's promise.
    fn is_suspect(&self, batch: &Batch, i: usize, hit: &Hit) -> bool {
        let Promise { by, .. } = batch.promises[i];
        if !is_hit(hit) {
            return true;
        }
        if hit.t <= by {
            return false;
        }
        if self.is_strict {
            return true;
        }
        let ray = self.closed.ray(self.seed, batch.first + i as u64);
        let Some(corners) = self.corners(hit.primitive) else { return true };
        let tolerance = Tolerance::of_ray(ray.origin.as_dvec3(), ray.direction.as_dvec3(), corners, 0.0);
        let t = f64::from(hit.t);
        let nearest = t - tolerance.of_t(t);
        nearest.is_nan() || nearest > f64::from(by)
    }

    fn corners(&self, primitive: u32) -> Option<[glam::DVec3; 3]> {
        let mesh = &self.closed.mesh;
        ((primitive as usize) < mesh.triangles.len()).then(|| mesh.corners(primitive as usize).map(|p| p.as_dvec3()))
    }

    /// Has exact answers for the suspects and counts them.
    fn judge(&self, batch: &Batch, suspects: &[usize], hits: &[Hit], leaks: &mut Leaks) {
        if suspects.is_empty() {
            return;
        }
        let ray = |&i: &usize| {
            let ray = self.closed.ray(self.seed, batch.first + i as u64);
            StressRay::new(ray.origin, ray.direction)
        };
        let case = Case { mesh: self.closed.mesh.clone(), rays: suspects.iter().map(ray).collect(), any_hit: false };
        let answers = Answers::new(&case);
        for (number, &i) in suspects.iter().enumerate() {
            match answers.judge(number, &hits[i], None, self.is_strict) {
                None => leaks.cleared += 1,
                Some(fault) => {
                    let count = if fault == Fault::Miss { &mut leaks.misses } else { &mut leaks.behind };
                    *count += 1;
                    leaks.wrong.push((case.rays[number], fault));
                }
            }
        }
    }
}
