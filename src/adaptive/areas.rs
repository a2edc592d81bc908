//! Blocks of a picture of bounded error, area after area: by the device, where it decides about an area by itself, else
//! by the host.

use super::host::{Tracing, room_for_sampling};
use super::promises::squared_error;
use super::{Done, blocks_of};
use crate::blocks::{Area, Blocks};
use crate::error::Result;
use crate::io::film::{Film, FilmWindow};
use crate::options::Decisions;
use crate::shared::RenderParams;
use crate::tracer::{Adaptive, AdaptiveStats, Backend, Finished, Progress, RenderResult, Spent};
use crate::work::PixelWork;

/// Renders some blocks of a picture, in ascending order, and tells `done` of them as soon as they are finished: their
/// pixels are those of [`super::render_adaptive`], whatever else is rendered. The result has `film`, one of a `part` of
/// the picture or without pixels yet, with what the part has of the blocks on it; or none.
///
/// # Errors
/// As [`Backend::render`], and those of `done`.
pub fn render_blocks(
    tracer: &mut dyn Backend,
    params: &RenderParams,
    adaptive: Adaptive,
    (wanted, part): (&[usize], &Area),
    film: Option<Film>,
    done: Done,
    progress: Progress,
) -> Result<RenderResult> {
    let keeps_film = film.is_some();
    let result = RenderResult::of_film(film.unwrap_or_else(Film::none));
    let mut run = Run::new(params, adaptive, part, (result, keeps_film));
    run.areas(tracer, wanted, done, progress)?;
    Ok(run.finish())
}

/// Renders a part of a picture, or all of it, and the blocks that have pixels there; where it `notes_sampling` it tells
/// how each pixel was sampled, and the host decides.
///
/// # Errors
/// As [`Backend::render`]; [`Error::OutOfMemory`](crate::Error::OutOfMemory) when there is no memory for that.
pub fn render_area(
    tracer: &mut dyn Backend,
    params: &RenderParams,
    adaptive: Adaptive,
    part: &Area,
    notes_sampling: bool,
    progress: Progress,
) -> Result<RenderResult> {
    let (width, height) = to_u32(part.size());
    let sampling = notes_sampling.then(|| room_for_sampling(part.x.len() * part.y.len())).transpose()?;
    let result = RenderResult { sampling, ..RenderResult::of_film(Film { width, height, pixels: Vec::new() }) };
    let mut run = Run::new(params, adaptive, part, (result, true));
    let wanted = run.blocks.of_part(part);
    run.areas(tracer, &wanted, &mut |_| Ok(()), progress)?;
    Ok(run.finish())
}

/// Pixels of a picture that a device renders at once if it decides by itself: area after area takes 50 ms of an H200
/// more for each, mostly for memory.
const AT_ONCE: usize = 1 << 24;

/// A picture on its way.
struct Run<'a> {
    params: &'a RenderParams,
    adaptive: Adaptive,
    blocks: Blocks,
    /// What the result shows of the picture, if it keeps a film.
    part: &'a Area,
    keeps_film: bool,
    result: RenderResult,
    spent: Spent,
    /// The device, unless the host had to decide about an area.
    decided_by: Decisions,
}

impl<'a> Run<'a> {
    /// On the film of `result`, if it keeps one, which shows `part` of the picture.
    fn new(
        params: &'a RenderParams,
        adaptive: Adaptive,
        part: &'a Area,
        (result, keeps_film): (RenderResult, bool),
    ) -> Self {
        Run {
            params,
            adaptive,
            blocks: blocks_of((params.width, params.height), adaptive),
            part,
            keeps_film,
            result,
            spent: Spent::default(),
            decided_by: Decisions::Device,
        }
    }

    /// Renders blocks, area after area; a whole picture that is small at once, where the device decides.
    fn areas(&mut self, tracer: &mut dyn Backend, wanted: &[usize], done: Done, progress: Progress) -> Result<()> {
        let (width, height) = (self.params.width as usize, self.params.height as usize);
        let is_small = width * height <= AT_ONCE && wanted.len() == self.blocks.count();
        if is_small && self.blocks.areas() > 1 && self.result.sampling.is_none() {
            let all = Area { x: 0..width, y: 0..height };
            if let Some((traced, spent)) = tracer.render_by_error(self.params, self.adaptive, &self.blocks, progress)? {
                return self.take(traced, spent, &all, wanted, done);
            }
        }
        let per_area = self.blocks.per_area;
        let areas: Vec<&[usize]> = wanted.chunk_by(|a, b| a / per_area == b / per_area).collect();
        for (number, wanted) in areas.iter().enumerate() {
            let progress = |part: f64| progress((number as f64 + part) / areas.len() as f64);
            self.area(tracer, wanted, done, &progress)?;
        }
        Ok(())
    }

    /// Renders blocks of one area.
    fn area(&mut self, tracer: &mut dyn Backend, wanted: &[usize], done: Done, progress: Progress) -> Result<()> {
        let number = wanted[0] / self.blocks.per_area;
        let place = self.blocks.area(number);
        // The host alone tells how pixels are sampled.
        if wanted.len() == self.blocks.per_area && self.result.sampling.is_none() {
            let params = self.params.cropped(to_u32((place.x.start, place.y.start)), to_u32(place.size()));
            let of_area = self.blocks.of_area(number);
            if let Some((traced, spent)) = tracer.render_by_error(&params, self.adaptive, &of_area, progress)? {
                return self.take(traced, spent, &place, wanted, done);
            }
        }
        self.decided_by = Decisions::Host;
        self.on_host(tracer, &place, wanted, done, progress)
    }

