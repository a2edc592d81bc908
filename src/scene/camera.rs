//! The pinhole camera.

use glam::Vec3;

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
    /// A camera that shows the whole box `low`..`high` from the front, a little from the right and above.
    pub fn framing(low: Vec3, high: Vec3) -> Camera {
        // Halves first: the extent of a scene near the largest float would overflow.
        let center = low * 0.5 + high * 0.5;
        let half = high * 0.5 - low * 0.5;
        let scale = half.max_element().max(f32::MIN_POSITIVE);
        let radius = (half / scale).length() * scale;
        const DISTANCE_IN_RADII: f32 = 3.1; // the bounding sphere fits a 40 degree cone: 1/sin(20 deg) = 2.92, and a margin
        let distance = if radius > f32::MIN_POSITIVE { DISTANCE_IN_RADII * radius } else { 1.0 };
        Camera {
            eye: center + Vec3::new(0.45, 0.35, 0.82).normalize() * distance,
            target: center,
            up: Vec3::Y,
            fov_degrees: 40.0,
        }
    }
}
