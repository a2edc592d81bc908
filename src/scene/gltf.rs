//! Loads glTF 2.0 files, text (`.gltf`) and binary (`.glb`).
//!
//! Format: Khronos, "glTF 2.0 Specification", version 2.0.1, 2021 (ISO/IEC 12113:2022), and the extensions in
//! [`KNOWN`]. The `gltf` crate has the structs of the JSON and takes a binary file apart; it is used without its
//! validation and without its readers, which panic where a file breaks a rule. Whatever an index, an offset or a count
//! of the file leads to is checked here before it is followed.
//!
//! | glTF | scene |
//! |---|---|
//! | the default scene, else the first, else all nodes without a parent | what is loaded |
//! | mesh of one node | triangles, placed in f64 and rounded once |
//! | meshes of the same numbers in several places, `EXT_mesh_gpu_instancing` | instances |
//! | material | see `materials.rs` |
//! | first perspective camera | camera; its distances and its aspect are not used |
//! | `KHR_lights_punctual` | lights; candela and lux over π, because a matt surface of the format gives back 1/π |
//!
//! What a file has beside that is told in one warning: `../unused.rs`.
//!
//! Bad at: what is finer than a material, which textures other than that of the base colour are; smooth colours of
//! vertices on large triangles. A file is read whole, and stays until the scene is complete.

mod accessors;
mod buffers;
mod images;
mod lights;
mod materials;
mod meshes;
mod nodes;

use super::reading::{check_memory, read_all, warn_of_dropped};
use super::text::{BYTE_ORDER_MARK, quote};
use super::unused::{MAX_NAMES, Unused};
use super::{Builder, Scene};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use ::gltf::binary::Glb;
use ::gltf::json::Root;
use buffers::Buffers;
use serde::Deserialize;
use std::path::Path;

/// The largest file that is read: the length of a binary one has 32 bits.
const MAX_FILE_BYTES: u64 = u32::MAX as u64;

/// Bytes before the chunks of a binary file.
const GLB_HEADER_BYTES: u64 = 12;

/// The extensions that a file may require.
const KNOWN: [&str; 11] = [
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// What an object of the JSON takes in memory: the largest struct, that of a material, has about so many bytes.
const OBJECT_BYTES: u64 = 1024;

/// What an element of a list takes.
const ELEMENT_BYTES: u64 = 16;

/// A file, as its parts are read.
struct Source<'a> {
    path: &'a Path,
    root: &'a Root,
    buffers: Buffers<'a>,
    budget: MemoryBudget,
}

impl Source<'_> {
    fn fault(&self, message: impl Into<String>) -> Error {
        Error::input(self.path, None, message)
    }
}

/// Loads the glTF file at `path`. Only buffers and pictures in its folder and below are opened.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let data = read_all(path, MAX_FILE_BYTES, (1, budget), |_| Ok(()))?;
    let (json, binary) = chunks(path, &data)?;
    let json = json.strip_prefix(BYTE_ORDER_MARK).unwrap_or(json);
    check_memory(path, parsed_bytes(json), budget)?;
    let place = |line: usize| if binary.is_none() { Some(line) } else { None };
    let refused = |error: serde_json::Error| refused(path, place(error.line()), &error);
    serde_json::from_slice::<Head>(json).map_err(refused)?.check(path)?;
    // By a function of the crate, which has it compiled: it is a tenth of what this library is compiled to.
    let root = Root::from_slice(json).map_err(refused)?;
    let (buffers, mut files) = Buffers::load(path, &root, binary, budget)?;
    let source = Source { path, root: &root, buffers, budget: *budget };

    let mut unused = unused_of(&root);
    let hierarchy = nodes::walk(&source, &mut unused)?;
    let mut builder = Builder::within(*budget);
    lights::add(&source, &hierarchy, &mut builder, &mut unused);
    let mut looks = materials::Looks::new(&source);
    meshes::add(&source, &hierarchy, &mut looks, &mut builder, &mut unused)?;
    let (mut warnings, mut pictures) = looks.finish();
    files.append(&mut pictures);

    let mut scene = builder.finish().map_err(|e| source.fault(e.to_string()))?;
    if scene.triangle_count() == 0 {
        return Err(source.fault(format!("has no triangles{}", unused.instead())));
    }
    scene.camera = scene.camera.map(|camera| lights::look_at_something(camera, scene_middle(&scene)));
    warnings.extend(path, unused.message());
    warn_of_dropped(path, &scene, &mut warnings);
    scene.warnings = warnings.into_vec();
    scene.files = files;
    Ok(scene)
}

