//! The pinhole camera, and where it stands to show a scene.

use super::open_side::quarter_turns;
use super::room::{Subject, free_way, is_ground, subject};
use super::{Scene, Viewpoint};
use crate::parallel;
use glam::{DVec3, Vec3};

/// The vertical field of view of a camera of which nobody says it, degrees.
pub(super) const FOV_DEGREES: f32 = 40.0;

/// The same inside of a scene: walls of a room are near, so that more than a quarter of it is seen.
pub(super) const INSIDE_FOV_DEGREES: f32 = 65.0;

/// How much of the way from the middle of a room to what is behind a camera steps back: the rest keeps it out of walls.
const STEP_BACK: f64 = 0.9;

/// Where the lamp of a room hangs, in parts of the way from the middle to where a camera steps back to, from there up
/// to what is above, and from there to what is on the left. From the camera itself it would light walls and what stands
/// before them alike, without shadows; and under the ceiling that would have none of its light.
const LAMP_BACK: f64 = 0.4;
const LAMP_UP: f64 = 0.7;
const LAMP_LEFT: f64 = 0.5;

/// A pinhole camera that looks from `eye` towards `target`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position, world units.
    pub eye: Vec3,
    /// The point in the middle of the picture.
    pub target: Vec3,
    /// Which way is up; need not be perpendicular to the view nor of unit length.
    pub up: Vec3,
    /// Vertical field of view, degrees, in (0, 180).
    pub fov_degrees: f32,
}

impl Camera {
    /// A camera that shows all `points` from the front, a little from the right and above, in a picture of `aspect` =
    /// width / height, where y is up. Without points it looks at the origin.
    pub fn framing(points: impl Iterator<Item = Vec3> + Clone, aspect: f32) -> Camera {
        let framing = Framing { viewpoint: None, up: Vec3::Y, fov_degrees: None, aspect, may_enter: false };
        framing.camera(points.map(|point| [point; 3])).camera
    }
}

/// A camera in place of another in pictures that are wider than an aspect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WideCamera {
    /// Width / height, above 0.
    pub aspect: f32,
    /// The camera. Its field of view is that of a picture of this aspect: a wider one shows as much across, and less
    /// above and below.
    pub camera: Camera,
}

impl WideCamera {
    /// The camera of a picture of `aspect` = width / height, which is wider.
    fn at(&self, aspect: f32) -> Camera {
        let (_, tan_y) = tangents(self.camera.fov_degrees, self.aspect);
        let half = (tan_y * f64::from(self.aspect) / f64::from(aspect)).atan();
        Camera { fov_degrees: (2.0 * half).to_degrees() as f32, ..self.camera }
    }

    /// Which of `camera` and the ones for wider pictures, by rising aspect, a picture of `aspect` has.
    pub(crate) fn choose(camera: Option<Camera>, wide: &[WideCamera], aspect: f32) -> Option<Camera> {
        let widest = wide.iter().rev().find(|wide| wide.aspect < aspect);
        widest.map(|wide| wide.at(aspect)).or(camera)
    }
}

/// The directions of a world, unit vectors perpendicular to each other: `right` x `up` = `front`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axes {
    right: DVec3,
    up: DVec3,
    front: DVec3,
}

impl Axes {
    /// Of the world where `up` is up. Its right is x as far as `up` lets it, so that the front is z where y is up, and
    /// -y where z is up, as modelling programs have it. Where x is up, the front is z.
    pub fn of(up: Vec3) -> Axes {
        let up = up.as_dvec3().normalize_or(DVec3::Y);
        let is_along_x = up.x.abs() >= up.y.abs().max(up.z.abs());
        let right = if is_along_x { up.cross(DVec3::Z) } else { DVec3::X - up * up.x }.normalize();
        Axes { right, up, front: right.cross(up) }
    }

    pub fn up(&self) -> DVec3 {
        self.up
    }

    pub fn front(&self) -> DVec3 {
        self.front
    }

    pub fn back(&self) -> DVec3 {
        -self.front
    }

    /// These, after so many quarter turns about up: after one the front is where the right was.
    pub fn turned(&self, quarters: usize) -> Axes {
        (0..quarters).fold(*self, |axes, _| Axes { right: -axes.front, front: axes.right, ..axes })
    }

