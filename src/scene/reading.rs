//! What all loaders share: reading files, the memory that this takes, the kinds of files, pieces of lists, triangles
//! that are left out.

use super::text::{Tally, Warnings};
use super::{DropReason, Scene};
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::{Error, Result};
use crate::io::input::open_regular;
use crate::parallel;
use std::io::Read;
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

/// All of the regular file at `path`, which may have so many bytes, and for each of which so much memory is needed from
/// here on. `check_head` says what is wrong with its first [`HEAD_BYTES`], before the rest is read.
pub(super) fn read_all(
    path: &Path,
    most: u64,
    (bytes_per_byte, budget): (u64, &MemoryBudget),
    check_head: impl FnOnce(&[u8]) -> Result<()>,
) -> Result<Vec<u8>> {
    let unreadable = |e| Error::io("read", path, e);
    let (mut file, bytes) = open_regular(path)?;
    if bytes > most {
        let message = format!("is larger than {} MiB, the most that is read; split it", most >> 20);
        return Err(Error::input(path, None, message));
    }
    let mut data = Vec::new();
    (&mut file).take(HEAD_BYTES).read_to_end(&mut data).map_err(unreadable)?;
    check_head(&data)?;
    check_memory(path, bytes_per_byte * bytes, budget)?;
    data.try_reserve_exact(bytes as usize).map_err(|_| refused(path, bytes))?;
    // It may be growing.
    file.take(most.saturating_sub(data.len() as u64)).read_to_end(&mut data).map_err(unreadable)?;
    Ok(data)
}

/// How much of a file is looked at before all of it is read.
pub(super) const HEAD_BYTES: u64 = 1024;

/// A list that takes less is made without asking how much memory there is.
const CHECKED_LIST_BYTES: usize = 1 << 20;

/// Makes room for `more` values behind those of `list`, and checks that there is memory for them. The room doubles at
/// the least, so that the list is seldom moved.
pub(super) fn make_room<T>(list: &mut Vec<T>, more: usize, path: &Path, budget: &MemoryBudget) -> Result<()> {
    if list.capacity() - list.len() >= more {
        return Ok(());
    }
    let room = (list.len() + more).max(2 * list.capacity());
    let bytes = room.saturating_mul(size_of::<T>());
    // Where it moves, the old list is among what the process has.
    if bytes >= CHECKED_LIST_BYTES {
        check_memory(path, bytes as u64, budget)?;
    }
    list.try_reserve_exact(room - list.len()).map_err(|_| refused(path, bytes as u64))
}

/// Pieces of `target` that are as long as `lengths` say; these add up to its own.
pub(super) fn split_by<T>(mut target: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let piece = |length| target.split_off_mut(..length).expect("the lengths add up");
    lengths.map(piece).collect()
}

/// One warning for each reason why triangles cannot be hit.
pub(super) fn warn_of_dropped(path: &Path, scene: &Scene, warnings: &mut Warnings) {
    let none = [Tally::default(); 2];
    let of_triangle = |primitive: usize| {
        let mut tallies = none;
        if let Some(why) = scene.drop_reason(primitive) {
            tallies[usize::from(why == DropReason::ZeroArea)].note(primitive);
        }
        tallies
    };
    let tallies = parallel::reduce_numbers(scene.triangles.len(), none, of_triangle, |mut earlier, later| {
        earlier.iter_mut().zip(later).for_each(|(tally, later)| tally.append(later, 0));
        earlier
    });
    // Of objects with instances each once, however often they stand somewhere.
    let objects = scene.instances.objects().iter();
    let reasons = objects.flat_map(|object| {
        object.triangles.iter().filter_map(|t| DropReason::of(t.positions.map(|i| object.positions[i as usize])))
    });
    let mut of_objects = [0usize; 2];
    reasons.for_each(|why| of_objects[usize::from(why == DropReason::ZeroArea)] += 1);
    let names = ["with NaN or infinite vertices", "without area"];
    for ((tally, count), what) in tallies.into_iter().zip(of_objects).zip(names) {
        if tally.count > 0 {
            let message = format!("triangles {what} left out: {}, the first is number {}", tally.count, tally.first);
            warnings.add(path, None, message);
        }
        if count > 0 {
            warnings.add(path, None, format!("triangles {what} of objects with instances left out: {count}"));
        }
    }
}
