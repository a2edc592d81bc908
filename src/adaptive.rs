//! Rays where they show: pictures whose error is asked for instead of their samples.
//!
//! A coarse lattice of pixels is traced first and what lies between is interpolated (adaptive subsampling: thesis,
//! section 2.2.1; Bergman et al., "Image Rendering by Adaptive Refinement", SIGGRAPH 1986). Then more samples go, round
//! by round, to the pixels where they lower the picture's error most (Mitchell, "Generating Antialiased Images at Low
//! Sampling Densities", SIGGRAPH 1987; Kirk and Arvo, "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH
//! 1991), until the error that is left, estimated from differences between parts of the samples and between neighbours,
//! is as small as was asked for.
//!
//! Every pixel's samples are the first 1, 4, 16, 64 or 256 points of one sequence, so that a picture whose pixels all
//! have 256 is the one that 256 fixed samples give, bit for bit. Decisions are taken by the host or on the device
//! ([`crate::options::Decisions`]), from radiances that have the same bits everywhere and in the same arithmetic: so
//! the pictures have the same bits, too.
//!
//! Bad at: features that fall between all samples of a neighbourhood, of which nobody knows.

mod estimate;

use crate::error::Result;
use crate::io::film::Film;
use crate::options::Decisions;
use crate::shared::{CameraSample, RenderParams, TILE_SIDE};
use crate::tracer::{
    Adaptive, AdaptiveStats, Backend, LAST_LEVEL, LEVEL_SAMPLES, MOST_SAMPLES, Progress, RenderResult,
};
use crate::work::PixelWork;
pub(crate) use estimate::{COUNTED, CURVE, Choice, Promises, cl_constants};
use estimate::{Estimates, TileRow, display_steps, mean, mean_of, variance_of_mean};
use rayon::prelude::*;
use std::time::Instant;

/// How many pixels of a picture lie on a lattice: every so many across and down, and the last.
fn on_lattice((width, height): (usize, usize), step: usize) -> usize {
    let on_axis = |pixels: usize| (pixels - 1).div_ceil(step) + 1;
    on_axis(width) * on_axis(height)
}

/// The estimate comes down to this part of the error that is asked for. It may be off where few pixels have most of the
/// error: with an aim of 1 the error made was 0.53 to 1.10 of what was asked for on 19 scenes, and 1.19 once (48 x 48
/// pixels of gears).
const AIM: f64 = 0.85;

/// Pixels whose positions one thread makes at a time.
const PIXELS_AT_A_TIME: usize = 1 << 12;

/// Bytes for each pixel of a picture whose pixels the host keeps, beside the picture: estimates, their errors, and the
/// list of pixels that are traced next.
const PIXEL_BYTES: u64 = estimate::PIXEL_BYTES + size_of::<usize>() as u64;

/// Bytes for each ray of a list: its position twice, where parts of the list are joined, and its radiance.
const RAY_BYTES: u64 = 2 * size_of::<CameraSample>() as u64 + Film::PIXEL_BYTES;

/// Rays of a list for each pixel, that pictures of hard scenes took at the most at a time.
const RAYS_PER_PIXEL: u64 = 3;

/// About how many bytes [`render_adaptive`] takes of so many pixels, beside the picture: on the host, and on a device
/// that has a copy of the lists, which it counts with its queues.
pub(crate) fn estimated_bytes(pixels: u64, counters: bool, is_device: bool) -> u64 {
    let work = if counters { size_of::<PixelWork>() as u64 } else { 0 };
    let rays = (RAYS_PER_PIXEL * pixels).min(Adaptive::LIST_RAYS as u64);
    // On a device lists of rays are there once more, and what was counted of them is fetched in parts.
    let of_ray = if is_device { 2 * RAY_BYTES + 2 * work } else { RAY_BYTES + work };
    pixels * (PIXEL_BYTES + work) + rays * of_ray
}

