//! Levels of a texture: pictures of it that are half as wide and high, then a quarter, down to one texel, of which each
//! texel is the mean of those that it covers (Williams, "Pyramidal Parametrics", SIGGRAPH 1983).
//!
//! Means are those of linear light, weighted by area where a side is odd; each level is made from the one before as it
//! was before it was rounded to 8 bits. They are the host's business alone: device and twin read the same texels.

use crate::io::film::{SRGB_TO_LINEAR, linear_from_srgb, srgb_from_linear};
use crate::parallel;
use crate::scene::Image;
use glam::Vec3;
use std::sync::LazyLock;

/// Appends the levels of `image` behind itself; returns how many there are with it.
pub(super) fn push_levels(image: &Image, texels: &mut Vec<u32>) -> u32 {
    let mut size = [image.width, image.height];
    let mut count = 1;
    let mut level: Option<Vec<Vec3>> = None;
    while size != [1, 1] {
        let half = size.map(|side| (side / 2).max(1));
        let smaller = match &level {
            None => halved(size, half, |i| {
                let [r, g, b, _] = image.rgba[i];
                Vec3::from_array([r, g, b].map(|code| SRGB_TO_LINEAR[usize::from(code)]))
            }),
            Some(level) => halved(size, half, |i| level[i]),
        };
        parallel::extend(texels, smaller.len(), |i| to_srgb(smaller[i]));
        (level, size) = (Some(smaller), half);
        count += 1;
    }
    count
}

/// A picture of `half` the size, of one whose texels `of` numbers row by row.
fn halved([width, height]: [u32; 2], half: [u32; 2], of: impl Fn(usize) -> Vec3 + Sync) -> Vec<Vec3> {
    let across = spans(width, half[0]);
    let down = spans(height, half[1]);
    let texel = |rows: &Span, columns: &Span| {
        let mut sum = Vec3::ZERO;
        for (y, share) in rows.parts() {
            let row = columns.parts().map(|(x, share)| of(y * width as usize + x) * share).sum::<Vec3>();
            sum += row * share;
        }
        sum
    };
    let columns = across.len();
    parallel::map_numbers(columns * down.len(), |i| texel(&down[i / columns], &across[i % columns]))
}

/// The texels of a side that one of the next level covers: two, or where a side is odd three, or the only one.
struct Span {
    first: usize,
    count: usize,
    shares: [f32; 3],
}

impl Span {
    fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        (self.first..).zip(self.shares).take(self.count)
    }
}

fn spans(side: u32, half: u32) -> Vec<Span> {
    let covered = |i: u32| {
        // In units of 1/half texel: texel k reaches from k * half to (k + 1) * half.
        let (start, end) = (u64::from(i) * u64::from(side), (u64::from(i) + 1) * u64::from(side));
        let half = u64::from(half);
        let (first, last) = (start / half, (end - 1) / half);
        let share = |k: u64| ((k + 1) * half).min(end).saturating_sub((k * half).max(start)) as f32 / side as f32;
        Span { first: first as usize, count: (last - first + 1) as usize, shares: [0, 1, 2].map(|k| share(first + k)) }
    };
    (0..half).map(covered).collect()
}

/// The sRGB curve as tables: of a large texture millions of channels are rounded before anything is traced.
struct Curve {
    /// Linear light from which on each 8-bit value but the first is the nearest.
    from: [f32; 255],
    /// The 8-bit value at the beginning of each of many equal parts of 0..1.
    start: Vec<u8>,
}

/// In so many parts the curve, which is steepest at black, passes at most one 8-bit value.
const CURVE_PARTS: usize = 1 << 12;

static CURVE: LazyLock<Curve> = LazyLock::new(|| {
    let nearest = |linear: f64| (srgb_from_linear(linear) * 255.0).round() as u8;
    Curve {
        from: std::array::from_fn(|code| linear_from_srgb((code as f64 + 0.5) / 255.0) as f32),
        start: (0..=CURVE_PARTS).map(|part| nearest(part as f64 / CURVE_PARTS as f64)).collect(),
    }
});

/// The nearest 8-bit sRGB texel.
fn to_srgb(colour: Vec3) -> u32 {
    let code = |linear: f32| {
        let start = CURVE.start[((linear.clamp(0.0, 1.0) * CURVE_PARTS as f32) as usize).min(CURVE_PARTS)];
        start + CURVE.from[usize::from(start)..].iter().take_while(|&&from| linear >= from).count() as u8
    };
    u32::from_le_bytes([code(colour.x), code(colour.y), code(colour.z), u8::MAX])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, colour: impl Fn(u32, u32) -> [u8; 3]) -> Image {
        let texel = |i: u32| {
            let [r, g, b] = colour(i % width, i / width);
            [r, g, b, u8::MAX]
        };
        Image { name: "made".to_owned(), width, height, rgba: (0..width * height).map(texel).collect() }
    }

    fn levels_of(image: &Image) -> (u32, Vec<[u8; 4]>) {
        let mut texels = Vec::new();
        let count = push_levels(image, &mut texels);
        (count, texels.into_iter().map(u32::to_le_bytes).collect())
    }

    #[test]
    fn sides_are_halved_down_to_one_texel() {
        for (size, expected) in [((1, 1), (1, 0)), ((2, 1), (2, 1)), ((8, 4), (4, 8 + 2 + 1)), ((5, 3), (3, 2 + 1))] {
            let (count, texels) = levels_of(&image(size.0, size.1, |_, _| [90, 0, 255]));
            assert_eq!((count, texels.len()), expected, "{size:?}");
            assert!(texels.iter().all(|&texel| texel == [90, 0, 255, 255]), "{size:?}: {texels:?}");
        }
    }

    #[test]
    fn levels_are_means_of_linear_light() {
        // Half of a white light, shown: 188. Of black and white texels all levels are that.
        let (_, texels) = levels_of(&image(8, 8, |x, y| [if (x + y) % 2 == 0 { 255 } else { 0 }; 3]));
        assert!(texels.iter().all(|&texel| texel == [188, 188, 188, 255]), "{texels:?}");
        // Five columns in two: the middle one belongs to both by half.
        let (_, texels) = levels_of(&image(5, 1, |x, _| [if x == 2 { 255 } else { 0 }; 3]));
        let fifth = (srgb_from_linear(0.2) * 255.0).round() as u8;
        assert_eq!(texels, [[fifth, fifth, fifth, 255]; 3]);
    }

    #[test]
    fn every_share_is_counted_once() {
        for side in 2..70u32 {
            let half = side / 2;
            let mut total = vec![0.0; side as usize];
            for span in spans(side, half) {
                assert!((span.parts().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-6);
                span.parts().for_each(|(k, share)| total[k] += share);
            }
            let each = half as f32 / side as f32;
            assert!(total.iter().all(|t| (t - each).abs() < 1e-6), "{side}: {total:?}");
        }
    }

    #[test]
    fn colours_round_to_the_nearest() {
        for i in 0..=100_000u32 {
            let linear = i as f32 / 100_000.0;
            let [r, ..] = to_srgb(Vec3::splat(linear)).to_le_bytes();
            let shown = srgb_from_linear(f64::from(linear)) * 255.0;
            assert!((f64::from(r) - shown).abs() < 0.5001, "{linear}: {r}, {shown}");
        }
    }
}
