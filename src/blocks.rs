//! Which pixels of a picture are decided about together: those of a block, and of none other.
//!
//! A picture is cut into areas, each of which is decided about as if it were a picture, and an area into square
//! patches, which are dealt out to its blocks: a block has patches from all over its area. Where the first samples lie
//! apart, what lies between is found by following it from pixel to pixel, which ends at a patch's border: there
//! patches, and with them blocks, are larger. What is decided about a block depends on the scene, the options and its
//! pixels alone, and on the first samples beside its patches. So the same pixels come out whoever renders the blocks of
//! a picture, together or one by one.
//!
//! Every block is refined until its own error is small enough. Blocks of pixels that lie together, such as squares,
//! took 15 to 24 % more rays for it than one picture as a whole (1920 x 1080, error 1: bunny, snowflake, showcase),
//! because samples had to go where they help least; blocks that are dealt out like this are all alike, and took at most
//! 1.2 % more on ten scenes.
//!
//! Bad at: pictures of few patches, of whose blocks one may have all that is difficult.

use std::ops::Range;

/// Pixels of a patch's side where every pixel has a first sample; a multiple of
/// [`TILE_SIDE`](crate::shared::TILE_SIDE). Other patches have a multiple of it.
pub const PATCH_SIDE: usize = 32;
/// The largest lattice for which patches grow: with patches of 32 pixels a picture of a cow, 48 x 48 with a lattice of
/// 4, was off by 6.2 steps where 4 were asked for.
const LARGEST_STEP: usize = 4;
/// Pixels of the largest patch's side.
pub const LARGEST_PATCH: usize = PATCH_SIDE * LARGEST_STEP;
/// About so many pixels has an area's side. What is known of the pixels of an area is kept together.
const AREA_SIDE: usize = 2048;
/// About so many pixels has a block of the smallest patches: the errors of fewer differ more from block to block.
const BLOCK_PIXELS: usize = 1 << 17;

/// The areas and blocks of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Blocks {
    size: (usize, usize),
    /// Pixels of a patch's side.
    pub patch_side: usize,
    /// Width and height of all areas but the last in a row or column, which may be smaller.
    pub area: (usize, usize),
    /// Blocks of an area.
    pub per_area: usize,
    /// A patch lies so many blocks behind the one above it, and one behind the one to the left.
    pub stride: usize,
}

/// An area, in pixels of the picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Area {
    /// Its columns.
    pub x: Range<usize>,
    /// Its rows.
    pub y: Range<usize>,
}

impl Area {
    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        (self.x.len(), self.y.len())
    }

    /// Whether both have a pixel in common.
    pub fn meets(&self, other: &Area) -> bool {
        self.within(other).is_some()
    }

    /// What both have in common, if anything.
    pub fn within(&self, other: &Area) -> Option<Area> {
        let common = |a: &Range<usize>, b: &Range<usize>| a.start.max(b.start)..a.end.min(b.end);
        let area = Area { x: common(&self.x, &other.x), y: common(&self.y, &other.y) };
        (!area.x.is_empty() && !area.y.is_empty()).then_some(area)
    }

    /// Whether it has the pixel in this column and row.
    pub fn has(&self, x: usize, y: usize) -> bool {
        self.x.contains(&x) && self.y.contains(&y)
    }

    /// The same in pixels from this one of the picture on, which is no farther right or below than its first.
    #[must_use]
    pub fn seen_from(&self, (x, y): (usize, usize)) -> Area {
        Area { x: self.x.start - x..self.x.end - x, y: self.y.start - y..self.y.end - y }
    }

    /// How many patches of a side lie in a row, and in a column.
    pub fn patches(&self, side: usize) -> (usize, usize) {
        (self.x.len().div_ceil(side), self.y.len().div_ceil(side))
    }

    /// The patch of this number, row by row.
    pub fn patch(&self, number: usize, side: usize) -> Area {
        let columns = self.patches(side).0;
        let part = |of: &Range<usize>, i: usize| {
            let first = of.start + i * side;
            first..of.end.min(first + side)
        };
        Area { x: part(&self.x, number % columns), y: part(&self.y, number / columns) }
    }
}

