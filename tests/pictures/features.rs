//! Kernels that have only what the scene needs, beside those that have everything and the reference, which has no less:
//! bit for bit, on scenes that need one feature, all but one, and all.

use crate::common::{device, is_usually_taken, usually_every};
use glam::{DVec3, Vec3};
use raybrook::low_level::device::{Looked, kernel_resources};
use raybrook::low_level::features::Features;
use raybrook::low_level::options::{
    Intersector, KernelFeatures, Kernels, PacketSize, PictureOptions, StructureKind, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{
    Background, Builder, Camera, Falloff, Image, Light, LightKind, Material, NO_INDEX, Pattern, Procedural, Samples,
    Scene, Sky, Toon,
};
use raybrook::low_level::shared::Feature;
use raybrook::low_level::tracer::RenderResult;
use std::sync::Arc;

const DEPTH: u32 = 5;
const SIZE: (u32, u32) = (24, 20);

/// What is quick to compile: with a single list of triangles and a plain test the kernels are mostly shading.
const QUICK: TraceOptions =
    TraceOptions { intersector: Intersector::MollerTrumbore, ..TraceOptions::of(StructureKind::Brute) };

/// No feature but what a scene with light cannot do without.
pub fn fewest() -> Features {
    Features::ALL.iter().fold(Features::ALL, Features::without).with(Feature::DirectionalLights)
}

/// The smallest set with `feature` that a scene can need.
pub fn with(feature: Feature) -> Features {
    let set = fewest().with(feature);
    match feature {
        Feature::PlacedLights => set.without(Feature::DirectionalLights),
        Feature::Spots | Feature::Falloff => set.without(Feature::DirectionalLights).with(Feature::PlacedLights),
        _ => set,
    }
}

/// The largest set without `feature` that a scene can need.
pub fn lacking(feature: Feature) -> Features {
    let set = Features::ALL.without(feature);
    match feature {
        Feature::PlacedLights => set.without(Feature::Spots).without(Feature::Falloff),
        Feature::SeveralLights => set.without(Feature::DirectionalLights),
        // One material has one texture, and is a mirror or transparent.
        Feature::SeveralMaterials => set.without(Feature::ProceduralTextures).without(Feature::Mirrors),
        _ => set,
    }
}

/// A sphere and a box on a floor that need these features and no others.
pub fn scene_of(set: Features) -> Scene {
    let has = |feature| set.has(feature);
    let mut builder = Builder::new();
    let image = Image {
        name: "four texels".to_owned(),
        width: 2,
        height: 2,
        rgba: vec![[250, 40, 30, 255], [20, 200, 60, 255], [40, 60, 220, 255], [240, 240, 90, 255]],
    };
    let pattern =
        Procedural { transform: glam::DAffine3::from_scale(DVec3::splat(0.7)), ..Procedural::new(Pattern::Checker) };
    // What the sphere has: everything that goes together. The floor has what does not.
    let mut first = Material::matt(Vec3::new(0.7, 0.6, 0.5));
    let mut second = Material::matt(Vec3::new(0.4, 0.6, 0.7));
    let place_for = |taken: bool| if taken { 1 } else { 0 };
    let mut textured = [None, None];
    if has(Feature::ImageTextures) {
        textured[0] = Some(builder.add_texture(image));
    }
    if has(Feature::ProceduralTextures) {
        textured[place_for(has(Feature::ImageTextures))] = Some(builder.add_texture(pattern));
    }
    (first.diffuse_texture, second.diffuse_texture) = (textured[0], textured[1]);
    if has(Feature::Transparency) {
        (first.transmission, first.ior) = (Vec3::new(0.8, 0.9, 0.7), 1.4);
    }
    if has(Feature::Mirrors) {
        let mirror = if has(Feature::Transparency) { &mut second } else { &mut first };
        mirror.mirror = Vec3::new(0.5, 0.4, 0.3);
    }
    if has(Feature::Highlights) {
        (first.specular, first.shininess) = (Vec3::splat(0.6), 20.0);
    }
    first.toon = has(Feature::Toon).then(|| Toon::new(3));
    let ids = [builder.add_material(first), builder.add_material(second)];

    builder.use_material(ids[0]).sphere(1.0, 8);
    builder.translate(Vec3::new(1.4, -0.6, 0.3)).cuboid(Vec3::splat(0.8)).reset_transform();
    builder.use_material(ids[usize::from(has(Feature::SeveralMaterials))]);
    let corners = [(-4.0, -4.0), (-4.0, 4.0), (4.0, 4.0), (4.0, -4.0)].map(|(x, z)| Vec3::new(x, -1.0, z));
    builder.triangle(corners[0], corners[1], corners[2]).triangle(corners[0], corners[2], corners[3]);

    let spot = LightKind::Spot {
        position: Vec3::new(3.0, 5.0, 2.0),
        direction: Vec3::new(-3.0, -5.0, -2.0),
        inner_degrees: 10.0,
        outer_degrees: 25.0,
    };
    let point = LightKind::Point { position: Vec3::new(3.0, 5.0, 2.0) };
    let falloff = if has(Feature::Falloff) { Falloff::Quadratic } else { Falloff::None };
    let strength = if has(Feature::Falloff) { 30.0 } else { 0.8 };
    let placed =
        Light { kind: if has(Feature::Spots) { spot } else { point }, intensity: Vec3::splat(strength), falloff };
    let directional = Light::directional(Vec3::new(-0.4, -1.0, -0.6), Vec3::new(0.8, 0.7, 0.6));
    for (feature, light) in [(Feature::PlacedLights, placed), (Feature::DirectionalLights, directional)] {
        if has(feature) {
            builder.light(light);
            let both = has(Feature::PlacedLights) && has(Feature::DirectionalLights);
            if has(Feature::SeveralLights) && !both {
                builder.light(Light { intensity: Vec3::splat(0.1 * light.intensity.x), ..light });
            }
        }
    }
    builder.camera(Camera { eye: Vec3::new(1.0, 1.5, 5.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 45.0 });
    builder.ambient(Vec3::splat(0.2));
    if has(Feature::Sky) {
        let [top, bottom] = [Vec3::new(0.2, 0.25, 0.4), Vec3::new(0.15, 0.1, 0.05)];
        builder.sky(Sky { top, bottom, viewer: Vec3::new(0.2, 0.15, 0.1), up: Vec3::new(0.3, 1.2, 0.2) });
        builder.background(Background { bottom, top });
    }
    let mut scene = builder.finish().unwrap();
    if !has(Feature::SmoothNormals) {
        scene.triangles.iter_mut().for_each(|triangle| triangle.normals = [NO_INDEX; 3]);
    }
    assert_eq!(Features::of_scene(&scene), set, "the scene for {set}");
    scene
}

fn picture(scene: &Scene) -> Picture {
    let camera = scene.camera.expect("every scene here has a camera");
    Picture { camera, size: SIZE, samples: Samples::PerPixel(2), depth: DEPTH, kill_weight: None }
}

/// Bits of the pixels, and the counted rays.
fn outcome(result: &RenderResult) -> (Vec<[u32; 3]>, [u64; 8]) {
    (result.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect(), result.counts)
}

/// Renders with kernels for the scene, with those for all scenes, and on the reference.
fn compare(set: Features, options: &TraceOptions) {
    let Some(device) = device() else { return };
    let scene = scene_of(set);
    let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
    let rendered = |device, features| {
        let options = TraceOptions { picture: PictureOptions { features, ..options.picture }, ..*options };
        let mut tracer = open_tracer(device, &buffers, &options, DEPTH, None).unwrap();
        outcome(&render(tracer.as_mut(), &buffers, &picture(&scene), &|_| ()).unwrap())
    };
    let expected = rendered(None, KernelFeatures::All);
    for &features in KernelFeatures::ALL {
        assert!(rendered(Some(&device), features) == expected, "{set}: --features {features} {options:?}");
    }
}

#[test]
fn scenes_of_one_feature_have_the_same_pixels() {
    usually_every(2, Feature::ALL).for_each(|&feature| compare(with(feature), &QUICK));
}

/// In a usual run of features that the other test has not alone.
#[test]
fn scenes_of_all_features_but_one_have_the_same_pixels() {
    let taken = Feature::ALL.iter().enumerate().filter(|&(number, _)| is_usually_taken(4, number + 3));
    taken.for_each(|(_, &feature)| compare(lacking(feature), &QUICK));
}

/// The kernels that are not quick to compile: packets and exact hits, and the wavefront kernels.
#[test]
fn other_kernels_have_the_same_pixels() {
    let packets = TraceOptions {
        packet_size: PacketSize::Sixteen,
        intersector: Intersector::Exact,
        ..TraceOptions::of(StructureKind::Bvh8)
    };
    let wavefront = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..QUICK.picture }, ..QUICK };
    for options in [packets, wavefront] {
        for set in usually_every(2, [Features::ALL, with(Feature::Mirrors)]) {
            compare(set, &options);
        }
    }
}

