//! Stops: when a node of a kd-tree becomes a leaf, for all builds alike.
//!
//! Thesis, section 5.5: a limit of triangles, a limit of depth, or a split that does not pay ([`super::cost`]); section
//! 5.5.2: children that are nearly alike. [`super::subtree::MAX_GROWTH`] limits what is left, and so does memory
//! ([`GrowthLimit`]).
//!
//! The two limits are bad at scenes of uneven detail. The cost looks one split ahead, with [`Stops::with_trials`] two,
//! and misses gains that take more.
//! Children that are alike may still be worth it further down.

use super::BuildOptions;
use super::cost::{Costs, Split};
use super::memory::GrowthLimit;
use super::subtree::{Cell, growth_after};
use crate::options::{Stop, TraceOptions};

/// Where a node stands in the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub cell: Cell,
    /// 1 for the root, 2 n and 2 n + 1 for the children of node n: the highest bit set is the depth, of 60 at most.
    pub number: u64,
    /// See [`super::subtree::MAX_GROWTH`].
    growth: f64,
    /// Whether the split above it did not pay.
    is_trial: bool,
}

impl Place {
    pub fn root(cell: Cell) -> Place {
        Place { cell, number: 1, growth: 1.0, is_trial: false }
    }

    /// The root's is 0.
    pub fn depth(&self) -> u32 {
        self.number.ilog2()
    }
}

/// Nodes of at least so many references are split once more than pays ([`Stops::with_trials`]). On 18 models smaller
/// nodes make 8 % more time to build of it, and lower the expected cost by 0.2 % at the most; two such splits in a row
/// lower it by 0.1 % more (docs/record/2026-11-25-host-pruned-trees.md).
const TRIAL_REFERENCES: usize = 8;

/// The stops of a build.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stops<'a> {
    costs: Costs,
    leaf_size: usize,
    max_depth: u32,
    by_cost: bool,
    has_trials: bool,
    similar_children: f32,
    growth: &'a GrowthLimit,
}

impl<'a> Stops<'a> {
    pub fn new(costs: Costs, options: &BuildOptions, growth: &'a GrowthLimit) -> Stops<'a> {
        Stops {
            costs,
            leaf_size: options.leaf_size as usize,
            max_depth: options.max_depth.min(TraceOptions::MAX_DEPTH),
            by_cost: options.stop == Stop::Cost,
            has_trials: false,
            similar_children: options.similar_children,
            growth,
        }
    }

    /// Where the cost decides: allows a split that does not pay below one that does, for a builder which makes a node a
    /// leaf again when all that is below costs no less ([`Stops::are_pruned`]). Some gains take two splits, none of
    /// which pays alone.
    pub fn with_trials(self) -> Stops<'a> {
        Stops { has_trials: self.by_cost, ..self }
    }

    /// Whether a node that costs no less than a leaf is to be made a leaf.
    pub fn are_pruned(&self) -> bool {
        self.has_trials
    }

    /// Whether no split is to be looked for in a node of `count` references.
    pub fn ends_at(&self, count: usize, place: &Place) -> bool {
        count <= self.leaf_size || place.depth() >= self.max_depth
    }

    /// The places of the two children, or `None` when `split` of a node of `count` references is refused.
    pub fn children(&self, count: usize, place: &Place, split: &Split) -> Option<[Place; 2]> {
        let pays = split.cost < self.costs.leaf(count);
        let may_try = self.has_trials && !place.is_trial && count >= TRIAL_REFERENCES;
        if self.by_cost && !pays && !may_try {
            return None;
        }
        // The rounded quotient of 19 and 20 is the float32 nearest to 0.95: a share that is met exactly is allowed.
        let share = (f64::from(split.left.min(split.right)) / count as f64) as f32;
        if share > self.similar_children {
            return None;
        }
        let parts = split.left as usize + split.right as usize;
        let growth = growth_after(place.growth, count, parts)?;
        if !self.growth.allows(count, parts) {
            return None;
        }
        let (left, right) = place.cell.split(split.axis, split.plane);
        let child = |cell, side| Place { cell, number: 2 * place.number + side, growth, is_trial: !pays };
        Some([child(left, 0), child(right, 1)])
    }
}
