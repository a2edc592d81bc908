//! The kinds of hard cases: one small function each, that makes a mesh and rays from random numbers.
//!
//! Coordinates called dyadic are small multiples of a small power of two, so that sums, and so hits, are exact in float32.

mod directions;
mod limits;
mod scales;
mod seams;
mod second;
mod sizes;
mod surfaces;

use super::case::Case;
use super::random::Random;
use crate::error::{Error, Result};

/// One kind of hard cases.
pub struct Kind {
    /// As the user types it.
    pub name: &'static str,
    /// What is hard about it, in one line.
    pub about: &'static str,
    make: fn(&mut Random, usize) -> Case,
}

impl Kind {
    /// Every kind.
    pub fn all() -> impl Iterator<Item = &'static Kind> {
        [seams::KINDS, directions::KINDS, surfaces::KINDS, sizes::KINDS, limits::KINDS, scales::KINDS, second::KINDS]
            .into_iter()
            .flatten()
    }

    /// The kind of this name.
    ///
    /// # Errors
    /// [`Error::Option`] when there is none; the message has the nearest name.
    pub fn find(name: &str) -> Result<&'static Kind> {
        Kind::all().find(|kind| kind.name == name).ok_or_else(|| {
            let nearest = Kind::all().max_by(|a, b| {
                let likeness = |kind: &Kind| strsim::jaro_winkler(kind.name, name);
                likeness(a).total_cmp(&likeness(b))
            });
            let hint = nearest.map_or("", |kind| kind.name);
            Error::option("KIND", format!("there is no kind '{name}'; nearest: {hint}; --list lists all"))
        })
    }

    /// The case of this kind that belongs to `seed`, with `rays` rays: always the same, whatever else is made.
    pub fn case(&self, seed: u64, rays: usize) -> Case {
        let mut random = Random(seed ^ u64::from(crc32fast::hash(self.name.as_bytes())) << 32);
        (self.make)(&mut random, rays)
    }
}
