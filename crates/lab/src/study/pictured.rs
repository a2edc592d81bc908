//! What the scenes of studies look like: a small picture and a sentence each, for the page.

use super::fingerprint::fingerprint;
use super::report::write_png;
use super::{Lab, scenes};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use raybrook::low_level::input::read_regular;
use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::Path;

/// A scene as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PicturedScene {
    /// Its name in tables.
    pub name: String,
    /// What it is, in a sentence.
    pub about: String,
    /// Triangles that can be hit.
    pub triangles: usize,
    /// A checksum of all that the picture shows.
    #[serde(default)]
    fingerprint: String,
    /// A picture as PNG, in base 64.
    pub png: String,
}

/// Width and height of the pictures.
pub(super) const SIZE: (u32, u32) = (240, 135);

/// The pictures of a file; none where there is no such file.
pub(super) fn read(path: &Path) -> Vec<PicturedScene> {
    let bytes = read_regular(path).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// The pictures of a lab's scenes, those of `known` that are of the same scene as they are.
///
/// # Errors
/// As [`Lab::picture`].
pub(super) fn of_lab(lab: &Lab, known: &[PicturedScene]) -> Result<Vec<PicturedScene>> {
    if !lab.scenes.is_empty() {
        let users = |(name, scene): &(String, Scene)| pictured(lab, name, "A scene of the user's.", scene, known);
        return lab.scenes.iter().map(users).collect();
    }
    scenes::own(lab.quick).map(|own| pictured(lab, own.name, own.about, &own.scene(lab.quick)?, known)).collect()
}

fn pictured(lab: &Lab, name: &str, about: &str, scene: &Scene, known: &[PicturedScene]) -> Result<PicturedScene> {
    let fingerprint = fingerprint(scene);
    if let Some(same) = known.iter().find(|other| other.name == name && other.fingerprint == fingerprint) {
        return Ok(same.clone());
    }
    (lab.progress)(&format!("a picture of {name}"));
    let film = lab.picture(scene, SIZE)?;
    let (mut png, pixels) = (Vec::new(), film.to_srgb8());
    let failed = |error: io::Error| Error::io("encode", "a picture", error);
    write_png(&mut png, film.width, film.height, pixels.as_flattened()).map_err(failed)?;
    let (name, about, triangles) = (name.to_owned(), about.to_owned(), scene.hittable().len());
    Ok(PicturedScene { name, about, triangles, fingerprint, png: STANDARD.encode(png) })
}
