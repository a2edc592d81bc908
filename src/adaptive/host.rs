//! Pictures of bounded error whose pixels the host keeps, one area after the other.

use super::blocks::{Area, Blocks};
use super::patch::{LATTICE_ERROR, Lattice, Patch, by_tiles, next_samples};
use super::promises::{Choice, Promises};
use super::shown::{display_steps, mean_of, squared, variance_of_mean};
use super::{Pixels, Refined, refine, sample_sequence};
use crate::budget::{DecidedBy, Need, try_repeat};
use crate::error::Result;
use crate::io::film::Film;
use crate::options::Decisions;
use crate::shared::{CameraSample, RenderParams, TILE_SIDE};
use crate::tracer::{Adaptive, Backend, LEVEL_SAMPLES, Progress, RenderResult, Sampling};
use crate::work::PixelWork;
use rayon::prelude::*;
use std::time::Instant;

/// Renders a picture with `tracer`, and decides what it traces.
///
/// # Errors
/// As [`Backend::render`].
pub fn render(
    tracer: &mut dyn Backend,
    params: &RenderParams,
    adaptive: Adaptive,
    progress: Progress,
) -> Result<RenderResult> {
    render_noting(tracer, params, adaptive, false, progress)
}

/// The same; with `notes_sampling` it tells how each pixel was sampled.
///
/// # Errors
/// As [`render`]; [`Error::OutOfMemory`](crate::Error::OutOfMemory) when there is no memory for that.
pub fn render_noting(
    tracer: &mut dyn Backend,
    params: &RenderParams,
    adaptive: Adaptive,
    notes_sampling: bool,
    progress: Progress,
) -> Result<RenderResult> {
    let size = (params.width as usize, params.height as usize);
    let blocks = Blocks::new(size, adaptive.step());
    let film = Film { width: params.width, height: params.height, pixels: Film::try_pixels(size.0 * size.1)? };
    let mut sampling = notes_sampling.then(|| room_for_sampling(size.0 * size.1)).transpose()?;
    let mut tracing = Tracing {
        tracer,
        params: *params,
        sequence: sample_sequence(),
        list_rays: adaptive.list_rays,
        result: RenderResult::of_film(film),
        decide_s: 0.0,
    };
    let (areas, pixels) = (blocks.areas(), blocks.pixels());
    let mut all = Refined::default();
    for number in 0..areas {
        let place = blocks.area(number);
        let of_area = &pixels[number * blocks.per_area..][..blocks.per_area];
        let progress = |part: f64| progress((number as f64 + part) / areas as f64);
        let mut area = AreaPixels::new(&mut tracing, &blocks, place, adaptive.step());
        all.add(&refine(&mut area, of_area, adaptive, &progress)?);
        if let Some(sampling) = &mut sampling {
            area.note_sampling(sampling);
        }
        area.finish();
    }
    let Tracing { result, decide_s, .. } = tracing;
    let stats = all.stats(adaptive, size, Decisions::Host, decide_s);
    Ok(RenderResult { adaptive: Some(stats), sampling, ..result })
}

/// Room for how so many pixels were sampled.
fn room_for_sampling(pixels: usize) -> Result<Sampling> {
    let what = format!("how {pixels} pixels were sampled");
    let bytes = 2 * (size_of::<f32>() * pixels) as u64;
    let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "lower `size`" };
    let samples = try_repeat(0, pixels).map_err(|_| need.refused())?;
    Ok(Sampling { samples, errors: try_repeat(0.0, pixels).map_err(|_| need.refused())? })
}

/// About so many first samples are taken at a time: their film is there twice, on a device and fetched.
pub const PART_PIXELS: usize = 1 << 20;

/// What traces the samples of all areas, and what became of them.
struct Tracing<'a> {
    tracer: &'a mut dyn Backend,
    params: RenderParams,
    sequence: Vec<CameraSample>,
    list_rays: usize,
    /// Its film has the first samples of an area, and what lies between them, until the area is finished.
    result: RenderResult,
    decide_s: f64,
}

