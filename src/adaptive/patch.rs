//! How wrong each pixel of a patch may be.

use super::promises::{Choice, Promises, class};
use super::shown::{mean, show, squared};
use crate::blocks::{Area, LARGEST_PATCH, PATCH_SIDE};
use crate::fma::with_fma;
use crate::shared::TILE_SIDE;
use crate::tracer::{LAST_LEVEL, LEVEL_SAMPLES};
use bytemuck::zeroed_vec;
use std::ops::Range;

/// Squared error of an interpolated pixel for each squared second difference of the lattice around it: 0.030 to 0.046
/// of five scenes and lattices of 2 and 4 pixels.
pub const LATTICE_ERROR: f32 = 0.045;

/// The squared error of a pixel is the largest of three, by level: a part of the variance that its quarters show, of
/// the contrast around it, and of the mean error that one sample has of the pixels around it. The last two count for
/// n^-1.5, which is what a mean of n samples in such a net has of the squared error of one where an edge runs through
/// the pixel.
///
/// Against 256 samples, all 147,456 pixels of a scene at that level: one sample has 0.033 to 0.054 of the contrast
/// (seven scenes). Four have 0.23 to 0.35 of the variance where that is large, and 0.02 to 0.16 of the contrast / 8
/// where it is nothing, because a feature passed between the samples (the same). Sixteen have 0.24 to 0.41 of a large
/// variance, else 0.07 to 0.15 of what is around / 64 (two scenes). The last levels are guessed from how the errors of
/// whole pictures turned out.
pub const PARTS: [[f32; 3]; LEVEL_SAMPLES.len()] =
    [[0.0; 3], [0.0, 0.05, 0.1], [0.25, 0.1, 0.1], [0.35, 0.0125, 0.1], [0.4, 0.0125, 0.1], [0.4, 0.0125, 0.1]];

/// What an interpolated pixel's squared error may be, as a part of the square of what was wrong with one beside it.
pub const SURPRISE: f32 = 0.25;

/// Bytes for each pixel of an area while it is refined: what is known of it, and the sum of its samples, which those
/// patches have that more than first samples were taken of.
pub const PIXEL_BYTES: u64 = size_of::<[f32; 3 + 3 + 2]>() as u64 + 5;

/// A bit for each pixel of a row.
type Row = u128;
const _: () = assert!(LARGEST_PATCH <= Row::BITS as usize);

/// The lattice of an area.
pub struct Lattice {
    /// Pixels from one of its points to the next.
    pub step: usize,
    /// Squared errors of the interpolation in each of its cells; none where every pixel is one of its points.
    pub cells: Vec<f32>,
    /// Cells in a row.
    pub columns: usize,
}

impl Lattice {
    /// Whether a pixel of an area is one of the points: every so many across and down, and the last.
    pub fn has(&self, (x, y): (usize, usize), (width, height): (usize, usize)) -> bool {
        let is_on = |i: usize, end: usize| i.is_multiple_of(self.step) || i + 1 == end;
        is_on(x, width) && is_on(y, height)
    }

    /// How many of the points lie in a part of an area of this size.
    pub fn points(&self, part: &Area, (width, height): (usize, usize)) -> u64 {
        let on_axis = |part: &Range<usize>, end: usize| {
            let regular = part.end.div_ceil(self.step) - part.start.div_ceil(self.step);
            let has_last = part.end == end && !(end - 1).is_multiple_of(self.step);
            (regular + usize::from(has_last)) as u64
        };
        on_axis(&part.x, width) * on_axis(&part.y, height)
    }

    fn error(&self, x: usize, y: usize) -> f32 {
        self.cells.get(y / self.step * self.columns + x / self.step).copied().unwrap_or(0.0)
    }
}

/// The first samples of an area, and what lies between them.
#[derive(Clone, Copy)]
pub struct FirstSamples<'a> {
    /// The pixels of a picture.
    pub film: &'a [[f32; 3]],
    /// Pixels of a row of it.
    pub width: usize,
    /// Where the area lies there.
    pub area: &'a Area,
    pub lattice: &'a Lattice,
    /// Pixels of a whole patch's side.
    pub side: usize,
}