impl Blocks {
    /// Of a picture of this size, whose first samples lie so many pixels apart.
    pub fn new(size: (usize, usize), lattice: usize) -> Blocks {
        let growth = lattice.max(1).next_power_of_two().min(LARGEST_STEP);
        let side = |pixels: usize| {
            let areas = ((pixels + AREA_SIDE / 2) / AREA_SIDE).max(1);
            pixels.div_ceil(areas).next_multiple_of(LARGEST_PATCH)
        };
        let area = (side(size.0), side(size.1));
        let pixels = area.0.min(size.0) * area.1.min(size.1);
        let of_block = BLOCK_PIXELS * growth * growth;
        let per_area = ((pixels + of_block / 2) / of_block).max(1);
        Blocks { size, patch_side: PATCH_SIDE * growth, area, per_area, stride: stride_of(per_area) }
    }

    /// How many areas lie in a row, and in a column.
    fn areas_across_and_down(&self) -> (usize, usize) {
        (self.size.0.div_ceil(self.area.0), self.size.1.div_ceil(self.area.1))
    }

    /// How many areas there are.
    pub fn areas(&self) -> usize {
        let (across, down) = self.areas_across_and_down();
        across * down
    }

    /// The area of this number, row by row.
    pub fn area(&self, number: usize) -> Area {
        let columns = self.areas_across_and_down().0;
        let part = |i: usize, side: usize, end: usize| i * side..end.min((i + 1) * side);
        Area {
            x: part(number % columns, self.area.0, self.size.0),
            y: part(number / columns, self.area.1, self.size.1),
        }
    }

    /// The block, among those of its area, of the patch in this column and row of the area.
    pub fn block_of(&self, column: usize, row: usize) -> usize {
        (column + row * self.stride) % self.per_area
    }

    /// The blocks of an area that have a pixel in `part` of the picture, in ascending order: all of them where all of
    /// the area lies in it, also those of a small area that have no pixels.
    pub fn blocks_in(&self, area: usize, part: &Area) -> Vec<usize> {
        let (first, place) = (area * self.per_area, self.area(area));
        let Some(common) = place.within(part) else { return Vec::new() };
        if common == place {
            return (first..first + self.per_area).collect();
        }
        let patches = |common: &Range<usize>, start: usize| {
            (common.start - start) / self.patch_side..(common.end - start).div_ceil(self.patch_side)
        };
        let (columns, rows) = (patches(&common.x, place.x.start), patches(&common.y, place.y.start));
        let (mut is_in, mut count) = (vec![false; self.per_area], 0);
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            count += usize::from(!std::mem::replace(&mut is_in[self.block_of(column, row)], true));
            if count == self.per_area {
                break; // of large parts the first patches are in all blocks
            }
        }
        (0..self.per_area).filter(|&block| is_in[block]).map(|block| first + block).collect()
    }

    /// The blocks that have a pixel in `part` of the picture, in ascending order.
    pub fn of_part(&self, part: &Area) -> Vec<usize> {
        (0..self.areas()).flat_map(|area| self.blocks_in(area, part)).collect()
    }

    /// How many blocks there are. They are numbered area after area.
    pub fn count(&self) -> usize {
        self.areas() * self.per_area
    }

    /// The blocks of an area alone, as if it were a picture.
    #[must_use]
    pub fn of_area(&self, number: usize) -> Blocks {
        Blocks { size: self.area(number).size(), ..*self }
    }

    /// Where the pixels of a block lie in the picture: its patches, one after the other.
    pub fn places(&self, block: usize) -> Vec<Area> {
        let area = self.area(block / self.per_area);
        let (columns, rows) = area.patches(self.patch_side);
        let is_in = |patch: &usize| self.block_of(patch % columns, patch / columns) == block % self.per_area;
        (0..columns * rows).filter(is_in).map(|patch| area.patch(patch, self.patch_side)).collect()
    }

    /// The patches of each block of an area.
    pub fn patches_of(&self, area: &Area) -> Vec<Vec<usize>> {
        let (columns, rows) = area.patches(self.patch_side);
        let mut blocks = vec![Vec::new(); self.per_area];
        for number in 0..columns * rows {
            blocks[self.block_of(number % columns, number / columns)].push(number);
        }
        blocks
    }

    /// How many pixels each block has, area after area.
    pub fn pixels(&self) -> Vec<u64> {
        let of_area = |number| {
            let area = self.area(number);
            let pixels = |patch: &usize| {
                let (width, height) = area.patch(*patch, self.patch_side).size();
                (width * height) as u64
            };
            let of_block = move |patches: Vec<usize>| patches.iter().map(pixels).sum::<u64>();
            self.patches_of(&self.area(number)).into_iter().map(of_block).collect::<Vec<u64>>()
        };
        (0..self.areas()).flat_map(of_area).collect()
    }
}

