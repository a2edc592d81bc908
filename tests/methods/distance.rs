//! Closest points and distances: against rational arithmetic over all triangles, device against twin, signs against
//! solid angles.

use super::closed::meshes as closed_meshes;
use super::crossings::winding;
use crate::common::{Random, SEED, asked, device, scene_of, soup};
use glam::{DVec3, Vec3};
use num_bigint::BigInt;
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::closest::point_scene;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::tracer::{Candidates, CandidatesJob};
use raybrook::{ClosestPoint, Error, Scene, Tracer};
use raybrook_lab::stress::{Mesh, Ratio};
use rayon::prelude::*;
use std::sync::{Arc, LazyLock};

type Triangle = [Vec3; 3];
type Whole = [BigInt; 3];

/// A mesh, points around it, and what rational arithmetic says of them.
struct Model {
    name: &'static str,
    triangles: Vec<Triangle>,
    points: Vec<[f32; 3]>,
    expected: Vec<ClosestPoint>,
}

/// A closest point before it is rounded: position and weights as numerators over one denominator, in whole units.
struct Rational {
    square: Ratio,
    at: Whole,
    weights: [BigInt; 2],
    whole: BigInt,
}

impl Rational {
    fn weight(&self, corner: usize) -> BigInt {
        match corner {
            0 => &self.whole - &self.weights[0] - &self.weights[1],
            _ => self.weights[corner - 1].clone(),
        }
    }
}

fn minus(a: &Whole, b: &Whole) -> Whole {
    std::array::from_fn(|k| &a[k] - &b[k])
}

fn dot(a: &Whole, b: &Whole) -> BigInt {
    (0..3).map(|k| &a[k] * &b[k]).sum()
}

fn cross(a: &Whole, b: &Whole) -> Whole {
    std::array::from_fn(|k| &a[(k + 1) % 3] * &b[(k + 2) % 3] - &a[(k + 2) % 3] * &b[(k + 1) % 3])
}

/// A float as a whole number of units of 2^`exponent`, which it is.
fn whole(x: f32, exponent: i32) -> BigInt {
    let x = Ratio::from_float(x.into());
    let (numerator, denominator) = (x.numerator().clone(), x.denominator());
    let scaled = if exponent < 0 { numerator << -exponent } else { numerator >> exponent };
    scaled / denominator
}

/// The exponent of the lowest bit of some floats.
fn lowest_bit(numbers: impl Iterator<Item = f32>) -> i32 {
    let exponent = |x: f32| {
        let field = (x.to_bits() >> 23 & 255) as i32;
        let significand = x.to_bits() & 0x7f_ffff | if field == 0 { 0 } else { 0x80_0000 };
        field.max(1) - 150 + significand.trailing_zeros() as i32
    };
    numbers.filter(|&x| x != 0.0).map(exponent).min().unwrap_or(0)
}

/// Every place of a triangle where the distance may be least: vertices, feet on edges, and that on the face.
fn places(corners: &[Whole; 3], point: &Whole) -> Vec<Rational> {
    let mut places = Vec::new();
    let mut add = |weights: [BigInt; 3]| {
        let whole: BigInt = weights.iter().sum();
        let at: Whole = std::array::from_fn(|k| (0..3).map(|i| &corners[i][k] * &weights[i]).sum());
        let to: Whole = std::array::from_fn(|k| &at[k] - &point[k] * &whole);
        let square = Ratio::new(dot(&to, &to), &whole * &whole, 0);
        let [_, u, v] = weights;
        places.push(Rational { square, at, weights: [u, v], whole });
    };
    let zero = BigInt::ZERO;
    for i in 0..3 {
        let mut weights = [zero.clone(), zero.clone(), zero.clone()];
        weights[i] = 1.into();
        add(weights.clone());
        let j = (i + 1) % 3;
        let edge = minus(&corners[j], &corners[i]);
        let from_start = dot(&edge, &minus(point, &corners[i]));
        let from_end = dot(&edge, &minus(&corners[j], point));
        if from_start > zero && from_end > zero {
            (weights[i], weights[j]) = (from_end, from_start);
            add(weights);
        }
    }
    let normal = cross(&minus(&corners[1], &corners[0]), &minus(&corners[2], &corners[0]));
    let to = [0, 1, 2].map(|i| minus(&corners[i], point));
    let weights = [0, 1, 2].map(|i| dot(&normal, &cross(&to[(i + 1) % 3], &to[(i + 2) % 3])));
    let has_area = dot(&normal, &normal) > zero;
    if has_area && weights.iter().all(|weight| *weight >= zero) {
        add(weights);
    }
    if !has_area {
        keep_longest_edge(corners, &mut places);
    }
    places
}

