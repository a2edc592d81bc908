//! Every structure, build, traversal and triangle test, on the device and in the twin: the same hits bit for bit, and right
//! by the f64 oracle.

mod common;

use common::{Random, SEED, device, scene_of, sheet, soup};
use glam::Vec3;
use raybrook::layout::Float4;
use raybrook::options::{Accel, Build, Intersector, TraceOptions, Traversal};
use raybrook::pack::SceneBuffers;
use raybrook::reference::ReferenceTracer;
use raybrook::reference::oracle::Oracle;
use raybrook::scene::Scene;
use raybrook::session::open_tracer;
use raybrook::shared::{Hit, NO_PRIMITIVE, TraceRay};
use raybrook::tracer::{TraceJob, Tracer, is_hit};
use std::sync::Arc;

/// A ray in world units.
type Query = (Vec3, Vec3, f32, f32);

/// Every combination of parts that exists.
fn all_options() -> Vec<TraceOptions> {
    let mut all = Vec::new();
    for &intersector in Intersector::ALL {
        for &accel in Accel::ALL.iter().filter(|&&accel| accel != Accel::Kd) {
            all.push(TraceOptions { accel, intersector, ..TraceOptions::default() });
        }
        for &build in Build::ALL {
            for &traversal in Traversal::ALL {
                all.push(TraceOptions { accel: Accel::Kd, build, traversal, intersector, ..TraceOptions::default() });
            }
        }
    }
    all
}

/// Rays through a scene about the origin: from outside and inside, along axes and in planes of the scene, short ones, and some
/// that are nonsense.
fn queries(count: usize, random: &mut Random) -> Vec<Query> {
    (0..count)
        .map(|i| {
            let inf = f32::INFINITY;
            let from = 3.0 * random.vec3();
            match i % 10 {
                0..4 => (from, random.vec3() - from, 0.0, inf),
                4 => (random.vec3(), random.vec3(), 0.0, inf),
                5 => (Vec3::new(from.x / 3.0, from.y / 3.0, 3.0), Vec3::NEG_Z * (1.0 + random.unit()), 0.0, inf),
                // Through grid vertices of the sheet and along its cells' edges.
                6 => (Vec3::new((8.0 * random.signed()).round() / 8.0, -2.0, 0.1), Vec3::Y, 0.0, inf),
                7 => (from, (random.vec3() - from) * 1e-20, 0.0, inf),
                8 => (from, random.vec3() - from, 0.5 * random.unit(), 0.5 + random.unit()),
                _ => {
                    let mut ray = [from, random.vec3()];
                    ray[random.bits() as usize % 2][random.bits() as usize % 3] = random.any_float();
                    (ray[0], ray[1], 0.0, inf)
                }
            }
        })
        .collect()
}

fn pack(buffers: &SceneBuffers, queries: &[Query]) -> Vec<TraceRay> {
    queries.iter().map(|&(o, d, t_min, t_max)| buffers.trace_ray(o, d, t_min, t_max)).collect()
}

/// Bits of a hit; all misses are alike.
fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

fn assert_same(name: &str, queries: &[Query], got: &[Hit], expected: &[Hit]) {
    assert_eq!(got.len(), expected.len());
    let wrong: Vec<_> = (0..got.len()).filter(|&i| bits(&got[i]) != bits(&expected[i])).collect();
    if let Some(&i) = wrong.first() {
        panic!(
            "{name}: {} of {} hits differ (seed {SEED}); first: ray {i} {:?}: {:?} instead of {:?}",
            wrong.len(),
            got.len(),
            queries[i],
            got[i],
            expected[i]
        );
    }
}

fn scenes() -> Vec<(&'static str, Scene)> {
    let mut random = Random(SEED);
    vec![
        ("one triangle", scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]])),
        ("soup", scene_of(&soup(300, 0.3, &mut random))),
        ("small soup", scene_of(&soup(2000, 0.03, &mut random))),
        ("sheet", scene_of(&sheet(16))),
        ("flat", scene_of(&sheet(8).into_iter().map(|t| t.map(|p| p.with_z(0.25))).collect::<Vec<_>>())),
        ("duplicates", scene_of(&[sheet(6), sheet(6), sheet(6)].concat())),
    ]
}

#[test]
fn device_and_twin_agree_to_the_bit() {
    let Some(device) = device() else { return };
    for (name, scene) in scenes() {
        for options in all_options() {
            let name = format!("{name}, {options:?}");
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let mut random = Random(SEED);
            let queries = queries(3000, &mut random);
            let rays = pack(&buffers, &queries);
            let next: Vec<_> = rays.iter().map(|_| Float4::new(random.vec3(), 0.0)).collect();
            let job = TraceJob { rays: &rays, next_directions: Some(&next), any_hit: false, repeat: 1 };
            let mut twin = ReferenceTracer::new(buffers.clone(), options);
            let expected = twin.trace(&job, &|_| ()).unwrap();
            let mut tracer = open_tracer(Some(&device), &buffers, &options, 1, None).unwrap();
            let got = tracer.trace(&job, &|_| ()).unwrap();
            assert_same(&name, &queries, &got.hits, &expected.hits);
            assert_same(&format!("{name}, next"), &queries, &got.next_hits.unwrap(), &expected.next_hits.unwrap());
            assert_eq!(got.kernel_s.len(), 1);

            let any = tracer.trace(&TraceJob { any_hit: true, next_directions: None, ..job }, &|_| ()).unwrap();
            for (i, (any, closest)) in any.hits.iter().zip(&expected.hits).enumerate() {
                assert_eq!(is_hit(any), is_hit(closest), "{name}: any-hit of ray {i} {:?}", queries[i]);
            }
        }
    }
}

