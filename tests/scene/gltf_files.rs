//! glTF files: numbers of every kind, hierarchies, materials, hostile files, and real models.

use crate::common::models::*;
use glam::{Vec2, Vec3};
use raybrook::low_level::scene::{Falloff, LightKind, Scene, load};
use serde_json::{Value, json};
use std::path::Path;

/// A file that is put together: its JSON and its only buffer.
struct File {
    json: Value,
    bytes: Vec<u8>,
}

const FLOAT: u32 = 5126;

impl File {
    /// One node with a mesh of one primitive, which is to be filled in.
    fn new() -> File {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}], "bufferViews": [], "accessors": []
        });
        File { json, bytes: Vec::new() }
    }

    /// A square of two triangles in the plane z = 0, with texture coordinates.
    fn square() -> File {
        let mut file = File::new();
        let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
        let uvs = file.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let indices = file.accessor(&[0, 1, 2, 0, 2, 3], json!({"componentType": 5121, "count": 6, "type": "SCALAR"}));
        *file.primitive() = json!({"attributes": {"POSITION": positions, "TEXCOORD_0": uvs}, "indices": indices});
        file
    }

    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// Adds an item to a list of the JSON and tells its number.
    fn push(&mut self, list: &str, item: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let mut view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.bytes.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    fn accessor(&mut self, bytes: &[u8], mut accessor: Value) -> usize {
        accessor["bufferView"] = self.view(bytes, None).into();
        self.push("accessors", accessor)
    }

    fn floats(&mut self, kind: &str, numbers: &[f32]) -> usize {
        let parts = if kind == "VEC2" {
            2
        } else if kind == "VEC4" {
            4
        } else {
            3
        };
        let accessor = json!({"componentType": FLOAT, "count": numbers.len() / parts, "type": kind});
        self.accessor(bytemuck::cast_slice(numbers), accessor)
    }

    /// The file in binary.
    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut binary = self.bytes.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut file = b"glTF".to_vec();
        let words = |file: &mut Vec<u8>, words: &[u32]| words.iter().for_each(|w| file.extend(w.to_le_bytes()));
        words(&mut file, &[2, 12 + 8 + json.len() as u32 + 8 + binary.len() as u32, json.len() as u32]);
        file.extend(b"JSON");
        file.extend(json);
        words(&mut file, &[binary.len() as u32]);
        file.extend(b"BIN\0");
        file.extend(binary);
        file
    }

    /// The file as text that names its buffer by `uri`.
    fn text(&self, uri: &str) -> String {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bytes.len(), "uri": uri}]);
        json.to_string()
    }

    fn try_load(&self) -> raybrook::Result<Scene> {
        load_bytes("a.GLB", &self.glb())
    }

    #[track_caller]
    fn load(&self) -> Scene {
        let scene = self.try_load().unwrap();
        assert_consistent(&scene, "a.GLB");
        scene
    }

    /// What is wrong with the file.
    #[track_caller]
    fn fault(&self) -> String {
        let error = self.try_load().unwrap_err();
        assert_eq!(error.exit_code(), 3, "{error}");
        error.to_string()
    }
}

fn load_bytes(name: &str, bytes: &[u8]) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load(path)
}

fn vertices(scene: &Scene) -> Vec<[Vec3; 3]> {
    (0..scene.triangle_count()).map(|i| scene.vertices(i)).collect()
}

/// A PNG of these texels.
fn png(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, texels.len() as u32 / width);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
    bytes
}

/// A tetrahedron and a far point that nothing uses; every coordinate fits into 8 bits.
const CORNERS: [[f32; 3]; 5] = [[0.0; 3], [9.0, 0.0, 0.0], [100.0; 3], [0.0, 7.0, 0.0], [0.0, 0.0, 5.0]];
const FACES: [[u32; 3]; 4] = [[0, 3, 1], [0, 1, 4], [1, 3, 4], [3, 0, 4]];

/// The tetrahedron with positions and indices that are to be filled in.
fn tetrahedron(fill: impl FnOnce(&mut File) -> (usize, usize)) -> Scene {
    let mut file = File::new();
    let (positions, indices) = fill(&mut file);
    *file.primitive() = json!({"attributes": {"POSITION": positions}, "indices": indices});
    file.load()
}

fn indices(file: &mut File, component: u32, bytes: &[u8]) -> usize {
    file.accessor(bytes, json!({"componentType": component, "count": 12, "type": "SCALAR"}))
}

