//! OFF files: as Geomview defines them and as others write them, hostile files, and a real model.

use crate::common::models::{assert_consistent, assert_warned, damage};
use crate::common::shared;
use glam::{Vec2, Vec3};
use raybrook::low_level::scene::{Scene, load};

fn load_text(name: &str, text: &str) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    load(path)
}

#[track_caller]
fn off(text: &str) -> Scene {
    let scene = load_text("a.OFF", text).unwrap();
    assert_consistent(&scene, "a.OFF");
    scene
}

fn vertices(scene: &Scene) -> Vec<[Vec3; 3]> {
    (0..scene.triangle_count()).map(|i| scene.vertices(i)).collect()
}

/// A square of two triangles, and one of a quadrilateral.
const BODY: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3\n3 0 2 3\n";

#[test]
fn triangles_are_those_of_an_obj() {
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 2 3 4\nf 1 3 4\n";
    let expected = vertices(&load_text("a.obj", obj).unwrap());
    for head in
        ["OFF\n4 3 0\n", "OFF 4 3 0\n", "OFF4 3 0\n", "4 3 0\n", "# c\r\nOFF # d\r\n\r\n4 3\r\n", "off\n4\n3 9\n"]
    {
        let scene = off(&(head.to_owned() + BODY));
        assert_eq!(vertices(&scene), expected, "{head:?}");
        assert!(scene.warnings.is_empty(), "{head:?}: {:?}", scene.warnings);
        assert_eq!((scene.materials.len(), scene.up), (1, None));
    }
}

#[test]
fn vertices_have_what_the_first_word_says() {
    let scene = off("STCNOFF\n3 1 0\n0 0 0  0 0 1  255 0 0 255  0 0\n1 0 0  0 0 1  255 0 0 255  1 0\n\
         0 1 0  0 0 1  255 0 0 255  0 1\n3 0 1 2\n");
    assert_eq!((scene.normals.len(), scene.uvs[1], scene.uvs[2]), (3, Vec2::X, Vec2::Y));
    assert_eq!((&scene.materials[0].name[..], scene.materials[0].diffuse), ("#ff0000", Vec3::X));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let corners = "COFF\n3 1 0\n0 0 0 1.0 0 0 1\n1 0 0 0 1 0 1\n0 1 0 0 0 1 0.5\n3 0 1 2\n";
    let scene = off(corners);
    assert_eq!(scene.materials[0].name, "#555555");
    assert_warned(&scene, "each triangle has the mean colour of its corners");
    assert_warned(&scene, "not used: transparency of colours (1)");
    assert_warned(
        &off(&corners.replace("COFF", "OFF")),
        "numbers beside vertices, of which the first word says nothing, not used: 3",
    );
    let scene = off(&corners.replace(" 1.0 0 0 1", " 1.0 0"));
    assert_warned(&scene, ":3: vertices without the colour that the first word promises: 1");
    assert_eq!(scene.materials[0].name, "");
}

#[test]
fn faces_may_have_colours() {
    let body = "4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3 0 255 0 128\n3 0 1 3\n";
    let scene = off(&("OFF\n".to_owned() + body));
    let of = |triangle: usize| &scene.materials[scene.triangles[triangle].material as usize].name[..];
    assert_eq!([of(0), of(1), of(2)], ["#ff0000", "#00ff00", ""]);
    assert_warned(&scene, "not used: transparency of colours (1)");
    let floats = off(&("OFF\n".to_owned() + &body.replace("255 0 0\n", "1 0 0\n").replace("0 255 0 128", "0 1 0 1")));
    assert_eq!(floats.materials[0].name, "#ff0000");
    let table = off(&("OFF\n".to_owned() + &body.replace("3 0 1 3", "3 0 1 3 7")));
    assert_warned(&table, ":9: colours of faces by their number in a table not used: 1");
}

#[test]
fn what_is_left_out_is_told() {
    let scene = off("OFF\n3 3 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n2 0 1\n3 0 0 1\nand more\n");
    assert_eq!((scene.triangle_count(), scene.hittable().len()), (2, 1));
    assert_warned(&scene, ":7: faces with fewer than three corners ignored: 1");
    assert_warned(&scene, "triangles without area left out: 1");
    assert_warned(&scene, ":9: has more than its first lines promise");
}

#[test]
fn wrong_files_are_refused_with_what_is_wrong() {
    for (text, part) in [
        ("", "a.OFF: is empty"),
        ("ply\n", "a.OFF:1: is not an OFF file"),
        ("OFF BINARY\n\u{1}", "a.OFF:1: is a binary OFF file"),
        ("4OFF\n1 1 1\n", "three dimensions"),
        ("nOFF\n4 1 1 1\n", "three dimensions"),
        ("OFF\n3 0 0\n", "a.OFF: has no faces"),
        ("OFF\n3 x 0\n", "a.OFF:2: the number of faces should be a whole number, not 'x'"),
        ("OFF\n-3 1 0\n", "a.OFF:2: the number of vertices should be a whole number"),
        ("OFF\n4000000000 4000000000 0\n0 0 0\n", "vertex 1 of 4000000000"),
        ("OFF\n99999999999 1 0\n", "more than 32-bit indices"),
        ("OFF\n1 1 0\n0 0 a\n", "a.OFF:3: vertex 0 of 1 (counted from 0) should be a number, not 'a'"),
        ("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "a.OFF:4: face 0 of 1 (counted from 0) names vertex 1, but there are 1"),
        ("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", "a corner of face 0"),
        ("OFF\n1 1 0\n0 0 0\n4294967295\n", "4294967295 corners"),
        ("OFF\n1 1 0\n0 0 0\n2 0 0\n", "no face of three or more corners"),
        ("OFF\n1 2 0\n0 0 0\n3 0 0 0\n", "the file ends where face 1 of 2"),
        ("STOFF\n1 1 0\n0 0 0 1\n3 0 0 0\n", "a.OFF:3: vertex 0 of 1 (counted from 0) has no texture coordinates"),
    ] {
        let error = load_text("a.OFF", text).unwrap_err();
        assert_eq!(error.exit_code(), 3);
        assert!(error.to_string().contains(part), "{error}, not {part}");
    }
}

#[test]
fn damaged_files_never_panic() {
    damage(
        "off",
        b"STCNOFF\n3 2 0\n0 0 0 0 0 1 255 0 0 0 0\n1 0 0 0 0 1 255 0 0 1 0\n0 1 0 0 0 1 9 9 9 0 1\n3 0 1 2\n\
                    4 0 1 2 0 1 0 0\n",
    );
}

#[test]
fn a_real_model() {
    let Some(path) = shared("trimesh-models/ballA.off") else { return };
    let scene = load(path).unwrap();
    assert_eq!((scene.positions.len(), scene.triangle_count(), scene.hittable().len()), (1900, 3796, 3796));
    assert!(scene.warnings.is_empty());
}
