//! Hard rays: the exact tracer by hand, the judge, the kinds, and that methods fail exactly where they should.

use crate::common::device;
use glam::{DVec3, Vec3};
use raybrook::low_level::options::{Build, Intersector, KdOptions, Structure, StructureKind, TraceOptions, Traversal};
use raybrook::low_level::random::Random;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE};
use raybrook_lab::stress::{
    Answers, Case, Closest, ExactTracer, Fault, Found, Interval, Kind, Mesh, Method, Replay, StressRay,
};

/// A kind's case of these tests.
const SEED: u64 = 3;
const RAYS: usize = 200;

const EVERYWHERE: Interval = Interval { near: 0.0, far: f32::INFINITY, is_open: false };
const EXACT: TraceOptions = TraceOptions { intersector: Intersector::Exact, ..TraceOptions::DEFAULT };

// ---- the exact tracer
// ------------------------------------------------------------------------------------------------

fn closest(mesh: &Mesh, origin: Vec3, direction: Vec3, interval: Interval) -> Option<Closest> {
    let tracer = ExactTracer::new(mesh);
    let line = tracer.line(origin.as_dvec3(), direction.as_dvec3())?;
    tracer.closest(&line, interval, &[], |_| true)
}

/// A square of two triangles in the plane z = 0 from -1 to 1, divided along x = y.
fn square() -> Mesh {
    let mut mesh = Mesh::default();
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    mesh.quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    mesh
}

#[test]
fn exact_hits_by_hand() {
    let down = -3.0 * Vec3::Z;
    let hit = |x: f32, y: f32| closest(&square(), Vec3::new(x, y, 1.0), down, EVERYWHERE);
    let found = hit(0.5, -0.25).unwrap();
    assert_eq!(found.primitives, [0]);
    // A third is no float; the weights of vertex 1 and 2 at (x, y) are (x - y) / 2 and (y + 1) / 2.
    assert_eq!((found.crossing.t.to_f32(), found.crossing.t.to_f64()), (1.0 / 3.0, 1.0 / 3.0));
    assert_eq!((found.crossing.u.to_f64(), found.crossing.v.to_f64()), (0.375, 0.375));
    assert_eq!(hit(0.5, 0.5).unwrap().primitives, [0, 1], "on the diagonal");
    assert_eq!(hit(0.5, 0.5f32.next_up()).unwrap().primitives, [1], "a float beside it");
    assert_eq!(hit(-1.0, -1.0).unwrap().primitives, [0, 1], "at a corner of both");
    assert_eq!(hit(1.0, 0.3).unwrap().primitives, [0], "on the border");
    assert!(hit(1.0f32.next_up(), 0.3).is_none(), "a float outside");
}

#[test]
fn limits_are_exact() {
    // t is exactly 1/3, which lies between two floats.
    let third = 1.0f32 / 3.0;
    let (below, above) =
        if f64::from(third) < 1.0 / 3.0 { (third, third.next_up()) } else { (third.next_down(), third) };
    let is_hit = |near: f32, far: f32| {
        let interval = Interval { near, far, is_open: false };
        closest(&square(), Vec3::new(0.5, 0.0, 1.0), -3.0 * Vec3::Z, interval).is_some()
    };
    for (near, far, expected) in [
        (below, above, true),
        (0.0, below, false),
        (above, f32::INFINITY, false),
        (f32::NEG_INFINITY, above, true),
        (1.0, 0.0, false),
        (f32::NAN, 1.0, false),
        (0.0, f32::NAN, false),
    ] {
        assert_eq!(is_hit(near, far), expected, "{near} to {far}");
    }
    let at = |is_open: bool| closest(&square(), Vec3::ZERO, Vec3::Z, Interval { is_open, ..EVERYWHERE });
    assert!(at(false).is_some() && at(true).is_none(), "at t = 0");
}

#[test]
fn what_is_no_ray_or_no_triangle_is_not_hit() {
    let mut mesh = Mesh::default();
    mesh.triangle([Vec3::new(-1.0, -1.0, 0.5), Vec3::new(1.0, -1.0, 0.5), Vec3::new(0.0, f32::NAN, 0.5)]);
    mesh.triangle([Vec3::splat(-0.5), Vec3::ZERO, Vec3::splat(0.5)]);
    mesh.append(&square());
    let hit = |origin: Vec3, direction: Vec3| closest(&mesh, origin, direction, EVERYWHERE).map(|hit| hit.primitives);
    assert_eq!(hit(Vec3::new(0.25, 0.0, 1.0), -Vec3::Z), Some(vec![2]), "behind a NaN and a line");
    assert_eq!(hit(Vec3::new(-2.0, 0.0, 0.0), Vec3::X), None, "in the plane");
    assert_eq!(hit(Vec3::new(-2.0, 0.0, f32::from_bits(1)), Vec3::X), None, "parallel");
    assert_eq!(hit(Vec3::Z, Vec3::ZERO), None);
    assert_eq!(hit(Vec3::Z, Vec3::new(0.0, f32::NAN, -1.0)), None);
    assert_eq!(hit(Vec3::new(0.0, f32::INFINITY, 1.0), -Vec3::Z), None);
}