/// What is known of the pixels of a patch. They are numbered row by row, in rows as long as a whole patch.
pub struct Patch {
    /// Pixels of a whole patch's side; at the border of an area it may be smaller.
    side: usize,
    /// Where its first pixel lies in its area.
    first: (usize, usize),
    size: (usize, usize),
    /// As [`display_steps`], by channel, in rows of `side + 2`. Around the patch the first samples of the pixels there,
    /// whatever they have become since: those of other patches may be anywhere. NaN where there are no pixels.
    shown: [Vec<f32>; 3],
    /// Squared error: of a mean of samples by what parts of them differ; of an interpolated pixel by what its
    /// neighbours turned out to be.
    own: Vec<f32>,
    /// Squared errors, as estimated.
    errors: Vec<f32>,
    levels: Vec<u8>,
    /// Which pixels have new samples since errors were estimated, by row.
    news: Vec<Row>,
    /// Whether errors were estimated before.
    is_estimated: bool,
    /// Whether a pixel has more than its first sample.
    has_means: bool,
    /// The highest class of a pixel.
    highest: usize,
    /// Sums of samples of pixels that have any, once one has more than the first.
    sums: Vec<[f32; 3]>,
}

impl Patch {
    /// Room for a patch of this side.
    pub fn room(side: usize) -> Patch {
        let ring = (side + 2) * (side + 2);
        Patch {
            side,
            first: (0, 0),
            size: (0, 0),
            shown: [zeroed_vec(ring), zeroed_vec(ring), zeroed_vec(ring)],
            own: zeroed_vec(side * side),
            errors: zeroed_vec(side * side),
            levels: zeroed_vec(side * side),
            news: vec![0; side],
            is_estimated: false,
            has_means: false,
            highest: 0,
            sums: Vec::new(),
        }
    }

    /// The patch `place`, with its errors estimated. None where nothing is ever to be done, as [`Patch::fill`] has it.
    pub fn estimated(samples: FirstSamples, place: &Area) -> Option<Patch> {
        let mut patch = Patch::room(samples.side);
        if !patch.fill(samples, place) {
            return None;
        }
        // Its block has counted them.
        patch.update(samples.lattice, &mut Promises::default());
        Some(patch)
    }

