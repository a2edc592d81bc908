//! What a scene needs of the kernels that shade: each feature that it does without is left out of its kernels
//! (`cl/shared/features.cl`), where it would cost registers, instructions and room on the stack of pending rays even if
//! no ray ever asked for it.
//!
//! The scalar twin has all features: that it and a specialised kernel agree to the bit shows that nothing was left out
//! that matters.
//!
//! Bad at: a new combination of features is a new program, which is compiled once on each device. Kernels that trace
//! batches do not shade, and are the same for all scenes.

use crate::scene::{Falloff, Light, LightKind, MaterialId, NO_INDEX, Scene, Texture};
use crate::shared::Feature;
use std::fmt;

/// A set of features.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Features(u32);

impl Features {
    /// All of them.
    pub const ALL: Features = Features((1 << Feature::ALL.len()) - 1);

    /// Those that `scene` needs: of its materials only those of triangles count.
    pub fn of_scene(scene: &Scene) -> Features {
        Self::of_materials(scene, &scene.used_materials())
    }

    /// The same where the [used materials](Scene::used_materials) are known.
    pub(crate) fn of_materials(scene: &Scene, used: &[MaterialId]) -> Features {
        let mut features = Features(0);
        for &material in used {
            let material = &scene.materials[material as usize];
            match material.diffuse_texture.and_then(|id| scene.textures.get(id as usize)) {
                Some(Texture::Image(_)) => features.add(Feature::ImageTextures),
                Some(Texture::Procedural(_)) => features.add(Feature::ProceduralTextures),
                None => {}
            }
            features.add_if(material.is_transparent(), Feature::Transparency);
            // A transparent surface mirrors by Fresnel's equations alone.
            features.add_if(!material.is_transparent() && material.mirror.max_element() > 0.0, Feature::Mirrors);
            features.add_if(material.specular.max_element() > 0.0, Feature::Highlights);
            features.add_if(material.toon.is_some(), Feature::Toon);
        }
        features.add_if(used.len() > 1, Feature::SeveralMaterials);
        let of_objects = scene.instances.objects().iter().flat_map(|object| &object.triangles);
        let mut triangles = scene.triangles.iter().chain(of_objects);
        features.add_if(triangles.any(|triangle| !triangle.normals.contains(&NO_INDEX)), Feature::SmoothNormals);
        features.add_if(scene.sky.is_some(), Feature::Sky);
        features.with_lights(scene.shining_lights().map(|(_, light)| light))
    }

    /// These, with what `lights` need in place of what other lights did.
    #[must_use]
    pub(crate) fn with_lights<'a>(self, lights: impl Iterator<Item = &'a Light>) -> Features {
        const OF_LIGHTS: [Feature; 5] = [
            Feature::PlacedLights,
            Feature::DirectionalLights,
            Feature::Spots,
            Feature::Falloff,
            Feature::SeveralLights,
        ];
        let mut features = OF_LIGHTS.into_iter().fold(self, Features::without);
        let mut count = 0;
        for light in lights {
            features.add(match light.kind {
                LightKind::Directional { .. } => Feature::DirectionalLights,
                LightKind::Point { .. } | LightKind::Spot { .. } => Feature::PlacedLights,
            });
            features.add_if(matches!(light.kind, LightKind::Spot { .. }), Feature::Spots);
            features.add_if(light.falloff == Falloff::Quadratic, Feature::Falloff);
            count += 1;
        }
        features.add_if(count != 1, Feature::SeveralLights);
        features
    }

    /// Whether `feature` is among them.
    pub const fn has(self, feature: Feature) -> bool {
        self.0 & feature.bit() != 0
    }

    /// These and `feature`.
    #[must_use]
    pub const fn with(self, feature: Feature) -> Features {
        Features(self.0 | feature.bit())
    }

    /// These without `feature`.
    #[must_use]
    pub const fn without(self, feature: Feature) -> Features {
        Features(self.0 & !feature.bit())
    }

    /// Whether kernels with these read normals and texture coordinates of triangles; else a triangle has no shading
    /// data but its material.
    pub const fn need_shading_data(self) -> bool {
        self.has(Feature::SmoothNormals) || self.has(Feature::ImageTextures) || self.has(Feature::ProceduralTextures)
    }

    /// Whether surfaces send secondary rays but for shadow rays.
    pub const fn send_rays(self) -> bool {
        self.has(Feature::Mirrors) || self.has(Feature::Transparency)
    }

    /// One bit for each, see [`Feature::bit`].
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The features, in the order of [`Feature::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Feature> {
        Feature::ALL.iter().copied().filter(move |&feature| self.has(feature))
    }

    /// The most rays of a path that can wait at a time when a chain of rays is at most `max_depth` long. Every surface
    /// replaces the ray that found it by one, or where something is transparent by at most two; and at the last depth
    /// by none.
    pub fn pending_rays(self, max_depth: u32) -> u32 {
        if self.has(Feature::Transparency) { max_depth.max(1) } else { 1 }
    }

    fn add(&mut self, feature: Feature) {
        *self = self.with(feature);
    }

    fn add_if(&mut self, condition: bool, feature: Feature) {
        if condition {
            self.add(feature);
        }
    }
}

/// As a list: `smooth-normals, highlights`; `none`.
impl fmt::Display for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.iter().map(Feature::name).collect();
        f.write_str(if names.is_empty() { "none" } else { "" })?;
        f.write_str(&names.join(", "))
    }
}
