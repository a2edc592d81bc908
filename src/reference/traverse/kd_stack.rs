//! Twin of `cl/traverse/kd_stack.cl`.

use super::kd_step::{KdCell, kd_step, root_cell};
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

#[inline(always)]
pub fn traverse_kd_stack(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let Some(mut cell) = root_cell(buffers, ray) else { return hit };
    let mut stack = [KdCell::default(); TraceOptions::MAX_DEPTH as usize];
    let mut stacked = 0;
    loop {
        let mut node = load_node(buffers, cell.node as usize, work);
        while node.flags != KD_LEAF {
            work.count(WorkCounter::Steps, 1);
            if let Some(second) = kd_step(ray, &node, &mut cell) {
                stack[stacked] = second;
                stacked += 1;
            }
            node = load_node(buffers, cell.node as usize, work);
        }
        work.count(WorkCounter::DeepestStack, stacked as u32);
        if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
            return hit;
        }
        loop {
            if stacked == 0 {
                return hit;
            }
            stacked -= 1;
            cell = stack[stacked];
            if hit.t >= cell.t_near {
                break;
            }
        }
    }
}
