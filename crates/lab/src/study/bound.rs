//! What so few wrong answers say of the rate of wrong answers: bounds, so that few tests do not look better than many,
//! and whether two rates differ at all.
//!
//! Clopper and Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the Binomial",
//! Biometrika 26, 1934: the largest and the smallest rate at which so few, or so many, wrong answers still come out one
//! time in twenty. One-sided for every count, so that none and one are bounded alike. Fisher, "The Design of
//! Experiments", 1935: how often chance alone deals out wrong answers as unevenly.
//!
//! The distributions are those of the crate statrs, whose incomplete beta function is right to 4e-12 here. Its inverse
//! is only right to 3e-8, so it is inverted by bisection.

use statrs::distribution::{DiscreteCDF, Hypergeometric};
use statrs::function::beta::beta_reg;

/// The probability that a statement is false, at most: that the true rate is above the bound, that a claim fails which
/// is said to hold.
pub const RISK: f64 = 0.05;

/// The rate that is not exceeded with 95 % confidence when `wrong` of `tested` answers were wrong; 1 where nothing
/// was tested.
pub fn upper_bound(wrong: u64, tested: u64) -> f64 {
    if wrong >= tested {
        return 1.0;
    }
    // So few or fewer are wrong as likely as a beta distribution lies above the rate.
    rate_at(1.0 - RISK, wrong as f64 + 1.0, (tested - wrong) as f64)
}

/// The rate that is exceeded with 95 % confidence; 0 where nothing was wrong.
pub fn lower_bound(wrong: u64, tested: u64) -> f64 {
    if wrong == 0 || wrong > tested {
        return 0.0;
    }
    rate_at(RISK, wrong as f64, (tested - wrong) as f64 + 1.0)
}

/// The rate below which the beta distribution of `a` and `b` lies with this probability.
fn rate_at(probability: f64, a: f64, b: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    loop {
        let middle: f64 = low + (high - low) / 2.0;
        if middle <= low || middle >= high {
            return high;
        }
        match beta_reg(a, b, middle) < probability {
            true => low = middle,
            false => high = middle,
        }
    }
}

/// The probability that chance alone puts so many or more of all wrong answers among `tested`, if the rate is that of
/// the `base`, too: Fisher's exact test, one-sided. Each is a count of wrong answers and of all.
pub fn chance_of_more([wrong, tested]: [u64; 2], [base_wrong, base_tested]: [u64; 2]) -> f64 {
    if wrong == 0 {
        return 1.0;
    }
    let all = Hypergeometric::new(tested + base_tested, wrong + base_wrong, tested);
    all.map_or(1.0, |distribution| distribution.sf(wrong - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles of the beta distribution in 60 decimal digits, by bisection over the exact sum.
    #[test]
    fn bounds_are_those_of_clopper_and_pearson() {
        for (wrong, tested, expected) in [
            (0, 1, 9.5e-1),
            (0, 27_200, 1.101_311_510_589_759e-4),
            (1, 27_200, 1.743_947_813_683_129e-4),
            (1, 2, 9.746_794_344_808_964e-1),
            (3, 10, 6.066_242_161_054_134e-1),
            (5, 100, 1.022_533_776_432_745e-1),
            (99, 100, 9.994_871_985_837_377e-1),
            (1714, 27_200, 6.549_124_338_395_476e-2),
            (12_936, 27_200, 4.805_891_216_369_159e-1),
        ] {
            let bound = upper_bound(wrong, tested);
            assert!((bound / expected - 1.0).abs() < 1e-11, "{wrong} of {tested}: {bound}, not {expected}");
            // So many of them were right.
            let low = lower_bound(tested - wrong, tested);
            assert!((low - (1.0 - expected)).abs() < 1e-11, "{wrong} of {tested}: {low}");
        }
    }

    #[test]
    fn none_is_bounded_by_about_three_and_every_further_wrong_answer_is_worse() {
        for tested in [100, 1928, 10_000_000_000] {
            assert!((upper_bound(0, tested) * tested as f64 / 3.0 - 1.0).abs() < 0.02, "{tested}");
            let bounds: Vec<_> =
                (0..90).map(|wrong| [lower_bound(wrong, tested), upper_bound(wrong, tested)]).collect();
            assert!(bounds.windows(2).all(|pair| pair[0] < pair[1]), "{tested}: {bounds:?}");
            let is_between = |(wrong, [low, high]): (usize, &[f64; 2])| {
                let rate = wrong as f64 / tested as f64;
                *low <= rate && rate < *high
            };
            assert!(bounds.iter().enumerate().all(is_between), "{tested}");
        }
        assert!(upper_bound(0, 1000) < upper_bound(0, 100));
        assert_eq!([upper_bound(0, 0), upper_bound(7, 7), lower_bound(0, 9)], [1.0, 1.0, 0.0]);
    }

    /// Fisher's own tea: four cups of eight have milk in first, and all four are told.
    #[test]
    fn more_wrong_answers_are_told_from_chance() {
        assert!((chance_of_more([4, 4], [0, 4]) - 1.0 / 70.0).abs() < 1e-12);
        assert!((chance_of_more([3, 4], [1, 4]) - 17.0 / 70.0).abs() < 1e-12);
        assert_eq!([chance_of_more([0, 100], [0, 100]), chance_of_more([0, 0], [0, 0])], [1.0, 1.0]);
        // A rate that is there already is none of the place's.
        assert!(chance_of_more([135, 1000], [130, 1000]) > RISK && chance_of_more([190, 1000], [130, 1000]) < RISK);
    }
}
