//! Twin of `cl/traverse/octree.cl`. The reasons are there.

use super::leaf::{test_leaf, test_triangles};
use crate::bounds::SLACK;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_bounds, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet, widen_down, widen_up};
use crate::shared::{Hit, KD_LEAF, WorkCounter};

#[derive(Clone, Copy, Default)]
struct OpenNode {
    first_child: u32,
    centre: u32,
    next: u32,
    t_near: f32,
    t_far: f32,
}

/// The part of `t_near..t_far` in one half of a cell.
#[inline(always)]
fn clip_to_half(
    to_plane: f32,
    slack: f32,
    (direction, inv_direction): (f32, f32),
    beyond: bool,
    t_near: &mut f32,
    t_far: &mut f32,
) {
    let outwards = if beyond == (direction < 0.0) { slack } else { -slack };
    let t_plane = (to_plane + outwards) * inv_direction;
    if beyond {
        let t_enter = widen_down(t_plane);
        if t_enter > *t_near {
            *t_near = t_enter;
        }
    } else {
        let t_leave = widen_up(t_plane);
        if t_leave < *t_far {
            *t_far = t_leave;
        }
    }
}

/// Twin of `cl/traverse/octree.cl`.
#[inline(always)]
pub fn traverse_octree(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    let [low, high] = [0, 1].map(|corner| load_bounds(buffers, corner, work));
    let outside = low.w.to_bits() as usize;
    let outside = outside..outside + high.w.to_bits() as usize;
    if test_triangles(buffers, options, ray, outside, 0, any_hit, &mut hit, work) {
        return hit;
    }
    let (low, high) = (low.xyz(), high.xyz());
    let slack = SLACK * ray.farthest_distance(low, high);
    let Some((mut t_near, mut t_far)) = ray.clip_to_thick_box(slack, low, high) else {
        return hit;
    };
    let mirror = (0..3).fold(0, |mirror, axis| mirror | u32::from(ray.direction[axis] < 0.0) << axis);

    let mut stack = [OpenNode::default(); TraceOptions::MAX_DEPTH as usize];
    let mut depth = 0;
    let mut node_index = 0;
    loop {
        let node = load_node(buffers, node_index as usize, work);
        if node.flags == KD_LEAF {
            if test_leaf(buffers, options, ray, &node, any_hit, &mut hit, work) {
                return hit;
            }
        } else {
            stack[depth] = OpenNode { first_child: node.left, centre: node.right, next: 0, t_near, t_far };
            depth += 1;
            work.count(WorkCounter::DeepestStack, depth as u32);
        }

        let mut found = false;
        while !found {
            if depth == 0 {
                return hit;
            }
            let open = &mut stack[depth - 1];
            if open.next == 8 || hit.t < open.t_near {
                depth -= 1;
                continue;
            }
            let child = open.next;
            open.next += 1;
            work.count(WorkCounter::Steps, 1);
            let to_centre = ray.from_origin(load_bounds(buffers, open.centre as usize, work).xyz());
            (t_near, t_far) = (open.t_near, open.t_far);
            for axis in 0..3 {
                let along = (ray.direction[axis], ray.inv_direction[axis]);
                clip_to_half(to_centre[axis], slack, along, child >> axis & 1 != 0, &mut t_near, &mut t_far);
            }
            found = t_near <= t_far && hit.t >= t_near;
            node_index = open.first_child + (child ^ mirror);
        }
    }
}
