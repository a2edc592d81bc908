//! Loads a scene by the kind of its file.

use super::{Scene, SourceFile, file, nff, obj, ply, stl};
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::{Error, Result};
use std::path::Path;

/// The endings of the files that hold a model: what an object of a scene file can name.
pub(super) const MODELS: [&str; 4] = ["obj", "ply", "stl", "nff"];

/// The ending of `path`, which tells its kind, in lower case.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase)
}

/// Loads the scene in `path`: a `.toml` scene file (see `docs/book/src/scenes.md`), a Wavefront `.obj`, a `.ply`, a `.stl` or
/// an `.nff`; in what memory there is ([`MemoryBudget::available`]).
///
/// # Errors
/// As [`load_within`].
pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
    load_within(path, &MemoryBudget::available())
}

/// As [`load`], with a memory of its own choice.
///
/// # Errors
/// The file cannot be read, is not of a known kind, or what it holds is not usable; the error names file and line.
/// [`Error::OutOfMemory`] when it takes more than `budget` has.
pub fn load_within(path: impl AsRef<Path>, budget: &MemoryBudget) -> Result<Scene> {
    let path = path.as_ref();
    let mut scene = match ending(path).as_deref() {
        Some("toml") => file::load(path, budget),
        Some("obj") => obj::load(path, budget),
        Some("ply") => ply::load(path, budget),
        Some("nff") => nff::load(path, budget),
        Some("stl") => stl::load(path, budget),
        _ => Err(Error::input(
            path,
            None,
            "not a known kind of scene; raybrook reads .toml scene files, Wavefront .obj, .ply, .stl and Haines' .nff",
        )),
    }?;
    scene.files.push(SourceFile { path: path.to_owned(), role: "the scene".to_owned() });
    Ok(scene)
}

/// The line of a text on which vertex number `vertex` of [`Scene::positions`] stands, for messages: of an OBJ file.
/// None of other files, or when it cannot be found any more.
pub fn line_of_vertex(path: impl AsRef<Path>, vertex: usize) -> Option<usize> {
    let path = path.as_ref();
    if ending(path).as_deref() == Some("obj") { obj::line_of_vertex(path, vertex) } else { None }
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
