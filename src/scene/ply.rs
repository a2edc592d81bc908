//! Loads PLY files, text and binary of both byte orders.
//!
//! Format: G. Turk, "The PLY Polygon File Format", 1994, and what writers have added to it since. The header is parsed
//! by the `serde-ply` crate. Rows are read by `whole.rs`, by all processors at the same time, or where something is
//! wrong with them streamed by `serde-ply`, from bytes that `source.rs` prepares; polygons are split by
//! [`super::triangulate`].
//!
//! | element | property | becomes |
//! |---|---|---|
//! | `vertex` | `x` `y` `z` | positions |
//! | | `nx` `ny` `nz` | normals |
//! | | `u` `v`, `s` `t`, `texture_u` `texture_v` | texture coordinates |
//! | | `red` `green` `blue` (also `r`, `diffuse_red`, …) | a triangle's colour is the mean of its corners' |
//! | `face` | `vertex_indices`, `vertex_index` | a polygon |
//! | | `texcoord` | texture coordinates of its corners, before those of vertices |
//! | | `red` `green` `blue` | its colour, where vertices have none |
//! | | `texnumber` | which `comment TextureFile` is its texture; the first when missing |
//!
//! Colours are values as displayed (sRGB): 0 to 255, 0 to 65535 for integers of 16 bits, 0 to 1 for floats; kept in 8
//! bits. The material model has no colours of vertices, so each colour becomes a matt material (`../paint.rs`), and
//! where a texture could be loaded colours are not used. What else a file has is read over and told in a warning.
//!
//! Bad at: smooth colours on large triangles. Triangle strips and point clouds are refused.

mod faces;
mod rows;
mod source;
mod textures;
mod values;
mod vertices;
mod whole;

use super::paint;
use super::reading::{check_memory, refused, warn_of_dropped};
use super::text::{Warnings, quote};
use super::{Image, Scene, Texture, Triangle};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::io::input::open_regular;
use faces::{FaceSink, Faces};
use rows::{Element, Skip};
use serde::de::MapAccess;
use serde_ply::{DeserializeError, ElementDef, PlyHeader, PlyReader};
use source::Source;
use std::cell::Cell;
use std::io::ErrorKind;
use std::path::Path;
use vertices::Vertices;
use whole::Whole;

/// How many properties and elements that are not used are told by name.
const MAX_NAMES: usize = 12;

/// The largest file that is read into memory; larger ones are streamed, which takes longer.
const MAX_WHOLE_BYTES: u64 = 1 << 30;

/// Loads the PLY file at `path`: a scene without lights and camera. Only textures in its folder and below are opened.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let row_ended = Cell::new(true);
    let (file, bytes) = open_regular(path)?;
    let mut source = Source::new(path, file, &row_ended)?;
    let header = match PlyReader::from_reader(&mut source) {
        Ok(reader) => reader.header().clone(),
        Err(fault) => return Err(header_fault(path, &source, fault)),
    };
    let mut warnings = Warnings::default();
    let mut mesh = Mesh::new(path, &header, &mut warnings, budget)?;
    check_memory(path, mesh.estimated_bytes(&header, bytes), budget)?;
    let whole = if bytes <= MAX_WHOLE_BYTES { mesh.read_whole(path, &mut source, &header)? } else { None };
    let (has_more, left_out) = match whole {
        Some(found) => found,
        None => {
            mesh.stream(path, &mut source)?;
            (source.has_more().map_err(|e| Error::io("read", path, e))?, source.left_out)
        }
    };
    if has_more {
        warnings.add(path, None, "has more data than its header promises; the rest is not read");
    }
    if left_out {
        warnings.add(path, None, "has lines with more values than the header promises; the rest of each is not read");
    }
    mesh.finish(path, &header, warnings)
}

/// What is read of a file.
struct Mesh {
    /// Numbers of the elements.
    vertex: usize,
    face: usize,
    vertices: Vertices,
    faces: Faces,
    textures: Vec<Image>,
}

impl Mesh {
    /// Nothing read yet; the textures that `header` names are loaded.
    fn new(path: &Path, header: &PlyHeader, warnings: &mut Warnings, budget: &MemoryBudget) -> Result<Mesh> {
        let fault = |message: String| Error::input(path, None, message);
        let find = |name: &str| header.elem_defs.iter().position(|e| e.name == name && e.count > 0);
        let (Some(vertex), Some(face)) = (find("vertex"), find("face")) else {
            return Err(fault(without_faces(header)));
        };
        let [vertex_element, face_element] = [vertex, face].map(|i| &header.elem_defs[i]);
        let vertices = Vertices::new(vertex_element).map_err(fault)?;
        let (numbers, textures) = match vertices.has_uvs || Faces::has_texcoords(face_element) {
            true => textures::load_textures(path, &header.comments, warnings, budget),
            false => Default::default(),
        };
        let faces = Faces::new(face_element, &vertices, numbers, (path, budget)).map_err(fault)?;
        Ok(Mesh { vertex, face, vertices, faces, textures })
    }

