//! Materials of metallic and rough surfaces, turned into Whitted's.
//!
//! With base colour b (factor and texture), metallic m, roughness r, alpha a, transmission t, and s = (1 - r)², the
//! share of a reflection that is taken for sharp:
//!
//! | glTF | material |
//! |---|---|
//! | base colour | diffuse = b (1 - m s)(1 - t) a, with its texture; ambient likewise |
//! | metal | mirror = b m s, of a textured surface the mean colour; the rest is diffuse |
//! | roughness | shininess = 2 / r⁴ - 2, where that is 1 or more; see [`Finish::material`] |
//! | `MASK` | nothing where alpha is below the cutoff everywhere; else opaque |
//! | `BLEND` | transmission = 1 - a, straight through |
//! | `KHR_materials_transmission` | transmission = t b (1 - m), refracted by `ior` as by solid glass |
//! | emissive, `KHR_materials_emissive_strength` | emission, of a texture the mean colour |
//! | `KHR_materials_unlit` | emission = b; with a texture see [`Unlit`] |
//! | `KHR_materials_pbrSpecularGlossiness` | b = diffuse; what its specular colour has above 0.04 is metal |
//!
//! Surfaces are seen from both sides, whatever `doubleSided` says.

use super::Source;
use super::images::{Images, Summary};
use crate::io::film::SRGB_TO_LINEAR;
use crate::scene::paint::{MAX_COLOURS, reduction, rounded_part, to_8_bits};
use crate::scene::text::{Warnings, quote};
use crate::scene::unused::Unused;
use crate::scene::{Builder, Material, MaterialId, SourceFile, TextureId};
use ::gltf::json::extensions::material::{Material as Extensions, Specular, Volume};
use ::gltf::json::material::{AlphaMode, Material as Description};
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use glam::{DAffine2, DMat2, DVec2, Vec2, Vec3, Vec4};
use std::collections::{HashMap, HashSet};

/// The largest emission that is kept, as that of other formats.
const MAX_EMISSION: f32 = 1e6;

/// Index of refraction where a file does not tell: the format's default.
const DEFAULT_IOR: f32 = 1.5;

/// What a dielectric reflects of a straight look: of that index of refraction.
const DIELECTRIC: f32 = 0.04;

/// The alpha from which a mask is solid, where a file does not tell.
const DEFAULT_CUTOFF: f32 = 0.5;

/// How unlit surfaces with a texture look. The scene's material has no texture for the light that it gives off, but one
/// for ambient light, of which the format has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unlit {
    /// All surfaces are unlit: by an ambient light of 1.
    ByAmbientLight,
    /// Some are: these are matt.
    Matt,
}

/// What a primitive must know of its material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    pub material: MaterialId,
    /// Which texture coordinates its texture has, if it has one.
    pub uvs: Option<Coordinates>,
    /// Whether there is anything to be seen of it.
    pub is_seen: bool,
}

/// Which texture coordinates a texture has, and what becomes of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coordinates {
    pub set: u32,
    /// Of coordinates with v downwards.
    transform: DAffine2,
    /// Whether the texture ends where u, or v, leaves 0 to 1.
    is_clamped: [bool; 2],
}

/// How far beyond 0 to 1 coordinates do not leave a texture: less than a texel of most.
const RIM: f64 = 1.0 / 1024.0;

impl Coordinates {
    /// What becomes of them, as bits.
    pub fn bits(&self) -> [u64; 6] {
        self.transform.to_cols_array().map(f64::to_bits)
    }

    /// The scene's coordinates, v upwards; 0 for what is not finite. And whether they leave a texture that ends.
    pub fn place(&self, [u, v]: [f32; 2]) -> (Vec2, bool) {
        let placed = self.transform.transform_point2(DVec2::new(u.into(), v.into()));
        let is_outside = |x: f64| !(-RIM..=1.0 + RIM).contains(&x);
        let leaves = self.is_clamped[0] && is_outside(placed.x) || self.is_clamped[1] && is_outside(placed.y);
        let upwards = Vec2::new(placed.x as f32, (1.0 - placed.y) as f32);
        (if upwards.is_finite() { upwards } else { Vec2::ZERO }, leaves)
    }
}

