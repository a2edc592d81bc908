//! Closed meshes, and rays at their edges and vertices that must hit: a billion of them need no exact answer each.
//!
//! [`ClosedMesh`] is a mesh in which every edge belongs to two triangles that run along it in opposite directions.
//! [`ClosedMesh::ray`] makes rays aimed at an edge or a vertex, as near as float32 can, each with a t by which it hits
//! something, which doubles with bounds of their errors have proved (`promise.rs`), or exact arithmetic where triangles
//! are as thin as a line, into which rays are aimed, too (`thin.rs`). [`find_leaks`] traces them and counts those that
//! come through.
//!
//! Bad at: rays that may miss. What passes a silhouette from outside, by a rounding, is left to the kinds of
//! [`super::Kind`].

mod aim;
mod inside;
mod promise;
mod run;
mod thin;

pub use aim::AimedRay;
pub use run::{Leaks, MAX_SUSPECTS, find_leaks};

use super::mesh::Mesh;
use glam::{DVec3, Vec3};
use inside::Ball;
use rayon::slice::ParallelSliceMut;
use std::collections::HashMap;
use std::fmt;
use thin::Thin;

/// A mesh with an inside, and what is needed to aim at its edges and vertices. Numbers of vertices here are those of
/// different positions; triangles with two equal corners, which are never hit, are left out.
pub struct ClosedMesh {
    mesh: Mesh,
    positions: Vec<DVec3>,
    edges: Vec<Edge>,
    /// `sides[first_side[i]..first_side[i + 1]]` are the sides opposite to vertex i of the triangles around it.
    first_side: Vec<u32>,
    sides: Vec<[u32; 2]>,
    /// The box around it.
    low: Vec3,
    high: Vec3,
    inside: Vec<Ball>,
    thin: Thin,
}

/// An edge and the third vertices of its triangles, of which the first one runs along it from `ends[0]` to `ends[1]`.
#[derive(Debug, Clone, Copy)]
struct Edge {
    ends: [u32; 2],
    opposite: [u32; 2],
}

/// Why a mesh is not closed. All zeros: it has no inside that float32 can tell from its surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct NotClosed {
    /// Edges of one triangle.
    pub open_edges: usize,
    /// Edges of more than two triangles.
    pub crowded_edges: usize,
    /// Edges of two triangles that both run along it in the same direction.
    pub turned_edges: usize,
    /// Triangles with a corner that is NaN or infinite.
    pub not_finite: usize,
}

impl fmt::Display for NotClosed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == NotClosed::default() {
            return write!(f, "not closed: it has no inside");
        }
        let counts = [
            (self.open_edges, "open edges"),
            (self.crowded_edges, "edges of more than two triangles"),
            (self.turned_edges, "edges whose triangles face opposite ways"),
            (self.not_finite, "triangles that are not finite"),
        ];
        let words: Vec<_> = counts.iter().filter(|c| c.0 > 0).map(|(count, what)| format!("{count} {what}")).collect();
        write!(f, "not closed: {}", words.join(", "))
    }
}

impl std::error::Error for NotClosed {}

/// A triangle's side, run along from `low` to `high` or back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    low: u32,
    high: u32,
    is_backward: bool,
    opposite: u32,
}

impl ClosedMesh {
    /// Welds equal positions and finds out what belongs together.
    ///
    /// # Errors
    /// [`NotClosed`] counts what is open.
    pub fn new(mesh: Mesh) -> Result<ClosedMesh, NotClosed> {
        let is_finite = |corners: &[u32; 3]| corners.iter().all(|&i| mesh.positions[i as usize].is_finite());
        let not_finite = mesh.triangles.iter().filter(|corners| !is_finite(corners)).count();
        let (positions, triangles) = weld(&mesh);
        let edges = match edges(&triangles) {
            Ok(edges) if not_finite == 0 => edges,
            Ok(_) => return Err(NotClosed { not_finite, ..NotClosed::default() }),
            Err(why) => return Err(NotClosed { not_finite, ..why }),
        };
        if positions.is_empty() {
            return Err(NotClosed::default());
        }
        let (first_side, sides) = sides_around(positions.len(), &triangles);
        let low = positions.iter().copied().reduce(DVec3::min).unwrap_or_default().as_vec3();
        let high = positions.iter().copied().reduce(DVec3::max).unwrap_or_default().as_vec3();
        let corners: Vec<_> = triangles.iter().map(|corners| corners.map(|i| positions[i as usize])).collect();
        let inside = inside::balls(&corners, low, high);
        if inside.is_empty() {
            return Err(NotClosed::default());
        }
        let thin = Thin::of(&triangles, &positions);
        Ok(ClosedMesh { mesh, positions, edges, first_side, sides, low, high, inside, thin })
    }

