//! Rays at edges and vertices of closed meshes: that they must hit, that exact methods hit, and that others are found
//! out.

use crate::common::{SEED, device, shared};
use glam::Vec3;
use raybrook::low_level::options::{
    Build, BvhOptions, Intersector, KdOptions, SpatialSplits, Structure, StructureKind, TraceOptions, Traversal,
};
use raybrook::low_level::reference::shade::normal::triangle_normal;
use raybrook::low_level::scene::{Builder, Material, load};
use raybrook_lab::stress::closed::{ClosedMesh, Leaks, MAX_SUSPECTS, NotClosed, find_leaks};
use raybrook_lab::stress::{Answers, Case, ExactTracer, Found, Interval, Mesh, Replay, StressRay};

/// Closed meshes of several shapes: smooth, with sharp edges in the axes' planes, with a hole, with slivers and a
/// vertex of 64 triangles, of four triangles, far from the origin, and of two surfaces.
pub fn meshes() -> Vec<(&'static str, ClosedMesh)> {
    let mut torus = Builder::new();
    torus.material(Material::matt(Vec3::ONE)).torus(1.0, 0.4, 24, 12);
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let mut tetrahedron = Mesh::default();
    for p in [corner(0.0, 0.0, 0.1), corner(1.0, 0.2, 0.0), corner(0.1, 1.0, 0.3), corner(0.3, 0.2, 1.0)] {
        tetrahedron.vertex(p);
    }
    tetrahedron.triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let mut hollow = Mesh::sphere(2);
    hollow.append(&Mesh::cubes(1).mapped(|p| (p - 0.5) * 0.5));
    let meshes = [
        ("sphere", Mesh::sphere(3)),
        ("cubes", Mesh::cubes(2)),
        ("torus", Mesh::try_from(&torus.finish().unwrap()).unwrap()),
        ("double fan", Mesh::double_fan(6, 0.01)),
        ("tetrahedron", tetrahedron),
        ("offset", Mesh::sphere(2).mapped(|p| p + 1000.0)),
        ("hollow", hollow),
        ("thin", thin()),
    ];
    meshes.map(|(name, mesh)| (name, ClosedMesh::new(mesh).unwrap())).into()
}

/// What a CAD program makes of the cosine of 90 degrees.
const NOISE: f32 = 6.123234e-17;

/// A pyramid upside down whose base has a corner that is off by noise; the first triangle closes the gap, which is
/// narrower than any coordinate's last bit.
pub fn thin() -> Mesh {
    let corners =
        [[NOISE, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 8.0, 0.0], [0.0, 8.0, 0.0], [4.0, 4.0, 0.0], [4.0, 4.0, -4.0]];
    let triangles = [[0, 2, 4], [0, 1, 2], [4, 2, 3], [0, 4, 3], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]];
    Mesh { positions: corners.map(Vec3::from_array).into(), triangles: triangles.into() }
}

const EXACT: TraceOptions = TraceOptions { intersector: Intersector::Exact, ..TraceOptions::DEFAULT };

fn on_reference(mesh: &ClosedMesh, options: &TraceOptions, rays: u64) -> Leaks {
    find_leaks(mesh, options, None, None, SEED, rays, &|_| Ok(())).unwrap()
}

/// Every structure, and every build and traversal of a kd-tree that finds every hit.
pub fn structures() -> Vec<TraceOptions> {
    let accels = StructureKind::ALL.iter().map(|&accel| TraceOptions { structure: Structure::of(accel), ..EXACT });
    let builds = Build::ALL
        .iter()
        .map(|&build| TraceOptions { structure: Structure::Kd(KdOptions { build, ..EXACT.kd() }), ..EXACT });
    let traversals = Traversal::ALL.iter().filter(|traversal| traversal.is_exact());
    let traversals = traversals
        .map(|&traversal| TraceOptions { structure: Structure::Kd(KdOptions { traversal, ..EXACT.kd() }), ..EXACT });
    // Triangles in several leaves.
    let split = |splits| BvhOptions { spatial_splits: Some(splits), ..BvhOptions::DEFAULT };
    let [always, auto] = [SpatialSplits::Share(1.0), SpatialSplits::Auto].map(split);
    let split = [Structure::Bvh2(always), Structure::Bvh8(always), Structure::Bvh2(auto)];
    let split = split.map(|structure| TraceOptions { structure, ..EXACT });
    accels.chain(builds).chain(traversals).chain(split).collect()
}

#[test]
fn promises_are_true() {
    for (name, closed) in meshes() {
        let tracer = ExactTracer::new(closed.mesh());
        let mut by_a_finite_t = 0;
        const RAYS: u64 = 3000;
        for index in 0..RAYS {
            let ray = closed.ray(SEED, index);
            let line = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()).unwrap();
            let everywhere = Interval { near: 0.0, far: f32::INFINITY, is_open: false };
            let hit = tracer.closest(&line, everywhere, &[], |_| true);
            let hit = hit.unwrap_or_else(|| panic!("{name}: ray {index} of seed {SEED} may miss: {ray:?}"));
            let t = hit.crossing.t.to_f64();
            assert!(t <= ray.by, "{name}: ray {index} of seed {SEED} hits at {t}, {ray:?}");
            by_a_finite_t += u64::from(ray.by.is_finite());
            assert_eq!(ray, closed.ray(SEED, index));
        }
        assert!(by_a_finite_t > RAYS * 3 / 4, "{name}: {by_a_finite_t}");
    }
}

