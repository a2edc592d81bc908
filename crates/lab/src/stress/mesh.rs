//! Meshes that the generators of hard cases are made of.

use glam::{DVec3, Vec3};
use raybrook::low_level::random::Random;
use raybrook::low_level::scene::{Material, NO_INDEX, Scene, Triangle};
use raybrook::{Error, Result};
use std::collections::HashMap;
use std::fmt::Write;

/// Triangles that share vertices. Vertices may be NaN or infinite, triangles without area.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Three numbers of vertices each.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A scene's triangles with their numbers; those that cannot be hit have corners that are no numbers.
    pub fn of_scene(scene: &Scene) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..scene.triangle_count() {
            let can_be_hit = scene.drop_reason(i).is_none();
            mesh.triangle(if can_be_hit { scene.vertices(i) } else { [Vec3::NAN; 3] });
        }
        mesh
    }

    /// The corners of a triangle.
    pub fn corners(&self, primitive: usize) -> [Vec3; 3] {
        self.triangles[primitive].map(|i| self.positions[i as usize])
    }

    /// Adds a vertex and tells its number.
    pub fn vertex(&mut self, position: Vec3) -> u32 {
        self.positions.push(position);
        (self.positions.len() - 1) as u32
    }

    /// Adds a triangle with vertices of its own.
    pub fn triangle(&mut self, corners: [Vec3; 3]) {
        let corners = corners.map(|p| self.vertex(p));
        self.triangles.push(corners);
    }

    /// Adds two triangles with vertices of their own; the corners go round.
    pub fn quad(&mut self, corners: [Vec3; 4]) {
        let [a, b, c, d] = corners.map(|p| self.vertex(p));
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }

    /// Adds another mesh.
    pub fn append(&mut self, other: &Mesh) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|i| i + first)));
    }

    /// The mesh with other positions.
    #[must_use]
    pub fn mapped(mut self, map: impl FnMut(Vec3) -> Vec3) -> Mesh {
        self.positions = self.positions.into_iter().map(map).collect();
        self
    }

    /// The mesh with its triangles in a random order, each turned to begin with a random corner.
    #[must_use]
    pub fn shuffled(mut self, random: &mut Random) -> Mesh {
        for i in (1..self.triangles.len()).rev() {
            self.triangles.swap(i, random.below(i + 1));
        }
        for triangle in &mut self.triangles {
            triangle.rotate_left(random.below(3));
        }
        self
    }

    /// With the back of every triangle as its front.
    #[must_use]
    pub fn turned_around(mut self) -> Mesh {
        self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        self
    }

    // ---- shapes
    // ------------------------------------------------------------------------------------------------------

    /// A closed unit sphere of 8 * 4^`levels` triangles: an octahedron whose triangles are divided.
    pub fn sphere(levels: u32) -> Mesh {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        let mut mesh = Mesh { positions: axes.collect(), triangles: Vec::new() };
        for octant in 0..8u32 {
            let [x, y, z] = [octant & 1, 2 + (octant >> 1 & 1), 4 + (octant >> 2)];
            let is_mirrored = octant.count_ones() % 2 == 1;
            mesh.triangles.push(if is_mirrored { [x, z, y] } else { [x, y, z] });
        }
        for _ in 0..levels {
            let mut middles = HashMap::new();
            for [a, b, c] in std::mem::take(&mut mesh.triangles) {
                let mut middle = |i: u32, k: u32| {
                    *middles.entry((i.min(k), i.max(k))).or_insert_with(|| {
                        let sum: DVec3 = [i, k].map(|i| mesh.positions[i as usize].as_dvec3()).into_iter().sum();
                        mesh.positions.push((sum / sum.length()).as_vec3());
                        (mesh.positions.len() - 1) as u32
                    })
                };
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                mesh.triangles.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
            }
        }
        mesh
    }

    /// A sheet of `n` x `n` squares over 0..`n` in x and y, each of two triangles; `height` gives z at a corner.
    pub fn sheet(n: usize, mut height: impl FnMut(usize, usize) -> f32) -> Mesh {
        let mut mesh = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                mesh.vertex(Vec3::new(x as f32, y as f32, height(x, y)));
            }
        }
        let at = |x: usize, y: usize| (y * (n + 1) + x) as u32;
        for y in 0..n {
            for x in 0..n {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                mesh.triangles.extend(if (x + y) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
            }
        }
        mesh
    }

    /// A closed box.
    pub fn cube(low: Vec3, high: Vec3) -> Mesh {
        let corner = |i: u32| {
            let choose = |bit: u32, k: usize| if i >> bit & 1 == 1 { high[k] } else { low[k] };
            Vec3::new(choose(0, 0), choose(1, 1), choose(2, 2))
        };
        let mut mesh = Mesh { positions: (0..8).map(corner).collect(), triangles: Vec::new() };
        for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        mesh
    }

    /// `n`^3 unit boxes, one unit apart, from the origin on.
    pub fn cubes(n: i32) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..n * n * n {
            let low = 2.0 * Vec3::new((i % n) as f32, (i / n % n) as f32, (i / (n * n)) as f32);
            mesh.append(&Mesh::cube(low, low + 1.0));
        }
        mesh
    }

    /// `count` triangles of about `size` in the cube -1..1.
    pub fn soup(count: usize, size: f32, random: &mut Random) -> Mesh {
        let mut mesh = Mesh::default();
        for _ in 0..count {
            let center = random.vec3();
            mesh.triangle([(); 3].map(|()| center + random.vec3() * size));
        }
        mesh
    }

    /// A ring of 2^`bits` points of radius 1 around the z axis, and triangles from each of its edges to two hubs at
    /// -`height` and `height`, the first two vertices: closed.
    pub fn double_fan(bits: u32, height: f32) -> Mesh {
        // By bisection, because a square root is the same everywhere, and a library's sine is not.
        let mut ring = vec![DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y];
        for _ in 2..bits {
            let next = ring.iter().cycle().skip(1);
            ring = ring.iter().zip(next).flat_map(|(&a, &b)| [a, (a + b) / (a + b).length()]).collect();
        }
        let mut mesh = Mesh { positions: vec![Vec3::Z * -height, Vec3::Z * height], triangles: Vec::new() };
        mesh.positions.extend(ring.iter().map(|p| p.as_vec3()));
        let count = ring.len() as u32;
        for i in 0..count {
            let (a, b) = (2 + i, 2 + (i + 1) % count);
            mesh.triangles.extend([[1, a, b], [0, b, a]]);
        }
        mesh
    }

    // ---- places on a mesh
    // --------------------------------------------------------------------------------------------

    /// A vertex of a random triangle.
    pub fn random_vertex(&self, random: &mut Random) -> Vec3 {
        self.corners(random.below(self.triangles.len()))[random.below(3)]
    }

    /// A point of a random edge, rounded; its middle one time in four.
    pub fn random_edge_point(&self, random: &mut Random) -> Vec3 {
        let corners = self.corners(random.below(self.triangles.len()));
        let k = random.below(3);
        let weight = if random.below(4) == 0 { 0.5 } else { random.unit() };
        corners[k].lerp(corners[(k + 1) % 3], weight)
    }

    /// A vertex or a point of an edge.
    pub fn random_seam(&self, random: &mut Random) -> Vec3 {
        if random.below(3) == 0 { self.random_vertex(random) } else { self.random_edge_point(random) }
    }

    /// A point inside of a random triangle, rounded.
    pub fn random_inside(&self, random: &mut Random) -> Vec3 {
        inside_of(self.corners(random.below(self.triangles.len())), random)
    }

    // ---- other forms
    // -------------------------------------------------------------------------------------------------

    /// As a scene.
    pub fn scene(&self) -> Scene {
        let triangle = |&positions| Triangle { positions, normals: [NO_INDEX; 3], uvs: [NO_INDEX; 3], material: 0 };
        Scene {
            positions: self.positions.clone(),
            triangles: self.triangles.iter().map(triangle).collect(),
            materials: vec![Material::default()],
            ..Scene::default()
        }
    }

    /// As the text of a Wavefront OBJ file that reads back to the bit.
    pub fn to_obj(&self) -> String {
        let mut text = String::new();
        for p in &self.positions {
            // The shortest number that reads back as the same float. Writing to a string cannot fail.
            let _ = writeln!(text, "v {:e} {:e} {:e}", p.x, p.y, p.z);
        }
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|i| i + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        text
    }
}

