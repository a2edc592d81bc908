//! Whether splits of space pay: the tree with them and that without are both built, and the one is kept that the
//! expected cost ([`Bvh::expected_cost`]; MacDonald and Booth 1990) speaks for.
//!
//! Both have been through reinsertion, which mends a part of what splits of space would. The costs are sums in the
//! order of nodes, so that what is chosen depends on neither threads nor the order of triangles.
//!
//! Bad at: time, as one tree is thrown away; and packets of rays, which meet more leaves together than the cost of one
//! ray knows of.

use super::Bvh;
use crate::accel::BuildOptions;
use crate::options::SpatialSplits;

/// Splits of space are kept where the tree with them has less than this part of the cost of that without.
///
/// Costs with a share of 1 by those without, of nine scenes: .90 to .92 where triangles are long or differ in size
/// (sponza, spider, milk truck, viking room), and .98 to 1.03 in all others (fandisk, bunny, gears, coffee, bathroom):
/// this is the middle between the two. Where it was near 1 rays of a GPU ran at .89 (bathroom) to 1.03 times the speed,
/// in sponza at 1.06 to 1.18 (docs/record/2026-11-22-h200-spatial-splits.md).
const LARGEST_RATIO: f64 = 0.95;

/// What [`SpatialSplits::Auto`] has chosen in the hierarchies of a scene.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SplitsChosen {
    /// Hierarchies that were built in both ways: one, or one for each object.
    pub hierarchies: usize,
    /// Those of them that were kept with splits of space.
    pub with_splits: usize,
    /// The least and the largest of their ratios: the expected cost with splits of space by that without. NaN where no
    /// hierarchy has a cost.
    pub cost_ratios: [f64; 2],
}

impl SplitsChosen {
    /// Of hierarchies with these ratios ([`Bvh::splits_ratio`]); `None` when there are none.
    pub(crate) fn of(ratios: impl IntoIterator<Item = f64>) -> Option<SplitsChosen> {
        let ratios: Vec<f64> = ratios.into_iter().collect();
        // Of a number and NaN both functions take the number.
        let cost_ratios = [f64::min, f64::max].map(|of| ratios.iter().copied().fold(f64::NAN, of));
        let with_splits = ratios.iter().filter(|&&ratio| do_pay(ratio)).count();
        (!ratios.is_empty()).then_some(SplitsChosen { hierarchies: ratios.len(), with_splits, cost_ratios })
    }
}

/// Whether splits of space pay that change the cost so; NaN, of triangles whose box has no surface, is a no.
fn do_pay(ratio: f64) -> bool {
    ratio < LARGEST_RATIO
}

/// The tree that `grow` makes with splits of space, where these pay, else that without; it is given the share of parts.
/// One is finished before the other is begun, which takes less memory.
pub(super) fn cheaper(grow: impl Fn(f32) -> Bvh, options: &BuildOptions) -> Bvh {
    let [without, with] = [0.0, SpatialSplits::AUTO_SHARE].map(grow);
    let ratio = with.expected_cost(options) / without.expected_cost(options);
    Bvh { splits_ratio: Some(ratio), ..if do_pay(ratio) { with } else { without } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hierarchies_are_told_of_together() {
        let of = |ratios: &[f64]| SplitsChosen::of(ratios.iter().copied());
        assert_eq!(of(&[]), None);
        let chosen = of(&[f64::NAN, 0.96, 0.94, f64::NAN, 1.5]).unwrap();
        assert_eq!(chosen, SplitsChosen { hierarchies: 5, with_splits: 1, cost_ratios: [0.94, 1.5] });
        let none = of(&[f64::NAN]).unwrap();
        assert!(none.with_splits == 0 && none.cost_ratios.iter().all(|ratio| ratio.is_nan()), "{none:?}");
    }
}
