//! Pictures in blocks: rendered in any order, by any number of tracers, with the bits of the whole picture.
//!
//! With a fixed number of samples a block is a band of rows. A picture by its error has the blocks in which samples are
//! decided about ([`crate::blocks`]). Either depends on the picture's size and samples alone.

use super::{Crop, Picture, rendered_params};
use crate::adaptive::{Done, blocks_of, render_blocks as render_by_error, stats_of};
use crate::blocks::{Area, Blocks};
use crate::error::{Error, Result};
use crate::io::film::{Film, FilmWindow};
use crate::options::Decisions;
use crate::pack::{SceneBuffers, sample_positions};
use crate::scene::Samples;
use crate::several::Pace;
use crate::shared::{CameraSample, RenderParams, TILE_SIDE};
use crate::tracer::{Adaptive, AdaptiveStats, Backend, Finished, Progress, RenderResult, Spent};
use std::borrow::Cow;
use std::ops::Range;
use std::panic::resume_unwind;
use std::sync::mpsc::sync_channel;
use std::thread::Builder;
use std::time::{Duration, Instant};

/// The most pixels of a band, and about how many camera rays.
const BAND_PIXELS: u64 = 1 << 17;
const BAND_RAYS: u64 = 1 << 20;

/// Camera rays of the first bands that are rendered together, and how many times as many are next while that takes
/// little time.
const FIRST_RAYS: u64 = 1 << 22;
const GROWTH: u64 = 64;
/// The most pixels of bands that are rendered together, so that a device has room for them: 128 MiB.
const GROUP_PIXELS: u64 = 1 << 23;
/// So long take bands that are rendered together, about: what is lost when the program is stopped.
const GROUP_TIME: Duration = Duration::from_secs(1);

/// How a picture, or a part of one, is cut into blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureBlocks {
    /// What is rendered of the picture.
    part: Crop,
    samples: Samples,
    cut: Cut,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Cut {
    /// Into bands of so many rows.
    Bands(u32),
    /// As decisions are taken for this error.
    Strewn(Blocks, f32),
}

impl PictureBlocks {
    /// Of a picture of this size, or of a part of it.
    pub fn new(size: (u32, u32), samples: Samples, part: Option<Crop>) -> PictureBlocks {
        let part = part.unwrap_or(Crop { place: (0, 0), size });
        let cut = match samples {
            Samples::Error(error) => Cut::Strewn(blocks_of(size, Adaptive::of_error(error)), error),
            fixed => {
                let pixels = (BAND_RAYS / u64::from(fixed.per_pixel())).min(BAND_PIXELS);
                let rows = (pixels / u64::from(part.size.0)) as u32 / TILE_SIDE * TILE_SIDE;
                Cut::Bands(rows.max(TILE_SIDE))
            }
        };
        PictureBlocks { part, samples, cut }
    }

    /// The numbers of its blocks, in ascending order: of a part by its error those that have pixels in it. Their pixels
    /// elsewhere are decided about together with these.
    pub fn numbers(&self) -> Vec<usize> {
        match self.cut {
            Cut::Bands(rows) => (0..self.part.size.1.div_ceil(rows) as usize).collect(),
            Cut::Strewn(blocks, _) => blocks.of_part(&self.part.area()),
        }
    }

    /// Column and row in the picture where what is rendered begins.
    pub fn place(&self) -> (usize, usize) {
        (self.part.place.0 as usize, self.part.place.1 as usize)
    }

    /// Width and height of what is rendered.
    pub fn size(&self) -> (u32, u32) {
        self.part.size
    }

    /// Whether there is a block of this number.
    pub fn has(&self, number: usize) -> bool {
        match self.cut {
            Cut::Bands(rows) => number < self.part.size.1.div_ceil(rows) as usize,
            Cut::Strewn(blocks, _) => {
                let of_area = |area| blocks.blocks_in(area, &self.part.area());
                number < blocks.count() && of_area(number / blocks.per_area).contains(&number)
            }
        }
    }

    /// How many pixels a block has in what is rendered.
    pub fn pixels(&self, number: usize) -> usize {
        self.places(number).iter().map(|place| place.x.len() * place.y.len()).sum()
    }

