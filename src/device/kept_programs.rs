//! Programs that a context keeps, so that who builds one again does not wait for it.

use super::cache::CacheKey;
use super::handle::Owned;
use opencl3::program::Program;
use std::sync::Arc;

/// How many are kept: those of all methods that take turns in a comparison.
const MOST_PROGRAMS: usize = 64;

/// The programs, the one last used at the end. The least recently used is forgotten: PoCL keeps a program's
/// intermediate code in memory.
#[derive(Debug, Default)]
pub(super) struct KeptPrograms(Vec<Kept>);

#[derive(Debug, Clone)]
pub(super) struct Kept {
    pub key: CacheKey,
    pub raw: Arc<Owned<Program>>,
    /// As [`Built::log`](super::Built::log).
    pub log: String,
}

impl KeptPrograms {
    /// The program of this key, which counts as used.
    pub fn find(&mut self, key: &CacheKey) -> Option<Kept> {
        let place = self.0.iter().position(|kept| kept.key == *key)?;
        self.0[place..].rotate_left(1);
        self.0.last().cloned()
    }

    /// Keeps one that is not there.
    pub fn keep(&mut self, kept: Kept) {
        if self.0.len() == MOST_PROGRAMS {
            self.0.remove(0);
        }
        self.0.push(kept);
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }
}