#[test]
fn numbers_of_every_kind_give_the_triangles_of_an_obj() {
    let obj: String = CORNERS.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let faces: String = FACES.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)).collect();
    let expected = vertices(&load_bytes("a.obj", (obj + &faces).as_bytes()).unwrap());
    let flat = CORNERS.as_flattened();
    let corners = FACES.as_flattened();
    let bytes = |of: fn(u32) -> Vec<u8>| -> Vec<u8> { corners.iter().flat_map(|&i| of(i)).collect() };
    let wide = bytes(|i| i.to_le_bytes().to_vec());

    for (component, index_bytes) in
        [(5121, bytes(|i| vec![i as u8])), (5123, bytes(|i| (i as u16).to_le_bytes().to_vec())), (5125, wide.clone())]
    {
        let scene = tetrahedron(|file| (file.floats("VEC3", flat), indices(file, component, &index_bytes)));
        assert_eq!(vertices(&scene), expected, "indices of type {component}");
        assert_eq!(scene.positions.len(), 4, "the vertex that nothing uses");
    }
    // Quantised, with and without normalisation, which a node takes back.
    for (component, most, parts) in [(5120, 127.0, 1), (5121, 255.0, 1), (5122, 32_767.0, 2), (5123, 65_535.0, 2)] {
        let quantised: Vec<u8> = flat.iter().flat_map(|&x| (x as u16).to_le_bytes()[..parts].to_vec()).collect();
        for normalized in [false, true] {
            let mut file = File::new();
            let count = CORNERS.len();
            let kind = json!({"componentType": component, "count": count, "type": "VEC3", "normalized": normalized});
            let positions = file.accessor(&quantised, kind);
            let indices = indices(&mut file, 5125, &wide);
            *file.primitive() = json!({"attributes": {"POSITION": positions}, "indices": indices});
            if normalized {
                file.json["nodes"][0]["scale"] = json!([most, most, most]);
            }
            file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
            for (found, due) in vertices(&file.load()).iter().flatten().zip(expected.iter().flatten()) {
                let tolerance = if normalized { 9.0 * f32::EPSILON } else { 0.0 };
                assert!((*found - *due).abs().max_element() <= tolerance, "{component}, {normalized}: {found} {due}");
            }
        }
    }
    // Interleaved with something else, at an offset.
    let interleaved: Vec<f32> = CORNERS.iter().flat_map(|&[x, y, z]| [7.0, x, y, z, -7.0]).collect();
    let scene = tetrahedron(|file| {
        let view = file.view(bytemuck::cast_slice(&interleaved), Some(20));
        let accessor = json!({"bufferView": view, "byteOffset": 4, "componentType": FLOAT, "count": 5, "type": "VEC3"});
        (file.push("accessors", accessor), indices(file, 5125, &wide))
    });
    assert_eq!(vertices(&scene), expected);
    // Sparse: in place of wrong numbers, and of none at all.
    for has_view in [true, false] {
        let scene = tetrahedron(|file| {
            let mut wrong = flat.to_vec();
            wrong[3..6].copy_from_slice(&[1.0, 2.0, 3.0]);
            wrong[12..15].copy_from_slice(&[-1.0, 2.0, 3.0]);
            let places: &[u16] = if has_view { &[1, 4] } else { &[0, 1, 2, 3, 4] };
            let values: Vec<[f32; 3]> = places.iter().map(|&i| CORNERS[i as usize]).collect();
            let (places_view, values_view) =
                (file.view(bytemuck::cast_slice(places), None), file.view(bytemuck::cast_slice(&values), None));
            let mut accessor = json!({"componentType": FLOAT, "count": 5, "type": "VEC3", "sparse": {
                "count": places.len(), "indices": {"bufferView": places_view, "componentType": 5123},
                "values": {"bufferView": values_view}
            }});
            if has_view {
                accessor["bufferView"] = file.view(bytemuck::cast_slice(&wrong), None).into();
            }
            (file.push("accessors", accessor), indices(file, 5125, &wide))
        });
        assert_eq!(vertices(&scene), expected, "sparse, {has_view}");
    }
    // Without indices.
    let mut file = File::new();
    let every: Vec<f32> = corners.iter().flat_map(|&i| CORNERS[i as usize]).collect();
    let positions = file.floats("VEC3", &every);
    *file.primitive() = json!({"attributes": {"POSITION": positions}});
    assert_eq!(vertices(&file.load()), expected);
}

#[test]
fn strips_and_fans_are_triangles_and_the_rest_is_told() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
    let [a, b, c, d] = corners;
    for (mode, order, expected) in [
        (5, [0u8, 1, 3, 2], vec![[a, b, d], [d, b, c]]),
        (5, [0, 1, 3, 3], vec![[a, b, d]]),
        (6, [0, 1, 2, 3], vec![[a, b, c], [a, c, d]]),
    ] {
        let mut file = File::square();
        let indices = file.accessor(&order, json!({"componentType": 5121, "count": 4, "type": "SCALAR"}));
        file.primitive()["indices"] = indices.into();
        file.primitive()["mode"] = mode.into();
        let same = |found: &[Vec3; 3], due: &[Vec3; 3]| (0..3).any(|k| [0, 1, 2].map(|i| found[(i + k) % 3]) == *due);
        let found = vertices(&file.load());
        assert_eq!(found.len(), expected.len(), "mode {mode}");
        assert!(found.iter().zip(&expected).all(|(found, due)| same(found, due)), "{mode}: {found:?}");
    }
    let mut file = File::square();
    for mode in [0, 1, 3, 3] {
        let primitive = json!({"attributes": {"POSITION": 0}, "mode": mode});
        file.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }
    file.json["animations"] = json!([]);
    file.json["extensionsUsed"] = json!(["KHR_materials_clearcoat", "KHR_lights_punctual"]);
    let scene = file.load();
    assert_eq!(scene.triangle_count(), 2);
    let expected = "a.GLB: not used: extension KHR_materials_clearcoat, lines (3), points";
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(scene.warnings[0].ends_with(expected), "{}", scene.warnings[0]);
    // Nothing else at all.
    file.json["meshes"][0]["primitives"].as_array_mut().unwrap().remove(0);
    assert!(file.fault().ends_with("has no triangles; not used: extension KHR_materials_clearcoat, lines (3), points"));
}

