//! Crossings of surfaces, and points inside: against winding numbers in f64, which know nothing of edges.

use super::closed::meshes;
use crate::common::{Random, SEED, device};
use glam::{DVec3, Vec3};
use raybrook::{AllHits, Error, Hit, Ray, Scene, Tracer};
use raybrook_lab::stress::{ExactTracer, Mesh};
use std::sync::{Arc, Mutex};

fn devices() -> Vec<String> {
    std::iter::once("reference".to_owned()).chain(device().map(|device| device.info.index.to_string())).collect()
}

fn tracer_on(device: &str, mesh: &Mesh) -> Tracer {
    Tracer::builder(&mesh.scene()).device(device).build().unwrap()
}

/// How often the mesh winds around a point, by the solid angles of its triangles: van Oosterom and Strackee, "The Solid
/// Angle of a Plane Triangle", IEEE Transactions on Biomedical Engineering 30(2), 1983. `None` near the surface, where
/// f64 does not tell.
pub fn winding(mesh: &Mesh, point: DVec3) -> Option<i32> {
    let mut sum = 0.0;
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i).map(|corner| corner.as_dvec3() - point);
        let sizes = [a, b, c].map(DVec3::length);
        let across = a.dot(b.cross(c));
        let along = sizes.iter().product::<f64>() + a.dot(b) * sizes[2] + b.dot(c) * sizes[0] + c.dot(a) * sizes[1];
        // In the triangle's plane, and not outside of it.
        if across.abs() <= 1e-12 * sizes.iter().product::<f64>() && along <= 0.0 {
            return None;
        }
        sum += across.atan2(along) / std::f64::consts::TAU;
    }
    ((sum - sum.round()).abs() < 1e-9).then(|| sum.round() as i32)
}

/// A gap along a ray that is narrower is left out: the point in its middle is too near to the surface.
const LEAST_GAP: f32 = 1e-3;

/// How often the winding number's evenness changes along each ray, and whether the ray meets what does not change it;
/// `None` where f64 does not tell.
fn expected_crossings(mesh: &Mesh, rays: &[Ray], all: &AllHits) -> Vec<Option<(usize, bool)>> {
    let exact = ExactTracer::new(mesh);
    let of_ray = |(i, ray): (usize, &Ray)| {
        let [origin, direction] = [ray.origin, ray.direction].map(|p| Vec3::from(p).as_dvec3());
        let line = exact.line(origin, direction).unwrap();
        let t = |hit: &Hit| exact.crossing(&line, hit.triangle).unwrap().t;
        if all.of_ray(i).windows(2).any(|two| two[0].t == two[1].t && t(&two[0]) != t(&two[1])) {
            return None; // a gap that rounding closes
        }
        let mut places: Vec<f32> = all.of_ray(i).iter().map(|hit| hit.t).collect();
        places.dedup();
        let last = places.last().map_or(0.0, |t| t + 1.0);
        let ends: Vec<f32> = [vec![0.0], places, vec![last]].concat();
        let length = Vec3::from(ray.direction).length();
        if ends.windows(2).any(|gap| (gap[1] - gap[0]) * length < LEAST_GAP) {
            return None;
        }
        let middle = |gap: &[f32]| winding(mesh, origin + direction * ((f64::from(gap[0]) + f64::from(gap[1])) / 2.0));
        let windings = ends.windows(2).map(middle).collect::<Option<Vec<_>>>()?;
        let changes = windings.windows(2).filter(|two| (two[0] - two[1]) % 2 != 0).count();
        Some((changes, windings.windows(2).any(|two| two[0] == two[1])))
    };
    rays.iter().enumerate().map(of_ray).collect()
}

