//! Twin of `cl/kernels/list_hits.cl`: the hits of rays, the closest first. The reasons are there.

use crate::fma::with_fma;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::HitList;
use crate::reference::shared::ray::NO_HIT;
use crate::reference::traverse::batch::batch_ray;
use crate::reference::traverse::{finish, traverse};
use crate::shared::{Hit, TraceRay};

with_fma! {
    /// The hits of a ray, the closest first, as many as there is room for: not more than it has.
    pub fn list_hits(buffers: &SceneBuffers, options: &TraceOptions, query: &TraceRay, hits: &mut [Hit]) {
        if hits.is_empty() {
            return;
        }
        let ray = batch_ray(query, buffers.params.scale);
        let mut list = HitList { hits: &mut *hits, count: 0 };
        traverse(buffers, options, &ray, false, &mut list);
        let count = list.count;
        for hit in &mut hits[..count] {
            finish(buffers, options, &ray, hit);
        }
        hits[count..].fill(NO_HIT);
    }
}
