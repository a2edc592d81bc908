//! Two kinds of numbers in which the closest point of a triangle is computed by the same text: f64 with bounds of its
//! errors, which says so where it cannot tell a sign, and exact integers, which always can.
//!
//! The bounds grow with every step, after Rump, "Fast and Parallel Interval Arithmetic", BIT 39(3), 1999 (a middle and
//! a radius). Coordinates are floats and no expression is of a higher degree than 6, so that no product leaves f64's
//! range: what is not zero is at least 2^-894 and less than 2^780.

use crate::reference::shared::integer::Integer;

/// A number that can be added and multiplied.
pub(super) trait Number: Copy {
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn negative(self) -> Self;
    /// -1, 0 or 1; `None` where it is not known.
    fn sign(self) -> Option<i32>;
}

pub(super) fn dot<N: Number>(a: [N; 3], b: [N; 3]) -> N {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}

pub(super) fn cross<N: Number>(a: [N; 3], b: [N; 3]) -> [N; 3] {
    let component = |i: usize, j: usize| a[i].times(b[j]).minus(a[j].times(b[i]));
    [component(1, 2), component(2, 0), component(0, 1)]
}

/// A number that is within `error` of `value`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ball {
    pub value: f64,
    pub error: f64,
}

/// The largest relative error of one rounding.
const UNIT: f64 = f64::EPSILON / 2.0;
/// More than the roundings of a bound itself, of which no step has more than five.
const ROUND_UP: f64 = 1.0 + 8.0 * f64::EPSILON;

impl Ball {
    pub fn exact(value: f64) -> Ball {
        Ball { value, error: 0.0 }
    }

    /// The difference of two floats, which f64 mostly has without rounding.
    pub fn difference(a: f32, b: f32) -> Ball {
        let (a, b) = (f64::from(a), f64::from(b));
        let value = a - b;
        // What the rounding left out is a float, too (Knuth, "The Art of Computer Programming", volume 2, 4.2.2).
        let b_part = a - value;
        let is_exact = (a - (value + b_part)) + (b_part - b) == 0.0;
        Ball { value, error: if is_exact { 0.0 } else { UNIT * value.abs() } }
    }

    fn rounded(value: f64, error: f64) -> Ball {
        Ball { value, error: (error + UNIT * value.abs()) * ROUND_UP }
    }

    /// The quotient; `None` where the divisor may be 0.
    pub fn over(self, divisor: Ball) -> Option<Ball> {
        let least = divisor.value.abs() - divisor.error * ROUND_UP;
        if least <= 0.0 {
            return None;
        }
        let value = self.value / divisor.value;
        Some(Ball::rounded(value, (self.error + value.abs() * ROUND_UP * divisor.error) / least))
    }

    /// The float nearest to the number; `None` where that is not known.
    pub fn to_f32(self) -> Option<f32> {
        let error = self.error * ROUND_UP;
        let [low, high] = [self.value - error, self.value + error];
        // The sum and the difference have a rounding of their own.
        let [low, high] = match error {
            0.0 => [low, high],
            _ => [low.next_down(), high.next_up()],
        };
        let rounded = low as f32 + 0.0; // no negative zero
        (rounded.to_bits() == (high as f32 + 0.0).to_bits()).then_some(rounded)
    }

    /// The float nearest to the square root of the number.
    pub fn sqrt_to_f32(self) -> Option<f32> {
        let error = self.error * ROUND_UP;
        let low = (self.value - error).next_down().max(0.0).sqrt().next_down();
        let high = (self.value + error).next_up().sqrt().next_up();
        let rounded = low as f32;
        (low > 0.0 && rounded == high as f32).then_some(rounded)
    }
}

impl Number for Ball {
    fn plus(self, other: Ball) -> Ball {
        Ball::summed(self, other, self.value + other.value)
    }

    fn minus(self, other: Ball) -> Ball {
        Ball::summed(self, other, self.value - other.value)
    }

    fn times(self, other: Ball) -> Ball {
        let error = self.value.abs() * other.error + (other.value.abs() + other.error) * self.error;
        Ball::rounded(self.value * other.value, error)
    }

    fn negative(self) -> Ball {
        Ball { value: -self.value, error: self.error }
    }

    fn sign(self) -> Option<i32> {
        if self.value.abs() > self.error {
            return Some(if self.value > 0.0 { 1 } else { -1 });
        }
        (self.error == 0.0).then_some(0)
    }
}

impl Ball {
    /// A sum of which one number is exactly zero has no rounding: axes' planes are frequent.
    fn summed(a: Ball, b: Ball, value: f64) -> Ball {
        let is_exact = (a.value == 0.0 || b.value == 0.0) && a.error + b.error == 0.0;
        if is_exact { Ball::exact(value) } else { Ball::rounded(value, a.error + b.error) }
    }
}

/// An exact integer: a number of units, all of whose limbs count.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exact<const ROOM: usize>(pub Integer<ROOM>);

impl<const ROOM: usize> Exact<ROOM> {
    /// The difference of two floats in units of 2^`exponent`, of which both are multiples.
    pub fn difference(a: f32, b: f32, exponent: i32) -> Self {
        let whole = |x: f32| Exact(Integer::from_float(x, exponent, ROOM));
        whole(a).minus(whole(b))
    }

    fn sum(mut self, other: Self, sign: i32) -> Self {
        self.0.add(&other.0, sign, ROOM);
        self
    }

    /// -1, 0 or 1.
    pub fn known_sign(&self) -> i32 {
        self.0.sign(ROOM)
    }
}

impl<const ROOM: usize> Number for Exact<ROOM> {
    fn plus(self, other: Self) -> Self {
        self.sum(other, 1)
    }

    fn minus(self, other: Self) -> Self {
        self.sum(other, -1)
    }

    fn times(self, other: Self) -> Self {
        let mut product = Integer::ZERO;
        product.add_product(&self.0, &other.0, 1, ROOM);
        Exact(product)
    }

    fn negative(self) -> Self {
        Exact(self.0.negated(ROOM))
    }

    fn sign(self) -> Option<i32> {
        Some(self.known_sign())
    }
}
