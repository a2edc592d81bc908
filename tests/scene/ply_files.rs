//! PLY files: every encoding and number type, the quirks of real writers, colours and textures, and real models.

use crate::common::models::{assert_consistent, assert_warned, shared_scenes, total_area};
use crate::common::ply::{CORNERS, FORMATS, RGB, Row, XYZ, encode, load_bytes, square, text};
use raybrook::low_level::scene::{NO_INDEX, Scene, load};
use std::path::Path;

#[test]
fn every_encoding_and_number_type_gives_the_same_mesh() {
    let positions = [[0.0, 0.0, 3.0], [100.0, 0.0, 4.0], [100.0, 50.0, 5.0], [0.0, 50.0, 6.0], [7.0, 8.0, 9.0]];
    let faces: [&[f64]; 2] = [&[0.0, 1.0, 2.0, 3.0], &[4.0, 2.0, 1.0]];
    let integers =
        ["char", "int8", "uchar", "uint8", "short", "int16", "ushort", "uint16", "int", "int32", "uint", "uint32"];
    let numbers = [&integers[..], &["float", "float32", "double", "float64"]].concat();
    let mut checked = 0;
    for format in FORMATS {
        for (i, &kind) in numbers.iter().enumerate() {
            let (count, index) = (integers[i % integers.len()], integers[(i + 5) % integers.len()]);
            let vertex = format!("element vertex 5\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z");
            let header = format!("{vertex}\nelement face 2\nproperty list {count} {index} vertex_index");
            let mut rows: Vec<Row> = positions.iter().map(|p| p.map(|x| (kind, x)).to_vec()).collect();
            for face in faces {
                let corners = face.iter().map(|&corner| (index, corner));
                rows.push(std::iter::once((count, face.len() as f64)).chain(corners).collect());
            }
            let name = format!("{format}, {kind}, list {count} {index}");
            let scene = load_bytes(&encode(format, &header, &rows)).unwrap_or_else(|e| panic!("{name}: {e}"));
            let read: Vec<_> = scene.positions.iter().map(|p| p.to_array().map(f64::from)).collect();
            assert_eq!(read, positions, "{name}");
            let triangles: Vec<_> = scene.triangles.iter().map(|t| t.positions).collect();
            assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [4, 2, 1]], "{name}");
            assert_eq!((scene.materials.len(), &scene.warnings[..]), (1, &[][..]), "{name}");
            assert_consistent(&scene, &name);
            checked += 1;
        }
    }
    assert_eq!(checked, 48);
}

#[test]
fn double_positions_are_rounded_once_and_those_out_of_range_are_left_out() {
    let rows = [[0.1, 0.0, 0.0], [1.0, 1e39, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 0.0]];
    let header = "element vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                  element face 2\nproperty list uchar uchar vertex_indices";
    let mut rows: Vec<Row> = rows.iter().map(|p| p.map(|x| ("double", x)).to_vec()).collect();
    rows.push([3.0, 0.0, 1.0, 2.0].map(|x| ("uchar", x)).to_vec());
    rows.push([3.0, 0.0, 2.0, 3.0].map(|x| ("uchar", x)).to_vec());
    for format in FORMATS {
        let scene = load_bytes(&encode(format, header, &rows)).unwrap();
        assert_eq!(scene.positions[0].x, 0.1, "{format}");
        assert_eq!(scene.hittable(), [1], "{format}");
        assert_warned(&scene, "triangles with NaN or infinite vertices left out: 1, the first is number 0");
    }
}

#[test]
fn polygons_are_split_and_short_ones_left_out() {
    let arrow = text(
        &["element vertex 4", XYZ, "element face 4", CORNERS],
        "0 1 0\n-1 -1 0\n0 0 0\n1 -1 0\n2 0 1\n4 1 2 3 0\n0\n1 2\n",
    );
    let scene = load_bytes(arrow.as_bytes()).unwrap();
    assert_eq!(scene.triangles.len(), 2);
    assert!((total_area(&scene) - 1.0).abs() < 1e-12, "the notch is not covered");
    assert_warned(&scene, "a.ply: faces with fewer than three corners ignored: 3, the first is of face 0");
    assert_eq!(scene.warnings.len(), 1);
}

