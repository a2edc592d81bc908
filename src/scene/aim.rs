//! Where a picture is seen from: what is given of a camera, and what the scene, its format and the program add to it.

use super::Camera;
use super::camera::{Axes, FOV_DEGREES, Framed, Framing};
use super::check::{camera_fault, is_along, is_field_of_view, nonzero};
use super::room::Subject;
use crate::error::{Error, Result};
use crate::names::names;
use glam::Vec3;
use std::borrow::Cow;

names! {
    /// From where a camera that is placed by itself looks at a scene. The right side is that of x, and a camera in
    /// front looks along -z where y is up, along y where z is.
    pub enum Viewpoint ("view") {
        /// From the front.
        Front = "front",
        /// From behind.
        Back = "back",
        /// From the left side.
        Left = "left",
        /// From the right side.
        Right = "right",
        /// From above; the front is at the bottom of the picture.
        Top = "top",
        /// From below; the front is at the top of the picture.
        Bottom = "bottom",
        /// From the front, the right and above in equal parts.
        Iso = "iso",
        /// From the middle of the scene's box, along the longer of its two horizontal sides.
        Inside = "inside",
    }
}

/// What is given of a camera, each part by itself. The scene's camera has the others, or else one that is placed so
/// that everything is in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aim {
    /// Position, world units.
    pub eye: Option<Vec3>,
    /// The point in the middle of the picture, world units.
    pub target: Option<Vec3>,
    /// Which way is up.
    pub up: Option<Vec3>,
    /// Vertical field of view, degrees, in (0, 180).
    pub fov_degrees: Option<f32>,
    /// From where to look, in place of `eye` and `target`.
    pub viewpoint: Option<Viewpoint>,
}

impl From<Camera> for Aim {
    /// All parts of `camera`.
    fn from(Camera { eye, target, up, fov_degrees }: Camera) -> Aim {
        Aim { eye: Some(eye), target: Some(target), up: Some(up), fov_degrees: Some(fov_degrees), viewpoint: None }
    }
}

/// Where a part of a camera comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AimSource {
    /// It was given.
    Given,
    /// The scene's camera has it so.
    Scene,
    /// The rule of the format that the scene's file has, or of the program that wrote it.
    Format,
    /// The program chose it, for this reason.
    Automatic(Cow<'static, str>),
}

/// A camera, and where each of its parts comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// The camera.
    pub camera: Camera,
    /// Where its eye comes from.
    pub eye: AimSource,
    /// Where its target comes from.
    pub target: AimSource,
    /// Where its up comes from.
    pub up: AimSource,
    /// Where its field of view comes from.
    pub fov: AimSource,
    /// The camera that was placed by itself, if there was need of one, and for what.
    pub(crate) framed: Option<(Framing, Framed)>,
    /// Where the lamp of a room hangs that the camera was put inside of.
    room_lamp: Option<Vec3>,
    /// Which way was up before an up along the view made room for another.
    sky_up: Vec3,
}

impl Aim {
    /// Checks what does not depend on a scene.
    ///
    /// # Errors
    /// [`Error::Option`] for numbers that are not finite, an up of length 0, a field of view out of range, an eye that
    /// is the target, an up along the view, and for an eye or a target beside a viewpoint.
    pub fn check(&self) -> Result<()> {
        if let (Some(viewpoint), Some(name)) =
            (self.viewpoint, self.eye.map(|_| "eye").or(self.target.map(|_| "target")))
        {
            let message =
                format!("`view = {viewpoint}` says itself where the camera is and looks; leave one of them out");
            return Err(Error::option(name, message));
        }
        let faults = [("eye", self.eye), ("target", self.target)].into_iter().find_map(|(name, place)| {
            let place = place.filter(|place| !place.is_finite())?;
            Some(Error::option(name, format!("{place} is no place; give three finite numbers")))
        });
        let of_up = || {
            let fault = nonzero("up", self.up?)?;
            Some(Error::option("up", format!("{} {}; give a direction, such as `up = z`", self.up?, fault.message)))
        };
        let of_fov = || self.fov_degrees.and_then(fov_fault);
        if let Some(fault) = faults.or_else(of_up).or_else(of_fov) {
            return Err(fault);
        }
        match (self.eye, self.target, self.up) {
            (Some(eye), Some(target), _) if eye == target => Err(self.same_place(eye)),
            (Some(eye), Some(target), Some(up)) => {
                self.check_view(&Camera { eye, target, up, fov_degrees: FOV_DEGREES })
            }
            _ => Ok(()),
        }
    }

