//! What the scenes of studies look like: a small picture and a sentence each, for the page.

use super::{Lab, scenes};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use raybrook::low_level::film::Film;
use raybrook::low_level::input::read_regular;
use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
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

/// The names of the scenes of a lab.
pub(super) fn names(lab: &Lab) -> Vec<String> {
    match lab.scenes.is_empty() {
        true => scenes::shown(lab.quick).map(|shown| shown.name.to_owned()).collect(),
        false => lab.scenes.iter().map(|(name, _)| name.clone()).collect(),
    }
}

/// Renders the scenes of a lab.
///
/// # Errors
/// As [`Lab::picture`].
pub(super) fn render(lab: &Lab) -> Result<Vec<PicturedScene>> {
    if !lab.scenes.is_empty() {
        return lab.scenes.iter().map(|(name, scene)| pictured(lab, name, "a scene of the user's", scene)).collect();
    }
    scenes::shown(lab.quick).map(|shown| pictured(lab, shown.name, shown.about, &(shown.make)()?)).collect()
}

fn pictured(lab: &Lab, name: &str, about: &str, scene: &Scene) -> Result<PicturedScene> {
    (lab.progress)(&format!("a picture of {name}"));
    let film = lab.picture(scene, SIZE)?;
    let png = STANDARD.encode(png_of(&film)?);
    Ok(PicturedScene { name: name.to_owned(), about: about.to_owned(), triangles: scene.hittable().len(), png })
}

fn png_of(film: &Film) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let failed = |error: png::EncodingError| Error::io("encode", "a picture", std::io::Error::other(error));
    let mut encoder = png::Encoder::new(&mut bytes, film.width, film.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(film.to_srgb8().as_flattened()).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}
