//! The rules that cameras, lights, materials and procedural textures obey, in one place: the builder and the scene
//! files both ask here.
//!
//! A fault names the value at fault as scene files spell its key, so that a file's reader can find the line.

use super::{Camera, CameraKey, Image, Light, LightKind, Material, Procedural, Scene, Sky, Texture, Toon, WideCamera};
use crate::error::{Error, Result};
use crate::shared::NO_PRIMITIVE;
use glam::{DVec3, Vec3};

/// What is wrong with which value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// The key of the value in a scene file, such as `fov`.
    pub key: &'static str,
    /// What is wrong with it; follows the key in a sentence.
    pub message: String,
}

/// What is out of range in camera, lights, materials, textures, ambient light and background.
pub(super) fn value_faults(scene: &Scene) -> Vec<String> {
    let mut faults: Vec<String> = Vec::new();
    faults.extend(scene.camera.as_ref().and_then(camera_fault).map(|f| format!("camera: {} {}", f.key, f.message)));
    for wide in &scene.wide_cameras {
        let fault = wide_camera_fault(wide);
        faults.extend(fault.map(|f| format!("camera of aspect {}: {} {}", wide.aspect, f.key, f.message)));
    }
    faults.extend(key_faults(&scene.camera_keys));
    for (i, light) in scene.lights.iter().enumerate() {
        faults.extend(light_fault(light).map(|f| format!("light {i}: {} {}", f.key, f.message)));
    }
    faults.extend(scene.sky.as_ref().and_then(sky_fault).map(|f| format!("sky: {} {}", f.key, f.message)));
    for m in &scene.materials {
        faults.extend(material_fault(m).map(|f| format!("material '{}': {} {}", m.name, f.key, f.message)));
        if let Some(t) = m.diffuse_texture.filter(|&t| t as usize >= scene.textures.len()) {
            faults.push(format!("material '{}': there is no texture number {t}", m.name));
        }
    }
    if scene.triangle_count() >= NO_PRIMITIVE as usize {
        faults.push("it has more triangles, of instances and its own, than 32-bit numbers can tell apart".into());
    }
    let objects = scene.instances.objects().iter().flat_map(|object| object.triangles.iter().map(|t| t.material));
    let materials = scene.instances.placed().iter().filter_map(|instance| instance.material).chain(objects);
    if let Some(id) = materials.into_iter().find(|&id| id as usize >= scene.materials.len()) {
        faults.push(format!("an instance: there is no material number {id}"));
    }
    for (i, texture) in scene.textures.iter().enumerate() {
        match texture {
            Texture::Procedural(procedural) => {
                faults.extend(procedural_fault(procedural).map(|f| format!("texture {i}: {} {}", f.key, f.message)));
            }
            Texture::Image(image) => faults.extend(image_fault(image).map(|fault| format!("texture {i}: {fault}"))),
        }
    }
    for (what, colour) in
        [("ambient", scene.ambient), ("background", scene.background.bottom), ("background", scene.background.top)]
    {
        if !(colour.is_finite() && colour.min_element() >= 0.0) {
            faults.push(format!("{what}: {colour} is not a colour"));
        }
    }
    faults
}

/// What is wrong with a picture that was put together by hand.
fn image_fault(image: &Image) -> Option<String> {
    let Image { name, width, height, rgba } = image;
    if !(1..=Image::MAX_SIDE).contains(width) || !(1..=Image::MAX_SIDE).contains(height) {
        let most = Image::MAX_SIDE;
        return Some(format!("'{name}' has {width} x {height} texels; each side must lie between 1 and {most}"));
    }
    let due = *width as usize * *height as usize;
    (rgba.len() != due).then(|| format!("'{name}' has {} of its {width} x {height} texels", rgba.len()))
}

/// An error that tells the first of `faults`, if there are any.
pub(super) fn none_of(mut faults: Vec<String>) -> Result<()> {
    if faults.is_empty() {
        return Ok(());
    }
    const TOLD: usize = 3; // later faults are mostly consequences of the first
    let rest = faults.len().saturating_sub(TOLD);
    faults.truncate(TOLD);
    if rest > 0 {
        faults.push(format!("and {rest} more"));
    }
    Err(Error::Scene(faults.join("; ")))
}