#[test]
fn normals_belong_to_vertices_and_bad_ones_to_nobody() {
    let normals = ["0 0 1", "nan 0 1", "0 2 0", "0 0 0"];
    let lines = "property float nx\nproperty float ny\nproperty float nz";
    let scene = load_bytes(square(lines, normals, "", &["4 0 1 2 3"]).as_bytes()).unwrap();
    assert_eq!(scene.triangles[0].normals, [0, NO_INDEX, 2]);
    assert_eq!(scene.triangles[1].normals, [0, 2, 3]);
    assert_eq!(scene.normals[2].to_array(), [0.0, 2.0, 0.0]);
    assert_consistent(&scene, "normals");
    // Two of the three are no normal.
    let lines = "property float nx\nproperty float ny";
    let scene = load_bytes(square(lines, ["0 0"; 4], "", &["4 0 1 2 3"]).as_bytes()).unwrap();
    assert_eq!(scene.triangles[0].normals, [NO_INDEX; 3]);
    assert_warned(&scene, "not used: vertex 'nx', vertex 'ny'");
}

#[test]
fn texture_coordinates_have_many_names() {
    let uvs = ["0 0", "1 0", "1 1", "nan 1"];
    for [u, v] in [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]] {
        let lines = format!("property float {u}\nproperty float {v}");
        let scene = load_bytes(square(&lines, uvs, "", &["4 0 1 2 3"]).as_bytes()).unwrap();
        assert_eq!(scene.triangles[0].uvs, [0, 1, 2], "{u}");
        assert_eq!(scene.triangles[1].uvs, [0, 2, NO_INDEX], "{u}");
        assert_eq!(scene.uvs[2].to_array(), [1.0, 1.0], "{u}");
        assert_eq!(scene.warnings, [] as [&str; 0]);
    }
}

#[test]
fn faces_can_have_texture_coordinates_of_their_own() {
    let faces = ["3 0 1 2 6 0.1 0.2 0.3 0.4 0.5 0.6", "3 0 2 3 0", "3 1 2 3 2 0 0", "4 0 1 2 3 8 1 2 3 4 5 6 7 8"];
    let lines = "property list uchar float texcoord";
    let scene = load_bytes(square("", [""; 4], lines, &faces).as_bytes()).unwrap();
    assert_eq!(scene.triangles[0].uvs.map(|i| scene.uvs[i as usize].to_array()), [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]);
    assert_eq!((scene.triangles[1].uvs, scene.triangles[2].uvs), ([NO_INDEX; 3], [NO_INDEX; 3]));
    assert_eq!(scene.triangles[4].uvs.map(|i| scene.uvs[i as usize].x), [1.0, 5.0, 7.0]);
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert_warned(
        &scene,
        "lists 'texcoord' that do not have two numbers for each corner ignored: 1, the first is of face 2",
    );
}

/// The names of the triangles' materials, and whether their colours are what the names say.
fn colours(scene: &Scene) -> Vec<&str> {
    assert_consistent(scene, "colours");
    scene.triangles.iter().map(|t| scene.materials[t.material as usize].name.as_str()).collect()
}

#[test]
fn colours_become_materials() {
    // Of faces: exact, and one material for each colour.
    let faces = ["3 0 1 2 255 0 0", "3 0 2 3 0 128 0", "3 1 2 3 255 0 0"];
    let scene = load_bytes(square("", [""; 4], RGB, &faces).as_bytes()).unwrap();
    assert_eq!(colours(&scene), ["#ff0000", "#008000", "#ff0000"]);
    assert_eq!((scene.materials.len(), &scene.warnings[..]), (2, &[][..]));
    let green = &scene.materials[1];
    assert!((green.diffuse.y - 0.215_860_5).abs() < 1e-6, "sRGB 128 is linear 0.216, not {}", green.diffuse.y);
    assert_eq!((green.ambient, green.diffuse.x), (green.diffuse, 0.0));

    // Of vertices: the mean of the corners, which is worth a warning where they differ.
    let vertices = ["0 0 0", "30 60 90", "60 3 255", "0 0 0"];
    let scene = load_bytes(square(RGB, vertices, "", &["3 0 1 2", "3 0 3 0"]).as_bytes()).unwrap();
    assert_eq!(colours(&scene), ["#1e1573", "#000000"]);
    assert_warned(&scene, "each triangle has the mean colour of its corners");
    let scene = load_bytes(square(RGB, ["9 8 7"; 4], "", &["4 0 1 2 3"]).as_bytes()).unwrap();
    assert_eq!((colours(&scene), scene.materials.len()), (vec!["#090807"; 2], 1));
    assert_eq!(scene.warnings, [] as [&str; 0]);

    // Of both: those of vertices, as most viewers do, and the others are told.
    let scene = load_bytes(square(RGB, ["9 8 7"; 4], RGB, &["4 0 1 2 3 1 2 3"]).as_bytes()).unwrap();
    assert_eq!(colours(&scene), ["#090807"; 2]);
    assert_warned(&scene, "not used: face 'red', face 'green', face 'blue'");
}

