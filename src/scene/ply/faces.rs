//! The faces of a PLY file, split into triangles.

use super::rows::Sink;
use super::values::Values;
use super::vertices::{BLUE, GREEN, RED, Vertices, colour_scale, find};
use crate::budget::MemoryBudget;
use crate::parallel;
use crate::scene::paint;
use crate::scene::reading::{check_memory, make_room, split_by};
use crate::scene::text::Tally;
use crate::scene::triangulate::{MAX_CORNERS, Triangulator};
use crate::scene::{NO_INDEX, TextureId, Triangle};
use glam::{Vec2, Vec3};
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{ElementDef, PlyProperty, PropertyType};
use std::fmt;
use std::path::{Path, PathBuf};

/// The names that writers give to the list of a face's corners.
const CORNERS: &[&str] = &["vertex_indices", "vertex_index"];
/// MeshLab's list of texture coordinates, u and v for each corner.
const TEXCOORDS: &str = "texcoord";
/// MeshLab's number of a face's texture.
const TEXTURE: &[&str] = &["texnumber"];

/// What a property of a face is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    Corners,
    Texcoords,
    Texture,
    /// A part of the colour, and its factor.
    Colour(usize, f32),
    Unused,
}

/// The faces.
pub(super) struct Faces {
    roles: Vec<Role>,
    /// Whether faces have colours.
    pub has_colours: bool,
    /// Whether corners have texture coordinates of their face's own.
    pub has_texcoords: bool,
    count: usize,
    face: Face,
    polygon: Vec<Vec3>,
    triangulator: Triangulator,
    /// Their materials are paints until [`paint::materials`] makes materials of them.
    pub triangles: Vec<Triangle>,
    /// Texture coordinates of the faces' own.
    pub uvs: Vec<Vec2>,
    /// The file, for messages, and what it may take: a polygon has nearly as many triangles as corners.
    file: (PathBuf, MemoryBudget),
    /// Why there is no memory for more triangles, once there is none.
    pub refused: Option<crate::Error>,
    /// Which texture each number means, if it could be loaded.
    textures: Vec<Option<TextureId>>,
    /// Faces with fewer than three corners, which are left out.
    pub short: Tally,
    /// Lists of texture coordinates of the wrong length, which are left out.
    pub odd_texcoords: Tally,
    /// Whether a triangle has corners of different colours.
    pub blended: bool,
}

/// A face.
#[derive(Default)]
struct Face {
    corners: Vec<u32>,
    texcoords: Vec<f32>,
    texture: i64,
    colour: [f32; 3],
}

impl Faces {
    /// Room for the rows of `element` of a `file`, between `vertices`; `textures` are those that the file names.
    ///
    /// # Errors
    /// It has no list of corners.
    pub fn new(
        element: &ElementDef,
        vertices: &Vertices,
        textures: Vec<Option<TextureId>>,
        (path, budget): (&Path, &MemoryBudget),
    ) -> Result<Faces, String> {
        let mut roles = vec![Role::Unused; element.properties.len()];
        let corners = find_list(element, CORNERS).ok_or("the faces have no list 'vertex_indices'")?;
        roles[corners] = Role::Corners;
        let texcoords = find_list(element, &[TEXCOORDS]);
        if let Some(texcoords) = texcoords {
            roles[texcoords] = Role::Texcoords;
        }
        if let Some(texture) = find(element, TEXTURE).filter(|_| !textures.is_empty()) {
            roles[texture] = Role::Texture;
        }
        let colour = [RED, GREEN, BLUE].map(|names| find(element, names));
        let has_colours = colour.iter().all(Option::is_some) && !vertices.has_colours;
        for (part, property) in colour.into_iter().flatten().enumerate().filter(|_| has_colours) {
            roles[property] = Role::Colour(part, colour_scale(&element.properties[property]));
        }
        let file = (path.to_owned(), *budget);
        Ok(Faces::empty(roles, has_colours, texcoords.is_some(), textures, Triangulator::new(), file))
    }

    fn empty(
        roles: Vec<Role>,
        has_colours: bool,
        has_texcoords: bool,
        textures: Vec<Option<TextureId>>,
        triangulator: Triangulator,
        file: (PathBuf, MemoryBudget),
    ) -> Faces {
        Faces {
            roles,
            has_colours,
            has_texcoords,
            count: 0,
            face: Face::default(),
            polygon: Vec::new(),
            triangulator,
            triangles: Vec::new(),
            uvs: Vec::new(),
            file,
            refused: None,
            textures,
            short: Tally::default(),
            odd_texcoords: Tally::default(),
            blended: false,
        }
    }

    /// None, to be read from a part of the same rows.
    pub fn like(&self) -> Faces {
        let (roles, textures) = (self.roles.clone(), self.textures.clone());
        let triangulator = Triangulator::sharing(&self.triangulator);
        let Faces { has_colours, has_texcoords, .. } = *self;
        Faces::empty(roles, has_colours, has_texcoords, textures, triangulator, self.file.clone())
    }

