//! What a screen shows of radiances, in which errors are measured.

use crate::fma::with_fma;
use crate::io::film::srgb_from_linear;
use crate::tracer::LEVEL_SAMPLES;
use std::sync::LazyLock;

/// Values of a screen by the root of the radiance, of which they are nearly a multiple: straight lines between these
/// are right to 0.001 steps.
pub static CURVE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let root = |i: usize| i as f64 / CURVE_INTERVALS as f64;
    (0..=CURVE_INTERVALS + 1).map(|i| (255.0 * srgb_from_linear(root(i).powi(2))) as f32).collect()
});
/// Parts of the root's range.
pub const CURVE_INTERVALS: usize = 4096;

/// Each value of [`CURVE`] with the difference to the next: they are looked up together.
static STEPS: LazyLock<Vec<[f32; 2]>> =
    LazyLock::new(|| CURVE.windows(2).map(|pair| [pair[0], pair[1] - pair[0]]).collect());

/// Values of a screen, 0 to 255 without rounding.
pub fn display_steps(linear: [f32; 3]) -> [f32; 3] {
    let steps = STEPS.as_slice();
    linear.map(|radiance| {
        let (low, part) = place_on_curve(radiance);
        let [value, difference] = steps[low as usize];
        value + difference * part
    })
}

/// The interval of the curve that a radiance lies in, and how far in it is.
#[inline(always)]
fn place_on_curve(radiance: f32) -> (i32, f32) {
    // NaN counts as black, as it does in files.
    let at = if radiance > 0.0 { radiance.min(1.0) } else { 0.0 }.sqrt() * CURVE_INTERVALS as f32;
    // SAFETY: it is a number from 0 to CURVE_INTERVALS. A conversion of any float takes four times as many
    // instructions.
    let low: i32 = unsafe { at.to_int_unchecked() };
    (low, at - low as f32)
}

/// Channels that are looked up together.
const TOGETHER: usize = 64;

with_fma! {
    /// [`display_steps`] of many channels: in place of each its value. In three loops, as the one in the middle reads
    /// here and there, which is not done in lanes, and what is around it is.
    pub fn show(channels: &mut [f32]) {
        let steps = STEPS.as_slice();
        let (mut low, mut of_curve) = ([0i32; TOGETHER], [[0f32; TOGETHER]; 2]);
        for channels in channels.chunks_mut(TOGETHER) {
            for (low, channel) in low.iter_mut().zip(&mut *channels) {
                (*low, *channel) = place_on_curve(*channel);
            }
            let [values, differences] = &mut of_curve;
            for ((low, value), difference) in low.iter().zip(&mut *values).zip(&mut *differences).take(channels.len()) {
                [*value, *difference] = steps[*low as usize];
            }
            for ((part, value), difference) in channels.iter_mut().zip(values).zip(differences) {
                *part = *value + *difference * *part;
            }
        }
    }
}

/// The variance of the mean of four values, if they have nothing to do with each other. Of parts of one net they have:
/// together they cover the pixel better, and the error is smaller ([`super::patch::PARTS`]).
pub fn variance_of_mean(quarters: &[[f32; 3]; 4]) -> f32 {
    let [a, b, c, d] = quarters;
    let mean: [f32; 3] = std::array::from_fn(|i| (a[i] + b[i] + c[i] + d[i]) * 0.25);
    let [a, b, c, d] = quarters.map(|quarter| squared(std::array::from_fn(|i| quarter[i] - mean[i])));
    (a + b + c + d) * (1.0 / 12.0)
}

/// Mean of the squared channels.
pub fn squared([r, g, b]: [f32; 3]) -> f32 {
    (r * r + g * g + b * b) * (1.0 / 3.0)
}

/// What a pixel of a level that has samples shows: their mean.
pub fn mean(sum: [f32; 3], level: u8) -> [f32; 3] {
    mean_of(sum, LEVEL_SAMPLES[usize::from(level)] as usize)
}

/// The mean of so many samples.
pub fn mean_of(sum: [f32; 3], samples: usize) -> [f32; 3] {
    let part = 1.0 / samples as f32;
    sum.map(|sum| sum * part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn many_channels_show_what_each_does() {
        let mut random = Random::new(11);
        let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 0.0, f32::MIN_POSITIVE, 1e-45, 1.0, 1.5];
        for count in [0, 1, 2, 21, 22, 43, 130] {
            let pixel = |_| {
                std::array::from_fn(|_| match random.below(3) {
                    0 => special[random.below(special.len())],
                    _ => 1.1 * random.unit() * random.unit(),
                })
            };
            let pixels: Vec<[f32; 3]> = (0..count).map(pixel).collect();
            let mut shown = pixels.concat();
            show(&mut shown);
            let expected: Vec<[f32; 3]> = pixels.iter().map(|&pixel| display_steps(pixel)).collect();
            let bits = |channels: &[f32]| channels.iter().map(|c| c.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&shown), bits(&expected.concat()), "{count} pixels");
        }
    }
}
