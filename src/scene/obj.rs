//! Loads Wavefront OBJ files.
//!
//! Format: Wavefront, "Advanced Visualizer" manual, appendix B1 (Object Files), as written in practice. The text is cut
//! into parts that all processors read at the same time, three times over: `survey.rs` counts statements, so that each
//! part knows the numbers of its first line, vertex and triangle; `vertices.rs` reads what faces refer to; `faces.rs`
//! reads these, so that every index can be checked and negative ones and faces before their vertices mean what they
//! should. Each part writes to its own piece of the scene's arrays. Polygons are split by [`super::triangulate`];
//! materials come from [`super::mtl`], beside the vertices.
//!
//! The `tobj` crate is what tests compare with. It read the files until it was too slow: alone and without any of the
//! checks 37 to 47 MB/s for files of 1 and 5 million triangles, as it gives every corner to hash maps, and it can
//! neither read from parts nor give vertices without faces. It also fails on byte order marks, on continued lines, on
//! old Mac line ends and on comments that are not UTF-8, gives a corner without a normal that of the corner before it,
//! and has no line numbers in its errors.
//!
//! Bad at: memory. A file is read whole, and stays until the scene is complete.

mod faces;
mod survey;
#[cfg(test)]
mod tests;
mod vertices;

use super::mtl::Library;
use super::reading::{check_memory, read_all, warn_of_dropped};
use super::text::{Warnings, split_keyword};
use super::{Scene, Triangle};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use faces::{Materials, Tallies};
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::path::Path;
use survey::{PART_BYTES, Survey};
use vertices::Vertices;

/// The largest OBJ or NFF file that is read. Its text has to fit into memory, and its indices into 32 bits: a vertex
/// takes at least 8 bytes of text, a triangle of a polygon 2.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// What is wrong with a line.
type Fault = (usize, String);

/// Loads the OBJ file at `path`: a scene without lights and camera. Only files in its folder and below are opened.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    load_in_parts(path, PART_BYTES, budget)
}

/// The line of vertex statement number `vertex`, counted from 0.
pub(super) fn line_of_vertex(path: &Path, vertex: usize) -> Option<usize> {
    let text = read_text(path, 1, &MemoryBudget::UNLIMITED).ok()?;
    let survey = Survey::new(&text, PART_BYTES);
    let part = survey.parts.iter().rev().find(|part| part.before[0] <= vertex)?;
    let is_vertex = |line: &(usize, Cow<[u8]>)| split_keyword(&line.1).0 == b"v";
    part.lines().filter(is_vertex).nth(vertex - part.before[0]).map(|(line, _)| line)
}

/// Bytes of a scene's arrays with so many positions, texture coordinates and normals, and so many triangles.
fn scene_bytes([positions, uvs, normals]: [usize; 3], triangles: usize) -> u64 {
    let vectors = size_of::<Vec3>() as u64 * (positions as u64 + normals as u64);
    vectors + size_of::<Vec2>() as u64 * uvs as u64 + size_of::<Triangle>() as u64 * triangles as u64
}

/// Loads a file in parts of about `part_bytes`.
fn load_in_parts(path: &Path, part_bytes: usize, budget: &MemoryBudget) -> Result<Scene> {
    let text = read_text(path, 1, budget)?;
    let survey = Survey::new(&text, part_bytes);
    if survey.faces == 0 {
        return Err(Error::input(path, None, "has no faces (lines that begin with 'f'); is it a Wavefront OBJ file?"));
    }
    let bytes = scene_bytes(survey.counts, survey.triangles);
    check_memory(path, bytes, budget)?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let root = folder.canonicalize().map_err(|e| Error::io("read", folder, e))?;
    let mut library = Library::new(path, root, *budget);
    survey.ignored.report(path, &mut library.warnings);
    for (line, names) in &survey.libraries {
        library.read_libraries(*line, names);
    }

    // Materials come with textures, which take time to decode.
    let (materials, vertices) = rayon::join(|| materials(&survey, &mut library), || vertices::read(&survey));
    let at_line = |(line, message): Fault| Error::input(path, line, message);
    let vertices = vertices.map_err(at_line)?;
    let (triangles, tallies) = faces::read(&survey, &vertices, &materials).map_err(at_line)?;
    if triangles.is_empty() {
        return Err(Error::input(path, None, "has no face of three or more corners"));
    }
    warn_of_faces(path, tallies, &mut library.warnings);
    let Vertices { positions, uvs, normals, extras } = vertices;
    library.warnings.tally(path, extras, "colours and weights of vertices not used");
    let mut scene = Scene { positions, normals, uvs, triangles, ..Scene::default() };
    warn_of_dropped(path, &scene, &mut library.warnings);
    scene.files = library.take_files();
    scene.materials = library.materials;
    scene.textures = library.textures;
    scene.warnings = library.warnings.into_vec();
    Ok(scene)
}

/// Gives numbers to the materials in the order in which faces may first need them.
fn materials<'a>(survey: &'a Survey, library: &mut Library) -> Materials<'a> {
    let bare = if survey.has_bare_faces { library.default_material() } else { 0 };
    let find =
        |(line, name): &'a (usize, survey::Name)| (&name[..], library.find(&String::from_utf8_lossy(name), *line));
    Materials { by_name: survey.materials.iter().map(find).collect(), bare }
}

/// Reads a regular file that may be OBJ, NFF or OFF text, for each byte of which so much memory is needed from here on.
pub(super) fn read_text(path: &Path, bytes_per_byte: u64, budget: &MemoryBudget) -> Result<Vec<u8>> {
    read_all(path, MAX_FILE_BYTES, (bytes_per_byte, budget), |head| {
        if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
            return Err(Error::input(path, 1, "is UTF-16 text; save it as UTF-8"));
        }
        if head.contains(&0) {
            return Err(Error::input(path, None, "is not text (it has NUL bytes); only the text form is read"));
        }
        Ok(())
    })
}

/// What was read of all parts, or what is wrong with the first part at fault.
fn first_fault<T>(parts: Vec<std::result::Result<T, Fault>>) -> std::result::Result<Vec<T>, Fault> {
    parts.into_iter().collect()
}

fn warn_of_faces(path: &Path, tallies: Tallies, warnings: &mut Warnings) {
    let short = (tallies.short, "faces with fewer than three corners ignored");
    let dangling = (tallies.dangling, "texture or normal indices that refer to nothing ignored");
    for (tally, what) in [short, dangling] {
        warnings.tally(path, tally, what);
    }
    warnings.extend(path, tallies.fans);
}