/// The weights of a triangle without area are those on its longest edge, the first of several, which is all of it.
fn keep_longest_edge(corners: &[Whole; 3], places: &mut Vec<Rational>) {
    let square = |i: usize| {
        let edge = minus(&corners[(i + 1) % 3], &corners[i]);
        dot(&edge, &edge)
    };
    let longest = (0..3).rev().max_by_key(|&i| square(i)).unwrap();
    let least = |places: &[Rational]| places.iter().map(|place| place.square.clone()).min().unwrap();
    let of_all = least(places);
    places.retain(|place| place.weight((longest + 2) % 3) == BigInt::ZERO);
    assert!(least(places) == of_all, "the longest edge is not all of the triangle");
}

/// The float nearest to the square root of a square of units of 2^`exponent`.
fn root(square: &Ratio, exponent: i32) -> f32 {
    const MORE_BITS: i32 = 40;
    let shift = MORE_BITS + (square.denominator().bits() as i32 - square.numerator().bits() as i32).max(0) / 2;
    let scaled = square.numerator() << (2 * shift);
    let quotient = &scaled / square.denominator();
    let root = quotient.sqrt();
    let is_exact = &root * &root * square.denominator() == scaled;
    Ratio::new(root * 2 + i32::from(!is_exact), 1.into(), exponent - shift - 1).to_f32()
}

/// The closest point by rational arithmetic; f64 leaves out what is farther by far.
fn closest(triangles: &[Triangle], point: [f32; 3]) -> ClosestPoint {
    let at = Vec3::from(point);
    let sound = |i: &usize| triangles[*i].iter().all(|corner| corner.is_finite());
    let to = |p: Vec3| (DVec3::from(p) - DVec3::from(at)).length();
    let near = |i: usize| {
        let [a, b, c] = triangles[i];
        let inside = DVec3::from(at).clamp(a.min(b).min(c).into(), a.max(b).max(c).into());
        (inside - DVec3::from(at)).length()
    };
    let corner = |i: usize| triangles[i].map(to).into_iter().fold(f64::INFINITY, f64::min);
    let limit = (0..triangles.len()).filter(sound).map(corner).fold(f64::INFINITY, f64::min) * (1.0 + 1e-9);
    let mut best: Option<(usize, i32, Rational)> = None;
    for i in (0..triangles.len()).filter(sound).filter(|&i| near(i) <= limit) {
        let exponent = lowest_bit(triangles[i].iter().flat_map(|p| p.to_array()).chain(point));
        let units = |p: Vec3| p.to_array().map(|x| whole(x, exponent));
        let mut places = places(&triangles[i].map(units), &units(at));
        let nearest = (0..places.len()).min_by(|&a, &b| places[a].square.cmp(&places[b].square)).unwrap();
        let place = places.swap_remove(nearest);
        let square = |place: &Rational, exponent: i32| {
            Ratio::new(place.square.numerator().clone(), place.square.denominator().clone(), 2 * exponent)
        };
        if best.as_ref().is_none_or(|(_, other, best)| square(&place, exponent) < square(best, *other)) {
            best = Some((i, exponent, place));
        }
    }
    let (triangle, exponent, place) = best.unwrap();
    let rounded = |x: &BigInt, exponent| Ratio::new(x.clone(), place.whole.clone(), exponent).to_f32() + 0.0;
    ClosestPoint {
        point: std::array::from_fn(|k| rounded(&place.at[k], exponent)),
        distance: root(&place.square, exponent),
        triangle: triangle as u32,
        u: rounded(&place.weights[0], 0),
        v: rounded(&place.weights[1], 0),
    }
}

