//! What of a scene is to be seen when nobody says from where: all of it; what stands on its ground; or, of a room, the
//! inside.
//!
//! Both rules read each triangle a few times and build nothing. Both are about boxes along the axes: a room that stands
//! askew is seen from outside.

use glam::DVec3;

/// What a camera that is placed by itself shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Subject {
    /// The whole scene.
    Everything,
    /// What is left without a few triangles that are much larger: ground, or a backdrop.
    WithoutGround,
    /// The scene from its middle.
    Room,
}

/// The share of the walls towards the camera, and of the rays from the middle, that makes a room. Those of rooms are
/// above it although one wall of a stage or part of a roof is open, and those of other things far below: a ball has no
/// walls, and rays from the middle of a solid meet surfaces from behind.
const MOST: f64 = 0.75;

/// How far from a side of the scene's box its walls lie, of that side's distance from the other one.
const WALL: f64 = 0.02;

/// The largest share of a scene's diagonal that ground leaves for everything else; and the least of it that both legs
/// of a right-angled triangle have which is as large as ground.
const GROUND: f64 = 0.25;

/// What to show of triangles between `low` and `high` from a camera that stands in the direction `back`, which may
/// enter a room.
pub(super) fn subject(
    triangles: impl Iterator<Item = [DVec3; 3]> + Clone,
    (low, high): (DVec3, DVec3),
    back: Option<DVec3>,
) -> Subject {
    if back.is_some_and(|back| {
        has_walls(triangles.clone(), (low, high), back) && is_hollow(triangles.clone(), (low, high))
    }) {
        return Subject::Room;
    }
    let diagonal = (high - low).length();
    let rest = triangles.filter(|triangle| !is_ground(triangle, diagonal)).flatten();
    let bounds = rest.fold(None, |bounds: Option<(DVec3, DVec3)>, p| {
        Some(bounds.map_or((p, p), |(low, high)| (low.min(p), high.max(p))))
    });
    let is_small = bounds.is_some_and(|(low, high)| (high - low).length() < GROUND * diagonal);
    if is_small { Subject::WithoutGround } else { Subject::Everything }
}

/// Whether a triangle is as large as ground in a scene of this diagonal. Its area tells: a long stick, which a model
/// may stand on, has little.
pub(super) fn is_ground([a, b, c]: &[DVec3; 3], diagonal: f64) -> bool {
    (b - a).cross(c - a).length() > (GROUND * diagonal).powi(2)
}

/// Whether most of the three sides of the box that a camera in the direction `back` sees are walls.
fn has_walls(triangles: impl Iterator<Item = [DVec3; 3]>, (low, high): (DVec3, DVec3), back: DVec3) -> bool {
    let size = high - low;
    let of_side = DVec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
    let towards = DVec3::select(back.cmpgt(DVec3::ZERO), high, low);
    let wall = triangles.fold(DVec3::ZERO, |wall, [a, b, c]| {
        let distance = (a - towards).abs().max((b - towards).abs()).max((c - towards).abs());
        let lies_in = distance.cmple(WALL * size);
        wall + DVec3::select(lies_in, (b - a).cross(c - a).abs() / 2.0, DVec3::ZERO)
    });
    // Where walls lie in two layers no more is closed.
    let total = of_side.element_sum();
    total > 0.0 && wall.min(of_side).element_sum() >= MOST * total
}

/// Whether the middle of the box is in the open, with surface all around: rays to all sides meet it from the front.
fn is_hollow(triangles: impl Iterator<Item = [DVec3; 3]>, (low, high): (DVec3, DVec3)) -> bool {
    const RAYS: usize = 64;
    let (middle, size) = ((low + high) / 2.0, high - low);
    let directions: [DVec3; RAYS] = std::array::from_fn(|i| {
        // Spread over the sphere by the golden angle (Vogel, "A better way to construct the sunflower head", 1979), and
        // stretched as the box is.
        const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
        let height = 1.0 - (2 * i + 1) as f64 / RAYS as f64;
        let (sine, cosine) = (GOLDEN_ANGLE * i as f64).sin_cos();
        let radius = (1.0 - height * height).sqrt();
        DVec3::new(radius * cosine, height, radius * sine) * size
    });
    let closest = closest(triangles, middle, directions);
    let hits = closest.iter().filter(|(t, _)| t.is_finite()).count() as f64;
    let fronts = closest.iter().filter(|(_, is_front)| *is_front).count() as f64;
    hits >= MOST * RAYS as f64 && fronts >= MOST * hits
}

/// How far rays from `origin` go until they meet a triangle, in lengths of their directions, and whether they meet it
/// from the front.
fn closest<const RAYS: usize>(
    triangles: impl Iterator<Item = [DVec3; 3]>,
    origin: DVec3,
    directions: [DVec3; RAYS],
) -> [(f64, bool); RAYS] {
    let mut closest = [(f64::INFINITY, false); RAYS];
    for [a, b, c] in triangles {
        let (edge1, edge2, from_a) = (b - a, c - a, origin - a);
        let normal = edge1.cross(edge2);
        let moment = from_a.dot(normal);
        for (direction, closest) in directions.iter().zip(&mut closest) {
            // Möller & Trumbore's triple products; one that misses for a rounding is one of many.
            let determinant = -direction.dot(normal);
            let turned = from_a.cross(*direction);
            let (t, u, v) = (moment / determinant, edge2.dot(turned) / determinant, -edge1.dot(turned) / determinant);
            if t > 0.0 && t < closest.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                *closest = (t, determinant > 0.0);
            }
        }
    }
    closest
}