#[test]
fn nodes_place_their_meshes() {
    let mut file = File::square();
    file.json["nodes"] = json!([
        {"translation": [10, 0, 0], "children": [1, 2]},
        {"mesh": 0, "scale": [-2, 1, 1]},
        {"mesh": 1, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
    ]);
    let mesh = file.json["meshes"][0].clone();
    file.push("meshes", mesh);
    let scene = file.load();
    // The same accessors: one object in two places.
    assert_eq!((scene.triangles.len(), scene.instances.placed().len(), scene.instances.objects().len()), (0, 2, 1));
    let [a, b, c] = scene.vertices(0);
    assert_eq!((b - a).cross(c - a), Vec3::new(0.0, 0.0, 2.0), "the outside of a mirrored square stays outside");
    assert_eq!(scene.bounds().unwrap(), (Vec3::new(8.0, 0.0, 0.0), Vec3::new(10.0, 1.0, 5.0)));
    assert_eq!(scene.vertices(2)[1], Vec3::new(10.0, 1.0, 5.0));
    // A triangle without area is told once for both places.
    let mut thin = File { json: file.json.clone(), bytes: file.bytes.clone() };
    let indices = thin.accessor(&[0, 1, 2, 0, 3, 3], json!({"componentType": 5121, "count": 6, "type": "SCALAR"}));
    for mesh in [0, 1] {
        thin.json["meshes"][mesh]["primitives"][0]["indices"] = indices.into();
    }
    assert_eq!(thin.load().warnings.len(), 1);
    assert_warned(&thin.load(), "a.GLB: triangles without area of objects with instances left out: 1");
    // Of other accessors with the same numbers, too.
    let mut copied = File { json: file.json.clone(), bytes: file.bytes.clone() };
    let positions = copied.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    copied.json["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = positions.into();
    let counts = |file: &File| {
        let scene = file.load();
        (scene.triangles.len(), scene.instances.placed().len(), scene.instances.objects().len())
    };
    assert_eq!(counts(&copied), (0, 2, 1));
    let other = copied.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 1.0, 0.0]);
    copied.json["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = other.into();
    assert_eq!(counts(&copied), (4, 0, 0));
    // Of another material: still one object.
    file.json["materials"] = json!([{"name": "a"}, {"name": "b"}]);
    file.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    file.json["meshes"][1]["primitives"][0]["material"] = 1.into();
    let scene = file.load();
    assert_eq!((scene.instances.placed().len(), scene.instances.objects().len()), (2, 1));
    let names: Vec<_> = scene.used_materials().iter().map(|&id| scene.materials[id as usize].name.clone()).collect();
    assert_eq!(names, ["a", "b"]);
    // One of both is flat, which no instance is.
    file.json["nodes"][2]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 5, 1]);
    let scene = file.load();
    assert_eq!((scene.triangles.len(), scene.instances.placed().len()), (4, 0));
    assert_eq!(scene.bounds().unwrap(), (Vec3::new(8.0, 0.0, 0.0), Vec3::new(11.0, 1.0, 5.0)));
    let of_triangles = |scene: &Scene| -> Vec<String> {
        scene.triangles.iter().map(|t| scene.materials[t.material as usize].name.clone()).collect()
    };
    assert_eq!(of_triangles(&scene), ["a", "a", "b", "b"]);
    let flat = file.json["nodes"][2]["matrix"].take();
    file.json["nodes"][2] = json!({"mesh": 1});
    file.json["nodes"][1] = json!({"mesh": 0, "matrix": flat});
    assert_eq!(of_triangles(&file.load()), ["b", "b", "a", "a"], "the solid one first");
}

#[test]
fn the_scene_that_is_shown() {
    let mut file = File::square();
    file.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1]}, {"children": [0]}]);
    file.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [1]}]);
    let z = |file: &File| file.load().bounds().unwrap().0.z;
    assert_eq!(z(&file), 0.0);
    file.json["scene"] = 1.into();
    assert_eq!(z(&file), 1.0);
    assert_warned(&file.load(), "not used: other scenes");
    file.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(z(&file), 0.0);
    // None: all nodes that are no one's child.
    file.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(file.load().triangle_count(), 4);
    file.json["scene"] = 0.into();
    assert!(file.fault().contains("there is no scene 0"));
}