    /// The direction in which a camera stands that nobody places: in front, a little to the right and above.
    pub fn automatic(&self) -> DVec3 {
        self.right * 0.45 + self.up * 0.35 + self.front * 0.82
    }

    /// The direction in which a camera stands that looks from `viewpoint`, and what is up in its picture.
    fn of_view(&self, viewpoint: Option<Viewpoint>) -> (DVec3, DVec3) {
        let Axes { right, up, front } = *self;
        match viewpoint {
            None => (self.automatic(), up),
            Some(Viewpoint::Front | Viewpoint::Inside) => (front, up),
            Some(Viewpoint::Back) => (-front, up),
            Some(Viewpoint::Left) => (-right, up),
            Some(Viewpoint::Right) => (right, up),
            Some(Viewpoint::Top) => (up, -front),
            Some(Viewpoint::Bottom) => (-up, front),
            Some(Viewpoint::Iso) => (right + up + front, up),
        }
    }
}

/// What a camera that is placed by itself depends on, beside the points that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Framing {
    /// From where; `None`: from the front, a little from the right and above.
    pub viewpoint: Option<Viewpoint>,
    /// What is up in the world; not zero.
    pub up: Vec3,
    /// Vertical, degrees; `None`: as is usual.
    pub fov_degrees: Option<f32>,
    /// Width / height of the picture.
    pub aspect: f32,
    /// Whether a room is seen from inside, where the viewpoint is open.
    pub may_enter: bool,
}

/// A camera that was placed by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Framed {
    pub camera: Camera,
    /// What it shows.
    pub subject: Subject,
    /// Whether it stands elsewhere than usual, where the scene is open.
    pub is_turned: bool,
    /// Where a lamp hangs in the room that it shows, if it shows one.
    pub lamp: Option<Vec3>,
}

/// A little air around the model.
const MARGIN: f64 = 1.06;

/// How far away a camera must be whose picture shows the point that lies at `p` from the picture's middle: its distance
/// aside is at most a tangent times its distance ahead.
fn distance_to_show(p: DVec3, [right, up, back]: [DVec3; 3], (tan_x, tan_y): (f64, f64)) -> f64 {
    MARGIN * (p.dot(right).abs() / tan_x).max(p.dot(up).abs() / tan_y) + p.dot(back)
}

/// The directions to the right, up and back of a camera that stands in the direction `back` and has `up` upwards.
pub(super) fn picture_axes(back: DVec3, up: DVec3) -> [DVec3; 3] {
    let back = back.normalize();
    let right = up.cross(back).normalize();
    [right, back.cross(right), back]
}

/// The tangents of half the angles of view across and up.
fn tangents(fov_degrees: f32, aspect: f32) -> (f64, f64) {
    let tan_y = (f64::from(fov_degrees).to_radians() / 2.0).tan();
    (tan_y * f64::from(aspect), tan_y)
}

/// How far from its target `camera`, which was placed as it is `framed`, must be to show the same from all
/// `directions`, each with what is up.
pub(super) fn orbit_distance(
    scene: &Scene,
    framed: (Framing, Framed),
    camera: &Camera,
    directions: &[(DVec3, DVec3)],
    aspect: f32,
) -> f64 {
    let (low, high) = scene.bounds().unwrap_or_default();
    let diagonal = (high.as_dvec3() - low.as_dvec3()).length();
    let shows_all = framed.1.subject == Subject::Everything;
    let axes: Vec<_> = directions.iter().map(|&(back, up)| picture_axes(back, up)).collect();
    let (target, tangents) = (camera.target.as_dvec3(), tangents(camera.fov_degrees, aspect));
    let of_point = |p: DVec3| axes.iter().map(|&axes| distance_to_show(p - target, axes, tangents)).fold(0.0, f64::max);
    let hittable = scene.hittable();
    let of_triangle = |i: usize| {
        let triangle = scene.vertices(hittable[i] as usize).map(DVec3::from);
        let is_shown = shows_all || !is_ground(&triangle, diagonal);
        if is_shown { triangle.into_iter().map(of_point).fold(0.0, f64::max) } else { 0.0 }
    };
    parallel::reduce_numbers(hittable.len(), 0.0, of_triangle, f64::max)
}

