//! Loads 3MF files: a zip archive with a model in XML.
//!
//! Format: 3MF Consortium, "3D Manufacturing Format, Core Specification", version 1.3, 2021, and the colour groups of
//! its Materials and Properties Extension. Unpacked by the `zip` crate and read by `quick-xml` as it comes; the archive
//! is as untrusted as any input, and what the model takes is checked against the memory before and while it is read.
//!
//! | 3MF | scene |
//! |---|---|
//! | objects of the build items, and of their components | triangles; of what stands in several places, instances |
//! | base materials, colour groups | matt materials (`paint.rs`); a triangle has the mean colour of its corners |
//! | unit | not used: coordinates stay the numbers that they are |
//!
//! z is up, as printers have it. Extensions that a file requires are refused by name; of others the elements that are
//! read over are told.
//!
//! Bad at: textures, which are left out; pieces of a model in several parts of the archive (production extension).

mod model;
mod xml;

use super::paint;
use super::reading::{check_memory, warn_of_dropped};
use super::text::{Warnings, quote};
use super::{Builder, NO_INDEX, Scene, Transform, Triangle};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::io::input::open_regular;
use crate::scene::mesh::{Corner, Mesh};
use glam::{DAffine3, DVec3, Vec3};
use model::{Item, Model, Object, Shape};
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;
use zip::ZipArchive;

/// The part that names the others, and what it calls the model.
const RELATIONSHIPS: &str = "_rels/.rels";
const MODEL_TYPE: &str = "3dmodel";
/// Where the model is by custom.
const USUAL_MODEL: &str = "3D/3dmodel.model";

/// The largest model in an archive, unpacked: as the largest text of other formats.
const MAX_MODEL_BYTES: u64 = 1 << 30;

/// The largest list of parts.
const MAX_RELATIONSHIPS_BYTES: u64 = 1 << 20;

/// What a model takes while it is turned into a scene, in its own size.
const BYTES_PER_BYTE: u64 = 6;

/// How many times objects may stand somewhere: components of components multiply.
const MAX_PLACES: u64 = 1 << 24;

/// Loads the 3MF file at `path`: a scene without lights and camera.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let fault = |message: String| Error::input(path, None, message);
    let (file, _) = open_regular(path)?;
    let unreadable = |e: zip::result::ZipError| fault(format!("is no 3MF file: {}", quote(e.to_string().as_bytes())));
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(unreadable)?;
    let name = model_name(&mut archive);
    let missing = |e| fault(format!("its model '{}' cannot be read: {e}", quote(name.as_bytes())));
    let part = archive.by_name(&name).map_err(missing)?;
    let bytes = part.size();
    if bytes > MAX_MODEL_BYTES {
        let message = format!("its model has more than {} MiB, the most that is read; split it", MAX_MODEL_BYTES >> 20);
        return Err(fault(message));
    }
    check_memory(path, BYTES_PER_BYTE * bytes, budget)?;
    // What is longer than the archive says is no 3MF file.
    let wrong = |message| fault(format!("{}: {message}", quote(name.as_bytes())));
    let model = Model::read(BufReader::new(part.take(bytes))).map_err(wrong)?;
    scene(path, model, budget)
}

/// The name of the part that is the model.
fn model_name(archive: &mut ZipArchive<BufReader<File>>) -> String {
    let mut text = Vec::new();
    let read = archive.by_name(RELATIONSHIPS).map(|part| part.take(MAX_RELATIONSHIPS_BYTES).read_to_end(&mut text));
    let named = read.ok().and_then(|read| read.ok()).and_then(|_| xml::target_of(&text, MODEL_TYPE));
    named.map_or(USUAL_MODEL.to_owned(), |target| target.trim_start_matches('/').to_owned())
}

fn scene(path: &Path, mut model: Model, budget: &MemoryBudget) -> Result<Scene> {
    let fault = |message: String| Error::input(path, None, message);
    let places = places(path, &model, budget)?;
    let (ranges, mut triangles) = paints(&mut model);
    check_copies(path, &model, &places, &ranges, budget)?;
    let mut warnings = Warnings::default();
    let (materials, reduced) = paint::materials(&mut triangles, &[], model.blended);
    let mut builder = Builder::within(*budget);
    materials.into_iter().for_each(|material| _ = builder.push_material(material));
    for ((object, places), range) in model.objects.iter().zip(&places).zip(ranges) {
        let Shape::Mesh { positions, .. } = &object.shape else { continue };
        add(places, positions, &triangles[range], &mut builder);
        if let Some(message) = builder.take_fault() {
            return Err(fault(format!("object {} cannot be placed: {message}", object.id)));
        }
    }
    let mut scene = builder.finish().map_err(|e| fault(e.to_string()))?;
    if scene.triangle_count() == 0 {
        return Err(fault("has no triangles in its build items".into()));
    }
    warnings.extend(path, model.unused.message());
    warnings.extend(path, reduced);
    warn_of_dropped(path, &scene, &mut warnings);
    scene.warnings = warnings.into_vec();
    scene.up = Some(Vec3::Z);
    Ok(scene)
}

