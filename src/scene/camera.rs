//! The pinhole camera.

use glam::{DVec3, Vec3};

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
    /// width / height. Without points it looks at the origin.
    pub fn framing(points: impl Iterator<Item = Vec3> + Clone, aspect: f32) -> Camera {
        const FOV_DEGREES: f32 = 40.0;
        const MARGIN: f64 = 1.06; // a little air around the model
        let points = points.map(DVec3::from); // f64: the extent of a scene near the largest float overflows float32
        let low = points.clone().reduce(DVec3::min).unwrap_or_default();
        let high = points.clone().reduce(DVec3::max).unwrap_or_default();
        let center = (low + high) / 2.0;

        let back = DVec3::new(0.45, 0.35, 0.82).normalize();
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let tan_y = (f64::from(FOV_DEGREES).to_radians() / 2.0).tan();
        let tan_x = tan_y * f64::from(aspect);
        // Every point must lie inside the pyramid of view: its distance aside is at most tan times its distance ahead.
        let distance = points
            .map(|p| p - center)
            .map(|p| MARGIN * (p.dot(right).abs() / tan_x).max(p.dot(up).abs() / tan_y) + p.dot(back))
            .fold(0.0, f64::max);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        Camera {
            eye: (center + back * distance).as_vec3(),
            target: center.as_vec3(),
            up: Vec3::Y,
            fov_degrees: FOV_DEGREES,
        }
    }
}
