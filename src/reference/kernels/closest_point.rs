//! Twin of `cl/kernels/closest_point.cl`: which triangles may be the nearest one of a point. The reasons are there.

use crate::bounds::{BOX_DISTANCE_DOWN, BOX_LIMIT_UP, DISTANCE_ERROR, LEAST_DISTANCE_ERROR, MOST_CANDIDATES};
use crate::fma::with_fma;
use crate::layout::Float4;
use crate::math::{abs3, clamp01, cross3, dot3, fma3, is_finite3, max_or, min_or, scale_to_unit};
use crate::options::TraceOptions;
use crate::pack::PointScene;
use crate::shared::{BVH_COUNT_SHIFT, BVH_FIRST_MASK, BVH_LEAF, BVH_NODE_RECORDS, KdNode};
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
fn farthest_distance(corners: [Vec3; 3]) -> f32 {
    nearest_of_triangle(corners).square.sqrt() + distance_error(corners)
}

/// A bound from below of the distance.
#[inline(always)]
fn least_distance(corners: [Vec3; 3]) -> f32 {
    let nearest = nearest_of_triangle(corners);
    let mut direction = nearest.to;
    let along = dot3(nearest.to, nearest.along);
    if nearest.is_inside {
        direction = nearest.along * if along < 0.0 { -1.0 } else { 1.0 };
    } else {
        let square = dot3(nearest.along, nearest.along);
        if square > 0.0 {
            direction = fma3(nearest.along, -(along / square), nearest.to);
        }
    }
    let Some((direction, _)) = scale_to_unit(direction) else { return 0.0 };
    let [a, b, c] = corners.map(|corner| dot3(corner, direction));
    let least = min_or(a, min_or(b, c));
    least / dot3(direction, direction).sqrt() - distance_error(corners)
}

/// The square of a distance that is no larger than that to a box.
#[inline(always)]
fn box_square(point: Vec3, middle: Vec3, half_size: Vec3) -> f32 {
    let away = abs3(point - middle) * BOX_DISTANCE_DOWN - half_size;
    let outside = Vec3::new(max_or(away.x, 0.0), max_or(away.y, 0.0), max_or(away.z, 0.0));
    dot3(outside, outside)
}

/// Boxes whose `box_square` is larger are farther than `distance`.
#[inline(always)]
fn limit_of(distance: f32) -> f32 {
    distance * distance * BOX_LIMIT_UP
}

/// Goes through all leaves that may be within `distance`, nearer ones first, and lists the triangles that may be within
/// it; returns how many. Without a list it returns none, and `distance` becomes one within which there surely is a
/// triangle.
#[inline(always)]
fn visit_triangles(scene: &PointScene, point: Vec3, distance: &mut f32, mut list: Option<&mut dyn FnMut(u32)>) -> u32 {
    let nodes = scene.nodes();
    let (mut links, mut squares) =
        ([0; TraceOptions::MAX_DEPTH as usize + 1], [0.0; TraceOptions::MAX_DEPTH as usize + 1]);
    let (mut stacked, mut link, mut count) = (0, 0u32, 0);
    let mut limit = limit_of(*distance);
    loop {
        while link & BVH_LEAF == 0 {
            let first = (BVH_NODE_RECORDS * link) as usize;
            let numbers = |record: usize| bytemuck::cast::<KdNode, [f32; 4]>(nodes[first + record]);
            let (xy0, xy1, z0, z1) = (numbers(0), numbers(1), numbers(2), numbers(3));
            let square = |xy: [f32; 4], middle: f32, half_size: f32| {
                box_square(point, Vec3::new(xy[0], xy[2], middle), Vec3::new(xy[1], xy[3], half_size))
            };
            let (square0, square1) = (square(xy0, z0[2], z0[3]), square(xy1, z1[0], z1[1]));
            let (link0, link1) = (z0[0].to_bits(), z0[1].to_bits());
            let goes_to1 = square1 < square0;
            let (near, far) = if goes_to1 { (square1, square0) } else { (square0, square1) };
            if far <= limit {
                links[stacked] = if goes_to1 { link0 } else { link1 };
                squares[stacked] = far;
                stacked += 1;
            }
            link = match near <= limit {
                true if goes_to1 => link1,
                true => link0,
                false => BVH_LEAF,
            };
        }
        let first = link & BVH_FIRST_MASK;
        for i in first..first + ((link & !BVH_LEAF) >> BVH_COUNT_SHIFT) {
            let primitive = scene.references()[i as usize];
            let corners = scene.vertices(primitive).map(|corner| corner - point);
            match &mut list {
                None => {
                    *distance = min_or(*distance, farthest_distance(corners));
                    limit = limit_of(*distance);
                }
                Some(list) if least_distance(corners) <= *distance => {
                    list(primitive);
                    count += 1;
                }
                Some(_) => {}
            }
        }
        loop {
            if stacked == 0 {
                return count;
            }
            stacked -= 1;
            link = links[stacked];
            if squares[stacked] <= limit {
                break;
            }
        }
    }
}

/// How many triangles may be the nearest one of a point; `list` gets them.
#[inline(always)]
fn candidates(scene: &PointScene, point: Float4, list: &mut dyn FnMut(u32)) -> u32 {
    let point = point.xyz();
    if !is_finite3(point) {
        return 0;
    }
    let mut distance = f32::INFINITY;
    visit_triangles(scene, point, &mut distance, None);
    visit_triangles(scene, point, &mut distance, Some(list))
}

with_fma! {
    /// How many triangles may be the nearest one of each point, and the first `MOST_CANDIDATES` of them.
    pub fn list_candidates(scene: &PointScene, points: &[Float4], counts: &mut [u32], lists: &mut [u32]) {
        let lists = lists.chunks_exact_mut(MOST_CANDIDATES as usize);
        for ((point, count), list) in points.iter().zip(counts).zip(lists) {
            let mut places = list.iter_mut();
            *count = candidates(scene, *point, &mut |primitive| {
                if let Some(place) = places.next() {
                    *place = primitive;
                }
            });
        }
    }
}

with_fma! {
    /// All triangles that may be the nearest one of a point.
    pub fn all_candidates(scene: &PointScene, point: Float4) -> Vec<u32> {
        let mut all = Vec::new();
        candidates(scene, point, &mut |primitive| all.push(primitive));
        all
    }
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
            let (low, high) = (f64::from(least_distance(given)), f64::from(farthest_distance(given)));
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

    #[test]
    fn boxes_are_not_left_out_too_early() {
        let mut random = Random::new(20_081_122);
        let mut close = 0;
        for i in 0..300_000 {
            let (middle, half_size) = (random.vec3(), random.vec3().abs() * random.size(-20, 0));
            let point = middle + random.vec3() * [0.1, 1.0, 100.0][i % 3];
            let away = (DVec3::from(point) - DVec3::from(middle)).abs() - DVec3::from(half_size);
            let exact = away.max(DVec3::ZERO).length();
            // The least distance that the box is as near as, and one that is a bit less.
            let reached = exact as f32;
            let reached = if f64::from(reached) < exact { reached.next_up() } else { reached };
            assert!(box_square(point, middle, half_size) <= limit_of(reached.max(LEAST_DISTANCE_ERROR)));
            close += usize::from(exact > 0.0 && box_square(point, middle, half_size) > limit_of(0.999 * reached));
        }
        assert!(close > 100_000, "{close}");
    }
}
