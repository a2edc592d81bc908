//! Pictures: on a device and in the twin, pixel by pixel.

#[path = "../common/mod.rs"]
mod common;

mod adaptive;
mod crop;
mod features;
mod images;
mod layers;
mod roulette;
mod several;
mod shading;
mod texture_filter;
mod truth;
mod wavefront;