#[test]
fn rays_come_from_everywhere_and_meet_what_they_are_aimed_at() {
    let closed = ClosedMesh::new(Mesh::sphere(3)).unwrap();
    let rays: Vec<_> = (0..20_000).map(|index| closed.ray(SEED, index)).collect();
    let share = |count: usize| count as f64 / rays.len() as f64;
    let of = |is_so: &dyn Fn(f32) -> bool| share(rays.iter().filter(|ray| is_so(ray.origin.length())).count());
    assert!(of(&|r| r > 1e4) > 0.1 && of(&|r| r > 1e5) > 0.01, "far away");
    assert!(of(&|r| (1.0..1.01).contains(&r)) > 0.01, "close to the surface");
    let inside = share(rays.iter().filter(|ray| ray.is_inside).count());
    let at_vertices = share(rays.iter().filter(|ray| ray.is_at_vertex).count());
    assert!((0.1..0.6).contains(&inside) && (0.1..0.6).contains(&at_vertices), "{inside} {at_vertices}");
    assert!(rays.iter().all(|ray| !ray.is_inside || ray.origin.length() < 1.0));

    // Rays that meet several triangles at exactly the same t go through an edge or a vertex to the last bit.
    let tracer = ExactTracer::new(closed.mesh());
    let meets_a_seam = |ray: &&raybrook_lab::stress::closed::AimedRay| {
        let line = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()).unwrap();
        let hits = (0..closed.mesh().triangles.len() as u32).filter_map(|i| tracer.crossing(&line, i));
        let times: Vec<_> = hits.map(|hit| hit.t).collect();
        times.iter().enumerate().any(|(i, t)| times[..i].contains(t))
    };
    let on_seams = rays[..1000].iter().filter(meets_a_seam).count();
    assert!(on_seams > 50, "{on_seams} of 1000");
}

#[test]
fn exact_lets_no_ray_through() {
    for (name, closed) in meshes() {
        for options in structures() {
            let leaks = on_reference(&closed, &options, 2000);
            assert_eq!((leaks.rays, leaks.misses, leaks.behind, leaks.cleared), (2000, 0, 0, 0), "{name} {options:?}");
        }
    }
}

#[test]
fn exact_lets_no_ray_through_on_a_device() {
    let Some(device) = device() else { return };
    for (name, closed) in meshes().into_iter().take(4) {
        for traversal in [Traversal::Stack, Traversal::Ropes] {
            let options = TraceOptions { structure: Structure::Kd(KdOptions { traversal, ..EXACT.kd() }), ..EXACT };
            let leaks = find_leaks(&closed, &options, Some(&device), None, SEED, 20_000, &|_| Ok(())).unwrap();
            assert_eq!(
                (leaks.rays, leaks.misses, leaks.behind, leaks.cleared),
                (20_000, 0, 0, 0),
                "{name} {options:?}"
            );
            // The rays are as hard as they should be: some pass so exactly through an edge that only exact integers
            // tell.
            assert!(leaks.second_pass.unwrap() > 0, "{name}: {:?}", leaks.second_pass);
        }
    }
}

/// Triangles of areas down to 2^-120 above a floor, and rays that hit them within and on their edges, some at sums that
/// no float holds.
fn thin_triangles() -> Case {
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let mut mesh = Mesh::default();
    mesh.quad([at(-9.0, -9.0, -1.0), at(9.0, -9.0, -1.0), at(9.0, 9.0, -1.0), at(-9.0, 9.0, -1.0)]);
    mesh.triangle([at(4.0, 4.0, 0.0), at(NOISE, 0.0, 0.0), at(8.0, 8.0, 0.0)]);
    let heights = [2f32.powi(-54), 2f32.powi(-90), 2f32.powi(-120)];
    for (z, &height) in (1..).zip(&heights) {
        mesh.triangle([at(1.0, 1.0, z as f32), at(0.0, height, z as f32), at(-1.0, -1.0, z as f32)]);
    }
    let mut rays = vec![StressRay::new(at(6.0, 6.0, 1.0), -Vec3::Z), StressRay::new(at(5.0, 5.0, -0.5), Vec3::Z)];
    for part in [0.25, 0.5, 1.0, 2.0] {
        rays.push(StressRay::new(at(NOISE * part / 4.0, 0.0, 0.5), at(4.0, 4.0, -0.5)));
        for (z, &height) in (1..).zip(&heights) {
            rays.push(StressRay::new(at(0.0, height * part, z as f32 + 0.5), -Vec3::Z));
            rays.push(StressRay::new(at(0.0, height * part, z as f32 - 0.5), Vec3::Z * 3.0));
            rays.push(StressRay::new(at(0.0, height * part, z as f32 + 0.5), at(0.25, 0.25, -0.5)));
        }
    }
    Case { mesh, rays, any_hit: false }
}

