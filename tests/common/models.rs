//! What the tests of the model loaders share: the tables of the shared models, and what every loaded scene obeys.

use super::shared;
use raybrook::low_level::scene::{DropReason, Image, NO_INDEX, Scene, load};
use std::path::{Path, PathBuf};

/// A path under the shared scenes, or `None`, with the reason printed, where they are not.
pub fn shared_scenes(path: &str) -> Option<PathBuf> {
    shared(&format!("scenes/{path}"))
}

/// The rows of an `expected.tsv`: file and expectation.
pub fn rows(table: &Path) -> Vec<(String, String)> {
    let text = std::fs::read_to_string(table).unwrap();
    let cells = |line: &str| line.split('\t').map(str::to_owned).collect::<Vec<_>>();
    text.lines().skip(1).map(cells).map(|c| (c[0].clone(), c[1].clone())).collect()
}

/// The area of all triangles.
pub fn total_area(scene: &Scene) -> f64 {
    let area = |primitive| {
        let [a, b, c] = scene.vertices(primitive).map(|p| p.as_dvec3());
        (b - a).cross(c - a).length() / 2.0
    };
    (0..scene.triangles.len()).map(area).sum()
}

/// How many triangles have a corner that is not finite.
pub fn not_finite(scene: &Scene) -> usize {
    (0..scene.triangles.len()).filter(|&i| scene.drop_reason(i) == Some(DropReason::NotFinite)).count()
}

/// A texture of a model, which is always a picture.
pub fn image_of(scene: &Scene, texture: usize) -> &Image {
    scene.textures[texture].image().expect("a picture")
}

/// The size of the first texture.
pub fn size_of_picture(scene: &Scene) -> (u32, u32) {
    (image_of(scene, 0).width, image_of(scene, 0).height)
}

/// Every index of `scene` refers to something, and every material is one that can be shaded.
pub fn assert_consistent(scene: &Scene, name: &str) {
    for t in &scene.triangles {
        assert!(t.positions.iter().all(|&i| (i as usize) < scene.positions.len()), "{name}");
        assert!(t.normals.iter().all(|&i| i == NO_INDEX || scene.normals[i as usize].is_finite()), "{name}");
        assert!(t.uvs.iter().all(|&i| i == NO_INDEX || scene.uvs[i as usize].is_finite()), "{name}");
        assert!((t.material as usize) < scene.materials.len(), "{name}");
    }
    for m in &scene.materials {
        assert!(m.diffuse_texture.is_none_or(|t| (t as usize) < scene.textures.len()), "{name}");
        for colour in [m.ambient, m.diffuse, m.specular, m.mirror, m.transmission, m.emission] {
            assert!(colour.is_finite() && colour.min_element() >= 0.0, "{name}: {m:?}");
        }
        for colour in [m.ambient, m.diffuse, m.specular, m.mirror, m.transmission] {
            assert!(colour.max_element() <= 1.0, "{name}: {m:?}");
        }
    }
    for i in 0..scene.textures.len() {
        let t = image_of(scene, i);
        assert_eq!(t.rgba.len(), (t.width * t.height) as usize, "{name}");
    }
}

/// One of the warnings has `part` in it.
#[track_caller]
pub fn assert_warned(scene: &Scene, part: &str) {
    assert!(scene.warnings.iter().any(|w| w.contains(part)), "no warning has {part:?}: {:#?}", scene.warnings);
}

/// Loads every file of the shared `malformed/` with `ending` and holds it against the table there; returns how many
/// there are.
pub fn check_malformed(table: &Path, ending: &str) -> usize {
    let rows = rows(table).into_iter().filter(|(name, _)| name.ends_with(ending));
    rows.map(|(name, expected)| {
        let started = std::time::Instant::now();
        let loaded = load(table.with_file_name(&name));
        assert!(started.elapsed().as_secs() < 10, "{name} took {:?}", started.elapsed());
        let only_error = expected.starts_with("error") && !expected.contains(" or ");
        match loaded {
            Err(error) => {
                let may_fail = ["error", "outside", "no crash"].iter().any(|part| expected.contains(part));
                assert!(may_fail, "{name}: {error}, but {expected}");
                assert!(error.to_string().contains(name.as_str()), "{name}: {error}");
                assert_eq!(error.exit_code(), 3, "{name}");
            }
            Ok(scene) => {
                assert!(!only_error, "{name} loaded, but {expected}");
                assert_consistent(&scene, &name);
                if let Some((_, count)) = expected.split_once("ok ") {
                    let count: usize = count.split(' ').next().unwrap().parse().unwrap();
                    assert_eq!(scene.triangle_count(), count, "{name}");
                }
                if expected.contains("drop") {
                    assert!(not_finite(&scene) > 0, "{name}");
                    assert_warned(&scene, "NaN or infinite");
                }
                if expected.contains("untextured") || expected.contains("outside") {
                    assert!(scene.textures.is_empty(), "{name}");
                    assert_warned(&scene, if name.starts_with("mtl_") { "outside the scene" } else { "texture '" });
                }
            }
        }
    })
    .count()
}

/// Loads `file`, under its own name's ending, cut after each byte and with each byte changed in several ways: whatever
/// comes of it, nothing panics, errors name the file, and scenes are whole.
pub fn damage(ending: &str, file: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("damaged.{ending}"));
    let try_to_load = |bytes: &[u8], what: &str| {
        std::fs::write(&path, bytes).unwrap();
        let loaded = load(&path);
        std::fs::remove_file(&path).unwrap(); // some file systems wait for the disk when a file is written over
        match loaded {
            Ok(scene) => assert_consistent(&scene, what),
            Err(error) => assert!(error.to_string().contains("damaged."), "{what}: {error}"),
        }
    };
    for length in 0..file.len() {
        try_to_load(&file[..length], &format!("the first {length} bytes"));
    }
    for place in 0..file.len() {
        for flip in [0x01, 0x10, 0x80, 0xff, file[place], file[place] ^ b'9', file[place] ^ b'\n'] {
            let mut changed = file.to_vec();
            changed[place] ^= flip;
            try_to_load(&changed, &format!("byte {place} is {}", changed[place]));
        }
    }
}