fn of_mesh(mesh: &Mesh) -> Vec<Triangle> {
    (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect()
}

/// Segments, points, a triangle that is not finite, and one that is as it should be.
fn degenerate() -> Vec<Triangle> {
    let p = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let (a, b, c) = (p(0.0, 0.0, 0.0), p(1.0, 0.5, 0.25), p(3.0, 1.5, 0.75));
    let segments = [[a, b, c], [c, b, a], [b, a, c], [a, c, b], [a, a, b], [b, a, a], [a, b, a]];
    let turned = segments.map(|triangle| triangle.map(|p| Vec3::new(-p.y, p.x, p.z + 2.0)));
    let others = [[c; 3], [p(2.0, 2.0, 2.0); 3], [p(-3.0, 0.0, 0.0), p(-4.0, 0.0, 0.5), p(-3.5, 1.0, 0.1)]];
    let unsound = [[p(f32::NAN, 0.0, 0.0), a, b], [p(f32::INFINITY, 1.0, 0.0), a, c]];
    [&segments[..], &turned, &unsound, &others].concat()
}

/// Meshes of many kinds, each with the size of its box.
fn meshes() -> Vec<(&'static str, Vec<Triangle>)> {
    let mut random = Random::new(SEED);
    let random_soup = soup(300, 0.3, &mut random);
    let scaled = |scale: f32| random_soup.iter().map(|t| t.map(|p| p * scale)).collect::<Vec<_>>();
    let any = (0..40).map(|_| [(); 3].map(|()| Vec3::from_array([(); 3].map(|()| random.any_float())))).collect();
    let mut sheets = Mesh::sheet(6, |_, _| 0.0);
    sheets.append(&Mesh::sheet(3, |_, _| 0.0).turned_around());
    sheets.append(&Mesh::sheet(6, |x, y| (x + y) as f32 * 0.25));
    vec![
        ("sphere", of_mesh(&Mesh::sphere(3))),
        ("cubes", of_mesh(&Mesh::cubes(2))),
        ("slivers", of_mesh(&Mesh::double_fan(6, 0.01))),
        ("offset", of_mesh(&Mesh::sphere(2).mapped(|p| p + 1000.0))),
        ("sheets", of_mesh(&sheets)),
        ("degenerate", degenerate()),
        ("small", scaled(1e-30)),
        ("smallest", scaled(1e-43)),
        ("large", scaled(1e30)),
        ("largest", scaled(2e38)),
        ("soup", random_soup),
        ("any floats", any),
    ]
}

/// Points near, far, on vertices, edges and faces, and as far from many triangles.
fn points(triangles: &[Triangle]) -> Vec<[f32; 3]> {
    let mut random = Random::new(SEED + 1);
    let sound: Vec<_> = triangles.iter().filter(|t| t.iter().all(|p| p.is_finite())).collect();
    let low = sound.iter().flat_map(|t| t.iter()).fold(Vec3::INFINITY, |low, &p| low.min(p));
    let high = sound.iter().flat_map(|t| t.iter()).fold(Vec3::NEG_INFINITY, |high, &p| high.max(p));
    let (middle, size) = (0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low).max_element());
    let mut points = vec![middle, low, high, Vec3::ZERO, Vec3::new(middle.x, middle.y, high.z)];
    for i in 0..40 {
        let [a, b, c] = *sound[random.below(sound.len())];
        let (s, t) = (random.unit(), random.unit());
        let (edge, face) = (a + (b - a) * s, a + (b - a) * (s * t) + (c - a) * (s - s * t));
        let normal = (b - a).normalize_or_zero().cross((c - a).normalize_or_zero()) * size;
        let near = [1e-7, 1e-4, 1e-2, 1.0][i % 4] * random.sign();
        points.extend([
            [a, edge, face][i % 3],
            0.5 * a + 0.5 * b,
            face + normal * near,
            edge + normal * near,
            a + (a - middle) * near,
            middle + random.vec3() * size * [0.7, 1.5, 1e3, 1e6][i % 4],
            (middle + random.vec3() * size).round(),
        ]);
    }
    points.extend([1e12, 1e20, 1e35].map(|far| middle + random.vec3() * far));
    points.extend([Vec3::MAX, Vec3::splat(1e-45), Vec3::new(f32::MAX, 0.0, f32::MIN)]);
    points.into_iter().filter(|point| point.is_finite()).map(|point| point.to_array()).collect()
}

/// Made once: rational arithmetic takes its time.
fn models() -> &'static [Model] {
    static ALL: LazyLock<Vec<Model>> = LazyLock::new(|| {
        let model = |(name, triangles): (&'static str, Vec<Triangle>)| {
            let points = points(&triangles);
            let expected = points.par_iter().map(|&point| closest(&triangles, point)).collect();
            Model { name, triangles, points, expected }
        };
        meshes().into_iter().map(model).collect()
    });
    &ALL
}

/// Methods that differ in what points go through.
const METHODS: [&str; 3] = ["bvh2", "kd", "brute"];

fn bits(closest: &ClosestPoint) -> (u32, [u32; 6]) {
    let [x, y, z] = closest.point;
    (closest.triangle, [x, y, z, closest.distance, closest.u, closest.v].map(f32::to_bits))
}

