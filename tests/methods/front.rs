//! The front door: its hits and pictures are those of what lies below, bit for bit, on every device, and its errors
//! name the culprit.

use crate::common::{SEED, device, scene_of, sheet, soup};
use glam::{DAffine3, DVec3, Vec3};
use raybrook::low_level::film::Film;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::random::Random;
use raybrook::low_level::renderer::{self, complete_as, open_tracer};
use raybrook::low_level::scene::{Aim, Samples};
use raybrook::low_level::tracer::is_hit;
use raybrook::scene::Transform;
use raybrook::{Builder, Camera, Error, Hit, Layer, Light, Material, Precision, Ray, Scene, Tracer, View, Viewpoint};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Names of the reference and of the device, if there is one.
fn devices() -> Vec<String> {
    let device = device().map(|device| device.info.index.to_string());
    std::iter::once("reference".to_owned()).chain(device).collect()
}

fn tracer_on(device: &str, scene: &Scene) -> Tracer {
    Tracer::builder(scene).device(device).build().unwrap()
}

/// What the reference answers below the front door.
fn low_level_hits(scene: &Scene, rays: &[Ray]) -> Vec<Option<Hit>> {
    let options = TraceOptions::DEFAULT;
    let buffers = Arc::new(SceneBuffers::new(scene, &options).unwrap());
    let ray = |i: usize| (Vec3::from(rays[i].origin), Vec3::from(rays[i].direction), rays[i].t_min, rays[i].t_max);
    let batch = buffers.batch(rays.len(), ray, None);
    let mut tracer = open_tracer(None, &buffers, &options, 1, None).unwrap();
    let hits = tracer.trace(&batch.job(false, 1), &|_| ()).unwrap().hits;
    let front = |hit: &raybrook::low_level::shared::Hit| Hit { t: hit.t, u: hit.u, v: hit.v, triangle: hit.primitive };
    hits.iter().map(|hit| is_hit(hit).then(|| front(hit))).collect()
}

fn bits(hits: &[Option<Hit>]) -> Vec<Option<[u32; 4]>> {
    hits.iter().map(|hit| hit.map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.triangle])).collect()
}

/// A ray in each of the unusual kinds, and rays of many lengths between them.
fn rays(random: &mut Random) -> Vec<Ray> {
    const LENGTHS: [f32; 4] = [1e-3, 1.0, 30.0, 1e6];
    let nonsense = [f32::NAN, f32::INFINITY, 0.0];
    let usual = (0..3000).map(|i| {
        let origin = random.vec3() * 2.0;
        let ray = Ray::new(origin.into(), ((random.vec3() - origin) * LENGTHS[i % 4]).into());
        if i % 5 == 0 { ray.between(0.2 / LENGTHS[i % 4], 0.9 / LENGTHS[i % 4]) } else { ray }
    });
    let mut rays: Vec<Ray> = usual.collect();
    let aimed = |origin| Ray::new(origin, [0.01, 0.02, -1.0]);
    rays.extend(nonsense.map(|x| Ray::new([0.0, 0.0, 3.0], [x, 0.0, -x])));
    rays.extend(nonsense.map(|x| aimed([0.0, x, 3.0])));
    rays.extend([aimed([0.0, 0.0, 3.0]).between(f32::NAN, 9.0), aimed([0.0, 0.0, 3.0]).between(9.0, 1.0)]);
    for tiny_or_large in [1e-45, 1e-38, 1e30, 3e38] {
        rays.push(Ray::new([tiny_or_large, 0.1, 3.0], [0.0, 0.0, -1.0]));
        rays.push(Ray::new([0.05, 0.1, tiny_or_large], [0.0, 0.0, -1.0]));
        rays.push(Ray::new([0.05, 0.1, 3.0], [0.0, 0.0, -tiny_or_large]));
    }
    rays
}

