//! Twin of `cl/traverse/thesis_restart.cl`, which is wrong on purpose.

use super::NO_HIT;
use super::kd_step::root_cell;
use super::leaf::test_leaf;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::ray::Ray;
use crate::shared::{Hit, KD_LEAF};

#[inline(always)]
pub fn traverse_thesis_restart(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    let mut hit = NO_HIT;
    let Some(scene) = root_cell(buffers, ray) else { return hit };
    let mut t_max = scene.t_near;
    while t_max < scene.t_far {
        let t_min = t_max;
        t_max = scene.t_far;
        let mut node = &buffers.nodes[0];
        while node.flags != KD_LEAF {
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
            node = &buffers.nodes[next as usize];
        }
        if test_leaf(buffers, options, ray, node, any_hit, &mut hit) {
            return hit;
        }
    }
    hit
}
