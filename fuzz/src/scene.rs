//! What holds of every scene that was loaded.

use super::errors::{check_error, readable};
use super::folder::Folder;
use raybrook::low_level::options::{Structure, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{NO_INDEX, Samples, Scene, Texture, Triangle};
use raybrook::{Error, Result};
use std::sync::Arc;

/// Of scenes with more triangles no picture is made, which would take too long.
const PICTURE_TRIANGLES: usize = 1000;

/// The most warnings: fifty, and how many more there were, of a scene file and of a model that it names.
const WARNINGS: usize = 2 * 51;

/// The longest warning. It quotes up to sixteen names of 60 characters.
const WARNING_BYTES: usize = 8192;

/// Checks a scene that could be loaded, and the error of one that could not; whether it could.
pub fn check_loaded(result: Result<Scene>) -> bool {
    let Some(mut scene) = readable(result) else { return false };
    check_indices(&scene);
    check_numbers(&scene);
    assert!(scene.warnings.len() <= WARNINGS, "{} warnings", scene.warnings.len());
    assert!(scene.warnings.iter().all(|warning| warning.len() < WARNING_BYTES), "{:?}", scene.warnings);
    if scene.triangle_count() <= PICTURE_TRIANGLES {
        check_picture(&mut scene);
    }
    true
}

/// Every index refers to something.
fn check_indices(scene: &Scene) {
    let has = |index: u32, count: usize| (index as usize) < count;
    let materials = scene.materials.len();
    let check = |triangle: &Triangle, positions: usize, normals: usize, uvs: usize| {
        assert!(triangle.positions.iter().all(|&i| has(i, positions)), "{triangle:?}");
        assert!(triangle.normals.iter().all(|&i| i == NO_INDEX || has(i, normals)), "{triangle:?}");
        assert!(triangle.uvs.iter().all(|&i| i == NO_INDEX || has(i, uvs)), "{triangle:?}");
        assert!(has(triangle.material, materials), "{triangle:?}");
    };
    scene.triangles.iter().for_each(|t| check(t, scene.positions.len(), scene.normals.len(), scene.uvs.len()));
    let objects = scene.instances.objects();
    for object in objects {
        object.triangles.iter().for_each(|t| check(t, object.positions.len(), object.normals.len(), object.uvs.len()));
    }
    for instance in scene.instances.placed() {
        assert!(has(instance.object, objects.len()) && instance.material.is_none_or(|m| has(m, materials)));
    }
    assert_eq!(scene.triangle_count(), scene.triangles.len() + scene.instances.triangle_count());
    for material in &scene.materials {
        assert!(material.diffuse_texture.is_none_or(|texture| has(texture, scene.textures.len())), "{material:?}");
    }
}

/// Every number is one that can be traced and shaded with.
fn check_numbers(scene: &Scene) {
    scene.check_values().expect("loaders have checked what a scene may hold");
    for triangle in &scene.triangles {
        let normals = triangle.normals.iter().filter(|&&i| i != NO_INDEX);
        assert!(normals.clone().all(|&i| scene.normals[i as usize].is_finite()), "{triangle:?}");
        let uvs = triangle.uvs.iter().filter(|&&i| i != NO_INDEX);
        assert!(uvs.clone().all(|&i| scene.uvs[i as usize].is_finite()), "{triangle:?}");
    }
    for primitive in scene.hittable() {
        assert!(scene.vertices(primitive as usize).iter().all(|p| p.is_finite()), "triangle {primitive}");
    }
    if let Some((low, high)) = scene.bounds() {
        assert!(low.is_finite() && high.is_finite() && low.cmple(high).all());
    }
    for image in scene.textures.iter().filter_map(Texture::image) {
        assert_eq!(image.rgba.len(), image.width as usize * image.height as usize, "{}", image.name);
    }
}

/// A small picture of it has pixels that are numbers, or there is an error that says why there is none.
fn check_picture(scene: &mut Scene) {
    const SIZE: (u32, u32) = (4, 3);
    const DEPTH: u32 = 3;
    complete(scene, SIZE.0 as f32 / SIZE.1 as f32);
    let options = TraceOptions { structure: Structure::of(StructureKind::Bvh2), ..TraceOptions::DEFAULT };
    let buffers = match SceneBuffers::within(scene, &options, &Folder.budget()) {
        Ok(buffers) => Arc::new(buffers),
        Err(error) => return check_error(&error),
    };
    let camera = scene.camera.expect("a complete scene has one");
    let picture = Picture { camera, size: SIZE, samples: Samples::PerPixel(1), depth: DEPTH, kill_weight: None };
    let tracer = open_tracer(None, &buffers, &options, DEPTH, None);
    let rendered = tracer.and_then(|mut tracer| render(tracer.as_mut(), &buffers, &picture, &|_| ()));
    match rendered {
        Ok(rendered) => assert_eq!(rendered.film.non_finite(), 0, "pixels that are no numbers"),
        Err(error @ Error::Option { .. }) => panic!("the options go together: {error}"),
        Err(error) => check_error(&error),
    }
}
