//! How wrong each pixel may be, and which of them more samples would help most.

use crate::io::film::srgb_from_linear;
use crate::shared::TILE_SIDE;
use crate::tracer::{LAST_LEVEL, LEVEL_SAMPLES};
use bytemuck::{Zeroable, zeroed_vec};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Squared error of an interpolated pixel for each squared second difference of the lattice around it: 0.030 to 0.046
/// of five scenes and lattices of 2 and 4 pixels.
const LATTICE_ERROR: f32 = 0.045;

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
const PARTS: [[f32; 3]; LEVEL_SAMPLES.len()] =
    [[0.0; 3], [0.0, 0.05, 0.1], [0.25, 0.1, 0.1], [0.35, 0.0125, 0.1], [0.4, 0.0125, 0.1], [0.4, 0.0125, 0.1]];

/// Values of a screen by the root of the radiance, of which they are nearly a multiple: straight lines between these
/// are right to 0.001 steps.
pub static CURVE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let root = |i: usize| i as f64 / CURVE_INTERVALS as f64;
    (0..=CURVE_INTERVALS + 1).map(|i| (255.0 * srgb_from_linear(root(i).powi(2))) as f32).collect()
});
const CURVE_INTERVALS: usize = 4096;

/// Values of a screen, 0 to 255 without rounding.
pub fn display_steps(linear: [f32; 3]) -> [f32; 3] {
    linear.map(|radiance| {
        // NaN counts as black, as it does in files.
        let at = if radiance > 0.0 { radiance.min(1.0) } else { 0.0 }.sqrt() * CURVE_INTERVALS as f32;
        let low = at as usize;
        CURVE[low] + (CURVE[low + 1] - CURVE[low]) * (at - low as f32)
    })
}

/// The variance of the mean of four values, if they have nothing to do with each other. Of parts of one net they have:
/// together they cover the pixel better, and the error is smaller ([`PARTS`]).
pub fn variance_of_mean(quarters: &[[f32; 3]; 4]) -> f32 {
    let [a, b, c, d] = quarters;
    let mean: [f32; 3] = std::array::from_fn(|i| (a[i] + b[i] + c[i] + d[i]) * 0.25);
    let [a, b, c, d] = quarters.map(|quarter| squared(std::array::from_fn(|i| quarter[i] - mean[i])));
    (a + b + c + d) * (1.0 / 12.0)
}

/// Mean of the squared channels.
fn squared([r, g, b]: [f32; 3]) -> f32 {
    (r * r + g * g + b * b) * (1.0 / 3.0)
}

/// What is known of a pixel: nothing where all is zero.
#[derive(Debug, Clone, Copy, Zeroable)]
pub struct Estimate {
    /// As [`display_steps`].
    shown: [f32; 3],
    /// Squared error: of a mean of samples by what parts of them differ; of an interpolated pixel by what its
    /// neighbours turned out to be.
    own: f32,
    level: u8,
    /// Whether its samples were there when errors were estimated last.
    is_old: bool,
}

impl Estimate {
    /// Takes note of the samples that raised the pixel by a level: what it shows now, and the variance of that. Returns
    /// the square of how much these are not what was there, if they are the first.
    fn raise(&mut self, shown: [f32; 3], variance: f32) -> Option<f32> {
        let before = std::mem::replace(self, Estimate { shown, own: variance, level: self.level + 1, is_old: false });
        (before.level == 0).then(|| squared(std::array::from_fn(|c| shown[c] - before.shown[c])))
    }
}

/// Bytes of [`Estimates`] for each pixel: the estimate itself, its error, and points of the lattice while others are
/// interpolated.
pub const PIXEL_BYTES: u64 = (size_of::<Estimate>() + size_of::<f32>() + size_of::<[f32; 3]>() / 4) as u64;

/// Pixels of a tile's side. Estimates are made anew, and pixels looked for, in the tiles alone where there is something.
const SIDE: usize = TILE_SIDE as usize;

/// From so many pixels of a tile on, the contrasts of all are computed together.
const CONTRASTS_TOGETHER: u32 = 16;