#[test]
fn second_lines_start_at_the_hit() {
    let mut mesh = square();
    mesh.append(&square().mapped(|p| p + Vec3::Z));
    let tracer = ExactTracer::new(&mesh);
    // The hit at x = 1/3 is no float, and the start only as near as weights can be; back from there to x = 1/3 + 1/5 on
    // the other square, and straight to the edge at x = 1.
    let line = tracer.line(DVec3::new(0.0, 0.125, 1.0), DVec3::new(1.0, 0.0, -3.0)).unwrap();
    let first = tracer.closest(&line, Interval { near: 0.25, ..EVERYWHERE }, &[], |_| true).unwrap();
    let next = |direction: Vec3| {
        let line = tracer.line_from(&first.crossing, direction).unwrap();
        let ahead = Interval { is_open: true, ..EVERYWHERE };
        tracer.closest(&line, ahead, &first.primitives, |_| true).map(|hit| hit.crossing)
    };
    let back = next(Vec3::new(1.0, 0.0, 5.0)).unwrap();
    assert_eq!((back.primitive, back.t.to_f64()), (2, 0.2));
    // u = (x - y) / 2 on the second square's first triangle.
    let off = (back.u.to_f64() - (1.0 / 3.0 + 0.2 - 0.125) / 2.0).abs();
    assert!(off > 0.0 && off < f64::from(f32::EPSILON), "{off:e}");
    assert!(next(Vec3::X).is_none(), "within the own plane");
    assert!(next(-Vec3::Z).is_none(), "the own triangle");
}

#[test]
fn the_filter_loses_no_hit() {
    for kind in Kind::all() {
        let case = kind.case(SEED, 20);
        let tracer = ExactTracer::new(&case.mesh);
        for ray in &case.rays {
            let Some(line) = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()) else { continue };
            let interval = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
            let all = (0..case.mesh.triangles.len() as u32).filter_map(|i| tracer.crossing(&line, i));
            let nearest = all.filter(|crossing| interval.contains(&crossing.t)).min_by(|a, b| a.t.cmp(&b.t));
            let found = tracer.closest(&line, interval, &[], |_| true);
            assert_eq!(
                found.map(|hit| hit.crossing.primitive),
                nearest.map(|hit| hit.primitive),
                "{} {ray:?}",
                kind.name
            );
        }
    }
}

// ---- the judge
// -------------------------------------------------------------------------------------------------------

const MISS: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };

#[test]
fn exact_answers_are_right_and_others_are_not() {
    let (mut judged, mut hits) = (0, 0);
    for (kind, case) in Kind::all().flat_map(|kind| kind.cases(SEED, RAYS).map(move |case| (kind, case))) {
        let answers = Answers::new(&case);
        for i in 0..case.rays.len() {
            let (hit, next) = answers.rounded(i);
            for strictly in [true, false] {
                assert_eq!(answers.judge(i, &hit, next.as_ref(), strictly), None, "{} ray {i}: {hit:?}", kind.name);
            }
            judged += 1;
            let is_wrong = |hit: Hit, fault: Fault| {
                assert_eq!(answers.judge(i, &hit, next.as_ref(), true), Some(fault), "{} ray {i}: {hit:?}", kind.name);
            };
            if hit.primitive == NO_PRIMITIVE {
                is_wrong(Hit { primitive: 0, t: 1.0, ..hit }, Fault::False);
                continue;
            }
            hits += 1;
            is_wrong(MISS, Fault::Miss);
            if case.any_hit {
                continue; // of which only the triangle is told
            }
            is_wrong(Hit { primitive: hit.primitive + 1, ..hit }, Fault::Primitive);
            is_wrong(Hit { t: hit.t.next_up(), ..hit }, Fault::T);
            is_wrong(Hit { t: f32::NAN, ..hit }, Fault::T);
            is_wrong(Hit { u: f32::from_bits(hit.u.to_bits() + 3), ..hit }, Fault::Weights);
        }
    }
    assert!(hits > judged / 2, "only {hits} of {judged} rays hit anything");
}

