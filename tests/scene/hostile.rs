//! Values at the ends of their ranges: whatever a scene may hold, every pixel of its picture is a number, the same on a
//! device and on the twin; what it may not hold is refused by name.

use crate::common::{Random, SEED, quick_device};
use glam::{Vec2, Vec3};
use raybrook::Error;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{
    KernelFeatures, Kernels, LEAST_ROULETTE, PacketSize, PictureOptions, Structure, StructureKind, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{
    Background, Builder, Camera, Falloff, Image, Light, LightKind, Material, Normals, Pattern, Procedural, Samples,
    Scene, Sky, TextureSpace, Toon, load,
};
use raybrook::low_level::tracer::RenderResult;
use std::fmt::Write;
use std::sync::Arc;

const SIZE: (u32, u32) = (12, 9);
const DEPTH: u32 = 6;

/// Numbers of every size that are finite and not negative.
const SIZES: [f32; 14] = [
    0.0,
    1e-45,
    1e-38,
    1e-30,
    1e-19,
    1e-6,
    1.0 - f32::EPSILON / 2.0,
    1.0,
    1.0 + f32::EPSILON,
    1e6,
    1e19,
    1e30,
    f32::MAX / 2.0,
    f32::MAX,
];

/// Mostly an ordinary number, often one of `choices`.
fn number(random: &mut Random, choices: &[f32]) -> f32 {
    if random.bits().is_multiple_of(2) { random.unit() } else { random.pick(choices) }
}

fn colour(random: &mut Random) -> Vec3 {
    Vec3::from([(); 3].map(|()| number(random, &SIZES)))
}

/// A colour of components up to 1.
fn share(random: &mut Random) -> Vec3 {
    if random.bits().is_multiple_of(3) { Vec3::ZERO } else { Vec3::from([(); 3].map(|()| number(random, &SIZES[..8]))) }
}

/// A vector of any size but not zero.
fn vector(random: &mut Random) -> Vec3 {
    loop {
        let v = Vec3::from([(); 3].map(|()| random.sign() * number(random, &SIZES)));
        if v != Vec3::ZERO {
            return v;
        }
    }
}

fn material(random: &mut Random, textures: usize) -> Material {
    Material {
        name: "hostile".into(),
        ambient: colour(random),
        diffuse: colour(random),
        diffuse_texture: (random.bits().is_multiple_of(2)).then(|| random.below(textures) as u32),
        specular: colour(random),
        shininess: number(random, &[0.0, 1e-45, 1e-6, 1.0, Material::MAX_SHININESS]),
        mirror: share(random),
        transmission: share(random),
        ior: number(random, &SIZES[1..]).max(f32::from_bits(1)),
        emission: colour(random),
        toon: random.bits().is_multiple_of(4).then(|| Toon {
            steps: random.pick(&[1, 2, Toon::MAX_STEPS]),
            threshold: number(random, &[0.0, 1e-45, 1.0 - f32::EPSILON / 2.0]),
        }),
    }
}

fn light(random: &mut Random) -> Light {
    // Some lie on a surface or in a vertex.
    let position = match random.below(4) {
        0 => vector(random).clamp(Vec3::splat(-1e30), Vec3::splat(1e30)),
        1 => random.pick(&[Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z]),
        _ => 3.0 * random.vec3(),
    };
    let outer_degrees = number(random, &[1e-45, 1e-3, 89.99999]).max(f32::from_bits(1));
    let kind = match random.below(3) {
        0 => LightKind::Point { position },
        1 => LightKind::Directional { direction: vector(random) },
        _ => LightKind::Spot {
            position,
            direction: vector(random),
            inner_degrees: random.pick(&[0.0, outer_degrees]),
            outer_degrees,
        },
    };
    Light { kind, intensity: colour(random), falloff: random.pick(&[Falloff::None, Falloff::Quadratic]) }
}

/// A normal for a vertex: ordinary, tiny, huge, without direction, or no number.
fn normal(random: &mut Random) -> Vec3 {
    match random.below(6) {
        0 => vector(random),
        1 => Vec3::ZERO,
        2 => Vec3::splat(random.pick(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY])),
        3 => random.sign() * Vec3::Z,
        _ => random.vec3(),
    }
}

fn coordinate(random: &mut Random) -> f32 {
    match random.below(5) {
        0 => random.any_float(),
        1 => random.sign() * random.pick(&SIZES),
        2 => random.pick(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]),
        _ => random.signed() * 4.0,
    }
}