    /// Becomes the patch `place` with the first samples, in place of one that has never had others. Not where all its
    /// pixels and those around it are the same, so that nothing is ever to be done.
    pub fn fill(&mut self, FirstSamples { film, width, area, lattice, side }: FirstSamples, place: &Area) -> bool {
        let columns = place.x.start.saturating_sub(1).max(area.x.start)..area.x.end.min(place.x.end + 1);
        let rows = place.y.start.saturating_sub(1).max(area.y.start)..area.y.end.min(place.y.end + 1);
        let row = |y: usize| &film[y * width..][columns.clone()];
        let first = (place.x.start - area.x.start, place.y.start - area.y.start);
        let size = place.size();
        let pixels = || (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y)));
        let corner = row(rows.start)[0];
        if rows.clone().all(|y| row(y).iter().all(|pixel| *pixel == corner))
            && (lattice.cells.is_empty() || pixels().all(|(x, y)| lattice.error(first.0 + x, first.1 + y) == 0.0))
        {
            return false;
        }
        (self.first, self.size, self.is_estimated) = (first, size, false);
        let ring = side + 2;
        if rows.len() < ring || columns.len() < ring {
            self.shown.iter_mut().for_each(|channel| channel.fill(f32::NAN));
            self.errors.fill(0.0);
            self.levels.fill(0);
        }
        let mut channels = [0f32; 3 * (LARGEST_PATCH + 2)];
        for y in rows {
            let channels = &mut channels[..3 * columns.len()];
            channels.copy_from_slice(row(y).as_flattened());
            show(channels);
            let to = (y + 1 - place.y.start) * ring + columns.start + 1 - place.x.start;
            let [red, green, blue] = self.shown.each_mut().map(|channel| &mut channel[to..]);
            for (((shown, red), green), blue) in channels.as_chunks().0.iter().zip(red).zip(green).zip(blue) {
                [*red, *green, *blue] = *shown;
            }
        }
        if lattice.step == 1 {
            self.levels.chunks_mut(side).take(size.1).for_each(|row| row[..size.0].fill(1));
        } else {
            for (x, y) in pixels() {
                self.levels[y * side + x] = u8::from(lattice.has((first.0 + x, first.1 + y), area.size()));
            }
        }
        true
    }

    /// The highest class of a pixel.
    pub fn highest(&self) -> usize {
        self.highest
    }

    /// Place of a pixel in what is shown.
    fn place_of(&self, pixel: usize) -> usize {
        (pixel / self.side + 1) * (self.side + 2) + pixel % self.side + 1
    }

    /// The sums of the samples of its pixels, which until now are those in `film`, a picture of `width`; `place`: where
    /// the patch lies there.
    pub fn sums(&mut self, film: &[[f32; 3]], width: usize, place: &Area) -> &mut [[f32; 3]] {
        if self.sums.is_empty() {
            self.sums = zeroed_vec(self.side * self.side);
            for (sums, y) in self.sums.chunks_mut(self.side).zip(place.y.clone()) {
                sums[..place.x.len()].copy_from_slice(&film[y * width..][place.x.clone()]);
            }
        }
        &mut self.sums
    }

    /// Takes note of the samples that raised a pixel by a level: what it shows now, and the variance of that. Returns
    /// the square of how much these are not what was there, if they are the first.
    pub fn raise(&mut self, pixel: usize, shown: [f32; 3], variance: f32) -> Option<f32> {
        let at = self.place_of(pixel);
        let before: [f32; 3] = std::array::from_fn(|channel| self.shown[channel][at]);
        self.shown.iter_mut().zip(shown).for_each(|(channel, value)| channel[at] = value);
        self.own[pixel] = variance;
        self.levels[pixel] += 1;
        self.news[pixel / self.side] |= 1 << (pixel % self.side);
        self.has_means |= self.levels[pixel] > 1;
        (self.levels[pixel] == 1).then(|| squared(std::array::from_fn(|c| shown[c] - before[c])))
    }

    /// Where interpolated pixels have their first samples, and what [`Patch::raise`] said of them: where one was wrong,
    /// those beside it may be.
    pub fn tell_neighbours(&mut self, changes: &[(usize, f32)]) {
        for &(pixel, change) in changes {
            for near in self.neighbours(pixel) {
                if self.levels[near] == 0 {
                    self.own[near] = self.own[near].max(SURPRISE * change);
                }
            }
        }
    }

    /// The pixels of the patch around one, row by row.
    fn neighbours(&self, pixel: usize) -> impl Iterator<Item = usize> + use<> {
        let side = self.side;
        let (x, y) = (pixel % side, pixel / side);
        let columns = x.saturating_sub(1)..self.size.0.min(x + 2);
        let rows = y.saturating_sub(1)..self.size.1.min(y + 2);
        rows.flat_map(move |row| columns.clone().map(move |column| row * side + column)).filter(move |&i| i != pixel)
    }

    /// Estimates anew the errors of pixels that have new samples, and of those beside them, and keeps `promises` of
    /// its block up to date.
    pub fn update(&mut self, lattice: &Lattice, promises: &mut Promises) {
        if self.is_estimated && self.news.iter().all(|news| *news == 0) {
            return;
        }
        if !self.is_estimated && lattice.step == 1 {
            return estimate_first_samples(self, promises);
        }
        for y in 0..self.size.1 {
            let mut near = self.near_news(y);
            if near == 0 {
                continue;
            }
            let contrasts = self.contrasts(y);
            while near != 0 {
                let x = near.trailing_zeros() as usize;
                near &= near - 1;
                let pixel = y * self.side + x;
                let level = self.levels[pixel];
                if self.is_estimated {
                    let was_raised = self.news[y] >> x & 1 != 0;
                    promises.forget(level - u8::from(was_raised), self.errors[pixel]);
                }
                let error = match level {
                    0 => self.own[pixel].max(lattice.error(self.first.0 + x, self.first.1 + y)),
                    _ => self.estimate(pixel, contrasts[x]),
                };
                promises.count(level, error);
                self.errors[pixel] = error;
            }
        }
        self.news.fill(0);
        self.is_estimated = true;
        let classes = self.errors.iter().zip(&self.levels).filter_map(|(error, level)| class(*level, *error));
        self.highest = classes.max().unwrap_or(0);
    }

    /// Which pixels of a row are new or beside a new one.
    fn near_news(&self, y: usize) -> Row {
        let columns = Row::MAX >> (Row::BITS as usize - self.size.0);
        if !self.is_estimated {
            return columns;
        }
        let rows = &self.news[y.saturating_sub(1)..self.size.1.min(y + 2)];
        let news = rows.iter().fold(0, |all, row| all | row);
        (news | news << 1 | news >> 1) & columns
    }

    /// Of a row the largest squared second differences in the four directions around each pixel.
    #[inline(always)]
    fn contrasts(&self, y: usize) -> [f32; LARGEST_PATCH] {
        // Where the two around a pixel lie, by row and column, behind the pixel above and to the left of it.
        const AROUND: [[(usize, usize); 2]; 4] =
            [[(1, 0), (1, 2)], [(0, 1), (2, 1)], [(0, 0), (2, 2)], [(0, 2), (2, 0)]];
        let mut contrasts = [0f32; LARGEST_PATCH];
        for (first, contrasts) in (0..self.side).step_by(PATCH_SIDE).zip(contrasts.chunks_exact_mut(PATCH_SIDE)) {
            for [before, after] in AROUND {
                let mut sum = [0.0; PATCH_SIDE];
                for shown in &self.shown {
                    let of = |(down, right): (usize, usize)| {
                        &shown[(y + down) * (self.side + 2) + first + right..][..PATCH_SIDE]
                    };
                    let (a, here, b) = (of(before), of((1, 1)), of(after));
                    for i in 0..PATCH_SIDE {
                        let bend = a[i] - 2.0 * here[i] + b[i];
                        sum[i] += bend * bend;
                    }
                }
                for (contrast, sum) in contrasts.iter_mut().zip(sum) {
                    // Of NaN, where there is no pixel on one side, and a number this is the number.
                    *contrast = contrast.max(sum * (1.0 / 3.0));
                }
            }
        }
        contrasts
    }

    /// The squared error of a pixel that has samples.
    fn estimate(&self, pixel: usize, contrast: f32) -> f32 {
        let level = self.levels[pixel];
        let [of_quarters, of_contrast, of_neighbours] = PARTS[usize::from(level)];
        let around = if self.has_means { self.around(pixel) } else { 0.0 };
        let of_one = (of_contrast * contrast).max(of_neighbours * around);
        (of_quarters * self.own[pixel]).max(of_one / edge_samples(level))
    }

    /// What the pixels around one turned out to be: the mean squared error that one sample of them would have.
    fn around(&self, pixel: usize) -> f32 {
        let mut sum = 0.0;
        for near in self.neighbours(pixel) {
            let level = self.levels[near];
            if level > 1 {
                sum += self.own[near] * edge_samples(level);
            }
        }
        sum / 8.0
    }

    /// The pixels of a choice, and their levels, in the order in which they are traced: by tiles, so that neighbours in
    /// a list are neighbours in the picture.
    pub fn chosen(&self, choice: Choice) -> Vec<(u16, u8)> {
        if self.highest < choice.lowest {
            return Vec::new();
        }
        let is_chosen = |pixel: usize| {
            let level = self.levels[pixel];
            class(level, self.errors[pixel]).is_some_and(|class| choice.includes(level, class))
        };
        by_tiles(self.size, self.side)
            .filter(|&pixel| is_chosen(pixel))
            .map(|pixel| (pixel as u16, self.levels[pixel]))
            .collect()
    }

    /// The level of a pixel of it, and its squared error as estimated.
    pub fn sampled(&self, (x, y): (usize, usize)) -> (u8, f32) {
        let pixel = y * self.side + x;
        (self.levels[pixel], self.errors[pixel])
    }

    /// Writes what its pixels show to their places in the rows of `film`, a picture of `width`, which have the first
    /// samples and what lies between them.
    pub fn write(&self, film: &mut [[f32; 3]], width: usize, first_column: usize) {
        if self.sums.is_empty() {
            return;
        }
        for (y, film) in film.chunks_mut(width).enumerate() {
            for x in 0..self.size.0 {
                let pixel = y * self.side + x;
                if self.levels[pixel] > 0 {
                    film[first_column + x] = mean(self.sums[pixel], self.levels[pixel]);
                }
            }
        }
    }
}

