//! Triangles that are as thin as a line: rays within them, and exact proofs around them.
//!
//! Whoever takes such a triangle for one without area, and leaves it out, opens a hole that hardly any ray finds: it is
//! narrower than the last bits of the coordinates around it. Rays of floats go through it all the same. One with the
//! origin `beside` the axis and the direction `corner` is at t = 1 exactly at `beside + corner`, a sum that no float
//! holds.

use super::super::estimate::size_of_cross;
use super::super::exact::{Interval, Line};
use super::super::tolerance::EPSILON;
use super::{AimedRay, ClosedMesh};
use glam::{DVec2, DVec3, Vec3};
use raybrook::low_level::random::Random;
use raybrook::low_level::scene::{PROJECTIONS, projected_area};

/// Roundings of a cross product of two differences, twice those of each component, and a margin: what float32 surely
/// tells from zero is more.
const FLOAT_ERROR: f64 = 8.0 * EPSILON;
/// One ray in so many is aimed at a thin triangle, where there are any.
const SHARE: usize = 4;
/// Origins are up to two to this power of the mesh's size above a thin triangle.
const DISTANCES: (i32, i32) = (-6, 4);

/// The thin triangles of a mesh.
#[derive(Default)]
pub(super) struct Thin {
    /// Their corners.
    triangles: Vec<[u32; 3]>,
    /// Whether one touches the vertex of this number; empty when there are none.
    touches: Vec<bool>,
}

impl Thin {
    pub fn of(triangles: &[[u32; 3]], positions: &[DVec3]) -> Thin {
        let is_thin = |corners: &[u32; 3]| is_thin(corners.map(|i| positions[i as usize]));
        let triangles: Vec<_> = triangles.iter().copied().filter(is_thin).collect();
        if triangles.is_empty() {
            return Thin::default();
        }
        let mut touches = vec![false; positions.len()];
        triangles.iter().flatten().for_each(|&i| touches[i as usize] = true);
        Thin { triangles, touches }
    }
}

/// Whether float32 arithmetic may take a triangle for one without area.
fn is_thin([a, b, c]: [DVec3; 3]) -> bool {
    let (edge1, edge2) = (b - a, c - a);
    let size = size_of_cross(edge1.abs(), edge2.abs());
    edge1.cross(edge2).abs().cmple(size * FLOAT_ERROR).all()
}

impl ClosedMesh {
    /// How many triangles are so thin that float32 arithmetic may take them for lines.
    pub fn thin_count(&self) -> usize {
        self.thin.triangles.len()
    }

    /// By exact arithmetic: the t at which a ray first hits a triangle around one of `vertices`, where thin triangles
    /// are.
    pub(super) fn promise_beside_thin(&self, origin: Vec3, direction: Vec3, vertices: &[u32]) -> Option<f64> {
        let Thin { touches, .. } = &self.thin;
        if !vertices.iter().any(|&vertex| touches.get(vertex as usize) == Some(&true)) {
            return None;
        }
        let line = Line::new(origin.as_dvec3(), direction.as_dvec3())?;
        let ahead = Interval { near: 0.0, far: f32::INFINITY, is_open: false };
        let around = vertices.iter().flat_map(|&vertex| self.fan(vertex));
        let hits = around.filter_map(|corners| line.crossing(corners)).map(|[t, ..]| t);
        hits.filter(|t| ahead.contains(t)).min().map(|t| t.to_f64().next_up())
    }

    /// A ray into a thin triangle, beside the corner where it is widest; at times `None`, and without thin triangles
    /// always.
    pub(super) fn aim_at_thin(&self, random: &mut Random) -> Option<AimedRay> {
        let Thin { triangles, .. } = &self.thin;
        if triangles.is_empty() || random.below(SHARE) != 0 {
            return None;
        }
        let corners = triangles[random.below(triangles.len())];
        let area = |axes| projected_area(corners.map(|i| self.position(i).as_vec3()), axes);
        let [x, y] = PROJECTIONS.into_iter().max_by(|&p, &q| area(p).abs().total_cmp(&area(q).abs()))?;
        let up = 3 - x - y;
        let seen = |i: u32| DVec2::new(self.position(i)[x], self.position(i)[y]);
        // The corner that faces the longest side is the one beside which there is most room.
        let sides = [0, 1, 2].map(|k| [0, 1, 2].map(|j| corners[(k + j) % 3]));
        let length = |&[_, p, q]: &[u32; 3]| seen(p).distance_squared(seen(q));
        let [corner, p, q] = sides.into_iter().max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let along = seen(q) - seen(p);
        let height = area([x, y]) / along.length();
        let inwards = along.perp().normalize_or_zero() * -height * f64::from(random.unit());

        let at = self.position(corner).as_vec3();
        let size = (self.high - self.low).max_element() * random.size(DISTANCES.0, DISTANCES.1);
        let above = random.sign() * raybrook::low_level::random::power_of_two(size.log2().floor() as i32);
        let (mut origin, mut direction) = (Vec3::ZERO, at);
        (origin[x], origin[y]) = (inwards.x as f32, inwards.y as f32);
        // The way along the third axis has to be exact.
        origin[up] = random.pick(&[above, at[up] + above, 2.0 * at[up], -at[up]]);
        direction[up] = at[up] - origin[up];
        if !(origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO) {
            return None;
        }
        let by = self.promise_beside_thin(origin, direction, &[corner])?;
        Some(AimedRay { origin, direction, by, is_inside: false, is_at_vertex: true })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::exact::ExactTracer;
    use super::super::super::mesh::Mesh;
    use super::*;

    /// A pyramid upside down, a corner of whose base is off by the noise of a cosine of 90 degrees; the last triangle
    /// closes the gap.
    fn pyramid(noise: f32, lift: f32) -> Mesh {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z + lift);
        Mesh {
            positions: vec![
                at(noise, 0.0, 0.0),
                at(8.0, 0.0, 0.0),
                at(8.0, 8.0, 0.0),
                at(0.0, 8.0, 0.0),
                at(4.0, 4.0, 0.0),
                at(4.0, 4.0, -4.0),
            ],
            triangles: vec![[0, 1, 2], [4, 2, 3], [0, 4, 3], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5], [0, 2, 4]],
        }
    }

    #[test]
    fn rays_go_through_the_inside_of_thin_triangles() {
        for (noise, lift) in [(6.123234e-17, 0.0), (6.123234e-17, 3.0), (1e-30, 0.0), (1e-40, 0.0)] {
            let closed = ClosedMesh::new(pyramid(noise, lift)).unwrap();
            assert_eq!(closed.thin_count(), 1);
            let tracer = ExactTracer::new(closed.mesh());
            let everywhere = Interval { near: 0.0, far: f32::INFINITY, is_open: false };
            let hits = (0..2000).filter_map(|index| {
                let ray = closed.ray(5, index);
                let line = Line::new(ray.origin.as_dvec3(), ray.direction.as_dvec3())?;
                let hit = tracer.closest(&line, everywhere, &[], |_| true).expect("the ray must hit");
                assert!(hit.crossing.t.to_f64() <= ray.by, "{ray:?}");
                Some(hit.primitives)
            });
            let within = hits.filter(|primitives| primitives[..] == [7]).count();
            assert!(within > 50, "{noise:e}, {lift}: {within} of 2000");
        }
    }

    #[test]
    fn ordinary_meshes_have_no_thin_triangles() {
        for mesh in [Mesh::sphere(3), Mesh::cubes(2), Mesh::double_fan(6, 0.01)] {
            assert_eq!(ClosedMesh::new(mesh).unwrap().thin_count(), 0);
        }
    }
}
