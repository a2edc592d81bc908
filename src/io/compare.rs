//! How far two results are apart: pictures by their pixels and by eye, hits bit by bit.
//!
//! By eye is FLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator
//! for Alternating Images", HPG 2020), on 8-bit sRGB at its default of 67 pixels per degree.
//!
//! Bad at: differences above white or below black, which no 8-bit picture shows; `rms` and `unequal_pixels` see them.

use flip_rs::{DEFAULT_PPD, FlipError, RgbImage, ldr_flip};
use serde::Serialize;

use crate::io::film::{Film, linear_from_srgb};
use crate::shared::{Hit, NO_PRIMITIVE};

/// How two pictures differ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FilmDifference {
    /// Pixels of each picture.
    pub pixels: usize,
    /// Pixels with a channel that differs in any bit of the linear value.
    pub unequal_pixels: usize,
    /// Pixels with a channel that differs as 8-bit sRGB.
    pub differing_pixels: usize,
    /// Pixels with a channel that is NaN or infinite in either picture; such channels are left out of `rms`.
    pub non_finite_pixels: usize,
    /// The largest difference of a channel as 8-bit sRGB, 0..=255.
    pub largest_step: u8,
    /// Root of the mean squared difference of the channels, linear radiance.
    pub rms: f64,
    /// Root of the mean squared difference of the channels as 8-bit sRGB, 0..=255.
    pub rms_8bit: f64,
    /// Mean FLIP error, 0 (same) to 1; `None` for a picture that is empty or too large for the measure.
    pub flip_mean: Option<f64>,
    /// Largest FLIP error of a pixel.
    pub flip_max: Option<f64>,
}

/// Compares `b` with the reference `a`.
///
/// # Panics
/// When the pictures differ in size: nobody can say which pixels belong together.
pub fn compare_films(a: &Film, b: &Film) -> FilmDifference {
    assert_same_size(a, b);
    let (srgb_a, srgb_b) = (a.to_srgb8(), b.to_srgb8());
    let mut unequal_pixels = 0;
    let mut non_finite_pixels = 0;
    let (mut finite_channels, mut sum) = (0_usize, 0.0_f64);
    for (p, q) in a.pixels.iter().zip(&b.pixels) {
        unequal_pixels += usize::from(p.map(f32::to_bits) != q.map(f32::to_bits));
        non_finite_pixels += usize::from(p.iter().chain(q).any(|c| !c.is_finite()));
        for (c, d) in p.iter().zip(q).filter(|(c, d)| c.is_finite() && d.is_finite()) {
            finite_channels += 1;
            sum += (f64::from(*c) - f64::from(*d)).powi(2);
        }
    }
    let steps = srgb_a.as_flattened().iter().zip(srgb_b.as_flattened()).map(|(c, d)| c.abs_diff(*d));
    let squared_steps: u64 = steps.clone().map(|s| u64::from(s).pow(2)).sum();
    let flip = flip_errors(a, &srgb_a, &srgb_b).ok();
    FilmDifference {
        pixels: a.pixels.len(),
        unequal_pixels,
        differing_pixels: srgb_a.iter().zip(&srgb_b).filter(|(p, q)| p != q).count(),
        non_finite_pixels,
        largest_step: steps.max().unwrap_or(0),
        rms: root_mean(sum, finite_channels),
        rms_8bit: root_mean(squared_steps as f64, 3 * srgb_a.len()),
        flip_mean: flip.as_ref().map(|errors| errors.iter().map(|&e| f64::from(e)).sum::<f64>() / errors.len() as f64),
        flip_max: flip.map(|errors| errors.iter().fold(0.0, |max, &e| f64::from(e).max(max))),
    }
}

fn assert_same_size(a: &Film, b: &Film) {
    assert_eq!((a.width, a.height, a.pixels.len()), (b.width, b.height, b.pixels.len()), "pictures of different sizes");
}