#[test]
fn hits_are_those_of_a_batch_below() {
    let mut random = Random::new(SEED);
    let [near, moved, small] =
        [(1.0, Vec3::ZERO), (40.0, Vec3::new(7.0, -300.0, 0.1)), (1e-20, Vec3::ZERO)].map(|(scale, offset)| {
            let triangles = [soup(300, 0.2, &mut random), sheet(12)].concat();
            let placed: Vec<_> = triangles.iter().map(|t| t.map(|p| p * scale + offset)).collect();
            let positions: Vec<[f32; 3]> = placed.iter().flatten().map(|p| p.to_array()).collect();
            let numbers: Vec<[u32; 3]> = (0..placed.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let scene = Scene::from_mesh(&positions, &numbers).unwrap();
            let place = |p: [f32; 3]| (Vec3::from(p) * scale + offset).to_array();
            let rays = rays(&mut random).into_iter().map(|ray| Ray { origin: place(ray.origin), ..ray });
            (scene, rays.collect::<Vec<Ray>>())
        });
    for (scene, rays) in [near, moved, small] {
        let expected = low_level_hits(&scene, &rays);
        let count = expected.iter().flatten().count();
        assert!(count > 100 && count < rays.len() - 100, "{count} hits");
        for device in devices() {
            let mut tracer = tracer_on(&device, &scene);
            assert_eq!(bits(&tracer.closest_hits(&rays).unwrap()), bits(&expected), "{device}");
            let any: Vec<bool> = expected.iter().map(Option::is_some).collect();
            assert_eq!(tracer.any_hits(&rays).unwrap(), any, "{device}");
            assert_eq!(tracer.closest_hits(&[]).unwrap(), []);
        }
    }
}

/// The device, if there is one, and the reference; or the reference by itself, which is no sharing.
fn several() -> String {
    device().map_or("reference".to_owned(), |device| format!("{},reference", device.info.index))
}

#[test]
fn several_devices_share_a_batch_with_the_answers_of_one() {
    let mut random = Random::new(SEED);
    let triangles = [soup(300, 0.2, &mut random), sheet(12)].concat();
    let positions: Vec<[f32; 3]> = triangles.iter().flatten().map(|p| p.to_array()).collect();
    let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let scene = Scene::from_mesh(&positions, &numbers).unwrap();
    let some = rays(&mut random);
    // Two runs of a processor: some rays at both ends and at the border, between them such as miss.
    let run = 1 << 18;
    let mut all = vec![Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, 1.0]); run + 2 * some.len()];
    let places = [0, run - some.len() / 2, all.len() - some.len()].map(|at| at..at + some.len());
    places.iter().for_each(|place| all[place.clone()].copy_from_slice(&some));
    let device = several();
    let mut tracer = tracer_on(&device, &scene);
    assert_eq!(tracer.device_count(), device.split(',').count());
    assert!(tracer.device_name().ends_with("reference"), "{}", tracer.device_name());
    let mut one = tracer_on("reference", &scene);
    let closest = low_level_hits(&scene, &some);
    let of_rays = closest.iter().flatten().count();
    let found = tracer.closest_hits(&all).unwrap();
    assert!(of_rays > 100 && found.iter().flatten().count() == 3 * of_rays);
    let (counts, listed) = (one.count_hits(&some).unwrap(), one.first_hits(&some, 2).unwrap());
    let (all_counts, all_listed) = (tracer.count_hits(&all).unwrap(), tracer.first_hits(&all, 2).unwrap());
    assert_eq!(all_counts.iter().sum::<u32>(), 3 * counts.iter().sum::<u32>());
    assert_eq!(all_listed.hits().len(), 3 * listed.hits().len());
    for place in places {
        assert_eq!(bits(&found[place.clone()]), bits(&closest));
        assert_eq!(all_counts[place.clone()], counts);
        (0..some.len()).for_each(|i| assert_eq!(all_listed.of_ray(place.start + i), listed.of_ray(i)));
    }
    assert_eq!(tracer.notes(), [""; 0]);
}