/// The estimates of a picture.
pub struct Estimates {
    size: (usize, usize),
    lattice: usize,
    pixels: Vec<Estimate>,
    /// Squared errors of the pixels.
    errors: Vec<f32>,
    /// Squared errors of the interpolation in each cell of the lattice.
    cells: Vec<f32>,
    /// Which tiles have pixels that are new.
    has_news: Vec<bool>,
    /// The highest class in each tile.
    highest: Vec<u16>,
    /// Of all pixels; `None` before errors were estimated.
    promises: Option<Promises>,
}

/// The estimates of the pixels in a row of tiles.
pub struct TileRow<'a> {
    width: usize,
    pixels: &'a mut [Estimate],
    has_news: &'a mut [bool],
}

impl TileRow<'_> {
    /// Of the pixel `at` so many behind the first of the row.
    pub fn level(&self, at: usize) -> u8 {
        self.pixels[at].level
    }

    /// As [`Estimate::raise`], of the pixel `at` so many behind the first of the row.
    pub fn raise(&mut self, at: usize, shown: [f32; 3], variance: f32) -> Option<f32> {
        self.has_news[at % self.width / SIDE] = true;
        self.pixels[at].raise(shown, variance)
    }
}

impl Estimates {
    pub fn new(size: (usize, usize), lattice: usize) -> Self {
        let count = size.0 * size.1;
        let tiles = size.0.div_ceil(SIDE) * size.1.div_ceil(SIDE);
        Estimates {
            size,
            lattice,
            // Memory that is taken when it is written.
            pixels: zeroed_vec(count),
            errors: vec![0.0; count],
            cells: Vec::new(),
            has_news: vec![true; tiles],
            highest: vec![0; tiles],
            promises: None,
        }
    }

    /// Tiles across.
    fn columns(&self) -> usize {
        self.size.0.div_ceil(SIDE)
    }

    /// The pixels of the tiles that are `wanted`, tile after tile, so that neighbours in a list are neighbours in the
    /// picture.
    fn pixels_of_tiles(
        &self,
        wanted: impl Fn(usize) -> bool + Send + Sync,
    ) -> impl ParallelIterator<Item = (usize, usize)> {
        let ((width, height), columns) = (self.size, self.columns());
        let tiles = (0..self.has_news.len()).into_par_iter().filter(move |&tile| wanted(tile));
        tiles.flat_map_iter(move |tile| {
            let (left, top) = (tile % columns * SIDE, tile / columns * SIDE);
            (top..height.min(top + SIDE)).flat_map(move |y| (left..width.min(left + SIDE)).map(move |x| (x, y)))
        })
    }

    /// The samples that bring a pixel to the next level.
    pub fn new_samples(&self, pixel: usize) -> std::ops::Range<usize> {
        let level = usize::from(self.pixels[pixel].level);
        LEVEL_SAMPLES[level] as usize..LEVEL_SAMPLES[level + 1] as usize
    }

