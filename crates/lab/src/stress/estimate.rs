//! Numbers in doubles with a bound of their error: a static filter (Shewchuk, "Adaptive Precision Floating-Point
//! Arithmetic and Fast Robust Geometric Predicates", Discrete & Computational Geometry 18, 1997, section 4).

use glam::DVec3;

/// The largest relative error of one rounding of a double.
pub const ROUNDING: f64 = f64::EPSILON / 2.0;
/// A product of three numbers that are each off by a rounding, and the sum of six such: a difference, twice, in 2; the
/// products of a component 1, their difference 1; the products with the third vector 1, their sum 2: gamma(7) of the
/// same expression of magnitudes, which is itself computed, and too small by gamma(7) at most: 8 leaves room for the
/// second order of both.
pub const PRODUCT_ERROR: f64 = 8.0 * ROUNDING;

/// A number that is surely within `bound` of `value`.
#[derive(Debug, Clone, Copy)]
pub struct Estimate {
    /// As computed.
    pub value: f64,
    /// Not below zero.
    pub bound: f64,
}

impl Estimate {
    /// a . (b x c), where `b` and `c` are differences that were rounded once, and `a` is one, too, or exact.
    pub fn volume(a: DVec3, b: DVec3, c: DVec3) -> Estimate {
        Estimate { value: a.dot(b.cross(c)), bound: PRODUCT_ERROR * a.abs().dot(size_of_cross(b.abs(), c.abs())) }
    }

    /// -1 or 1 where that is the number's sign for certain.
    pub fn sign(self) -> Option<f64> {
        (self.value.abs() > self.bound).then(|| self.value.signum())
    }

    /// The quotient; `None` when the divisor may be zero.
    pub fn over(self, divisor: Estimate) -> Option<Estimate> {
        divisor.sign()?;
        let value = self.value / divisor.value;
        // 1.01 for the rounding of the bound, 4 for that of the quotient and of the two limits.
        let error = (self.bound + value.abs() * divisor.bound) / (divisor.value.abs() - divisor.bound);
        Some(Estimate { value, bound: 1.01 * error + 4.0 * ROUNDING * value.abs() })
    }

    /// No exact value is smaller.
    pub fn low(self) -> f64 {
        self.value - self.bound
    }

    /// No exact value is larger.
    pub fn high(self) -> f64 {
        self.value + self.bound
    }
}

/// The cross product of two vectors of magnitudes if nothing cancelled.
pub fn size_of_cross(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::new(a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x)
}
