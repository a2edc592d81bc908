//! OBJ, MTL and texture files: the quirks of real writers, hostile files, and real models.
//!
//! The large tables are those of `../shared/scenes`, a collection beside the repository; where it is absent those tests
//! say so and pass. All other tests write their own files.

use crate::common::models::{
    assert_consistent, assert_warned, check_malformed, image_of, rows, shared_scenes as shared, size_of_picture,
    total_area,
};
use raybrook::low_level::scene::{NO_INDEX, Scene, load};
use std::path::Path;

/// Writes `files` into a fresh folder and loads the first.
fn load_files(files: &[(&str, &str)]) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    load(folder.path().join(files[0].0))
}

fn load_text(text: &str) -> raybrook::Result<Scene> {
    load_files(&[("a.obj", text)])
}

#[test]
fn every_quirk_loads_with_its_triangle_count() {
    let Some(table) = shared("quirks/expected.tsv") else { return };
    let mut checked = 0;
    for (name, expected) in rows(&table).iter().filter(|(name, _)| name.ends_with(".obj")) {
        let scene = load(table.with_file_name(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        let counts = expected.trim_start_matches("ok ").trim_start_matches("either ");
        let (least, most) = counts.split_once("..").unwrap_or((counts, counts));
        let range = least.parse::<usize>().unwrap()..=most.parse::<usize>().unwrap();
        assert!(range.contains(&scene.triangles.len()), "{name}: {} triangles, {expected}", scene.triangles.len());
        assert_consistent(&scene, name);
        let hittable = match name.as_str() {
            "degenerate.obj" => 12,
            "all_same_point.obj" => 0,
            _ => scene.triangles.len(),
        };
        assert_eq!(scene.hittable().len(), hittable, "{name}");
        checked += 1;
    }
    assert!(checked >= 40, "{checked} rows");
}

#[test]
fn polygons_keep_their_area() {
    for (name, expected) in [
        ("concave_L.obj", 3.0),
        ("concave_arrow.obj", 1.0),
        ("concave_star.obj", 4.114497),
        ("ngon_10000_one_line.obj", 3.1415924),
        ("cube.obj", 6.0),
        ("bom.obj", 6.0),
        ("negative_indices.obj", 6.0),
        ("continuation.obj", 6.0),
        ("vertex_w.obj", 6.0),
        ("mixed_corner_forms.obj", 6.0),
    ] {
        let Some(path) = shared("quirks").map(|p| p.join(name)) else { return };
        let scene = load(path).unwrap();
        assert!((total_area(&scene) - expected).abs() < 2e-6, "{name}: {}", total_area(&scene));
    }
}

#[test]
fn quirks_give_the_right_materials_and_warnings() {
    let Some(folder) = shared("quirks") else { return };
    let scene = |name: &str| load(folder.join(name)).unwrap();
    for name in ["textured_quad.obj", "backslash_path.obj", "map_options.obj", "texture_name_with_space.obj"] {
        let scene = scene(name);
        let texture = scene.materials[scene.triangles[0].material as usize].diffuse_texture;
        assert_eq!(texture, Some(0), "{name}: {:#?}", scene.warnings);
        assert_eq!(size_of_picture(&scene), (4, 4), "{name}");
        assert_eq!(scene.triangles[1].uvs.map(|i| scene.uvs[i as usize].to_array()), [[0., 0.], [1., 1.], [0., 1.]]);
    }
    assert_warned(&scene("vertex_colours.obj"), "colours and weights of vertices not used: 8, this is the first");
    assert!(scene("vertex_w.obj").warnings.is_empty(), "{:?}", scene("vertex_w.obj").warnings);
    assert_warned(&scene("map_options.obj"), "map_options.mtl:3: ");
    assert_warned(&scene("map_options.obj"), "-s -o -clamp -mm");
    assert_warned(&scene("missing_mtllib.obj"), "missing_mtllib.obj:1: material library 'nowhere.mtl'");
    assert_warned(&scene("undefined_usemtl.obj"), "undefined_usemtl.obj:2: material 'undefined_name' is not defined");
    assert_warned(&scene("missing_texture.obj"), "missing_texture.mtl:3: texture 'tex/none.png'");
    assert_warned(&scene("textured_quad.obj"), "mats.mtl:23: 'unknown_key' is not supported");
    assert_eq!(scene("material_name_with_spaces.obj").materials[0].name, "name with spaces");
    assert_eq!(scene("utf8_names.obj").materials[0].name, "červená");
    let glass = &scene("two_mtllibs.obj").materials[0];
    assert_eq!((glass.ior, glass.transmission.x), (1.5, 0.9));
}

#[test]
fn every_malformed_file_behaves_as_listed() {
    let Some(table) = shared("malformed/expected.tsv") else { return };
    let checked = check_malformed(&table, ".obj");
    assert!(checked >= 40, "{checked} rows");
}

#[test]
fn messages_name_file_and_line() {
    for (text, place, part) in [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", ":4: ", "vertex index 4 is too large: the file has 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", ":4: ", "index 0; indices count from 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf -1 -2 -9\n", ":5: ", "vertex index -9 reaches before the first"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3.5\n", ":4: ", "'3.5' is not a whole number"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", ":4: ", "99999999999999999999 is too large"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4294967297\n", ":4: ", "4294967297 is too large"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 /3\n", ":4: ", "corner '/3' has no vertex index"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3/1/1/1\n", ":4: ", "more than vertex/texture/normal"),
        ("# c\nv 0 0\nv 1 0 0\nf 1 2 2\n", ":2: ", "'v' needs 3 numbers, found 2: '0 0'"),
        ("v 0 0 0\nv a b c\nf 1 2 2\n", ":2: ", "'v a b c' is not made of numbers"),
        ("v 0 0 0\r\n\r\nv 0,5 0 0\r\nf 1 2 2\r\n", ":3: ", "decimals take a point, not a comma"),
        ("v 0 0 0\rv 1 0 0\rvn 0 x 0\rf 1 2 2\r", ":3: ", "'vn 0 x 0' is not made of numbers"),
        ("v 0 0 0\nf 1 \\\n 1 \\\n 2\nv 0 0 x\n", ":5: ", "'v 0 0 x'"),
        ("", ": ", "has no faces"),
        ("\u{89}PNG\r\n\u{1a}\n\0\0\0\rIHDR", ": ", "NUL bytes"),
        ("v 0 0 0\nf 1 1\n", ": ", "has no face of three or more corners"),
    ] {
        let message = load_text(text).expect_err(text).to_string();
        assert!(message.contains(&format!("a.obj{place}")) && message.contains(part), "{text:?}: {message}");
    }
}

#[test]
fn a_concave_polygon_does_not_cover_its_notch() {
    let scene = load_text("v 0 1 0\nv -1 -1 0\nv 0 0 0\nv 1 -1 0\nf 2 3 4 1\n").unwrap();
    assert_eq!(scene.triangles.len(), 2);
    assert!((total_area(&scene) - 1.0).abs() < 1e-12);
    for primitive in 0..2 {
        let [a, b, c] = scene.vertices(primitive);
        assert!((b - a).cross(c - a).z > 0.0, "wound like the face");
        // The notch holds (0, -0.5).
        let p = glam::Vec3::new(0.0, -0.5, 0.0);
        let inside = [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| (e - s).cross(p - s).z >= 0.0);
        assert!(!inside, "triangle {primitive}");
    }
}

#[test]
fn marks_line_ends_and_continuations_do_not_lose_data() {
    let plain = load_text("v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n").unwrap();
    for text in [
        "\u{feff}v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n",
        "v 0 0 0\r\nv 2 0 0\r\nv 0 3 0\r\nf 1 2 3",
        "v 0 0 0\rv 2 0 0\rv 0 3 0\rf 1 2 3",
        "v 0 \\\n0 0\nv 2 0 \\\r\n 0\nv 0 3 0\nf 1 \\\n2 \\\n3\n",
        "# C:\\models\\\nv 0 0 0 # a\\\nv 2 0 0\nv 0 3 0#b\nf 1 2 3 # 4 5\n",
        "f 1 2 3\ng\nv 0 0 0\nv 2 0 0\nv 0 3 0\n",
        "v 0 0 0 7\nv 2 0 0 1 1 1\nv 0 3 0 0\nf -3 -2 -1\nl 1 2\np 3\ncurv 0 1 \\\n 1 2 3\n",
    ] {
        let scene = load_text(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!(scene.triangles.len(), 1, "{text:?}");
        assert_eq!(scene.vertices(0), plain.vertices(0), "{text:?}");
    }
}

#[test]
fn primitives_are_numbered_in_file_order() {
    let mut text = String::from("mtllib m.mtl\n");
    let mut expected = Vec::new();
    // Each face has its own place, in materials and groups that come and go.
    for face in 0..200 {
        text.push_str(&format!("v {face} 0 0\nv {face} 1 0\nv {face} 0 1\nv {face} -1 1\n"));
        let material = ["red", "green", "undefined"][face / 3 % 3];
        text.push_str(&format!("g group{}\nusemtl {material}\no object{}\n", face % 4, face % 2));
        text.push_str(if face % 5 == 0 { "f -4 -3 -2 -1\n" } else { "f -4 -3 -2\n" });
        let name = if material == "undefined" { "" } else { material };
        expected.extend(std::iter::repeat_n((face as f32, name), if face % 5 == 0 { 2 } else { 1 }));
    }
    let scene = load_files(&[("a.obj", &text), ("m.mtl", "newmtl green\nKd 0 1 0\nnewmtl red\nKd 1 0 0\n")]).unwrap();
    let found: Vec<(f32, &str)> = (0..scene.triangles.len())
        .map(|i| (scene.vertices(i)[0].x, scene.materials[scene.triangles[i].material as usize].name.as_str()))
        .collect();
    assert_eq!(found, expected);
    assert_eq!(scene.materials.len(), 3);
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
}

#[test]
fn corners_without_normal_or_texture_do_not_get_their_neighbours() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 1 0 0\nvt 0.25 0.5\nvt 0.75\n";
    let text = format!("{vertices}f 1/2/2 2/1/1 3/1/1\nf 1 2 3\nf 1//1 2//2 3\nf 1/1 2/9 3/-1/-7\n");
    let scene = load_text(&text).unwrap();
    let normal = |i: u32| if i == NO_INDEX { None } else { Some(scene.normals[i as usize].to_array()) };
    let uv = |i: u32| if i == NO_INDEX { None } else { Some(scene.uvs[i as usize].to_array()) };
    let (x, z) = (Some([1., 0., 0.]), Some([0., 0., 1.]));
    assert_eq!(scene.triangles[0].normals.map(normal), [x, z, z]);
    assert_eq!(scene.triangles[0].uvs.map(uv), [Some([0.75, 0.]), Some([0.25, 0.5]), Some([0.25, 0.5])]);
    assert_eq!((scene.triangles[1].normals, scene.triangles[1].uvs), ([NO_INDEX; 3], [NO_INDEX; 3]));
    assert_eq!(scene.triangles[2].normals.map(normal), [z, x, None]);
    assert_eq!(scene.triangles[3].uvs.map(uv), [Some([0.25, 0.5]), None, Some([0.75, 0.])]);
    assert_eq!(scene.triangles[3].normals, [NO_INDEX; 3]);
    assert_warned(&scene, "a.obj:11: texture or normal indices that refer to nothing ignored: 2");
}

#[test]
fn triangles_that_cannot_be_hit_keep_their_number_and_warn_once() {
    let text = "v nan 0 0\nv 1e39 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\n\
                f 1 4 5\nf 3 4 5\nf 2 4 5\nf 3 4 6\nf 3 3 3\nf 1 2 3\nf 1 2\n";
    let scene = load_text(text).unwrap();
    assert_eq!((scene.triangles.len(), scene.hittable()), (6, vec![1]));
    assert_warned(&scene, "triangles with NaN or infinite vertices left out: 3, the first is number 0");
    assert_warned(&scene, "triangles without area left out: 2, the first is number 3");
    assert_warned(&scene, "a.obj:13: faces with fewer than three corners ignored: 1,");
    assert_eq!(scene.warnings.len(), 3);
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";

/// A picture of one colour.
fn write_png(path: &Path, colour: [u8; 3]) {
    image::RgbImage::from_pixel(2, 3, image::Rgb(colour)).save(path).unwrap();
}

#[test]
fn nothing_outside_the_folder_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let outside = folder.path().join("outside");
    let inside = folder.path().join("inside");
    std::fs::create_dir_all(&outside).unwrap();
    std::fs::create_dir_all(inside.join("sub")).unwrap();
    std::fs::write(outside.join("secret.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    write_png(&outside.join("secret.png"), [1, 2, 3]);
    write_png(&inside.join("open.png"), [4, 5, 6]);
    let mut libraries = vec!["../outside/secret.mtl".to_owned(), "..\\outside\\secret.mtl".to_owned()];
    libraries.push(outside.join("secret.mtl").to_str().unwrap().to_owned());
    libraries.push("sub/../../outside/secret.mtl".to_owned());
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(outside.join("secret.mtl"), inside.join("link.mtl")).unwrap();
        std::os::unix::fs::symlink(&outside, inside.join("sub/link")).unwrap();
        libraries.extend(["link.mtl".to_owned(), "sub/link/secret.mtl".to_owned()]);
    }
    let obj = inside.join("a.obj");
    for library in &libraries {
        std::fs::write(&obj, format!("mtllib {library}\nusemtl m\n{TRIANGLE}")).unwrap();
        let scene = load(&obj).unwrap();
        assert_eq!(scene.materials[0].name, "", "{library} was read");
        assert_warned(&scene, "outside the scene's folder");
        assert_warned(&scene, "a.obj:1: ");

        let texture = library.replace(".mtl", ".png");
        std::fs::write(inside.join("own.mtl"), format!("newmtl m\nKd 1 0 0\nmap_Kd {texture}\n")).unwrap();
        std::fs::write(&obj, format!("mtllib own.mtl\nusemtl m\n{TRIANGLE}")).unwrap();
        #[cfg(unix)]
        if texture == "link.png" {
            std::os::unix::fs::symlink(outside.join("secret.png"), inside.join(&texture)).unwrap();
        }
        let scene = load(&obj).unwrap();
        assert!(scene.textures.is_empty(), "{texture} was read");
        assert_eq!(scene.materials[0].diffuse.to_array(), [1.0, 0.0, 0.0]);
        assert_warned(&scene, "outside the scene's folder");
        assert_warned(&scene, "own.mtl:3: ");
    }
    // The same ways that end inside do work, from a library in a folder of its own too.
    std::fs::write(inside.join("sub/own.mtl"), "newmtl m\nmap_Kd ..\\open.png\n").unwrap();
    std::fs::write(&obj, format!("mtllib sub\\own.mtl\nusemtl m\n{TRIANGLE}")).unwrap();
    let scene = load(&obj).unwrap();
    assert_eq!(image_of(&scene, 0).rgba, [[4, 5, 6, 255]; 6]);
    assert_eq!(scene.warnings, [] as [&str; 0]);
}

#[test]
fn textures_are_shared_and_only_loaded_for_materials_in_use() {
    let folder = tempfile::tempdir().unwrap();
    write_png(&folder.path().join("one.png"), [255, 128, 0]);
    write_png(&folder.path().join("two.png"), [0, 0, 255]);
    std::fs::write(folder.path().join("broken.png"), "no picture").unwrap();
    let library = "newmtl a\nmap_Kd one.png\nnewmtl b\nmap_Kd -s 1 1 1 ./one.png\nnewmtl c\nmap_Kd two.png\n\
                   newmtl d\nmap_Kd broken.png\nnewmtl e\nmap_Kd broken.png\nnewmtl unused\nmap_Kd none.png\n";
    std::fs::write(folder.path().join("m.mtl"), library).unwrap();
    let mut text = String::from("mtllib m.mtl m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n");
    for name in ["a", "b", "c", "d", "e", "a"] {
        text.push_str(&format!("usemtl {name}\nf 1 2 3\n"));
    }
    std::fs::write(folder.path().join("a.obj"), text).unwrap();
    let scene = load(folder.path().join("a.obj")).unwrap();
    let textures: Vec<_> =
        scene.triangles.iter().map(|t| scene.materials[t.material as usize].diffuse_texture).collect();
    assert_eq!(textures, [Some(0), Some(0), Some(1), None, None, Some(0)]);
    assert_eq!((scene.textures.len(), scene.materials.len()), (2, 5));
    assert_eq!(size_of_picture(&scene), (2, 3));
    assert_eq!(scene.materials[0].diffuse.to_array(), [1.0; 3], "no Kd beside a map_Kd is white");
    let broken = scene.warnings.iter().filter(|w| w.contains("broken.png")).count();
    assert_eq!(broken, 1, "one warning for each file: {:#?}", scene.warnings);
    assert!(!scene.warnings.iter().any(|w| w.contains("none.png")));
}

#[test]
fn materials_follow_the_table_in_mtl_rs() {
    let library = "newmtl matt\nKd 0.5 0.25 0.125 # c\nKs 1 1 1\nillum 1\n\
                   newmtl mirror\nKa 0.1 0.1 0.1\nKd 0 0 0\nKs 0.9 0.8 0.7\nNs 20000\nillum 3\n\
                   newmtl glass\nKd 1 1 1\nKs 0.1 0.1 0.1\nNi 1.5\nillum 7\n\
                   newmtl thin\nKd 1 1 1\nd 0.25\nTf 1 0.5 0\n\
                   newmtl tr\nKd 0 1 0\nTr 0.75\n\
                   newmtl light\nKa 20 20 20\nKd 1 1 1\n\
                   newmtl constant\nKd 0.3 0.2 0.1\nKs 1 1 1\nillum 0\n\
                   newmtl gray\nKd 0.5\nKe 3 0 0\n\
                   newmtl bad\nKd nan inf -1\nKs 1e39 0 0\nNs 1e30\nNi 0\nd -3\nillum 99\nKd 0.5 0.5\nKd 0.5 0.5 x\n\
                   Kd 2 0.5 0\n\
                   map_Ks a.png\nnorm b.png\nPr 0.5\nPr 0.5\n";
    let names: Vec<&str> = library.lines().filter_map(|l| l.strip_prefix("newmtl ")).collect();
    let mut text = String::from("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n");
    for name in &names {
        text.push_str(&format!("usemtl {name}\nf 1 2 3\n"));
    }
    let scene = load_files(&[("a.obj", &text), ("m.mtl", library)]).unwrap();
    assert_eq!(scene.materials.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), names);
    let [matt, mirror, glass, thin, tr, light, constant, gray, bad] = &scene.materials[..] else { panic!() };
    assert_eq!((matt.diffuse.to_array(), matt.ambient), ([0.5, 0.25, 0.125], matt.diffuse));
    assert_eq!(matt.specular.to_array(), [0.0; 3]);
    assert_eq!((mirror.mirror, mirror.mirror.to_array()), (mirror.specular, [0.9, 0.8, 0.7]));
    assert_eq!((mirror.shininess, mirror.ambient.x), (10_000.0, 0.1));
    assert_eq!((glass.ior, glass.transmission.to_array(), glass.diffuse.to_array()), (1.5, [1.0; 3], [0.0; 3]));
    assert_eq!((thin.transmission.to_array(), thin.diffuse.to_array(), thin.ior), ([0.75, 0.375, 0.0], [0.25; 3], 1.0));
    assert_eq!((tr.transmission.to_array(), tr.diffuse.to_array()), ([0.75; 3], [0.0, 0.25, 0.0]));
    assert_eq!((light.emission.to_array(), light.ambient.to_array()), ([20.0; 3], [1.0; 3]));
    assert_eq!((constant.emission.to_array(), constant.diffuse.to_array()), ([0.3, 0.2, 0.1], [0.0; 3]));
    assert_eq!((gray.diffuse.to_array(), gray.emission.to_array()), ([0.5; 3], [3.0, 0.0, 0.0]));
    assert_eq!((bad.diffuse.to_array(), bad.specular.to_array(), bad.ior), ([1.0, 0.5, 0.0], [0.0; 3], 1.0));
    assert_eq!(bad.transmission.to_array(), [0.0; 3]);
    for line in [34, 35, 37, 38, 39, 40, 41, 42] {
        assert_warned(&scene, &format!("m.mtl:{line}: "));
    }
    for keyword in ["'map_Ks'", "'norm'", "'Pr' is not supported and ignored (statements: 2)"] {
        assert_warned(&scene, keyword);
    }
}

#[test]
fn hostile_files_do_not_flood_the_warnings() {
    let mut text = TRIANGLE.to_owned();
    for i in 0..10_000 {
        text.push_str(&format!("usemtl m{i}\nunknown{i} 1\nmtllib l{i}.mtl\nf 1 2 3\nf\n"));
    }
    let scene = load_text(&text).unwrap();
    assert_eq!((scene.triangles.len(), scene.materials.len()), (10_001, 1));
    assert!(scene.warnings.len() < 100, "{}", scene.warnings.len());
    assert_warned(&scene, "more warnings left out");
}

#[test]
fn real_models_have_their_triangles() {
    for (name, triangles, textures) in [
        ("bunny/bunny-69451.obj", 69_451, 0),
        ("sponza/sponza.obj", 66_450, 0),
        ("spd/gears.obj", 36_610, 0),
        ("spd/mount.obj", 33_200, 0),
        ("spd/tree.obj", 33_662, 0),
        ("objects/suzanne.obj", 968, 0),
        ("objects/cow.obj", 5_804, 0),
        ("objects/teapot.obj", 6_320, 0),
        ("objects/fandisk.obj", 12_946, 0),
        ("spot/spot.obj", 5_856, 0),
        ("spot/spot_control_mesh.obj", 372, 0),
        ("spot/spot_quadrangulated.obj", 5_856, 0),
        ("spot/spot_textured.obj", 5_856, 1),
        ("spider/spider.obj", 1_368, 4),
        ("viking-room/viking_room.obj", 3_828, 0), // its usemtl names a material that its library does not define
        ("cornell/cornell_box.obj", 34, 0),
        ("cornell/cornellbox_suzanne.obj", 980, 0),
    ] {
        let Some(path) = shared(name) else { continue };
        let started = std::time::Instant::now();
        let scene = load(path).unwrap_or_else(|e| panic!("{name}: {e}"));
        eprintln!("{name}: {:?}, {:#?}", started.elapsed(), scene.warnings);
        assert_consistent(&scene, name);
        assert_eq!(
            (scene.triangles.len(), scene.textures.len()),
            (triangles, textures),
            "{name}: {:#?}",
            scene.warnings
        );
    }
}

#[test]
fn large_files_keep_order_and_materials() {
    // More corners than the loader hands to its parser at once, twice over.
    const FACES: usize = 200_000;
    let mut text = String::from("mtllib m.mtl\n");
    for i in 0..100 {
        text.push_str(&format!("v {i} 0 0\n"));
    }
    text.push_str("v 0 1 0\nv 0 0 1\n");
    for face in 0..FACES {
        if face % 1000 == 7 {
            text.push_str(if face % 2000 == 7 { "usemtl a\nf 1 2\n" } else { "usemtl b\n" });
        }
        text.push_str(&format!("f {} -2 -1\n", face % 100 + 1));
    }
    let scene = load_files(&[("a.obj", &text), ("m.mtl", "newmtl a\nnewmtl b\n")]).unwrap();
    assert_eq!(scene.triangles.len(), FACES);
    for face in 0..FACES {
        let name = if face < 7 { "" } else { ["a", "b"][(face - 7) / 1000 % 2] };
        assert_eq!(scene.vertices(face)[0].x, (face % 100) as f32);
        assert_eq!(scene.materials[scene.triangles[face].material as usize].name, name, "face {face}");
    }
}

#[test]
fn every_kind_of_picture_loads_as_8_bit_rgba() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = image::RgbImage::from_fn(3, 2, |x, y| image::Rgb([x as u8 * 100, y as u8 * 200, 50]));
    let expected: Vec<[u8; 4]> = rgb.pixels().map(|p| [p[0], p[1], p[2], 255]).collect();
    let picture = image::DynamicImage::from(rgb);
    for (name, save_as) in [("a.png", "a.png"), ("a.bmp", "a.bmp"), ("a.tga", "a.tga"), ("b.jpg", "b.png")] {
        picture.save(folder.path().join(save_as)).unwrap();
        // A PNG named .jpg: what the file says counts.
        std::fs::rename(folder.path().join(save_as), folder.path().join(name)).unwrap();
    }
    picture.to_rgb16().save(folder.path().join("deep.png")).unwrap();
    picture.to_rgba16().save(folder.path().join("deep_alpha.png")).unwrap();
    picture.to_rgba8().save(folder.path().join("alpha.png")).unwrap();
    picture.to_luma8().save(folder.path().join("gray.png")).unwrap();
    picture.to_luma_alpha16().save(folder.path().join("gray_deep.png")).unwrap();
    let gray: Vec<[u8; 4]> = picture.to_luma8().pixels().map(|p| [p[0], p[0], p[0], 255]).collect();
    for name in
        ["a.png", "a.bmp", "a.tga", "b.jpg", "deep.png", "deep_alpha.png", "alpha.png", "gray.png", "gray_deep.png"]
    {
        std::fs::write(folder.path().join("m.mtl"), format!("newmtl m\nmap_Kd {name}\n")).unwrap();
        std::fs::write(folder.path().join("a.obj"), format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}")).unwrap();
        let scene = load(folder.path().join("a.obj")).unwrap();
        assert_eq!(scene.warnings, [] as [&str; 0], "{name}");
        let texture = image_of(&scene, 0);
        assert_eq!((texture.name.as_str(), texture.width, texture.height), (name, 3, 2));
        assert_eq!(&texture.rgba, if name.starts_with("gray") { &gray } else { &expected }, "{name}");
    }
}