    /// The rows of tiles.
    pub fn tile_rows(&mut self) -> impl IndexedParallelIterator<Item = TileRow<'_>> {
        let (width, columns) = (self.size.0, self.columns());
        let rows = self.pixels.par_chunks_mut(SIDE * width).zip(self.has_news.par_chunks_mut(columns));
        rows.map(move |(pixels, has_news)| TileRow { width, pixels, has_news })
    }

    /// Those that are traced first: every so many across and down, and the last.
    pub fn pixels_of_lattice(&self) -> Vec<usize> {
        let (width, height) = self.size;
        let on_lattice = |i: usize, end: usize| i.is_multiple_of(self.lattice) || i + 1 == end;
        let pixels = self.pixels_of_tiles(|_| true);
        pixels.filter(|&(x, y)| on_lattice(x, width) && on_lattice(y, height)).map(|(x, y)| y * width + x).collect()
    }

    /// Interpolated pixels that have their first samples, and what [`Estimate::raise`] said of them: where one was
    /// wrong, those beside it may be.
    pub fn tell_neighbours(&mut self, news: impl Iterator<Item = (usize, f32)>) {
        for (pixel, change) in news {
            for neighbour in neighbours(pixel, self.size) {
                let estimate = &mut self.pixels[neighbour];
                if estimate.level == 0 {
                    estimate.own = estimate.own.max(SURPRISE * change);
                }
            }
        }
    }

    /// Whether pixels without samples have been interpolated.
    pub fn is_interpolated(&self) -> bool {
        !self.cells.is_empty()
    }

    /// Gives the pixels without samples what lies between those of the lattice. `pixels` are sums of samples where there
    /// are any.
    pub fn interpolate(&mut self, pixels: &mut [[f32; 3]]) {
        let ((width, height), lattice) = (self.size, self.lattice);
        let columns = self.cells_per_row();
        let place = |cell: usize, end: usize| (cell * lattice).min(end - 1);
        // A copy of the points of the lattice, so that rows can be written by different threads.
        let corners: Vec<_> = (0..=(height - 1) / lattice + 1)
            .into_par_iter()
            .flat_map_iter(|row| (0..=columns).map(move |column| (column, row)))
            .map(|(column, row)| {
                let pixel = place(row, height) * width + place(column, width);
                mean(pixels[pixel], self.pixels[pixel].level)
            })
            .collect();
        let rows = self.pixels.par_chunks_mut(width).zip(pixels.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (estimates, pixels))| {
            let across_y = part_of(y, y / lattice * lattice, place(y / lattice + 1, height));
            for cell in 0..columns {
                let (x0, x1) = (cell * lattice, place(cell + 1, width));
                let at = y / lattice * (columns + 1) + cell;
                let [a, b, c, d] = [at, at + 1, at + columns + 1, at + columns + 2].map(|i| corners[i]);
                for x in x0..width.min(x0 + lattice) {
                    if estimates[x].level > 0 {
                        continue;
                    }
                    let across_x = part_of(x, x0, x1);
                    pixels[x] = std::array::from_fn(|i| {
                        let upper = (b[i] - a[i]).mul_add(across_x, a[i]);
                        let lower = (d[i] - c[i]).mul_add(across_x, c[i]);
                        (lower - upper).mul_add(across_y, upper)
                    });
                    estimates[x].shown = display_steps(pixels[x]);
                }
            }
        });
        if !self.is_interpolated() {
            self.estimate_cells();
        }
    }

    fn cells_per_row(&self) -> usize {
        (self.size.0 - 1) / self.lattice + 1
    }

    fn estimate_cells(&mut self) {
        let (width, height) = self.size;
        let step = self.lattice;
        let columns = self.cells_per_row();
        let rows = (height - 1) / step + 1;
        let at = |column: isize, row: isize| -> Option<[f32; 3]> {
            if column < 0 || row < 0 || column as usize > columns || row as usize > rows {
                return None;
            }
            let (x, y) = ((column as usize * step).min(width - 1), (row as usize * step).min(height - 1));
            Some(self.pixels[y * width + x].shown)
        };
        let bend = |column: isize, row: isize, dx: isize, dy: isize| -> f32 {
            let ends = at(column - dx, row - dy).zip(at(column + dx, row + dy));
            let (Some((a, c)), Some(b)) = (ends, at(column, row)) else { return 0.0 };
            squared(std::array::from_fn(|i| a[i] - 2.0 * b[i] + c[i]))
        };
        self.cells = (0..rows * columns)
            .into_par_iter()
            .map(|cell| {
                let (column, row) = ((cell % columns) as isize, (cell / columns) as isize);
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let bends = corners.map(|(x, y)| bend(column + x, row + y, 1, 0).max(bend(column + x, row + y, 0, 1)));
                LATTICE_ERROR * bends.into_iter().fold(0.0, f32::max)
            })
            .collect();
    }

    /// Estimates the errors of all pixels anew.
    pub fn update(&mut self) -> Promises {
        let mut errors = std::mem::take(&mut self.errors);
        let mut highest = std::mem::take(&mut self.highest);
        let rows = errors.par_chunks_mut(SIDE * self.size.0).zip(highest.par_chunks_mut(self.columns()));
        let change = rows.enumerate().fold(Promises::default, |mut change, (row, (errors, highest))| {
            for (column, highest) in highest.iter_mut().enumerate() {
                if self.has_news_near(column, row) {
                    *highest = self.update_tile((column, row), errors, &mut change);
                }
            }
            change
        });
        let change = change.reduce(Promises::default, Promises::plus);
        (self.errors, self.highest) = (errors, highest);
        let promises = self.promises.take().unwrap_or_default().plus(change);
        self.promises = Some(promises.clone());
        self.tile_rows().for_each(|row| {
            for column in (0..row.has_news.len()).filter(|&column| row.has_news[column]) {
                let columns = column * SIDE..row.width.min((column + 1) * SIDE);
                let pixels = row.pixels.chunks_mut(row.width).flat_map(|pixels| &mut pixels[columns.clone()]);
                pixels.for_each(|pixel| pixel.is_old = true);
            }
            row.has_news.fill(false);
        });
        promises
    }

    /// Whether a tile, or one of those around it, has pixels that are new.
    fn has_news_near(&self, column: usize, row: usize) -> bool {
        let columns = self.columns();
        let rows = row.saturating_sub(1)..self.size.1.div_ceil(SIDE).min(row + 2);
        let near = column.saturating_sub(1)..columns.min(column + 2);
        rows.into_iter().any(|row| self.has_news[row * columns..][near.clone()].contains(&true))
    }

    /// Estimates the errors in a tile anew, of which `errors` has the row; adds to `change` what is promised more than
    /// before. Returns the highest class.
    fn update_tile(&self, (column, row): (usize, usize), errors: &mut [f32], change: &mut Promises) -> u16 {
        let (width, height) = self.size;
        let (left, top) = (column * SIDE, row * SIDE);
        let columns = left..width.min(left + SIDE);
        // What has changed has changed what is said of its neighbours.
        let near = self.near_news(left, top);
        let is_inside = left > 0 && top > 0 && left + SIDE < width && top + SIDE < height;
        let is_worth_it = near.iter().map(|row| row.count_ones()).sum::<u32>() >= CONTRASTS_TOGETHER;
        let contrasts = (is_inside && is_worth_it).then(|| self.contrasts(left, top));
        let mut highest = 0;
        for y in top..height.min(top + SIDE) {
            for x in columns.clone() {
                let error = &mut errors[(y - top) * width + x];
                let pixel = self.pixels[y * width + x];
                if near[y - top] >> (x - left) & 1 != 0 {
                    if self.promises.is_some() {
                        change.forget(pixel.level - u8::from(!pixel.is_old), *error);
                    }
                    *error = self.estimate(x, y, contrasts.as_ref().map(|rows| rows[y - top][x - left]));
                    change.count(pixel.level, *error);
                }
                highest = highest.max(class(pixel.level, *error).unwrap_or(0));
            }
        }
        highest as u16
    }

    /// Which pixels of a tile are new or beside a new one: a bit for each column in each row.
    fn near_news(&self, left: usize, top: usize) -> [u32; SIDE] {
        let (width, height) = self.size;
        if self.promises.is_none() {
            return [!0; SIDE];
        }
        let columns = left.saturating_sub(1)..width.min(left + SIDE + 1);
        // A bit for each column; that of the one to the left of the tile is the lowest.
        let mut news = [0; SIDE + 2];
        for y in top.saturating_sub(1)..height.min(top + SIDE + 1) {
            for (x, pixel) in columns.clone().zip(&self.pixels[y * width..][columns.clone()]) {
                news[y + 1 - top] |= u32::from(!pixel.is_old) << (x + 1 - left);
            }
        }
        std::array::from_fn(|row| {
            let bits = news[row] | news[row + 1] | news[row + 2];
            bits | bits >> 1 | bits >> 2
        })
    }

    /// [`Estimates::contrast`] of all pixels of a tile that has pixels all around.
    fn contrasts(&self, left: usize, top: usize) -> [[f32; SIDE]; SIDE] {
        // By channel, so that pixels in a row are taken together.
        let mut shown = [[[0.0; SIDE + 2]; SIDE + 2]; 3];
        let rows = self.pixels[(top - 1) * self.size.0..].chunks(self.size.0).take(SIDE + 2);
        for (row, pixels) in rows.enumerate() {
            for (column, pixel) in pixels[left - 1..][..SIDE + 2].iter().enumerate() {
                shown.iter_mut().zip(pixel.shown).for_each(|(shown, value)| shown[row][column] = value);
            }
        }
        // Where the two around a pixel lie, by row and column of `shown`, behind the pixel's own in its tile.
        const AROUND: [[(usize, usize); 2]; 4] =
            [[(1, 0), (1, 2)], [(0, 1), (2, 1)], [(0, 0), (2, 2)], [(0, 2), (2, 0)]];
        let mut contrasts = [[0.0; SIDE]; SIDE];
        for (row, contrasts) in contrasts.iter_mut().enumerate() {
            for [before, after] in AROUND {
                let mut sum = [0.0; SIDE];
                for shown in &shown {
                    let of = |(down, right): (usize, usize)| &shown[row + down][right..][..SIDE];
                    let (a, here, b) = (of(before), of((1, 1)), of(after));
                    for i in 0..SIDE {
                        let bend = a[i] - 2.0 * here[i] + b[i];
                        sum[i] += bend * bend;
                    }
                }
                for i in 0..SIDE {
                    let squared = sum[i] * (1.0 / 3.0);
                    contrasts[i] = if squared > contrasts[i] { squared } else { contrasts[i] };
                }
            }
        }
        contrasts
    }

    /// The squared error of a pixel, whose contrast may be known.
    fn estimate(&self, x: usize, y: usize, contrast: Option<f32>) -> f32 {
        let pixel = y * self.size.0 + x;
        let Estimate { level, own, .. } = self.pixels[pixel];
        if level == 0 {
            let cell = y / self.lattice * self.cells_per_row() + x / self.lattice;
            return own.max(self.cells[cell]);
        }
        let [of_quarters, of_contrast, of_neighbours] = PARTS[usize::from(level)];
        let of_one =
            (of_contrast * contrast.unwrap_or_else(|| self.contrast(x, y))).max(of_neighbours * self.around(x, y));
        (of_quarters * own).max(of_one / edge_samples(level))
    }

    /// The largest squared second difference in the four directions around a pixel.
    fn contrast(&self, x: usize, y: usize) -> f32 {
        let (width, height) = self.size;
        let pixel = y * width + x;
        let shown = |pixel: usize| self.pixels[pixel].shown;
        let here = shown(pixel);
        let bend = |a, b| {
            let (a, b) = (shown(a), shown(b));
            squared(std::array::from_fn(|c| a[c] - 2.0 * here[c] + b[c]))
        };
        let (inner_x, inner_y) = (x > 0 && x + 1 < width, y > 0 && y + 1 < height);
        let across = if inner_x { bend(pixel - 1, pixel + 1) } else { 0.0 };
        let upwards = if inner_y { bend(pixel - width, pixel + width) } else { 0.0 };
        let mut contrast = across.max(upwards);
        if inner_x && inner_y {
            contrast = contrast.max(bend(pixel - width - 1, pixel + width + 1));
            contrast = contrast.max(bend(pixel - width + 1, pixel + width - 1));
        }
        contrast
    }

    /// What the pixels around one turned out to be: the mean squared error that one sample of them would have.
    fn around(&self, x: usize, y: usize) -> f32 {
        let (width, height) = self.size;
        let columns = x.saturating_sub(1)..width.min(x + 2);
        let mut sum = 0.0;
        for row in y.saturating_sub(1)..height.min(y + 2) {
            for column in columns.clone().filter(|&column| (column, row) != (x, y)) {
                let near = &self.pixels[row * width + column];
                if near.level > 1 {
                    sum += near.own * edge_samples(near.level);
                }
            }
        }
        sum / 8.0
    }

    /// The pixels of a choice, in the order in which they are traced.
    pub fn chosen(&self, choice: Choice) -> Vec<usize> {
        let is_chosen = |pixel: &usize| {
            let level = self.pixels[*pixel].level;
            class(level, self.errors[*pixel]).is_some_and(|class| choice.includes(level, class))
        };
        let pixels = self.pixels_of_tiles(|tile| usize::from(self.highest[tile]) >= choice.lowest);
        pixels.map(|(x, y)| y * self.size.0 + x).filter(is_chosen).collect()
    }
}

