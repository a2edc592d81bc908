//! Pictures of counted work ("arbitrary output variables"): one counter a picture, as false colours to look at or as
//! numbers.
//!
//! The colours are those of Inferno (van der Walt and Smith, matplotlib 2015), which is perceptually uniform: equal
//! differences of work look alike, black is none, and lightness alone tells the order, also in print and to the
//! colour-blind.
//!
//! Bad at: showing few pixels of very much work beside many of little. The brightest colour stands for what only one in
//! a thousand pixels exceeds; what is above has that colour, too, and [`AovRange::maximum`] tells how much that is.

use crate::io::film::{Film, light_of_colour};
use crate::shared::WorkCounter;
use crate::work::PixelWork;
use serde::Serialize;

/// One in so many pixels may be brighter than the brightest colour: the edges of objects, or a few pixels of a mirror
/// or glass, would else leave the rest in the dark.
const PIXELS_PER_OUTLIER: usize = 1000;

/// What the colours of a picture mean; black is always 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct AovRange {
    /// The counter.
    #[serde(serialize_with = "as_key")]
    pub counter: WorkCounter,
    /// The count of a pixel from which on it has the brightest colour.
    pub brightest: u32,
    /// The largest count of a pixel.
    pub maximum: u32,
}

fn as_key<S: serde::Serializer>(counter: &WorkCounter, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&counter.key())
}

/// One counter of every pixel of a picture, all rays of the pixel together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Aov {
    width: u32,
    height: u32,
    counts: Vec<u32>,
    range: AovRange,
}

impl Aov {
    /// Takes `counter` from the work on the `width` x `height` pixels of a picture.
    pub fn new(work: &[PixelWork], (width, height): (u32, u32), counter: WorkCounter) -> Self {
        let counts: Vec<_> = work.iter().map(|pixel| pixel.total().get(counter)).collect();
        let mut sorted = counts.clone();
        sorted.sort_unstable();
        let maximum = sorted.last().copied().unwrap_or(0);
        let brightest =
            sorted.get(sorted.len().saturating_sub(1 + sorted.len() / PIXELS_PER_OUTLIER)).copied().unwrap_or(0);
        // Where next to nothing is counted, what there is shall show.
        let brightest = if brightest == 0 { maximum } else { brightest };
        Aov { width, height, counts, range: AovRange { counter, brightest, maximum } }
    }

    /// What the colours mean.
    pub fn range(&self) -> AovRange {
        self.range
    }

    /// The picture in false colours. Written as PNG it has exactly the colours of the map.
    pub fn false_colours(&self) -> Film {
        let colour = |&count: &u32| {
            let part = f64::from(count) / f64::from(self.range.brightest.max(1));
            light_of_colour(colorous::INFERNO.eval_continuous(part.min(1.0)))
        };
        self.film(colour)
    }

    /// The counts themselves in all three channels, for formats of linear values; exact up to 2^24.
    pub fn numbers(&self) -> Film {
        self.film(|&count| [count as f32; 3])
    }

    fn film(&self, pixel: impl Fn(&u32) -> [f32; 3]) -> Film {
        Film { width: self.width, height: self.height, pixels: self.counts.iter().map(pixel).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::RayWork;

    fn work(tests: u32) -> PixelWork {
        let mut camera = RayWork::default();
        camera.count(WorkCounter::Tests, tests);
        let mut secondary = RayWork::default();
        secondary.count(WorkCounter::Tests, 1);
        secondary.count(WorkCounter::Steps, 5);
        PixelWork { camera, secondary }
    }

    #[test]
    fn colours_run_from_black_to_the_brightest_and_numbers_are_the_counts() {
        let pixels: Vec<_> = (0..2000).map(|i| if i == 7 { work(1_000_000) } else { work(i % 100) }).collect();
        let aov = Aov::new(&pixels, (100, 20), WorkCounter::Tests);
        assert_eq!(aov.range(), AovRange { counter: WorkCounter::Tests, brightest: 100, maximum: 1_000_001 });
        let codes = aov.false_colours().to_srgb8();
        let expected = |part: f64| {
            let colorous::Color { r, g, b } = colorous::INFERNO.eval_continuous(part);
            [r, g, b]
        };
        assert_eq!((codes[7], codes[99], codes[49]), (expected(1.0), expected(1.0), expected(0.5)));
        let lightness = |code: [u8; 3]| code.iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(codes[10..100].iter().map(|&code| lightness(code)).is_sorted());
        assert_eq!(aov.numbers().pixels[7], [1_000_001.0; 3]);
        assert_eq!(aov.numbers().pixels[1], [2.0; 3]);
    }

    #[test]
    fn nothing_counted_is_black() {
        let black = Aov::new(&[work(3); 4], (2, 2), WorkCounter::Restarts);
        assert_eq!((black.range().brightest, black.range().maximum), (0, 0));
        assert!(black.false_colours().to_srgb8().iter().flatten().all(|&code| code < 5));
        let same = Aov::new(&[work(3); 4], (2, 2), WorkCounter::Steps);
        assert_eq!((same.range().brightest, same.numbers().pixels[3]), (5, [5.0; 3]));
    }
}
