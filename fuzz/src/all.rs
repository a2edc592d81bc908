//! All fuzz targets: those of the library, and those of the program.

#[path = "lib.rs"]
pub mod library;
pub mod program;

pub use library::{
    batch_journal, gltf, kernel_cache, mtl, nff, npz, obj, off, options, picture_journal, ply, stl, texture, threemf,
    toml, tuned,
};
pub use program::{stress_journal, turntable_manifest};