    /// None, to be read from all rows.
    pub fn afresh(&self) -> Faces {
        Faces { triangulator: Triangulator::new(), ..self.like() }
    }

    /// Whether some polygons are split by the order in which they come.
    pub fn is_spent(&self) -> bool {
        self.triangulator.is_spent()
    }

    /// Takes the values of property number `number` from `values`: false when it is not used, None when something is
    /// wrong.
    pub fn take(
        &mut self,
        number: usize,
        property: &PlyProperty,
        values: &mut impl Values,
        vertices: &Vertices,
    ) -> Option<bool> {
        let face = &mut self.face;
        match (self.roles[number], &property.property_type) {
            (Role::Corners, &PropertyType::List { count_type, data_type }) => {
                let count = values.count(count_type).filter(|&count| count <= MAX_CORNERS)?;
                face.corners.clear();
                for _ in 0..count {
                    let corner = values.integer(data_type).and_then(|corner| u32::try_from(corner).ok());
                    face.corners.push(corner.filter(|&corner| (corner as usize) < vertices.count)?);
                }
            }
            (Role::Texcoords, &PropertyType::List { count_type, data_type }) => {
                let count = values.count(count_type).filter(|&count| count <= 2 * MAX_CORNERS)?;
                face.texcoords.clear();
                for _ in 0..count {
                    face.texcoords.push(values.number(data_type)?);
                }
            }
            (Role::Texture, &PropertyType::Scalar(kind)) => face.texture = values.integer(kind)?,
            (Role::Colour(part, scale), &PropertyType::Scalar(kind)) => {
                face.colour[part] = values.number(kind)? * scale;
            }
            _ => return Some(false),
        }
        Some(true)
    }

    /// Ends a face, whose properties were all taken, between `vertices`; a fault says what is wrong with it.
    pub fn end_face(&mut self, vertices: &Vertices) -> Result<(), String> {
        let faces = self;
        let number = faces.count;
        faces.count += 1;
        let (corners, texcoords) = (&faces.face.corners, &faces.face.texcoords);
        if corners.len() < 3 {
            faces.short.note(number);
            return Ok(());
        }
        let has_own_uvs = texcoords.len() == 2 * corners.len();
        if !texcoords.is_empty() && !has_own_uvs {
            faces.odd_texcoords.note(number);
        }
        let first_uv = faces.uvs.len() as u32;
        if has_own_uvs {
            if faces.uvs.len() + corners.len() >= NO_INDEX as usize {
                return Err("more texture coordinates than 32-bit indices can tell apart".into());
            }
            faces.uvs.extend(texcoords.chunks_exact(2).map(Vec2::from_slice));
        }
        let normal_of = |vertex: u32| finite(&vertices.normals, vertex, |n| n.is_finite());
        let uv_of = |corner: usize| match faces.has_texcoords {
            true if has_own_uvs => finite(&faces.uvs, first_uv + corner as u32, |uv| uv.is_finite()),
            true => NO_INDEX,
            false => finite(&vertices.uvs, corners[corner], |uv| uv.is_finite()),
        };
        let texture = usize::try_from(faces.face.texture).ok().and_then(|number| *faces.textures.get(number)?);
        let triangles = if corners.len() == 3 {
            &[[0, 1, 2]] // most faces: without a look at their vertices
        } else {
            faces.polygon.clear();
            faces.polygon.extend(corners.iter().map(|&i| vertices.positions[i as usize]));
            faces.triangulator.split(&faces.polygon)
        };
        let (path, budget) = &faces.file;
        if let Err(error) = make_room(&mut faces.triangles, triangles.len(), path, budget) {
            faces.refused = Some(error);
            return Err("too many triangles for the memory".into());
        }
        for triangle in triangles {
            let triangle = triangle.map(|corner| corner as usize);
            let positions = triangle.map(|corner| corners[corner]);
            let uvs = triangle.map(uv_of);
            let paint = match texture.filter(|_| !uvs.contains(&NO_INDEX)) {
                Some(texture) => paint::textured(texture),
                None if !vertices.colours.is_empty() => {
                    let colours = positions.map(|i| vertices.colours[i as usize]);
                    faces.blended |= colours[0] != colours[1] || colours[0] != colours[2];
                    paint::coloured(paint::mean(colours))
                }
                None if faces.has_colours => paint::coloured(faces.face.colour.map(paint::to_8_bits)),
                None => paint::PLAIN,
            };
            let normals = positions.map(normal_of);
            faces.triangles.push(Triangle { positions, normals, uvs, material: paint });
        }
        Ok(())
    }

