//! Twin of `cl/traverse/boxes.cl`: bounding boxes one after the other. The reasons are there.

use super::leaf::test_leaf;
use crate::bounds::SLACK;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_bounds, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::reference::shared::slab::padding_distance;
use crate::shared::{Hit, WorkCounter};

/// Every cluster whose volume the ray may meet, one after the other.
#[inline(always)]
pub fn traverse_clusters<W: Work>(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut W,
    may_meet: impl Fn(usize, &Hit, &mut W) -> bool,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    for cluster in 0..load_node(buffers, 0, work).right as usize {
        work.count(WorkCounter::Steps, 1);
        if !may_meet(cluster, &hit, work) {
            continue;
        }
        let leaf = load_node(buffers, 1 + cluster, work);
        if test_leaf(buffers, options, ray, &leaf, any_hit, &mut hit, work) {
            return hit;
        }
    }
    hit
}

/// [`padding_distance`] in the scene.
#[inline(always)]
pub fn padding_distance_in(buffers: &SceneBuffers, ray: &Ray) -> f32 {
    let (low, high) = (buffers.params.low, buffers.params.high);
    padding_distance(ray, low.xyz(), high.xyz(), high.w)
}

#[inline(always)]
pub fn traverse_boxes(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let slack = SLACK * padding_distance_in(buffers, ray);
    traverse_clusters(buffers, options, ray, any_hit, work, |cluster, hit, work| {
        let low = load_bounds(buffers, 2 * cluster, work).xyz();
        let high = load_bounds(buffers, 2 * cluster + 1, work).xyz();
        ray.clip_to_thick_box(slack, low, high).is_some_and(|(t_near, _)| hit.t >= t_near)
    })
}