/// A texture as a material names it.
struct Shown {
    image: usize,
    wraps: [WrappingMode; 2],
    is_nearest: bool,
    set: u32,
    transform: DAffine2,
}

/// A texture of the scene.
#[derive(Debug, Clone, Copy)]
struct Kept {
    texture: TextureId,
    /// How much of it the picture takes across and down; its mirror images have the rest.
    share: DVec2,
}

/// The materials in use.
pub(super) struct Looks<'a> {
    source: &'a Source<'a>,
    images: Images<'a>,
    pub unlit: Unlit,
    /// By number in the file and colour.
    known: HashMap<(Option<usize>, [u32; 4]), Look>,
    /// By picture and the directions in which it is mirrored.
    textures: HashMap<(usize, [bool; 2]), Option<Kept>>,
    /// Colours of vertices that became materials; whether triangles have the mean of several, or a rounded one.
    colours: HashSet<[u8; 4]>,
    blended: bool,
    rounded: bool,
}

impl<'a> Looks<'a> {
    pub fn new(source: &'a Source<'a>) -> Looks<'a> {
        let images = Images::new(source);
        Looks {
            source,
            images,
            unlit: Unlit::Matt,
            known: HashMap::new(),
            textures: HashMap::new(),
            colours: HashSet::new(),
            blended: false,
            rounded: false,
        }
    }

    /// Whether material `number` of the file is lit by nothing.
    pub fn is_unlit(&self, number: Option<usize>) -> bool {
        let description = number.and_then(|number| self.source.root.materials.get(number));
        description.and_then(|d| d.extensions.as_ref()).is_some_and(|all| all.unlit.is_some())
    }

    /// The look of material `number`, or of the format's default one, on vertices of colour `tint`.
    pub fn of(&mut self, number: Option<usize>, tint: Vec4, builder: &mut Builder, unused: &mut Unused) -> Look {
        let key = (number, tint.to_array().map(f32::to_bits));
        if let Some(&known) = self.known.get(&key) {
            return known;
        }
        let default = Description::default();
        let description = number.and_then(|number| self.source.root.materials.get(number));
        let name = match (description.and_then(|d| d.name.as_ref()), number) {
            (Some(name), _) => quote(name.as_bytes()),
            (None, Some(number)) => format!("material {number}"),
            (None, None) => "default".to_owned(),
        };
        let description = description.unwrap_or(&default);
        let look = self.look(description, name, tint, builder, unused);
        self.known.insert(key, look);
        look
    }

    /// The materials of triangles on material `number` with these colours, each the mean of several where that is said.
    /// A triangle has one material, so each colour is one: in 8 bits, and where there are very many in fewer.
    pub fn of_colours(
        &mut self,
        number: Option<usize>,
        colours: &[(Vec4, bool)],
        builder: &mut Builder,
    ) -> Vec<MaterialId> {
        let mut codes: Vec<[u8; 4]> = colours.iter().map(|(colour, _)| self.code(*colour)).collect();
        let new: HashSet<&[u8; 4]> = codes.iter().filter(|code| !self.colours.contains(*code)).collect();
        if self.colours.len() + new.len() > MAX_COLOURS {
            codes.iter_mut().flatten().for_each(|part| *part = rounded_part(*part));
            self.rounded = true;
        }
        self.blended |= colours.iter().any(|(_, is_mean)| *is_mean);
        self.colours.extend(&codes);
        // What is not used of the material was told when it was met first.
        let mut told = Unused::default();
        let mut last = None;
        let mut material = |code: &[u8; 4]| match last {
            Some((known, material)) if known == *code => material,
            _ => {
                let [red, green, blue, alpha] = *code;
                let [red, green, blue] = [red, green, blue].map(|part| SRGB_TO_LINEAR[usize::from(part)]);
                let tint = Vec4::new(red, green, blue, f32::from(alpha) / 255.0);
                let material = self.of(number, tint, builder, &mut told).material;
                last = Some((*code, material));
                material
            }
        };
        codes.iter().map(&mut material).collect()
    }

    /// A linear colour in 8 bits, as sRGB, and its alpha.
    fn code(&self, colour: Vec4) -> [u8; 4] {
        let [red, green, blue, alpha] = zero_to_one(colour).to_array();
        let levels = &*SRGB_TO_LINEAR;
        let nearest = |part: f32| {
            let above = levels.partition_point(|&level| level < part).min(255);
            let below = above.saturating_sub(1);
            let is_nearer_below = part - levels[below] < levels[above] - part;
            (if is_nearer_below { below } else { above }) as u8
        };
        [nearest(red), nearest(green), nearest(blue), to_8_bits(255.0 * alpha)]
    }

    /// What was wrong with pictures and colours, and the files that pictures are in.
    pub fn finish(self) -> (Warnings, Vec<SourceFile>) {
        let files = self.images.files();
        let mut warnings = self.images.warnings;
        warnings.extend(self.source.path, reduction(self.blended, self.rounded));
        (warnings, files)
    }

    fn look(
        &mut self,
        description: &Description,
        name: String,
        tint: Vec4,
        builder: &mut Builder,
        unused: &mut Unused,
    ) -> Look {
        let none = Extensions::default();
        let extensions = description.extensions.as_ref().unwrap_or(&none);
        let metal = &description.pbr_metallic_roughness;
        let (factor, info) = match &extensions.pbr_specular_glossiness {
            Some(glossy) => (glossy.diffuse_factor.0, &glossy.diffuse_texture),
            None => (metal.base_color_factor.0, &metal.base_color_texture),
        };
        let factor = zero_to_one(Vec4::from(factor)) * zero_to_one(tint);
        let shown = info.as_ref().and_then(|info| self.shown(info, unused));
        let summary = shown.as_ref().and_then(|shown| self.images.summary(shown.image));
        let shown = shown.filter(|_| summary.is_some());
        // While the picture that was summed up is still decoded.
        let texture = shown.as_ref().and_then(|shown| self.texture(shown, builder));
        unused.add("normal textures", usize::from(description.normal_texture.is_some()));
        unused.add("occlusion textures", usize::from(description.occlusion_texture.is_some()));

        let opacity = self.opacity(description, factor.w, summary, unused);
        let colour = factor.truncate();
        let mean = colour * summary.map_or(Vec3::ONE, |summary| summary.colour);
        let finish = self.finish_of(description, extensions, mean, unused);
        let mut material = Material { name, ..finish.material(colour, mean, opacity.unwrap_or(1.0)) };
        material.emission += opacity.unwrap_or(1.0) * self.emission(description, extensions, unused);
        let is_textured = shown.is_some();
        if extensions.unlit.is_some() {
            self.unlight(&mut material, colour * opacity.unwrap_or(1.0), is_textured, unused);
        }
        material.emission = material.emission.clamp(Vec3::ZERO, Vec3::splat(MAX_EMISSION));
        unused.add("texture filters NEAREST", shown.as_ref().map_or(0, |shown| usize::from(shown.is_nearest)));
        material.diffuse_texture = texture.as_ref().map(|(texture, _)| *texture);
        let uvs = texture.map(|(_, coordinates)| coordinates);
        Look { material: builder.push_material(material), uvs, is_seen: opacity.is_some() }
    }

    /// Makes a material one that gives off its colour and answers no light.
    fn unlight(&self, material: &mut Material, colour: Vec3, is_textured: bool, unused: &mut Unused) {
        let Material { name, transmission, .. } = std::mem::take(material);
        *material = Material { name, transmission, ambient: Vec3::ZERO, diffuse: Vec3::ZERO, ..Material::default() };
        match (is_textured, self.unlit) {
            (false, _) => material.emission = colour,
            (true, Unlit::ByAmbientLight) => material.ambient = colour,
            (true, Unlit::Matt) => {
                (material.ambient, material.diffuse) = (colour, colour);
                unused.note("unlit among lit materials: matt");
            }
        }
    }

    /// What a material tells of a texture; none when it leads nowhere.
    fn shown(&self, info: &Info, unused: &mut Unused) -> Option<Shown> {
        let root = self.source.root;
        let texture = root.textures.get(info.index.value());
        let image = texture.map(|texture| texture.source.value()).filter(|&image| image < root.images.len());
        let (Some(texture), Some(image)) = (texture, image) else {
            unused.note("textures without a picture");
            return None;
        };
        let sampler = texture.sampler.and_then(|sampler| root.samplers.get(sampler.value()));
        let wrap = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(mode) => mode,
            Checked::Invalid => WrappingMode::Repeat,
        };
        let moved = info.extensions.as_ref().and_then(|all| all.texture_transform.as_ref());
        let transform = moved.map_or(DAffine2::IDENTITY, |moved| {
            // As the extension has it: counter-clockwise where v is downwards.
            let (sin, cos) = f64::from(moved.rotation.0).sin_cos();
            let turn = DMat2::from_cols(DVec2::new(cos, -sin), DVec2::new(sin, cos));
            let vector = |v: [f32; 2]| DVec2::from(v.map(f64::from));
            DAffine2::from_mat2_translation(turn * DMat2::from_diagonal(vector(moved.scale.0)), vector(moved.offset.0))
        });
        Some(Shown {
            image,
            wraps: sampler.map_or([WrappingMode::Repeat; 2], |sampler| [wrap(sampler.wrap_s), wrap(sampler.wrap_t)]),
            is_nearest: sampler.is_some_and(|s| s.mag_filter == Some(Checked::Valid(MagFilter::Nearest))),
            set: moved.and_then(|moved| moved.tex_coord).unwrap_or(info.tex_coord),
            transform,
        })
    }

    /// The scene's texture of what is shown, and its coordinates.
    fn texture(&mut self, shown: &Shown, builder: &mut Builder) -> Option<(TextureId, Coordinates)> {
        let mirrored = shown.wraps.map(|mode| mode == WrappingMode::MirroredRepeat);
        let images = &mut self.images;
        let kept = self.textures.entry((shown.image, mirrored)).or_insert_with(|| {
            let (image, [across, down]) = images.image(shown.image, mirrored)?;
            let share = |doubled: bool| if doubled { 0.5 } else { 1.0 };
            Some(Kept { texture: builder.add_texture(image), share: DVec2::new(share(across), share(down)) })
        });
        let Kept { texture, share } = (*kept)?;
        let transform = DAffine2::from_scale(share) * shown.transform;
        let is_clamped = shown.wraps.map(|mode| mode == WrappingMode::ClampToEdge);
        Some((texture, Coordinates { set: shown.set, transform, is_clamped }))
    }

    /// How much of a surface is there; none where its mask hides it everywhere.
    fn opacity(
        &self,
        material: &Description,
        factor: f32,
        summary: Option<Summary>,
        unused: &mut Unused,
    ) -> Option<f32> {
        let (low, high) = summary.map_or((1.0, 1.0), |summary| (summary.range.0.w, summary.range.1.w));
        let (low, high) = (factor * low, factor * high);
        match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => {
                let cutoff = material.alpha_cutoff.map_or(DEFAULT_CUTOFF, |cutoff| cutoff.0);
                if low < cutoff && high >= cutoff {
                    unused.note("alpha masks of textures: what they cut out is seen");
                }
                (high >= cutoff).then_some(1.0)
            }
            Checked::Valid(AlphaMode::Blend) => {
                if low < high {
                    unused.note_reduced("alpha of textures");
                }
                Some(factor * summary.map_or(1.0, |summary| summary.values.w))
            }
            _ => Some(1.0),
        }
    }

    /// The mean of a texture that no surface shows, 1 without one.
    fn mean(
        &mut self,
        info: Option<&Info>,
        name: &'static str,
        part: impl Fn(&Summary) -> Vec3,
        unused: &mut Unused,
    ) -> Vec3 {
        let shown = info.and_then(|info| self.shown(info, unused));
        let Some(summary) = shown.and_then(|shown| self.images.summary(shown.image)) else { return Vec3::ONE };
        if !summary.is_plain() || summary.range.0.w != summary.range.1.w {
            unused.note_reduced(name);
        }
        part(&summary)
    }

    fn emission(&mut self, material: &Description, extensions: &Extensions, unused: &mut Unused) -> Vec3 {
        let strength = extensions.emissive_strength.as_ref().map_or(1.0, |strength| strength.emissive_strength.0);
        let factor = at_least_zero(Vec3::from(material.emissive_factor.0) * strength);
        if factor == Vec3::ZERO {
            return factor;
        }
        factor * self.mean(material.emissive_texture.as_ref(), "emissive textures", |s| s.colour, unused)
    }

    /// What a surface is beside its colour.
    fn finish_of(
        &mut self,
        material: &Description,
        extensions: &Extensions,
        mean: Vec3,
        unused: &mut Unused,
    ) -> Finish {
        let ior = extensions.ior.as_ref().map_or(DEFAULT_IOR, |ior| ior.ior.0);
        let ior = if ior >= 1.0 && ior.is_finite() { ior } else { DEFAULT_IOR };
        let transmission = self.transmission(extensions, unused);
        if let Some(glossy) = &extensions.pbr_specular_glossiness {
            let (info, name) = (glossy.specular_glossiness_texture.as_ref(), "specular-glossiness textures");
            let specular = zero_to_one3(glossy.specular_factor.0.into()) * self.mean(info, name, |s| s.colour, unused);
            let gloss = self.mean(info, name, |s| Vec3::splat(s.values.w), unused).x;
            let roughness = 1.0 - glossy.glossiness_factor.0.clamp(0.0, 1.0) * gloss;
            let metal = ((specular - DIELECTRIC) / (1.0 - DIELECTRIC)).max(Vec3::ZERO);
            // Where there is a texture, its colours are those of the metal's rough part as well.
            let scattered = if glossy.diffuse_texture.is_some() { Vec3::ZERO } else { metal };
            return Finish { roughness, metallic: 0.0, metal, scattered, reflectance: specular, ior, transmission };
        }
        let pbr = &material.pbr_metallic_roughness;
        let info = pbr.metallic_roughness_texture.as_ref();
        let texture = self.mean(info, "metallic-roughness textures", |s| s.values.truncate(), unused);
        let roughness = zero_to_one3(Vec3::splat(pbr.roughness_factor.0)).x * texture.y;
        let metallic = zero_to_one3(Vec3::splat(pbr.metallic_factor.0)).x * texture.z;
        let dielectric = ((ior - 1.0) / (ior + 1.0)).powi(2) * self.specular(extensions.specular.as_ref(), unused);
        let reflectance = dielectric.min(Vec3::ONE).lerp(mean, metallic);
        let transmission = transmission * (1.0 - metallic);
        if transmission > 0.0 && roughness > 0.0 {
            unused.note("roughness of what is transmitted");
        }
        let (metal, scattered) = (mean * metallic, Vec3::ZERO);
        Finish { roughness, metallic, metal, scattered, reflectance, ior, transmission }
    }

    fn specular(&mut self, extension: Option<&Specular>, unused: &mut Unused) -> Vec3 {
        let Some(specular) = extension else { return Vec3::ONE };
        let strength =
            self.mean(specular.specular_texture.as_ref(), "specular textures", |s| Vec3::splat(s.values.w), unused);
        let colour =
            self.mean(specular.specular_color_texture.as_ref(), "specular colour textures", |s| s.colour, unused);
        let factor = at_least_zero(specular.specular_color_factor.0.into());
        factor * colour * strength * zero_to_one3(Vec3::splat(specular.specular_factor.0))
    }

    fn transmission(&mut self, extensions: &Extensions, unused: &mut Unused) -> f32 {
        let Some(extension) = &extensions.transmission else { return 0.0 };
        let factor = zero_to_one3(Vec3::splat(extension.transmission_factor.0)).x;
        if factor == 0.0 {
            return 0.0;
        }
        let is_thin = |volume: &Volume| volume.thickness_factor.0 <= 0.0;
        if extensions.volume.as_ref().is_none_or(is_thin) {
            unused.note("thin walls: they refract as solids");
        }
        if let Some(volume) = &extensions.volume {
            unused.add("attenuation in volumes", usize::from(volume.attenuation_distance.0.is_finite()));
        }
        factor
            * self
                .mean(extension.transmission_texture.as_ref(), "transmission textures", |s| s.values.truncate(), unused)
                .x
    }
}

