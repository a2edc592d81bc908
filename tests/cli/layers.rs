//! Layers of pictures on the command line: channels of an .exr file, or pictures beside a .png.

use super::{assert_fails, folder, raybrook, stderr};
use std::path::Path;

const FIXED: [&str; 8] = ["render", "one.obj", "--device", "reference", "--size", "9x7", "--samples", "1"];

fn render(at: &Path, arguments: &[&str]) -> std::process::Output {
    raybrook(at, &[&FIXED[..], arguments].concat())
}

/// Whether an OpenEXR file's header has a channel of this name and kind: 0 for whole numbers, 2 for 32-bit floats.
fn has_channel(file: &[u8], name: &str, kind: u8) -> bool {
    let entry = [b"\0", name.as_bytes(), &[0, kind, 0, 0, 0]].concat();
    file[..file.len().min(900)].windows(entry.len()).any(|bytes| bytes == entry)
}

#[test]
fn an_exr_has_the_layers_in_it_and_a_png_beside_it() {
    let folder = folder();
    let at = folder.path();
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    let layers = ["--layers", "depth,normal,geometric-normal,uv,albedo,primitive,material,steps"];
    let plain = render(at, &["-o", "plain.exr"]);
    let output = render(at, &[&["-o", "a.exr", "--stats", "s.json"], &layers[..]].concat());
    assert!(plain.status.success() && output.status.success(), "{}", stderr(&output));
    let file = read("a.exr");
    for name in ["depth.Z", "normal.X", "normal.Z", "geometric_normal.Y", "uv.U", "uv.V", "albedo.R", "albedo.B", "R"] {
        assert!(has_channel(&file, name, 2), "{name}");
    }
    assert!(has_channel(&file, "primitive.X", 0) && has_channel(&file, "steps.X", 0));
    assert!(!has_channel(&read("plain.exr"), "depth.Z", 2));
    let stats: serde_json::Value = serde_json::from_slice(&read("s.json")).unwrap();
    assert!(stats["layers_s"].as_f64().unwrap() > 0.0 && stats["rays"]["camera"]["cast"] == 63, "{stats}");
    assert_eq!(stats["materials"].as_array().map(Vec::len), Some(1), "{stats}");

    let said = String::from_utf8_lossy(&render(at, &[&["-o", "b.png"], &layers[..]].concat()).stdout).into_owned();
    for name in ["depth", "normal", "geometric-normal", "uv", "albedo", "primitive", "steps"] {
        assert!(said.contains(&format!("b-{name}.png: ")) && read(&format!("b-{name}.png"))[1..4] == *b"PNG", "{said}");
    }
    let names = std::fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.filter(|name| name.to_string_lossy().starts_with("a-")).count(), 0);
}

#[test]
fn what_has_no_layers_is_refused_before_anything_is_done() {
    let folder = folder();
    let at = folder.path();
    for (arguments, words) in [
        (&["-o", "a.pfm", "--layers", "depth"][..], &["--layers", ".pfm", ".exr"][..]),
        (&["--layers", "depth,speed"], &["--layers", "speed", "geometric-normal", "empty-leaves"]),
        (&["--layers", "uv,depth,uv"], &["--layers", "uv is there twice"]),
        (&["--layers", "steps,tests,steps"], &["--layers", "steps is there twice"]),
    ] {
        assert_fails(&render(at, arguments), 2, words);
    }
    assert_fails(&render(at, &["-o", "no/such/a.exr", "--layers", "depth"]), 5, &["no/such/a.exr"]);
    let names: Vec<_> = std::fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(names.iter().all(|name| name == "one.obj" || name == "cache"), "{names:?}");
}
