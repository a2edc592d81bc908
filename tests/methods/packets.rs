//! Packets of rays with exact hits: the closest hits of the twin, which traces one ray after the other, to the bit; and
//! of any hits one that is there. Packets of other triangle tests: `rounded_packets.rs`.

use crate::common::{Random, SEED, device, on_oclgrind, quick_device, scene_of, sheet, soup, usually_every};
use glam::Vec3;
use raybrook::low_level::accel::StructureStats;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{
    ArrayOptions, BvhOptions, KdOptions, KernelFeatures, Layout, Memory, PacketSize, PictureOptions, Structure,
    StructureKind, TraceOptions, TriangleOrder,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{Samples, load};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Backend, TraceJob, TraceResult, is_hit};
use std::sync::Arc;

pub(crate) const PACKETS: TraceOptions =
    TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::of(StructureKind::Bvh8) };

/// In a kd-tree.
pub(crate) const KD: TraceOptions = TraceOptions { structure: Structure::of(StructureKind::Kd), ..PACKETS };

/// The same, as deep as planes part triangles.
const KD_TO_THE_END: TraceOptions =
    TraceOptions { structure: Structure::Kd(KdOptions { cost_traverse: Some(0.0), ..KD.kd() }), ..KD };

pub(crate) const BRUTE: TraceOptions = TraceOptions::of(StructureKind::Brute);

