//! `--compiler-options`.

use crate::common::{device, root};
use std::process::Command;

#[test]
fn the_command_line_hands_them_on_and_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let scene = &root().join("scenes/showcase.toml").display().to_string();
    let raybrook = |device: &str, options: &str| {
        let (picture, stats) = (at("a.png"), at("stats.json"));
        let words = ["render", scene, "--size", "8x6", "-o", &picture, "--stats", &stats, "--device", device];
        let mut command = Command::new(env!("CARGO_BIN_EXE_raybrook"));
        command.args(words).args(["--compiler-options", options]).env("RAYBROOK_CACHE_DIR", at("cache"));
        command.output().unwrap()
    };
    let refused = raybrook("reference", "-w");
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--compiler-options: the reference has no compiler"));

    let Some(device) = device() else { return };
    let done = raybrook(&device.info.index.to_string(), "-cl-mad-enable -w");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["compiler_options"], "-cl-mad-enable -w");
}
