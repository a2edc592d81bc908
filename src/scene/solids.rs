//! Solids, broken into triangles of chosen fineness (thesis, section 6.2.1).
//!
//! The y axis is up and the axis of everything round. Triangles are counter-clockwise seen from outside. Solids that
//! have an inside are closed: each edge belongs to two triangles that share its two positions, also along the seam of
//! the texture. Round surfaces have the smooth normals of the ideal solid, flat ones none (the geometric normal
//! serves). They are inscribed: their vertices lie on the ideal surface, so that a coarse solid is smaller than its
//! ideal.

use super::NO_INDEX;
use super::builder::Builder;
use super::mesh::{Corner, Counts, Mesh, sin_cos_degrees};
use glam::{DVec3, Vec3};

/// The most segments that a solid is broken into along one direction: a sphere then has 16.8 million triangles, and a
/// slip of the keyboard does not fill the memory.
pub const MAX_SEGMENTS: u32 = 4096;

/// Segments around a solid of a file that does not tell: at this many a sphere of 500 pixels shows no corners.
pub(super) const DEFAULT_SEGMENTS: u32 = 64;

/// The axes of a box's faces as (normal, u, v) with u x v = normal; u runs to the right and v upwards seen from
/// outside.
const BOX_FACES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::NEG_Z, DVec3::Y],
    [DVec3::NEG_X, DVec3::Z, DVec3::Y],
    [DVec3::Y, DVec3::X, DVec3::NEG_Z],
    [DVec3::NEG_Y, DVec3::X, DVec3::Z],
    [DVec3::Z, DVec3::X, DVec3::Y],
    [DVec3::NEG_Z, DVec3::NEG_X, DVec3::Y],
];

/// Point `i` of `n` on the unit circle around y: from +z towards +x, so that u runs to the right seen from outside.
fn around(i: u32, n: u32) -> DVec3 {
    let (sin, cos) = sin_cos_degrees(360.0 * f64::from(i % n) / f64::from(n));
    DVec3::new(sin, 0.0, cos)
}

impl Builder {
    /// A sphere around the origin: `segments` around (3 or more), half as many from pole to pole, 2 `segments`
    /// (`segments`/2 - 1) triangles. u runs around from +z over +x, v from the south pole to the north pole.
    pub fn sphere(&mut self, radius: f32, segments: u32) -> &mut Self {
        if !(self.positive("sphere: radius", radius) & self.fine("sphere: segments", segments, 3)) {
            return self;
        }
        let (radius, rings) = (f64::from(radius), (segments / 2).max(2));
        // Each corner of a quadrilateral has texture coordinates of its own.
        let counts = Counts::of_grid(segments, rings, true);
        if !self.has_room("the sphere", Counts { uvs: 2 * counts.triangles, ..counts }) {
            return self;
        }
        let mut mesh = Mesh::default();
        let direction = |i: u32, j: u32| {
            let (sin, cos) = sin_cos_degrees(180.0 * f64::from(j) / f64::from(rings));
            around(i, segments) * sin - DVec3::Y * cos
        };
        let add_point =
            |mesh: &mut Mesh, direction: DVec3| (mesh.add_position(direction * radius), mesh.add_normal(direction));
        let south = add_point(&mut mesh, DVec3::NEG_Y);
        let north = add_point(&mut mesh, DVec3::Y);
        let points: Vec<_> = (1..rings)
            .flat_map(|j| (0..segments).map(move |i| (i, j)))
            .map(|(i, j)| add_point(&mut mesh, direction(i, j)))
            .collect();
        let corner = |mesh: &mut Mesh, i: u32, j: u32, u: f64| {
            let (position, normal) = match j {
                0 => south,
                _ if j == rings => north,
                _ => points[((j - 1) * segments + i % segments) as usize],
            };
            Corner { position, normal, uv: mesh.add_uv(u / f64::from(segments), f64::from(j) / f64::from(rings)) }
        };
        for j in 0..rings {
            for i in 0..segments {
                let (left, right) = (f64::from(i), f64::from(i + 1));
                // A pole is one position with as many texture coordinates as there are triangles, each in its
                // triangle's middle.
                let [u0, u1] = if j == 0 { [left + 0.5; 2] } else { [left, right] };
                let [u2, u3] = if j + 1 == rings { [left + 0.5; 2] } else { [right, left] };
                let bottom_left = corner(&mut mesh, i, j, u0);
                let top_right = corner(&mut mesh, i + 1, j + 1, u2);
                if j > 0 {
                    let bottom_right = corner(&mut mesh, i + 1, j, u1);
                    mesh.triangles.push([bottom_left, bottom_right, top_right]);
                }
                if j + 1 < rings {
                    let top_left = corner(&mut mesh, i, j + 1, u3);
                    mesh.triangles.push([bottom_left, top_right, top_left]);
                }
            }
        }
        self.add_mesh(&mesh)
    }