impl Framing {
    /// A camera that shows `triangles`, or looks about among them. Without triangles it looks at the origin.
    pub fn camera(&self, triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> Framed {
        // f64: the extent of a scene near the largest float overflows float32
        let triangles = triangles.map(|triangle| triangle.map(DVec3::from));
        let axes = Axes::of(self.up);
        let (low, high) = bounds(triangles.clone());
        let may_enter = self.may_enter && self.viewpoint.is_none();
        let subject = match self.viewpoint {
            Some(Viewpoint::Inside) => Subject::Room,
            _ => subject(triangles.clone(), (low, high), may_enter.then(|| axes.automatic())),
        };
        if subject == Subject::Room {
            let (camera, lamp) = self.inside(&axes, (low + high) / 2.0, triangles);
            return Framed { camera, subject, is_turned: false, lamp: Some(lamp) };
        }

        let turns = match may_enter && subject == Subject::Everything {
            true => quarter_turns(triangles.clone(), (low, high), &axes),
            false => 0,
        };
        let diagonal = (high - low).length();
        let shown = triangles.filter(|triangle| subject == Subject::Everything || !is_ground(triangle, diagonal));
        let (low, high) = bounds(shown.clone());
        let center = (low + high) / 2.0;
        let fov_degrees = self.fov_degrees.unwrap_or(FOV_DEGREES);
        let (back, up) = axes.turned(turns).of_view(self.viewpoint);
        let axes = picture_axes(back, up);
        let [.., back] = axes;
        // Every point must lie inside the pyramid of view.
        let tangents = tangents(fov_degrees, self.aspect);
        let distance = shown.flatten().map(|p| distance_to_show(p - center, axes, tangents)).fold(0.0, f64::max);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let eye = (center + back * distance).as_vec3();
        let camera = Camera { eye, target: center.as_vec3(), up: self.up, fov_degrees };
        Framed { camera, subject, is_turned: turns > 0, lamp: None }
    }

    /// A camera in the middle of the triangles' box that looks along the longer of its horizontal sides: to the right,
    /// or away from the front; but the other way where much more surface lies, as the end of a room may be open. Where
    /// nobody asked for the inside, it steps back from the middle as far as there is room, to show more. And the place
    /// of a lamp that it sees walls, corners and form by.
    fn inside(
        &self,
        axes: &Axes,
        center: DVec3,
        triangles: impl Iterator<Item = [DVec3; 3]> + Clone,
    ) -> (Camera, Vec3) {
        let points = triangles.clone().flatten();
        let reach = |axis: DVec3| points.clone().map(|p| (p - center).dot(axis).abs()).fold(0.0, f64::max);
        let (across, along) = (reach(axes.right), reach(axes.front));
        let (ahead, distance) = if across > along { (axes.right, across) } else { (axes.back(), along) };
        // Where the middle of the surface is, from -1 behind the camera to 1 before it.
        let (moment, area) = triangles.clone().fold((0.0, 0.0), |(moment, area), [a, b, c]| {
            let of_triangle = (b - a).cross(c - a).length();
            (moment + of_triangle * ((a + b + c) / 3.0 - center).dot(ahead), area + of_triangle)
        });
        // Without one end the middle of a cube's surface is at 0.2: a quarter of that is more than furniture does.
        const OPEN_END: f64 = -0.05;
        let is_behind = moment < OPEN_END * area * distance;
        let ahead = if is_behind { -ahead } else { ahead };
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let back = STEP_BACK * distance * free_way(triangles.clone(), center, -ahead * distance);
        let step = if self.viewpoint.is_none() { back } else { 0.0 };
        let camera = Camera {
            eye: (center - ahead * step).as_vec3(),
            target: (center + ahead * distance).as_vec3(),
            up: self.up,
            fov_degrees: self.fov_degrees.unwrap_or(INSIDE_FOV_DEGREES),
        };
        // From the line to the middle, along which nothing is in the way, up and then to the left as far as there is
        // room.
        let toward = |from: DVec3, axis: DVec3, share: f64| {
            let way = axis * reach(axis);
            from + way * share * free_way(triangles.clone(), from, way)
        };
        let above = toward(center - ahead * back * LAMP_BACK, axes.up, LAMP_UP);
        let lamp = toward(above, axes.up.cross(ahead), LAMP_LEFT);
        (camera, lamp.as_vec3())
    }
}

/// The smallest box around triangles; around the origin where there are none.
fn bounds(triangles: impl Iterator<Item = [DVec3; 3]> + Clone) -> (DVec3, DVec3) {
    let points = triangles.flatten();
    (points.clone().reduce(DVec3::min).unwrap_or_default(), points.reduce(DVec3::max).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners of a box, each as a triangle without area.
    fn corners(low: Vec3, high: Vec3) -> impl Iterator<Item = [Vec3; 3]> + Clone {
        let side = move |i: u32, bit: u32| i >> bit & 1 != 0;
        let pick = move |i: u32| Vec3::select(glam::BVec3::new(side(i, 0), side(i, 1), side(i, 2)), high, low);
        (0..8).map(move |i| [pick(i); 3])
    }

    #[test]
    fn axes_are_right_handed_and_keep_x_to_the_right() {
        for (up, right, front) in [
            (Vec3::Y, DVec3::X, DVec3::Z),
            (Vec3::Z, DVec3::X, DVec3::NEG_Y),
            (Vec3::NEG_Y, DVec3::X, DVec3::NEG_Z),
            (Vec3::NEG_Z, DVec3::X, DVec3::Y),
            (Vec3::X * 3.0, DVec3::NEG_Y, DVec3::Z),
            (Vec3::NEG_X, DVec3::Y, DVec3::Z),
        ] {
            let axes = Axes::of(up);
            assert_eq!((axes.right, axes.front), (right, front), "{up}");
        }
        for up in [Vec3::new(1.0, 1.0, 1.0), Vec3::new(-3.0, 0.1, 2.9), Vec3::new(1e-30, 2e-30, 0.0), Vec3::MAX] {
            let Axes { right, up: unit, front } = Axes::of(up);
            let products = [right.dot(unit), right.dot(front), unit.dot(front), right.cross(unit).dot(front) - 1.0];
            assert!(products.iter().all(|product| product.abs() < 1e-14), "{up}: {products:?}");
        }
    }

    /// Every corner lies inside the pyramid of view, and one almost at its rim: whatever is looked from.
    #[test]
    fn everything_is_in_the_picture_and_fills_it() {
        let viewpoints = Viewpoint::ALL.iter().filter(|&&viewpoint| viewpoint != Viewpoint::Inside).copied();
        for viewpoint in [None].into_iter().chain(viewpoints.map(Some)) {
            for up in [Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::new(1.0, 2.0, 3.0)] {
                for (fov_degrees, aspect) in [(40.0, 1.5), (90.0, 0.5), (10.0, 1.0)] {
                    let framing = Framing { viewpoint, up, fov_degrees: Some(fov_degrees), aspect, may_enter: true };
                    let corners = corners(Vec3::new(-1.0, 4.0, 2.0), Vec3::new(3.0, 5.0, 9.0));
                    let camera = framing.camera(corners.clone()).camera;
                    let eye = camera.eye.as_dvec3();
                    let forward = (camera.target.as_dvec3() - eye).normalize();
                    let picture_up = match viewpoint {
                        Some(Viewpoint::Top | Viewpoint::Bottom) => Axes::of(up).front,
                        _ => Axes::of(up).up,
                    };
                    let right = forward.cross(picture_up).normalize();
                    let half = (f64::from(fov_degrees).to_radians() / 2.0).tan();
                    let reach = |p: DVec3| {
                        let ahead = (p - eye).dot(forward);
                        assert!(ahead > 0.0, "{viewpoint:?} {up}");
                        let [x, y] = [right, right.cross(forward)].map(|axis| (p - eye).dot(axis).abs() / ahead / half);
                        (x / f64::from(aspect)).max(y)
                    };
                    let most = corners.map(|[p, ..]| reach(p.into())).fold(0.0, f64::max);
                    assert!((0.85..1.0).contains(&most), "{viewpoint:?} {up} {fov_degrees} {aspect}: {most}");
                }
            }
        }
    }

    /// A room with a table in it, all turned inward but that.
    #[test]
    fn a_room_is_seen_from_its_end_unless_something_is_in_the_way() {
        let sides = |low: Vec3, high: Vec3, inward: bool| {
            let at = move |x: bool, y: bool, z: bool| Vec3::select(glam::BVec3::new(x, y, z), high, low);
            let quads = [
                [at(false, false, false), at(false, false, true), at(false, true, true), at(false, true, false)],
                [at(true, false, false), at(true, true, false), at(true, true, true), at(true, false, true)],
                [at(false, false, false), at(true, false, false), at(true, false, true), at(false, false, true)],
                [at(false, true, false), at(false, true, true), at(true, true, true), at(true, true, false)],
                [at(false, false, false), at(false, true, false), at(true, true, false), at(true, false, false)],
                [at(false, false, true), at(true, false, true), at(true, true, true), at(false, true, true)],
            ];
            let triangles = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
            triangles.map(|[a, b, c]| if inward { [a, c, b] } else { [a, b, c] }).collect::<Vec<_>>()
        };
        let (low, high) = (Vec3::new(-5.0, 0.0, -2.0), Vec3::new(5.0, 3.0, 2.0));
        let camera = |triangles: &[[Vec3; 3]], may_enter| {
            let framing = Framing { viewpoint: None, up: Vec3::Y, fov_degrees: None, aspect: 1.5, may_enter };
            framing.camera(triangles.iter().copied())
        };
        let room = sides(low, high, true);
        let Framed { camera: inside, subject, lamp, .. } = camera(&room, true);
        assert_eq!((subject, inside.fov_degrees), (Subject::Room, INSIDE_FOV_DEGREES));
        assert_eq!((inside.eye, inside.target), (Vec3::new(-4.5, 1.5, 0.0), Vec3::new(5.0, 1.5, 0.0)));
        // Between camera and middle, under the ceiling, on the left.
        assert!(lamp.unwrap().distance(Vec3::new(-1.8, 2.55, -1.0)) < 1e-5, "{lamp:?}");
        // A cupboard from which a tenth is left to the middle.
        let cupboard = sides(Vec3::new(-3.0, 1.0, -0.5), Vec3::new(-2.0, 2.0, 0.5), false);
        let Framed { camera: before_it, lamp, .. } = camera(&[room.clone(), cupboard].concat(), true);
        assert_eq!(before_it.eye, Vec3::new(-1.8, 1.5, 0.0));
        assert!(lamp.unwrap().distance(Vec3::new(-0.72, 2.55, -1.0)) < 1e-5, "{lamp:?}");
        // What hangs from the ceiling is above the lamp, not around it.
        let beam = sides(Vec3::new(-2.2, 2.0, -1.0), Vec3::new(-1.4, 3.0, 2.0), false);
        let lamp = camera(&[room.clone(), beam].concat(), true).lamp;
        assert!(lamp.unwrap().distance(Vec3::new(-1.8, 1.85, -1.0)) < 1e-5, "{lamp:?}");
        // Where it may not enter, and where it is no room.
        assert_eq!(camera(&room, false).subject, Subject::Everything);
        assert_eq!(camera(&sides(low, high, false), true).subject, Subject::Everything);
    }

    #[test]
    fn inside_looks_along_the_longer_side_and_to_the_closed_end() {
        let inside = |up, triangles: &[[Vec3; 3]]| {
            let viewpoint = Some(Viewpoint::Inside);
            let framing = Framing { viewpoint, up, fov_degrees: None, aspect: 1.0, may_enter: true };
            let camera = framing.camera(triangles.iter().copied()).camera;
            (camera.eye, (camera.target - camera.eye).normalize())
        };
        let high = Vec3::new(6.0, 9.0, 2.0);
        let long: Vec<_> = corners(Vec3::ZERO, high).collect();
        assert_eq!(inside(Vec3::Y, &long), (high / 2.0, Vec3::X));
        assert_eq!(inside(Vec3::Z, &long), (high / 2.0, Vec3::Y)); // away from the front, which is -y
        assert_eq!(inside(Vec3::X, &long), (high / 2.0, Vec3::NEG_Y)); // to the right
        let wall = |x: f32| [Vec3::new(x, 0.0, 0.0), Vec3::new(x, 9.0, 0.0), Vec3::new(x, 9.0, 2.0)];
        let closed_at = |x: f32| [long.clone(), vec![wall(x)]].concat();
        assert_eq!(inside(Vec3::Y, &closed_at(0.0)).1, Vec3::NEG_X);
        assert_eq!(inside(Vec3::Y, &closed_at(6.0)).1, Vec3::X);
    }
}