fn devices() -> Vec<String> {
    std::iter::once("reference".to_owned()).chain(device().map(|device| device.info.index.to_string())).collect()
}

#[test]
fn closest_points_are_those_of_rational_arithmetic() {
    let (mut tested, mut wrong) = (0, 0);
    let cases: Vec<_> =
        devices().into_iter().flat_map(|device| METHODS.map(|method| (device.clone(), method))).collect();
    for model in models() {
        for (device, method) in &cases {
            let scene = scene_of(&model.triangles);
            let mut tracer = Tracer::builder(&scene).device(device).method(method).build().unwrap();
            let found = tracer.closest_points(&model.points).unwrap();
            for (i, (found, expected)) in found.iter().zip(&model.expected).enumerate() {
                tested += 1;
                if found.as_ref().map(bits) != Some(bits(expected)) {
                    wrong += 1;
                    let point = model.points[i];
                    eprintln!("{} {device} {method} {point:?}: {found:?}, not {expected:?}", model.name);
                }
            }
        }
    }
    eprintln!("{tested} closest points tested, {wrong} wrong");
    assert!(tested > 9000, "{tested}");
    assert_eq!(wrong, 0);
}

/// The lists, too, although the answers do not depend on them.
#[test]
fn device_and_twin_list_the_same_candidates() {
    let Some(device) = device() else { return };
    let (mut most, mut listed, mut wide, mut shared) = (0, 0, 0, 0);
    for model in models() {
        let methods = [
            ("structure=bvh2", false),
            ("structure=bvh2 spatial_splits=1", true),
            ("structure=grid", false),
            ("structure=grid", true),
            ("structure=bvh8", false),
            ("structure=bvh8 spatial_splits=1", true),
        ];
        for (method, prefers_wide) in methods {
            let options = asked(method);
            let buffers = Arc::new(SceneBuffers::new(&scene_of(&model.triangles), &options).unwrap());
            let scene = point_scene(&buffers, prefers_wide, &MemoryBudget::available()).unwrap();
            wide += usize::from(scene.is_wide());
            shared += usize::from(scene.is_shared());
            let scaled = |point: &[f32; 3]| Float4::new(Vec3::from(*point) * scene.scale(), 0.0);
            let points: Vec<_> = model.points.iter().map(scaled).chain([Float4::new(Vec3::NAN, 0.0)]).collect();
            let found = |device| -> Candidates {
                let mut tracer = open_tracer(device, &buffers, &options, 1, None).unwrap();
                tracer.find_candidates(&CandidatesJob { scene: &scene, points: &points }, &|_| ()).unwrap()
            };
            let (got, expected) = (found(Some(&device)), found(None));
            assert_eq!(got.counts, expected.counts, "{}", model.name);
            for point in 0..points.len() {
                assert_eq!(got.of_point(point), expected.of_point(point), "{} {point}", model.name);
            }
            assert_eq!(got.counts.last(), Some(&0));
            most = got.counts.iter().copied().max().unwrap().max(most);
            listed += (0..points.len()).filter(|&point| got.of_point(point).is_some()).count();
        }
    }
    assert!(most > 500 && listed > 5000, "{most} {listed}");
    assert!(wide > models().len() && shared > models().len(), "{wide} {shared}");
}

#[test]
fn signs_are_those_of_solid_angles() {
    let (mut tested, mut inside) = (0, 0);
    for (name, closed) in closed_meshes() {
        let mesh = closed.mesh();
        let triangles = of_mesh(mesh);
        let points = points(&triangles);
        for device in devices() {
            let mut tracer = Tracer::builder(&mesh.scene()).device(&device).build().unwrap();
            let (distances, signed) = (tracer.distances(&points).unwrap(), tracer.signed_distances(&points).unwrap());
            for (i, point) in points.iter().enumerate() {
                assert_eq!(distances[i], signed[i].abs(), "{name} {device} {point:?}");
                let is_far = Vec3::from(*point).abs().max_element() > 1e6;
                let Some(times) = winding(mesh, Vec3::from(*point).into()).filter(|_| !is_far) else { continue };
                assert_eq!(signed[i] < 0.0, times % 2 != 0, "{name} {device} {point:?} {}", signed[i]);
                tested += 1;
                inside += usize::from(signed[i] < 0.0);
            }
            let corner = triangles[0][0].to_array();
            let on_surface = tracer.signed_distances(&[corner]).unwrap()[0];
            assert_eq!(on_surface.to_bits(), 0, "{name}");
        }
    }
    eprintln!("{tested} signs tested, {inside} inside");
    assert!(tested > 1000 && inside > 100, "{tested} {inside}");
}