#[test]
fn instances_of_a_graphics_card() {
    let mut file = File::square();
    let translations = file.floats("VEC3", &[0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 3.0, 0.0]);
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let turn = [0.0, 0.0, quarter, quarter];
    let rotations = file.floats("VEC4", &[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], turn].concat());
    let scales = file.floats("VEC3", &[1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    let attributes = json!({"TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales});
    file.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = file.load();
    assert_eq!((scene.triangle_count(), scene.instances.shared_triangle_count()), (6, 2));
    assert_eq!(scene.vertices(2)[1], Vec3::new(5.0, 0.0, 0.0));
    assert!((scene.vertices(4)[1] - Vec3::new(0.0, 4.0, 0.0)).length() < 1e-6);
    file.json["accessors"][scales]["count"] = 2.into();
    assert!(file.fault().contains("[3, 3, 2] elements"), "{}", file.fault());
}

#[test]
fn what_is_required_and_not_known_is_refused_by_name() {
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "ACME_x"] {
        let mut file = File::square();
        file.json["extensionsRequired"] = json!(["KHR_texture_transform", name]);
        let fault = file.fault();
        assert!(fault.contains(&format!("requires the extension {name}, which is not supported")), "{fault}");
    }
    // Before anything else of the file is looked at.
    let fault =
        load_bytes("a.gltf", br#"{"asset":{"version":"2.0"},"extensionsRequired":["X"],"nodes":7}"#).unwrap_err();
    assert!(fault.to_string().contains("extension X"), "{fault}");
    for (asset, part) in [
        (json!({"version": "1.0"}), "is glTF 1.0"),
        (json!({"version": 1}), "is glTF 1;"),
        (json!({"version": "2.1", "minVersion": "2.1"}), "is glTF 2.1"),
        (json!({}), "missing field `version`"),
    ] {
        let mut file = File::square();
        file.json["asset"] = asset;
        assert!(file.fault().contains(part), "{}", file.fault());
    }
    let mut file = File::square();
    file.json["asset"] = json!({"version": "2.1"});
    assert_eq!(file.load().triangle_count(), 2, "a later version that older readers may read");
    // A header of version 1 has the same length in another place.
    let mut old = File::square().glb();
    (old[4], old[8]) = (1, 0xff);
    assert!(load_bytes("a.glb", &old).unwrap_err().to_string().contains("version 1; only version 2"));
}

#[test]
fn buffers_and_pictures_beside_the_file() {
    use base64::Engine;
    let mut file = File::square();
    file.json["images"] = json!([{"uri": "p%C3%AFcture%201.png"}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    file.primitive()["material"] = 0.into();
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    std::fs::write(inner.join("b c.bin"), &file.bytes).unwrap();
    std::fs::write(folder.path().join("outside.bin"), &file.bytes).unwrap();
    std::fs::write(inner.join("p\u{ef}cture 1.png"), png(1, &[[255, 0, 0, 255]])).unwrap();
    let path = inner.join("a.gltf");
    let try_load = |uri: &str| {
        std::fs::write(&path, file.text(uri)).unwrap();
        load(&path)
    };
    for uri in ["b%20c.bin", "b c.bin"] {
        let scene = try_load(uri).unwrap();
        assert_eq!((scene.triangle_count(), scene.textures.len(), scene.warnings.len()), (2, 1, 0), "{uri}");
        let mut files: Vec<_> = scene.files.iter().map(|f| Path::new(&f.path).file_name().unwrap()).collect();
        files.sort();
        assert_eq!(files, ["a.gltf", "b c.bin", "p\u{ef}cture 1.png"]);
    }
    let base64 = base64::engine::general_purpose::STANDARD.encode(&file.bytes);
    for data in [&base64[..], base64.trim_end_matches('=')] {
        assert_eq!(try_load(&format!("data:application/gltf-buffer;base64,{data}")).unwrap().triangle_count(), 2);
    }
    for (uri, part) in [
        ("../outside.bin", "lies outside"),
        ("%2e%2e/outside.bin", "lies outside"),
        ("nothing.bin", "cannot be opened"),
        ("https://example.com/b.bin", "is an address"),
        ("file:///etc/passwd", "is an address"),
        ("data:;base64,AA*=", "base64"),
        ("data:text", "no comma"),
        ("data:;base64,AAAA", "cut short"),
        ("/dev/zero", "lies outside"),
        ("a\0b", "cannot be opened"),
    ] {
        let fault = try_load(uri).unwrap_err().to_string();
        assert!(fault.contains("a.gltf: buffer 0, '") || fault.contains("a.gltf: buffer 0 "), "{fault}");
        assert!(fault.contains(part), "{uri}: {fault}");
    }
    // A picture that is missing is told, and the surface plain.
    std::fs::remove_file(inner.join("p\u{ef}cture 1.png")).unwrap();
    let scene = try_load("b%20c.bin").unwrap();
    assert!(scene.textures.is_empty());
    assert_warned(&scene, "texture 'p%C3%AFcture%201.png' cannot be opened");
}

/// The square with a material, and the texels of a texture if it has one.
fn painted(material: Value, texels: Option<(u32, &[[u8; 4]])>) -> File {
    let mut file = File::square();
    file.json["materials"] = json!([material]);
    file.primitive()["material"] = 0.into();
    if let Some((width, texels)) = texels {
        let view = file.view(&png(width, texels), None);
        file.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        file.json["samplers"] = json!([{}]);
        file.json["textures"] = json!([{"source": 0, "sampler": 0}]);
    }
    file
}

#[track_caller]
fn assert_near(found: Vec3, due: impl Into<Vec3>) {
    let due = due.into();
    assert!((found - due).abs().max_element() < 1e-6, "{found}, not {due}");
}

#[test]
fn metallic_roughness_becomes_whitted() {
    let base = [0.8, 0.4, 0.2];
    let of = |metallic: f32, roughness: f32, more: Value| {
        let mut material = json!({"name": "m", "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": metallic, "roughnessFactor": roughness
        }});
        more.as_object().unwrap().iter().for_each(|(key, value)| material[key] = value.clone());
        let scene = painted(material, None).load();
        assert_eq!(scene.materials.len(), 1);
        (scene.materials[0].clone(), scene.warnings)
    };
    let (matt, warnings) = of(0.0, 1.0, json!({}));
    assert_eq!((matt.diffuse, matt.ambient, &matt.name[..]), (base.into(), base.into(), "m"));
    assert_eq!((matt.mirror, matt.specular, matt.transmission), (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO));
    assert!(warnings.is_empty());
    let (metal, _) = of(1.0, 0.0, json!({}));
    assert_eq!((metal.mirror, metal.diffuse), (base.into(), Vec3::ZERO));
    let (half, _) = of(1.0, 0.5, json!({}));
    assert_near(half.mirror, Vec3::from(base) / 4.0);
    assert_near(half.diffuse, Vec3::from(base) * 0.75);
    let (glossy, _) = of(0.0, 0.5, json!({}));
    assert_near(glossy.specular, [0.16; 3]);
    assert_eq!(glossy.shininess, 30.0);
    let (glass, warnings) = of(
        0.0,
        0.0,
        json!({"extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 0.75}, "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_volume": {"thicknessFactor": 1}
        }}),
    );
    assert_near(glass.transmission, Vec3::from(base) * 0.75);
    assert_near(glass.diffuse, Vec3::from(base) * 0.25);
    assert_eq!((glass.ior, warnings.len()), (1.33, 0));
    let (veil, _) =
        of(0.0, 1.0, json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}}));
    assert_eq!((veil.transmission, veil.ior), (Vec3::splat(0.75), 1.0));
    assert_near(veil.diffuse, [0.25; 3]);
    let (lamp, _) = of(
        0.0,
        1.0,
        json!({"emissiveFactor": [1, 0.5, 0], "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 8}
        }}),
    );
    assert_eq!(lamp.emission, Vec3::new(8.0, 4.0, 0.0));
    let (unlit, _) = of(0.0, 1.0, json!({"extensions": {"KHR_materials_unlit": {}}}));
    assert_eq!((unlit.emission, unlit.diffuse, unlit.ambient), (base.into(), Vec3::ZERO, Vec3::ZERO));
    let (gold, _) = of(
        0.0,
        1.0,
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.52, 0.04], "glossinessFactor": 1
        }}}),
    );
    assert_near(gold.mirror, [1.0, 0.5, 0.0]);
    // Numbers out of range.
    let (odd, _) = of(-3.0, 1e30, json!({"emissiveFactor": [-1, 1e38, 0], "alphaMode": "SOLID"}));
    assert_eq!((odd.diffuse, odd.emission), (base.into(), Vec3::new(0.0, 1e6, 0.0)));
    assert!(odd.transmission == Vec3::ZERO);
}