#[test]
fn colours_have_a_range_for_each_number_type() {
    for (kind, value) in
        [("uchar", "255 51 0"), ("float", "1 0.2 -1"), ("double", "7 0.2 nan"), ("ushort", "65535 13107 0")]
    {
        for [r, g, b] in [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]] {
            let lines = format!("property {kind} {r}\nproperty {kind} {g}\nproperty {kind} {b}\nproperty {kind} alpha");
            let row = format!("{value} 1");
            let scene = load_bytes(square(&lines, [&row; 4], "", &["4 0 1 2 3"]).as_bytes()).unwrap();
            assert_eq!(colours(&scene), ["#ff3300"; 2], "{kind} {r}");
            assert_eq!(scene.warnings.len(), 1);
            assert_warned(&scene, "a.ply: not used: vertex 'alpha'");
        }
    }
}

#[test]
fn very_many_colours_are_rounded_with_one_warning() {
    let face = |i: usize| format!("3 0 1 2 {} {} {}", i % 256, i / 256 % 256, 255);
    for (count, materials) in [(4096, 4096), (4097, 16 * 2), (65_536, 16 * 16)] {
        let faces: Vec<String> = (0..count).map(face).collect();
        let faces: Vec<&str> = faces.iter().map(String::as_str).collect();
        let scene = load_bytes(square("", [""; 4], RGB, &faces).as_bytes()).unwrap();
        assert_eq!((scene.triangles.len(), scene.materials.len()), (count, materials));
        let warnings = usize::from(count > 4096);
        assert_eq!(scene.warnings.len(), warnings, "{:?}", scene.warnings);
        if count > 4096 {
            assert_warned(&scene, "red, green and blue are rounded to 16 values each");
        }
        // At most half a step of 17 away.
        for (i, name) in colours(&scene).into_iter().enumerate() {
            let code = usize::from_str_radix(&name[1..], 16).unwrap();
            let most = if count > 4096 { 8 } else { 0 };
            assert!(
                (code >> 16).abs_diff(i % 256) <= most && (code >> 8 & 255).abs_diff(i / 256 % 256) <= most,
                "{name}"
            );
        }
    }
}

/// A picture of one colour.
fn write_png(path: &Path) {
    image::RgbImage::from_pixel(2, 2, image::Rgb([9, 9, 9])).save(path).unwrap();
}