/// New samples of pixels of a patch.
struct Listed {
    /// The block, and the patch's number in it; of first samples 0, and its number in the area.
    patch: (usize, usize),
    /// Where it lies in the picture.
    place: Area,
    /// A whole patch's side.
    side: usize,
    /// Which of its pixels, and how many samples they have so far, as a level.
    pixels: Vec<(u16, u8)>,
    samples: usize,
}

impl Listed {
    fn new(patch: (usize, usize), place: Area, side: usize, pixels: Vec<(u16, u8)>) -> Listed {
        let samples = pixels.iter().map(|&(_, level)| next_samples(level).len()).sum();
        Listed { patch, place, side, pixels, samples }
    }

    /// Where a pixel of it lies in the picture.
    fn place_of(&self, pixel: u16) -> (usize, usize) {
        let pixel = usize::from(pixel);
        (self.place.x.start + pixel % self.side, self.place.y.start + pixel / self.side)
    }
}

impl Tracing<'_> {
    fn width(&self) -> usize {
        self.params.width as usize
    }

    /// Counts the time of what the host does.
    fn on_host<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let done = work(self);
        self.decide_s += start.elapsed().as_secs_f64();
        done
    }

    /// Takes the first sample of every pixel of an area, without lists. Returns how many that are.
    fn trace_area(&mut self, area: &Area) -> Result<u64> {
        let rows = (PART_PIXELS / area.x.len()).max(1).next_multiple_of(TILE_SIDE as usize);
        for top in area.y.clone().step_by(rows) {
            let part = Area { x: area.x.clone(), y: top..area.y.end.min(top + rows) };
            let (columns, rows) = part.size();
            let params = self.params.of_part((part.x.start as u32, part.y.start as u32), (columns as u32, rows as u32));
            let traced = self.tracer.render(&params, &self.sequence[..1], &|_| ())?;
            self.on_host(|this| {
                let width = this.width();
                this.result.add(&traced);
                let film = &mut this.result.film.pixels[part.y.start * width..part.y.end * width];
                film.par_chunks_mut(width).zip(traced.film.pixels.par_chunks(columns)).for_each(|(film, traced)| {
                    film[part.x.clone()].copy_from_slice(traced);
                });
                this.add_work(
                    traced.work.as_deref(),
                    part.y.clone().flat_map(|y| part.x.clone().map(move |x| ((x, y), 1))),
                );
            });
        }
        Ok((area.x.len() * area.y.len()) as u64)
    }

    /// Traces new samples in lists that are short enough, and hands each part with its radiances to `take`.
    fn trace(&mut self, all: &[Listed], mut take: impl FnMut(&mut Self, &[Listed], &[[f32; 3]])) -> Result<()> {
        let mut rest = all;
        while !rest.is_empty() {
            let mut samples = 0;
            let end = rest.iter().position(|listed| {
                let is_full = samples > 0 && samples + listed.samples > self.list_rays;
                samples += if is_full { 0 } else { listed.samples };
                is_full
            });
            let (now, later) = rest.split_at(end.unwrap_or(rest.len()));
            let positions = self.on_host(|this| this.positions(now, samples));
            let mut traced = self.tracer.render(&self.params.of_list(samples as u32), &positions, &|_| ())?;
            drop(positions);
            let radiances = std::mem::take(&mut traced.film.pixels);
            self.on_host(|this| {
                this.result.add(&traced);
                let samples = |listed: &Listed| {
                    let samples = |&(pixel, level): &(u16, u8)| (listed.place_of(pixel), next_samples(level).len());
                    listed.pixels.iter().map(samples).collect::<Vec<_>>()
                };
                this.add_work(traced.work.as_deref(), now.iter().flat_map(samples));
                take(this, now, &radiances);
            });
            rest = later;
        }
        Ok(())
    }

    /// Where the new samples of some patches lie in the picture.
    fn positions(&self, listed: &[Listed], samples: usize) -> Vec<CameraSample> {
        let mut positions: Vec<CameraSample> = bytemuck::zeroed_vec(samples);
        let sequence = &self.sequence;
        by_patch(listed, &mut positions).into_par_iter().for_each(|(listed, positions)| {
            let mut positions = positions.iter_mut();
            for &(pixel, level) in &listed.pixels {
                let (x, y) = listed.place_of(pixel);
                let (x, y) = (x as f32, y as f32);
                for (sample, to) in sequence[next_samples(level)].iter().zip(positions.by_ref()) {
                    *to = CameraSample { x: x + sample.x, y: y + sample.y, ..*sample };
                }
            }
        });
        positions
    }

    /// Adds what was counted of samples to what was of their pixels: places in the picture, and how many samples each
    /// has.
    fn add_work(&mut self, work: Option<&[PixelWork]>, pixels: impl Iterator<Item = ((usize, usize), usize)>) {
        let Some(work) = work else { return };
        let (width, count) = (self.width(), self.result.film.pixels.len());
        let all = self.result.work.get_or_insert_with(|| vec![PixelWork::default(); count]);
        let mut work = work.iter();
        for ((x, y), samples) in pixels {
            work.by_ref().take(samples).for_each(|one| all[y * width + x].add(one));
        }
    }
}