/// How far one can go from `origin` by `way`, in parts of it up to 1, until something is in the way.
pub(super) fn free_way(triangles: impl Iterator<Item = [DVec3; 3]>, origin: DVec3, way: DVec3) -> f64 {
    let [(t, _)] = closest(triangles, origin, [way]);
    t.min(1.0)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::camera::Axes;
    use super::*;
    use glam::Vec3;

    /// The sides of a box, seen from outside; `inward`: from inside. Without those whose numbers are left out.
    pub fn sides(low: DVec3, high: DVec3, inward: bool, without: &[usize]) -> Vec<[DVec3; 3]> {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let side = |i: usize| {
            let (n, u, v) = (axes[i / 2], axes[(i / 2 + 1) % 3], axes[(i / 2 + 2) % 3]);
            let (is_high, size) = (i % 2 == 1, high - low);
            let corner = low + if is_high { n * size } else { DVec3::ZERO };
            let [a, b, c, d] = [corner, corner + u * size, corner + (u + v) * size, corner + v * size];
            if is_high != inward { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] }
        };
        (0..6).filter(|i| !without.contains(i)).flat_map(side).collect()
    }

    fn found(triangles: &[[DVec3; 3]]) -> Subject {
        let points = || triangles.iter().flatten().copied();
        let bounds = (points().reduce(DVec3::min).unwrap(), points().reduce(DVec3::max).unwrap());
        subject(triangles.iter().copied(), bounds, Some(Axes::of(Vec3::Y).automatic()))
    }

    #[test]
    fn rooms_are_entered_and_solids_are_not() {
        let (low, high) = (DVec3::new(-3.0, 0.0, -5.0), DVec3::new(3.0, 2.5, 4.0));
        let table = sides(DVec3::new(1.0, 0.0, 1.0), DVec3::new(2.0, 1.0, 2.0), false, &[]);
        let room = |without: &[usize]| [sides(low, high, true, without), table.clone()].concat();
        assert_eq!(found(&room(&[])), Subject::Room);
        assert_eq!(found(&room(&[4])), Subject::Room, "open where the camera does not see it");
        assert_ne!(found(&room(&[3])), Subject::Room, "open at the top, which is what the camera sees most of");
        // Walls of some thickness: the outside is turned outward.
        let thick = [sides(low - 0.3, high + 0.3, false, &[]), room(&[])].concat();
        assert_eq!(found(&thick), Subject::Room);
        // Solid ones.
        assert_ne!(found(&sides(low, high, false, &[])), Subject::Room);
        let inner = sides(low / 2.0, high / 2.0, false, &[]);
        assert_ne!(found(&[sides(low, high, false, &[]), inner].concat()), Subject::Room);
        // A hollow thing without walls along the axes: a double pyramid, turned inward.
        let tips = [DVec3::Y, DVec3::NEG_Y];
        let around = [DVec3::X, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Z];
        let double = tips.iter().flat_map(|&tip| {
            (0..4).map(move |i| {
                let (a, b) = (around[i], around[(i + 1) % 4]);
                if tip.y > 0.0 { [tip, a, b] } else { [tip, b, a] }
            })
        });
        assert_ne!(found(&double.collect::<Vec<_>>()), Subject::Room);
    }

    #[test]
    fn ground_is_what_is_much_larger_than_all_else() {
        let ground = |side: f64| {
            let [a, b, c, d] = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
            vec![[a * side, b * side, c * side], [a * side, c * side, d * side]]
        };
        let model = sides(DVec3::splat(-1.0), DVec3::splat(1.0), false, &[]);
        for (side, expected) in [
            (1.0, Subject::Everything),
            (4.0, Subject::Everything),
            (6.0, Subject::WithoutGround),
            (1e6, Subject::WithoutGround),
        ] {
            assert_eq!(found(&[ground(side), model.clone()].concat()), expected, "{side}");
        }
        assert_eq!(found(&ground(9.0)), Subject::Everything, "nothing stands on it");
        // A lollipop keeps its stick.
        let stick = sides(DVec3::new(-0.1, -20.0, -0.1), DVec3::new(0.1, -1.0, 0.1), false, &[]);
        assert_eq!(found(&[stick, model.clone()].concat()), Subject::Everything);
        // Two models far apart are both seen.
        let other: Vec<_> = model.iter().map(|t| t.map(|p| p + DVec3::X * 99.0)).collect();
        assert_eq!(found(&[ground(100.0), model, other].concat()), Subject::Everything);
    }

    #[test]
    fn scenes_of_nothing_and_of_no_extent_are_seen_as_they_are() {
        let bounds = (DVec3::ZERO, DVec3::ZERO);
        assert_eq!(subject(std::iter::empty(), bounds, Some(DVec3::ONE)), Subject::Everything);
        assert_eq!(found(&[[DVec3::ONE; 3]]), Subject::Everything);
        let far = DVec3::splat(f64::from(f32::MAX));
        assert_eq!(found(&[[far, -far, far * DVec3::X]]), Subject::Everything);
    }
}
