//! Splits of a list of triangles into two: by whichever method suits their number.

use super::bins::{Binning, Split};
use super::items::{Bounds, Extent, Item, partition};
use super::sweep::{self, Sweep};

/// The best split that was found.
pub(super) enum ObjectSplit {
    Swept(Sweep),
    Binned(Binning, Split),
}

impl ObjectSplit {
    /// That of at least two items; `None` when all centroids are alike.
    pub fn best(items: &[Item], extent: &Extent) -> Option<ObjectSplit> {
        if items.len() <= sweep::CAPACITY {
            return Sweep::best(items, extent).map(ObjectSplit::Swept);
        }
        let binning = Binning::new(extent);
        let split = binning.best_split(items)?;
        Some(ObjectSplit::Binned(binning, split))
    }

    /// Half areas of the two sides, each times the items in it.
    pub fn cost(&self) -> f64 {
        match self {
            ObjectSplit::Swept(sweep) => sweep.cost,
            ObjectSplit::Binned(_, split) => split.cost,
        }
    }

    /// What the boxes of the two sides have in common.
    pub fn overlap(&self, items: &[Item]) -> Bounds {
        let [low, high] = match self {
            ObjectSplit::Swept(sweep) => sweep.boxes(items),
            ObjectSplit::Binned(_, split) => split.boxes,
        };
        low.intersection(high)
    }

    /// Brings the items of one side before those of the other and returns how many these are.
    pub fn apply(&self, items: &mut [Item]) -> usize {
        match self {
            ObjectSplit::Swept(sweep) => sweep.apply(items),
            ObjectSplit::Binned(binning, split) => partition(items, &|item| binning.is_before(item, split)),
        }
    }
}