/// Each patch of a list with its part of what there is for each sample.
fn by_patch<'a, T>(listed: &'a [Listed], samples: &'a mut [T]) -> Vec<(&'a Listed, &'a mut [T])> {
    let mut rest = samples;
    let of_patch = |listed: &'a Listed| {
        let (now, later) = std::mem::take(&mut rest).split_at_mut(listed.samples);
        rest = later;
        (listed, now)
    };
    listed.iter().map(of_patch).collect()
}

/// A list in groups of patches that have something in common, each with its radiances.
fn by_groups<'a, T: PartialEq>(
    listed: &'a [Listed],
    radiances: &'a [[f32; 3]],
    common: impl Fn(&Listed) -> T + 'a,
) -> impl Iterator<Item = (&'a [Listed], &'a [[f32; 3]])> {
    let mut rest = radiances;
    listed.chunk_by(move |a, b| common(a) == common(b)).map(move |group| {
        let (now, later) = rest.split_at(group.iter().map(|listed| listed.samples).sum());
        rest = later;
        (group, now)
    })
}

/// A block of an area.
struct Block {
    /// Where its patches lie in the picture.
    places: Vec<Area>,
    /// What is known of them.
    patches: Vec<Option<Patch>>,
}

/// The pixels of an area on their way.
struct AreaPixels<'a, 't> {
    tracing: &'a mut Tracing<'t>,
    place: Area,
    /// Pixels of a patch's side.
    side: usize,
    lattice: Lattice,
    blocks: Vec<Block>,
    promises: Vec<Promises>,
}

impl<'a, 't> AreaPixels<'a, 't> {
    fn new(tracing: &'a mut Tracing<'t>, blocks: &Blocks, place: Area, step: usize) -> Self {
        let of_block = |patches: Vec<usize>| {
            let places = patches.into_iter().map(|number| place.patch(number, blocks.patch_side)).collect();
            Block { places, patches: Vec::new() }
        };
        AreaPixels {
            tracing,
            side: blocks.patch_side,
            lattice: Lattice { step, cells: Vec::new(), columns: (place.x.len() - 1) / step + 1 },
            blocks: blocks.patches_of(&place).into_iter().map(of_block).collect(),
            promises: vec![Promises::default(); blocks.per_area],
            place,
        }
    }

