//! Haines' NFF: what becomes of each entity, and files that are wrong or hostile.

use crate::common::{Random, SEED, shared};
use glam::Vec3;
use raybrook::low_level::scene::{DropReason, Falloff, Light, LightKind, NO_INDEX, Scene, load};
use std::collections::HashMap;

/// Loads `text` as an NFF file.
fn load_text(text: impl AsRef<[u8]>) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nff");
    std::fs::write(&path, text).unwrap();
    load(path)
}

fn scene(text: &str) -> Scene {
    load_text(text).unwrap_or_else(|e| panic!("{e}\nof\n{text}"))
}

/// The fault of `text`, after the file's name.
#[track_caller]
fn fault(text: &str) -> String {
    let error = load_text(text).expect_err(text).to_string();
    error.split_once("a.nff").expect("a message with the file's name").1.to_owned()
}

#[track_caller]
fn assert_warned(scene: &Scene, parts: &[&str]) {
    let found = scene.warnings.iter().any(|warning| parts.iter().all(|part| warning.contains(part)));
    assert!(found, "no warning has {parts:?}: {:#?}", scene.warnings);
}

const VIEW: &str = "v\nfrom 1 2 3.5\nat 0 0 0\nup 0 0 1\nangle 45\nhither 1\nresolution 512 256\n";
const TRIANGLE: &str = "p 3\n0 0 0\n1 0 0\n0 1 0\n";

#[test]
fn view_background_and_lights_are_as_given() {
    let full = scene(&format!("b 0.1 0.2 0.3\n{VIEW}l 2 4 4\nl -2 4 3 0.5 0.25 0\nl 0 0 1e3\nl 1 1 1\n{TRIANGLE}"));
    let camera = full.camera.unwrap();
    assert_eq!((camera.eye, camera.target, camera.up), (Vec3::new(1.0, 2.0, 3.5), Vec3::ZERO, Vec3::Z));
    assert_eq!((camera.fov_degrees, full.picture.size), (45.0, Some((512, 256))));
    assert_eq!((full.background.bottom, full.background.top), (Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.1, 0.2, 0.3)));
    // Four lights: those without a colour have 1 / sqrt(4).
    let light = |position: [f32; 3], intensity: [f32; 3]| Light::point(position.into(), intensity.into());
    let expected = [
        light([2.0, 4.0, 4.0], [0.5; 3]),
        light([-2.0, 4.0, 3.0], [0.5, 0.25, 0.0]),
        light([0.0, 0.0, 1e3], [0.5; 3]),
        light([1.0; 3], [0.5; 3]),
    ];
    assert_eq!(full.lights, expected);
    assert!(full.lights.iter().all(|l| l.falloff == Falloff::None && matches!(l.kind, LightKind::Point { .. })));
    assert_eq!((full.ambient, full.warnings.len()), (Vec3::ZERO, 0), "{:?}", full.warnings);

    let bare = scene(TRIANGLE);
    assert!(bare.camera.is_none() && bare.lights.is_empty() && bare.picture.size.is_none());
    assert_eq!(bare.background.top, Vec3::ZERO);
}

