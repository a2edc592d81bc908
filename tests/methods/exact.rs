//! The exact triangle test against exact integers of any length from a library: every decision, every rounding, every
//! order.

use crate::common::{Random, SEED, device, scene_of};
use glam::Vec3;
use num_bigint::{BigInt, Sign};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{
    BvhOptions, Intersector, KdOptions, PacketSize, Structure, StructureKind, TraceOptions, Traversal,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::intersect::exact_filter::{Decision, decide_extended, finish_extended};
use raybrook::low_level::reference::intersect::exact_integers::{decide_by_integers, finish_by_integers};
use raybrook::low_level::reference::intersect::moller_trumbore::Intersection;
use raybrook::low_level::reference::intersect::ties::{are_in_one_plane, are_same_points};
use raybrook::low_level::reference::shared::ray::{NO_HIT, Ray, TrianglePoint, start_on_triangle};
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE, TraceRay};
use raybrook::low_level::tracer::TraceJob;
use std::cmp::Ordering;
use std::sync::Arc;

/// x * 2^149: whole for every float.
fn whole(x: f32) -> BigInt {
    let bits = x.to_bits();
    let (field, fraction) = (bits >> 23 & 255, bits & 0x7f_ffff);
    let magnitude = match field {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (field - 1),
    };
    if x.is_sign_negative() { -magnitude } else { magnitude }
}

type Vector = [BigInt; 3];

fn vector(v: Vec3) -> Vector {
    v.to_array().map(whole)
}

fn minus(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| &a[i] - &b[i])
}

fn cross(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        &a[j] * &b[k] - &a[k] * &b[j]
    })
}

fn dot(a: &Vector, b: &Vector) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

/// Exact numbers of a triangle that is hit: t = distance / det, u = weight1 / det, v = weight2 / det, and det > 0.
struct Exact {
    distance: BigInt,
    weight1: BigInt,
    weight2: BigInt,
    det: BigInt,
}

impl Exact {
    fn new(ray: &Ray, [p0, p1, p2]: [Vec3; 3]) -> Option<Exact> {
        let (o, d) = (vector(ray.origin), vector(ray.direction));
        let [a, b, c] = [p0, p1, p2].map(|p| minus(&vector(p), &o));
        let weights = [dot(&d, &cross(&c, &b)), dot(&d, &cross(&a, &c)), dot(&d, &cross(&b, &a))];
        let det: BigInt = weights.iter().sum();
        let sign = match det.sign() {
            Sign::NoSign => return None,
            Sign::Plus => BigInt::from(1),
            Sign::Minus => BigInt::from(-1),
        };
        let [weight0, weight1, weight2] = weights.map(|weight| weight * &sign);
        if [&weight0, &weight1, &weight2].iter().any(|weight| weight.sign() == Sign::Minus) {
            return None;
        }
        let normal = cross(&minus(&b, &a), &minus(&c, &a));
        // (p1 - p0) x (p2 - p0) = -(a x c + b x a + c x b), whose products with d are the weights.
        let distance = -dot(&normal, &a) * &sign;
        Some(Exact { distance, weight1, weight2, det: det * sign })
    }

    /// Whether t is between two floats.
    fn is_within(&self, low: f32, high: f32) -> bool {
        let scaled: BigInt = &self.distance << 149u32;
        let above = low == f32::NEG_INFINITY || scaled >= whole(low) * &self.det;
        above && (high == f32::INFINITY || scaled <= whole(high) * &self.det)
    }

    fn compare_t(&self, other: &Exact) -> Ordering {
        (&self.distance * &other.det).cmp(&(&other.distance * &self.det))
    }
}

/// Whether `x` is the float nearest to numerator / denominator, ties to even.
fn is_nearest(x: f32, numerator: &BigInt, denominator: &BigInt) -> bool {
    if !x.is_finite() {
        return false;
    }
    // The sign of the exact value minus the middle of x and its neighbour.
    let against_middle = |neighbour: f32| {
        let twice_middle = whole(x) + if neighbour.is_finite() { whole(neighbour) } else { whole(f32::MAX) };
        let scaled: BigInt = numerator * 2;
        (scaled << 149u32).cmp(&(twice_middle * denominator))
    };
    let even = x.to_bits() & 1 == 0;
    let below = against_middle(x.next_up());
    let above = against_middle(x.next_down());
    (below == Ordering::Less || (below == Ordering::Equal && even))
        && (above == Ordering::Greater || (above == Ordering::Equal && even))
}

fn assert_nearest(found: Intersection, exact: &Exact, what: &str) {
    for (name, value, numerator) in
        [("t", found.t, &exact.distance), ("u", found.u, &exact.weight1), ("v", found.v, &exact.weight2)]
    {
        assert!(is_nearest(value, numerator, &exact.det), "{what}: {name} = {value:e} is not the nearest float");
    }
}