    /// Takes an area that the device rendered by itself.
    fn take(&mut self, traced: RenderResult, spent: Spent, place: &Area, wanted: &[usize], done: Done) -> Result<()> {
        self.spent.add(&spent);
        self.result.add(&traced);
        let origin = (place.x.start, place.y.start);
        let window = FilmWindow { film: &traced.film, place: origin };
        done(&Finished { blocks: wanted, film: window, spent })?;
        let is_all = (traced.film.width, traced.film.height) == (self.params.width, self.params.height);
        match (self.keeps_film, is_all && self.shows_all()) {
            (false, _) => {}
            (true, true) => self.result.film = traced.film,
            (true, false) => {
                let Some(place) = place.within(self.part) else { return Ok(()) };
                self.result.film.make_pixels()?;
                self.result.film.copy((self.part.x.start, self.part.y.start), &window, &place);
            }
        }
        Ok(())
    }

    /// Whether the result shows all of the picture.
    fn shows_all(&self) -> bool {
        to_u32(self.part.size()) == (self.params.width, self.params.height)
    }

    /// Renders blocks of an area, and decides about them.
    fn on_host(
        &mut self,
        tracer: &mut dyn Backend,
        place: &Area,
        wanted: &[usize],
        done: Done,
        progress: Progress,
    ) -> Result<()> {
        let mut told = Spent::default();
        let mut tell = |finished: &Finished| {
            told.add(&finished.spent);
            done(finished)
        };
        // On the picture's film, unless that is smaller, or has other blocks of the area, which would be drawn over.
        let is_in_place = self.keeps_film && self.shows_all() && wanted.len() == self.blocks.per_area;
        let (onto, origin) = if is_in_place {
            self.result.film.make_pixels()?;
            (std::mem::replace(&mut self.result, RenderResult::of_film(Film::none())), (0, 0))
        } else {
            let ((width, height), pixels) = (to_u32(place.size()), place.x.len() * place.y.len());
            let film = Film { width, height, pixels: Film::try_pixels(pixels)? };
            let sampling = self.result.sampling.is_some().then(|| room_for_sampling(pixels)).transpose()?;
            (RenderResult { sampling, ..RenderResult::of_film(film) }, (place.x.start, place.y.start))
        };
        let mut tracing = Tracing::new(tracer, self.params, self.adaptive, &self.blocks, (onto, origin), progress);
        tracing.render_area(wanted, &mut tell)?;
        let traced = tracing.result;
        if is_in_place {
            self.result = traced;
        } else {
            self.result.add(&traced);
            if self.keeps_film {
                self.keep(&traced, place, wanted)?;
            }
        }
        self.spent.add(&told);
        Ok(())
    }

    /// Keeps what the part has of some blocks of an area.
    fn keep(&mut self, traced: &RenderResult, area: &Area, wanted: &[usize]) -> Result<()> {
        let Run { part, blocks, result: RenderResult { film, work, sampling, .. }, .. } = self;
        film.make_pixels()?;
        let pixels = film.pixels.len();
        let window = FilmWindow { film: &traced.film, place: (area.x.start, area.y.start) };
        let places = wanted.iter().flat_map(|&block| blocks.places(block)).filter_map(|place| place.within(part));
        for place in places {
            film.copy((part.x.start, part.y.start), &window, &place);
            if let Some(traced) = &traced.work {
                let work = work.get_or_insert_with(|| vec![PixelWork::default(); pixels]);
                copy((work, part), (traced, area), &place);
            }
            if let (Some(sampling), Some(traced)) = (sampling.as_mut(), &traced.sampling) {
                copy((&mut sampling.samples, part), (&traced.samples, area), &place);
                copy((&mut sampling.errors, part), (&traced.errors, area), &place);
            }
        }
        Ok(())
    }

    fn finish(self) -> RenderResult {
        // Of the blocks that were rendered, which may reach beyond the part.
        let pixels = self.spent.refined.pixels.iter().sum::<u64>().max(1);
        let stats = stats_of(&self.spent, self.adaptive, pixels, self.decided_by);
        RenderResult { adaptive: Some(stats), ..self.result }
    }
}

/// What became of a picture, or of a part of it, of so many pixels.
pub fn stats_of(spent: &Spent, adaptive: Adaptive, pixels: u64, decided_by: Decisions) -> AdaptiveStats {
    AdaptiveStats {
        error: adaptive.error,
        estimated_error: (squared_error(spent.refined.error) / pixels as f64).sqrt() as f32,
        pixels: spent.refined.pixels,
        rounds: spent.refined.rounds,
        decided_by,
        decide_s: spent.decide_s,
    }
}

/// Copies what both have of a place of the picture: values of all pixels of an area.
fn copy<T: Copy>((to, to_area): (&mut [T], &Area), (from, from_area): (&[T], &Area), place: &Area) {
    for y in place.y.clone() {
        let row = |area: &Area| {
            let first = (y - area.y.start) * area.x.len() + place.x.start - area.x.start;
            first..first + place.x.len()
        };
        to[row(to_area)].copy_from_slice(&from[row(from_area)]);
    }
}

fn to_u32((x, y): (usize, usize)) -> (u32, u32) {
    (x as u32, y as u32)
}
