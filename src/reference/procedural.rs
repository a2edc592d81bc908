//! Twin of `cl/shade/procedural.cl`: procedural textures. The reasons are there.

use super::math::{clamp01, fma3, sin_turns};
use super::surface::Surface;
use crate::layout::Float4;
use crate::shared::{TEXTURE_CHECKER, TEXTURE_MARBLE, TEXTURE_NOISE, TextureInfo};
use glam::Vec3;

#[inline(always)]
fn split_cell(x: f32) -> (u32, f32) {
    let low = x.floor();
    if low.abs() < 2_147_483_648.0 { (low as i32 as u32, x - low) } else { (0, 0.0) }
}

#[inline(always)]
fn hash_cell(x: u32, y: u32, z: u32, seed: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9e37_79b1)
        ^ y.wrapping_mul(0x85eb_ca77)
        ^ z.wrapping_mul(0xc2b2_ae3d)
        ^ seed.wrapping_mul(0x27d4_eb2f);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

#[inline(always)]
fn along_gradient(hash: u32, x: f32, y: f32, z: f32) -> f32 {
    let g = hash & 15;
    let a = if g < 8 { x } else { y };
    let b = if g < 4 {
        y
    } else if g == 12 || g == 14 {
        x
    } else {
        z
    };
    (if g & 1 != 0 { -a } else { a }) + (if g & 2 != 0 { -b } else { b })
}

#[inline(always)]
fn fade(t: f32) -> f32 {
    t * t * t * t.mul_add(t.mul_add(6.0, -15.0), 10.0)
}

#[inline(always)]
fn mix(a: f32, b: f32, t: f32) -> f32 {
    (b - a).mul_add(t, a)
}

/// Gradient noise in about -1..1, 0 at every corner of a cell.
#[inline(always)]
pub fn gradient_noise(p: Vec3, seed: u32) -> f32 {
    let ((x, fx), (y, fy), (z, fz)) = (split_cell(p.x), split_cell(p.y), split_cell(p.z));
    let (x1, y1, z1) = (x.wrapping_add(1), y.wrapping_add(1), z.wrapping_add(1));
    let (gx, gy, gz) = (fx - 1.0, fy - 1.0, fz - 1.0);
    let (s, t) = (fade(fx), fade(fy));
    let low = mix(
        mix(
            along_gradient(hash_cell(x, y, z, seed), fx, fy, fz),
            along_gradient(hash_cell(x1, y, z, seed), gx, fy, fz),
            s,
        ),
        mix(
            along_gradient(hash_cell(x, y1, z, seed), fx, gy, fz),
            along_gradient(hash_cell(x1, y1, z, seed), gx, gy, fz),
            s,
        ),
        t,
    );
    let high = mix(
        mix(
            along_gradient(hash_cell(x, y, z1, seed), fx, fy, gz),
            along_gradient(hash_cell(x1, y, z1, seed), gx, fy, gz),
            s,
        ),
        mix(
            along_gradient(hash_cell(x, y1, z1, seed), fx, gy, gz),
            along_gradient(hash_cell(x1, y1, z1, seed), gx, gy, gz),
            s,
        ),
        t,
    );
    mix(low, high, fade(fz))
}

const OCTAVE_SHIFT: Vec3 = Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5);

/// Octaves of noise; `folded`: of their absolute values.
#[inline(always)]
pub fn fractal_noise(mut p: Vec3, octaves: u32, seed: u32, folded: bool) -> f32 {
    let (mut sum, mut weight) = (0.0, 1.0f32);
    for octave in 0..octaves {
        p += OCTAVE_SHIFT;
        let noise = gradient_noise(p, seed.wrapping_add(octave));
        sum = weight.mul_add(if folded { noise.abs() } else { noise }, sum);
        weight *= 0.5;
        p *= 2.0;
    }
    sum
}

/// Cubes by turns: 0 or 1.
#[inline(always)]
pub fn checker_pattern(p: Vec3) -> f32 {
    let cells = split_cell(p.x).0.wrapping_add(split_cell(p.y).0).wrapping_add(split_cell(p.z).0);
    (cells & 1) as f32
}

/// Fractal noise in 0..1.
#[inline(always)]
pub fn noise_pattern(p: Vec3, octaves: u32, seed: u32) -> f32 {
    clamp01(0.5f32.mul_add(fractal_noise(p, octaves, seed, false), 0.5))
}

/// Folded layers across x, in 0..1.
#[inline(always)]
pub fn marble_pattern(p: Vec3, octaves: u32, seed: u32, turbulence: f32) -> f32 {
    let layer = turbulence.mul_add(fractal_noise(p, octaves, seed, true), p.x);
    clamp01(0.5f32.mul_add(sin_turns(layer), 0.5))
}

const EARLY_WOOD: f32 = 0.85;

/// Bent rings about the axis y, in 0..1.
#[inline(always)]
pub fn wood_pattern(p: Vec3, octaves: u32, seed: u32, turbulence: f32) -> f32 {
    let radius = p.x.mul_add(p.x, p.z * p.z).sqrt();
    let (_, at) = split_cell(turbulence.mul_add(fractal_noise(p, octaves, seed, false), radius));
    let t = clamp01(if at < EARLY_WOOD { at / EARLY_WOOD } else { (1.0 - at) / (1.0 - EARLY_WOOD) });
    t * t * (-2.0f32).mul_add(t, 3.0)
}

#[inline(always)]
fn apply_row(row: Float4, p: Vec3) -> f32 {
    p.x.mul_add(row.x, p.y.mul_add(row.y, p.z.mul_add(row.z, row.w)))
}

/// The colour of a procedural texture at a position in tracing space, or at texture coordinates.
#[inline(always)]
pub fn procedural_colour(info: &TextureInfo, [u, v]: [f32; 2], position: Vec3) -> Vec3 {
    let at = if info.in_uv != 0 { Vec3::new(u, v, 0.0) } else { position };
    let p = Vec3::new(apply_row(info.to_x, at), apply_row(info.to_y, at), apply_row(info.to_z, at));
    let turbulence = info.colour0_turbulence.w;
    let t = match info.kind {
        TEXTURE_CHECKER => checker_pattern(p),
        TEXTURE_NOISE => noise_pattern(p, info.octaves, info.seed),
        TEXTURE_MARBLE => marble_pattern(p, info.octaves, info.seed, turbulence),
        _ => wood_pattern(p, info.octaves, info.seed, turbulence),
    };
    let colour = info.colour0_turbulence.xyz();
    fma3(info.colour1.xyz() - colour, t, colour)
}

/// Where a solid texture is looked at: a little beneath the surface.
#[inline(always)]
pub fn solid_position(surface: &Surface) -> Vec3 {
    let outward = if surface.front { surface.geometric_normal } else { -surface.geometric_normal };
    fma3(outward, -2.0 * surface.point.error, surface.point.position)
}
