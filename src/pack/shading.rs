//! Packs what shading reads: of materials and textures only those that some triangle has, of lamps only those that
//! shine.

use super::textures::pack_textures;
use crate::error::{Error, Result};
use crate::layout::Float4;
use crate::math::unit_normals;
use crate::options::TextureFilter;
use crate::parallel;
use crate::scene::{self, Falloff, LightKind, MaterialId, Scene, TextureId, Triangle};
use crate::shared::{
    LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT, Light, MAX_RADIANCE, Material, NO_TEXTURE, Shading, TextureInfo,
};
use glam::{DVec3, Vec2, Vec3};

pub(super) struct ShadingArrays {
    pub materials: Vec<Material>,
    pub lights: Vec<Light>,
    pub textures: Vec<TextureInfo>,
    pub texels: Vec<u32>,
    /// See [`super::SceneBuffers::brightest`].
    pub brightest: f32,
}

impl ShadingArrays {
    /// `used`: [`Scene::used_materials`].
    ///
    /// # Errors
    /// [`Error::Scene`] when there are more texels than 32 bits can number, or when a light is too far away to be a
    /// point.
    pub fn new(scene: &Scene, used: &[MaterialId], scale: f32, filter: TextureFilter) -> Result<ShadingArrays> {
        let mut used_textures: Vec<_> =
            used.iter().filter_map(|&id| scene.materials[id as usize].diffuse_texture).collect();
        used_textures.sort_unstable();
        used_textures.dedup();
        let (textures, texels) = pack_textures(scene, &used_textures, scale, filter)?;
        let lights = scene.shining_lights();
        Ok(ShadingArrays {
            materials: used
                .iter()
                .map(|&id| pack_material(&scene.materials[id as usize], scene.ambient, &used_textures))
                .collect(),
            lights: lights.map(|(i, light)| pack_light(i, light, scale)).collect::<Result<_>>()?,
            textures,
            texels,
            brightest: brightest(scene, used),
        })
    }
}

/// The place of `id` in a sorted list that has it.
fn place_of(id: u32, used: &[u32]) -> u32 {
    used.binary_search(&id).expect("the list has all that are used") as u32
}

/// One for each triangle of a scene without instances. `used`: [`Scene::used_materials`].
pub(super) fn shading_of(scene: &Scene, used: &[MaterialId]) -> Vec<Shading> {
    let of = |material| ShadingOf { normals: &scene.normals, uvs: &scene.uvs, material };
    let pack = |t: &Triangle| pack_shading(t, &of(place_of(t.material, used) as usize), unit_normals);
    parallel::map_slice(&scene.triangles, pack)
}

/// What the shading data of a triangle is made of, beside its indices.
pub(super) struct ShadingOf<'a> {
    pub normals: &'a [Vec3],
    pub uvs: &'a [Vec2],
    /// Place of the material among those that are used.
    pub material: usize,
}

/// `normals` makes of the corners' normals as they are given, zero without one, those that are packed.
pub(super) fn pack_shading(triangle: &Triangle, of: &ShadingOf, normals: impl Fn([Vec3; 3]) -> [Vec3; 3]) -> Shading {
    let normal = |i: u32| of.normals.get(i as usize).copied().unwrap_or(Vec3::ZERO);
    let normals = normals(triangle.normals.map(normal));
    let uvs = triangle.uvs.map(|i| of.uvs.get(i as usize).copied().unwrap_or_default());
    Shading {
        normal0_u0: Float4::new(normals[0], uvs[0].x),
        normal1_u1: Float4::new(normals[1], uvs[1].x),
        normal2_u2: Float4::new(normals[2], uvs[2].x),
        v0: uvs[0].y,
        v1: uvs[1].y,
        v2: uvs[2].y,
        material: of.material as u32,
    }
}

/// Colours are limited like radiance, so that sums and products of two cannot make NaN of a zero and an infinity.
pub(super) fn pack_colour(colour: Vec3) -> Float4 {
    Float4::new(colour.min(Vec3::splat(MAX_RADIANCE)), 0.0)
}

