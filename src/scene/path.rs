//! Cameras that move: around a scene, or from key to key.

use super::camera::orbit_distance;
use super::check::{camera_fault, key_faults};
use super::mesh::rotation;
use super::{Camera, Placed, Scene};
use crate::error::{Error, Result};
use glam::{DVec3, Vec3};

/// A camera that is given for a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraKey {
    /// The frame, from 1.
    pub frame: u32,
    /// The camera.
    pub camera: Camera,
}

/// A camera from frame to frame. Frames are counted from 1.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraPath {
    /// In equal steps around an axis.
    Turn {
        /// That of the first frame.
        first: Camera,
        /// The axis that it turns about, through the target, or through the eye: then it looks about.
        axis: DVec3,
        /// Whether it looks about.
        looks_about: bool,
        /// How far from each frame to the next, degrees; counter-clockwise as seen from above.
        step_degrees: f64,
    },
    /// Through cameras that are given for some frames, of rising numbers: on smooth curves (cubic ones whose slope at a
    /// key is that from the key before it to the one after it: Catmull and Rom, "A Class of Local Interpolating
    /// Splines", 1974), but for the field of view, which changes in straight lines. It rests before the first and after
    /// the last key.
    Keys(Vec<CameraKey>),
}

/// Directions in which it is looked whether a scene that turns stays in the picture; of any number of frames, so that
/// all of them have the same first one.
const DIRECTIONS: u32 = 64;

impl CameraPath {
    /// `degrees` around what `placed` looks at, in `frames` steps of which the last one leads back to the first frame
    /// when it is a full turn. A camera inside of a room looks about instead. One whose place nobody gave stands so far
    /// away that `scene` stays in pictures of `aspect` = width / height.
    pub fn turn(placed: &Placed, scene: &Scene, aspect: f32, degrees: f32, frames: u32) -> CameraPath {
        let step_degrees = f64::from(degrees) / f64::from(frames.max(1));
        let axis = placed.world_up().as_dvec3().normalize_or(DVec3::Y);
        let mut first = placed.camera;
        if let Some(framed) = placed.automatic().filter(|_| !placed.is_inside()) {
            let step = f64::from(degrees) / f64::from(DIRECTIONS);
            let target = first.target.as_dvec3();
            let back = (first.eye.as_dvec3() - target).normalize_or_zero();
            let turns = (0..=DIRECTIONS).map(|i| rotation(axis, step * f64::from(i)));
            let cameras: Vec<_> = turns.map(|turn| (turn * back, turn * first.up.as_dvec3())).collect();
            let distance = orbit_distance(scene, framed, &first, &cameras, aspect);
            if distance > (first.eye.as_dvec3() - target).length() {
                first.eye = (target + back * distance).as_vec3();
            }
        }
        CameraPath::Turn { first, axis, looks_about: placed.is_inside(), step_degrees }
    }

    /// Checks the cameras of frames 1 to `frames` of keys: those between two keys may see nothing, too.
    ///
    /// # Errors
    /// [`Error::Scene`] names the keys at fault, or the first frame whose camera looks nowhere.
    pub fn check(&self, frames: u32) -> Result<()> {
        let CameraPath::Keys(keys) = self else { return Ok(()) };
        let mut faults = key_faults(keys);
        if keys.is_empty() {
            faults.push("there are no camera keys".into());
        }
        if faults.is_empty() {
            let fault = |frame| Some((frame, camera_fault(&self.camera(frame))?));
            faults.extend((1..=frames).find_map(fault).map(|(frame, fault)| {
                format!(
                    "camera between two keys, in frame {frame}: {} {}; move a key, or add one",
                    fault.key, fault.message
                )
            }));
        }
        if faults.is_empty() { Ok(()) } else { Err(Error::Scene(faults.join("; "))) }
    }

    /// The camera of frame number `frame`.
    ///
    /// # Panics
    /// Where there are no keys.
    pub fn camera(&self, frame: u32) -> Camera {
        match self {
            CameraPath::Keys(keys) => between_keys(keys, frame),
            CameraPath::Turn { first, .. } if frame <= 1 => *first,
            CameraPath::Turn { first, axis, looks_about, step_degrees } => {
                let turn = rotation(*axis, step_degrees * f64::from(frame - 1));
                let (eye, target) = (first.eye.as_dvec3(), first.target.as_dvec3());
                let up = (turn * first.up.as_dvec3()).as_vec3();
                match looks_about {
                    true => Camera { target: (eye + turn * (target - eye)).as_vec3(), up, ..*first },
                    false => Camera { eye: (target + turn * (eye - target)).as_vec3(), up, ..*first },
                }
            }
        }
    }
}