    /// Takes the first samples of the points of the lattice. Returns how many that are.
    fn trace_lattice(&mut self) -> Result<u64> {
        let AreaPixels { tracing, place, side, lattice, .. } = self;
        let listed = tracing.on_host(|_| pixels_of_lattice(place, *side, lattice));
        tracing.trace(&listed, |tracing, listed, radiances| {
            let width = tracing.width();
            take_firsts(&mut tracing.result.film.pixels, width, listed, radiances);
        })?;
        Ok(listed.iter().map(|listed| listed.samples as u64).sum())
    }

    /// Keeps how the pixels of the area were sampled.
    fn note_sampling(&self, sampling: &mut Sampling) {
        let AreaPixels { tracing, place, lattice, blocks, .. } = self;
        let patches = blocks.iter().flat_map(|block| block.places.iter().zip(&block.patches));
        for (at, patch) in patches {
            for (y, x) in at.y.clone().flat_map(|y| at.x.clone().map(move |x| (y, x))) {
                // Of a patch of one colour nothing is known but its first samples.
                let first = || lattice.has((x - place.x.start, y - place.y.start), place.size());
                let in_patch = (x - at.x.start, y - at.y.start);
                let (level, squared) = patch.as_ref().map_or_else(|| (first().into(), 0.0), |p| p.sampled(in_patch));
                let pixel = y * tracing.width() + x;
                sampling.samples[pixel] = LEVEL_SAMPLES[usize::from(level)];
                sampling.errors[pixel] = squared.sqrt();
            }
        }
    }

    /// The picture has what became of the area.
    fn finish(self) {
        let AreaPixels { tracing, place, side, blocks, .. } = self;
        tracing.on_host(|tracing| {
            let width = tracing.width();
            let (columns, rows) = place.patches(side);
            let mut patches: Vec<Vec<(usize, Patch)>> = (0..rows).map(|_| Vec::with_capacity(columns)).collect();
            for block in blocks {
                for (at, patch) in block.places.into_iter().zip(block.patches) {
                    let row = &mut patches[(at.y.start - place.y.start) / side];
                    row.extend(patch.map(|patch| (at.x.start, patch)));
                }
            }
            let film = &mut tracing.result.film.pixels[place.y.start * width..place.y.end * width];
            film.par_chunks_mut(side * width).zip(patches).for_each(|(film, patches)| {
                patches.into_iter().for_each(|(column, patch)| patch.write(film, width, column));
            });
        });
    }
}

impl Pixels for AreaPixels<'_, '_> {
    fn begin(&mut self) -> Result<u64> {
        let traced = match self.lattice.step {
            1 => self.tracing.trace_area(&self.place)?,
            _ => self.trace_lattice()?,
        };
        let AreaPixels { tracing, place, side, lattice, blocks, .. } = self;
        tracing.on_host(|tracing| {
            let width = tracing.width();
            let film = &mut tracing.result.film.pixels;
            if lattice.step > 1 {
                lattice.cells = interpolate(film, width, place, lattice);
            }
            blocks.par_iter_mut().for_each(|block| {
                let patch = |at: &Area| Patch::new(film, width, place, at, *side, lattice);
                block.patches = block.places.iter().map(patch).collect();
            });
        });
        Ok(traced)
    }

