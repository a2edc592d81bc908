//! A camera that is moved by hand: around its target, along the picture, to and fro, through the scene.
//!
//! Moves are in f64, so that many small ones do not add up to roundings. What is up stays up: the camera turns around
//! that direction and never looks along it. A move that would make a camera which sees nothing is left out.

use raybrook::Camera;
use raybrook::glam::DVec3;
use raybrook::low_level::scene::Aim;
use serde::Deserialize;
use std::f64::consts::PI;

/// How near to straight up or down a camera looks, radians: about half a degree.
const LEAST_TILT: f64 = 0.01;

/// A move. Lengths along the picture are in its heights.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Move {
    /// Around the target, as if the scene was dragged right and down; a height is half a turn.
    Orbit([f64; 2]),
    /// Along the picture, as if the scene was dragged right and down.
    Pan([f64; 2]),
    /// Towards the target: its distance is multiplied by e to the power of minus this.
    Zoom(f64),
    /// Right, up and ahead, in diagonals of the scene.
    Fly([f64; 3]),
    /// Looks elsewhere from the same place, right and down; a height is half a turn.
    Look([f64; 2]),
    /// Looks at this point, world units, from the same place.
    Target([f64; 3]),
    /// Back to the first camera.
    Reset,
}

impl Move {
    /// The largest number of a move that hands make; more is no move.
    const MOST: f64 = 1000.0;

    /// Whether hands make such a move.
    pub fn is_usual(&self) -> bool {
        match self {
            Move::Orbit(by) | Move::Pan(by) | Move::Look(by) => by.iter().all(|x| x.abs() <= Self::MOST),
            Move::Zoom(by) => by.abs() <= Self::MOST,
            Move::Fly(by) => by.iter().all(|x| x.abs() <= Self::MOST),
            Move::Target(at) => at.iter().all(|x| x.is_finite()),
            Move::Reset => true,
        }
    }
}

/// A camera and what it takes to move it.
#[derive(Debug, Clone)]
pub struct Navigator {
    first: Camera,
    eye: DVec3,
    target: DVec3,
    /// Diagonal of the scene, world units.
    diagonal: f64,
    has_moved: bool,
}

impl Navigator {
    /// Starts with `camera` in a scene of that diagonal.
    pub fn new(camera: Camera, diagonal: f64) -> Navigator {
        let (eye, target) = (camera.eye.into(), camera.target.into());
        Navigator { first: camera, eye, target, diagonal, has_moved: false }
    }

    /// Where the camera is now.
    pub fn camera(&self) -> Camera {
        if !self.has_moved {
            return self.first;
        }
        Camera { eye: self.eye.as_vec3(), target: self.target.as_vec3(), ..self.first }
    }

    /// Takes over another scene: a camera that nobody moved is its first one.
    pub fn follow(&mut self, camera: Camera, diagonal: f64) {
        let next = Navigator::new(camera, diagonal);
        *self = if self.has_moved { Navigator { first: camera, diagonal, ..self.clone() } } else { next };
    }

    /// Moves the camera; not at all where it would see nothing.
    pub fn apply(&mut self, by: Move) {
        let mut next = self.clone();
        next.has_moved = true;
        match by {
            Move::Orbit([right, down]) => next.eye = self.target + self.turned(self.offset(), -right * PI, -down * PI),
            Move::Look([right, down]) => next.target = self.eye - self.turned(self.offset(), -right * PI, -down * PI),
            Move::Pan([right, down]) => next.shift(self.along([-right, down, 0.0]) * self.picture_height()),
            Move::Fly(by) => next.shift(self.along(by) * self.diagonal),
            Move::Zoom(by) => next.eye = self.target + self.offset() * (-by).exp(),
            Move::Target(at) => next.target = at.into(),
            Move::Reset => next = Navigator::new(self.first, self.diagonal),
        }
        if next.sees() {
            *self = next;
        }
    }

    /// Whether the camera has a place and a direction, as float32 has them.
    fn sees(&self) -> bool {
        let camera = self.camera();
        camera.eye.is_finite() && camera.target.is_finite() && Aim::from(camera).check().is_ok()
    }

    /// From the target to the eye.
    fn offset(&self) -> DVec3 {
        self.eye - self.target
    }

    /// What is up, of unit length.
    fn up(&self) -> DVec3 {
        DVec3::from(self.first.up).normalize_or(DVec3::Y)
    }

    /// The height of the picture where the target is, world units.
    fn picture_height(&self) -> f64 {
        2.0 * (f64::from(self.first.fov_degrees).to_radians() / 2.0).tan() * self.offset().length()
    }

    /// The direction of a move right, up and ahead in the picture.
    fn along(&self, [right, up, ahead]: [f64; 3]) -> DVec3 {
        let forward = -self.offset().normalize_or(DVec3::Z);
        let side = forward.cross(self.up()).normalize_or(forward.any_orthonormal_vector());
        side * right + side.cross(forward) * up + forward * ahead
    }

    fn shift(&mut self, by: DVec3) {
        self.eye += by;
        self.target += by;
    }

