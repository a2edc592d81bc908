//! An OBJ file read a second time, by the crate `tobj`: `raybrook info --cross-check`.
//!
//! Two readers that share no code seldom misread a file in the same way. Where they differ, the file's text often tells
//! why: `tobj` has known limits, which are looked for line by line ([`Reason`]).
//!
//! Bad at: polygons. Of one that either reader splits otherwise all triangles count as different; nothing but triangles
//! is compared.

use glam::{Vec2, Vec3};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::input::{open_regular, read_regular};
use raybrook::low_level::scene::{Scene, Triangle};
use raybrook::{Error, Result};
use serde::Serialize;
use std::collections::HashSet;
use std::io::Read;
use std::path::Path;

/// Bytes that `tobj` takes for one of the file's: a corner of a face, two characters at least, becomes a record of
/// three indices, an entry of a hash map, and up to eight numbers.
const BYTES_OF_BYTE: u64 = 60;

/// What the file has that `tobj` is known to read otherwise, or not at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// A byte order mark.
    ByteOrderMark,
    /// Lines that go on behind a backslash.
    ContinuedLines,
    /// Lines that end with CR alone.
    OldLineEnds,
    /// Bytes that are no UTF-8.
    NotUtf8,
    /// Comments behind data.
    TrailingComments,
    /// `p` and `l` elements.
    PointsAndLines,
    /// Faces of more than three corners.
    Polygons,
    /// Faces of fewer than three corners.
    TooFewCorners,
    /// Corners without normals or texture coordinates in a file that has some.
    MixedCorners,
    /// More than one library in a line, or names with backslashes.
    Libraries,
    /// Material colours of one number.
    OneNumber,
}

impl Reason {
    /// In words.
    pub fn about(self) -> &'static str {
        match self {
            Reason::ByteOrderMark => {
                "the file begins with a byte order mark: tobj takes the first line for an unknown one"
            }
            Reason::ContinuedLines => "lines are continued by a backslash, which tobj does not know",
            Reason::OldLineEnds => "lines end with CR alone: tobj sees one line",
            Reason::NotUtf8 => "there are bytes that are no UTF-8, perhaps in a comment: tobj stops there",
            Reason::TrailingComments => "there are comments behind data: tobj takes them for more data",
            Reason::PointsAndLines => "there are points or lines: tobj may make triangles of them",
            Reason::Polygons => {
                "there are faces of more than three corners: tobj splits them as fans, which is wrong where they are \
                 concave; raybrook clips ears there"
            }
            Reason::TooFewCorners => {
                "there are faces of fewer than three corners: tobj makes triangles or an error of them"
            }
            Reason::MixedCorners => {
                "some corners have none of the normals or texture coordinates of the file: tobj gives them others'"
            }
            Reason::Libraries => {
                "a line names several libraries, or a path with backslashes: tobj takes it for one name"
            }
            Reason::OneNumber => "a colour has one number: tobj's reader of materials panics",
        }
    }
}

/// Something that is compared, triangle by triangle.
#[derive(Debug, Clone, Serialize)]
pub struct Compared {
    /// What.
    pub what: &'static str,
    /// Triangles of which it differs.
    pub differing: usize,
    /// The first of them.
    pub first: Option<usize>,
}

/// What two readers make of one file.
#[derive(Debug, Clone, Serialize)]
pub struct CrossCheck {
    /// Triangles that raybrook reads.
    pub triangles: usize,
    /// Triangles that `tobj` reads; `None` where it fails.
    pub tobj_triangles: Option<usize>,
    /// Why it fails.
    pub tobj_error: Option<String>,
    /// Positions, normals, texture coordinates and materials of the triangles that both have.
    pub compared: Vec<Compared>,
    /// What may be the cause, where something differs.
    pub reasons: Vec<Reason>,
}

impl CrossCheck {
    /// Whether a reason can be why something differs that does.
    fn is_explained_by(&self, reason: Reason) -> bool {
        let Some(count) = self.tobj_triangles else {
            let spoils_all = !matches!(reason, Reason::Polygons | Reason::MixedCorners | Reason::OneNumber);
            return spoils_all && reason != Reason::Libraries;
        };
        let is_other = |what: &[&str]| self.compared.iter().any(|c| c.differing > 0 && what.contains(&c.what));
        let has_other_triangles = count != self.triangles || is_other(&["positions"]);
        match reason {
            Reason::Polygons | Reason::TooFewCorners | Reason::PointsAndLines => has_other_triangles,
            Reason::MixedCorners => is_other(&["normals", "texture coordinates"]),
            Reason::Libraries | Reason::OneNumber => is_other(&["materials"]),
            _ => true,
        }
    }