/// Each feature is in the pictures of these scenes: without it they are others.
#[test]
fn every_feature_shows() {
    let pixels = |scene: &Scene| {
        let buffers = Arc::new(SceneBuffers::new(scene, &QUICK).unwrap());
        let mut tracer = open_tracer(None, &buffers, &QUICK, DEPTH, None).unwrap();
        outcome(&render(tracer.as_mut(), &buffers, &picture(scene), &|_| ()).unwrap()).0
    };
    let none = pixels(&scene_of(fewest()));
    // Without any lamp there are not fewer features.
    for &feature in Feature::ALL.iter().filter(|&&feature| feature != Feature::DirectionalLights) {
        assert!(pixels(&scene_of(with(feature))) != none, "{feature}");
    }
}

/// What is left out is not in the program.
#[test]
fn kernels_for_few_features_are_smaller() {
    let Some(device) = device() else { return };
    let bytes = |set, features| {
        let buffers = SceneBuffers::new(&scene_of(set), &QUICK).unwrap();
        let options = TraceOptions { picture: PictureOptions { features, ..QUICK.picture }, ..QUICK };
        let programs = kernel_resources(&device, &buffers, &options, DEPTH, Looked::Pictures).unwrap();
        assert_eq!((programs.len(), programs[0].kernels[0].kernel.as_str()), (1, "render"));
        programs[0].binary_bytes
    };
    let few = bytes(fewest(), KernelFeatures::Scene);
    let sky = bytes(with(Feature::Sky), KernelFeatures::Scene);
    match (few, sky, bytes(fewest(), KernelFeatures::All)) {
        (Some(few), Some(sky), Some(all)) => {
            assert!(few < sky && sky < all, "{few} bytes, {sky} with a sky, and {all} with everything");
        }
        _ => crate::common::skip("the driver does not tell how large binaries are"),
    }
}

