//! Splits polygons, concave ones too, into triangles: n corners always give n-2.
//!
//! Quads by the right diagonal; convex polygons as fans; others by ear clipping (Meisters, "Polygons have ears",
//! American Mathematical Monthly 1975) with the `earcut` crate, on the plane of the two axes that the polygon's normal
//! is least along. The normal is Newell's (Sutherland, Sproull & Schumacker, "A Characterization of Ten Hidden-Surface
//! Algorithms", ACM Computing Surveys 1974, appendix), in f64.
//!
//! `earcut` leaves out corners on a straight edge; the neighbour's corner there would then touch the middle of an edge,
//! and rays could pass between. Those corners are put back by splitting the triangle at that edge.
//!
//! Bad at: polygons that cross themselves or have no plane: they get n-2 triangles, but which is anybody's guess.

use earcut::Earcut;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Splits polygons; keeps its buffers between them.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    projected: Vec<[f64; 2]>,
    ears: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    pairs_spent: Arc<AtomicU64>,
    /// How many concave polygons became fans because [`MAX_PAIRS`] was spent.
    pub(super) fans: usize,
}

/// The largest number of corners of one face: bounds the memory that splitting it takes.
pub(super) const MAX_CORNERS: usize = 65_536;

/// The most pairs of corners (squares of corner counts) that ear clipping is given in one file. Star polygons, which
/// cross themselves everywhere, reach the quadratic worst case of 33 ns a pair (16,000 corners: 8.3 s); this bounds a
/// file to some 3 s. It is one polygon of 10,000 corners, or 10,000 of 100; convex ones are free.
pub(super) const MAX_PAIRS: u64 = 100_000_000;

impl Triangulator {
    /// One with empty buffers.
    pub(super) fn new() -> Self {
        Triangulator {
            earcut: Earcut::new(),
            projected: Vec::new(),
            ears: Vec::new(),
            triangles: Vec::new(),
            pairs_spent: Arc::default(),
            fans: 0,
        }
    }

    /// Another one for the same file, which spends from the same [`MAX_PAIRS`].
    pub(super) fn sharing(other: &Triangulator) -> Self {
        Triangulator { pairs_spent: Arc::clone(&other.pairs_spent), ..Triangulator::new() }
    }

    /// Whether [`MAX_PAIRS`] was spent: which polygons became fans then depends on the order in which they were split.
    pub(super) fn is_spent(&self) -> bool {
        self.pairs_spent.load(Ordering::Relaxed) > MAX_PAIRS
    }

    /// The `polygon.len() - 2` triangles of `polygon`, as indices of its corners, wound as the polygon is.
    ///
    /// None for fewer than three corners. A polygon without area or with a corner that is not finite becomes a fan.
    pub(super) fn split(&mut self, polygon: &[Vec3]) -> &[[u32; 3]] {
        self.triangles.clear();
        match polygon.len() {
            0..=2 => {}
            3 => self.triangles.push([0, 1, 2]),
            4 => self.triangles.extend(split_quad([polygon[0], polygon[1], polygon[2], polygon[3]])),
            count => {
                if !self.project(polygon) || self.is_convex() || !self.clip_ears() {
                    self.triangles.clear();
                    self.triangles.extend((1..count as u32 - 1).map(|i| [0, i, i + 1]));
                }
            }
        }
        &self.triangles
    }

    /// The warning about [`Triangulator::fans`].
    pub(super) fn fans_message(&self) -> String {
        format!("large concave polygons split as if convex, perhaps wrongly: {}", self.fans)
    }

    /// Projects a polygon so that it winds counter-clockwise; false when it has no plane.
    fn project(&mut self, polygon: &[Vec3]) -> bool {
        let normal = newell_normal(polygon);
        if !normal.is_finite() || normal == DVec3::ZERO {
            return false;
        }
        // Leave out the dominant axis; the order of the other two decides the winding.
        let size = normal.abs();
        let dominant = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
        let (mut across, mut up) = ((dominant + 1) % 3, (dominant + 2) % 3);
        if normal[dominant] < 0.0 {
            (across, up) = (up, across);
        }
        self.projected.clear();
        self.projected.extend(polygon.iter().map(|p| [f64::from(p[across]), f64::from(p[up])]));
        true
    }