/// A number of many or few digits, near or far, zero at times.
fn coordinate(kind: u64, random: &mut Random) -> f32 {
    match kind {
        0 => random.signed(),
        1 => (4.0 * random.signed()).round(),
        2 => 1e5 + random.signed(),
        3 => random.signed() * 2f32.powi((random.bits() % 40) as i32 - 20),
        4 => (4.0 * random.signed()).round() + random.signed() * 1e-6,
        _ => random.signed() * 2f32.powi((random.bits() % 140) as i32 - 120),
    }
}

const KINDS: u64 = 6;

fn point(kind: u64, random: &mut Random) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| coordinate(kind, random)))
}

/// A ray and a triangle; most of the rays aim at edges, vertices, the inside, or run in the plane.
fn case(i: usize, random: &mut Random) -> (Ray, [Vec3; 3]) {
    let kind = random.bits() % KINDS;
    let mut triangle = [(); 3].map(|()| point(kind, random));
    if i.is_multiple_of(5) {
        triangle[2] = triangle[0].lerp(triangle[1], random.unit()) + random.vec3() * 1e-5 * triangle[1].length();
    }
    let origin = match random.bits() % 4 {
        0 => point(kind, random),
        1 => triangle[0] + point(1, random),
        2 => 100.0 * point(kind, random),
        _ => point(1, random),
    };
    let (a, b) = (random.unit(), random.unit());
    let target = match random.bits() % 6 {
        0 => triangle[0],
        1 => triangle[1].lerp(triangle[2], a),
        2 => triangle[0].midpoint(triangle[1]),
        3 => triangle[0] + (triangle[1] - triangle[0]) * (a * (1.0 - b)) + (triangle[2] - triangle[0]) * b,
        4 => origin + (triangle[1] - triangle[0]) * a.round() + (triangle[2] - triangle[0]),
        _ => point(kind, random),
    };
    let mut ray = Ray::new(origin, target - origin, f32::NEG_INFINITY, f32::INFINITY, NO_PRIMITIVE);
    (ray.t_scale, ray.t_lift) = (1.0, 1.0); // the caller's t is that of the ray's own direction
    (ray, triangle)
}

#[test]
fn every_step_is_right() {
    const CASES: usize = 60_000;
    let mut random = Random::new(SEED);
    let (mut hits, mut undecided, mut on_edges) = (0, 0, 0);
    let scene = scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]]);
    let buffers = SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap();
    for i in 0..CASES {
        let (ray, triangle) = case(i, &mut random);
        let is_ray = ray.t_near <= ray.t_far && triangle.iter().all(|p| p.is_finite());
        if !is_ray {
            continue;
        }
        let exact = Exact::new(&ray, triangle);
        let what = format!("case {i} (seed {SEED}): {ray:?} {triangle:?}");
        // Rays that start nowhere on a triangle need no scene.
        let found = match decide_by_integers(&buffers, &ray, triangle, 0, &NO_HIT) {
            Decision::Hit(limits) => Some((finish_by_integers(&buffers, &ray, triangle), limits)),
            Decision::Miss => None,
            Decision::Undecided => panic!("{what}: exact integers leave nothing open"),
        };
        match (found, &exact) {
            (Some((found, [low, high])), Some(exact)) => {
                assert_nearest(found, exact, &what);
                assert!(low < found.t && found.t < high, "{what}: t {} outside of {low}..{high}", found.t);
                hits += 1;
                on_edges += usize::from(found.u == 0.0 || found.v == 0.0);
            }
            // Only for a t beyond every float.
            (None, Some(exact)) => assert!(!is_nearest(f32::MAX, &exact.distance, &exact.det), "{what}: missed"),
            (found, None) => assert_eq!(found, None, "{what}"),
        }
        match (decide_extended(&ray, triangle), &exact) {
            (Decision::Undecided, _) => undecided += 1,
            (Decision::Hit([low, high]), Some(exact)) => {
                assert!(exact.is_within(low, high), "{what}: t outside of {low}..{high}");
                match finish_extended(&ray, triangle) {
                    Some(found) => assert_nearest(found, exact, &what),
                    None => undecided += 1,
                }
            }
            (Decision::Miss, None) => {}
            (decision, _) => panic!("{what}: {decision:?}, but hit is {}", exact.is_some()),
        }
    }
    assert!(hits > CASES / 5 && on_edges > CASES / 100, "{hits} hits, {on_edges} on edges");
    // These rays were made to be undecided, and still not all are.
    assert!(undecided > CASES / 50 && undecided < CASES / 2, "{undecided} undecided");
}

