//! What all loaders share: the memory that reading takes, the kinds of files, pieces of lists.

use super::Scene;
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::{Error, Result};
use std::path::Path;

/// Loads one kind of file, with this memory.
pub(super) type Loader = fn(&Path, &MemoryBudget) -> Result<Scene>;

/// Endings of files, and what loads them.
pub(super) type Loaders = [(&'static str, Loader)];

/// What loads `path`, by its ending.
pub(super) fn loader_of(path: &Path, loaders: &Loaders) -> Option<Loader> {
    let ending = ending(path)?;
    loaders.iter().find(|(known, _)| *known == ending).map(|(_, load)| *load)
}

/// The ending of `path`, which tells its kind, in lower case.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase)
}

/// Checks that there is memory for the so many bytes that reading `path` takes.
pub(super) fn check_memory(path: &Path, bytes: u64, budget: &MemoryBudget) -> Result<()> {
    budget.check(&need(&path.display().to_string(), bytes))
}

/// The error that the system has no memory for `bytes` of `path`.
pub(super) fn refused(path: &Path, bytes: u64) -> Error {
    need(&path.display().to_string(), bytes).refused()
}

fn need(what: &str, bytes: u64) -> Need<'_> {
    Need {
        what,
        bytes,
        decided_by: DecidedBy::Input,
        remedy: "take a model of fewer triangles, or raise `memory_limit`",
    }
}

/// Pieces of `target` that are as long as `lengths` say; these add up to its own.
pub(super) fn split_by<T>(mut target: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let piece = |length| target.split_off_mut(..length).expect("the lengths add up");
    lengths.map(piece).collect()
}
