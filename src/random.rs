//! Random numbers that are the same on every machine: whole numbers, powers of two and square roots, but no library's
//! sine or logarithm.

use glam::Vec3;
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// SplitMix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014): small, seedable,
/// good enough for test data.
#[derive(Debug, Clone)]
pub struct Random(SplitMix64);

impl Random {
    /// The numbers of `seed`, the same ones on every machine.
    pub fn new(seed: u64) -> Random {
        Random(SplitMix64::seed_from_u64(seed))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// In 0..1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    /// In -1..1.
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// In the cube -1..1.
    pub fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// Any float32 bit pattern: NaN, infinities and subnormal numbers among them.
    pub fn any_float(&mut self) -> f32 {
        f32::from_bits(self.bits() as u32)
    }

    /// A whole number from 0 to `count` - 1.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() >> 32) as usize % count
    }

    /// A whole number from `low` to `high`, both included.
    pub fn whole(&mut self, low: i32, high: i32) -> i32 {
        low + self.below((high - low + 1) as usize) as i32
    }

    /// One of `choices`.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    /// -1 or 1.
    pub fn sign(&mut self) -> f32 {
        self.pick(&[-1.0, 1.0])
    }

    /// 2^`low` to 2^`high`, every size as likely as any other.
    pub fn size(&mut self, low: i32, high: i32) -> f32 {
        power_of_two(self.whole(low, high - 1)) * (1.0 + self.unit())
    }

    /// One of `choices`, or 2^`low` to 2^`high`, which is as likely as each of them.
    pub fn size_or(&mut self, choices: &[f32], low: i32, high: i32) -> f32 {
        let i = self.below(choices.len() + 1);
        choices.get(i).copied().unwrap_or_else(|| self.size(low, high))
    }

    /// A direction of about unit length, every direction as likely as any other.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vec3();
            if (0.01..1.0).contains(&v.length_squared()) {
                return v / v.length();
            }
        }
    }
}

/// 2^exponent, 0 or infinite beyond float's range.
pub fn power_of_two(exponent: i32) -> f32 {
    let bits = match exponent {
        128.. => f32::INFINITY.to_bits(),
        -126..=127 => ((exponent + 127) as u32) << 23,
        -149..=-127 => 1 << (exponent + 149),
        _ => 0,
    };
    f32::from_bits(bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seeds of records mean the same rays for ever: the numbers of the paper's algorithm, written out.
    #[test]
    fn seeds_keep_their_meaning() {
        let mut state = 7u64;
        let mut random = Random::new(7);
        for _ in 0..1000 {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            assert_eq!(random.bits(), z ^ (z >> 31));
        }
    }
}
