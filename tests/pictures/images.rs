//! Whole pictures: the device's against the twin's byte for byte, and what must be seen in them.

use super::wavefront::panes_of_doubt;
use crate::common::device;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use raybrook::low_level::device::{DeviceHandle, OpenClBackend};
use raybrook::low_level::film::Film;
use raybrook::low_level::options::{PacketSize, StructureKind, TraceOptions};
use raybrook::low_level::pack::{SceneBuffers, sample_positions};
use raybrook::low_level::renderer::{Picture, build_and_open, complete, open_tracer, render};
use raybrook::low_level::scene::{
    Background, Builder, Camera, Falloff, Image, Light, LightKind, Material, Pattern, Procedural, Samples, Scene,
    TextureSpace, Toon,
};
use raybrook::low_level::shared::{COUNTERS, CameraSample, Hit};
use raybrook::low_level::tracer::{Backend, RenderResult, Task, TraceResult, is_hit};
use std::sync::Arc;

const SIZE: (u32, u32) = (61, 45); // no multiple of the tile's side
const DEPTH: u32 = 6;

/// A square of side `side` about the origin, facing +z.
fn centred_quad(builder: &mut Builder, side: f32) {
    builder.quad(Vec3::new(-side, -side, 0.0) / 2.0, Vec3::X * side, Vec3::Y * side, 1);
}

/// A floor with a texture, a mirror, a glass ball, a smooth ball, and one light of each kind.
fn motley() -> Scene {
    let mut builder = Builder::new();
    let texels = (0..64u8).map(|i| if (i / 8 + i % 8) % 2 == 0 { [230, 220, 200, 255] } else { [40, 60, 90, 255] });
    let checker = Image { name: "checker".into(), width: 8, height: 8, rgba: texels.collect() };
    let diffuse_texture = Some(builder.add_texture(checker));
    builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
    builder.push();
    builder.translate(Vec3::new(0.0, -1.0, 0.0));
    builder.rotate(Vec3::X, -90.0);
    centred_quad(&mut builder, 8.0);
    builder.pop();
    let balls = [
        Material { mirror: Vec3::new(0.9, 0.8, 0.7), ..Material::matt(Vec3::splat(0.05)) },
        Material { transmission: Vec3::new(0.9, 1.0, 0.9), ior: 1.5, ..Material::matt(Vec3::ZERO) },
        Material { specular: Vec3::splat(0.6), shininess: 80.0, ..Material::matt(Vec3::new(0.7, 0.1, 0.1)) },
    ];
    for (i, ball) in balls.into_iter().enumerate() {
        builder.material(ball);
        builder.push();
        builder.translate(Vec3::new(2.2 * (i as f32 - 1.0), 0.0, 0.3 * i as f32));
        builder.sphere(1.0, 24);
        builder.pop();
    }
    let mut scene = builder.finish().unwrap();
    scene.lights = vec![
        Light::point(Vec3::new(3.0, 5.0, 4.0), Vec3::splat(0.5)),
        Light::directional(Vec3::new(0.5, -1.0, -0.3), Vec3::new(0.2, 0.2, 0.3)),
        Light {
            kind: LightKind::Spot {
                position: Vec3::new(-4.0, 6.0, 2.0),
                direction: Vec3::new(4.0, -6.0, -2.0),
                inner_degrees: 10.0,
                outer_degrees: 20.0,
            },
            intensity: Vec3::splat(30.0),
            falloff: Falloff::Quadratic,
        },
    ];
    scene.ambient = Vec3::splat(0.1);
    scene.background = Background { bottom: Vec3::new(0.2, 0.15, 0.1), top: Vec3::new(0.3, 0.5, 0.9) };
    scene.camera = Some(Camera {
        eye: Vec3::new(0.5, 2.0, 7.0),
        target: Vec3::new(0.0, 0.0, 0.0),
        up: Vec3::Y,
        fov_degrees: 45.0,
    });
    scene
}