/// The camera of a frame of keys.
fn between_keys(keys: &[CameraKey], frame: u32) -> Camera {
    let after = keys.partition_point(|key| key.frame <= frame);
    if after == 0 || after == keys.len() {
        return keys[after.saturating_sub(1)].camera;
    }
    let [from, to] = [keys[after - 1], keys[after]];
    let share = f64::from(frame - from.frame) / f64::from(to.frame - from.frame);
    let curve = |of: fn(&Camera) -> Vec3| curve(keys, after, share, of);
    let (fov, to_fov) = (f64::from(from.camera.fov_degrees), f64::from(to.camera.fov_degrees));
    Camera {
        eye: curve(|camera| camera.eye),
        target: curve(|camera| camera.target),
        up: curve(|camera| camera.up),
        fov_degrees: (fov + share * (to_fov - fov)) as f32,
    }
}

/// A part of all keys at a `share` of the way to key `after` from the one before it.
fn curve(keys: &[CameraKey], after: usize, share: f64, of: fn(&Camera) -> Vec3) -> Vec3 {
    if share == 0.0 {
        return of(&keys[after - 1].camera);
    }
    let at = |i: usize| of(&keys[i].camera).as_dvec3();
    let frames = |from: usize, to: usize| f64::from(keys[to].frame - keys[from].frame);
    // By one frame; at the ends to the only neighbour.
    let slope = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(keys.len() - 1));
        (at(after) - at(before)) / frames(before, after)
    };
    let (from, to, way) = (at(after - 1), at(after), frames(after - 1, after));
    let (s2, s3) = (share * share, share * share * share);
    let point = from * (2.0 * s3 - 3.0 * s2 + 1.0)
        + slope(after - 1) * way * (s3 - 2.0 * s2 + share)
        + to * (3.0 * s2 - 2.0 * s3)
        + slope(after) * way * (s3 - s2);
    point.as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Aim, Builder, Viewpoint};

    fn placed(scene: &Scene, aim: &Aim) -> Placed {
        aim.place(
            scene.camera,
            scene.up,
            || None,
            1.5,
            |framing| framing.camera(scene.hittable().iter().map(|&i| scene.vertices(i as usize))),
        )
    }

    #[test]
    fn keys_and_frames_that_see_nothing_are_named() {
        let key = |frame: u32, eye: Vec3, target: Vec3| CameraKey {
            frame,
            camera: Camera { eye, target, up: Vec3::Y, fov_degrees: 40.0 },
        };
        let good = || key(1, Vec3::Z, Vec3::ZERO);
        let nan = key(5, Vec3::splat(f32::NAN), Vec3::ZERO);
        let wide = CameraKey { camera: Camera { fov_degrees: 180.0, ..good().camera }, frame: 6 };
        for (keys, words) in [
            (vec![good()], None),
            (vec![good(), key(9, Vec3::X, Vec3::ZERO)], None),
            (vec![], Some("no camera keys")),
            (vec![good(), nan], Some("frame 5: eye")),
            (vec![good(), key(5, Vec3::X, Vec3::X)], Some("frame 5: target is the eye's own place")),
            (vec![good(), key(5, Vec3::Y, Vec3::ZERO)], Some("frame 5: up is parallel")),
            (vec![good(), wide], Some("frame 6: fov is 180")),
            (vec![good(), good()], Some("frame 1: frame is not behind")),
            // Each key is good, and in the middle the camera is where it looks.
            (vec![good(), key(3, Vec3::NEG_Z, Vec3::ZERO)], Some("in frame 2: target")),
        ] {
            let scene = Scene { camera_keys: keys.clone(), ..Scene::default() };
            let found = CameraPath::Keys(keys).check(3).map_err(|error| error.to_string());
            match words {
                None => assert_eq!((found, scene.check_values().is_ok()), (Ok(()), true)),
                Some(words) => {
                    let error = found.unwrap_err();
                    assert!(error.contains(words), "{error}");
                    let is_between = words.starts_with("in frame") || words.starts_with("no camera");
                    assert_eq!(scene.check_values().is_ok(), is_between, "{error}");
                }
            }
        }
    }

    #[test]
    fn a_turn_leads_around_the_target_and_back() {
        let mut builder = Builder::new();
        builder.cuboid(Vec3::ONE);
        let scene = builder.finish().unwrap();
        let aim = Aim { eye: Some(Vec3::new(5.0, 3.0, 1.0)), target: Some(Vec3::X), ..Aim::default() };
        let path = CameraPath::turn(&placed(&scene, &aim), &scene, 1.5, 360.0, 4);
        let eyes = [1, 2, 3, 4, 5].map(|frame| path.camera(frame).eye);
        let expected = [[5.0, 3.0, 1.0], [2.0, 3.0, -4.0], [-3.0, 3.0, -1.0], [0.0, 3.0, 4.0], [5.0, 3.0, 1.0]];
        assert_eq!(eyes, expected.map(Vec3::from));
        assert!((1..5).all(|frame| path.camera(frame).target == Vec3::X && path.camera(frame).up == Vec3::Y));
        let half = CameraPath::turn(&placed(&scene, &aim), &scene, 1.5, -180.0, 2);
        assert_eq!(half.camera(2).eye, Vec3::new(0.0, 3.0, 4.0));
    }

    #[test]
    fn keys_are_met_and_what_is_between_them_is_smooth() {
        let key = |frame, x: f32, fov_degrees| {
            let camera = Camera { eye: Vec3::new(x, 2.0 * x, 5.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees };
            CameraKey { frame, camera }
        };
        let keys = vec![key(3, 0.0, 40.0), key(5, 1.0, 60.0), key(9, 0.0, 20.0)];
        let path = CameraPath::Keys(keys.clone());
        assert!(keys.iter().all(|key| path.camera(key.frame) == key.camera));
        assert_eq!((path.camera(1), path.camera(100)), (keys[0].camera, keys[2].camera));
        assert_eq!((path.camera(4).fov_degrees, path.camera(7).fov_degrees), (50.0, 40.0));
        // Slopes by a frame: 1/2 at the first key, 0 at the second.
        assert_eq!(path.camera(4).eye, Vec3::new(0.625, 1.25, 5.0));
        let even: Vec<_> = (0..4).map(|i| key(1 + 4 * i, i as f32, 40.0)).collect();
        let path = CameraPath::Keys(even);
        for frame in 1..=13 {
            assert!((path.camera(frame).eye.x - (frame - 1) as f32 / 4.0).abs() < 1e-6, "a straight way stays one");
        }
        let alone = CameraPath::Keys(vec![key(7, 3.0, 40.0)]);
        assert_eq!(alone.camera(1), alone.camera(9));
    }

    /// A long bar, which from the side is wider than from its end.
    #[test]
    fn what_turns_stays_in_the_picture() {
        let mut builder = Builder::new();
        builder.translate(Vec3::new(2.0, 7.0, -3.0)).scale(Vec3::new(0.5, 1.0, 20.0)).cuboid(Vec3::ONE);
        let scene = builder.finish().unwrap();
        for (viewpoint, up) in
            [(None, Vec3::Y), (Some(Viewpoint::Front), Vec3::Y), (Some(Viewpoint::Top), Vec3::Y), (None, Vec3::Z)]
        {
            let aim = Aim { viewpoint, up: Some(up), ..Aim::default() };
            let path = CameraPath::turn(&placed(&scene, &aim), &scene, 1.5, 360.0, 24);
            let mut nearest_rim = 0.0f64;
            for frame in 1..=24 {
                let camera = path.camera(frame);
                let forward = (camera.target - camera.eye).as_dvec3().normalize();
                let right = forward.cross(camera.up.as_dvec3()).normalize();
                let half = (f64::from(camera.fov_degrees) / 2.0).to_radians().tan();
                for corner in scene.positions.iter().map(|p| (*p - camera.eye).as_dvec3()) {
                    let ahead = corner.dot(forward);
                    let aside = |axis: DVec3| corner.dot(axis).abs() / ahead / half;
                    let reach = (aside(right) / 1.5).max(aside(right.cross(forward)));
                    assert!(ahead > 0.0 && reach < 1.0, "{viewpoint:?} {up} {frame}: {reach}");
                    nearest_rim = nearest_rim.max(reach);
                }
            }
            assert!(nearest_rim > 0.85, "{viewpoint:?} {up}: {nearest_rim}");
        }
    }
}