    fn raise(&mut self, choices: &[Choice]) -> Result<()> {
        let AreaPixels { tracing, side, lattice, blocks, .. } = self;
        let listed: Vec<Vec<Listed>> = tracing.on_host(|_| {
            let chosen = blocks.par_iter().zip(choices).enumerate().map(|(number, (block, choice))| {
                let of_patch = |(slot, patch): (usize, &Option<Patch>)| {
                    let pixels = patch.as_ref()?.chosen(*choice);
                    (!pixels.is_empty()).then(|| Listed::new((number, slot), block.places[slot].clone(), *side, pixels))
                };
                block.patches.iter().enumerate().filter_map(of_patch).collect()
            });
            chosen.collect()
        });
        let listed: Vec<Listed> = listed.into_iter().flatten().collect();
        let is_interpolated = lattice.step > 1;
        tracing.trace(&listed, |tracing, listed, radiances| {
            let (film, width) = (&tracing.result.film.pixels[..], tracing.width());
            let mut groups: Vec<_> = blocks.iter_mut().map(|block| (block, None)).collect();
            for group in by_groups(listed, radiances, |listed| listed.patch.0) {
                groups[group.0[0].patch.0].1 = Some(group);
            }
            groups.into_par_iter().for_each(|(block, group)| {
                let Some((listed, radiances)) = group else { return };
                for (listed, radiances) in by_groups(listed, radiances, |listed| listed.patch.1) {
                    if let Some(patch) = &mut block.patches[listed[0].patch.1] {
                        take_samples(patch, &listed[0], radiances, is_interpolated, (film, width));
                    }
                }
            });
        })
    }

    fn update(&mut self) -> Result<&[Promises]> {
        let AreaPixels { tracing, lattice, blocks, promises, .. } = self;
        tracing.on_host(|_| {
            blocks.par_iter_mut().zip(promises.par_iter_mut()).for_each(|(block, promises)| {
                block.patches.iter_mut().flatten().for_each(|patch| patch.update(lattice, promises));
            });
        });
        Ok(promises)
    }
}

/// The first samples of an area, patch by patch.
fn pixels_of_lattice(area: &Area, side: usize, lattice: &Lattice) -> Vec<Listed> {
    let (columns, rows) = area.patches(side);
    let of_patch = |number| {
        let place = area.patch(number, side);
        let (left, top) = (place.x.start - area.x.start, place.y.start - area.y.start);
        let is_on = |pixel: &usize| lattice.has((left + pixel % side, top + pixel / side), area.size());
        let pixels = by_tiles(place.size(), side).filter(is_on).map(|pixel| (pixel as u16, 0)).collect();
        Listed::new((0, number), place, side, pixels)
    };
    (0..columns * rows).into_par_iter().map(of_patch).collect()
}

/// Puts the first samples of listed pixels into the picture; the list goes through rows of patches.
fn take_firsts(film: &mut [[f32; 3]], width: usize, listed: &[Listed], radiances: &[[f32; 3]]) {
    let mut rows = Vec::new();
    let (mut rest, mut first_row) = (film, 0);
    for (listed, radiances) in by_groups(listed, radiances, |listed| listed.place.y.start) {
        let y = listed[0].place.y.clone();
        let (_, below) = rest.split_at_mut((y.start - first_row) * width);
        let (film, later) = below.split_at_mut(y.len() * width);
        rows.push((listed, radiances, film));
        (rest, first_row) = (later, y.end);
    }
    rows.into_par_iter().for_each(|(listed, radiances, film)| {
        let mut radiances = radiances.iter();
        for listed in listed {
            for (&(pixel, _), radiance) in listed.pixels.iter().zip(radiances.by_ref()) {
                let (x, y) = listed.place_of(pixel);
                film[(y - listed.place.y.start) * width + x] = *radiance;
            }
        }
    });
}

/// Takes note of what was traced: the new samples of pixels of a patch. `film`: that of the first samples, and its
/// width.
fn take_samples(
    patch: &mut Patch,
    listed: &Listed,
    mut radiances: &[[f32; 3]],
    is_interpolated: bool,
    (film, width): (&[[f32; 3]], usize),
) {
    let mut changes = Vec::new();
    for &(pixel, level) in &listed.pixels {
        let (now, later) = radiances.split_at(next_samples(level).len());
        radiances = later;
        let pixel = usize::from(pixel);
        let sum = &mut patch.sums(film, width, &listed.place)[pixel];
        let raised = raise_pixel(if level > 0 { *sum } else { [0.0; 3] }, now);
        *sum = raised.sum;
        let change = patch.raise(pixel, raised.shown, raised.variance);
        changes.extend(change.filter(|_| is_interpolated).map(|change| (pixel, change)));
    }
    patch.tell_neighbours(&changes);
}

