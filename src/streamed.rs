//! One hit of each ray of a batch whose rays are made where a device reads them, and whose hits become what the caller
//! wants where the device writes them, so that neither lies in memory between.

use crate::error::Result;
use crate::pack::SceneBuffers;
use crate::parallel::{self, lock, unlocked};
use crate::reference::extreme::WorldRay;
use crate::shared::{Hit, TraceRay};
use crate::tracer::{Backend, ExtremeRay, Progress, RayStream, TakeHits, TraceJob, TraceResult};
use glam::Vec3;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// What callers want to know of a hit.
pub(crate) trait OfHit: Copy + Send {
    /// What they want of one.
    fn of(hit: &Hit) -> Self;

    /// What they want of many, which are in memory.
    fn of_all(hits: Vec<Hit>) -> Vec<Self> {
        parallel::map_slice(&hits, Self::of)
    }
}

/// All of it.
impl OfHit for Hit {
    fn of(hit: &Hit) -> Hit {
        *hit
    }

    fn of_all(hits: Vec<Hit>) -> Vec<Hit> {
        hits
    }
}

/// What is wanted of one hit of each of `count` rays, by a stream. `None` where `tracer` is as soon ready with all rays
/// at once.
///
/// # Errors
/// As [`Backend::trace`].
pub(crate) fn trace_streamed<T: OfHit>(
    tracer: (&mut dyn Backend, &SceneBuffers),
    (count, ray): (usize, impl Fn(usize) -> WorldRay + Sync),
    any_hit: bool,
    progress: Progress,
) -> Result<Option<Vec<T>>> {
    let (took, taken) = parallel::filled((count, RayStream::PIECE), |room| {
        let take = |first: usize, hits: &[Hit]| room.put(first, hits.iter().map(T::of));
        stream_hits(tracer, (count, ray), any_hit, &take, progress)
    });
    Ok(took?.and(taken))
}

