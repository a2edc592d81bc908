//! The bounds of `cl/kernels/closest_point.cl` in f64 and in world units, in which nothing gets lost: what they leave
//! of a list is mostly one triangle, or those around one edge or vertex.

use crate::bounds::DISTANCE_ERROR;
use glam::{DVec3, Vec3};

/// [`DISTANCE_ERROR`] with f64's rounding.
const ERROR: f64 = DISTANCE_ERROR as f64 / crate::bounds::EPSILON as f64 * (f64::EPSILON / 2.0);

struct Nearest {
    to: DVec3,
    square: f64,
    along: DVec3,
    is_inside: bool,
}

fn take_edge(from: DVec3, edge: DVec3, nearest: &mut Nearest) {
    let s = -from.dot(edge) / edge.length_squared();
    let s = if s > 0.0 { s.min(1.0) } else { 0.0 };
    let to = from + s * edge;
    let square = to.length_squared();
    if square < nearest.square {
        *nearest = Nearest { to, square, along: if s > 0.0 && s < 1.0 { edge } else { DVec3::ZERO }, is_inside: false };
    }
}

fn nearest_of([a, b, c]: [DVec3; 3]) -> Nearest {
    let (edge1, edge2) = (b - a, c - a);
    let mut nearest = Nearest { to: a, square: a.length_squared(), along: DVec3::ZERO, is_inside: false };
    take_edge(a, edge1, &mut nearest);
    take_edge(a, edge2, &mut nearest);
    take_edge(b, c - b, &mut nearest);
    let normal = edge1.cross(edge2);
    let weights = [b.cross(c), c.cross(a), a.cross(b)].map(|side| normal.dot(side));
    let sum = (weights[0] + weights[1]) + weights[2];
    if weights.iter().all(|&weight| weight >= 0.0) && sum > 0.0 {
        let to = a + (weights[1] / sum) * edge1 + (weights[2] / sum) * edge2;
        let square = to.length_squared();
        if square <= nearest.square {
            return Nearest { to, square, along: normal, is_inside: true };
        }
    }
    nearest
}

/// Bounds of the distance between a triangle and a point.
pub(super) fn distance_bounds(triangle: [Vec3; 3], point: Vec3) -> [f64; 2] {
    let corners = triangle.map(|corner| DVec3::from(corner) - DVec3::from(point));
    let nearest = nearest_of(corners);
    let reach = corners.iter().map(|corner| corner.length_squared()).fold(0.0, f64::max).sqrt();
    let error = ERROR * reach;
    let along = nearest.to.dot(nearest.along);
    let square = nearest.along.length_squared();
    let direction = match nearest.is_inside {
        true => nearest.along * along.signum(),
        false if square > 0.0 => nearest.to - (along / square) * nearest.along,
        false => nearest.to,
    };
    let length = direction.length();
    let least = corners.iter().map(|corner| corner.dot(direction)).fold(f64::INFINITY, f64::min);
    let low = if length > 0.0 { least / length - error } else { 0.0 };
    [low, nearest.square.sqrt() + error]
}
