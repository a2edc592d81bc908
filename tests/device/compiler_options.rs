//! Options for the device's compiler: whatever they relax, hits and pictures keep their bits; a refused one is named.

use crate::common::{APART, AT_APART, Random, SEED, device, is_thorough, scene_of, sheet, soup};
use glam::Vec3;
use raybrook::low_level::device::{Cache, CompileOptions, DeviceContext, DeviceHandle, ProgramSource, build};
use raybrook::low_level::options::{
    Decisions, Intersector, KdOptions, PacketSize, PictureOptions, Structure, StructureKind, TraceOptions, Traversal,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{Builder, Image, Light, Material, Samples, Scene};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Backend, Task, TraceJob};
use raybrook::{Error, Result};
use std::sync::Arc;

/// What OpenCL 1.2 (section 5.6.4.5) has to relax arithmetic, each and together.
const RELAXED: [&str; 7] = [
    "-cl-mad-enable",
    "-cl-no-signed-zeros",
    "-cl-finite-math-only",
    "-cl-unsafe-math-optimizations",
    "-cl-denorms-are-zero",
    "-cl-fast-relaxed-math",
    "-cl-fast-relaxed-math -cl-mad-enable -cl-single-precision-constant",
];

/// What stands for all of these where each is many kernels to compile. By OpenCL's definition unsafe optimizations are
/// the first two, and the last one is all others but denormals; it is refused on some devices, so that the others stay.
const WIDEST: [&str; 4] = [RELAXED[2], RELAXED[3], RELAXED[4], RELAXED[6]];

/// What makes the kernels take the instructions that they take on GPUs, whatever the device is.
const GPU: [&str; 2] = ["-D GPU", "-D GPU -cl-fast-relaxed-math"];