    /// What is wrong with a camera that is where it looks.
    fn same_place(&self, place: Vec3) -> Error {
        let name = if self.eye.is_some() { "eye" } else { "target" };
        Error::option(name, format!("{place} is both the eye and the target; give another `eye` or `target`"))
    }

    /// Checks a camera that has finite numbers.
    fn check_view(&self, camera: &Camera) -> Result<()> {
        let Some(fault) = camera_fault(camera) else { return Ok(()) };
        Err(match fault.key {
            "target" if camera.eye == camera.target => self.same_place(camera.eye),
            "up" => {
                let forward = (camera.target.as_dvec3() - camera.eye.as_dvec3()).abs();
                let other = if forward.y <= forward.z { "y" } else { "z" };
                let message =
                    format!("{} is parallel to the view from eye to target; give another, such as", camera.up);
                Error::option("up", format!("{message} `up = {other}`"))
            }
            key => Error::option(key, fault.message),
        })
    }

    /// The camera of a scene, for a picture of `aspect` = width / height. `scene` is the scene's own camera,
    /// `format_up` the up of its format, `shape_up` tells the up of its shape and why, and `frame` places a camera that
    /// shows everything.
    pub(crate) fn place(
        &self,
        scene: Option<Camera>,
        format_up: Option<Vec3>,
        shape_up: impl FnOnce() -> Option<(Vec3, &'static str)>,
        aspect: f32,
        frame: impl FnOnce(&Framing) -> Framed,
    ) -> Placed {
        let (up, up_source) = match (self.up, scene, format_up) {
            (Some(up), ..) => (up, AimSource::Given),
            (None, Some(camera), _) => (camera.up, AimSource::Scene),
            (None, None, Some(up)) => (up, AimSource::Format),
            (None, None, None) => {
                let (up, reason) =
                    shape_up().unwrap_or((Vec3::Y, "y is up where neither scene, format nor shape says"));
                (up, AimSource::Automatic(reason.into()))
            }
        };
        let own = scene.filter(|_| self.viewpoint.is_none());
        let has_places = own.is_some() || self.eye.is_some() && self.target.is_some();
        let framing = Framing {
            viewpoint: self.viewpoint,
            up,
            fov_degrees: self.fov_degrees.or(scene.map(|camera| camera.fov_degrees)),
            aspect,
            may_enter: self.eye.is_none() && self.target.is_none(),
        };
        let framed = (!has_places).then(|| (framing, frame(&framing)));
        let automatic = framed.map(|(_, framed)| framed.camera);
        let subject = framed.map_or(Subject::Everything, |(_, framed)| framed.subject);
        let (fov_degrees, fov) = match (self.fov_degrees, scene, automatic) {
            (Some(fov), ..) => (fov, AimSource::Given),
            (None, Some(camera), _) => (camera.fov_degrees, AimSource::Scene),
            (None, None, Some(camera)) if subject == Subject::Room => {
                (camera.fov_degrees, AimSource::Automatic("wide, as the walls of a room are near".into()))
            }
            (None, None, _) => (FOV_DEGREES, AimSource::Automatic("a picture of usual width".into())),
        };
        let of_eye = match framed.is_some_and(|(_, framed)| framed.is_turned) {
            true => "from where everything is in the picture, on the side where the model is open".into(),
            false => self.eye_reason(subject),
        };
        let (eye, eye_source) = part(self.eye, own.map(|c| c.eye), automatic.map(|c| c.eye), of_eye);
        let of_target = self.target_reason(subject);
        let (target, target_source) = part(self.target, own.map(|c| c.target), automatic.map(|c| c.target), of_target);
        let camera = Camera { eye, target, up, fov_degrees };
        let sky_up = up;
        let (camera, up) = self.with_fitting_up(camera, up_source);
        let room_lamp = framed.and_then(|(_, framed)| framed.lamp);
        Placed { camera, eye: eye_source, target: target_source, up, fov, framed, room_lamp, sky_up }
    }

    fn eye_reason(&self, subject: Subject) -> Cow<'static, str> {
        let seen = match subject {
            Subject::Everything => "from where everything is in the picture",
            Subject::WithoutGround => "from where everything but a large ground or backdrop is in the picture",
            Subject::Room if self.viewpoint.is_some() => "the middle of the scene",
            Subject::Room => "at the end of the scene, a room whose walls hide it from outside",
        };
        self.viewpoint.map_or(seen.into(), |viewpoint| format!("`view = {viewpoint}`: {seen}").into())
    }

