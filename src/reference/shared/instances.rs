//! Twin of `cl/shared/instances.cl`: triangles of objects, placed when they are read. The reasons are there.

use super::math::unit_normals;
use crate::fma::with_fma;
use crate::layout::Float4;
use crate::pack::SceneBuffers;
use crate::scene::{row_times_direction, row_times_point};
use crate::shared::{INSTANCE_BLUR, INSTANCE_NORMALS, INSTANCE_RECORDS, INSTANCE_TO_WORLD, NO_MATERIAL, Shading};
use glam::Vec3;

/// The records of instance `instance`.
#[inline(always)]
pub fn instance_records(buffers: &SceneBuffers, instance: u32) -> &[Float4] {
    let records = INSTANCE_RECORDS as usize;
    &buffers.bounds[instance as usize * records..][..records]
}

/// The number in w of a record.
#[inline(always)]
fn number(records: &[Float4], record: u32) -> u32 {
    records[record as usize].w.to_bits()
}

/// What takes a triangle's place in the arrays to its number in the scene.
#[inline(always)]
pub fn to_primitive(records: &[Float4]) -> u32 {
    number(records, INSTANCE_NORMALS + 2).wrapping_neg()
}

/// The records of the instance that has a triangle, and the triangle's place in the arrays.
fn placed_at(buffers: &SceneBuffers, primitive: u32) -> (&[Float4], usize) {
    let (mut low, mut high) = (0, buffers.params.reference_count);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if number(instance_records(buffers, middle), INSTANCE_NORMALS) <= primitive {
            low = middle;
        } else {
            high = middle;
        }
    }
    let records = instance_records(buffers, low);
    (records, primitive.wrapping_add(number(records, INSTANCE_NORMALS + 2)) as usize)
}

#[inline(always)]
fn point_in_row(row: Float4, p: Vec3) -> f32 {
    row_times_point([row.x, row.y, row.z, row.w], p)
}

#[inline(always)]
fn direction_in_row(row: Float4, d: Vec3) -> f32 {
    row_times_direction([row.x, row.y, row.z], d)
}

/// Three rows of a transform, applied to a point.
#[inline(always)]
pub fn transform_point(rows: &[Float4], p: Vec3) -> Vec3 {
    let [a, b, c] = [rows[0], rows[1], rows[2]];
    Vec3::new(point_in_row(a, p), point_in_row(b, p), point_in_row(c, p))
}

/// The same without the summands.
#[inline(always)]
pub fn transform_direction(rows: &[Float4], d: Vec3) -> Vec3 {
    let [a, b, c] = [rows[0], rows[1], rows[2]];
    Vec3::new(direction_in_row(a, d), direction_in_row(b, d), direction_in_row(c, d))
}

/// A vertex of an object, placed.
#[inline(always)]
fn placed(buffers: &SceneBuffers, rows: &[Float4], vertex: usize) -> Vec3 {
    // No coordinate is a negative zero: the sum of one and zero is not.
    transform_point(rows, buffers.vertices[vertex].xyz()) * buffers.params.scale + 0.0
}

with_fma! {
    /// The vertices of a triangle, tracing space.
    pub fn placed_vertices(buffers: &SceneBuffers, primitive: u32) -> [Vec3; 3] {
        let (records, place) = placed_at(buffers, primitive);
        let (rows, first) = (&records[INSTANCE_TO_WORLD as usize..], 3 * place);
        [placed(buffers, rows, first), placed(buffers, rows, first + 1), placed(buffers, rows, first + 2)]
    }
}

/// The shading data of a triangle.
pub fn placed_shading(buffers: &SceneBuffers, primitive: u32) -> Shading {
    let (records, place) = placed_at(buffers, primitive);
    let mut at = buffers.shading[place];
    let rows = &records[INSTANCE_NORMALS as usize..];
    let raw = [at.normal0_u0.xyz(), at.normal1_u1.xyz(), at.normal2_u2.xyz()];
    let [n0, n1, n2] = unit_normals(raw.map(|n| transform_direction(rows, n)));
    at.normal0_u0 = Float4::new(n0, at.normal0_u0.w);
    at.normal1_u1 = Float4::new(n1, at.normal1_u1.w);
    at.normal2_u2 = Float4::new(n2, at.normal2_u2.w);
    let material = number(records, INSTANCE_BLUR);
    if material != NO_MATERIAL {
        at.material = material;
    }
    at
}