    /// About how many bytes are taken while a file of `file_bytes` is read: most faces are triangles, and parts that
    /// were read by several threads are there once more when they are joined. Rows that a header promises beyond the
    /// file's end count for nothing.
    fn estimated_bytes(&self, header: &PlyHeader, file_bytes: u64) -> u64 {
        let rows = |element: usize| (header.elem_defs[element].count as u64).min(file_bytes);
        let text = if file_bytes <= MAX_WHOLE_BYTES { file_bytes } else { 0 };
        text + self.vertices.row_bytes() * rows(self.vertex) + 2 * size_of::<Triangle>() as u64 * rows(self.face)
    }

    /// Reads the file into memory and all of it at the same time: whether there is more after its rows, and in lines
    /// beside them. None if that cannot be done, and nothing is read.
    fn read_whole(&mut self, path: &Path, source: &mut Source, header: &PlyHeader) -> Result<Option<(bool, bool)>> {
        let data = source.data().map_err(|e| match e.kind() {
            ErrorKind::OutOfMemory => refused(path, MAX_WHOLE_BYTES),
            _ => Error::io("read", path, e),
        })?;
        let (vertices, faces) = ((self.vertex, &self.vertices), (self.face, &self.faces));
        let whole = whole::read(header, &data, source.line_end, vertices, faces);
        Ok(whole.map(|Whole { vertices, faces, has_more, left_out }| {
            (self.vertices, self.faces) = (vertices, faces);
            (has_more, left_out)
        }))
    }

    /// Reads the file piece by piece.
    fn stream(&mut self, path: &Path, source: &mut Source) -> Result<()> {
        // A fresh start, also for the time that polygons may take.
        self.faces = self.faces.afresh();
        // Polygons are split where their corners are known: a file with its faces first is read twice.
        let passes: &[&[usize]] =
            if self.face < self.vertex { &[&[self.vertex], &[self.face]] } else { &[&[self.vertex, self.face]] };
        for wanted in passes {
            self.read(path, source, wanted)?;
        }
        Ok(())
    }

    /// Reads the file once; of its elements only those that are `wanted`.
    fn read(&mut self, path: &Path, source: &mut Source, wanted: &[usize]) -> Result<()> {
        let row_ended = source.row_ended;
        source.rewind().map_err(|e| Error::io("read", path, e))?;
        let rows = Cell::new(0);
        let mut reader = match PlyReader::from_reader(&mut *source) {
            Ok(reader) => reader,
            Err(fault) => return Err(header_fault(path, source, fault)),
        };
        for number in 0..reader.header().elem_defs.len() {
            let ElementDef { name, count, properties } = reader.header().elem_defs[number].clone();
            let properties = properties.len();
            let (rows, mut reader) = (&rows, &mut reader);
            rows.set(0);
            let read = if !wanted.contains(&number) {
                reader.next_value_seed(Element { properties, sink: &mut Skip, rows, row_ended })
            } else if number == self.vertex {
                reader.next_value_seed(Element { properties, sink: &mut self.vertices, rows, row_ended })
            } else {
                let mut sink = FaceSink { faces: &mut self.faces, vertices: &self.vertices };
                reader.next_value_seed(Element { properties, sink: &mut sink, rows, row_ended })
            };
            if let Err(fault) = read {
                if let Some(refused) = self.faces.refused.take() {
                    return Err(refused);
                }
                return Err(row_fault(path, source, &name, rows.get(), count, fault));
            }
        }
        Ok(())
    }

