//! Pictures from all around: their number, that they are those of `render`, and that they are of one scene.

use super::{assert_fails, folder, raybrook, stderr};
use std::path::Path;
use std::process::{Command, Stdio};

const PICTURE: [&str; 6] = ["--size", "16x12", "--samples", "1", "--device", "reference"];

fn turntable(at: &Path, scene: &str, arguments: &[&str]) -> std::process::Output {
    raybrook(at, &[&["turntable", scene], &PICTURE[..], arguments].concat())
}

fn model() -> tempfile::TempDir {
    let folder = folder();
    let model = "v -1 -2 -3\nv 1 -2 -3\nv 1 2 -3\nv -1 2 -3\nv 0 3 4\nf 4 3 2 1\nf 1 2 5\nf 3 4 5\nf 2 3 5\nf 4 1 5\n";
    std::fs::write(folder.path().join("tent.obj"), model).unwrap();
    folder
}

/// The bytes of all frames.
fn frames(at: &Path, folder: &str) -> Vec<Vec<u8>> {
    let path = |i: usize| at.join(folder).join(format!("frame-{i:04}.png"));
    (1..).map(path).take_while(|path| path.exists()).map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn frames_are_the_pictures_of_their_cameras() {
    let folder = model();
    let at = folder.path();
    // Quarter turns about y are exact.
    let camera = ["--eye", "9,4,2", "--target", "0,1,0", "--fov", "50"];
    let output = turntable(at, "tent.obj", &[&["--frames", "4", "-o", "out"], &camera[..]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("out: 4 frames, "));
    let found = frames(at, "out");
    assert_eq!(found.len(), 4);
    for (frame, eye) in found.iter().zip(["9,4,2", "2,4,-9", "-9,4,-2", "-2,4,9"]) {
        let picture = [&["render", "tent.obj", "-o", "one.png"], &PICTURE[..], &camera[2..], &["--eye", eye]].concat();
        assert!(raybrook(at, &picture).status.success());
        assert!(*frame == std::fs::read(at.join("one.png")).unwrap(), "{eye}");
    }
    assert!(found[0] != found[1] && found[1] != found[2]);
    let half =
        turntable(at, "tent.obj", &[&["--frames", "2", "--degrees=-180", "-o", "turn.png"], &camera[..]].concat());
    assert!(half.status.success(), "{}", stderr(&half));
    let second = std::fs::read(at.join("turn-0002.png")).unwrap();
    assert!(std::fs::read(at.join("turn-0001.png")).unwrap() == found[0] && second == found[3]);
}

#[test]
fn keys_of_the_scene_lead_the_camera_and_frames_make_an_animation() {
    let folder = model();
    let at = folder.path();
    let keys = "[[camera.key]]\nframe = 1\neye = [9, 4, 2]\n[[camera.key]]\nframe = 3\neye = [5, 4, 9]\nfov = 60\n";
    let scene = format!("[camera]\ntarget = [0, 1, 0]\nfov = 50\n{keys}[[object]]\nfile = \"tent.obj\"\n");
    std::fs::write(at.join("moving.toml"), scene).unwrap();
    let output = turntable(at, "moving.toml", &["-o", "keyed", "--animation", "all.png", "--fps", "10"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let found = frames(at, "keyed");
    assert_eq!(found.len(), 3);
    for (frame, words) in [(0, "--eye 9,4,2 --fov 50"), (1, "--eye 7,4,5.5 --fov 55"), (2, "--eye 5,4,9 --fov 60")] {
        let camera = words.split(' ').collect::<Vec<_>>();
        let picture = [&["render", "tent.obj", "-o", "one.png", "--target", "0,1,0"], &PICTURE[..], &camera].concat();
        assert!(raybrook(at, &picture).status.success());
        assert!(found[frame] == std::fs::read(at.join("one.png")).unwrap(), "{words}");
    }
    let animation = std::fs::read(at.join("all.png")).unwrap();
    assert!(animation.windows(8).any(|bytes| bytes == [b'a', b'c', b'T', b'L', 0, 0, 0, 3]));
    // The camera of the scene itself is that of the first key, and an option has the scene turn.
    assert!(turntable(at, "moving.toml", &["--frames", "2", "--degrees", "90", "-o", "turned"]).status.success());
    assert!(frames(at, "turned")[0] == found[0] && frames(at, "turned")[1] != found[1]);
    assert_fails(&turntable(at, "tent.obj", &["-o", "none"]), 2, &["--frames", "camera keys"]);
    assert_fails(&turntable(at, "moving.toml", &["-o", "a.exr", "--animation", "b.png"]), 2, &["--animation"]);
    assert_fails(
        &turntable(at, "moving.toml", &["-o", "keyed", "--animation", "keyed/frame-0002.png"]),
        2,
        &["--animation"],
    );
    let unordered =
        "[camera]\neye = [0, 0, 9]\ntarget = [0, 0, 0]\n[[camera.key]]\nframe = 3\n[[camera.key]]\nframe = 3\n";
    std::fs::write(at.join("wrong.toml"), unordered).unwrap();
    assert_fails(&turntable(at, "wrong.toml", &["-o", "none"]), 3, &["wrong.toml:7", "frame", "before it, 3"]);
    assert!(!at.join("none").exists());
}

#[test]
fn a_turntable_goes_on_where_it_was_stopped() {
    let folder = model();
    let at = folder.path();
    let arguments = ["--frames", "6", "--size", "160x120", "-o", "a"];
    let arguments: Vec<_> = ["turntable", "tent.obj"].iter().chain(&arguments).chain(&PICTURE[2..]).copied().collect();
    assert!(raybrook(at, &arguments).status.success());
    let undisturbed = frames(at, "a");
    assert_eq!(undisturbed.len(), 6);
    // Killed once the first frames are there.
    let words: Vec<_> = arguments.iter().map(|&word| if word == "a" { "b" } else { word }).collect();
    let slow = [&words[..], &["--device", "reference"]].concat();
    let mut child = Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args(&slow[..slow.len() - 2])
        .current_dir(at)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while frames(at, "b").is_empty() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    let _ = child.kill();
    child.wait().unwrap();
    // However many there are, one is lost.
    let _ = std::fs::remove_file(at.join("b/frame-0003.png"));
    let first = std::fs::metadata(at.join("b/frame-0001.png")).unwrap().modified().unwrap();
    let output = raybrook(at, &words);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("of which "), "{output:?}");
    assert!(frames(at, "b") == undisturbed);
    assert_eq!(std::fs::metadata(at.join("b/frame-0001.png")).unwrap().modified().unwrap(), first);
}

#[test]
fn frames_that_were_cut_off_or_damaged_are_made_anew() {
    let folder = model();
    let at = folder.path();
    let run = || turntable(at, "tent.obj", &["--frames", "5", "-o", "out", "--layers", "depth"]);
    assert!(run().status.success());
    let path = |name: &str| at.join("out").join(format!("frame-{name}.png"));
    let read = || -> Vec<Vec<u8>> {
        let name = |frame: u32, layer| path(&format!("000{frame}{layer}"));
        (1..=5).flat_map(|frame| ["", "-depth"].map(|layer| std::fs::read(name(frame, layer)).unwrap())).collect()
    };
    let modified = |name| std::fs::metadata(path(name)).unwrap().modified().unwrap();
    let (right, untouched) = (read(), ["0001", "0001-depth", "0005"].map(modified));
    // One is cut off, of another a bit has changed, and of a third a bit of a layer's picture.
    let cut = std::fs::read(path("0002")).unwrap();
    std::fs::write(path("0002"), &cut[..cut.len() / 2]).unwrap();
    for name in ["0003", "0004-depth"] {
        let mut damaged = std::fs::read(path(name)).unwrap();
        damaged[60] ^= 16;
        std::fs::write(path(name), damaged).unwrap();
    }
    let output = run();
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("frame-0002.png' and 2 more are not what was written"), "{said}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("5 frames, of which 2 were there"), "{output:?}");
    assert!(read() == right);
    assert_eq!(["0001", "0001-depth", "0005"].map(modified), untouched);
    // Whoever made frames before there were sums has what is there noted.
    let manifest = at.join("out/frame-turntable.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let mut values: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).unwrap();
    values.remove("files").unwrap();
    std::fs::write(&manifest, serde_json::to_string(&values).unwrap()).unwrap();
    let output = run();
    assert!(String::from_utf8_lossy(&output.stdout).contains("of which 5 were there"), "{output:?}");
    assert_eq!(std::fs::read_to_string(&manifest).unwrap(), text);
    std::fs::write(path("0005"), b"").unwrap();
    let output = run();
    assert!(stderr(&output).contains("frame-0005.png' is not what was written; its frame"), "{output:?}");
    assert!(read() == right);
}

#[test]
fn frames_of_something_else_are_not_mixed_in() {
    let folder = model();
    let at = folder.path();
    let five = ["--frames", "5", "-o", "out"];
    assert!(turntable(at, "tent.obj", &five).status.success());
    let before = frames(at, "out");
    for (scene, arguments, words) in [
        ("tent.obj", &["--frames", "3", "-o", "out"][..], &["-o", "'out'", "another frames", "--restart"][..]),
        ("tent.obj", &["--frames", "5", "-o", "out", "--degrees", "90"], &["degrees"]),
        ("tent.obj", &["--frames", "5", "-o", "out", "--fov", "30"], &["fov"]),
        ("tent.obj", &["--frames", "5", "-o", "out", "--exposure", "1"], &["another exposure"]),
        ("one.obj", &five, &["another scene"]),
        ("tent.obj", &["--frames", "0"], &["--frames"]),
        ("tent.obj", &["--frames", "2", "--degrees", "nan"], &["--degrees"]),
        ("tent.obj", &["--frames", "2", "-o", "a.gif"], &["-o", "a.gif"]),
    ] {
        assert_fails(&turntable(at, scene, arguments), 2, words);
        assert!(frames(at, "out") == before, "{arguments:?}");
    }
    // The scene itself may have changed.
    let changed = std::fs::read_to_string(at.join("tent.obj")).unwrap().replace("v 0 3 4", "v 0 3 5");
    std::fs::write(at.join("tent.obj"), changed).unwrap();
    assert_fails(&turntable(at, "tent.obj", &five), 2, &["another scene"]);
    let three = ["--frames", "3", "-o", "out", "--restart"];
    assert!(turntable(at, "tent.obj", &three).status.success());
    assert_eq!(frames(at, "out").len(), 3);
    assert!(!at.join("out/frame-0005.png").exists() && frames(at, "out")[0] != before[0]);
    // Frames that nobody knows.
    std::fs::remove_file(at.join("out/frame-turntable.json")).unwrap();
    assert_fails(&turntable(at, "tent.obj", &["--frames", "3", "-o", "out"]), 2, &["nothing that tells", "--restart"]);
}

/// Layers of frames have the bytes of `render`'s, and belong to what has to be there.
#[test]
fn layers_of_frames_are_those_of_their_pictures() {
    let folder = model();
    let at = folder.path();
    let camera = ["--target", "0,1,0", "--fov", "50"];
    let turn = |more: &[&str]| {
        let arguments = [&["--frames", "2", "--degrees=-180", "--eye", "9,4,2"], &camera[..], more].concat();
        turntable(at, "tent.obj", &arguments)
    };
    let read = |name: &str| std::fs::read(at.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    for (name, layers, beside) in [
        ("flat.png", "depth,normal,steps", &["depth", "normal", "steps"][..]),
        ("deep.exr", "depth,object,samples,tests", &[]),
    ] {
        let output = turn(&["--layers", layers, "-o", name]);
        assert!(output.status.success(), "{}", stderr(&output));
        let (stem, ending) = name.split_once('.').unwrap();
        for (frame, eye) in [("0001", "9,4,2"), ("0002", "-2,4,9")] {
            let picture = ["render", "tent.obj", "--layers", layers, "-o", name, "--eye", eye];
            assert!(raybrook(at, &[&picture[..], &PICTURE[..], &camera[..]].concat()).status.success());
            assert!(read(&format!("{stem}-{frame}.{ending}")) == read(name), "{name} {frame}");
            for layer in beside {
                let one = read(&format!("{stem}-{layer}.png"));
                assert!(read(&format!("{stem}-{frame}-{layer}.png")) == one, "{name} {frame} {layer}");
            }
        }
    }
    let said = |output: &std::process::Output| String::from_utf8_lossy(&output.stdout).into_owned();
    let flat = ["--layers", "depth,normal,steps", "-o", "flat.png"];
    let before = read("flat-0002-normal.png");
    std::fs::remove_file(at.join("flat-0002-normal.png")).unwrap();
    let again = said(&turn(&flat));
    assert!(again.contains("2 frames, of which 1 were there"), "{again}");
    assert!(read("flat-0002-normal.png") == before);
    // What the frames know is part of what they are.
    let other = turn(&["--layers", "depth", "-o", "flat.png"]);
    assert_fails(&other, 2, &["another layers", "--restart"]);
    let anew = turn(&["-o", "flat.png", "--restart"]);
    assert!(anew.status.success() && !said(&anew).contains("were there"), "{}", stderr(&anew));
    for layer in ["depth", "normal", "steps"] {
        assert!(!at.join(format!("flat-0001-{layer}.png")).exists(), "{layer}");
    }
    assert_fails(&turn(&["--layers", "depth", "-o", "no.pfm"]), 2, &["--layers", ".exr"]);
    assert_fails(&turn(&["--layers", "error", "-o", "no.png"]), 2, &["--layers"]);
}
