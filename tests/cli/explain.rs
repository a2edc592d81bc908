//! `--explain`: every choice with its reason, on standard error and in `--stats`.

use super::{folder, raybrook, stderr, write_npz};
use serde_json::{Value, json};
use std::path::Path;

/// What every run with a structure of boxes explains, beside the work-group size, which the reference does not have.
const OPTIONS: [&str; 8] = [
    "--structure",
    "--packet-size",
    "--intersector",
    "--leaf-size",
    "--cost-traverse",
    "--cost-intersect",
    "--reinsert",
    "--spatial-splits",
];

/// What every picture explains behind that.
const CAMERA: [&str; 4] = ["--eye", "--target", "--up", "--fov"];

/// Runs `arguments` and returns what it said of each choice: the lines, and the entries of the JSON file. Of a picture
/// it also says what took how long.
fn explained(at: &Path, arguments: &[&str]) -> (Vec<String>, Vec<Value>) {
    let output = raybrook(at, &[arguments, &["--explain", "--stats", "stats.json"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!String::from_utf8_lossy(&output.stdout).contains("--structure"), "{output:?}");
    let stats: Value = serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap();
    let (times, lines): (Vec<_>, Vec<_>) =
        stderr(&output).lines().map(str::to_owned).partition(|line| line.starts_with("time: "));
    assert_eq!(times.len(), usize::from(arguments[0] == "render"), "{times:?}");
    times.iter().for_each(|line| assert_times(line, &stats));
    (lines, stats["choices"].as_array().unwrap().clone())
}

/// `time: 0.123 s: PART 0.100 s, PART 0.020 s`, the longest first, with seconds that `stats` has.
fn assert_times(line: &str, stats: &Value) {
    let seconds = |text: &str| text.trim_end_matches(" s").parse::<f64>().unwrap();
    let (total, parts) = line.trim_start_matches("time: ").split_once(": ").unwrap();
    assert!((seconds(total) - stats["total_s"].as_f64().unwrap()).abs() <= 5e-4, "{line}");
    let parts = parts.split(", ").map(|part| part.trim_end_matches(" s").rsplit_once(' ').unwrap());
    let parts: Vec<_> = parts.map(|(name, number)| (name, seconds(number))).collect();
    let of = |name: &str| parts.iter().find(|part| part.0 == name).map_or(0.0, |part| part.1);
    let written = stats["write_s"].as_f64().unwrap();
    assert!((of("encoding and writing") - written).abs() <= 5e-4 || written < 0.01 * seconds(total), "{line}");
    let named: Vec<_> = parts.iter().filter(|part| part.0 != "the rest").collect();
    assert!(named.windows(2).all(|two| two[0].1 >= two[1].1), "{line}");
}

fn assert_same(lines: &[String], choices: &[Value]) {
    assert_eq!(lines.len(), choices.len(), "{lines:?}");
    for (line, choice) in lines.iter().zip(choices) {
        let text = |name: &str| choice[name].as_str().unwrap();
        assert!(line.starts_with(&format!("{} {}: ", text("option"), text("value"))), "{line}: {choice}");
        assert!(line.contains(text("origin")) && line.contains(text("reason")), "{line}: {choice}");
    }
}

#[test]
fn every_choice_is_told_with_its_reason() {
    let folder = folder();
    let at = folder.path();
    let render = ["render", "one.obj", "--device", "reference", "--size", "8x8"];
    let (lines, choices) = explained(at, &render);
    assert_same(&lines, &choices);
    let options: Vec<_> = choices.iter().map(|choice| choice["option"].as_str().unwrap()).collect();
    assert_eq!(options, [&OPTIONS[..], &CAMERA].concat());
    assert!(choices.iter().all(|choice| choice["origin"] == "model" && choice["reason"] != ""), "{choices:?}");
    assert!(lines[0].starts_with("--structure bvh2: model: ") && lines[0].contains("1 triangles"), "{}", lines[0]);

    let given =
        ["--structure", "bvh8", "--packet-size", "1", "--precision", "exact", "--leaf-size", "3", "--reinsert", "2"];
    let numbers = ["--cost-intersect", "2", "--spatial-splits", "auto"];
    let (lines, choices) = explained(at, &[&render[..], &given, &numbers].concat());
    assert_same(&lines, &choices);
    for (line, expected) in lines.iter().zip([
        "--structure bvh8: given on the command line",
        "--packet-size 1: given on the command line",
        "--intersector exact: given on the command line",
        "--leaf-size 3: given on the command line",
        "--cost-traverse 1: model: ",
        "--cost-intersect 2: given on the command line",
        "--reinsert 2: given on the command line",
        "--spatial-splits auto: given on the command line",
    ]) {
        assert!(line.starts_with(expected), "{line}");
    }

    // What came of it is known once the structure is built: a triangle alone is not cut.
    let stats: Value = serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["options"]["spatial_splits"], "auto");
    assert_eq!(stats["spatial_splits"], json!({"hierarchies": 1, "with_splits": 0, "cost_ratios": [1.0, 1.0]}));

    write_npz(&at.join("rays.npz"), &[("origin", 3, &[0.25, 0.25, 1.0]), ("direction", 3, &[0.0, 0.0, -1.0])]);
    let (lines, choices) =
        explained(at, &["trace", "one.obj", "rays.npz", "--device", "reference", "--max-depth", "9"]);
    assert_same(&lines, &choices);
    assert!(lines[0].starts_with("--structure kd: model: --max-depth means nothing to bvh2"), "{}", lines[0]);
    assert!(lines.iter().any(|line| line == "--max-depth 9: given on the command line"), "{lines:?}");
}

#[test]
fn without_the_option_nothing_is_told_and_info_tells_of_the_build() {
    let folder = folder();
    let render = ["render", "one.obj", "--device", "reference", "--size", "8x8"];
    for arguments in [&render[..], &[&render[..], &["--explain", "-q"]].concat()] {
        let output = raybrook(folder.path(), arguments);
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    }
    let output = raybrook(folder.path(), &["info", "one.obj", "--explain", "--json", "--leaf-size", "2"]);
    let said = stderr(&output);
    assert!(
        said.starts_with("--structure kd: model: ") && said.contains("--leaf-size 2: given on the command line"),
        "{said}"
    );
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info.get("spatial_splits"), None);
    let output = raybrook(folder.path(), &["info", "one.obj", "--structure", "bvh2", "--spatial-splits", "auto"]);
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(told.lines().any(|line| line.split_whitespace().eq("spatial splits with splits 0".split(' '))), "{told}");
}

#[test]
fn a_device_has_a_work_group_and_check_explains_as_well() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let check = ["check", "one.obj", "--device", &device.info.index.to_string(), "--size", "8x8"];
    let (lines, choices) = explained(folder.path(), &check);
    assert_same(&lines, &choices);
    assert_eq!(choices[choices.len() - CAMERA.len() - 1]["option"], "work-group size");
    assert!(lines[0].contains(device.info.kind.name()) || lines[0].contains("CPU"), "{}", lines[0]);
}
