//! A way to compute a picture: in f64 as it is, or with every number off by what float32 may round it by.
//!
//! No float32 renderer can know numbers better than their roundings, so a pixel is right if some numbers within them
//! make it. This is stochastic arithmetic (La Porte and Vignes, "Algorithmes numériques, analyse et mise en œuvre",
//! 1974; Parker, "Monte Carlo Arithmetic", 1997) with the bounds of float32 in place of the last bits of the arithmetic
//! at hand: each trial draws other errors, each within its bound, and the spread of the trials tells how far off a
//! result may be, also where a chain of mirrors makes much of little.
//!
//! Bad at: rare coincidences. What only one set of errors in thousands leads to is not found.

use glam::DVec3;
use raybrook::low_level::random::Random;

/// Half the distance from 1 to the next float32: what a rounding is off by, relative to the result.
pub const EPSILON: f64 = crate::stress::EPSILON;

/// One way to compute: which errors are made, and which decisions came of them.
#[derive(Debug, Clone)]
pub struct Trial {
    random: Option<Random>,
    decisions: u64,
}

impl Trial {
    /// Without errors but those of f64.
    pub fn exact() -> Trial {
        Trial { random: None, decisions: 0 }
    }

    /// With errors that follow from `seed`.
    pub fn rounded(seed: u64) -> Trial {
        Trial { random: Some(Random::new(seed)), decisions: 0 }
    }

    /// Whether errors are made.
    pub fn has_errors(&self) -> bool {
        self.random.is_some()
    }

    /// Keeps what was decided: which triangle is hit, whether a light is hidden.
    pub fn decide(&mut self, choice: u32) {
        /// The golden ratio in 64 bits: a factor that spreads every bit.
        const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
        self.decisions = (self.decisions.rotate_left(7) ^ u64::from(choice)).wrapping_mul(SPREAD).wrapping_add(1);
    }

    /// A number that tells whether two trials decided alike.
    pub fn decisions(&self) -> u64 {
        self.decisions
    }

    /// An error of at most `bound`.
    pub fn error(&mut self, bound: f64) -> f64 {
        match &mut self.random {
            Some(random) => f64::from(random.signed()) * bound,
            None => 0.0,
        }
    }

    /// `x`, the result of so many roundings of numbers as large as itself.
    pub fn number(&mut self, x: f64, roundings: f64) -> f64 {
        x + self.error(roundings * EPSILON * x.abs())
    }

    /// `x`, off by so many roundings of numbers of size `size`.
    pub fn near(&mut self, x: f64, size: f64, roundings: f64) -> f64 {
        x + self.error(roundings * EPSILON * size)
    }

    /// `v`, each component off by so many roundings of numbers as large as the vector.
    pub fn vector(&mut self, v: DVec3, roundings: f64) -> DVec3 {
        self.moved(v, roundings * EPSILON * v.length())
    }

    /// `v`, each component off by at most `bound`.
    pub fn moved(&mut self, v: DVec3, bound: f64) -> DVec3 {
        match self.random {
            Some(_) => v + DVec3::new(self.error(bound), self.error(bound), self.error(bound)),
            None => v,
        }
    }
}