    fn target_reason(&self, subject: Subject) -> Cow<'static, str> {
        let seen = match subject {
            Subject::Everything => "the middle of the scene",
            Subject::WithoutGround => "the middle of what stands on the ground",
            Subject::Room => "along the longer side of the room",
        };
        seen.into()
    }

    /// `camera` with an up that is not along the view, where nobody insists on one that is: the far side is up then, as
    /// on a map.
    fn with_fitting_up(&self, camera: Camera, source: AimSource) -> (Camera, AimSource) {
        let forward = camera.target.as_dvec3() - camera.eye.as_dvec3();
        let is_open = matches!(source, AimSource::Format | AimSource::Automatic(_));
        let looks_along = matches!(self.viewpoint, Some(Viewpoint::Top | Viewpoint::Bottom));
        if !(looks_along || is_open && forward.is_finite() && is_along(camera.up.as_dvec3(), forward)) {
            return (camera, source);
        }
        let axes = Axes::of(camera.up);
        let up = if forward.dot(axes.up()) < 0.0 { axes.back() } else { axes.front() };
        let camera = Camera { up: up.as_vec3(), ..camera };
        (camera, AimSource::Automatic("as the view is straight down or up".into()))
    }
}

/// What is wrong with a field of view.
fn fov_fault(degrees: f32) -> Option<Error> {
    let message = format!("{degrees} is no angle of view; give degrees between 0 and 180, both excluded");
    (!is_field_of_view(degrees)).then(|| Error::option("fov", message))
}

/// One place of a camera, and where it comes from.
fn part(
    given: Option<Vec3>,
    scene: Option<Vec3>,
    automatic: Option<Vec3>,
    reason: Cow<'static, str>,
) -> (Vec3, AimSource) {
    match (given, scene) {
        (Some(place), _) => (place, AimSource::Given),
        (None, Some(place)) => (place, AimSource::Scene),
        (None, None) => (automatic.unwrap_or_default(), AimSource::Automatic(reason)),
    }
}

impl Placed {
    /// Checks that the camera, which `aim` was placed as, sees something.
    ///
    /// # Errors
    /// As [`Aim::check`].
    pub fn check(&self, aim: &Aim) -> Result<()> {
        if *aim == Aim::default() {
            // In a scene that is tiny beside its distance from the origin, the camera can be where it looks.
            return Ok(());
        }
        aim.check()?;
        aim.check_view(&self.camera)
    }

    /// Whether the camera was put inside of a scene.
    pub fn is_inside(&self) -> bool {
        self.room_lamp.is_some()
    }

    /// Where the lamp of a room hangs, world units, if the camera was put inside of one.
    pub fn room_lamp(&self) -> Option<Vec3> {
        self.room_lamp
    }

    /// How the camera was placed, where nobody gave its eye or target.
    pub(super) fn automatic(&self) -> Option<(Framing, Framed)> {
        let is_automatic = |source: &AimSource| matches!(source, AimSource::Automatic(_));
        self.framed.filter(|_| is_automatic(&self.eye) && is_automatic(&self.target))
    }

    /// Which way is up in the world, also where it is not in the picture.
    pub(super) fn world_up(&self) -> Vec3 {
        self.framed.map_or(self.camera.up, |(framing, _)| framing.up)
    }

    /// Which way is up in the world, whatever the picture shows of it.
    pub(crate) fn sky_up(&self) -> Vec3 {
        self.sky_up
    }
}