    /// Adds those of `parts` in their order. None when there are more texture coordinates than indices can tell apart,
    /// or when there is no memory for all of them twice.
    pub fn extend(&mut self, parts: Vec<Faces>) -> Option<()> {
        let count = parts.iter().map(|part| part.triangles.len()).sum();
        check_memory(&self.file.0, (count * size_of::<Triangle>()) as u64, &self.file.1).ok()?;
        self.triangles = bytemuck::zeroed_vec(count);
        let places = split_by(&mut self.triangles, parts.iter().map(|part| part.triangles.len()));
        let first_uvs = parts.iter().scan(0, |sum, part| Some(std::mem::replace(sum, *sum + part.uvs.len())));
        let first_uvs: Vec<_> = first_uvs.collect();
        for part in &parts {
            self.short.append(part.short, self.count);
            self.odd_texcoords.append(part.odd_texcoords, self.count);
            self.count += part.count;
            self.blended |= part.blended;
            self.uvs.extend_from_slice(&part.uvs);
        }
        if self.uvs.len() >= NO_INDEX as usize {
            return None;
        }
        parallel::each(parts.into_iter().zip(places).zip(first_uvs), |((part, places), first_uv)| {
            places.copy_from_slice(&part.triangles);
            let own_uvs =
                places.iter_mut().flat_map(|t| &mut t.uvs).filter(|uv| part.has_texcoords && **uv != NO_INDEX);
            own_uvs.for_each(|uv| *uv += first_uv as u32);
        });
        Some(())
    }

    /// Whether the rows of `element` have texture coordinates.
    pub fn has_texcoords(element: &ElementDef) -> bool {
        find_list(element, &[TEXCOORDS]).is_some()
    }

    /// Whether property number `property` is read.
    pub fn uses(&self, property: usize) -> bool {
        self.roles[property] != Role::Unused
    }

    /// The warning about large concave polygons that were split as if convex, if there were any.
    pub fn fans_message(&self) -> Option<String> {
        (self.triangulator.fans > 0).then(|| self.triangulator.fans_message())
    }
}

/// The number of the first property of `element` that is a list with one of `names`.
fn find_list(element: &ElementDef, names: &[&str]) -> Option<usize> {
    let is_list = |p: &PlyProperty| matches!(p.property_type, PropertyType::List { .. });
    element.properties.iter().position(|p| names.contains(&p.name.as_str()) && is_list(p))
}

/// Reads faces between `vertices`.
pub(super) struct FaceSink<'a> {
    pub faces: &'a mut Faces,
    pub vertices: &'a Vertices,
}

impl Sink for FaceSink<'_> {
    fn property<'de, A: MapAccess<'de>>(&mut self, property: usize, row: &mut A) -> Result<(), A::Error> {
        let face = &mut self.faces.face;
        match self.faces.roles[property] {
            Role::Corners => {
                row.next_value_seed(Corners { list: &mut face.corners, vertices: self.vertices.count })?;
            }
            Role::Texcoords => row.next_value_seed(Numbers(&mut face.texcoords))?,
            Role::Texture => face.texture = row.next_value()?,
            Role::Colour(part, scale) => face.colour[part] = row.next_value::<f32>()? * scale,
            Role::Unused => _ = row.next_value::<IgnoredAny>()?,
        }
        Ok(())
    }

    fn end_row(&mut self) -> Result<(), String> {
        self.faces.end_face(self.vertices)
    }
}

/// `index` if `values` has something there that is finite, else [`NO_INDEX`].
fn finite<T>(values: &[T], index: u32, is_finite: impl Fn(&T) -> bool) -> u32 {
    if values.get(index as usize).is_some_and(is_finite) { index } else { NO_INDEX }
}

/// The corners of a face, each a number of a vertex below `vertices`.
struct Corners<'a> {
    list: &'a mut Vec<u32>,
    vertices: usize,
}

impl<'de> DeserializeSeed<'de> for Corners<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Corners<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of vertex numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<(), A::Error> {
        self.list.clear();
        while let Some(number) = numbers.next_element::<i64>()? {
            if self.list.len() == MAX_CORNERS {
                return Err(Error::custom(format!("more than {MAX_CORNERS} corners")));
            }
            match u32::try_from(number).ok().filter(|&i| (i as usize) < self.vertices) {
                Some(index) => self.list.push(index),
                None => {
                    return Err(Error::custom(format!("vertex {number} is not one of the file's {}", self.vertices)));
                }
            }
        }
        Ok(())
    }
}

/// A list of numbers.
struct Numbers<'a>(&'a mut Vec<f32>);

impl<'de> DeserializeSeed<'de> for Numbers<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Numbers<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<(), A::Error> {
        self.0.clear();
        while let Some(number) = numbers.next_element()? {
            if self.0.len() == 2 * MAX_CORNERS {
                return Err(Error::custom(format!("more than {} texture coordinates", 2 * MAX_CORNERS)));
            }
            self.0.push(number);
        }
        Ok(())
    }
}
