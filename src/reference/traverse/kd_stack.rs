//! Twin of `cl/traverse/kd_stack.cl`.

use super::NO_HIT;
use super::kd_step::{KdCell, kd_step, root_cell};
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::ray::Ray;
use crate::shared::{Hit, KD_LEAF};

#[inline(always)]
pub fn traverse_kd_stack(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    let mut hit = NO_HIT;
    let Some(mut cell) = root_cell(buffers, ray) else { return hit };
    let mut stack = [KdCell::default(); TraceOptions::MAX_DEPTH as usize];
    let mut stacked = 0;
    loop {
        let mut node = &buffers.nodes[cell.node as usize];
        while node.flags != KD_LEAF {
            if let Some(second) = kd_step(ray, node, &mut cell) {
                stack[stacked] = second;
                stacked += 1;
            }
            node = &buffers.nodes[cell.node as usize];
        }
        if test_leaf(buffers, options, ray, node, any_hit, &mut hit) {
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