#[test]
fn rays_cross_where_inside_and_outside_change() {
    let (mut tested, mut touches) = (0, 0);
    for (name, closed) in meshes() {
        let mesh = closed.mesh();
        let mut random = Random::new(SEED);
        let ray = |index: u64| {
            let aimed = closed.ray(SEED, index);
            // Some in the axes' directions, along edges and faces.
            match index % 4 {
                0 => {
                    let to = mesh.random_vertex(&mut random);
                    let axis = random.pick(&[Vec3::X, Vec3::Y, Vec3::NEG_Z]);
                    Ray::new((to - axis * 8.0).to_array(), axis.to_array())
                }
                _ => Ray::new(aimed.origin.to_array(), aimed.direction.to_array()),
            }
        };
        let rays: Vec<_> = (0..800).map(ray).collect();
        let all = tracer_on("reference", mesh).all_hits(&rays).unwrap();
        let expected = expected_crossings(mesh, &rays, &all);
        for device in devices() {
            let mut tracer = tracer_on(&device, mesh);
            let found = tracer.all_hits(&rays).unwrap();
            let differing = (0..rays.len()).find(|&i| found.of_ray(i) != all.of_ray(i));
            let told = differing.map(|i| (rays[i], found.of_ray(i), all.of_ray(i)));
            assert!(told.is_none(), "{name} on {device}: {told:?}");
            let counts = tracer.count_crossings(&rays).unwrap();
            for (i, expected) in expected.iter().enumerate() {
                let Some((changes, has_touch)) = *expected else { continue };
                let ray = &rays[i];
                assert_eq!(counts[i] as usize, changes, "{name} on {device}: ray {i} {ray:?} {:?}", all.of_ray(i));
                tested += 1;
                touches += usize::from(has_touch);
            }
        }
    }
    assert!(tested > 2000 && touches > 50, "{tested} {touches}");
}

#[test]
fn ties_are_those_of_exact_arithmetic() {
    let (mut ties, mut others) = (0, 0);
    for (name, closed) in meshes() {
        let mesh = closed.mesh();
        let mut random = Random::new(SEED);
        let ray = |index: u64| {
            let aimed = closed.ray(SEED, index);
            // Straight at a vertex from so far away that t is the same number for what lies near it.
            let to = mesh.random_vertex(&mut random);
            let axis = random.pick(&[Vec3::X, Vec3::Y, Vec3::NEG_Z]);
            match index % 2 {
                0 => Ray::new((to - axis * 1e6).to_array(), axis.to_array()),
                _ => Ray::new(aimed.origin.to_array(), aimed.direction.to_array()),
            }
        };
        let rays: Vec<_> = (0..150).map(ray).collect();
        let exact = ExactTracer::new(mesh);
        for device in devices() {
            let mut tracer = tracer_on(&device, mesh);
            let all = tracer.all_hits(&rays).unwrap();
            let mut found = tracer.ties(&rays, &all).into_iter();
            for (i, ray) in rays.iter().enumerate() {
                let [origin, direction] = [ray.origin, ray.direction].map(|p| Vec3::from(p).as_dvec3());
                let line = exact.line(origin, direction).unwrap();
                let t = |hit: &Hit| exact.crossing(&line, hit.triangle).unwrap().t;
                let hits = all.of_ray(i);
                for k in 0..hits.len() {
                    let is_tie = k > 0 && hits[k - 1].t == hits[k].t && t(&hits[k - 1]) == t(&hits[k]);
                    assert_eq!(found.next(), Some(is_tie), "{name} on {device}: hit {k} of {ray:?}");
                    ties += usize::from(is_tie);
                    others += usize::from(!is_tie && k > 0 && hits[k - 1].t == hits[k].t);
                }
            }
            assert_eq!(found.next(), None);
        }
    }
    assert!(ties > 100 && others > 0, "{ties} {others}");
}

fn cube() -> Mesh {
    Mesh::cube(Vec3::ZERO, Vec3::ONE)
}

