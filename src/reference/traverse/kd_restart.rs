//! Twin of `cl/traverse/kd_restart.cl`.

use super::kd_step::{kd_step, root_cell};
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::min_or;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

/// The trail that leads to the second child of the deepest pending branch.
#[inline(always)]
pub fn next_trail(trail: u64, pending: u64) -> u64 {
    let deepest = 1 << (63 - pending.leading_zeros());
    (trail & (deepest - 1)) | deepest
}

#[inline(always)]
pub fn traverse_kd_restart(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let Some(root) = root_cell(buffers, ray) else { return hit };
    let mut trail = 0u64;
    loop {
        let mut cell = root;
        let mut branch = 1u64;
        let mut pending = 0u64;
        let mut t_pending = f32::INFINITY;
        let mut node = load_node(buffers, 0, work);
        while node.flags != KD_LEAF {
            work.count(WorkCounter::Steps, 1);
            if let Some(second) = kd_step(ray, &node, &mut cell) {
                if trail & branch != 0 {
                    cell = second;
                } else if hit.t >= second.t_near {
                    pending |= branch;
                    t_pending = min_or(second.t_near, t_pending);
                }
                branch <<= 1;
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
