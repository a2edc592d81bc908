//! Twins of `cl/shade/`, file for file: surfaces, textures and light. The reasons are there.

pub mod camera;
pub mod footprint;
pub mod light;
pub mod local_light;
pub mod normal;
pub mod procedural;
pub mod roulette;
pub mod scene;
pub mod surface;
pub mod texture;
pub mod whitted;
