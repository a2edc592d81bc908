//! Loads STL files, binary and text.
//!
//! Format: 3D Systems, "StereoLithography Interface Specification", 1988, as written in practice. Parsed by the
//! `stl_io` crate, whose reading of text is stricter than its writers: keywords in lower case, a blank after `solid`,
//! finite normals, and one solid a file. [`clean`] therefore hands it a canonical text of as many lines.
//!
//! Corners at exactly equal positions become one vertex. Facet normals are not used: which side is outside follows from
//! the order of the corners, which is what the format asks for when the two disagree. Attribute bytes, which some
//! programs use for colours, are not used either; a warning tells of them.
//!
//! Bad at: memory. A file is read whole, and a text is copied once more.

use super::reading::{HEAD_BYTES, read_all, warn_of_dropped};
use super::text::{Tally, Warnings, quote};
use super::{Material, NO_INDEX, Scene, Triangle};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use glam::Vec3;
use std::collections::HashMap;
use std::io::{Cursor, ErrorKind};
use std::path::Path;

/// The largest STL file that is read: some 20 million triangles in binary, whose corners are told apart by 32 bits.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Bytes of a binary file: the header, which says nothing; the count after it; each facet.
const HEADER_BYTES: usize = 80;
const COUNT_BYTES: usize = 4;
const FACET_BYTES: usize = 50;

/// What a file takes while it is read, in its own size: of a binary one itself, its triangles, and its corners by their
/// positions. A text is copied, but has fewer triangles.
const BYTES_PER_BYTE: u64 = 5;

/// Loads the STL file at `path`: a scene without lights and camera.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let mut data = read_all(path, MAX_FILE_BYTES, (BYTES_PER_BYTE, budget), |_| Ok(()))?;
    let facets = binary_facets(&data);
    let is_text = facets.is_none() && is_text(&data);
    if is_text {
        data = clean(&data);
    } else {
        let facets = facets.ok_or_else(|| Error::input(path, None, wrong_size(&data)))?;
        if facets == 0 {
            return Err(Error::input(path, None, "has no triangles"));
        }
        data[..HEADER_BYTES].fill(b'\n'); // it may begin with "solid", and stl_io looks at the first line for that
    }
    let mut scene = weld(&data).map_err(|(facet, fault)| {
        let line = if is_text { line_of(&data, facet) } else { None };
        let fault = match fault.kind() {
            ErrorKind::UnexpectedEof => "the file is cut short".to_owned(),
            _ => quote(fault.to_string().as_bytes()),
        };
        let place = if line.is_some() { ", which begins here" } else { "" };
        Error::input(path, line, format!("facet {facet}{place}: {fault}"))
    })?;
    if scene.triangles.is_empty() {
        return Err(Error::input(path, None, "has no triangles"));
    }
    let mut warnings = Warnings::default();
    let attributes = attributes(&data, facets.filter(|_| !is_text).unwrap_or(0));
    if attributes.count > 0 {
        let Tally { first, count } = attributes;
        let message =
            format!("attributes of facets, which may be colours, not used: {count}, the first of facet {first}");
        warnings.add(path, None, message);
    }
    warn_of_dropped(path, &scene, &mut warnings);
    scene.warnings = warnings.into_vec();
    scene.up = Some(Vec3::Z); // what writes this format stands on the x-y plane, with rare exceptions
    Ok(scene)
}

/// How many facets `data` has if its size is that of a binary file.
fn binary_facets(data: &[u8]) -> Option<usize> {
    let count = data.get(HEADER_BYTES..)?.first_chunk::<COUNT_BYTES>()?;
    let facets = u32::from_le_bytes(*count) as usize;
    (facets.checked_mul(FACET_BYTES)?.checked_add(HEADER_BYTES + COUNT_BYTES)? == data.len()).then_some(facets)
}

/// The facets of a binary file whose attribute bytes say something.
fn attributes(data: &[u8], facets: usize) -> Tally {
    let mut tally = Tally::default();
    let body = data.get(HEADER_BYTES + COUNT_BYTES..).unwrap_or_default();
    for (facet, bytes) in body.chunks_exact(FACET_BYTES).take(facets).enumerate() {
        if !bytes.ends_with(&[0, 0]) {
            tally.note(facet);
        }
    }
    tally
}

