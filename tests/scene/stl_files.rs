//! STL files: text and binary as real writers make them, hostile files, and real models.

use crate::common::models::{assert_consistent, assert_warned, check_malformed, damage, shared_scenes, total_area};
use raybrook::low_level::scene::{NO_INDEX, Scene, load};

/// Writes `bytes` as an STL file into a fresh folder and loads it.
fn load_bytes(bytes: &[u8]) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.STL");
    std::fs::write(&path, bytes).unwrap();
    load(path)
}

/// What a warning says of attribute bytes.
const ATTRIBUTES: &str = "attributes of facets, which may be colours";

type Corners = [[f32; 3]; 3];

/// Two triangles of a unit square, wound the same way.
const SQUARE: [Corners; 2] = [[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]];

/// A binary file: `header` filled up with blanks, and a normal and attribute bytes that mean nothing.
fn binary(header: &str, triangles: &[Corners]) -> Vec<u8> {
    let mut file = format!("{header:<80}").into_bytes();
    file.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        let numbers = [f32::NAN, -1.0, 1e30].into_iter().chain(triangle.iter().flatten().copied());
        file.extend(numbers.flat_map(f32::to_le_bytes));
        file.extend([0xab, 0xcd]);
    }
    file
}

fn facet(triangle: Corners) -> String {
    let vertices = triangle.map(|[x, y, z]| format!("      vertex {x} {y} {z}\n")).concat();
    format!("  facet normal 0 0 -1\n    outer loop\n{vertices}    endloop\n  endfacet\n")
}

fn text(triangles: &[Corners]) -> String {
    format!("solid square\n{}endsolid square\n", triangles.iter().map(|&t| facet(t)).collect::<String>())
}

fn assert_square(scene: &Scene, name: &str) {
    assert_consistent(scene, name);
    let warnings = scene.warnings.iter().filter(|warning| !warning.contains(ATTRIBUTES)).count();
    assert_eq!((scene.triangles.len(), warnings), (2, 0), "{name}");
    assert_eq!(scene.positions.len(), 4, "{name}: corners at one place are one vertex");
    assert_eq!(scene.triangles[0].positions, [0, 1, 2], "{name}");
    assert_eq!(scene.triangles[1].positions, [0, 2, 3], "{name}");
    for (triangle, corners) in SQUARE.iter().enumerate() {
        assert_eq!(scene.vertices(triangle).map(|p| p.to_array()), *corners, "{name}");
        // The order of the corners counts, and no normal is read, here all of them wrong.
        assert_eq!(scene.triangles[triangle].normals, [NO_INDEX; 3], "{name}");
    }
}

#[test]
fn binary_files_are_told_by_their_size() {
    for header in ["", "made by a test", "solid", "solid square", "solid\nfacet normal 0 0 1", "SOLID \n\n\n", "\u{0}"]
    {
        let scene = load_bytes(&binary(header, &SQUARE)).unwrap();
        assert_square(&scene, header);
        assert_warned(&scene, &format!("a.STL: {ATTRIBUTES}, not used: 2, the first of facet 0"));
    }
}

#[test]
fn text_files_of_every_writer_are_read() {
    let plain = text(&SQUARE);
    let two_solids = format!("{}{}", text(&SQUARE[..1]), text(&SQUARE[1..]));
    for (what, file) in [
        ("as specified", plain.clone().into_bytes()),
        ("without a name", plain.replace(" square", "").into_bytes()),
        ("a tab before the name", plain.replace("solid square", "solid\tsquare").into_bytes()),
        ("upper case", plain.to_uppercase().into_bytes()),
        ("Windows line ends", plain.replace('\n', "\r\n").into_bytes()),
        ("old Mac line ends", plain.replace('\n', "\r").into_bytes()),
        ("no line end at the end", plain.trim_end().to_owned().into_bytes()),
        ("empty lines", plain.replace('\n', "\n\n \t\n").into_bytes()),
        ("empty lines first", format!("\n \n{plain}").into_bytes()),
        (
            "end in two words",
            plain.replace("endl", "end l").replace("endf", "end f").replace("ends", "end s").into_bytes(),
        ),
        ("exponents", plain.replace("vertex 1 ", "vertex +1.0E+00 ").into_bytes()),
        ("normals that are no numbers", plain.replace("0 0 -1", "-nan(ind) nan 1e999").into_bytes()),
        ("two solids", two_solids.into_bytes()),
        ("a name that is not UTF-8", [b"solid caf\xe9", &plain.as_bytes()[5..]].concat()),
    ] {
        assert_square(&load_bytes(&file).unwrap_or_else(|e| panic!("{what}: {e}")), what);
    }
}