    /// Whether the projected polygon turns left at every corner and goes around once. Straight corners do not count as
    /// convex: in a fan they would touch the middle of an edge.
    fn is_convex(&self) -> bool {
        let corners = &self.projected;
        let at = |i: usize| corners[i % corners.len()];
        let to_the_right = |i: usize| at(i + 1)[0] > at(i)[0] || (at(i + 1)[0] == at(i)[0] && at(i + 1)[1] > at(i)[1]);
        let turns_left = |i: usize| signed_area([at(i), at(i + 1), at(i + 2)]) > 0.0;
        let reversals = (0..corners.len()).filter(|&i| to_the_right(i) != to_the_right(i + 1)).count();
        reversals == 2 && (0..corners.len()).all(turns_left)
    }

    /// Ear clipping of the projected polygon; false when it fails or would take too long.
    fn clip_ears(&mut self) -> bool {
        let count = self.projected.len();
        self.pairs_spent.fetch_add((count as u64).pow(2), Ordering::Relaxed);
        if self.is_spent() {
            self.fans += 1;
            return false;
        }
        self.earcut.earcut_slice(&self.projected, &[], &mut self.ears);
        for ear in self.ears.chunks_exact(3) {
            let [a, b, c] = [ear[0], ear[1], ear[2]];
            let clockwise = signed_area([a, b, c].map(|i| self.projected[i as usize])) < 0.0;
            self.triangles.push(if clockwise { [a, c, b] } else { [a, b, c] });
        }
        if self.triangles.is_empty() || self.triangles.len() > count - 2 {
            return false;
        }
        if self.triangles.len() < count - 2 {
            put_back(&mut self.triangles, count);
        }
        self.triangles.len() == count - 2
    }
}

/// Inserts the corners of `0..count` that no triangle has, each at the edge between its neighbours.
fn put_back(triangles: &mut Vec<[u32; 3]>, count: usize) {
    let mut used = vec![false; count];
    let mut triangle_of_edge = HashMap::with_capacity(3 * triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        for i in 0..3 {
            used[triangle[i] as usize] = true;
            triangle_of_edge.insert((triangle[i], triangle[(i + 1) % 3]), t);
        }
    }
    let last_used = used.iter().rposition(|&u| u).unwrap_or(0);
    let mut previous = last_used as u32;
    // `next[i]`: the first used corner after i, around the polygon; filled backwards so that runs take linear time.
    let mut next = vec![0; count];
    let mut following = used.iter().position(|&u| u).unwrap_or(0) as u32;
    for corner in (0..count).rev() {
        next[corner] = following;
        if used[corner] {
            following = corner as u32;
        }
    }
    // Start after the last used corner: its run of unused ones goes around the end.
    for corner in (last_used + 1..count).chain(0..last_used) {
        let middle = corner as u32;
        if used[corner] {
            previous = middle;
            continue;
        }
        let end = next[corner];
        let piece = match triangle_of_edge.get(&(previous, end)).copied() {
            Some(t) => {
                let third = triangles[t].into_iter().find(|&i| i != previous && i != end).unwrap_or(end);
                triangles[t] = [previous, middle, third];
                triangle_of_edge.insert((third, previous), t);
                triangle_of_edge.insert((middle, end), triangles.len());
                triangle_of_edge.insert((end, third), triangles.len());
                [middle, end, third]
            }
            None => [previous, middle, end], // without area; keeps the count
        };
        triangles.push(piece);
        previous = middle;
    }
}

/// The two triangles of a quad: by the diagonal from the first corner where both then face as the quad does.
fn split_quad(quad: [Vec3; 4]) -> [[u32; 3]; 2] {
    let normal = newell_normal(&quad);
    let smaller = |split: [[u32; 3]; 2]| {
        let facing = split.map(|triangle| {
            let [a, b, c] = triangle.map(|i| quad[i as usize].as_dvec3());
            (b - a).cross(c - a).dot(normal)
        });
        facing[0].min(facing[1])
    };
    let (first, second) = ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]);
    let least = smaller(first);
    // A NaN fails both comparisons and keeps the first.
    if least <= 0.0 && smaller(second) > least { second } else { first }
}

/// Twice the vector area of a polygon: exact for planar ones, the mean plane's for others.
fn newell_normal(polygon: &[Vec3]) -> DVec3 {
    // Relative to the first corner, or far polygons cancel.
    let origin = polygon[0].as_dvec3();
    let edges = polygon.windows(2).map(|pair| (pair[0].as_dvec3() - origin).cross(pair[1].as_dvec3() - origin));
    edges.sum()
}