/// Closest hit by brute force in exact arithmetic: primitive and numbers.
fn closest(ray: &Ray, triangles: &[[Vec3; 3]]) -> Option<(u32, Exact)> {
    let mut best: Option<(u32, Exact)> = None;
    for (i, &triangle) in triangles.iter().enumerate() {
        let Some(found) = Exact::new(ray, triangle) else { continue };
        let limit = |t: f32| Exact {
            distance: whole(t),
            weight1: BigInt::ZERO,
            weight2: BigInt::ZERO,
            det: BigInt::from(1) << 149u32,
        };
        let is_inside = found.compare_t(&limit(ray.t_near)) != Ordering::Less
            && found.compare_t(&limit(ray.t_far)) != Ordering::Greater;
        if is_inside && best.as_ref().is_none_or(|(_, best)| found.compare_t(best) == Ordering::Less) {
            best = Some((i as u32, found));
        }
    }
    best
}

fn trace(
    device: Option<&DeviceHandle>,
    buffers: &Arc<SceneBuffers>,
    options: &TraceOptions,
    rays: &[TraceRay],
) -> Vec<Hit> {
    let mut tracer = open_tracer(device, buffers, options, 1, None).unwrap();
    tracer
        .trace(&TraceJob { extreme: &[], rays, next_directions: None, any_hit: false, repeat: 1 }, &|_| ())
        .unwrap()
        .hits
}

/// Layers that differ by a few units in the last place, through which rays run to where they cross or coincide.
fn layers(random: &mut Random) -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::new();
    for i in 0..24 {
        let ulps = |x: f32, n: u64| f32::from_bits(x.to_bits() + n as u32);
        let corner = |x: f32, y: f32, random: &mut Random| {
            Vec3::new(x, y, ulps(1.0 + 0.25 * x, random.bits() % 4)) // planes within 3 ulp of a common one
        };
        let triangle = [corner(-1.0, -1.0, random), corner(3.0, -1.0, random), corner(-1.0, 3.0, random)];
        triangles.push(if i % 2 == 0 { triangle } else { [triangle[1], triangle[0], triangle[2]] });
    }
    triangles
}

#[test]
fn the_closest_hit_is_the_exact_one() {
    let device = device();
    let mut random = Random::new(SEED);
    let triangles = layers(&mut random);
    let scene = scene_of(&triangles);
    let queries: Vec<(Vec3, Vec3, [f32; 2])> = (0..3000)
        .map(|i| {
            let from = Vec3::new(random.signed(), random.signed(), -1.0);
            let vertices = triangles[random.bits() as usize % triangles.len()];
            let target = match i % 4 {
                0 => vertices[0].midpoint(vertices[1]),
                1 => vertices[i % 3],
                _ => Vec3::new(0.5 * random.signed(), 0.5 * random.signed(), 1.0),
            };
            // Limits at the layers' own distance: straight up t is the layers' height above the origin.
            match i % 4 {
                3 => (target.with_z(0.0), Vec3::Z, [1.0 + 0.25 * target.x, f32::INFINITY]),
                _ => (from, target - from, [0.0, f32::INFINITY]),
            }
        })
        .collect();
    for options in [
        TraceOptions { intersector: Intersector::Exact, ..TraceOptions::of(StructureKind::Brute) },
        TraceOptions {
            structure: Structure::Kd(KdOptions { traversal: Traversal::ShortStack, ..KdOptions::DEFAULT }),
            intersector: Intersector::Exact,
            ..TraceOptions::DEFAULT
        },
    ] {
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rays: Vec<_> = queries.iter().map(|&(o, d, [near, far])| buffers.trace_ray(o, d, near, far)).collect();
        let hits = trace(None, &buffers, &options, &rays);
        let packed: Vec<[Vec3; 3]> =
            buffers.vertices.chunks_exact(3).map(|t| std::array::from_fn(|i| t[i].xyz())).collect();
        let mut ties = 0;
        for (i, (query, hit)) in rays.iter().zip(&hits).enumerate() {
            let (o, d) = (query.origin_t_min, query.direction_t_max);
            let scale = buffers.params.scale; // the packed vertices' unit of t
            let ray = Ray::new(o.xyz(), d.xyz(), scale * o.w, scale * d.w, NO_PRIMITIVE);
            let expected = closest(&ray, &packed);
            let what = format!("ray {i} (seed {SEED}) {query:?}: {hit:?}");
            assert_eq!(hit.primitive, expected.as_ref().map_or(NO_PRIMITIVE, |(i, _)| *i), "{what}");
            if let Some((_, exact)) = expected {
                let found = Intersection { t: scale * hit.t / ray.t_lift / ray.t_scale, u: hit.u, v: hit.v };
                assert_nearest(found, &exact, &what);
                let same_float = |other: &[Vec3; 3]| {
                    Exact::new(&ray, *other).is_some_and(|o| is_nearest(found.t, &o.distance, &o.det))
                };
                ties += usize::from(packed.iter().filter(|triangle| same_float(triangle)).count() > 1);
            }
        }
        assert!(ties > 1000, "only {ties} rays with several triangles at the same float");
        if let Some(device) = &device {
            let on_device = trace(Some(device), &buffers, &options, &rays);
            assert_eq!(bytemuck::cast_slice::<_, u32>(&on_device), bytemuck::cast_slice::<_, u32>(&hits));
        }
    }
}