#[test]
fn a_t_that_no_float_tells_is_no_hit_within_any_limits() {
    // At t = 2^128 - 2^103 and just before it, of which the first one rounds to infinity; and behind as far.
    let length = 2f32.powi(-61);
    let mesh = square().mapped(|p| (p - Vec3::Z) * 2f32.powi(67));
    let above = |z: f32| Vec3::new(0.5, 0.25, z * 2f32.powi(42));
    for (z, near, far, expected) in [
        (-1.0, 0.0, f32::INFINITY, false),
        (-1.5, 0.0, f32::INFINITY, true),
        (-1.5, 0.0, f32::MAX, false),
        (-2.0, 0.0, f32::MAX, true),
    ] {
        let interval = Interval { near, far, is_open: false };
        let hit = closest(&mesh, above(z), -Vec3::Z * length, interval);
        assert_eq!(hit.map(|hit| hit.crossing.t.to_f32()), expected.then_some(f32::MAX), "{z} {near} {far}");
        let back = Interval { near: -far, far: -near, is_open: false };
        let hit = closest(&mesh, above(z), Vec3::Z * length, back);
        assert_eq!(hit.map(|hit| hit.crossing.t.to_f32()), expected.then_some(f32::MIN), "{z} behind");
    }
}

#[test]
fn any_hits_are_judged_by_their_triangles() {
    // Three squares: at t = 1, at t = 2, and beyond the limit at t = 4.
    let mut mesh = Mesh::default();
    for z in [1.0, 2.0, 4.0] {
        mesh.append(&square().mapped(|p| p + z * Vec3::Z));
    }
    let ray = StressRay::new(Vec3::new(0.5, 0.0, 0.0), Vec3::Z).within(0.0, 3.0);
    let missing = StressRay::new(Vec3::new(0.5, 0.0, 0.0), -Vec3::Z);
    let case = Case { mesh, rays: vec![ray, missing], any_hit: true };
    let answers = Answers::new(&case);
    let found = |primitive: u32| Hit { t: 0.0, u: 0.0, v: 0.0, primitive };
    for strictly in [true, false] {
        let judge = |ray: usize, hit: Hit| answers.judge(ray, &hit, None, strictly);
        let (hit, other) = (answers.rounded(0).0.primitive, answers.rounded(0).0.primitive ^ 1);
        assert_eq!([judge(0, found(hit)), judge(0, found(hit + 2))], [None; 2]);
        assert_eq!(judge(0, found(other)), Some(Fault::Primitive), "the square's other half");
        assert_eq!(judge(0, found(hit + 4)), Some(Fault::Primitive), "beyond the limit");
        assert_eq!((judge(0, MISS), judge(1, MISS)), (Some(Fault::Miss), None));
        assert_eq!(judge(1, found(0)), Some(Fault::False));
    }
}

#[test]
fn second_rays_are_judged_by_what_they_left() {
    // Two squares, 1 apart; the first ray goes down on the lower one's diagonal, the second one back up.
    let mut mesh = square();
    mesh.append(&square().mapped(|p| p + Vec3::Z));
    let rays = [Vec3::Z, -Vec3::Z].map(|next| StressRay::new(Vec3::new(0.25, 0.25, 0.5), -Vec3::Z).then(next));
    let case = Case { mesh, rays: rays.to_vec(), any_hit: false };
    let answers = Answers::new(&case);
    let hit = |primitive: u32, t: f32| Hit { t, u: 0.0, v: 0.625, primitive };
    for strictly in [true, false] {
        let judge = |ray: usize, next: Hit| answers.judge(ray, &hit(0, 0.5), Some(&next), strictly);
        assert_eq!(judge(0, hit(2, 1.0)), None);
        assert_eq!(judge(0, MISS), Some(Fault::Leak));
        assert_eq!(judge(0, hit(0, 0.0)), Some(Fault::SelfHit));
        assert_eq!(judge(0, hit(1, 0.0)), Some(Fault::SelfHit), "the neighbour that was hit at the same point");
        assert_eq!(judge(0, hit(2, 1.01)), Some(Fault::T));
        assert_eq!(judge(1, MISS), None);
        assert_eq!(judge(1, hit(2, 1.0)), Some(Fault::False));
        assert_eq!(answers.judge(0, &MISS, Some(&MISS), strictly), Some(Fault::Miss), "the first one is judged first");
    }
    assert_eq!(answers.judge(0, &hit(0, 0.5), Some(&hit(3, 1.0)), true), Some(Fault::Primitive), "lowest number");
    assert_eq!(answers.judge(0, &hit(0, 0.5), Some(&hit(3, 1.0)), false), None, "any of those as near");
}