/// Balls of every procedural texture on a floor that lies in a border of its own one's cells, and one in tones.
fn patterned() -> Scene {
    let mut builder = Builder::new();
    let mut textured = |texture: Procedural| {
        let diffuse_texture = Some(builder.add_texture(texture));
        builder.add_material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) })
    };
    let placed = DAffine3::from_scale_rotation_translation(
        DVec3::new(0.4, 0.7, 0.4),
        DQuat::from_rotation_z(0.7),
        DVec3::new(1.0, 2.0, 3.0),
    );
    let mut balls = Pattern::ALL
        .map(|pattern| textured(Procedural { transform: placed, seed: 7, ..Procedural::new(pattern) }))
        .to_vec();
    let in_uv = Procedural {
        transform: DAffine3::from_scale(DVec3::splat(0.1)),
        space: TextureSpace::Uv,
        ..Procedural::new(Pattern::Checker)
    };
    balls.push(textured(in_uv));
    let floor = textured(Procedural::new(Pattern::Checker));
    let toon = Some(Toon::new(3));
    balls.push(builder.add_material(Material {
        toon,
        specular: Vec3::splat(0.5),
        shininess: 30.0,
        ..Material::matt(Vec3::new(0.8, 0.3, 0.1))
    }));
    for (i, ball) in balls.into_iter().enumerate() {
        builder.push().translate(Vec3::new(1.4 * (i as f32 - 2.5), 0.6, 0.0)).use_material(ball).sphere(0.65, 24).pop();
    }
    builder.use_material(floor).push().rotate(Vec3::X, -90.0);
    centred_quad(&mut builder, 12.0);
    builder.pop();
    Scene { lights: motley().lights, camera: motley().camera, ..builder.finish().unwrap() }
}

/// Renders `scene` on the device, or on the reference, with 4 samples per pixel.
fn picture_of(scene: &Scene, on_device: bool, options: TraceOptions) -> Option<RenderResult> {
    let device = if on_device { Some(device()?) } else { None };
    let camera = scene.camera.unwrap();
    let picture = Picture { camera, size: SIZE, samples: Samples::PerPixel(4), depth: DEPTH, kill_weight: None };
    let (buffers, mut tracer) =
        build_and_open(device.as_ref(), scene, &options, DEPTH, None, &[Task::Picture]).unwrap();
    Some(render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap())
}

fn reference(scene: &Scene) -> RenderResult {
    picture_of(scene, false, TraceOptions::default()).unwrap()
}

