//! Twin of `cl/intersect/edges.cl`: edge functions in sheared space, and a bound of their error. The reasons are there.

use super::intersect::ShearedTriangle;
use super::math::{max_or, min_or};
use super::ray::EPSILON;
use glam::Vec3;

const SHEAR_ERROR: f32 = 74.0 * EPSILON;
const SHEAR_ERROR2: f32 = 544.0 * EPSILON * EPSILON;
const LEAST_EDGE: f32 = f32::from_bits((127 - 60) << 23);

/// Edge functions, one for each vertex.
#[derive(Debug, Clone, Copy)]
pub struct Edges {
    /// Opposite to vertex 0, 1, 2.
    pub weights: [f32; 3],
    /// The least of them.
    pub low: f32,
    /// The greatest.
    pub high: f32,
    /// A bound of their errors.
    pub bound: f32,
}

impl Edges {
    /// Of a triangle.
    #[inline(always)]
    pub fn new(s: &ShearedTriangle) -> Edges {
        let [a, b, c] = s.vertices;
        let weights = [c.x.mul_add(b.y, -(c.y * b.x)), a.x.mul_add(c.y, -(a.y * c.x)), b.x.mul_add(a.y, -(b.y * a.x))];
        let larger = |p: Vec3| max_or(p.x.abs(), p.y.abs());
        let extent = max_or(max_or(larger(a), larger(b)), larger(c));
        let farthest = extent + max_or(a.z.abs(), max_or(b.z.abs(), c.z.abs()));
        Edges {
            weights,
            low: min_or(weights[0], min_or(weights[1], weights[2])),
            high: max_or(weights[0], max_or(weights[1], weights[2])),
            bound: farthest.mul_add(SHEAR_ERROR.mul_add(extent, SHEAR_ERROR2 * farthest), LEAST_EDGE),
        }
    }

    /// Where the ray passes the triangle for certain.
    #[inline(always)]
    pub fn surely_missed(&self) -> bool {
        self.low < -self.bound && self.high > self.bound
    }
}
