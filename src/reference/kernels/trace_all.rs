//! Twin of `cl/kernels/trace_all.cl`: all hits of rays. The reasons are there.

use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::shared::fma::with_fma;
use crate::reference::shared::math::{max_or, min_or};
use crate::reference::shared::memory::{NoWork, Work};
use crate::reference::shared::ray::Ray;
use crate::reference::traverse::batch::batch_ray;
use crate::reference::traverse::{finish, traverse};
use crate::shared::{Hit, NO_PRIMITIVE, TraceRay};
use crate::work::RayWork;

/// Goes on to the ray's next hit, of which the primitive alone is final unless t, u and v are wanted.
#[inline(always)]
fn next_of_batch(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &mut Ray,
    is_wanted: bool,
    work: &mut impl Work,
) -> Option<Hit> {
    let mut hit = traverse(buffers, options, ray, false, work);
    if hit.primitive == NO_PRIMITIVE {
        return None;
    }
    let least_t = if options.intersector == Intersector::Exact { hit.u } else { hit.t };
    ray.after = hit;
    ray.t_near = max_or(ray.t_near, min_or(least_t, ray.t_far));
    if is_wanted || !ray.callers_t(hit.t).is_finite() {
        finish(buffers, options, ray, &mut hit);
    }
    hit.t.is_finite().then_some(hit)
}

#[inline(always)]
fn count_hits(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    query: &TraceRay,
    most: u32,
    work: &mut impl Work,
) -> u32 {
    let mut ray = batch_ray(query, buffers.params.scale);
    let mut count = 0;
    while count < most && next_of_batch(buffers, options, &mut ray, false, work).is_some() {
        count += 1;
    }
    count
}

with_fma! {
    /// How many hits each of some rays has, up to `most`; counts the work if there is room for it.
    pub fn count_chunk(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        rays: &[TraceRay],
        most: u32,
        counts: &mut [u32],
        work: Option<&mut [RayWork]>,
    ) {
        let queries = rays.iter().zip(counts);
        match work {
            None => queries.for_each(|(ray, count)| *count = count_hits(buffers, options, ray, most, &mut NoWork)),
            Some(work) => queries.zip(work).for_each(|((ray, count), work)| {
                *work = RayWork::default();
                *count = count_hits(buffers, options, ray, most, work);
            }),
        }
    }
}

with_fma! {
    /// The hits of a ray, the closest first, as many as there is room for: not more than it has.
    pub fn list_hits(buffers: &SceneBuffers, options: &TraceOptions, query: &TraceRay, hits: &mut [Hit]) {
        let mut ray = batch_ray(query, buffers.params.scale);
        for hit in hits {
            if let Some(found) = next_of_batch(buffers, options, &mut ray, true, &mut NoWork) {
                *hit = found;
            }
        }
    }
}