#[test]
fn tolerance_does_not_let_rays_slip_through() {
    // A closed box seen from inside: along its edges a neighbour may be told, but neither a miss nor what lies behind.
    let mut mesh = Mesh::cube(Vec3::splat(-1.0), Vec3::splat(1.0));
    let far_wall = mesh.triangles.len() as u32;
    mesh.append(&Mesh::cube(Vec3::splat(-2.0), Vec3::splat(2.0)));
    let mut random = Random::new(SEED);
    let case = Case::new(mesh, 200, &mut random, |_, random, _| {
        // Origins of all digits, so that hardly any ray meets the edge exactly.
        StressRay::to(random.vec3() / 3.0, Vec3::new(1.0, random.signed(), random.sign()))
    });
    let answers = Answers::new(&case);
    for i in 0..case.rays.len() {
        let (hit, _) = answers.rounded(i);
        assert!(hit.primitive < far_wall);
        assert_eq!(answers.judge(i, &MISS, None, false), Some(Fault::Miss));
        let behind = (far_wall..far_wall + 12).filter_map(|primitive| {
            let beyond = Hit { primitive, t: 2.0 * hit.t, ..hit };
            answers.judge(i, &beyond, None, false)
        });
        assert_eq!(behind.count(), 12, "ray {i} slips through");
        // Weights are those of the right triangle here, and are judged where the ray meets the edge exactly.
        let is_near = |p: u32| {
            let fault = answers.judge(i, &Hit { primitive: p, ..hit }, None, false);
            p != hit.primitive && matches!(fault, None | Some(Fault::Weights))
        };
        assert!((0..far_wall).any(is_near), "ray {i} has no neighbour");
    }
}

// ---- kinds
// -----------------------------------------------------------------------------------------------------------

/// A number for all bits of a case.
fn fingerprint(case: &Case) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    let mut add = |bits: u32| hasher.update(&bits.to_le_bytes());
    case.mesh.positions.iter().flat_map(|p| p.to_array()).for_each(|x| add(x.to_bits()));
    case.mesh.triangles.iter().flatten().for_each(|&i| add(i));
    for ray in &case.rays {
        let next = ray.next.unwrap_or(Vec3::ZERO);
        [ray.origin, ray.direction, next].iter().flat_map(|v| v.to_array()).for_each(|x| add(x.to_bits()));
        [ray.t_min, ray.t_max].iter().for_each(|x| add(x.to_bits()));
    }
    hasher.finalize()
}

#[test]
fn a_seed_makes_the_same_rays_everywhere() {
    // Of all kinds, on x86-64. Changes only when a kind does: the rays that users have seen go wrong are others then.
    const ALL: u32 = 2_673_531_513;
    const STACKS: u32 = 1_862_256_288;
    assert_eq!(fingerprint_of(Kind::all()), (84, ALL));
    assert_eq!(fingerprint_of(Kind::stacks()), (7, STACKS));
    assert!(Kind::find("edgse").err().unwrap().to_string().contains("nearest: edges"));
}

/// How many kinds there are, no name twice, and a number for the cases of all.
fn fingerprint_of(kinds: impl Iterator<Item = &'static Kind>) -> (usize, u32) {
    let mut hasher = crc32fast::Hasher::new();
    let mut names = Vec::new();
    for kind in kinds {
        let made = fingerprint(&kind.case(SEED, RAYS));
        assert_eq!(made, fingerprint(&kind.case(SEED, RAYS)), "{}", kind.name);
        assert_ne!(made, fingerprint(&kind.case(SEED + 1, RAYS)), "{}", kind.name);
        for rays in [7, 1007] {
            assert_eq!(kind.cases(SEED, rays).map(|case| case.rays.len()).sum::<usize>(), rays, "{}", kind.name);
        }
        hasher.update(&made.to_le_bytes());
        names.push(kind.name);
    }
    names.sort_unstable();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count);
    (count, hasher.finalize())
}

// ---- methods
// ---------------------------------------------------------------------------------------------------------