/// A direction of any length but 0, which becomes 1.
pub(super) fn pack_direction(direction: Vec3) -> Float4 {
    Float4::new(DVec3::from(direction).normalize_or(DVec3::NEG_Y).as_vec3(), 0.0)
}

fn pack_material(material: &scene::Material, ambient: Vec3, used_textures: &[TextureId]) -> Material {
    Material {
        ambient: pack_colour(material.ambient * ambient),
        diffuse: pack_colour(material.diffuse),
        specular_shininess: Float4 {
            w: material.shininess.clamp(0.0, scene::Material::MAX_SHININESS),
            ..pack_colour(material.specular)
        },
        mirror: Float4::new(material.mirror, 0.0),
        transmission_ior: Float4::new(material.transmission, material.ior),
        emission: Float4::new(material.emission, 0.0),
        texture: material.diffuse_texture.map_or(NO_TEXTURE, |id| place_of(id, used_textures)),
        transparent: u32::from(material.is_transparent()),
        toon_steps: material.toon.map_or(0, |toon| toon.steps),
        toon_threshold: material.toon.map_or(0.0, |toon| toon.threshold),
    }
}

pub(super) fn pack_light(index: usize, light: &scene::Light, scale: f32) -> Result<Light> {
    // Tracing space ends at 2^128, the scene at 2^21: what lies beyond is seen from everywhere in the same direction.
    let place = |position: Vec3| {
        let scaled = position * scale;
        let reason = || {
            format!(
                "light {index}: {position} is over 2^106 times as far away as the scene is large; make it directional"
            )
        };
        if scaled.is_finite() { Ok(Float4::new(scaled, 0.0)) } else { Err(Error::Scene(reason())) }
    };
    let mut packed = Light {
        intensity: Float4::new(light.intensity, 0.0),
        falloff_scale: match light.falloff {
            Falloff::None => 0.0,
            Falloff::Quadratic => scale,
        },
        ..Light::default()
    };
    match light.kind {
        LightKind::Point { position } => {
            packed.kind = LIGHT_POINT;
            packed.position = place(position)?;
        }
        LightKind::Directional { direction } => {
            packed.kind = LIGHT_DIRECTIONAL;
            packed.direction = pack_direction(direction);
        }
        LightKind::Spot { position, direction, inner_degrees, outer_degrees } => {
            packed.kind = LIGHT_SPOT;
            packed.position = place(position)?;
            packed.direction = pack_direction(direction);
            packed.cos_outer = outer_degrees.to_radians().cos();
            // A hard edge is the steepest ramp that float32 can hold.
            packed.cos_inner = inner_degrees.to_radians().cos().max(packed.cos_outer.next_up());
        }
    }
    Ok(packed)
}

/// A bound of the radiance of one surface per unit of weight; infinite with a light whose strength has no bound nearby.
fn brightest(scene: &Scene, used: &[MaterialId]) -> f32 {
    // In f64, where neither sums nor products of colours become infinite.
    let mut lights = DVec3::ZERO;
    for light in &scene.lights {
        if light.falloff == Falloff::Quadratic {
            return f32::INFINITY;
        }
        lights += light.intensity.as_dvec3();
    }
    let background = scene.background.bottom.max(scene.background.top);
    let sky = scene.sky.unwrap_or_default();
    let surfaces = used
        .iter()
        .map(|&id| {
            let m = &scene.materials[id as usize];
            let [ambient, emission] = [m.ambient.as_dvec3() * scene.ambient.as_dvec3(), m.emission.as_dvec3()];
            let sky = m.diffuse.as_dvec3() * (sky.top.max(sky.bottom).as_dvec3() + sky.viewer.as_dvec3());
            ambient + emission + sky + (m.diffuse.as_dvec3() + m.specular.as_dvec3()) * lights
        })
        .fold(background.as_dvec3(), DVec3::max);
    surfaces.max_element() as f32
}
