//! The judge of pictures (`raybrook check --truth`): what is right passes, and every mistake is found.

use crate::features::{lacking, scene_of, with};
use glam::{DAffine3, DVec3, Vec3};
use raybrook::low_level::features::Features;
use raybrook::low_level::options::{
    Intersector, KdOptions, PictureOptions, StructureKind, Terminator, TextureFilter, TraceOptions, Traversal,
};
use raybrook::low_level::pack::{SceneBuffers, sample_positions};
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{
    Builder, Camera, Image, Light, LightKind, Material, Pattern, Procedural, Samples, Scene, Texture, TextureSpace,
    Toon,
};
use raybrook::low_level::shared::Feature;
use raybrook_lab::truth::{PictureVerdict, RayVerdicts, SampledRays, Truth, judge_picture, judge_rays};
use std::sync::Arc;

const DEPTH: u32 = 5;
const SIZE: (u32, u32) = (32, 24);

fn picture_of(scene: &Scene) -> Picture {
    let camera = scene.camera.expect("every scene here has a camera");
    Picture { camera, size: SIZE, samples: Samples::PerPixel(1), depth: DEPTH, kill_weight: None }
}

/// What the judge of `scene` says to the picture and the rays that the reference makes of `shown`.
fn judged_as(
    scene: &Scene,
    asked: &TraceOptions,
    shown: &Scene,
    options: &TraceOptions,
) -> (PictureVerdict, RayVerdicts) {
    let buffers = Arc::new(SceneBuffers::new(shown, options).unwrap());
    let mut tracer = open_tracer(None, &buffers, options, DEPTH, None).unwrap();
    let picture = picture_of(shown);
    let film = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap().film;
    let params = buffers.render_params(&picture.camera, SIZE, picture.samples, DEPTH, None);
    let places = sample_positions(picture.samples);
    let truth = Truth::new(scene, asked, picture_of(scene), places, params.kill_weight).unwrap();
    let sampled = SampledRays::new(&truth, &params, picture.camera.eye, (0.5, 0.5), 100);
    let rays = judge_rays(scene, &buffers, options, tracer.as_mut(), (sampled, 100), &|_| ()).unwrap();
    (judge_picture(&truth, &film, &|_| ()).0, rays)
}

/// The same of a picture that is made as it is judged.
fn judged(scene: &Scene, options: &TraceOptions) -> (PictureVerdict, RayVerdicts) {
    judged_as(scene, options, scene, options)
}

fn assert_right(what: &str, (picture, rays): (PictureVerdict, RayVerdicts)) {
    assert_eq!(picture.wrong, 0, "{what}: {picture:?}");
    assert_eq!(rays.wrong(), 0, "{what}: {rays:?}");
    assert_eq!(picture.pixels, picture.equal + picture.rounded + picture.edge);
    // What is let off because a ray may have gone the other way is little, or the judge would be blind.
    assert!(picture.edge * 10 < picture.pixels, "{what}: {picture:?}");
    assert!(rays.strict && rays.kinds.iter().all(|kind| kind.t_ulp.unwrap_or(0) == 0), "{what}: {rays:?}");
}

#[test]
fn scenes_of_every_feature_are_right() {
    for &feature in Feature::ALL {
        assert_right(&format!("with {feature}"), judged(&scene_of(with(feature)), &TraceOptions::DEFAULT));
        assert_right(&format!("without {feature}"), judged(&scene_of(lacking(feature)), &TraceOptions::DEFAULT));
    }
    assert_right("all", judged(&scene_of(Features::ALL), &TraceOptions::of(StructureKind::Bvh8)));
}

