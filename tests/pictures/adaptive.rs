//! Pictures of bounded error: the bound against full pictures, the device against the twin, and what samples go where.

use crate::common::models::shared_scenes;
use crate::common::{Random, SEED, device, is_thorough, usually_every};
use glam::Vec3;
use raybrook::low_level::adaptive::{render_adaptive, sample_sequence};
use raybrook::low_level::film::{Film, srgb_from_linear};
use raybrook::low_level::options::{
    Decisions, Intersector, KernelFeatures, Kernels, PacketSize, PictureOptions, Structure, StructureKind, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render, render_full};
use raybrook::low_level::scene::{Camera, DefaultLight, Samples, Scene, load};
use raybrook::low_level::shared::CameraSample;
use raybrook::low_level::tracer::{Adaptive, AdaptiveStats, Backend, LEVEL_SAMPLES, MOST_SAMPLES, RenderResult};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const DEPTH: u32 = 5;

/// With all features, so that all scenes have the same kernels.
const ALL_FEATURES: TraceOptions = TraceOptions {
    picture: PictureOptions { features: KernelFeatures::All, ..PictureOptions::DEFAULT },
    ..TraceOptions::DEFAULT
};

fn own_scene(name: &str) -> PathBuf {
    crate::common::root().join("scenes").join(name)
}

/// A scene that is ready, with the picture to render of it.
struct Ready {
    buffers: Arc<SceneBuffers>,
    picture: Picture,
    options: TraceOptions,
}

impl Ready {
    fn new(mut scene: Scene, size: (u32, u32), samples: Samples, options: TraceOptions) -> Ready {
        complete(&mut scene, size.0 as f32 / size.1 as f32);
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let picture = Picture { camera: scene.camera.unwrap(), size, samples, depth: DEPTH, kill_weight: None };
        Ready { buffers, picture, options }
    }

    fn of_file(path: &Path, side: u32, error: f32) -> Ready {
        Self::new(load(path).unwrap(), (side, side), Samples::Error(error), ALL_FEATURES)
    }

    fn reference(&self) -> Box<dyn Backend> {
        open_tracer(None, &self.buffers, &self.options, DEPTH, None).unwrap()
    }

    fn render(&self, tracer: &mut dyn Backend) -> RenderResult {
        render(tracer, &self.buffers, &self.picture, &|_| ()).unwrap()
    }

    fn full(&self, tracer: &mut dyn Backend) -> Film {
        render_full(tracer, &self.buffers, &self.picture, &|_| ()).unwrap().film
    }
}

fn bits(film: &Film) -> Vec<u32> {
    film.pixels.as_flattened().iter().map(|c| c.to_bits()).collect()
}