pub(crate) fn ray(origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> TraceRay {
    TraceRay { origin_t_min: Float4::new(origin, t_min), direction_t_max: Float4::new(direction, t_max) }
}

/// Rays that go much the same way, from one point or from several, `of` rays at a time along another axis: what frusta
/// are made of, some of them too broad.
pub(crate) fn bundles(count: usize, of: usize, random: &mut Random) -> Vec<TraceRay> {
    let bundle = |random: &mut Random| {
        let from = random.vec3() * if random.bits() & 1 == 0 { 0.3 } else { 3.0 };
        let to = random.vec3();
        let width = if random.bits().is_multiple_of(4) { 1.0 } else { 0.2 } * random.unit();
        let spread = [0.0, 0.01, 0.5][random.bits() as usize % 3];
        let t_min = if random.bits().is_multiple_of(8) { -2.0 } else { 0.0 };
        (0..of)
            .map(|_| {
                let start = from + random.vec3() * spread;
                ray(start, to + random.vec3() * width - start, t_min, f32::INFINITY)
            })
            .collect::<Vec<_>>()
    };
    (0..count / of).flat_map(|_| bundle(random)).collect()
}

/// Rays of all directions, with limits of t, along axes, through vertices and edges of `triangles`, and with numbers
/// that no packet takes.
pub(crate) fn scattered(count: usize, triangles: &[[Vec3; 3]], random: &mut Random) -> Vec<TraceRay> {
    let inf = f32::INFINITY;
    (0..count)
        .map(|i| {
            let from = 3.0 * random.vec3();
            let [a, b, _] = triangles[random.bits() as usize % triangles.len()];
            match i % 11 {
                0..3 => ray(from, random.vec3() - from, 0.0, inf),
                3 => ray(random.vec3(), random.vec3(), 0.0, 0.3),
                4 => ray(from, random.vec3() - from, 0.9, 1.1),
                5 => ray(Vec3::new(from.x / 3.0, from.y / 3.0, 3.0), Vec3::NEG_Z * (1.0 + random.unit()), 0.0, inf),
                6 => ray(from, a - from, 0.0, inf),
                7 => ray(from, a.lerp(b, 0.5) - from, -1.0, inf),
                8 => ray(a, random.vec3(), 0.0, inf),
                9 => ray(from * 1e6, (random.vec3() - from * 1e6) * 1e-12, 0.0, inf),
                _ => {
                    let mut numbers = [from, random.vec3()].map(|v| v.to_array()).concat();
                    numbers.extend([0.0, inf]);
                    numbers[random.bits() as usize % 8] = random.any_float();
                    ray(Vec3::from_slice(&numbers), Vec3::from_slice(&numbers[3..]), numbers[6], numbers[7])
                }
            }
        })
        .collect()
}

pub(crate) fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

pub(crate) fn trace(tracer: &mut dyn Backend, rays: &[TraceRay], any_hit: bool) -> TraceResult {
    tracer.trace(&TraceJob { extreme: &[], rays, next_directions: None, any_hit, repeat: 1 }, &|_| ()).unwrap()
}

/// Asserts that packets give the twin's closest hits, and some hit where there is one: how many rays hit, and how many
/// took the second pass.
fn assert_answers(
    device: &DeviceHandle,
    options: &TraceOptions,
    triangles: &[[Vec3; 3]],
    rays: &[TraceRay],
) -> [usize; 2] {
    let buffers = Arc::new(SceneBuffers::new(&scene_of(triangles), options).unwrap());
    let mut tracer = open_tracer(Some(device), &buffers, options, 1, None).unwrap();
    let mut twin = ReferenceBackend::new(buffers.clone(), *options);
    let closest = trace(tracer.as_mut(), rays, false);
    let expected = trace(&mut twin, rays, false);
    for ((hit, twin), ray) in closest.hits.iter().zip(&expected.hits).zip(rays) {
        assert_eq!(bits(hit), bits(twin), "{options:?} {ray:?} (seed {SEED})");
    }
    // Some hit is there if a closest one is. It is a real one if its triangle alone is hit.
    let any = trace(tracer.as_mut(), rays, true);
    let brute = SceneBuffers::new(&scene_of(triangles), &BRUTE).unwrap();
    for (i, (hit, closest)) in any.hits.iter().zip(&expected.hits).enumerate() {
        assert_eq!(is_hit(hit), is_hit(closest), "{options:?} {:?} (seed {SEED})", rays[i]);
        assert_eq!([hit.t, hit.u, hit.v], if is_hit(hit) { [0.0; 3] } else { [f32::INFINITY, 0.0, 0.0] });
        if is_hit(hit) && hit.primitive != closest.primitive {
            let mut alone = brute.clone();
            alone.references = vec![hit.primitive];
            alone.params.reference_count = 1;
            let mut twin = ReferenceBackend::new(Arc::new(alone), BRUTE);
            let its_own = trace(&mut twin, &rays[i..=i], false).hits[0];
            assert!(is_hit(&its_own), "{options:?} {:?} (seed {SEED})", rays[i]);
        }
    }
    [closest.hits.iter().filter(|hit| is_hit(hit)).count(), closest.second_pass.unwrap_or(0) as usize]
}

#[test]
fn packets_find_the_hits_of_single_rays() {
    let (Some(device), Some(quick)) = (device(), quick_device()) else { return };
    let options = format!("{} -D MANY_REFERENCES=0u", quick.compiler_options());
    let far = quick.with_compiler_options(&options).unwrap();
    let mut random = Random::new(SEED);
    let mut hits = 0;
    // Triangles of all sizes, some without area, so many that the hierarchy is several levels deep; shared edges; one
    // triangle; none.
    let mut mixed = soup(300, 0.2, &mut random);
    mixed.extend(soup(5, 2.0, &mut random));
    mixed.extend(soup(300, 1e-4, &mut random));
    mixed.push([Vec3::ONE; 3]);
    // Several triangles at the same place: which is hit is a matter of numbers.
    mixed.extend_from_within(..20);
    for triangles in
        [mixed, sheet(24), sheet(3).iter().map(|t| t.map(|p| p * 1e18)).collect(), soup(1, 1.0, &mut random)]
    {
        let mut rays = bundles(1600, 16, &mut random);
        rays.extend(bundles(3200, 64, &mut random));
        rays.extend(bundles(1600, 32, &mut random));
        rays.extend(scattered(1600, &triangles, &mut random));
        hits += assert_answers(&device, &PACKETS, &triangles, &rays)[0];
        // As in structures that are far from a processor's cores, where leaves wait for their turn.
        assert_answers(&far, &PACKETS, &triangles, &rays);
        // As it is built for packets, with leaves of several packets of triangles, and deep with small ones.
        for kd in [
            KD,
            TraceOptions { structure: Structure::Kd(KdOptions { leaf_size: Some(40), ..KD.kd() }), ..KD },
            KD_TO_THE_END,
        ] {
            assert_answers(&device, &kd, &triangles, &rays);
        }
    }
    assert!(hits > 6000, "{hits} hits of 32000 rays");
    for options in [PACKETS, KD] {
        assert_eq!(assert_answers(&device, &options, &[], &bundles(32, 16, &mut random)), [0, 0]);
    }
}

/// A triangle that splits of space have put into several leaves is met again and again, by all rays of a packet.
#[test]
fn packets_meet_the_parts_of_a_triangle() {
    let Some(device) = quick_device() else { return };
    let mut random = Random::new(SEED);
    let long = soup(200, 2.0, &mut random).into_iter().map(|[a, b, c]| [a, b, b + (c - b) * 0.02]);
    let triangles: Vec<_> = long.chain(soup(200, 0.05, &mut random)).chain(soup(5, 2.0, &mut random)).collect();
    let options = TraceOptions {
        structure: Structure::Bvh8(BvhOptions {
            spatial_splits: Some(4.0.into()),
            leaf_size: Some(2),
            ..BvhOptions::DEFAULT
        }),
        ..PACKETS
    };
    let buffers = SceneBuffers::new(&scene_of(&triangles), &options).unwrap();
    let stats =
        StructureStats::new(options.kind(), &buffers.nodes, &buffers.references, &buffers.bounds, triangles.len());
    assert!(stats.references_per_triangle > 1.5, "{stats:?}");
    let mut rays = bundles(1600, 16, &mut random);
    rays.extend(bundles(3200, 64, &mut random));
    rays.extend(scattered(1600, &triangles, &mut random));
    let [hits, _] = assert_answers(&device, &options, &triangles, &rays);
    assert!(hits > rays.len() / 4, "{hits} hits of {} rays", rays.len());
}

#[test]
fn batches_of_every_length_are_traced_whole() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let triangles = sheet(8);
    let rays = bundles(6000, 40, &mut random);
    for options in [PACKETS, KD] {
        let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles), &options).unwrap());
        let mut tracer = open_tracer(Some(&device), &buffers, &options, 1, None).unwrap();
        let mut twin = ReferenceBackend::new(buffers.clone(), options);
        for length in (0..50).chain(60..70).chain([127, 128, 129, 190, 4095, 4096, 4097, rays.len()]) {
            let [hits, expected] =
                [&mut *tracer as &mut dyn Backend, &mut twin].map(|tracer| trace(tracer, &rays[..length], false).hits);
            assert!(hits.iter().map(bits).eq(expected.iter().map(bits)), "{length} rays, {options:?}");
        }
    }
}

