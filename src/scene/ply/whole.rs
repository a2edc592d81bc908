//! Reads the rows of a PLY file that has no fault, from memory and by all processors at the same time.
//!
//! Where rows begin is found by stepping from one to the next; blocks of rows are then read beside each other, each
//! into vertices and faces of its own, and joined. Whatever is unusual here (a fault above all) makes it give up, and
//! the file is streamed through `serde-ply` from its beginning, which finds the words for what is wrong. It takes no
//! more than some nanoseconds a value; `serde-ply` asks a reader for the bytes of each, and makes a string of each
//! number of a text.

use super::faces::Faces;
use super::values::{Binary, Text, Values};
use super::vertices::Vertices;
use crate::parallel;
use serde_ply::{ElementDef, PlyFormat, PlyHeader, PlyProperty, PropertyType};

/// Rows of a block: some milliseconds of work.
const BLOCK_ROWS: usize = 1 << 14;

/// What was read.
pub(super) struct Whole {
    pub vertices: Vertices,
    pub faces: Faces,
    /// Whether something follows the rows.
    pub has_more: bool,
    /// Whether a line of a text had something beside its row.
    pub left_out: bool,
}

/// Reads `data`, all that follows `header`, into elements like `vertices` and `faces`, which are number `vertex` and
/// `face`. Lines of a text end with `line_end`. None when something is wrong with it, or not foreseen here.
pub(super) fn read(
    header: &PlyHeader,
    data: &[u8],
    line_end: u8,
    (vertex, vertices): (usize, &Vertices),
    (face, faces): (usize, &Faces),
) -> Option<Whole> {
    let wanted = Wanted { vertex, vertices, face, faces };
    match header.format {
        PlyFormat::Ascii => wanted.read(header, Text::new(data, line_end)),
        PlyFormat::BinaryLittleEndian => wanted.read(header, Binary::<false>(data)),
        PlyFormat::BinaryBigEndian => wanted.read(header, Binary::<true>(data)),
    }
}

struct Wanted<'a> {
    vertex: usize,
    vertices: &'a Vertices,
    face: usize,
    faces: &'a Faces,
}

/// Rows that stand one after the other, and how many they are.
type Block<V> = (V, usize);

impl Wanted<'_> {
    fn read<V: Values>(&self, header: &PlyHeader, mut values: V) -> Option<Whole> {
        let (mut vertex_blocks, mut face_blocks) = (Vec::new(), Vec::new());
        let mut left_out = false;
        for (number, element) in header.elem_defs.iter().enumerate() {
            let blocks = blocks(&mut values, element)?;
            match number {
                _ if number == self.vertex => vertex_blocks = blocks,
                _ if number == self.face => face_blocks = blocks,
                _ => {
                    let read = read_all(blocks, |block| read_over(&element.properties, block))?;
                    left_out |= read.contains(&true);
                }
            }
        }
        let has_more = !values.is_empty();

        let properties = &header.elem_defs[self.vertex].properties;
        let read = read_all(vertex_blocks, |block| read_vertices(self.vertices.like(), properties, block))?;
        let (parts, left_out_of): (Vec<_>, Vec<_>) = read.into_iter().unzip();
        left_out |= left_out_of.contains(&true);
        let mut vertices = self.vertices.like();
        vertices.extend(parts);

        let properties = &header.elem_defs[self.face].properties;
        let read = read_all(face_blocks, |block| read_faces(self.faces.like(), &vertices, properties, block))?;
        let (parts, left_out_of): (Vec<_>, Vec<_>) = read.into_iter().unzip();
        left_out |= left_out_of.contains(&true);
        if self.faces.is_spent() {
            return None;
        }
        let mut faces = self.faces.like();
        faces.extend(parts)?;
        Some(Whole { vertices, faces, has_more, left_out })
    }
}

/// What `read` makes of all blocks, on all cores; `None` where there is none of one of them.
fn read_all<V: Values, T: Send>(blocks: Vec<Block<V>>, read: impl Fn(Block<V>) -> Option<T> + Sync) -> Option<Vec<T>> {
    parallel::map(blocks.into_iter(), read).into_iter().collect()
}

/// Steps over the rows of `element`.
fn blocks<V: Values>(values: &mut V, element: &ElementDef) -> Option<Vec<Block<V>>> {
    let mut blocks = Vec::new();
    if element.properties.is_empty() {
        return Some(blocks); // its rows take no bytes: a header can promise any number of them
    }
    let mut left = element.count;
    while left > 0 {
        let rows = left.min(BLOCK_ROWS);
        blocks.push((values.clone(), rows));
        values.skip_rows(&element.properties, rows)?;
        left -= rows;
    }
    Some(blocks)
}

/// Reads over a block, and tells whether a line had something beside its row.
fn read_over<V: Values>(properties: &[PlyProperty], (mut values, rows): Block<V>) -> Option<bool> {
    let mut left_out = false;
    for _ in 0..rows {
        values.begin_row();
        for property in properties {
            skip(&mut values, property)?;
        }
        left_out |= !values.end_row();
    }
    Some(left_out)
}

/// Reads a block into `vertices`, and tells whether a line had something beside its row.
fn read_vertices<V: Values>(
    mut vertices: Vertices,
    properties: &[PlyProperty],
    (mut values, rows): Block<V>,
) -> Option<(Vertices, bool)> {
    let mut left_out = false;
    for _ in 0..rows {
        values.begin_row();
        for (number, property) in properties.iter().enumerate() {
            match property.property_type {
                PropertyType::Scalar(kind) => vertices.set(number, values.number(kind)?),
                PropertyType::List { .. } => skip(&mut values, property)?,
            }
        }
        left_out |= !values.end_row();
        vertices.push();
    }
    Some((vertices, left_out))
}

/// Reads a block of faces between `vertices`.
fn read_faces<V: Values>(
    mut faces: Faces,
    vertices: &Vertices,
    properties: &[PlyProperty],
    (mut values, rows): Block<V>,
) -> Option<(Faces, bool)> {
    let mut left_out = false;
    faces.triangles.reserve(rows); // most faces are triangles
    for _ in 0..rows {
        values.begin_row();
        for (number, property) in properties.iter().enumerate() {
            if !faces.take(number, property, &mut values, vertices)? {
                skip(&mut values, property)?;
            }
        }
        left_out |= !values.end_row();
        faces.end_face(vertices).ok()?;
    }
    Some((faces, left_out))
}

/// Reads over a property that is not used, which must be right all the same.
fn skip<V: Values>(values: &mut V, property: &PlyProperty) -> Option<()> {
    match property.property_type {
        PropertyType::Scalar(kind) => values.number(kind).map(|_| ()),
        PropertyType::List { count_type, data_type } => {
            for _ in 0..values.count(count_type)? {
                values.number(data_type)?;
            }
            Some(())
        }
    }
}