/// Root of the mean squared difference in steps of 8-bit sRGB, not rounded to them.
fn error_in_steps(truth: &Film, film: &Film) -> f64 {
    let shown = |c: f32| 255.0 * srgb_from_linear(f64::from(c).clamp(0.0, 1.0));
    let (a, b) = (truth.pixels.as_flattened(), film.pixels.as_flattened());
    let sum: f64 = a.iter().zip(b).map(|(&a, &b)| (shown(a) - shown(b)).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

#[test]
fn samples_cover_a_pixel_evenly_from_any_power_of_four_on() {
    let samples = sample_sequence();
    assert_eq!(samples.len(), MOST_SAMPLES as usize);
    assert!(samples.iter().flat_map(|s| [s.x, s.y]).all(|c| (0.0..1.0).contains(&c)));
    let near_middle = |c: f32| (c - 0.5).abs() < 0.02;
    assert!(near_middle(samples[0].x) && near_middle(samples[0].y), "{:?}", samples[0]);
    // The first one stands for the pixel, those up to a power of four together for half of it.
    for (area, new) in
        [(1.0, 0..1), (0.5 / 4.0, 1..4), (0.5 / 16.0, 4..16), (0.5 / 64.0, 16..64), (0.5 / 256.0, 64..256)]
    {
        assert!(samples[new].iter().all(|s| (s.footprint.powi(2) / area - 1.0).abs() < 1e-6));
    }
    for side in [2, 4, 8, 16] {
        for block in samples.chunks(side * side) {
            // One in each of the rectangles that are side^2 to a pixel, whatever their shape.
            for columns in (0..).map(|k| 1 << k).take_while(|&columns| columns <= side * side) {
                let rows = side * side / columns;
                let mut cells: Vec<_> = block
                    .iter()
                    .map(|s| (s.x * columns as f32) as usize * rows + (s.y * rows as f32) as usize)
                    .collect();
                cells.sort_unstable();
                assert_eq!(cells, (0..side * side).collect::<Vec<_>>(), "{columns} x {rows}");
            }
        }
    }
}

#[test]
fn a_list_of_rays_is_what_pictures_are_made_of() {
    let ready = Ready::of_file(&own_scene("cornell.toml"), 21, 1.0);
    let mut devices = vec![ready.reference()];
    let mut options = vec![ready.options];
    if let Some(device) = device() {
        for kernels in [Kernels::Mega, Kernels::Wavefront] {
            options
                .push(TraceOptions { picture: PictureOptions { kernels, ..ready.options.picture }, ..ready.options });
            devices.push(open_tracer(Some(&device), &ready.buffers, options.last().unwrap(), DEPTH, None).unwrap());
        }
    }
    let mut random = Random::new(SEED);
    let samples = Samples::PerPixel(1);
    let params = ready.buffers.render_params(&ready.picture.camera, ready.picture.size, samples, DEPTH, None);
    for tracer in &mut devices {
        let at = CameraSample { x: 0.25, y: 0.625, footprint: 1.0 };
        let picture = tracer.render(&params, &[at], &|_| ()).unwrap();
        // Some pixels in any order, some twice, and no whole number of rows.
        let places: Vec<_> = (0..131).map(|_| (random.below(21), random.below(21))).collect();
        let positions: Vec<_> =
            places.iter().map(|&(x, y)| CameraSample { x: x as f32 + at.x, y: y as f32 + at.y, ..at }).collect();
        let list = tracer.render(&params.of_list(131), &positions, &|_| ()).unwrap();
        assert_eq!((list.film.width, list.film.height), (131, 1));
        assert_eq!(list.counts[0], 131);
        for (&(x, y), pixel) in places.iter().zip(&list.film.pixels) {
            assert_eq!(pixel.map(f32::to_bits), picture.film.pixels[y * 21 + x].map(f32::to_bits), "{x}, {y}");
        }
    }
}

#[test]
fn device_and_twin_take_the_same_samples_and_render_the_same_bits() {
    let Some(device) = device() else { return };
    let packets = TraceOptions {
        structure: Structure::of(StructureKind::Bvh8),
        packet_size: PacketSize::Sixteen,
        ..ALL_FEATURES
    };
    let picture = PictureOptions { kernels: Kernels::Wavefront, ..ALL_FEATURES.picture };
    for (options, error) in [
        (packets, 0.5),
        (TraceOptions { intersector: Intersector::MollerTrumbore, ..packets }, 0.5),
        (TraceOptions { picture, ..ALL_FEATURES }, 2.0),
        (ALL_FEATURES, 8.0),
    ] {
        let scene = load(own_scene("cornell.toml")).unwrap();
        let ready = Ready::new(scene, (45, 37), Samples::Error(error), options);
        let twins = ready.render(ready.reference().as_mut());
        let stats = taken(&twins);
        assert!(stats.rounds > 1 && stats.estimated_error <= error, "{stats:?}");
        let camera_rays: u64 = stats.pixels.iter().zip(LEVEL_SAMPLES).map(|(&n, samples)| n * u64::from(samples)).sum();
        assert_eq!(twins.counts[0], camera_rays, "every ray is a sample of a pixel");
        for decisions in [Decisions::Host, Decisions::Device] {
            let options = TraceOptions { picture: PictureOptions { decisions, ..options.picture }, ..options };
            let mut on_device = open_tracer(Some(&device), &ready.buffers, &options, DEPTH, None).unwrap();
            for picture in ["first", "second"] {
                let ours = ready.render(on_device.as_mut());
                assert_eq!(bits(&ours.film), bits(&twins.film), "error {error}, {decisions}, {picture}");
                assert_eq!(ours.counts, twins.counts, "error {error}, {decisions}, {picture}");
                assert_eq!(taken(&ours), stats, "error {error}, {decisions}, {picture}");
                assert_eq!(ours.adaptive.unwrap().decided_by, decisions);
                assert_eq!(ours.second_pass.is_some(), options.intersector == Intersector::Exact);
            }
        }
    }
}

/// What a picture took, but for time.
fn taken(result: &RenderResult) -> AdaptiveStats {
    AdaptiveStats { decide_s: 0.0, decided_by: Decisions::Auto, ..result.adaptive.unwrap() }
}

#[test]
fn the_device_decides_of_pictures_of_any_shape_and_lattice_what_the_host_decides() {
    let Some(device) = device() else { return };
    let scene = load(own_scene("spheres.toml")).unwrap();
    let options = TraceOptions {
        picture: PictureOptions { decisions: Decisions::Device, ..ALL_FEATURES.picture },
        ..ALL_FEATURES
    };
    for (size, lattice, error) in [
        ((1, 1), 1, 1.0),
        ((1, 1), 8, 1.0),
        ((1, 9), 2, 0.7),
        ((7, 1), 3, 1.0),
        ((2, 2), 100, 0.0),
        ((9, 5), 0, 0.5),
        ((8, 8), 4, 4.0),
        ((65, 50), 1, 0.3),
        ((65, 50), 2, 2.0),
        ((70, 33), 5, 255.0),
        ((24, 24), 3, 0.0),
        // Two blocks; two areas, of which one is smaller.
        ((560, 360), 1, 2.0),
        ((560, 360), 3, 6.0),
        ((3201, 7), 8, 4.0),
    ] {
        let ready = Ready::new(scene.clone(), size, Samples::Error(error), options);
        let params = ready.buffers.render_params(&ready.picture.camera, size, Samples::Error(error), DEPTH, None);
        let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
        let mut on_device = open_tracer(Some(&device), &ready.buffers, &options, DEPTH, None).unwrap();
        let ours = render_adaptive(on_device.as_mut(), &params, adaptive, &|_| ()).unwrap();
        let twins = render_adaptive(ready.reference().as_mut(), &params, adaptive, &|_| ()).unwrap();
        assert_eq!(bits(&ours.film), bits(&twins.film), "{size:?}, lattice {lattice}");
        assert_eq!(ours.counts, twins.counts, "{size:?}, lattice {lattice}");
        assert_eq!(taken(&ours), taken(&twins), "{size:?}, lattice {lattice}");
    }
}

/// Of as many rays as a tile may have, and of fewer: tiles are not divided. Small, because `tests/runtimes.sh` has it
/// checked for races.
#[test]
fn short_lists_make_the_same_picture() {
    let Some(device) = device() else { return };
    let mut scene = crate::common::scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]]);
    scene.materials[0].emission = Vec3::splat(0.5);
    scene.camera = Some(Camera { eye: Vec3::new(0.4, 0.3, 3.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 30.0 });
    let options = TraceOptions {
        picture: PictureOptions { decisions: Decisions::Device, ..PictureOptions::DEFAULT },
        ..TraceOptions::DEFAULT
    };
    for (error, lattice) in [(3.0, 1), (8.0, 2)] {
        let ready = Ready::new(scene.clone(), (19, 12), Samples::Error(error), options);
        let size = ready.picture.size;
        let params = ready.buffers.render_params(&ready.picture.camera, size, Samples::Error(error), DEPTH, None);
        let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
        let twins = render_adaptive(ready.reference().as_mut(), &params, adaptive, &|_| ()).unwrap();
        let mut on_device = open_tracer(Some(&device), &ready.buffers, &options, DEPTH, None).unwrap();
        for list_rays in [1, Adaptive::LIST_RAYS] {
            let adaptive = Adaptive { list_rays, ..adaptive };
            let short = render_adaptive(ready.reference().as_mut(), &params, adaptive, &|_| ()).unwrap();
            let ours = render_adaptive(on_device.as_mut(), &params, adaptive, &|_| ()).unwrap();
            for picture in [&short, &ours] {
                assert_eq!(bits(&picture.film), bits(&twins.film), "lattice {lattice}, lists of {list_rays}");
                assert_eq!(picture.counts, twins.counts, "lattice {lattice}, lists of {list_rays}");
                assert_eq!(taken(picture), taken(&twins), "lattice {lattice}, lists of {list_rays}");
            }
        }
    }
}