/// What each new sample of a pixel promises to take away of the squared error: classes, four to a factor of 2. None
/// where there are no more samples, or nothing to take away.
fn class(level: u8, error: f32) -> Option<usize> {
    let worth = NEW_SAMPLES_RECIPROCALS.get(usize::from(level))?;
    (error > 0.0).then(|| (error * worth).to_bits() as usize >> CLASS_SHIFT)
}

/// What is left of the squared error of a picture, and where samples would take how much of it away.
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
    fn count(&mut self, level: u8, error: f32) {
        self.error = self.error.wrapping_add((error * ERROR_UNITS) as u64);
        if let Some(class) = class(level, error) {
            let count = &mut self.pixels[usize::from(level) * CLASSES + class];
            *count = count.wrapping_add(1);
        }
    }

    /// The opposite of [`Promises::count`].
    fn forget(&mut self, level: u8, error: f32) {
        self.error = self.error.wrapping_sub((error * ERROR_UNITS) as u64);
        if let Some(class) = class(level, error) {
            let count = &mut self.pixels[usize::from(level) * CLASSES + class];
            *count = count.wrapping_sub(1);
        }
    }

    fn plus(mut self, other: Promises) -> Promises {
        self.error = self.error.wrapping_add(other.error);
        self.pixels.iter_mut().zip(other.pixels).for_each(|(count, more)| *count = count.wrapping_add(more));
        self
    }

    /// The sum of the squared errors of all pixels.
    pub fn squared_error(&self) -> f64 {
        self.error as f64 / f64::from(ERROR_UNITS)
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
        let squared = self.squared_error();
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

/// Pixels that are to have more samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// The lowest class; 1 or more.
    pub lowest: usize,
    /// Whether those that have samples are left out.
    pub only_interpolated: bool,
}

