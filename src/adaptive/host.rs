//! Pictures of bounded error whose pixels the host keeps, one area after the other.

use super::patch::{FirstSamples, LATTICE_ERROR, Lattice, Patch, by_tiles, next_samples};
use super::promises::{Choice, Promises};
use super::shown::{display_steps, mean_of, squared, variance_of_mean};
use super::{Done, Pixels, refine, sample_sequence};
use crate::blocks::{Area, Blocks};
use crate::budget::{DecidedBy, Need, try_zeros};
use crate::error::Result;
use crate::io::film::{FilmPlace, FilmWindow};
use crate::parallel;
use crate::shared::{CameraSample, RenderParams, TILE_SIDE};
use crate::tracer::{Adaptive, Backend, Finished, LEVEL_SAMPLES, Progress, Refined, RenderResult, Sampling, Spent};
use crate::work::PixelWork;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Room for how so many pixels were sampled.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory) when the system has no memory for that.
pub fn room_for_sampling(pixels: usize) -> Result<Sampling> {
    let what = format!("how {pixels} pixels were sampled");
    let bytes = 2 * (size_of::<f32>() * pixels) as u64;
    let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "lower `size`" };
    let samples = try_zeros(pixels).ok_or_else(|| need.refused())?;
    Ok(Sampling { samples, errors: try_zeros(pixels).ok_or_else(|| need.refused())? })
}

/// About so many first samples are taken at a time: their film is there twice, on a device and fetched.
pub const PART_PIXELS: usize = 1 << 20;

/// What traces the samples of areas, and what became of them.
pub struct Tracing<'a> {
    tracer: &'a mut dyn Backend,
    params: RenderParams,
    adaptive: Adaptive,
    blocks: &'a Blocks,
    sequence: Vec<CameraSample>,
    /// Its film, of the picture or of an area, has the first samples of an area, and what lies between them, until its
    /// blocks are finished. Where there is room for it, it is told how each pixel was sampled.
    pub result: RenderResult,
    /// Where the film's first pixel lies in the picture.
    origin: (usize, usize),
    decide_s: f64,
    /// What was told of so far.
    told: Spent,
    progress: Shown<'a>,
}

/// The progress of an area, which launches tell again, so that whoever wants to stop gets a word in.
#[derive(Clone)]
struct Shown<'a> {
    progress: Progress<'a>,
    /// The bits of the part that is done.
    done: Arc<AtomicU64>,
}

impl Shown<'_> {
    fn set(&self, done: f64) {
        self.done.store(done.to_bits(), Relaxed);
        self.again();
    }

    fn again(&self) {
        (self.progress)(f64::from_bits(self.done.load(Relaxed)));
    }
}

impl<'a> Tracing<'a> {
    /// Of a picture's areas, on the film of `result`, whose first pixel is `origin` of the picture.
    pub fn new(
        tracer: &'a mut dyn Backend,
        params: &RenderParams,
        adaptive: Adaptive,
        blocks: &'a Blocks,
        (result, origin): (RenderResult, (usize, usize)),
        progress: Progress<'a>,
    ) -> Tracing<'a> {
        Tracing {
            tracer,
            params: *params,
            adaptive,
            blocks,
            sequence: sample_sequence(),
            told: Spent::of(&result, 0.0),
            result,
            origin,
            decide_s: 0.0,
            progress: Shown { progress, done: Arc::default() },
        }
    }

    /// Renders blocks of an area, in ascending order, onto the film. `done` is told of those that are finished.
    ///
    /// # Errors
    /// As [`Backend::render`], and those of `done`.
    pub fn render_area(&mut self, wanted: &[usize], done: Done) -> Result<()> {
        self.render_in_groups(wanted, groups_of, done)
    }

    /// As [`Tracing::render_area`], in as many groups of blocks as `groups_of` says of their number and of the time of
    /// their first samples.
    fn render_in_groups(
        &mut self,
        wanted: &[usize],
        groups_of: impl FnOnce(usize, Duration) -> usize,
        done: Done,
    ) -> Result<()> {
        let adaptive = self.adaptive;
        let start = Instant::now();
        let mut area = AreaPixels::new(self, wanted);
        area.begin()?;
        let groups = groups_of(wanted.len(), start.elapsed());
        if groups > 1 {
            area.keep_patches();
        }
        for group in 0..groups {
            let range = group * wanted.len() / groups..(group + 1) * wanted.len() / groups;
            let pixels: Vec<u64> = area.blocks[range.clone()].iter().map(Block::pixels).collect();
            let promises = vec![Promises::default(); pixels.len()];
            let shown = area.tracing.progress.clone();
            let progress = |part: f64| shown.set((group as f64 + part) / groups as f64);
            let mut pixels_of_group = Group { area: &mut area, range: range.clone(), promises };
            let refined = refine(&mut pixels_of_group, &pixels, adaptive, &progress)?;
            area.note_sampling(range.clone());
            area.finish(range.clone());
            area.tracing.tell(&wanted[range], refined, done)?;
        }
        Ok(())
    }

    /// Tells that blocks are finished, and what they took since this was called before.
    fn tell(&mut self, blocks: &[usize], refined: Refined, done: Done) -> Result<()> {
        let all = Spent::of(&self.result, self.decide_s);
        let spent = Spent { refined, ..all.since(&self.told) };
        self.told = all;
        let film = FilmWindow { film: &self.result.film, place: self.origin };
        done(&Finished { blocks, film, spent })
    }
}