#[test]
fn textures_are_shown_or_summed_up() {
    let (black, white) = ([0, 0, 0, 255], [255, 255, 255, 255]);
    let texture = json!({"baseColorTexture": {"index": 0}, "metallicFactor": 0});
    let file = painted(json!({"pbrMetallicRoughness": texture}), Some((2, &[black, white])));
    let scene = file.load();
    assert_eq!(size_of_picture(&scene), (2, 1));
    assert_eq!((scene.materials[0].diffuse_texture, scene.materials[0].diffuse), (Some(0), Vec3::ONE));
    let uv = |scene: &Scene, corner: usize| scene.uvs[scene.triangles[0].uvs[corner] as usize];
    assert_eq!([0, 1, 2].map(|corner| uv(&scene, corner)), [Vec2::ZERO, Vec2::X, Vec2::ONE], "v is upwards here");

    // Scaled, turned by a quarter counter-clockwise, moved.
    let mut moved = painted(json!({"pbrMetallicRoughness": texture}), Some((2, &[black, white])));
    let transform = json!({"scale": [2, 3], "rotation": std::f32::consts::FRAC_PI_2, "offset": [0.5, 0]});
    moved.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({"KHR_texture_transform": transform});
    let scene = moved.load();
    // (1, 1) with v down becomes (2, 3), (3, -2), (3.5, -2); and -2 is 3 upwards.
    assert!((uv(&scene, 1) - Vec2::new(3.5, 3.0)).length() < 1e-6, "{}", uv(&scene, 1));

    // Another set of coordinates, by the texture or by the transform.
    for (set, is_of_transform) in [(1, false), (1, true)] {
        let mut file = painted(json!({"pbrMetallicRoughness": texture}), Some((2, &[black, white])));
        let other = file.floats("VEC2", &[0.25; 8]);
        file.primitive()["attributes"]["TEXCOORD_1"] = other.into();
        let info = &mut file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
        match is_of_transform {
            false => info["texCoord"] = set.into(),
            true => info["extensions"] = json!({"KHR_texture_transform": {"texCoord": set}}),
        }
        assert_eq!(uv(&file.load(), 0), Vec2::new(0.25, 0.75));
    }

    // Mirrored: with its mirror image beside it.
    let mut mirrored = painted(json!({"pbrMetallicRoughness": texture}), Some((2, &[black, white])));
    mirrored.json["samplers"][0] = json!({"wrapS": 33648, "wrapT": 33071});
    let scene = mirrored.load();
    assert_eq!(image_of(&scene, 0).rgba, [black, white, white, black]);
    assert_eq!(uv(&scene, 2), Vec2::new(0.5, 1.0));
    assert!(scene.warnings.is_empty());
    let leaving = mirrored.floats("VEC2", &[0.0, 2.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    mirrored.primitive()["attributes"]["TEXCOORD_0"] = leaving.into();
    assert_warned(&mirrored.load(), "not used: ends of textures (CLAMP_TO_EDGE): they repeat");

    // What is not shown by itself, by its mean.
    let material = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}, "normalTexture": {"index": 0},
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}});
    let scene = painted(material, Some((2, &[black, white]))).load();
    assert!(scene.textures.is_empty());
    assert_eq!(scene.materials[0].emission, Vec3::splat(0.5));
    // Half metallic, half rough.
    assert_near(scene.materials[0].mirror, [0.5 * 0.25; 3]);
    assert_eq!(scene.warnings.len(), 1);
    assert_warned(
        &scene,
        "not used: normal textures; only their mean is used: emissive textures, metallic-roughness textures",
    );
    // A texture of one colour is exactly that.
    let material = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}});
    let scene = painted(material, Some((2, &[white, white]))).load();
    assert_eq!((scene.materials[0].emission, scene.warnings.len()), (Vec3::ONE, 0));
}

