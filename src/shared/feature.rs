//! The features of the kernels that shade (`cl/shared/features.cl`).

use crate::names::names;

names! {
    /// One feature of the kernels that shade; the values number the bits of [`Features`](crate::features::Features).
    pub enum Feature ("feature") {
        /// Textures that are pictures.
        ImageTextures = "image-textures",
        /// Textures that are computed.
        ProceduralTextures = "procedural-textures",
        /// Normals of vertices.
        SmoothNormals = "smooth-normals",
        /// Mirrors.
        Mirrors = "mirrors",
        /// Surfaces that light passes through.
        Transparency = "transparency",
        /// Highlights.
        Highlights = "highlights",
        /// Threshold shading.
        Toon = "toon",
        /// Lamps that are somewhere: point lights and spots.
        PlacedLights = "placed-lights",
        /// Lamps that are infinitely far.
        DirectionalLights = "directional-lights",
        /// Lamps with a cone.
        Spots = "spots",
        /// Light that falls with the distance.
        Falloff = "falloff",
        /// Another number of lamps than one.
        SeveralLights = "several-lights",
        /// More than one material.
        SeveralMaterials = "several-materials",
        /// Light of a sky and from the viewer.
        Sky = "sky",
    }
}

impl Feature {
    /// Its bit in [`Features::bits`](crate::features::Features::bits).
    pub const fn bit(self) -> u32 {
        1 << self as u32
    }

    /// The name in `cl/shared/types.cl`: `FEATURE_SMOOTH_NORMALS`.
    pub fn cl_name(self) -> String {
        format!("FEATURE_{}", self.name().replace('-', "_").to_uppercase())
    }
}
