//! Twin of `cl/intersect/edges.cl`: edge functions in sheared space, and a bound of their error. The reasons are there.

use crate::reference::shared::math::{max_or, min_or};
use crate::shared::constants::{EDGE_ERROR, EDGE_ERROR_EXTENT, EDGE_ERROR_LOW, EDGE_ERROR2, LEAST_EDGE};
use glam::Vec3;

/// The error of edge functions, times extent and distance, of a ray whose origin has that second part.
#[inline(always)]
pub fn edge_error(origin_low: Vec3) -> f32 {
    if origin_low == Vec3::ZERO { EDGE_ERROR } else { EDGE_ERROR_LOW }
}

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
    /// Of a triangle in sheared space; `error` is what [`edge_error`] gives for the ray.
    #[inline(always)]
    pub fn new(error: f32, [a, b, c]: [Vec3; 3]) -> Edges {
        let weights = [c.x.mul_add(b.y, -(c.y * b.x)), a.x.mul_add(c.y, -(a.y * c.x)), b.x.mul_add(a.y, -(b.y * a.x))];
        let larger = |p: Vec3| max_or(p.x.abs(), p.y.abs());
        let extent = max_or(max_or(larger(a), larger(b)), larger(c));
        let farthest = extent + max_or(a.z.abs(), max_or(b.z.abs(), c.z.abs()));
        let first_order = error.mul_add(farthest, EDGE_ERROR_EXTENT * extent);
        let second_order = (EDGE_ERROR2 * farthest).mul_add(farthest, LEAST_EDGE);
        Edges {
            weights,
            low: min_or(weights[0], min_or(weights[1], weights[2])),
            high: max_or(weights[0], max_or(weights[1], weights[2])),
            bound: extent.mul_add(first_order, second_order),
        }
    }

    /// Where the ray passes the triangle for certain.
    #[inline(always)]
    pub fn surely_missed(&self) -> bool {
        self.low < -self.bound && self.high > self.bound
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::EPSILON;
    use crate::random::Random;
    use crate::reference::intersect::watertight::shear_triangle;
    use crate::reference::shared::ray::{Ray, major_axis, swap_to_z};
    use crate::shared::NO_PRIMITIVE;
    use glam::DVec3;

    const SEED: u64 = 20_081_121;

    /// The edge functions without rounding but f64's, whose errors are 2^28 times smaller than the bound's terms.
    fn exact_weights(ray: &Ray, origin_low: DVec3, triangle: [Vec3; 3]) -> [f64; 3] {
        let axis = major_axis(ray.direction);
        let turned = |v: DVec3| {
            let order = swap_to_z(Vec3::new(0.0, 1.0, 2.0), axis).to_array().map(|k| k as usize);
            DVec3::from_array(order.map(|k| v[k]))
        };
        let direction = turned(ray.direction.as_dvec3());
        let [a, b, c] = triangle.map(|p| {
            let p = turned(p.as_dvec3() - ray.origin.as_dvec3() - origin_low);
            p - direction * (p.z / direction.z)
        });
        [c.x * b.y - c.y * b.x, a.x * c.y - a.y * c.x, b.x * a.y - b.y * a.x]
    }

    /// Rays near triangles of any size, near and far, along axes and across; every other one does not start at its
    /// origin.
    #[test]
    fn edge_functions_are_off_by_no_more_than_their_bound_and_not_by_much_less() {
        let mut random = Random::new(SEED);
        let mut most = [0f64; 2];
        for i in 0..600_000 {
            let origin = random.vec3() * random.size(-4, 16);
            let direction =
                random.direction() * [Vec3::ONE, Vec3::new(1.0, 1e-3, 0.0)][i / 2 % 2] + random.vec3() * 1e-7;
            let mut ray = Ray::new(origin, direction, 0.0, f32::INFINITY, NO_PRIMITIVE);
            let size = random.size(-20, 2);
            let at = ray.origin + ray.direction * random.size(-8, 17) + random.vec3() * size;
            let triangle = [(); 3].map(|()| at + random.vec3() * size);
            let is_low = i % 2 == 1;
            if is_low {
                ray.origin_low = ray.origin * random.vec3() * EPSILON; // as of a ray that leaves a triangle
            }
            // The second part is off by 2 EPSILON of itself.
            let off = DVec3::from_array([(); 3].map(|()| 1.0 + f64::from(2.0 * EPSILON * random.signed())));
            let exact = exact_weights(&ray, ray.origin_low.as_dvec3() * off, triangle);
            let edges = {
                let sheared = shear_triangle(&ray, triangle);
                Edges::new(sheared.error, sheared.vertices)
            };
            for (weight, exact) in edges.weights.into_iter().zip(exact) {
                let share = (f64::from(weight) - exact).abs() / f64::from(edges.bound);
                assert!(share <= 1.0, "{i} (seed {SEED}): {share} of {edges:?}, {ray:?} {triangle:?}");
                most[usize::from(is_low)] = share.max(most[usize::from(is_low)]);
            }
        }
        // By chance: roundings that all go one way are rare.
        assert!(most[0] > 0.15 && most[1] > 0.06, "{most:?}");
    }
}
