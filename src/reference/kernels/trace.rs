//! Twin of `cl/kernels/trace.cl`: batches of rays. The reasons are there.

use crate::fma::with_fma;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shade::surface::{leave_surface, surface_hit, surface_point};
use crate::reference::shared::memory::{NoWork, Work};
use crate::reference::shared::ray::NO_HIT;
use crate::reference::traverse::batch::{batch_hit, batch_ray, trace_batch, use_callers_units};
use crate::reference::traverse::query::closest_hit;
use crate::shared::{Hit, NO_PRIMITIVE, TraceRay};
use crate::work::RayWork;

with_fma! {
    /// Traces some rays; counts the work if there is room for it.
    pub fn trace_chunk(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        rays: &[TraceRay],
        any_hit: bool,
        hits: &mut [Hit],
        work: Option<&mut [RayWork]>,
    ) {
        let queries = rays.iter().zip(hits);
        match work {
            None => {
                for (ray, hit) in queries {
                    *hit = trace_batch(buffers, options, ray, any_hit, &mut NoWork);
                }
            }
            Some(work) => {
                for ((ray, hit), work) in queries.zip(work) {
                    *work = RayWork::default();
                    *hit = trace_batch(buffers, options, ray, any_hit, work);
                }
            }
        }
    }
}

/// The closest hit of the ray that leaves a hit of `query` in this direction.
#[inline(always)]
fn trace_next(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    query: &TraceRay,
    direction: &Float4,
    from: &Hit,
    work: &mut impl Work,
) -> Hit {
    if from.primitive == NO_PRIMITIVE {
        return NO_HIT;
    }
    let scale = buffers.params.scale;
    let left = surface_hit(buffers, options, &batch_ray(query, scale), from);
    let point = surface_point(buffers, options, &left);
    let mut ray = leave_surface(&point, direction.xyz(), f32::INFINITY);
    if ray.t_near <= ray.t_far {
        use_callers_units(&mut ray, direction.xyz(), scale);
    }
    batch_hit(closest_hit(buffers, options, &ray, work))
}

with_fma! {
    /// Traces the secondary rays of some hits; counts the work if there is room for it.
    pub fn trace_next_chunk(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        rays: &[TraceRay],
        directions: &[Float4],
        hits: &[Hit],
        next_hits: &mut [Hit],
        work: Option<&mut [RayWork]>,
    ) {
        let queries = rays.iter().zip(directions).zip(hits).zip(next_hits);
        match work {
            None => {
                for (((ray, to), from), hit) in queries {
                    *hit = trace_next(buffers, options, ray, to, from, &mut NoWork);
                }
            }
            Some(work) => {
                for ((((ray, to), from), hit), work) in queries.zip(work) {
                    *work = RayWork::default();
                    *hit = trace_next(buffers, options, ray, to, from, work);
                }
            }
        }
    }
}