    /// Where the pixels of a block lie in the picture, one place after the other; nothing beyond the part.
    pub fn places(&self, number: usize) -> Vec<Area> {
        match self.cut {
            Cut::Bands(rows) => vec![self.bands(number..number + 1, rows).area()],
            Cut::Strewn(blocks, _) => {
                let part = self.part.area();
                blocks.places(number).into_iter().filter_map(|place| place.within(&part)).collect()
            }
        }
    }

    /// Whether its blocks are bands of rows.
    pub fn are_bands(&self) -> bool {
        matches!(self.cut, Cut::Bands(_))
    }

    /// The rows of what is rendered that a block has all pixels of, if it is a band.
    pub(super) fn rows_of_band(&self, number: usize) -> Option<Range<usize>> {
        let Cut::Bands(rows) = self.cut else { return None };
        Some(self.bands(number..number + 1, rows).area().seen_from(self.place()).y)
    }

    /// The blocks that have some rows of what is rendered, from top to bottom in pieces that have whole rows together:
    /// bands, or the blocks of the areas beside each other.
    pub(super) fn tiers(&self, rows: &Range<usize>) -> Vec<Vec<usize>> {
        let top = |&number: &usize| match self.cut {
            Cut::Bands(_) => number,
            Cut::Strewn(blocks, _) => blocks.area(number / blocks.per_area).y.start,
        };
        let is_in = |number: &usize| self.rows_of_band(*number).is_none_or(|of| rows.contains(&of.start));
        let numbers: Vec<usize> = self.numbers().into_iter().filter(is_in).collect();
        numbers.chunk_by(|a, b| top(a) == top(b)).map(<[usize]>::to_vec).collect()
    }

    /// The blocks in pieces whose pixels fill a rectangle together, and these rectangles in pixels from [`Self::place`]
    /// on, row by row: bands, and what is rendered of areas.
    pub fn regions(&self) -> Vec<(Area, Vec<usize>)> {
        let region = |numbers: Vec<usize>| {
            let area = match self.cut {
                Cut::Bands(rows) => self.bands(numbers[0]..numbers[0] + 1, rows).area(),
                Cut::Strewn(blocks, _) => {
                    let area = blocks.area(numbers[0] / blocks.per_area);
                    area.within(&self.part.area()).expect("it has blocks, so the part meets it")
                }
            };
            (area.seen_from(self.place()), numbers)
        };
        self.units_of(&self.numbers(), 1).into_iter().map(region).collect()
    }

    /// About how many pixels are in flight at the most while blocks are rendered on a device that has at most so many
    /// at a time.
    pub fn in_flight(&self, on_device: u64) -> u64 {
        let pixels = u64::from(self.part.size.0) * u64::from(self.part.size.1);
        let most = match self.cut {
            Cut::Bands(rows) => (u64::from(rows) * u64::from(self.part.size.0)).max(on_device.min(GROUP_PIXELS)),
            Cut::Strewn(blocks, _) => (blocks.area.0 * blocks.area.1) as u64,
        };
        most.min(pixels)
    }

    /// Neighbouring bands.
    fn bands(&self, numbers: Range<usize>, rows: u32) -> Crop {
        let row = |band: usize| (band as u32).saturating_mul(rows).min(self.part.size.1);
        let (top, end) = (row(numbers.start), row(numbers.end));
        Crop { place: (self.part.place.0, self.part.place.1 + top), size: (self.part.size.0, end - top) }
    }

    /// The blocks that part `number` of `count` parts renders, counted from 0: together all, each block in one part.
    /// Whole areas where there are enough of them, because blocks of an area have first samples in common; and several
    /// neighbouring bands at a time, because small launches keep no GPU busy.
    pub fn of_part(&self, number: usize, count: usize) -> Vec<usize> {
        self.by_parts(count).filter(|(part, _)| *part == number).flat_map(|(_, blocks)| blocks).collect()
    }

    /// The blocks in the pieces that are dealt out to so many parts, each with the number of its part.
    pub fn by_parts(&self, count: usize) -> impl Iterator<Item = (usize, Vec<usize>)> + use<> {
        let units = self.units_of(&self.numbers(), ENOUGH_AREAS * count);
        let together = match self.cut {
            Cut::Bands(_) => (units.len() / (ENOUGH_AREAS * count)).max(1),
            Cut::Strewn(..) => 1,
        };
        let pieces: Vec<Vec<usize>> = units.chunks(together).map(<[Vec<usize>]>::concat).collect();
        pieces.into_iter().enumerate().map(move |(piece, blocks)| (piece % count, blocks))
    }

