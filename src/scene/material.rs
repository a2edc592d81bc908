//! The material model: Blinn–Phong with mirror reflection and dielectric refraction (Whitted 1980).

use super::TextureId;
use glam::Vec3;

/// Index of a material in its scene.
pub type MaterialId = u32;

/// How a surface answers light. All colours are linear RGB; 0..1 keeps energy.
///
/// A surface with `transmission` above zero is a dielectric: Fresnel's equations share the light between what is
/// reflected and what is transmitted, of which `transmission` is taken; `mirror` is not used. The local light (ambient,
/// diffuse, specular) is added as its colours say: whoever makes a material leaves to these what does not pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name as the file gives it.
    pub name: String,
    /// Multiplies the scene's ambient light.
    pub ambient: Vec3,
    /// Lambert reflectance; multiplied by the texture where there is one.
    pub diffuse: Vec3,
    /// Texture of the diffuse (and ambient) colour.
    pub diffuse_texture: Option<TextureId>,
    /// Blinn–Phong highlight.
    pub specular: Vec3,
    /// Blinn–Phong exponent, 0..=[`Material::MAX_SHININESS`].
    pub shininess: f32,
    /// Mirror reflectance.
    pub mirror: Vec3,
    /// What passes through the surface; above zero the surface is transparent, refracts, and reflects by Fresnel.
    pub transmission: Vec3,
    /// Index of refraction relative to the outside, above 0. 1 lets rays pass straight.
    pub ior: f32,
    /// Light given off by the surface itself (seen by rays, does not light others).
    pub emission: Vec3,
    /// Threshold ("cartoon") shading of diffuse light and highlights.
    pub toon: Option<Toon>,
}

/// Threshold ("cartoon") shading (thesis, section 3.3.2): in place of the cosine of Lambert's law there are a few
/// tones, each from a threshold of the cosine on, and a highlight has full strength or none. It applies to each light
/// by itself; shadows, the lights' falloff, textures and ambient light are what they are without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Toon {
    /// Tones above dark, 1..=[`Toon::MAX_STEPS`], of 1 / `steps`, 2 / `steps`, ..., 1.
    pub steps: u32,
    /// The cosine from which there is the first of them, 0..1, 1 excluded; those of the others divide the rest evenly.
    pub threshold: f32,
}

impl Toon {
    /// The most tones: more cannot be told apart in a picture of 8 bits.
    pub const MAX_STEPS: u32 = 255;

    /// `steps` tones and dark, all of the same share of the cosine's range.
    pub fn new(steps: u32) -> Toon {
        Toon { steps, threshold: 1.0 / (steps as f32 + 1.0) }
    }
}

impl Material {
    /// The largest Blinn–Phong exponent that the shading arithmetic is bounded for.
    pub const MAX_SHININESS: f32 = 10_000.0;

    /// A matt surface of colour `diffuse`.
    pub fn matt(diffuse: Vec3) -> Material {
        Material { diffuse, ambient: diffuse, ..Material::default() }
    }

    /// Whether light passes through it: a shadow ray goes on, tinted.
    pub fn is_transparent(&self) -> bool {
        self.transmission.max_element() > 0.0
    }
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: String::new(),
            ambient: Vec3::splat(0.8),
            diffuse: Vec3::splat(0.8),
            diffuse_texture: None,
            specular: Vec3::ZERO,
            shininess: 0.0,
            mirror: Vec3::ZERO,
            transmission: Vec3::ZERO,
            ior: 1.0,
            emission: Vec3::ZERO,
            toon: None,
        }
    }
}