/// A direction that turns from its axis by so little that it shows only 2^126 units of length away.
#[test]
fn the_smallest_turns_count() {
    let turn = 1.0 + 2f32.powi(-22);
    let scene = scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Z]]);
    let device = device();
    for &accel in StructureKind::ALL {
        let options = TraceOptions::of(accel);
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        // Compilers take longer than all else here.
        let on_device =
            device.as_ref().filter(|_| matches!(accel, StructureKind::Kd | StructureKind::Bvh2 | StructureKind::Bvh8));
        for (along, sideways) in [(2f32.powi(24), 2f32.powi(-105)), (-2f32.powi(100), 2f32.powi(-29))] {
            let from = Vec3::new(0.0, -2f32.powi(126) * along.signum(), 0.25);
            let ray = buffers.trace_ray(from, Vec3::new(sideways * turn, along, 0.0), 0.0, f32::INFINITY);
            for device in [None, on_device] {
                let hit = trace(device, &buffers, &options, &[ray])[0];
                let expected = Hit { t: 2f32.powi(126) / along.abs(), u: 0.125 * turn, v: 0.25, primitive: 0 };
                assert_eq!(hit, expected, "{accel}, {along}, {}", device.is_some());
            }
        }
    }
}

#[test]
fn numbers_of_the_most_bits_fit() {
    // The positions of this ray and these triangles take 255 bits; two hits at the same t are compared as numbers of
    // 1280 bits.
    let smallest = f32::from_bits(1);
    let triangle = [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(smallest, 1.0, 0.0)];
    // Another one in its plane, so that neither the same points nor pairs of doubles decide (cl/intersect/ties.cl).
    let other = [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(-smallest, 1.0, 0.0)];
    let options = TraceOptions { intersector: Intersector::Exact, ..TraceOptions::of(StructureKind::Brute) };
    let buffers = Arc::new(SceneBuffers::new(&scene_of(&[triangle, other]), &options).unwrap());
    let (from, along) = (2f32.powi(105), 17.0 / 16.0);
    let rays = [buffers.trace_ray(Vec3::Z * from, Vec3::Z * -along, 0.0, f32::INFINITY)];
    for device in [None, device()] {
        let hit = trace(device.as_ref(), &buffers, &options, &rays)[0];
        assert_eq!((hit.primitive, hit.t, hit.u), (0, from / along, 0.25));
    }
}

/// A ray meets a vertex of a triangle, and then another one with that vertex, which has the lower number and is not
/// hit: the ray is in its plane. Pairs of doubles tell so at once.
#[test]
fn triangles_in_the_plane_of_a_ray_are_not_hit_where_others_are() {
    let Some(device) = device() else { return };
    let corner = Vec3::ZERO;
    let beside = [corner, Vec3::new(3.0, 3.0, 8.0), Vec3::new(1.0, 5.0, 8.0)];
    let across = [corner, Vec3::new(-2.0, 0.0, -3.0), Vec3::new(0.0, -2.0, -3.0)];
    let bvh = BvhOptions { leaf_size: Some(1), ..BvhOptions::DEFAULT };
    for (structure, packet_size) in
        [(Structure::Bvh2(bvh), PacketSize::One), (Structure::Bvh8(bvh), PacketSize::Sixteen)]
    {
        let options = TraceOptions { intersector: Intersector::Exact, structure, packet_size, ..TraceOptions::DEFAULT };
        let buffers = Arc::new(SceneBuffers::new(&scene_of(&[beside, across]), &options).unwrap());
        let direction = Vec3::new(1.0, 2.0, 4.0);
        let rays = [buffers.trace_ray(-3.0 * direction, direction, 0.0, f32::INFINITY); 64];
        let mut tracer = open_tracer(Some(&device), &buffers, &options, 1, None).unwrap();
        let job = TraceJob { rays: &rays, next_directions: None, extreme: &[], any_hit: false, repeat: 1 };
        let result = tracer.trace(&job, &|_| ()).unwrap();
        assert!(
            result.hits.iter().all(|hit| (hit.primitive, hit.t) == (1, 3.0)),
            "{structure:?}: {:?}",
            result.hits[0]
        );
        assert!(result.second_pass == Some(0) || !device.info.fp64, "{structure:?}: {:?}", result.second_pass);
    }
}