#[test]
fn only_equal_corners_become_one() {
    // -0 equals 0; the next float to 1 is another place; NaN is no place.
    let near = f32::from_bits(1.0f32.to_bits() + 1);
    let triangles = [
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]],
        [[-0., 0., -0.], [near, 0., 0.], [0., 1., -0.]],
        [[f32::NAN, 0., 0.], [1., 0., 0.], [0., 1., 0.]],
    ];
    let scene = load_bytes(&binary("", &triangles)).unwrap();
    let positions: Vec<_> = scene.triangles.iter().map(|t| t.positions).collect();
    assert_eq!(positions, [[0, 1, 2], [0, 3, 2], [4, 1, 2]]);
    assert_eq!(scene.hittable(), [0, 1]);
    assert_warned(&scene, "a.STL: triangles with NaN or infinite vertices left out: 1, the first is number 2");
}

#[test]
fn messages_name_the_place() {
    let plain = text(&SQUARE);
    let whole = binary("", &SQUARE);
    let more = [&whole[..], &[0; 50]].concat();
    let solid = binary("solid", &SQUARE);
    for (file, part) in [
        (b"".to_vec(), "a.STL: is not an STL file"),
        (whole[..83].to_vec(), "a.STL: is not an STL file"),
        (whole[..84].to_vec(), "should have 184 bytes for the 2 triangles that it promises, but has 84"),
        (whole[..183].to_vec(), "but has 183"),
        (solid[..183].to_vec(), "should have 184 bytes"),
        (more, "but has 234"),
        (binary("", &[]), "a.STL: has no triangles"),
        (b"solid a\nendsolid a\n".to_vec(), "a.STL: has no triangles"),
        (b"\x89PNG\r\n\x1a\n\0\0\0".to_vec(), "is not an STL file"),
        (b"solid".to_vec(), "is cut short"),
        (plain.replace("endsolid square\n", "").into_bytes(), "a.STL: facet 2: the file is cut short"),
        (
            plain[..plain.len() - 40].to_owned().into_bytes(),
            "a.STL:9: facet 1, which begins here: the file is cut short",
        ),
        (
            plain.replace("vertex 0 1 0", "vertex 0 1").into_bytes(),
            "a.STL:9: facet 1, which begins here: vertex f32 f32 f32",
        ),
        (plain.replace("vertex 0 1 0", "vertex 0 1 x").into_bytes(), "a.STL:9: facet 1"),
        (plain.replace("vertex 0 1 0", "vertex 0 1 1e39").into_bytes(), "a.STL:9: facet 1"),
        (plain.replace("vertex 0 1 0", "vertex 0,5 1 0").into_bytes(), "a.STL:9: facet 1"),
        (plain.replace("outer loop", "inner loop").into_bytes(), "a.STL:2: facet 0"),
        (plain.replace("endfacet\nendsolid", "endfacet\nrubbish\nendsolid").into_bytes(), "a.STL:16: facet 2"),
        (plain.replace("vertex 0 1 0\n", "vertex 0 1 0\nvertex 0 0 1\n").into_bytes(), "a.STL:9: facet 1"),
    ] {
        let error = load_bytes(&file).expect_err(part);
        assert!(error.to_string().contains(part), "{part:?}: {error}");
        assert_eq!(error.exit_code(), 3, "{part:?}");
    }
}

#[test]
fn damaged_files_never_panic() {
    damage("stl", text(&SQUARE).as_bytes());
    damage("stl", &binary("solid", &SQUARE));
}

#[test]
fn every_malformed_file_behaves_as_listed() {
    let Some(table) = shared_scenes("malformed/expected.tsv") else { return };
    let checked = check_malformed(&table, ".stl");
    assert!(checked >= 6, "{checked} rows");
}

#[test]
fn real_models_have_their_triangles() {
    for (name, triangles, without_area) in [
        ("stl/3DSMaxExport.STL", 2000, 0),
        ("stl/Spider_ascii.stl", 1368, 56),
        ("stl/Spider_binary.stl", 1368, 56),
        ("stl/featuretype.STL", 3476, 0),
        ("stl/sphereWithHole.stl", 285, 0),
        ("stl/triangle_with_two_solids.stl", 2, 0),
    ] {
        let Some(path) = shared_scenes(name) else { continue };
        let scene = load(path).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_consistent(&scene, name);
        assert_eq!((scene.triangles.len(), scene.hittable().len()), (triangles, triangles - without_area), "{name}");
        assert_eq!(scene.warnings.len(), usize::from(without_area > 0), "{name}: {:?}", scene.warnings);
        assert!(scene.positions.len() < 3 * triangles || triangles == 2, "{name}: no corner is shared");
    }
}

#[test]
fn text_and_binary_of_a_model_are_alike() {
    let (Some(text), Some(binary)) = (shared_scenes("stl/Spider_ascii.stl"), shared_scenes("stl/Spider_binary.stl"))
    else {
        return;
    };
    let (text, binary) = (load(text).unwrap(), load(binary).unwrap());
    let (text_area, binary_area) = (total_area(&text), total_area(&binary));
    // The text has six digits.
    assert!((text_area / binary_area - 1.0).abs() < 1e-5, "{text_area} {binary_area}");
}