/// So far each row of patches is shifted against the one above, that those of a block lie far from each other in every
/// direction: by the part of all that the golden section leaves, and so that every block comes to every column.
fn stride_of(blocks: usize) -> usize {
    const PART: f64 = 0.381_966;
    let wanted = PART * blocks as f64;
    let candidates = (1..=blocks).filter(|&stride| greatest_common_divisor(stride, blocks) == 1);
    let distance = |stride: usize| (stride as f64 - wanted).abs();
    candidates.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(1)
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_in_one_area_one_patch_and_one_block() {
        for size in [(1, 1), (33, 31), (1920, 1080), (3100, 40), (40, 5200), (4096, 4096), (65535, 32)] {
            let blocks = Blocks::new(size, 2);
            let mut pixels = 0;
            for number in 0..blocks.areas() {
                let area = blocks.area(number);
                let (width, height) = area.size();
                assert!(width > 0 && height > 0, "{size:?}");
                assert!(area.x.start.is_multiple_of(LARGEST_PATCH) && area.y.start.is_multiple_of(LARGEST_PATCH));
                assert!(width.max(height) < AREA_SIDE / 2 * 3 + LARGEST_PATCH, "{size:?}: {width} x {height}");
                let mut patches: Vec<usize> = blocks.patches_of(&area).concat();
                patches.sort_unstable();
                let side = blocks.patch_side;
                let (across, down) = area.patches(side);
                assert!(patches.into_iter().eq(0..across * down));
                let of_patch = |number| area.patch(number, side).size();
                let sizes = (0..across * down).map(of_patch);
                let sum: usize = sizes.map(|(width, height)| width * height).sum();
                assert_eq!(sum, width * height);
                pixels += sum;
            }
            assert_eq!(pixels, size.0 * size.1, "{size:?}");
            assert_eq!(blocks.pixels().iter().sum::<u64>(), pixels as u64);
            assert_eq!(blocks.pixels().len(), blocks.areas() * blocks.per_area);
        }
    }

    #[test]
    fn blocks_are_alike() {
        let blocks = Blocks::new((1920, 1080), 1);
        assert_eq!((blocks.areas(), blocks.per_area), (1, 16));
        let area = blocks.area(0);
        let (columns, _) = area.patches(blocks.patch_side);
        for patches in blocks.patches_of(&area) {
            // A sixteenth of every quarter of the picture, to a patch or two.
            for quarter in 0..4 {
                let is_in = |patch: &&usize| {
                    let (right, low) = (*patch % columns >= 30, *patch / columns >= 17);
                    usize::from(right) + 2 * usize::from(low) == quarter
                };
                let count = patches.iter().filter(is_in).count();
                assert!((29..=34).contains(&count), "{count} of 510");
            }
        }
    }

    #[test]
    fn coarse_pictures_have_larger_patches_and_fewer_blocks() {
        let of = |lattice| {
            let blocks = Blocks::new((1920, 1080), lattice);
            (blocks.patch_side, blocks.per_area)
        };
        assert_eq!([0, 1, 2, 3, 4, 8].map(of), [(32, 16), (32, 16), (64, 4), (128, 1), (128, 1), (128, 1)]);
    }

    #[test]
    fn strides_have_no_divisor_in_common_with_the_number_of_blocks() {
        assert_eq!([1, 2, 3, 8, 16, 32, 72].map(stride_of), [1, 1, 1, 3, 7, 13, 29]);
    }
}
