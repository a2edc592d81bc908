//! A picture judged pixel by pixel.
//!
//! A pixel is *equal* where it is what f64 says but for the roundings of a sum of products, which are counted
//! ([`tolerance_of`]). Other numbers of float32 are worse than their last bit: a highlight of exponent 1000 makes a
//! thousandth of a thousandth, a chain of mirrors doubles an error with every bounce. So a pixel that differs by more
//! is rendered again and again with every number off by what float32 may round it by ([`super::Trial`]), and is
//!
//! * *rounded* where its colour lies among those of the trials that made the same decisions: the same triangles hit,
//!   the same lights hidden;
//! * *on an edge* where it lies among those of all trials: some ray of it passes so close to an edge, a silhouette or
//!   the border of a shadow that float32 may take the other side;
//! * *wrong* otherwise.
//!
//! A colour lies among others where it lies in the smallest box around them, but for the counted roundings.

use super::render::{Listener, Truth};
use super::trial::{EPSILON, Trial};
use approx::AbsDiffEq;
use glam::DVec3;
use raybrook::low_level::compare::{FilmDifference, compare_films};
use raybrook::low_level::film::{Film, srgb_from_linear};
use raybrook::low_level::parallel;
use serde::Serialize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Trials of a pixel that differs, and of one that still does after the first of them. Of 20,400 such pixels in four
/// scenes, with glass, mirrors, patterns and 91 spheres, 168 took more than the first 8, and none more than 64.
const TRIALS: [u64; 3] = [8, 64, 512];
/// How often as long as the picture each further round of trials may take: one that is wrong all over is not looked at
/// for ever. Pixels that get no further trials are wrong. 64 trials of one pixel in 64 are 50 times what those scenes
/// took.
const PATIENCE: usize = 1;
/// So many pixels get all trials in any case.
const LEAST_SEARCHED: usize = 64;
/// Roundings of a product of colours, cosine and weight on the way of one ray, and of the sum that it is added to. A
/// light takes: direction 4, cosine 4, falloff 6, spot 6, tint and colour 6, sum 2.
const ROUNDINGS_OF_RAY: f64 = 28.0;

/// What became of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelVerdict {
    /// As f64 has it.
    Equal,
    /// As float32 may round it.
    Rounded,
    /// As float32 may decide it.
    Edge,
    /// Neither.
    Wrong,
}

/// A pixel that is far off.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PixelFault {
    /// From the left.
    pub x: u32,
    /// From the top.
    pub y: u32,
    /// Largest difference of a channel in steps of 8-bit sRGB.
    pub steps: f64,
    /// Linear, as found.
    pub found: [f32; 3],
    /// Linear, as f64 has it.
    pub truth: [f64; 3],
}

/// What is to be said of a picture.
#[derive(Debug, Clone, Serialize)]
pub struct PictureVerdict {
    /// How many there are.
    pub pixels: usize,
    /// As f64 has them.
    pub equal: usize,
    /// As float32 may round them.
    pub rounded: usize,
    /// As float32 may decide them.
    pub edge: usize,
    /// Nothing explains them.
    pub wrong: usize,
    /// The farthest from f64 of those that are right.
    pub worst_right: Option<PixelFault>,
    /// The farthest of the wrong ones.
    pub worst_wrong: Option<PixelFault>,
    /// All in all.
    pub difference: FilmDifference,
}

/// How far a channel of this value may be off by the roundings of sums and products alone: everything that is summed is
/// positive, so that a sum is off by no more than its parts.
fn tolerance_of(value: f64, truth: &Truth) -> f64 {
    let roundings = ROUNDINGS_OF_RAY * f64::from(truth.depth()) + truth.light_count() as f64;
    roundings * EPSILON * value + f64::from(f32::MIN_POSITIVE)
}

/// The smallest box around some colours.
#[derive(Debug, Clone, Copy)]
struct Among {
    low: DVec3,
    high: DVec3,
}

impl Among {
    fn of(colour: DVec3) -> Among {
        Among { low: colour, high: colour }
    }

    fn add(&mut self, colour: DVec3) {
        self.low = self.low.min(colour);
        self.high = self.high.max(colour);
    }

    fn holds(&self, colour: DVec3, truth: &Truth) -> bool {
        let nearest = colour.clamp(self.low, self.high);
        (0..3).all(|k| nearest[k].abs_diff_eq(&colour[k], tolerance_of(nearest[k].abs(), truth)))
    }
}

/// The state of a pixel that differs.
struct Suspect {
    index: usize,
    decisions: u64,
    alike: Among,
    all: Among,
    trials: u64,
    verdict: PixelVerdict,
}