/// Twice the area of a triangle in the plane, above zero when it winds counter-clockwise.
fn signed_area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn areas(polygon: &[Vec3]) -> (f64, f64) {
        let mut triangulator = Triangulator::new();
        let triangles = triangulator.split(polygon);
        assert_eq!(triangles.len(), polygon.len() - 2, "{polygon:?}");
        let normal = newell_normal(polygon);
        let facing = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| polygon[i as usize].as_dvec3());
            (b - a).cross(c - a).dot(normal.normalize()) / 2.0
        });
        (facing.clone().sum(), facing.map(f64::abs).sum())
    }

    #[test]
    fn concave_polygons_are_covered_once_in_every_orientation() {
        let arrow = [[-1.0, -1.0], [0.0, 0.0], [1.0, -1.0], [0.0, 1.0]];
        let hexagon = [[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [2.0, 2.0], [0.0, 2.0], [-1.0, 1.0]];
        let comb = [[0.0, 0.0], [5.0, 0.0], [5.0, 3.0], [4.0, 1.0], [3.0, 3.0], [2.0, 1.0], [1.0, 3.0]];
        // Corners on straight edges, at the start and end of the list too.
        let square = [[0.5, 0.0], [1.0, 0.0], [1.0, 0.25], [1.0, 0.5], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.25, 0.0]];
        for (outline, area) in [(&arrow[..], 1.0), (&comb[..], 9.5), (&hexagon[..], 6.0), (&square[..], 1.0)] {
            for start in 0..outline.len() {
                for axis in 0..3 {
                    for backwards in [false, true] {
                        let mut polygon: Vec<Vec3> = (0..outline.len())
                            .map(|i| outline[(start + i) % outline.len()])
                            .map(|[x, y]| [Vec3::new(x, y, 0.0), Vec3::new(0.0, x, y), Vec3::new(y, 7.0, x)][axis])
                            .collect();
                        if backwards {
                            polygon.reverse();
                        }
                        let (signed, unsigned) = areas(&polygon);
                        assert!((signed - area).abs() < 1e-9, "{signed} {polygon:?}");
                        assert!((unsigned - area).abs() < 1e-9, "{unsigned} {polygon:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn corners_on_straight_edges_stay_corners_of_triangles() {
        let square = [[0.0, 0.0], [0.25, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 1.0], [0.0, 1.0]];
        let polygon = square.map(|[x, y]| Vec3::new(x, y, 0.0));
        let mut triangulator = Triangulator::new();
        let triangles = triangulator.split(&polygon).to_vec();
        for edge in 0..square.len() as u32 {
            let edge = [edge, (edge + 1) % square.len() as u32];
            let owners = triangles.iter().filter(|t| (0..3).any(|i| [t[i], t[(i + 1) % 3]] == edge)).count();
            assert_eq!(owners, 1, "edge {edge:?} of {triangles:?}");
        }
        for t in &triangles {
            assert!(
                signed_area(t.map(|i| [square[i as usize][0].into(), square[i as usize][1].into()])) > 0.0,
                "{t:?}"
            );
        }
    }

    #[test]
    fn polygons_without_a_plane_still_give_their_count() {
        let point = [Vec3::ONE; 6];
        let line = [0.0, 1.0, 2.0, 3.0, 2.5, 1.5].map(|x| Vec3::new(x, x, x));
        let bad = [Vec3::ZERO, Vec3::X, Vec3::NAN, Vec3::Y, Vec3::INFINITY];
        let twice = [Vec3::ZERO, Vec3::X, Vec3::X, Vec3::ONE, Vec3::Y, Vec3::Y];
        let mut triangulator = Triangulator::new();
        for polygon in [&point[..], &line, &bad, &twice, &[Vec3::NAN; 4]] {
            assert_eq!(triangulator.split(polygon).len(), polygon.len() - 2, "{polygon:?}");
        }
    }

    #[test]
    fn crossing_polygons_end_in_time() {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223); // Numerical Recipes
            (state >> 8) as f32
        };
        let started = std::time::Instant::now();
        let mut triangulator = Triangulator::new();
        for count in [10, 100, 1000, 9_000, 10_000, 65_536] {
            let polygon: Vec<Vec3> = (0..count).map(|_| Vec3::new(random(), random(), 0.0)).collect();
            assert_eq!(triangulator.split(&polygon).len(), count - 2);
        }
        assert_eq!(triangulator.fans, 2);
        assert!(started.elapsed().as_secs() < 10, "{:?}", started.elapsed());
    }
}