    /// The mesh as it was given.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// How many edges it has.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize]
    }

    /// The triangles around `vertex`, which is the first corner of each.
    fn fan(&self, vertex: u32) -> impl Iterator<Item = [DVec3; 3]> {
        let [first, end] = [vertex, vertex + 1].map(|i| self.first_side[i as usize] as usize);
        self.sides[first..end].iter().map(move |&[p, q]| [vertex, p, q].map(|i| self.position(i)))
    }
}

/// Different positions, and the triangles of three different ones.
fn weld(mesh: &Mesh) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    let mut numbers = HashMap::new();
    let mut number_of = |p: Vec3| {
        let key = p.to_array().map(|x| (x + 0.0).to_bits()); // -0 is 0
        *numbers.entry(key).or_insert_with(|| {
            positions.push(p.as_dvec3());
            (positions.len() - 1) as u32
        })
    };
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for i in 0..mesh.triangles.len() {
        let corners = mesh.corners(i);
        if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
            triangles.push(corners.map(&mut number_of));
        }
    }
    (positions, triangles)
}

/// Every edge with its two triangles.
fn edges(triangles: &[[u32; 3]]) -> Result<Vec<Edge>, NotClosed> {
    let side = |&[a, b, c]: &[u32; 3]| Side { low: a.min(b), high: a.max(b), is_backward: a > b, opposite: c };
    let mut sides: Vec<Side> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]])
        .map(|corners| side(&corners))
        .collect();
    sides.par_sort_unstable();
    let mut why = NotClosed::default();
    let mut edges = Vec::with_capacity(sides.len() / 2);
    for sides in sides.chunk_by(|x, y| (x.low, x.high) == (y.low, y.high)) {
        match sides {
            // Sorted: the one that runs forward comes first.
            [first, second] if first.is_backward != second.is_backward => {
                edges.push(Edge { ends: [first.low, first.high], opposite: [first.opposite, second.opposite] });
            }
            [_, _] => why.turned_edges += 1,
            [_] => why.open_edges += 1,
            _ => why.crowded_edges += 1,
        }
    }
    if why == NotClosed::default() { Ok(edges) } else { Err(why) }
}

/// The sides opposite to each vertex, one vertex after the other, and where each one's begin.
fn sides_around(vertex_count: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 2]>) {
    let mut first_side = vec![0; vertex_count + 1];
    for &corner in triangles.iter().flatten() {
        first_side[corner as usize + 1] += 1;
    }
    for i in 1..first_side.len() {
        first_side[i] += first_side[i - 1];
    }
    let mut next = first_side.clone();
    let mut sides = vec![[0; 2]; 3 * triangles.len()];
    for &[a, b, c] in triangles {
        for [vertex, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
            sides[next[vertex as usize] as usize] = [p, q];
            next[vertex as usize] += 1;
        }
    }
    (first_side, sides)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_closed_is_counted() {
        let why = |mesh: Mesh| ClosedMesh::new(mesh).map(|_| ()).unwrap_err();
        let cube = || Mesh::cube(Vec3::ZERO, Vec3::ONE);
        let nothing = NotClosed::default();

        let mut mesh = cube();
        mesh.triangles.pop();
        assert_eq!(why(mesh), NotClosed { open_edges: 3, ..nothing });

        let mut mesh = cube();
        mesh.triangles[0].swap(0, 1);
        assert_eq!(why(mesh), NotClosed { turned_edges: 3, ..nothing });

        let mut mesh = cube();
        mesh.append(&Mesh::cube(Vec3::new(1.0, 1.0, 0.0), Vec3::new(2.0, 2.0, 1.0)));
        assert_eq!(why(mesh), NotClosed { crowded_edges: 1, ..nothing }, "two boxes at an edge");

        let mut mesh = cube();
        mesh.positions[0].x = f32::NAN;
        assert!(why(mesh).not_finite > 0);

        assert_eq!(why(Mesh::default()), nothing);
        let mut both_sides = Mesh::default();
        both_sides.triangle([Vec3::ZERO, Vec3::X, Vec3::Y]);
        both_sides.triangles.push([0, 2, 1]);
        assert_eq!(why(both_sides).to_string(), "not closed: it has no inside");
    }

    #[test]
    fn positions_are_welded_and_triangles_without_area_ignored() {
        // Vertices of their own for each triangle, once with -0 for 0, and a triangle with two equal corners.
        let cube = Mesh::cube(Vec3::ZERO, Vec3::ONE);
        let mut mesh = Mesh::default();
        for i in 0..cube.triangles.len() {
            mesh.triangle(cube.corners(i).map(|p| if i == 3 && p.x == 0.0 { Vec3::new(-0.0, p.y, p.z) } else { p }));
        }
        mesh.triangle([Vec3::ZERO, Vec3::X, Vec3::X]);
        let closed = ClosedMesh::new(mesh).unwrap();
        assert_eq!((closed.edge_count(), closed.positions.len()), (18, 8));
        let around: usize = (0..8).map(|i| closed.fan(i).count()).sum();
        assert_eq!(around, 36);
    }
}
