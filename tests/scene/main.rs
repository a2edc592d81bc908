//! Scenes: made by hand, read from files of every format, refused, and the models of others.

#[path = "../common/mod.rs"]
mod common;

mod builder;
mod fuzzed;
mod gltf_files;
mod hostile;
mod instances;
mod models;
mod nff;
mod obj_files;
mod off_files;
mod ply_files;
mod ply_refused;
mod samples;
mod scene_file;
mod spd;
mod stl_files;
mod threemf_files;
mod upright;