/// The sine of the angle between `up` and the view below which the camera's right vector is mostly rounding error: each
/// component of the float32 cross product of unit vectors is off by up to 3 eps/2 < 2^-22, a quarter of this.
const PARALLEL_SINE: f64 = 1.0 / (1u32 << 20) as f64;

/// Whether no picture has `up` upwards that is seen along `forward`. Neither is zero.
pub(super) fn is_along(up: DVec3, forward: DVec3) -> bool {
    forward.normalize().cross(up.normalize()).length() < PARALLEL_SINE
}

/// Whether a picture can have this vertical field of view. NaN is none.
pub(super) fn is_field_of_view(degrees: f32) -> bool {
    degrees > 0.0 && degrees < 180.0
}

/// What is wrong with `camera`, if anything.
pub(super) fn camera_fault(camera: &Camera) -> Option<Fault> {
    let view = finite("eye", camera.eye)
        .or(finite("target", camera.target))
        .or(finite("up", camera.up))
        .or(nonzero("up", camera.up));
    if view.is_some() {
        return view;
    }
    let forward = camera.target.as_dvec3() - camera.eye.as_dvec3();
    if forward == DVec3::ZERO {
        return fault("target", "is the eye's own place: the camera looks nowhere");
    }
    if is_along(camera.up.as_dvec3(), forward) {
        return fault("up", "is parallel to the view from eye to target; choose another");
    }
    let fov = camera.fov_degrees;
    if !is_field_of_view(fov) {
        return fault("fov", format!("is {fov}; it must lie between 0 and 180 degrees, both excluded"));
    }
    None
}

/// What is wrong with a camera for wide pictures, if anything.
pub(super) fn wide_camera_fault(wide: &WideCamera) -> Option<Fault> {
    let is_aspect = wide.aspect > 0.0 && wide.aspect.is_finite();
    let message = || format!("is {}; it must be above 0", wide.aspect);
    if is_aspect { camera_fault(&wide.camera) } else { fault("aspect", message()) }
}

/// What is wrong with the frame of a key that comes behind one of frame `before`, if anything.
pub(super) fn frame_fault(before: Option<u32>, frame: u32) -> Option<Fault> {
    let before = before.filter(|&before| frame <= before)?;
    fault("frame", format!("is not behind that of the key before it, {before}"))
}

/// What is wrong with the keys of a moving camera.
pub(super) fn key_faults(keys: &[CameraKey]) -> Vec<String> {
    let of_camera = |key: &CameraKey| camera_fault(&key.camera).map(|fault| (key.frame, fault));
    let of_frame =
        |pair: &[CameraKey]| frame_fault(Some(pair[0].frame), pair[1].frame).map(|fault| (pair[1].frame, fault));
    let faults = keys.iter().filter_map(of_camera).chain(keys.windows(2).filter_map(of_frame));
    faults.map(|(frame, fault)| format!("camera key of frame {frame}: {} {}", fault.key, fault.message)).collect()
}

/// What is wrong with `sky`, if anything.
pub(super) fn sky_fault(sky: &Sky) -> Option<Fault> {
    at_least_zero("top", sky.top)
        .or_else(|| at_least_zero("bottom", sky.bottom))
        .or_else(|| at_least_zero("viewer", sky.viewer))
        .or_else(|| nonzero("up", sky.up))
}

/// What is wrong with `light`, if anything.
pub(super) fn light_fault(light: &Light) -> Option<Fault> {
    let place = match light.kind {
        LightKind::Point { position } => finite("position", position),
        LightKind::Directional { direction } => nonzero("direction", direction),
        LightKind::Spot { position, direction, inner_degrees: inner, outer_degrees: outer } => {
            finite("position", position).or(nonzero("direction", direction)).or_else(|| cone_fault(inner, outer))
        }
    };
    place.or_else(|| at_least_zero("intensity", light.intensity))
}

