//! `raybrook check --truth` and `raybrook info --cross-check` from outside.

use super::{assert_fails, folder, raybrook, stderr};
use crate::common::root;
use std::path::Path;

const SMALL: [&str; 8] = ["--size", "40x40", "--samples", "1", "--device", "reference", "--truth-rays", "200"];

fn check(folder: &Path, scene: &str, more: &[&str]) -> std::process::Output {
    let scene = root().join("scenes").join(scene);
    let scene = scene.to_str().unwrap();
    raybrook(folder, &[&["check", "--truth", scene][..], &SMALL, more].concat())
}

#[test]
fn exact_methods_pass_and_everything_is_told() {
    let folder = folder();
    let output = check(folder.path(), "cornell.toml", &["--stats", "a.json", "-o", "a.png"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}{}", stderr(&output));
    for word in ["camera", "shadow", "reflected", "refracted", "any hit", "0 wrong of 1600", "passed"] {
        assert!(said.contains(word), "'{word}' is missing in: {said}");
    }
    assert!(folder.path().join("a.png").is_file());
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("a.json")).unwrap()).unwrap();
    assert_eq!(
        (&json["passed"], &json["picture"]["wrong"], &json["rays"]["strict"]),
        (&true.into(), &0.into(), &true.into())
    );
    let kinds = json["rays"]["kinds"].as_array().unwrap();
    assert!(kinds.iter().all(|kind| kind["wrong"] == 0 && kind["tested"].as_u64() > Some(0)), "{kinds:?}");
    assert_eq!(kinds.len(), 5);
}

#[test]
fn methods_that_are_wrong_end_with_1() {
    let folder = folder();
    let thesis = ["--structure", "kd", "--traversal", "thesis-restart", "--intersector", "thesis"];
    let output = check(folder.path(), "cornell.toml", &thesis);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}{}", stderr(&output));
    assert!(said.contains("FAILED") && said.contains("worst wrong"), "{said}");
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let folder = folder();
    let run = |arguments: &[&str]| raybrook(folder.path(), &[&["check", "one.obj"], arguments].concat());
    assert_fails(&run(&["--truth", "--error", "2"]), 2, &["--error"]);
    assert_fails(&run(&["--truth-rays", "5"]), 2, &["--truth"]);
    assert_fails(&run(&["--truth", "--device", "reference", "--roulette", "0.1"]), 2, &["--roulette", "chance"]);
    assert_fails(&run(&["--truth", "--truth-rays", "0"]), 2, &["--truth-rays"]);
    let small = ["--truth", "--device", "reference", "--memory-limit", "500M", "--size", "65535x65535"];
    assert_fails(&run(&small), 4, &["judging a picture", "--size"]);
}

#[test]
fn another_reader_agrees_or_tells_why_not() {
    let folder = folder();
    let info = |name: &str, more: &[&str]| {
        let output = raybrook(folder.path(), &[&["info", name, "--cross-check"], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    assert!(info("one.obj", &[]).contains("tobj reads the same 1 triangles"));
    let arrow = "v 2 1 0\nv 0 0 0\nv -2 1 0\nv 0 -1 0\nf 1 2 3 4\n";
    std::fs::write(folder.path().join("arrow.obj"), arrow).unwrap();
    let said = info("arrow.obj", &[]);
    assert!(said.contains("positions: ") && said.contains("concave"), "{said}");
    let json: serde_json::Value = serde_json::from_str(&info("arrow.obj", &["--json"])).unwrap();
    assert_eq!(json["cross_check"]["tobj_triangles"], 2);
    assert_eq!(json["cross_check"]["reasons"][0], "polygons");
    let output =
        raybrook(folder.path(), &["info", root().join("scenes/cornell.toml").to_str().unwrap(), "--cross-check"]);
    assert_fails(&output, 3, &[".obj"]);
}
