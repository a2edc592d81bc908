//! Twin of `cl/shade/texture.cl`: filtered sRGB pictures, or procedural textures. The reasons are there.

use super::footprint::Footprint;
use super::procedural::procedural_colour;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{fma3, max_or, min_or};
use crate::shared::constants::MORE_TEXELS;
use crate::shared::{MOST_TAPS, TEXTURE_IMAGE, TextureInfo};
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

/// A level of a texture.
#[derive(Clone, Copy)]
struct TextureLevel {
    first: u32,
    width: u32,
    height: u32,
}

impl TextureLevel {
    #[inline(always)]
    fn finest(info: &TextureInfo) -> TextureLevel {
        TextureLevel { first: info.first, width: info.width, height: info.height }
    }

    #[inline(always)]
    fn next(self) -> TextureLevel {
        let half = |side: u32| (side >> 1).max(1);
        TextureLevel {
            first: self.first + self.width * self.height,
            width: half(self.width),
            height: half(self.height),
        }
    }
}

#[inline(always)]
fn sample_level(buffers: &SceneBuffers, level: TextureLevel, [u, v]: [f32; 2]) -> Vec3 {
    let (left, right, weight_x) = wrap_texel(u, level.width);
    let (top, bottom, weight_y) = wrap_texel(-v, level.height);
    let row0 = level.first + top * level.width;
    let row1 = level.first + bottom * level.width;
    let (c00, c01) = (texel(buffers, row0 + left), texel(buffers, row0 + right));
    let (c10, c11) = (texel(buffers, row1 + left), texel(buffers, row1 + right));
    let upper = fma3(c01 - c00, weight_x, c00);
    let lower = fma3(c11 - c10, weight_x, c10);
    fma3(lower - upper, weight_y, upper)
}

#[inline(always)]
fn sample_along(buffers: &SceneBuffers, level: TextureLevel, [u, v]: [f32; 2], way: [f32; 2], taps: u32) -> Vec3 {
    let share = 1.0 / taps as f32;
    let mut sum = Vec3::ZERO;
    for i in 0..taps {
        let at = (i as f32 + 0.5).mul_add(share, -0.5);
        sum += sample_level(buffers, level, [way[0].mul_add(at, u), way[1].mul_add(at, v)]);
    }
    sum * share
}

#[inline(always)]
fn texels_along(way: [f32; 2], info: &TextureInfo) -> f32 {
    let (x, y) = (way[0] * info.width as f32, way[1] * info.height as f32);
    x.mul_add(x, y * y).sqrt()
}

#[inline(always)]
fn sample_footprint(buffers: &SceneBuffers, info: &TextureInfo, uv: [f32; 2], footprint: &Footprint) -> Vec3 {
    let (along, across) = (texels_along(footprint.along, info), texels_along(footprint.across, info));
    let is_known = along.is_finite() && across.is_finite();
    let (longer, shorter, way) = match is_known {
        false => (0.0, 0.0, [0.0; 2]),
        true if along >= across => (along, across, footprint.along),
        true => (across, along, footprint.across),
    };
    let taps = (min_or(longer / max_or(shorter, 1.0), MOST_TAPS as f32).ceil() as u32).max(1);
    let width = if is_known { max_or(max_or(longer / taps as f32, shorter), 1.0) } else { MORE_TEXELS };
    let level_number = (width.to_bits() >> 23) - 127;
    let beyond = f32::from_bits((width.to_bits() & 0x7f_ffff) | 0x3f80_0000) - 1.0;
    let is_last = level_number + 1 >= info.levels;
    let mut level = TextureLevel::finest(info);
    for _ in 0..if is_last { info.levels - 1 } else { level_number } {
        level = level.next();
    }
    let colour = sample_along(buffers, level, uv, way, taps);
    if is_last || beyond == 0.0 {
        return colour;
    }
    fma3(sample_along(buffers, level.next(), uv, way, taps) - colour, beyond, colour)
}

/// Linear RGB of texture number `texture` on a surface: at texture coordinates `uv` for a picture, there alone or over
/// a footprint; at `position` ([`solid_position`](super::procedural::solid_position), tracing space) for a procedural
/// texture.
#[inline(always)]
pub fn surface_colour(
    buffers: &SceneBuffers,
    texture: u32,
    uv: [f32; 2],
    footprint: Option<&Footprint>,
    position: Vec3,
) -> Vec3 {
    let info = &buffers.textures[texture as usize];
    if info.kind != TEXTURE_IMAGE {
        return procedural_colour(info, uv, position);
    }
    match footprint {
        Some(footprint) => sample_footprint(buffers, info, uv, footprint),
        None => sample_level(buffers, TextureLevel::finest(info), uv),
    }
}
