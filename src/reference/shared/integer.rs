//! Twin of `cl/shared/integer.cl`: exact integers of any length that a ray-triangle test needs. The reasons are there.

/// The most limbs of a number: those that `integer_units()` of `cl/intersect/exact_integers.cl` takes where positions
/// are any floats, which rays of extreme numbers need (`src/reference/extreme.rs`). In the bits of its formula such
/// positions have p = 277 + 149 and directions d = 277.
pub const MAX_LIMBS: usize = 77;

/// Two's complement, least significant limb first; the first `n` limbs, which every function is told, count. There is
/// room for `ROOM`: most numbers have a fifth of the most limbs, and copying the others took most of the time.
#[derive(Debug, Clone, Copy)]
pub struct Integer<const ROOM: usize> {
    limbs: [u32; ROOM],
}

impl<const ROOM: usize> Integer<ROOM> {
    /// Zero.
    pub const ZERO: Self = Integer { limbs: [0; ROOM] };

    /// A small number.
    pub fn from_limb(limb: u32) -> Self {
        let mut r = Self::ZERO;
        r.limbs[0] = limb;
        r
    }

    /// `x / 2^exponent`; bits below 1 are dropped. `x` is finite.
    pub fn from_float(x: f32, exponent: i32, n: usize) -> Self {
        let (mut significand, own) = float_significand(x);
        let mut r = Self::ZERO;
        if significand == 0 {
            return r;
        }
        let mut shift = own - exponent;
        if shift < 0 {
            significand = if shift > -32 { significand >> -shift } else { 0 };
            shift = 0;
        }
        r.limbs[0] = significand;
        r.shift_up(shift as usize, n);
        if x.is_sign_negative() { r.negated(n) } else { r }
    }

    fn is_negative(&self, n: usize) -> bool {
        self.limbs[n - 1] >> 31 != 0
    }

    fn is_zero(&self, n: usize) -> bool {
        self.limbs[..n].iter().all(|&limb| limb == 0)
    }

    /// -1, 0 or 1.
    pub fn sign(&self, n: usize) -> i32 {
        if self.is_negative(n) { -1 } else { i32::from(!self.is_zero(n)) }
    }

    /// Adds `sign` (1 or -1) times `b`.
    pub fn add(&mut self, b: &Self, sign: i32, n: usize) {
        let flip = if sign < 0 { u32::MAX } else { 0 };
        let mut carry = u64::from(flip & 1);
        for i in 0..n {
            carry += u64::from(self.limbs[i]) + u64::from(b.limbs[i] ^ flip);
            self.limbs[i] = carry as u32;
            carry >>= 32;
        }
    }

    /// The number with the other sign.
    pub fn negated(&self, n: usize) -> Self {
        let mut r = Self::ZERO;
        r.add(self, -1, n);
        r
    }

    /// Makes it its magnitude; returns the sign that it had.
    pub fn take_sign(&mut self, n: usize) -> i32 {
        let sign = self.sign(n);
        if sign < 0 {
            *self = self.negated(n);
        }
        sign
    }

    /// The magnitude, and how many limbs of it matter; changes `sign` if the number is negative.
    fn magnitude(&self, sign: &mut i32, n: usize) -> (Self, usize) {
        let mut magnitude = *self;
        if magnitude.take_sign(n) < 0 {
            *sign = -*sign;
        }
        let length = magnitude.limbs[..n].iter().rposition(|&limb| limb != 0).map_or(0, |i| i + 1);
        (magnitude, length)
    }

    /// Adds `sign * a * b`.
    pub fn add_product(&mut self, a: &Self, b: &Self, mut sign: i32, n: usize) {
        let (x, x_length) = a.magnitude(&mut sign, n);
        let (y, y_length) = b.magnitude(&mut sign, n);
        let mut product = Self::ZERO;
        for i in 0..x_length {
            let factor = u64::from(x.limbs[i]);
            let mut carry = 0;
            for j in 0..n - i {
                if j >= y_length && carry == 0 {
                    break;
                }
                carry += factor * u64::from(y.limbs[j]) + u64::from(product.limbs[i + j]);
                product.limbs[i + j] = carry as u32;
                carry >>= 32;
            }
        }
        self.add(&product, sign, n);
    }