    /// A box of the given size (all above 0) around the origin, 12 triangles. Every face has the whole texture, upright
    /// on the sides.
    pub fn cuboid(&mut self, size: Vec3) -> &mut Self {
        if !(self.positive("box: size", size.x)
            & self.positive("box: size", size.y)
            & self.positive("box: size", size.z))
        {
            return self;
        }
        let mut mesh = Mesh::default();
        let half = size.as_dvec3() / 2.0;
        for i in 0..8u32 {
            let side = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            mesh.add_position(DVec3::new(side(0), side(1), side(2)) * half);
        }
        let uvs = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| mesh.add_uv(u, v));
        for [normal, u, v] in BOX_FACES {
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(s, t)| normal + u * s + v * t);
            let indices = corners.map(|c| u32::from(c.x > 0.0) | u32::from(c.y > 0.0) << 1 | u32::from(c.z > 0.0) << 2);
            mesh.add_quad([0, 1, 2, 3].map(|k| Corner { position: indices[k], normal: NO_INDEX, uv: uvs[k] }));
        }
        self.add_mesh(&mesh)
    }

    /// A closed cylinder that stands on the origin, its axis y: 4 `segments` triangles.
    pub fn cylinder(&mut self, radius: f32, height: f32, segments: u32) -> &mut Self {
        self.frustum(radius, radius, height, segments, true)
    }

    /// A closed cone that stands on the origin, its tip at (0, `height`, 0): 2 `segments` triangles.
    pub fn cone(&mut self, radius: f32, height: f32, segments: u32) -> &mut Self {
        self.frustum(radius, 0.0, height, segments, true)
    }

    /// A cylinder or cone, whole or cut off, that stands on the origin: one of the radii may be 0. With `caps` it is
    /// closed. The side has the texture once around it; a cap has the disc that fits into the texture.
    pub fn frustum(
        &mut self,
        bottom_radius: f32,
        top_radius: f32,
        height: f32,
        segments: u32,
        caps: bool,
    ) -> &mut Self {
        let radii_fit = self.not_negative("cylinder or cone: radius", bottom_radius)
            & self.not_negative("cylinder or cone: radius", top_radius)
            & self.positive("cylinder or cone: the larger radius", bottom_radius.max(top_radius));
        if !(radii_fit
            & self.positive("cylinder or cone: height", height)
            & self.fine("cylinder or cone: segments", segments, 3))
        {
            return self;
        }
        let (bottom, top, height) = (f64::from(bottom_radius), f64::from(top_radius), f64::from(height));
        let mut mesh = Mesh::default();
        let mut ring = |radius: f64, y: f64| -> Vec<u32> {
            let points = if radius == 0.0 { 1 } else { segments };
            let first = mesh.positions.len() as u32;
            (0..points).for_each(|i| _ = mesh.add_position(around(i, segments) * radius + DVec3::Y * y));
            (0..segments).map(|i| first + i % points).collect()
        };
        let (low, high) = (ring(bottom, 0.0), ring(top, height));
        add_side(&mut mesh, &low, &high, bottom - top, height);
        if caps && bottom > 0.0 {
            add_cap(&mut mesh, &low, 0.0, false);
        }
        if caps && top > 0.0 {
            add_cap(&mut mesh, &high, height, true);
        }
        self.add_mesh(&mesh)
    }

    /// A flat disc around the origin that faces +y, or a ring when `inner_radius` is above 0; `segments` triangles,
    /// twice as many for a ring. The texture lies on it as on the square around it.
    pub fn disc(&mut self, inner_radius: f32, radius: f32, segments: u32) -> &mut Self {
        if !(self.not_negative("disc: inner radius", inner_radius)
            & self.positive("disc: radius", radius)
            & self.fine("disc: segments", segments, 3))
        {
            return self;
        }
        if inner_radius >= radius {
            return self.fail(format!("disc: the inner radius {inner_radius} leaves nothing of radius {radius}"));
        }
        let mut mesh = Mesh::default();
        let mut ring = |radius: f64| -> Vec<u32> {
            (0..segments).map(|i| mesh.add_position(around(i, segments) * radius)).collect()
        };
        let outer = ring(f64::from(radius));
        if inner_radius == 0.0 {
            add_cap(&mut mesh, &outer, 0.0, true);
            return self.add_mesh(&mesh);
        }
        let inner = ring(f64::from(inner_radius));
        let share = 0.5 * f64::from(inner_radius) / f64::from(radius);
        for i in 0..segments {
            let next = ((i + 1) % segments) as usize;
            let corners = [
                (inner[i as usize], i, share),
                (outer[i as usize], i, 0.5),
                (outer[next], i + 1, 0.5),
                (inner[next], i + 1, share),
            ];
            let quad = corners.map(|(position, i, size)| {
                let p = around(i, segments) * size;
                Corner { position, normal: NO_INDEX, uv: mesh.add_uv(0.5 + p.x, 0.5 - p.z) }
            });
            mesh.add_quad(quad);
        }
        self.add_mesh(&mesh)
    }

    /// The flat parallelogram `origin` + a `edge_u` + b `edge_v` (a, b in 0..1) in `segments`² x 2 triangles; its
    /// outside is where `edge_u` x `edge_v` points, its texture coordinates are (a, b).
    pub fn quad(&mut self, origin: Vec3, edge_u: Vec3, edge_v: Vec3, segments: u32) -> &mut Self {
        if !self.fine("quad: segments", segments, 1) {
            return self;
        }
        let (origin, u, v) = (origin.as_dvec3(), edge_u.as_dvec3(), edge_v.as_dvec3());
        if !(origin.is_finite() && u.cross(v).is_finite() && u.cross(v) != DVec3::ZERO) {
            return self.fail("quad: its edges are parallel, zero or not finite");
        }
        if !self.has_room("the quad", Counts::of_grid(segments, segments, false)) {
            return self;
        }
        let mut mesh = Mesh::default();
        let share = |i: u32| f64::from(i) / f64::from(segments);
        mesh.add_grid(segments, segments, [false; 2], |i, j| (origin + u * share(i) + v * share(j), None));
        self.add_mesh(&mesh)
    }

    /// A ring torus around the y axis: the middle of its tube, of radius `minor_radius`, is `major_radius` away from
    /// the axis. `segments` around the axis times `sides` around the tube times 2 triangles.
    pub fn torus(&mut self, major_radius: f32, minor_radius: f32, segments: u32, sides: u32) -> &mut Self {
        let radii_fit =
            self.positive("torus: major radius", major_radius) & self.positive("torus: minor radius", minor_radius);
        if !(radii_fit & self.fine("torus: segments", segments, 3) & self.fine("torus: sides", sides, 3)) {
            return self;
        }
        if minor_radius >= major_radius {
            return self
                .fail(format!("torus: the minor radius {minor_radius} is not below the major radius {major_radius}"));
        }
        if !self.has_room("the torus", Counts::of_grid(segments, sides, true)) {
            return self;
        }
        let (major, minor) = (f64::from(major_radius), f64::from(minor_radius));
        let mut mesh = Mesh::default();
        mesh.add_grid(segments, sides, [true; 2], |i, j| {
            let (sin, cos) = sin_cos_degrees(360.0 * f64::from(j) / f64::from(sides));
            let normal = around(i, segments) * cos + DVec3::Y * sin;
            (around(i, segments) * major + normal * minor, Some(normal))
        });
        self.add_mesh(&mesh)
    }

    /// The surface y = `height(x, z)` over the square -1/2..1/2 in x and z, seen from above, with smooth normals:
    /// `columns` along x times `rows` along z times 2 triangles. u runs along x and v against z. Not closed; scale it
    /// to the size it should have.
    pub fn height_field(&mut self, columns: u32, rows: u32, height: impl Fn(f32, f32) -> f32) -> &mut Self {
        if !(self.fine("height field: columns", columns, 1) & self.fine("height field: rows", rows, 1)) {
            return self;
        }
        if !self.has_room("the height field", Counts::of_grid(columns, rows, true)) {
            return self;
        }
        let mut mesh = Mesh::default();
        let share = |i: u32, n: u32| f64::from(i) / f64::from(n) - 0.5;
        mesh.add_grid(columns, rows, [false; 2], |i, j| {
            let (x, z) = (share(i, columns), -share(j, rows));
            (DVec3::new(x, f64::from(height(x as f32, z as f32)), z), None)
        });
        if let Some(p) = mesh.positions.iter().find(|p| !p.is_finite()) {
            return self.fail(format!("height field: the height at x = {}, z = {} is not finite", p.x, p.z));
        }
        mesh.smooth();
        self.add_mesh(&mesh)
    }

    fn positive(&mut self, what: &str, value: f32) -> bool {
        self.require(value > 0.0 && value.is_finite(), || format!("{what} is {value}; it must be above 0 and finite"))
    }

    fn not_negative(&mut self, what: &str, value: f32) -> bool {
        self.require(value >= 0.0 && value.is_finite(), || {
            format!("{what} is {value}; it must be finite and not negative")
        })
    }

    fn fine(&mut self, what: &str, count: u32, least: u32) -> bool {
        self.require((least..=MAX_SEGMENTS).contains(&count), || {
            format!("{what} is {count}; it must lie between {least} and {MAX_SEGMENTS}")
        })
    }

    fn require(&mut self, holds: bool, fault: impl FnOnce() -> String) -> bool {
        if !holds {
            self.fail(fault());
        }
        holds
    }
}