    /// Whether both readers have the same.
    pub fn agrees(&self) -> bool {
        self.tobj_triangles == Some(self.triangles) && self.compared.iter().all(|c| c.differing == 0)
    }
}

/// A corner as a reader has it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Corner {
    position: Vec3,
    normal: Option<Vec3>,
    uv: Option<Vec2>,
}

struct Read3 {
    corners: [Corner; 3],
    material: Option<String>,
}

/// Reads the OBJ file at `path`, of which raybrook has made `scene`, by `tobj` and compares.
///
/// # Errors [`Error::Input`] when it is no OBJ file or cannot be read; [`Error::OutOfMemory`] when that takes more than
/// `budget`.
pub fn cross_check(path: &Path, scene: &Scene, budget: &MemoryBudget) -> Result<CrossCheck> {
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("obj")) {
        return Err(Error::input(path, None, "is no .obj file: only these are read by another reader, too"));
    }
    let (mut file, file_bytes) = open_regular(path)?;
    let bytes = file_bytes.saturating_mul(BYTES_OF_BYTE);
    let what = format!("reading {} a second time", path.display());
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy: "raise `memory_limit`" })?;
    let mut text = Vec::new();
    file.read_to_end(&mut text).map_err(|e| Error::io("read", path, e))?;
    let libraries = library_texts(path, &text);
    let found = read_by_tobj(&text, &libraries);
    let mut check = CrossCheck {
        triangles: scene.triangles.len(),
        tobj_triangles: None,
        tobj_error: None,
        compared: Vec::new(),
        reasons: Vec::new(),
    };
    match found {
        Ok(theirs) => {
            check.tobj_triangles = Some(theirs.len());
            check.compared = compare(scene, &theirs, &libraries);
        }
        Err(message) => check.tobj_error = Some(message),
    }
    if !check.agrees() {
        check.reasons =
            reasons(&text, &libraries).into_iter().filter(|reason| check.is_explained_by(*reason)).collect();
    }
    Ok(check)
}

/// The libraries that the file names, as far as they lie in its folder or below: `tobj` by itself opens any path.
fn library_texts(path: &Path, text: &[u8]) -> Vec<(String, Vec<u8>)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(root) = folder.canonicalize() else { return Vec::new() };
    let lines = text.split(|&b| b == b'\n').filter_map(|line| line.strip_prefix(b"mtllib "));
    let names = lines.map(|line| String::from_utf8_lossy(line).trim().to_owned());
    let inside = |name: &String| root.join(name).canonicalize().ok().filter(|path| path.starts_with(&root));
    let read = |name: String| {
        let text = read_regular(&inside(&name)?).ok()?;
        Some((name, text))
    };
    names.filter_map(read).collect()
}

/// The triangles that `tobj` makes of a text, in the order of the file.
fn read_by_tobj(text: &[u8], libraries: &[(String, Vec<u8>)]) -> std::result::Result<Vec<Read3>, String> {
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let library = |name: &Path| {
        let found = libraries.iter().find(|(known, _)| Path::new(known) == name);
        // It panics on colours of one number.
        found
            .filter(|(_, text)| !has_colour_of_one_number(text))
            .map_or(Err(tobj::LoadError::OpenFileFailed), |(_, text)| tobj::load_mtl_buf(&mut text.as_slice()))
    };
    let (models, materials) =
        tobj::load_obj_buf(&mut &text[..], &options, library).map_err(|error| error.to_string())?;
    let materials = materials.unwrap_or_default();
    let mut triangles = Vec::new();
    for mesh in models.iter().map(|model| &model.mesh) {
        let material = mesh.material_id.and_then(|id| materials.get(id)).map(|material| material.name.clone());
        for first in (0..mesh.indices.len() / 3).map(|i| 3 * i) {
            let corners = [first, first + 1, first + 2].map(|i| corner_of(mesh, i));
            triangles.push(Read3 { corners, material: material.clone() });
        }
    }
    Ok(triangles)
}