#[test]
fn alpha_of_textures() {
    let texel = |alpha: u8| [255, 255, 255, alpha];
    let of = |mode: &str, cutoff: f32, alpha: [u8; 2]| {
        let pbr = json!({"baseColorTexture": {"index": 0}, "metallicFactor": 0});
        let material = json!({"alphaMode": mode, "alphaCutoff": cutoff, "pbrMetallicRoughness": pbr});
        painted(material, Some((2, &alpha.map(texel)))).try_load()
    };
    let scene = of("BLEND", 0.5, [51, 51]).unwrap();
    assert_near(scene.materials[0].transmission, [0.8; 3]);
    assert!(scene.warnings.is_empty());
    let scene = of("BLEND", 0.5, [0, 255]).unwrap();
    assert_near(scene.materials[0].transmission, [0.5; 3]);
    assert_warned(&scene, "only their mean is used: alpha of textures");
    for (mode, cutoff, alpha) in [("MASK", 0.5, [128, 255]), ("MASK", 0.0, [0, 0]), ("OPAQUE", 0.5, [0, 255])] {
        let scene = of(mode, cutoff, alpha).unwrap();
        assert_eq!((scene.materials[0].transmission, scene.warnings.len()), (Vec3::ZERO, 0), "{mode} {cutoff}");
    }
    assert_warned(&of("MASK", 0.5, [0, 255]).unwrap(), "alpha masks of textures");
    let fault = of("MASK", 0.9, [128, 0]).unwrap_err().to_string();
    assert!(fault.contains("has no triangles; not used: surfaces that their alpha mask hides"), "{fault}");
}

