//! What is done with an input of each kind that the library reads, and what must hold then: a function for each fuzz
//! target. The targets call them with inputs that libFuzzer makes, and `tests/scene/fuzzed.rs` with those that are kept
//! in `seeds/`. `program.rs` has what the program alone reads.
//!
//! No input may panic, or have more memory taken than a load may take ([`folder::Folder::budget`]) and libFuzzer allows
//! (`run.sh`). What can be used must pass the checks that follow in each file.

mod caches;
mod errors;
mod folder;
mod journals;
mod models;
mod options;
mod rays;
mod records;
mod scene;
mod target;

pub use caches::{kernel_cache, tuned};
pub use journals::{batch_journal, picture_journal};
pub use models::{gltf, mtl, nff, obj, off, ply, stl, texture, threemf, toml};
pub use options::options;
pub use rays::npz;

use records::pieces;
use target::Target;

/// These targets by their names, which are those of `targets/` and `seeds/`.
pub const TARGETS: [(&str, Target); 16] = [
    ("batch_journal", batch_journal),
    ("gltf", gltf),
    ("kernel_cache", kernel_cache),
    ("mtl", mtl),
    ("nff", nff),
    ("npz", npz),
    ("obj", obj),
    ("off", off),
    ("options", options),
    ("picture_journal", picture_journal),
    ("ply", ply),
    ("stl", stl),
    ("texture", texture),
    ("threemf", threemf),
    ("toml", toml),
    ("tuned", tuned),
];
