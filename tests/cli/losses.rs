//! Nothing that a user has is lost: inputs are not overwritten, what cannot be written is told, and a run that is
//! stopped leaves nothing unfinished. `tests/faults/` has the long form of the latter two.

use super::{assert_fails, folder, raybrook, stderr, write_npz};
use std::path::Path;

/// A picture that is not made by `raybrook`.
fn picture(path: &Path) {
    image::RgbImage::from_pixel(2, 2, image::Rgb([9, 8, 7])).save(path).unwrap();
}

/// A model with a library and pictures, in a scene of which there is one more; rays; and a report by somebody else.
fn with_inputs() -> tempfile::TempDir {
    let folder = folder();
    let at = folder.path();
    let write = |name: &str, text: &str| std::fs::write(at.join(name), text).unwrap();
    let face = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    write("model.obj", &format!("mtllib model.mtl\n{face}"));
    write("model.mtl", "newmtl m\nmap_Kd model.png\nnewmtl unused\nbump -bm 2 bump.png\nmap_Ks unread.png\n");
    write(
        "textured.ply",
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    );
    write(
        "scene.toml",
        "[material.m]\ndiffuse = 1\ntexture = \"floor.png\"\n[[object]]\nfile = \"model.obj\"\n[[object]]\n\
         file = \"textured.ply\"\n\
         [[object]]\nsolid = \"height-field\"\nmaterial = \"m\"\npicture = \"heights.png\"\n",
    );
    for name in ["model", "bump", "unread", "skin", "floor", "heights"] {
        picture(&at.join(format!("{name}.png")));
    }
    let rays = at.join("rays.npz");
    write_npz(&rays, &[("origin", 3, &[0.1, 0.1, 1.0]), ("direction", 3, &[0.0, 0.0, -1.0])]);
    for folder in ["site", "other/data", "third/data"] {
        std::fs::create_dir_all(at.join(folder)).unwrap();
    }
    write("site/index.html", "<html><title>mine</title></html>");
    write("other/data/layout.json", "{\"study\": \"layout\", \"rooms\": 3}");
    write("third/data/layout.journal", "a diary");
    #[cfg(unix)]
    std::os::unix::fs::symlink("floor.png", at.join("link.png")).unwrap();
    std::fs::hard_link(at.join("floor.png"), at.join("hard.png")).unwrap();
    folder
}

/// The names and bytes of all files below `folder`, in order.
fn files(folder: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        match entry.is_dir() {
            true => found.extend(files(&entry)),
            false => found.push((entry.clone(), std::fs::read(entry).unwrap())),
        }
    }
    found.sort();
    found
}

