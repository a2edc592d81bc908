//! Twin of `cl/traverse/instances.cl`. The reasons are there.

use super::bvh2::{descend_to_leaf, pop};
use super::leaf::test_listed;
use crate::accel::{instance_of, leaf_range};
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::instances::to_primitive;
use crate::reference::shared::memory::{Work, load_instance};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::reference::shared::slab::{PairSlabs, Slabs};
use crate::shared::{BVH_END, BVH_LEAVE, Hit, INSTANCE_REACH, WorkCounter};

#[inline(always)]
pub fn traverse_instances(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let (low, high) = (buffers.params.low.xyz(), buffers.params.high.xyz());
    let outside = PairSlabs::new(&Slabs::new(ray, low, high, buffers.params.high.w));
    let mut pair = outside;
    let mut inside = 0;

    let mut stack = [BVH_END; 2 * TraceOptions::MAX_DEPTH as usize + 2];
    let mut stacked = 0;
    let mut link = 0;
    loop {
        link = descend_to_leaf(buffers, &pair, [ray.t_near, hit.t], any_hit, &mut stack, &mut stacked, link, work);
        if link == BVH_END {
            return hit;
        }
        if let Some(instance) = instance_of(link) {
            stacked += 1;
            stack[stacked] = BVH_LEAVE;
            work.count(WorkCounter::DeepestStack, stacked as u32);
            let records = load_instance(buffers, instance, work);
            pair = PairSlabs::new(&Slabs::of_instance(ray, low, high, records));
            inside = to_primitive(records);
            link = records[INSTANCE_REACH as usize].w.to_bits();
            continue;
        }
        if link == BVH_LEAVE {
            pair = outside;
        } else {
            let references = leaf_range(link).expect("the descent ends at a leaf");
            if test_listed(buffers, options, ray, references, inside, any_hit, &mut hit, work) {
                return hit;
            }
        }
        link = pop(&stack, &mut stacked);
    }
}