    /// `offset` turned around what is up, then away from it; of the same length, and never along it.
    fn turned(&self, offset: DVec3, around: f64, away: f64) -> DVec3 {
        let up = self.up();
        let (sine, cosine) = around.sin_cos();
        let level = offset - up * offset.dot(up);
        // A camera that looks along what is up begins to turn from any side.
        let level = level.normalize_or(up.any_orthonormal_vector());
        let level = level * cosine + up.cross(level) * sine;
        let angle = offset.dot(up).atan2((offset - up * offset.dot(up)).length());
        let most = PI / 2.0 - LEAST_TILT;
        let (height, reach) = (angle - away).clamp(-most, most).sin_cos();
        (level * reach + up * height) * offset.length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::glam::Vec3;

    fn navigator() -> Navigator {
        let (eye, target, up) = (Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, Vec3::Y);
        Navigator::new(Camera { eye, target, up, fov_degrees: 90.0 }, 2.0)
    }

    fn after(moves: &[Move]) -> Camera {
        let mut navigator = navigator();
        moves.iter().for_each(|&by| navigator.apply(by));
        navigator.camera()
    }

    #[track_caller]
    fn assert_near(found: Vec3, expected: Vec3) {
        assert!(found.distance(expected) < 1e-5, "{found}, not {expected}");
    }

    #[test]
    fn moves_go_where_the_hand_goes() {
        // Dragging right brings the left side to the front, dragging down the top.
        assert_near(after(&[Move::Orbit([0.5, 0.0])]).eye, Vec3::new(-4.0, 0.0, 0.0));
        let side = std::f32::consts::FRAC_1_SQRT_2 * 4.0;
        assert_near(after(&[Move::Orbit([0.0, 0.25])]).eye, Vec3::new(0.0, side, side));
        // A picture of 90 degrees is twice as high as its target is far.
        let panned = after(&[Move::Pan([0.5, 0.25])]);
        assert_near(panned.eye, Vec3::new(-4.0, 2.0, 4.0));
        assert_near(panned.target, Vec3::new(-4.0, 2.0, 0.0));
        assert_near(after(&[Move::Zoom(2f64.ln())]).eye, Vec3::new(0.0, 0.0, 2.0));
        let flown = after(&[Move::Fly([0.5, 1.0, 2.0])]);
        assert_near(flown.eye, Vec3::new(1.0, 2.0, 0.0));
        assert_near(flown.target, Vec3::new(1.0, 2.0, -4.0));
        assert_near(after(&[Move::Look([0.5, 0.0])]).target, Vec3::new(4.0, 0.0, 4.0));
        assert_near(after(&[Move::Look([0.0, 0.25])]).target, Vec3::new(0.0, -side, 4.0 - side));
        assert_near(after(&[Move::Target([1.0, 2.0, 3.0])]).target, Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(after(&[Move::Orbit([0.3, 0.2]), Move::Reset]), navigator().camera());
    }

    #[test]
    fn the_camera_never_turns_over() {
        for by in [Move::Orbit([0.1, 10.0]), Move::Orbit([0.1, -10.0]), Move::Look([0.0, 7.0]), Move::Look([0.0, -7.0])]
        {
            let camera = after(&[by; 5]);
            let forward = (camera.target - camera.eye).normalize();
            assert!(forward.dot(camera.up).abs() > 0.999, "{by:?} did not reach the pole: {forward}");
            assert!(Aim::from(camera).check().is_ok(), "{by:?}: {camera:?}");
            assert_eq!(camera.up, Vec3::Y);
        }
    }

    #[test]
    fn many_small_moves_are_one_large_one() {
        let camera = after(&[Move::Orbit([0.001, 0.0]); 2000]);
        assert_near(camera.eye, navigator().camera().eye);
        let there_and_back: Vec<_> = (0..1000).flat_map(|_| [Move::Zoom(0.01), Move::Zoom(-0.01)]).collect();
        assert_near(after(&there_and_back).eye, navigator().camera().eye);
    }

    #[test]
    fn what_would_see_nothing_is_left_out() {
        let still = navigator().camera();
        for by in [
            Move::Target([0.0, 0.0, 4.0]),
            Move::Target([0.0, 9.0, 4.0]),
            Move::Target([1e300, 0.0, 0.0]),
            Move::Zoom(-900.0),
            Move::Fly([1000.0, f64::NAN, 0.0]),
        ] {
            assert_eq!(after(&[by]), still, "{by:?}");
        }
        // As near as float32 lets it.
        let near = after(&[Move::Zoom(1.0); 1000]);
        assert!(near.eye != near.target);
        assert!(!Move::Zoom(f64::NAN).is_usual() && !Move::Pan([0.0, 1e9]).is_usual() && Move::Reset.is_usual());
    }

    #[test]
    fn another_scene_moves_only_cameras_that_nobody_moved() {
        let other = Camera { eye: Vec3::splat(9.0), ..navigator().camera() };
        let mut still = navigator();
        still.follow(other, 1.0);
        assert_eq!(still.camera(), other);
        let mut moved = navigator();
        moved.apply(Move::Zoom(0.5));
        let before = moved.camera();
        moved.follow(other, 1.0);
        assert_eq!(moved.camera(), before);
        moved.apply(Move::Reset);
        assert_eq!(moved.camera(), other);
    }
}
