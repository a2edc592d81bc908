//! Pictures on surfaces: bilinear, or the mean over the part of the surface that a ray stands for.
//!
//! The mean is taken from smaller and smaller copies (Williams, "Pyramidal Parametrics", SIGGRAPH 1983) at several
//! places along the longer axis of the ray's ellipse (McCormack et al., "Feline", SIGGRAPH 1999); the ellipse is what a
//! cone cuts out of the triangle's plane (Akenine-Möller et al., JCGT 10(1), 2021). How many places and which copy is
//! raybrook's definition; the book's page on pictures states it.

use super::surface::Surface;
use super::trial::Trial;
use glam::{DVec2, DVec3};
use raybrook::low_level::film::{linear_from_srgb, srgb_from_linear};
use raybrook::low_level::scene::Image;
use raybrook::low_level::shared::MOST_TAPS;
use raybrook::low_level::shared::constants::LEAST_CONE_COSINE;

/// A picture of 8-bit sRGB, in linear light.
#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<DVec3>,
}

/// A texture and its smaller copies.
#[derive(Debug, Clone)]
pub struct Pyramid {
    levels: Vec<Level>,
}

impl Pyramid {
    /// Bytes that a texel takes, with its share of the smaller copies.
    pub const TEXEL_BYTES: u64 = size_of::<DVec3>() as u64 * 3 / 2;

    /// `image` alone, or with all smaller copies down to one texel: each texel is the mean of the area that it covers,
    /// in linear light, and is kept in 8 bits of sRGB.
    pub fn new(image: &Image, with_copies: bool) -> Pyramid {
        let of_code: Vec<f64> = (0..256).map(|code| linear_from_srgb(f64::from(code) / 255.0)).collect();
        let linear = |[r, g, b, _]: [u8; 4]| DVec3::from_array([r, g, b].map(|code| of_code[usize::from(code)]));
        let finest = Level {
            width: image.width as usize,
            height: image.height as usize,
            texels: image.rgba.iter().copied().map(linear).collect(),
        };
        let mut unrounded = finest.clone();
        let mut levels = vec![finest];
        while with_copies && (unrounded.width, unrounded.height) != (1, 1) {
            unrounded = unrounded.halved();
            let kept = |x: f64| of_code[(srgb_from_linear(x.clamp(0.0, 1.0)) * 255.0).round() as usize];
            let texels = unrounded.texels.iter().map(|c| DVec3::from_array(c.to_array().map(kept))).collect();
            levels.push(Level { texels, ..unrounded });
        }
        Pyramid { levels }
    }

    /// The colour at texture coordinates.
    pub fn bilinear(&self, uv: DVec2, trial: &mut Trial) -> DVec3 {
        self.levels[0].at(uv, trial)
    }

    /// The mean over an ellipse of which these are two axes at a right angle, from end to end, in texture coordinates.
    pub fn mean(&self, uv: DVec2, axes: [DVec2; 2], trial: &mut Trial) -> DVec3 {
        let sides = DVec2::new(self.levels[0].width as f64, self.levels[0].height as f64);
        let lengths = axes.map(|axis| trial.number((axis * sides).length(), 16.0));
        let last = self.levels.len() - 1;
        if !lengths.iter().all(|length| *length <= f64::from(f32::MAX)) {
            return self.levels[last].at(uv, trial);
        }
        let (longer, shorter) = (lengths[0].max(lengths[1]), lengths[0].min(lengths[1]));
        let way = if lengths[0] >= lengths[1] { axes[0] } else { axes[1] };
        let taps = (longer / shorter.max(1.0)).min(f64::from(MOST_TAPS)).ceil().max(1.0);
        trial.decide(taps as u32);
        // What one place stands for. Between two copies, which differ by a factor of 2, the colour goes straight.
        let width = trial.number((longer / taps).max(shorter).max(1.0), 2.0).max(1.0);
        let number = (width.log2().floor() as usize).min(last);
        let beyond = if number == last { 0.0 } else { width / f64::from(1u32 << number) - 1.0 };
        let along = |level: &Level, trial: &mut Trial| {
            let places = (0..taps as u32).map(|i| (f64::from(i) + 0.5) / taps - 0.5);
            places.map(|at| level.at(uv + way * at, trial)).sum::<DVec3>() / taps
        };
        let finer = along(&self.levels[number], trial);
        if beyond == 0.0 { finer } else { finer.lerp(along(&self.levels[number + 1], trial), beyond) }
    }
}

impl Level {
    /// Half as wide and high, rounded down.
    fn halved(&self) -> Level {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        // What a new texel covers of the old ones, with the share of each.
        let covered = |i: usize, new: usize, old: usize| {
            let (start, end) = ((i * old) as f64 / new as f64, ((i + 1) * old) as f64 / new as f64);
            let overlap = move |k: usize| ((k + 1) as f64).min(end) - (k as f64).max(start);
            (start.floor() as usize..(end.ceil() as usize).min(old)).map(move |k| (k, overlap(k) / (end - start)))
        };
        let texel = |x: usize, y: usize| {
            let rows = covered(y, height, self.height);
            let row = |(k, share): (usize, f64)| {
                covered(x, width, self.width).map(|(j, part)| self.texels[k * self.width + j] * part).sum::<DVec3>()
                    * share
            };
            rows.map(row).sum::<DVec3>()
        };
        let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
        Level { width, height, texels }
    }

