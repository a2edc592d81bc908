//! The `f` statements of an OBJ text, as triangles.

use super::survey::{Part, Survey, material_name};
use super::vertices::Vertices;
use super::{Fault, first_fault};
use crate::parallel;
use crate::scene::reading::split_by;
use crate::scene::text::{Tally, integer, quote, split_keyword, words};
use crate::scene::triangulate::{MAX_CORNERS, Triangulator};
use crate::scene::{MaterialId, NO_INDEX, Triangle};
use glam::Vec3;
use std::collections::HashMap;

/// Names of the three kinds of index of a face's corner, in the order of a corner.
const INDEX_KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// What the materials of `usemtl` statements are.
pub(super) struct Materials<'a> {
    /// The material of each name.
    pub(super) by_name: HashMap<&'a [u8], MaterialId>,
    /// The material of faces before the first `usemtl`.
    pub(super) bare: MaterialId,
}

/// What is to be told of faces.
#[derive(Debug, Default)]
pub(super) struct Tallies {
    /// Lines with faces of fewer than three corners, which are left out.
    pub(super) short: Tally,
    /// Lines with texture or normal indices that refer to nothing, which are left out.
    pub(super) dangling: Tally,
    /// How many large concave polygons were split as if convex, and the warning about them.
    pub(super) fans: Option<String>,
}

/// The triangles of all faces, in file order.
pub(super) fn read(
    survey: &Survey,
    vertices: &Vertices,
    materials: &Materials,
) -> Result<(Vec<Triangle>, Tallies), Fault> {
    let mut triangles = bytemuck::zeroed_vec(survey.triangles);
    let places = split_by(&mut triangles, survey.parts.iter().map(|part| part.triangles));
    let first = Triangulator::new();
    let read = parallel::map(survey.parts.iter().zip(places), |(part, places)| {
        Reader::new(survey, part, vertices, materials).read(part, places, &mut Triangulator::sharing(&first))
    });
    let mut tallies = merged(first_fault(read)?);
    if first.is_spent() {
        // Which polygons are split properly must not depend on which part was the first to be read.
        let mut triangulator = Triangulator::new();
        let places = split_by(&mut triangles, survey.parts.iter().map(|part| part.triangles));
        for (part, places) in survey.parts.iter().zip(places) {
            Reader::new(survey, part, vertices, materials).read(part, places, &mut triangulator)?;
        }
        tallies.fans = Some(triangulator.fans_message());
    }
    Ok((triangles, tallies))
}

fn merged(parts: Vec<Tallies>) -> Tallies {
    let mut all = Tallies::default();
    for part in parts {
        all.short.append(part.short, 0);
        all.dangling.append(part.dangling, 0);
    }
    all
}

/// Reads the faces of one part.
struct Reader<'a> {
    /// Numbers of `v`, `vt` and `vn` statements in the file, and those up to here, which negative indices count back
    /// from.
    counts: [usize; 3],
    seen: [usize; 3],
    vertices: &'a Vertices,
    materials: &'a Materials<'a>,
    material: MaterialId,
    /// The line of the statement in hand.
    line: usize,
    /// Indices of the corners of the face in hand, by kind.
    corners: Vec<[u32; 3]>,
    polygon: Vec<Vec3>,
    tallies: Tallies,
}

impl<'a> Reader<'a> {
    fn new(survey: &Survey, part: &Part, vertices: &'a Vertices, materials: &'a Materials<'a>) -> Self {
        Reader {
            counts: survey.counts,
            seen: part.before,
            vertices,
            materials,
            material: part.material.as_ref().map_or(materials.bare, |name| materials.by_name[&name[..]]),
            line: 0,
            corners: Vec::new(),
            polygon: Vec::new(),
            tallies: Tallies::default(),
        }
    }

    /// Fills `places`, which are as many as the faces of `part` make triangles.
    fn read(mut self, part: &Part, places: &mut [Triangle], triangulator: &mut Triangulator) -> Result<Tallies, Fault> {
        if part.faces == 0 {
            return Ok(self.tallies);
        }
        let mut places = places.iter_mut();
        for (number, line) in part.lines() {
            self.line = number;
            let (keyword, rest) = split_keyword(&line);
            match keyword {
                b"v" => self.seen[0] += 1,
                b"vt" => self.seen[1] += 1,
                b"vn" => self.seen[2] += 1,
                b"f" => {
                    self.read_corners(rest).map_err(|fault| (number, fault))?;
                    self.split(triangulator, |triangle| {
                        *places.next().expect("the survey counted the same corners") = triangle;
                    });
                }
                b"usemtl" => self.material = self.materials.by_name[&material_name(line)[..]],
                _ => {}
            }
        }
        Ok(self.tallies)
    }