impl TryFrom<&Scene> for Mesh {
    type Error = Error;

    /// # Errors
    /// As [`Scene::flattened`].
    fn try_from(scene: &Scene) -> Result<Mesh> {
        let flat = scene.flattened()?;
        let triangles = flat.triangles.iter().map(|triangle| triangle.positions).collect();
        Ok(Mesh { positions: flat.positions.clone(), triangles })
    }
}

/// A point inside of a triangle, rounded.
pub fn inside_of([a, b, c]: [Vec3; 3], random: &mut Random) -> Vec3 {
    let (u, v) = (random.unit(), random.unit());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    a + (b - a) * u + (c - a) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_meshes_are_closed() {
        let meshes = [Mesh::sphere(0), Mesh::sphere(3), Mesh::cube(Vec3::ZERO, Vec3::ONE), Mesh::double_fan(6, 0.5)];
        for mesh in meshes {
            let mut edges: Vec<_> = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
            edges.sort();
            let count = edges.len();
            edges.dedup();
            assert_eq!(edges.len(), count, "every edge is run along once in each direction");
            assert!(edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok()), "and has two triangles");
            let volume: f32 =
                (0..mesh.triangles.len()).map(|i| mesh.corners(i)).map(|[a, b, c]| a.dot(b.cross(c))).sum();
            assert!(volume > 0.5, "counter-clockwise from outside: {volume}");
        }
    }

    #[test]
    fn a_written_mesh_reads_back_to_the_bit() {
        let mut mesh = Mesh::soup(50, 0.1, &mut Random::new(1));
        mesh.triangle([Vec3::new(-0.0, 1e-45, 3e38), Vec3::NAN, Vec3::new(f32::INFINITY, f32::NEG_INFINITY, 1e-20)]);
        mesh.triangles.push([0, 0, 1]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.obj");
        std::fs::write(&path, mesh.to_obj()).unwrap();
        let read = Mesh::try_from(&raybrook::low_level::scene::load(&path).unwrap()).unwrap();
        let bits = |mesh: &Mesh| -> Vec<u32> {
            let corners = (0..mesh.triangles.len()).flat_map(|i| mesh.corners(i));
            corners.flat_map(|p| p.to_array()).map(|x| if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() }).collect()
        };
        assert_eq!(bits(&read), bits(&mesh));
    }
}