#[test]
fn several_devices_share_pictures_with_the_pixels_of_one() {
    let scene = balls();
    let mut tracer = tracer_on(&several(), &scene);
    let mut one = tracer_on("reference", &scene);
    // Bands, areas of a picture by its error, parts of both, layers, and how pixels were sampled.
    let wide = || View::new(2100, 90);
    let views = [
        wide().samples(2).depth(3),
        wide().error(2.0).depth(1),
        wide().samples(1).crop(1000, 11, 300, 60),
        wide().error(2.0).crop(1000, 11, 300, 60),
        View::new(64, 48).samples(1).layers(&[Layer::Depth]),
        View::new(64, 48).error(2.0).layers(&[Layer::Samples]),
    ];
    for view in &views {
        let (found, expected) = (tracer.render(view).unwrap(), one.render(view).unwrap());
        assert!(found.pixels() == expected.pixels() && found.layers() == expected.layers(), "{view:?}");
        assert!(found.camera_rays() > 0, "{view:?}");
    }
    assert!(tracer.render(&wide().crop(2000, 0, 200, 9)).is_err());
    let blocks = views[0].blocks(&scene).unwrap().numbers();
    let some: Vec<usize> = blocks.iter().rev().copied().collect();
    let (found, expected) = (tracer.render_blocks(&views[0], &some), one.render_blocks(&views[0], &some));
    assert!(found.unwrap() == expected.unwrap());
}

#[test]
fn what_stops_the_work_of_several_devices_leaves_them_as_they_were() {
    let scene = balls();
    let (stop, told) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
    let tell = {
        let (stop, told) = (stop.clone(), told.clone());
        move |done: f64| {
            assert!((0.0..=1.0).contains(&done));
            if told.fetch_add(1, Ordering::Relaxed) == 0 {
                stop.store(true, Ordering::Relaxed);
            }
        }
    };
    let mut tracer = Tracer::builder(&scene).device(&several()).stop(stop.clone()).progress(tell).build().unwrap();
    let view = View::new(1100, 900).samples(1).depth(2);
    assert!(matches!(tracer.render(&view), Err(Error::Stopped)));
    stop.store(false, Ordering::Relaxed);
    let again = tracer.render(&view).unwrap();
    assert!(told.load(Ordering::Relaxed) > 1 && tracer.device_count() == several().split(',').count());
    assert!(again.pixels() == tracer_on("reference", &scene).render(&view).unwrap().pixels());
}

#[test]
fn a_device_is_named_once() {
    let refused = Tracer::builder(&balls()).device("reference,reference").build().unwrap_err().to_string();
    assert!(refused.contains("'reference' is a device that was named before"), "{refused}");
    assert!(Tracer::builder(&balls()).device("reference,toaster").build().unwrap_err().to_string().contains("toaster"));
}

#[test]
fn numbers_at_both_ends_of_float32_are_exact() {
    let scene = Scene::from_mesh(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], &[[0, 1, 2]]).unwrap();
    let down = [0.0, 0.0, -1.0];
    let cases = [
        (Ray::new([1.0, 1.0, 1e30], down), Some(1e30)),
        (Ray::new([1e-45, 1.0, 2.0], down), Some(2.0)), // inside by the smallest float
        (Ray::new([-1e-45, 1.0, 2.0], down), None),     // and outside
        (Ray::new([1.0, 1.0, 1e-45], down), Some(1e-45)),
        (Ray::new([1.0, 1.0, 2.0], [0.0, 0.0, -1e-45]), None), // t is beyond the largest float
        (Ray::new([1.0, 1.0, 2.0], down).between(2.0, 2.0), Some(2.0)),
        (Ray::new([1.0, 1.0, 2.0], down).between(0.0, 2f32.next_down()), None),
        (Ray::new([1.0, 1.0, 2.0], down).between(2f32.next_up(), 9.0), None),
        (Ray::new([0.0, 0.0, 2.0], down), Some(2.0)), // a vertex
    ];
    let rays = cases.map(|case| case.0);
    for device in devices() {
        let hits = tracer_on(&device, &scene).closest_hits(&rays).unwrap();
        for ((ray, t), hit) in cases.iter().zip(hits) {
            assert_eq!(hit.map(|hit| hit.t), *t, "{device}: {ray:?}");
        }
    }
}

