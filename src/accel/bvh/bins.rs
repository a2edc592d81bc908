//! Splits of large nodes: centroids are sorted into bins on each axis, and the planes between bins are candidates.
//!
//! Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", IEEE Symposium on Interactive Ray Tracing
//! 2007, section 3.

use super::items::{Bounds, CHUNK, Extent, Item, PARALLEL_ITEMS};
use crate::parallel;
use glam::Vec4;

/// Bins of an axis.
pub(super) const BINS: usize = 16;

/// Bins per unit of length on axes of such lengths; 0 on one without length.
pub(super) fn scale(lengths: Vec4) -> Vec4 {
    lengths.to_array().map(|length| if length > 0.0 { BINS as f32 / length } else { 0.0 }).into()
}

/// The bin at so many bins from the low end. Lengths so short that their scale is infinite leave the first and the last
/// bin: 0 times it is NaN, which converts to 0.
#[inline(always)]
pub(super) fn bin_of(place: f32) -> usize {
    (place as i32).min(BINS as i32 - 1) as usize
}

/// Which bins centroids belong to.
pub(super) struct Binning {
    low: Vec4,
    /// 0 on an axis on which all centroids are alike.
    scale: Vec4,
}

/// A plane before a bin.
pub(super) struct Split {
    /// Half areas of the two sides, each times the items in it.
    pub cost: f64,
    /// The boxes of the two sides.
    pub boxes: [Bounds; 2],
    axis: usize,
    bin: usize,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    count: u32,
}

impl Bin {
    const EMPTY: Bin = Bin { bounds: Bounds::EMPTY, count: 0 };

    #[inline(always)]
    fn union(self, other: Bin) -> Bin {
        Bin { bounds: self.bounds.union(other.bounds), count: self.count + other.count }
    }

    #[inline(always)]
    fn cost(&self) -> f64 {
        self.bounds.half_area() * f64::from(self.count)
    }
}

type Bins = [[Bin; BINS]; 3];

impl Binning {
    pub fn new(extent: &Extent) -> Binning {
        Binning { low: extent.centroids.low, scale: scale(extent.centroids.high - extent.centroids.low) }
    }

    /// How many bins an item's centroid is from the low end.
    #[inline(always)]
    fn place(&self, item: &Item) -> Vec4 {
        (item.centroid() - self.low) * self.scale
    }

    /// The bins of an item's centroid.
    #[inline(always)]
    fn bins_of(&self, item: &Item) -> [usize; 3] {
        let [x, y, z, _] = self.place(item).to_array();
        [x, y, z].map(bin_of)
    }

    /// The cheapest split; `None` when all centroids are alike.
    pub fn best_split(&self, items: &[Item]) -> Option<Split> {
        let bins = match items.len() >= PARALLEL_ITEMS {
            true => {
                let parts = parallel::map(items.chunks(CHUNK), |chunk| self.fill(chunk));
                parts.into_iter().fold([[Bin::EMPTY; BINS]; 3], merge)
            }
            false => self.fill(items),
        };
        let mut best: Option<Split> = None;
        for (axis, bins) in bins.iter().enumerate().filter(|(axis, _)| self.scale[*axis] > 0.0) {
            let mut highs = [Bin::EMPTY; BINS];
            let mut high = Bin::EMPTY;
            for bin in (1..BINS).rev() {
                high = high.union(bins[bin]);
                highs[bin] = high;
            }
            let mut low = Bin::EMPTY;
            for bin in 1..BINS {
                low = low.union(bins[bin - 1]);
                // The first and the last bin have items: both sides have. An empty bin's plane is that before it.
                if bins[bin - 1].count == 0 {
                    continue;
                }
                let cost = low.cost() + highs[bin].cost();
                if best.as_ref().is_none_or(|best| cost < best.cost) {
                    best = Some(Split { cost, boxes: [low.bounds, highs[bin].bounds], axis, bin });
                }
            }
        }
        best
    }

    fn fill(&self, items: &[Item]) -> Bins {
        let mut bins = [[Bin::EMPTY; BINS]; 3];
        for item in items {
            let one = Bin { bounds: item.bounds(), count: 1 };
            for (bins, bin) in bins.iter_mut().zip(self.bins_of(item)) {
                bins[bin] = bins[bin].union(one);
            }
        }
        bins
    }

    /// Whether an item lies below the plane: whether its bin does, which is that of the same place rounded down, or 0
    /// where that is NaN.
    #[inline(always)]
    pub fn is_before(&self, item: &Item, split: &Split) -> bool {
        let is_behind = self.place(item).cmpge(Vec4::splat(split.bin as f32)).bitmask();
        is_behind >> split.axis & 1 == 0
    }
}

fn merge(mut a: Bins, b: Bins) -> Bins {
    for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
        *a = a.union(*b);
    }
    a
}
