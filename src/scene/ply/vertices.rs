//! The vertices of a PLY file.

use super::rows::Sink;
use crate::scene::paint;
use glam::{Vec2, Vec3};
use serde::de::{IgnoredAny, MapAccess};
use serde_ply::{ElementDef, PlyProperty, PropertyType, ScalarType};
use std::ops::Range;

/// The names that writers give to what is read of a vertex, in the order of [`Vertices::row`]. Texture coordinates are
/// called s, t by Blender, u, v by others, and texture_u, texture_v by MeshLab.
const NAMES: [&[&str]; 11] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["u", "s", "texture_u", "texture_s"],
    &["v", "t", "texture_v", "texture_t"],
    RED,
    GREEN,
    BLUE,
];
const POSITION: Range<usize> = 0..3;
const NORMAL: Range<usize> = 3..6;
const UV: Range<usize> = 6..8;
const COLOUR: Range<usize> = 8..11;

/// Names of the parts of a colour.
pub(super) const RED: &[&str] = &["red", "r", "diffuse_red"];
pub(super) const GREEN: &[&str] = &["green", "g", "diffuse_green"];
pub(super) const BLUE: &[&str] = &["blue", "b", "diffuse_blue"];

/// The number of the first property of `element` that is a single number with one of `names`.
pub(super) fn find(element: &ElementDef, names: &[&str]) -> Option<usize> {
    let is_scalar = |p: &PlyProperty| matches!(p.property_type, PropertyType::Scalar(_));
    element.properties.iter().position(|p| names.contains(&p.name.as_str()) && is_scalar(p))
}

/// What to multiply a part of a colour with for 255 to be its largest value: integers of 16 bits have 65535 for it,
/// floats 1.
pub(super) fn colour_scale(property: &PlyProperty) -> f32 {
    match property.property_type {
        PropertyType::Scalar(ScalarType::F32 | ScalarType::F64) => 255.0,
        PropertyType::Scalar(ScalarType::I16 | ScalarType::U16) => 255.0 / 65535.0,
        _ => 1.0,
    }
}

/// The vertices, all arrays of one length or empty.
pub(super) struct Vertices {
    /// How many the header promises.
    pub count: usize,
    /// For each property where in `row` it goes, if anywhere, and its factor.
    slots: Vec<Option<(usize, f32)>>,
    row: [f32; NAMES.len()],
    has_normals: bool,
    /// Whether they have texture coordinates.
    pub has_uvs: bool,
    /// Whether they have colours.
    pub has_colours: bool,
    /// Where they are.
    pub positions: Vec<Vec3>,
    /// Their normals.
    pub normals: Vec<Vec3>,
    /// Their texture coordinates.
    pub uvs: Vec<Vec2>,
    /// Their colours, as displayed.
    pub colours: Vec<[u8; 3]>,
}

impl Vertices {
    /// Room for the rows of `element`.
    ///
    /// # Errors
    /// It has no positions, or more rows than indices can tell apart.
    pub fn new(element: &ElementDef) -> Result<Vertices, String> {
        let found = NAMES.map(|names| find(element, names));
        let has = |part: Range<usize>| found[part].iter().all(Option::is_some);
        if !has(POSITION) {
            return Err("the vertices have no x, y and z".into());
        }
        if element.count >= crate::scene::NO_INDEX as usize {
            return Err(format!("has {} vertices, more than 32-bit indices can tell apart", element.count));
        }
        let mut slots = vec![None; element.properties.len()];
        for part in [POSITION, NORMAL, UV, COLOUR].into_iter().filter(|part| has(part.clone())) {
            for slot in part {
                let scale = |property| if COLOUR.contains(&slot) { colour_scale(property) } else { 1.0 };
                if let Some(property) = found[slot] {
                    slots[property] = Some((slot, scale(&element.properties[property])));
                }
            }
        }
        Ok(Vertices {
            count: element.count,
            slots,
            row: Default::default(),
            has_normals: has(NORMAL),
            has_uvs: has(UV),
            has_colours: has(COLOUR),
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            colours: Vec::new(),
        })
    }

    /// As many as were asked for, of which none was read.
    pub fn like(&self) -> Vertices {
        let (positions, normals, uvs, colours) = Default::default();
        Vertices { slots: self.slots.clone(), positions, normals, uvs, colours, ..*self }
    }

    /// Takes the value of property number `property`.
    pub fn set(&mut self, property: usize, value: f32) {
        if let Some((slot, scale)) = self.slots[property] {
            self.row[slot] = value * scale;
        }
    }

    /// Ends a row.
    pub fn push(&mut self) {
        self.positions.push(Vec3::from_slice(&self.row[POSITION]));
        if self.has_normals {
            self.normals.push(Vec3::from_slice(&self.row[NORMAL]));
        }
        if self.has_uvs {
            self.uvs.push(Vec2::from_slice(&self.row[UV]));
        }
        if self.has_colours {
            self.colours.push([0, 1, 2].map(|part| paint::to_8_bits(self.row[COLOUR][part])));
        }
    }

    /// Adds those of `parts` in their order.
    pub fn extend(&mut self, parts: Vec<Vertices>) {
        self.positions.reserve_exact(parts.iter().map(|part| part.positions.len()).sum());
        for part in parts {
            self.positions.extend(part.positions);
            self.normals.extend(part.normals);
            self.uvs.extend(part.uvs);
            self.colours.extend(part.colours);
        }
    }

    /// Bytes that a row becomes, twice: parts that were read by several threads are there once more when they are
    /// joined.
    pub fn row_bytes(&self) -> u64 {
        let of = |has: bool, bytes: usize| if has { bytes } else { 0 };
        let row = size_of::<Vec3>()
            + of(self.has_normals, size_of::<Vec3>())
            + of(self.has_uvs, size_of::<Vec2>())
            + of(self.has_colours, size_of::<[u8; 3]>());
        2 * row as u64
    }

    /// Whether property number `property` is read.
    pub fn uses(&self, property: usize) -> bool {
        self.slots[property].is_some()
    }
}

impl Sink for Vertices {
    fn property<'de, A: MapAccess<'de>>(&mut self, property: usize, row: &mut A) -> Result<(), A::Error> {
        match self.slots[property] {
            Some(_) => self.set(property, row.next_value()?),
            None => _ = row.next_value::<IgnoredAny>()?,
        }
        Ok(())
    }

    fn end_row(&mut self) -> Result<(), String> {
        self.push();
        Ok(())
    }
}
