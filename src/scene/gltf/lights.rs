//! Cameras and lights of nodes.
//!
//! | glTF | scene |
//! |---|---|
//! | `yfov` | vertical field of view; a camera looks along -z, and y is up |
//! | point and spot light, candela | intensity / π, falling with the square of the distance |
//! | directional light, lux | intensity / π |
//! | `innerConeAngle`, `outerConeAngle` | the same angles; in between the scene's own curve, which is smoother |

use super::Source;
use super::nodes::{Hierarchy, Placed};
use crate::scene::check::{camera_fault, light_fault};
use crate::scene::unused::Unused;
use crate::scene::{Builder, Camera, Falloff, Light, LightKind};
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light as PunctualLight, Spot, Type};
use ::gltf::json::validation::Checked;
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// The widest cone of a spot light here, degrees; the format's own limit is 90.
const MAX_CONE_DEGREES: f32 = 89.9;

/// The largest intensity that is kept: its products stay far from the largest float.
const MAX_INTENSITY: f32 = 1e30;

/// Adds the first camera that can be one, and all lights.
pub(super) fn add(source: &Source, hierarchy: &Hierarchy, builder: &mut Builder, unused: &mut Unused) {
    let mut has_camera = false;
    for placed in &hierarchy.cameras {
        match camera(source, placed) {
            Some(camera) if !has_camera => {
                builder.camera(camera);
                has_camera = true;
            }
            Some(_) => unused.note("other cameras"),
            None => unused.note("cameras that are not perspective"),
        }
    }
    let lights = source.root.extensions.as_ref().and_then(|all| all.khr_lights_punctual.as_ref());
    let lights = lights.map_or(&[][..], |extension| &extension.lights);
    for placed in &hierarchy.lights {
        match lights.get(placed.number).and_then(|punctual| light(punctual, placed).map(|light| (punctual, light))) {
            Some((punctual, light)) => {
                unused.add("ranges of lights", usize::from(punctual.range.is_some()));
                builder.light(light);
            }
            None => unused.note("lights that make no sense"),
        }
    }
}

fn point(placed: &Placed) -> Vec3 {
    placed.transform.translation.as_vec3()
}

/// Where an axis of a node points, as a unit vector.
fn axis(placed: &Placed, axis: DVec3) -> Vec3 {
    placed.transform.transform_vector3(axis).normalize_or_zero().as_vec3()
}

fn camera(source: &Source, placed: &Placed) -> Option<Camera> {
    let perspective = source.root.cameras.get(placed.number)?.perspective.as_ref()?;
    let eye = point(placed);
    let target = eye + axis(placed, DVec3::NEG_Z);
    let camera = Camera { eye, target, up: axis(placed, DVec3::Y), fov_degrees: perspective.yfov.to_degrees() };
    camera_fault(&camera).is_none().then_some(camera)
}

/// The camera with its target where `middle` is before it, instead of at a distance that has no meaning: whoever moves
/// the eye looks there.
pub(super) fn look_at_something(camera: Camera, middle: Option<DVec3>) -> Camera {
    let eye = camera.eye.as_dvec3();
    let forward = (camera.target.as_dvec3() - eye).normalize_or_zero();
    let distance = middle.map_or(0.0, |middle| (middle - eye).dot(forward));
    let there = Camera { target: (eye + forward * distance).as_vec3(), ..camera };
    if distance > 0.0 && camera_fault(&there).is_none() { there } else { camera }
}

fn light(light: &PunctualLight, placed: &Placed) -> Option<Light> {
    let Checked::Valid(kind) = light.type_ else { return None };
    let direction = axis(placed, DVec3::NEG_Z);
    let kind = match kind {
        Type::Point => LightKind::Point { position: point(placed) },
        Type::Directional => LightKind::Directional { direction },
        Type::Spot => {
            let (inner_degrees, outer_degrees) = cone(light.spot.as_ref());
            LightKind::Spot { position: point(placed), direction, inner_degrees, outer_degrees }
        }
    };
    let intensity = Vec3::from(light.color) * (light.intensity / PI);
    let light = Light { kind, intensity: intensity.min(Vec3::splat(MAX_INTENSITY)), falloff: Falloff::Quadratic };
    light_fault(&light).is_none().then_some(light)
}

/// The inner and outer angle of a cone, degrees.
fn cone(spot: Option<&Spot>) -> (f32, f32) {
    let outer = spot.map_or(45.0, |spot| spot.outer_cone_angle.to_degrees()).min(MAX_CONE_DEGREES);
    (spot.map_or(0.0, |spot| spot.inner_cone_angle.to_degrees()).min(outer), outer)
}