impl Suspect {
    /// Renders the pixel with other roundings until they explain it, or there have been `trials`.
    fn search(&mut self, truth: &Truth, found: DVec3, trials: u64) {
        let (x, y) = place(self.index, truth);
        while self.trials < trials && self.verdict != PixelVerdict::Rounded {
            self.trials += 1;
            let mut trial = Trial::rounded(self.trials << 32 ^ self.index as u64);
            let colour = truth.pixel(x, y, &mut trial, &mut Listener::None);
            self.all.add(colour);
            if trial.decisions() == self.decisions {
                self.alike.add(colour);
            }
            if self.alike.holds(found, truth) {
                self.verdict = PixelVerdict::Rounded;
            } else if self.all.holds(found, truth) {
                self.verdict = PixelVerdict::Edge;
            }
        }
    }
}

fn place(index: usize, truth: &Truth) -> (u32, u32) {
    let width = truth.size().0;
    (index as u32 % width, index as u32 / width)
}

/// Renders the picture in f64 and judges `film`, which has its size. Also returns what f64 has, rounded, and the
/// verdict of each pixel. `progress` hears the part that is done.
pub fn judge_picture(
    truth: &Truth,
    film: &Film,
    progress: &(dyn Fn(f64) + Sync),
) -> (PictureVerdict, Film, Vec<PixelVerdict>) {
    let found = |index: usize| DVec3::from_array(film.pixels[index].map(f64::from));
    let done = AtomicUsize::new(0);
    let count = film.pixels.len();
    let pixel = |index: usize| {
        let (x, y) = place(index, truth);
        let mut trial = Trial::exact();
        let colour = truth.pixel(x, y, &mut trial, &mut Listener::None);
        let equal = Among::of(colour).holds(found(index), truth);
        let suspect = (!equal).then(|| {
            let (alike, all) = (Among::of(colour), Among::of(colour));
            let decisions = trial.decisions();
            let mut suspect = Suspect { index, decisions, alike, all, trials: 0, verdict: PixelVerdict::Wrong };
            suspect.search(truth, found(index), TRIALS[0]);
            suspect
        });
        let before = done.fetch_add(1, Ordering::Relaxed);
        if before.is_multiple_of(film.width as usize) {
            progress(before as f64 / count as f64);
        }
        (colour, suspect)
    };
    let (colours, suspects): (Vec<DVec3>, Vec<Option<Suspect>>) =
        parallel::map_numbers(count, pixel).into_iter().unzip();
    let mut suspects: Vec<Suspect> = suspects.into_iter().flatten().collect();
    search_longer(truth, &mut suspects, &found);

    let mut verdicts = vec![PixelVerdict::Equal; count];
    suspects.iter().for_each(|suspect| verdicts[suspect.index] = suspect.verdict);
    let (width, height) = (film.width, film.height);
    let shown = Film { width, height, pixels: colours.iter().map(|c| c.as_vec3().to_array()).collect() };
    let how_many = |verdict| verdicts.iter().filter(|&&v| v == verdict).count();
    let worst = |is_wrong: bool| {
        let chosen = (0..count).filter(|&i| (verdicts[i] == PixelVerdict::Wrong) == is_wrong);
        let faults = chosen.map(|i| fault(i, truth, film.pixels[i], colours[i]));
        faults.filter(|fault| fault.steps > 0.0).max_by(|a, b| a.steps.total_cmp(&b.steps))
    };
    let verdict = PictureVerdict {
        pixels: count,
        equal: how_many(PixelVerdict::Equal),
        rounded: how_many(PixelVerdict::Rounded),
        edge: how_many(PixelVerdict::Edge),
        wrong: how_many(PixelVerdict::Wrong),
        worst_right: worst(false),
        worst_wrong: worst(true),
        difference: compare_films(&shown, film),
    };
    (verdict, shown, verdicts)
}

/// Gives pixels that are not explained more trials, as many pixels as may be, spread over the picture.
fn search_longer(truth: &Truth, suspects: &mut [Suspect], found: &(dyn Fn(usize) -> DVec3 + Sync)) {
    let pixels = truth.size().0 as usize * truth.size().1 as usize;
    for trials in &TRIALS[1..] {
        let most = LEAST_SEARCHED.max(PATIENCE * pixels / *trials as usize);
        let mut open: Vec<_> = suspects.iter_mut().filter(|s| s.verdict == PixelVerdict::Wrong).collect();
        let step = open.len().div_ceil(most).max(1);
        let mut chosen: Vec<_> = open.iter_mut().step_by(step).collect();
        parallel::each_mut(&mut chosen, |_, suspect| suspect.search(truth, found(suspect.index), *trials));
    }
}

fn fault(index: usize, truth: &Truth, found: [f32; 3], colour: DVec3) -> PixelFault {
    let (x, y) = place(index, truth);
    let shown = |c: f64| 255.0 * srgb_from_linear(if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 });
    let steps = (0..3).map(|k| (shown(f64::from(found[k])) - shown(colour[k])).abs()).fold(0.0, f64::max);
    PixelFault { x, y, steps, found, truth: colour.to_array() }
}
