//! The program from outside: exit codes, messages, files.

#[path = "../common/mod.rs"]
mod common;

mod all_hits;
mod cache;
mod camera;
mod choice;
mod closed;
mod compiler_options;
mod device_faults;
mod display;
mod distance;
mod explain;
mod fuzzed;
mod keep;
mod keep_rays;
mod keep_stress;
mod layers;
mod limits;
mod losses;
mod methods;
mod peers;
mod ply_headers;
mod progress;
mod roulette;
mod study;
mod time_limits;
mod truth;
mod tune;
mod turntable;
mod view;
mod warm_up;

use std::path::Path;
use std::process::{Command, Output};

/// Runs `raybrook` with its own kernel cache, on the reference unless the arguments say otherwise.
fn raybrook(folder: &Path, arguments: &[&str]) -> Output {
    raybrook_with(folder, arguments, &[])
}

/// The same with environment variables of its own.
fn raybrook_with(folder: &Path, arguments: &[&str], variables: &[(&str, &str)]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args(arguments)
        .current_dir(folder)
        .env("RAYBROOK_CACHE_DIR", folder.join("cache"))
        .env_remove("RAYBROOK_DEVICE")
        .env_remove("RAYBROOK_CACHE_MB")
        .envs(variables.iter().copied())
        .output()
        .unwrap()
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    folder
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The browser's name, if there is one.
fn browser() -> Option<&'static str> {
    let is_there = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|out| out.status.success());
    let found = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(is_there);
    if found.is_none() {
        crate::common::skip("there is no chromium here");
    }
    found
}