/// Balls and a crumpled sheet with normals and texture coordinates of all kinds, among needles and specks, in all
/// sizes.
fn scene(random: &mut Random) -> Scene {
    let mut builder = Builder::new();
    let rgba = (0..6u8).map(|i| [40 * i, 255 - 40 * i, 20 * i, 255]).collect();
    builder.add_texture(Image { name: "six".into(), width: 3, height: 2, rgba });
    for &pattern in &[Pattern::Checker, Pattern::Noise, Pattern::Marble, Pattern::Wood] {
        let space = random.pick(&[TextureSpace::World, TextureSpace::Uv]);
        builder.add_texture(Procedural { space, ..Procedural::new(pattern) });
    }
    // The unit of length: nothing in a picture depends on it but light that falls off.
    let unit = random.pick(&[1e-25, 1e-12, 1.0, 1.0, 1e12, 1e25]);
    builder.scale(Vec3::splat(unit));
    for _ in 0..3 {
        let material = material(random, 5);
        builder.material(material).push().translate(1.5 * random.vec3()).sphere(0.8, 8).pop();
    }
    let hostile = material(random, 5);
    builder.material(hostile);
    let n = 4;
    let positions: Vec<_> =
        (0..n * n).map(|i| Vec3::new((i % n) as f32 - 1.5, (i / n) as f32 - 1.5, -1.0) + 0.5 * random.vec3()).collect();
    let cells = (0..(n - 1) * (n - 1)).map(|i| (i / (n - 1) * n + i % (n - 1)) as u32);
    let stride = n as u32;
    let triangles: Vec<_> = cells.flat_map(|i| [[i, i + 1, i + stride + 1], [i, i + stride + 1, i + stride]]).collect();
    let normals: Vec<_> = positions.iter().map(|_| normal(random)).collect();
    let uvs: Vec<_> = positions.iter().map(|_| Vec2::new(coordinate(random), coordinate(random))).collect();
    builder.mesh(&positions, Normals::Given(&normals), &uvs, &triangles);
    // A needle and a speck before the eye.
    builder.triangle(Vec3::new(-2.0, 0.1, 1.0), Vec3::new(2.0, 0.1 + 1e-7, 1.0), Vec3::new(2.0, 0.1 + 3e-6, 1.0));
    let speck = random.pick(&[1e-2, 1e-12, 1e-25]);
    builder.triangle(Vec3::ZERO, Vec3::X * speck, Vec3::Y * speck);
    builder.reset_transform();
    let mut scene = builder.finish().unwrap();
    scene.lights = (0..1 + random.below(3)).map(|_| light(random)).collect();
    for light in &mut scene.lights {
        if let LightKind::Point { position } | LightKind::Spot { position, .. } = &mut light.kind
            && random.bits().is_multiple_of(4)
        {
            *position = Vec3::from(position.to_array().map(|c| (c * unit).clamp(-1e30, 1e30)));
        }
    }
    scene.ambient = colour(random);
    scene.background = Background { bottom: colour(random), top: colour(random) };
    if random.bits().is_multiple_of(2) {
        scene.sky =
            Some(Sky { top: colour(random), bottom: colour(random), viewer: colour(random), up: vector(random) });
    }
    let fov_degrees = number(random, &[1e-45, 1e-6, 179.99998]).max(f32::from_bits(1)) * 60.0;
    let target = if random.bits().is_multiple_of(2) { Vec3::ZERO } else { random.vec3() };
    scene.camera = Some(Camera {
        eye: unit * (target + random.pick(&[0.5, 4.0, 4.0, 1e4]) * random.direction()),
        target: unit * target,
        up: Vec3::new(0.3, 1.0, 0.2),
        fov_degrees: fov_degrees.clamp(f32::from_bits(1), 179.99998),
    });
    scene
}

fn picture(scene: &Scene, random: &mut Random) -> Picture {
    let samples = Samples::PerPixel(random.pick(&[1, 1, 3]));
    let kill_weight = random.pick(&[None, Some(0.0)]);
    Picture { camera: scene.camera.unwrap(), size: SIZE, samples, depth: DEPTH, kill_weight }
}

fn rendered(
    device: Option<&DeviceHandle>,
    buffers: &Arc<SceneBuffers>,
    options: &TraceOptions,
    picture: &Picture,
) -> RenderResult {
    let mut tracer = open_tracer(device, buffers, options, picture.depth, None).unwrap();
    render(tracer.as_mut(), buffers, picture, &|_| ()).unwrap()
}

