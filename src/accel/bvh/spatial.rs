//! Splits of space: triangles that cross a plane are cut at it, and each side of it gets the part that is there.
//!
//! Stich, Friedrich and Dietrich, "Spatial Splits in Bounding Volume Hierarchies", High Performance Graphics 2009,
//! sections 4.1 to 4.4. Planes are those between bins of the node's box. A triangle that is cheaper as a whole stays
//! whole on one side ("unsplitting").
//!
//! What bins hold are estimates: a triangle's edges between two planes, within the box that it has in the node. Of the
//! plane that is taken the parts are those of [`clip`](crate::accel::clip), which lose no point: every point of the
//! triangle in the box of an item is in the box of a part.
//!
//! Bad at: triangles that are small for their nodes, of which few are cut, but all are looked at.

use super::bins::{BINS, bin_of};
use super::items::{Bounds, CHUNK, Item, PARALLEL_ITEMS};
use crate::accel::subtree::Cell;
use crate::parallel;
use glam::{Vec3, Vec3A, Vec4};

/// Cuts of one task.
const CUTS_OF_TASK: usize = 256;

/// A plane, and what is on its two sides when every triangle that crosses it is cut.
pub(super) struct SpatialSplit {
    axis: usize,
    plane: f32,
    low: Side,
    high: Side,
}

/// Some items, and the box around them.
#[derive(Clone, Copy)]
struct Side {
    bounds: Bounds,
    count: usize,
}

impl Side {
    const EMPTY: Side = Side { bounds: Bounds::EMPTY, count: 0 };

    fn with(self, bounds: Bounds, count: usize) -> Side {
        Side { bounds: self.bounds.union(bounds), count: self.count + count }
    }

    fn cost(&self) -> f64 {
        self.bounds.half_area() * self.count as f64
    }
}

/// The items between two planes.
#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    /// How many items begin here, and how many end.
    first: u32,
    last: u32,
}

type Bins = [[Bin; BINS]; 3];

const NO_BINS: Bins = [[Bin { bounds: Bounds::EMPTY, first: 0, last: 0 }; BINS]; 3];

/// How an item is divided.
enum Division {
    Low(Item),
    High(Item),
    Cut([Item; 2]),
}

impl SpatialSplit {
    /// The cheapest plane through `bounds`, the box around `items`, that cuts at most `most_cuts` of them; `None` when
    /// there is none.
    pub fn best(vertices: &[[Vec3; 3]], items: &[Item], bounds: &Bounds, most_cuts: usize) -> Option<SpatialSplit> {
        let planes = Planes::new(bounds);
        let fill = |items: &[Item]| planes.fill(vertices, items);
        let bins = match items.len() >= PARALLEL_ITEMS {
            true => parallel::map(items.chunks(CHUNK), fill).into_iter().fold(NO_BINS, merge),
            false => fill(items),
        };
        let mut best: Option<(f64, SpatialSplit)> = None;
        for (axis, bins) in bins.iter().enumerate().filter(|(axis, _)| planes.are_across(*axis)) {
            let mut highs = [Side::EMPTY; BINS];
            let mut high = Side::EMPTY;
            for bin in (1..BINS).rev() {
                high = high.with(bins[bin].bounds, bins[bin].last as usize);
                highs[bin] = high;
            }
            let mut low = Side::EMPTY;
            for bin in 1..BINS {
                low = low.with(bins[bin - 1].bounds, bins[bin - 1].first as usize);
                let (high, plane) = (highs[bin], planes.at[axis][bin]);
                // Items reach both faces of the box: a plane between them has some on both sides.
                let is_between = bounds.low[axis] < plane && plane < bounds.high[axis];
                let cost = low.cost() + high.cost();
                if is_between
                    && low.count + high.count <= items.len() + most_cuts
                    && best.as_ref().is_none_or(|best| cost < best.0)
                {
                    best = Some((cost, SpatialSplit { axis, plane, low, high }));
                }
            }
        }
        best.map(|(_, split)| split)
    }

    /// Half areas of the two sides, each times the items in it.
    pub fn cost(&self) -> f64 {
        self.low.cost() + self.high.cost()
    }

    /// Divides `items`: those of the lower side stay in front, and those of the upper one are returned. Neither side is
    /// empty.
    pub fn apply(&self, vertices: &[[Vec3; 3]], items: &mut [Item]) -> (usize, Vec<Item>) {
        let crossing: Vec<_> = items.iter().filter(|item| self.crosses(item)).copied().collect();
        let of_few = |few: &[Item]| few.iter().map(|item| self.parts(vertices, item)).collect::<Vec<_>>();
        let parts = parallel::map(crossing.chunks(CUTS_OF_TASK), of_few);
        let (mut low, mut high) = (self.low, self.high);
        let mut parts = parts.into_iter().flatten();
        let mut low_count = 0;
        let mut high_items = Vec::with_capacity(self.high.count);
        for i in 0..items.len() {
            let item = items[i];
            let division = if self.crosses(&item) {
                let parts = parts.next().expect("there are parts of each");
                divide(&item, parts, &mut low, &mut high)
            } else if item.bounds().low[self.axis] < self.plane {
                Division::Low(item)
            } else {
                Division::High(item)
            };
            let (kept, moved) = match division {
                Division::Low(item) => (Some(item), None),
                Division::High(item) => (None, Some(item)),
                Division::Cut([low, high]) => (Some(low), Some(high)),
            };
            if let Some(kept) = kept {
                items[low_count] = kept;
                low_count += 1;
            }
            high_items.extend(moved);
        }
        (low_count, high_items)
    }