fn corner_of(mesh: &tobj::Mesh, index: usize) -> Corner {
    let numbers = |list: &[f32], indices: &[u32], size: usize| {
        let first = *indices.get(index)? as usize * size;
        list.get(first..first + size).map(<[f32]>::to_vec)
    };
    let position = numbers(&mesh.positions, &mesh.indices, 3).map_or(Vec3::NAN, |p| Vec3::from_slice(&p));
    Corner {
        position,
        normal: numbers(&mesh.normals, &mesh.normal_indices, 3).map(|n| Vec3::from_slice(&n)),
        uv: numbers(&mesh.texcoords, &mesh.texcoord_indices, 2).map(|uv| Vec2::from_slice(&uv)),
    }
}

/// The same of a triangle of raybrook's.
fn ours(scene: &Scene, triangle: &Triangle) -> Read3 {
    let corner = |k: usize| Corner {
        position: scene.positions[triangle.positions[k] as usize],
        normal: scene.normals.get(triangle.normals[k] as usize).copied(),
        uv: scene.uvs.get(triangle.uvs[k] as usize).copied(),
    };
    let material = scene.materials.get(triangle.material as usize).map(|material| material.name.clone());
    Read3 { corners: [0, 1, 2].map(corner), material }
}

fn compare(scene: &Scene, theirs: &[Read3], libraries: &[(String, Vec<u8>)]) -> Vec<Compared> {
    let lines = libraries.iter().flat_map(|(_, text)| text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii));
    let defined: HashSet<String> = lines
        .filter_map(|line| line.strip_prefix(b"newmtl "))
        .map(|name| String::from_utf8_lossy(name.trim_ascii()).into_owned())
        .collect();
    let names = ["positions", "normals", "texture coordinates", "materials"];
    let mut compared = names.map(|what| Compared { what, differing: 0, first: None });
    // NaN is as good as NaN.
    let bits = |v: Vec3| v.to_array().map(|x| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() });
    for (index, (triangle, theirs)) in scene.triangles.iter().zip(theirs).enumerate() {
        let ours = ours(scene, triangle);
        let each = |is_other: &dyn Fn(&Corner, &Corner) -> bool| {
            ours.corners.iter().zip(&theirs.corners).any(|(a, b)| is_other(a, b))
        };
        let (named, ours_named) = (theirs.material.as_ref(), ours.material.as_ref());
        let differs = [
            each(&|a, b| bits(a.position) != bits(b.position)),
            each(&|a, b| a.normal.map(bits) != b.normal.map(bits)),
            each(&|a, b| a.uv.map(|uv| bits(uv.extend(0.0))) != b.uv.map(|uv| bits(uv.extend(0.0)))),
            // A material that no library has is nobody's.
            named != ours_named && (named.is_some() || ours_named.is_some_and(|name| defined.contains(name))),
        ];
        for (compared, _) in compared.iter_mut().zip(differs).filter(|(_, differs)| *differs) {
            compared.differing += 1;
            compared.first = compared.first.or(Some(index));
        }
    }
    compared.to_vec()
}

fn has_colour_of_one_number(library: &[u8]) -> bool {
    let is_colour = |word: &[u8]| [&b"Ka"[..], b"Kd", b"Ks", b"Ke", b"Tf"].contains(&word);
    library.split(|&b| b == b'\n').any(|line| {
        let mut words = line.split(|b| b.is_ascii_whitespace()).filter(|word| !word.is_empty());
        words.next().is_some_and(is_colour) && words.count() < 3
    })
}

