//! Where a picture is seen from, as decisions: each part of the camera with its source.

use super::request::{Decision, Source};
use crate::scene::{AimSource, Placed};
use glam::Vec3;

/// The parts of a camera, each with where it comes from.
pub fn camera_decisions(placed: &Placed) -> [Decision; 4] {
    let camera = &placed.camera;
    [
        decision("eye", vector(camera.eye), &placed.eye),
        decision("target", vector(camera.target), &placed.target),
        decision("up", vector(camera.up), &placed.up),
        decision("fov", camera.fov_degrees.to_string(), &placed.fov),
    ]
}

/// As it is typed.
fn vector(Vec3 { x, y, z }: Vec3) -> String {
    // Adding 0 makes -0 positive.
    format!("{},{},{}", x + 0.0, y + 0.0, z + 0.0)
}

fn decision(option: &'static str, value: String, from: &AimSource) -> Decision {
    let (source, reason) = match from {
        AimSource::Given => (Source::Given, ""),
        AimSource::Scene => (Source::Scene, "its camera"),
        AimSource::Format => (Source::Scene, "the rule of its format, or of the program that wrote the file"),
        AimSource::Automatic(reason) => (Source::Model, reason.as_ref()),
    };
    Decision { option: option.into(), value, source, reason: reason.to_owned() }
}
