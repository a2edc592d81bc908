//! Loads Wavefront OBJ files.
//!
//! Format: Wavefront, "Advanced Visualizer" manual, appendix B1 (Object Files). The text is checked and cleaned by
//! [`super::obj_clean`], parsed by the `tobj` crate, and its polygons are split by [`super::triangulate`]; materials come
//! from [`super::mtl`].
//!
//! Bad at: memory. A file is read whole, and while it is turned into a scene takes about five times its size.

use super::load::open_regular;
use super::mtl::Library;
use super::obj_clean::{Cleaner, Survey, Tally, Warnings, quote};
use super::triangulate::Triangulator;
use super::{DropReason, MaterialId, NO_INDEX, Scene, Triangle};
use crate::error::{Error, Result};
use glam::{Vec2, Vec3};
use std::io::Read;
use std::path::Path;

/// The largest OBJ or NFF file that is read. Its text has to fit into memory, and its indices into 32 bits: a vertex takes at least
/// 8 bytes of text, a triangle of a polygon 2.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// How much of a file is searched for NUL bytes before all of it is read.
const HEAD_BYTES: usize = 1024;

/// Loads the OBJ file at `path`: a scene without lights and camera. Only files in its folder and below are opened.
pub(super) fn load(path: &Path) -> Result<Scene> {
    let text = read_text(path)?;
    let survey = Survey::new(&text);
    if survey.faces == 0 {
        return Err(Error::input(path, None, "has no faces (lines that begin with 'f'); is it a Wavefront OBJ file?"));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let root = folder.canonicalize().map_err(|e| Error::io("read", folder, e))?;
    let mut library = Library::new(path, root);
    survey.ignored.report(path, &mut library.warnings);
    for (line, names) in &survey.libraries {
        library.read_libraries(*line, names);
    }

    let (models, materials) = parse(path, &text, &survey, &mut library)?;
    drop(text);
    let mut scene = Scene::default();
    let mut triangulator = Triangulator::new();
    let ends = materials.iter().skip(1).map(|&(first_face, _)| first_face).chain([usize::MAX]);
    let mut runs = materials.iter().map(|&(_, material)| material).zip(ends);
    let (mut material, mut end) = runs.next().unwrap_or_default();
    let mut face = 0;
    for model in models {
        append_mesh(&mut scene, &model.mesh, &mut triangulator, || {
            if face == end {
                (material, end) = runs.next().unwrap_or((material, usize::MAX));
            }
            face += 1;
            material
        });
    }
    if triangulator.fans > 0 {
        library.warnings.add(path, None, triangulator.fans_message());
    }
    if scene.triangles.is_empty() {
        return Err(Error::input(path, None, "has no face of three or more corners"));
    }
    warn_of_dropped(path, &scene, &mut library.warnings);
    scene.materials = library.materials;
    scene.textures = library.textures;
    scene.warnings = library.warnings.into_vec();
    Ok(scene)
}

/// Reads a regular file that may be OBJ or NFF text.
pub(super) fn read_text(path: &Path) -> Result<Vec<u8>> {
    let unreadable = |e| Error::io("read", path, e);
    let (mut file, bytes) = open_regular(path)?;
    if bytes > MAX_FILE_BYTES {
        let message = format!("is larger than {} MiB, the most that is read; split it", MAX_FILE_BYTES >> 20);
        return Err(Error::input(path, None, message));
    }
    let mut text = Vec::new();
    (&mut file).take(HEAD_BYTES as u64).read_to_end(&mut text).map_err(unreadable)?;
    if text.starts_with(b"\xff\xfe") || text.starts_with(b"\xfe\xff") {
        return Err(Error::input(path, 1, "is UTF-16 text; save it as UTF-8"));
    }
    if text.contains(&0) {
        return Err(Error::input(path, None, "is not text (it has NUL bytes); only the text form is read"));
    }
    text.reserve_exact(bytes as usize);
    file.take(MAX_FILE_BYTES).read_to_end(&mut text).map_err(unreadable)?;
    Ok(text)
}

/// The faces of a file in parts, in file order, and the first face and material of each run of faces of one material.
type Parsed = (Vec<tobj::Model>, Vec<(usize, MaterialId)>);

/// Parses the cleaned text.
fn parse(path: &Path, text: &[u8], survey: &Survey, library: &mut Library) -> Result<Parsed> {
    let mut cleaner = Cleaner::new(text, survey, library);
    let options = tobj::LoadOptions::default(); // neither triangulated, nor with a single index
    let loaded = tobj::load_obj_buf(&mut cleaner, &options, |_| Err(tobj::LoadError::OpenFileFailed));
    let (line, fault) = (cleaner.line, cleaner.fault.take());
    let (short_faces, dangling, materials) = (cleaner.short_faces, cleaner.dangling, cleaner.materials);
    match loaded {
        Ok((models, _)) => {
            warn_of_lines(path, short_faces, "faces with fewer than three corners ignored", library);
            warn_of_lines(path, dangling, "texture or normal indices that refer to nothing ignored", library);
            Ok((models, materials))
        }
        Err(error) => {
            let message = fault.unwrap_or_else(|| explain(error, text, line));
            Err(Error::input(path, line, message))
        }
    }
}

/// Why `tobj` refused a line of the cleaned text: all it still has to check is numbers.
fn explain(error: tobj::LoadError, text: &[u8], line: usize) -> String {
    let statement =
        super::obj_clean::Lines::new(text).find(|(number, _)| *number == line).map(|(_, s)| s).unwrap_or_default();
    let comma = if statement.contains(&b',') { "; decimals take a point, not a comma" } else { "" };
    format!("{error}: '{}' is not made of numbers{comma}", quote(statement.trim_ascii()))
}

/// Adds a part of the faces, polygons split into triangles, to `scene`; `next_material` gives the material of each.
fn append_mesh(
    scene: &mut Scene,
    mesh: &tobj::Mesh,
    triangulator: &mut Triangulator,
    mut next_material: impl FnMut() -> MaterialId,
) {
    let [first_position, first_normal, first_uv] =
        [scene.positions.len(), scene.normals.len(), scene.uvs.len()].map(|count| count as u32);
    scene.positions.extend(mesh.positions.chunks_exact(3).map(Vec3::from_slice));
    scene.normals.extend(mesh.normals.chunks_exact(3).map(Vec3::from_slice));
    scene.uvs.extend(mesh.texcoords.chunks_exact(2).map(Vec2::from_slice));

    // The extra normal and texture coordinate of corners without one are NaN; those of the file that are NaN are no use.
    let finite_normal =
        |index: u32, normals: &[Vec3]| if normals[index as usize].is_finite() { index } else { NO_INDEX };
    let finite_uv = |index: u32, uvs: &[Vec2]| if uvs[index as usize].is_finite() { index } else { NO_INDEX };
    let mut polygon = Vec::new();
    let mut first = 0;
    let triangles_only = mesh.indices.len() / 3 * usize::from(mesh.face_arities.is_empty());
    for corners in mesh.face_arities.iter().map(|&n| n as usize).chain(std::iter::repeat_n(3, triangles_only)) {
        let positions = &mesh.indices[first..first + corners];
        let normals = mesh.normal_indices.get(first..first + corners);
        let uvs = mesh.texcoord_indices.get(first..first + corners);
        first += corners;
        let material = next_material();
        polygon.clear();
        polygon.extend(positions.iter().map(|&i| scene.positions[(first_position + i) as usize]));
        for triangle in triangulator.split(&polygon) {
            let triangle = triangle.map(|corner| corner as usize);
            scene.triangles.push(Triangle {
                positions: triangle.map(|i| first_position + positions[i]),
                normals: triangle
                    .map(|i| normals.map_or(NO_INDEX, |n| finite_normal(first_normal + n[i], &scene.normals))),
                uvs: triangle.map(|i| uvs.map_or(NO_INDEX, |u| finite_uv(first_uv + u[i], &scene.uvs))),
                material,
            });
        }
    }
}

fn warn_of_lines(path: &Path, tally: Tally, what: &str, library: &mut Library) {
    if tally.count > 0 {
        library.warnings.add(path, tally.first, format!("{what}: {}, this is the first", tally.count));
    }
}

/// One warning for each reason why triangles cannot be hit.
pub(super) fn warn_of_dropped(path: &Path, scene: &Scene, warnings: &mut Warnings) {
    let (mut not_finite, mut zero_area) = (Tally::default(), Tally::default());
    for primitive in 0..scene.triangles.len() {
        match scene.drop_reason(primitive) {
            Some(DropReason::NotFinite) => not_finite.note(primitive),
            Some(DropReason::ZeroArea) => zero_area.note(primitive),
            None => {}
        }
    }
    for (tally, what) in [(not_finite, "with NaN or infinite vertices"), (zero_area, "without area")] {
        if tally.count > 0 {
            let message = format!("triangles {what} left out: {}, the first is number {}", tally.count, tally.first);
            warnings.add(path, None, message);
        }
    }
}
