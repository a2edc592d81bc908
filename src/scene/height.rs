//! Heights for height fields of scene files: from a picture or from a formula.

use super::Image;
use std::f32::consts::TAU;

/// The built-in formulas, as scene files name them.
pub(super) const FORMULAS: [&str; 3] = ["waves", "ripples", "noise"];

/// Octaves of the noise: each doubles the frequency and halves the height.
const OCTAVES: u32 = 5;

/// The height between -`amplitude` and `amplitude` at (x, z) of the formula number `formula` in [`FORMULAS`].
///
/// * waves: crossed sines, `frequency` of them along each side;
/// * ripples: rings around the middle that fade outwards, `frequency` of them along a side;
/// * noise: fractal value noise with `frequency` cells along a side; `seed` chooses which.
pub(super) fn formula(formula: usize, amplitude: f32, frequency: f32, seed: u32) -> impl Fn(f32, f32) -> f32 {
    move |x, z| {
        let height = match formula {
            0 => (TAU * frequency * x).sin() * (TAU * frequency * z).sin(),
            1 => {
                let r = x.hypot(z);
                const FADING: f32 = 4.0; // 1/e after half a side
                (TAU * frequency * r).cos() * (-FADING * r * r).exp()
            }
            _ => fractal_noise(x * frequency, z * frequency, seed),
        };
        amplitude * height
    }
}

/// The height between 0 and `height` at (x, z), both -1/2..1/2, from the red of `picture`: 0 is black and `height`
/// white, proportional to the stored 8-bit value (heights are no colours), bilinear between texels; the top row lies at
/// z = -1/2.
pub(super) fn from_picture(picture: &Image, height: f32) -> impl Fn(f32, f32) -> f32 {
    let (last_column, last_row) = (picture.width - 1, picture.height - 1);
    move |x, z| {
        let along = |t: f32, last: u32| {
            let at = ((t + 0.5) * last as f32).clamp(0.0, last as f32);
            let low = (at as u32).min(last.saturating_sub(1));
            (low, (low + 1).min(last), at - low as f32)
        };
        let ((left, right, s), (top, bottom, t)) = (along(x, last_column), along(z, last_row));
        let texel =
            |column: u32, row: u32| f32::from(picture.rgba[row as usize * picture.width as usize + column as usize][0]);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        height / 255.0
            * mix(mix(texel(left, top), texel(right, top), s), mix(texel(left, bottom), texel(right, bottom), s), t)
    }
}

/// Value noise in -1..1: octaves of smoothly interpolated random values on the whole numbers.
fn fractal_noise(x: f32, z: f32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut scale) = (0.0, 0.5, 1.0);
    for octave in 0..OCTAVES {
        sum += weight * value_noise(x * scale, z * scale, seed.wrapping_add(octave));
        (weight, scale) = (weight * 0.5, scale * 2.0);
    }
    sum
}

fn value_noise(x: f32, z: f32, seed: u32) -> f32 {
    let (column, row) = (x.floor(), z.floor());
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (s, t) = (smooth(x - column), smooth(z - row));
    let value = |i: i32, j: i32| random((column as i32).wrapping_add(i), (row as i32).wrapping_add(j), seed);
    let low = value(0, 0) + (value(1, 0) - value(0, 0)) * s;
    let high = value(0, 1) + (value(1, 1) - value(0, 1)) * s;
    low + (high - low) * t
}

/// A random value in -1..1 of a grid point: the finaliser of MurmurHash3 (Appleby 2011), the same everywhere.
fn random(column: i32, row: i32, seed: u32) -> f32 {
    let mut h = (column as u32).wrapping_mul(0x9e37_79b1)
        ^ (row as u32).wrapping_mul(0x85eb_ca77)
        ^ seed.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^= h >> 16;
    (h >> 8) as f32 / (1u32 << 23) as f32 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_stay_within_the_amplitude() {
        for (i, name) in FORMULAS.iter().enumerate() {
            let height = formula(i, 2.0, 3.0, 7);
            let heights: Vec<f32> =
                (0..10_000).map(|k| height((k % 100) as f32 / 99.0 - 0.5, (k / 100) as f32 / 99.0 - 0.5)).collect();
            assert!(heights.iter().all(|h| h.abs() <= 2.0), "{name}");
            assert!(heights.iter().any(|h| h.abs() > 0.7), "{name} is nearly flat");
        }
        assert_ne!(formula(2, 1.0, 3.0, 7)(0.1, 0.2), formula(2, 1.0, 3.0, 8)(0.1, 0.2), "the seed chooses");
    }

    #[test]
    fn pictures_are_met_at_their_texels() {
        let rgba = [0u8, 51, 102, 153, 204, 255].map(|v| [v, 9, 9, 255]).to_vec();
        let picture = Image { name: String::new(), width: 3, height: 2, rgba };
        let height = from_picture(&picture, 10.0);
        for (x, z, expected) in
            [(-0.5, -0.5, 0.0), (0.0, -0.5, 2.0), (0.5, -0.5, 4.0), (-0.5, 0.5, 6.0), (0.5, 0.5, 10.0), (0.0, 0.0, 5.0)]
        {
            assert!((height(x, z) - expected).abs() < 1e-5, "at {x}, {z}: {}", height(x, z));
        }
        let dot = Image { name: String::new(), width: 1, height: 1, rgba: vec![[255; 4]] };
        assert_eq!(from_picture(&dot, 3.0)(0.3, -0.2), 3.0);
    }
}