/// Rows of an image are traced tile by tile (`src/device/rows.rs`); each hit is that of its own ray all the same.
#[test]
fn images_in_a_batch_keep_the_order_of_their_rays() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let triangles = sheet(24);
    let single = TraceOptions { packet_size: PacketSize::One, ..PACKETS };
    for (width, height, others) in [(64, 64, 0), (72, 43, 5), (40, 7, 0), (104, 17, 100)] {
        let pixel = |i: usize| {
            let to = Vec3::new((i % width) as f32 / width as f32 - 0.5, (i / width) as f32 / width as f32 - 0.3, -1.0);
            ray(Vec3::new(0.1, 0.2, 3.0), to, 0.0, f32::INFINITY)
        };
        let mut rays: Vec<_> = (0..width * height).map(pixel).collect();
        rays.extend(scattered(others, &triangles, &mut random));
        for options in [PACKETS, single] {
            let [hits, _] = assert_answers(&device, &options, &triangles, &rays);
            assert!(hits > rays.len() / 10, "{hits} hits of {} rays", rays.len());
        }
    }
}

/// Bundles and other rays through a sheet.
fn sheet_and_rays() -> (Vec<[Vec3; 3]>, Vec<TraceRay>) {
    let mut random = Random::new(SEED);
    let triangles = sheet(12);
    let mut rays = bundles(640, 64, &mut random);
    rays.extend(scattered(640, &triangles, &mut random));
    (triangles, rays)
}