#[test]
fn every_structure_gives_the_hits_of_brute_force() {
    for (name, scene) in scenes() {
        for &intersector in Intersector::ALL {
            let mut expected: Option<Vec<Hit>> = None;
            for options in all_options().into_iter().filter(|o| o.intersector == intersector) {
                let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
                let queries = queries(20_000, &mut Random(SEED + 1));
                let rays = pack(&buffers, &queries);
                let job = TraceJob { rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
                let hits = ReferenceTracer::new(buffers, options).trace(&job, &|_| ()).unwrap().hits;
                match &expected {
                    None => expected = Some(hits), // the first one is brute force
                    Some(expected) => assert_same(&format!("{name}, {options:?}"), &queries, &hits, expected),
                }
            }
        }
    }
}

/// Wrong primitives against the oracle. Nothing here is so thin or so far away that float32 could mistake it.
#[test]
fn hits_are_those_of_the_oracle() {
    const RAYS: usize = 20_000;
    for (name, scene) in scenes() {
        let oracle = Oracle::new(&scene);
        let queries = queries(RAYS, &mut Random(SEED + 2));
        let truth: Vec<_> = queries.iter().map(|&(o, d, near, far)| oracle.closest_hit(o, d, near, far)).collect();
        for &intersector in Intersector::ALL {
            let options = TraceOptions { intersector, ..TraceOptions::default() };
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let rays = pack(&buffers, &queries);
            let job = TraceJob { rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
            let hits = ReferenceTracer::new(buffers.clone(), options).trace(&job, &|_| ()).unwrap().hits;
            let wrong = hits.iter().zip(&truth).filter(|(hit, truth)| {
                let hit = buffers.world_hit(**hit);
                match truth {
                    None => is_hit(&hit),
                    // Another triangle at the same distance (a shared edge, a duplicate) is as right.
                    Some(truth) => {
                        let close = (f64::from(hit.t) - truth.t).abs() <= 1e-4 * truth.t.abs();
                        !is_hit(&hit) || (hit.primitive != truth.primitive && !close)
                    }
                }
            });
            assert_eq!(wrong.count(), 0, "{name}, {intersector}: wrong of {RAYS} rays (seed {SEED})");
        }
    }
}

#[test]
fn a_power_of_two_changes_nothing_but_t() {
    let scene = scene_of(&soup(200, 0.3, &mut Random(SEED)));
    let queries = queries(5000, &mut Random(SEED + 3));
    let options = TraceOptions::default();
    let trace = |exponent: i32| {
        let factor = 2f32.powi(exponent);
        let mut scaled = scene.clone();
        scaled.positions.iter_mut().for_each(|p| *p *= factor);
        let buffers = Arc::new(SceneBuffers::new(&scaled, &options).unwrap());
        // Only rays whose origin survives the factor.
        let rays: Vec<_> = queries
            .iter()
            .filter(|q| q.0.abs().max_element() < 8.0 && q.0.abs().min_element() > 1e-3)
            .map(|&(o, d, near, far)| buffers.trace_ray(o * factor, d, near * factor, far * factor))
            .collect();
        let job = TraceJob { rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        ReferenceTracer::new(buffers, options).trace(&job, &|_| ()).unwrap().hits
    };
    let expected = trace(0);
    assert!(expected.iter().filter(|hit| is_hit(hit)).count() > 500);
    for exponent in [-100, -60, -10, 7, 40, 90] {
        assert_same(&format!("scale 2^{exponent}"), &queries, &trace(exponent), &expected);
    }
}

#[test]
fn nonsense_rays_miss() {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let down = (Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z, 0.0, inf);
    let nonsense = [
        (Vec3::new(nan, 0.2, 1.0), down.1, 0.0, inf),
        (Vec3::new(0.2, inf, 1.0), down.1, 0.0, inf),
        (down.0, Vec3::ZERO, 0.0, inf),
        (down.0, Vec3::new(0.0, nan, -1.0), 0.0, inf),
        (down.0, Vec3::new(0.0, 0.0, -inf), 0.0, inf),
        (down.0, down.1, nan, inf),
        (down.0, down.1, 0.0, nan),
        (down.0, down.1, 2.0, 1.0),
        (down.0, down.1, 1.5, inf),
        (down.0, down.1, 0.0, 0.5),
    ];
    for options in all_options() {
        let scene = scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]]);
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rays = pack(&buffers, &[&[down], &nonsense[..]].concat());
        for any_hit in [false, true] {
            let job = TraceJob { rays: &rays, next_directions: None, any_hit, repeat: 1 };
            let hits = ReferenceTracer::new(buffers.clone(), options).trace(&job, &|_| ()).unwrap().hits;
            assert_eq!(buffers.world_hit(hits[0]).t, 1.0, "{options:?}");
            for (hit, ray) in hits[1..].iter().zip(&nonsense) {
                assert_eq!((hit.primitive, hit.t), (NO_PRIMITIVE, inf), "{options:?}: {ray:?}");
            }
        }
    }
}
