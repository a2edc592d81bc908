//! Memory that is not there, inputs that hold nothing or too large numbers, names that command terminals, and files
//! broken at random.

use super::{assert_fails, folder, raybrook, raybrook_with, stderr};
use raybrook::low_level::journal::Journal;
use raybrook::low_level::rays::RayBatch;
use std::path::Path;
use std::process::{Command, Output};

const SMALL: [&str; 6] = ["--device", "reference", "--size", "8x8", "--samples", "1"];

fn write(at: &Path, name: &str, text: &str) {
    std::fs::write(at.join(name), text).unwrap();
}

fn rays(at: &Path, count: usize) {
    let (origins, directions) = (vec![[0.2, 0.2, 1.0]; count], vec![[0.0, 0.0, -1.0]; count]);
    RayBatch { origins, directions, ..RayBatch::default() }.write(at.join("rays.npz")).unwrap();
}

/// The same with limits of the shell, where there is one.
#[cfg(target_os = "linux")]
fn limited(at: &Path, limit: &str, arguments: &[&str]) -> Output {
    Command::new("sh")
        .args(["-c", &format!("ulimit {limit} && exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_raybrook")])
        .args(arguments)
        .current_dir(at)
        .env("RAYBROOK_CACHE_DIR", at.join("cache"))
        .env("RAYON_NUM_THREADS", "2")
        .env_remove("RAYBROOK_DEVICE")
        .output()
        .unwrap()
}

/// Nothing here may take the time that making it takes: all is refused before.
#[test]
fn what_memory_cannot_hold_is_refused_with_numbers_and_what_to_lower() {
    let folder = folder();
    let at = folder.path();
    let picture = ["render", "one.obj", "--device", "reference", "--memory-limit", "200M", "--size"];
    // What is told of all pixels beside their light is in memory, and so is the picture then.
    let with_layers = ["--samples", "1", "--layers", "depth"];
    for (size, more) in [("65535x65535", &[][..]), ("6000x6000", &with_layers), ("2000x2000", &["--error", "2"])] {
        let output = raybrook(at, &[&picture[..], &[size], more].concat());
        assert_fails(&output, 4, &["a picture of", size, "iB", "200 MiB", "lower --size"]);
    }
    for (solid, more) in
        [("quad", ""), ("sphere", ""), ("torus", "sides = 4096"), ("height-field", "formula = 'noise'")]
    {
        write(at, "fine.toml", &format!("[[object]]\nsolid = '{solid}'\nsegments = 4096\n{more}\n"));
        for command in ["render", "info"] {
            let output = raybrook(at, &[command, "fine.toml", "--memory-limit", "1.5g"]);
            assert_fails(&output, 3, &["fine.toml:1:", "triangles", "1.5 GiB", "lower its segments"]);
        }
    }
    write(at, "solid.toml", "[[object]]\nsolid = 'sphere'\nsegments = 512\n");
    for accel in ["bvh2", "bvh8", "kd", "grid", "octree", "instances"] {
        let output = raybrook(at, &["info", "solid.toml", "--structure", accel, "--memory-limit", "64M"]);
        assert_fails(&output, 3, &[accel, "261120 triangles", "64 MiB", "fewer triangles"]);
    }
    let places = vec!["{}"; 300].join(",");
    write(at, "many.toml", &format!("[[object]]\nsolid = 'sphere'\nsegments = 64\ninstances = [{places}]\n"));
    let many = ["render", "many.toml", "--memory-limit", "100M", "-q"];
    assert_fails(
        &raybrook(at, &[&many[..], &SMALL, &["--structure", "bvh2"]].concat()),
        3,
        &["1190400 triangles", "instances"],
    );
    let output = raybrook(at, &[&many[..], &SMALL, &["--structure", "instances"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));

    rays(at, 300_000);
    let trace = ["trace", "one.obj", "rays.npz", "--device", "reference", "--memory-limit"];
    assert_fails(&raybrook(at, &[&trace[..], &["12M"]].concat()), 3, &["array", "rays.npz", "split the batch"]);
    assert_fails(&raybrook(at, &[&trace[..], &["60M"]].concat()), 3, &["300000 rays", "split the batch"]);
    assert!(raybrook(at, &[&trace[..], &["1G"]].concat()).status.success());
    for wrong in ["0", "much", "8X", ""] {
        assert_fails(&raybrook(at, &[&trace[..], &[wrong]].concat()), 2, &["--memory-limit"]);
    }
}

/// Files in which two bytes stand for a triangle of forty, or twelve for an entry of a map.
#[test]
fn what_small_files_become_is_refused_before_memory_runs_out() {
    const CORNERS: usize = 65_536;
    const FACES: usize = 50;
    let folder = folder();
    let at = folder.path();
    let face = format!("{CORNERS}{}\n", " 0 1".repeat(CORNERS / 2));
    write(at, "corners.off", &format!("OFF\n3 {FACES} 0\n0 0 0\n1 0 0\n0 1 0\n{}", face.repeat(FACES)));
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face {FACES}\nproperty list uint uchar vertex_indices\nend_header\n"
    );
    let face = [&(CORNERS as u32).to_le_bytes()[..], &[0, 1].repeat(CORNERS / 2)].concat();
    let vertices = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    std::fs::write(at.join("corners.ply"), [header.as_bytes(), &vertices, &face.repeat(FACES)].concat()).unwrap();
    std::fs::write(at.join("sparse.glb"), sparse_glb(1 << 21)).unwrap();
    for (file, limit) in [("corners.off", "100M"), ("corners.ply", "100M"), ("sparse.glb", "60M")] {
        let output = raybrook(at, &["info", file, "--memory-limit", limit]);
        assert_fails(&output, 3, &[file, "takes the process to about", "the memory limit is"]);
    }
}