/// A mirror ball and a glass one on a floor, without light or camera.
fn balls() -> Scene {
    let mut builder = Builder::new();
    builder.material(Material::matt(Vec3::new(0.7, 0.6, 0.4)));
    builder.quad(Vec3::new(-3.0, -1.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, 1);
    builder.material(Material { mirror: Vec3::splat(0.6), ..Material::matt(Vec3::splat(0.2)) });
    builder.push().translate(Vec3::X * 1.2).sphere(1.0, 16).pop();
    builder.material(Material { transmission: Vec3::splat(0.9), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.push().translate(Vec3::X * -1.2).sphere(1.0, 16).pop();
    builder.finish().unwrap()
}

/// The picture below the front door, as the command line makes it.
fn low_level_film(scene: Scene, size: (u32, u32), samples: Samples, depth: u32) -> Film {
    film_of(scene, &Aim::default(), size, samples, depth)
}

/// The same with parts of the camera.
fn film_of(mut scene: Scene, aim: &Aim, size: (u32, u32), samples: Samples, depth: u32) -> Film {
    complete_as(&mut scene, samples.aspect(size) as f32, aim);
    let options = TraceOptions::DEFAULT;
    let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
    let picture = renderer::Picture { camera: scene.camera.unwrap(), size, samples, depth, kill_weight: None };
    let mut tracer = open_tracer(None, &buffers, &options, depth, None).unwrap();
    renderer::render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap().film
}

#[test]
fn pictures_are_those_of_a_picture_below() {
    let camera = Camera { eye: Vec3::new(0.5, 2.0, 6.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 };
    let bare = balls();
    let lamp = Light::point(Vec3::new(3.0, 6.0, 4.0), Vec3::splat(0.9));
    let lit = Scene { camera: Some(camera), lights: vec![lamp], ..balls() };
    for device in devices() {
        let mut of_bare = tracer_on(&device, &bare);
        let mut of_lit = tracer_on(&device, &lit);
        // Sizes of several aspects, each with a framing camera and a key light of its own, and chains that grow.
        for (size, samples, depth) in [
            ((32, 24), Samples::PerPixel(1), 4),
            ((24, 40), Samples::PerPixel(4), 12),
            ((32, 24), Samples::Error(2.0), 8),
        ] {
            let view = View::new(size.0, size.1).depth(depth);
            let view = match samples {
                Samples::Error(error) => view.error(error),
                fixed => view.samples(fixed.per_pixel()),
            };
            for (tracer, scene) in [(&mut of_bare, &bare), (&mut of_lit, &lit)] {
                let picture = tracer.render(&view).unwrap();
                let film = low_level_film(scene.clone(), size, samples, depth);
                assert_eq!((picture.width(), picture.height()), size);
                assert!(picture.pixels() == film.pixels, "{device} {size:?} {samples:?}");
                assert_eq!(picture.to_srgb8(), film.to_srgb8().as_flattened());
                assert!(picture.camera_rays() >= u64::from(size.0 * size.1) / 4);
                assert!(picture.all_rays() > picture.camera_rays());
            }
        }
        // Rays between pictures.
        let rays = rays(&mut Random::new(SEED));
        assert_eq!(bits(&of_bare.closest_hits(&rays).unwrap()), bits(&low_level_hits(&bare, &rays)));
        // A camera of the view's own: that of the scene has no part in it.
        let view = View::new(32, 24).samples(1).camera(Camera { fov_degrees: 20.0, ..camera });
        let other = Scene { camera: Some(Camera { fov_degrees: 20.0, ..camera }), ..lit.clone() };
        let film = low_level_film(other, (32, 24), Samples::PerPixel(1), 8);
        assert!(of_lit.render(&view).unwrap().pixels() == film.pixels);
    }
}

/// Whatever of the camera a view says, the picture is the one below: with a light of its own, and with one that moves
/// with the camera.
#[test]
fn parts_of_a_camera_are_those_of_a_picture_below() {
    let camera = Camera { eye: Vec3::new(0.5, 2.0, 6.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 };
    let lamp = Light::point(Vec3::new(3.0, 6.0, 4.0), Vec3::splat(0.9));
    let bare = Scene { up: Some(Vec3::Z), ..balls() };
    let lit = Scene { camera: Some(camera), lights: vec![lamp], ..balls() };
    let view = View::new(16, 12).samples(1);
    let (eye, target, up) = (Vec3::new(-4.0, 1.0, 3.0), Vec3::new(0.5, 0.0, 0.25), Vec3::NEG_X);
    let aims = [
        (view.eye(eye.into()), Aim { eye: Some(eye), ..Aim::default() }),
        (view.target(target.into()).fov(30.0), Aim { target: Some(target), fov_degrees: Some(30.0), ..Aim::default() }),
        (view.up(up.into()), Aim { up: Some(up), ..Aim::default() }),
        (view.camera(camera).eye(eye.into()).fov(9.0), Aim { eye: Some(eye), fov_degrees: Some(9.0), ..camera.into() }),
        (view, Aim::default()),
    ];
    let views = Viewpoint::ALL.iter().map(|&viewpoint| {
        let aim = Aim { up: Some(up), viewpoint: Some(viewpoint), ..Aim::default() };
        (view.up(up.into()).viewpoint(viewpoint), aim)
    });
    let all: Vec<_> = aims.into_iter().chain(views).collect();
    for scene in [&bare, &lit] {
        let mut tracer = tracer_on("reference", scene);
        let mut films = Vec::new();
        for (view, aim) in &all {
            let film = film_of(scene.clone(), aim, (16, 12), Samples::PerPixel(1), 8);
            assert!(tracer.render(view).unwrap().pixels() == film.pixels, "{aim:?}");
            assert!(!films.contains(&film), "{aim:?}");
            films.push(film);
        }
    }
}

/// The lamp of a scene without light is of another kind inside, and so are the kernels.
#[test]
fn every_device_lights_a_scene_from_inside_and_outside_in_turn() {
    let bare = Scene { up: Some(Vec3::Z), ..balls() };
    let aims = [Aim::default(), Aim { viewpoint: Some(Viewpoint::Inside), up: Some(Vec3::X), ..Aim::default() }];
    let views = [View::new(16, 12), View::new(16, 12).viewpoint(Viewpoint::Inside).up([1.0, 0.0, 0.0])];
    for device in devices() {
        let mut tracer = tracer_on(&device, &bare);
        for (view, aim) in [0, 1, 0].map(|i| (views[i].samples(1), &aims[i])) {
            let film = film_of(bare.clone(), aim, (16, 12), Samples::PerPixel(1), 8);
            assert!(tracer.render(&view).unwrap().pixels() == film.pixels, "{device} {aim:?}");
        }
    }
}

#[test]
fn a_picture_is_written_and_sized_as_the_scene_says() {
    let mut scene = balls();
    scene.picture.size = Some((8, 6));
    let mut tracer = tracer_on("reference", &scene);
    let picture = tracer.render(&View::default().samples(1)).unwrap();
    assert_eq!((picture.width(), picture.height()), (8, 6));
    let folder = tempfile::tempdir().unwrap();
    for ending in ["png", "exr", "pfm"] {
        let path = folder.path().join("picture").with_extension(ending);
        picture.save(&path).unwrap();
        assert!(path.metadata().unwrap().len() > 50);
    }
    let error = picture.save(folder.path().join("picture.bmp")).unwrap_err().to_string();
    assert!(error.contains("picture.bmp"), "{error}");
}

#[test]
fn a_tracer_owns_what_it_needs_and_goes_to_another_thread() {
    let calls = Arc::new(AtomicUsize::new(0));
    let counter = calls.clone();
    let mut tracer = {
        let scene = balls();
        let progress = move |done: f64| {
            assert!((0.0..=1.0).contains(&done));
            counter.fetch_add(1, Ordering::Relaxed);
        };
        Tracer::builder(&scene).device("reference").progress(progress).build().unwrap()
    };
    let hits = std::thread::spawn(move || tracer.closest_hits(&[Ray::new([0.0, 9.0, 0.0], [0.0, -1.0, 0.0])]).unwrap());
    assert_eq!(hits.join().unwrap()[0].map(|hit| hit.t), Some(10.0));
    assert!(calls.load(Ordering::Relaxed) > 0);
}

#[test]
fn every_method_has_the_same_hits_and_says_what_it_is() {
    let scene = scene_of(&sheet(8));
    let rays = rays(&mut Random::new(SEED));
    let expected = bits(&low_level_hits(&scene, &rays));
    for method in ["brute", "kd+ropes", "median+restart", "bvh2", "bvh8", "grid", "octree", "boxes+exact"] {
        let mut tracer = Tracer::builder(&scene).device("reference").method(method).cache(false).build().unwrap();
        assert_eq!(bits(&tracer.closest_hits(&rays).unwrap()), expected, "{method}");
        let choices = tracer.choices().join("\n");
        let structure = match method.split('+').next().unwrap() {
            "median" => "kd",
            structure => structure,
        };
        assert!(choices.contains(&format!("structure {structure}: ")), "{choices}");
        assert_eq!(tracer.device_name(), "reference");
        assert_eq!(tracer.notes(), Vec::<String>::new());
    }
    let fast = Tracer::builder(&scene).device("reference").precision(Precision::Fast).build().unwrap();
    assert!(fast.choices().iter().any(|choice| choice.starts_with("intersector moller-trumbore")));
}

/// What a tracer says of rays (closest hits, counts), of points where some of them start, and in a picture, to the bit.
fn answers(tracer: &mut Tracer, rays: &[Ray]) -> (Vec<Option<[u32; 4]>>, Vec<u32>, Vec<u8>) {
    let hits = bits(&tracer.closest_hits(rays).unwrap());
    let mut counts = tracer.count_hits(rays).unwrap();
    let origins: Vec<[f32; 3]> = rays[..100].iter().map(|ray| ray.origin).collect();
    counts.extend(tracer.distances(&origins).unwrap().iter().map(|distance| distance.to_bits()));
    counts.extend(tracer.winding_numbers(&origins).unwrap().iter().map(|number| (*number as f32).to_bits()));
    (hits, counts, tracer.render(&View::new(24, 16).samples(1)).unwrap().to_srgb8())
}

#[test]
fn a_moving_scene_has_the_answers_of_a_new_one() {
    let mut random = Random::new(SEED);
    let triangles = [soup(200, 0.2, &mut random), sheet(8)].concat();
    let positions: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let rays = rays(&mut random);
    let at = |amount: f32| -> Vec<[f32; 3]> {
        let moved = |&p: &Vec3| p + amount * Vec3::new(7.0 * p.y, 7.0 * p.z, 7.0 * p.x).map(f32::sin);
        positions.iter().map(|p| moved(p).to_array()).collect()
    };
    // Triangles that lose their area, and get it back.
    let flattened: Vec<[f32; 3]> = positions.iter().map(|p| [p.x, p.y, if p.y > 0.3 { 0.5 } else { p.z }]).collect();
    let collapsed: Vec<[f32; 3]> = (0..positions.len()).map(|i| positions[i / 6 * 6].to_array()).collect();
    let half: Vec<[f32; 3]> =
        at(0.1).into_iter().enumerate().map(|(i, p)| if i < 90 { collapsed[i] } else { p }).collect();
    let shapes = [at(0.0), at(0.01), at(0.3), half, at(0.02), flattened, at(3.0), collapsed, at(0.0)];
    let methods = devices().into_iter().flat_map(|device| ["bvh2", "bvh8", "kd", "grid"].map(|m| (device.clone(), m)));
    let mut compared = 0;
    // Of devices one method: others would only have more kernels compiled.
    for (device, method) in methods.filter(|(device, method)| device == "reference" || *method == "bvh8") {
        let open = |scene: &Scene| Tracer::builder(scene).device(&device).method(method).build().unwrap();
        let mut scene = Scene::from_mesh(&shapes[0], &numbers).unwrap();
        let mut tracer = open(&scene);
        for (i, shape) in shapes.iter().enumerate() {
            scene.update_vertices(shape).unwrap();
            tracer.update(&scene).unwrap();
            let expected = answers(&mut open(&scene), &rays);
            assert!(answers(&mut tracer, &rays) == expected, "{device}, {method}, shape {i}");
            compared += expected.0.iter().flatten().count();
        }
        let mut nowhere = scene.clone();
        nowhere.positions[0].x = f32::NAN;
        nowhere.lights.push(Light::point(Vec3::NAN, Vec3::ONE));
        let before = answers(&mut tracer, &rays);
        assert!(matches!(tracer.update(&nowhere), Err(Error::Scene(_))));
        assert!(answers(&mut tracer, &rays) == before, "{device}, {method}: a refused update changes nothing");
    }
    assert!(compared > 50_000, "{compared} hits");
}

#[test]
fn moving_instances_have_the_answers_of_new_ones() {
    let mut builder = Builder::new();
    let object = builder.begin_object().sphere(0.3, 12).end_object();
    builder.cuboid(Vec3::new(2.0, 0.1, 2.0));
    for i in 0..4 {
        builder.push().translate(Vec3::new(0.5 * i as f32 - 0.8, 0.3, 0.0)).instance(object, None).pop();
    }
    let mut scene = builder.finish().unwrap();
    let rays = rays(&mut Random::new(SEED));
    for method in ["instances", "bvh2"] {
        let open = |scene: &Scene| Tracer::builder(scene).device("reference").method(method).build().unwrap();
        let mut tracer = open(&scene);
        let mut last = answers(&mut tracer, &rays);
        for turn in 1..4 {
            let angle = f64::from(turn);
            let place =
                DAffine3::from_rotation_y(angle) * DAffine3::from_translation(DVec3::new(0.4, 0.1 * angle, 0.2));
            scene.instances.set_transform(2, Transform::new(place).unwrap()).unwrap();
            tracer.update(&scene).unwrap();
            let found = answers(&mut tracer, &rays);
            assert!(found == answers(&mut open(&scene), &rays), "{method}, turn {turn}");
            assert!(found.0 != last.0, "{method}, turn {turn}: the instance has moved");
            last = found;
        }
    }
    let far = Transform::new(DAffine3::from_translation(DVec3::splat(3e38))).unwrap();
    let message = |result: raybrook::Result<()>| result.unwrap_err().to_string();
    assert!(message(scene.instances.set_transform(2, far)).contains("out of float32's range"));
    assert!(message(scene.instances.set_transform(4, far)).contains("no instance number 4"));
    assert!(message(scene.update_vertices(&[[0.0; 3]])).contains("there are 1 positions"));
    let positions = vec![[f32::INFINITY; 3]; scene.positions.len()];
    assert!(message(scene.update_vertices(&positions)).contains("vertex 0 of the mesh"));
}

#[test]
fn errors_name_the_culprit() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mesh = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| Scene::from_mesh(positions, triangles).map(|_| ());
    let scene = Scene::from_mesh(&corners, &[[0, 1, 2]]).unwrap();
    let build = |builder: raybrook::TracerBuilder| builder.device("reference").build().map(|_| ());
    let by_hand = |change: fn(&mut Scene)| {
        let mut scene = scene.clone();
        change(&mut scene);
        Tracer::new(&scene).map(|_| ())
    };
    let render = |view: View| tracer_on("reference", &scene).render(&view).map(|_| ());
    let blind = Camera { eye: Vec3::ONE, target: Vec3::ONE, up: Vec3::Y, fov_degrees: 40.0 };
    let cases: Vec<(&str, Result<(), Error>)> = vec![
        ("triangle 1 names vertex 3, but the mesh has 3 vertices", mesh(&corners, &[[0, 1, 2], [0, 3, 9]])),
        ("the mesh has no triangles", mesh(&corners, &[])),
        ("vertex 1 of the mesh is (NaN, 0, 0)", mesh(&[[0.0; 3], [f32::NAN, 0.0, 0.0]], &[[0, 0, 1]])),
        ("no-such-scene.obj", Scene::load("no-such-scene.obj").map(|_| ())),
        ("no device is called 'voodoo'", Tracer::builder(&scene).device("voodoo").build().map(|_| ())),
        ("method: no 'best'", build(Tracer::builder(&scene).method("kd+best"))),
        ("traversal: means nothing to `structure = grid`", build(Tracer::builder(&scene).method("grid+ropes"))),
        (
            "precision: 'fast', but the method names the triangle test 'plucker'",
            build(Tracer::builder(&scene).method("plucker").precision(Precision::Fast)),
        ),
        ("the memory limit is 1.0 MiB", build(Tracer::builder(&scene).memory_limit(1 << 20))),
        ("triangle 0 names the vertices 0, 1, 7", by_hand(|scene| scene.triangles[0].positions[2] = 7)),
        ("material 4", by_hand(|scene| scene.triangles[0].material = 4)),
        ("ambient", by_hand(|scene| scene.ambient = Vec3::NAN)),
        ("size: 0x9", render(View::new(0, 9))),
        ("0 is not in 1 to 65536", render(View::new(9, 9).samples(0))),
        ("NaN is not in 0 to 255", render(View::new(9, 9).error(f32::NAN))),
        ("depth: 65 is not in 1 to 64", render(View::new(9, 9).depth(65))),
        ("eye: [1, 1, 1] is both the eye and the target", render(View::new(9, 9).camera(blind))),
        ("eye: [1, 1, NaN] is no place", render(View::new(9, 9).eye([1.0, 1.0, f32::NAN]))),
        ("target: [inf, 0, 0] is no place", render(View::new(9, 9).target([f32::INFINITY, 0.0, 0.0]))),
        ("up: [0, 0, 0] is zero", render(View::new(9, 9).up([0.0; 3]))),
        ("up: [0, 0, 2] is parallel to the view", render(View::new(9, 9).eye([0.5, 0.5, 3.0]).up([0.0, 0.0, 2.0]))),
        ("fov: 180 is no angle of view", render(View::new(9, 9).fov(180.0))),
        ("eye: `view = top` says itself", render(View::new(9, 9).viewpoint(Viewpoint::Top).eye([1.0; 3]))),
    ];
    for (words, result) in cases {
        let message = result.expect_err(words).to_string();
        assert!(message.contains(words), "'{words}' is missing in: {message}");
    }
}

#[test]
fn a_scene_too_large_for_a_camera_still_takes_rays() {
    let far = f32::MAX;
    let scene = Scene::from_mesh(&[[-far, -far, 0.0], [far, -far, 0.0], [0.0, far, 0.0]], &[[0, 1, 2]]).unwrap();
    let mut tracer = tracer_on("reference", &scene);
    let hits = tracer.closest_hits(&[Ray::new([0.0, 0.0, 1e30], [0.0, 0.0, -1e10])]).unwrap();
    assert_eq!(hits[0].map(|hit| hit.t), Some(1e20));
    let error = tracer.render(&View::new(8, 8)).unwrap_err().to_string();
    assert!(error.contains("give a camera"), "{error}");
    let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
    assert!(tracer.render(&View::new(8, 8).samples(1).camera(camera)).unwrap().pixels()[0][0] > 0.1);
}