/// Where each object is, by following build items and components.
///
/// A component names an object that stands before its own, so that there is no circle.
fn places(path: &Path, model: &Model, budget: &MemoryBudget) -> Result<Vec<Vec<DAffine3>>> {
    let fault = |message: String| Error::input(path, None, message);
    // How many places an object and its parts take.
    let mut counts: Vec<u64> = Vec::with_capacity(model.objects.len());
    let sum = |items: &[Item], counts: &[u64]| items.iter().map(|i| counts[i.object]).fold(0, u64::saturating_add);
    for object in &model.objects {
        counts.push(match &object.shape {
            Shape::Mesh { .. } => 1,
            Shape::Components(parts) => sum(parts, &counts).saturating_add(1),
        });
    }
    let total = sum(&model.build, &counts);
    if total > MAX_PLACES {
        return Err(fault(format!(
            "has objects in {total} places, of components of components; the most is {MAX_PLACES}"
        )));
    }
    check_memory(path, total * 2 * size_of::<Item>() as u64, budget)?;
    let mut found = vec![Vec::new(); model.objects.len()];
    let placed = |parent: DAffine3| move |item: &Item| Item { object: item.object, transform: parent * item.transform };
    let mut waiting: Vec<Item> = model.build.iter().rev().map(placed(DAffine3::IDENTITY)).collect();
    while let Some(Item { object, transform }) = waiting.pop() {
        if !transform.is_finite() {
            return Err(fault(format!("object {} has a transform that is not finite", model.objects[object].id)));
        }
        match &model.objects[object].shape {
            Shape::Mesh { .. } => found[object].push(transform),
            Shape::Components(parts) => waiting.extend(parts.iter().rev().map(placed(transform))),
        }
    }
    Ok(found)
}

/// Checks that there is memory for the copies of objects that a transform flattens, of which there are no instances.
fn check_copies(
    path: &Path,
    model: &Model,
    places: &[Vec<DAffine3>],
    ranges: &[Range<usize>],
    budget: &MemoryBudget,
) -> Result<()> {
    let mut bytes = 0u64;
    for ((object, places), range) in model.objects.iter().zip(places).zip(ranges) {
        let Shape::Mesh { positions, .. } = &object.shape else { continue };
        let copies = places.iter().filter(|place| !is_solid(place)).count() as u64;
        let of_copy = range.len() * size_of::<Triangle>() + positions.len() * size_of::<Vec3>();
        bytes = bytes.saturating_add(copies.saturating_mul(of_copy as u64));
    }
    check_memory(path, bytes, budget)
}

/// Whether an instance can be there: none is where a transform flattens space.
fn is_solid(transform: &DAffine3) -> bool {
    Transform::new(*transform).is_some()
}

/// The triangles of all objects, their materials paints, and which of them are of which object.
fn paints(model: &mut Model) -> (Vec<Range<usize>>, Vec<Triangle>) {
    let (mut ranges, mut all) = (Vec::new(), Vec::new());
    for Object { shape, .. } in &mut model.objects {
        let first = all.len();
        if let Shape::Mesh { triangles, .. } = shape {
            all.append(triangles);
        }
        ranges.push(first..all.len());
    }
    (ranges, all)
}

/// Adds an object in its places.
fn add(places: &[DAffine3], positions: &[Vec3], triangles: &[Triangle], builder: &mut Builder) {
    if places.is_empty() || triangles.is_empty() {
        return;
    }
    let corner = |position: u32| Corner { position, normal: NO_INDEX, uv: NO_INDEX };
    let mesh = |place: &dyn Fn(&Vec3) -> DVec3| Mesh {
        positions: positions.iter().map(place).collect(),
        triangles: triangles.iter().map(|triangle| triangle.positions.map(corner)).collect(),
        ..Mesh::default()
    };
    let own = |p: &Vec3| p.as_dvec3();
    let material = |i: usize| triangles[i].material;
    let (solid, flat): (Vec<&DAffine3>, Vec<&DAffine3>) = places.iter().partition(|place| is_solid(place));
    for transform in flat {
        builder.add_geometry(&mesh(&|p| transform.transform_point3(own(p))), material);
    }
    match solid[..] {
        [] => {}
        [transform] => {
            builder.push().multiply("transform", *transform).add_geometry(&mesh(&own), material).pop();
        }
        _ => {
            builder.begin_object().add_geometry(&mesh(&own), material);
            let object = builder.end_object();
            for transform in solid {
                builder.push().multiply("transform", *transform).instance(object, None).pop();
            }
        }
    }
}
