//! Loads a scene by the kind of its file.

use super::{Scene, file, nff, obj};
use crate::error::{Error, Result};
use std::path::Path;

/// Loads the scene in `path`: a `.toml` scene file (see `scenes/README.md`), a Wavefront `.obj` or an `.nff`.
///
/// # Errors
/// The file cannot be read, is not of a known kind, or what it holds is not usable; the error names file and line.
pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
    let path = path.as_ref();
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("toml") => file::load(path),
        Some("obj") => obj::load(path),
        Some("nff") => nff::load(path),
        _ => Err(Error::input(
            path,
            None,
            "not a known kind of scene; raybrook reads .toml scene files, Wavefront .obj and Haines' .nff",
        )),
    }
}
