//! Quotients of exact integers of any length: the exact t, u and v of a hit.

use num_bigint::{BigInt, BigUint, Sign};
use std::cmp::Ordering;

/// numerator / denominator; not reduced.
#[derive(Debug, Clone)]
pub struct Ratio {
    numerator: BigInt,
    /// Above zero.
    denominator: BigInt,
}

impl Ratio {
    /// `numerator` * 2^`exponent` / `denominator`.
    ///
    /// # Panics
    /// When the denominator is zero: callers have looked at its sign.
    pub fn new(numerator: BigInt, denominator: BigInt, exponent: i32) -> Ratio {
        assert_ne!(denominator.sign(), Sign::NoSign, "no triangle is hit with a determinant of zero");
        let (mut numerator, mut denominator) =
            if denominator.sign() == Sign::Minus { (-numerator, -denominator) } else { (numerator, denominator) };
        if exponent > 0 {
            numerator <<= exponent;
        } else {
            denominator <<= -exponent;
        }
        Ratio { numerator, denominator }
    }

    /// The number itself. `x` is finite.
    pub fn from_float(x: f64) -> Ratio {
        let (significand, exponent) = decode(x);
        Ratio::new(significand.into(), 1.into(), exponent)
    }

    /// Above the line.
    pub fn numerator(&self) -> &BigInt {
        &self.numerator
    }

    /// Below the line; above zero.
    pub fn denominator(&self) -> &BigInt {
        &self.denominator
    }

    /// The nearest float; of two that are as near the even one.
    pub fn to_f32(&self) -> f32 {
        // A number of 24 digits, which the conversion keeps, or one beyond the floats' range.
        self.rounded(f32::MANTISSA_DIGITS, -149) as f32
    }

    /// Whether the nearest float is not infinite.
    pub fn is_finite_f32(&self) -> bool {
        let most = self.numerator.bits() as i64 - self.denominator.bits() as i64 + 1; // below 2 to this power
        most < i64::from(f32::MAX_EXP) || self.to_f32().is_finite()
    }

    /// The nearest double; of two that are as near the even one.
    pub fn to_f64(&self) -> f64 {
        self.rounded(f64::MANTISSA_DIGITS, -1074)
    }

    /// Rounded to `digits` binary digits, the last one not below 2^`last_exponent`.
    fn rounded(&self, digits: u32, last_exponent: i64) -> f64 {
        let (n, d) = (self.numerator.magnitude(), self.denominator.magnitude());
        if n.bits() == 0 {
            return 0.0;
        }
        let shifted = |x: &BigUint, by: i64| if by > 0 { x << by as u64 } else { x.clone() };
        // floor(log2(n / d)) is the difference of the lengths or one less.
        let mut exponent = n.bits() as i64 - d.bits() as i64;
        if shifted(n, -exponent) < shifted(d, exponent) {
            exponent -= 1;
        }
        let last = (exponent - i64::from(digits) + 1).max(last_exponent);
        let (n, d) = (shifted(n, -last), shifted(d, last));
        let mut significand = &n / &d;
        let order = ((&n - &significand * &d) << 1u32).cmp(&d);
        if order == Ordering::Greater || (order == Ordering::Equal && significand.bit(0)) {
            significand += 1u32;
        }
        let significand = u64::try_from(&significand).expect("no more digits than a double has") as f64;
        let magnitude = scaled(significand, last);
        if self.numerator.sign() == Sign::Minus { -magnitude } else { magnitude }
    }
}

