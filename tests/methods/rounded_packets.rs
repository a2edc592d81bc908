//! Packets of rays by rounded triangle tests. Brute force answers with the nearest of all hits that the test finds; a
//! packet must give the same hit, to the bit, where that hit lies within HIT_ERROR of its triangle
//! (`cl/packets/rounded.cl`). Elsewhere, on triangles that are seen edge-on, it may be another hit that the test finds,
//! but none behind one that lies so.

use crate::common::{Random, SEED, device, is_usually_taken, scene_of, sheet, soup, usually_every};
use crate::packets::{BRUTE, KD, PACKETS, assert_picture, bits, bundles, ray, scattered, trace};
use glam::{DVec3, Vec3};
use raybrook::low_level::bounds::{EPSILON, HIT_ERROR};
use raybrook::low_level::options::{BvhOptions, Intersector, KdOptions, Structure, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Backend, is_hit};
use std::sync::Arc;

fn tests() -> impl Iterator<Item = Intersector> {
    Intersector::ALL.iter().copied().filter(|test| test.cl_packet_test().is_some())
}

/// The point of a triangle that is nearest to `p`: of its plane, or of its edges.
fn nearest_point([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let of_edge = |a: DVec3, b: DVec3| a + (b - a) * ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    let normal = (b - a).cross(c - a);
    let in_plane = p - normal * ((p - a).dot(normal) / normal.length_squared());
    let is_left = |a: DVec3, b: DVec3| (b - a).cross(in_plane - a).dot(normal) >= 0.0;
    if is_left(a, b) && is_left(b, c) && is_left(c, a) {
        return in_plane;
    }
    let points = [of_edge(a, b), of_edge(b, c), of_edge(c, a)];
    points.into_iter().min_by(|p0, p1| (*p0 - p).length().total_cmp(&(*p1 - p).length())).unwrap()
}

/// Whether the hit is surely no farther from its triangle, on any axis, than HIT_ERROR EPSILON D, where D is the
/// largest distance of the scene from the ray's start.
fn is_near_its_triangle(triangles: &[[Vec3; 3]], ray: &TraceRay, hit: &Hit) -> bool {
    let origin = ray.origin_t_min.xyz().as_dvec3();
    let point = origin + ray.direction_t_max.xyz().as_dvec3() * f64::from(hit.t);
    let farthest = triangles.iter().flatten().map(|p| (p.as_dvec3() - origin).abs().max_element()).fold(0.0, f64::max);
    let distance = point - nearest_point(triangles[hit.primitive as usize].map(|p| p.as_dvec3()), point);
    distance.length() <= f64::from(HIT_ERROR * EPSILON) * farthest
}

/// Whether a packet takes the ray: nothing of it is extreme.
fn is_moderate(ray: &TraceRay) -> bool {
    let moderate = |x: f32| x == 0.0 || (1e-9..1e9).contains(&x.abs());
    let (origin, direction) = (ray.origin_t_min.xyz().to_array(), ray.direction_t_max.xyz().to_array());
    origin.into_iter().chain(direction).all(moderate) && ray.direction_t_max.xyz() != Vec3::ZERO
}

/// Brute force by the twin, over all triangles or over one.
struct BruteForce {
    buffers: SceneBuffers,
    options: TraceOptions,
}

impl BruteForce {
    fn new(triangles: &[[Vec3; 3]], intersector: Intersector) -> BruteForce {
        let options = TraceOptions { intersector, ..BRUTE };
        BruteForce { buffers: SceneBuffers::new(&scene_of(triangles), &options).unwrap(), options }
    }

    fn hits(&self, rays: &[TraceRay]) -> Vec<Hit> {
        trace(&mut ReferenceBackend::new(Arc::new(self.buffers.clone()), self.options), rays, false).hits
    }

    fn hit_of(&self, triangle: u32, ray: &TraceRay) -> Hit {
        let mut buffers = self.buffers.clone();
        buffers.references = vec![triangle];
        buffers.params.reference_count = 1;
        trace(&mut ReferenceBackend::new(Arc::new(buffers), self.options), &[*ray], false).hits[0]
    }
}

/// What came of a comparison.
#[derive(Debug, Default)]
struct Tally {
    hits: usize,
    /// Rays whose answer is not that of brute force.
    others: usize,
}

/// Asserts the answers of packets for rays of moderate numbers, and that others have those of single rays. What is left
/// of a batch that is no multiple of sixteen goes by itself, too, and is left out.
fn assert_answers(
    device: &raybrook::low_level::device::DeviceHandle,
    options: &TraceOptions,
    triangles: &[[Vec3; 3]],
    rays: &[TraceRay],
) -> Tally {
    let rays = &rays[..rays.len() / 16 * 16];
    let buffers = Arc::new(SceneBuffers::new(&scene_of(triangles), options).unwrap());
    let mut tracer = open_tracer(Some(device), &buffers, options, 1, None).unwrap();
    let brute = BruteForce::new(triangles, options.intersector);
    let single = trace(&mut ReferenceBackend::new(buffers.clone(), *options), rays, false).hits;
    let expected = brute.hits(rays);
    let [closest, any] = [false, true].map(|any_hit| trace(tracer.as_mut() as &mut dyn Backend, rays, any_hit));
    assert_eq!(closest.second_pass.unwrap_or(0), 0, "nothing is deferred");
    let mut tally = Tally::default();
    for (i, ray) in rays.iter().enumerate() {
        let (hit, some, nearest) = (&closest.hits[i], &any.hits[i], &expected[i]);
        let what = format!(
            "ray {i}, {} in {}: {ray:?}: {hit:?}, {nearest:?} (seed {SEED})",
            options.intersector,
            options.kind()
        );
        tally.hits += usize::from(is_hit(hit));
        if !is_moderate(ray) {
            assert_eq!(bits(hit), bits(&single[i]), "{what}");
            assert_eq!(is_hit(some), is_hit(&single[i]), "{what}");
            continue;
        }
        if is_hit(some) && some.primitive != nearest.primitive {
            assert!(is_hit(&brute.hit_of(some.primitive, ray)), "{what}");
        }
        let must_be_it = !is_hit(nearest) || is_near_its_triangle(triangles, ray, nearest);
        assert!(!must_be_it || is_hit(some) == is_hit(nearest), "{what}");
        if bits(hit) == bits(nearest) {
            continue;
        }
        assert!(!must_be_it, "{what}");
        tally.others += 1;
        assert!(!is_hit(hit) || bits(&brute.hit_of(hit.primitive, ray)) == bits(hit), "{what}");
        for triangle in 0..triangles.len() as u32 {
            let other = brute.hit_of(triangle, ray);
            let is_behind = !is_hit(&other) || (hit.t, hit.primitive) <= (other.t, other.primitive);
            assert!(is_behind || !is_near_its_triangle(triangles, ray, &other), "{what}: {other:?}");
        }
    }
    tally
}

/// Structures as they are built for packets, with parts of triangles in several leaves, and deep.
fn structures(intersector: Intersector) -> [TraceOptions; 4] {
    let split = BvhOptions { spatial_splits: Some(4.0.into()), leaf_size: Some(2), ..BvhOptions::DEFAULT };
    let deep = KdOptions { cost_traverse: Some(0.0), ..KD.kd() };
    [
        PACKETS,
        TraceOptions { structure: Structure::Bvh8(split), ..PACKETS },
        KD,
        TraceOptions { structure: Structure::Kd(deep), ..KD },
    ]
    .map(|options| TraceOptions { intersector, ..options })
}

#[test]
fn packets_find_what_brute_force_finds() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let mut mixed = soup(200, 0.2, &mut random);
    mixed.extend(soup(5, 2.0, &mut random));
    mixed.extend(soup(200, 1e-4, &mut random));
    // Several triangles at the same place: the lower number is hit.
    mixed.extend_from_within(..20);
    let models = [mixed, sheet(16), soup(1, 1.0, &mut random)];
    for (triangles, intersector) in models.iter().flat_map(|triangles| tests().map(move |test| (triangles, test))) {
        let mut rays = bundles(640, 16, &mut random);
        rays.extend(bundles(1280, 64, &mut random));
        rays.extend(scattered(1100, triangles, &mut random));
        for options in structures(intersector) {
            let tally = assert_answers(&device, &options, triangles, &rays);
            assert!(tally.hits > 100, "{options:?}: {tally:?}");
        }
    }
}