    /// Position of the highest bit of a number that is not negative, counted from 1; 0 for zero.
    pub fn bits(&self, n: usize) -> i32 {
        let highest = self.limbs[..n].iter().rposition(|&limb| limb != 0);
        highest.map_or(0, |i| 32 * (i as i32 + 1) - self.limbs[i].leading_zeros() as i32)
    }

    /// Multiplies by `2^shift`.
    pub fn shift_up(&mut self, shift: usize, n: usize) {
        let (limbs, bits) = (shift / 32, shift % 32);
        for i in (0..n).rev() {
            self.limbs[i] = if i >= limbs { self.limbs[i - limbs] } else { 0 };
        }
        let mut carry = 0;
        for limb in &mut self.limbs[..n] {
            carry += u64::from(*limb) << bits;
            *limb = carry as u32;
            carry >>= 32;
        }
    }
}

/// The float's significand as an integer, and the exponent with |x| = significand * 2^exponent.
pub fn float_significand(x: f32) -> (u32, i32) {
    let bits = x.to_bits();
    let field = bits >> 23 & 255;
    let hidden = if field == 0 { 0 } else { 0x80_0000 };
    (bits & 0x7f_ffff | hidden, field.max(1) as i32 - 150)
}

/// Widens `lowest..highest` to the exponents of the lowest and behind the highest bit of x; zero has none.
pub fn widen_exponents(x: f32, lowest: &mut i32, highest: &mut i32) {
    let (significand, exponent) = float_significand(x);
    if significand != 0 {
        *lowest = (exponent + significand.trailing_zeros() as i32).min(*lowest);
        *highest = (exponent + 32 - significand.leading_zeros() as i32).max(*highest);
    }
}

fn float_from_parts(significand: u32, exponent: i32) -> f32 {
    let lift = if exponent < -102 { 24 } else { 0 };
    let power = f32::from_bits(((exponent + lift + 127) as u32) << 23);
    significand as f32 * power * if lift != 0 { 1.0 / 16_777_216.0 } else { 1.0 }
}

/// The float nearest to `numerator / denominator * 2^exponent`, ties to even; infinity where there is none.
pub fn integer_quotient<const ROOM: usize>(
    mut numerator: Integer<ROOM>,
    mut denominator: Integer<ROOM>,
    exponent: i32,
    n: usize,
) -> f32 {
    let sign = numerator.take_sign(n) * denominator.take_sign(n);
    if sign == 0 {
        return 0.0;
    }
    let (denominator_bits, numerator_bits) = (denominator.bits(n), numerator.bits(n));
    let scale = denominator_bits - numerator_bits;
    let n = (denominator_bits.max(numerator_bits) as usize + 2).div_ceil(32);
    debug_assert!(n <= ROOM);
    if scale >= 0 {
        numerator.shift_up(scale as usize, n);
    } else {
        denominator.shift_up(-scale as usize, n);
    }
    let mut quotient = 0u32;
    for _ in 0..26 {
        quotient <<= 1;
        numerator.add(&denominator, -1, n);
        if numerator.is_negative(n) {
            numerator.add(&denominator, 1, n);
        } else {
            quotient |= 1;
        }
        let once = numerator;
        numerator.add(&once, 1, n);
    }
    let is_inexact = !numerator.is_zero(n);
    let bits = 32 - quotient.leading_zeros() as i32;
    let unit = exponent - scale - 25;
    let dropped = (bits - 24).max(-149 - unit);
    if dropped > 27 {
        return 0.0;
    }
    if unit + bits > 129 {
        return if sign > 0 { f32::INFINITY } else { f32::NEG_INFINITY };
    }
    let mut significand = quotient >> dropped;
    let rest = quotient - (significand << dropped);
    let half_unit = 1 << (dropped - 1);
    if rest > half_unit || (rest == half_unit && (is_inexact || significand & 1 != 0)) {
        significand += 1;
    }
    (if sign < 0 { -1.0 } else { 1.0 }) * float_from_parts(significand, unit + dropped)
}