/// Positions of a pixel's samples, in [0, 1)^2: the sequence of Sobol', in which 4^k points from any multiple of 4^k on
/// have one point in each of the squares and rectangles that are 4^k to a pixel, scrambled as Owen's (Laine and Karras'
/// hash: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020). Of 6,000 pairs of those among 2^16 seeds
/// that keep the first point and the means of 4, 16 and 64 near the middle, these had the least errors of 400 edges
/// through the pixel: 0.22, 0.13, 0.035, 0.012 and 0.0041 of the edge's step for 1 to 256 samples (the Hammersley sets
/// of [`crate::pack::sample_positions`]: 0.22, 0.10, 0.039, 0.013, 0.0050).
///
/// Each stands for a square over which textures are averaged: the first, which may remain the only one, for the pixel,
/// others for half of their share of it when the samples up to the next power of 4 are there. Of a floor of tiles, out
/// to the horizon, whole shares blurred as much as 1.2 steps where an error of 1 was asked for, halves 0.9 (2.4 and 2.8
/// million samples).
pub fn sample_sequence() -> Vec<CameraSample> {
    const SEEDS: [u32; 2] = [213, 661];
    // Behind the hash of the reversed bits each bit depends on the higher ones alone.
    let scramble = |bits: u32, seed: u32| {
        let mut x = bits.reverse_bits().wrapping_add(seed);
        for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
            x ^= x.wrapping_mul(factor);
        }
        (x.reverse_bits() >> 8) as f32 / (1 << 24) as f32
    };
    let second_axis = |mut index: u32| {
        let (mut bits, mut direction) = (0, 1 << 31);
        while index != 0 {
            bits ^= direction * (index & 1);
            direction ^= direction >> 1;
            index >>= 1;
        }
        bits
    };
    let footprint = |index: u32| match LEVEL_SAMPLES[LEVEL_SAMPLES.partition_point(|&samples| samples <= index)] {
        1 => 1.0,
        samples => (0.5 / samples as f32).sqrt(),
    };
    (0..MOST_SAMPLES)
        .map(|i| CameraSample {
            x: scramble(i.reverse_bits(), SEEDS[0]),
            y: scramble(second_axis(i), SEEDS[1]),
            footprint: footprint(i),
        })
        .collect()
}

/// Where what is known of a picture's pixels is kept, and who traces them.
pub(crate) trait Pixels {
    /// Takes the samples that bring pixels to the next level: of a choice, or, without one, the first samples of those
    /// of the lattice.
    fn raise(&mut self, choice: Option<Choice>) -> Result<()>;

    /// Gives the pixels without samples what lies between those of the lattice, and the first time estimates what that
    /// misses.
    fn interpolate(&mut self) -> Result<()>;

    /// Estimates the errors of all pixels anew.
    fn update(&mut self) -> Result<Promises>;
}

/// Takes samples where they help most until the picture's error is as small as was asked for. Who decided, and in which
/// time, the caller knows.
pub(crate) fn refine(
    pixels: &mut dyn Pixels,
    size: (usize, usize),
    adaptive: Adaptive,
    progress: Progress,
) -> Result<AdaptiveStats> {
    let all = size.0 * size.1;
    let target = (AIM * f64::from(adaptive.error)).powi(2) * all as f64;
    let mut stats = AdaptiveStats {
        error: adaptive.error,
        estimated_error: 0.0,
        pixels: [0; LEVEL_SAMPLES.len()],
        rounds: 1,
        decided_by: Decisions::Host,
        decide_s: 0.0,
    };
    pixels.raise(None)?;
    stats.pixels[1] = on_lattice(size, adaptive.step()) as u64;
    stats.pixels[0] = all as u64 - stats.pixels[1];
    if adaptive.step() > 1 {
        pixels.interpolate()?;
    }
    let mut first = None;
    loop {
        let promises = pixels.update()?;
        let squared = promises.squared_error();
        stats.estimated_error = (squared / all as f64).sqrt() as f32;
        if squared <= target {
            break;
        }
        let first = *first.get_or_insert(squared);
        if target > 0.0 {
            // What is left goes down by about the same factor in each round.
            progress(((first / squared).ln() / (first / target).ln()).clamp(0.0, 1.0));
        }
        let choice = promises.choose(target, stats.rounds);
        let raised = promises.chosen(choice);
        if raised == [0; LAST_LEVEL as usize] {
            break;
        }
        pixels.raise(Some(choice))?;
        stats.rounds += 1;
        for (level, count) in raised.into_iter().enumerate() {
            stats.pixels[level] -= count;
            stats.pixels[level + 1] += count;
        }
    }
    if adaptive.step() > 1 {
        pixels.interpolate()?;
    }
    Ok(stats)
}

