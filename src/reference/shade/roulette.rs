//! Twin of `cl/shade/roulette.cl`: which secondary rays are cast. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x > 0)` is also true for NaN, and that is meant

use super::whitted::RayKind;
use crate::reference::shared::hash::hash_word;
use crate::reference::shared::math::max_component;
use crate::scene::PictureDefaults;
use crate::shared::constants::ROULETTE_UNITS;
use crate::shared::{CameraSample, RAY_DEPTH_BITS, RAY_KIND_BITS, RenderParams};
use glam::Vec3;

const _: () = assert!(PictureDefaults::MAX_DEPTH < 1 << RAY_DEPTH_BITS, "a depth is never taken for a turn");

/// What decides about the rays of a path.
#[derive(Debug, Clone, Copy)]
pub struct Killing<'a> {
    params: &'a RenderParams,
    camera_ray: u32,
}

impl<'a> Killing<'a> {
    /// Of the path whose camera ray passes there through the picture.
    #[inline(always)]
    pub fn of_path(params: &'a RenderParams, at: CameraSample) -> Self {
        Killing { params, camera_ray: hash_word(hash_word(0, at.x.to_bits()), at.y.to_bits()) }
    }

    /// The depth without the way.
    #[inline(always)]
    pub fn depth(&self, depth: u32) -> u32 {
        if self.params.plays_roulette() { depth & ((1 << RAY_DEPTH_BITS) - 1) } else { depth }
    }

    /// What it is of a ray of this kind that leaves where one of this depth has hit.
    #[inline(always)]
    pub fn next_depth(&self, depth: u32, kind: RayKind) -> u32 {
        if !self.params.plays_roulette() {
            return depth + 1;
        }
        let turns = (depth >> RAY_DEPTH_BITS) << 1 | u32::from(kind == RayKind::Refracted);
        turns << RAY_DEPTH_BITS | (self.depth(depth) + 1)
    }

    /// What a ray of this weight and kind weighs that leaves where one of this depth has hit; `None` if it is not cast.
    #[inline(always)]
    pub fn survives(&self, depth: u32, kind: RayKind, weight: Vec3) -> Option<Vec3> {
        let RenderParams { kill_weight, roulette_weight, .. } = *self.params;
        let most = max_component(weight);
        if !(most > kill_weight) {
            return None;
        }
        if most >= roulette_weight {
            return Some(weight);
        }
        let random = hash_word(self.camera_ray, self.next_depth(depth, kind) << RAY_KIND_BITS | kind as u32);
        let wins = wins_roulette(random, most, roulette_weight);
        wins.then(|| weight * (roulette_weight / most))
    }
}

