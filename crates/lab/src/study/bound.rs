//! What so few wrong answers say of the rate of wrong answers: an upper bound, so that few tests do not look better
//! than many.
//!
//! Clopper and Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the Binomial",
//! Biometrika 26, 1934: the largest rate at which so few wrong answers still come out one time in twenty. One-sided
//! for every count, so that none and one are bounded alike. Own code, because the crates that have quantiles of the
//! beta distribution failed here: one of them panicked and one did not end for the counts of a study.
//!
//! Bad at: counts above 10^9, whose binomial coefficient it multiplies up.

/// The probability that the true rate is above the bound, at most.
const RISK: f64 = 0.05;

/// The rate that is not exceeded with 95 % confidence when `wrong` of `tested` answers were wrong; 1 where nothing
/// was tested.
pub fn upper_bound(wrong: u64, tested: u64) -> f64 {
    if wrong >= tested {
        return 1.0;
    }
    if wrong == 0 {
        // (1 - bound)^tested = RISK, without the cancellation of 1 - RISK^(1 / tested).
        return -(RISK.ln() / tested as f64).exp_m1();
    }
    let ways = log_ways(wrong, tested);
    let (mut low, mut high) = (wrong as f64 / tested as f64, 1.0);
    loop {
        let middle = low + (high - low) / 2.0;
        if middle <= low || middle >= high {
            return high;
        }
        match at_most(wrong, tested, middle, ways) > RISK {
            true => low = middle,
            false => high = middle,
        }
    }
}

/// The logarithm of the number of ways to choose `wrong` of `tested`.
fn log_ways(wrong: u64, tested: u64) -> f64 {
    let fewer = wrong.min(tested - wrong);
    (1..=fewer).map(|i| ((tested - fewer + i) as f64 / i as f64).ln()).sum()
}

/// The probability of at most `wrong` wrong answers of `tested` at a rate above `wrong` / `tested`.
fn at_most(wrong: u64, tested: u64, rate: f64, log_ways: f64) -> f64 {
    let right = (tested - wrong) as f64;
    let first = (log_ways + wrong as f64 * rate.ln() + right * (-rate).ln_1p()).exp();
    // From `wrong` down each term is smaller than the one before, because the rate is above wrong / tested.
    let (mut term, mut sum) = (first, first);
    for i in (1..=wrong).rev() {
        term *= i as f64 * (1.0 - rate) / ((tested - i + 1) as f64 * rate);
        sum += term;
        if term < sum * f64::EPSILON / 2.0 {
            break;
        }
    }
    sum
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
        }
    }

    #[test]
    fn none_is_bounded_by_about_three_and_every_further_wrong_answer_is_worse() {
        for tested in [100, 1928, 10_000_000_000] {
            assert!((upper_bound(0, tested) * tested as f64 / 3.0 - 1.0).abs() < 0.02, "{tested}");
            let bounds: Vec<_> = (0..90).map(|wrong| upper_bound(wrong, tested)).collect();
            assert!(bounds.windows(2).all(|pair| pair[0] < pair[1]), "{tested}: {bounds:?}");
        }
        assert!(upper_bound(0, 1000) < upper_bound(0, 100));
        assert_eq!([upper_bound(0, 0), upper_bound(7, 7)], [1.0, 1.0]);
    }
}