#[test]
fn packets_read_every_kind_of_memory() {
    let Some(device) = device() else { return };
    let (triangles, rays) = sheet_and_rays();
    // All memories but the global one, which the other tests read, and all layouts; together, as each is a program to
    // compile.
    let with = |base: TraceOptions, memory, layout, triangles| TraceOptions {
        arrays: ArrayOptions { memory, layout, triangles },
        ..base
    };
    for options in [
        with(PACKETS, Memory::Constant, Layout::Split, TriangleOrder::LeafOrder),
        with(PACKETS, Memory::BufferImage, Layout::Whole, TriangleOrder::Indexed),
        with(PACKETS, Memory::Image2d, Layout::Split, TriangleOrder::Indexed),
        with(KD, Memory::Constant, Layout::Split, TriangleOrder::LeafOrder),
        with(KD, Memory::Image2d, Layout::Whole, TriangleOrder::Indexed),
    ] {
        assert_answers(&device, &options, &triangles, &rays);
        assert_picture(&device, "glass.toml", &options, (29, 21));
    }
}

#[test]
fn packets_do_without_double() {
    let Some(device) = device() else { return };
    let (triangles, rays) = sheet_and_rays();
    let float_only = device.with_compiler_options("-D FLOAT_ONLY=1").unwrap();
    for options in usually_every(2, [PACKETS, KD]) {
        assert_answers(&float_only, &options, &triangles, &rays);
    }
    assert_picture(&float_only, "glass.toml", &PACKETS, (61, 45));
}

#[test]
fn what_packets_leave_open_is_decided_all_the_same() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let flat = sheet(6).iter().map(|t| t.map(|p| Vec3::new(p.x, p.y, 0.0))).collect::<Vec<_>>();
    let count = if on_oclgrind() { 64 } else { 320 };
    let many = count * 5 / 16;
    // Rays in the plane of triangles, along edges and through vertices: one in a triangle's plane never hits it.
    let mut rays_in = |triangles: &[[Vec3; 3]]| {
        (0..count)
            .map(|_| {
                let [from, to] =
                    [(); 2].map(|()| triangles[random.bits() as usize % triangles.len()][random.bits() as usize % 3]);
                let from = from + (from - to) * random.unit();
                ray(from, to - from, 0.0, f32::INFINITY)
            })
            .filter(|ray| ray.direction_t_max.xyz() != Vec3::ZERO)
            .collect::<Vec<_>>()
    };
    // Half of the sheet is so narrow that pairs of doubles do not tell what is zero: exact integers decide.
    let narrow = flat.iter().map(|t| t.map(|p| if p.y < 0.0 { p * Vec3::new(1.0, 1e-25, 1.0) } else { p }));
    let narrow = narrow.collect::<Vec<_>>();
    let tilted = narrow.iter().map(|t| t.map(|p| p.with_z(p.x))).collect::<Vec<_>>();
    let (rays, narrow_rays, tilted_rays) = (rays_in(&flat), rays_in(&narrow), rays_in(&tilted));
    for options in [PACKETS, KD] {
        let [hits, second] = assert_answers(&device, &options, &tilted, &tilted_rays);
        let all = tilted_rays.len();
        assert!(hits < all && second > many, "{hits} hits, {second} of {all} rays in the second pass");
    }
    // In a plane across an axis packets leave nothing open.
    for options in usually_every(2, [PACKETS, KD]) {
        assert_eq!(assert_answers(&device, &options, &flat, &rays[..rays.len() / 16 * 16]), [0, 0]);
        assert!(assert_answers(&device, &options, &narrow, &narrow_rays)[0] < narrow_rays.len());
    }
    // From above at vertices and middles of edges: most of it is settled in packets, the rest ray by ray behind them.
    let triangles = flat;
    let rays: Vec<_> = (0..count / 2)
        .map(|i| {
            let [a, b, _] = triangles[random.bits() as usize % triangles.len()];
            let from = Vec3::new(0.3, 0.2, 2.0) + 0.01 * random.vec3();
            ray(from, if i % 2 == 0 { a } else { a.lerp(b, 0.5) } - from, 0.0, f32::INFINITY)
        })
        .collect();
    for options in [PACKETS, KD] {
        let [hits, second] = assert_answers(&device, &options, &triangles, &rays);
        // Some miss the sheet at its border.
        assert!(hits > many && second < many, "{hits} hits, {second} of {} rays in the second pass", rays.len());
    }
}