#[test]
fn threads_decide_nothing() {
    let ready = Ready::of_file(&own_scene("chess.toml"), 64, 1.0);
    let films = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| ready.render(ready.reference().as_mut()))
    });
    assert_eq!(bits(&films[0].film), bits(&films[1].film));
    assert_eq!(films[0].counts, films[1].counts);
}

#[test]
fn no_error_means_the_full_picture_where_there_is_anything_to_see() {
    let ready = Ready::of_file(&own_scene("cornell.toml"), 24, 0.0);
    let result = ready.render(ready.reference().as_mut());
    let stats = result.adaptive.unwrap();
    let full = ready.full(ready.reference().as_mut());
    let same = result.film.pixels.iter().zip(&full.pixels).filter(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits));
    let complete = *stats.pixels.last().unwrap();
    assert!(complete > 400, "{stats:?}");
    assert!(same.count() as u64 >= complete, "{stats:?}");
    assert!(error_in_steps(&full, &result.film) < 0.1, "{stats:?}");
}

/// What is asked for is kept, and what is estimated is near what is: on every scene, for three errors. On a device, if
/// there is one, which renders the twin's pixels in less time: those of the largest error are compared. One kernel for
/// all scenes.
fn assert_bound_is_kept(path: &Path, side: u32) {
    let device = device();
    let options = TraceOptions {
        picture: PictureOptions { features: KernelFeatures::All, ..PictureOptions::DEFAULT },
        packet_size: device.as_ref().map_or(PacketSize::One, |_| PacketSize::Sixteen),
        ..TraceOptions::of(StructureKind::Bvh8)
    };
    let mut scene = load(path).unwrap();
    // Rooms, too, are seen from outside, as they were when the bound was measured. From inside a detail that lies
    // between all samples of a small picture can weigh more: `cornell_box.obj` at 48x48 makes 1.37 where 1 is asked
    // for.
    let points: Vec<Vec3> = scene.hittable().iter().flat_map(|&i| scene.vertices(i as usize)).collect();
    scene.camera = scene.camera.or(Some(Camera::framing(points.iter().copied(), 1.0)));
    let first = Ready::new(scene, (side, side), Samples::Error(1.0), options);
    let mut tracer = open_tracer(device.as_ref(), &first.buffers, &options, DEPTH, None).unwrap();
    let full = first.full(tracer.as_mut());
    let mut rays = u64::MAX;
    for error in [0.5, 1.0, 4.0] {
        let picture = Picture { samples: Samples::Error(error), ..first.picture };
        let ready = Ready { buffers: first.buffers.clone(), picture, options };
        let result = ready.render(tracer.as_mut());
        if device.is_some() && error == 4.0 {
            let twins = ready.render(ready.reference().as_mut());
            assert_eq!(bits(&result.film), bits(&twins.film), "{}", path.display());
        }
        let (stats, made) = (result.adaptive.unwrap(), error_in_steps(&full, &result.film));
        let asked = f64::from(error);
        eprintln!(
            "{}: asked {asked}, estimated {}, made {made:.3}, {} rays",
            path.display(),
            stats.estimated_error,
            result.counts[0]
        );
        assert!(stats.estimated_error <= error, "{}: {stats:?}", path.display());
        assert!(made <= BOUND * asked, "{}: asked {asked}, made {made}, {stats:?}", path.display());
        assert!(result.counts[0] <= rays, "{}: more rays for a larger error", path.display());
        rays = result.counts[0];
    }
}