/// What no ray can meet, or what gives no light, is not needed, and not sent to the device either.
#[test]
fn what_is_not_used_does_not_count() {
    let mut scene = scene_of(fewest());
    let plain = SceneBuffers::new(&scene, &QUICK).unwrap();
    scene.materials.insert(0, Material { transmission: Vec3::ONE, ..Material::default() });
    scene.textures.push(Procedural::new(Pattern::Wood).into());
    scene.materials.insert(0, Material { diffuse_texture: Some(0), ..Material::default() });
    scene.triangles.iter_mut().for_each(|triangle| triangle.material += 2);
    scene.lights.insert(0, Light::point(Vec3::ZERO, Vec3::ZERO));
    assert_eq!(Features::of_scene(&scene), fewest());
    let buffers = SceneBuffers::new(&scene, &QUICK).unwrap();
    assert_eq!((buffers.materials.len(), buffers.lights.len(), buffers.textures.len()), (1, 1, 0));
    assert_eq!(buffers.materials, plain.materials);
    assert!(buffers.shading.iter().all(|shading| shading.material == 0));
    assert_eq!((buffers.brightest, buffers.params.has_transparent), (plain.brightest, 0));
}

#[test]
fn sets_are_told_by_name() {
    assert_eq!(fewest().to_string(), "directional-lights");
    assert_eq!(fewest().without(Feature::DirectionalLights).to_string(), "none");
    assert_eq!(with(Feature::Mirrors).to_string(), "mirrors, directional-lights");
    assert_eq!(Features::ALL.iter().count(), Feature::ALL.len());
    assert_eq!([1, 8].map(|depth| Features::ALL.pending_rays(depth)), [1, 8]);
    assert_eq!(with(Feature::Mirrors).pending_rays(8), 1);
}