impl Choice {
    fn includes(self, level: u8, class: usize) -> bool {
        class >= self.lowest && (level == 0 || !self.only_interpolated)
    }
}

/// How many samples bring a pixel from this level to the next.
const fn new_samples(level: usize) -> u32 {
    LEVEL_SAMPLES[level + 1] - LEVEL_SAMPLES[level]
}

/// 1 / [`new_samples`].
const NEW_SAMPLES_RECIPROCALS: [f32; LAST_LEVEL as usize] = {
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
/// What an interpolated pixel's squared error may be, as a part of the square of what was wrong with one beside it.
const SURPRISE: f32 = 0.25;
/// Units of a squared error of 1: in pictures of 2^28 pixels errors of 255 steps in all of them can be counted.
const ERROR_UNITS: f32 = (1 << 20) as f32;
/// Bits of a float below those that name its class.
const CLASS_SHIFT: u32 = 21;
/// From one level to the next a squared error goes down to an eighth, and each of four times the samples takes a part
/// of that away.
const CLASSES_OF_LEVEL: usize = 4 * 5;
const CLASSES: usize = 1 << (31 - CLASS_SHIFT);
/// Levels and classes of pixels that can have more samples.
pub const COUNTED: usize = LAST_LEVEL as usize * CLASSES;

/// What `cl/kernels/adaptive.cl` has of the constants of this file.
pub fn cl_constants() -> String {
    let list = |values: &[f32]| values.iter().map(|value| format!("{value:?}f")).collect::<Vec<_>>().join(", ");
    let parts = PARTS.map(|parts| format!("{{{}}}", list(&parts))).join(", ");
    format!(
        "#define CURVE_INTERVALS {CURVE_INTERVALS}u\n\
         #define LATTICE_ERROR {LATTICE_ERROR:?}f\n\
         #define SURPRISE {SURPRISE:?}f\n\
         #define ERROR_UNITS {ERROR_UNITS:?}f\n\
         #define CLASS_SHIFT {CLASS_SHIFT}u\n\
         #define CLASSES {CLASSES}u\n\
         #define LAST_LEVEL {LAST_LEVEL}u\n\
         __constant uint LEVEL_SAMPLES[] = {{{}}};\n\
         __constant float NEW_SAMPLES_RECIPROCALS[] = {{{}}};\n\
         __constant float PARTS[][3] = {{{parts}}};\n",
        LEVEL_SAMPLES.map(|samples| format!("{samples}u")).join(", "),
        list(&NEW_SAMPLES_RECIPROCALS),
    )
}

/// n^1.5 of the samples n = 4^(level - 1) of a level that has some.
fn edge_samples(level: u8) -> f32 {
    (1 << (3 * (level - 1))) as f32
}

/// What a pixel of a level shows: the mean of its samples, or, without any, what it was interpolated to be.
pub fn mean(sum: [f32; 3], level: u8) -> [f32; 3] {
    mean_of(sum, LEVEL_SAMPLES[usize::from(level)].max(1) as usize)
}

/// The mean of so many samples.
pub fn mean_of(sum: [f32; 3], samples: usize) -> [f32; 3] {
    let part = 1.0 / samples as f32;
    sum.map(|sum| sum * part)
}

/// How far `i` is from `low` to `high`.
fn part_of(i: usize, low: usize, high: usize) -> f32 {
    if high > low { (i - low) as f32 / (high - low) as f32 } else { 0.0 }
}

/// The pixels around one.
fn neighbours(pixel: usize, (width, height): (usize, usize)) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let rows = y.saturating_sub(1)..height.min(y + 2);
    rows.flat_map(move |row| (x.saturating_sub(1)..width.min(x + 2)).map(move |column| row * width + column))
        .filter(move |&near| near != pixel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn colour(random: &mut Random) -> [f32; 3] {
        // Most pixels are like their neighbours.
        if random.below(8) > 0 { [0.25; 3] } else { std::array::from_fn(|_| random.unit()) }
    }

    /// Raises some pixels, one in so many.
    fn raise(estimates: &mut Estimates, one_in: usize, random: &mut Random) {
        let (width, last) = (estimates.size.0, LAST_LEVEL);
        let count = estimates.pixels.len();
        let mut wanted: Vec<bool> = (0..count).map(|_| random.below(one_in) == 0).collect();
        wanted.iter_mut().zip(&estimates.pixels).for_each(|(wanted, pixel)| *wanted &= pixel.level < last);
        let values: Vec<_> = (0..count).map(|_| (display_steps(colour(random)), 30.0 * random.unit())).collect();
        let news: Vec<_> = estimates
            .tile_rows()
            .enumerate()
            .flat_map_iter(|(row, mut pixels)| {
                let first = row * SIDE * width;
                let end = count.min(first + SIDE * width);
                let of_row: Vec<_> = (first..end)
                    .filter(|&i| wanted[i])
                    .filter_map(|i| Some((i, pixels.raise(i - first, values[i].0, values[i].1)?)))
                    .collect();
                of_row
            })
            .collect();
        estimates.tell_neighbours(news.into_iter());
    }

    /// What `update` must return: everything counted anew.
    fn promises(estimates: &Estimates) -> Promises {
        let mut all = Promises::default();
        for (pixel, estimate) in estimates.pixels.iter().enumerate() {
            let (x, y) = (pixel % estimates.size.0, pixel / estimates.size.0);
            let error = estimates.estimate(x, y, None);
            assert_eq!(error.to_bits(), estimates.errors[pixel].to_bits(), "pixel {x}, {y} of {:?}", estimates.size);
            all.count(estimate.level, error);
        }
        all
    }

    #[test]
    fn what_is_updated_is_what_is_counted_anew() {
        let mut random = Random::new(5);
        for (size, lattice) in [((1, 1), 1), ((7, 9), 1), ((8, 8), 2), ((33, 50), 1), ((64, 40), 4), ((71, 35), 2)] {
            let mut estimates = Estimates::new(size, lattice);
            let first = estimates.pixels_of_lattice();
            let width = size.0;
            for &pixel in &first {
                let shown = display_steps(colour(&mut random));
                let (row, at) = (pixel / (SIDE * width), pixel % (SIDE * width));
                let mut rows: Vec<_> = estimates.tile_rows().collect();
                rows[row].raise(at, shown, 0.0);
            }
            if lattice > 1 {
                estimates.interpolate(&mut vec![[0.3; 3]; size.0 * size.1]);
            }
            for one_in in [1, 3, 20, 200, 2000, 2, 1] {
                let updated = estimates.update();
                assert!(updated == promises(&estimates), "{size:?}, lattice {lattice}");
                // All of a choice are found, tile by tile.
                let choice = updated.choose(0.3 * updated.squared_error(), 1);
                let chosen = estimates.chosen(choice);
                assert_eq!(chosen.len() as u64, updated.chosen(choice).iter().sum::<u64>());
                raise(&mut estimates, one_in, &mut random);
            }
        }
    }
}
