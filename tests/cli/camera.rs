//! Options of the camera: whose parts take the place of whose, what is told of it, and what is refused.

use super::{assert_fails, folder, raybrook, stderr};
use raybrook::low_level::film::Film;
use std::path::Path;

/// A box of different sides, and something on it that tells them apart.
const MODEL: &str = "v -1 -2 -3\nv 1 -2 -3\nv 1 2 -3\nv -1 2 -3\nv -1 -2 3\nv 1 -2 3\nv 1 2 3\nv -1 2 3\nv 0 3 1\n\
    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\nf 7 8 9\nf 3 7 9\n";

/// The same before an even background.
const PLAIN: &str = "[trace]\ndefault-light = \"plain\"\n[[object]]\nfile = \"box.obj\"\n";

const SIZE: [&str; 7] = ["--size", "24x18", "--samples", "1", "--device", "reference", "--explain"];

/// The bytes of the picture of `scene`, and what was explained.
fn rendered(at: &Path, scene: &str, arguments: &[&str]) -> (Vec<u8>, String) {
    let output = raybrook(at, &[&["render", scene, "-o", "out.pfm"], &SIZE[..], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    (std::fs::read(at.join("out.pfm")).unwrap(), stderr(&output))
}

/// The pixels of such a picture, lowest row first.
fn pixels(picture: &[u8]) -> Vec<[f32; 3]> {
    let values = picture[b"PF\n24 18\n-1.0\n".len()..].as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    values.collect::<Vec<_>>().as_chunks().0.to_vec()
}

fn model() -> tempfile::TempDir {
    let folder = folder();
    std::fs::write(folder.path().join("box.obj"), MODEL).unwrap();
    std::fs::write(folder.path().join("plain.toml"), PLAIN).unwrap();
    folder
}

#[test]
fn a_camera_that_is_given_is_that_of_a_scene_file() {
    let folder = model();
    let at = folder.path();
    let scene = |camera: &str| format!("[camera]\n{camera}\n[[object]]\nfile = \"box.obj\"\n");
    let write = |camera: &str| std::fs::write(at.join("scene.toml"), scene(camera)).unwrap();
    std::fs::write(at.join("other.toml"), scene("eye = [9, 1, 2]\ntarget = [0, 1, 0]\nup = [0, 0, 1]\nfov = 55"))
        .unwrap();
    for (of, arguments, camera) in [
        ("box.obj", &["--eye", "-7,2,5", "--target", "0,.5,0"][..], "eye = [-7, 2, 5]\ntarget = [0, 0.5, 0]"),
        (
            "box.obj",
            &["--eye", "1e1,0,0", "--target=-1,-1,-1", "--up", "-z", "--fov", "30"],
            "eye = [10, 0, 0]\ntarget = [-1, -1, -1]\nup = [0, 0, -1]\nfov = 30",
        ),
        ("other.toml", &[], "eye = [9, 1, 2]\ntarget = [0, 1, 0]\nup = [0, 0, 1]\nfov = 55"),
        ("other.toml", &["--eye", "8,3,2"], "eye = [8, 3, 2]\ntarget = [0, 1, 0]\nup = [0, 0, 1]\nfov = 55"),
        ("other.toml", &["--target", "0,0,1"], "eye = [9, 1, 2]\ntarget = [0, 0, 1]\nup = [0, 0, 1]\nfov = 55"),
        ("other.toml", &["--up", "0,2,-1"], "eye = [9, 1, 2]\ntarget = [0, 1, 0]\nup = [0, 2, -1]\nfov = 55"),
        ("other.toml", &["--fov", "70"], "eye = [9, 1, 2]\ntarget = [0, 1, 0]\nup = [0, 0, 1]\nfov = 70"),
    ] {
        write(camera);
        assert!(rendered(at, of, arguments).0 == rendered(at, "scene.toml", &[]).0, "{of} {arguments:?}");
    }
    // Of the camera that is placed by itself the other parts stay, too: it looks at the middle of the box.
    write("eye = [-7, 2, 5]\ntarget = [0, 0.5, 0]");
    assert!(rendered(at, "box.obj", &["--eye", "-7,2,5"]).0 == rendered(at, "scene.toml", &[]).0);
}

#[test]
fn every_part_of_the_camera_is_told_with_where_it_comes_from() {
    let folder = model();
    let at = folder.path();
    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 4 0 0\nvertex 0 2 6\nendloop\nendfacet\n\
        endsolid a\n";
    std::fs::write(at.join("one.stl"), stl).unwrap();
    std::fs::write(
        at.join("scene.toml"),
        "[camera]\neye = [9, 1, 2]\ntarget = [0, 1, 0]\n[[object]]\nfile = \"one.stl\"\n",
    )
    .unwrap();
    let ground = format!("{MODEL}v -9 -9 -3\nv 9 -9 -3\nv 9 9 -3\nv -9 9 -3\nf 10 11 12 13\n");
    std::fs::write(at.join("lying.obj"), ground).unwrap();
    for (scene, arguments, lines) in [
        ("box.obj", &[][..], &["--target 0,0.5,0: model: ", "--up 0,1,0: model: ", "--fov 40: model: "][..]),
        ("one.stl", &[], &["--target 2,1,3: model: ", "--up 0,0,1: scene: the rule of its format"]),
        ("one.stl", &["--up", "y"], &["--up 0,1,0: given on the command line"]),
        ("lying.obj", &[], &["--up 0,0,1: model: the model has level ground across z"]),
        ("lying.obj", &["--up", "y"], &["--up 0,1,0: given on the command line"]),
        (
            "scene.toml",
            &["--fov", "33"],
            &[
                "--eye 9,1,2: scene: ",
                "--target 0,1,0: scene: ",
                "--up 0,1,0: scene: ",
                "--fov 33: given on the command line",
            ],
        ),
        (
            "scene.toml",
            &["--view", "left"],
            &["--eye -", "model: --view left: from where everything", "--up 0,1,0: scene: "],
        ),
        ("box.obj", &["--view", "top"], &["--eye 0,", "--up 0,0,-1: model: as the view is straight down or up"]),
        ("one.stl", &["--view", "bottom"], &["--up 0,-1,0: model: as the view"]),
        (
            "box.obj",
            &["--view", "inside"],
            &["--eye 0,0.5,0: model: ", "--target 0,0.5,-3: model: ", "--fov 65: model: "],
        ),
        // Straight down with an up that nobody insists on.
        ("box.obj", &["--eye", "0,9,0", "--target", "0,0,0"], &["--up 0,0,-1: model: as the view"]),
        ("box.obj", &["--eye", "0,-9,0", "--target", "0,0,0"], &["--up 0,0,1: model: as the view"]),
    ] {
        let (_, said) = rendered(at, scene, arguments);
        for line in lines {
            assert!(said.contains(line), "{scene} {arguments:?}: '{line}' is missing in {said}");
        }
    }
}

#[test]
fn everything_is_in_the_picture_from_every_side() {
    let folder = model();
    let at = folder.path();
    for up in ["y", "z", "-x"] {
        let mut seen = Vec::new();
        for view in ["front", "back", "left", "right", "top", "bottom", "iso"] {
            let picture = rendered(at, "plain.toml", &["--view", view, "--up", up]).0;
            let pixels = pixels(&picture);
            let background = [0.05_f32; 3];
            let is_rim = |i: usize| [0, 23].contains(&(i % 24)) || !(24..17 * 24).contains(&i);
            assert!((0..24 * 18).filter(|&i| is_rim(i)).all(|i| pixels[i] == background), "{view} {up}");
            let hit = pixels.iter().filter(|&&pixel| pixel != background).count();
            assert!(hit > 40, "{view} {up}: {hit}");
            assert!(!seen.contains(&picture), "{view} {up}");
            seen.push(picture);
        }
    }
    // From within nothing else is seen, and nothing is black: where the lamp does not reach there is the sky.
    let inside = pixels(&rendered(at, "box.obj", &["--view", "inside"]).0);
    assert!(inside.iter().all(|pixel| pixel[0] > 0.05), "{inside:?}");
}

/// The box turned inward is a room; on ground of a thousand times its size it fills the picture as without.
#[test]
fn rooms_are_seen_from_inside_and_ground_does_not_count() {
    let folder = model();
    let at = folder.path();
    let inward: String = MODEL.split("f 7 8 9").next().unwrap().lines().fold(String::new(), |text, line| {
        let words: Vec<_> = line.split(' ').collect();
        let turned = |face: &[&str]| face.iter().rev().copied().collect::<Vec<_>>().join(" ");
        if words[0] == "f" { text + "f " + &turned(&words[1..]) + "\n" } else { text + line + "\n" }
    });
    let inward = inward.replace("v 0 3 1\n", "");
    std::fs::write(at.join("room.obj"), &inward).unwrap();
    let (room, said) = rendered(at, "room.obj", &[]);
    for words in ["--eye 0,0,2.7: model: ", "a room", "--target 0,0,-3: model: ", "--fov 65: model: "] {
        assert!(said.contains(words), "'{words}' is missing in {said}");
    }
    // Seen by a lamp that hangs on the left: the right wall is lighter than the left one, and the floor than the
    // ceiling.
    let seen = pixels(&room);
    assert!(seen.iter().all(|pixel| pixel[0] > 0.05));
    let mean = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| {
        let all = rows.flat_map(|row| columns.clone().map(move |column| row * 24 + column));
        let values: Vec<f32> = all.map(|i| seen[i][0]).collect();
        values.iter().sum::<f32>() / values.len() as f32
    };
    assert!(mean(8..10, 0..2) < 0.8 * mean(8..10, 22..24) && mean(16..18, 11..13) < 0.6 * mean(0..2, 11..13));
    let (outside, said) = rendered(at, "room.obj", &["--view", "front"]);
    assert!(said.contains("from where everything is in the picture") && outside != room, "{said}");
    let (_, said) = rendered(at, "room.obj", &["--eye", "1,2,9"]);
    assert!(said.contains("--target 0,0,0: model: the middle of the scene"), "{said}");
    assert!(!rendered(at, "box.obj", &[]).1.contains("a room"));

    let ground = format!("{MODEL}v -9999 -2 -9999\nv 9999 -2 -9999\nv 9999 -2 9999\nv -9999 -2 9999\nf 13 12 11 10\n");
    std::fs::write(at.join("ground.obj"), ground).unwrap();
    let (before_nothing, alone) = rendered(at, "box.obj", &[]);
    let (on_ground, said) = rendered(at, "ground.obj", &[]);
    let place = |said: &str| said.split_once("--eye ").unwrap().1.split_once(':').unwrap().0.to_owned();
    assert_eq!(place(&said), place(&alone));
    assert!(said.contains("everything but a large ground or backdrop"), "{said}");
    assert!(pixels(&on_ground)[0] != pixels(&before_nothing)[0], "the ground is at the lower left");
}

#[test]
fn a_model_of_stl_stands_upright() {
    let folder = model();
    let at = folder.path();
    // The same triangle in both formats.
    std::fs::write(at.join("two.obj"), "v 0 0 0\nv 4 0 0\nv 0 2 6\nf 1 2 3\n").unwrap();
    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 4 0 0\nvertex 0 2 6\nendloop\nendfacet\n\
        endsolid a\n";
    std::fs::write(at.join("two.stl"), stl).unwrap();
    let of = |scene: &str, arguments: &[&str]| rendered(at, scene, arguments).0;
    assert!(of("two.stl", &[]) == of("two.obj", &["--up", "z"]));
    assert!(of("two.stl", &["--up", "y"]) == of("two.obj", &[]));
    assert!(of("two.stl", &[]) != of("two.obj", &[]));
    // A scene file says itself what is up.
    std::fs::write(at.join("two.toml"), "[[object]]\nfile = \"two.stl\"\n").unwrap();
    assert!(of("two.toml", &[]) == of("two.obj", &["--up", "y"]));
}

#[test]
fn what_sees_nothing_is_refused() {
    let folder = model();
    let at = folder.path();
    for (arguments, words) in [
        (&["--eye", "1,2"][..], &["--eye", "1,2", "three finite numbers"][..]),
        (&["--eye", "1,2,inf"], &["--eye", "three finite numbers"]),
        (&["--target", "1,2,1e39"], &["--target", "three finite numbers"]),
        (&["--eye", "1,-2,3", "--target", "1,-2,3"], &["--eye", "1, -2, 3", "both the eye and the target"]),
        (&["--eye", "0,.5,0"], &["--eye", "both the eye and the target"]),
        (&["--eye", "0,9,0", "--target", "0,0,0", "--up", "-y"], &["--up", "parallel", "--up z"]),
        (&["--eye", "0,0.5,9", "--up", "z"], &["--up", "parallel", "--up y"]),
        (&["--up", "0,0,0"], &["--up", "no direction"]),
        (&["--up", "w"], &["--up", "'w'", "-z"]),
        (&["--fov", "0"], &["--fov", "between 0 and 180"]),
        (&["--fov", "180"], &["--fov", "180", "between 0 and 180"]),
        (&["--fov", "-40"], &["--fov", "-40", "between 0 and 180"]),
        (&["--fov", "nan"], &["--fov", "NaN", "between 0 and 180"]),
        (&["--view", "sideways"], &["--view", "sideways", "front, back, left, right, top, bottom, iso, inside"]),
        (&["--view", "top", "--eye", "1,2,3"], &["--view", "--eye"]),
        (&["--view", "top", "--target", "1,2,3"], &["--view", "--target"]),
    ] {
        for command in ["render", "check"] {
            let output = raybrook(at, &[&[command, "box.obj", "--size", "8x8"], arguments].concat());
            assert_fails(&output, 2, words);
        }
    }
    assert!(!at.join("box.png").exists());
}

#[test]
fn a_part_of_a_picture_is_written_with_the_bits_of_the_whole() {
    let folder = model();
    let at = folder.path();
    for quality in [&["--samples", "3"][..], &["--error", "2"]] {
        let picture = |arguments: &[&str]| {
            let render = ["render", "box.obj", "--size", "24x18", "--device", "reference", "-o", "out.pfm"];
            let output = raybrook(at, &[&render[..], quality, arguments].concat());
            assert!(output.status.success(), "{}", stderr(&output));
            (std::fs::read(at.join("out.pfm")).unwrap(), String::from_utf8_lossy(&output.stdout).into_owned())
        };
        let whole = pixels(&picture(&[]).0);
        let (part, said) = picture(&["--crop", "5,4,9x6"]);
        assert!(said.contains("out.pfm: 9x6, "), "{said}");
        let header = b"PF\n9 6\n-1.0\n";
        assert!(part.starts_with(header), "{quality:?}");
        let values = part[header.len()..].as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        let values: Vec<f32> = values.collect();
        // Rows are written from the lowest one up: the part's lowest is 8 rows above the picture's lowest.
        for (row, values) in values.chunks(3 * 9).enumerate() {
            let from = (18 - 4 - 6 + row) * 24 + 5;
            assert_eq!(values, whole[from..from + 9].as_flattened(), "{quality:?}, row {row}");
        }
    }
}

#[test]
fn exposure_multiplies_light_before_it_becomes_srgb() {
    let folder = model();
    let at = folder.path();
    let linear = pixels(&rendered(at, "plain.toml", &[]).0);
    // Rows of .pfm files begin with the lowest one.
    let film = Film { width: 24, height: 18, pixels: linear.chunks(24).rev().flatten().copied().collect() };
    for (stops, background) in [(None, 63), (Some("0"), 63), (Some("2"), 124), (Some("-1.5"), 36)] {
        let given = stops.map(|stops| ["--exposure", stops]);
        let render = ["render", "plain.toml", "-o", "out.png"];
        let arguments = [&render[..], &SIZE, given.as_ref().map_or(&[], |given| &given[..])].concat();
        let output = raybrook(at, &arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        let mut exposed = film.clone();
        exposed.expose(stops.map_or(0.0, |stops| stops.parse().unwrap())).unwrap();
        assert_eq!(std::fs::read(at.join("out.png")).unwrap(), exposed.to_png().unwrap(), "{stops:?}");
        // The background is 0.05; display values as IEC 61966-2-1 has them.
        assert_eq!(exposed.to_srgb8()[0], [background; 3], "{stops:?}");
    }
    for (arguments, words) in [
        (&["--exposure", "nan"][..], &["--exposure", "NaN", "-100 to 100"][..]),
        (&["--exposure", "101"], &["--exposure", "101", "-100 to 100"]),
        (&["--exposure", "much"], &["--exposure", "much"]),
        (&["--exposure", "1", "-o", "out.exr"], &["--exposure", ".exr", "leave it out"]),
        (&["--crop", "1,2,3"], &["--crop", "1,2,3", "100,50,320x240"]),
        (&["--crop", "0,0,0x4"], &["--crop", "0,0,0x4", "no pixels"]),
        (&["--crop", "4,0,5x8"], &["--crop", "4,0,5x8", "beyond the picture of 8x8"]),
        (&["--crop", "0,0,4x4", "--measure-error"], &["--crop", "--measure-error"]),
    ] {
        assert_fails(&raybrook(at, &[&["render", "box.obj", "--size", "8x8"], arguments].concat()), 2, words);
    }
}

/// The device has the pixels of the reference, whatever the camera.
#[test]
fn devices_see_the_same() {
    let Some(device) = crate::common::device() else { return };
    let index = device.info.index.to_string();
    let folder = model();
    let at = folder.path();
    let all = [&["--view", "inside"][..], &["--view", "top", "--up", "z"], &["--eye", "-7,2,5", "--fov", "20"]];
    for arguments in crate::common::usually_every(2, all) {
        let device = ["--size", "24x18", "--samples", "4", "--device", &index];
        let output = raybrook(at, &[&["check", "box.obj", "-o", "d.pfm"], arguments, &device].concat());
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("pixels       0 of 432 differ"), "{said}{}", stderr(&output));
    }
}