fn bits(film: &Film) -> Vec<[u32; 3]> {
    film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

#[test]
fn device_and_twin_render_the_same_bits() {
    for accel in [StructureKind::Kd, StructureKind::Brute] {
        let options = TraceOptions::of(accel);
        for scene in [motley(), patterned()] {
            let Some(got) = picture_of(&scene, true, options) else { return };
            let expected = picture_of(&scene, false, options).unwrap();
            assert_eq!(got.counts, expected.counts, "{accel}");
            let wrong = bits(&got.film).iter().zip(bits(&expected.film)).filter(|(a, b)| **a != *b).count();
            assert_eq!(wrong, 0, "{accel}: {wrong} of {} pixels differ in some bit", expected.film.pixels.len());
            assert_eq!(expected.film.non_finite(), 0);
        }
    }
}

/// Each sample of a pixel may be an item of its own, of as many samples at a time as there is room for.
#[test]
fn samples_of_items_of_their_own_make_the_same_bits() {
    let Some(device) = device() else { return };
    let above = Light::directional(Vec3::Z, Vec3::splat(0.5));
    let [eye, target] = [-4.0, 0.0].map(|z| Vec3::new(1.0, 1.0, z));
    let below = Camera { eye, target, up: Vec3::Y, fov_degrees: 90.0 };
    // Both samples of pixels on the diagonal lie on it, where the first pass leaves rays to the second.
    let panes = (Scene { camera: Some(below), lights: vec![above], ..panes_of_doubt() }, (16, 16), &[2][..]);
    for packet_size in [PacketSize::One, PacketSize::Sixteen] {
        let options = TraceOptions { packet_size, ..TraceOptions::DEFAULT };
        for (scene, size, samples) in [(motley(), SIZE, &[1, 2, 5, 67][..]), panes.clone()] {
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let mut ours = OpenClBackend::new(&device, &buffers, &options, DEPTH, None).unwrap();
            let mut twin = open_tracer(None, &buffers, &options, DEPTH, None).unwrap();
            for &samples in samples {
                let (camera, samples) = (scene.camera.unwrap(), Samples::PerPixel(samples));
                let picture = Picture { camera, size, samples, depth: DEPTH, kill_weight: None };
                let expected = render(twin.as_mut(), &buffers, &picture, &|_| ()).unwrap();
                let resolved = [true, false].map(|apart| {
                    ours.take_samples_apart(apart);
                    let got = render(&mut ours, &buffers, &picture, &|_| ()).unwrap();
                    assert_eq!(got.counts, expected.counts, "{packet_size} {samples:?} {apart}");
                    assert!(bits(&got.film) == bits(&expected.film), "{packet_size} {samples:?} {apart}");
                    got.second_pass.unwrap()
                });
                // The second pass has samples, or pixels with all of theirs.
                assert!(size != (16, 16) || resolved[0] > resolved[1] && resolved[1] >= 8, "{resolved:?}");
            }
        }
    }
}

/// Few pixels and rays that the first pass defers are settled on the host, with the same bits; not where lights have
/// moved, of which the host does not know.
#[test]
fn the_host_settles_few_pixels_and_rays_with_the_same_bits() {
    let Some(device) = device().map(DeviceHandle::ask_host) else { return };
    let above = Light::directional(Vec3::Z, Vec3::splat(0.5));
    let [eye, target] = [-4.0, 0.0].map(|z| Vec3::new(1.0, 1.0, z));
    let camera = Camera { eye, target, up: Vec3::Y, fov_degrees: 90.0 };
    let scene = Scene { camera: Some(camera), lights: vec![above], ..panes_of_doubt() };
    for packet_size in [PacketSize::One, PacketSize::Sixteen] {
        let options = TraceOptions { packet_size, ..TraceOptions::DEFAULT };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        // The host settles what comes first.
        let open = || {
            let mut ours = OpenClBackend::new(&device, &buffers, &options, DEPTH, None).unwrap();
            ours.take_samples_apart(false);
            ours
        };
        let mut twin = open_tracer(None, &buffers, &options, DEPTH, None).unwrap();
        let check = |ours: &OpenClBackend, got: RenderResult, expected: RenderResult, what: &str| {
            assert_eq!(got.counts, expected.counts, "{packet_size} {what}");
            assert!(bits(&got.film) == bits(&expected.film), "{packet_size} {what}");
            assert!(got.second_pass >= Some(8), "{packet_size} {what}: {:?}", got.second_pass);
            assert_eq!(ours.on_host_s() > 0.0, what != "other lights", "{packet_size} {what}");
        };
        let render_by = |tracer: &mut dyn Backend, samples| {
            let samples = Samples::PerPixel(samples);
            let picture = Picture { camera, size: (16, 16), samples, depth: DEPTH, kill_weight: None };
            render(tracer, &buffers, &picture, &|_| ()).unwrap()
        };
        for samples in [1, 2] {
            let mut ours = open();
            let got = render_by(&mut ours, samples);
            check(&ours, got, render_by(twin.as_mut(), samples), "picture");
        }
        // Lists have a place for each ray: here the pixels column by column.
        let params = buffers.render_params(&camera, (16, 16), Samples::PerPixel(1), DEPTH, None).of_list(250);
        let sample = sample_positions(Samples::PerPixel(1))[0];
        let at = |i: usize| CameraSample { x: (i / 16) as f32 + sample.x, y: (i % 16) as f32 + sample.y, ..sample };
        let list: Vec<_> = (0..250).map(at).collect();
        let mut ours = open();
        let got = ours.render(&params, &list, &|_| ()).unwrap();
        check(&ours, got, twin.render(&params, &list, &|_| ()).unwrap(), "list");

        // Rays to points on the diagonal, from outside of it.
        let from = Vec3::new(0.75, 0.25, -1.0);
        let ray = |i: usize| (from, Vec3::new(i as f32, i as f32, 0.0) / 32.0 - from, 0.0, f32::INFINITY);
        let batch = buffers.batch(32, ray, None);
        for any_hit in [false, true] {
            let mut ours = open();
            let job = batch.job(any_hit, 1);
            let got = ours.trace(&job, &|_| ()).unwrap();
            let expected = twin.trace(&job, &|_| ()).unwrap();
            // Packets may find another one of several hits.
            let primitive = |hit: &Hit| if any_hit { u32::from(is_hit(hit)) } else { hit.primitive };
            let bits = |hit: &Hit| ([hit.t, hit.u, hit.v].map(f32::to_bits), primitive(hit));
            let hits = |result: &TraceResult| result.hits.iter().map(bits).collect::<Vec<_>>();
            assert_eq!(hits(&got), hits(&expected), "{packet_size} any hit: {any_hit}");
            assert_eq!(ours.on_host_s() > 0.0, got.second_pass > Some(0), "{packet_size} any hit: {any_hit}");
            assert!(any_hit || got.second_pass > Some(0), "{packet_size}");
        }

        let mut lights = buffers.lights.clone();
        lights.iter_mut().for_each(|light| light.intensity.x *= 0.5);
        let mut ours = open();
        [&mut ours as &mut dyn Backend, twin.as_mut()].into_iter().for_each(|by| by.set_lights(&lights).unwrap());
        let got = render_by(&mut ours, 1);
        check(&ours, got, render_by(twin.as_mut(), 1), "other lights");
    }
}

/// Walls that lie in borders of the checker's cells show the cells of their inside, whichever side is seen, without a
/// single pixel of the neighbours: the hits' rounding errors must not choose. The last walls lie near the border of a
/// place that float32 does not have.
#[test]
fn walls_in_borders_of_the_checker_are_clean() {
    for (size, wall) in [(1.0, 3.0), (1.0, 0.0), (1.0, -7.0), (0.25, 100.0), (0.1, 0.3), (0.3, -2.1), (0.7, 4.9)] {
        for axis in 0..3 {
            let mut builder = Builder::new();
            let transform = DAffine3::from_scale(DVec3::splat(size));
            let texture =
                Procedural { transform, colours: [Vec3::ZERO, Vec3::ONE], ..Procedural::new(Pattern::Checker) };
            let diffuse_texture = Some(builder.add_texture(texture));
            builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
            // The quad's u and v run along the next two axes, so that it faces along this one.
            let along = |i: usize| Vec3::AXES[(axis + i) % 3];
            let side = 6.0 * size as f32;
            let origin = along(0) * wall - (along(1) + along(2)) * side / 2.0;
            builder.quad(origin, along(1) * side, along(2) * side, 3).ambient(Vec3::ONE);
            let mut scene = builder.finish().unwrap();
            for outside in [1.0, -1.0] {
                let (up, right) = (along(2), along(1) * outside);
                let eye = along(0) * (wall + outside * side);
                scene.camera = Some(Camera { eye, target: along(0) * wall, up, fov_degrees: 40.0 });
                let film = reference(&scene).film;
                let mut seen = 0;
                for (i, pixel) in film.pixels.iter().enumerate() {
                    let (x, y) = (i % SIZE.0 as usize, i / SIZE.0 as usize);
                    // Where the pixel's middle meets the wall, in cells from the quad's middle.
                    let half = 6.0 * 20f64.to_radians().tan();
                    let across = (2.0 * x as f64 + 1.0 - f64::from(SIZE.0)) / f64::from(SIZE.1) * half;
                    let high = (1.0 - (2.0 * y as f64 + 1.0) / f64::from(SIZE.1)) * half;
                    // Only pixels that lie in one cell of the wall; half a pixel is 0.05 cells.
                    let in_one_cell = |t: f64| (t - t.round()).abs() > 0.1 && t.abs() < 2.9;
                    if !(in_one_cell(across) && in_one_cell(high)) {
                        continue;
                    }
                    let across = across * f64::from(right.dot(along(1)));
                    let inside = (f64::from(wall) / size).round() as i64 - 1;
                    let cell = inside + across.floor() as i64 + high.floor() as i64;
                    assert_eq!(
                        Vec3::from(*pixel),
                        Vec3::splat(cell.rem_euclid(2) as f32),
                        "{size} {wall} {axis}: {x} {y}"
                    );
                    seen += 1;
                }
                assert!(seen > 500, "{seen} pixels");
            }
        }
    }
}

/// Of a ball in three tones under one light there are the tones, the dark and the highlight's, and nothing between.
#[test]
fn cartoons_have_few_colours() {
    let mut builder = Builder::new();
    let toon = Some(Toon { steps: 3, threshold: 0.2 });
    builder.material(Material {
        toon,
        specular: Vec3::splat(0.25),
        shininess: 20.0,
        ..Material::matt(Vec3::splat(0.75))
    });
    builder.sphere(1.0, 64).light(Light::directional(Vec3::new(-0.5, -0.5, -1.0), Vec3::ONE));
    let mut scene = builder.finish().unwrap();
    scene.background = Background { bottom: Vec3::ZERO, top: Vec3::ZERO };
    scene.camera = Some(Camera { eye: Vec3::Z * 6.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 22.0 });
    let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::default()).unwrap());
    let picture = Picture {
        camera: scene.camera.unwrap(),
        size: SIZE,
        samples: Samples::PerPixel(1),
        depth: 1,
        kill_weight: None,
    };
    let mut tracer = open_tracer(None, &buffers, &TraceOptions::default(), 1, None).unwrap();
    let film = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap().film;
    let mut counts = [0; 5];
    for [red, green, blue] in film.pixels {
        let tone = [0.0, 0.25, 0.5, 0.75, 1.0].iter().position(|&tone| tone == red);
        assert!(red == green && green == blue && tone.is_some(), "{red} {green} {blue}");
        counts[tone.unwrap()] += 1;
    }
    assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
}