/// Walls across the axes, seen along an axis: t is a difference of two floats by a power of two, and often the middle
/// between two floats. Doubles tell which of them it rounds to, whatever the other axes' numbers are.
#[test]
fn distances_to_walls_across_an_axis_need_no_integers() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    // A room of six walls, whose coordinates have all their bits.
    let low = Vec3::new(-9.0, -10.0, -11.0) - 4.0 * Vec3::new(random.unit(), random.unit(), random.unit());
    let high = Vec3::new(9.0, 10.0, 11.0) + 4.0 * Vec3::new(random.unit(), random.unit(), random.unit());
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for at in [low, high] {
            let corner = |to_high: [bool; 2]| {
                let mut p = at;
                for (i, is_high) in to_high.into_iter().enumerate() {
                    let k = (axis + 1 + i) % 3;
                    p[k] = if is_high { high[k] } else { low[k] };
                }
                p
            };
            let [a, b, c, d] = [[false, false], [true, false], [true, true], [false, true]].map(corner);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut sights = Vec::new();
    let mut middles = 0;
    for i in 0..3000 {
        let axis = i % 3;
        // Far from a wall across the axis, and with a tiny coordinate, whose bits are far below the others'.
        let mut eye = random.vec3() * 7.0;
        eye[(axis + 1) % 3] = 1e-3 * random.signed();
        let mut direction = random.vec3() * 0.25;
        direction[axis] = random.pick(&[-4.0, -1.0, -0.5, 0.5, 1.0, 2.0]);
        let wall = if direction[axis] > 0.0 { high[axis] } else { low[axis] };
        let t = (f64::from(wall) - f64::from(eye[axis])) / f64::from(direction[axis]);
        let nearest = t as f32;
        let other = if f64::from(nearest) < t { nearest.next_up() } else { nearest.next_down() };
        middles += usize::from(t != f64::from(nearest) && (f64::from(nearest) + f64::from(other)) / 2.0 == t);
        sights.push((eye, direction));
    }
    assert!(middles > 500, "{middles} (seed {SEED})");
    for (structure, packet_size) in [
        (Structure::Bvh2(BvhOptions::DEFAULT), PacketSize::One),
        (Structure::Bvh8(BvhOptions::DEFAULT), PacketSize::Sixteen),
    ] {
        let options = TraceOptions { intersector: Intersector::Exact, structure, packet_size, ..TraceOptions::DEFAULT };
        let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles), &options).unwrap());
        let rays: Vec<_> =
            sights.iter().map(|&(eye, direction)| buffers.trace_ray(eye, direction, 0.0, f32::INFINITY)).collect();
        let job = TraceJob { rays: &rays, next_directions: None, extreme: &[], any_hit: false, repeat: 1 };
        let [expected, got] = [None, Some(&device)]
            .map(|device| open_tracer(device, &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap());
        assert!(expected.hits == got.hits, "{structure:?} (seed {SEED})");
        assert!(expected.hits.iter().all(|hit| hit.primitive != NO_PRIMITIVE), "{structure:?}");
        assert!(got.second_pass == Some(0) || !device.info.fp64, "{structure:?}: {:?}", got.second_pass);
    }
}

/// A point with coordinates of `octaves` powers of two below 2 and their signs, of few or many bits.
fn wild(octaves: u64, random: &mut Random) -> Vec3 {
    let mut coordinate = || {
        let bits =
            [1.0, 1.0 + power(-1 - (random.bits() % 23) as i32), 1.0 + random.unit()][random.bits() as usize % 3];
        let sign = if random.bits().is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * bits * power(-((random.bits() % octaves) as i32))
    };
    Vec3::new(coordinate(), coordinate(), coordinate())
}

#[test]
fn rays_start_where_their_triangle_is() {
    // Positions are whole multiples of 2^-149, weights of 2^-149, too: of 2^-298 their products.
    let mut random = Random::new(SEED);
    let mut nonzero = 0;
    for i in 0..100_000 {
        let is_wild = i % 2 == 1; // of all exponents, down to the last bit of a float
        let triangle = [(); 3].map(|()| if is_wild { wild(120, &mut random) } else { point(i % 4, &mut random) });
        let mut weights = match is_wild {
            true => wild(149, &mut random).abs() * 0.25,
            false => Vec3::new(random.unit(), random.unit(), random.unit()) * [0.3, 1e-4, 1e-9][i as usize % 3],
        };
        weights[i as usize % 3] = -1.0;
        let at = TrianglePoint::of_weights(triangle, weights);
        let (high, low) = start_on_triangle(&at);
        for k in 0..3 {
            let [base, other1, other2] = at.vertices.map(|p| whole(p[k]));
            let [weight1, weight2] = at.weights.map(whole);
            let exact: BigInt = (&base << 149u32) + weight1 * (other1 - &base) + weight2 * (other2 - &base);
            let rest: BigInt = exact - (whole(high[k]) << 149u32);
            // Off by 2 EPSILON of itself, or by what no float is small enough for: a product's last bits, nine times.
            let error: BigInt = &rest - (whole(low[k]) << 149u32);
            let bound = (rest.magnitude() >> 23u32) + (whole(9.0 * f32::from_bits(1)).magnitude() << 149u32);
            assert!(*error.magnitude() <= bound, "point {i} (seed {SEED}), axis {k}: {at:?} {high} {low}");
            nonzero += usize::from(rest.bits() > 0);
        }
    }
    assert!(nonzero > 100_000, "{nonzero} starts with a second part");
}