/// What is not used and nobody looks at while the scene is read.
fn unused_of(root: &Root) -> Unused {
    let mut unused = Unused::default();
    let unknown = root.extensions_used.iter().filter(|name| !KNOWN.contains(&name.as_str()));
    for name in unknown.take(MAX_NAMES) {
        unused.note(format!("extension {}", quote(name.as_bytes())));
    }
    unused.add("animations", root.animations.len());
    unused.add("other scenes", root.scenes.len().saturating_sub(1));
    unused
}

/// The JSON of a file, and of a binary one its other chunk.
fn chunks<'d>(path: &Path, data: &'d [u8]) -> Result<(&'d [u8], Option<&'d [u8]>)> {
    if !data.starts_with(b"glTF") {
        return Ok((data, None));
    }
    let fault = |message: String| Error::input(path, None, message);
    let word = |at: usize| data.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    // First of all: other versions have other headers.
    if let Some(version) = word(4).filter(|version| *version != 2) {
        return Err(fault(format!("is a .glb file of version {version}; only version 2 is read")));
    }
    // The crate subtracts the header from this length unchecked.
    let length = word(8).map_or(0, u64::from);
    if length < GLB_HEADER_BYTES || length > data.len() as u64 {
        let size = data.len();
        return Err(fault(format!("is a .glb file that says it has {length} bytes, but has {size}: it is cut short")));
    }
    let glb = Glb::from_slice(&data[..length as usize])
        .map_err(|error| fault(format!("is a damaged .glb file: {}", quote(error.to_string().as_bytes()))))?;
    // The crate borrows what it has cut out of a slice.
    match (glb.json, glb.bin) {
        (std::borrow::Cow::Borrowed(json), None) => Ok((json, Some(&[]))),
        (std::borrow::Cow::Borrowed(json), Some(std::borrow::Cow::Borrowed(binary))) => Ok((json, Some(binary))),
        _ => Err(fault("is a damaged .glb file".into())),
    }
}

/// About how many bytes JSON takes once it is parsed, beside itself.
fn parsed_bytes(json: &[u8]) -> u64 {
    let count = |wanted: u8| memchr::memchr_iter(wanted, json).count() as u64;
    json.len() as u64 + OBJECT_BYTES * count(b'{') + ELEMENT_BYTES * count(b',')
}

/// What is wrong with the JSON of a file, and in which line of it.
fn refused(path: &Path, line: Option<usize>, error: &serde_json::Error) -> Error {
    let message = error.to_string();
    let message = message.split(" at line ").next().unwrap_or_default();
    Error::input(path, line, format!("not valid glTF: {}", quote(message.as_bytes())))
}

/// What tells whether the rest can be read.
#[derive(Deserialize)]
struct Head {
    asset: Asset,
    #[serde(default, rename = "extensionsRequired")]
    required: Vec<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    /// A text; in files of version 1.0 it may be a number.
    version: serde_json::Value,
    min_version: Option<String>,
}

impl Head {
    fn check(&self, path: &Path) -> Result<()> {
        let fault = |message: String| Err(Error::input(path, None, message));
        let version = || self.asset.version.as_str().map_or_else(|| self.asset.version.to_string(), str::to_owned);
        let needed = self.asset.min_version.clone().unwrap_or_else(version);
        if !needed.starts_with("2.") || self.asset.min_version.as_ref().is_some_and(|least| least != "2.0") {
            return fault(format!("is glTF {}; only version 2.0 is read", quote(needed.as_bytes())));
        }
        let unknown: Vec<_> = self.required.iter().filter(|name| !KNOWN.contains(&name.as_str())).collect();
        let Some(first) = unknown.first() else { return Ok(()) };
        let more = if unknown.len() > 1 { format!(" and {} more", unknown.len() - 1) } else { String::new() };
        fault(format!(
            "requires the extension {}{more}, which is not supported; save it without",
            quote(first.as_bytes())
        ))
    }
}

/// The middle of all triangles.
fn scene_middle(scene: &Scene) -> Option<glam::DVec3> {
    scene.bounds().map(|(low, high)| (low.as_dvec3() + high.as_dvec3()) / 2.0)
}
