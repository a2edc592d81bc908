//! Loads a scene by the kind of its file.

use super::{Scene, SourceFile, file, nff, obj, ply, stl};
use crate::error::{Error, Result};
use std::path::Path;

/// The endings of the files that hold a model: what an object of a scene file can name.
pub(super) const MODELS: [&str; 4] = ["obj", "ply", "stl", "nff"];

/// The ending of `path`, which tells its kind, in lower case.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase)
}

/// Loads the scene in `path`: a `.toml` scene file (see `scenes/README.md`), a Wavefront `.obj`, a `.ply`, a `.stl` or an `.nff`.
///
/// # Errors
/// The file cannot be read, is not of a known kind, or what it holds is not usable; the error names file and line.
pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
    let path = path.as_ref();
    let mut scene = match ending(path).as_deref() {
        Some("toml") => file::load(path),
        Some("obj") => obj::load(path),
        Some("ply") => ply::load(path),
        Some("nff") => nff::load(path),
        Some("stl") => stl::load(path),
        _ => Err(Error::input(
            path,
            None,
            "not a known kind of scene; raybrook reads .toml scene files, Wavefront .obj, .ply, .stl and Haines' .nff",
        )),
    }?;
    scene.files.push(SourceFile { path: path.to_owned(), role: "the scene".to_owned() });
    Ok(scene)
}

/// Pieces of `target` that are as long as `lengths` say; these add up to its own.
pub(super) fn split_by<T>(mut target: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let piece = |length| target.split_off_mut(..length).expect("the lengths add up");
    lengths.map(piece).collect()
}
