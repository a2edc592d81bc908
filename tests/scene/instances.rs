//! Instances against the flattened scene, bit for bit: hits and pictures, on the reference and on the device, whatever
//! the transforms.

use crate::common::{Random, SEED, device, is_thorough, quick_device, sheet, soup, usually_every};
use glam::{Affine3A, Vec2, Vec3};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{
    ArrayOptions, Intersector, Kernels, Memory, PictureOptions, StructureKind, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{Builder, Camera, Image, Light, Material, Normals, Samples, Scene};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{TraceJob, is_hit};
use std::sync::Arc;

const INSTANCES: TraceOptions = TraceOptions::of(StructureKind::Instances);
const FLAT: TraceOptions = TraceOptions::of(StructureKind::Bvh2);

fn positions(triangles: &[[Vec3; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corners: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    (corners, (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// Objects that are open, closed, smooth and textured, and transforms of every kind: rotated, mirrored, sheared, flat,
/// small, large and far away, and some that cannot be shared because their inverse is not sure.
fn scene(random: &mut Random) -> Scene {
    let mut builder = Builder::new();
    let dots = (0..16 * 8).map(|_| [(); 4].map(|()| (random.bits() % 256) as u8)).collect();
    let texture = builder.add_texture(Image { name: "cloth".into(), width: 16, height: 8, rgba: dots });
    let plain = builder.add_material(Material::matt(Vec3::new(0.8, 0.3, 0.2)));
    let glass = builder.add_material(Material {
        transmission: Vec3::splat(0.9),
        ior: 1.5,
        specular: Vec3::splat(0.5),
        shininess: 40.0,
        ..Material::matt(Vec3::splat(0.05))
    });
    let mirror = builder.add_material(Material { mirror: Vec3::splat(0.6), ..Material::matt(Vec3::splat(0.3)) });
    let cloth = builder.add_material(Material { diffuse_texture: Some(texture), ..Material::matt(Vec3::ONE) });
    // Of the scene's own.
    builder.use_material(plain).push().translate(Vec3::Y * -3.0).cuboid(Vec3::new(30.0, 1.0, 30.0)).pop();

    let (corners, triangles) = positions(&soup(60, 0.4, random));
    let loose = builder.use_material(mirror).begin_object().mesh(&corners, Normals::Flat, &[], &triangles).end_object();
    let (corners, triangles) = positions(&sheet(6));
    let uvs: Vec<Vec2> = corners.iter().map(|p| Vec2::new(p.x, p.y)).collect();
    let waves =
        builder.use_material(cloth).begin_object().mesh(&corners, Normals::Smooth, &uvs, &triangles).end_object();
    let ball = builder.use_material(glass).begin_object().sphere(1.0, 12).end_object();
    let objects = [loose, waves, ball];
    let materials = [None, None, Some(plain), Some(glass), Some(mirror)];
    for i in 0..60 {
        let object = objects[i % objects.len()];
        builder.push().translate(random.vec3() * 5.0).rotate(random.vec3(), 360.0 * random.unit());
        match i % 8 {
            0 => builder.scale(Vec3::new(1.0, 0.3, 2.0)),
            1 => builder.scale(Vec3::new(-0.7, 0.7, 0.7)),
            2 => builder
                .transform(Affine3A::from_cols_array(&[1.0, 0.4, 0.0, 0.7, 1.0, -0.2, 0.1, 0.0, 0.5, 0.0, 0.0, 0.0])),
            3 => builder.scale(Vec3::splat(1e-3)),
            4 => builder.scale(Vec3::new(1.5, 1e-4, 1.5)),
            5 => builder.scale(Vec3::new(1.0, 1e-9, -1.0)),
            6 => builder.rotate(Vec3::X, 90.0).scale(Vec3::splat(2.0)),
            _ => builder.scale(Vec3::splat(0.8)),
        };
        builder.instance(object, materials[i % materials.len()]).pop();
    }
    // Far away, much larger, and flattened so far that it loses triangles by rounding.
    builder.push().translate(Vec3::new(900.0, 30.0, -500.0)).scale(Vec3::splat(40.0)).instance(loose, None).pop();
    builder.push().translate(Vec3::new(1e4, 0.0, 0.0)).scale(Vec3::splat(1e-5)).instance(waves, None).pop();
    // Whose inverse is not sure: Fibonacci numbers have the determinant 1, far below the rounding of their products.
    let [a, b, c] = [5_702_887.0, 9_227_465.0, 14_930_352.0].map(|x: f32| x / 4e6);
    let unsure = Affine3A::from_cols_array(&[b, a, 0.0, c, b, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    builder.push().translate(Vec3::new(-6.0, 2.0, 0.0)).transform(unsure).instance(loose, None).pop();
    builder.light(Light::point(Vec3::new(4.0, 12.0, 9.0), Vec3::ONE));
    builder.light(Light::directional(Vec3::new(0.3, -1.0, -0.2), Vec3::splat(0.4)));
    builder.camera(Camera { eye: Vec3::new(1.0, 4.0, 14.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 });
    builder.finish().unwrap()
}

/// Rays of all kinds, world units: into the heap, along axes, at vertices and middles of edges, from far away, from
/// inside.
fn rays(scene: &Scene, buffers: &SceneBuffers, count: usize, random: &mut Random) -> Vec<TraceRay> {
    (0..count)
        .map(|i| {
            let triangle = scene.vertices((random.bits() % scene.triangle_count() as u64) as usize);
            let target = match i % 4 {
                0 => triangle[0],
                1 => (triangle[0] + triangle[1]) * 0.5,
                2 => (triangle[0] + triangle[1] + triangle[2]) / 3.0,
                _ => random.vec3() * 5.0,
            };
            let origin = match i % 7 {
                0 => target + Vec3::new(0.0, 3.0, 0.0),
                // Few from so far away that they meet every box.
                1 => random.vec3() * if i % 448 == 1 { 1e30 } else { 3e4 },
                2 => target - random.vec3() * 1e-3,
                _ => random.vec3() * 8.0,
            };
            let direction = if i % 11 == 0 { random.vec3() } else { target - origin };
            buffers.trace_ray(origin, direction, [0.0, 0.9][i / 3 % 2], f32::INFINITY)
        })
        .collect()
}

fn bits(hits: &[Hit]) -> Vec<[u32; 4]> {
    hits.iter().map(|hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]).collect()
}

/// The closest hits, those of secondary rays, and whether there are any.
fn trace(
    scene: &Scene,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    rays: &dyn Fn(&SceneBuffers) -> Vec<TraceRay>,
) -> (Vec<[u32; 4]>, Vec<[u32; 4]>, Vec<bool>) {
    let buffers = Arc::new(SceneBuffers::new(scene, options).unwrap());
    let rays = rays(&buffers);
    let turned = |d: Float4| Float4 { x: d.y, y: -d.x, z: 0.7, w: 0.0 };
    let next: Vec<Float4> = rays.iter().map(|ray| turned(ray.direction_t_max)).collect();
    let mut tracer = open_tracer(device, &buffers, options, 1, None).unwrap();
    let job = |any_hit, next_directions| TraceJob { extreme: &[], rays: &rays, any_hit, next_directions, repeat: 1 };
    let closest = tracer.trace(&job(false, Some(&next)), &|_| ()).unwrap();
    let any = tracer.trace(&job(true, None), &|_| ()).unwrap();
    (bits(&closest.hits), bits(&closest.next_hits.unwrap()), any.hits.iter().map(is_hit).collect())
}

#[test]
fn hits_are_those_of_the_flattened_scene() {
    let mut random = Random::new(SEED);
    let scene = scene(&mut random);
    let flat = scene.flattened().unwrap().into_owned();
    let count = if is_thorough() { 30_000 } else { 10_000 };
    let made = |buffers: &SceneBuffers| rays(&scene, buffers, count, &mut Random::new(SEED + 1));
    for intersector in [
        Intersector::Exact,
        Intersector::Watertight,
        Intersector::Plucker,
        Intersector::MollerTrumbore,
        Intersector::Thesis,
    ] {
        let with = |options: TraceOptions| TraceOptions { intersector, ..options };
        let expected = trace(&flat, &with(FLAT), None, &made);
        let hits = expected.0.iter().filter(|hit| hit[3] != u32::MAX).count();
        assert!((count / 2..count - count / 30).contains(&hits), "{hits} hits");
        // Rounded tests see the same vertices, too.
        assert_eq!(trace(&scene, &with(INSTANCES), None, &made), expected, "{intersector}, seed {SEED}");
        assert_eq!(trace(&scene, &with(FLAT), None, &made), expected, "{intersector}, flattened by the packer");
        let Some(device) = quick_device().filter(|_| intersector == Intersector::Exact) else { continue };
        // `tests/methods/same_answers.rs` has instances in every memory.
        for memory in usually_every(3, [Memory::Global, Memory::Constant, Memory::Image2d]) {
            let options = TraceOptions { arrays: ArrayOptions { memory, ..INSTANCES.arrays }, ..INSTANCES };
            assert_eq!(trace(&scene, &options, Some(&device), &made), expected, "{memory}, seed {SEED}");
        }
    }
}

fn picture(scene: &Scene, options: &TraceOptions, device: Option<&DeviceHandle>) -> (Vec<[u32; 3]>, [u64; 8]) {
    let buffers = Arc::new(SceneBuffers::new(scene, options).unwrap());
    let picture = Picture {
        camera: scene.camera.unwrap(),
        size: (64, 48),
        samples: Samples::PerPixel(1),
        depth: 6,
        kill_weight: None,
    };
    let mut tracer = open_tracer(device, &buffers, options, picture.depth, None).unwrap();
    let result = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap();
    (result.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect(), result.counts)
}

#[test]
fn pictures_are_those_of_the_flattened_scene() {
    let scene = scene(&mut Random::new(SEED));
    let flat = scene.flattened().unwrap().into_owned();
    let expected = picture(&flat, &FLAT, None);
    assert!(expected.1[5] > 100 && expected.1[7] > 100, "mirrors and glass are seen: {:?}", expected.1);
    assert_eq!(picture(&scene, &INSTANCES, None), expected);
    // Which rays live at roulette is no matter of where triangles are.
    let playing = |options: TraceOptions| TraceOptions {
        picture: PictureOptions { roulette: Some(0.7), ..options.picture },
        ..options
    };
    let random = picture(&flat, &playing(FLAT), None);
    assert!(random.1[4] < expected.1[4] && random.1[6] < expected.1[6], "{:?}, {:?}", random.1, expected.1);
    assert_eq!(picture(&scene, &playing(INSTANCES), None), random);
    let Some(device) = quick_device() else { return };
    if is_thorough() {
        assert_eq!(picture(&scene, &playing(INSTANCES), Some(&device)), random, "roulette");
    }
    assert_eq!(picture(&scene, &INSTANCES, Some(&device)), expected, "mega-kernel");
    let wavefront =
        TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..INSTANCES.picture }, ..INSTANCES };
    assert_eq!(picture(&scene, &wavefront, Some(&device)), expected, "wavefront kernels");
}

/// Transforms, objects and scenes of very different sizes: what is shared and what is placed beforehand hit alike.
#[test]
fn sizes_and_odd_transforms_lose_no_hit() {
    let mut random = Random::new(SEED + 3);
    for (size, unit) in [(1.0, 1.0), (1e-12, 1.0), (1.0, 1e15), (1e9, 1e-20), (1e-3, 1e25)] {
        let mut builder = Builder::new();
        let triangles: Vec<_> =
            soup(40, 0.5, &mut random).into_iter().map(|t| t.map(|p| (p + Vec3::splat(3.0)) * size)).collect();
        let (corners, indices) = positions(&triangles);
        let object = builder.begin_object().mesh(&corners, Normals::Flat, &[], &indices).end_object();
        for _ in 0..30 {
            let stretch = (random.vec3() * 8.0).exp2() / size * unit;
            let turn = random.vec3();
            builder.push().translate(random.vec3() * 50.0 * unit).rotate(turn, 360.0 * random.unit());
            builder.scale(stretch).instance(object, None).pop();
        }
        let scene = builder.finish().unwrap();
        let flat = scene.flattened().unwrap().into_owned();
        let made = |buffers: &SceneBuffers| {
            let mut random = Random::new(SEED + 4);
            let aim = |_| {
                let [a, b, c] = scene.vertices((random.bits() % scene.triangle_count() as u64) as usize);
                let origin = random.vec3() * 200.0 * unit;
                let target = a + (b - a) * random.unit() * 0.5 + (c - a) * random.unit() * 0.5;
                let t_min = [0.0, 0.5 * unit][random.bits() as usize % 2];
                if random.bits().is_multiple_of(16) {
                    // So slightly askew that the direction is lifted, see make_ray().
                    let along = Vec3::new(1.0, 1e-42, 0.0);
                    return buffers.trace_ray(target - Vec3::X * unit * 3.0, along * 3.0, t_min, f32::INFINITY);
                }
                buffers.trace_ray(origin, (target - origin) / unit, t_min, f32::INFINITY)
            };
            (0..20_000).map(aim).collect()
        };
        let expected = trace(&flat, &FLAT, None, &made);
        let hits = expected.0.iter().filter(|hit| hit[3] != u32::MAX).count();
        assert!(hits > 15_000, "objects of {size}, scene of {unit}: {hits} hits");
        assert_eq!(trace(&scene, &INSTANCES, None, &made), expected, "objects of {size}, scene of {unit}, seed {SEED}");
    }
}

/// Without normals and textures triangles have no shading data but their materials, or none at all.
#[test]
fn flat_instances_have_their_materials() {
    let Some(device) = quick_device() else { return };
    for several in [false, true] {
        let mut builder = Builder::new();
        let [red, mirror] = [0.0, 0.6].map(|mirror| {
            builder.add_material(Material { mirror: Vec3::splat(mirror), ..Material::matt(Vec3::new(0.8, 0.3, 0.2)) })
        });
        let other = if several { mirror } else { red };
        let object = builder.use_material(red).begin_object().cuboid(Vec3::ONE).end_object();
        builder.push().translate(Vec3::Y * -1.5).cuboid(Vec3::new(12.0, 1.0, 12.0)).pop();
        for (i, material) in [None, Some(other), None, Some(red)].into_iter().enumerate() {
            builder.push().translate(Vec3::X * (1.5 * i as f32 - 2.0)).rotate(Vec3::ONE, 40.0 * i as f32);
            builder.instance(object, material).pop();
        }
        builder.light(Light::point(Vec3::new(4.0, 12.0, 9.0), Vec3::ONE));
        builder.camera(Camera { eye: Vec3::new(1.0, 4.0, 9.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 });
        let scene = builder.finish().unwrap();
        let expected = picture(&scene.flattened().unwrap(), &FLAT, None);
        assert_eq!(expected.1[4] > 0, several, "mirrors are seen: {:?}", expected.1);
        // What is flattened is a scene as any other.
        assert_eq!(picture(&scene, &FLAT, is_thorough().then_some(&device)), expected);
        assert_eq!(picture(&scene, &INSTANCES, Some(&device)), expected);
    }
}

#[test]
fn a_thousand_instances_take_the_memory_of_one() {
    let mut builder = Builder::new();
    let ball = builder.begin_object().sphere(1.0, 32).end_object();
    for i in 0..1000 {
        let at = Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 3.0;
        builder.push().translate(at).rotate(Vec3::Y, i as f32).instance(ball, None).pop();
    }
    let scene = builder.finish().unwrap();
    assert_eq!(scene.triangle_count(), 1000 * scene.instances.shared_triangle_count());
    let bytes = |options: &TraceOptions| SceneBuffers::new(&scene, options).unwrap().size_bytes(options);
    let (shared, flat) = (bytes(&INSTANCES), bytes(&FLAT));
    // 1000 records of 176 bytes and their nodes, and one sphere.
    assert!(shared < 500_000 && flat > 250 * shared, "{shared} bytes, flattened {flat}");
}

#[test]
fn nothing_and_objects_without_triangles_are_traced() {
    for count in [0, 2] {
        let mut builder = Builder::new();
        let nothing = builder.begin_object().end_object();
        for _ in 0..count {
            builder.instance(nothing, None);
        }
        let scene = builder.finish().unwrap();
        let made = |buffers: &SceneBuffers| vec![buffers.trace_ray(Vec3::ZERO, Vec3::X, 0.0, 1.0)];
        assert_eq!(trace(&scene, &INSTANCES, None, &made).2, [false]);
        let Some(device) = device() else { continue };
        assert_eq!(trace(&scene, &INSTANCES, Some(&device), &made).2, [false]);
    }
}
