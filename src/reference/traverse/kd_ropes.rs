//! Twin of `cl/traverse/kd_ropes.cl`.

use super::kd_push_down::push_down;
use super::kd_step::{kd_split, root_cell};
use super::leaf::test_leaf;
use crate::bounds::PLANE_ERROR;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_bounds, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet, widen_down, widen_up};
use crate::shared::constants::NO_AXIS;
use crate::shared::{Hit, KD_LEAF, NO_ROPE, WorkCounter};

/// The t at which the ray leaves one axis of a leaf, at the earliest (`error` negative) or latest.
#[inline(always)]
fn leave_slab(slab: &Float4, ray: &Ray, axis: usize, error: f32) -> f32 {
    let (plane, error) = if ray.direction[axis] >= 0.0 { (slab.y, error) } else { (slab.x, -error) };
    let to_plane = (plane - ray.origin[axis]) - ray.origin_low[axis];
    (to_plane + error) * ray.inv_direction[axis]
}

#[inline(always)]
fn rope_ahead(slab: &Float4, direction: f32) -> u32 {
    (if direction >= 0.0 { slab.w } else { slab.z }).to_bits()
}

#[inline(always)]
pub fn traverse_kd_ropes(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let Some(root) = root_cell(buffers, ray) else { return hit };
    let mut next = 0;
    let mut face_axis = NO_AXIS;
    let mut face_low = root.t_near;
    let mut face_high = f32::NEG_INFINITY;
    loop {
        let mut node = load_node(buffers, next as usize, work);
        while node.flags != KD_LEAF {
            work.count(WorkCounter::Steps, 1);
            let split = kd_split(ray, &node);
            if split.t_high < face_low {
                next = split.second;
            } else if node.flags as usize == face_axis || split.t_low > face_high {
                next = split.first;
            } else {
                work.count(WorkCounter::Restarts, 1);
                return push_down(buffers, options, ray, root, any_hit, hit, work);
            }
            node = load_node(buffers, next as usize, work);
        }
        if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
            return hit;
        }
        let first_slab = 3 * node.split.to_bits() as usize;
        let slabs = [
            load_bounds(buffers, first_slab, work),
            load_bounds(buffers, first_slab + 1, work),
            load_bounds(buffers, first_slab + 2, work),
        ];
        let mut t = [0.0; 3];
        for axis in 0..3 {
            t[axis] = leave_slab(&slabs[axis], ray, axis, -PLANE_ERROR);
        }
        let axis = if t[1] < t[0] {
            if t[2] < t[1] { 2 } else { 1 }
        } else if t[2] < t[0] {
            2
        } else {
            0
        };
        let exit_low = widen_down(t[axis]);
        let exit_high = widen_up(leave_slab(&slabs[axis], ray, axis, PLANE_ERROR));
        let single = (axis == 0 || widen_down(t[0]) > exit_high)
            && (axis == 1 || widen_down(t[1]) > exit_high)
            && (axis == 2 || widen_down(t[2]) > exit_high)
            && (axis == face_axis || exit_low > face_high);
        if !single {
            work.count(WorkCounter::Restarts, 1);
            return push_down(buffers, options, ray, root, any_hit, hit, work);
        }
        next = rope_ahead(&slabs[axis], ray.direction[axis]);
        if hit.t < exit_low || exit_low > root.t_far || next == NO_ROPE {
            return hit;
        }
        face_axis = axis;
        face_low = exit_low;
        face_high = exit_high;
    }
}
