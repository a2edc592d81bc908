//! Rows of an image among the rays of a batch. Camera rays mostly come row by row; sixteen that are traced together are
//! better a square than a piece of a row: packets trace bunny's at 1.4 times the speed. So kernels take whole bands of
//! [`TILE_SIDE`] rows tile by tile (`cl/traverse/batch.cl`). Every ray is traced as it is, and its hit goes where the
//! caller's ray was: only the order changes.

use crate::shared::{TILE_SIDE, TraceRay};
use std::ops::RangeInclusive;

/// Rows shorter than this gain nothing, and no image has longer ones than this.
const LENGTHS: RangeInclusive<usize> = 32..=1 << 14;
/// How many rays are asked where the row below them is.
const ASKED: usize = 8;
/// So many of them must say the same: rays may be those of an image that hit something, of which only some rows are
/// whole.
const AGREE: usize = 7;
/// Two rays are neighbours if they are at most so many times as far from each other as two in a row: pixels need not be
/// squares.
const NEIGHBOURS: f32 = 3.0;

/// The rows of a batch, as kernels take them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Rows {
    /// Rays of a row, a multiple of [`TILE_SIDE`]; 0 if there are no rows.
    pub length: u32,
    /// Rays of all whole bands, with which the batch begins.
    pub in_bands: u32,
}

impl Rows {
    /// Finds the rows of `rays`. Of long rows that takes half a millisecond.
    pub fn find(rays: &[TraceRay]) -> Rows {
        let lengths: Vec<usize> = asked(rays).filter_map(|from| length_below(rays, from, LENGTHS)).collect();
        let votes = |length: &usize| lengths.iter().filter(|&other| other == length).count();
        let most = lengths.iter().copied().max_by_key(votes);
        let is_good = |length: &usize| length.is_multiple_of(TILE_SIDE as usize) && votes(length) >= AGREE;
        most.filter(is_good).map_or(Rows::default(), |length| Rows::of_length(rays, length))
    }

    /// The same of rays that come after others with such rows: if theirs are as long, that is seen in microseconds.
    pub fn find_after(self, rays: &[TraceRay]) -> Rows {
        let length = self.length as usize;
        let near = length.saturating_sub(2 * NEIGHBOURS as usize)..=length;
        let agree = |&from: &usize| length_below(rays, from, near.clone()) == Some(length);
        let are_as_long = length > 0 && asked(rays).filter(agree).count() >= AGREE;
        if are_as_long { Rows::of_length(rays, length) } else { Rows::find(rays) }
    }

    fn of_length(rays: &[TraceRay], length: usize) -> Rows {
        let band = TILE_SIDE as usize * length;
        Rows { length: length as u32, in_bands: (rays.len() / band * band) as u32 }
    }
}

/// The rays that are asked.
fn asked(rays: &[TraceRay]) -> impl Iterator<Item = usize> {
    let count = rays.len();
    (0..ASKED).map(move |i| count * (2 * i + 1) / (2 * ASKED))
}

/// How far two rays are from each other: squares of the distances of their origins and of their unit directions.
fn distances(a: &TraceRay, b: &TraceRay) -> [f32; 2] {
    let direction = |ray: &TraceRay| ray.direction_t_max.xyz().normalize_or_zero();
    [a.origin_t_min.xyz().distance_squared(b.origin_t_min.xyz()), direction(a).distance_squared(direction(b))]
}

