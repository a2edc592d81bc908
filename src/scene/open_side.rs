//! From which side a model is seen that is open on one: a room without some of its walls, a stage.
//!
//! Surface faces inward if it is turned to the middle of the model's box. Of figures, cars and solids little does,
//! whatever they are seen from: of most models at most a third of what is seen, of a skeleton half from one side. Of a
//! room without a roof most does that is seen from above, floor and furniture, and from its open side; from behind a
//! wall little does. Of 83 models none but a room is turned.
//!
//! What is seen is found by [`GRID`] x [`GRID`] parallel lines, of which each has the triangle that is nearest to the
//! viewer. Bad at: rooms that are open between two of the four views, and thick masks that lie on their face.

use super::camera::{Axes, picture_axes};
use glam::DVec3;

/// Lines in a row, and rows of lines.
const GRID: usize = 32;

/// Where in its cell of the grid a line is: off the middle and the fractions on which regular models have vertices.
const IN_CELL: [f64; 2] = [0.4786, 0.5331];

/// More than so much of what is seen is most of it.
const HALF: f64 = 0.5;

/// By how many quarter turns about the world's up a camera goes on from the usual direction, so that it sees into a
/// model which it sees from behind a wall otherwise: 0 for most models.
pub(super) fn quarter_turns(
    triangles: impl Iterator<Item = [DVec3; 3]> + Clone,
    bounds: (DVec3, DVec3),
    axes: &Axes,
) -> usize {
    let inward = |back: DVec3, up: DVec3| inward(triangles.clone(), bounds, picture_axes(back, up));
    if inward(axes.up(), axes.back()) <= HALF {
        return 0;
    }
    let of_turn = |turns: usize| inward(axes.turned(turns).automatic(), axes.up());
    if of_turn(0) > HALF {
        return 0;
    }
    let turns = (1..4).map(|turns| (turns, of_turn(turns)));
    let most = turns.fold((0, HALF), |most, next| if next.1 > most.1 { next } else { most });
    most.0
}

/// How much of what is seen in the direction from which `back` leads to the viewer faces inward, of triangles between
/// `low` and `high`.
fn inward(
    triangles: impl Iterator<Item = [DVec3; 3]>,
    (low, high): (DVec3, DVec3),
    [right, up, back]: [DVec3; 3],
) -> f64 {
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    // The box as it is seen, and a whole number for each line.
    let line = |axis: DVec3| axis * (GRID as f64 / 2.0 / axis.abs().dot(half));
    let (across, upwards) = (line(right), line(up));
    let place = |p: DVec3| {
        let p = p - middle;
        let at = |axis: DVec3, i: usize| p.dot(axis) + (GRID as f64 / 2.0 - IN_CELL[i]);
        [at(across, 0), at(upwards, 1), p.dot(back)]
    };
    let mut nearest = [(f64::NEG_INFINITY, false); GRID * GRID];
    for [a, b, c] in triangles {
        let normal = (b - a).cross(c - a);
        let faces_inward = normal.dot(back) > 0.0 && normal.dot(middle - a) > 0.0;
        for (line, depth) in met([a, b, c].map(place)) {
            if depth > nearest[line].0 {
                nearest[line] = (depth, faces_inward);
            }
        }
    }
    let seen = nearest.iter().filter(|(depth, _)| depth.is_finite()).count();
    let inward = nearest.iter().filter(|(_, faces_inward)| *faces_inward).count();
    if seen == 0 { 0.0 } else { inward as f64 / seen as f64 }
}

/// The lines that meet a triangle, and how near to the viewer. Those that a rounding has miss it are a few of many.
fn met([a, b, c]: [[f64; 3]; 3]) -> impl Iterator<Item = (usize, f64)> {
    let range = move |i: usize| {
        let (low, high) = (a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i]));
        let last = (GRID - 1) as f64;
        low.ceil().max(0.0) as usize..(high.floor().min(last) + 1.0).max(0.0) as usize
    };
    let twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    range(1).flat_map(move |y| range(0).map(move |x| (x, y))).filter_map(move |(x, y)| {
        let (dx, dy) = (x as f64 - a[0], y as f64 - a[1]);
        let u = (dx * (c[1] - a[1]) - dy * (c[0] - a[0])) / twice_area;
        let v = ((b[0] - a[0]) * dy - (b[1] - a[1]) * dx) / twice_area;
        let is_in = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        is_in.then(|| (y * GRID + x, a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])))
    })
}