#[test]
fn edges_and_vertices_are_crossed_once_or_touched() {
    let cases = [
        ([-1.0, 1.0, 0.5], [1.0, -1.0, 0.0], 0),  // touches an edge
        ([-1.0, 1.0, 0.0], [1.0, -1.0, 0.0], 0),  // and a vertex
        ([-1.0, -1.0, 0.5], [1.0, 1.0, 0.0], 2),  // in and out through edges
        ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], 2), // through vertices
        ([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0], 2),   // through the edges that cut faces into triangles
        ([0.5, 0.25, 0.5], [1.0, 0.0, 0.0], 1),   // from inside
        ([0.5, 0.25, 0.5], [1.0, 1.0, 1.0], 1),
    ];
    for device in devices() {
        let mut tracer = tracer_on(&device, &cube());
        for (origin, direction, expected) in cases {
            let count = tracer.count_crossings(&[Ray::new(origin, direction)]).unwrap();
            assert_eq!(count, [expected], "{device}: {origin:?} {direction:?}");
        }
        // In a face's plane: in and out, or neither.
        for z in [0.0, 1.0] {
            let count = tracer.count_crossings(&[Ray::new([-1.0, 0.5, z], [1.0, 0.0, 0.0])]).unwrap()[0];
            assert!(count == 0 || count == 2, "{count}");
        }
        let within = Ray::new([-1.0, 0.25, 0.5], [1.0, 0.0, 0.0]).between(0.0, 1.5);
        assert_eq!(tracer.count_crossings(&[within]).unwrap(), [1]);
    }
}

#[test]
fn points_are_inside_where_the_mesh_winds_around_them() {
    let (mut tested, mut inside) = (0, 0);
    for (name, closed) in meshes() {
        let mesh = closed.mesh();
        let (low, high) = mesh
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let mut random = Random::new(SEED);
        // As many straight behind a vertex, as the ray that is traced goes, as anywhere.
        let free: Vec<Vec3> = (0..600)
            .map(|i| {
                let anywhere = low + (high - low) * (random.vec3() * 0.55 + 0.5);
                let vertex = mesh.random_vertex(&mut random);
                if i % 2 == 0 { anywhere } else { Vec3::new(anywhere.x, vertex.y, vertex.z) }
            })
            .collect();
        let points: Vec<_> = free.iter().chain(&mesh.positions).map(|p| p.to_array()).collect();
        let windings: Vec<_> = free.iter().map(|point| winding(mesh, point.as_dvec3())).collect();
        for device in devices() {
            let found = tracer_on(&device, mesh).contains(&points).unwrap();
            for ((point, &is_inside), winding) in points.iter().zip(&found).zip(&windings) {
                let Some(winding) = *winding else { continue };
                assert_eq!(is_inside, winding % 2 != 0, "{name} on {device}: {point:?}");
                tested += 1;
                inside += usize::from(is_inside);
            }
            let used = |i: usize| mesh.triangles.iter().flatten().any(|&corner| corner as usize == i);
            let off = (0..mesh.positions.len()).filter(|&i| used(i)).find(|&i| !found[free.len() + i]);
            assert_eq!(off, None, "{name} on {device}: vertices are on the surface");
        }
    }
    assert!(tested > 5000 && (1000..tested - 1000).contains(&inside), "{tested} {inside}");
}

#[test]
fn the_surface_belongs_to_the_inside_and_the_next_float_does_not() {
    for device in devices() {
        let mut tracer = tracer_on(&device, &cube());
        let next = 1f32.next_up();
        let points = [[1.0, 0.5, 0.5], [0.5, 1.0, 0.25], [0.5, 0.5, 0.0], [1.0, 1.0, 0.5], [1.0; 3]];
        assert_eq!(tracer.contains(&points).unwrap(), [true; 5], "{device}");
        let points = [[next, 0.5, 0.5], [0.5, next, 0.25], [0.5, 0.5, -1e-45], [next, next, 0.5], [next; 3]];
        assert_eq!(tracer.contains(&points).unwrap(), [false; 5], "{device}");
        assert_eq!(tracer.contains(&[[f32::NAN, 0.5, 0.5], [f32::INFINITY; 3]]).unwrap(), [false; 2]);
    }
}

