//! One method over one case.

use super::case::Case;
use super::judge::{Answers, Fault};
use glam::Vec3;
use raybrook::Result;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::parallel;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::Backend;
use std::sync::Arc;

/// What a tracer answered, in world units.
#[derive(Debug, Clone)]
pub struct Found {
    /// The hits.
    pub hits: Vec<Hit>,
    /// Those of the secondary rays, if the case has some.
    pub next_hits: Option<Vec<Hit>>,
}

/// The scene of a case, packed, and what traces it.
pub(super) fn open(
    case: &Case,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    cache: Option<&Cache>,
) -> Result<(Arc<SceneBuffers>, Box<dyn Backend>)> {
    let buffers = Arc::new(SceneBuffers::new(&case.mesh.scene(), options)?);
    let tracer = open_tracer(device, &buffers, options, 1, cache)?;
    Ok((buffers, tracer))
}

impl Found {
    /// Traces all rays of `case` on `device`, or on the reference when there is none.
    ///
    /// # Errors
    /// The options contradict each other, or the device failed.
    pub fn new(
        case: &Case,
        options: &TraceOptions,
        device: Option<&DeviceHandle>,
        cache: Option<&Cache>,
    ) -> Result<Found> {
        let (buffers, mut tracer) = open(case, options, device, cache)?;
        let next = |i: usize| case.rays[i].next.unwrap_or(Vec3::ZERO);
        let next: Option<&(dyn Fn(usize) -> Vec3 + Sync)> = if case.has_second_rays() { Some(&next) } else { None };
        let batch = buffers.batch(case.rays.len(), |i| case.ray(i), next);
        let result = tracer.trace(&batch.job(case.any_hit, 1), &|_| ())?;
        Ok(Found { hits: result.hits, next_hits: result.next_hits })
    }

    /// The rays with wrong answers, by number.
    pub fn faults(&self, answers: &Answers, strictly: bool) -> Vec<(usize, Fault)> {
        let next = |i: usize| self.next_hits.as_ref().map(|hits| &hits[i]);
        let judged = |i: usize| Some((i, answers.judge(i, &self.hits[i], next(i), strictly)?));
        parallel::flat_map_numbers(self.hits.len(), judged)
    }
}