#[test]
fn textures_are_named_in_comments_and_chosen_by_faces() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("inside");
    std::fs::create_dir(&inside).unwrap();
    write_png(&inside.join("one blue.png"));
    write_png(&inside.join("two.png"));
    write_png(&folder.path().join("secret.png"));
    let names = ["one blue.png", "two.png", "./two.png", "none.png", "../secret.png"];
    let comments: Vec<String> = names.iter().map(|n| format!("comment TextureFile {n}")).collect();
    let uv = "property float s\nproperty float t";
    let faces = [
        "3 0 1 2 0 1 2 3",
        "3 0 1 2 1 1 2 3",
        "3 0 1 2 2 1 2 3",
        "3 0 1 2 3 1 2 3",
        "3 0 1 2 4 1 2 3",
        "3 0 1 2 -1 1 2 3",
    ];
    let file = square(uv, ["0 0"; 4], &format!("property int texnumber\n{RGB}"), &faces);
    let path = inside.join("a.ply");
    std::fs::write(&path, file.replace("element vertex", &format!("{}\nelement vertex", comments.join("\n")))).unwrap();
    let scene = load(&path).unwrap();
    // A texture alone counts where it is; elsewhere the colour.
    assert_eq!(colours(&scene), ["one blue.png", "two.png", "two.png", "#010203", "#010203", "#010203"]);
    let textures: Vec<_> =
        scene.triangles.iter().map(|t| scene.materials[t.material as usize].diffuse_texture).collect();
    assert_eq!(textures, [Some(0), Some(1), Some(1), None, None, None]);
    assert_eq!((scene.textures.len(), scene.materials[0].diffuse.to_array()), (2, [1.0; 3]));
    assert_warned(&scene, "texture 'none.png' cannot be opened");
    assert_warned(&scene, "texture '../secret.png' lies outside the scene's folder");

    // Without a number the first one; without texture coordinates none is opened.
    let file = square(uv, ["0 0"; 4], "", &["4 0 1 2 3"]);
    std::fs::write(&path, file.replace("element vertex", "comment TextureFile two.png\nelement vertex")).unwrap();
    assert_eq!(colours(&load(&path).unwrap()), ["two.png"; 2]);
    let file = square("", [""; 4], "", &["4 0 1 2 3"]);
    std::fs::write(&path, file.replace("element vertex", "comment TextureFile none.png\nelement vertex")).unwrap();
    let scene = load(&path).unwrap();
    assert_eq!(scene.warnings.len(), 1);
    assert_warned(&scene, "not used: textures, for which there are no coordinates");
}

#[test]
fn headers_of_every_writer_are_read() {
    let plain = square("", [""; 4], "", &["4 0 1 2 3"]);
    for (what, file) in [
        ("Windows line ends", plain.replace('\n', "\r\n").into_bytes()),
        ("old Mac line ends", plain.replace('\n', "\r").into_bytes()),
        ("no line end at the end", plain.trim_end().to_owned().into_bytes()),
        ("empty lines between rows", plain.replace("1 0 0 \n", "\n1 0 0\n \n").into_bytes()),
        ("blanks around numbers", plain.replace("1 0 0", "\t1  0   0  ").into_bytes()),
        ("other forms of numbers", plain.replace("1 0 0", "+1. .0 0e5").into_bytes()),
        ("comments", plain.replace("element", "comment end_header\nobj_info\nelement").into_bytes()),
        ("a header that is not UTF-8", {
            let (start, end) = plain.split_once("element").unwrap();
            [start.as_bytes(), b"comment caf\xe9\nelement", end.as_bytes()].concat()
        }),
    ] {
        let scene = load_bytes(&file).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!((scene.triangles.len(), &scene.warnings[..]), (2, &[][..]), "{what}");
        assert!((total_area(&scene) - 1.0).abs() < 1e-12, "{what}");
    }
    // Binary data may begin with any byte, a line feed too.
    let header = format!("element vertex 4\n{XYZ}\nelement face 1\n{CORNERS}");
    let mut rows =
        vec![vec![("uchar", 10.0), ("uchar", 0.0), ("uchar", 0.0), ("uchar", 0.0), ("float", 0.0), ("float", 0.0)]];
    rows.extend([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(|p| p.map(|x| ("float", x)).to_vec()));
    rows.push(vec![("uchar", 4.0), ("int", 0.0), ("int", 1.0), ("int", 2.0), ("int", 3.0)]);
    let file = encode("binary_little_endian", &header, &rows);
    let data = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    for line_end in ["\n", "\r\n"] {
        let header = String::from_utf8(file[..data].to_vec()).unwrap().replace('\n', line_end);
        let scene = load_bytes(&[header.as_bytes(), &file[data..]].concat()).unwrap();
        assert_eq!(scene.positions[0].x.to_bits(), 10, "{line_end:?}");
    }
}

#[test]
fn elements_and_properties_that_are_not_known_are_read_over() {
    let odd = "element odd 2\nproperty list uchar float values\nproperty double d";
    let empty = "element empty 4000000000";
    let vertex =
        format!("element vertex 3\nproperty char flag\n{XYZ}\nproperty list uchar short list\nproperty float x");
    let face = format!("element face 1\nproperty list uchar uint other\n{CORNERS}\nproperty float quality");
    let header = [odd, &vertex, empty, odd, &face, odd].join("\n");
    let odd_rows = || {
        vec![
            vec![("uchar", 2.0), ("float", 1.0), ("float", 2.0), ("double", 3.0)],
            vec![("uchar", 0.0), ("double", 3.0)],
        ]
    };
    let mut rows: Vec<Row> = odd_rows();
    for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
        let list = [("uchar", 1.0), ("short", 7.0), ("float", 99.0)];
        rows.push([vec![("char", 1.0), ("float", x), ("float", y), ("float", 0.0)], list.to_vec()].concat());
    }
    rows.extend(odd_rows());
    let corners = [3.0, 0.0, 1.0, 2.0].map(|i| (if i == 3.0 { "uchar" } else { "int" }, i));
    rows.push([vec![("uchar", 1.0), ("uint", 5.0)], corners.to_vec(), vec![("float", 0.5)]].concat());
    rows.extend(odd_rows());
    for format in FORMATS {
        let scene = load_bytes(&encode(format, &header, &rows)).unwrap_or_else(|e| panic!("{format}: {e}"));
        assert_eq!(scene.vertices(0).map(|p| p.to_array()), [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], "{format}");
        assert_eq!(scene.warnings.len(), 1, "{format}: {:?}", scene.warnings);
        for name in ["element 'odd'", "vertex 'flag'", "vertex 'list'", "vertex 'x'", "face 'other'", "face 'quality'"]
        {
            assert_warned(&scene, name);
        }
    }
}