/// A binary glTF file of one triangle, whose accessor has so many sparse elements.
fn sparse_glb(count: usize) -> Vec<u8> {
    let indices: Vec<u8> = (0..count as u32).flat_map(u32::to_le_bytes).collect();
    let (from, values) = (indices.len(), 3 * count);
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}],
        "accessors": [{{"componentType": 5121, "count": {count}, "type": "VEC3", "sparse": {{"count": {count},
            "indices": {{"bufferView": 0, "componentType": 5125}}, "values": {{"bufferView": 1}}}}}}],
        "bufferViews": [{{"buffer": 0, "byteLength": {from}}},
            {{"buffer": 0, "byteOffset": {from}, "byteLength": {values}}}],
        "buffers": [{{"byteLength": {}}}]}}"#,
        from + values
    );
    let chunk = |kind: &[u8], data: &[u8], fill: u8| {
        let mut data = data.to_vec();
        data.resize(data.len().next_multiple_of(4), fill);
        [&(data.len() as u32).to_le_bytes()[..], kind, &data].concat()
    };
    let binary = [indices, vec![7; values]].concat();
    let chunks = [chunk(b"JSON", json.as_bytes(), b' '), chunk(b"BIN\0", &binary, 0)].concat();
    [b"glTF", &2_u32.to_le_bytes()[..], &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

/// A journal may promise any number of runs, and sizes that no picture has.
#[test]
fn journals_that_promise_much_are_refused_at_once() {
    let folder = folder();
    let at = folder.path();
    let batch = |count: u64, run: u64, part: &str| {
        format!(
            r#"H{{"batch": {{"version": "0.1.0", "geometry": "", "rays": "", "count": {count}, "run": {run},
            "asked": "counts", "has_second": false, "method": null}}, "part": {part}}}"#
        )
    };
    let picture = |size: &str, part: &str| {
        format!(
            r#"H{{"picture": {{"version": "0.1.0", "scene": "", "size": {size}, "error": null, "samples": "1",
            "crop": null, "depth": 1, "kill_weight": null, "roulette": null, "texture_filter": "", "terminator": "",
            "method": null}}, "part": {part}}}"#
        )
    };
    let part = r#"{"number": 1, "of": 2}"#;
    let none = r#"{"number": 1, "of": 0}"#;
    for (header, output, words) in [
        (
            batch(u64::MAX, 1, part),
            "a.npz",
            "18446744073709551615 of 18446744073709551615 runs are missing; trace these parts",
        ),
        (batch(1 << 50, 1 << 20, "null"), "a.npz", "1073741824 of 1073741824 runs are missing; let the command"),
        (batch(5, 1, none), "a.npz", "1/0 is no part"),
        (picture("[4, 3]", none), "a.pfm", "1/0 is no part"),
        (picture("[0, 3]", part), "a.pfm", "0x3 is no size of a picture"),
        (picture("[4, 4294967295]", part), "a.pfm", "4x4294967295 is no size of a picture"),
    ] {
        let journal = at.join("a.partial");
        let _ = std::fs::remove_file(&journal);
        Journal::create(&journal, header.as_bytes()).unwrap();
        assert_fails(&raybrook(at, &["merge", "a.partial", "-o", output]), 3, &["a.partial", words]);
        assert!(!at.join(output).exists());
    }
}

