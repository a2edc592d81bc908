//! What is left of the squared error of a block, and which of its pixels more samples would help most.

use crate::tracer::{LAST_LEVEL, LEVEL_SAMPLES};

/// What each new sample of a pixel promises to take away of the squared error: classes, four to a factor of 2. None
/// where there are no more samples, or nothing to take away.
pub fn class(level: u8, error: f32) -> Option<usize> {
    let worth = NEW_SAMPLES_RECIPROCALS.get(usize::from(level))?;
    (error > 0.0).then(|| (error * worth).to_bits() as usize >> CLASS_SHIFT)
}

/// What is left of the squared error of a block, and where samples would take how much of it away.
#[derive(Debug, Clone, PartialEq)]
pub struct Promises {
    /// The sum of the squared errors of all pixels in units of 1 / [`ERROR_UNITS`], each cut off to these: whole
    /// numbers have the same sum in any order.
    pub error: u64,
    /// Pixels by level, then by class.
    pub pixels: Vec<u32>,
}

impl Default for Promises {
    fn default() -> Self {
        Promises { error: 0, pixels: vec![0; COUNTED] }
    }
}

impl Promises {
    /// Adds a pixel.
    pub fn count(&mut self, level: u8, error: f32) {
        self.error = self.error.wrapping_add((error * ERROR_UNITS) as u64);
        if let Some(class) = class(level, error) {
            let count = &mut self.pixels[usize::from(level) * CLASSES + class];
            *count = count.wrapping_add(1);
        }
    }

    /// The opposite of [`Promises::count`].
    pub fn forget(&mut self, level: u8, error: f32) {
        self.error = self.error.wrapping_sub((error * ERROR_UNITS) as u64);
        if let Some(class) = class(level, error) {
            let count = &mut self.pixels[usize::from(level) * CLASSES + class];
            *count = count.wrapping_sub(1);
        }
    }

    /// How far the squared error is above `target`, at least 0.
    pub fn excess(&self, target: f64) -> f64 {
        (squared_error(self.error) - target).max(0.0)
    }

    /// How many pixels of each level a choice has.
    pub fn chosen(&self, choice: Choice) -> [u64; LAST_LEVEL as usize] {
        std::array::from_fn(|level| {
            let classes = self.pixels[level * CLASSES..][..CLASSES].iter().enumerate();
            let chosen = classes.filter(|&(class, _)| choice.includes(level as u8, class));
            chosen.map(|(_, &count)| u64::from(count)).sum()
        })
    }

    /// The pixels that are to have more samples, by what they promise for each: so many that the squared error comes
    /// down to `target`, if they keep their promises. After many `rounds` more than that: each is a list of its own,
    /// and the last ones would be short.
    ///
    /// While many of them are interpolated, none but these: next to them the contrast of the others means little.
    pub fn choose(&self, target: f64, rounds: u32) -> Choice {
        let middle = |class: usize| f64::from(f32::from_bits(((2 * class + 1) << (CLASS_SHIFT - 1)) as u32));
        let mut promises: Vec<f64> = (0..CLASSES)
            .map(|class| {
                let count = |level: usize| f64::from(self.pixels[level * CLASSES + class]);
                let samples: f64 =
                    (0..usize::from(LAST_LEVEL)).map(|level| count(level) * f64::from(new_samples(level))).sum();
                // The last classes are of no numbers.
                if samples > 0.0 { NEXT_LEVEL * middle(class) * samples } else { 0.0 }
            })
            .collect();
        let squared = squared_error(self.error);
        let late = f64::from(rounds.saturating_sub(EARLY_ROUNDS)) / f64::from(LATE_ROUNDS);
        let (mut excess, mut lowest) = ((squared - target).max(late.min(MOST_AT_A_TIME) * squared), CLASSES);
        while lowest > 1 && excess > 0.0 {
            lowest -= 1;
            excess -= promises[lowest];
            // What these pixels leave is worth its samples, too, before others are worth their first.
            if let Some(later) = lowest.checked_sub(CLASSES_OF_LEVEL) {
                promises[later] += (1.0 - NEXT_LEVEL) * promises[lowest];
            }
        }
        let all = Choice { lowest, only_interpolated: false };
        let chosen = self.chosen(all);
        Choice { only_interpolated: chosen[0] > chosen.iter().sum::<u64>() / FEW_INTERPOLATED, ..all }
    }
}

/// A sum of squared errors that was counted in units of [`Promises::error`].
pub fn squared_error(error: u64) -> f64 {
    error as f64 / f64::from(ERROR_UNITS)
}

/// Pixels that are to have more samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// The lowest class; 1 or more.
    pub lowest: usize,
    /// Whether those that have samples are left out.
    pub only_interpolated: bool,
}

impl Choice {
    /// No pixel.
    pub const NONE: Choice = Choice { lowest: CLASSES, only_interpolated: false };

    /// Whether it has the pixels of a level and class.
    pub fn includes(self, level: u8, class: usize) -> bool {
        class >= self.lowest && (level == 0 || !self.only_interpolated)
    }
}

/// How many samples bring a pixel from this level to the next.
const fn new_samples(level: usize) -> u32 {
    LEVEL_SAMPLES[level + 1] - LEVEL_SAMPLES[level]
}

/// 1 / [`new_samples`].
pub const NEW_SAMPLES_RECIPROCALS: [f32; LAST_LEVEL as usize] = {
    let mut all = [0.0; LAST_LEVEL as usize];
    let mut level = 0;
    while level < all.len() {
        all[level] = 1.0 / new_samples(level) as f32;
        level += 1;
    }
    all
};

/// The part of a squared error that four times the samples take away, where it is a part of n^-1.5.
const NEXT_LEVEL: f64 = 0.875;
/// Rounds in which no more is taken than what is needed, as estimated. Pictures without a lattice are done by then;
/// behind a lattice new contrast shows beside every pixel that is traced, so that lists would follow edges pixel by
/// pixel.
const EARLY_ROUNDS: u32 = 6;
/// Each round after them takes at least one part in so many more of the squared error than the round before.
const LATE_ROUNDS: u32 = 16;
/// The part of the squared error that late rounds need not exceed.
const MOST_AT_A_TIME: f64 = 0.5;
/// Interpolated pixels are traced by themselves while they are more than one in so many of those that are worth
/// samples.
const FEW_INTERPOLATED: u64 = 8;
/// Units of a squared error of 1: in pictures of 2^28 pixels errors of 255 steps in all of them can be counted.
pub const ERROR_UNITS: f32 = (1 << 20) as f32;
/// Bits of a float below those that name its class.
pub const CLASS_SHIFT: u32 = 21;
/// From one level to the next a squared error goes down to an eighth, and each of four times the samples takes a part
/// of that away.
const CLASSES_OF_LEVEL: usize = 4 * 5;
/// Classes of a level.
pub const CLASSES: usize = 1 << (31 - CLASS_SHIFT);
/// Levels and classes of pixels that can have more samples.
pub const COUNTED: usize = LAST_LEVEL as usize * CLASSES;
