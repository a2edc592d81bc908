//! What `--structure auto` takes, and what it says of that.

use super::{folder, raybrook, stderr};
use raybrook::low_level::choose::{Request, Workload};

/// Left to choose, the program takes what is fast on the device, and what other options are for.
#[test]
fn the_structure_follows_device_and_options() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let workload =
        Workload { device: Some(&device.info), triangle_count: Some(1), features: None, shared_triangles: 0 };
    let fastest = Request::default().choose(&workload, None).unwrap().options.kind().name();
    let index = device.info.index.to_string();
    for (device, arguments, expected) in [
        (index.as_str(), "", fastest),
        (&index, "--structure auto --memory constant", fastest),
        (&index, "--structure octree", "octree"),
        (&index, "--build median", "kd"),
        (&index, "--grid-size 3,3,3", "grid"),
        ("reference", "", "bvh2"),
    ] {
        let render = ["render", "one.obj", "--size", "8x8", "--device", device, "--stats", "stats.json", "-q"];
        let output =
            raybrook(folder.path(), &[&render[..], &arguments.split_whitespace().collect::<Vec<_>>()].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.path().join("stats.json")).unwrap()).unwrap();
        assert_eq!(stats["options"]["accel"], expected, "--device {device} {arguments}");
    }
}

/// A leaf of two children a node has room for 15 triangles: the reference would take it but for that.
#[test]
fn a_limit_that_changes_the_structure_is_told() {
    let folder = folder();
    let said = |arguments: &str| {
        let render = ["render", "one.obj", "--size", "8x8", "--device", "reference"];
        let output =
            raybrook(folder.path(), &[&render[..], &arguments.split_whitespace().collect::<Vec<_>>()].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let note = "note: --structure auto takes kd: --leaf-size 16: a leaf of --structure bvh2 has room for 15 at most\n";
    assert_eq!(said("--leaf-size 16"), note);
    for silent in
        ["--leaf-size 15", "--leaf-size 16 -q", "--leaf-size 16 --structure kd", "--leaf-size 16 --build median"]
    {
        assert_eq!(said(silent), "", "{silent}");
    }
}