    /// Bilinear between the four texels around a point. Texels' centres are at halves; the picture repeats; v runs
    /// upwards and rows downwards. From 2^24 on coordinates are whole numbers in float32.
    fn at(&self, uv: DVec2, trial: &mut Trial) -> DVec3 {
        let mut around = |t: f64, size: usize| {
            let t = if t.is_finite() { trial.number(t, 1.0) } else { 0.0 };
            let x = trial.near(t.rem_euclid(1.0) * size as f64 - 0.5, size as f64, 1.0);
            let low = (x.floor() as i64).rem_euclid(size as i64) as usize;
            (low, (low + 1) % size, x - x.floor())
        };
        let (left, right, to_right) = around(uv.x, self.width);
        let (top, bottom, down) = around(-uv.y, self.height);
        let texel = |x: usize, y: usize| self.texels[y * self.width + x];
        let upper = texel(left, top).lerp(texel(right, top), to_right);
        upper.lerp(texel(left, bottom).lerp(texel(right, bottom), to_right), down)
    }
}

/// The axes of the ellipse that a cone of `width` along unit `direction` cuts out of a surface, in texture coordinates.
pub fn ellipse(surface: &Surface, direction: DVec3, width: f64) -> [DVec2; 2] {
    let [p0, p1, p2] = surface.corners;
    let (edge1, edge2) = (p1 - p0, p2 - p0);
    let normal = surface.geometric_normal;
    let across = normal.cross(direction).try_normalize().unwrap_or_else(|| edge1.normalize_or_zero());
    let along = across.cross(normal);
    // A ray that grazes its triangle sees no more of it than at this cosine.
    let cosine = (-normal.dot(direction)).max(f64::from(LEAST_CONE_COSINE));
    let [uv0, uv1, uv2] = surface.corner_uvs;
    let area = edge1.cross(edge2).dot(normal);
    let in_texture = |way: DVec3| {
        let weight1 = way.cross(edge2).dot(normal) / area;
        let weight2 = edge1.cross(way).dot(normal) / area;
        (uv1 - uv0) * weight1 + (uv2 - uv0) * weight2
    };
    [in_texture(along * (width / cosine)), in_texture(across * width)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn image(width: u32, height: u32, code: impl Fn(u32, u32) -> u8) -> Image {
        let texel = |i: u32| [code(i % width, i / width), 0, 0, 255];
        Image { name: String::new(), width, height, rgba: (0..width * height).map(texel).collect() }
    }

    #[test]
    fn between_texels_light_is_mixed_in_proportion() {
        let pyramid = Pyramid::new(&image(2, 1, |x, _| if x == 0 { 0 } else { 255 }), false);
        // Centres at 1/4 and 3/4; it repeats.
        for (u, red) in [(0.25, 0.0), (0.75, 1.0), (0.5, 0.5), (0.375, 0.25), (1.0, 0.5), (-3.125, 0.75)] {
            let found = pyramid.bilinear(DVec2::new(u, 0.3), &mut Trial::exact());
            assert_relative_eq!(found.x, red, epsilon = 1e-12);
        }
    }

    #[test]
    fn v_runs_upwards() {
        let pyramid = Pyramid::new(&image(1, 2, |_, y| if y == 0 { 255 } else { 0 }), false);
        let at = |v: f64| pyramid.bilinear(DVec2::new(0.5, v), &mut Trial::exact()).x;
        assert_relative_eq!(at(0.75), 1.0, epsilon = 1e-12);
        assert_relative_eq!(at(0.25), 0.0, epsilon = 1e-12);
    }

    #[test]
    fn a_large_part_of_a_texture_has_its_mean() {
        // A quarter of a 5 x 4 texture is white: 0.25 of the light, of which 8 bits keep the nearest code.
        let pyramid = Pyramid::new(&image(5, 4, |_, y| if y == 1 { 255 } else { 0 }), true);
        assert_eq!(pyramid.levels.len(), 3);
        let mean = pyramid.mean(DVec2::splat(0.4), [DVec2::new(9.0, 0.0), DVec2::new(0.0, 9.0)], &mut Trial::exact());
        assert_relative_eq!(
            mean.x,
            linear_from_srgb((srgb_from_linear(0.25) * 255.0).round() / 255.0),
            epsilon = 1e-12
        );
        let point = pyramid.mean(DVec2::splat(0.4), [DVec2::ZERO; 2], &mut Trial::exact());
        assert_eq!(point, pyramid.bilinear(DVec2::splat(0.4), &mut Trial::exact()));
    }

    #[test]
    fn a_cone_that_leans_cuts_a_longer_ellipse() {
        let mut surface = Surface::flat(DVec3::ZERO, DVec3::Y);
        surface.corners = [DVec3::ZERO, DVec3::Z, DVec3::X];
        surface.corner_uvs = [DVec2::ZERO, DVec2::Y, DVec2::X];
        let direction = DVec3::new(0.75f64.sqrt(), -0.5, 0.0);
        let axes = ellipse(&surface, direction, 0.1);
        assert_relative_eq!(axes[0].length(), 0.2, max_relative = 1e-12);
        assert_relative_eq!(axes[1].length(), 0.1, max_relative = 1e-12);
        assert_relative_eq!(axes[0].dot(axes[1]), 0.0, epsilon = 1e-12);
    }
}