/// Fails unless the program ended with `code` and said every one of `words`.
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "'{word}' is missing in: {said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn wrong_input_ends_with_the_documented_code() {
    let folder = folder();
    let at = folder.path();
    std::fs::write(at.join("empty.obj"), "").unwrap();
    std::fs::write(at.join("bad.obj"), "v 0 0 0\nv 1 0 0\nf 1 2 9\n").unwrap();
    std::fs::write(at.join("bad.toml"), "[image]\nwidht = 3\n").unwrap();
    std::fs::write(at.join("text.npz"), "no zip").unwrap();
    let cases: &[(&[&str], i32, &[&str])] = &[
        (&["render", "missing.obj"], 3, &["missing.obj"]),
        (&["render", "empty.obj"], 3, &["empty.obj"]),
        (&["render", "bad.obj"], 3, &["bad.obj:3"]),
        (&["render", "bad.toml"], 3, &["bad.toml:2", "widht", "width"]),
        (&["render", "one.fbx"], 3, &["one.fbx", ".obj", ".ply", ".stl"]),
        (&["render", "."], 3, &["."]),
        (&["render", "one.obj", "-o", "x.gif"], 2, &["x.gif", ".png"]),
        (&["render", "one.obj", "-o", "no/such/folder/x.png"], 5, &["no/such/folder/x.png"]),
        (&["render", "one.obj", "--stats", "no/such/folder/x.json"], 5, &["no/such/folder/x.json"]),
        (&["render", "one.obj", "--size", "0x5"], 2, &["--size", "0x5"]),
        (&["render", "one.obj", "--samples", "0"], 2, &["--samples"]),
        (&["render", "one.obj", "--precision", "good"], 2, &["--precision", "exact, fast"]),
        (
            &["render", "one.obj", "--precision", "fast", "--intersector", "plucker"],
            2,
            &["--precision", "--intersector"],
        ),
        (&["render", "one.obj", "--error=-1"], 2, &["--error"]),
        (&["render", "one.obj", "--error", "256"], 2, &["--error", "0 to 255"]),
        (&["render", "one.obj", "--error", "nan"], 2, &["--error", "0 to 255"]),
        (&["render", "one.obj", "--error", "1", "--samples", "4"], 2, &["--error", "--samples"]),
        (&["render", "one.obj", "--samples", "corners", "--measure-error"], 2, &["--measure-error"]),
        (&["render", "one.obj", "--samples", "edges"], 2, &["--samples", "corners"]),
        (&["render", "one.obj", "--samples", "corners", "--size", "1x5"], 2, &["--samples", "2x2"]),
        (&["render", "one.obj", "--structure", "tree"], 2, &["--structure", "tree", "auto, brute, kd, bvh2"]),
        (&["render", "one.obj", "--max-depth", "99"], 2, &["--max-depth", "60"]),
        (&["render", "one.obj", "--roulette", "1.5"], 2, &["--roulette", "1.5", "at most 1"]),
        (&["render", "one.obj", "--roulette=-0.1"], 2, &["--roulette", "-0.1", "must be 0, or"]),
        (&["render", "one.obj", "--roulette", "nan"], 2, &["--roulette", "NaN"]),
        (&["check", "one.obj", "--roulette", "much"], 2, &["--roulette", "much", "a number"]),
        (&["render", "one.obj", "--leaf-size", "0"], 2, &["--leaf-size"]),
        (&["info", "one.obj", "--build", "middle"], 2, &["--build", "sampled-median", "volume"]),
        (&["info", "one.obj", "--stop", "never"], 2, &["--stop", "cost, size"]),
        (&["info", "one.obj", "--empty-bonus", "2"], 2, &["--empty-bonus", "from 0 to 1"]),
        (&["info", "one.obj", "--build", "median", "--cost-traverse", "2"], 2, &["--cost-traverse", "--stop cost"]),
        (&["info", "one.obj", "--sample-size", "9"], 2, &["--sample-size", "--build sampled-median"]),
        (&["info", "one.obj", "--structure", "octree", "--stop", "size"], 2, &["--stop", "--structure kd"]),
        (&["render", "one.obj", "--aov", "steps,speed"], 2, &["--aov", "speed", "steps, leaves, empty-leaves"]),
        (&["render", "one.obj", "-o", "no/such/folder/x.png", "--aov", "steps"], 5, &["no/such/folder/x.png"]),
        (&["render", "one.obj", "--bit-depth", "12"], 2, &["--bit-depth", "12"]),
        (&["render", "one.obj", "--device", "no such device"], 4, &["no such device"]),
        (&["trace", "one.obj", "missing.npz"], 3, &["missing.npz"]),
        (&["trace", "one.obj", "text.npz"], 3, &["text.npz"]),
        (&["devices", "--structure", "grid"], 2, &["--structure", "--kernels"]),
        (&["devices", "--depth", "3"], 2, &["--depth", "--kernels"]),
        (&["devices", "--kernels", "--leaf-size", "0"], 2, &["--leaf-size"]),
        (&["devices", "--kernels", "--device", "reference"], 4, &["reference", "no kernels"]),
        (&["devices", "--kernels", "--scene", "missing.obj", "--device", "no such device"], 4, &["no such device"]),
        (&["methods", "one.obj"], 2, &["one.obj"]),
        (
            &["trace", "one.obj", "missing.npz", "--kernels", "wavefront"],
            2,
            &["--kernels", "wavefront", "one kernel, mega"],
        ),
        (
            &["render", "one.obj", "--textures", "host-pass"],
            2,
            &["--textures", "--kernels wavefront --textures host-pass"],
        ),
        (&["render", "one.obj", "--paths-in-flight", "8"], 2, &["--kernels wavefront --paths-in-flight 8"]),
        (&["tune", "missing.obj", "--device", "reference"], 3, &["missing.obj"]),
        (&["tune", "--device", "no such device"], 4, &["no such device"]),
        (&["tune", "one.obj", "--rays", "15"], 2, &["--rays", "16"]),
        (&["tune", "one.obj", "--structure", "tree"], 2, &["--structure", "tree", "brute, kd, bvh2"]),
        (&["tune", "--forget", "one.obj"], 2, &["--forget"]),
        (&["paint"], 2, &["paint"]),
        (&[], 2, &["render", "trace", "check", "info", "devices", "methods", "tune"]),
    ];
    for (arguments, code, words) in cases {
        assert_fails(&raybrook(at, arguments), *code, words);
    }
    assert!(!at.join("one.png").exists(), "a failed run must not leave a picture");
}

