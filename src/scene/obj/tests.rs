//! However a text is cut into parts, it gives the same scene, warnings and errors, as `tobj` has them where it can read
//! the text.

use super::load_in_parts;
use crate::budget::MemoryBudget;
use crate::error::Result;
use crate::random::Random;
use crate::scene::triangulate::MAX_PAIRS;
use crate::scene::{NO_INDEX, Scene};
use std::fmt::Write;
use std::path::PathBuf;

/// One part, parts of a line each, and sizes between.
const PART_BYTES: [usize; 6] = [usize::MAX, 1, 7, 61, 300, 4096];

/// Loads `text` in parts of each size: the results.
fn load_all(text: &[u8]) -> Vec<Result<Scene>> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("a.obj");
    std::fs::write(folder.path().join("m.mtl"), "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n").unwrap();
    std::fs::write(&path, text).unwrap();
    PART_BYTES.map(|part_bytes| load_in_parts(&path, part_bytes, &MemoryBudget::UNLIMITED)).into()
}

/// All that a loader decides of `scene`; NaN is equal to itself.
fn contents(scene: &Scene) -> String {
    let Scene { positions, normals, uvs, triangles, materials, warnings, .. } = scene;
    let warnings: Vec<_> = warnings.iter().map(|w| w.split_once("a.obj").expect("it names the file").1).collect();
    format!("{positions:?} {normals:?} {uvs:?} {triangles:?} {materials:?} {warnings:?}")
}

/// Loads `text`, which must give the same scene in parts of each size.
#[track_caller]
fn same_scene(text: &[u8]) -> Scene {
    let mut scenes = load_all(text).into_iter().map(|scene| scene.unwrap());
    let whole = scenes.next().unwrap();
    for (scene, part_bytes) in scenes.zip(&PART_BYTES[1..]) {
        assert!(
            contents(&scene) == contents(&whole),
            "parts of {part_bytes} bytes:\n{}",
            String::from_utf8_lossy(text)
        );
    }
    whole
}

/// The message about `text`, from its line on, which must be the same in parts of each size.
#[track_caller]
fn same_fault(text: &str) -> String {
    let message = |result: Result<Scene>| result.unwrap_err().to_string().split_once("a.obj:").unwrap().1.to_owned();
    let messages: Vec<_> = load_all(text.as_bytes()).into_iter().map(message).collect();
    assert!(messages.iter().all(|m| *m == messages[0]), "{messages:#?}");
    messages.into_iter().next().unwrap()
}

/// Statements of every kind in any order, lines broken and ended in every way.
fn hostile_text(random: &mut Random, line_ends: &[&str], statements: usize) -> String {
    let mut text = String::from(random.pick(&["", "\u{feff}", "# a comment\\\n"]));
    text.push_str("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf 1 2 3\n");
    for number in 0..statements {
        let (a, b, c) = (random.below(100) as f32 / 7.0, random.below(9), random.below(5));
        let corner = |random: &mut Random| {
            random.pick(&["-1", "-2/-1", "-3/1/-1", "1//1", "2", "3/99/-99", "-3//", "1/1"]).to_owned()
        };
        let mut statement = match random.below(16) {
            0..4 => format!("v {a} {b} {c}"),
            4 => format!("vn {a} {} {c}", random.pick(&["0", "nan", "1e9"])),
            5 => format!("vt {a}"),
            6 => format!("usemtl {}", random.pick(&["a", "b", "undefined", "a # no name", ""])),
            7 => String::from(random.pick(&["g x", "o y", "s 1", "mtllib m.mtl", "mtllib none.mtl", ""])),
            8 => format!("unknown{} 1 2", random.below(24)),
            9 => format!("# comment {}", random.pick(&["\\", "", "é"])),
            _ => "f".to_owned(),
        };
        for _ in 0..if statement == "f" { 2 + random.below(5) } else { 0 } {
            let corner = corner(random);
            write!(statement, "{}{corner}", random.pick(&[" ", "\t", " \\\n", " \\\n\\\n "])).unwrap();
        }
        text.push_str(&statement);
        if number + 1 < statements || random.below(2) == 0 {
            text.push_str(random.pick(line_ends));
        }
    }
    text
}

#[test]
fn any_parts_give_the_same_scene() {
    let random = &mut Random::new(2008);
    let mut triangles = 0;
    for _ in 0..300 {
        let line_ends: &[&str] = match random.below(4) {
            0 => &["\n"],
            1 => &["\r\n"],
            2 => &["\r", "\r\r"],
            _ => &["\n", "\r\n", "\r", "\n\n", " \n", "#\n"],
        };
        triangles += same_scene(hostile_text(random, line_ends, 60).as_bytes()).triangles.len();
    }
    assert!(triangles > 5000, "{triangles}");
    // Larger than a part of the usual size.
    let text = hostile_text(random, &["\n", "\r\n"], 60_000);
    assert!(text.len() > 2 * super::PART_BYTES);
    same_scene(text.as_bytes());
}