fn root_mean(sum: f64, count: usize) -> f64 {
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

fn flip_errors(film: &Film, reference: &[[u8; 3]], test: &[[u8; 3]]) -> Result<Vec<f32>, FlipError> {
    let image =
        |pixels: &[[u8; 3]]| RgbImage::new(film.width as usize, film.height as usize, pixels.as_flattened().to_vec());
    Ok(ldr_flip(&image(reference)?, &image(test)?, DEFAULT_PPD)?.into_pixels())
}

/// Brightness of the reference behind the marks of [`difference_picture`], as a part of its own.
const BACKDROP: f32 = 0.1;
/// The darkest mark's place on the Magma scale, 0..=255: a colour that no grey backdrop has.
const FIRST_MARK: f64 = 110.0;

/// A picture of where `b` differs from the reference `a`: the reference in dark grey, and each pixel that differs as
/// 8-bit sRGB in a colour from purple (one step) over red and orange to pale yellow (255 steps).
///
/// The scale is logarithmic and starts bright, because the differences worth finding are mostly single pixels off by a
/// step or two, which a plain difference or a FLIP map shows as black.
///
/// # Panics
/// As [`compare_films`].
pub fn difference_picture(a: &Film, b: &Film) -> Film {
    assert_same_size(a, b);
    let marks: Vec<[f32; 3]> = (0..=255_u8).map(mark_of_step).collect();
    let pixels = a.to_srgb8().into_iter().zip(b.to_srgb8()).zip(&a.pixels).map(|((p, q), radiance)| {
        let step = p.iter().zip(q).map(|(c, d)| c.abs_diff(d)).max().unwrap_or(0);
        if step > 0 { marks[usize::from(step)] } else { [BACKDROP * luminance(radiance); 3] }
    });
    Film { width: a.width, height: a.height, pixels: pixels.collect() }
}

/// The colour of a difference of `step`, linear.
fn mark_of_step(step: u8) -> [f32; 3] {
    let place = FIRST_MARK + (255.0 - FIRST_MARK) * f64::from(step.max(1)).ln() / 255.0_f64.ln();
    flip_rs::MAGMA[place.round() as usize].map(|c| linear_from_srgb(f64::from(c)) as f32)
}

/// Luminance by ITU-R BT.709 of what a screen shows of a pixel.
fn luminance(pixel: &[f32; 3]) -> f32 {
    let [red, green, blue] = pixel.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 });
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// How two lists of hits differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct HitDifference {
    /// Rays in each list.
    pub rays: usize,
    /// Rays whose t, u, v or primitive differ in any bit; two misses are equal, whatever else they hold.
    pub differing: usize,
    /// Rays that hit different triangles, or of which one hits and one misses.
    pub differing_primitive: usize,
    /// Rays of which one hits and one misses.
    pub differing_hit: usize,
    /// The largest distance of t in units in the last place, over the rays that hit in both lists.
    pub largest_t_ulp: u32,
    /// The first ray that differs.
    pub first: Option<usize>,
}

