//! Where on a triangle its closest point to a point lies: inside of the face, inside of an edge, or at a vertex.
//!
//! Ericson, "Real-Time Collision Detection", 2005, section 5.1.5: which of the seven it is follows from the signs of
//! products of edges with the ways to the corners. A triangle without area is the longest of its edges, or a point.

use super::number::{Number, cross, dot};
use glam::Vec3;

/// A triangle as seen from a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape<N> {
    /// The corners, from the point as the origin.
    pub to: [[N; 3]; 3],
    /// From each corner to the next one.
    pub edges: [[N; 3]; 3],
}

/// What the closest point lies inside of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Feature {
    Vertex(usize),
    /// From this corner to the next one.
    Edge(usize),
    Face,
}

/// The next corner.
fn next(i: usize) -> usize {
    (i + 1) % 3
}

/// Where the closest point is: at a corner and some shares of `whole` along edges from there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Location<N> {
    pub corner: usize,
    /// Shares, and ways along edges.
    pub steps: [Option<(N, [N; 3])>; 2],
    /// Weights of vertices 1 and 2 as shares of `whole`; `None`: 0.
    pub weights: [Option<N>; 2],
    /// Positive; `None`: 1, and there are no steps.
    pub whole: Option<N>,
}

impl<N: Number> Shape<N> {
    pub fn new(corners: [Vec3; 3], point: Vec3, difference: impl Fn(f32, f32) -> N) -> Self {
        let minus = |a: Vec3, b: Vec3| [difference(a.x, b.x), difference(a.y, b.y), difference(a.z, b.z)];
        let [a, b, c] = corners;
        Shape { to: corners.map(|corner| minus(corner, point)), edges: [minus(b, a), minus(c, b), minus(a, c)] }
    }

    /// How far the point is along edge `i`, from its start and back from its end; together they are the edge's square.
    fn along(&self, i: usize) -> [N; 2] {
        [dot(self.edges[i], self.to[i]).negative(), dot(self.edges[i], self.to[next(i)])]
    }

    fn normal(&self) -> [N; 3] {
        cross(self.edges[0], self.edges[1])
    }

    /// The weight of the corner that is opposite of edge `i`, where the point is above the triangle's plane.
    fn weight_opposite(&self, normal: [N; 3], i: usize) -> N {
        dot(normal, cross(self.to[i], self.to[next(i)]))
    }

    /// What the closest point lies inside of, or where it is at the border of two, one of them; `None` where these
    /// numbers do not tell.
    pub fn feature(&self) -> Option<Feature> {
        let normal = self.normal();
        let mut is_known = true;
        let has_area = normal.into_iter().any(|component| {
            let sign = component.sign();
            is_known &= sign.is_some();
            sign.is_some_and(|sign| sign != 0)
        });
        if !has_area {
            return if is_known { self.feature_of_longest_edge() } else { None };
        }
        let mut signs = [[0; 2]; 3];
        for (i, signs) in signs.iter_mut().enumerate() {
            let [from_start, from_end] = self.along(i);
            *signs = [from_start.sign()?, from_end.sign()?];
        }
        let is_beyond = |i: &usize| signs[*i][0] <= 0 && signs[(i + 2) % 3][1] <= 0;
        if let Some(corner) = (0..3).find(is_beyond) {
            return Some(Feature::Vertex(corner));
        }
        for (i, signs) in signs.iter().enumerate() {
            if signs[0] >= 0 && signs[1] >= 0 && self.weight_opposite(normal, i).sign()? <= 0 {
                return Some(Feature::Edge(i));
            }
        }
        Some(Feature::Face)
    }

    /// The same of a triangle without area.
    fn feature_of_longest_edge(&self) -> Option<Feature> {
        let squares = self.edges.map(|edge| dot(edge, edge));
        let mut longest = 0;
        for i in 1..3 {
            if squares[i].minus(squares[longest]).sign()? > 0 {
                longest = i;
            }
        }
        let [from_start, from_end] = self.along(longest);
        if from_start.sign()? <= 0 {
            return Some(Feature::Vertex(longest));
        }
        Some(if from_end.sign()? <= 0 { Feature::Vertex(next(longest)) } else { Feature::Edge(longest) })
    }

    /// The closest point.
    pub fn location(&self, feature: Feature) -> Location<N> {
        match feature {
            Feature::Vertex(corner) => Location { corner, steps: [None; 2], weights: [None; 2], whole: None },
            Feature::Edge(corner) => {
                let [from_start, from_end] = self.along(corner);
                let weights = match corner {
                    0 => [Some(from_start), None],
                    1 => [Some(from_end), Some(from_start)],
                    _ => [None, Some(from_end)],
                };
                let steps = [Some((from_start, self.edges[corner])), None];
                Location { corner, steps, weights, whole: Some(from_start.plus(from_end)) }
            }
            Feature::Face => {
                let normal = self.normal();
                let [weight2, _, weight1] = [0, 1, 2].map(|i| self.weight_opposite(normal, i));
                // From corner 0 along edge 0, and then along edge 1.
                let steps = [Some((weight1.plus(weight2), self.edges[0])), Some((weight2, self.edges[1]))];
                let weights = [Some(weight1), Some(weight2)];
                Location { corner: 0, steps, weights, whole: Some(dot(normal, normal)) }
            }
        }
    }
}