/// A disk that is full before a journal has its header: nothing is left that the next run would stumble over.
#[cfg(target_os = "linux")]
#[test]
fn a_journal_that_cannot_be_begun_is_not_left_behind() {
    let folder = folder();
    let at = folder.path();
    let render = [&["render", "one.obj", "-o", "a.pfm", "--keep", "always"], &SMALL[..]].concat();
    let output = limited(at, "-f 0", &render);
    assert_fails(&output, 5, &["a.pfm.partial"]);
    assert!(!at.join("a.pfm.partial").exists() && !at.join("a.pfm").exists());
    assert!(raybrook(at, &render).status.success());
}

#[cfg(target_os = "linux")]
#[test]
fn limits_of_the_shell_end_in_messages() {
    let folder = folder();
    let at = folder.path();
    write(at, "fine.toml", "[[object]]\nsolid = 'quad'\nsegments = 4096\n");
    rays(at, 300_000);
    let reference = ["--device", "reference"];
    for limit in ["-v 400000", "-d 200000"] {
        let output = limited(at, limit, &[&["render", "one.obj", "--size", "20000x20000"], &reference[..]].concat());
        assert_fails(&output, 4, &["a picture of 20000x20000", "ulimit"]);
        let output = limited(at, limit, &[&["render", "fine.toml"], &reference[..]].concat());
        assert_fails(&output, 3, &["fine.toml:1:", "ulimit", "lower its segments"]);
    }
    // What is allowed, and the system refuses: no array is called damaged.
    let allowed = [&["render", "fine.toml", "--memory-limit", "1T"], &reference[..]].concat();
    assert_fails(&limited(at, "-v 1000000", &allowed), 3, &["fine.toml:1:", "the system refuses that"]);
    let trace = [&["trace", "one.obj", "rays.npz", "--memory-limit", "1T"], &reference[..]].concat();
    for kibibytes in [150_000, 160_000, 170_000, 180_000, 200_000] {
        let output = limited(at, &format!("-v {kibibytes}"), &trace);
        assert!(!stderr(&output).contains("damaged"), "{}", stderr(&output));
    }
}

#[test]
fn memory_is_limited_on_devices_too() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let at = folder.path();
    let name = device.info.index.to_string();
    let picture = ["render", "one.obj", "--device", &name, "--memory-limit", "300M", "--size", "30000x30000"];
    assert_fails(&raybrook(at, &picture), 4, &["a picture of 30000x30000", "lower --size"]);
    write(at, "solid.toml", "[[object]]\nsolid = 'sphere'\nsegments = 1024\n");
    let scene = ["render", "solid.toml", "--device", &name, "--memory-limit", "300M", "--size", "8x8"];
    assert_fails(&raybrook(at, &scene), 3, &["1046528 triangles", "300 MiB"]);
}