/// Gives the pixels of an area between the points of the lattice what lies between these. Returns what that misses: the
/// squared errors in the lattice's cells.
fn interpolate(film: &mut [[f32; 3]], picture_width: usize, place: &Area, lattice: &Lattice) -> Vec<f32> {
    let (step, columns) = (lattice.step, lattice.columns);
    let (width, height) = place.size();
    let point = |cell: usize, end: usize| (cell * step).min(end - 1);
    let rows = (height - 1) / step + 1;
    // A copy of the points of the lattice, so that rows can be written by different threads.
    let points: Vec<[f32; 3]> = (0..=rows)
        .flat_map(|row| (0..=columns).map(move |column| (column, row)))
        .map(|(column, row)| {
            film[(place.y.start + point(row, height)) * picture_width + place.x.start + point(column, width)]
        })
        .collect();
    let film_rows = film[place.y.start * picture_width..place.y.end * picture_width].par_chunks_mut(picture_width);
    film_rows.enumerate().for_each(|(y, row)| {
        let across_y = part_of(y, y / step * step, point(y / step + 1, height));
        for (x, pixel) in row[place.x.clone()].iter_mut().enumerate() {
            if lattice.has((x, y), (width, height)) {
                continue;
            }
            let cell = x / step;
            let at = y / step * (columns + 1) + cell;
            let [a, b, c, d] = [at, at + 1, at + columns + 1, at + columns + 2].map(|i| points[i]);
            let across_x = part_of(x, cell * step, point(cell + 1, width));
            *pixel = std::array::from_fn(|i| {
                let upper = (b[i] - a[i]).mul_add(across_x, a[i]);
                let lower = (d[i] - c[i]).mul_add(across_x, c[i]);
                (lower - upper).mul_add(across_y, upper)
            });
        }
    });
    let shown: Vec<_> = points.into_par_iter().map(display_steps).collect();
    errors_of_cells(&shown, columns, rows)
}

/// The squared errors of the interpolation in the cells of a lattice, of whose points `shown` has the values.
fn errors_of_cells(shown: &[[f32; 3]], columns: usize, rows: usize) -> Vec<f32> {
    let at = |column: isize, row: isize| -> Option<[f32; 3]> {
        let (column, row) = (usize::try_from(column).ok()?, usize::try_from(row).ok()?);
        (column <= columns && row <= rows).then(|| shown[row * (columns + 1) + column])
    };
    let bend = |column: isize, row: isize, dx: isize, dy: isize| -> f32 {
        let ends = at(column - dx, row - dy).zip(at(column + dx, row + dy));
        let (Some((a, c)), Some(b)) = (ends, at(column, row)) else { return 0.0 };
        squared(std::array::from_fn(|i| a[i] - 2.0 * b[i] + c[i]))
    };
    let error = |cell: usize| {
        let (column, row) = ((cell % columns) as isize, (cell / columns) as isize);
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let bends = corners.map(|(x, y)| bend(column + x, row + y, 1, 0).max(bend(column + x, row + y, 0, 1)));
        LATTICE_ERROR * bends.into_iter().fold(0.0, f32::max)
    };
    (0..rows * columns).into_par_iter().map(error).collect()
}

