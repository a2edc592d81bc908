//! Kernels and twin mirror each other, file for file and name for name.

use std::collections::BTreeSet;
use std::path::Path;

const FOLDERS: [&str; 6] = ["shared", "intersect", "traverse", "points", "shade", "kernels"];

/// Files without a twin, in `cl/` or in `src/reference/`, and why they have none.
const WITHOUT_TWIN: &[(&str, &str)] = &[
    ("cl/shared/compiler.cl", "directives for device compilers"),
    ("cl/shared/internal_begin.cl", "directives for device compilers"),
    ("cl/shared/internal_end.cl", "directives for device compilers"),
    ("cl/shared/features.cl", "leaves out code; the twin has all of it"),
    ("cl/shared/types.cl", "generated from src/shared.rs"),
    ("cl/shared/constants.cl", "generated from src/shared.rs and src/shared/constants.rs"),
    ("cl/shared/extended.cl", "the twin has f64"),
    ("cl/shared/double_double.cl", "the twin goes from f64 to exact integers at once"),
    ("cl/shared/rounding_errors.cl", "compiled for several numbers of lanes; the twin's one is in ray.rs"),
    ("cl/intersect/exact_closer.cl", "the twin goes from f64 to exact integers at once"),
    ("cl/points/scene.cl", "where arrays lie; the twin reads src/pack/points.rs"),
    ("cl/kernels/count_hits_packets.cl", "sixteen rays at a time, with the answers of count_hits.cl"),
    ("cl/kernels/list_hits_packets.cl", "sixteen rays at a time, with the answers of list_hits.cl"),
    ("cl/kernels/add_samples.cl", "the twin has the samples of a pixel in one loop"),
    ("cl/kernels/adaptive.cl", "its twin is src/adaptive/, which also decides on the host"),
    ("cl/kernels/empty.cl", "computes nothing"),
    ("cl/kernels/limits.cl", "measures the device"),
    ("cl/kernels/render_packets.cl", "sixteen pixels at a time, with the answers of render.cl"),
    ("cl/kernels/trace_packets.cl", "sixteen rays at a time, with the answers of trace.cl"),
    ("cl/kernels/wavefront.cl", "several kernels, with the answers of render.cl"),
    ("src/reference/shared/memory.rs", "the folder cl/memory/, most of which is about where arrays lie"),
];

/// The names of the files of a folder without `.cl` or `.rs`.
fn names(folder: &Path, extension: &str) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let files =
        entries.map(|entry| entry.unwrap().path()).filter(|path| path.extension().is_some_and(|e| e == extension));
    files.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned()).filter(|name| name != "mod").collect()
}

#[test]
fn every_kernel_file_has_its_twin_and_every_twin_its_kernel_file() {
    let root = crate::common::root();
    let mut alone = BTreeSet::new();
    for folder in FOLDERS {
        let kernels = names(&root.join("cl").join(folder), "cl");
        let twins = names(&root.join("src/reference").join(folder), "rs");
        assert!(!kernels.is_empty() && !twins.is_empty(), "{folder}");
        alone.extend(kernels.difference(&twins).map(|name| format!("cl/{folder}/{name}.cl")));
        alone.extend(twins.difference(&kernels).map(|name| format!("src/reference/{folder}/{name}.rs")));
    }
    let excepted: BTreeSet<_> = WITHOUT_TWIN.iter().map(|(path, _)| (*path).to_owned()).collect();
    assert_eq!(excepted.len(), WITHOUT_TWIN.len(), "a path stands in the table twice");
    let missing: Vec<_> = alone.difference(&excepted).collect();
    assert!(missing.is_empty(), "without a file of the same name on the other side: {missing:?}");
    let stale: Vec<_> = excepted.difference(&alone).collect();
    assert!(stale.is_empty(), "have a twin, or do not exist: {stale:?}");
}