/// What a surface is beside its colour.
struct Finish {
    roughness: f32,
    metallic: f32,
    /// The colour of the metal's reflections.
    metal: Vec3,
    /// Of that what the base colour does not have.
    scattered: Vec3,
    /// What it reflects of a straight look.
    reflectance: Vec3,
    ior: f32,
    transmission: f32,
}

impl Finish {
    /// The material of base colour `colour`, which is `mean` with its texture, and of which `opacity` is there.
    ///
    /// The highlight is as wide and, up to 1, as high as the format's own: at its middle the lobe of Trowbridge and
    /// Reitz (GGX) gives back D f / 4 of a light, D = 1 / (π r⁴) and f the reflectance of a straight look, where a matt
    /// surface gives back 1 / π; so specular is f / (4 r⁴). The exponent of the Blinn–Phong lobe of the same width is
    /// 2 / r⁴ - 2 (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, section 5.2).
    fn material(&self, colour: Vec3, mean: Vec3, opacity: f32) -> Material {
        let Finish { roughness, metallic, metal, scattered, reflectance, ior, transmission } = *self;
        let sharp = (1.0 - roughness).powi(2);
        // What is mirrored sharply is not scattered.
        let diffuse = (colour * (1.0 - metallic * sharp) + scattered * (1.0 - sharp)).min(Vec3::ONE);
        let diffuse = diffuse * (1.0 - transmission) * opacity;
        let least = 2.0 / (Material::MAX_SHININESS + 2.0);
        let width = roughness.powi(4).max(least);
        let shininess = (2.0 / width - 2.0).clamp(0.0, Material::MAX_SHININESS);
        let specular = (reflectance / (4.0 * width)).min(Vec3::ONE) * opacity;
        Material {
            ambient: diffuse,
            diffuse,
            specular: if shininess >= 1.0 { specular } else { Vec3::ZERO },
            shininess,
            mirror: metal * sharp * opacity,
            transmission: Vec3::splat(1.0 - opacity) + opacity * transmission * mean,
            // What is only not quite there bends nothing.
            ior: if opacity < 1.0 && transmission == 0.0 { 1.0 } else { ior },
            ..Material::default()
        }
    }
}

fn at_least_zero(v: Vec3) -> Vec3 {
    Vec3::from_array(v.to_array().map(|x| if x > 0.0 { x.min(f32::MAX) } else { 0.0 }))
}

fn zero_to_one3(v: Vec3) -> Vec3 {
    at_least_zero(v).min(Vec3::ONE)
}

fn zero_to_one(v: Vec4) -> Vec4 {
    Vec4::from_array(v.to_array().map(|x| if x > 0.0 { x.min(1.0) } else { 0.0 }))
}
