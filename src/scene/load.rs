//! Loads a scene by the kind of its file.

use super::reading::{Loaders, ending, loader_of};
use super::{Scene, SourceFile, file, gltf, nff, obj, off, ply, stl, threemf};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::io::input::open_regular;
use glam::Vec3;
use std::io::Read;
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
    scene.up = scene.up.or_else(|| up_of_file(path));
    scene.files.push(SourceFile { path: path.to_owned(), role: "the scene".to_owned() });
    Ok(scene)
}

/// Programs that write a kind of file with z up unless their users choose otherwise, though the format says nothing:
/// the file's ending, and what a comment at its head says. Blender writes `.obj` files with y up: these have none.
const WRITERS_WITH_Z_UP: &[(&str, &str)] = &[
    ("ply", "comment Created by Blender"),
    ("ply", "comment Created in Blender"),
    ("obj", "# Created by FreeCAD"),
    ("obj", "# OpenSCAD obj exporter"),
];

/// How much of a file is searched for the name of its writer, bytes.
const HEAD_BYTES: u64 = 512;

/// Which way is up by the rule of the format of the file at `path`, or of the program that wrote it. The loaders of
/// formats with z up say so themselves.
fn up_of_file(path: &Path) -> Option<Vec3> {
    let ending = ending(path)?;
    if ["toml", "gltf", "glb"].contains(&&*ending) {
        return Some(Vec3::Y);
    }
    let comments: Vec<&str> = WRITERS_WITH_Z_UP.iter().filter(|(kind, _)| *kind == ending).map(|(_, c)| *c).collect();
    if comments.is_empty() {
        return None;
    }
    // The scene was read from it a moment ago: where that is over, nothing is known.
    let mut head = Vec::new();
    open_regular(path).ok()?.0.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
    let says = |line: &[u8]| comments.iter().any(|comment| line.starts_with(comment.as_bytes()));
    head.split(|&byte| byte == b'\n').any(says).then_some(Vec3::Z)
}

/// The line of a text on which vertex number `vertex` of [`Scene::positions`] stands, for messages: of an OBJ file.
/// None of other files, or when it cannot be found any more.
pub fn line_of_vertex(path: impl AsRef<Path>, vertex: usize) -> Option<usize> {
    let path = path.as_ref();
    if ending(path).as_deref() == Some("obj") { obj::line_of_vertex(path, vertex) } else { None }
}