/// What the text has that `tobj` reads otherwise.
fn reasons(text: &[u8], libraries: &[(String, Vec<u8>)]) -> Vec<Reason> {
    let lines = || text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii);
    let faces = || lines().filter_map(|line| line.strip_prefix(b"f ").map(<[u8]>::trim_ascii));
    let corners = |face: &[u8]| face.split(|b| b.is_ascii_whitespace()).filter(|word| !word.is_empty()).count();
    let all_corners =
        || faces().flat_map(|face| face.split(|b| b.is_ascii_whitespace())).filter(|word| !word.is_empty());
    // Part 1 of v/vt/vn is a texture coordinate's index, part 2 a normal's.
    let lacks = |part: usize| {
        let has = |corner: &[u8]| corner.split(|&b| b == b'/').nth(part).is_some_and(|index| !index.is_empty());
        all_corners().any(|corner| !has(corner))
    };
    let tells = |word: &[u8]| lines().any(|line| line.starts_with(word));
    let is_mixed = (tells(b"vt ") && lacks(1)) || (tells(b"vn ") && lacks(2));
    let names = || lines().filter_map(|line| line.strip_prefix(b"mtllib ").map(<[u8]>::trim_ascii));
    let found = [
        (Reason::ByteOrderMark, text.starts_with(b"\xef\xbb\xbf")),
        (Reason::ContinuedLines, lines().any(|line| line.ends_with(b"\\"))),
        (Reason::OldLineEnds, text.windows(2).any(|pair| pair[0] == b'\r' && pair[1] != b'\n')),
        (Reason::NotUtf8, std::str::from_utf8(text).is_err()),
        (Reason::TrailingComments, lines().any(|line| line.iter().position(|&b| b == b'#').is_some_and(|at| at > 0))),
        (Reason::PointsAndLines, lines().any(|line| line.starts_with(b"p ") || line.starts_with(b"l "))),
        (Reason::Polygons, faces().any(|face| corners(face) > 3)),
        (Reason::TooFewCorners, faces().any(|face| corners(face) < 3)),
        (Reason::MixedCorners, is_mixed),
        (Reason::Libraries, names().any(|name| name.contains(&b' ') || name.contains(&b'\\'))),
        (Reason::OneNumber, libraries.iter().any(|(_, text)| has_colour_of_one_number(text))),
    ];
    found.into_iter().filter_map(|(reason, is_there)| is_there.then_some(reason)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::scene::load;

    fn checked(text: &[u8]) -> CrossCheck {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        std::fs::write(folder.path().join("a.mtl"), "newmtl red\nKd 1 0 0\nnewmtl grey\nKd 0.5 0.5 0.5\n").unwrap();
        cross_check(&path, &load(&path).unwrap(), &MemoryBudget::UNLIMITED).unwrap()
    }

    const SQUARE: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n";

    #[test]
    fn readers_agree_on_what_is_plain() {
        let text = format!("{SQUARE}usemtl red\nf 1/1/1 2/2/1 3/3/1\nusemtl grey\nf 1/1/1 3/3/1 4/2/1\n");
        let check = checked(text.as_bytes());
        assert!(check.agrees() && check.reasons.is_empty(), "{check:?}");
        assert_eq!((check.triangles, check.tobj_triangles), (2, Some(2)));
        assert!(
            checked(format!("{SQUARE}f 1/1/1 2/2/1 3/3/1 4/2/1\n").as_bytes()).agrees(),
            "a convex face is a fan to both"
        );
    }

    #[test]
    fn what_differs_is_named_with_its_reason() {
        // A fan from the first corner of this arrow covers its notch.
        let arrow = "v 0 -1 0\nv 2 1 0\nv 0 0 0\nv -2 1 0\n";
        for (text, reason, what) in [
            ("\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_owned(), Reason::ByteOrderMark, ""),
            ("v 0 0 0\nv 1 \\\n0 0\nv 0 1 0\nf 1 2 3\n".to_owned(), Reason::ContinuedLines, ""),
            ("v 2 1 0\nv 0 0 0\nv -2 1 0\nv 0 -1 0\nf 1 2 3 4\n".to_owned(), Reason::Polygons, "positions"),
            (format!("{SQUARE}f 1/1/1 2/2/1 3/3\n"), Reason::MixedCorners, "normals"),
            ("v 0 0 0\nv 1 0 0\nv 0 1 0 # last\nf 1 2 3\n".to_owned(), Reason::TrailingComments, ""),
        ] {
            let check = checked(text.as_bytes());
            assert!(!check.agrees() && check.reasons.contains(&reason), "{text}: {check:?}");
            let is_told = check.compared.iter().any(|c| c.what == what && c.differing > 0);
            assert!(
                is_told || check.tobj_error.is_some() || check.tobj_triangles != Some(check.triangles),
                "{check:?}"
            );
        }
        let latin = [b"# caf\xe9\n", arrow.as_bytes(), b"f 1 2 3\n"].concat();
        let check = checked(&latin);
        assert!(check.tobj_error.is_some() && check.reasons == [Reason::NotUtf8], "{check:?}");
    }

    #[test]
    fn other_formats_are_refused() {
        let error = cross_check(Path::new("a.ply"), &Scene::default(), &MemoryBudget::UNLIMITED).unwrap_err();
        assert_eq!(error.exit_code(), 3);
    }
}
