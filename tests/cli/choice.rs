//! What `--structure auto` takes, and what it says of that.

use super::{folder, raybrook, stderr};
use raybrook::low_level::choose::{Request, Workload};

/// Left to choose, the program takes what is fast on the device, and what other options are for.
#[test]
fn the_structure_follows_device_and_options() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let workload = Workload { triangle_count: Some(1), ..Workload::without_scene(Some(&device.info)) };
    let fastest = Request::default().choose(&workload, None).unwrap().options.kind().name();
    let index = device.info.index.to_string();
    for (device, arguments, expected) in [
        (index.as_str(), "--structure auto --memory constant", fastest),
        // What asks for a structure does so on every device.
        ("reference", "--structure octree", "octree"),
        ("reference", "--build median", "kd"),
        ("reference", "--grid-size 3,3,3", "grid"),
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

/// Names of earlier versions do what they did, with a note, and the parts of a method are those of the single options.
#[test]
fn old_names_and_methods_in_one_word_are_understood() {
    let folder = folder();
    let at = folder.path();
    let picture = |arguments: &str| {
        let arguments = format!("render one.obj -o a.pfm --size 9x7 --samples 1 --device reference {arguments}");
        let output = raybrook(at, &arguments.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{}", stderr(&output));
        (std::fs::read(at.join("a.pfm")).unwrap(), stderr(&output))
    };
    let (plain, said) = picture("--structure grid --intersector watertight");
    assert!(!said.contains("is called"), "{said}");
    let (old, said) = picture("--accel=grid --intersector watertight");
    assert!(said.contains("note: --accel is called --structure now"), "{said}");
    assert!(old == plain && picture("--method watertight+grid").0 == plain);
    let (_, said) = picture("--kernels split");
    assert!(said.contains("note: --kernels split is called --kernels wavefront now"), "{said}");
    for (arguments, words) in [
        ("--method best", "no 'best'; possible, joined by '+'"),
        ("--method kd+grid", "has --structure kd and --structure grid; take one of them"),
        ("--method kd --structure kd", "--method has --structure kd, and --structure is given, too; give it once"),
        ("--method grid+ropes", "option --traversal: means nothing to --structure grid"),
        ("--method plucker --precision fast", "--intersector is given, too"),
    ] {
        let arguments = format!("render one.obj {arguments}");
        let output = raybrook(at, &arguments.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(stderr(&output).contains(words), "{arguments}: {}", stderr(&output));
    }
}

/// What packages install: completions for each shell, and a page for each command.
#[test]
fn completions_and_manual_pages_have_every_command() {
    let folder = folder();
    let at = folder.path();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = raybrook(at, &["completions", shell]);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && text.contains("memory-limit"), "{shell}");
        // PowerShell's and Elvish's have no values, fish's those of options alone.
        let names = match shell {
            "bash" | "zsh" => &["bvh8", "moller-trumbore", "vertices", "split-rule"][..],
            "fish" => &["bvh8", "moller-trumbore"],
            _ => &[],
        };
        assert!(names.iter().all(|name| text.contains(name)), "{shell}");
    }
    assert!(raybrook(at, &["man", "pages"]).status.success());
    let read = |name: &str| std::fs::read_to_string(at.join("pages").join(name)).unwrap();
    assert!(read("raybrook.1").contains("render"));
    assert!(read("raybrook-render.1").contains("memory") && read("raybrook-stress.1").contains("closed"));
    assert!(!raybrook(at, &["completions", "tcsh"]).status.success());
    std::fs::write(at.join("file"), "").unwrap();
    assert_eq!(raybrook(at, &["man", "file"]).status.code(), Some(5));
}
