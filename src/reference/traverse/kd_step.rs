//! Twin of `cl/traverse/kd_step.cl`: what the kd-tree's traversals share.

use crate::bounds::PLANE_ERROR;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{max_or, min_or};
use crate::reference::shared::ray::{Ray, widen_down, widen_up};
use crate::shared::KdNode;

/// A node, and the part of the ray in its cell.
#[derive(Debug, Clone, Copy, Default)]
pub struct KdCell {
    pub node: u32,
    pub t_near: f32,
    pub t_far: f32,
}

/// The root and the part of the ray in the scene's box.
#[inline(always)]
pub fn root_cell(buffers: &SceneBuffers, ray: &Ray) -> Option<KdCell> {
    let (t_near, t_far) = ray.clip_to_box(buffers.params.low.xyz(), buffers.params.high.xyz())?;
    Some(KdCell { node: 0, t_near, t_far })
}

/// The children of an inner node in the order in which the ray meets them, and bounds of the plane's t.
#[derive(Debug, Clone, Copy)]
pub struct KdSplit {
    pub first: u32,
    pub second: u32,
    pub t_low: f32,
    pub t_high: f32,
}

#[inline(always)]
pub fn kd_split(ray: &Ray, node: &KdNode) -> KdSplit {
    let axis = node.flags as usize;
    let to_split = (node.split - ray.origin[axis]) - ray.origin_low[axis];
    let inv_direction = ray.inv_direction[axis];
    let ascending = ray.direction[axis] >= 0.0;
    let outwards = if ascending { PLANE_ERROR } else { -PLANE_ERROR };
    let (first, second) = if ascending { (node.left, node.right) } else { (node.right, node.left) };
    let t_low = widen_down((to_split - outwards) * inv_direction);
    let t_high = widen_up((to_split + outwards) * inv_direction);
    KdSplit { first, second, t_low, t_high }
}

/// Goes from the inner node `node` of `cell` to the child that the ray meets, the first one if it meets both; then
/// returns the second one.
#[inline(always)]
pub fn kd_step(ray: &Ray, node: &KdNode, cell: &mut KdCell) -> Option<KdCell> {
    let split = kd_split(ray, node);
    if split.t_low > cell.t_far {
        cell.node = split.first;
        return None;
    }
    if split.t_high < cell.t_near {
        cell.node = split.second;
        return None;
    }
    let second = KdCell { node: split.second, t_near: max_or(split.t_low, cell.t_near), t_far: cell.t_far };
    cell.node = split.first;
    cell.t_far = min_or(split.t_high, cell.t_far);
    Some(second)
}
