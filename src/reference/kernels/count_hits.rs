//! Twin of `cl/kernels/count_hits.cl`: how many hits rays have. The reasons are there.

use crate::fma::with_fma;
use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{max_or, min_or};
use crate::reference::shared::memory::{NoWork, Work};
use crate::reference::shared::ray::Ray;
use crate::reference::traverse::batch::batch_ray;
use crate::reference::traverse::leaf::{counted_hits, has_float_t};
use crate::reference::traverse::traverse;
use crate::shared::{NO_PRIMITIVE, TraceRay};
use crate::work::RayWork;

/// Goes on to the ray's next hit. Whether there is one.
#[inline(always)]
fn next_of_ray(buffers: &SceneBuffers, options: &TraceOptions, ray: &mut Ray, work: &mut impl Work) -> bool {
    let hit = traverse(buffers, options, ray, false, work);
    if hit.primitive == NO_PRIMITIVE {
        return false;
    }
    let least_t = if options.intersector == Intersector::Exact { hit.u } else { hit.t };
    ray.after = hit;
    ray.t_near = max_or(ray.t_near, min_or(least_t, ray.t_far));
    has_float_t(buffers, options, ray, hit)
}

#[inline(always)]
fn count_of_ray(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    query: &TraceRay,
    most: u32,
    work: &mut impl Work,
) -> u32 {
    let mut ray = batch_ray(query, buffers.params.scale);
    if most > 0 && !options.repeats_triangles() {
        ray.most = most;
        return counted_hits(&traverse(buffers, options, &ray, true, work));
    }
    let mut count = 0;
    while count < most && next_of_ray(buffers, options, &mut ray, work) {
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
            None => {
                for (ray, count) in queries {
                    *count = count_of_ray(buffers, options, ray, most, &mut NoWork);
                }
            }
            Some(work) => {
                for ((ray, count), work) in queries.zip(work) {
                    *work = RayWork::default();
                    *count = count_of_ray(buffers, options, ray, most, work);
                }
            }
        }
    }
}