/// In the planes of triangles, along their edges and through their vertices, where t of some tests is noise.
#[test]
fn packets_of_rays_in_planes_and_through_edges() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let flat: Vec<_> = sheet(6).iter().map(|t| t.map(|p| Vec3::new(p.x, p.y, 0.0))).collect();
    let [mut hits, mut others] = [0; 2];
    for (triangles, (number, intersector)) in
        [flat, sheet(6)].iter().flat_map(|triangles| tests().enumerate().map(move |test| (triangles, test)))
    {
        let corner =
            |random: &mut Random| triangles[random.bits() as usize % triangles.len()][random.bits() as usize % 3];
        let rays: Vec<_> = (0..1600)
            .map(|i| {
                let [a, b] = [(); 2].map(|()| corner(&mut random));
                let to = if i % 3 == 0 { a } else { a.lerp(b, random.unit()) };
                let above = Vec3::new(0.3, 0.2, if i % 2 == 0 { 2.0 } else { 1e-4 }) + 0.01 * random.vec3();
                let from = if i % 5 == 0 { above } else { b + (b - a) * random.unit() };
                ray(from, to - from, 0.0, f32::INFINITY)
            })
            .filter(|ray| ray.direction_t_max.xyz() != Vec3::ZERO)
            .collect();
        // Split triangles take a program of their own, and so does a kd-tree, the same around every test.
        let is_tried = |options: &TraceOptions| {
            let is_plain = matches!(options.structure, Structure::Bvh8(bvh) if bvh.spatial_splits.is_none());
            let is_usual = is_plain && is_usually_taken(2, number) || is_usually_taken(4, number);
            is_usual || intersector == Intersector::FASTEST
        };
        for options in structures(intersector).into_iter().filter(is_tried) {
            let tally = assert_answers(&device, &options, triangles, &rays);
            assert!(intersector != Intersector::Watertight || tally.others == 0, "{options:?}: {tally:?}");
            hits += tally.hits;
            others += tally.others;
        }
    }
    println!("{others} other hits than brute force's, {hits} hits");
    // The second number is what is lost by design, if it is any: else the half of the judgement above judges nothing.
    assert!(hits > 1000 && others > 0, "{others} other hits than brute force's, {hits} hits");
}