/// What is wrong with a spot light's angles.
fn cone_fault(inner: f32, outer: f32) -> Option<Fault> {
    if !(outer > 0.0 && outer < 90.0) {
        return fault("outer", format!("is {outer}; it must lie between 0 and 90 degrees, both excluded"));
    }
    if !(inner >= 0.0 && inner <= outer) {
        return fault("inner", format!("is {inner}; it must lie between 0 and outer = {outer} degrees"));
    }
    None
}

/// What is wrong with `material`, if anything.
pub(super) fn material_fault(material: &Material) -> Option<Fault> {
    let colours = at_least_zero("ambient", material.ambient)
        .or_else(|| at_least_zero("diffuse", material.diffuse))
        .or_else(|| at_least_zero("specular", material.specular))
        .or_else(|| at_least_zero("emission", material.emission))
        // Above 1 a chain of rays would gain light at every bounce.
        .or_else(|| zero_to_one("mirror", material.mirror))
        .or_else(|| zero_to_one("transmission", material.transmission));
    if colours.is_some() {
        return colours;
    }
    let (shininess, ior) = (material.shininess, material.ior);
    if !(0.0..=Material::MAX_SHININESS).contains(&shininess) {
        return fault("shininess", format!("is {shininess}; it must lie between 0 and {}", Material::MAX_SHININESS));
    }
    if !(ior > 0.0 && ior.is_finite()) {
        return fault("ior", format!("is {ior}; it must be finite and above 0"));
    }
    let toon = material.toon.as_ref().and_then(toon_fault)?;
    fault("toon", format!("{} {}", toon.key, toon.message))
}

/// What is wrong with `toon`, if anything.
pub(super) fn toon_fault(toon: &Toon) -> Option<Fault> {
    let (steps, threshold) = (toon.steps, toon.threshold);
    if !(1..=Toon::MAX_STEPS).contains(&steps) {
        return fault("steps", format!("is {steps}; it must lie between 1 and {}", Toon::MAX_STEPS));
    }
    if !(0.0..1.0).contains(&threshold) {
        return fault("threshold", format!("is {threshold}; it must be at least 0 and below 1"));
    }
    None
}

/// What is wrong with `procedural`, if anything.
pub(super) fn procedural_fault(procedural: &Procedural) -> Option<Fault> {
    // Above 1 a surface would give back more light than it gets.
    let colours = procedural.colours.iter().find_map(|&colour| zero_to_one("colors", colour));
    if colours.is_some() {
        return colours;
    }
    let (octaves, turbulence) = (procedural.octaves, procedural.turbulence);
    if !(1..=Procedural::MAX_OCTAVES).contains(&octaves) {
        return fault("octaves", format!("is {octaves}; it must lie between 1 and {}", Procedural::MAX_OCTAVES));
    }
    if !turbulence.is_finite() {
        return fault("turbulence", format!("is {turbulence}; it must be finite"));
    }
    if !(procedural.transform.is_finite() && procedural.transform.inverse().is_finite()) {
        return fault("scale", "leaves the pattern no extent, or one beyond all numbers");
    }
    None
}

fn fault(key: &'static str, message: impl Into<String>) -> Option<Fault> {
    Some(Fault { key, message: message.into() })
}

fn finite(key: &'static str, v: Vec3) -> Option<Fault> {
    if v.is_finite() { None } else { fault(key, format!("is {v}; it must be finite")) }
}

pub(super) fn nonzero(key: &'static str, v: Vec3) -> Option<Fault> {
    finite(key, v).or_else(|| if v == Vec3::ZERO { fault(key, "is zero: it has no direction") } else { None })
}

fn at_least_zero(key: &'static str, colour: Vec3) -> Option<Fault> {
    finite(key, colour).or_else(|| {
        if colour.min_element() < 0.0 { fault(key, format!("is {colour}; no component may be negative")) } else { None }
    })
}

fn zero_to_one(key: &'static str, colour: Vec3) -> Option<Fault> {
    at_least_zero(key, colour).or_else(|| {
        if colour.max_element() > 1.0 { fault(key, format!("is {colour}; no component may be above 1")) } else { None }
    })
}