#[test]
fn winding_numbers_are_sums_of_solid_angles() {
    let (mut tested, mut halves) = (0, 0);
    for (name, closed) in closed_meshes() {
        let mut mesh = closed.mesh().clone();
        for is_open in [false, true] {
            if is_open {
                mesh.triangles.truncate(mesh.triangles.len() * 2 / 3);
            }
            let points = points(&of_mesh(&mesh));
            let mut tracer = Tracer::builder(&mesh.scene()).device("reference").build().unwrap();
            let distances = tracer.distances(&points).unwrap();
            for (i, number) in tracer.winding_numbers(&points).unwrap().into_iter().enumerate() {
                let point = Vec3::from(points[i]).into();
                // Angles are badly conditioned near edges.
                let error = if distances[i] > 1e-3 { 1e-12 } else { 1e-8 };
                let sum = solid_angles(&mesh, point);
                assert!((number - sum).abs() < error, "{name} {point:?}: {number}, not {sum}");
                // Nearer than this the other sum, whose signs are rounded, may be on the wrong side.
                if !is_open
                    && distances[i] > 1e-9
                    && let Some(times) = winding(&mesh, point)
                {
                    assert!((number - f64::from(times)).abs() < error, "{name} {point:?}: {number}, not {times}");
                    tested += 1;
                }
                halves += usize::from((number - 0.5).abs() < 0.4);
            }
        }
    }
    eprintln!("{tested} winding numbers of closed meshes tested");
    assert!(tested > 500 && halves > 50, "{tested} {halves}");
}

/// The winding number by every triangle, with exact signs; those whose plane has the point count nothing.
fn solid_angles(mesh: &Mesh, point: DVec3) -> f64 {
    let of_triangle = |i: usize| {
        let corners = mesh.corners(i);
        let exponent = -149;
        let units = |p: Vec3| p.to_array().map(|x| whole(x, exponent));
        let at = units(point.as_vec3());
        let [a, b, c] = corners.map(|corner| minus(&units(corner), &at));
        let across = dot(&a, &cross(&b, &c));
        if across == BigInt::ZERO {
            return 0.0;
        }
        let across = Ratio::new(across, 1.into(), 3 * exponent).to_f64();
        let [a, b, c] = corners.map(|corner| DVec3::from(corner) - point);
        let sizes = [a, b, c].map(DVec3::length);
        let along = sizes.iter().product::<f64>() + a.dot(b) * sizes[2] + b.dot(c) * sizes[0] + c.dot(a) * sizes[1];
        across.atan2(along) / std::f64::consts::TAU
    };
    (0..mesh.triangles.len()).map(of_triangle).sum()
}

#[test]
fn what_has_no_answer_says_so() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let scene = Scene::from_mesh(&corners, &[[0, 1, 2]]).unwrap();
    let points = [[0.25, 0.25, 2.0], [f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [f32::MAX, 0.0, f32::MIN]];
    for device in devices() {
        let mut tracer = Tracer::builder(&scene).device(&device).build().unwrap();
        let closest = tracer.closest_points(&points).unwrap();
        assert_eq!(closest[0].map(|closest| closest.distance), Some(2.0));
        assert_eq!(closest[1..3], [None; 2]);
        assert_eq!(closest[3].map(|closest| closest.distance), Some(f32::INFINITY));
        assert!(tracer.distances(&points).unwrap()[1..3].iter().all(|distance| distance.is_nan()));
        let error = tracer.signed_distances(&points).unwrap_err();
        assert!(matches!(error, Error::Scene(_)) && error.to_string().contains("3 of its edges"), "{error}");
        assert!(tracer.winding_numbers(&points).unwrap()[1..3].iter().all(|number| number.is_nan()));
        assert!(tracer.closest_points(&[]).unwrap().is_empty() && tracer.winding_numbers(&[]).unwrap().is_empty());

        let mut empty = Tracer::builder(&Scene::default()).device(&device).build().unwrap();
        assert_eq!(empty.closest_points(&points).unwrap(), [None; 4]);
        let distances = empty.distances(&points).unwrap();
        assert!(distances[0] == f32::INFINITY && distances[1].is_nan());
        assert_eq!(empty.winding_numbers(&points[..1]).unwrap(), [0.0]);
    }
}