#[test]
fn scenes_without_objects_are_refused_unless_that_is_wanted() {
    let folder = folder();
    let at = folder.path();
    write(at, "empty.toml", "");
    write(at, "cut.toml", "[image]\nwidth = 8\nheight = 8\n[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\n");
    rays(at, 2);
    for name in ["empty.toml", "cut.toml"] {
        for command in [&["render", name][..], &["trace", name, "rays.npz"]] {
            let output = raybrook(at, &[command, &["--device", "reference"]].concat());
            assert_fails(&output, 3, &[name, "has no objects", "--allow-empty"]);
        }
        let output = raybrook(at, &[&["render", name, "--allow-empty"], &SMALL[..]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let output = raybrook(at, &["trace", name, "rays.npz", "--allow-empty", "--device", "reference"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let output = raybrook(at, &["info", name]);
        assert!(output.status.success(), "{}", stderr(&output));
        assert_fails(&raybrook(at, &["tune", name, "--device", "reference"]), 3, &[name, "has no objects"]);
        assert_fails(
            &raybrook(at, &["study", "pareto", "--scene", name, "--device", "reference"]),
            3,
            &["has no objects"],
        );
    }
    // Models have no other purpose than their triangles.
    let header =
        "format ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    write(at, "empty.obj", "v 0 0 0\n");
    write(at, "empty.ply", &format!("ply\n{header}"));
    write(at, "empty.stl", "solid a\nendsolid a\n");
    write(at, "empty.nff", "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 40\nhither 1\nresolution 8 8\n");
    write(at, "empty.gltf", "{\"asset\": {\"version\": \"2.0\"}}");
    write(at, "empty.off", "OFF\n0 0 0\n");
    write(at, "empty.glb", "");
    write(at, "empty.3mf", "");
    for ending in ["obj", "ply", "stl", "nff", "gltf", "glb", "off", "3mf"] {
        let name = &format!("empty.{ending}")[..];
        assert_fails(&raybrook(at, &[&["render", name], &SMALL[..]].concat()), 3, &[name]);
    }
}

#[test]
fn what_cannot_be_framed_is_named_and_rays_need_no_camera() {
    let folder = folder();
    let at = folder.path();
    write(at, "huge.obj", "v 0 0 0\n# far\nv -3.3e38 1 0\nv 0 1e38 3e38\nf 1 2 3\n");
    let output = raybrook(at, &[&["render", "huge.obj"], &SMALL[..]].concat());
    assert_fails(
        &output,
        3,
        &["huge.obj:3:", "(-3.3e38, 1e0, 0e0)", "triangle 0", "give a camera by --eye and --target"],
    );
    assert!(!stderr(&output).contains("inf"), "{}", stderr(&output));
    write(
        at,
        "huge.stl",
        "solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 3e38 0 0\nvertex 0 3e38 0\nendloop\nendfacet\n\
         endsolid a\n",
    );
    assert_fails(&raybrook(at, &[&["render", "huge.stl"], &SMALL[..]].concat()), 3, &["huge.stl:", "3e38", "camera"]);

    // Rays need neither camera nor lights: not one that frames the scene, and not the file's lamp beyond the ends of
    // float32.
    let object = "[[object]]\nfile = 'plane.obj'\n";
    write(at, "plane.obj", "v -1.6e38 -1.6e38 0\nv 1.6e38 -1.6e38 0\nv 0 1.6e38 0\nf 1 2 3\n");
    write(at, "plane.toml", object);
    rays(at, 2);
    for scene in ["plane.obj", "plane.toml", "huge.obj"] {
        let output = raybrook(at, &["trace", scene, "rays.npz", "-o", "hits.npz", "--device", "reference"]);
        assert!(output.status.success(), "{scene}: {}", stderr(&output));
        assert!(raybrook(at, &["info", scene]).status.success());
    }
    write(at, "lamp.obj", "v 0 0 0\nv 1e-30 0 0\nv 0 1e-30 0\nf 1 2 3\n");
    write(at, "lamp.toml", "[[light]]\nkind = 'point'\nposition = [1e38, 0, 0]\n[[object]]\nfile = 'lamp.obj'\n");
    assert_fails(&raybrook(at, &[&["render", "lamp.toml"], &SMALL[..]].concat()), 3, &["light 0"]);
    assert!(raybrook(at, &["trace", "lamp.toml", "rays.npz", "--device", "reference"]).status.success());
    assert!(raybrook(at, &["info", "lamp.toml"]).status.success());
    let tune = ["tune", "huge.obj", "--device", "reference", "--rays", "64", "--structure", "bvh2,kd"];
    let output = raybrook(at, &tune);
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn empty_variables_are_as_unset() {
    let folder = folder();
    let at = folder.path();
    let variables = [
        ("RAYBROOK_DEVICE", ""),
        ("RAYBROOK_CACHE_DIR", ""),
        ("RAYBROOK_CACHE_MB", ""),
        ("HOME", at.to_str().unwrap()),
    ];
    let output = raybrook_with(at, &["render", "one.obj", "--size", "8x8", "-q"], &variables);
    assert!(output.status.success(), "{}", stderr(&output));
    let output = raybrook_with(at, &["info", "one.obj"], &[("RAYBROOK_DEVICE", "nothing-like-it")]);
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn tune_finds_out_that_it_cannot_write_before_it_measures() {
    let folder = folder();
    let at = folder.path();
    write(at, "file", "");
    std::fs::create_dir_all(at.join("cache").join("tuned.json")).unwrap();
    let tune = ["tune", "one.obj", "--device", "reference", "--rays", "64"];
    for cache in ["file", "file/cache", "cache"] {
        let output = raybrook_with(at, &tune, &[("RAYBROOK_CACHE_DIR", at.join(cache).to_str().unwrap())]);
        assert_fails(&output, 5, &["cannot create"]);
        assert!(!stderr(&output).contains("candidate"), "{}", stderr(&output));
    }
    let elsewhere = [("RAYBROOK_CACHE_DIR", at.join("file").to_str().unwrap().to_owned())];
    let elsewhere: Vec<_> = elsewhere.iter().map(|(name, value)| (*name, value.as_str())).collect();
    let output = raybrook_with(at, &[&tune[..], &["--no-cache", "--structure", "bvh2"]].concat(), &elsewhere);
    assert!(output.status.success(), "{}", stderr(&output));
}

/// Fails when something is in the output that a terminal may take for a command.
fn assert_plain(output: &Output, from: &str) {
    for text in [&output.stdout, &output.stderr] {
        let text = String::from_utf8_lossy(text);
        assert!(!text.contains(|c: char| c.is_control() && c != '\n' && c != '\t'), "{from}: {text:?}");
    }
}

#[test]
fn texts_of_files_and_arguments_never_command_the_terminal() {
    const ESCAPE: &str = "\u{1b}]0;title\u{7}\u{1b}[31m\u{9b}2J";
    let folder = folder();
    let at = folder.path();
    let named = format!("x{ESCAPE}");
    let toml = "\\u001b]0;title\\u0007\\u001b[31m\\u009b2J";
    let model = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let ply = |what: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             {what}element face 1\n\
             property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        )
    };
    let files = [
        ("material.toml", format!("[[object]]\nsolid = 'box'\nmaterial = \"{toml}\"\n")),
        ("solid.toml", format!("[[object]]\nsolid = \"{toml}\"\n")),
        ("file.toml", format!("[[object]]\nfile = \"{toml}.obj\"\n")),
        ("key.toml", format!("[image]\n\"{toml}\" = 1\n")),
        ("texture.toml", format!("[material.\"{toml}\"]\ntexture = \"{toml}\"\n")),
        ("raw.toml", format!("[[object]]\nsolid = '{ESCAPE}'\n")),
        ("material.obj", format!("{model}mtllib {named}.mtl\nusemtl {named}\n{named} 1\nf 1 2 3\n")),
        ("bad.obj", format!("{model}f 1 2 {named}\n")),
        ("maps.obj", format!("mtllib maps.mtl\n{model}usemtl a\nf 1 2 3\n")),
        ("maps.mtl", format!("newmtl a\nmap_Kd {named}.png\n{named} 1\nNs {named}\n")),
        ("named.ply", ply(&format!("property float {named}\n"))),
        ("typed.ply", ply(&format!("property {named} w\n"))),
        ("texture.ply", ply(&format!("property float u\nproperty float v\ncomment TextureFile {named}.png\n"))),
        ("word.nff", format!("{named} 1 2 3\np 3\n0 0 0\n1 0 0\n0 1 0\n")),
        ("word.off", format!("OFF\n1 1 0\n{named} 0 0\n")),
        ("word.gltf", format!("{{\"asset\": {{\"version\": \"{toml}\"}}}}")),
        (
            "names.gltf",
            format!(
                "{{\"asset\": {{\"version\": \"2.0\"}}, \"extensionsUsed\": [\"{toml}\"], \
                 \"nodes\": [{{\"mesh\": 0}}], \
                 \"meshes\": [{{\"primitives\": [{{\"attributes\": {{\"POSITION\": 0}}, \"material\": 0}}]}}], \
                 \"materials\": [{{\"name\": \"{toml}\", \"pbrMetallicRoughness\": {{\"baseColorTexture\": \
                 {{\"index\": 0}}}}}}], \
                 \"textures\": [{{\"source\": 0}}], \"images\": [{{\"uri\": \"{toml}.png\"}}], \
                 \"accessors\": [{{\"count\": 3, \"componentType\": 5126, \"type\": \"VEC3\"}}]}}"
            ),
        ),
        ("word.stl", format!("solid {named}\nfacet {named}\nvertex {named} 0 0\n")),
    ];
    for (name, text) in &files {
        write(at, name, text);
        for command in ["info", "render"] {
            let output =
                raybrook(at, &[&[command, name, "-v"][..], if command == "render" { &SMALL } else { &[] }].concat());
            assert_plain(&output, name);
        }
    }
    let path = format!("{named}.obj");
    write(at, &path, &format!("{model}f 1 2 3\n"));
    let output_name = format!("{named}.png");
    for arguments in [
        &["render", &path, "-q"][..],
        &["render", "one.obj", "-o", &named],
        &["render", "one.obj", "-o", &output_name, "--size", "8x8", "--device", "reference"],
        &["render", "one.obj", "--device", &named],
        &["render", "one.obj", "--structure", &named],
        &["render", "one.obj", "--size", &named],
        &["render", "one.obj", "--samples", &named],
        &["render", &named],
        &["trace", "one.obj", &named],
        &["stress", &named],
        &["study", &named],
        &["devices", "--kernels", &named],
        &[&named],
    ] {
        assert_plain(&raybrook(at, arguments), arguments[arguments.len() - 1]);
    }
    assert_plain(&raybrook_with(at, &["render", "one.obj"], &[("RAYBROOK_DEVICE", &named)]), "RAYBROOK_DEVICE");
}

/// A short part of what `tests/faults/mutate.py` does.
#[test]
fn files_broken_at_random_end_in_documented_codes() {
    let script = crate::common::root().join("tests/faults/mutate.py");
    if !Command::new("python3").arg("--version").output().is_ok_and(|output| output.status.success()) {
        crate::common::skip("there is no python3");
        return;
    }
    let output = Command::new("python3")
        .args(["-B".as_ref(), script.as_os_str(), env!("CARGO_BIN_EXE_raybrook").as_ref()])
        .args(["--runs", "12", "--seed", "20081121"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
}