/// A ball before a floor that has `texture`, whose coordinates go from 0 to 3.
fn textured(texture: impl Into<Texture>) -> Scene {
    let mut builder = Builder::new();
    let id = builder.add_texture(texture);
    builder.material(Material { diffuse_texture: Some(id), ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-4.0, -1.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 1);
    builder.material(Material {
        diffuse_texture: Some(id),
        specular: Vec3::splat(0.4),
        shininess: 60.0,
        ..Material::matt(Vec3::ONE)
    });
    builder.sphere(1.0, 24);
    builder.light(Light::directional(Vec3::new(-0.5, -1.0, -0.4), Vec3::ONE));
    builder.camera(Camera { eye: Vec3::new(0.6, 1.4, 4.6), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 45.0 });
    builder.finish().unwrap()
}

fn image() -> Image {
    let texel = |i: u32| [(i * 37 % 256) as u8, (i * 101 % 256) as u8, (i * i * 13 % 256) as u8, 255];
    Image { name: "made".to_owned(), width: 24, height: 15, rgba: (0..24 * 15).map(texel).collect() }
}

fn pattern(pattern: Pattern) -> Procedural {
    let transform = DAffine3::from_rotation_z(0.3) * DAffine3::from_scale(DVec3::splat(0.37));
    Procedural { transform, seed: 5, ..Procedural::new(pattern) }
}

#[test]
fn textures_and_patterns_are_right() {
    for pattern in Pattern::ALL.map(pattern) {
        assert_right(pattern.pattern.name(), judged(&textured(pattern.clone()), &TraceOptions::DEFAULT));
        let in_uv = Procedural { space: TextureSpace::Uv, ..pattern };
        assert_right("in texture coordinates", judged(&textured(in_uv), &TraceOptions::DEFAULT));
    }
    for texture_filter in [TextureFilter::Footprint, TextureFilter::Bilinear] {
        let picture = PictureOptions { texture_filter, ..PictureOptions::DEFAULT };
        assert_right("image", judged(&textured(image()), &TraceOptions { picture, ..TraceOptions::DEFAULT }));
    }
}

#[test]
fn shadows_that_start_on_the_triangle_are_right() {
    let picture = PictureOptions { terminator: Terminator::Hard, ..PictureOptions::DEFAULT };
    let scene = scene_of(Features::ALL);
    assert_right("hard", judged(&scene, &TraceOptions { picture, ..TraceOptions::DEFAULT }));
}

#[test]
fn instances_and_triangles_in_the_same_place_are_right() {
    let mut builder = Builder::new();
    let mirror = Material { mirror: Vec3::splat(0.6), ..Material::matt(Vec3::new(0.8, 0.5, 0.2)) };
    let glass = builder.add_material(Material { transmission: Vec3::splat(0.9), ior: 1.3, ..Material::default() });
    builder.material(mirror);
    let object = builder.begin_object().sphere(0.6, 12).cuboid(Vec3::new(0.2, 2.0, 0.2)).end_object();
    builder.push().translate(Vec3::X * 1.2).rotate(Vec3::Z, 30.0).instance(object, None).pop();
    builder.push().translate(Vec3::X * -0.8).scale(Vec3::new(-1.0, 0.7, 1.2)).instance(object, Some(glass)).pop();
    for _ in 0..2 {
        builder.quad(Vec3::new(-4.0, -1.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 2);
    }
    builder.light(Light::point(Vec3::new(1.0, 4.0, 2.0), Vec3::ONE));
    builder.camera(Camera { eye: Vec3::new(0.6, 1.4, 4.6), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 45.0 });
    let scene = builder.finish().unwrap();
    for structure in [StructureKind::Instances, StructureKind::Bvh2] {
        assert_right(structure.name(), judged(&scene, &TraceOptions::of(structure)));
    }
}

/// Pixels of the picture of `shown` that are wrong for the judge of `scene`.
fn wrong_pixels(scene: &Scene, shown: &Scene) -> usize {
    judged_as(scene, &TraceOptions::DEFAULT, shown, &TraceOptions::DEFAULT).0.wrong
}

/// Changes a scene.
type Change = fn(&mut Scene);

#[test]
fn every_mistake_in_shading_is_found() {
    // A cartoon's highlight hides small changes of its strength.
    let (smooth, cartoon) = (scene_of(lacking(Feature::Toon)), scene_of(Features::ALL));
    let changes: [(&str, Change); 18] = [
        ("shininess", |s| s.materials.iter_mut().for_each(|m| m.shininess *= 1.01)),
        ("specular", |s| s.materials.iter_mut().for_each(|m| m.specular *= 1.001)),
        ("diffuse", |s| s.materials.iter_mut().for_each(|m| m.diffuse *= 1.0001)),
        ("ambient", |s| s.ambient *= 1.0001),
        ("mirror", |s| s.materials.iter_mut().for_each(|m| m.mirror *= 0.999)),
        ("transmission", |s| s.materials.iter_mut().for_each(|m| m.transmission *= 0.999)),
        ("ior", |s| s.materials.iter_mut().for_each(|m| m.ior *= 1.001)),
        ("toon", |s| s.materials.iter_mut().filter(|m| m.toon.is_some()).for_each(|m| m.toon = Some(Toon::new(4)))),
        ("light", |s| s.lights[0].intensity *= 1.0001),
        ("its place", |s| {
            if let LightKind::Spot { position, .. } = &mut s.lights[0].kind {
                position.x += 0.001;
            }
        }),
        ("its cone", |s| {
            if let LightKind::Spot { outer_degrees, .. } = &mut s.lights[0].kind {
                *outer_degrees += 0.01;
            }
        }),
        ("a light less", |s| s.lights.truncate(1)),
        ("background", |s| s.background.top *= 1.0001),
        ("sky", |s| s.sky.iter_mut().for_each(|sky| sky.top *= 1.001)),
        ("its place", |s| s.sky.iter_mut().for_each(|sky| sky.up.x += 0.001)),
        ("viewer", |s| s.sky.iter_mut().for_each(|sky| sky.viewer *= 1.001)),
        ("texture", |s| {
            if let Texture::Image(image) = &mut s.textures[0] {
                image.rgba.swap(0, 1);
            }
        }),
        ("normals", |s| s.normals.iter_mut().for_each(|n| n.x += 0.001)),
    ];
    for (what, change) in changes {
        let scene = if what == "toon" { &cartoon } else { &smooth };
        let mut shown = scene.clone();
        change(&mut shown);
        let wrong = wrong_pixels(scene, &shown);
        assert!(wrong > 5, "{what}: {wrong} pixels are wrong");
    }
    assert_eq!(wrong_pixels(&smooth, &smooth), 0);
}

#[test]
fn other_patterns_and_filters_are_found() {
    for pattern in [Pattern::Noise, Pattern::Marble, Pattern::Wood].map(pattern) {
        let other = Procedural { seed: 6, ..pattern.clone() };
        assert!(wrong_pixels(&textured(pattern.clone()), &textured(other)) > 20, "{pattern:?}");
        let other = Procedural { octaves: pattern.octaves - 1, ..pattern.clone() };
        assert!(wrong_pixels(&textured(pattern.clone()), &textured(other)) > 20, "{pattern:?}");
    }
    let scene = textured(image());
    let of = |picture| TraceOptions { picture, ..TraceOptions::DEFAULT };
    let bilinear = of(PictureOptions { texture_filter: TextureFilter::Bilinear, ..PictureOptions::DEFAULT });
    assert!(judged_as(&scene, &TraceOptions::DEFAULT, &scene, &bilinear).0.wrong > 20);
    let scene = scene_of(lacking(Feature::Toon));
    let hard = of(PictureOptions { terminator: Terminator::Hard, ..PictureOptions::DEFAULT });
    assert!(judged_as(&scene, &TraceOptions::DEFAULT, &scene, &hard).0.wrong > 0);
}

/// A ring of glass and mirrors, whose triangles lie in all directions.
#[test]
fn methods_that_lose_hits_are_found() {
    let mut builder = Builder::new();
    builder.material(Material { mirror: Vec3::splat(0.9), ..Material::matt(Vec3::new(0.8, 0.5, 0.2)) });
    builder.torus(1.0, 0.4, 24, 12);
    builder.quad(Vec3::new(-4.0, -1.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 1);
    builder.light(Light::point(Vec3::new(1.0, 4.0, 2.0), Vec3::ONE));
    builder.camera(Camera { eye: Vec3::new(0.6, 1.4, 3.6), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 45.0 });
    let scene = builder.finish().unwrap();
    let kd = KdOptions { traversal: Traversal::ThesisRestart, ..KdOptions::DEFAULT };
    let thesis = TraceOptions { intersector: Intersector::Thesis, ..TraceOptions::of_kd(kd) };
    let (picture, rays) = judged(&scene, &thesis);
    assert!(picture.wrong > 0 && picture.worst_wrong.is_some(), "{picture:?}");
    assert!(!rays.strict && rays.wrong() > 0, "{rays:?}");
    assert_right("exact", judged(&scene, &TraceOptions::DEFAULT));
}
