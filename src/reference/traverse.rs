//! Twins of `cl/traverse/`: how a ray finds the triangles that it may hit. The reasons are there.

use super::grid::traverse_grid;
use super::intersect::intersect;
use super::math::{max_or, min_or};
use super::octree::traverse_octree;
use super::ray::{Ray, widen_down, widen_up};
use super::volumes::{traverse_boxes, traverse_spheres};
use crate::options::{Accel, TraceOptions, Traversal};
use crate::pack::SceneBuffers;
use crate::shared::{Hit, KD_LEAF, NO_PRIMITIVE};
use glam::Vec3;

/// The hit of a ray that missed.
pub const NO_HIT: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };

/// The vertices of a triangle, tracing space.
#[inline(always)]
pub fn vertices(buffers: &SceneBuffers, primitive: u32) -> [Vec3; 3] {
    let first = 3 * primitive as usize;
    [buffers.vertices[first].xyz(), buffers.vertices[first + 1].xyz(), buffers.vertices[first + 2].xyz()]
}

/// The closest hit of the ray, or with `any_hit` some hit; in the ray's own units of t.
#[inline(always)]
pub fn traverse(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    match (options.accel, options.traversal) {
        (Accel::Brute, _) => traverse_brute_force(buffers, options, ray, any_hit),
        (Accel::Kd, Traversal::Stack) => traverse_kd_stack(buffers, options, ray, any_hit),
        (Accel::Grid, _) => traverse_grid(buffers, options, ray, any_hit),
        (Accel::Octree, _) => traverse_octree(buffers, options, ray, any_hit),
        (Accel::Boxes, _) => traverse_boxes(buffers, options, ray, any_hit),
        (Accel::Spheres, _) => traverse_spheres(buffers, options, ray, any_hit),
    }
}

#[inline(always)]
pub(super) fn test_triangle(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, primitive: u32, hit: &mut Hit) {
    if primitive == ray.skip {
        return;
    }
    if let Some(found) = intersect(buffers, options.intersector, ray, primitive)
        && ray.is_nearer(hit, found.t, primitive)
    {
        *hit = Hit { t: found.t, u: found.u, v: found.v, primitive };
    }
}

/// Twin of `cl/traverse/brute_force.cl`.
#[inline(always)]
pub fn traverse_brute_force(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    let mut hit = NO_HIT;
    for &primitive in &buffers.references {
        test_triangle(buffers, options, ray, primitive, &mut hit);
        if any_hit && hit.primitive != NO_PRIMITIVE {
            break;
        }
    }
    hit
}

#[derive(Clone, Copy, Default)]
struct FarChild {
    node: u32,
    t_near: f32,
    t_far: f32,
}

/// Twin of `cl/traverse/kd_stack.cl`.
#[inline(always)]
pub fn traverse_kd_stack(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    let mut hit = NO_HIT;
    let Some((mut t_near, mut t_far)) = ray.clip_to_box(buffers.params.low.xyz(), buffers.params.high.xyz()) else {
        return hit;
    };
    let mut stack = [FarChild::default(); TraceOptions::MAX_DEPTH as usize];
    let mut stacked = 0;
    let mut node_index = 0;
    loop {
        let mut node = &buffers.nodes[node_index as usize];
        while node.flags != KD_LEAF {
            let axis = node.flags as usize;
            let t_split = (node.split - ray.origin[axis]) * ray.inv_direction[axis];
            let ascending = ray.direction[axis] >= 0.0;
            let (first, second) = if ascending { (node.left, node.right) } else { (node.right, node.left) };
            let t_split_low = widen_down(t_split);
            let t_split_high = widen_up(t_split);
            if t_split_low > t_far {
                node_index = first;
            } else if t_split_high < t_near {
                node_index = second;
            } else {
                stack[stacked] = FarChild { node: second, t_near: max_or(t_split_low, t_near), t_far };
                stacked += 1;
                node_index = first;
                t_far = min_or(t_split_high, t_far);
            }
            node = &buffers.nodes[node_index as usize];
        }
        for &primitive in &buffers.references[node.left as usize..(node.left + node.right) as usize] {
            test_triangle(buffers, options, ray, primitive, &mut hit);
            if any_hit && hit.primitive != NO_PRIMITIVE {
                return hit;
            }
        }
        loop {
            if stacked == 0 {
                return hit;
            }
            stacked -= 1;
            if hit.t >= stack[stacked].t_near {
                break;
            }
        }
        FarChild { node: node_index, t_near, t_far } = stack[stacked];
    }
}
