//! Twin of `cl/shade/scene.cl`, whose arrays are those of [`SceneBuffers`] here: what a ray sees that misses all of
//! them.

use crate::pack::SceneBuffers;
use crate::reference::shared::math::{clamp01, fma3};
use glam::Vec3;

/// The background's radiance in this direction.
#[inline(always)]
pub fn background(buffers: &SceneBuffers, direction: Vec3) -> Vec3 {
    let bottom = buffers.params.background_bottom.xyz();
    let height = clamp01(0.5f32.mul_add(direction.y, 0.5));
    fma3(buffers.params.background_top.xyz() - bottom, height, bottom)
}
