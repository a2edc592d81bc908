//! The colours and textures of PLY, OFF and 3MF files as materials; what of it glTF files share.
//!
//! A surface has one material, so each colour becomes a matt one, named by its code. Until all faces are known a
//! triangle has a *paint* for a material: its colour, its texture, or neither.

use super::file::linear;
use super::{Image, Material, MaterialId, TextureId, Triangle};
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// The most colours that become a material each. With more, red, green and blue are rounded to [`LEVELS`] values each,
/// which makes at most as many.
pub(super) const MAX_COLOURS: usize = 4096;

/// Values of red, green and blue after rounding: the cube root of [`MAX_COLOURS`].
const LEVELS: u32 = 16;

/// The paint of a triangle without colour or texture.
pub(super) const PLAIN: MaterialId = MaterialId::MAX;

/// What marks a texture in a paint; a colour has 24 bits.
const TEXTURED: MaterialId = 1 << 31;

/// The paint of a triangle with a texture.
pub(super) fn textured(texture: TextureId) -> MaterialId {
    TEXTURED | texture
}

/// The paint of a triangle of one colour.
pub(super) fn coloured([red, green, blue]: [u8; 3]) -> MaterialId {
    u32::from_be_bytes([0, red, green, blue])
}

/// The nearest 8-bit value; 0 for NaN.
pub(super) fn to_8_bits(value: f32) -> u8 {
    value.round() as u8 // saturates
}

/// The mean of three colours, as displayed.
pub(super) fn mean(colours: [[u8; 3]; 3]) -> [u8; 3] {
    [0, 1, 2].map(|part| ((colours.iter().map(|c| u32::from(c[part])).sum::<u32>() + 1) / 3) as u8)
}

/// Turns the paints of `triangles` into materials, in order of first use; and what there is to say of it. `blended`:
/// whether a triangle has corners of different colours.
pub(super) fn materials(
    triangles: &mut [Triangle],
    textures: &[Image],
    blended: bool,
) -> (Vec<Material>, Option<String>) {
    let mut colours = HashSet::new();
    let too_many =
        triangles.iter().any(|t| t.material < TEXTURED && colours.insert(t.material) && colours.len() > MAX_COLOURS);
    let mut materials = Vec::new();
    let mut ids: HashMap<MaterialId, MaterialId> = HashMap::new();
    let mut last = None; // most triangles have the paint of the one before, which needs no look-up
    for triangle in triangles {
        let id = match last {
            Some((paint, id)) if paint == triangle.material => id,
            _ => {
                let is_rounded = too_many && triangle.material < TEXTURED;
                let paint = if is_rounded { rounded(triangle.material) } else { triangle.material };
                *ids.entry(paint).or_insert_with(|| {
                    materials.push(material(paint, textures));
                    (materials.len() - 1) as MaterialId
                })
            }
        };
        last = Some((triangle.material, id));
        triangle.material = id;
    }
    (materials, reduction(blended, too_many))
}

/// The warning about colours that are not as they were.
pub(super) fn reduction(blended: bool, rounded: bool) -> Option<String> {
    let averaging = blended.then(|| "each triangle has the mean colour of its corners".to_owned());
    let rounding = rounded.then(|| format!("red, green and blue are rounded to {LEVELS} values each"));
    let reduced: Vec<String> = averaging.into_iter().chain(rounding).collect();
    (!reduced.is_empty())
        .then(|| format!("{}: a triangle has one material, and each colour is one", reduced.join(", and ")))
}

/// The nearest colour of those whose parts have [`LEVELS`] values.
fn rounded(colour: MaterialId) -> MaterialId {
    let [_, parts @ ..] = colour.to_be_bytes();
    coloured(parts.map(rounded_part))
}

/// The nearest of [`LEVELS`] values.
pub(super) fn rounded_part(part: u8) -> u8 {
    let step = 255 / (LEVELS - 1); // 17, without remainder
    ((u32::from(part) + step / 2) / step * step) as u8
}

fn material(paint: MaterialId, textures: &[Image]) -> Material {
    if paint == PLAIN {
        return Material::default();
    }
    if paint >= TEXTURED {
        let texture = paint - TEXTURED;
        let name = textures[texture as usize].name.clone();
        return Material { name, diffuse_texture: Some(texture), ..Material::matt(Vec3::ONE) };
    }
    let [_, parts @ ..] = paint.to_be_bytes();
    Material { name: format!("#{paint:06x}"), ..Material::matt(parts.map(linear).into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_keeps_the_ends_and_goes_to_the_nearest() {
        for (colour, expected) in [(0, 0), (0xff_ff_ff, 0xff_ff_ff), (0x08_09_19, 0x00_11_11), (0x1a_80_7f, 0x22_88_77)]
        {
            assert_eq!(rounded(colour), expected, "{colour:06x}");
        }
        let all: HashSet<_> = (0..256).map(rounded).collect();
        assert_eq!((all.len() as u32, all.len().pow(3)), (LEVELS, MAX_COLOURS));
    }

    #[test]
    fn a_mean_is_rounded_to_the_nearest() {
        assert_eq!(mean([[0, 255, 1], [0, 255, 0], [1, 255, 1]]), [0, 255, 1]);
    }
}
