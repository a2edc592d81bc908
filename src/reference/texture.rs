//! Twin of `cl/shade/texture.cl`: bilinear sRGB pictures, or procedural textures. The reasons are there.

use super::math::fma3;
use super::procedural::procedural_colour;
use crate::pack::SceneBuffers;
use crate::shared::{TEXTURE_IMAGE, TextureInfo};
use glam::Vec3;

#[inline(always)]
/// The two texels around a texture coordinate on a side of `size` texels, and the weight of the second.
pub fn wrap_texel(t: f32, size: u32) -> (u32, u32, f32) {
    let wrapped = if t.is_finite() { t - t.floor() } else { 0.0 };
    let x = wrapped.mul_add(size as f32, -0.5);
    let floor_x = x.floor();
    let index = floor_x as i32;
    let last = size as i32 - 1;
    let low = if index < 0 {
        last
    } else if index > last {
        0
    } else {
        index
    };
    (low as u32, if low == last { 0 } else { low as u32 + 1 }, x - floor_x)
}

#[inline(always)]
fn texel(buffers: &SceneBuffers, index: u32) -> Vec3 {
    let rgba = buffers.texels[index as usize];
    let linear = |shift: u32| buffers.srgb_to_linear[(rgba >> shift & 255) as usize];
    Vec3::new(linear(0), linear(8), linear(16))
}

#[inline(always)]
fn sample_texture(buffers: &SceneBuffers, info: &TextureInfo, [u, v]: [f32; 2]) -> Vec3 {
    let (left, right, weight_x) = wrap_texel(u, info.width);
    let (top, bottom, weight_y) = wrap_texel(-v, info.height);
    let row0 = info.first + top * info.width;
    let row1 = info.first + bottom * info.width;
    let (c00, c01) = (texel(buffers, row0 + left), texel(buffers, row0 + right));
    let (c10, c11) = (texel(buffers, row1 + left), texel(buffers, row1 + right));
    let upper = fma3(c01 - c00, weight_x, c00);
    let lower = fma3(c11 - c10, weight_x, c10);
    fma3(lower - upper, weight_y, upper)
}

/// Linear RGB of texture number `texture` on a surface: at texture coordinates `uv` for a picture, at `position`
/// ([`solid_position`](super::procedural::solid_position), tracing space) for a procedural texture.
#[inline(always)]
pub fn surface_colour(buffers: &SceneBuffers, texture: u32, uv: [f32; 2], position: Vec3) -> Vec3 {
    let info = &buffers.textures[texture as usize];
    if info.kind != TEXTURE_IMAGE {
        return procedural_colour(info, uv, position);
    }
    sample_texture(buffers, info, uv)
}