#[test]
fn looks_follow_the_standard_databases() {
    let text = format!(
        "{TRIANGLE}f 1 0.5 0.25 0.8 0.3 12 0 0\n{TRIANGLE}f 1 1 1 0.2 0 100000 0.8 1.1\n{TRIANGLE}\
         f 1 0.5 0.25 0.8 0.3 12 0 0\n{TRIANGLE}"
    );
    let scene = scene(&text);
    let used: Vec<_> = scene.triangles.iter().map(|t| &scene.materials[t.material as usize]).collect();
    assert_eq!((scene.materials.len(), used.len()), (3, 4), "equal looks are one material");
    assert_eq!(used[0].diffuse, Vec3::splat(0.8), "before any f");
    assert_eq!(used[1], used[3]);
    let (opaque, glass) = (used[1], used[2]);
    assert_eq!((opaque.diffuse, opaque.ambient), (Vec3::new(0.8, 0.4, 0.2), Vec3::new(0.8, 0.4, 0.2)));
    assert_eq!((opaque.specular, opaque.mirror, opaque.shininess), (Vec3::splat(0.3), Vec3::splat(0.3), 12.0));
    assert!(!opaque.is_transparent() && opaque.ior == 1.0);
    assert_eq!((glass.transmission, glass.ior, glass.mirror), (Vec3::splat(0.8), 1.1, Vec3::ZERO));
    assert_eq!(glass.shininess, 10_000.0);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn polygons_and_patches_become_triangles() {
    // Comments, line breaks and blanks anywhere; an arrow, a bent quad, and a patch.
    let text = "\u{feff}# made by hand\r\np 4 -1 -1 0 # tip\r\n 0 0\n0 1 -1 0 0 1 0\rp\n4\n0 0 0\n1 0 0\n1 1 0.5\n\
                0 1 0\n\
                pp 3\n0 0 0 0 0 2\n1 0 0 0.6 0 0.8\n0 1 0 0 0 0\n";
    let scene = scene(text);
    assert_eq!(scene.triangles.len(), 2 + 2 + 1);
    let area = |i: usize| {
        let [a, b, c] = scene.vertices(i);
        (b - a).cross(c - a) / 2.0
    };
    assert_eq!(area(0) + area(1), Vec3::Z, "the arrow covers 1 and faces up");
    assert!(area(0).z > 0.0 && area(1).z > 0.0, "no part of it is covered twice");
    assert!(scene.triangles[..4].iter().all(|t| t.normals == [NO_INDEX; 3]));
    let normals = scene.triangles[4].normals.map(|n| scene.normals[n as usize]);
    assert_eq!(normals, [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::ZERO]);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

/// How often each edge is run through, less its runs in the other direction; vertices by their bits.
fn open_edges(scene: &Scene) -> usize {
    let mut runs: HashMap<_, i32> = HashMap::new();
    for primitive in 0..scene.triangles.len() {
        let corners = scene.vertices(primitive).map(|p| p.to_array().map(f32::to_bits));
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            *runs.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    runs.values().filter(|&&run| run != 0).count()
}

#[test]
fn spheres_and_cones_stand_where_they_should() {
    let ball = scene("s 3 -2 1 0.5\n");
    assert!(ball.positions.iter().all(|p| (p.distance(Vec3::new(3.0, -2.0, 1.0)) - 0.5).abs() < 1e-6));
    assert_eq!((ball.triangles.len(), open_edges(&ball)), (2 * 64 * 31, 0));

    let (base, apex) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 5.0, 9.0));
    let axis = (apex - base).normalize();
    for (base_radius, apex_radius, triangles) in [(1.0, 0.25, 128), (0.5, 0.5, 128), (2.0, 0.0, 64), (0.0, 2.0, 64)] {
        let cone = scene(&format!("c 1 2 3 {base_radius}\n-1 5 9 {apex_radius}\n"));
        assert_eq!(cone.triangles.len(), triangles, "open at both ends");
        for p in &cone.positions {
            let along = (*p - base).dot(axis) / (apex - base).length();
            let away = (*p - base - (*p - base).dot(axis) * axis).length();
            assert!(along.abs() < 1e-6 || (along - 1.0).abs() < 1e-6, "{p} is {along} along");
            let radius = if along < 0.5 { base_radius } else { apex_radius };
            assert!((away - radius).abs() < 2e-6, "{p} is {away} away, not {radius}");
        }
        // Outwards: the normal leads away from the axis.
        let [a, b, c] = cone.vertices(0);
        let middle = (a + b + c) / 3.0 - base;
        assert!((b - a).cross(c - a).dot(middle - middle.dot(axis) * axis) > 0.0);
        let smooth = cone.triangles.iter().all(|t| t.normals.iter().all(|&n| n != NO_INDEX));
        assert!(smooth && cone.warnings.is_empty(), "{:?}", cone.warnings);
    }
}

#[test]
fn many_solids_become_coarser_and_too_many_are_refused() {
    let many = scene(&"s 0 0 0 1\n".repeat(20_000));
    assert_eq!(many.triangles.len(), 20_000 * 2 * 14 * 6);
    assert_warned(&many, &["20000 spheres", "made of 14 segments each, not 64", "4194304 triangles"]);
    let message = fault(&"c 0 0 0 1 0 0 1 1\n".repeat(65_537));
    assert!(message.contains("has 65537 spheres, cones and cylinders; the most is 65536"), "{message}");
}

#[test]
fn faults_name_their_line() {
    let view = |from: &str, to: &str| format!("{}{TRIANGLE}", VIEW.replace(from, to));
    let huge = "p 99999999999999999999\n0 0 0\n".to_owned();
    let cases: [(String, &str, &str); 26] = [
        (String::new(), ": ", "has no objects"),
        (format!("{VIEW}f 1 1 1 1 0 0 0 0\nl 0 0 0\n"), ": ", "has no objects"),
        ("p 2\n0 0 0\n1 1 1\n".into(), ": ", "has no objects"),
        ("p 3\n0 0 0\n1 0 0\n".into(), ":3: ", "the file ends where vertex 3 of 3 should be"),
        ("p 3\n0 0 0\n1 0 0\n0 1\np 3\n".into(), ":5: ", "vertex 3 of 3 should be a number, not 'p'"),
        ("pp 3\n0 0 0 0 0 1\n1 0 0 0 0\n".into(), ":3: ", "normal 2 of 3"),
        ("p 3\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n".into(), ":5: ", "the number '1' belongs to nothing"),
        ("# p\np 3,5\n".into(), ":2: ", "decimals take a point"),
        ("p 3\n0 0,5 0\n".into(), ":2: ", "'0,5'; decimals take a point, not a comma"),
        (
            "p 2.5\n".into(),
            ":1: ",
            "the number of vertices of a polygon is 2.5; it must be a whole number from 0 to 65536",
        ),
        ("p -3\n".into(), ":1: ", "is -3"),
        ("p nan\n".into(), ":1: ", "is NaN"),
        (huge, ":1: ", "is 100000000000000000000; it must"),
        ("p 65537\n".into(), ":1: ", "is 65537; it must"),
        ("\n\ns 1 2 3\n".into(), ":3: ", "the file ends where the radius of a sphere should be"),
        ("c 1 2 3 4 5\n".into(), ":1: ", "the apex of a cone"),
        ("l 1 2\n".into(), ":1: ", "the position of a light"),
        ("l 1 2 nan\n".into(), ":1: ", "light: position"),
        ("l 1 2 3 4\nb 0 0 0\n".into(), ":2: ", "green of a light should be a number, not 'b'"),
        ("l 1 2 3 4 -5 6\n".into(), ":1: ", "light: intensity"),
        (view("at 0 0 0\n", ""), ":1: ", "the view has no 'at'"),
        (view("at 0 0 0", "at 1 2 3.5"), ":3: ", "'at' is the eye's own place"),
        (view("up 0 0 1", "up 1 2 3.5"), ":4: ", "'up' is parallel to the view"),
        (view("angle 45", "angle 180"), ":5: ", "'angle' is 180"),
        (view("from 1", "from inf"), ":2: ", "'from' is [inf, 2, 3.5]; it must be finite"),
        (view("512", "0"), ":7: ", "'resolution' is 0; it must be a whole number from 1 to 65535"),
    ];
    for (text, place, part) in cases {
        let message = fault(&text);
        assert!(message.starts_with(place) && message.contains(part), "{message:?} for {text:?}");
    }
    let utf16 = load_text(b"\xff\xfep\0 \x003\0").unwrap_err().to_string();
    assert!(utf16.contains("UTF-16"), "{utf16}");
    let binary = load_text(b"p 3\n\0\0\0").unwrap_err().to_string();
    assert!(binary.contains("NUL"), "{binary}");
}

#[test]
fn what_is_left_out_is_warned_of() {
    let left_out = scene(&format!(
        "fm 1 2 3\nfm 4 5 6\n7 8\nkfa name\n{TRIANGLE}p 3\n0 0 0\nnan 0 0\n0 1e39 0\np 3\n0 0 0\n1 1 1\n2 2 2\n\
         p 1 0 0 0\np 0\n\
         s 0 0 0 0\ns 0 nan 0 1\nc 0 0 0 1 0 0 0 1\nc 0 0 0 0 0 0 1 0\n"
    ));
    assert_eq!((left_out.triangles.len(), left_out.hittable().len()), (3, 1));
    let reasons = [1, 2].map(|i| left_out.drop_reason(i).unwrap());
    assert_eq!(reasons, [DropReason::NotFinite, DropReason::ZeroArea]);
    assert_warned(&left_out, &["a.nff:1:", "'fm' is not supported and ignored (statements: 2)"]);
    assert_warned(&left_out, &["a.nff:4:", "'kfa' is not supported"]);
    assert_warned(&left_out, &["with NaN or infinite vertices left out: 1"]);
    assert_warned(&left_out, &["without area left out: 1"]);
    assert_warned(&left_out, &["a.nff:17:", "fewer than three vertices ignored: 2"]);
    assert_warned(&left_out, &["a.nff:19:", "without size, or with NaN or infinite numbers, ignored: 4"]);

    let negative = scene("s 0 0 0 -1\n");
    assert_eq!(negative.triangles.len(), 2 * 64 * 31);
    assert_warned(&negative, &["a.nff:1:", "negative radii"]);
}

#[test]
fn looks_without_sense_are_left_out_or_clamped() {
    let default = scene(TRIANGLE).materials;
    for (looks, part) in [
        ("f 1 1 1 0.5 0.5 nan 0 0", "has NaN, not a number from 0, and is ignored"),
        ("f 1 -1 1 0.5 0.5 1 0 0", "has -1, not"),
        ("f 1 1 1 inf 0.5 1 0 0", "has inf, not"),
        ("f 1 1 1 0.5", "'f' has 4 numbers, not 8, and is ignored"),
    ] {
        let scene = scene(&format!("{looks}\n{TRIANGLE}"));
        assert_eq!(scene.materials, default, "{looks}");
        assert_warned(&scene, &["a.nff:1: ", part]);
    }
    let bright = scene(&format!("f 2 1 0.5 0.9 3 1 7 1.5\n{TRIANGLE}"));
    let material = &bright.materials[0];
    assert_eq!((material.diffuse, material.specular), (Vec3::new(1.0, 0.9, 0.45), Vec3::ONE));
    assert_eq!((material.mirror, material.transmission, material.ior), (Vec3::ONE, Vec3::ONE, 1.5));
    assert_warned(&bright, &["a.nff:1: ", "more than 1, which is taken instead"]);
    let no_ior = scene(&format!("f 1 1 1 0 0 0 0.5 0\n{TRIANGLE}"));
    assert_eq!(no_ior.materials[0].ior, 1.0);
    assert_warned(&no_ior, &["a.nff:1: ", "ior is 0"]);
    let background = scene(&format!("b 1 2\n{TRIANGLE}"));
    assert_eq!(background.background.top, Vec3::ZERO);
    assert_warned(&background, &["a.nff:1: ", "'b' has 2 numbers, not 3"]);
}

#[test]
fn more_materials_than_are_kept_are_told() {
    let looks: String = (0..65_540).map(|i| format!("f {} 0 0 1 0 0 0 0\n", i as f32 / 65_540.0)).collect();
    let scene = scene(&format!("{looks}{TRIANGLE}"));
    assert_eq!(scene.materials.len(), 65_536);
    assert_warned(&scene, &["a.nff:65537: ", "new looks ignored after the most that are kept: 4"]);
}

/// Loading must end in a scene or a message, whatever stands in the file.
#[test]
fn damaged_files_end_in_a_message_or_a_scene() {
    let whole = format!(
        "{VIEW}l 0 0 9\nf 1 0 0 0.5 0.5 9 0.5 1.5\n{TRIANGLE}s 0 0 0 1\nc 0 0 0 1 0 0 1 0\n\
         pp 3 0 0 0 0 0 1 1 0 0 0 0 1 1 1 0 0 0 1\n"
    );
    let words = [
        "p",
        "pp",
        "s",
        "c",
        "f",
        "l",
        "b",
        "v",
        "#",
        "\n",
        "-1",
        "nan",
        "inf",
        "1e39",
        "4294967297",
        "\\",
        "\u{fffd}",
    ];
    let mut random = Random::new(SEED);
    let mut loaded = 0;
    for _ in 0..2000 {
        let mut text = whole.clone().into_bytes();
        for _ in 0..1 + random.bits() % 4 {
            let at = random.bits() as usize % text.len();
            match random.bits() % 4 {
                0 => text[at] = random.bits() as u8,
                1 => text.truncate(at + 1),
                2 => drop(text.drain(at..(at + 1 + random.bits() as usize % 9).min(text.len()))),
                _ => {
                    let word = format!(" {} ", words[random.bits() as usize % words.len()]);
                    text.splice(at..at, word.into_bytes());
                }
            }
            if text.is_empty() {
                break;
            }
        }
        if let Ok(scene) = load_text(&text) {
            loaded += 1;
            assert!(scene.triangles.iter().all(|t| t.positions.iter().all(|&i| (i as usize) < scene.positions.len())));
            assert!(scene.triangles.iter().all(|t| (t.material as usize) < scene.materials.len()));
        }
    }
    assert!(
        (100..1900).contains(&loaded),
        "{loaded} of 2000 loaded: the damage is too small or too large to tell anything"
    );
}

#[test]
fn scene_files_take_geometry_and_materials() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("a.nff"), format!("b 1 0 0\n{VIEW}l 1 1 1\nf 1 0 0 1 0 0 0 0\n{TRIANGLE}")).unwrap();
    let toml = "[material.blue]\ndiffuse = [0, 0, 1]\n[[object]]\nfile = \"a.nff\"\n[[object]]\nfile = \"a.nff\"\n\
                material = \"blue\"\n";
    std::fs::write(at.join("a.toml"), toml).unwrap();
    let scene = load(at.join("a.toml")).unwrap();
    let colours = scene.triangles.iter().map(|t| scene.materials[t.material as usize].diffuse);
    assert_eq!(colours.collect::<Vec<_>>(), [Vec3::X, Vec3::Z]);
    assert!(scene.camera.is_none() && scene.lights.is_empty() && scene.background == Default::default());
}

#[test]
fn the_standard_databases_load_whole() {
    for (name, triangles, materials, lights) in [("tetra", 4096, 1, 1), ("gears", 36_610, 63, 5)] {
        let Some(path) = shared(&format!("spd/{name}.nff")) else { return };
        let scene = load(path).unwrap();
        assert_eq!((scene.triangles.len(), scene.hittable().len()), (triangles, triangles), "{name}");
        assert_eq!((scene.materials.len(), scene.lights.len()), (materials, lights), "{name}");
        assert_eq!((scene.picture.size, scene.warnings.len()), (Some((512, 512)), 0), "{name}: {:?}", scene.warnings);
    }
}