/// The estimate is one, not a proof: so much more than what was asked for is allowed. Of 28 scenes and three errors the
/// most was 1.12 (a box and gears in the studio's light; 82 of 86 kept 1.05, and all in the plain lamp's, 1.04). Before
/// a light background a dark detail that lies between all samples weighs more: of five other sizes, 40 to 160, the legs
/// of a spider made 2.1 times what was asked for at 40x40 pixels, and nothing else more than 1.24 times.
const BOUND: f64 = 1.15;

#[test]
fn the_error_asked_for_is_kept_on_our_scenes() {
    for name in usually_every(3, ["cornell.toml", "chess.toml", "glass.toml", "showcase.toml", "spheres.toml"]) {
        assert_bound_is_kept(&own_scene(name), if is_thorough() { 96 } else { 64 });
    }
}

#[test]
fn the_error_asked_for_is_kept_on_shared_scenes() {
    for folder in ["bunny", "cornell", "objects", "spd", "spider", "sponza", "spot", "viking-room"] {
        let Some(folder) = shared_scenes(folder) else { continue };
        let mut models: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        models.retain(|path| path.extension().is_some_and(|extension| extension == "obj" || extension == "ply"));
        models.sort();
        assert!(!models.is_empty());
        usually_every(2, models).for_each(|path| assert_bound_is_kept(&path, 48));
    }
}