impl PartialEq for Ratio {
    fn eq(&self, other: &Ratio) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Ratio {}

impl PartialOrd for Ratio {
    fn partial_cmp(&self, other: &Ratio) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ratio {
    fn cmp(&self, other: &Ratio) -> Ordering {
        (&self.numerator * &other.denominator).cmp(&(&other.numerator * &self.denominator))
    }
}

/// The significand, odd or zero, and the power of two of a finite number.
pub fn decode(x: f64) -> (i64, i32) {
    let bits = x.to_bits();
    let (field, fraction) = ((bits >> 52 & 0x7ff) as i32, (bits & ((1 << 52) - 1)) as i64);
    let (magnitude, exponent) = if field == 0 { (fraction, -1074) } else { (fraction | 1 << 52, field - 1075) };
    if magnitude == 0 {
        return (0, 0);
    }
    let zeros = magnitude.trailing_zeros();
    let odd = magnitude >> zeros;
    (if x.is_sign_negative() { -odd } else { odd }, exponent + zeros as i32)
}

/// x * 2^exponent in two steps, because the power alone may be out of a double's range.
fn scaled(x: f64, exponent: i64) -> f64 {
    let power = |e: i64| f64::from_bits(((e.clamp(-1022, 1023) + 1023) as u64) << 52);
    let half = exponent / 2;
    x * power(half) * power(exponent - half)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(numerator: i64, denominator: i64, exponent: i32) -> Ratio {
        Ratio::new(numerator.into(), denominator.into(), exponent)
    }

    #[test]
    fn floats_come_back_as_they_went() {
        for x in [0.0, 1.0, -0.1, 1e-310, f64::MAX, f64::MIN_POSITIVE, 5e-324, -1.5e300, 3.0] {
            assert_eq!(Ratio::from_float(x).to_f64(), x);
        }
        for x in [1e-45f32, f32::MAX, f32::MIN_POSITIVE, -0.3, 1e-40] {
            assert_eq!(Ratio::from_float(x.into()).to_f32(), x);
        }
    }

    #[test]
    fn quotients_round_to_nearest_and_ties_to_even() {
        assert_eq!(ratio(1, 3, 0).to_f32(), 1.0 / 3.0);
        assert_eq!(ratio(-2, -3, 0).to_f64(), 2.0 / 3.0);
        assert_eq!(ratio(5, -7, 3).to_f64(), -40.0 / 7.0);
        // 2^24 + 1 lies between two floats, as do 2^24 + 3 and their like far below.
        assert_eq!(ratio((1 << 24) + 1, 1, 0).to_f32(), 16_777_216.0);
        assert_eq!(ratio((1 << 24) + 3, 1, 0).to_f32(), 16_777_220.0);
        assert_eq!(ratio((1 << 25) + 3, 2, 0).to_f32(), 16_777_218.0);
        assert_eq!(ratio(3, 2, -149).to_f32(), 3e-45); // 2 units of the last place
        assert_eq!(ratio(1, 2, -149).to_f32(), 0.0);
        assert_eq!(ratio(3, 4, -149).to_f32(), 1e-45);
        assert_eq!(ratio(1, 1, 128).to_f32(), f32::INFINITY);
        assert_eq!(ratio(1, 1, 2000).to_f64(), f64::INFINITY);
    }

    #[test]
    fn what_rounds_to_infinity_is_not_finite() {
        // Half a unit beyond the largest float, which has 24 digits, is as near to 2^128, whose last digit is even.
        let beyond = |halves: i64| ratio((1 << 25) - 2 + halves, 1, 103);
        for (ratio, expected) in [(beyond(0), true), (beyond(1), false), (beyond(2), false), (ratio(1, 1, 300), false)]
        {
            assert_eq!((ratio.is_finite_f32(), ratio.to_f32().is_finite()), (expected, expected));
        }
        assert!(ratio((1 << 26) - 3, 1, 102).is_finite_f32() && ratio(-1, 3, 0).is_finite_f32());
        assert!(!ratio(-1, 1, 128).is_finite_f32());
    }

    #[test]
    fn order_is_that_of_the_numbers() {
        assert!(ratio(1, 3, 0) < ratio(1, 2, 0) && ratio(-1, 2, 0) < ratio(-1, 3, 0));
        assert_eq!(ratio(2, 6, 1), ratio(4, 6, 0));
        assert!(Ratio::from_float(0.1) > ratio(1, 10, 0), "the double 0.1 is above a tenth");
    }
}