/// A triangle and its t.
type Answer = Option<(u32, f32)>;

/// A ray of a table: where it goes, its limits, and the hit that exact arithmetic finds.
struct Row {
    name: &'static str,
    triangles: Vec<[[f32; 3]; 3]>,
    origin: [f32; 3],
    direction: [f32; 3],
    limits: [f32; 2],
    hit: Answer,
    /// The direction of a secondary ray, and its hit.
    next: Option<([f32; 3], Answer)>,
}

fn power(exponent: i32) -> f32 {
    2f64.powi(exponent) as f32
}

const UP: f32 = f32::INFINITY;
const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

/// A right triangle of `size` at the height `z`.
fn flat(size: f32, z: f32) -> [[f32; 3]; 3] {
    [[0.0, 0.0, z], [size, 0.0, z], [0.0, size, z]]
}

/// Rays at the ends of float32, each of which was answered wrongly once.
fn rows_at_the_ends() -> Vec<Row> {
    let p = power;
    let row = |name, triangles: &[[[f32; 3]; 3]], origin, direction, limits, hit| Row {
        name,
        triangles: triangles.to_vec(),
        origin,
        direction,
        limits,
        hit,
        next: None,
    };
    let all = [0.0, UP];
    let tiny = f32::from_bits(1);
    vec![
        row("an origin below the scene's bits", &[flat(4.0, 0.0)], [-tiny, 1.0, 1.0], DOWN, all, None),
        row("the same, inside", &[flat(4.0, 0.0)], [tiny, 1.0, 1.0], DOWN, all, Some((0, 1.0))),
        row("an origin beyond floats", &[flat(1e-20, 0.0)], [1e-21, 1e-21, 1e20], DOWN, all, Some((0, 1e20))),
        row(
            "a vertex below bits",
            &[flat(1e18, 0.0), flat(1e18, p(-100))],
            [1e17, 1e17, 1.0],
            DOWN,
            all,
            Some((1, 1.0)),
        ),
        row(
            "the same, limits",
            &[flat(1e18, 0.0), flat(1e18, p(-100))],
            [1e17, 1e17, 0.0],
            DOWN,
            [-UP, UP],
            Some((1, -p(-100))),
        ),
        row(
            "t below tracing space",
            &[flat(1e18, 0.0), flat(1e18, 1.1e-12)],
            [1e17, 1e17, 0.0],
            [0.0, 0.0, 1.0],
            [tiny, UP],
            Some((1, 1.1e-12)),
        ),
        row("t that is subnormal", &[flat(1.0, 0.0)], [0.25, 0.25, 3.0 * p(-149)], DOWN, all, Some((0, 3.0 * p(-149)))),
        row("t near 0", &[flat(1.0, 0.0)], [0.25, 0.25, p(-90)], DOWN, all, Some((0, p(-90)))),
        row("t beyond a limit", &[flat(1.0, 0.0)], [0.25, 0.25, 3.0 * p(-149)], [0.0, 0.0, -p(-147)], [0.0, 0.7], None),
        row(
            "t at a limit",
            &[flat(1.0, 0.0)],
            [0.25, 0.25, 3.0 * p(-149)],
            [0.0, 0.0, -p(-147)],
            [0.0, 0.75],
            Some((0, 0.75)),
        ),
        row("t = 0 is outside", &[flat(10.0, 0.0)], [1.0, 1.0, 0.0], DOWN, [tiny, UP], None),
        row("t = 0 is outside of a large scene", &[flat(1e4, 0.0)], [1.0, 1.0, 0.0], DOWN, [tiny, UP], None),
        row("t = 0 is inside", &[flat(1e4, 0.0)], [1.0, 1.0, 0.0], DOWN, [0.0, tiny], Some((0, 0.0))),
        row("t = 0 is outside, from below", &[flat(1e4, 0.0)], [1.0, 1.0, 0.0], DOWN, [-UP, -tiny], None),
        row("negative t", &[flat(1.0, 0.0)], [0.25, 0.25, -2.0], DOWN, [-UP, UP], Some((0, -2.0))),
        row("t beyond floats", &[flat(1e21, 0.0)], [1e20, 1e20, 2e21], [0.0, 0.0, -1e-18], all, None),
        row("the largest t", &[flat(1e21, 0.0)], [1e20, 1e20, 1e20], [0.0, 0.0, -1e-18], all, Some((0, 1e38))),
        row(
            "t beyond floats comes first",
            &[flat(1e21, 0.0), flat(1e21, 1.95e21)],
            [1e20, 1e20, 2e21],
            [0.0, 0.0, -1e-18],
            all,
            Some((1, ((2e21f32 as f64 - 1.95e21f32 as f64) / 1e-18f32 as f64) as f32)),
        ),
        row("far below", &[flat(1e21, 0.0)], [1e20, 1e20, -2e21], [0.0, 0.0, -1e-18], [-UP, UP], None),
        row(
            "a direction of all sizes",
            &[flat(1.0, 0.0)],
            [0.25, 0.25, 1.0],
            [p(-149), 0.0, -p(127)],
            all,
            Some((0, p(-127))),
        ),
        Row {
            next: Some(([-p(-16), p(-146), 0.0], Some((1, p(-72))))),
            ..row(
                "a secondary ray that is hardly off its triangle",
                &[flat(1.0, 0.0), [[1.0, 0.25, -1.0], [-1.0, -2.0, 1.0], [-1.0, 3.0, 1.0]]],
                [p(-88), 0.25, 1.0],
                DOWN,
                all,
                Some((0, 1.0)),
            )
        },
        Row {
            next: Some(([0.0, 0.0, 1.0], None)),
            ..row(
                "a secondary ray that starts where floats end",
                &[
                    [[0.0, 0.0, 0.0], [1.0, 0.0, p(-105)], [0.0, 1.0, 0.0]],
                    [[0.0, -1.0, p(-107)], [1.0, -1.0, p(-107)], [0.0, 2.0, p(-107)]],
                ],
                [0.5, tiny, 1.0],
                DOWN,
                all,
                Some((0, 1.0)),
            )
        },
    ]
}