/// A scene with hostile values is refused, and then by name, or rendered to numbers.
fn pixels_are_numbers(renders: u64, device: Option<&DeviceHandle>) {
    let (mut wrong, mut pictures, mut lit) = (Vec::new(), 0, 0);
    for seed in 0..renders {
        let random = &mut Random::new(SEED + seed);
        let scene = scene(random);
        let kernels = random.pick(Kernels::ALL);
        // Every scene needs other features, which are compiled for one; features.rs of the pictures has sets of them.
        let is_own = if device.is_some() { seed == 0 } else { seed.is_multiple_of(8) };
        let features = if is_own { KernelFeatures::Scene } else { KernelFeatures::All };
        let mut options = TraceOptions {
            picture: PictureOptions { kernels, features, ..PictureOptions::DEFAULT },
            ..TraceOptions::DEFAULT
        };
        if kernels == Kernels::Mega && features == KernelFeatures::All && random.below(2) == 0 {
            options = TraceOptions {
                structure: Structure::of(StructureKind::Bvh8),
                packet_size: PacketSize::Sixteen,
                ..options
            };
        }
        let buffers = match SceneBuffers::new(&scene, &options) {
            Ok(buffers) => Arc::new(buffers),
            Err(Error::Scene(message)) if message.contains("light ") => continue,
            Err(other) => panic!("seed {seed}: {other}"),
        };
        let picture = picture(&scene, random);
        let twin = rendered(None, &buffers, &options, &picture);
        pictures += 1;
        lit += usize::from(twin.counts[2] > 0);
        let roulette = Some(random.pick(&[1.0, 0.5, 1e-3, LEAST_ROULETTE]));
        let playing = TraceOptions { picture: PictureOptions { roulette, ..options.picture }, ..options };
        let bad = twin.film.non_finite() + rendered(None, &buffers, &playing, &picture).film.non_finite();
        if bad > 0 {
            wrong.push((seed, bad));
        }
        assert!(twin.film.pixels.iter().flatten().all(|c| c.is_nan() || *c >= 0.0), "seed {seed}: less than no light");
        if let Some(device) = device {
            let film = rendered(Some(device), &buffers, &options, &picture).film;
            let bits = |pixel: &[f32; 3]| pixel.map(f32::to_bits);
            assert!(film.pixels.iter().map(bits).eq(twin.film.pixels.iter().map(bits)), "seed {seed}, {kernels}");
        }
    }
    println!("{pictures} pictures, {lit} of them with shadow rays, {} with pixels that are no numbers", wrong.len());
    assert!(wrong.is_empty(), "{} of {pictures}: (seed, pixels) {wrong:?}", wrong.len());
    assert!(pictures > renders * 3 / 4 && lit > pictures as usize / 3);
}

#[test]
fn hostile_scenes_have_pixels_that_are_numbers() {
    pixels_are_numbers(1000, None);
}

#[test]
fn hostile_scenes_are_the_same_on_devices() {
    let Some(device) = quick_device() else { return };
    pixels_are_numbers(40, Some(&device));
}

/// The same from scene files, with values beyond what is possible as well: these are refused with their line.
#[test]
fn hostile_scene_files_are_refused_by_line_or_have_pixels_that_are_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let (mut refused, mut pictures) = (0, 0);
    for seed in 0..2000 {
        let random = &mut Random::new(SEED + seed);
        let any = |random: &mut Random| match random.below(24) {
            0 => random.pick(&["inf", "nan", "-inf", "-1", "-1e-45", "1e39"]).to_owned(),
            _ => format!("{:e}", number(random, &SIZES)),
        };
        let three = |random: &mut Random| format!("[{}, {}, {}]", any(random), any(random), any(random));
        let mut text = String::from("[camera]\neye = [0.5, 1, 5]\ntarget = [0, 0, 0]\n\n[material.m]\n");
        for key in ["diffuse", "ambient", "specular", "emission"] {
            writeln!(text, "{key} = {}", three(random)).unwrap();
        }
        for key in ["mirror", "transmission"] {
            // Mostly within 0 to 1, or nothing would come through.
            let value = if random.below(8) == 0 { three(random) } else { format!("{:?}", share(random).to_array()) };
            writeln!(text, "{key} = {value}").unwrap();
        }
        for key in ["ior", "shininess"] {
            let value = if random.below(8) == 0 { any(random) } else { format!("{}", 1.0 + random.unit()) };
            writeln!(text, "{key} = {value}").unwrap();
        }
        writeln!(text, "[trace]\nambient = {}\nbackground = {}", three(random), three(random)).unwrap();
        let kind = random.pick(&["point", "spot"]);
        writeln!(text, "[[light]]\nkind = \"{kind}\"\nposition = {}\nfalloff = \"quadratic\"", three(random)).unwrap();
        writeln!(text, "{}intensity = {}", if kind == "spot" { "target = [0, 0, 0]\n" } else { "" }, three(random))
            .unwrap();
        text += "[[object]]\nsolid = \"sphere\"\nmaterial = \"m\"\nsegments = 8\n";
        std::fs::write(&path, &text).unwrap();
        let scene = match load(&path) {
            Ok(scene) => scene,
            Err(Error::Input { line: Some(_), .. }) => {
                refused += 1;
                continue;
            }
            Err(other) => panic!("seed {seed}: {other}\nin\n{text}"),
        };
        let buffers = match SceneBuffers::new(&scene, &TraceOptions::DEFAULT) {
            Ok(buffers) => Arc::new(buffers),
            Err(Error::Scene(message)) if message.starts_with("light 0: ") => continue, // too far away to be a point
            Err(other) => panic!("seed {seed}: {other}"),
        };
        let result = rendered(None, &buffers, &TraceOptions::DEFAULT, &picture(&scene, random));
        assert_eq!(result.film.non_finite(), 0, "seed {seed}\n{text}");
        pictures += 1;
    }
    println!("{pictures} pictures, {refused} files refused");
    assert!(pictures > 300 && refused > 300);
}