/// A tracer on `device`, or `None`, with the reason printed, where the kernels refuse the device's compiler options.
fn open(
    device: &DeviceHandle,
    buffers: &Arc<SceneBuffers>,
    options: &TraceOptions,
    task: Task,
) -> Option<Box<dyn Backend>> {
    let tracer = open_tracer(Some(device), buffers, options, 4, None);
    match tracer.and_then(|mut tracer| tracer.prepare(task).map(|()| tracer)) {
        Ok(tracer) => Some(tracer),
        Err(error @ Error::Option { .. }) => {
            let message = error.to_string();
            assert!(message.contains(" refuses '-cl-fast-relaxed-math': "), "{message}");
            assert!(message.contains("cannot be protected"), "{message}");
            crate::common::skip(format_args!("refused: {}", message.lines().next().unwrap_or_default()));
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Rays through edges and vertices, along axes, at random, and some that are none. Those from above vertices start at
/// numbers with bits so far apart that only exact integers tell that they meet them.
fn rays(buffers: &SceneBuffers, triangles: &[[Vec3; 3]], random: &mut Random) -> Vec<TraceRay> {
    let nonsense = [f32::NAN, f32::INFINITY, -0.0, 1e30];
    (0..2000)
        .map(|i| {
            let vertices = triangles[random.bits() as usize % triangles.len()];
            let from = match i % 16 {
                11 => vertices[0].with_z(random.unit() * f32::exp2(-40.0)),
                _ => 3.0 * random.vec3(),
            };
            let direction = match i % 8 {
                0 => vertices[i / 8 % 3] - from,
                1 | 2 => vertices[0].lerp(vertices[1], random.unit()) - from,
                3 => Vec3::new(-0.0, 0.0, -1.0),
                4 if i % 16 == 4 => random.vec3().with_y(nonsense[i / 16 % 4]),
                _ => random.vec3() - from,
            };
            let (from, direction) = if i % 16 == 15 { (APART[0] - AT_APART, AT_APART) } else { (from, direction) };
            buffers.trace_ray(from, direction, 0.0, f32::INFINITY)
        })
        .collect()
}

fn bits(hits: &[Hit]) -> &[u32] {
    bytemuck::cast_slice(hits)
}

#[test]
fn hits_keep_their_bits() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let triangles = [sheet(12), soup(60, 0.3, &mut random), vec![APART]].concat();
    let scene = scene_of(&triangles);
    for options in [
        TraceOptions::DEFAULT,
        TraceOptions::of(StructureKind::Bvh2),
        TraceOptions {
            structure: Structure::Kd(KdOptions { traversal: Traversal::Ropes, ..KdOptions::DEFAULT }),
            intersector: Intersector::MollerTrumbore,
            ..TraceOptions::DEFAULT
        },
        TraceOptions { intersector: Intersector::Watertight, ..TraceOptions::of(StructureKind::Grid) },
        TraceOptions { intersector: Intersector::Plucker, ..TraceOptions::of(StructureKind::Octree) },
    ] {
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rays = rays(&buffers, &triangles, &mut random);
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        let any_hit = TraceJob { any_hit: true, ..job };
        let mut reference = open_tracer(None, &buffers, &options, 4, None).unwrap();
        let expected = reference.trace(&job, &|_| ()).unwrap().hits;
        let expected_any = reference.trace(&any_hit, &|_| ()).unwrap().hits;
        assert!(expected.iter().filter(|hit| hit.t.is_finite()).count() > 500);
        // Each is a program to compile.
        let relaxed_by = match (options.intersector, options.kind()) {
            (Intersector::Exact, StructureKind::Bvh2) => &GPU[..],
            (Intersector::Exact, _) if is_thorough() => &RELAXED[..],
            // The last one is among those of GPUs.
            (Intersector::Exact, _) => &WIDEST[..3],
            _ if is_thorough() => &RELAXED[3..=5],
            _ => &RELAXED[5..=5],
        };
        for relaxed in relaxed_by {
            let device = device.clone().with_compiler_options(relaxed).unwrap();
            let Some(mut tracer) = open(&device, &buffers, &options, Task::Batch) else { continue };
            let got = tracer.trace(&job, &|_| ()).unwrap();
            assert_eq!(bits(&got.hits), bits(&expected), "{relaxed}: {options:?} (seed {SEED})");
            let got_any = tracer.trace(&any_hit, &|_| ()).unwrap();
            assert_eq!(bits(&got_any.hits), bits(&expected_any), "{relaxed}: any hit, {options:?} (seed {SEED})");
            if options.intersector == Intersector::Exact {
                assert!(got.second_pass > Some(0), "no ray needed exact integers");
            }
        }
    }
}

/// Mirror, glass, texture, smooth shading, highlights, and shadows of a lamp and of the sun.
fn motley() -> Scene {
    let mut builder = Builder::new();
    let rgba = vec![[230, 220, 200, 255], [40, 60, 90, 255], [90, 10, 10, 255]];
    let diffuse_texture = Some(builder.add_texture(Image { name: "three".into(), width: 3, height: 1, rgba }));
    builder.material(Material { diffuse_texture, mirror: Vec3::splat(0.2), ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-3.0, -1.0, -3.0), 6.0 * Vec3::Z, 6.0 * Vec3::X, 1);
    builder.material(Material {
        specular: Vec3::splat(0.6),
        shininess: 60.0,
        mirror: Vec3::splat(0.3),
        ..Material::matt(Vec3::new(0.8, 0.4, 0.2))
    });
    builder.sphere(0.8, 24);
    builder.material(Material { transmission: Vec3::new(0.7, 0.9, 0.8), ior: 1.5, ..Material::matt(Vec3::splat(0.1)) });
    builder.push().translate(Vec3::new(1.4, -0.2, 0.8)).sphere(0.6, 16).pop();
    builder.light(Light::point(Vec3::new(2.0, 4.0, 3.0), Vec3::splat(0.6)));
    builder.light(Light::directional(Vec3::new(0.5, -1.0, -0.3), Vec3::new(0.2, 0.2, 0.3)));
    let mut scene = builder.finish().unwrap();
    complete(&mut scene, 1.0);
    scene
}

#[test]
fn pictures_keep_their_bits() {
    let Some(device) = device() else { return };
    let scene = motley();
    let one = TraceOptions {
        picture: PictureOptions { decisions: Decisions::Device, ..PictureOptions::DEFAULT },
        ..TraceOptions::DEFAULT
    };
    let sixteen =
        TraceOptions { structure: Structure::of(StructureKind::Bvh8), packet_size: PacketSize::Sixteen, ..one };
    let usual = [(one, &WIDEST[2..3]), (sixteen, &WIDEST[3..])];
    let thorough = [(one, &WIDEST[..]), (sixteen, &WIDEST[1..])];
    for (options, relaxed_by) in if is_thorough() { thorough } else { usual } {
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let pictures_of = |tracer: &mut dyn Backend| {
            [Samples::PerPixel(1), Samples::Error(3.0)].map(|samples| {
                let (camera, size) = (scene.camera.unwrap(), (40, 40));
                let picture = Picture { camera, size, samples, depth: 4, kill_weight: None };
                let result = render(tracer, &buffers, &picture, &|_| ()).unwrap();
                (result.film.pixels.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>(), result.counts)
            })
        };
        let expected = pictures_of(open_tracer(None, &buffers, &options, 4, None).unwrap().as_mut());
        for (_, counts) in &expected {
            assert!(counts.iter().all(|&count| count > 0), "not all kinds of rays: {counts:?}");
        }
        for relaxed in relaxed_by {
            let device = device.clone().with_compiler_options(relaxed).unwrap();
            let Some(mut tracer) = open(&device, &buffers, &options, Task::Picture) else { continue };
            assert!(pictures_of(tracer.as_mut()) == expected, "{relaxed}, {}", options.kind());
        }
    }
}

/// Whether a program that does nothing came from the cache.
fn build_empty(device: &DeviceHandle, cache: Option<&Cache>) -> Result<bool> {
    let context = DeviceContext::open(device)?;
    // Tests that run beside this one may keep the context open, and with it the program of the last call.
    context.forget_programs();
    build(&context, &ProgramSource::empty(), &CompileOptions::new(), cache).map(|built| built.from_cache)
}

#[test]
fn a_refused_option_is_named() {
    let Some(device) = device() else { return };
    let refused = |options: &str| build_empty(&device.clone().with_compiler_options(options).unwrap(), None);
    refused("-cl-mad-enable -w -D UNUSED=1 -D USED").unwrap();
    let Err(error) = refused("-cl-mad-enable -cl-no-such-option -w") else {
        crate::common::skip(format_args!("'{}' takes options that do not exist", device.info.name));
        return;
    };
    let message = error.to_string();
    assert!(matches!(error, Error::Option { .. }), "{message}");
    let expected = format!(
        "option compiler_options: the compiler of device '{}' refuses '-cl-no-such-option': ",
        device.info.name
    );
    assert!(message.starts_with(&expected), "{message}");
}

#[test]
fn what_is_no_option_is_refused() {
    let Some(device) = device() else { return };
    for (options, expected) in [
        ("cl-mad-enable", "option compiler_options: 'cl-mad-enable' is no option"),
        ("-cl-mad-enable\0", "option compiler_options: no compiler takes the character '\\0'"),
    ] {
        let message = device.clone().with_compiler_options(options).unwrap_err().to_string();
        assert!(message.starts_with(expected), "{message}");
    }
    let spaced = device.with_compiler_options("  -w\t -D  A=1 ").unwrap();
    assert_eq!(spaced.compiler_options(), "-w -D A=1");
}

#[test]
fn options_are_part_of_the_cache_key() {
    let Some(device) = device() else { return };
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path());
    let from_cache =
        |options: &str| build_empty(&device.clone().with_compiler_options(options).unwrap(), Some(&cache)).unwrap();
    assert!(!from_cache(""));
    if !from_cache("") {
        crate::common::skip(format_args!("'{}' gives no binaries", device.info.name));
        return;
    }
    assert!(!from_cache("-cl-mad-enable") && from_cache("-cl-mad-enable") && from_cache(""));
}