    /// The scene, and what there is to say of it.
    fn finish(self, path: &Path, header: &PlyHeader, mut warnings: Warnings) -> Result<Scene> {
        let faces = &self.faces;
        if faces.triangles.is_empty() {
            return Err(Error::input(path, None, "has no face of three or more corners"));
        }
        for (tally, what) in [
            (faces.short, "faces with fewer than three corners"),
            (faces.odd_texcoords, "lists 'texcoord' that do not have two numbers for each corner"),
        ] {
            if tally.count > 0 {
                let message = format!("{what} ignored: {}, the first is of face {}", tally.count, tally.first);
                warnings.add(path, None, message);
            }
        }
        let unused = self.unused(header).map(|unused| format!("not used: {unused}"));
        if !self.textures.is_empty() && (self.vertices.has_colours || faces.has_colours) {
            warnings.add(path, None, "not used where there is a texture: colours");
        }
        if !faces.has_texcoords && !self.vertices.has_uvs && !textures::named(&header.comments).is_empty() {
            warnings.add(path, None, "not used: textures, for which there are no coordinates");
        }
        for message in faces.fans_message().into_iter().chain(unused) {
            warnings.add(path, None, message);
        }
        let Mesh { vertices, mut faces, textures, .. } = self;
        let (materials, reduced) = paint::materials(&mut faces.triangles, &textures, faces.blended);
        warnings.extend(path, reduced);
        let uvs = if faces.uvs.is_empty() { vertices.uvs } else { faces.uvs };
        let (positions, normals, triangles) = (vertices.positions, vertices.normals, faces.triangles);
        let textures = textures.into_iter().map(Texture::from).collect();
        let mut scene = Scene { positions, normals, uvs, triangles, materials, textures, ..Scene::default() };
        warn_of_dropped(path, &scene, &mut warnings);
        scene.warnings = warnings.into_vec();
        scene.files = textures::named_files(path, &header.comments);
        Ok(scene)
    }

    /// What the file has that is not used.
    fn unused(&self, header: &PlyHeader) -> Option<String> {
        let mut names = Vec::new();
        for (number, element) in header.elem_defs.iter().enumerate() {
            let is_used = |property: usize| match number {
                n if n == self.vertex => self.vertices.uses(property),
                n if n == self.face => self.faces.uses(property),
                _ => true,
            };
            if number != self.vertex && number != self.face && element.count > 0 {
                names.push(format!("element '{}'", quote(element.name.as_bytes())));
            }
            let unused = element.properties.iter().enumerate().filter(|&(property, _)| !is_used(property));
            names.extend(unused.map(|(_, p)| format!("{} '{}'", element.name, quote(p.name.as_bytes()))));
        }
        let more = names.len().saturating_sub(MAX_NAMES);
        names.truncate(MAX_NAMES);
        if more > 0 {
            names.push(format!("and {more} more"));
        }
        (!names.is_empty()).then(|| names.join(", "))
    }
}

/// Why a file without vertices and faces is refused: what it has instead.
fn without_faces(header: &PlyHeader) -> String {
    let count = |name: &str| header.elem_defs.iter().find(|e| e.name == name).map_or(0, |e| e.count);
    let strips = count("tristrips");
    if strips > 0 {
        return format!("holds triangle strips ({strips} of 'tristrips'), which are not supported; save it with faces");
    }
    let elements = header.elem_defs.iter().filter(|e| e.count > 0).take(MAX_NAMES);
    let held: Vec<_> = elements.map(|e| format!("{} of '{}'", e.count, quote(e.name.as_bytes()))).collect();
    match (count("vertex"), held.is_empty()) {
        (_, true) => "holds nothing: no element has a row".into(),
        (0, false) => format!("has no vertices; it holds {}", held.join(", ")),
        (_, false) => format!("has no faces; it holds points only ({})", held.join(", ")),
    }
}

fn header_fault(path: &Path, source: &Source, DeserializeError(fault): DeserializeError) -> Error {
    let message = format!("the PLY header is wrong: {}", quote(fault.to_string().as_bytes()));
    Error::input(path, source.line, message)
}

/// What is wrong with row number `row` of an element.
fn row_fault(
    path: &Path,
    source: &Source,
    element: &str,
    row: usize,
    count: usize,
    DeserializeError(fault): DeserializeError,
) -> Error {
    let element = quote(element.as_bytes());
    let line = source.text.then_some(source.line);
    match fault.kind() {
        ErrorKind::UnexpectedEof if source.row().is_empty() => {
            Error::input(path, None, format!("is cut short: it ends in {element} {row} of {count} (counted from 0)"))
        }
        ErrorKind::UnexpectedEof => {
            let line_text = quote(source.row());
            Error::input(
                path,
                line,
                format!("{element} {row} has fewer values than the header promises: '{line_text}'"),
            )
        }
        ErrorKind::InvalidData => {
            let fault = quote(fault.to_string().as_bytes());
            let quoted = if source.text { format!(": '{}'", quote(source.row())) } else { String::new() };
            Error::input(path, line, format!("{element} {row}: {fault}{quoted}"))
        }
        _ => Error::io("read", path, fault),
    }
}
