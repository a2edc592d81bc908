//! Light sources: all are points or directions, so shadows are hard.

use glam::Vec3;

/// How a point light's irradiance falls with distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Falloff {
    /// Not at all (the thesis's and OBJ's habit): `intensity` arrives everywhere.
    #[default]
    None,
    /// With the squared distance: `intensity` arrives at distance 1.
    Quadratic,
}

/// What kind of light it is, with the data of that kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// Shines from `position` in all directions.
    Point {
        /// World units.
        position: Vec3,
    },
    /// Shines along `direction` (from the light towards the scene) from infinitely far.
    Directional {
        /// Need not be of unit length; not zero.
        direction: Vec3,
    },
    /// Shines from `position` in a cone around `direction`. Between the two angles intensity is 3 s^2 - 2 s^3 of what
    /// it is within: s is the cosine's share of the way from that of `outer_degrees` to that of `inner_degrees`.
    Spot {
        /// World units.
        position: Vec3,
        /// Axis of the cone, away from the light; need not be of unit length; not zero.
        direction: Vec3,
        /// Full intensity within this angle from the axis, degrees.
        inner_degrees: f32,
        /// None beyond this angle from the axis, degrees; at least `inner_degrees`, below 90.
        outer_degrees: f32,
    },
}

/// Light from all around, which casts no shadows, on the diffuse colours of surfaces: that of a sky above and of ground
/// below, and some from the viewer's side.
///
/// A surface whose normal has the cosines c with `up` and v with the way to the viewer gets `bottom` + (`top` -
/// `bottom`) (1 + c) / 2, the mean of what it sees of both halves, and `viewer` times v. What a ray sees, a lamp at its
/// start sees, too: so light from the viewer needs no shadow ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sky {
    /// Light of all directions above, linear RGB.
    pub top: Vec3,
    /// Light of all directions below.
    pub bottom: Vec3,
    /// Strength of a lamp at the viewer's eye, without falloff.
    pub viewer: Vec3,
    /// Where `top` is, and that of the background. Need not be of unit length; not zero.
    pub up: Vec3,
}

impl Default for Sky {
    /// No light; y is up.
    fn default() -> Self {
        Sky { top: Vec3::ZERO, bottom: Vec3::ZERO, viewer: Vec3::ZERO, up: Vec3::Y }
    }
}

/// A light source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Kind and place.
    pub kind: LightKind,
    /// Colour and strength, linear RGB.
    pub intensity: Vec3,
    /// Fall of point and spot lights with distance.
    pub falloff: Falloff,
}

impl Light {
    /// A point light without falloff.
    pub fn point(position: Vec3, intensity: Vec3) -> Light {
        Light { kind: LightKind::Point { position }, intensity, falloff: Falloff::None }
    }

    /// A directional light that shines along `direction`.
    pub fn directional(direction: Vec3, intensity: Vec3) -> Light {
        Light { kind: LightKind::Directional { direction }, intensity, falloff: Falloff::None }
    }
}
