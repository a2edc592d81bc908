//! Loads a scene by the kind of its file.

use super::reading::{Loaders, ending, loader_of};
use super::{Scene, SourceFile, file, gltf, nff, obj, off, ply, stl, threemf};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use std::path::Path;

/// The files that hold a model: what an object of a scene file can name.
const MODELS: &Loaders = &[
    ("obj", obj::load),
    ("ply", ply::load),
    ("stl", stl::load),
    ("gltf", gltf::load),
    ("glb", gltf::load),
    ("off", off::load),
    ("3mf", threemf::load),
    ("nff", nff::load),
];

/// Loads the scene in `path`: a `.toml` scene file (see `docs/book/src/scenes.md`), a Wavefront `.obj`, a `.ply`, a
/// `.stl`, glTF 2.0 as `.gltf` or `.glb`, an `.off`, a `.3mf` or an `.nff`; in what memory there is
/// ([`MemoryBudget::available`]).
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
    let mut scene = match (ending(path).as_deref(), loader_of(path, MODELS)) {
        (Some("toml"), _) => file::load(path, budget, MODELS),
        (_, Some(load)) => load(path, budget),
        _ => Err(Error::input(
            path,
            None,
            "not a known kind of scene; raybrook reads .toml scene files, Wavefront .obj, .ply, .stl, .gltf, .glb, \
             .off, .3mf and Haines' .nff",
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
