//! Twin of `cl/shade/procedural.cl`: procedural textures. The reasons are there.

use super::surface::Surface;
use crate::layout::Float4;
use crate::reference::shared::hash::mix_bits;
use crate::reference::shared::math::{clamp01, fma3, sin_turns};
use crate::shared::constants::{
    CELL_LIMIT, EARLY_WOOD, HASH_SEED, HASH_X, HASH_Y, HASH_Z, OCTAVE_SHIFT, SOLID_DEPTH, WOOD_NOISE,
};
use crate::shared::{TEXTURE_CHECKER, TEXTURE_MARBLE, TEXTURE_NOISE, TextureInfo};
use glam::Vec3;

#[inline(always)]
fn split_cell(x: f32) -> (u32, f32) {
    let low = x.floor();
    if low.abs() < CELL_LIMIT { (low as i32 as u32, x - low) } else { (0, 0.0) }
}

#[inline(always)]
fn hash_cell(x: u32, y: u32, z: u32, seed: u32) -> u32 {
    mix_bits(x.wrapping_mul(HASH_X) ^ y.wrapping_mul(HASH_Y) ^ z.wrapping_mul(HASH_Z) ^ seed.wrapping_mul(HASH_SEED))
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

/// Folded veins across x, in 0..1.
#[inline(always)]
pub fn marble_pattern(p: Vec3, octaves: u32, seed: u32, turbulence: f32) -> f32 {
    let layer = turbulence.mul_add(fractal_noise(p, octaves, seed, true), p.x);
    let wave = clamp01(0.5f32.mul_add(sin_turns(layer), 0.5));
    (wave * wave) * (wave * wave)
}

/// Bent rings about the axis y, in 0..1.
#[inline(always)]
pub fn wood_pattern(p: Vec3, octaves: u32, seed: u32, turbulence: f32) -> f32 {
    let radius = p.x.mul_add(p.x, p.z * p.z).sqrt();
    let (_, at) = split_cell(turbulence.mul_add(fractal_noise(p * WOOD_NOISE, octaves, seed, false), radius));
    let t = clamp01(if at < EARLY_WOOD { at * (1.0 / EARLY_WOOD) } else { (1.0 - at) * (1.0 / (1.0 - EARLY_WOOD)) });
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
    fma3(outward, -SOLID_DEPTH * surface.largest_coordinate, surface.point.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bound of the noise's slope along an axis: the corners' gradients have components of at most 1, and their
    /// values, of at most 2 on either side, are blended by a fade whose slope is at most 15/8.
    const SLOPE: f32 = 1.0 + 4.0 * 15.0 / 8.0;

    /// Points that are spread over -`extent`..`extent`.
    fn points(count: u32, extent: f32) -> impl Iterator<Item = Vec3> {
        let coordinate = move |i: u32, axis: u32| (hash_cell(i, axis, 0, 2008) as f32 / 2f32.powi(31) - 1.0) * extent;
        (0..count).map(move |i| Vec3::new(coordinate(i, 0), coordinate(i, 1), coordinate(i, 2)))
    }

    #[test]
    fn noise_is_zero_at_corners_and_within_its_range_between() {
        for p in points(10_000, 1000.0).chain(points(1000, 1e9)) {
            assert_eq!(gradient_noise(p.round(), 5), 0.0, "at {}", p.round());
        }
        let (mut low, mut high, mut sum) = (0f32, 0f32, 0f64);
        let count = 1_000_000;
        for p in points(count, 500.0) {
            let noise = gradient_noise(p, 5);
            (low, high) = (low.min(noise), high.max(noise));
            sum += f64::from(noise);
        }
        assert!(low > -1.04 && high < 1.04, "{low} {high}");
        assert!(low < -0.8 && high > 0.8, "it is nearly flat: {low} {high}");
        assert!((sum / f64::from(count)).abs() < 0.01, "its mean is {}", sum / f64::from(count));
        assert_ne!(gradient_noise(Vec3::splat(0.3), 1), gradient_noise(Vec3::splat(0.3), 2), "the seed chooses");
    }

    /// Patterns that have no jumps, with a bound of their slope per unit of the noise's.
    #[test]
    fn noise_marble_and_wood_are_continuous() {
        const STEP: f32 = 1.0 / 4096.0;
        let (octaves, turbulence) = (3, 0.7);
        // Each octave has half the strength at twice the frequency, so the same slope.
        let fractal = octaves as f32 * SLOPE;
        type Pattern = fn(Vec3, u32, u32, f32) -> f32;
        let patterns: [(&str, Pattern, f32); 3] = [
            ("noise", |p, octaves, seed, _| noise_pattern(p, octaves, seed), 0.5 * fractal),
            // The fourth power's slope is 4, the half sine's pi.
            ("marble", marble_pattern, 4.0 * std::f32::consts::PI * (1.0 + turbulence * fractal)),
            // The smooth step's slope is 3/2, on the late wood's share of a ring.
            ("wood", wood_pattern, 1.5 / (1.0 - EARLY_WOOD) * (1.0 + turbulence * fractal * WOOD_NOISE.x)),
        ];
        for (name, pattern, slope) in patterns {
            // Half of the steps cross a cell's border.
            for p in points(20_000, 8.0).flat_map(|p| [p, Vec3::new(p.x.round() - STEP / 2.0, p.y, p.z)]) {
                let (a, b) = (pattern(p, octaves, 9, turbulence), pattern(p + Vec3::X * STEP, octaves, 9, turbulence));
                assert!((0.0..=1.0).contains(&a), "{name} is {a} at {p}");
                assert!((a - b).abs() <= slope * STEP, "{name} jumps from {a} to {b} at {p}");
            }
        }
    }

    #[test]
    fn checkers_alternate_everywhere() {
        let cells = |n: i32| (-n..n).flat_map(move |x| (-n..n).flat_map(move |y| (-n..n).map(move |z| (x, y, z))));
        for (x, y, z) in cells(5) {
            let expected = (x + y + z).rem_euclid(2) as f32;
            let corner = Vec3::new(x as f32, y as f32, z as f32);
            for inside in [0.0, 0.5, 1.0 - f32::EPSILON * 4.0] {
                assert_eq!(checker_pattern(corner + inside), expected, "{x} {y} {z} + {inside}");
            }
        }
        // Just below 0 is the cell on the other side, however near.
        assert_eq!(checker_pattern(Vec3::new(-1e-30, 0.5, 0.5)), 1.0);
        assert_eq!(checker_pattern(Vec3::new(-0.0, 0.5, 0.5)), 0.0);
    }

    #[test]
    fn nonsense_has_a_colour() {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 2_147_483_648.0, -2_147_483_648.0, 1e-45] {
            for p in [Vec3::new(x, 0.5, 0.5), Vec3::new(0.5, x, 0.5), Vec3::new(0.5, 0.5, x), Vec3::splat(x)] {
                for t in [
                    checker_pattern(p),
                    noise_pattern(p, 16, 1),
                    marble_pattern(p, 16, 1, 2.0),
                    wood_pattern(p, 16, 1, 2.0),
                    wood_pattern(p, 16, 1, f32::MAX),
                ] {
                    assert!((0.0..=1.0).contains(&t), "{t} at {p}");
                }
            }
        }
    }
}