    fn crosses(&self, item: &Item) -> bool {
        let Bounds { low, high } = item.bounds();
        low[self.axis] < self.plane && self.plane < high[self.axis]
    }

    /// The parts of an item that crosses the plane.
    fn parts(&self, vertices: &[[Vec3; 3]], item: &Item) -> [Item; 2] {
        let whole = item.to_part();
        let cell = Cell { low: whole.low, high: whole.high };
        let (low, high) = whole.split(vertices, &cell, self.axis, self.plane);
        // Where rounding leaves nothing of a side its part of the box will do: both sides have been counted.
        let (mut low_box, mut high_box) = (whole, whole);
        low_box.high[self.axis] = self.plane;
        high_box.low[self.axis] = self.plane;
        [low.unwrap_or(low_box), high.unwrap_or(high_box)].map(|part| Item::of_part(&part))
    }
}

/// Cuts an item, or leaves it whole on one side where that costs no more: section 4.4. Keeps account of what is on the
/// two sides.
fn divide(item: &Item, parts: [Item; 2], low: &mut Side, high: &mut Side) -> Division {
    let whole = item.bounds();
    let whole_low = (low.with(whole, 0), Side { count: high.count - 1, ..*high });
    let whole_high = (Side { count: low.count - 1, ..*low }, high.with(whole, 0));
    let cost = |sides: &(Side, Side)| match sides.0.count.min(sides.1.count) {
        0 => f64::INFINITY,
        _ => sides.0.cost() + sides.1.cost(),
    };
    let (division, sides) = match cost(&whole_low) <= cost(&whole_high) {
        true => (Division::Low(*item), whole_low),
        false => (Division::High(*item), whole_high),
    };
    if cost(&sides) <= low.cost() + high.cost() {
        (*low, *high) = sides;
        return division;
    }
    Division::Cut(parts)
}

fn merge(mut a: Bins, b: Bins) -> Bins {
    for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
        a.bounds = a.bounds.union(b.bounds);
        a.first += b.first;
        a.last += b.last;
    }
    a
}

/// Where bins begin and end.
struct Planes {
    low: Vec4,
    scale: Vec4,
    at: [[f32; BINS + 1]; 3],
}

impl Planes {
    fn new(bounds: &Bounds) -> Planes {
        let spread = bounds.high - bounds.low;
        let at = |axis: usize| {
            let plane = |i: usize| (spread[axis] * (i as f32 / BINS as f32) + bounds.low[axis]).min(bounds.high[axis]);
            std::array::from_fn(plane)
        };
        Planes { low: bounds.low, scale: super::bins::scale(spread), at: [at(0), at(1), at(2)] }
    }

    /// Whether there are any across an axis: the box is not flat there, nor so large that float32 does not know its
    /// length.
    fn are_across(&self, axis: usize) -> bool {
        self.scale[axis] > 0.0
    }

    fn fill(&self, vertices: &[[Vec3; 3]], items: &[Item]) -> Bins {
        let mut bins = NO_BINS;
        for item in items {
            let bounds = item.bounds();
            let (lows, highs) = ((bounds.low - self.low) * self.scale, (bounds.high - self.low) * self.scale);
            for axis in (0..3).filter(|&axis| self.are_across(axis)) {
                let (first, last) = self.range(axis, &bounds, [lows[axis], highs[axis]].map(bin_of));
                let bins = &mut bins[axis];
                bins[first].first += 1;
                bins[last].last += 1;
                if first == last {
                    bins[first].bounds = bins[first].bounds.union(bounds);
                    continue;
                }
                let edges = Edges::new(&vertices[item.triangle() as usize], axis);
                for (bin, number) in bins[first..=last].iter_mut().zip(first..) {
                    let low = if number == first { bounds.low[axis] } else { self.at[axis][number] };
                    let high = if number == last { bounds.high[axis] } else { self.at[axis][number + 1] };
                    let part = edges.between(low, high).intersection(bounds);
                    if !part.is_empty() {
                        bin.bounds = bin.bounds.union(part);
                    }
                }
            }
        }
        bins
    }

