//! Twin of `cl/points/distance.cl`: how far triangles are from a point. The reasons are there.

use crate::bounds::{BOX_LIMIT_UP, DISTANCE_ERROR, LEAST_DISTANCE_ERROR};
use crate::math::{clamp01, cross3, dot3, fma3, max_or, min_or};
use crate::shared::constants::{LARGEST_SCALED, SMALLEST_SCALED};
use glam::Vec3;

/// The closest point of a triangle so far, from the query's point as the origin.
struct Nearest {
    to: Vec3,
    square: f32,
    along: Vec3,
    is_inside: bool,
}

/// Takes the closest point of the edge from `from` on if it is nearer.
#[inline(always)]
fn take_edge(from: Vec3, edge: Vec3, nearest: &mut Nearest) {
    let s = clamp01(-dot3(from, edge) / dot3(edge, edge));
    let to = fma3(edge, s, from);
    let square = dot3(to, to);
    if square < nearest.square {
        nearest.to = to;
        nearest.square = square;
        nearest.along = edge * if s > 0.0 && s < 1.0 { 1.0 } else { 0.0 };
    }
}

/// A point of the triangle that is about the closest one.
#[inline(always)]
fn nearest_of_triangle([a, b, c]: [Vec3; 3]) -> Nearest {
    let (edge1, edge2) = (b - a, c - a);
    let mut nearest = Nearest { to: a, square: dot3(a, a), along: Vec3::ZERO, is_inside: false };
    take_edge(a, edge1, &mut nearest);
    take_edge(a, edge2, &mut nearest);
    take_edge(b, c - b, &mut nearest);

    let normal = cross3(edge1, edge2);
    let weight0 = dot3(normal, cross3(b, c));
    let weight1 = dot3(normal, cross3(c, a));
    let weight2 = dot3(normal, cross3(a, b));
    let sum = (weight0 + weight1) + weight2;
    if weight0 >= 0.0 && weight1 >= 0.0 && weight2 >= 0.0 && sum > 0.0 {
        let to = fma3(edge2, weight2 / sum, fma3(edge1, weight1 / sum, a));
        let square = dot3(to, to);
        if square <= nearest.square {
            return Nearest { to, square, along: normal, is_inside: true };
        }
    }
    nearest
}

/// What bounds of the triangle's distance are off by.
#[inline(always)]
fn distance_error([a, b, c]: [Vec3; 3]) -> f32 {
    let reach = max_or(dot3(a, a), max_or(dot3(b, b), dot3(c, c))).sqrt();
    DISTANCE_ERROR.mul_add(reach, LEAST_DISTANCE_ERROR)
}

/// A bound from above of the distance.
#[inline(always)]
pub fn farthest_distance(corners: [Vec3; 3]) -> f32 {
    nearest_of_triangle(corners).square.sqrt() + distance_error(corners)
}

/// A bound from below of the distance; `None` where little is known.
#[inline(always)]
fn least_distance(corners: [Vec3; 3]) -> Option<f32> {
    let nearest = nearest_of_triangle(corners);
    let along = dot3(nearest.to, nearest.along);
    let given = if nearest.is_inside {
        nearest.along * if along < 0.0 { -1.0 } else { 1.0 }
    } else {
        let square = dot3(nearest.along, nearest.along);
        let part = if square > 0.0 { along / square } else { 0.0 };
        fma3(nearest.along, -part, nearest.to)
    };
    let magnitude = max_or(given.x.abs(), max_or(given.y.abs(), given.z.abs()));
    let direction = given * (1.0 / magnitude);
    let [a, b, c] = corners.map(|corner| dot3(corner, direction));
    let least = min_or(a, min_or(b, c));
    let bound = least / dot3(direction, direction).sqrt() - distance_error(corners);
    (magnitude > SMALLEST_SCALED && magnitude < LARGEST_SCALED && !bound.is_nan()).then_some(bound)
}

/// Whether a bound from below of the distance is no more than that one, or little is known.
#[inline(always)]
pub fn may_be_within(corners: [Vec3; 3], distance: f32) -> bool {
    least_distance(corners).is_none_or(|least| least <= distance)
}

/// Boxes are farther than `distance` where the square of theirs is larger than this.
#[inline(always)]
pub fn limit_of(distance: f32) -> f32 {
    distance * distance * BOX_LIMIT_UP
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::DVec3;

    /// The distance in f64, of well-shaped triangles right to a few of its last bits: by edges and by the face.
    fn distance([a, b, c]: [DVec3; 3]) -> f64 {
        let edge = |from: DVec3, to: DVec3| {
            let along = to - from;
            let s = (-from.dot(along) / along.length_squared()).clamp(0.0, 1.0);
            (from + s * along).length()
        };
        let of_edges = edge(a, b).min(edge(b, c)).min(edge(c, a));
        let normal = (b - a).cross(c - a);
        let is_above = [b.cross(c), c.cross(a), a.cross(b)].iter().all(|side| normal.dot(*side) >= 0.0);
        if is_above { of_edges.min(normal.dot(a).abs() / normal.length()) } else { of_edges }
    }

    /// Corners from a point whose distance is that of the triangle's size or far less, above a face, an edge or a
    /// vertex.
    fn corners(i: usize, random: &mut Random) -> ([Vec3; 3], Vec3) {
        let triangle = [(); 3].map(|()| random.vec3());
        let [a, b, c] = triangle;
        let (s, t) = (random.unit(), random.unit());
        let on = [a + (b - a) * (s * t) + (c - a) * (s - s * t), a + (b - a) * s, a][i % 3];
        let away = random.vec3() * random.size(-26, 6);
        let away = if i.is_multiple_of(2) { away } else { (b - a).cross(c - a) * away.x };
        (triangle, on + away)
    }

    /// Less than half of the bound is used up; the rest is for a square root and a division that round badly, as
    /// devices may. On average the bounds are hardly farther apart than they must be: lists are short.
    #[test]
    fn bounds_of_distances_hold_and_are_near_each_other() {
        let mut random = Random::new(20_081_121);
        let (mut most, mut apart, mut tested) = (0f64, 0f64, 0);
        for i in 0..300_000 {
            let (triangle, point) = corners(i, &mut random);
            let [a, b, c] = triangle.map(DVec3::from);
            let normal = (b - a).cross(c - a);
            if normal.length() < 0.01 * (b - a).length() * (c - a).length() {
                continue; // a needle, of which f64 does not know the distance well enough
            }
            let true_corners = triangle.map(|corner| DVec3::from(corner) - DVec3::from(point));
            let given = triangle.map(|corner| corner - point);
            let exact = distance(true_corners); // of differences that are exact, or as good as that
            let (low, high) = (f64::from(least_distance(given).unwrap_or(0.0)), f64::from(farthest_distance(given)));
            let reach = true_corners.iter().map(|corner| corner.length()).fold(0.0, f64::max);
            assert!(low <= exact && exact <= high, "{triangle:?} {point:?}: {low} {exact} {high}");
            let error = f64::from(distance_error(given));
            most = most.max((exact - (high - error)).max(low + error - exact) / (f64::from(DISTANCE_ERROR) * reach));
            apart += (high - low.max(0.0)) / (f64::from(DISTANCE_ERROR) * reach);
            tested += 1;
        }
        assert!(tested > 200_000 && most > 0.02 && most < 0.5, "{tested} {most}");
        let apart = apart / f64::from(tested);
        assert!(apart < 4.0, "{apart}");
    }
}
