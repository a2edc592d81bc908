//! Twin of `cl/traverse/thesis_restart.cl`, which is wrong on purpose.

use super::kd_step::root_cell;
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

#[inline(always)]
pub fn traverse_thesis_restart(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let Some(scene) = root_cell(buffers, ray) else { return hit };
    let mut t_max = scene.t_near;
    while t_max < scene.t_far {
        work.count(WorkCounter::Restarts, u32::from(t_max > scene.t_near));
        let t_min = t_max;
        t_max = scene.t_far;
        let mut node = load_node(buffers, 0, work);
        while node.flags != KD_LEAF {
            work.count(WorkCounter::Steps, 1);
            let axis = node.flags as usize;
            let direction = ray.direction[axis];
            let t_split = (node.split - ray.origin[axis]) / direction;
            let (first, second) = if direction >= 0.0 { (node.left, node.right) } else { (node.right, node.left) };
            let mut next = first;
            if t_split >= t_max || t_split < 0.0 {
                next = first;
            } else if t_split <= t_min {
                next = second;
            } else {
                t_max = t_split;
            }
            node = load_node(buffers, next as usize, work);
        }
        if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
            return hit;
        }
    }
    hit
}