/// So long takes what is lost of an area at the most, about, when the program is stopped.
const GROUP_TIME: Duration = Duration::from_secs(2);
/// A picture takes about so many times as long as its first samples: a pixel has about three rays, and what is traced
/// in lists takes longer.
const FIRST_SAMPLES_PART: u32 = 4;

/// Into how many groups so many blocks are divided, which are refined one after the other, if their first samples took
/// so long: lists of all of them keep a device busy, small groups are sooner finished.
fn groups_of(blocks: usize, first_samples: Duration) -> usize {
    let estimated = first_samples * FIRST_SAMPLES_PART;
    (estimated.as_secs_f64() / GROUP_TIME.as_secs_f64()).ceil().clamp(1.0, blocks as f64) as usize
}

/// New samples of pixels of a patch.
struct Listed {
    /// The block, and the patch's number in it; of first samples 0, and its number in the area.
    patch: (usize, usize),
    /// Where it lies on the film.
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

    /// Where a pixel of it lies on the film.
    fn place_of(&self, pixel: u16) -> (usize, usize) {
        let pixel = usize::from(pixel);
        (self.place.x.start + pixel % self.side, self.place.y.start + pixel / self.side)
    }
}

impl Tracing<'_> {
    /// Pixels of a row of the film.
    fn width(&self) -> usize {
        self.result.film.width as usize
    }

    /// What an area's film has until it has what became of its blocks.
    fn first_samples<'s>(&'s self, area: &'s Area, lattice: &'s Lattice, side: usize) -> FirstSamples<'s> {
        FirstSamples { film: &self.result.film.pixels, width: self.width(), area, lattice, side }
    }

    /// Counts the time of what the host does.
    fn on_host<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let done = work(self);
        self.decide_s += start.elapsed().as_secs_f64();
        done
    }

    /// Takes the first sample of every pixel of an area, without lists.
    fn trace_area(&mut self, area: &Area) -> Result<()> {
        let rows = (PART_PIXELS / area.x.len()).max(1).next_multiple_of(TILE_SIDE as usize);
        for top in area.y.clone().step_by(rows) {
            let part = Area { x: area.x.clone(), y: top..area.y.end.min(top + rows) };
            let (columns, rows) = part.size();
            let first = (self.origin.0 + part.x.start, self.origin.1 + part.y.start);
            let params = self.params.of_part((first.0 as u32, first.1 as u32), (columns as u32, rows as u32));
            let width = self.width();
            let film = &mut self.result.film.pixels[part.y.start * width..part.y.end * width];
            let place = FilmPlace { rows: film, width, column: part.x.start, columns };
            let traced = self.tracer.render_into(&params, &self.sequence[..1], place, &|_| self.progress.again())?;
            self.on_host(|this| {
                this.result.add(&traced);
                this.add_work(
                    traced.work.as_deref(),
                    part.y.clone().flat_map(|y| part.x.clone().map(move |x| ((x, y), 1))),
                );
            });
        }
        Ok(())
    }

    /// Traces new samples in lists that are short enough, and hands each part with its radiances to `take`.
    fn trace(&mut self, all: &[Listed], mut take: impl FnMut(&mut Self, &[Listed], &[[f32; 3]])) -> Result<()> {
        let mut rest = all;
        while !rest.is_empty() {
            let mut samples = 0;
            let end = rest.iter().position(|listed| {
                let is_full = samples > 0 && samples + listed.samples > self.adaptive.list_rays;
                samples += if is_full { 0 } else { listed.samples };
                is_full
            });
            let (now, later) = rest.split_at(end.unwrap_or(rest.len()));
            let positions = self.on_host(|this| this.positions(now, samples));
            let mut traced =
                self.tracer.render(&self.params.of_list(samples as u32), &positions, &|_| self.progress.again())?;
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
        let (sequence, origin) = (&self.sequence, self.origin);
        parallel::each(by_patch(listed, &mut positions).into_iter(), |(listed, positions)| {
            let mut positions = positions.iter_mut();
            for &(pixel, level) in &listed.pixels {
                let (x, y) = listed.place_of(pixel);
                let (x, y) = ((origin.0 + x) as f32, (origin.1 + y) as f32);
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
    /// Where its patches lie on the film.
    places: Vec<Area>,
    /// What is known of them.
    patches: Vec<Known>,
}

/// What is known of a patch. In most no pixel is ever chosen: the few that are looked at again are sooner made anew of
/// the film than all are kept, which took as long as everything else that is decided.
enum Known {
    /// Nothing yet.
    Nothing,
    /// That nothing is ever to be done.
    IsDone,
    /// The highest class of its pixels, which have their first samples and no others.
    Highest(usize),
    /// Everything.
    All(Box<Patch>),
}

impl Known {
    /// Of a patch, unless nothing is ever to be done there.
    fn all(patch: Option<Patch>) -> Known {
        patch.map_or(Known::IsDone, |patch| Known::All(Box::new(patch)))
    }

    /// Everything, where that is kept.
    fn patch(&mut self) -> Option<&mut Patch> {
        match self {
            Known::All(patch) => Some(patch),
            _ => None,
        }
    }
}

impl Block {
    fn pixels(&self) -> u64 {
        self.places.iter().map(|place| (place.x.len() * place.y.len()) as u64).sum()
    }
}

/// The pixels of blocks of an area on their way.
struct AreaPixels<'a, 't> {
    tracing: &'a mut Tracing<'t>,
    /// Where the area lies on the film.
    place: Area,
    /// Pixels of a patch's side.
    side: usize,
    lattice: Lattice,
    /// Those that are wanted.
    blocks: Vec<Block>,
    /// Whether each patch of the area is in one of them.
    is_wanted: Vec<bool>,
}

impl<'a, 't> AreaPixels<'a, 't> {
    /// Of blocks of one area.
    fn new(tracing: &'a mut Tracing<'t>, wanted: &[usize]) -> Self {
        let (blocks, step) = (tracing.blocks, tracing.adaptive.step());
        let of_area = |block: &usize| block % blocks.per_area;
        let number = wanted.first().map_or(0, |block| block / blocks.per_area);
        let place = blocks.area(number).seen_from(tracing.origin);
        let patches = blocks.patches_of(&place);
        let mut is_wanted = vec![false; patches.iter().map(Vec::len).sum()];
        wanted.iter().flat_map(|block| &patches[of_area(block)]).for_each(|&patch| is_wanted[patch] = true);
        let of_block = |block: &usize| {
            let places = patches[of_area(block)].iter().map(|&number| place.patch(number, blocks.patch_side)).collect();
            Block { patches: patches[of_area(block)].iter().map(|_| Known::Nothing).collect(), places }
        };
        AreaPixels {
            side: blocks.patch_side,
            lattice: Lattice { step, cells: Vec::new(), columns: (place.x.len() - 1) / step + 1 },
            blocks: wanted.iter().map(of_block).collect(),
            is_wanted,
            tracing,
            place,
        }
    }

    /// Takes the first samples of all blocks, and gives other pixels what lies between them.
    fn begin(&mut self) -> Result<()> {
        match self.lattice.step == 1 && self.is_wanted.iter().all(|is| *is) {
            true => self.tracing.trace_area(&self.place)?,
            false => self.trace_lattice()?,
        }
        let AreaPixels { tracing, place, lattice, .. } = self;
        if lattice.step > 1 {
            tracing.on_host(|tracing| {
                let width = tracing.width();
                lattice.cells = interpolate(&mut tracing.result.film.pixels, width, place, lattice);
            });
        }
        Ok(())
    }

    /// Keeps what the first samples say of all blocks, before the film has what becomes of some.
    fn keep_patches(&mut self) {
        let AreaPixels { tracing, place, side, lattice, blocks, .. } = self;
        tracing.on_host(|tracing| {
            let samples = tracing.first_samples(place, lattice, *side);
            parallel::each(blocks.iter_mut(), |block| {
                for (known, at) in block.patches.iter_mut().zip(&block.places) {
                    let mut patch = Patch::room(*side);
                    *known = Known::all(patch.fill(samples, at).then_some(patch));
                }
            });
        });
    }

    /// Takes the first samples of the points of the lattice that the blocks need.
    fn trace_lattice(&mut self) -> Result<()> {
        let AreaPixels { tracing, place, side, lattice, is_wanted, .. } = self;
        let listed = tracing.on_host(|_| pixels_of_lattice(place, *side, lattice, is_wanted));
        tracing.trace(&listed, |tracing, listed, radiances| {
            let width = tracing.width();
            take_firsts(&mut tracing.result.film.pixels, width, listed, radiances);
        })
    }

    /// Keeps how the pixels of some blocks were sampled, where that is asked for.
    fn note_sampling(&mut self, range: Range<usize>) {
        let AreaPixels { tracing, place, side, lattice, blocks, .. } = self;
        let Some(mut sampling) = tracing.result.sampling.take() else { return };
        let (width, samples) = (tracing.width(), tracing.first_samples(place, lattice, *side));
        let patches = blocks[range].iter().flat_map(|block| block.places.iter().zip(&block.patches));
        for (at, known) in patches {
            let of_first = if let Known::Highest(_) = known { Patch::estimated(samples, at) } else { None };
            let patch = if let Known::All(patch) = known { Some(&**patch) } else { of_first.as_ref() };
            for (y, x) in at.y.clone().flat_map(|y| at.x.clone().map(move |x| (y, x))) {
                // Of a patch of one colour nothing is known but its first samples.
                let first = || lattice.has((x - place.x.start, y - place.y.start), place.size());
                let in_patch = (x - at.x.start, y - at.y.start);
                let (level, squared) = patch.map_or_else(|| (first().into(), 0.0), |p| p.sampled(in_patch));
                sampling.samples[y * width + x] = LEVEL_SAMPLES[usize::from(level)];
                sampling.errors[y * width + x] = squared.sqrt();
            }
        }
        tracing.result.sampling = Some(sampling);
    }

    /// The film has what became of some blocks.
    fn finish(&mut self, range: Range<usize>) {
        let AreaPixels { tracing, place, side, blocks, .. } = self;
        tracing.on_host(|tracing| {
            let width = tracing.width();
            let (columns, rows) = place.patches(*side);
            let mut patches: Vec<Vec<(usize, Box<Patch>)>> = (0..rows).map(|_| Vec::with_capacity(columns)).collect();
            for block in &mut blocks[range] {
                for (at, known) in block.places.iter().zip(std::mem::take(&mut block.patches)) {
                    if let Known::All(patch) = known {
                        patches[(at.y.start - place.y.start) / *side].push((at.x.start, patch));
                    }
                }
            }
            let film = &mut tracing.result.film.pixels[place.y.start * width..place.y.end * width];
            parallel::each(film.chunks_mut(*side * width).zip(patches), |(film, patches)| {
                patches.into_iter().for_each(|(column, patch)| patch.write(film, width, column));
            });
        });
    }
}

/// Some blocks of an area, which are refined together.
struct Group<'g, 'a, 't> {
    area: &'g mut AreaPixels<'a, 't>,
    range: Range<usize>,
    promises: Vec<Promises>,
}

impl Pixels for Group<'_, '_, '_> {
    fn begin(&mut self) -> Result<u64> {
        let AreaPixels { place, lattice, blocks, .. } = &*self.area;
        let places = blocks[self.range.clone()].iter().flat_map(|block| &block.places);
        Ok(places.map(|patch| lattice.points(&patch.seen_from((place.x.start, place.y.start)), place.size())).sum())
    }

    fn raise(&mut self, choices: &[Choice]) -> Result<()> {
        let AreaPixels { tracing, place, side, lattice, blocks, .. } = &mut *self.area;
        let blocks = &mut blocks[self.range.clone()];
        let listed: Vec<Vec<Listed>> = tracing.on_host(|tracing| {
            let samples = tracing.first_samples(place, lattice, *side);
            parallel::map(blocks.iter_mut().zip(choices).enumerate(), |(number, (block, choice))| {
                let of_patch = |(slot, (known, at)): (usize, (&mut Known, &Area))| {
                    if let Known::Highest(highest) = known
                        && *highest >= choice.lowest
                    {
                        *known = Known::all(Patch::estimated(samples, at));
                    }
                    let pixels = known.patch()?.chosen(*choice);
                    (!pixels.is_empty()).then(|| Listed::new((number, slot), at.clone(), *side, pixels))
                };
                block.patches.iter_mut().zip(&block.places).enumerate().filter_map(of_patch).collect()
            })
        });
        let listed: Vec<Listed> = listed.into_iter().flatten().collect();
        let is_interpolated = lattice.step > 1;
        tracing.trace(&listed, |tracing, listed, radiances| {
            let (film, width) = (&tracing.result.film.pixels[..], tracing.width());
            let mut groups: Vec<_> = blocks.iter_mut().map(|block| (block, None)).collect();
            for group in by_groups(listed, radiances, |listed| listed.patch.0) {
                groups[group.0[0].patch.0].1 = Some(group);
            }
            parallel::each(groups.into_iter(), |(block, group)| {
                let Some((listed, radiances)) = group else { return };
                for (listed, radiances) in by_groups(listed, radiances, |listed| listed.patch.1) {
                    if let Some(patch) = block.patches[listed[0].patch.1].patch() {
                        take_samples(patch, &listed[0], radiances, is_interpolated, (film, width));
                    }
                }
            });
        })
    }

    fn update(&mut self) -> Result<&[Promises]> {
        let AreaPixels { tracing, place, side, lattice, blocks, .. } = &mut *self.area;
        let (blocks, promises) = (&mut blocks[self.range.clone()], &mut self.promises);
        tracing.on_host(|tracing| {
            let samples = tracing.first_samples(place, lattice, *side);
            parallel::each(blocks.iter_mut().zip(promises.iter_mut()), |(block, promises)| {
                let mut room = None;
                for (known, at) in block.patches.iter_mut().zip(&block.places) {
                    match known {
                        Known::All(patch) => patch.update(lattice, promises),
                        Known::IsDone | Known::Highest(_) => {}
                        Known::Nothing => {
                            let patch = room.get_or_insert_with(|| Patch::room(*side));
                            *known = match patch.fill(samples, at) {
                                true => {
                                    patch.update(lattice, promises);
                                    Known::Highest(patch.highest())
                                }
                                false => Known::IsDone,
                            };
                        }
                    }
                }
            });
        });
        Ok(promises)
    }
}

/// The first samples that the wanted patches of an area need, patch by patch: those of their own pixels, of the pixels
/// beside them, with which these are compared, and of all that is interpolated from.
fn pixels_of_lattice(area: &Area, side: usize, lattice: &Lattice, is_wanted: &[bool]) -> Vec<Listed> {
    let (columns, rows) = area.patches(side);
    let of_patch = |number| {
        let place = area.patch(number, side);
        let (left, top) = (place.x.start - area.x.start, place.y.start - area.y.start);
        let needed = needed_of_patch(area, side, lattice.step, is_wanted, number);
        let is_needed = |pixel: &usize| {
            let (x, y) = (pixel % side, pixel / side);
            lattice.has((left + x, top + y), area.size())
                && needed.iter().any(|needed| needed.has(place.x.start + x, place.y.start + y))
        };
        let pixels: Vec<_> = match needed.is_empty() {
            true => Vec::new(),
            false => by_tiles(place.size(), side).filter(is_needed).map(|pixel| (pixel as u16, 0)).collect(),
        };
        (!pixels.is_empty()).then(|| Listed::new((0, number), place, side, pixels))
    };
    parallel::flat_map_numbers(columns * rows, of_patch)
}

/// Where the first samples of a patch are needed: everywhere, where it is wanted, else around the wanted ones beside
/// it.
fn needed_of_patch(area: &Area, side: usize, step: usize, is_wanted: &[bool], number: usize) -> Vec<Area> {
    if is_wanted[number] {
        return vec![area.patch(number, side)];
    }
    // Pixels beside a patch are interpolated from points that are no more than a step away, and so are the points that
    // tell the errors of its cells.
    let beyond = if step > 1 { step + 1 } else { 1 };
    let around = |place: &Range<usize>, area: &Range<usize>| {
        place.start.saturating_sub(step).max(area.start)..area.end.min(place.end + beyond)
    };
    let (columns, rows) = area.patches(side);
    let (column, row) = (number % columns, number / columns);
    let rows_beside = row.saturating_sub(1)..rows.min(row + 2);
    let beside = rows_beside.flat_map(|row| (column.saturating_sub(1)..columns.min(column + 2)).map(move |c| (c, row)));
    let wanted = beside.map(|(column, row)| row * columns + column).filter(|&number| is_wanted[number]);
    let grown = |place: Area| Area { x: around(&place.x, &area.x), y: around(&place.y, &area.y) };
    wanted.map(|number| grown(area.patch(number, side))).collect()
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
    parallel::each(rows.into_iter(), |(listed, radiances, film)| {
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
    let film_rows = film[place.y.start * picture_width..place.y.end * picture_width].chunks_mut(picture_width);
    parallel::each(film_rows.enumerate(), |(y, row)| {
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
    let shown = parallel::map_slice(&points, |&point| display_steps(point));
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
    parallel::map_numbers(rows * columns, error)
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
    use super::super::{blocks_of, render_adaptive, render_area, render_blocks, whole_of};
    use super::*;
    use crate::io::film::Film;
    use crate::options::TraceOptions;
    use crate::shared::Light;
    use crate::tracer::{AllHits, AllHitsJob, Candidates, CandidatesJob, TraceJob, TraceResult};
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

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

        fn stop_when(&mut self, _: Arc<AtomicBool>) {}

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
        render_adaptive(&mut rings, &params(size), adaptive, &|_| ()).unwrap()
    }

    /// Checks that the window has the pixels of `whole` where blocks are.
    fn assert_has_blocks(whole: &Film, blocks: &Blocks, finished: &Finished) {
        for place in finished.blocks.iter().flat_map(|&block| blocks.places(block)) {
            for y in place.y {
                let row = y * whole.width as usize + place.x.start..y * whole.width as usize + place.x.end;
                assert_eq!(finished.film.row(y, place.x.clone()), &whole.pixels[row], "{:?}, row {y}", finished.blocks);
            }
        }
    }

    /// Sizes with one area and with two, errors and lattices, and the blocks of an area.
    const BLOCKS: [((u32, u32), f32, u32, usize); 5] = [
        ((700, 560), 1.0, 1, 3),
        ((700, 560), 4.0, 1, 3),
        ((1200, 900), 2.0, 2, 2),
        ((1297, 1003), 4.0, 4, 1),
        ((3101, 300), 1.0, 1, 4),
    ];

    #[test]
    fn how_pixels_were_sampled_adds_up_to_what_is_told_of_the_picture() {
        for (size, error, lattice) in [((70, 45), 1.0, 1), ((300, 140), 3.0, 4)] {
            let adaptive = Adaptive { error, lattice, list_rays: 1 << 12 };
            let mut rings = Rings { options: TraceOptions::DEFAULT };
            let of = params(size);
            let noted = render_area(&mut rings, &of, adaptive, &whole_of(&of), true, &|_| ()).unwrap();
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
        for (size, error, lattice, per_area) in BLOCKS {
            let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
            let whole = render_rings(size, adaptive);
            let blocks = blocks_of(size, adaptive);
            assert_eq!(blocks.per_area, per_area, "{size:?}");
            let mut all = Spent::default();
            for block in 0..blocks.count() {
                let mut rings = Rings { options: TraceOptions::DEFAULT };
                let mut told = 0;
                let keeps_film = block % 2 == 1;
                let film = keeps_film.then(|| Film { width: size.0, height: size.1, pixels: Vec::new() });
                let mut take = |finished: &Finished| {
                    assert_eq!(finished.blocks, [block]);
                    assert_has_blocks(&whole.film, &blocks, finished);
                    all.add(&finished.spent);
                    told += 1;
                    Ok(())
                };
                let params = params(size);
                let of = (&[block][..], &whole_of(&params));
                let result = render_blocks(&mut rings, &params, adaptive, of, film, &mut take, &|_| ());
                let film = result.unwrap().film;
                assert_eq!((told, film.pixels.is_empty()), (1, !keeps_film));
                if keeps_film {
                    let window = FilmWindow { film: &film, place: (0, 0) };
                    let finished = Finished { blocks: &[block], film: window, spent: Spent::default() };
                    assert_has_blocks(&whole.film, &blocks, &finished);
                }
            }
            let stats = whole.adaptive.unwrap();
            assert_eq!((all.refined.pixels, all.refined.rounds), (stats.pixels, stats.rounds));
            assert!(stats.rounds > 1, "some pixels were to have more samples");
        }
    }

    #[test]
    fn blocks_of_an_area_become_the_same_in_groups() {
        for (size, error, lattice, per_area) in BLOCKS {
            let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
            let whole = render_rings(size, adaptive);
            let blocks = blocks_of(size, adaptive);
            let (mut rings, params) = (Rings { options: TraceOptions::DEFAULT }, params(size));
            let film = RenderResult::of_film(Film::black(size.0, size.1));
            let mut tracing = Tracing::new(&mut rings, &params, adaptive, &blocks, (film, (0, 0)), &|_| ());
            let (wanted, mut next) = ((0..per_area).collect::<Vec<_>>(), 0);
            let mut take = |finished: &Finished| {
                assert_eq!(finished.blocks, [next], "one after the other");
                assert_has_blocks(&whole.film, &blocks, finished);
                next += 1;
                Ok(())
            };
            tracing.render_in_groups(&wanted, |_, _| per_area, &mut take).unwrap();
            assert_eq!(next, per_area);
        }
    }

    #[test]
    fn slow_areas_have_more_groups() {
        let of = |milliseconds| groups_of(16, Duration::from_millis(milliseconds));
        assert_eq!([0, 500, 501, 2000, 8000, 1_000_000].map(of), [1, 1, 2, 4, 16, 16]);
        assert_eq!(groups_of(1, Duration::from_secs(9)), 1);
    }

    #[test]
    fn what_fails_to_be_kept_ends_the_picture() {
        let adaptive = Adaptive::of_error(1.0);
        let mut rings = Rings { options: TraceOptions::DEFAULT };
        let mut refuse = |_: &Finished| Err(crate::error::Error::option("-o", "no room"));
        let params = params((90, 90));
        let of = (&[0][..], &whole_of(&params));
        let result = render_blocks(&mut rings, &params, adaptive, of, None, &mut refuse, &|_| ());
        assert!(result.unwrap_err().to_string().contains("no room"));
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
            let squares = parallel::map_numbers(film.len(), |pixel| {
                let (shown, truth) = (display_steps(film[pixel]), truth(pixel));
                f64::from(squared(std::array::from_fn(|c| shown[c] - truth[c])))
            });
            let made = (squares.iter().sum::<f64>() / film.len() as f64).sqrt();
            assert!(made < 1.05 * f64::from(error) && made > 0.3 * f64::from(error), "{made} for {error}");
        }
    }
}