/// Has the hits of `count` rays taken, by a stream; what that took, without hits. `None`, and whatever was taken counts
/// for nothing, where `tracer` is as soon ready with all rays at once.
///
/// # Errors
/// As [`Backend::trace`].
pub(crate) fn stream_hits(
    (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
    (count, ray): (usize, impl Fn(usize) -> WorldRay + Sync),
    any_hit: bool,
    take: TakeHits,
    progress: Progress,
) -> Result<Option<TraceResult>> {
    // Else all rays are extreme.
    if !buffers.keeps_vertices() {
        return Ok(None);
    }
    let apart = Apart::new(count);
    let make = |first: usize, places: &mut [TraceRay]| {
        buffers.make_rays(first, places, &ray, &mut |number, origin, ray| {
            apart.add(RayApart { number, ray, extreme_origin: Some(origin) });
        });
    };
    let defer = |number: usize, ray: &TraceRay| apart.add(RayApart { number, ray: *ray, extreme_origin: None });
    let take_or_keep = |first: usize, hits: &[Hit]| {
        if !apart.keep(first, hits) {
            take(first, hits);
        }
    };
    let stream = RayStream { count, any_hit, make: &make, defer: &defer, take: &take_or_keep };
    let Some(mut took) = tracer.trace_stream(&stream, progress)? else { return Ok(None) };
    let (mut apart, kept) = (unlocked(apart.rays), unlocked(apart.kept));
    if apart.is_empty() {
        return Ok(Some(took));
    }
    // Those of pieces side by side; of a ray that is there twice its extreme one last.
    apart.sort_unstable_by_key(|apart| (apart.number, apart.extreme_origin.is_some()));
    let rays: Vec<TraceRay> = apart.iter().map(|apart| apart.ray).collect();
    let extreme = |(index, apart): (usize, &RayApart)| {
        apart.extreme_origin.map(|origin| ExtremeRay { index, origin, is_second: false })
    };
    let extreme: Vec<_> = apart.iter().enumerate().filter_map(extreme).collect();
    let job = TraceJob { rays: &rays, next_directions: None, extreme: &extreme, any_hit, repeat: 1 };
    let of_apart = tracer.trace(&job, &|_| progress(1.0))?;
    for (first, mut piece) in kept {
        let [from, to] = [first, first + piece.len()].map(|end| apart.partition_point(|apart| apart.number < end));
        apart[from..to].iter().zip(&of_apart.hits[from..to]).for_each(|(RayApart { number, .. }, hit)| {
            piece[number - first] = *hit;
        });
        take(first, &piece);
    }
    took.kernel_s.extend(of_apart.kernel_s);
    if let Some(deferred) = of_apart.second_pass {
        *took.second_pass.get_or_insert(0) += deferred;
    }
    took.extreme_s = of_apart.extreme_s;
    Ok(Some(took))
}

/// A ray of a stream that is traced once this has ended.
struct RayApart {
    number: usize,
    ray: TraceRay,
    /// Where it starts, if tracing space cannot hold it.
    extreme_origin: Option<Vec3>,
}

/// Few rays, if any, and the pieces in which they are: their hits wait for those of these rays.
struct Apart {
    rays: Mutex<Vec<RayApart>>,
    has_some: Vec<AtomicBool>,
    kept: Mutex<Vec<(usize, Vec<Hit>)>>,
}

impl Apart {
    fn new(count: usize) -> Apart {
        let has_some = (0..count.div_ceil(RayStream::PIECE)).map(|_| AtomicBool::new(false)).collect();
        Apart { rays: Mutex::default(), has_some, kept: Mutex::default() }
    }

    fn add(&self, ray: RayApart) {
        self.has_some[ray.number / RayStream::PIECE].store(true, Ordering::Relaxed);
        lock(&self.rays).push(ray);
    }

    /// Keeps the hits of a piece with such rays.
    fn keep(&self, first: usize, hits: &[Hit]) -> bool {
        // Who takes hits came after who made the rays.
        let keeps = self.has_some[first / RayStream::PIECE].load(Ordering::Relaxed);
        if keeps {
            lock(&self.kept).push((first, hits.to_vec()));
        }
        keeps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::random::Random;
    use crate::reference::ReferenceBackend;
    use crate::scene::Scene;
    use crate::tracer::{AllHits, AllHitsJob, Candidates, CandidatesJob, RenderResult, is_hit};
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    /// The reference, which streams: pieces come in no order, every third ray is deferred with a wrong hit.
    struct Streaming {
        reference: ReferenceBackend,
        /// Whether the last piece is left out, as where a device is lost.
        is_lost: bool,
    }

    impl Backend for Streaming {
        fn device_name(&self) -> &str {
            self.reference.device_name()
        }

        fn options(&self) -> &TraceOptions {
            self.reference.options()
        }

        fn stop_when(&mut self, stop: Arc<AtomicBool>) {
            self.reference.stop_when(stop);
        }

        fn set_lights(&mut self, lights: &[crate::shared::Light]) -> Result<()> {
            self.reference.set_lights(lights)
        }

        fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
            self.reference.trace(job, progress)
        }

        fn trace_stream(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
            for first in (0..stream.count).step_by(RayStream::PIECE).rev() {
                let mut rays = vec![TraceRay::default(); RayStream::PIECE.min(stream.count - first)];
                (stream.make)(first, &mut rays);
                let job =
                    TraceJob { rays: &rays, next_directions: None, extreme: &[], any_hit: stream.any_hit, repeat: 1 };
                let mut hits = self.reference.trace(&job, progress)?.hits;
                // Not so in one of the pieces.
                for i in (0..hits.len()).filter(|i| (first + i).is_multiple_of(3) && first != RayStream::PIECE) {
                    hits[i] = Hit { t: 7.0, u: 0.25, v: 0.5, primitive: 0 };
                    (stream.defer)(first + i, &rays[i]);
                }
                (stream.take)(first, &hits);
                if self.is_lost {
                    return Ok(None);
                }
            }
            Ok(Some(TraceResult { kernel_s: vec![1.0], ..TraceResult::default() }))
        }

        fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits> {
            self.reference.trace_all(job, progress)
        }

        fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates> {
            self.reference.find_candidates(job, progress)
        }

        fn render(
            &mut self,
            params: &crate::shared::RenderParams,
            samples: &[crate::shared::CameraSample],
            progress: Progress,
        ) -> Result<RenderResult> {
            self.reference.render(params, samples, progress)
        }
    }

    #[test]
    fn deferred_and_extreme_rays_have_their_hits_too() {
        let mut random = Random::new(5);
        let corners: Vec<_> = (0..90).map(|_| random.vec3().to_array()).collect();
        let triangles: Vec<[u32; 3]> = (0..30).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let scene = Scene::from_mesh(&corners, &triangles).unwrap();
        let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap());
        // The far ones start beyond what tracing space holds; so do some of those that are no rays. One piece has none.
        let mut ray = |i: usize| match i % 50 {
            _ if i / RayStream::PIECE == 1 => (2.0 * random.vec3(), random.vec3(), 0.0, f32::INFINITY),
            7 => (random.vec3() * Vec3::new(1.0, 1.0, 0.0) - 3e38 * Vec3::Z, Vec3::Z, 0.0, f32::INFINITY),
            8 => (Vec3::splat(3e38), Vec3::NAN, 0.0, 1.0),
            _ => (2.0 * random.vec3(), random.vec3(), 0.0, f32::INFINITY),
        };
        let rays: Vec<WorldRay> = (0..2 * RayStream::PIECE + 100).map(&mut ray).collect();
        let given = (rays.len(), |i: usize| rays[i]);
        let reference = || ReferenceBackend::new(buffers.clone(), TraceOptions::DEFAULT);
        let mut tracer = Streaming { reference: reference(), is_lost: false };
        for any_hit in [false, true] {
            let batch = buffers.batch(rays.len(), |i| rays[i], None);
            assert!(batch.extreme.len() > 50);
            let expected = reference().trace(&batch.job(any_hit, 1), &|_| ()).unwrap().hits;
            let hits: Vec<Hit> = trace_streamed((&mut tracer, &buffers), given, any_hit, &|_| ()).unwrap().unwrap();
            let bits = |hits: &[Hit]| bytemuck::cast_slice::<_, u32>(hits).to_vec();
            assert_eq!(bits(&hits), bits(&expected));
            assert!((0..rays.len()).filter(|i| i % 50 == 7).any(|i| is_hit(&expected[i])));
        }
        tracer.is_lost = true;
        assert!(trace_streamed::<Hit>((&mut tracer, &buffers), given, false, &|_| ()).unwrap().is_none());
        let mut whole = reference();
        assert!(trace_streamed::<Hit>((&mut whole, &buffers), given, false, &|_| ()).unwrap().is_none());
    }
}