/// How far `i` is from `low` to `high`.
fn part_of(i: usize, low: usize, high: usize) -> f32 {
    if high > low { (i - low) as f32 / (high - low) as f32 } else { 0.0 }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::shared::Light;
    use crate::tracer::{AllHits, AllHitsJob, Candidates, CandidatesJob, TraceJob, TraceResult};

    /// Shows rings around a point instead of a scene: thin far from it, wide near it, on a ground without any.
    struct Rings {
        options: TraceOptions,
    }

    impl Rings {
        fn radiance(at: CameraSample) -> [f32; 3] {
            let (x, y) = (at.x - 100.0, at.y - 40.0);
            let distance = x * x + y * y;
            let is_light = distance < 40_000.0 && (distance / 2_000.0).fract() < 0.5;
            [if is_light { 0.9 } else { 0.1 }, 0.3, if at.x < 300.5 { 0.2 } else { 0.25 }]
        }
    }

    impl Backend for Rings {
        fn device_name(&self) -> &str {
            "rings"
        }

        fn options(&self) -> &TraceOptions {
            &self.options
        }

        fn set_lights(&mut self, _: &[Light]) -> Result<()> {
            unreachable!("nobody asks for it")
        }

        fn trace(&mut self, _: &TraceJob, _: Progress) -> Result<TraceResult> {
            unreachable!("nobody asks for it")
        }

        fn trace_all(&mut self, _: &AllHitsJob, _: Progress) -> Result<AllHits> {
            unreachable!("nobody asks for it")
        }

        fn find_candidates(&mut self, _: &CandidatesJob, _: Progress) -> Result<Candidates> {
            unreachable!("nobody asks for it")
        }

        fn render(&mut self, params: &RenderParams, samples: &[CameraSample], _: Progress) -> Result<RenderResult> {
            let (width, height) = params.film_size();
            let (left, top) = (params.first_pixel & 0xffff, params.first_pixel >> 16);
            let in_part = |i: u32| {
                let (x, y) = ((left + i % width) as f32, (top + i / width) as f32);
                CameraSample { x: x + samples[0].x, y: y + samples[0].y, ..samples[0] }
            };
            let pixels = match params.ray_count {
                0 => (0..width * height).map(|i| Rings::radiance(in_part(i))).collect(),
                _ => samples.iter().map(|&at| Rings::radiance(at)).collect(),
            };
            Ok(RenderResult::of_film(Film { width, height, pixels }))
        }
    }

    fn params((width, height): (u32, u32)) -> RenderParams {
        RenderParams { width, height, ..RenderParams::default() }
    }

    fn render_rings(size: (u32, u32), adaptive: Adaptive) -> RenderResult {
        let mut rings = Rings { options: TraceOptions::DEFAULT };
        render(&mut rings, &params(size), adaptive, &|_| ()).unwrap()
    }

    #[test]
    fn how_pixels_were_sampled_adds_up_to_what_is_told_of_the_picture() {
        for (size, error, lattice) in [((70, 45), 1.0, 1), ((300, 140), 3.0, 4)] {
            let adaptive = Adaptive { error, lattice, list_rays: 1 << 12 };
            let mut rings = Rings { options: TraceOptions::DEFAULT };
            let noted = render_noting(&mut rings, &params(size), adaptive, true, &|_| ()).unwrap();
            assert!(noted.film == render_rings(size, adaptive).film, "{size:?}");
            let (sampling, stats) = (noted.sampling.unwrap(), noted.adaptive.unwrap());
            for (samples, count) in LEVEL_SAMPLES.into_iter().zip(stats.pixels) {
                let found = sampling.samples.iter().filter(|&&found| found == samples).count() as u64;
                assert_eq!(found, count, "{size:?}, {samples} samples");
            }
            let squares: f64 = sampling.errors.iter().map(|&error| f64::from(error).powi(2)).sum();
            let error = (squares / sampling.errors.len() as f64).sqrt();
            assert!((error / f64::from(stats.estimated_error) - 1.0).abs() < 1e-3, "{error} {stats:?}");
        }
    }

    #[test]
    fn a_block_becomes_what_it_is_whatever_becomes_of_the_others() {
        for ((width, height), error, lattice, per_area) in
            [((700, 560), 1.0, 1, 3), ((700, 560), 4.0, 1, 3), ((1200, 900), 2.0, 2, 2)]
        {
            let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
            let whole = render_rings((width, height), adaptive).film.pixels;
            let size = (width as usize, height as usize);
            let blocks = Blocks::new(size, adaptive.step());
            assert_eq!((blocks.areas(), blocks.per_area), (1, per_area));
            let mut refined = 0;
            for block in 0..blocks.per_area {
                let mut rings = Rings { options: TraceOptions::DEFAULT };
                let film = Film { width, height, pixels: vec![[0.0; 3]; size.0 * size.1] };
                let mut tracing = Tracing {
                    tracer: &mut rings,
                    params: params((width, height)),
                    sequence: sample_sequence(),
                    list_rays: adaptive.list_rays,
                    result: RenderResult::of_film(film),
                    decide_s: 0.0,
                };
                let area = blocks.area(0);
                let mut pixels = AreaPixels::new(&mut tracing, &blocks, area.clone(), adaptive.step());
                // No samples are taken of the others but their first ones.
                let target = (super::super::AIM * f64::from(error)).powi(2) * blocks.pixels()[block] as f64;
                pixels.begin().unwrap();
                for round in 1.. {
                    let promises = &pixels.update().unwrap()[block];
                    if promises.excess(target) <= 0.0 {
                        break;
                    }
                    let mut choices = vec![Choice::NONE; blocks.per_area];
                    choices[block] = promises.choose(target, round);
                    pixels.raise(&choices).unwrap();
                    refined += 1;
                }
                pixels.finish();
                let film = &tracing.result.film.pixels;
                for patch in &blocks.patches_of(&area)[block] {
                    let place = area.patch(*patch, blocks.patch_side);
                    for y in place.y {
                        let row = y * size.0 + place.x.start..y * size.0 + place.x.end;
                        assert_eq!(film[row.clone()], whole[row], "block {block}, error {error}, row {y}");
                    }
                }
            }
            assert!(refined >= blocks.per_area, "every block had something to do");
        }
    }

    #[test]
    fn lists_of_any_length_and_parts_of_several_areas_make_the_same_picture() {
        for (size, error) in [((3100, 90), 1.0), ((90, 3100), 4.0)] {
            let adaptive = Adaptive::of_error(error);
            let whole = render_rings(size, adaptive);
            let short = render_rings(size, Adaptive { list_rays: 100, ..adaptive });
            assert_eq!(whole.film.pixels, short.film.pixels);
            let [a, b] = [&whole, &short].map(|picture| picture.adaptive.unwrap());
            assert_eq!((a.pixels, a.rounds, a.estimated_error), (b.pixels, b.rounds, b.estimated_error));
            assert!(a.pixels[2] > 0 && a.estimated_error <= error, "{a:?}");
            assert_eq!(a.pixels.iter().sum::<u64>(), u64::from(size.0) * u64::from(size.1));
        }
    }

    /// Against all samples of every pixel.
    #[test]
    fn the_error_that_was_asked_for_is_kept() {
        let size = (700, 560);
        let sequence = sample_sequence();
        let truth = |pixel: usize| {
            let (x, y) = ((pixel % 700) as f32, (pixel / 700) as f32);
            let samples = sequence.iter().map(|s| Rings::radiance(CameraSample { x: x + s.x, y: y + s.y, ..*s }));
            let sum = samples.fold([0.0; 3], plus);
            display_steps(mean_of(sum, sequence.len()))
        };
        for error in [0.5, 1.0, 2.0] {
            let film = render_rings(size, Adaptive::of_error(error)).film.pixels;
            let squares = film.par_iter().enumerate().map(|(pixel, &shown)| {
                let (shown, truth) = (display_steps(shown), truth(pixel));
                f64::from(squared(std::array::from_fn(|c| shown[c] - truth[c])))
            });
            let made = (squares.sum::<f64>() / film.len() as f64).sqrt();
            assert!(made < 1.05 * f64::from(error) && made > 0.3 * f64::from(error), "{made} for {error}");
        }
    }
}
