//! Splits of small nodes: every way to cut the list of centroids, sorted along each axis.
//!
//! Wald, Boulos and Shirley, "Ray Tracing Deformable Scenes Using Dynamic Bounding Volume Hierarchies", ACM
//! Transactions on Graphics 26(1), 2007, section 3.2. For so few triangles sorting costs no more than filling bins.

use super::items::{Bounds, Extent, Item};
use crate::accel::events::ordered;

/// The most items of a small node.
pub(super) const CAPACITY: usize = 32;

/// The cheapest cut.
pub(super) struct Sweep {
    /// Half areas of the two sides, each times the items in it.
    pub cost: f64,
    middle: usize,
    order: [u8; CAPACITY],
}

impl Sweep {
    /// That of 2 to [`CAPACITY`] items; `None` when all centroids are alike.
    pub fn best(items: &[Item], extent: &Extent) -> Option<Sweep> {
        let count = items.len();
        let mut best: Option<Sweep> = None;
        for axis in (0..3).filter(|&axis| extent.centroids.low[axis] < extent.centroids.high[axis]) {
            let order = sorted(items, axis);
            let mut high_costs = [0.0; CAPACITY];
            let mut high = Bounds::EMPTY;
            for middle in (1..count).rev() {
                high = high.union(items[usize::from(order[middle])].bounds());
                high_costs[middle] = high.half_area() * (count - middle) as f64;
            }
            let mut low = Bounds::EMPTY;
            let (mut cost, mut middle) = (f64::INFINITY, count / 2);
            for first in 1..count {
                low = low.union(items[usize::from(order[first - 1])].bounds());
                let cost_here = low.half_area() * first as f64 + high_costs[first];
                if cost_here < cost {
                    (cost, middle) = (cost_here, first);
                }
            }
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Sweep { cost, middle, order });
            }
        }
        best
    }

    /// The boxes of the two sides.
    pub fn boxes(&self, items: &[Item]) -> [Bounds; 2] {
        let (low, high) = self.order[..items.len()].split_at(self.middle);
        [low, high].map(|numbers| {
            numbers.iter().fold(Bounds::EMPTY, |bounds, &number| bounds.union(items[usize::from(number)].bounds()))
        })
    }

    /// Sorts the items, and returns how many are below the cut.
    pub fn apply(&self, items: &mut [Item]) -> usize {
        let mut old = [items[0]; CAPACITY];
        old[..items.len()].copy_from_slice(items);
        for (item, &number) in items.iter_mut().zip(&self.order) {
            *item = old[usize::from(number)];
        }
        self.middle
    }
}

/// The numbers of the items in the order of their centroids, and of their triangles where these are alike (insertion
/// sort).
fn sorted(items: &[Item], axis: usize) -> [u8; CAPACITY] {
    let mut order = [0u8; CAPACITY];
    let mut keys = [0u64; CAPACITY];
    for (number, item) in items.iter().enumerate() {
        // One comparison of integers instead of two, or three with NaN.
        let key = ordered(item.centroid()[axis] + 0.0) << 32 | u64::from(item.triangle());
        let mut at = number;
        while at > 0 && keys[at - 1] > key {
            keys[at] = keys[at - 1];
            order[at] = order[at - 1];
            at -= 1;
        }
        keys[at] = key;
        order[at] = number as u8;
    }
    order
}