#[test]
fn no_input_and_no_other_output_is_overwritten() {
    let folder = with_inputs();
    let at = folder.path();
    let before = files(at);
    let render = "render --device reference --size 4x4 --samples 1";
    let trace = "trace --device reference";
    let cases: &[(&str, &[&str])] = &[
        (&format!("{render} model.obj -o model.png"), &["-o", "model.png", "texture", "model.mtl"]),
        (&format!("{render} model.obj -o bump.png"), &["-o", "texture that", "model.mtl"]),
        (&format!("{render} model.obj -o unread.png"), &["-o", "texture that", "model.mtl"]),
        (&format!("{render} textured.ply -o skin.png"), &["-o", "texture that", "textured.ply"]),
        (&format!("{render} scene.toml -o skin.png"), &["-o", "texture that", "textured.ply"]),
        (&format!("{render} scene.toml -o floor.png"), &["-o", "texture that 'scene.toml'"]),
        (&format!("{render} scene.toml -o site/../link.png"), &["-o", "link.png", "texture that 'scene.toml'"]),
        (&format!("{render} scene.toml -o hard.png"), &["-o", "hard.png", "texture that 'scene.toml'"]),
        (&format!("{render} scene.toml -o heights.png"), &["-o", "picture of heights that 'scene.toml'"]),
        (&format!("{render} scene.toml --stats model.obj"), &["--stats", "model that 'scene.toml'"]),
        (&format!("{render} scene.toml --stats model.mtl"), &["--stats", "material library"]),
        (&format!("{render} scene.toml --stats scene.toml"), &["--stats", "'scene.toml' is the scene"]),
        (&format!("{render} one.obj -o a.png --stats ./a.png"), &["a.png", "what --stats writes"]),
        (&format!("{render} one.obj -o a.png --aov steps --stats a-steps.png"), &["a-steps.png", "--stats"]),
        (&format!("{render} one.obj -o a.png --layers depth --stats a-depth.png"), &["a-depth.png", "--layers"]),
        (&format!("{render} one.obj -o a.png --layers steps --aov steps"), &["a-steps.png", "--layers"]),
        (&format!("{trace} one.obj rays.npz -o rays.npz"), &["-o", "the file of rays"]),
        (&format!("{trace} one.obj rays.npz --stats one.obj"), &["--stats", "the scene"]),
        (&format!("{trace} model.obj rays.npz -o model.mtl"), &["-o", "material library"]),
        (&format!("{trace} one.obj rays.npz -o h.npz --stats h.npz"), &["--stats", "what -o writes"]),
        ("stress --device reference --replay model.obj rays.npz --json rays.npz", &["--json", "--replay"]),
        ("stress --device reference --replay model.obj rays.npz --json model.mtl", &["--json", "material library"]),
        ("stress --device reference --closed one.obj --json one.obj", &["--json", "a model"]),
        ("stress edges --rays 1 --write w --json w/edges-1.obj", &["--write", "what --json writes"]),
        ("study layout --quick --scene model.obj --markdown model.png", &["--markdown", "texture"]),
        ("study layout --quick --scene model.obj --markdown raybrook-study/index.html", &["--markdown", "-o"]),
        ("study layout --quick --device reference -o site", &["-o", "site/index.html", "another folder"]),
        ("study layout --quick --device reference -o other", &["-o", "other/data/layout.json"]),
        ("study layout --quick --device reference -o third", &["-o", "third/data/layout.journal"]),
    ];
    for (command, words) in cases {
        std::fs::create_dir_all(at.join("w")).unwrap();
        let output = raybrook(at, &command.split(' ').collect::<Vec<_>>());
        assert_fails(&output, 2, words);
        assert!(files(at) == before, "{command}");
    }
}

