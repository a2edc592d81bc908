//! Meshes in object coordinates: what solids are made of before the builder's transform puts them into the scene.
//!
//! Positions, normals and texture coordinates have their own indices, so that a seam of the texture or a crease of the
//! shading does not tear the surface: neighbours share their positions, and the mesh stays closed.
//! Everything is in f64; the builder rounds each vertex once.

use super::{NO_INDEX, Triangle};
use glam::{DMat3, DVec3, Vec2, Vec3};

/// One corner of a triangle: indices into the mesh's arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corner {
    pub position: u32,
    /// Or [`NO_INDEX`]: the geometric normal.
    pub normal: u32,
    /// Or [`NO_INDEX`]: (0, 0).
    pub uv: u32,
}

/// Triangles in object coordinates, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default)]
pub(super) struct Mesh {
    pub positions: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[Corner; 3]>,
}

/// How large a mesh will be.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub positions: u64,
    pub normals: u64,
    pub uvs: u64,
    pub triangles: u64,
    /// What is needed beside.
    pub more_bytes: u64,
}

impl Counts {
    /// Those of [`Mesh::add_grid`].
    pub fn of_grid(columns: u32, rows: u32, has_normals: bool) -> Counts {
        let (columns, rows) = (u64::from(columns), u64::from(rows));
        let points = (columns + 1) * (rows + 1);
        let more_bytes = points * size_of::<(u32, u32)>() as u64;
        Counts {
            positions: points,
            normals: if has_normals { points } else { 0 },
            uvs: points,
            triangles: 2 * columns * rows,
            more_bytes,
        }
    }

    pub fn and_bytes(self, bytes: u64) -> Counts {
        Counts { more_bytes: self.more_bytes + bytes, ..self }
    }

    /// Bytes of the mesh, and of its copy in a scene.
    pub fn bytes(&self) -> u64 {
        const VECTOR: u64 = (size_of::<DVec3>() + size_of::<Vec3>()) as u64;
        const UV: u64 = 2 * size_of::<Vec2>() as u64;
        const TRIANGLE: u64 = (size_of::<[Corner; 3]>() + size_of::<Triangle>()) as u64;
        VECTOR * (self.positions + self.normals) + UV * self.uvs + TRIANGLE * self.triangles + self.more_bytes
    }
}

impl Mesh {
    pub fn add_position(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        (self.positions.len() - 1) as u32
    }

    pub fn add_normal(&mut self, normal: DVec3) -> u32 {
        self.normals.push(normal);
        (self.normals.len() - 1) as u32
    }

    pub fn add_uv(&mut self, u: f64, v: f64) -> u32 {
        self.uvs.push(Vec2::new(u as f32, v as f32));
        (self.uvs.len() - 1) as u32
    }