#[test]
fn faults_have_their_line_whatever_the_parts() {
    let good = "v 0 0 0\nv 1 0 0\r\nv 0 1 \\\n 0\nf 1 2 3\n\n# c\\\n".repeat(50); // of 7 lines
    for (bad, line, part) in [
        ("v 0 0 x", 351, "position parse error: 'v 0 0 x' is not made of numbers"),
        ("v 0 0", 351, "'v' needs 3 numbers, found 2: '0 0'"),
        ("\n\nf -1 \\\n-2 -151", 353, "vertex index -151 reaches before the first vertex: there are 150 up to here"),
        ("f 1 2 999", 351, "vertex index 999 is too large: the file has 300"),
        ("f 1 2 3/1/1/1", 351, "more than vertex/texture/normal"),
    ] {
        let message = same_fault(&format!("{good}{bad}\n{good}"));
        assert!(message.starts_with(&format!("{line}: ")) && message.contains(part), "{message}");
        // The first of several is told, of vertices before faces.
        let message = same_fault(&format!("{good}{bad}\n{good}f 0 0 0\n{good}f x\n"));
        assert!(message.starts_with(&format!("{line}: ")), "{message}");
        let message = same_fault(&format!("f 1 2 0\n{bad}\n{good}vn x\n{good}vn y\n"));
        assert!(message.contains(if bad.starts_with('v') { part } else { "'vn' needs 3 numbers" }), "{message}");
    }
}

/// Copied numbers come with blanks of all kinds.
#[test]
fn blanks_beyond_ascii_do_not_spoil_numbers() {
    let scene = same_scene("v 0 0 0\nv 1\u{a0} 0 \u{2003}2\nv 0 1 0\nf 1 2 3\n".as_bytes());
    assert_eq!(scene.vertices(0)[1].to_array(), [1.0, 0.0, 2.0]);
    assert!(same_fault("v 0 0 0\nv 1\u{a0}0 2 3\nf 1 1 1\n").starts_with("2: position parse error"));
}

/// Ear clipping is given so much time in a file; which polygons get it must not depend on the parts.
#[test]
fn parts_spend_one_budget_of_ear_clipping() {
    let corners = 5000;
    let mut text = String::new();
    for i in 0..corners {
        let (angle, radius) = (i as f32 * std::f32::consts::TAU / corners as f32, 1.0 + (i % 2) as f32);
        writeln!(text, "v {} {} 0", radius * angle.cos(), radius * angle.sin()).unwrap();
    }
    let polygon: String = (1..=corners).fold("f".to_owned(), |face, i| face + &format!(" {i}")) + "\n";
    let polygons = 2 * (MAX_PAIRS / (corners * corners) as u64) as usize;
    text.push_str(&polygon.repeat(polygons));
    let scene = same_scene(text.as_bytes());
    assert_eq!(scene.triangles.len(), polygons * (corners - 2));
    let expected = format!("split as if convex, perhaps wrongly: {}", polygons / 2);
    assert!(scene.warnings[0].contains(&expected), "{:?}", scene.warnings);
}

/// `tobj` reads a text of absolute indices in which every corner has all three.
#[test]
fn scenes_are_those_of_tobj() {
    let random = &mut Random::new(1);
    let mut text = String::new();
    const COUNT: usize = 500;
    for _ in 0..COUNT {
        let mut number = || format!("{}.{}e{}", random.below(100), random.below(1_000_000_000), random.below(9));
        let [x, y, z, u, v] = [(); 5].map(|()| number());
        writeln!(text, "v {x} -{y} {z}\nvt {u} {v}\nvn {z} {x} -{y}").unwrap();
    }
    for face in 0..3 * COUNT {
        let [a, b, c] = [(); 3].map(|()| [(); 3].map(|()| (random.below(COUNT) + 1).to_string()).join("/"));
        writeln!(text, "f {a} {b} {c}\n{}", if face % 100 == 0 { "g" } else { "" }).unwrap();
    }
    let scene = same_scene(text.as_bytes());
    let options = tobj::LoadOptions::default();
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Err(tobj::LoadError::ReadError)).unwrap();
    let mut triangles = scene.triangles.iter();
    for mesh in models.iter().map(|model| &model.mesh) {
        for corners in (0..mesh.indices.len()).step_by(3) {
            let triangle = triangles.next().unwrap();
            for corner in 0..3 {
                let at = |indices: &[u32]| indices[corners + corner] as usize;
                let (p, n, t) = (at(&mesh.indices), at(&mesh.normal_indices), at(&mesh.texcoord_indices));
                let index = |indices: [u32; 3]| indices[corner] as usize;
                assert_eq!(scene.positions[index(triangle.positions)].to_array(), mesh.positions[3 * p..][..3]);
                assert_eq!(scene.normals[index(triangle.normals)].to_array(), mesh.normals[3 * n..][..3]);
                assert_eq!(scene.uvs[index(triangle.uvs)].to_array(), mesh.texcoords[2 * t..][..2]);
            }
        }
    }
    assert!(triangles.next().is_none() && scene.triangles.len() == 3 * COUNT);
    assert!(scene.triangles.iter().all(|t| !t.normals.contains(&NO_INDEX)));
}
