//! `raybrook tune`, and what `--structure auto` makes of it.

use super::{folder, raybrook, stderr};
use serde_json::Value;
use std::path::Path;

const TUNE: [&str; 5] = ["tune", "one.obj", "--rays", "64", "--device"];

fn tuned_file(at: &Path) -> std::path::PathBuf {
    at.join("cache").join("tuned.json")
}

/// What a small picture on the reference says of its structure, and the lines before.
fn structure(at: &Path, arguments: &[&str]) -> String {
    let fixed = ["render", "one.obj", "--size", "8x8", "--device", "reference", "--explain"];
    let output = raybrook(at, &[&fixed, arguments].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let said = stderr(&output);
    let end = said.find("--packet-size").unwrap_or(said.len());
    said[..end].trim_end().to_owned()
}

/// Changes a text in the file, in which it must be.
fn edit(at: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(tuned_file(at)).unwrap();
    assert!(text.contains(from), "no {from} in {text}");
    std::fs::write(tuned_file(at), text.replace(from, to)).unwrap();
}

#[test]
fn auto_follows_the_file_while_it_is_whole_and_of_these_versions() {
    let folder = folder();
    let at = folder.path();
    let output = raybrook(at, &[&TUNE[..], &["reference", "--structure", "bvh2"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("one.obj: 1 triangles") && said.contains("tiny: bvh2: nothing is clearly faster"), "{said}");
    assert!(stderr(&output).contains("round 7 of 7"), "{}", stderr(&output));
    assert!(structure(at, &[]).starts_with("--structure bvh2: tuned for this device: nothing was clearly faster"));

    edit(at, "\"accel\": \"bvh2\"", "\"accel\": \"kd\"");
    assert!(structure(at, &[]).starts_with("--structure kd: tuned for this device: "), "{}", structure(at, &[]));
    for (arguments, expected) in [
        (&["--no-cache"][..], "--structure bvh2: model: "),
        (&["--structure", "octree"], "--structure octree: given on the command line"),
        (&["--grid-size", "2,2,2"], "--structure grid: model: "),
        (&["--precision", "fast"], "--structure bvh2: model: "),
    ] {
        let said = structure(at, arguments);
        assert!(said.starts_with(expected), "{said}");
    }

    edit(at, "\"driver_version\": \"\"", "\"driver_version\": \"older\"");
    let said = structure(at, &[]);
    assert!(
        said.starts_with("note: ") && said.contains("'older'") && said.contains("--structure bvh2: model: "),
        "{said}"
    );
    let text = std::fs::read(tuned_file(at)).unwrap();
    std::fs::write(tuned_file(at), &text[..text.len() / 2]).unwrap();
    let said = structure(at, &[]);
    assert!(
        said.starts_with("note: ") && said.contains("tuned.json") && said.contains("--structure bvh2: model: "),
        "{said}"
    );
    // What is given needs no file, and quiet is quiet.
    assert!(!structure(at, &["--structure", "kd", "--packet-size", "1"]).contains("note"));

    let forget = raybrook(at, &["tune", "--forget"]);
    assert!(forget.status.success() && !tuned_file(at).exists(), "{}", stderr(&forget));
    assert!(String::from_utf8_lossy(&forget.stdout).contains("tuned.json"));
    let again = raybrook(at, &["tune", "--forget"]);
    assert!(again.status.success() && String::from_utf8_lossy(&again.stdout).contains("nothing"), "{again:?}");
    assert!(structure(at, &[]).starts_with("--structure bvh2: model: "));
}

#[test]
fn nothing_is_remembered_without_a_cache_or_where_it_cannot_be_written() {
    let folder = folder();
    let at = folder.path();
    let arguments = [&TUNE[..], &["reference", "--structure", "bvh2", "--json"]].concat();
    let output = raybrook(at, &[&arguments[..], &["--no-cache", "-q"]].concat());
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["remembered"], &report["fastest"][0]["size"]), (&Value::Null, &"tiny".into()));
    assert_eq!(report["scenes"][0]["measured"][0]["accel"], "bvh2");
    assert!(!tuned_file(at).exists());
    std::fs::write(at.join("cache"), "a file where the folder should be").unwrap();
    super::assert_fails(&raybrook(at, &arguments), 5, &["cache"]);
}

/// On a device, kernels are compiled: two structures are enough.
#[test]
fn a_device_is_tuned_and_followed() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let at = folder.path();
    let index = device.info.index.to_string();
    let output = raybrook(at, &[&TUNE[..], &[&index, "--structure", "brute", "--json"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let measured = report["scenes"][0]["measured"].as_array().unwrap();
    assert_eq!((measured.len(), &measured[1]["accel"]), (2, &"brute".into()));
    assert!(measured.iter().all(|measured| measured["differing"] == 0), "{report}");
    assert_eq!(report["device"]["device"], device.info.name);
    let fastest = report["fastest"][0]["fastest"]["accel"].as_str().unwrap();
    let render = ["render", "one.obj", "--size", "8x8", "--device", &index, "--explain"];
    let said = stderr(&raybrook(at, &render));
    assert!(said.starts_with(&format!("--structure {fastest}: tuned for this device: ")), "{said}");
    // The reference is another device.
    assert!(structure(at, &[]).starts_with("--structure bvh2: model: "));
}