    /// Some blocks in pieces that are best rendered together: those of an area, where they lie in so many areas,
    /// because they have first samples in common; else one by one.
    pub(super) fn units_of(&self, numbers: &[usize], enough: usize) -> Vec<Vec<usize>> {
        let per_area = match self.cut {
            Cut::Strewn(blocks, _) => blocks.per_area,
            Cut::Bands(_) => 1,
        };
        let areas: Vec<&[usize]> = numbers.chunk_by(|a, b| a / per_area == b / per_area).collect();
        match areas.len() >= enough {
            true => areas.into_iter().map(<[usize]>::to_vec).collect(),
            false => numbers.iter().map(|&number| vec![number]).collect(),
        }
    }

    /// The pixels of a block, place after place and row by row, from a film that shows them.
    pub fn gather<'f>(&self, number: usize, film: &FilmWindow<'f>) -> Cow<'f, [[f32; 3]]> {
        let places = self.places(number);
        if let [place] = &places[..]
            && let Some(rows) = film.rows(place)
        {
            return Cow::Borrowed(rows);
        }
        let mut pixels = Vec::new();
        for place in places {
            place.y.for_each(|y| pixels.extend_from_slice(film.row(y, place.x.clone())));
        }
        Cow::Owned(pixels)
    }

    /// Puts the pixels of a block, as [`PictureBlocks::gather`] has them, onto a film of the part, or one without
    /// pixels yet.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`](crate::Error::OutOfMemory) when the system has no memory for the film.
    pub fn scatter(&self, number: usize, pixels: &[[f32; 3]], film: &mut Film) -> Result<()> {
        film.make_pixels()?;
        let (mut rest, width) = (pixels, film.width as usize);
        for place in self.places(number).into_iter().map(|place| place.seen_from(self.place())) {
            for row in film.pixels.chunks_mut(width).skip(place.y.start).take(place.y.len()) {
                let (now, below) = rest.split_at(place.x.len());
                row[place.x.clone()].copy_from_slice(now);
                rest = below;
            }
        }
        Ok(())
    }

    /// Copies the pixels of blocks that are finished onto such a film.
    ///
    /// # Errors
    /// As [`PictureBlocks::scatter`].
    pub fn copy(&self, finished: &Finished, film: &mut Film) -> Result<()> {
        film.make_pixels()?;
        let places = finished.blocks.iter().flat_map(|&number| self.places(number));
        places.for_each(|place| film.copy(self.place(), &finished.film, &place));
        Ok(())
    }

    /// A film for the part, without pixels.
    pub fn empty_film(&self) -> Film {
        Film { width: self.part.size.0, height: self.part.size.1, pixels: Vec::new() }
    }

    /// What is told of a picture by its error.
    pub fn adaptive_stats(&self, spent: &Spent, decided_by: Decisions) -> Option<AdaptiveStats> {
        let Cut::Strewn(_, error) = self.cut else { return None };
        // Of the blocks that were rendered, which may reach beyond the part.
        let pixels = spent.refined.pixels.iter().sum::<u64>().max(1);
        Some(stats_of(spent, Adaptive::of_error(error), pixels, decided_by))
    }
}

/// A part takes whole areas where it has so many.
const ENOUGH_AREAS: usize = 4;

/// Renders the `wanted` blocks of a picture, in ascending order, and tells `done` of them as soon as they are finished.
/// What `done` gets shows other pixels, too, which may be anything. The result has `film`, one of the part that is
/// rendered or without pixels yet, with the blocks on it; or none. It has no counted work.
///
/// # Errors
/// As [`super::render`], and those of `done`.
pub fn render_blocks(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    picture: &Picture,
    blocks: &PictureBlocks,
    wanted: (&[usize], Option<Film>),
    done: Done,
    progress: Progress,
) -> Result<RenderResult> {
    render_blocks_at(&mut None, (tracer, buffers), picture, blocks, wanted, done, progress)
}

