//! Twin of `cl/traverse/kd_short_stack.cl`.

use super::kd_restart::next_trail;
use super::kd_step::{KdCell, kd_step, root_cell};
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::min_or;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

#[inline(always)]
pub fn traverse_kd_short_stack(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let Some(mut start) = root_cell(buffers, ray) else { return hit };
    let size = options.kd().short_stack_size() as usize;
    let mut ring = [KdCell::default(); TraceOptions::MAX_DEPTH as usize];
    let mut stored = 0;
    let mut top = 0;
    let mut t_forgotten = f32::INFINITY;
    let mut cell = start;
    let mut trail = 0u64;
    let mut pending = 0u64;
    let mut branches = 0;
    loop {
        let mut node = load_node(buffers, cell.node as usize, work);
        while node.flags != KD_LEAF {
            work.count(WorkCounter::Steps, 1);
            if pending == 0 {
                start = cell;
                trail >>= branches;
                branches = 0;
            }
            if let Some(second) = kd_step(ray, &node, &mut cell) {
                let branch = 1u64 << branches;
                if trail & branch != 0 {
                    cell = second;
                } else if hit.t >= second.t_near {
                    pending |= branch;
                    if stored == size {
                        t_forgotten = min_or(ring[top].t_near, t_forgotten);
                        work.count(WorkCounter::Overflows, 1);
                    } else {
                        stored += 1;
                    }
                    ring[top] = second;
                    top = if top + 1 == size { 0 } else { top + 1 };
                }
                branches += 1;
            }
            node = load_node(buffers, cell.node as usize, work);
        }
        work.count(WorkCounter::DeepestStack, stored as u32);
        if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
            return hit;
        }
        loop {
            if pending == 0 {
                return hit;
            }
            trail = next_trail(trail, pending);
            if stored == 0 {
                if hit.t < t_forgotten {
                    return hit;
                }
                work.count(WorkCounter::Restarts, 1);
                t_forgotten = f32::INFINITY;
                cell = start;
                pending = 0;
                branches = 0;
                break;
            }
            branches = 64 - pending.leading_zeros();
            pending &= !(1 << (branches - 1));
            stored -= 1;
            top = if top == 0 { size - 1 } else { top - 1 };
            cell = ring[top];
            if hit.t >= cell.t_near {
                break;
            }
        }
    }
}
