//! Procedural textures: checker, noise, marble and wood in space (Peachey, "Solid Texturing of Complex Surfaces",
//! SIGGRAPH 1985; Perlin, "An Image Synthesizer", SIGGRAPH 1985, and "Improving Noise", SIGGRAPH 2002).
//!
//! Which pattern it is, is a matter of definition: the hash of a cell, the twelve gradients, the shift of octaves, the
//! share of early wood. Those are raybrook's own and taken from its constants; everything that is computed from them is
//! computed here, in f64.

use super::surface::Surface;
use super::trial::Trial;
use glam::DVec3;
use raybrook::low_level::scene::{Pattern, Procedural, TextureSpace};
use raybrook::low_level::shared::constants::{
    EARLY_WOOD, HASH_FIRST, HASH_SECOND, HASH_SEED, HASH_X, HASH_Y, HASH_Z, OCTAVE_SHIFT, SOLID_DEPTH, WOOD_NOISE,
};

/// From here on a float has no fraction that matters: the corner of cell 0.
const MOST: f64 = (1u64 << 31) as f64;

/// The colour of a procedural texture on a surface.
pub fn colour(texture: &Procedural, surface: &Surface, trial: &mut Trial) -> DVec3 {
    let at = match texture.space {
        TextureSpace::Uv => surface.uv.extend(0.0),
        // Solid textures are looked at a few roundings beneath the surface, so that a wall in a border of cells has
        // one colour.
        TextureSpace::World => {
            let outward = if surface.is_front { surface.geometric_normal } else { -surface.geometric_normal };
            let depth = f64::from(SOLID_DEPTH) * surface.largest_coordinate();
            trial.vector(surface.position, 1.0) - outward * depth
        }
    };
    let inverse = texture.transform.inverse();
    let p = inverse.transform_point3(at);
    // Each row of the transform and each of its products is rounded, whatever cancels.
    let size = |row: DVec3| row.abs().dot(at.abs());
    let rows = inverse.matrix3.transpose();
    let sizes = DVec3::new(size(rows.x_axis), size(rows.y_axis), size(rows.z_axis)) + inverse.translation.abs();
    let p = DVec3::from_array([0, 1, 2].map(|k| trial.near(p[k], sizes[k], 4.0)));
    let [first, second] = texture.colours.map(|colour| colour.as_dvec3());
    first + (second - first) * share(texture, p, trial)
}

/// How much of the second colour there is at a point of the pattern's own space.
fn share(texture: &Procedural, p: DVec3, trial: &mut Trial) -> f64 {
    let turbulence = f64::from(texture.turbulence);
    match texture.pattern {
        Pattern::Checker => {
            let odd = p.to_array().map(|x| cell_of(x).0).iter().fold(0u32, |sum, cell| sum.wrapping_add(*cell)) & 1;
            trial.decide(odd);
            f64::from(odd)
        }
        Pattern::Noise => (0.5 + 0.5 * fractal(p, texture, false, trial)).clamp(0.0, 1.0),
        Pattern::Marble => {
            let layer = p.x + turbulence * fractal(p, texture, true, trial);
            let layer = trial.near(layer, layer.abs(), 2.0);
            // Four ulp of the sine.
            let wave =
                (0.5 + 0.5 * trial.near((std::f64::consts::TAU * layer.fract()).sin(), 1.0, 8.0)).clamp(0.0, 1.0);
            wave.powi(4)
        }
        Pattern::Wood => {
            let early = f64::from(EARLY_WOOD);
            let noise = fractal(p * WOOD_NOISE.as_dvec3(), texture, false, trial);
            let radius = p.x.hypot(p.z) + turbulence * noise;
            let (_, at) = cell_of(trial.near(radius, radius.abs(), 3.0));
            let t = if at < early { at / early } else { (1.0 - at) / (1.0 - early) }.clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        }
    }
}

/// The cell of width 1 that holds `x`, and where in it `x` is. Cells wrap around at 2^32.
fn cell_of(x: f64) -> (u32, f64) {
    let low = x.floor();
    if low.abs() < MOST { (low as i64 as u32, x - low) } else { (0, 0.0) }
}