#[test]
fn what_cannot_be_told_is_refused() {
    let mut open = cube();
    open.triangles.pop();
    let error = tracer_on("reference", &open).contains(&[[0.5; 3]]).unwrap_err();
    assert!(matches!(error, Error::Scene(_)), "{error:?}");
    assert!(error.to_string().contains("3 of its edges"), "{error}");
    // It still crosses what it crosses.
    let ray = Ray::new([0.5, 0.25, 0.5], [1.0, 0.0, 0.0]);
    assert!(tracer_on("reference", &open).count_crossings(&[ray]).is_ok());

    let scene = Scene::from_mesh(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]).unwrap();
    let mut tracer = Tracer::builder(&scene).device("reference").method("bvh2+watertight").build().unwrap();
    let error = tracer.count_crossings(&[ray]).unwrap_err();
    assert!(error.to_string().contains("watertight") && error.to_string().contains("exact"), "{error}");
}

/// More points than a run of a processor has: the answers are those of few at a time, by one device and by several, and
/// progress goes one way.
#[test]
fn many_points_and_rays_have_the_answers_of_few() {
    let (_, closed) = meshes().into_iter().find(|(name, _)| *name == "hollow").unwrap();
    let mesh = closed.mesh();
    let (corners, mut random) = (mesh.corners(0), Random::new(SEED + 7));
    // A third of some are on the surface. They are at both ends and at the border of two runs; the others are outside.
    let point = |i: usize| if i.is_multiple_of(3) { corners[i % 9 / 3] } else { 1.2 * random.vec3() }.to_array();
    let some: Vec<[f32; 3]> = (0..3000).map(point).collect();
    let run = 1 << 18;
    let mut points = vec![[50.0, 0.0, 0.0]; run + 2 * some.len()];
    let places = [0, run - some.len() / 2, points.len() - some.len()].map(|at| at..at + some.len());
    places.iter().for_each(|place| points[place.clone()].copy_from_slice(&some));
    let rays_of = |points: &[[f32; 3]]| -> Vec<Ray> { points.iter().map(|&p| Ray::new(p, [0.3, -0.2, 1.0])).collect() };
    let mut few = tracer_on("reference", mesh);
    let inside = few.contains(&some).unwrap();
    let count_of_some = inside.iter().filter(|inside| **inside).count();
    assert!((1001..2900).contains(&count_of_some), "{count_of_some}");
    let crossings = few.count_crossings(&rays_of(&some)).unwrap();
    let several = device().map(|device| format!("{},reference", device.info.index));
    for device in devices().into_iter().skip(1).chain(several) {
        let told = Arc::new(Mutex::new(Vec::new()));
        let tell = {
            let told = told.clone();
            move |done: f64| told.lock().unwrap().push(done)
        };
        let mut tracer = Tracer::builder(&mesh.scene()).device(&device).progress(tell).build().unwrap();
        let assert_told = || {
            let told = std::mem::take(&mut *told.lock().unwrap());
            // Threads tell of what they have done side by side.
            let goes_one_way = told.windows(2).all(|two| two[1] > two[0] - 0.01);
            assert!(told.len() > 1 && goes_one_way, "{device}: {} times", told.len());
            assert_eq!(told.iter().copied().fold(0.0, f64::max), 1.0, "{device}");
        };
        let found = tracer.contains(&points).unwrap();
        assert_told();
        assert_eq!(found.iter().filter(|inside| **inside).count(), 3 * count_of_some, "{device}");
        let counted = tracer.count_crossings(&rays_of(&points)).unwrap();
        assert_told();
        assert_eq!(counted.iter().sum::<u32>(), 3 * crossings.iter().sum::<u32>(), "{device}");
        for place in &places {
            assert!(found[place.clone()] == inside && counted[place.clone()] == crossings, "{device}");
        }
        // Too few to be shared.
        let distances = tracer.distances(&some).unwrap();
        told.lock().unwrap().clear();
        let signed = tracer.signed_distances(&some).unwrap();
        assert_told();
        let is_right = |i: usize| signed[i] == if inside[i] { -distances[i] } else { distances[i] };
        assert!((0..some.len()).all(is_right), "{device}");
    }
}
