//! What measurements say of a claim: that it holds, that it does not, or neither, because what was measured differs
//! more from round to round than from one side to the other.
//!
//! Methods are timed by turns, in rounds, so that what slows a machine for a while slows both sides of a round. Each
//! round therefore gives a ratio of its own, and the sign test says whether they lie on one side of a limit more often
//! than tosses of a coin would: Dixon and Mood, "The Statistical Sign Test", JASA 41, 1946. It asks nothing of the
//! distribution of times, which has a long tail.
//!
//! Bad at: few rounds. Below five nothing is ever decided. And it knows the noise of the clock alone: that other scenes
//! behave alike it does not say.

use super::bound::RISK;
use serde::{Deserialize, Serialize};
use statrs::distribution::{Binomial, DiscreteCDF};
use std::fmt;

/// What follows for a claim.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It holds on this device with these scenes.
    Holds,
    /// It does not.
    Fails,
    /// It was not measured, or the measurements do not tell.
    #[default]
    Undecided,
}

impl Outcome {
    /// Holds where it is true.
    pub fn of(is_so: bool) -> Outcome {
        if is_so { Outcome::Holds } else { Outcome::Fails }
    }

    /// That of a claim that is to hold in every part: it fails if it fails in one, and is undecided if one is.
    pub fn all(parts: impl IntoIterator<Item = Outcome>) -> Outcome {
        let (mut is_decided, mut result) = (false, Outcome::Holds);
        for part in parts {
            is_decided = true;
            match part {
                Outcome::Fails => return Outcome::Fails,
                Outcome::Undecided => result = Outcome::Undecided,
                Outcome::Holds => {}
            }
        }
        if is_decided { result } else { Outcome::Undecided }
    }

    /// That of a claim that is to hold in some part.
    pub fn any(parts: impl IntoIterator<Item = Outcome>) -> Outcome {
        Outcome::all(parts.into_iter().map(Outcome::opposite)).opposite()
    }

    /// Of the claim's contrary.
    pub fn opposite(self) -> Outcome {
        match self {
            Outcome::Holds => Outcome::Fails,
            Outcome::Fails => Outcome::Holds,
            Outcome::Undecided => Outcome::Undecided,
        }
    }
}

/// The ratios of two measurements, one for each round.
#[derive(Debug, Clone, PartialEq)]
pub struct Rounds {
    /// From the smallest to the largest.
    sorted: Vec<f64>,
}

impl Rounds {
    /// Of these ratios; `None`: there are none, or one is no number above 0.
    pub fn new(mut ratios: Vec<f64>) -> Option<Rounds> {
        ratios.sort_by(f64::total_cmp);
        let are_numbers = ratios.iter().all(|ratio| *ratio > 0.0 && ratio.is_finite());
        (are_numbers && !ratios.is_empty()).then_some(Rounds { sorted: ratios })
    }

    /// Their median.
    pub fn ratio(&self) -> f64 {
        let middle = self.sorted.len() / 2;
        match self.sorted.len() % 2 {
            0 => (self.sorted[middle - 1] * self.sorted[middle]).sqrt(),
            _ => self.sorted[middle],
        }
    }

    /// Each ratio so many times as large; `factor` is above 0.
    #[must_use]
    pub fn times(mut self, factor: f64) -> Rounds {
        self.sorted.iter_mut().for_each(|ratio| *ratio *= factor);
        self
    }

    /// Whether it is above `limit`.
    pub fn above(&self, limit: f64) -> Outcome {
        let above = self.sorted.iter().filter(|ratio| **ratio > limit).count();
        let below = self.sorted.iter().filter(|ratio| **ratio < limit).count();
        match (chance(above, above + below) <= RISK, chance(below, above + below) <= RISK) {
            (true, _) => Outcome::Holds,
            (_, true) => Outcome::Fails,
            _ => Outcome::Undecided,
        }
    }

    /// Whether it is below `limit`.
    pub fn below(&self, limit: f64) -> Outcome {
        self.above(limit).opposite()
    }
}

/// The median, and the smallest and the largest.
impl fmt::Display for Rounds {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let decimals = f.precision().unwrap_or(2);
        let (low, high) = (self.sorted[0], self.sorted[self.sorted.len() - 1]);
        write!(f, "{:.decimals$} [{low:.decimals$}, {high:.decimals$}]", self.ratio())
    }
}

/// The probability that `heads` or more of so many tosses of a coin are heads.
fn chance(heads: usize, tosses: usize) -> f64 {
    match (heads, Binomial::new(0.5, tosses as u64)) {
        (1.., Ok(coin)) => coin.sf(heads as u64 - 1),
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounds(ratios: &[f64]) -> Rounds {
        Rounds::new(ratios.to_vec()).unwrap()
    }

    #[test]
    fn five_rounds_of_one_mind_decide_and_four_do_not() {
        let five = rounds(&[1.01, 1.02, 1.03, 1.5, 1.1]);
        assert_eq!([five.above(1.0), five.below(1.0)], [Outcome::Holds, Outcome::Fails]);
        assert_eq!([five.above(1.02), five.above(2.0)], [Outcome::Undecided, Outcome::Fails]);
        assert_eq!(rounds(&[1.1; 4]).above(1.0), Outcome::Undecided);
        // Neither is above the other.
        assert_eq!(rounds(&[1.0; 9]).above(1.0), Outcome::Undecided);
        let eight_of_nine = rounds(&[0.9, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1]);
        assert_eq!(eight_of_nine.above(1.0), Outcome::Holds);
        assert_eq!(rounds(&[0.9, 0.9, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1]).above(1.0), Outcome::Undecided);
    }

    #[test]
    fn a_ratio_is_told_with_its_spread() {
        assert_eq!(rounds(&[2.0, 1.0, 4.0]).to_string(), "2.00 [1.00, 4.00]");
        assert_eq!(format!("{:.1}", rounds(&[2.0, 8.0])), "4.0 [2.0, 8.0]");
        assert_eq!([Rounds::new(vec![]), Rounds::new(vec![1.0, f64::NAN]), Rounds::new(vec![0.0])], [None, None, None]);
    }

    #[test]
    fn a_claim_holds_only_where_everything_was_measured() {
        use Outcome::{Fails, Holds, Undecided};
        for (parts, all, any) in [
            (&[][..], Undecided, Undecided),
            (&[Holds], Holds, Holds),
            (&[Holds, Undecided], Undecided, Holds),
            (&[Holds, Undecided, Fails], Fails, Holds),
            (&[Fails, Undecided], Fails, Undecided),
            (&[Fails, Fails], Fails, Fails),
        ] {
            assert_eq!((Outcome::all(parts.iter().copied()), Outcome::any(parts.iter().copied())), (all, any));
        }
    }

    /// Two sides that are the same are told apart one time in ten at most, one time in twenty either way.
    #[test]
    fn noise_alone_seldom_decides() {
        let random = &mut raybrook::low_level::random::Random::new(1);
        let decided = (0..2000).filter(|_| {
            let noise = (0..9).map(|_| 1.0 + 0.1 * f64::from(random.signed())).collect();
            Rounds::new(noise).unwrap().above(1.0) != Outcome::Undecided
        });
        let decided = decided.count();
        assert!((20..2 * 2000 / 20).contains(&decided), "{decided}");
    }
}