/// Adds the side between two rings of positions, the radius shrinking by `shrink` over `height`. A ring of radius 0
/// holds the same position at every index: its triangles, of which one edge has no length, are left out.
fn add_side(mesh: &mut Mesh, low: &[u32], high: &[u32], shrink: f64, height: f64) {
    let n = low.len() as u32;
    let has_no_radius = |ring: &[u32]| ring[0] == ring[1];
    let normal = |degrees: f64| {
        let (sin, cos) = sin_cos_degrees(degrees);
        (DVec3::new(sin, 0.0, cos) * height + DVec3::Y * shrink).normalize()
    };
    for i in 0..n {
        let (here, next) = (i as usize, ((i + 1) % n) as usize);
        let corner = |mesh: &mut Mesh, ring: &[u32], index: usize, side: f64, v: f64| {
            // The tip has a normal for each of its triangles, that of the triangle's middle.
            let at = f64::from(i) + if has_no_radius(ring) { 0.5 } else { side };
            let normal = mesh.add_normal(normal(360.0 * at / f64::from(n)));
            Corner { position: ring[index], normal, uv: mesh.add_uv(at / f64::from(n), v) }
        };
        let bottom_left = corner(mesh, low, here, 0.0, 0.0);
        let top_right = corner(mesh, high, next, 1.0, 1.0);
        if !has_no_radius(low) {
            let bottom_right = corner(mesh, low, next, 1.0, 0.0);
            mesh.triangles.push([bottom_left, bottom_right, top_right]);
        }
        if !has_no_radius(high) {
            let top_left = corner(mesh, high, here, 0.0, 1.0);
            mesh.triangles.push([bottom_left, top_right, top_left]);
        }
    }
}

/// Adds a flat fan from a new position on the axis to the positions `ring`, facing up or down.
fn add_cap(mesh: &mut Mesh, ring: &[u32], y: f64, faces_up: bool) {
    let n = ring.len() as u32;
    let position = mesh.add_position(DVec3::Y * y);
    let middle = Corner { position, normal: NO_INDEX, uv: mesh.add_uv(0.5, 0.5) };
    let first_uv = mesh.uvs.len() as u32;
    for i in 0..n {
        let p = around(i, n) * 0.5;
        mesh.add_uv(0.5 + p.x, if faces_up { 0.5 - p.z } else { 0.5 + p.z });
    }
    let corner = |i: u32| Corner { position: ring[(i % n) as usize], normal: NO_INDEX, uv: first_uv + i % n };
    for i in 0..n {
        let (here, next) = (corner(i), corner(i + 1));
        mesh.triangles.push(if faces_up { [middle, here, next] } else { [middle, next, here] });
    }
}