#[cfg(test)]
mod tests {
    use super::super::Viewpoint;
    use super::super::camera::Framing;
    use super::super::room::tests::sides;
    use super::*;
    use glam::Vec3;

    fn turns(triangles: &[[DVec3; 3]], up: Vec3) -> usize {
        let points = || triangles.iter().flatten().copied();
        let bounds = (points().reduce(DVec3::min).unwrap(), points().reduce(DVec3::max).unwrap());
        quarter_turns(triangles.iter().copied(), bounds, &Axes::of(up))
    }

    /// A floor with high walls on some of its four sides: left, right, back, front.
    fn stage(walls: &[usize]) -> Vec<[DVec3; 3]> {
        let wall = |side: &usize| {
            let (low, high) = match side {
                0 => (DVec3::new(-5.0, 0.0, -5.0), DVec3::new(-4.8, 16.0, 5.0)),
                1 => (DVec3::new(4.8, 0.0, -5.0), DVec3::new(5.0, 16.0, 5.0)),
                2 => (DVec3::new(-5.0, 0.0, -5.0), DVec3::new(5.0, 16.0, -4.8)),
                _ => (DVec3::new(-5.0, 0.0, 4.8), DVec3::new(5.0, 16.0, 5.0)),
            };
            sides(low, high, false, &[])
        };
        let floor = sides(DVec3::new(-5.0, -0.2, -5.0), DVec3::new(5.0, 0.0, 5.0), false, &[]);
        walls.iter().flat_map(wall).chain(floor).collect()
    }

    #[test]
    fn rooms_without_some_walls_are_seen_from_their_open_side() {
        // The usual view is from the front, and a little from the right.
        assert_eq!(turns(&stage(&[0, 2]), Vec3::Y), 0);
        assert_eq!(turns(&stage(&[2, 3, 0]), Vec3::Y), 1, "open on the right");
        assert_eq!(turns(&stage(&[1, 3, 0]), Vec3::Y), 2, "open at the back");
        assert_eq!(turns(&stage(&[1, 2, 3]), Vec3::Y), 3, "open on the left");
        assert_eq!(turns(&stage(&[]), Vec3::Y), 0, "a floor alone");
    }

    #[test]
    fn cameras_go_there_unless_somebody_says_where_they_stand() {
        let open_right: Vec<_> = stage(&[2, 3, 0]).iter().map(|triangle| triangle.map(|p| p.as_vec3())).collect();
        let framed = |viewpoint, may_enter| {
            let framing = Framing { viewpoint, up: Vec3::Y, fov_degrees: None, aspect: 1.0, may_enter };
            framing.camera(open_right.iter().copied())
        };
        let turned = framed(None, true);
        assert!(turned.is_turned && turned.camera.eye.x > 0.0 && turned.camera.eye.z < 0.0, "{turned:?}");
        for (viewpoint, may_enter) in [(None, false), (Some(Viewpoint::Front), true)] {
            let usual = framed(viewpoint, may_enter);
            assert!(!usual.is_turned && usual.camera.eye.z > 0.0, "{usual:?}");
        }
    }

    #[test]
    fn all_else_is_seen_from_the_front() {
        let cube = sides(DVec3::splat(-1.0), DVec3::splat(1.0), false, &[]);
        assert_eq!(turns(&cube, Vec3::Y), 0);
        // A box that is open on one side, with a roof.
        for without in 0..6 {
            if without != 3 {
                assert_eq!(turns(&sides(DVec3::splat(-1.0), DVec3::splat(1.0), true, &[without]), Vec3::Y), 0);
            }
        }
        assert_eq!(turns(&[[DVec3::ONE; 3]], Vec3::Y), 0);
        let far = DVec3::splat(f64::from(f32::MAX));
        assert_eq!(turns(&[[far, -far, far * DVec3::X]], Vec3::Z), 0);
    }
}