#[test]
fn rays_at_the_ends_of_float32_are_answered_exactly() {
    let device = device();
    for row in rows_at_the_ends() {
        let triangles: Vec<_> = row.triangles.iter().map(|triangle| triangle.map(Vec3::from)).collect();
        for &accel in StructureKind::ALL {
            let options = TraceOptions::of(accel);
            let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles), &options).unwrap());
            let [t_min, t_max] = row.limits;
            let next = row.next.map(|(direction, _)| move |_: usize| Vec3::from(direction));
            let next: Option<&(dyn Fn(usize) -> Vec3 + Sync)> = next.as_ref().map(|next| next as _);
            let batch = buffers.batch(1, |_| (row.origin.into(), row.direction.into(), t_min, t_max), next);
            // Compilers take longer than all else here.
            let on_device = device.as_ref().filter(|_| matches!(accel, StructureKind::Kd | StructureKind::Bvh2));
            for device in [None].into_iter().chain(on_device.map(Some)) {
                let what = format!("{}, {accel}, {}", row.name, device.map_or("reference", |device| &device.info.name));
                let mut tracer = open_tracer(device, &buffers, &options, 1, None).unwrap();
                let found = |hit: &Hit| (hit.primitive != NO_PRIMITIVE).then_some((hit.primitive, hit.t));
                let result = tracer.trace(&batch.job(false, 1), &|_| ()).unwrap();
                assert_eq!(found(&result.hits[0]), row.hit, "{what}");
                if let (Some((_, expected)), Some(hits)) = (row.next, result.next_hits) {
                    assert_eq!(found(&hits[0]), expected, "{what}, secondary ray");
                }
                if row.next.is_none() {
                    let any = tracer.trace(&batch.job(true, 1), &|_| ()).unwrap().hits[0];
                    assert_eq!(any.primitive != NO_PRIMITIVE, row.hit.is_some(), "{what}, any hit");
                }
            }
        }
    }
}
/// Many triangles in one place, their corners in every order, and many in one oblique plane: all that a ray hits of one
/// kind are at the same t. The hit is the first of them, rays that leave it meet none of the others, and that takes 5
/// to 35 times as long as the test that decides nothing exactly: it was 330 times when each tie was decided anew in
/// exact integers.
#[test]
fn ties_are_decided_by_number() {
    const COUNT: usize = 1500;
    let corners = [Vec3::new(0.0, 0.0, 0.25), Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.25, 1.0, 0.75)];
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let same: Vec<[Vec3; 3]> = (0..COUNT).map(|i| orders[i % 6].map(|k: usize| corners[k])).collect();
    let mut random = Random::new(SEED);
    let mut in_plane = |x: f32, y: f32| {
        let [x, y] = [x, y].map(|x| ((x + 0.5 * random.unit()) * 4096.0).round() / 4096.0);
        Vec3::new(x, y, 2.0 * x + 3.0 * y)
    };
    let oblique: Vec<_> = (0..COUNT).map(|_| [in_plane(-2.0, -2.0), in_plane(3.0, -1.0), in_plane(0.5, 3.0)]).collect();
    assert!(same.iter().all(|triangle| are_same_points(&same[0], triangle)));
    assert!(oblique.iter().all(|triangle| are_in_one_plane(&oblique[0], triangle)));
    assert!(!are_same_points(&same[0], &oblique[0]) && !are_same_points(&oblique[0], &oblique[1]));
    for (name, triangles) in [("same", &same), ("oblique", &oblique)] {
        let seconds = [Intersector::Exact, Intersector::Watertight].map(|intersector| {
            let options = TraceOptions { intersector, ..TraceOptions::of(StructureKind::Brute) };
            let buffers = Arc::new(SceneBuffers::new(&scene_of(triangles), &options).unwrap());
            let ray = |i: usize| {
                let at = Vec3::new(0.3 + 0.01 * (i % 10) as f32, 0.2 + 0.003 * i as f32, 0.5);
                let along = Vec3::new(0.01, 0.02, -1.0);
                buffers.trace_ray(at - 9.0 * along, along, 0.0, f32::INFINITY)
            };
            let rays: Vec<_> = (0..40).map(ray).collect();
            let next: Vec<_> = (0..40).map(|i| Float4::new(Vec3::new(0.1, 0.01 * i as f32, 1.0), 0.0)).collect();
            let mut twin = open_tracer(None, &buffers, &options, 1, None).unwrap();
            let job = TraceJob { extreme: &[], rays: &rays, next_directions: Some(&next), any_hit: false, repeat: 1 };
            let mut best = f64::INFINITY;
            for _ in 0..3 {
                let start = std::time::Instant::now();
                let found = twin.trace(&job, &|_| ()).unwrap();
                best = best.min(start.elapsed().as_secs_f64());
                if intersector == Intersector::Exact {
                    assert!(found.hits.iter().all(|hit| hit.primitive == 0), "{name}");
                    assert!(found.next_hits.unwrap().iter().all(|hit| hit.primitive == NO_PRIMITIVE), "{name}");
                }
            }
            best
        });
        println!("{name}: {seconds:?} s");
        assert!(seconds[0] < 100.0 * seconds[1], "{name}: exact {} s, watertight {} s", seconds[0], seconds[1]);
    }
}