/// The same at a device's pace, in camera rays, which is learnt.
pub(super) fn render_blocks_at(
    pace: &mut Pace,
    (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
    picture: &Picture,
    blocks: &PictureBlocks,
    (wanted, film): (&[usize], Option<Film>),
    done: Done,
    progress: Progress,
) -> Result<RenderResult> {
    picture.samples.check(picture.size)?;
    let params = rendered_params(tracer, buffers, picture);
    match blocks.cut {
        Cut::Strewn(_, error) => {
            let (adaptive, of) = (Adaptive::of_error(error), (wanted, &blocks.part.area()));
            render_by_error(tracer, &params, adaptive, of, film, done, progress)
        }
        Cut::Bands(rows) => render_bands((tracer, pace), &params, (blocks, rows), (wanted, film), done, progress),
    }
}

/// Bands that were traced together.
struct Group<'a> {
    numbers: &'a [usize],
    /// Where they are.
    place: Crop,
    traced: RenderResult,
}

/// What traces bands in groups, at a pace that is learnt.
struct Groups<'a> {
    params: &'a RenderParams,
    blocks: &'a PictureBlocks,
    rows: u32,
    wanted: &'a [usize],
    samples: Vec<CameraSample>,
    /// The most pixels that are traced together.
    most_pixels: u64,
}

impl<'a> Groups<'a> {
    fn pixels_of_band(&self) -> u64 {
        u64::from(self.rows) * u64::from(self.blocks.part.size.0)
    }

    fn rays_of_band(&self) -> u64 {
        self.pixels_of_band() * self.samples.len() as u64
    }

    /// How many bands are traced together at a pace.
    fn at_once(&self, pace: Pace) -> usize {
        let pixels = self.pixels_of_band();
        (pace.unwrap_or(FIRST_RAYS) / self.rays_of_band()).min(self.most_pixels / pixels).max(1) as usize
    }

