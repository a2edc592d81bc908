//! Packs textures for `cl/shade/texture.cl` and `cl/shade/procedural.cl`.

use super::texture_levels::push_levels;
use crate::error::{Error, Result};
use crate::layout::Float4;
use crate::options::TextureFilter;
use crate::scene::{Pattern, Procedural, Scene, Texture, TextureId, TextureSpace};
use crate::shared::{TEXTURE_CHECKER, TEXTURE_IMAGE, TEXTURE_MARBLE, TEXTURE_NOISE, TEXTURE_WOOD, TextureInfo};
use glam::DVec3;

/// The textures that are `used`, and the texels of those that are pictures.
///
/// # Errors
/// [`Error::Scene`] when there are more texels than 32 bits can number.
pub(super) fn pack_textures(
    scene: &Scene,
    used: &[TextureId],
    scale: f32,
    filter: TextureFilter,
) -> Result<(Vec<TextureInfo>, Vec<u32>)> {
    let mut texels = Vec::new();
    let mut textures = Vec::new();
    for &id in used {
        let image = match &scene.textures[id as usize] {
            Texture::Image(image) => image,
            Texture::Procedural(procedural) => {
                textures.push(pack_procedural(procedural, scale));
                continue;
            }
        };
        let first = texels.len() as u32; // checked below
        let (width, height) = (image.width, image.height);
        texels.extend(image.rgba.iter().map(|&rgba| u32::from_le_bytes(rgba)));
        let levels = match filter {
            TextureFilter::Footprint => push_levels(image, &mut texels),
            TextureFilter::Bilinear => 1,
        };
        if u32::try_from(texels.len()).is_err() {
            return Err(Error::Scene(format!("its textures hold over 2^32 texels at '{}'", image.name)));
        }
        textures.push(TextureInfo { kind: TEXTURE_IMAGE, first, width, height, levels, ..TextureInfo::default() });
    }
    Ok((textures, texels))
}

/// The inverse of the texture's transform is what the kernels need, and from tracing space.
fn pack_procedural(procedural: &Procedural, scale: f32) -> TextureInfo {
    let in_uv = procedural.space == TextureSpace::Uv;
    let unit = if in_uv { 1.0 } else { f64::from(scale) };
    let to_texture = procedural.transform.inverse();
    let rows = to_texture.matrix3.transpose();
    let row = |row: DVec3, offset: f64| Float4::new((row / unit).as_vec3(), offset as f32);
    TextureInfo {
        to_x: row(rows.x_axis, to_texture.translation.x),
        to_y: row(rows.y_axis, to_texture.translation.y),
        to_z: row(rows.z_axis, to_texture.translation.z),
        colour0_turbulence: Float4::new(procedural.colours[0], procedural.turbulence),
        colour1: Float4::new(procedural.colours[1], 0.0),
        kind: match procedural.pattern {
            Pattern::Checker => TEXTURE_CHECKER,
            Pattern::Noise => TEXTURE_NOISE,
            Pattern::Marble => TEXTURE_MARBLE,
            Pattern::Wood => TEXTURE_WOOD,
        },
        octaves: procedural.octaves.min(Procedural::MAX_OCTAVES),
        seed: procedural.seed,
        in_uv: u32::from(in_uv),
        ..TextureInfo::default()
    }
}