#[test]
fn a_hit_beside_its_triangle_is_told_from_one_near_it() {
    let triangles = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let ray = ray(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z, 0.0, f32::INFINITY);
    for (t, is_near) in [(1.0, true), (1.0 + HIT_ERROR * EPSILON, true), (1.0 + 2.5 * HIT_ERROR * EPSILON, false)] {
        let hit = Hit { t, u: 0.2, v: 0.2, primitive: 0 };
        assert_eq!(is_near_its_triangle(&triangles, &ray, &hit), is_near, "{t}");
    }
    let beside = crate::packets::ray(Vec3::new(-0.1, 0.2, 1.0), Vec3::NEG_Z, 0.0, f32::INFINITY);
    assert!(!is_near_its_triangle(&triangles, &beside, &Hit { t: 1.0, u: 0.0, v: 0.2, primitive: 0 }));
}

#[test]
fn pictures_have_the_twins_pixels_and_rays() {
    let Some(device) = device() else { return };
    let all = [
        ("glass.toml", Intersector::MollerTrumbore, PACKETS),
        ("cornell.toml", Intersector::Watertight, PACKETS),
        ("showcase.toml", Intersector::Watertight, KD),
        ("vase.obj", Intersector::MollerTrumbore, KD),
        ("glass.toml", Intersector::Plucker, PACKETS),
    ];
    for (name, intersector, structure) in usually_every(2, all) {
        assert_picture(&device, name, &TraceOptions { intersector, ..structure }, (61, 45));
    }
}