    /// Traces all bands, and hands each group on as soon as it is traced.
    fn trace(
        &self,
        (tracer, pace): (&mut dyn Backend, &mut Pace),
        progress: Progress,
        mut hand_on: impl FnMut(Group<'a>) -> Result<()>,
    ) -> Result<()> {
        let mut rest = self.wanted;
        while !rest.is_empty() {
            let (numbers, later) = rest.split_at(neighbours(rest).min(self.at_once(*pace)));
            let before = self.wanted.len() - rest.len();
            let progress =
                |part: f64| progress((before as f64 + part * numbers.len() as f64) / self.wanted.len() as f64);
            let place = self.blocks.bands(numbers[0]..numbers[0] + numbers.len(), self.rows);
            let start = Instant::now();
            let traced = tracer.render(&self.params.cropped(place.place, place.size), &self.samples, &progress)?;
            *pace = Some(next_rays(self.rays_of_band() * numbers.len() as u64, start.elapsed()));
            hand_on(Group { numbers, place, traced })?;
            rest = later;
        }
        Ok(())
    }

    /// Whether all bands are one group.
    fn are_one(&self, pace: Pace) -> bool {
        neighbours(self.wanted) == self.wanted.len() && self.wanted.len() <= self.at_once(pace)
    }

    /// As [`Groups::trace`], in a second thread: what takes a group, and may write it to a disk, does so while the next
    /// one is traced. Returns for how many seconds nothing was traced meanwhile; `None` where there can be no thread.
    fn trace_beside(
        &self,
        (tracer, pace): (&mut dyn Backend, &mut Pace),
        progress: Progress,
        take: impl FnMut(Group<'a>) -> Result<()>,
    ) -> Result<Option<f64>> {
        std::thread::scope(|scope| {
            let (sender, receiver) = sync_channel(0);
            let trace = move || {
                let mut waited = Duration::ZERO;
                self.trace((tracer, pace), progress, |group| {
                    let traced = Instant::now();
                    let sent = sender.send(group);
                    waited += traced.elapsed();
                    // Where nobody takes it, whoever did has failed.
                    sent.map_err(|_| Error::Stopped)
                })?;
                Ok((waited, Instant::now()))
            };
            let Ok(tracing) = Builder::new().spawn_scoped(scope, trace) else { return Ok(None) };
            let taken = receiver.into_iter().try_for_each(take);
            let traced: Result<(Duration, Instant)> = tracing.join().unwrap_or_else(|panic| resume_unwind(panic));
            taken?;
            let (waited, end) = traced?;
            Ok(Some((waited + end.elapsed()).as_secs_f64()))
        })
    }
}

fn render_bands(
    (tracer, pace): (&mut dyn Backend, &mut Pace),
    params: &RenderParams,
    (blocks, rows): (&PictureBlocks, u32),
    (wanted, film): (&[usize], Option<Film>),
    done: Done,
    progress: Progress,
) -> Result<RenderResult> {
    let most_pixels = tracer.pixels_at_a_time().min(GROUP_PIXELS);
    let groups = Groups { params, blocks, rows, wanted, samples: sample_positions(blocks.samples), most_pixels };
    let keeps_film = film.is_some();
    let mut result = RenderResult::of_film(film.unwrap_or_else(Film::none));
    let mut take = |Group { numbers, place, traced }: Group| {
        result.add(&traced);
        let at = (place.place.0 as usize, place.place.1 as usize);
        let film = FilmWindow { film: &traced.film, place: at };
        let finished = Finished { blocks: numbers, film, spent: Spent::of(&traced, 0.0) };
        done(&finished)?;
        match keeps_film {
            true if place == blocks.part => result.film = traced.film,
            true => blocks.copy(&finished, &mut result.film)?,
            false => {}
        }
        Ok(())
    };
    let taking_s = match groups.are_one(*pace) {
        true => None,
        false => groups.trace_beside((&mut *tracer, &mut *pace), progress, &mut take)?,
    };
    if taking_s.is_none() {
        groups.trace((tracer, pace), progress, take)?;
    }
    Ok(RenderResult { taking_s, ..result })
}

/// How many of the first numbers follow each other without a gap.
fn neighbours(numbers: &[usize]) -> usize {
    let breaks = numbers.windows(2).position(|pair| pair[0] + 1 != pair[1]);
    breaks.map_or(numbers.len(), |last| last + 1)
}

/// How many camera rays are traced together next, if so many took so long.
fn next_rays(rays: u64, took: Duration) -> u64 {
    let in_time = rays as f64 * GROUP_TIME.as_secs_f64() / took.as_secs_f64().max(1e-3);
    (in_time as u64).min(rays.saturating_mul(GROWTH)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(size: (u32, u32)) -> Vec<PictureBlocks> {
        let part = Crop { place: (3, 5), size: (size.0 - 7, size.1 - 6) };
        let samples =
            [Samples::PerPixel(1), Samples::PerPixel(64), Samples::Corners, Samples::Error(1.0), Samples::Error(4.0)];
        let parts = [None, Some(part)];
        samples.iter().flat_map(|&samples| parts.map(|part| PictureBlocks::new(size, samples, part))).collect()
    }

    #[test]
    fn as_many_bands_are_traced_together_as_there_is_room_for() {
        let blocks = PictureBlocks::new((4096, 4096), Samples::PerPixel(1), None);
        let Cut::Bands(rows) = blocks.cut else { panic!("{blocks:?}") };
        let (params, wanted, samples) = (RenderParams::default(), blocks.numbers(), sample_positions(blocks.samples));
        let mut groups = Groups { params: &params, blocks: &blocks, rows, wanted: &wanted, samples, most_pixels: 0 };
        let band = groups.pixels_of_band();
        for (most_pixels, pace, expected) in [
            (GROUP_PIXELS, Some(u64::MAX), GROUP_PIXELS / band),
            (1 << 20, Some(u64::MAX), (1 << 20) / band),
            (1 << 20, Some(3 * band), 3),
            (1 << 20, Some(1), 1),
            (1, Some(u64::MAX), 1),
        ] {
            groups.most_pixels = most_pixels;
            assert_eq!(groups.at_once(pace) as u64, expected, "{most_pixels} pixels at a pace of {pace:?}");
        }
    }

    #[test]
    fn every_pixel_is_in_one_block() {
        for size in [(9, 8), (1500, 40), (40, 1500), (3200, 900)] {
            for blocks in all(size) {
                let mut film = Film { width: size.0, height: size.1, pixels: Vec::new() };
                film.pixels = (0..size.0 * size.1).map(|i| [i as f32 + 1.0; 3]).collect();
                let mut part = blocks.empty_film();
                let numbers = blocks.numbers();
                for &number in &numbers {
                    let pixels = blocks.gather(number, &FilmWindow { film: &film, place: (0, 0) });
                    assert_eq!(pixels.len(), blocks.pixels(number));
                    blocks.scatter(number, &pixels, &mut part).unwrap();
                }
                let count: usize = numbers.iter().map(|&number| blocks.pixels(number)).sum();
                assert_eq!(count, part.pixels.len(), "{blocks:?}");
                let (left, top) = blocks.place();
                for (i, pixel) in part.pixels.iter().enumerate() {
                    let (x, y) = (i % part.width as usize + left, i / part.width as usize + top);
                    assert_eq!(*pixel, film.pixels[y * size.0 as usize + x], "{blocks:?}");
                }
                let last = *numbers.last().unwrap();
                assert!(blocks.has(last) && !blocks.has(last + 1_000_000));
            }
        }
    }

    #[test]
    fn a_part_has_the_blocks_that_have_pixels_in_it() {
        for (size, error) in [((1920, 1080), 1.0), ((1920, 1080), 2.0), ((3200, 3900), 1.0)] {
            let whole = PictureBlocks::new(size, Samples::Error(error), None);
            for part in ["0,0,1x1", "63,64,2x1", "100,200,96x70", "1600,900,300x90"] {
                let part: Crop = part.parse().unwrap();
                let blocks = PictureBlocks::new(size, Samples::Error(error), Some(part));
                let is_in = |number: &usize| whole.places(*number).iter().any(|place| place.meets(&part.area()));
                let expected: Vec<usize> = whole.numbers().into_iter().filter(is_in).collect();
                assert_eq!(blocks.numbers(), expected, "{part}");
                let is_had: Vec<usize> = whole.numbers().into_iter().filter(|&number| blocks.has(number)).collect();
                assert_eq!(is_had, expected, "{part}");
            }
        }
        let part = Some(Crop { place: (63, 64), size: (2, 1) });
        assert_eq!(PictureBlocks::new((1920, 1080), Samples::Error(1.0), part).numbers().len(), 2);
    }

    #[test]
    fn regions_are_filled_by_their_blocks() {
        for size in [(9, 8), (1500, 40), (40, 1500), (3200, 3900)] {
            for blocks in all(size) {
                let regions = blocks.regions();
                let numbers: Vec<usize> = regions.iter().flat_map(|(_, numbers)| numbers.clone()).collect();
                assert_eq!(numbers, blocks.numbers());
                for (area, numbers) in regions {
                    let places = numbers.iter().flat_map(|&number| blocks.places(number));
                    let places: Vec<Area> = places.map(|place| place.seen_from(blocks.place())).collect();
                    assert!(places.iter().all(|place| place.within(&area).as_ref() == Some(place)), "{blocks:?}");
                    let pixels: usize = places.iter().map(|place| place.x.len() * place.y.len()).sum();
                    assert_eq!(pixels, area.x.len() * area.y.len(), "{blocks:?}");
                }
            }
        }
    }

    #[test]
    fn parts_have_every_block_once() {
        for size in [(1500, 800), (9000, 9000), (65535, 65535)] {
            for samples in [Samples::PerPixel(4), Samples::Error(1.0)] {
                let blocks = PictureBlocks::new(size, samples, None);
                for count in [1, 2, 3, 16, 100] {
                    let parts: Vec<_> = (0..count).map(|number| blocks.of_part(number, count)).collect();
                    assert!(parts.iter().all(|part| part.is_sorted()));
                    let longest = parts.iter().map(Vec::len).max().unwrap();
                    let average = blocks.numbers().len().div_ceil(count);
                    assert!(longest <= average + average / ENOUGH_AREAS + 1, "{longest} of {average}");
                    let mut together = parts.concat();
                    together.sort_unstable();
                    assert_eq!(together, blocks.numbers());
                }
            }
        }
    }

    #[test]
    fn rays_are_traced_in_groups_of_about_a_second() {
        assert_eq!(next_rays(1000, Duration::from_secs(4)), 250);
        assert_eq!(next_rays(1000, Duration::from_millis(500)), 2000);
        assert_eq!(next_rays(1000, Duration::ZERO), 64_000);
        assert_eq!(next_rays(1, Duration::from_secs(1000)), 1);
        assert_eq!([neighbours(&[4]), neighbours(&[4, 5, 6]), neighbours(&[4, 5, 7])], [1, 3, 2]);
    }
}