#[test]
fn unlit_textures_are_shown_by_ambient_light() {
    let unlit =
        json!({"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let mut file = painted(unlit, Some((2, &[[0, 0, 0, 255], [255; 4]])));
    let scene = file.load();
    let material = &scene.materials[0];
    assert_eq!((scene.ambient, material.ambient, material.diffuse), (Vec3::ONE, Vec3::ONE, Vec3::ZERO));
    let other = json!({"attributes": {"POSITION": 0}});
    file.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(other);
    let scene = file.load();
    assert_eq!((scene.ambient, scene.materials[0].diffuse), (Vec3::ZERO, Vec3::ONE));
    assert_warned(&scene, "unlit among lit materials: matt");
}

#[test]
fn colours_of_vertices() {
    let mut file = File::square();
    let colours = file.accessor(
        &[255, 0, 255, 255].repeat(4),
        json!({"componentType": 5121, "count": 4, "type": "VEC4", "normalized": true}),
    );
    file.primitive()["attributes"]["COLOR_0"] = colours.into();
    let scene = file.load();
    assert_eq!((scene.materials[0].diffuse, scene.warnings.len()), (Vec3::new(1.0, 0.0, 1.0), 0));
    let colours = file.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    file.primitive()["attributes"]["COLOR_0"] = colours.into();
    let scene = file.load();
    let of = |triangle: usize| scene.materials[scene.triangles[triangle].material as usize].diffuse;
    // Of three corners one is red; in 8 bits.
    assert!((of(0) - Vec3::X / 3.0).abs().max_element() < 1.0 / 255.0, "{}", of(0));
    assert_eq!((of(0), scene.warnings.len()), (of(1), 1));
    assert_warned(&scene, "a.GLB: each triangle has the mean colour of its corners: a triangle has one material");
    // One colour for each triangle, on a material.
    let corners = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0].repeat(2));
    let colours = file.floats("VEC4", &[[1.0, 1.0, 0.0, 1.0].repeat(3), [0.0, 1.0, 1.0, 0.4].repeat(3)].concat());
    *file.primitive() = json!({"attributes": {"POSITION": corners, "COLOR_0": colours}, "material": 0});
    file.json["materials"] = json!([{"alphaMode": "BLEND", "normalTexture": {"index": 0},
        "pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1]}}]);
    let scene = file.load();
    let of = |triangle: usize| &scene.materials[scene.triangles[triangle].material as usize];
    assert_eq!((of(0).diffuse, of(0).transmission), (Vec3::new(1.0, 0.5, 0.0), Vec3::ZERO));
    assert_near(of(1).transmission, [0.6; 3]);
    assert_eq!(scene.warnings.len(), 1);
    assert_warned(&scene, "not used: normal textures");
    assert!(!scene.warnings[0].contains('('), "told once: {}", scene.warnings[0]);
}

#[test]
fn cameras_and_lights() {
    let mut file = File::square();
    file.json["cameras"] = json!([
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 1, "znear": 0}},
        {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1, "aspectRatio": 2}},
    ]);
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1, 0.5, 0], "intensity": std::f32::consts::PI, "range": 9},
        {"type": "directional", "intensity": 2.0 * std::f32::consts::PI},
        {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
        {"type": "area"},
    ]}});
    let light = |number: usize| json!({"KHR_lights_punctual": {"light": number}});
    file.json["nodes"] = json!([
        {"children": [1, 2, 3, 4, 5, 6, 7], "translation": [0, 0, 4]},
        {"mesh": 0}, {"camera": 0}, {"camera": 1, "scale": [3, 3, 3]}, {"camera": 1},
        {"extensions": light(0)}, {"extensions": light(1), "rotation": [0, 1, 0, 0]},
        {"extensions": light(2), "children": [8, 9]}, {"extensions": light(3)}, {"extensions": light(7)},
    ]);
    let scene = file.load();
    let camera = scene.camera.unwrap();
    assert_eq!((camera.eye, camera.up), (Vec3::new(0.0, 0.0, 4.0), Vec3::Y));
    assert_eq!(camera.fov_degrees, 0.5f32.to_degrees());
    assert!((camera.target - camera.eye).normalize().z < -0.999);
    let [point, sun, spot] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_eq!(point.kind, LightKind::Point { position: Vec3::new(0.0, 0.0, 4.0) });
    assert_eq!((point.intensity, point.falloff), (Vec3::new(1.0, 0.5, 0.0), Falloff::Quadratic));
    assert_eq!((sun.kind, sun.intensity), (LightKind::Directional { direction: Vec3::Z }, Vec3::splat(2.0)));
    let LightKind::Spot { direction, inner_degrees, outer_degrees, .. } = spot.kind else { panic!("{spot:?}") };
    assert_eq!((direction, inner_degrees, outer_degrees), (Vec3::NEG_Z, 0.1f32.to_degrees(), 0.2f32.to_degrees()));
    let told =
        "not used: cameras that are not perspective, lights that make no sense (2), other cameras, ranges of lights";
    assert_warned(&scene, told);
}