    fn read_corners(&mut self, rest: &[u8]) -> Result<(), String> {
        self.corners.clear();
        let mut count = 0;
        for word in words(rest) {
            let corner = self.corner(word)?;
            count += 1;
            if count <= MAX_CORNERS {
                self.corners.push(corner);
            }
        }
        if count > MAX_CORNERS {
            return Err(format!("a face of {count} corners; the most is {MAX_CORNERS}: split it"));
        }
        if count < 3 {
            self.tallies.short.note(self.line);
        }
        Ok(())
    }

    /// Gives the triangles of the face in hand to `push`.
    fn split(&mut self, triangulator: &mut Triangulator, mut push: impl FnMut(Triangle)) {
        let material = self.material;
        let mut push = |[a, b, c]: [[u32; 3]; 3]| {
            let of_kind = |kind: usize| [a[kind], b[kind], c[kind]];
            push(Triangle { positions: of_kind(0), uvs: of_kind(1), normals: of_kind(2), material });
        };
        if let &[a, b, c] = &self.corners[..] {
            return push([a, b, c]);
        }
        self.polygon.clear();
        self.polygon.extend(self.corners.iter().map(|corner| self.vertices.positions[corner[0] as usize]));
        for triangle in triangulator.split(&self.polygon) {
            push(triangle.map(|corner| self.corners[corner as usize]));
        }
    }

    /// The indices of a corner `v/vt/vn`, from 0; [`NO_INDEX`] for a texture coordinate or normal that is missing or
    /// not finite.
    fn corner(&mut self, word: &[u8]) -> Result<[u32; 3], String> {
        let mut parts = word.split(|&b| b == b'/');
        let mut indices = [NO_INDEX; 3];
        for (kind, place) in indices.iter_mut().enumerate() {
            let part = parts.next().unwrap_or_default();
            let is_optional = kind > 0;
            if is_optional && part.is_empty() {
                continue;
            }
            if is_optional && self.counts[kind] == 0 {
                self.tallies.dangling.note(self.line);
                continue;
            }
            match self.resolve(part, kind) {
                Ok(index) if self.is_usable(index, kind) => *place = index,
                Ok(_) => {}
                Err(Dangling::Nothing) if is_optional => self.tallies.dangling.note(self.line),
                Err(_) => return Err(self.index_fault(part, kind, word)),
            }
        }
        if parts.next().is_some() {
            return Err(format!("'{}' has more than vertex/texture/normal", quote(word)));
        }
        Ok(indices)
    }

    /// The absolute index, from 0, that `part` means.
    fn resolve(&self, part: &[u8], kind: usize) -> Result<u32, Dangling> {
        if part.is_empty() {
            return Err(Dangling::Nothing);
        }
        let index = integer(part).ok_or(Dangling::NoInteger)?;
        let absolute = if index < 0 { index.saturating_add(self.seen[kind] as i64 + 1) } else { index };
        let is_known = (1..=self.counts[kind] as i64).contains(&absolute);
        if is_known { Ok((absolute - 1) as u32) } else { Err(Dangling::Nothing) }
    }

    /// Texture coordinates and normals that are not finite are no use; positions that are not are told of later.
    fn is_usable(&self, index: u32, kind: usize) -> bool {
        match kind {
            0 => true,
            1 => self.vertices.uvs[index as usize].is_finite(),
            _ => self.vertices.normals[index as usize].is_finite(),
        }
    }

    fn index_fault(&self, part: &[u8], kind: usize, word: &[u8]) -> String {
        let (what, text, count) = (INDEX_KINDS[kind], quote(part), self.counts[kind]);
        let digits = part.strip_prefix(b"-").unwrap_or(part);
        if part.is_empty() {
            format!("face corner '{}' has no {what} index", quote(word))
        } else if !digits.iter().all(u8::is_ascii_digit) || digits.is_empty() {
            format!("{what} index '{text}' is not a whole number")
        } else if digits.iter().all(|&d| d == b'0') {
            format!("{what} index 0; indices count from 1")
        } else if part.starts_with(b"-") {
            format!("{what} index {text} reaches before the first {what}: there are {} up to here", self.seen[kind])
        } else {
            format!("{what} index {text} is too large: the file has {count}")
        }
    }
}

/// Why an index means nothing.
enum Dangling {
    /// It is empty, zero or out of range.
    Nothing,
    /// It is not an integer of 64 bits.
    NoInteger,
}