/// Renders a picture with as many rays as the error takes that is asked for. Of `params` samples do not matter.
///
/// # Errors
/// As [`Backend::render`].
pub fn render_adaptive(
    tracer: &mut dyn Backend,
    params: &RenderParams,
    adaptive: Adaptive,
    progress: Progress,
) -> Result<RenderResult> {
    if let Some(result) = tracer.render_by_error(params, adaptive, progress)? {
        return Ok(result);
    }
    let mut sampler = Sampler::new(tracer, params, adaptive);
    let size = sampler.size;
    let stats = refine(&mut sampler, size, adaptive, progress)?;
    Ok(sampler.finish(stats))
}

/// A picture on its way whose pixels the host keeps.
struct Sampler<'a> {
    tracer: &'a mut dyn Backend,
    params: RenderParams,
    sequence: Vec<CameraSample>,
    size: (usize, usize),
    adaptive: Adaptive,
    estimates: Estimates,
    /// Its film has the sum of the samples of each pixel that has any, until all are there.
    result: RenderResult,
    decide_s: f64,
}

impl Pixels for Sampler<'_> {
    fn raise(&mut self, choice: Option<Choice>) -> Result<()> {
        let pixels = match choice {
            Some(choice) => self.on_host(|sampler| sampler.estimates.chosen(choice)),
            None if self.adaptive.step() == 1 => return self.raise_all(),
            None => {
                self.result.film.pixels = Film::try_pixels(self.size.0 * self.size.1)?;
                self.on_host(|sampler| sampler.estimates.pixels_of_lattice())
            }
        };
        let mut rest = pixels.as_slice();
        while !rest.is_empty() {
            let (firsts, positions) = self.on_host(|sampler| sampler.list(rest));
            let (now, later) = rest.split_at(firsts.len() - 1);
            let traced = self.tracer.render(&self.params.of_list(positions.len() as u32), &positions, &|_| ())?;
            self.on_host(|sampler| {
                sampler.result.add(&traced);
                sampler.take(now, &firsts, &traced);
            });
            rest = later;
        }
        Ok(())
    }

    fn interpolate(&mut self) -> Result<()> {
        self.on_host(|sampler| sampler.estimates.interpolate(&mut sampler.result.film.pixels));
        Ok(())
    }

    fn update(&mut self) -> Result<Promises> {
        Ok(self.on_host(|sampler| sampler.estimates.update()))
    }
}

impl<'a> Sampler<'a> {
    fn new(tracer: &'a mut dyn Backend, params: &RenderParams, adaptive: Adaptive) -> Self {
        let size = (params.width as usize, params.height as usize);
        let film = Film { width: params.width, height: params.height, pixels: Vec::new() };
        Sampler {
            tracer,
            params: *params,
            sequence: sample_sequence(),
            size,
            adaptive,
            estimates: Estimates::new(size, adaptive.step()),
            result: RenderResult::of_film(film),
            decide_s: 0.0,
        }
    }

    /// Takes the first sample of every pixel: of a picture that has no more, so that nothing is listed.
    fn raise_all(&mut self) -> Result<()> {
        let params = RenderParams { sample_count: 1, sample_weight: 1.0, ..self.params };
        let mut traced = self.tracer.render(&params, &self.sequence[..1], &|_| ())?;
        self.on_host(|sampler| {
            sampler.result.add(&traced);
            sampler.result.work = traced.work.take();
            sampler.result.film = traced.film;
            sampler.film_rows().for_each(|(film, mut estimates)| {
                for (at, pixel) in film.iter_mut().enumerate() {
                    let raised = raise_pixel([0.0; 3], &[*pixel]);
                    *pixel = raised.sum;
                    estimates.raise(at, raised.shown, raised.variance);
                }
            });
        });
        Ok(())
    }

    /// The film and the estimates of each row of tiles.
    fn film_rows(&mut self) -> impl IndexedParallelIterator<Item = (&mut [[f32; 3]], TileRow<'_>)> {
        let in_row = TILE_SIDE as usize * self.size.0;
        self.result.film.pixels.par_chunks_mut(in_row).zip(self.estimates.tile_rows())
    }

    /// The picture, whose film has sums until now.
    fn finish(mut self, stats: AdaptiveStats) -> RenderResult {
        self.on_host(|sampler| {
            sampler.film_rows().for_each(|(film, estimates)| {
                for (at, pixel) in film.iter_mut().enumerate() {
                    *pixel = mean(*pixel, estimates.level(at));
                }
            });
        });
        let stats = AdaptiveStats { decide_s: self.decide_s, ..stats };
        RenderResult { adaptive: Some(stats), ..self.result }
    }