/// Straight down at vertices and at middles and quarters of edges of a landscape, and from its vertices: zero weights,
/// and distances that are 0, or in the middle between two floats. Packets decide nearly all of it.
#[test]
fn packets_decide_about_rays_at_vertices_of_a_landscape() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let size = if on_oclgrind() { 5 } else { 9 }; // each coordinate has few bits
    let heights: Vec<f32> = (0..size * size).map(|_| 0.2 * random.unit()).collect();
    let place = |x: usize| 2.0 * x as f32 / (size - 1) as f32 - 1.0;
    let point = |x: usize, y: usize| Vec3::new(place(x), place(y), heights[x * size + y]);
    let cells = (1..size).flat_map(|x| (1..size).map(move |y| (x, y)));
    let triangles: Vec<_> = cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [point(x - 1, y - 1), point(x, y - 1), point(x, y), point(x - 1, y)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let edges: Vec<_> = triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
    let from = |above: bool, share: f32, direction: Vec3, t_min: f32| {
        let start = |(from, to): &(Vec3, Vec3)| {
            let point = from.lerp(*to, share);
            if above { point.with_z(1.0) } else { point }
        };
        edges.iter().map(|edge| ray(start(edge), direction, t_min, f32::INFINITY)).collect::<Vec<_>>()
    };
    let sets = [
        (from(true, 0.0, Vec3::NEG_Z, 0.0), true),
        (from(true, 0.25, Vec3::NEG_Z, 0.0), true),
        (from(true, 0.5, Vec3::NEG_Z, 0.0), true),
        (from(false, 0.0, Vec3::NEG_Z, 0.0), true),
        (from(false, 0.0, Vec3::new(0.0, 0.25, 4.0), -1.0), true),
        (from(false, 0.0, Vec3::Z, 0.001), false),
    ];
    for options in [PACKETS, KD] {
        for (rays, are_hits) in &sets {
            let [hits, second] = assert_answers(&device, &options, &triangles, rays);
            assert_eq!(hits, if *are_hits { rays.len() } else { 0 });
            assert!(second <= rays.len() / 50, "{second} of {} rays in the second pass", rays.len());
        }
    }
}

/// Renders one of the project's scenes on the device and by the twin, with two samples a pixel.
pub(crate) fn assert_picture(device: &DeviceHandle, name: &str, options: &TraceOptions, size: (u32, u32)) {
    let mut scene = load(crate::common::root().join("scenes").join(name).as_path()).unwrap();
    complete(&mut scene, size.0 as f32 / size.1 as f32);
    let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
    let picture =
        Picture { camera: scene.camera.unwrap(), size, samples: Samples::PerPixel(2), depth: 5, kill_weight: None };
    let [packets, twin] = [Some(device), None].map(|device| {
        let mut tracer = open_tracer(device, &buffers, options, picture.depth, None).unwrap();
        render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap()
    });
    assert_eq!(packets.counts, twin.counts, "{name}, {}: rays by kind", options.kind());
    for (i, (pixel, expected)) in packets.film.pixels.iter().zip(&twin.film.pixels).enumerate() {
        assert_eq!(pixel.map(f32::to_bits), expected.map(f32::to_bits), "{name}, {}: pixel {i}", options.kind());
    }
}

#[test]
fn pictures_in_packets_have_the_twins_pixels_and_rays() {
    let Some(device) = device() else { return };
    // Kernels with all features are compiled once, those for a scene for each.
    let [all, all_in_kd] = [PACKETS, KD].map(|options| TraceOptions {
        picture: PictureOptions { features: KernelFeatures::All, ..options.picture },
        ..options
    });
    let in_kd = ["cornell.toml", "glass.toml", "vase.obj"].map(|name| (name, all_in_kd));
    let names = ["cornell.toml", "spheres.toml", "showcase.toml"].map(|name| (name, all));
    let own = usually_every(2, [("glass.toml", PACKETS), ("vase.obj", PACKETS)]);
    for (name, options) in own.chain(names).chain(in_kd) {
        assert_picture(&device, name, &options, (61, 45)); // no multiple of a tile's side, nor of a packet
    }
}

/// For simulators.
#[test]
fn a_small_picture_in_packets_is_the_twins() {
    let Some(device) = device() else { return };
    assert_picture(&device, "glass.toml", &PACKETS, (13, 10));
}