#[test]
fn faces_can_come_before_their_vertices() {
    let header = format!("element face 2\n{CORNERS}\nelement edge 1\nproperty int v\nelement vertex 4\n{XYZ}");
    let corners = |numbers: &[i32]| {
        let numbers = numbers.iter().map(|&i| ("int", f64::from(i)));
        std::iter::once(("uchar", numbers.len() as f64)).chain(numbers).collect::<Row>()
    };
    let mut rows = vec![corners(&[1, 2, 3, 0]), corners(&[0, 1, 2]), vec![("int", 5.0)]];
    rows.extend(
        [[0.0, 1.0], [-1.0, -1.0], [0.0, 0.0], [1.0, -1.0]].map(|[x, y]| [x, y, 0.0].map(|x| ("float", x)).to_vec()),
    );
    for format in FORMATS {
        let scene = load_bytes(&encode(format, &header, &rows)).unwrap_or_else(|e| panic!("{format}: {e}"));
        assert_eq!((scene.triangles.len(), scene.positions.len()), (3, 4), "{format}");
        assert!((total_area(&scene) - 1.5).abs() < 1e-12, "{format}: the concave one is split by its positions");
        assert_warned(&scene, "not used: element 'edge'");
    }
}

#[test]
fn lines_are_rows() {
    // MeshLab writes more numbers than its header says.
    let file = square("", ["9 9", "", "", ""], "", &["3 0 1 2 7 7 7", "3 0 2 3"]);
    let scene = load_bytes(file.as_bytes()).unwrap();
    assert!((total_area(&scene) - 1.0).abs() < 1e-12);
    assert_eq!(scene.warnings.len(), 1);
    assert_warned(&scene, "a.ply: has lines with more values than the header promises");
    // A line with fewer does not borrow from the next.
    let file = square("", [""; 4], "", &["3 0 1", "3 0 2 3"]);
    let message = load_bytes(file.as_bytes()).unwrap_err().to_string();
    assert!(message.contains("a.ply:14: face 0 has fewer values than the header promises: '3 0 1'"), "{message}");
}

#[test]
fn data_after_the_last_row_are_told() {
    let file = square("", [""; 4], "", &["3 0 1 2", "3 0 2 3"]).replace("face 2", "face 1");
    let scene = load_bytes(file.as_bytes()).unwrap();
    assert_eq!(scene.triangles.len(), 1);
    assert_warned(&scene, "a.ply: has more data than its header promises");
    let scene = load_bytes(square("", [""; 4], "", &["3 0 1 2\n \n\n"]).as_bytes()).unwrap();
    assert_eq!(scene.warnings, [] as [&str; 0]);
}