with_fma! {
    /// [`Patch::update`] where each pixel has its first sample and no other: [`Patch::estimate`] is then a part of the
    /// contrast.
    fn estimate_first_samples(patch: &mut Patch, promises: &mut Promises) {
        let (mut most, (width, height)) = (0f32, patch.size);
        for y in 0..height {
            let contrasts = patch.contrasts(y);
            let errors = &mut patch.errors[y * patch.side..][..width];
            for (error, contrast) in errors.iter_mut().zip(contrasts) {
                *error = PARTS[1][1] * contrast;
            }
            for &error in errors.iter().filter(|error| **error > 0.0) {
                promises.count(1, error);
                most = most.max(error);
            }
        }
        patch.is_estimated = true;
        patch.highest = class(1, most).unwrap_or(0);
    }
}

/// The pixels of a patch, of a size and the whole one's side, tile by tile.
pub fn by_tiles((width, height): (usize, usize), side: usize) -> impl Iterator<Item = usize> {
    const TILE: usize = TILE_SIDE as usize;
    let tiles = (0..height).step_by(TILE).flat_map(move |top| (0..width).step_by(TILE).map(move |left| (left, top)));
    tiles.flat_map(move |(left, top)| {
        let columns = left..width.min(left + TILE);
        (top..height.min(top + TILE)).flat_map(move |y| columns.clone().map(move |x| y * side + x))
    })
}

