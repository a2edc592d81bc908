//! `--kernels wavefront` against the mega-kernel and the twin: the same bits in every pixel and the same rays, whatever
//! the scene, the number of paths in flight, the memory and who evaluates the textures.

use crate::common::{Random, SEED, device};
use glam::Vec3;
use raybrook::low_level::options::{
    ArrayOptions, Intersector, KernelFeatures, Kernels, Layout, Memory, PictureOptions, Structure, StructureKind,
    TexturePass, TraceOptions, TriangleOrder,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::shared::ray::Ray;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{
    self, Background, Builder, Camera, Falloff, Image, Light, LightKind, Material, Normals, Pattern, Procedural,
    Samples, Scene, Toon,
};
use raybrook::low_level::tracer::{Backend, RenderResult};
use std::sync::Arc;

/// The longest chain of rays of these tests; what tracers are opened for.
const DEPTH: u32 = 8;

/// With all features, so that all scenes have the same kernels: what is left out of others is the business of
/// `tests/pictures/features.rs`.
const WAVEFRONT: TraceOptions = TraceOptions {
    picture: PictureOptions { kernels: Kernels::Wavefront, features: KernelFeatures::All, ..PictureOptions::DEFAULT },
    ..TraceOptions::DEFAULT
};

/// Everything that renders one scene.
struct Tracers {
    scene: Scene,
    buffers: Arc<SceneBuffers>,
    twin: Box<dyn Backend>,
    mega: Box<dyn Backend>,
}

impl Tracers {
    /// `None` without a device.
    fn of(mut scene: Scene, options: TraceOptions) -> Option<Self> {
        let device = device()?;
        complete_camera(&mut scene);
        let options = TraceOptions {
            picture: PictureOptions {
                kernels: Kernels::Mega,
                textures: TexturePass::InKernel,
                paths_in_flight: None,
                ..options.picture
            },
            ..options
        };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let twin = open_tracer(None, &buffers, &options, DEPTH, None).unwrap();
        let mega = open_tracer(Some(&device), &buffers, &options, DEPTH, None).unwrap();
        Some(Tracers { scene, buffers, twin, mega })
    }

    fn picture(&self, size: (u32, u32), samples: u32, depth: u32) -> Picture {
        Picture {
            camera: self.scene.camera.unwrap(),
            size,
            samples: Samples::PerPixel(samples),
            depth,
            kill_weight: None,
        }
    }

    /// Renders with the wavefront kernels, mega-kernel and twin, and compares; `options` are of the first.
    fn compare(&mut self, options: &TraceOptions, pictures: &[Picture]) -> Vec<RenderResult> {
        let device = device().unwrap();
        let mut wavefront = open_tracer(Some(&device), &self.buffers, options, DEPTH, None).unwrap();
        let mut compare = |picture: &Picture| {
            let result =
                render(wavefront.as_mut(), &self.buffers, picture, &|done| assert!((0.0..=1.0).contains(&done)));
            let result = result.unwrap();
            for tracer in [&mut self.mega, &mut self.twin] {
                let expected = render(tracer.as_mut(), &self.buffers, picture, &|_| ()).unwrap();
                assert_eq!(result.counts, expected.counts, "{}, {picture:?}, {options:?}", tracer.device_name());
                let bits = |r: &RenderResult| -> Vec<_> { r.film.pixels.iter().map(|p| p.map(f32::to_bits)).collect() };
                let (got, expected) = (bits(&result), bits(&expected));
                let wrong = got.iter().zip(&expected).filter(|(a, b)| a != b).count();
                assert_eq!(
                    (wrong, got.len()),
                    (0, expected.len()),
                    "{}, {picture:?}, {options:?}",
                    tracer.device_name()
                );
            }
            result
        };
        pictures.iter().map(&mut compare).collect()
    }
}

/// A camera for scenes that have none; lights stay as they are.
fn complete_camera(scene: &mut Scene) {
    if scene.camera.is_none() {
        let lights = scene.lights.clone();
        complete(scene, 1.0);
        scene.lights = lights;
    }
}

/// Two mirrors, which see each other, a glass ball and panes of glass over a textured floor, before a wall of marble.
pub(super) fn glass_house(lights: Vec<Light>) -> Scene {
    let mut builder = Builder::new();
    let texels = (0..64u8).map(|i| if (i / 8 + i % 8) % 2 == 0 { [230, 220, 200, 255] } else { [40, 60, 90, 255] });
    let checker = Image { name: "checker".into(), width: 8, height: 8, rgba: texels.collect() };
    let diffuse_texture = Some(builder.add_texture(checker));
    builder.material(Material {
        diffuse_texture,
        specular: Vec3::splat(0.3),
        shininess: 20.0,
        ..Material::matt(Vec3::ONE)
    });
    builder.quad(Vec3::new(-3.0, -1.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 2);
    let toon = Some(Toon::new(3));
    let diffuse_texture = Some(builder.add_texture(Procedural::new(Pattern::Marble)));
    builder.material(Material { diffuse_texture, toon, ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-3.0, -1.0, -3.0), Vec3::X * 6.0, Vec3::Y * 3.0, 1);
    builder.material(Material { mirror: Vec3::new(0.9, 0.8, 0.7), ..Material::matt(Vec3::splat(0.05)) });
    builder.quad(Vec3::new(-3.0, -1.0, 3.0), Vec3::NEG_Z * 6.0, Vec3::Y * 3.0, 1);
    builder.quad(Vec3::new(3.0, -1.0, -3.0), Vec3::Z * 6.0, Vec3::Y * 3.0, 1);
    for (i, tint) in
        [Vec3::new(0.9, 1.0, 0.9), Vec3::new(1.0, 0.6, 0.5), Vec3::new(0.5, 0.7, 1.0)].into_iter().enumerate()
    {
        builder.material(Material { transmission: tint, ior: 1.1 + 0.2 * i as f32, ..Material::matt(Vec3::ZERO) });
        let corner = Vec3::new(-2.0 + i as f32, 0.6 + 0.4 * i as f32, 1.5);
        builder.quad(corner, Vec3::X * 2.0, Vec3::new(0.0, 0.1, -3.0), 1);
    }
    builder.material(Material { transmission: Vec3::splat(0.95), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.sphere(0.7, 12);
    let mut scene = builder.finish().unwrap();
    scene.lights = lights;
    scene.ambient = Vec3::splat(0.1);
    scene.background = Background { bottom: Vec3::new(0.2, 0.15, 0.1), top: Vec3::new(0.3, 0.5, 0.9) };
    scene.camera = Some(Camera { eye: Vec3::new(0.4, 1.0, 6.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 });
    scene
}

pub(super) fn one_light() -> Vec<Light> {
    vec![Light::point(Vec3::new(1.0, 4.0, 1.0), Vec3::splat(0.9))]
}

/// Lights of every kind, some of them below the floor, where they reach nothing.
fn many_lights() -> Vec<Light> {
    (0..11)
        .map(|i| {
            let angle = i as f32;
            let position = Vec3::new(2.0 * angle.cos(), if i % 4 == 3 { -2.0 } else { 3.0 }, 2.0 * angle.sin());
            match i % 3 {
                0 => Light::point(position, Vec3::splat(0.2)),
                1 => Light::directional(-position, Vec3::new(0.1, 0.2, 0.1)),
                _ => Light {
                    kind: LightKind::Spot { position, direction: -position, inner_degrees: 10.0, outer_degrees: 30.0 },
                    intensity: Vec3::splat(3.0),
                    falloff: Falloff::Quadratic,
                },
            }
        })
        .collect()
}

#[test]
fn every_scene_has_the_same_pixels() {
    let folder = crate::common::root().join("scenes");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "toml" || ending == "obj"));
    files.sort();
    let scenes = files.iter().map(|file| (file, scene::load(file).unwrap()));
    // tests/scene/instances.rs has those of instances: flake.toml would be 29 million triangles here.
    let scenes: Vec<_> = scenes.filter(|(_, scene)| scene.instances.is_empty()).collect();
    assert!(scenes.len() >= 6, "{files:?}");
    for (file, mut scene) in scenes {
        complete(&mut scene, 37.0 / 29.0);
        let Some(mut tracers) = Tracers::of(scene, WAVEFRONT) else { return };
        let depths = [1, 2, 3, 5, DEPTH].map(|depth| tracers.picture((37, 29), 1, depth));
        let samples = tracers.picture((29, 21), 3, DEPTH);
        tracers.compare(&WAVEFRONT, &[&depths[..], &[samples]].concat());
        if !tracers.scene.textures.is_empty() {
            let host_pass = TraceOptions {
                picture: PictureOptions { textures: TexturePass::HostPass, ..WAVEFRONT.picture },
                ..WAVEFRONT
            };
            let result = &tracers.compare(&host_pass, &depths[4..])[0];
            assert!(result.wavefront.unwrap().host_colours > 0, "{}", file.display());
        }
    }
}

#[test]
fn paths_in_flight_change_no_bit() {
    let Some(mut tracers) = Tracers::of(glass_house(one_light()), WAVEFRONT) else { return };
    let size = (43, 27); // no multiples of the tile's side, of which the last ones are narrower and lower
    let pictures = [tracers.picture(size, 2, 6)];
    let mut waves = Vec::new();
    for in_flight in [1, 7, 64, 100, 1000, 1_000_000] {
        let options = TraceOptions {
            picture: PictureOptions { paths_in_flight: Some(in_flight), ..WAVEFRONT.picture },
            ..WAVEFRONT
        };
        // A single path in flight takes a wave for every ray.
        let small = [tracers.picture((5, 4), 2, 6)];
        let result = &tracers.compare(&options, if in_flight == 1 { &small } else { &pictures })[0];
        let stats = result.wavefront.unwrap();
        let rays: u64 = [0, 4, 6].iter().map(|&kind| result.counts[kind]).sum();
        assert_eq!(stats.paths_in_flight as u64, u64::from(in_flight).min(result.counts[0]));
        assert!(stats.waves * stats.paths_in_flight as u64 >= rays && stats.waves <= rays, "{stats:?}, {rays} rays");
        if in_flight == 1 {
            assert_eq!(stats.waves, rays);
        } else {
            waves.push(stats.waves);
        }
    }
    assert!(waves.is_sorted_by(|a, b| a >= b), "{waves:?}");
}

#[test]
fn one_pixel_and_other_odd_sizes() {
    let Some(mut tracers) = Tracers::of(glass_house(one_light()), WAVEFRONT) else { return };
    let sizes = [(1, 1), (1, 19), (23, 1), (8, 8), (16, 9), (9, 16), (7, 7)];
    let pictures = sizes.map(|size| tracers.picture(size, 1, DEPTH));
    tracers.compare(&WAVEFRONT, &pictures);
    // One pixel of more samples than the batch of a single path in flight has.
    let options =
        TraceOptions { picture: PictureOptions { paths_in_flight: Some(1), ..WAVEFRONT.picture }, ..WAVEFRONT };
    let pictures = [tracers.picture((1, 1), 40, 3), tracers.picture((3, 2), 5, 1)];
    tracers.compare(&options, &pictures);
}

#[test]
fn lights_add_up_in_their_order() {
    for lights in [many_lights(), Vec::new()] {
        let Some(mut tracers) = Tracers::of(glass_house(lights), WAVEFRONT) else { return };
        let pictures = [tracers.picture((40, 30), 2, 4)];
        let result = &tracers.compare(&WAVEFRONT, &pictures)[0];
        let [cast, blocked] = [result.counts[2], result.counts[3]];
        assert_eq!(cast > 0, !tracers.scene.lights.is_empty());
        assert!(cast == 0 || blocked > 0 && blocked < cast, "{blocked} of {cast} shadow rays are blocked");
    }
}

#[test]
fn an_empty_scene_shows_its_background() {
    let mut scene = Builder::new().finish().unwrap();
    scene.background = Background { bottom: Vec3::X, top: Vec3::Z };
    scene.lights = one_light();
    let Some(mut tracers) = Tracers::of(scene, WAVEFRONT) else { return };
    let pictures = [tracers.picture((11, 10), 2, 4)];
    let result = &tracers.compare(&WAVEFRONT, &pictures)[0];
    assert_eq!(result.counts, [220, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn the_host_evaluates_textures_to_the_same_bits() {
    let Some(mut tracers) = Tracers::of(glass_house(many_lights()), WAVEFRONT) else { return };
    let pictures = [1, 4].map(|depth| tracers.picture((40, 30), 2, depth));
    let host_pass =
        TraceOptions { picture: PictureOptions { textures: TexturePass::HostPass, ..WAVEFRONT.picture }, ..WAVEFRONT };
    for options in [
        host_pass,
        TraceOptions { picture: PictureOptions { paths_in_flight: Some(300), ..host_pass.picture }, ..host_pass },
    ] {
        for result in tracers.compare(&options, &pictures) {
            let stats = result.wavefront.unwrap();
            let hits: u64 = [1, 5, 7].iter().map(|&kind| result.counts[kind]).sum();
            assert!(stats.host_colours > 0 && stats.host_colours < hits, "{stats:?} of {hits} hits");
        }
    }
    for result in tracers.compare(&WAVEFRONT, &pictures) {
        assert_eq!(result.wavefront.unwrap().host_colours, 0);
    }
    // On the twin the choice is accepted and changes nothing.
    let buffers = &tracers.buffers;
    let twin = open_tracer(None, buffers, &host_pass, DEPTH, None).unwrap();
    let results = [twin, tracers.twin].map(|mut twin| render(twin.as_mut(), buffers, &pictures[1], &|_| ()).unwrap());
    assert_eq!(results[0].film.pixels, results[1].film.pixels);
}

#[test]
fn wavefront_kernels_read_every_kind_of_memory() {
    let others = [
        TraceOptions {
            arrays: ArrayOptions { layout: Layout::Whole, ..WAVEFRONT.arrays },
            picture: PictureOptions { textures: TexturePass::HostPass, ..WAVEFRONT.picture },
            ..WAVEFRONT
        },
        TraceOptions { arrays: ArrayOptions { triangles: TriangleOrder::LeafOrder, ..WAVEFRONT.arrays }, ..WAVEFRONT },
        TraceOptions { structure: Structure::of(StructureKind::Brute), ..WAVEFRONT },
    ];
    for options in Memory::ALL
        .iter()
        .map(|&memory| TraceOptions { arrays: ArrayOptions { memory, ..WAVEFRONT.arrays }, ..WAVEFRONT })
        .chain(others)
    {
        let Some(mut tracers) = Tracers::of(glass_house(one_light()), options) else { return };
        let pictures = [tracers.picture((20, 17), 1, 5)];
        tracers.compare(&options, &pictures);
    }
}

/// Panes whose two triangles share an edge of corners with bits so far apart that only exact integers tell which of the
/// two a ray through it hits.
pub(super) fn panes_of_doubt() -> Scene {
    let mut builder = Builder::new();
    for (z, side, transmission) in [(0.0, 4.0, Vec3::ZERO), (1.0, 1.0, Vec3::ZERO), (2.0, 2.0, Vec3::splat(0.7))] {
        builder.material(Material { transmission, ior: 1.0, ..Material::matt(Vec3::ONE) });
        let corners = [[f32::exp2(-60.0); 2], [side; 2], [side, 0.0], [0.0, side]];
        builder.mesh(&corners.map(|[x, y]| Vec3::new(x, y, z)), Normals::Flat, &[], &[[2, 1, 0], [3, 0, 1]]);
    }
    builder.finish().unwrap()
}

#[test]
fn deferred_rays_take_the_second_pass() {
    let mut scene = panes_of_doubt();
    let [eye, target, lamp] = [4.0, 0.0, 8.0].map(|z| Vec3::new(1.0, 1.0, z));
    scene.camera = Some(Camera { eye, target, up: Vec3::Y, fov_degrees: 90.0 });
    let lights = vec![Light::directional(Vec3::NEG_Z, Vec3::splat(0.5)), Light::point(lamp, Vec3::splat(0.3))];
    let mut resolved = Vec::new();
    for (lights, depth) in [(Vec::new(), 1), (Vec::new(), 4), (lights, 4)] {
        let Some(mut tracers) = Tracers::of(Scene { lights, ..scene.clone() }, WAVEFRONT) else { return };
        let pictures = [tracers.picture((16, 16), 1, depth)];
        resolved.push(tracers.compare(&WAVEFRONT, &pictures)[0].second_pass.unwrap());
        let watertight = TraceOptions { intersector: Intersector::Watertight, ..WAVEFRONT };
        let Some(mut tracers) = Tracers::of(tracers.scene, watertight) else { return };
        assert_eq!(tracers.compare(&watertight, &pictures)[0].second_pass, None);
    }
    // The camera's rays to that edge of the glass, then those that go on through it, then shadow rays as well.
    assert!(resolved[0] >= 8 && resolved[1] > resolved[0] && resolved[2] > resolved[1], "{resolved:?}");
}

/// The wavefront kernels store origin, direction and t_near of a ray and make it anew from these.
#[test]
fn a_made_ray_is_made_again_to_the_same_bits() {
    let mut random = Random::new(SEED);
    let mut sound = 0;
    for i in 0..100_000 {
        let mut float = |ordinary: f32| match (i % 4, random.bits() % 4) {
            (0, _) | (1, 0) => random.any_float(),
            (_, 1) => 0.0 * random.signed(),
            _ => ordinary * random.signed(),
        };
        let [origin, direction] = [1e6, 1e-3].map(|size| Vec3::new(float(size), float(size), float(size)));
        let mut ray = Ray::new(origin, direction, 0.0, f32::INFINITY, i);
        if ray.t_near == 0.0 && i % 2 == 0 {
            ray.t_near = 0.25; // as where a ray leaves a surface
        }
        let again = Ray::new(ray.origin, ray.direction, ray.t_near, f32::INFINITY, ray.skip);
        let bits = |ray: &Ray| {
            let vectors = [ray.origin, ray.direction, ray.inv_direction];
            let mut bits: Vec<_> = vectors.iter().flat_map(|v| v.to_array()).map(f32::to_bits).collect();
            // Where it ends differs: made anew, t counts in another unit, of which the largest float is another one.
            // Nothing in a picture is that far away.
            bits.extend([ray.t_near.to_bits(), u32::from(ray.t_far > 0.0), ray.skip]);
            bits
        };
        assert_eq!(bits(&ray), bits(&again), "{ray:?} (seed {SEED})");
        sound += u32::from(ray.t_far > 0.0);
    }
    assert!((50_000..100_000).contains(&sound), "{sound}");
}
