//! What is done with an input of each kind, and what must hold then: a function for each fuzz target. The targets call
//! them with inputs that libFuzzer makes, and `tests/scene/fuzzed.rs` with those that are kept in `seeds/`.
//!
//! No input may panic, or have more memory taken than a load may take ([`folder::Folder::budget`]) and libFuzzer allows
//! (`run.sh`). What can be used must pass the checks that follow in each file.

mod caches;
mod folder;
mod journals;
mod models;
mod options;
mod rays;
mod scene;

pub use caches::{kernel_cache, tuned};
pub use journals::{batch_journal, picture_journal};
pub use models::{gltf, mtl, nff, obj, off, ply, stl, texture, threemf, toml};
pub use options::options;
pub use rays::npz;

/// Does with an input what must be done, panics where something does not hold, and tells whether
/// the input could be used.
pub type Target = fn(&[u8]) -> bool;

/// All targets by their names, which are those of `targets/` and `seeds/`.
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

/// What stands between the pieces of an input that is put together from several.
const BETWEEN: &[u8] = b"\n----\n";

/// The pieces of an input.
fn pieces(data: &[u8]) -> Vec<&[u8]> {
    let (mut all, mut rest) = (Vec::new(), data);
    while let Some(end) = rest.windows(BETWEEN.len()).position(|window| window == BETWEEN) {
        all.push(&rest[..end]);
        rest = &rest[end + BETWEEN.len()..];
    }
    all.push(rest);
    all
}