/// n^1.5 of the samples n = 4^(level - 1) of a level that has some.
fn edge_samples(level: u8) -> f32 {
    (1 << (3 * (level - 1))) as f32
}

/// The samples that bring a pixel of a level to the next.
pub fn next_samples(level: u8) -> Range<usize> {
    debug_assert!(level < LAST_LEVEL);
    let level = usize::from(level);
    LEVEL_SAMPLES[level] as usize..LEVEL_SAMPLES[level + 1] as usize
}

#[cfg(test)]
mod tests {
    use super::super::shown::display_steps;
    use super::*;
    use crate::random::Random;

    fn colour(random: &mut Random) -> [f32; 3] {
        // Most pixels are like their neighbours.
        if random.below(8) > 0 { [0.25; 3] } else { std::array::from_fn(|_| random.unit()) }
    }

    /// An area of a picture, whose first samples are made up.
    struct Sampled {
        area: Area,
        width: usize,
        film: Vec<[f32; 3]>,
        lattice: Lattice,
    }

    impl Sampled {
        fn new(random: &mut Random, size: (usize, usize), step: usize) -> Sampled {
            let area = Area { x: 3..3 + size.0, y: 2..2 + size.1 };
            let width = size.0 + 5;
            let film = (0..width * (size.1 + 4)).map(|_| colour(random)).collect();
            let columns = (size.0 - 1) / step + 1;
            let cells = (0..columns * ((size.1 - 1) / step + 1)).map(|_| 9.0 * random.unit()).collect();
            let lattice = Lattice { step, cells: if step > 1 { cells } else { Vec::new() }, columns };
            Sampled { area, width, film, lattice }
        }

        fn samples(&self) -> FirstSamples<'_> {
            let Sampled { area, width, film, lattice } = self;
            FirstSamples { film, width: *width, area, lattice, side: PATCH_SIDE * lattice.step }
        }