    /// The bins of an item, of which `guess` is right but for roundings: it crosses just the planes between these, and
    /// one that ends at a plane is below it.
    fn range(&self, axis: usize, bounds: &Bounds, guess: [usize; 2]) -> (usize, usize) {
        let (planes, low, high) = (&self.at[axis], bounds.low[axis], bounds.high[axis]);
        let [mut first, mut last] = guess;
        while first > 0 && low < planes[first] {
            first -= 1;
        }
        while first < BINS - 1 && planes[first + 1] <= low {
            first += 1;
        }
        while last > 0 && high <= planes[last] {
            last -= 1;
        }
        while last < BINS - 1 && planes[last + 1] < high {
            last += 1;
        }
        (first, last.max(first))
    }
}

/// A triangle's edges, to be cut across an axis.
struct Edges {
    axis: usize,
    from: [Vec3A; 3],
    along: [Vec3A; 3],
    /// Of their lengths on the axis.
    inverse: [f32; 3],
}

impl Edges {
    fn new(vertices: &[Vec3; 3], axis: usize) -> Edges {
        let from = vertices.map(Vec3A::from);
        let along = [from[1] - from[0], from[2] - from[1], from[0] - from[2]];
        Edges { axis, from, along, inverse: along.map(|along| 1.0 / along[axis]) }
    }

    /// The box around what is between two planes, but for roundings. An edge in a plane is left to the other two, which
    /// end there.
    fn between(&self, low: f32, high: f32) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for ((&from, &along), &inverse) in self.from.iter().zip(&self.along).zip(&self.inverse) {
            let [a, b] = [low, high].map(|plane| (plane - from[self.axis]) * inverse);
            let (first, last) = (a.min(b).max(0.0), a.max(b).min(1.0));
            if first <= last {
                let [p, q] = [first, last].map(|t| Vec4::from((from + along * t, 0.0)));
                bounds = bounds.union(Bounds { low: p.min(q), high: p.max(q) });
            }
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn cube(low: f32, high: f32) -> Bounds {
        Bounds { low: Vec4::splat(low), high: Vec4::splat(high) }
    }

    #[test]
    fn items_are_in_the_bins_between_whose_planes_they_reach() {
        let mut random = Random::new(20_081_121);
        let large = 0.75 * f32::MAX;
        for (low, high) in
            [(0.0, 16.0), (-0.3, 1.7), (1e6, 1e6 + 1.0), (0.0, 5e-45), (1.0, 1.0f32.next_up()), (-1e38, 2e38)]
        {
            let bounds = cube(low, high);
            let planes = Planes::new(&bounds);
            assert!(planes.are_across(0) && planes.at[0].is_sorted(), "{:?}", planes.at[0]);
            for i in 0..1000 {
                let mut place = || match i % 3 {
                    0 => planes.at[0][random.bits() as usize % (BINS + 1)],
                    _ => (low + (high - low) * random.unit()).clamp(low, high),
                };
                let (a, b) = (place(), place());
                let item = cube(a.min(b), a.max(b));
                let guess = [random.bits() as usize % BINS, random.bits() as usize % BINS];
                let (first, last) = planes.range(0, &item, guess);
                for bin in 1..BINS {
                    let plane = planes.at[0][bin];
                    // In front of the plane, behind it, or on both sides, as apply() has it.
                    let is_low = item.low[0] < plane;
                    let is_high = plane < item.high[0] || !is_low;
                    assert_eq!((first < bin, last >= bin), (is_low, is_high), "{item:?}, {plane}, {first}..={last}");
                }
            }
        }
        assert!(!Planes::new(&cube(1.0, 1.0)).are_across(1) && !Planes::new(&cube(-large, large)).are_across(1));
    }

    #[test]
    fn what_hardly_crosses_the_plane_stays_whole() {
        let sides = || (Side { bounds: cube(0.0, 1.0), count: 10 }, Side { bounds: cube(1.0, 2.0), count: 10 });
        let item =
            |low: f32, high: f32| Item::new(&[Vec3::splat(low), Vec3::splat(high), Vec3::new(low, high, low)], 0);
        let divided = |low: f32, high: f32, mut sides: (Side, Side)| {
            let division = divide(&item(low, high), [item(low, 1.0), item(1.0, high)], &mut sides.0, &mut sides.1);
            let which = match division {
                Division::Low(_) => 'l',
                Division::High(_) => 'h',
                Division::Cut(_) => 'c',
            };
            (which, sides.0.count, sides.1.count)
        };
        assert_eq!(divided(0.2, 1.01, sides()), ('l', 10, 9));
        assert_eq!(divided(0.99, 1.8, sides()), ('h', 9, 10));
        assert_eq!(divided(0.1, 1.9, sides()), ('c', 10, 10));
        // Neither side may be left without items.
        let alone = (Side { count: 1, ..sides().0 }, Side { count: 1, ..sides().1 });
        assert_eq!(divided(0.2, 1.01, alone), ('c', 1, 1));
    }
}