#[test]
fn real_models_have_their_triangles() {
    for (name, triangles, materials) in [
        ("bunny/bunny-948.ply", 948, 1),
        ("bunny/bunny-3851.ply", 3851, 1),
        ("bunny/bunny-16301.ply", 16_301, 1),
        ("bunny/bunny-closed-948.ply", 948, 1),
        ("bunny/bunny-closed-16302.ply", 16_302, 1),
        ("bunny/bunny-closed-75408.ply", 75_408, 1),
        ("ply/cube.ply", 12, 1),
        ("ply/cube_binary.ply", 12, 1),
        ("ply/cube_blender_uv.ply", 12, 1),
        ("ply/dragon-47794.ply", 47_794, 1),
        ("ply/float-color.ply", 1, 1),
        ("ply/fuze.ply", 1000, 1),
        ("ply/fuze_ascii.ply", 1000, 1),
        ("ply/reference.ply", 1610, 7),
        ("ply/sphere.ply", 1280, 1),
    ] {
        let Some(path) = shared_scenes(name) else { continue };
        let scene = load(path).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_consistent(&scene, name);
        assert_eq!(
            (scene.triangles.len(), scene.hittable().len()),
            (triangles, triangles),
            "{name}: {:#?}",
            scene.warnings
        );
        assert_eq!(scene.materials.len(), materials, "{name}: {:#?}", scene.warnings);
        match name {
            "ply/sphere.ply" => {
                // 20 * 8^2 faces of an icosphere: its area is a little below 4 pi.
                let area = total_area(&scene);
                assert!((12.4..12.566).contains(&area), "{area}");
            }
            "ply/cube_blender_uv.ply" => assert_eq!(scene.triangles[0].uvs, [0, 1, 2]),
            "ply/float-color.ply" => assert_eq!(colours(&scene), ["#0000ff"]),
            "ply/fuze.ply" | "ply/fuze_ascii.ply" => {
                assert_warned(&scene, "texture 'fuze uv.jpg' cannot be opened");
                assert_eq!(scene.uvs.len(), 3000, "{name}");
                assert_eq!(scene.materials[0].name, "#c0c0c0", "{name}");
            }
            _ => {}
        }
    }
}

/// A file is read in blocks of rows beside each other; what they hold is numbered through.
#[test]
fn large_files_keep_order_and_numbers() {
    const ROWS: usize = 40_000; // more than two blocks
    let header = format!(
        "element face {ROWS}\n{CORNERS}\nproperty list uchar float texcoord\nelement odd 2\nproperty int a\n\
         element vertex {ROWS}\n{XYZ}\n"
    );
    let header: Vec<&str> = header.trim().lines().collect();
    let faces: String = (0..ROWS)
        .map(|i| match i % 5 {
            0 => format!("4 {i} {} 2 3 8 {i} 0 1 0 1 1 0 1\n", ROWS - 1),
            1 => format!("3 {i} 0 1 0\n"),
            2 => format!("3 {i} 0 1 6 {i} 0 0.5 0 0 nan\n"),
            3 => "2 0 1 0\n".to_owned(),
            _ => format!("3 {i} 0 1 2 7 7\n"),
        })
        .collect();
    let vertices: String = (0..ROWS).map(|i| format!("{i} {} {}\n", i * i % 97, i % 89)).collect();
    let scene = load_bytes(text(&header, &format!("{faces}1\n2 3\n\n{vertices}")).as_bytes()).unwrap();
    let mut triangles = scene.triangles.iter();
    let uv = |corner: u32| if corner == NO_INDEX { None } else { Some(scene.uvs[corner as usize].x) };
    for i in (0..ROWS).filter(|i| i % 5 != 3) {
        let t = triangles.next().unwrap();
        let corner = t.positions.iter().position(|&p| scene.positions[p as usize].x == i as f32).unwrap();
        let expected = [0, 2].contains(&(i % 5)).then_some(i as f32);
        assert_eq!(uv(t.uvs[corner]), expected, "face {i}");
        if i % 5 == 0 {
            triangles.next().unwrap();
        }
    }
    assert!(triangles.next().is_none());
    assert_warned(&scene, "faces with fewer than three corners ignored: 8000, the first is of face 3");
    assert_warned(
        &scene,
        "'texcoord' that do not have two numbers for each corner ignored: 8000, the first is of face 4",
    );
    assert_warned(&scene, "lines with more values than the header promises");
    // A fault in a late block has its place.
    let broken = faces.replace("3 39996 0 1 0\n", "3 39996 0 x 0\n");
    let message = load_bytes(text(&header, &format!("{broken}1\n2\n{vertices}")).as_bytes()).unwrap_err().to_string();
    assert!(message.contains("face 39996: "), "{message}");
}