    /// Counts the time of what the host does.
    fn on_host<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let done = work(self);
        self.decide_s += start.elapsed().as_secs_f64();
        done
    }

    /// The new samples of the first of some pixels, of as many as a list has room for: where those of each begin and
    /// the last ones end, and their positions.
    fn list(&self, pixels: &[usize]) -> (Vec<usize>, Vec<CameraSample>) {
        let (sequence, estimates, width) = (&self.sequence, &self.estimates, self.size.0);
        let mut firsts = vec![0];
        for &pixel in pixels {
            let end = firsts[firsts.len() - 1] + estimates.new_samples(pixel).len();
            if firsts.len() > 1 && end > self.adaptive.list_rays {
                break;
            }
            firsts.push(end);
        }
        let positions_of = |&pixel: &usize| {
            let (x, y) = ((pixel % width) as f32, (pixel / width) as f32);
            sequence[estimates.new_samples(pixel)].iter().map(move |s| CameraSample { x: x + s.x, y: y + s.y, ..*s })
        };
        let parts = pixels[..firsts.len() - 1].par_chunks(PIXELS_AT_A_TIME);
        let positions: Vec<Vec<_>> = parts.map(|part| part.iter().flat_map(positions_of).collect()).collect();
        (firsts, positions.concat())
    }

    /// Takes note of what was traced: the new samples of each of the pixels, which begin at `firsts`.
    fn take(&mut self, pixels: &[usize], firsts: &[usize], traced: &RenderResult) {
        let samples = |index: usize| firsts[index]..firsts[index + 1];
        // Pixels are listed by rows of tiles: what one thread writes is apart from what others do.
        let in_row = TILE_SIDE as usize * self.size.0;
        let mut end = 0;
        let count = self.result.film.pixels.len();
        let rows: Vec<_> = (0..count.div_ceil(in_row))
            .map(|row| {
                let start = end;
                end += pixels[start..].partition_point(|&pixel| pixel / in_row <= row);
                start..end
            })
            .collect();
        let was_interpolated = self.estimates.is_interpolated();
        let news = self.film_rows().zip(rows).enumerate();
        let news = news.map(|(row, ((sums, mut estimates), list))| {
            let mut news = Vec::new();
            for index in list {
                let (pixel, at) = (pixels[index], pixels[index] - row * in_row);
                let old = if estimates.level(at) > 0 { sums[at] } else { [0.0; 3] };
                let raised = raise_pixel(old, &traced.film.pixels[samples(index)]);
                sums[at] = raised.sum;
                let change = estimates.raise(at, raised.shown, raised.variance);
                news.extend(change.filter(|_| was_interpolated).map(|change| (pixel, change)));
            }
            news
        });
        let news: Vec<Vec<_>> = news.collect();
        self.estimates.tell_neighbours(news.into_iter().flatten());
        if let Some(work) = &traced.work {
            let all = self.result.work.get_or_insert_with(|| vec![PixelWork::default(); count]);
            for (index, &pixel) in pixels.iter().enumerate() {
                work[samples(index)].iter().for_each(|one| all[pixel].add(one));
            }
        }
    }
}

/// A pixel at its next level.
struct Raised {
    sum: [f32; 3],
    /// As [`display_steps`].
    shown: [f32; 3],
    /// Of that.
    variance: f32,
}

/// Adds to the sum of a pixel's samples its `new` ones: the first, or three times as many as before.
fn raise_pixel(old: [f32; 3], new: &[[f32; 3]]) -> Raised {
    let sum = new.iter().fold(old, |sum, radiance| plus(sum, *radiance));
    let before = new.len() / 3;
    let mut variance = 0.0;
    if before > 0 {
        // Four sets of samples that cover the pixel alike: the old ones, and as many new ones three times.
        let quarter = |sum: [f32; 3]| display_steps(sum.map(|s| s / before as f32));
        let mut quarters = [quarter(old); 4];
        for (value, part) in quarters[1..].iter_mut().zip(new.chunks(before)) {
            *value = quarter(part.iter().fold([0.0; 3], |sum, r| plus(sum, *r)));
        }
        variance = variance_of_mean(&quarters);
    }
    Raised { sum, shown: display_steps(mean_of(sum, before + new.len())), variance }
}

fn plus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] + b[c])
}