#[test]
fn every_kind_of_ray_is_cast_and_counted() {
    let counts = reference(&motley()).counts;
    assert_eq!(counts[0], u64::from(SIZE.0 * SIZE.1 * 4), "camera rays");
    for kind in 0..COUNTERS / 2 {
        assert!(counts[2 * kind + 1] > 0 && counts[2 * kind] > counts[2 * kind + 1], "{counts:?}");
    }
}

/// A light over a quad with a smaller one between: lit outside, dark inside the shadow, tinted when the blocker is
/// glass.
fn shadow_scene(blocker: Material) -> Scene {
    let mut builder = Builder::new();
    builder.rotate(Vec3::X, -90.0);
    builder.material(Material::matt(Vec3::ONE));
    centred_quad(&mut builder, 4.0);
    builder.translate(Vec3::new(0.0, 0.0, 1.0));
    builder.material(blocker);
    centred_quad(&mut builder, 1.0);
    let mut scene = builder.finish().unwrap();
    scene.lights = vec![Light::directional(Vec3::NEG_Y, Vec3::splat(0.5))];
    scene.background = Background { bottom: Vec3::ZERO, top: Vec3::ZERO };
    // From the side, so that the blocker does not hide its shadow.
    scene.camera = Some(Camera { eye: Vec3::new(0.0, 0.4, 9.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 3.0 });
    scene
}

fn middle(film: &Film) -> Vec3 {
    Vec3::from(film.pixels[(film.height / 2 * film.width + film.width / 2) as usize])
}

#[test]
fn shadows_are_dark_and_glass_tints_them() {
    let opaque = middle(&reference(&shadow_scene(Material::matt(Vec3::ONE))).film);
    assert_eq!(opaque, Vec3::ZERO);
    let tint = Vec3::new(1.0, 0.5, 0.25);
    let glass = Material { transmission: tint, ..Material::matt(Vec3::ZERO) };
    let tinted = middle(&reference(&shadow_scene(glass)).film);
    assert!((tinted - 0.5 * tint).abs().max_element() < 1e-5, "{tinted}");
}

/// A sphere of a material in front of a plain background: nothing else, so that the answer is known.
fn ball(material: Material, background: Vec3) -> Vec3 {
    let mut builder = Builder::new();
    builder.material(material);
    builder.sphere(1.0, 64);
    let mut scene = builder.finish().unwrap();
    scene.background = Background { bottom: background, top: background };
    scene.camera = Some(Camera { eye: Vec3::Z * 6.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 5.0 });
    middle(&reference(&scene).film)
}

#[test]
fn mirrors_reflect_and_glass_keeps_energy() {
    let sky = Vec3::new(0.4, 0.6, 0.8);
    let mirror = ball(Material { mirror: Vec3::splat(0.5), ..Material::matt(Vec3::ZERO) }, sky);
    assert!((mirror - 0.5 * sky).abs().max_element() < 1e-6, "{mirror}");
    // White all round: a clear ball is invisible, whatever it reflects and refracts. What the depth limit of 6 cuts off
    // is seen after 5 inner reflections, 0.04^5 = 1e-7; the kill weight cuts 2e-4 at most, a few times.
    let clear = ball(Material { transmission: Vec3::ONE, ior: 1.5, ..Material::matt(Vec3::ZERO) }, Vec3::ONE);
    assert!((clear - Vec3::ONE).abs().max_element() < 1e-3, "{clear}");
    // Without a change of index the ray goes straight through both sides.
    let pane = ball(Material { transmission: Vec3::splat(0.5), ior: 1.0, ..Material::matt(Vec3::ZERO) }, Vec3::ONE);
    assert!((pane - Vec3::splat(0.25)).abs().max_element() < 1e-6, "{pane}");
}

#[test]
fn pictures_are_upright_and_not_mirrored() {
    let mut builder = Builder::new();
    for (position, colour) in [(Vec3::new(2.0, 0.0, 0.0), Vec3::X), (Vec3::new(0.0, 1.5, 0.0), Vec3::Y)] {
        builder.material(Material { emission: colour, ..Material::matt(Vec3::ZERO) });
        builder.push();
        builder.translate(position);
        builder.sphere(0.5, 16);
        builder.pop();
    }
    let mut scene = builder.finish().unwrap();
    scene.background = Background { bottom: Vec3::ZERO, top: Vec3::ZERO };
    scene.camera = Some(Camera { eye: Vec3::Z * 10.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 });
    let film = reference(&scene).film;
    // The centre of mass of each colour, in pixels from the upper left corner.
    let center = |channel: usize| {
        let lit = film.pixels.iter().enumerate().filter(|(_, p)| p[channel] > 0.5);
        let points: Vec<_> = lit.map(|(i, _)| (i as u32 % film.width, i as u32 / film.width)).collect();
        let n = points.len() as f32;
        assert!(n > 4.0);
        (points.iter().map(|p| p.0 as f32).sum::<f32>() / n, points.iter().map(|p| p.1 as f32).sum::<f32>() / n)
    };
    let (middle_x, middle_y) = (film.width as f32 / 2.0, film.height as f32 / 2.0);
    let ((red_x, red_y), (green_x, green_y)) = (center(0), center(1));
    assert!(red_x > middle_x + 5.0 && (red_y - middle_y).abs() < 2.0, "+x is right: {red_x}, {red_y}");
    assert!(green_y < middle_y - 5.0 && (green_x - middle_x).abs() < 2.0, "+y is up: {green_x}, {green_y}");
}

#[test]
fn textures_are_upright_and_survive_nonsense() {
    // Two texels: the upper one red, the lower one blue; v runs upwards.
    let mut builder = Builder::new();
    let rgba = vec![[255, 0, 0, 255], [0, 0, 255, 255]];
    let diffuse_texture = Some(builder.add_texture(Image { name: "two".into(), width: 1, height: 2, rgba }));
    builder.material(Material { diffuse: Vec3::ONE, ambient: Vec3::ONE, diffuse_texture, ..Material::default() });
    centred_quad(&mut builder, 2.0);
    let mut scene = builder.finish().unwrap();
    scene.ambient = Vec3::ONE;
    scene.camera = Some(Camera { eye: Vec3::Z * 4.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 25.0 });
    let film = reference(&scene).film;
    let row = |y: u32| Vec3::from(film.pixels[(y * film.width + film.width / 2) as usize]);
    let quarter = film.height / 4;
    assert!(row(quarter + 1).x > 0.85 && row(3 * quarter).z > 0.85, "{} {}", row(quarter + 1), row(3 * quarter));

    for nonsense in [f32::NAN, f32::INFINITY, 1e30, -1e30] {
        scene.uvs.iter_mut().for_each(|uv| uv.x = nonsense);
        let result = reference(&scene);
        assert_eq!(result.film.non_finite(), 0, "u = {nonsense}");
    }
}

#[test]
fn a_bare_scene_gets_a_camera_and_light() {
    let mut builder = Builder::new();
    builder.sphere(1.0, 24);
    let mut scene = builder.finish().unwrap();
    complete(&mut scene, SIZE.0 as f32 / SIZE.1 as f32);
    let result = reference(&scene);
    let share = result.counts[1] as f64 / result.counts[0] as f64;
    assert!((0.3..0.8).contains(&share), "the sphere covers {share} of the picture");
    let brightest = result.film.pixels.iter().flatten().fold(0f32, |a, &b| a.max(b));
    assert!((0.3..=1.5).contains(&brightest), "{brightest}");
}