/// What a scene may not hold is refused by name also where it was put together by hand.
#[test]
fn scenes_made_by_hand_are_checked_before_they_are_traced() {
    let good = {
        let mut builder = Builder::new();
        builder.sphere(1.0, 8).light(Light::point(Vec3::Y * 3.0, Vec3::ONE));
        builder.finish().unwrap()
    };
    type Spoil = fn(&mut Scene);
    let faults: [(&str, Spoil); 11] = [
        ("ior is 0", |s| s.materials[0].ior = 0.0),
        ("ior is -1.5", |s| s.materials[0].ior = -1.5),
        ("ior is inf", |s| s.materials[0].ior = f32::INFINITY),
        ("shininess is NaN", |s| s.materials[0].shininess = f32::NAN),
        ("shininess is 1000000", |s| s.materials[0].shininess = 1e30),
        ("mirror", |s| s.materials[0].mirror.x = f32::NAN),
        ("light 0: intensity", |s| s.lights[0].intensity.y = f32::INFINITY),
        ("background", |s| s.background.top.z = -1.0),
        ("sky: viewer", |s| s.sky = Some(Sky { viewer: Vec3::NAN, ..Sky::default() })),
        ("sky: up", |s| s.sky = Some(Sky { up: Vec3::ZERO, ..Sky::default() })),
        // On a scene of this size nothing has a direction any more in which light could come from there.
        ("light 0: ", |s| {
            s.positions.iter_mut().for_each(|p| *p *= 1e-20);
            s.lights[0] = Light::point(Vec3::Y * 1e30, Vec3::ONE);
        }),
    ];
    SceneBuffers::new(&good, &TraceOptions::DEFAULT).unwrap();
    for (words, spoil) in faults {
        let mut scene = good.clone();
        spoil(&mut scene);
        match SceneBuffers::new(&scene, &TraceOptions::DEFAULT) {
            Err(Error::Scene(message)) => assert!(message.contains(words), "{message}"),
            other => panic!("{words}: {:?}", other.map(|_| ())),
        }
    }
}

/// Light that falls off with the distance is that of the scene's own units, however small or large these are.
#[test]
fn falloff_does_not_depend_on_the_unit_of_length() {
    let lit = |unit: f32| {
        let mut builder = Builder::new();
        builder.material(Material { ambient: Vec3::ZERO, ..Material::matt(Vec3::ONE) });
        builder.quad(Vec3::new(-1.0, -1.0, 0.0) * unit, Vec3::X * 2.0 * unit, Vec3::Y * 2.0 * unit, 1);
        let kind = LightKind::Point { position: Vec3::new(0.25, 0.5, 2.0) * unit };
        builder.light(Light { kind, intensity: Vec3::splat(unit) * unit, falloff: Falloff::Quadratic });
        let scene = builder.finish().unwrap();
        let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap());
        let camera = Camera { eye: Vec3::Z * 4.0 * unit, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
        let picture = Picture { camera, size: SIZE, samples: Samples::PerPixel(1), depth: 1, kill_weight: None };
        rendered(None, &buffers, &TraceOptions::DEFAULT, &picture).film.pixels
    };
    let expected = lit(1.0);
    assert!(expected[54][0] > 0.1, "{:?}", expected[54]);
    // The square of the unit is the intensity, and must be a number.
    for exponent in [-62, -40, 20, 62] {
        assert_eq!(lit(2f32.powi(exponent)), expected, "2^{exponent}");
    }
}