/// Octaves of noise, each of double frequency and half strength; `folded`: of their absolute values.
fn fractal(mut p: DVec3, texture: &Procedural, folded: bool, trial: &mut Trial) -> f64 {
    let (mut sum, mut weight) = (0.0, 1.0);
    for octave in 0..texture.octaves.min(Procedural::MAX_OCTAVES) {
        p = trial.vector(p + OCTAVE_SHIFT.as_dvec3(), 1.0);
        let noise = trial.near(gradient_noise(p, texture.seed.wrapping_add(octave)), 1.0, 8.0);
        sum += weight * if folded { noise.abs() } else { noise };
        weight /= 2.0;
        p *= 2.0;
    }
    sum
}

/// Perlin's gradient noise: in each corner of a cell a plane that rises along one of twelve directions, blended.
fn gradient_noise(p: DVec3, seed: u32) -> f64 {
    let cells = p.to_array().map(cell_of);
    let blend = cells.map(|(_, t)| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let mut noise = 0.0;
    for corner in 0..8u32 {
        let bits = [corner & 1, corner >> 1 & 1, corner >> 2];
        let [x, y, z] = std::array::from_fn(|k| cells[k].0.wrapping_add(bits[k]));
        let from_corner: [f64; 3] = std::array::from_fn(|k| cells[k].1 - f64::from(bits[k]));
        let weight: f64 = (0..3).map(|k| if bits[k] == 1 { blend[k] } else { 1.0 - blend[k] }).product();
        noise += weight * DVec3::from_array(from_corner).dot(gradient(hash(x, y, z, seed)));
    }
    noise
}

/// From a cube's centre to the middle of one of its edges; the last four of sixteen repeat four of the twelve.
fn gradient(hash: u32) -> DVec3 {
    let sign = |bit: u32| if hash & bit == 0 { 1.0 } else { -1.0 };
    let (a, b) = (sign(1), sign(2));
    match hash & 15 {
        0..4 => DVec3::new(a, b, 0.0),
        4..8 => DVec3::new(a, 0.0, b),
        12 | 14 => DVec3::new(b, a, 0.0),
        _ => DVec3::new(0.0, a, b),
    }
}

fn hash(x: u32, y: u32, z: u32, seed: u32) -> u32 {
    let mixed = x.wrapping_mul(HASH_X) ^ y.wrapping_mul(HASH_Y) ^ z.wrapping_mul(HASH_Z) ^ seed.wrapping_mul(HASH_SEED);
    let first = (mixed ^ mixed >> 16).wrapping_mul(HASH_FIRST);
    let second = (first ^ first >> 13).wrapping_mul(HASH_SECOND);
    second ^ second >> 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn noise_is_smooth_and_zero_in_every_corner() {
        let mut largest = 0.0f64;
        for i in 0..2000 {
            let p = DVec3::new(f64::from(i) * 0.37, f64::from(i) * 0.11 - 40.0, f64::from(i) * 0.029);
            let noise = gradient_noise(p, 3);
            largest = largest.max(noise.abs());
            assert_relative_eq!(noise, gradient_noise(p + DVec3::splat(1e-7), 3), epsilon = 1e-6);
            assert_eq!(gradient_noise(p.floor(), 3), 0.0);
        }
        assert!((0.5..1.04).contains(&largest), "{largest}");
    }

    #[test]
    fn checkers_alternate_and_wood_has_rings() {
        let mut trial = Trial::exact();
        let checker = Procedural::new(Pattern::Checker);
        let at = |x: f64, trial: &mut Trial| share(&checker, DVec3::new(x, 0.5, 0.5), trial);
        assert_eq!([-0.5, 0.5, 1.5].map(|x| at(x, &mut trial)), [1.0, 0.0, 1.0]);
        let wood = Procedural { turbulence: 0.0, ..Procedural::new(Pattern::Wood) };
        for radius in [0.2f64, 1.2, 7.2] {
            let t = 0.2 / f64::from(EARLY_WOOD);
            let p = DVec3::new(0.6 * radius, 5.0, 0.8 * radius);
            assert_relative_eq!(share(&wood, p, &mut trial), t * t * (3.0 - 2.0 * t), epsilon = 1e-12);
        }
    }
}
