//! What the program makes of the limit of compiled kernels.

use super::{assert_fails, folder, raybrook_with, stderr};

/// A limit of 0 keeps no kernels, one that is no number is refused.
#[test]
fn the_limit_of_the_cache_is_read() {
    let folder = folder();
    // What is quick to compile.
    let quick = ["--structure", "brute", "--intersector", "moller-trumbore"];
    let render = [&["render", "one.obj", "--size", "8x8"][..], &quick, &["--device"]].concat();
    let with = |device: &str, megabytes| {
        raybrook_with(
            folder.path(),
            &[&render[..], &[device]].concat(),
            &[("RAYBROOK_CACHE_MB", megabytes), ("POCL_KERNEL_CACHE", "0")],
        )
    };
    assert_fails(&with("reference", "many"), 2, &["RAYBROOK_CACHE_MB", "'many'", "megabytes"]);
    let Some(device) = crate::common::device() else { return };
    for (megabytes, is_kept) in [("0", false), ("20", true)] {
        let output = with(&device.info.index.to_string(), megabytes);
        assert!(output.status.success(), "{}", stderr(&output));
        assert_eq!(folder.path().join("cache").exists(), is_kept, "{megabytes} MB");
    }
}