    /// Adds the convex quadrilateral a, b, c, d as the triangles a, b, c and a, c, d.
    pub fn add_quad(&mut self, [a, b, c, d]: [Corner; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Adds a grid of `columns` x `rows` quadrilaterals. `point(i, j)` gives the position of a grid point and its
    /// normal; the columns run along u and the rows along v, and the outside is where both turn counter-clockwise. A
    /// grid that `wraps` in columns or rows shares the last line of points with the first.
    pub fn add_grid(
        &mut self,
        columns: u32,
        rows: u32,
        wraps: [bool; 2],
        mut point: impl FnMut(u32, u32) -> (DVec3, Option<DVec3>),
    ) {
        let width = columns + u32::from(!wraps[0]);
        let height = rows + u32::from(!wraps[1]);
        let mut points = Vec::with_capacity(width as usize * height as usize);
        for j in 0..height {
            for i in 0..width {
                let (position, normal) = point(i, j);
                points.push((self.add_position(position), normal.map_or(NO_INDEX, |n| self.add_normal(n))));
            }
        }
        let first_uv = self.uvs.len() as u32;
        for j in 0..=rows {
            for i in 0..=columns {
                self.add_uv(f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows));
            }
        }
        let corner = |i: u32, j: u32| {
            let (position, normal) = points[(j % height) as usize * width as usize + (i % width) as usize];
            Corner { position, normal, uv: first_uv + j * (columns + 1) + i }
        };
        for j in 0..rows {
            for i in 0..columns {
                self.add_quad([corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]);
            }
        }
    }

    /// Gives every corner the smooth normal of its position: the mean of the triangles around it, each weighted by its
    /// angle there (Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets", JGT 1998), so that the
    /// result does not depend on how faces are split. A position without any proper triangle gets a zero normal: the
    /// geometric one.
    pub fn smooth(&mut self) {
        let mut normals = vec![DVec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let p = triangle.map(|c| self.positions[c.position as usize]);
            let face = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            for k in 0..3 {
                let (to_next, to_last) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                // atan2 instead of acos: exact for slivers too, and no division by a length of zero.
                let angle = to_next.cross(to_last).length().atan2(to_next.dot(to_last));
                normals[triangle[k].position as usize] += angle * face;
            }
        }
        self.normals = normals.into_iter().map(|n| n.normalize_or_zero()).collect();
        for corner in self.triangles.iter_mut().flatten() {
            corner.normal = corner.position;
        }
    }
}

/// The rotation about `axis`, of unit length, counter-clockwise seen against it, by Rodrigues' formula (1840) instead
/// of a quaternion: quarter turns about the coordinate axes are then exact.
pub(super) fn rotation(axis: DVec3, degrees: f64) -> DMat3 {
    let (sin, cos) = sin_cos_degrees(degrees);
    let DVec3 { x, y, z } = axis;
    let cross = DMat3::from_cols(DVec3::new(0.0, z, -y), DVec3::new(-z, 0.0, x), DVec3::new(y, -x, 0.0));
    let outer = DMat3::from_cols(axis * x, axis * y, axis * z);
    DMat3::IDENTITY * cos + cross * sin + outer * (1.0 - cos)
}

/// Sine and cosine of an angle in degrees; exact at the quarter turns, so that turned walls stay flat.
pub(super) fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    let turned = degrees.rem_euclid(360.0);
    if turned == 0.0 || turned == 360.0 {
        (0.0, 1.0)
    } else if turned == 90.0 {
        (1.0, 0.0)
    } else if turned == 180.0 {
        (0.0, -1.0)
    } else if turned == 270.0 {
        (-1.0, 0.0)
    } else {
        turned.to_radians().sin_cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        for (degrees, expected) in [(0.0, (0.0, 1.0)), (450.0, (1.0, 0.0)), (-180.0, (0.0, -1.0)), (270.0, (-1.0, 0.0))]
        {
            assert_eq!(sin_cos_degrees(degrees), expected, "{degrees} degrees");
        }
        let (s, c) = sin_cos_degrees(30.0);
        assert!((s - 0.5).abs() < 1e-15 && (c - 0.75f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn smooth_normals_do_not_depend_on_the_diagonal() {
        // The corner of a cube, its three faces split so that 1 or 2 triangles of a face meet there.
        let mut mesh = Mesh::default();
        let [o, x, y, z, xy, xz, yz] = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]]
            .map(|[a, b, c]| {
                let position = mesh.add_position(DVec3::new(f64::from(a), f64::from(b), f64::from(c)));
                Corner { position, normal: NO_INDEX, uv: NO_INDEX }
            });
        mesh.add_quad([o, y, xy, x]); // split through o: two triangles meet there
        mesh.add_quad([x, xz, z, o]); // split through x and z: one
        mesh.add_quad([o, z, yz, y]);
        mesh.smooth();
        let expected = DVec3::splat(-1.0 / 3.0f64.sqrt());
        assert!((mesh.normals[o.position as usize] - expected).length() < 1e-15, "{}", mesh.normals[0]);
    }
}