/// After how many rays there is one beside ray `from` that is no neighbour in its row, if the row is even there: the
/// row's length, if it is one of `lengths` or little more.
fn length_below(rays: &[TraceRay], from: usize, lengths: RangeInclusive<usize>) -> Option<usize> {
    let ray = rays.get(from)?;
    let to = |offset: usize| rays.get(from + offset).map(|other| distances(ray, other));
    let [one, eight] = [to(1)?, to(8)?];
    // In an even row the eighth ray is eight times as far as the first, by origin, by direction, or both.
    let is_even = |i: usize| eight[i] == 0.0 && one[i] == 0.0 || (16.0 * one[i]..=256.0 * one[i]).contains(&eight[i]);
    if !(is_even(0) && is_even(1)) || one == [0.0; 2] {
        return None;
    }
    let is_near = |d: &[f32; 2]| (0..2).all(|i| d[i] <= NEIGHBOURS * NEIGHBOURS * one[i]);
    let first = lengths.into_iter().find(|&offset| to(offset).is_none_or(|d| is_near(&d)))?;
    // The nearest of those beside it.
    let sum = |d: [f32; 2]| (0..2).filter(|&i| one[i] > 0.0).map(|i| d[i] / one[i]).sum::<f32>();
    let candidates = (first..first + 2 * NEIGHBOURS as usize).filter_map(|offset| Some((offset, sum(to(offset)?))));
    candidates.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(offset, _)| offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Float4;
    use glam::Vec3;
    use rand_xoshiro::Xoshiro128PlusPlus;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    fn ray(origin: Vec3, direction: Vec3) -> TraceRay {
        TraceRay { origin_t_min: Float4::new(origin, 0.0), direction_t_max: Float4::new(direction, f32::INFINITY) }
    }

    /// Camera rays of a picture, row by row, of which pixels are `aspect` times as high as wide.
    fn camera(width: usize, height: usize, aspect: f32) -> Vec<TraceRay> {
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f32 / width as f32 - 0.5, (i / width) as f32 * aspect / width as f32 - 0.3);
            ray(Vec3::new(1.0, 2.0, 3.0), Vec3::new(x, y, 1.0))
        };
        (0..width * height).map(pixel).collect()
    }

    #[test]
    fn rows_of_pictures_are_found() {
        for (width, height, aspect) in
            [(64, 64, 1.0), (1920, 108, 1.0), (1024, 1024, 1.0), (800, 600, 1.8), (320, 97, 0.6)]
        {
            let rows = Rows::find(&camera(width, height, aspect));
            let in_bands = (height / 8 * 8 * width) as u32;
            assert_eq!(rows, Rows { length: width as u32, in_bands }, "{width} x {height}, {aspect}");
        }
        // Parallel rays from a plane.
        let parallel: Vec<_> =
            (0..128 * 100).map(|i| ray(Vec3::new((i % 128) as f32, (i / 128) as f32, 0.0), Vec3::Z)).collect();
        assert_eq!(Rows::find(&parallel), Rows { length: 128, in_bands: 128 * 96 });
    }

    #[test]
    fn rows_are_found_after_others() {
        let (rays, others) = (camera(1920, 108, 1.0), camera(800, 600, 1.8));
        let [rows, of_others] = [&rays, &others].map(|rays| Rows::find(rays));
        // From the middle of a row on, as parts of a batch begin.
        let later = &rays[4 * 1920 + 777..];
        assert_eq!(
            rows.find_after(later),
            Rows { length: 1920, in_bands: (later.len() / (8 * 1920) * 8 * 1920) as u32 }
        );
        assert_eq!(rows.find_after(&others), of_others);
        assert_eq!(of_others.find_after(&rays), rows);
        assert_eq!(Rows::default().find_after(&rays), rows);
        let same = vec![rays[0]; 4096];
        assert_eq!(rows.find_after(&same), Rows::default());
        assert_eq!(rows.find_after(&[]), Rows::default());
    }

    #[test]
    fn what_has_no_rows_has_none() {
        let none = Rows::default();
        let mut rays = camera(100, 100, 1.0); // no multiple of a tile's side
        assert_eq!(Rows::find(&rays), none);
        rays = camera(64, 64, 1.0);
        // Tile by tile already.
        let tiled: Vec<_> =
            (0..64 * 64).map(|i| rays[(i / 512 * 8 + i % 64 / 8) * 64 + i / 64 % 8 * 8 + i % 8]).collect();
        assert_eq!(Rows::find(&tiled), none);
        // In no order. A simple multiple of the number would have rows.
        let mut random = Xoshiro128PlusPlus::seed_from_u64(1);
        rays.sort_by_cached_key(|_| random.next_u32());
        assert_eq!(Rows::find(&rays), none);
        let same = vec![rays[0]; 4096];
        assert_eq!(Rows::find(&same), none);
        let nonsense = vec![ray(Vec3::NAN, Vec3::INFINITY); 4096];
        assert_eq!(Rows::find(&nonsense), none);
        for count in [0, 1, 15, 16, 17] {
            assert_eq!(Rows::find(&rays[..count]), none);
        }
    }
}