#[test]
fn exact_is_right_in_every_kind_and_structure() {
    let structures = [
        EXACT,
        TraceOptions { structure: Structure::of(StructureKind::Brute), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Bvh2), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Bvh8), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Grid), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Octree), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Boxes), ..EXACT },
        TraceOptions { structure: Structure::of(StructureKind::Spheres), ..EXACT },
        TraceOptions {
            structure: Structure::Kd(KdOptions { build: Build::Median, traversal: Traversal::Restart, ..EXACT.kd() }),
            ..EXACT
        },
        TraceOptions {
            structure: Structure::Kd(KdOptions { traversal: Traversal::ShortStack, stack_size: Some(2), ..EXACT.kd() }),
            ..EXACT
        },
        TraceOptions { structure: Structure::Kd(KdOptions { traversal: Traversal::Ropes, ..EXACT.kd() }), ..EXACT },
    ];
    for (kind, case) in Kind::all().flat_map(|kind| kind.cases(SEED, RAYS).map(move |case| (kind, case))) {
        let answers = Answers::new(&case);
        for options in structures {
            let faults = Found::new(&case, &options, None, None).unwrap().faults(&answers, true);
            assert_eq!(faults, [], "{} (seed {SEED}): {} {}", kind.name, options.kind(), options.kd().traversal);
        }
    }
}

#[test]
fn exact_is_right_on_the_device() {
    let Some(device) = device() else { return };
    // One scene of each: a device takes a tenth of a second to get ready for another one.
    for kind in Kind::all() {
        let case = kind.case(SEED, RAYS);
        let found = Found::new(&case, &EXACT, Some(&device), None).unwrap();
        assert_eq!(found.faults(&Answers::new(&case), true), [], "{} (seed {SEED})", kind.name);
    }
}

#[test]
fn methods_fail_in_the_kinds_that_are_made_for_them() {
    use Fault::{Leak, Miss, Primitive, SelfHit, T, Weights};
    let cases: &[(&str, &str, Fault)] = &[
        ("moller-trumbore", "edges", Miss),
        ("moller-trumbore", "vertices", Miss),
        ("moller-trumbore", "needle-fans", Primitive),
        ("moller-trumbore", "needles", T),
        ("moller-trumbore", "slivers", T),
        ("moller-trumbore", "spawn-corners", Miss),
        ("plucker", "needles", Weights),
        ("precomputed", "edges", Miss),
        ("precomputed", "coplanar", Primitive),
        ("watertight", "coplanar", Primitive),
        ("watertight", "spawn-flat", SelfHit),
        ("thesis", "back-faces", Miss),
        ("thesis", "scale-1e-6", Miss),
        ("thesis", "sizes", Miss),
        ("thesis", "layers", Primitive),
        ("thesis", "on-surface", Miss),
        ("thesis", "spawn-sphere", Leak),
        ("thesis-restart", "inside", Miss),
        ("thesis-restart", "in-planes", Miss),
        ("thesis-restart", "axis", Miss),
        ("thesis-restart", "outside-cells", Primitive),
        ("thesis-restart", "spawn-glass", Leak),
    ];
    for &(method, kind, fault) in cases {
        let case = Kind::find(kind).unwrap().case(SEED, RAYS);
        let method = Method::parse(method, TraceOptions::DEFAULT).unwrap();
        let faults = Found::new(&case, &method.options, None, None).unwrap().faults(&Answers::new(&case), false);
        assert!(faults.iter().any(|&(_, found)| found == fault), "{} {kind}: {faults:?}", method.name);
    }
}

#[test]
fn a_replay_is_wrong_again() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, method) in [("edges", "moller-trumbore"), ("bad-vertices", "thesis-restart"), ("spawn-glass", "thesis")]
    {
        let case = Kind::find(kind).unwrap().case(SEED, RAYS);
        let options = Method::parse(method, TraceOptions::DEFAULT).unwrap().options;
        let faults = Found::new(&case, &options, None, None).unwrap().faults(&Answers::new(&case), false);
        assert!(!faults.is_empty(), "{kind}");
        let numbers: Vec<usize> = faults.iter().map(|&(i, _)| i).collect();
        let replay = Replay::in_folder(folder.path(), kind, method);
        replay.write(&case, &numbers).unwrap();
        let again = replay.read().unwrap();
        assert_eq!(again.rays, numbers.iter().map(|&i| case.rays[i]).collect::<Vec<_>>());
        let faults_again = Found::new(&again, &options, None, None).unwrap().faults(&Answers::new(&again), false);
        let sorts = |faults: &[(usize, Fault)]| faults.iter().map(|&(_, fault)| fault).collect::<Vec<_>>();
        assert_eq!(sorts(&faults_again), sorts(&faults), "{kind}");
    }
}
