//! Points that are surely inside of a closed mesh.
//!
//! The winding number is the sum of the triangles' solid angles (van Oosterom and Strackee, "The Solid Angle of a Plane
//! Triangle", IEEE Transactions on Biomedical Engineering 30, 1983; Jacobson, Kavan and Sorkine-Hornung, "Robust
//! Inside-Outside Segmentation using Generalized Winding Numbers", SIGGRAPH 2013): a whole number, and the same in a
//! ball that no triangle reaches into.

use super::super::tolerance::EPSILON;
use glam::{DVec3, Vec3};
use raybrook::low_level::parallel;
use raybrook::low_level::random::Random;
use std::f64::consts::TAU;

/// Points that are tried, half of them anywhere in the box, half of them close to the surface. Each takes a look at
/// every triangle.
const CANDIDATES: usize = 256;
/// Points close to the surface are up to this power of two smaller than their triangle away.
const CLOSEST: i32 = -10;
/// A winding number that is farther from a whole one was spoilt by roundings, which are billions of times smaller
/// elsewhere.
const MOST_OFF: f64 = 1.0 / 1024.0;

/// A ball of which every point is inside.
#[derive(Debug, Clone, Copy)]
pub struct Ball {
    /// A float32 point.
    pub center: DVec3,
    /// Half the distance of the surface, or less.
    pub radius: f64,
}

/// Balls inside of a mesh of these triangles, whose box is `low` to `high`. Always the same ones.
pub fn balls(triangles: &[[DVec3; 3]], low: Vec3, high: Vec3) -> Vec<Ball> {
    parallel::flat_map_numbers(CANDIDATES, |i| {
        let mut random = Random::new(Random::new(i as u64).bits());
        let center = if i % 2 == 0 {
            low + (high - low) * ((random.vec3() + 1.0) * 0.5)
        } else {
            let [a, b, c] = triangles[random.below(triangles.len())];
            let (edge1, edge2) = (b - a, c - a);
            let size = edge1.length().min(edge2.length());
            let away =
                edge1.cross(edge2).normalize_or_zero() * size * f64::from(random.sign() * random.size(CLOSEST, 0));
            ((a + b + c) / 3.0 + away).as_vec3()
        };
        ball_at(center.as_dvec3(), triangles)
    })
}

fn ball_at(center: DVec3, triangles: &[[DVec3; 3]]) -> Option<Ball> {
    let (mut angle, mut distance, mut farthest) = (0.0, f64::INFINITY, 0.0f64);
    for triangle in triangles {
        let corners = triangle.map(|p| p - center);
        angle += solid_angle(corners);
        distance = distance.min(least_distance(corners));
        farthest = corners.iter().fold(farthest, |far, p| far.max(p.abs().max_element()));
    }
    let largest = farthest + center.abs().max_element();
    let winding = angle / (2.0 * TAU);
    let is_inside = (winding - winding.round()).abs() < MOST_OFF && winding.round() != 0.0;
    // Doubles are off by far less than half of what float32 can tell at this distance from the origin: that half is for
    // them.
    let is_large = distance > 4.0 * EPSILON * largest;
    (is_inside && is_large).then_some(Ball { center, radius: distance / 2.0 })
}

fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let [x, y, z] = [a, b, c].map(DVec3::length);
    2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
}

/// A lower bound of a triangle's distance from the origin: the larger one of its box's and of its plane's.
fn least_distance([a, b, c]: [DVec3; 3]) -> f64 {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let of_box = low.max(-high).max(DVec3::ZERO).length();
    let of_plane = (b - a).cross(c - a).normalize_or_zero().dot(a).abs();
    of_box.max(of_plane)
}

impl Ball {
    /// A float32 point in it.
    pub fn random_point(&self, random: &mut Random) -> Vec3 {
        let point = (self.center + (random.direction() * random.unit()).as_dvec3() * self.radius).as_vec3();
        let is_inside = point.as_dvec3().distance(self.center) < self.radius;
        if is_inside { point } else { self.center.as_vec3() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::mesh::Mesh;
    use super::super::ClosedMesh;
    use super::*;

    #[test]
    fn balls_are_inside() {
        let sphere = ClosedMesh::new(Mesh::sphere(3)).unwrap();
        assert!(sphere.inside.len() > CANDIDATES / 3, "{}", sphere.inside.len());
        assert!(sphere.inside.iter().all(|ball| ball.center.length() + ball.radius < 1.0));
        assert!(
            sphere.inside.iter().any(|ball| ball.radius > 0.1) && sphere.inside.iter().any(|ball| ball.radius < 1e-3)
        );

        // A hollow sphere, and the same with both surfaces facing outwards, where the inner one's inside is inside
        // twice.
        let hollow = |inner: Mesh| {
            let mut mesh = Mesh::sphere(3);
            mesh.append(&inner.mapped(|p| p * 0.5));
            ClosedMesh::new(mesh).unwrap()
        };
        let mut turned = Mesh::sphere(3);
        turned.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        let is_in_shell = |ball: &Ball| (0.4..1.0).contains(&ball.center.length());
        assert!(hollow(turned).inside.iter().all(is_in_shell));
        assert!(!hollow(Mesh::sphere(3)).inside.iter().all(is_in_shell));
    }
}