#[test]
fn render_writes_every_format_and_stats() {
    let folder = folder();
    let at = folder.path();
    for (name, arguments, magic) in [
        ("one.png", &[][..], &b"\x89PNG"[..]),
        ("deep.png", &["-o", "deep.png", "--bit-depth", "16"], b"\x89PNG"),
        ("one.exr", &["-o", "one.exr"], b"\x76\x2f\x31\x01"),
        ("one.pfm", &["-o", "one.pfm"], b"PF\n"),
    ] {
        let fixed = [
            "render",
            "one.obj",
            "--device",
            "reference",
            "--size",
            "20x10",
            "--samples",
            "1",
            "--stats",
            "stats.json",
        ];
        let output = raybrook(at, &[&fixed, arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(std::fs::read(at.join(name)).unwrap().starts_with(magic), "{name}");
    }
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["rays"]["camera"]["cast"], 200);
    let hit = stats["rays"]["camera"]["hit"].as_u64().unwrap();
    assert!((15..160).contains(&hit), "{hit}");
    // The key light shines on the triangle, and nothing is in the way.
    assert_eq!(stats["rays"]["shadow"]["cast"], hit);
    assert_eq!(stats["rays"]["shadow"]["hit"], 0);
    assert_eq!(stats["options"]["accel"], "bvh2");
    assert_eq!((&stats["width"], &stats["height"]), (&20.into(), &10.into()));
    for time in ["load_s", "build_s", "total_s"] {
        assert!(stats[time].as_f64().unwrap() > 0.0, "{time}");
    }
    let left: Vec<_> = std::fs::read_dir(at).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().contains("tmp")), "{left:?}");
}

#[test]
fn precision_names_a_triangle_test() {
    let folder = folder();
    for (arguments, intersector) in [
        (vec![], "exact"),
        (vec!["--precision", "exact"], "exact"),
        (vec!["--precision", "fast"], "moller-trumbore"),
        (vec!["--intersector", "plucker"], "plucker"),
    ] {
        let all =
            [&["render", "one.obj", "--size", "8x8", "--device", "reference", "--stats", "s.json"], &arguments[..]];
        let output = raybrook(folder.path(), &all.concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.path().join("s.json")).unwrap()).unwrap();
        assert_eq!(stats["options"]["intersector"], intersector);
    }
}