/// Whether a ray of weight `most` in its largest channel wins with these random bits.
#[inline(always)]
pub fn wins_roulette(random: u32, most: f32, roulette: f32) -> bool {
    (random >> 8 | 1) as f32 * roulette < most * ROULETTE_UNITS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::sample_sequence;
    use crate::pack::sample_positions;
    use crate::random::Random;
    use crate::scene::Samples;

    /// The sum of squared deviations that `cells` of one size have from even counts, in units of the mean count, is
    /// beyond this with a probability of at most 1e-7 where they are as even as chance makes them (Laurent and Massart,
    /// "Adaptive Estimation of a Quadratic Functional by Model Selection", Annals of Statistics 28(5), 2000, lemma 1).
    fn most_chi_square(cells: usize) -> f64 {
        let (freedom, x) = ((cells - 1) as f64, 1e7f64.ln());
        freedom + 2.0 * (freedom * x).sqrt() + 2.0 * x
    }

    /// By how much pairs of numbers, which fall into 16 x 16 cells by their highest bits, are less even than chance, in
    /// units of the limit: up to 1 they are.
    fn unevenness(pairs: impl Iterator<Item = [u32; 2]>) -> f64 {
        let mut cells = [0u32; 256];
        let mut count = 0.0;
        for [a, b] in pairs {
            cells[((a >> 28) << 4 | b >> 28) as usize] += 1;
            count += 1.0;
        }
        let mean = count / 256.0;
        assert!(mean > 10.0, "too few for the statistic to be what its limit is of: {count}");
        let chi_square: f64 = cells.iter().map(|&n| (f64::from(n) - mean).powi(2) / mean).sum();
        chi_square / most_chi_square(256)
    }

    fn playing() -> RenderParams {
        RenderParams { roulette_weight: 1.0, ..RenderParams::default() }
    }

    fn at(x: f32, y: f32) -> CameraSample {
        CameraSample { x, y, footprint: 1.0 }
    }

    fn random(params: &RenderParams, at: CameraSample, depth: u32, kind: RayKind) -> u32 {
        let killing = Killing::of_path(params, at);
        hash_word(killing.camera_ray, killing.next_depth(depth, kind) << RAY_KIND_BITS | kind as u32)
    }

    /// All ways of so many surfaces, as the depth of the ray that hits the last one.
    fn ways(params: &RenderParams, surfaces: u32) -> Vec<u32> {
        let killing = Killing::of_path(params, at(0.0, 0.0));
        let next = |depth: u32| [RayKind::Reflected, RayKind::Refracted].map(|kind| killing.next_depth(depth, kind));
        (1..surfaces).fold(vec![1], |depths, _| depths.into_iter().flat_map(next).collect())
    }

    const KINDS: [RayKind; 2] = [RayKind::Reflected, RayKind::Refracted];

    #[test]
    fn numbers_are_even_over_pixels_samples_and_ways() {
        let params = playing();
        let both = |at: CameraSample, depth: u32| KINDS.map(|kind| random(&params, at, depth, kind));
        let grid = |count: u32| (0..count).flat_map(move |y| (0..count).map(move |x| (x as f32, y as f32)));
        // Of one sample a pixel, whose places have few bits, reflected rays against refracted ones.
        for offset in [0.0, 0.5] {
            for depth in [1, 2] {
                let pairs = grid(128).map(|(x, y)| both(at(x + offset, y + offset), depth));
                assert!(unevenness(pairs) < 1.0, "pixels, offset {offset}, depth {depth}");
            }
        }
        // A pixel's against its right and lower neighbour's.
        for (right, down) in [(1.0, 0.0), (0.0, 1.0), (8.0, 8.0)] {
            let first = |x, y| random(&params, at(x, y), 1, RayKind::Reflected);
            let pairs = grid(128).map(|(x, y)| [first(x, y), first(x + right, y + down)]);
            assert!(unevenness(pairs) < 1.0, "neighbours by {right}, {down}");
        }
        // Of the samples of few pixels, far from the corner where places have few bits left, one against the next.
        for samples in [sample_positions(Samples::PerPixel(256)), sample_sequence()] {
            let of_pixel = |(x, y): (f32, f32)| {
                let place = move |s: CameraSample| at(4000.0 + x + s.x, y + s.y);
                let number = |s| random(&params, place(s), 1, RayKind::Refracted);
                samples.windows(2).map(|two| [number(two[0]), number(two[1])]).collect::<Vec<_>>()
            };
            assert!(unevenness(grid(8).flat_map(of_pixel)) < 1.0, "samples");
        }
        // Of one camera ray, over all ways of up to 13 surfaces; and a ray's against that of the ray it comes of.
        let depths: Vec<_> = (1..14).flat_map(|surfaces| ways(&params, surfaces)).collect();
        assert!(unevenness(depths.iter().map(|&depth| both(at(17.25, 3.75), depth))) < 1.0, "ways");
        for kind in KINDS {
            let killing = Killing::of_path(&params, at(17.25, 3.75));
            let next = |depth| random(&params, at(17.25, 3.75), killing.next_depth(depth, kind), RayKind::Reflected);
            let pairs = depths.iter().map(|&depth| [random(&params, at(17.25, 3.75), depth, kind), next(depth)]);
            assert!(unevenness(pairs) < 1.0, "{kind:?} and what comes of it");
        }
    }

    #[test]
    fn numbers_that_are_not_random_are_seen() {
        let params = playing();
        let number = |i: u32| random(&params, at((i % 128) as f32, (i / 128) as f32), 1, RayKind::Reflected);
        let all = || 0..128 * 128;
        assert!(unevenness(all().map(|i| [number(i), number(i + 1)])) < 1.0);
        assert!(unevenness(all().map(|i| [number(i), number(i)])) > 2.0, "twice the same");
        assert!(unevenness(all().map(|i| [number(i), number(i) ^ 1 << 31])) > 2.0, "one against the other");
        assert!(unevenness(all().map(|i| [number(i), number(i) / 9 * 8])) > 2.0, "too small");
        let bits = |i: u32| [i % 128, i / 128].map(|x| (x as f32).to_bits() << 2);
        assert!(unevenness(all().map(bits)) > 2.0, "places without a hash");
    }

    /// Of the weights of rays: what lives, in the mean, is what there was; and without dividing it is not.
    #[test]
    fn weights_are_kept_on_average() {
        const COUNT: u32 = 100_000;
        const MOST_DEVIATION: f64 = 5.0; // of a normal variable: 5.7e-7
        let mut choose = Random::new(7);
        for roulette_weight in [1.0, 0.3, 1e-3] {
            let params = RenderParams { roulette_weight, ..RenderParams::default() };
            let [mut sum, mut squares, mut sum_undivided] = [0.0f64; 3];
            let mut lived = 0;
            for i in 0..COUNT {
                let colour = Vec3::new(choose.unit(), choose.unit(), choose.unit()) * roulette_weight;
                let killing = Killing::of_path(&params, at((i % 1000) as f32, (i / 1000) as f32));
                let kept = killing.survives(1, RayKind::Reflected, colour);
                if let Some(kept) = kept {
                    let (most, rounding) = (max_component(kept), 4.0 * f32::EPSILON);
                    assert!((most / roulette_weight - 1.0).abs() <= rounding, "{most}: a ray that lives weighs that");
                    lived += 1;
                }
                let difference = f64::from(kept.map_or(0.0, |kept| kept.y) - colour.y);
                sum += difference;
                squares += difference * difference;
                sum_undivided += f64::from(if kept.is_some() { 0.0 } else { -colour.y });
            }
            assert!(sum.abs() / squares.sqrt() < MOST_DEVIATION, "{roulette_weight}: {}", sum / squares.sqrt());
            assert!(sum_undivided.abs() / squares.sqrt() > 10.0 * MOST_DEVIATION, "{roulette_weight}");
            assert!((COUNT / 2..COUNT).contains(&lived), "{lived}: the largest of three numbers is 3/4 on average");
        }
    }

    #[test]
    fn the_least_and_the_greatest_weights_do_what_they_must() {
        let params = RenderParams { roulette_weight: 0.5, kill_weight: 1e-30, ..RenderParams::default() };
        let survives = |x: u32, weight: f32| {
            Killing::of_path(&params, at(x as f32, 0.0)).survives(1, RayKind::Reflected, Vec3::splat(weight))
        };
        for x in 0..1000 {
            assert_eq!(survives(x, 0.5), Some(Vec3::splat(0.5)), "as much as the roulette's always lives");
            assert_eq!(survives(x, 1.0), Some(Vec3::ONE));
            for never in [0.0, f32::NAN, -1.0, 1e-31, f32::MIN_POSITIVE] {
                assert_eq!(survives(x, never), None, "{never}");
            }
        }
        // The least number wins for all but the least weights, the greatest for none that could lose.
        for roulette in [1.0, 0.3, crate::options::LEAST_ROULETTE] {
            assert!(wins_roulette(0, roulette * 2f32.powi(-23), roulette));
            assert!(!wins_roulette(0, roulette * 2f32.powi(-25), roulette));
            assert!(!wins_roulette(u32::MAX, roulette.next_down(), roulette));
        }
        // Where none plays, depths are plain numbers.
        let plain = RenderParams::default();
        let killing = Killing::of_path(&plain, at(1.0, 1.0));
        assert_eq!((killing.next_depth(700, RayKind::Refracted), killing.depth(700)), (701, 700));
        assert!(killing.survives(1, RayKind::Reflected, Vec3::splat(1e-20)).is_some());
    }

    /// Paths of more surfaces than a word has bits keep their depth.
    #[test]
    fn depths_go_on_to_the_last() {
        let params = playing();
        let killing = Killing::of_path(&params, at(1.0, 1.0));
        let mut depth = 1;
        for expected in 2..=PictureDefaults::MAX_DEPTH {
            depth = killing.next_depth(depth, RayKind::Refracted);
            assert_eq!(killing.depth(depth), expected);
        }
        assert_eq!(depth << RAY_KIND_BITS, 0xffff_0000 | PictureDefaults::MAX_DEPTH << 8, "16 turns, and all of them");
    }
}
