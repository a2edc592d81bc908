//! Proofs that a ray must hit, and by which t. A triangle counts as in [`super::super::ExactTracer`]: its edges belong
//! to it, and a ray parallel to its plane does not hit it.
//!
//! **Around an edge or a vertex.** Let all triangles of an edge (two) or around a vertex face the ray from the same
//! side, strictly. Seen along the ray they lie around the edge or vertex without folds, each with the same sense of
//! rotation. Let the ray pass, strictly, on the inner side of each of their outer sides (those that do not lie on the
//! edge or touch the vertex). Edge: the ray is on one side of the edge or on the other, or on it, and so within the
//! triangle of that side, all of whose other sides are outer ones. Vertex: the segment from the vertex, which is on the
//! inner side of all outer sides itself, to the ray crosses none of them, so that the outer sides, which are closed
//! curves because the mesh is closed, wind around both points equally often, around the vertex at least once; as often
//! the triangles cover the ray. Either way it hits one of them, at a t not beyond the largest at which it crosses their
//! planes. The edge may be passed by one rounding or by many: that makes no difference.
//!
//! **From inside.** Let p be a point with a winding number other than 0 that is on no triangle, and the ray start
//! there. Move p by any vector so small that it stays clear of the surface, and such that the moved ray meets no edge
//! and no vertex. What the moved ray crosses changes the winding number from that of p to the 0 of everything far away,
//! so it hits a triangle, and not one parallel to it. There are finitely many triangles: one of them is hit for
//! arbitrarily small vectors, and being closed, without any.
//!
//! **Beside thin triangles.** What doubles do not prove there, exact arithmetic looks up: `thin.rs`.
//!
//! **Through the inside.** Let the ray start outside of the mesh's box, where the winding number is 0, and pass through
//! a ball in which it is not: the same, for the part of the ray up to any point in the ball.

use super::super::estimate::Estimate;
use super::aim::{Start, Target};
use super::{ClosedMesh, Edge};
use glam::{DVec3, Vec3};
use std::ops::Range;

impl ClosedMesh {
    /// A t at which, or before which, the ray surely hits something; the least that there is a proof for.
    pub(super) fn promise(&self, origin: Vec3, direction: Vec3, target: Target, start: Start) -> Option<f64> {
        let (origin64, direction64) = (origin.as_dvec3(), direction.as_dvec3());
        let around = match target {
            Target::Vertex(vertex) => self.promise_around_vertex(origin64, direction64, vertex),
            Target::Edge(edge) => {
                let Edge { ends, opposite } = self.edges[edge as usize];
                let faces = [[ends[0], ends[1], opposite[0]], [ends[1], ends[0], opposite[1]]];
                let faces = faces.map(|corners| corners.map(|i| self.position(i)));
                let passed = || ends.iter().find_map(|&end| self.promise_around_vertex(origin64, direction64, end));
                largest_t(origin64, direction64, faces, 1..3).or_else(passed)
            }
        };
        let exactly = || match target {
            Target::Vertex(vertex) => self.promise_beside_thin(origin, direction, &[vertex]),
            Target::Edge(edge) => self.promise_beside_thin(origin, direction, &self.edges[edge as usize].ends),
        };
        around.or_else(exactly).or_else(|| match start {
            Start::Inside => Some(f64::INFINITY),
            Start::Towards(ball) if self.is_outside_box(origin) => {
                let ball = self.inside[ball];
                let t = (ball.center - origin64).dot(direction64) / direction64.length_squared();
                // The ball has half the room that there is: the other half is for the roundings here.
                let passes_at = origin64 + direction64 * t;
                (t > 0.0 && passes_at.distance(ball.center) < ball.radius).then_some(t)
            }
            _ => None,
        })
    }

    fn promise_around_vertex(&self, origin: DVec3, direction: DVec3, vertex: u32) -> Option<f64> {
        largest_t(origin, direction, self.fan(vertex), 1..2)
    }

    fn is_outside_box(&self, p: Vec3) -> bool {
        p.cmplt(self.low).any() || p.cmpgt(self.high).any()
    }
}

/// The largest t at which a ray crosses the planes of `faces`, if the proof holds that it hits one of them. Side k of a
/// face runs from its corner k to the next one; `outer`: which ones the others of the faces do not share.
fn largest_t(
    origin: DVec3,
    direction: DVec3,
    faces: impl IntoIterator<Item = [DVec3; 3]>,
    outer: Range<usize>,
) -> Option<f64> {
    let mut facing = 0.0;
    let mut largest = f64::NEG_INFINITY;
    for corners in faces {
        let [a, b, c] = corners;
        let det = Estimate::volume(direction, b - a, c - a);
        let sign = det.sign()?;
        if sign == -facing {
            return None;
        }
        facing = sign;
        for k in outer.clone() {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            // Of a point within the triangle the volume of each side has the sign that det has not.
            if Estimate::volume(direction, q - p, p - origin).sign()? == sign {
                return None;
            }
        }
        let t = Estimate::volume(a - origin, b - a, c - a).over(det)?;
        if t.low() <= 0.0 {
            return None;
        }
        largest = largest.max(t.high());
    }
    (facing != 0.0).then_some(largest)
}
