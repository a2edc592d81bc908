//! Twin of `cl/shared/hash.cl`: random bits that are the same everywhere. The reasons are there.

use crate::shared::constants::{HASH_FIRST, HASH_SECOND, HASH_X};

/// A permutation of all words.
#[inline(always)]
pub fn mix_bits(hash: u32) -> u32 {
    let mut h = hash;
    h = (h ^ (h >> 16)).wrapping_mul(HASH_FIRST);
    h = (h ^ (h >> 13)).wrapping_mul(HASH_SECOND);
    h ^ (h >> 16)
}

/// The hash of some words and one more.
#[inline(always)]
pub fn hash_word(hash: u32, word: u32) -> u32 {
    mix_bits(hash ^ word.wrapping_mul(HASH_X))
}