#[test]
fn triangles_as_thin_as_a_line_are_hit() {
    let case = thin_triangles();
    let answers = Answers::new(&case);
    let (hit, _) = answers.rounded(0);
    assert_eq!((hit.primitive, hit.t), (2, 1.0), "an edge of the first one");
    let hits = (0..case.rays.len()).filter(|&i| answers.rounded(i).0.primitive >= 2).count();
    assert!(hits > 20, "{hits} of {}", case.rays.len());
    assert_eq!(case.mesh.scene().hittable().len(), 6);
    for options in structures() {
        let found = Found::new(&case, &options, None, None).unwrap();
        assert_eq!(found.faults(&answers, true), [], "{options:?}");
    }
    if let Some(device) = device() {
        for accel in [StructureKind::Kd, StructureKind::Bvh2, StructureKind::Bvh8] {
            let found =
                Found::new(&case, &TraceOptions { structure: Structure::of(accel), ..EXACT }, Some(&device), None)
                    .unwrap();
            assert_eq!(found.faults(&answers, true), [], "on the device: {accel}");
        }
    }
    for i in 2..6 {
        let normal = triangle_normal(case.mesh.corners(i));
        assert!((normal.length() - 1.0).abs() < 1e-6, "triangle {i}: {normal}");
    }
}

#[test]
fn leaks_are_found() {
    let sphere = ClosedMesh::new(Mesh::sphere(3)).unwrap();
    let with = |intersector| TraceOptions { intersector, ..TraceOptions::DEFAULT };

    let leaks = on_reference(&sphere, &with(Intersector::MollerTrumbore), 50_000);
    assert!(leaks.misses > 0 && leaks.behind > 0, "from inside and from outside: {leaks:?}");
    let leaks = on_reference(&sphere, &with(Intersector::Watertight), 50_000);
    assert_eq!((leaks.rays, leaks.misses, leaks.behind), (50_000, 0, 0));
    let lossy = TraceOptions {
        structure: Structure::Kd(KdOptions { traversal: Traversal::ThesisRestart, ..EXACT.kd() }),
        ..EXACT
    };
    assert!(on_reference(&sphere, &lossy, 5000).misses > 0);

    // It hits no back faces: half of all rays, more than anybody wants to know of.
    let leaks = on_reference(&sphere, &with(Intersector::Thesis), 50_000);
    assert!(leaks.is_cut_short && leaks.rays < 50_000);
    assert_eq!(leaks.wrong.len() as u64, leaks.misses + leaks.behind);
    assert_eq!(leaks.wrong.len() + leaks.cleared as usize, MAX_SUSPECTS);
}

#[test]
fn a_ray_that_slipped_through_does_so_again() {
    let sphere = ClosedMesh::new(Mesh::sphere(3)).unwrap();
    let options = TraceOptions { intersector: Intersector::MollerTrumbore, ..TraceOptions::DEFAULT };
    let leaks = on_reference(&sphere, &options, 50_000);
    let rays = leaks.wrong.iter().map(|&(ray, _)| ray).collect();
    let case = Case { mesh: sphere.mesh().clone(), rays, any_hit: false };
    let numbers: Vec<usize> = (0..case.rays.len()).collect();
    let folder = tempfile::tempdir().unwrap();
    let replay = Replay::in_folder(folder.path(), "sphere", "rays");
    replay.write(&case, &numbers).unwrap();
    let again = replay.read().unwrap();
    let faults = Found::new(&again, &options, None, None).unwrap().faults(&Answers::new(&again), false);
    let expected: Vec<_> = leaks.wrong.iter().map(|&(_, fault)| fault).enumerate().collect();
    assert_eq!(faults, expected);
}

#[test]
fn shared_models_are_closed_or_counted() {
    let Some(scenes) = shared("scenes") else { return };
    let of = |file: &str| {
        ClosedMesh::new(Mesh::try_from(&load(scenes.join(file)).unwrap()).unwrap()).map(|mesh| mesh.edge_count())
    };
    for file in ["ply/cube.ply", "ply/sphere.ply", "ply/fuze.ply", "spot/spot.obj", "objects/fandisk.obj"] {
        let triangles = load(scenes.join(file)).unwrap().triangles.len();
        assert_eq!(of(file), Ok(triangles * 3 / 2), "{file}");
    }
    // As the scenes' manifest has it.
    let why = |open_edges, crowded_edges| Err(NotClosed { open_edges, crowded_edges, ..NotClosed::default() });
    assert_eq!(of("objects/teapot.obj"), why(160, 0));
    assert_eq!(of("stl/3DSMaxExport.STL"), why(0, 16));
    assert_eq!(of("bunny/bunny-948.ply"), why(26, 70));
}
