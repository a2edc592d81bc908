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
//! have 256 is the one that 256 fixed samples give, bit for bit. Decisions are taken for blocks of pixels, each for
//! itself ([`crate::blocks`]), by the host ([`host`], [`patch`]) or on the device ([`crate::options::Decisions`]), from
//! radiances that have the same bits everywhere and in the same arithmetic: so the pictures have the same bits, too.
//!
//! Bad at: features that fall between all samples of a neighbourhood, of which nobody knows.

mod areas;
mod host;
mod patch;
mod promises;
mod shown;

use crate::blocks::{Area, Blocks};
use crate::error::Result;
use crate::io::film::Film;
use crate::parallel;
use crate::shared::{CameraSample, RenderParams};
use crate::tracer::{
    Adaptive, Backend, Finished, LAST_LEVEL, LEVEL_SAMPLES, MOST_SAMPLES, Progress, Refined, RenderResult,
};
use crate::work::PixelWork;
pub(crate) use areas::{render_area, render_blocks, stats_of};
pub(crate) use host::PART_PIXELS;
use promises::squared_error;
pub(crate) use promises::{COUNTED, Choice, Promises};
pub(crate) use shown::CURVE;

/// The estimate comes down to this part of the error that is asked for. It may be off where few pixels have most of the
/// error: with an aim of 1 the error made was 0.53 to 1.10 of what was asked for on 19 scenes, and 1.19 once (48 x 48
/// pixels of gears).
const AIM: f64 = 0.85;

/// Bytes for each ray of a list: its position, its radiance, and what is kept of it between.
const RAY_BYTES: u64 = size_of::<CameraSample>() as u64 + Film::PIXEL_BYTES + 4;

/// About how many bytes [`render_adaptive`] takes of a picture, beside the picture: on the host, and on a device whose
/// memory is the host's and that has a copy of the lists, which it counts with its queues.
pub(crate) fn estimated_bytes(size: (u32, u32), counters: bool, is_device: bool) -> u64 {
    let (width, height) = (size.0 as usize, size.1 as usize);
    let pixels = (width * height) as u64;
    let area = Blocks::new((width, height), 1).area(0).size();
    let in_area = (area.0 * area.1) as u64;
    let work = if counters { size_of::<PixelWork>() as u64 } else { 0 };
    let rays = (RAYS_PER_PIXEL * pixels).min(Adaptive::LIST_RAYS as u64);
    // On a device lists of rays are there once more, and what was counted of them is fetched in parts.
    let of_ray = if is_device { 2 * RAY_BYTES + 2 * work } else { RAY_BYTES + work };
    in_area * patch::PIXEL_BYTES + pixels * work + rays * of_ray
}

/// Rays of a list for each pixel, that pictures of hard scenes took at the most at a time.
const RAYS_PER_PIXEL: u64 = 3;

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

/// Where what is known of some blocks' pixels is kept, and who traces them.
pub(crate) trait Pixels {
    /// Takes the first samples, of the pixels of the lattice, and gives the others what lies between these. Returns how
    /// many have one.
    fn begin(&mut self) -> Result<u64>;

    /// Takes the samples that bring the pixels of a choice, one for each block, to the next level.
    fn raise(&mut self, choices: &[Choice]) -> Result<()>;

    /// Estimates the errors of all pixels anew, and tells what each block promises.
    fn update(&mut self) -> Result<&[Promises]>;
}

/// Takes blocks that are finished.
pub type Done<'a> = &'a mut dyn FnMut(&Finished) -> Result<()>;

/// Takes samples where they help most until the error of each block is as small as was asked for. `pixels_of`: how many
/// each block has.
pub(crate) fn refine(
    pixels: &mut dyn Pixels,
    pixels_of: &[u64],
    adaptive: Adaptive,
    progress: Progress,
) -> Result<Refined> {
    let target = |pixels: u64| (AIM * f64::from(adaptive.error)).powi(2) * pixels as f64;
    let mut refined = Refined { rounds: 1, ..Refined::default() };
    let count = pixels_of.iter().sum();
    refined.pixels[1] = pixels.begin()?;
    refined.pixels[0] = count - refined.pixels[1];
    let all = target(count);
    let mut first = None;
    loop {
        let promises = pixels.update()?;
        refined.error = promises.iter().map(|block| block.error).sum();
        if promises.iter().zip(pixels_of).all(|(block, &pixels)| block.excess(target(pixels)) <= 0.0) {
            break;
        }
        let squared = squared_error(refined.error);
        let first = *first.get_or_insert(squared);
        if 0.0 < all && all < first {
            // What is left goes down by about the same factor in each round.
            progress(((first / squared).ln() / (first / all).ln()).clamp(0.0, 1.0));
        }
        let rounds = refined.rounds;
        let choose = |i: usize| {
            let (block, target) = (&promises[i], target(pixels_of[i]));
            match block.excess(target) > 0.0 {
                true => {
                    let choice = block.choose(target, rounds);
                    (choice, block.chosen(choice))
                }
                false => (Choice::NONE, [0; LAST_LEVEL as usize]),
            }
        };
        let (choices, chosen): (Vec<Choice>, Vec<_>) =
            parallel::map_numbers(promises.len(), choose).into_iter().unzip();
        let raised: [u64; LAST_LEVEL as usize] =
            std::array::from_fn(|level| chosen.iter().map(|block| block[level]).sum());
        if raised == [0; LAST_LEVEL as usize] {
            break;
        }
        pixels.raise(&choices)?;
        refined.rounds += 1;
        for (level, count) in raised.into_iter().enumerate() {
            refined.pixels[level] -= count;
            refined.pixels[level + 1] += count;
        }
    }
    Ok(refined)
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
    render_area(tracer, params, adaptive, &whole_of(params), false, progress)
}

/// All of a picture.
fn whole_of(params: &RenderParams) -> Area {
    Area { x: 0..params.width as usize, y: 0..params.height as usize }
}

/// The blocks of a picture of this size.
pub(crate) fn blocks_of((width, height): (u32, u32), adaptive: Adaptive) -> Blocks {
    Blocks::new((width as usize, height as usize), adaptive.step())
}

/// What `cl/kernels/adaptive.cl` has of the constants of these files.
pub(crate) fn cl_constants() -> String {
    let list = |values: &[f32]| values.iter().map(|value| format!("{value:?}f")).collect::<Vec<_>>().join(", ");
    let parts = patch::PARTS.map(|parts| format!("{{{}}}", list(&parts))).join(", ");
    format!(
        "#define CURVE_INTERVALS {}u\n\
         #define LATTICE_ERROR {:?}f\n\
         #define SURPRISE {:?}f\n\
         #define ERROR_UNITS {:?}f\n\
         #define CLASS_SHIFT {}u\n\
         #define CLASSES {}u\n\
         #define LAST_LEVEL {LAST_LEVEL}u\n\
         __constant uint LEVEL_SAMPLES[] = {{{}}};\n\
         __constant float NEW_SAMPLES_RECIPROCALS[] = {{{}}};\n\
         __constant float PARTS[][3] = {{{parts}}};\n",
        shown::CURVE_INTERVALS,
        patch::LATTICE_ERROR,
        patch::SURPRISE,
        promises::ERROR_UNITS,
        promises::CLASS_SHIFT,
        promises::CLASSES,
        LEVEL_SAMPLES.map(|samples| format!("{samples}u")).join(", "),
        list(&promises::NEW_SAMPLES_RECIPROCALS),
    )
}