/// Compares two lists of hits of the same rays.
///
/// # Panics
/// When the lists differ in length.
pub fn compare_hits(a: &[Hit], b: &[Hit]) -> HitDifference {
    assert_eq!(a.len(), b.len(), "lists of hits of different lengths");
    let mut found = HitDifference {
        rays: a.len(),
        differing: 0,
        differing_primitive: 0,
        differing_hit: 0,
        largest_t_ulp: 0,
        first: None,
    };
    for (index, (p, q)) in a.iter().zip(b).enumerate() {
        let missed = [p, q].map(|hit| hit.primitive == NO_PRIMITIVE);
        if missed == [true, true] {
            continue;
        }
        if bits(p) != bits(q) {
            found.differing += 1;
            found.first = found.first.or(Some(index));
        }
        found.differing_primitive += usize::from(p.primitive != q.primitive);
        found.differing_hit += usize::from(missed[0] != missed[1]);
        if missed == [false, false] {
            found.largest_t_ulp = found.largest_t_ulp.max(ulp_distance(p.t, q.t));
        }
    }
    found
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

/// How many floats lie from one to the other; the two zeros are one float, and NaN is beyond the infinities.
pub fn ulp_distance(a: f32, b: f32) -> u32 {
    let place = |f: f32| {
        let magnitude = (f.to_bits() & 0x7fff_ffff) as i32;
        if f.is_sign_negative() { -magnitude } else { magnitude }
    };
    place(a).abs_diff(place(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32, value: f32) -> Film {
        Film { width, height, pixels: vec![[value; 3]; (width * height) as usize] }
    }

    #[test]
    fn the_same_picture_differs_in_nothing() {
        let mut film = grey(8, 4, 0.3);
        film.pixels[5] = [f32::NAN, 7.0, -2.0];
        let found = compare_films(&film, &film);
        let same = FilmDifference {
            pixels: 32,
            unequal_pixels: 0,
            differing_pixels: 0,
            non_finite_pixels: 1,
            largest_step: 0,
            rms: 0.0,
            rms_8bit: 0.0,
            flip_mean: Some(0.0),
            flip_max: Some(0.0),
        };
        assert_eq!(found, same);
    }

    #[test]
    fn black_and_white_are_as_far_apart_as_can_be() {
        let found = compare_films(&grey(16, 16, 0.0), &grey(16, 16, 1.0));
        assert_eq!((found.differing_pixels, found.largest_step), (256, 255));
        assert_eq!((found.rms, found.rms_8bit), (1.0, 255.0));
        // FLIP's largest colour distance is green to blue, so that flat black to white is 0.96739 (NVIDIA's
        // flip-evaluator 1.7).
        let mean = found.flip_mean.unwrap();
        assert!((mean - 0.967_391).abs() < 1e-5, "{mean}");
        assert!((found.flip_max.unwrap() - mean).abs() < 1e-6);
    }

    #[test]
    fn flip_is_the_one_of_its_authors() {
        // Expected: NVIDIA's flip-evaluator 1.7 on the same pictures, `evaluate(a, b, "LDR")`: mean and largest error.
        let (expected_mean, expected_max) = (0.432_133_08, 0.938_838_36);
        let film = |code: fn(u32, u32) -> [u32; 3]| {
            let linear = |c: u32| linear_from_srgb(f64::from(c % 256) / 255.0) as f32;
            let pixels = (0..32 * 24).map(|i| code(i % 32, i / 32).map(linear)).collect();
            Film { width: 32, height: 24, pixels }
        };
        let a = film(|x, y| [7 * x + 3 * y, 5 * x, 11 * y]);
        let b = film(|x, y| [7 * x + 3 * y + 10, 5 * x, if (x / 4 + y / 4) % 2 == 0 { 11 * y } else { 200 }]);
        let found = compare_films(&a, &b);
        assert!((found.flip_mean.unwrap() - expected_mean).abs() < 1e-6, "{found:?}");
        assert!((found.flip_max.unwrap() - expected_max).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn one_pixel_is_counted_once() {
        let a = grey(10, 10, 0.5);
        let mut b = a.clone();
        b.pixels[33] = [0.5, 0.505, 0.52];
        b.pixels[34][0] = f32::from_bits(0.5_f32.to_bits() + 1);
        let found = compare_films(&a, &b);
        assert_eq!((found.unequal_pixels, found.differing_pixels), (2, 1));
        assert_eq!(found.largest_step, 3);
        assert!((found.rms - ((0.005_f64.powi(2) + 0.02_f64.powi(2)) / 300.0).sqrt()).abs() < 1e-8);
        let flip = found.flip_mean.unwrap();
        assert!(flip > 0.0 && flip < 0.01, "{flip}");
    }

    #[test]
    fn values_that_are_not_finite_spoil_no_mean() {
        let a = grey(4, 4, 0.5);
        let mut b = a.clone();
        b.pixels[0] = [f32::NAN; 3];
        let found = compare_films(&a, &b);
        assert_eq!((found.non_finite_pixels, found.differing_pixels, found.rms), (1, 1, 0.0));
    }

    #[test]
    fn an_empty_picture_has_no_flip() {
        let found = compare_films(&grey(0, 0, 0.0), &grey(0, 0, 0.0));
        assert_eq!((found.pixels, found.rms, found.flip_mean), (0, 0.0, None));
    }

    #[test]
    fn the_difference_picture_marks_what_differs_and_nothing_else() {
        let a = grey(6, 6, 1.0);
        let mut b = a.clone();
        b.pixels[7] = [linear_from_srgb(254.0 / 255.0) as f32; 3];
        b.pixels[8] = [0.0; 3];
        let shown = difference_picture(&a, &b);
        let grey = |p: &[f32; 3]| p[0] == p[1] && p[1] == p[2];
        for (index, pixel) in shown.pixels.iter().enumerate() {
            assert_eq!(grey(pixel), index != 7 && index != 8, "{index}");
        }
        let bright = luminance(&shown.pixels[8]);
        assert!(bright > 0.8 && luminance(&shown.pixels[7]) > luminance(&shown.pixels[0]) / 2.0, "{bright}");
    }

    #[test]
    #[should_panic(expected = "different sizes")]
    fn pictures_of_different_sizes_are_not_compared() {
        compare_films(&grey(2, 3, 0.0), &grey(3, 2, 0.0));
    }

    const MISS: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };
    const HIT: Hit = Hit { t: 1.0, u: 0.25, v: 0.5, primitive: 3 };

    #[test]
    fn hits_are_compared_bit_by_bit() {
        let next_t = Hit { t: f32::from_bits(1.0_f32.to_bits() + 3), ..HIT };
        let minus_u = Hit { u: -0.0, ..HIT };
        let cases = [
            (HIT, HIT, [0, 0, 0, 0]),
            (MISS, Hit { t: 5.0, ..MISS }, [0, 0, 0, 0]),
            (HIT, next_t, [1, 0, 0, 3]),
            (Hit { u: 0.0, ..HIT }, minus_u, [1, 0, 0, 0]),
            (HIT, Hit { primitive: 4, ..HIT }, [1, 1, 0, 0]),
            (HIT, MISS, [1, 1, 1, 0]),
        ];
        for (a, b, [differing, primitive, hit, ulp]) in cases {
            let found = compare_hits(&[MISS, a, HIT], &[MISS, b, HIT]);
            let expected = HitDifference {
                rays: 3,
                differing,
                differing_primitive: primitive,
                differing_hit: hit,
                largest_t_ulp: ulp as u32,
                first: (differing > 0).then_some(1),
            };
            assert_eq!(found, expected, "{a:?} {b:?}");
        }
        assert_eq!(compare_hits(&[], &[]).rays, 0);
    }

    #[test]
    fn distances_in_the_last_place_cross_zero() {
        for (a, b, distance) in
            [(0.0, -0.0, 0), (1.0, 1.0, 0), (1.0, 2.0, 1 << 23), (-1e-45, 1e-45, 2), (f32::MAX, f32::INFINITY, 1)]
        {
            assert_eq!(ulp_distance(a, b), distance, "{a} {b}");
            assert_eq!(ulp_distance(b, a), distance, "{b} {a}");
        }
        assert!(ulp_distance(1.0, f32::NAN) > 1 << 23);
    }

    #[test]
    fn reports_serialise() {
        let json = serde_json::to_value(compare_hits(&[HIT], &[MISS])).unwrap();
        assert_eq!((&json["differing"], &json["first"]), (&1.into(), &0.into()));
        let json = serde_json::to_value(compare_films(&grey(2, 2, 0.0), &grey(2, 2, 0.5))).unwrap();
        assert_eq!(json["largest_step"], 188);
    }
}