#[test]
fn an_nff_file_has_its_size_and_corners_are_cast() {
    let folder = folder();
    let at = folder.path();
    let view = "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 40\nhither 1\nresolution 12 8\n";
    std::fs::write(at.join("a.nff"), format!("{view}l 0 0 9\ns 0 0 0 1\n")).unwrap();
    let stats = |arguments: &[&str]| -> serde_json::Value {
        let fixed = ["render", "a.nff", "--device", "reference", "--stats", "stats.json"];
        let output = raybrook(at, &[&fixed, arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap()
    };
    let plain = stats(&["--samples", "2"]);
    assert_eq!((&plain["width"], &plain["height"], &plain["samples"]), (&12.into(), &8.into(), &2.into()));
    assert_eq!(plain["rays"]["camera"]["cast"], 12 * 8 * 2);
    let corners = stats(&["--samples", "corners", "--size", "13x9"]);
    assert_eq!((&corners["samples"], &corners["rays"]["camera"]["cast"]), (&"corners".into(), &(13 * 9).into()));
}

#[test]
fn a_picture_is_asked_for_by_its_error() {
    let folder = folder();
    let at = folder.path();
    let scene = crate::common::root().join("scenes/spheres.toml");
    let stats = |arguments: &[&str]| -> serde_json::Value {
        let fixed = ["render", scene.to_str().unwrap(), "--device", "reference", "--size", "40x30", "-o", "x.png"];
        let output = raybrook(at, &[&fixed[..], &["--stats", "stats.json", "--measure-error"], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap()
    };
    let (small, large) = (stats(&["--error", "0.5"]), stats(&["--error", "4"]));
    for (stats, asked) in [(&small, 0.5), (&large, 4.0)] {
        assert_eq!((&stats["samples"]["error"], &stats["adaptive"]["error"]), (&asked.into(), &asked.into()));
        let pixels: Vec<u64> =
            stats["adaptive"]["pixels"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
        assert_eq!(pixels.iter().sum::<u64>(), 40 * 30);
        let made = stats["full_picture"]["difference"]["rms_8bit"].as_f64().unwrap();
        assert!(made > 0.0 && made < 1.2 * asked, "{made}");
        assert_eq!(stats["full_picture"]["rays"]["camera"]["cast"], 40 * 30 * 256);
    }
    let rays = |stats: &serde_json::Value| stats["rays"]["camera"]["cast"].as_u64().unwrap();
    assert!(rays(&small) > 3 * rays(&large), "{} {}", rays(&small), rays(&large));
    // Corners, which the file asks for here, are no samples of pixels.
    std::fs::write(at.join("corners.toml"), "[image]\nsamples = \"corners\"\n[[object]]\nsolid = \"box\"\n").unwrap();
    let output = raybrook(at, &["render", "corners.toml", "--device", "reference", "--measure-error"]);
    assert_fails(&output, 2, &["--measure-error"]);
    // Fixed samples have an error, too.
    let fixed = stats(&["--samples", "2"]);
    assert_eq!((&fixed["samples"], &fixed["adaptive"]), (&2.into(), &serde_json::Value::Null));
    assert!(fixed["full_picture"]["difference"]["rms_8bit"].as_f64().unwrap() > 1.0);
    // One step where nobody says anything.
    let output =
        raybrook(at, &["render", "one.obj", "--device", "reference", "--size", "9x9", "--stats", "stats.json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["samples"]["error"], 1.0);
}

#[test]
fn quiet_is_quiet_and_without_opencl_the_reference_says_so() {
    let folder = folder();
    let at = folder.path();
    let output = raybrook(at, &["-q", "render", "one.obj", "--device", "reference", "--size", "8x8"]);
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");

    let output = Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args(["render", "one.obj", "--size", "8x8"])
        .current_dir(at)
        .env("OCL_ICD_VENDORS", at)
        .env_remove("RAYBROOK_DEVICE")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let said = stderr(&output);
    assert!(said.contains("reference") && said.contains("pocl-opencl-icd"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn info_and_devices_print_json() {
    let folder = folder();
    let info = raybrook(folder.path(), &["info", "one.obj", "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["triangles"], 1);
    assert_eq!(info["dropped_zero_area"], 0);
    assert_eq!(info["high"], serde_json::json!([1.0, 1.0, 0.0]));
    assert!(info["tree"]["nodes"].as_u64().unwrap() >= 1);
    let text = raybrook(folder.path(), &["info", "one.obj"]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("triangles"));

    let devices = raybrook(folder.path(), &["devices", "--json"]);
    let devices: serde_json::Value = serde_json::from_slice(&devices.stdout).unwrap();
    assert!(devices["devices"].is_array());
}

#[test]
fn devices_kernels_lists_every_kernel() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let index = device.info.index.to_string();
    let run = |arguments: &[&str]| {
        // Kernels that PoCL compiles in half of the time.
        let device = ["--device", &index, "--compiler-options", "-cl-opt-disable"];
        let output = raybrook(folder.path(), &[&["devices", "--kernels"], &device[..], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let json: serde_json::Value =
        serde_json::from_str(&run(&["--json", "--scene", "one.obj", "--structure", "grid"])).unwrap();
    assert_eq!(json[0]["device"], device.info.name);
    let programs = json[0]["programs"].as_array().unwrap();
    let passes = ["DEFER_UNDECIDED", "DEFER_UNDECIDED", "RESOLVE_DEFERRED", "RESOLVE_DEFERRED"];
    for ((program, pass), kernel) in programs.iter().zip(passes).zip(["trace_any", "render"].iter().cycle()) {
        let options = program["compile_options"].as_str().unwrap();
        assert!(options.contains("traverse_grid") && options.contains(pass), "{options}");
        assert_eq!(program["kernels"][0]["kernel"], *kernel);
        assert!(program["kernels"][0]["max_work_group_size"].as_u64().unwrap() > 0);
    }
    assert_eq!(programs.len(), passes.len());
    let quick = ["--structure", "brute", "--intersector", "watertight"];
    let text = run(&[&["--depth", "30", "--counters", "--features", "all"][..], &quick].concat());
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    for expected in ["registers", "-DMAX_PENDING=32", "-DFEATURES=", "-DCOUNT_WORK=1", "render", "trace_next"] {
        assert!(text.contains(expected), "{expected} is not in {text}");
    }
}

/// Each option in turn must change the tree of a scene of ours, as `raybrook info` tells of it.
#[test]
fn info_shows_the_tree_that_the_options_build() {
    let tree = |arguments: &str| {
        let arguments = ["info", "scenes/knot.obj", "--json"].into_iter().chain(arguments.split_whitespace());
        let output = raybrook(&crate::common::root(), &arguments.collect::<Vec<_>>());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()["tree"].clone()
    };
    for (base, others) in [
        ("", &["--build volume", "--build median", "--cost-traverse 3", "--cost-intersect 3", "--empty-bonus 0"][..]),
        ("", &["--stop size", "--similar-children 0.4", "--leaf-size 9", "--max-depth 9"]),
        ("--build median", &["--build sampled-median", "--build spatial-median", "--build median --stop cost"]),
        ("--build median", &["--build median --split-axis longest", "--build median --similar-children 0.6"]),
        ("--build median --stop cost", &["--build median --stop cost --cost-traverse 3"]),
        ("--build sampled-median", &["--build sampled-median --sample-size 5"]),
    ] {
        let plain = tree(base);
        assert!(plain["nodes"].as_u64().unwrap() > 100, "{plain}");
        for other in others {
            assert_ne!(tree(other), plain, "'{other}' instead of '{base}'");
        }
    }
}

#[test]
fn trace_answers_a_batch() {
    let folder = folder();
    let at = folder.path();
    // A hit, a miss, one cut off by t_max; directions of another length than 1.
    write_npz(
        &at.join("rays.npz"),
        &[
            ("origin", 3, &[0.25, 0.25, 1.0, 5.0, 5.0, 1.0, 0.25, 0.25, 1.0]),
            ("direction", 3, &[0.0, 0.0, -2.0, 0.0, 0.0, -2.0, 0.0, 0.0, -2.0]),
            ("t_max", 1, &[9.0, 9.0, 0.25]),
        ],
    );
    let arguments = [
        "trace",
        "one.obj",
        "rays.npz",
        "-o",
        "hits.npz",
        "--device",
        "reference",
        "--repeat",
        "3",
        "--stats",
        "s.json",
    ];
    let output = raybrook(at, &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(
        read_npz(&at.join("hits.npz"), "t"),
        [0.5f32.to_bits(), f32::INFINITY.to_bits(), f32::INFINITY.to_bits()]
    );
    assert_eq!(read_npz(&at.join("hits.npz"), "primitive"), [0, u32::MAX, u32::MAX]);
    assert_eq!(read_npz(&at.join("hits.npz"), "u")[0], 0.25f32.to_bits());
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
    assert_eq!(stats["kernel_s"].as_array().unwrap().len(), 3);
    assert_eq!((&stats["rays"]["camera"]["cast"], &stats["rays"]["camera"]["hit"]), (&3.into(), &1.into()));

    assert!(stats.get("sort_s").is_none());
    let hits = ["t", "primitive", "u", "v"].map(|name| read_npz(&at.join("hits.npz"), name));
    let output = raybrook(at, &[&arguments[..], &["--ray-order", "sorted"]].concat());
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("3 rays (sorted in 0."), "{}", stderr(&output));
    assert_eq!(["t", "primitive", "u", "v"].map(|name| read_npz(&at.join("hits.npz"), name)), hits);
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
    assert!(stats["sort_s"].is_f64() && stats["options"]["ray_order"] == "sorted");
}

#[test]
fn counted_work_is_written_as_numbers_and_colours() {
    let folder = folder();
    let at = folder.path();
    let fixed = "render one.obj --device reference --size 20x10 --samples 1 --structure kd --stats s.json";
    let fixed: Vec<_> = fixed.split(' ').collect();
    for (arguments, pictures, files) in [
        (&["--aov", "steps,empty-leaves"][..], 2, &["one-steps.png", "one-empty-leaves.png"][..]),
        (&["-o", "one.exr", "--aov", "tests"], 1, &["one-tests.png", "one-tests.exr"]),
        (&["-o", "one.pfm", "--aov", "tests"], 1, &["one-tests.pfm"]),
        (&["--counters"], 0, &[]),
    ] {
        let output = raybrook(at, &[&fixed[..], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(said.contains(" tests (") && said.contains("deepest stack 0"), "{said}");
        assert_eq!(said.matches("(black)").count(), pictures, "{said}");
        for file in files {
            std::fs::remove_file(at.join(file)).expect(file);
        }
        let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
        assert_eq!(stats["options"]["counters"], true);
        let work = &stats["work"];
        assert_eq!(
            (&work["camera"]["rays"], &work["camera"]["sum"]["leaves"]),
            (&200.into(), &work["camera"]["sum"]["tests"])
        );
        // The scene's box is flat: shadow rays start in its one leaf, test nothing there but what they leave, and are
        // out of it.
        let [all, camera] = ["all", "camera"].map(|rays| &work[rays]);
        let of = |rays: &serde_json::Value, what: &str| rays["sum"][what].as_u64().unwrap();
        let shadow_rays = all["rays"].as_u64().unwrap() - camera["rays"].as_u64().unwrap();
        assert!(shadow_rays > 0);
        assert_eq!(of(all, "leaves"), of(camera, "leaves") + shadow_rays);
        for what in ["steps", "tests"] {
            assert_eq!(of(all, what), of(camera, what), "{what}");
        }
        assert_eq!(work["all"]["deepest_stack"], 0);
        assert_eq!(work["aovs"].as_array().map_or(0, Vec::len), pictures);
    }

    write_npz(
        &at.join("rays.npz"),
        &[
            ("origin", 3, &[0.25, 0.25, 1.0, 5.0, 5.0, 1.0]),
            ("direction", 3, &[0.0, 0.0, -1.0, 0.0, 0.0, -1.0]),
            ("next_direction", 3, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        ],
    );
    let fixed = [
        "trace",
        "one.obj",
        "rays.npz",
        "--structure",
        "kd",
        "-o",
        "hits.npz",
        "--device",
        "reference",
        "--stats",
        "s.json",
    ];
    let output = raybrook(at, &[&fixed[..], &["--counters"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let numbers = |name: &str| read_npz(&at.join("hits.npz"), name);
    assert_eq!((numbers("work_leaves"), numbers("work_tests")), (vec![1, 0], vec![1, 0]));
    assert_eq!((numbers("work_node_bytes"), numbers("work_triangle_bytes")), (vec![16, 0], vec![52, 0]));
    // The secondary ray runs in the triangle on which it starts: a leaf and a reference are read, and nothing is
    // tested.
    assert_eq!((numbers("next_work_tests"), numbers("next_work_triangle_bytes")), (vec![0, 0], vec![4, 0]));
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
    assert_eq!((&stats["work"]["camera"]["rays"], &stats["work"]["all"]["rays"]), (&2.into(), &3.into()));
    assert_eq!(stats["work"]["all"]["mean"]["triangle_bytes"], 56.0 / 3.0);
    assert!(stats["options"]["counters"] == true && stats["work"].get("aovs").is_none());

    assert!(raybrook(at, &fixed).status.success());
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
    assert!(stats.get("work").is_none() && stats["options"].get("counters").is_none());
}

#[test]
fn check_compares_device_and_reference() {
    let folder = folder();
    if raybrook(folder.path(), &["info", "one.obj", "-q"]).status.code() != Some(0) {
        panic!("info failed");
    }
    let output = raybrook(folder.path(), &["check", "one.obj", "--size", "40x30", "--device", "cpu"]);
    if output.status.code() == Some(4) && std::env::var_os("RAYBROOK_REQUIRE_DEVICE").is_none() {
        crate::common::skip(format_args!("no device: {}", stderr(&output)));
        return;
    }
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}{}", stderr(&output));
    assert!(said.contains("0 of 1200 differ in some bit") && said.contains("passed"), "{said}");
    assert!(folder.path().join("one-difference.png").exists());
}

/// Writes float32 arrays as `np.savez` does; `columns` 1 makes a vector.
fn write_npz(path: &Path, arrays: &[(&str, usize, &[f32])]) {
    use std::io::Write;
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, columns, values) in arrays {
        let rows = values.len() / columns;
        let shape = if *columns == 1 { format!("({rows},)") } else { format!("({rows}, {columns})") };
        let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
        while !(header.len() + 11).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        zip.start_file(format!("{name}.npy"), stored).unwrap();
        zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
        zip.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
        zip.write_all(header.as_bytes()).unwrap();
        zip.write_all(bytemuck::cast_slice(values)).unwrap();
    }
    zip.finish().unwrap();
}

/// The 32-bit words of an array.
fn read_npz(path: &Path, name: &str) -> Vec<u32> {
    use std::io::Read;
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut bytes = Vec::new();
    zip.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect()
}

#[test]
fn stress_counts_wrong_answers_and_writes_them_for_replay() {
    let folder = folder();
    let at = folder.path();
    let fixed = ["stress", "edges", "--rays", "150", "--device", "reference"];
    let run = |arguments: &[&str]| raybrook(at, &[&fixed, arguments].concat());
    let said = |output: &Output| String::from_utf8_lossy(&output.stdout).into_owned();

    let right = run(&["--intersector", "exact", "--json", "right.json", "--write", "wrong"]);
    assert_eq!(right.status.code(), Some(0), "{}", stderr(&right));
    assert!(said(&right).contains("0 wrong of 150 rays"), "{}", said(&right));
    assert!(!at.join("wrong").exists(), "nothing was wrong");

    let wrong = run(&["--methods=exact,moller-trumbore+grid", "--json", "wrong.json", "--write", "wrong"]);
    assert_eq!(wrong.status.code(), Some(1), "{}", stderr(&wrong));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("wrong.json")).unwrap()).unwrap();
    let [exact, other] = &report["methods"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!((&exact["strict"], &exact["wrong"], &other["strict"]), (&true.into(), &0.into(), &false.into()));
    let count = other["wrong"].as_u64().unwrap();
    assert!(count > 0 && other["kinds"][0]["faults"]["miss"] == count, "{report}");

    // The command that is printed, as a shell would split it.
    let printed = said(&wrong);
    let command = printed.lines().find(|line| line.starts_with("raybrook stress --replay")).expect(&printed);
    let words: Vec<&str> = command.split(' ').skip(1).map(|word| word.trim_matches('\'')).collect();
    let again = raybrook(at, &words);
    assert_eq!(again.status.code(), Some(1), "{}", stderr(&again));
    assert!(said(&again).contains(&format!("{count} of {count} rays wrong")), "{}", said(&again));
    // The same files are for `trace`, too.
    let traced = raybrook(at, &["trace", words[2], words[3], "--device", "reference"]);
    assert!(said(&traced).contains(&format!("{count} rays, {count} hit")), "{}", said(&traced));
}

#[test]
fn stress_judges_lists_and_walks_and_writes_them_for_replay() {
    let folder = folder();
    let at = folder.path();
    for (ask, wrong_method) in [("lists", "moller-trumbore"), ("walks", "thesis")] {
        let fixed = ["stress", "edges", "stack-vertices", "--rays", "60", "--ask", ask, "--device", "reference"];
        let right = raybrook(at, &[&fixed[..], &["--json", "right.json"]].concat());
        let said = String::from_utf8_lossy(&right.stdout).into_owned();
        assert_eq!(right.status.code(), Some(0), "{}", stderr(&right));
        assert!(said.contains("0 wrong of 120 rays") && said.contains("twice"), "{said}");
        let read = |name: &str| -> serde_json::Value {
            serde_json::from_slice(&std::fs::read(at.join(name)).unwrap()).unwrap()
        };
        let report = read("right.json");
        assert_eq!(report["asked"], ask);
        assert!(report["methods"][0]["kinds"][1]["hits"].as_u64().unwrap() > 60, "{report}");

        let spoilt = ["--intersector", wrong_method, "--json", "wrong.json", "--write", "wrong"];
        let wrong = raybrook(at, &[&fixed[..], &spoilt].concat());
        let said = String::from_utf8_lossy(&wrong.stdout).into_owned();
        assert_eq!(wrong.status.code(), Some(1), "{}", stderr(&wrong));
        let count = read("wrong.json")["methods"][0]["kinds"][1]["wrong"].as_u64().unwrap();
        let command = said.lines().rfind(|line| line.starts_with("raybrook stress --replay")).expect(&said);
        assert!(
            command.contains("stack-vertices-1-1") && command.contains(&format!("-{wrong_method}-{ask}.npz")),
            "{command}"
        );
        let words: Vec<&str> = command.split(' ').skip(1).map(|word| word.trim_matches('\'')).collect();
        let again = raybrook(at, &words);
        let said = String::from_utf8_lossy(&again.stdout).into_owned();
        assert_eq!(again.status.code(), Some(1), "{}", stderr(&again));
        assert!(said.contains("  exact  ") && said.contains("hits\n    0: triangle"), "{said}");
        // Each of its two scenes has files of its own; these are the last one's.
        assert!(count > 0 && said.contains(" rays wrong"), "{said}");
    }
}

#[test]
fn stress_lists_kinds_and_refuses_what_it_does_not_know() {
    let folder = folder();
    let at = folder.path();
    let list = raybrook(at, &["stress", "--list"]);
    let text = String::from_utf8_lossy(&list.stdout).into_owned();
    assert!(list.status.success() && text.lines().count() > 60, "{text}");
    assert!(text.lines().all(|line| line.split_whitespace().count() > 3), "a name and a description: {text}");
    let cases: &[(&[&str], i32, &[&str])] = &[
        (&["stress", "edgse"], 2, &["edgse", "nearest: edges"]),
        (&["stress", "edges", "--methods=best"], 2, &["--methods", "best", "watertight"]),
        (&["stress", "edges", "--methods=grid+ropes"], 2, &["--traversal", "--structure kd"]),
        (&["stress", "edges", "--rays", "0"], 2, &["--rays"]),
        (&["stress", "edges", "--json", "no/such/folder/x.json"], 5, &["no/such/folder/x.json"]),
        (&["stress", "--replay", "one.obj", "missing.npz"], 3, &["missing.npz"]),
        (&["stress", "--replay", "one.obj", "rays.npz", "--methods=exact"], 2, &["--replay", "--methods"]),
    ];
    for (arguments, code, words) in cases {
        assert_fails(&raybrook(at, arguments), *code, words);
    }
}