#[test]
fn what_is_the_same_everywhere_takes_a_ray_for_each_point_of_the_lattice() {
    // A triangle that fills the picture, seen in ambient light alone.
    let mut scene =
        crate::common::scene_of(&[[Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)]]);
    scene.materials[0].emission = Vec3::splat(0.5);
    scene.default_light = DefaultLight::Plain; // that of the studio depends on where it is seen from
    scene.camera = Some(Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 });
    let ready = Ready::new(scene, (33, 18), Samples::Error(4.0), TraceOptions::DEFAULT);
    let result = ready.render(ready.reference().as_mut());
    let lattice = |count: u64| (count - 1).div_ceil(4) + 1;
    assert_eq!(result.counts[0], lattice(33) * lattice(18));
    assert!(result.film.pixels.iter().all(|pixel| *pixel == result.film.pixels[0]));
    assert_eq!(result.adaptive.unwrap().estimated_error, 0.0);
}

#[test]
fn pictures_of_any_shape_and_lattice_end() {
    let scene = load(own_scene("spheres.toml")).unwrap();
    for size in [(1, 1), (1, 9), (7, 1), (2, 2), (9, 5), (8, 8)] {
        let ready = Ready::new(scene.clone(), size, Samples::Error(1.0), TraceOptions::DEFAULT);
        let params = ready.buffers.render_params(&ready.picture.camera, size, Samples::PerPixel(1), DEPTH, None);
        for lattice in [0, 1, 2, 3, 8, 100] {
            for error in [0.0, 0.7, 255.0] {
                let adaptive = Adaptive { lattice, ..Adaptive::of_error(error) };
                let result = render_adaptive(ready.reference().as_mut(), &params, adaptive, &|_| ()).unwrap();
                assert_eq!(result.adaptive.unwrap().pixels.iter().sum::<u64>(), u64::from(size.0 * size.1));
                assert_eq!(result.film.non_finite(), 0);
            }
        }
    }
}

#[test]
fn work_is_counted_on_all_samples_of_a_pixel() {
    let options = TraceOptions { counters: true, ..TraceOptions::DEFAULT };
    let scene = load(own_scene("cornell.toml")).unwrap();
    let ready = Ready::new(scene, (20, 16), Samples::Error(1.0), options);
    let result = ready.render(ready.reference().as_mut());
    let work = result.work.unwrap();
    assert_eq!(work.len(), 20 * 16);
    let steps: u64 =
        work.iter().map(|pixel| u64::from(pixel.total().get(raybrook::low_level::shared::WorkCounter::Steps))).sum();
    assert!(steps > result.counts[0], "{steps}");
    if let Some(device) = device() {
        let options =
            TraceOptions { picture: PictureOptions { decisions: Decisions::Device, ..options.picture }, ..options };
        let mut on_device = open_tracer(Some(&device), &ready.buffers, &options, DEPTH, None).unwrap();
        let ours = ready.render(on_device.as_mut());
        assert_eq!(ours.work.unwrap(), work);
        assert_eq!(ours.adaptive.unwrap().decided_by, Decisions::Host, "who alone can add up what each ray took");
    }
    // Counting changes nothing in the picture.
    let plain = Ready { options: TraceOptions::DEFAULT, ..ready };
    assert_eq!(bits(&plain.render(plain.reference().as_mut()).film), bits(&result.film));
}