#[test]
fn wrong_files_are_refused_with_what_is_wrong() {
    type Change = fn(&mut File);
    let changes: [(Change, &str); 22] = [
        (|f| f.json["scenes"][0]["nodes"] = json!([9]), "there is no node 9"),
        (|f| f.json["nodes"][0]["children"] = json!([0]), "node 0 has two parents or is its own ancestor"),
        (|f| f.json["scenes"][0]["nodes"] = json!([0, 0]), "node 0 has two parents"),
        (|f| f.json["nodes"][0]["mesh"] = 1.into(), "there is no mesh 1"),
        (|f| f.json["nodes"][0]["scale"] = json!([1e39, 1, 1]), "number out of range"),
        (
            |f| f.json["nodes"][0] = json!({"mesh": 0, "scale": [3e38, 1, 1], "translation": [3e38, 0, 0]}),
            "mesh 0 cannot be placed: the transform moves the vertex",
        ),
        (|f| f.primitive()["attributes"]["POSITION"] = 99.into(), "accessor 99 is named, but there is none"),
        (|f| f.primitive()["attributes"]["POSITION"] = 1.into(), "accessor 1 is of Vec2, but should have 3"),
        (|f| f.primitive()["indices"] = 0.into(), "accessor 0 is of F32 Vec3, which are no indices"),
        (|f| f.primitive()["indices"] = 99.into(), "accessor 99 is named"),
        (|f| f.primitive()["material"] = 3.into(), "there is no material 3"),
        (|f| f.primitive()["attributes"]["NORMAL"] = 3.into(), "accessor 3 is named"),
        (
            |f| f.json["accessors"][0]["count"] = 5.into(),
            "5 elements, which do not fit into the 48 bytes of bufferView 0",
        ),
        (|f| f.json["accessors"][0]["count"] = u64::MAX.into(), "18446744073709551615 elements"),
        (|f| f.json["accessors"][0]["byteOffset"] = u64::MAX.into(), "which do not fit"),
        (|f| f.json["accessors"][0]["componentType"] = 5124.into(), "components of no known type"),
        (|f| f.json["accessors"][0]["type"] = "VEC5".into(), "is of no known type"),
        (
            |f| f.json["bufferViews"][0]["byteStride"] = 8.into(),
            "elements of 12 bytes, but its bufferView has one every 8",
        ),
        (|f| f.json["bufferViews"][0]["byteOffset"] = u64::MAX.into(), "bufferView 0 reaches beyond its buffer"),
        (|f| f.json["bufferViews"][0]["buffer"] = 1.into(), "there is no buffer 1"),
        (|f| f.json["accessors"][0]["bufferView"] = 9.into(), "there is no bufferView 9"),
        (|f| f.json["accessors"][2] = json!({"componentType": 5121, "count": 6, "type": "SCALAR"}), "no bufferView"),
    ];
    for (change, part) in changes {
        let mut file = File::square();
        if part == "accessor 3 is named" {
            file.json["accessors"].as_array_mut().unwrap().truncate(3);
        }
        change(&mut file);
        let fault = file.fault();
        assert!(fault.contains("a.GLB: ") && fault.contains(part), "{fault}, not {part}");
    }
    // Nothing in any buffer: so many zeros are no mesh.
    let mut file = File::square();
    file.json["accessors"][0] = json!({"componentType": FLOAT, "count": 1u64 << 40, "type": "VEC3"});
    assert!(file.fault().contains("too many elements"));
}

#[test]
fn damaged_files_never_panic() {
    let mut file = painted(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}), Some((1, &[[9; 4]])));
    file.json["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 0, "scale": [2, 1, 1]}]);
    damage("glb", &file.glb());
    let mut small = File::square();
    small.json["accessors"][0]["sparse"] = json!({"count": 1, "indices": {"bufferView": 2, "componentType": 5121},
        "values": {"bufferView": 0}});
    damage("gltf", small.text("data:;base64,AAAA").as_bytes());
}

#[test]
fn every_malformed_file_behaves_as_listed() {
    let Some(table) = shared_scenes("malformed/expected.tsv") else { return };
    for (ending, least) in [(".gltf", 10), (".glb", 1)] {
        let checked = check_malformed(&table, ending);
        assert!(checked >= least, "{checked} rows of {ending}");
    }
}

#[test]
fn real_models_have_their_triangles() {
    for (name, triangles, instances, textures, low, high) in [
        ("BoxInterleaved.glb", 12, 0, 0, [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]),
        ("BoxTextured.glb", 12, 0, 1, [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]),
        ("BoxTextured.gltf", 12, 0, 1, [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]),
        ("CornellBox.glb", 36, 0, 0, [-556.0, 0.0, -559.2], [0.0, 548.8, 0.0001221]),
        ("CesiumMilkTruck.glb", 3624, 2, 1, [-2.431, 0.001452, -1.396], [2.438, 2.584, 1.396]),
        ("Duck.glb", 4212, 0, 1, [-0.693, 0.09929, -0.6133], [0.9618, 1.64, 0.5393]),
    ] {
        let Some(path) = shared_scenes(&format!("gltf/{name}")) else { continue };
        let scene = load(path).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_consistent(&scene, name);
        assert_eq!((scene.triangle_count(), scene.instances.placed().len()), (triangles, instances), "{name}");
        assert_eq!(scene.hittable().len(), triangles, "{name}");
        assert_eq!(scene.textures.len(), textures, "{name}");
        let (found_low, found_high) = scene.bounds().unwrap();
        let off = (found_low - Vec3::from(low)).abs().max((found_high - Vec3::from(high)).abs());
        assert!(off.max_element() < 1e-3 * Vec3::from(high).length(), "{name}: {found_low} {found_high}");
        assert_eq!(scene.camera.is_some(), name == "Duck.glb");
        assert_eq!(scene.warnings.len(), usize::from(name == "CesiumMilkTruck.glb"), "{name}: {:?}", scene.warnings);
    }
}