/// The kernel's answers are certain: whatever it says yes to is so, and it says so of all within its range.
#[test]
fn planes_are_one_where_whole_numbers_say_so() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..4000 {
        // Steps of 2^-12 fit; of 2^-30 and coordinates beside smaller ones do not always.
        let step = [4096.0, 1048576.0, 16777216.0][i % 3];
        let mut point = || {
            let [x, y] = [(); 2].map(|()| (random.signed() * step).round() / step);
            let off = if i % 4 == 3 { (random.bits() % 2) as f32 / step } else { 0.0 };
            let power = [1.0, 2f32.powi(-90)][i / 2000];
            Vec3::new(x, y, x + off) * power
        };
        (0..6).for_each(|_| data.extend(point().to_array()));
    }
    let body = "out[0] = are_in_one_plane(vload3(0, in), vload3(1, in), vload3(2, in), vload3(3, in), vload3(4, in), \
                vload3(5, in)) \
                ? 1.0f : 0.0f;";
    let on_device = crate::common::probe::run(&device, body, 18, 1, &data);
    let mut counts = [0; 2];
    for (numbers, found) in data.chunks_exact(18).zip(on_device) {
        let corners: Vec<Vec3> = numbers.chunks_exact(3).map(Vec3::from_slice).collect();
        let [start, along1, along2] = [0, 1, 2].map(|i| vector(corners[i]));
        let normal = cross(&minus(&along1, &start), &minus(&along2, &start));
        let exact = corners[3..].iter().all(|p| dot(&normal, &minus(&vector(*p), &start)).sign() == Sign::NoSign);
        assert_eq!(found == 1.0, exact, "{corners:?}");
        assert_eq!(are_in_one_plane(&[0, 1, 2].map(|i| corners[i]), &[3, 4, 5].map(|i| corners[i])), exact);
        counts[usize::from(exact)] += 1;
    }
    assert!(counts[0] > 500 && counts[1] > 2000, "{counts:?}");
}