/// Whether `data` looks like a text: many binary files begin with "solid" too, but their counts have NUL bytes, which
/// no text has.
fn is_text(data: &[u8]) -> bool {
    let head = &data[..data.len().min(HEAD_BYTES as usize)];
    starts_with(head.trim_ascii_start(), b"solid") && !head.contains(&0)
}

fn starts_with(text: &[u8], keyword: &[u8]) -> bool {
    text.get(..keyword.len()).is_some_and(|start| start.eq_ignore_ascii_case(keyword))
}

/// Why `data` is neither text nor binary.
fn wrong_size(data: &[u8]) -> String {
    match data.get(HEADER_BYTES..).and_then(|rest| rest.first_chunk::<COUNT_BYTES>()) {
        None => {
            let least = HEADER_BYTES + COUNT_BYTES;
            format!("is not an STL file: a text begins with 'solid', and a binary one has at least {least} bytes")
        }
        Some(count) => {
            let facets = u64::from(u32::from_le_bytes(*count));
            let bytes = facets * FACET_BYTES as u64 + (HEADER_BYTES + COUNT_BYTES) as u64;
            format!("should have {bytes} bytes for the {facets} triangles that it promises, but has {}", data.len())
        }
    }
}

/// A text of the one form that `stl_io` reads; line n of `text`, counted from 1, is line n, counted from 0.
///
/// Facet normals become zeros: they are not used, and those of facets without area are often not numbers. A text whose
/// last solid has no end gets none, so that a file that was cut between two facets is found out.
fn clean(text: &[u8]) -> Vec<u8> {
    let line_end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
    let mut clean = b"solid \n".to_vec();
    let mut is_open = false;
    for line in text.split(|&b| b == line_end) {
        let line = line.trim_ascii();
        if starts_with(line, b"solid") || starts_with(line, b"endsolid") || starts_with(line, b"end solid") {
            is_open = starts_with(line, b"solid");
        } else if starts_with(line, b"facet") {
            clean.extend_from_slice(b"facet normal 0 0 0");
        } else if starts_with(line, b"end loop") || starts_with(line, b"end facet") {
            clean.extend_from_slice(b"end");
            clean.extend(line[4..].to_ascii_lowercase());
        } else {
            clean.extend(String::from_utf8_lossy(line).to_ascii_lowercase().as_bytes());
        }
        clean.push(b'\n');
    }
    if !is_open {
        clean.extend_from_slice(b"endsolid\n");
    }
    clean
}

/// The line of the cleaned text where facet number `facet` begins.
fn line_of(clean: &[u8], facet: usize) -> Option<usize> {
    let mut left = facet;
    for (number, line) in clean.split(|&b| b == b'\n').enumerate().skip(1) {
        match line {
            b"" => {}
            _ if left == 0 => return Some(number),
            b"endfacet" => left -= 1,
            _ => {}
        }
    }
    None
}

/// The triangles of `data`, corners at equal positions made one; or the number of the facet at fault and the fault.
fn weld(data: &[u8]) -> std::result::Result<Scene, (usize, std::io::Error)> {
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    let mut vertices: HashMap<[u32; 3], u32> = HashMap::new();
    let mut data = Cursor::new(data);
    let facets = stl_io::create_stl_reader(&mut data).map_err(|fault| (0, fault))?;
    for (number, facet) in facets.enumerate() {
        let facet = facet.map_err(|fault| (number, fault))?;
        let positions = facet.vertices.map(|vertex| {
            let position = Vec3::from(vertex.0);
            let key = vertex.0.map(|x| (x + 0.0).to_bits()); // -0 + 0 is 0: they are equal
            *vertices.entry(key).or_insert_with(|| {
                scene.positions.push(position);
                (scene.positions.len() - 1) as u32
            })
        });
        scene.triangles.push(Triangle { positions, normals: [NO_INDEX; 3], uvs: [NO_INDEX; 3], material: 0 });
    }
    Ok(scene)
}
