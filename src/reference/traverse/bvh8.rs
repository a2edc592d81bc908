//! Twin of `cl/traverse/bvh8.cl`, one box and one triangle after the other. The reasons are there.

use super::leaf::test_triangles;
use super::wide_stack::{WIDTH, WideStack};
use crate::accel::leaf_range;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::intersect::filter::filter_sheared;
use crate::reference::shared::math::{max_or, min_or};
use crate::reference::shared::memory::{Work, count_packet, load_wide_link, load_wide_node, vertices};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::reference::shared::slab::Slabs;
use crate::shared::{BVH_LEAF, BVH8_NODE_RECORDS, Hit, WorkCounter};

/// When the ray enters child `lane` of a node, and leaves it.
#[inline(always)]
fn clip(node: &[u32], slabs: &Slabs, lane: usize, t_near: f32, t_limit: f32) -> [f32; 2] {
    let (mut enter, mut leave) = ([0.0; 3], [0.0; 3]);
    for axis in 0..3 {
        let plane = |high: bool| f32::from_bits(node[2 * WIDTH * axis + WIDTH * usize::from(high) + lane]);
        let is_upper_near = slabs.inv[axis] < 0.0;
        enter[axis] = plane(is_upper_near).mul_add(slabs.inv[axis], slabs.enter[axis]);
        leave[axis] = plane(!is_upper_near).mul_add(slabs.inv[axis], slabs.leave[axis]);
    }
    [
        max_or(max_or(enter[0], enter[1]), max_or(enter[2], t_near)),
        min_or(min_or(leave[0], leave[1]), min_or(leave[2], t_limit)),
    ]
}

/// Whether the filter of a packet leaves a triangle out.
#[inline(always)]
fn is_left_out(buffers: &SceneBuffers, ray: &Ray, reference: usize) -> bool {
    !filter_sheared(ray, vertices(buffers, buffers.references[reference]))
}

#[inline(always)]
pub fn traverse_bvh8(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let slabs = Slabs::new(ray, buffers.params.low.xyz(), buffers.params.high.xyz(), buffers.params.high.w);

    let mut stack = WideStack::new(buffers.stack_entries);
    let mut link = 0;
    loop {
        if link & BVH_LEAF == 0 {
            work.count(WorkCounter::Steps, 1);
            let node = load_wide_node(buffers, (BVH8_NODE_RECORDS * link) as usize, work);
            let mut intervals = [[0.0; 2]; WIDTH];
            for (lane, interval) in intervals.iter_mut().enumerate() {
                *interval = clip(node, &slabs, lane, ray.t_near, hit.t);
            }
            let is_met = |lane: &usize| intervals[*lane][0] <= intervals[*lane][1];
            stack.push(link, (0..WIDTH).filter(is_met).map(|lane| (lane, intervals[lane][0])), any_hit);
            work.count(WorkCounter::DeepestStack, stack.depth());
        } else {
            let references = leaf_range(link).expect("it is no inner node");
            work.count(WorkCounter::Leaves, 1);
            work.count(WorkCounter::EmptyLeaves, u32::from(references.is_empty()));
            let is_filtered = options.intersector.is_sheared();
            if is_filtered && !references.is_empty() {
                count_packet(work);
            }
            let mut left_out = 0;
            for reference in references.clone() {
                left_out += u32::from(is_filtered && is_left_out(buffers, ray, reference));
            }
            work.count(WorkCounter::Tests, left_out);
            for reference in references {
                if !(is_filtered && is_left_out(buffers, ray, reference))
                    && test_triangles(buffers, options, ray, reference..reference + 1, 0, any_hit, &mut hit, work)
                {
                    return hit;
                }
            }
        }
        let Some((node, lane)) = stack.next(hit.t) else { return hit };
        link = load_wide_link(buffers, node, lane, work);
    }
}