        fn places(&self) -> Vec<Area> {
            let side = self.samples().side;
            let (columns, rows) = self.area.patches(side);
            (0..columns * rows).map(|number| self.area.patch(number, side)).collect()
        }
    }

    /// The largest squared second difference around a pixel of an area, of which `shown` knows what can be seen.
    fn contrast(shown: impl Fn(i64, i64) -> Option<[f32; 3]>, x: i64, y: i64) -> f32 {
        let here = shown(x, y).unwrap();
        let bend = |(dx, dy): (i64, i64)| {
            let (a, b) = (shown(x - dx, y - dy)?, shown(x + dx, y + dy)?);
            Some(squared(std::array::from_fn(|c| a[c] - 2.0 * here[c] + b[c])))
        };
        [(1, 0), (0, 1), (1, 1), (-1, 1)].into_iter().filter_map(bend).fold(0.0, f32::max)
    }

    /// Everything estimated anew.
    fn promises(patch: &Patch, lattice: &Lattice) -> Promises {
        let mut all = Promises::default();
        let shown = |x: i64, y: i64| {
            let value = std::array::from_fn(|c| patch.shown[c][(y + 1) as usize * (patch.side + 2) + (x + 1) as usize]);
            (!f32::is_nan(value[0])).then_some(value)
        };
        for pixel in by_tiles(patch.size, patch.side) {
            let (x, y) = (pixel % patch.side, pixel / patch.side);
            let error = match patch.levels[pixel] {
                0 => patch.own[pixel].max(lattice.error(patch.first.0 + x, patch.first.1 + y)),
                _ => patch.estimate(pixel, contrast(shown, x as i64, y as i64)),
            };
            assert_eq!(error.to_bits(), patch.errors[pixel].to_bits(), "pixel {x}, {y} of {:?}", patch.size);
            all.count(patch.levels[pixel], error);
        }
        all
    }

    #[test]
    fn what_is_updated_is_what_is_estimated_anew() {
        let mut random = Random::new(5);
        for (size, step) in [((1, 1), 1), ((7, 9), 1), ((33, 50), 1), ((64, 40), 4), ((71, 35), 2)] {
            let sampled = Sampled::new(&mut random, size, step);
            let (samples, lattice) = (sampled.samples(), &sampled.lattice);
            for place in sampled.places() {
                let mut patch = Patch::room(samples.side);
                if !patch.fill(samples, &place) {
                    continue;
                }
                let mut kept = Promises::default();
                for one_in in [1, 3, 20, 200, 2000, 2, 1] {
                    patch.update(lattice, &mut kept);
                    assert!(kept == promises(&patch, lattice), "{size:?}, lattice {step}");
                    let choice = kept.choose(0.0, 1);
                    assert_eq!(patch.chosen(choice).len() as u64, kept.chosen(choice).iter().sum::<u64>());
                    assert_eq!(patch.chosen(Choice::NONE), []);
                    let mut changes = Vec::new();
                    for pixel in by_tiles(patch.size, patch.side) {
                        if random.below(one_in) == 0 && patch.levels[pixel] < LAST_LEVEL {
                            let shown = display_steps(colour(&mut random));
                            changes.extend(patch.raise(pixel, shown, 30.0 * random.unit()).map(|c| (pixel, c)));
                        }
                    }
                    patch.tell_neighbours(&changes);
                }
            }
        }
    }

    /// The last patches of an area are smaller than those before.
    #[test]
    fn nothing_is_left_in_a_room_of_the_patch_before() {
        let mut random = Random::new(6);
        for step in [1, 4] {
            let sampled = Sampled::new(&mut random, (80 * step + 3, 40 * step + 1), step);
            let (samples, lattice, places) = (sampled.samples(), &sampled.lattice, sampled.places());
            let mut room = Patch::room(samples.side);
            assert_eq!(places.len(), 6);
            for place in places.iter().chain(places.iter().rev()) {
                let mut counted = Promises::default();
                assert!(room.fill(samples, place));
                room.update(lattice, &mut counted);
                assert!(counted == promises(&room, lattice), "{place:?}, lattice {step}");
                let alone = Patch::estimated(samples, place).unwrap();
                assert_eq!((room.highest, &room.levels, &room.errors), (alone.highest, &alone.levels, &alone.errors));
                assert!(room.highest > 0 && room.chosen(Choice { lowest: 1, only_interpolated: false }).len() > 9);
            }
        }
    }

    #[test]
    fn where_all_is_the_same_nothing_is_to_be_done() {
        let area = Area { x: 0..40, y: 0..40 };
        let lattice = Lattice { step: 1, cells: Vec::new(), columns: 40 };
        let known = |film: &[[f32; 3]]| {
            let samples = FirstSamples { film, width: 40, area: &area, lattice: &lattice, side: 32 };
            let patch = |number| Patch::estimated(samples, &area.patch(number, 32)).is_some();
            [0, 1, 2, 3].map(patch)
        };
        let mut film = vec![[0.5; 3]; 40 * 40];
        assert_eq!(known(&film), [false; 4]);
        // The last pixel of the first patch is beside all others.
        film[31 * 40 + 31] = [0.6; 3];
        assert_eq!(known(&film), [true; 4]);
        film[31 * 40 + 31] = [0.5; 3];
        film[32 * 40 + 30] = [0.6; 3];
        assert_eq!(known(&film), [true, false, true, false]);
        let coarse = Lattice { step: 4, cells: vec![0.1; 100], columns: 10 };
        let film = [[0.5; 3]; 1600];
        let samples = FirstSamples { film: &film, width: 40, area: &area, lattice: &coarse, side: 32 };
        assert!(Patch::estimated(samples, &area.patch(0, 32)).is_some());
    }
}