#[test]
fn a_picture_without_a_name_of_its_own_avoids_the_scenes_files() {
    let folder = with_inputs();
    let at = folder.path();
    let before = files(at);
    let output = raybrook(at, &["render", "model.obj", "--device", "reference", "--size", "4x4", "--samples", "1"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("model-render.png"), "{}", stderr(&output));
    let mut after = files(at);
    after.retain(|(path, _)| !path.ends_with("model-render.png"));
    assert!(after == before && at.join("model-render.png").exists());
}

#[cfg(target_os = "linux")]
mod on_linux {
    use super::*;
    use std::ffi::OsStr;
    use std::io::{BufRead, BufReader};
    use std::os::unix::ffi::OsStrExt;
    use std::process::{Command, Output, Stdio};

    /// The program behind `script` of a shell, in which `$0` is its path.
    fn in_shell(at: &Path, script: &str) -> Output {
        let mut command = Command::new("sh");
        command.args(["-c", script, env!("CARGO_BIN_EXE_raybrook")]).current_dir(at).stdin(Stdio::null());
        command.env("RAYBROOK_CACHE_DIR", at.join("cache")).env_remove("RAYBROOK_DEVICE").output().unwrap()
    }

    fn code(at: &Path, script: &str) -> i32 {
        let output = in_shell(at, script);
        assert!(!stderr(&output).contains("panicked"), "{script}: {}", stderr(&output));
        output.status.code().unwrap()
    }

    const RENDER: &str = "$0 render model.obj --device reference --size 4x4 --samples 1 -o out.png";

    #[test]
    fn what_was_not_printed_is_an_error_and_what_was_not_told_is_none() {
        let folder = with_inputs();
        let at = folder.path();
        let prints = [
            "info one.obj --json",
            "info one.obj",
            "devices --json",
            "methods",
            "methods --json",
            "stress --list",
            "study --list",
            "stress edges --rays 2 --device reference",
            "trace one.obj rays.npz --device reference",
            "--help",
            "--version",
        ];
        for arguments in prints {
            let output = in_shell(at, &format!("$0 {arguments} >/dev/full"));
            assert_fails(&output, 5, &["standard output", "No space left"]);
            assert_eq!(code(at, &format!("$0 {arguments} 2>/dev/full")), 0, "{arguments}");
            // The shell tells the code of the last program alone.
            let closed = in_shell(at, &format!("{{ $0 {arguments} 2>&1; echo $? >code; }} | true"));
            assert_eq!(stderr(&closed), "", "{arguments}");
            assert_eq!(std::fs::read_to_string(at.join("code")).unwrap(), "0\n", "{arguments}");
        }
        // The library has statements that are not supported, of which there are warnings.
        for (script, expected) in [
            (format!("{RENDER} >/dev/full"), 5),
            (format!("{RENDER} -v --explain 2>/dev/full"), 0),
            (format!("{RENDER} -v >/dev/null 2>&1 | true"), 0),
        ] {
            assert_eq!(code(at, &script), expected, "{script}");
            std::fs::remove_file(at.join("out.png")).unwrap();
        }
        for (arguments, expected) in [("render none.obj", 3), ("render one.obj --size 0", 2), ("frobnicate", 2)] {
            assert_eq!(code(at, &format!("$0 {arguments} 2>/dev/full")), expected, "{arguments}");
        }
    }

    #[test]
    fn nothing_printed_commands_a_terminal() {
        let folder = folder();
        let at = folder.path();
        std::fs::write(at.join("evil.toml"), "[image]\n\"a\\u001b[31m\\u009b2J\\u202e\" = 1\n").unwrap();
        std::fs::write(at.join("\u{1b}]0;x\u{7}.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nfrob\n").unwrap();
        let evil = "\u{1b}[2J\u{9b}31m\u{7}\u{202e}";
        let name = "\u{1b}]0;x\u{7}.obj";
        for arguments in [
            &["render", "evil.toml"][..],
            &["render", "one.obj", "--device", evil],
            &["render", "one.obj", "--size", evil],
            &["render", "one.obj", "-o", evil],
            &["stress", evil],
            &["study", evil],
            &[evil],
            &["info", name],
            &["render", name, "--size", "4x4", "--device", "reference", "-o", "\u{1b}[31m.png"],
            &["tune", name, "--device", "reference", "--rays", "64", "--structure", "bvh2", "--json"],
        ] {
            let output = raybrook(at, arguments);
            let said = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
            let raw = |c: char| c.is_control() && c != '\n' && c != '\t' || c == '\u{202e}';
            assert!(!said.is_empty() && !said.contains(raw), "{arguments:?}: {said:?}");
        }
    }

    /// Waits until a stress test has told of some kinds, and has `send` do something to it.
    fn stopped_stress(at: &Path, signal: &str) -> Output {
        let words = "stress --rays 40 --intersector thesis --json out.json --write wrong --device reference";
        let mut child = Command::new(env!("CARGO_BIN_EXE_raybrook"))
            .args(words.split(' '))
            .current_dir(at)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert_eq!(lines.by_ref().take(4).filter_map(Result::ok).count(), 4);
        let pid = child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{signal}"), &pid]).status().unwrap().success());
        // So that it can print all that it wants to.
        lines.for_each(drop);
        child.wait_with_output().unwrap()
    }

    #[test]
    fn a_run_that_is_stopped_keeps_what_it_found_and_leaves_nothing_else() {
        for (signal, expected) in [("INT", Some(130)), ("TERM", Some(143)), ("HUP", Some(129)), ("KILL", None)] {
            let folder = folder();
            let at = folder.path();
            let output = stopped_stress(at, signal);
            assert_eq!(output.status.code(), expected, "{signal}: {}", stderr(&output));
            let left = files(at).into_iter().filter(|(path, _)| path.to_string_lossy().ends_with(".tmp")).count();
            assert_eq!(left, 0, "{signal}");
            if expected.is_some() {
                let report: serde_json::Value =
                    serde_json::from_slice(&std::fs::read(at.join("out.json")).unwrap()).unwrap();
                assert_eq!(report["finished"], false);
                assert!(report["methods"][0]["kinds"].as_array().unwrap().len() >= 3, "{report}");
            }
        }
    }

    #[test]
    fn signals_that_are_to_be_ignored_are() {
        let folder = folder();
        // As `nohup` starts it; the program's process is the shell's own.
        let script = "trap '' HUP; (sleep 0.2; kill -HUP $$) & exec $0 stress edges --rays 30000 --device reference \
                      --json out.json";
        assert_eq!(code(folder.path(), script), 0);
        let report = std::fs::read_to_string(folder.path().join("out.json")).unwrap();
        assert!(report.contains("\"finished\": true"), "{report}");
    }

    #[test]
    fn a_limit_of_file_size_is_a_write_error() {
        let folder = with_inputs();
        let at = folder.path();
        let before = files(at);
        for arguments in [
            "render one.obj --device reference --size 64x64 --samples 1 -o out.pfm",
            "stress edges --rays 100 --intersector thesis --device reference --write .",
        ] {
            let output = in_shell(at, &format!("ulimit -f 1; exec $0 {arguments}"));
            assert_fails(&output, 5, &["cannot write", "too large"]);
        }
        assert!(files(at) == before);
    }

    #[test]
    fn pipes_are_no_input_files() {
        let folder = folder();
        let at = folder.path();
        std::fs::create_dir(at.join("cache")).unwrap();
        let make = |name: &str| assert!(Command::new("mkfifo").arg(at.join(name)).status().unwrap().success());
        let models = ["obj", "ply", "stl", "nff", "gltf", "glb", "off", "3mf"].map(|ending| format!("pipe.{ending}"));
        ["pipe.npz", "pipe.toml", "cache/tuned.json"].into_iter().for_each(make);
        models.iter().for_each(|name| make(name));
        for arguments in [
            &["trace", "one.obj", "pipe.npz"][..],
            &["stress", "--device", "reference", "--replay", "one.obj", "pipe.npz"],
            &["render", "pipe.toml"],
            &["render", "pipe.obj"],
        ] {
            assert_fails(&raybrook(at, arguments), 3, &["pipe.", "is not a regular file"]);
        }
        for name in &models {
            assert_fails(&raybrook(at, &["info", name]), 3, &["pipe.", "is not a regular file"]);
        }
        let output = raybrook(at, &["render", "one.obj", "--device", "reference", "--size", "4x4", "-o", "out.png"]);
        assert!(output.status.success() && at.join("out.png").exists());
        let said = stderr(&output);
        assert!(
            said.contains("note: ") && said.contains("tuned.json") && said.contains("not a regular file"),
            "{said}"
        );
        let tune = ["tune", "one.obj", "--device", "reference", "--rays", "64", "--structure", "bvh2"];
        assert_fails(&raybrook(at, &tune), 5, &["tuned.json", "not a regular file"]);
    }

    #[test]
    fn names_need_not_be_text() {
        let folder = folder();
        let at = folder.path();
        let name = |bytes: &[u8]| OsStr::from_bytes(bytes).to_owned();
        let scene = name(b"a\xffb.obj");
        std::fs::copy(at.join("one.obj"), at.join(&scene)).unwrap();
        let run = |arguments: &[&OsStr]| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_raybrook"));
            command.args(arguments).current_dir(at).env("RAYBROOK_CACHE_DIR", at.join("cache"));
            command.env("RAYBROOK_DEVICE", "reference").output().unwrap()
        };
        let words = |text: &'static str| text.split(' ').map(OsStr::new).collect::<Vec<_>>();
        let output = run(&[&words("render --size 4x4 --aov steps")[..], &[&scene]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(at.join(name(b"a\xffb.png")).exists() && at.join(name(b"a\xffb-steps.png")).exists());
        let report = name(b"report\xfe");
        let study = [&words("study depth --quick --scene")[..], &[&scene, OsStr::new("-o"), &report]].concat();
        let output = run(&study);
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(at.join(&report).join("index.html").exists());
        assert_fails(&run(&[&scene]), 2, &["unrecognized"]);
    }
}
