//! Twin of `cl/traverse/bvh2.cl`. The reasons are there.

use super::leaf::test_listed;
use crate::accel::leaf_range;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::reference::shared::slab::{PairSlabs, Slabs, is_padding_enough};
use crate::shared::{BVH_END, BVH_LEAF, BVH_NODE_RECORDS, Hit, WorkCounter};

#[inline(always)]
pub fn traverse_bvh2(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let (low, high) = (buffers.params.low.xyz(), buffers.params.high.xyz());
    let (near_reach, padding) = (buffers.params.high.w, buffers.params.low.w);
    let needs_no_padding = is_padding_enough(ray, low, high, near_reach, padding) && ray.t_near.is_sign_positive();
    let pair = PairSlabs::new(&if needs_no_padding {
        Slabs::without_padding(ray)
    } else {
        Slabs::new(ray, low, high, near_reach)
    });

    let mut stack = [BVH_END; TraceOptions::MAX_DEPTH as usize + 1];
    let mut stacked = 0;
    let mut link = 0;
    loop {
        link = descend_to_leaf(buffers, &pair, [ray.t_near, hit.t], any_hit, &mut stack, &mut stacked, link, work);
        if link == BVH_END {
            return hit;
        }
        let references = leaf_range(link).expect("the descent ends at a leaf");
        if test_listed(buffers, options, ray, references, 0, any_hit, &mut hit, work) {
            return hit;
        }
        link = pop(&stack, &mut stacked);
    }
}

/// Descends to a leaf, nearer children first, or with `any_hit` child 0, and remembers the links of the others. The
/// link of the leaf, or the end.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "those of the kernel's function")]
pub(super) fn descend_to_leaf(
    buffers: &SceneBuffers,
    pair: &PairSlabs,
    limits: [f32; 2],
    any_hit: bool,
    stack: &mut [u32],
    stacked: &mut usize,
    mut link: u32,
    work: &mut impl Work,
) -> u32 {
    while link & BVH_LEAF == 0 {
        work.count(WorkCounter::Steps, 1);
        let first = (BVH_NODE_RECORDS * link) as usize;
        let mut record = |number: usize| load_node(buffers, first + number, work);
        let (xy0, xy1, links, z1) = (record(0), record(1), record(2), record(3));
        let zz = [f32::from_bits(links.right), links.split, f32::from_bits(z1.flags), f32::from_bits(z1.left)];
        let t = pair.clip(limits, bytemuck::cast(xy0), bytemuck::cast(xy1), zz);
        let (meets0, meets1) = (t[0] <= -t[1], t[2] <= -t[3]);
        let (link0, link1) = (links.flags, links.left);
        if meets0 || meets1 {
            let goes_to1 = meets1 && (!meets0 || (!any_hit && t[2] < t[0]));
            link = if goes_to1 { link1 } else { link0 };
            stack[*stacked + 1] = if goes_to1 { link0 } else { link1 };
            *stacked += usize::from(meets0 && meets1);
            work.count(WorkCounter::DeepestStack, *stacked as u32);
        } else {
            link = pop(stack, stacked);
        }
    }
    link
}

/// What was remembered last, or the end.
#[inline(always)]
pub(super) fn pop(stack: &[u32], stacked: &mut usize) -> u32 {
    let link = stack[*stacked];
    *stacked = stacked.wrapping_sub(1); // the end's place is never asked for again
    link
}
