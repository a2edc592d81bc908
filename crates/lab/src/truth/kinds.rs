//! Kinds of rays of a picture.

use serde::Serialize;

/// What a ray is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// From the eye.
    Camera,
    /// To a light.
    Shadow,
    /// Off a mirror, or off glass.
    Reflected,
    /// Into glass, or out of it.
    Refracted,
}

impl Kind {
    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Camera => "camera",
            Kind::Shadow => "shadow",
            Kind::Reflected => "reflected",
            Kind::Refracted => "refracted",
        }
    }
}
