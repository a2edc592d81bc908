//! Twin of `cl/traverse/kd_push_down.cl`.

use super::kd_restart::next_trail;
use super::kd_step::{KdCell, kd_step, root_cell};
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::min_or;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

/// Looks for nearer hits than `hit` in all leaves that the ray meets below `start`.
#[inline(always)]
pub fn push_down(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    mut start: KdCell,
    any_hit: bool,
    mut hit: Hit,
    work: &mut impl Work,
) -> Hit {
    let mut trail = 0u64;
    loop {
        let mut cell = start;
        let mut branches = 0;
        let mut pending = 0u64;
        let mut t_pending = f32::INFINITY;
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
                    t_pending = min_or(second.t_near, t_pending);
                }
                branches += 1;
            }
            node = load_node(buffers, cell.node as usize, work);
        }
        if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
            return hit;
        }
        if pending == 0 || hit.t < t_pending {
            return hit;
        }
        trail = next_trail(trail, pending);
        work.count(WorkCounter::Restarts, 1);
    }
}

#[inline(always)]
pub fn traverse_kd_push_down(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let hit = no_hit_yet(ray);
    let Some(root) = root_cell(buffers, ray) else { return hit };
    push_down(buffers, options, ray, root, any_hit, hit, work)
}
