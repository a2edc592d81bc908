//! Grid, octree, boxes, spheres and hierarchies of boxes: rays and scenes made to break them, against brute force bit
//! for bit; what each structure promises of its lists; and the options that go with them.

use crate::common::{
    Random, SEED, asked, device, is_thorough, quick_device, scene_of, sheet, soup, try_asked, usually_every,
};
use glam::{DVec3, Vec3};
use raybrook::low_level::accel::{BuildOptions, StructureStats, build_boxes, build_octree, build_spheres};
use raybrook::low_level::options::{
    GridOptions, Intersector, KdOptions, PacketSize, Structure, StructureKind, TraceOptions, Traversal,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::{Hit, KD_LEAF, TraceRay, WorkCounter};
use raybrook::low_level::tracer::{Backend, TraceJob, is_hit};
use std::sync::Arc;

type Triangles = Vec<[Vec3; 3]>;

/// Kernels would read beyond the ends of arrays that were packed for others.
#[test]
fn a_scene_is_traced_with_what_it_was_packed_for() {
    let base = TraceOptions::DEFAULT;
    let kd = TraceOptions { structure: Structure::of(StructureKind::Kd), ..base };
    let ropes = TraceOptions { structure: Structure::Kd(KdOptions { traversal: Traversal::Ropes, ..kd.kd() }), ..kd };
    let packets = TraceOptions { packet_size: PacketSize::Sixteen, ..kd };
    let precomputed = TraceOptions { intersector: Intersector::Precomputed, ..kd };
    let buffers = |options: &TraceOptions| {
        Arc::new(SceneBuffers::new(&scene_of(&soup(20, 0.5, &mut Random::new(SEED))), options).unwrap())
    };
    for (packed, asked, refused) in [
        (
            kd,
            TraceOptions { structure: Structure::Kd(KdOptions { traversal: Traversal::Restart, ..kd.kd() }), ..kd },
            None,
        ),
        (ropes, kd, None),
        (packets, kd, None),
        (precomputed, kd, None),
        (kd, ropes, Some("traversal: ropes")),
        (kd, packets, Some("packet_size: 16")),
        (kd, precomputed, Some("intersector: precomputed")),
        (kd, TraceOptions { structure: Structure::of(StructureKind::Bvh2), ..base }, Some("structure: bvh2")),
    ] {
        let buffers = buffers(&packed);
        for device in [None, device().as_ref()] {
            let message = open_tracer(device, &buffers, &asked, 1, None).err().map(|error| error.to_string());
            assert_eq!(message.is_some(), refused.is_some(), "{packed:?} {asked:?}: {message:?}");
            assert!(message.is_none_or(|message| message.contains(refused.unwrap())), "{asked:?}");
        }
    }
}

/// Squares at whole coordinates, in planes across all axes: with as many cells as squares everything lies in some
/// plane.
fn lattice(side: usize) -> Triangles {
    let cells = (0..side * side * side).map(|i| (i % side, i / side % side, i / side / side));
    cells
        .flat_map(|(x, y, z)| {
            let at = Vec3::new(x as f32, y as f32, z as f32);
            [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)]
                .into_iter()
                .flat_map(move |(u, v)| [[at, at + u, at + v], [at + u, at + u + v, at + v]])
        })
        .collect()
}

fn moved(triangles: Triangles, scale: f32, offset: Vec3) -> Triangles {
    triangles.into_iter().map(|triangle| triangle.map(|p| p * scale + offset)).collect()
}

fn scenes() -> Vec<(&'static str, Triangles)> {
    let mut random = Random::new(SEED);
    let big = [[Vec3::new(-9.0, -8.0, -7.0), Vec3::new(9.0, -6.0, 8.0), Vec3::new(-5.0, 9.0, 6.0)]];
    let needles = (0..100).map(|_| {
        let (a, b) = (random.vec3(), random.vec3());
        [a, b, b + random.vec3() * 1e-5]
    });
    vec![
        ("needles", needles.collect()),
        ("one triangle", vec![[Vec3::ZERO, Vec3::X, Vec3::Y]]),
        ("one oblique triangle", big.to_vec()),
        ("a big one among small ones", [&big[..], &soup(300, 0.05, &mut random)].concat()),
        ("lattice", lattice(4)),
        ("lattice, not at round numbers", moved(lattice(4), 0.1, Vec3::new(0.3, -0.7, 100.1))),
        ("flat", sheet(8).into_iter().map(|t| t.map(|p| p.with_z(0.0))).collect()),
        ("flat, across x", sheet(8).into_iter().map(|t| t.map(|p| Vec3::new(0.1, p.y, p.x))).collect()),
        ("duplicates", vec![[Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::new(3.0, 1.0, -2.0)]; 50]),
        ("far from the origin", moved(soup(200, 0.3, &mut random), 1.0, Vec3::new(1e6, -2e6, 3e5))),
        ("huge", moved(soup(200, 0.3, &mut random), 1e18, Vec3::splat(-5e17))),
        ("tiny", moved(soup(200, 0.3, &mut random), 1e-20, Vec3::ZERO)),
    ]
}

/// Structures with their numbers; the first is brute force.
fn all_options() -> Vec<TraceOptions> {
    let kinds = ["brute", "bvh2", "bvh8", "instances", "grid", "octree", "boxes", "spheres"];
    let numbers = [
        "grid grid_size=1,1,1",
        "grid grid_size=4,4,4",
        "grid grid_size=7,3,1",
        "grid grid_size=2,1,90",
        "grid grid_size=33,34,35",
        "bvh2 leaf_size=1",
        "bvh8 leaf_size=1",
        "octree leaf_size=1",
        "boxes leaf_size=1",
        "spheres leaf_size=1",
        "bvh2 reinsert=0",
        "bvh8 reinsert=0",
        "bvh2 leaf_size=1 reinsert=100",
        "bvh8 leaf_size=1 reinsert=100",
        "instances leaf_size=1",
        "instances spatial_splits=auto",
        "octree max_depth=0",
        "octree leaf_size=1 max_depth=60",
    ];
    let all = kinds.iter().chain(&numbers).map(|text| asked(&format!("structure={text}")));
    all.chain([StructureKind::Bvh2, StructureKind::Bvh8].into_iter().flat_map(cut)).collect()
}

/// Hierarchies of boxes with splits of space.
fn cut(kind: StructureKind) -> [TraceOptions; 3] {
    ["spatial_splits=0.5", "leaf_size=1 reinsert=100 spatial_splits=4", "spatial_splits=auto"]
        .map(|numbers| asked(&format!("structure={kind} {numbers}")))
}

/// Rays in tracing space that meet a 4³ grid, its octree and the triangles where it hurts.
fn queries(buffers: &SceneBuffers, count: usize) -> Vec<TraceRay> {
    let mut random = Random::new(SEED + 7);
    let (low, high) = (buffers.params.low.xyz(), buffers.params.high.xyz());
    let extent = high - low;
    let size = extent.max_element();
    let middle = (low + high) * 0.5;
    let corners: Vec<Vec3> = buffers.vertices.iter().map(|v| v.xyz()).collect();
    let ray = |origin: Vec3, direction: Vec3, t_max: f32| TraceRay {
        origin_t_min: raybrook::low_level::layout::Float4::new(origin, 0.0),
        direction_t_max: raybrook::low_level::layout::Float4::new(direction, t_max),
    };
    (0..count)
        .map(|i| {
            let anywhere = middle + random.vec3() * size * 1.5;
            let mut below = |n: u64| (random.bits() % n) as usize;
            // A corner of the 4³ grid, as its planes are computed.
            let mut lattice_point = || {
                let [x, y, z] = [below(5), below(5), below(5)].map(|k| k as f32);
                Vec3::new(
                    x.mul_add(extent.x / 4.0, low.x),
                    y.mul_add(extent.y / 4.0, low.y),
                    z.mul_add(extent.z / 4.0, low.z),
                )
            };
            let (a, b) = (lattice_point(), lattice_point());
            let (axis, triangle) = (below(3), 3 * below(corners.len() as u64 / 3));
            let sign = [-1.0, 1.0][below(2)];
            let [p0, p1, p2] = [corners[triangle], corners[triangle + 1], corners[triangle + 2]];
            let weight = random.unit();
            let inf = f32::INFINITY;
            match i % 14 {
                0 => (a + (a - b) * 2.0, b - a, inf), // through two corners
                1 => (a, b - a, inf),                 // from one to the other
                2 => (a - Vec3::AXES[axis] * sign * size * 2.0, Vec3::AXES[axis] * sign, inf), // along a cell's edge
                3 => (a, Vec3::new(1.0, sign, 1.0), inf), // three planes at once
                4 => {
                    // In a face.
                    let (mut from, mut along) = (anywhere, random.vec3());
                    from[axis] = a[axis];
                    along[axis] = 0.0;
                    (from, along, inf)
                }
                5 => (a, random.vec3(), inf), // from a corner
                6 => {
                    // Nearly in a face: the axis's crossings are as uncertain as can be.
                    let (from, mut along) = (a.with_x(anywhere.x).with_y(anywhere.y), random.vec3());
                    along.z = [1e-7, -1e-20, 1e-38, -1e-44][i / 14 % 4];
                    (from, along, inf)
                }
                7 => (anywhere, p0 - anywhere, inf),                  // at a vertex
                8 => (anywhere, p0.lerp(p1, weight) - anywhere, inf), // at an edge
                9 => (p0.lerp(p1, weight), random.vec3(), inf),       // from an edge
                10 => (p0, p1 - p0, inf),                             // along an edge
                11 => (p0 + (p0 - p2), p1.lerp(p2, weight) - (p0 + (p0 - p2)), inf), // in a triangle's plane
                12 => {
                    // From far away, at an edge: the test's own errors are larger than any cell.
                    let from = middle + random.vec3() * size * 10f32.powi(i as i32 / 14 % 8);
                    (from, p0.lerp(p1, weight) - from, inf)
                }
                _ => (anywhere, p0.lerp(p1, weight).lerp(p2, random.unit()) - anywhere, 1.0), // ends at a triangle
            }
        })
        .map(|(origin, direction, t_max)| ray(origin, direction, t_max))
        .collect()
}

fn queries_of(scene: &Scene, count: usize) -> Vec<TraceRay> {
    queries(&SceneBuffers::new(scene, &all_options()[0]).unwrap(), count)
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

fn assert_same(name: &str, rays: &[TraceRay], got: &[Hit], expected: &[Hit]) {
    let wrong: Vec<_> = (0..rays.len()).filter(|&i| bits(&got[i]) != bits(&expected[i])).collect();
    if let Some(&i) = wrong.first() {
        let count = wrong.len();
        panic!("{name}: {count} hits differ; ray {i} {:?}: {:?} instead of {:?}", rays[i], got[i], expected[i]);
    }
}

#[test]
fn rays_made_to_break_structures_get_the_hits_of_brute_force() {
    let count = if is_thorough() { 3_000 } else { 700 };
    for (name, triangles) in scenes() {
        let scene = scene_of(&triangles);
        let mut expected = Vec::new();
        let rays = queries_of(&scene, count);
        for options in all_options() {
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
            let mut tracer = ReferenceBackend::new(buffers, options);
            let hits = tracer.trace(&job, &|_| ()).unwrap().hits;
            if options.kind() == StructureKind::Brute {
                let found = hits.iter().filter(|hit| is_hit(hit)).count();
                assert!(found > count / 10, "{name}: only {found} hits");
                expected = hits;
                continue;
            }
            assert_same(&format!("{name}, {options:?}"), &rays, &hits, &expected);
            let any = tracer.trace(&TraceJob { any_hit: true, ..job }, &|_| ()).unwrap().hits;
            let same = any.iter().zip(&expected).all(|(any, closest)| is_hit(any) == is_hit(closest));
            assert!(same, "{name}, {options:?}: any-hit");
        }
    }
}

#[test]
fn the_device_agrees_on_them_to_the_bit() {
    let Some(device) = quick_device() else { return };
    for (name, triangles) in scenes() {
        let scene = scene_of(&triangles);
        let rays = queries_of(&scene, 1400);
        for options in usually_every(
            2,
            all_options().into_iter().skip(1).take(7).chain(cut(StructureKind::Bvh2)).chain(cut(StructureKind::Bvh8)),
        ) {
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
            let expected = ReferenceBackend::new(buffers.clone(), options).trace(&job, &|_| ()).unwrap().hits;
            let got =
                open_tracer(Some(&device), &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap().hits;
            assert_same(&format!("{name}, {options:?}"), &rays, &got, &expected);
        }
    }
}

fn all(triangles: &Triangles) -> Vec<u32> {
    (0..triangles.len() as u32).collect()
}

fn packed(buffers: &SceneBuffers) -> Triangles {
    buffers.vertices.chunks_exact(3).map(|corners| [corners[0].xyz(), corners[1].xyz(), corners[2].xyz()]).collect()
}

#[test]
fn a_grid_lists_each_triangle_in_every_cell_that_its_box_touches() {
    for (name, triangles) in scenes() {
        for size in [None, Some([1, 1, 1]), Some([5, 6, 7])] {
            let options = TraceOptions { structure: Structure::Grid(GridOptions { size }), ..TraceOptions::default() };
            let buffers = SceneBuffers::new(&scene_of(&triangles), &options).unwrap();
            let (low, cell) = (buffers.bounds[0].xyz(), buffers.bounds[1].xyz());
            let count = [0, 1, 2].map(|axis| buffers.bounds[axis].w.to_bits());
            assert_eq!(buffers.nodes.len(), count.iter().product::<u32>() as usize, "{name}");
            if let Some(size) = size {
                let extent = buffers.params.high.xyz() - buffers.params.low.xyz();
                assert!((0..3).all(|k| count[k] == if extent[k] > 0.0 { size[k] } else { 1 }), "{name}: {count:?}");
            }
            let triangles = packed(&buffers);
            let mut next = 0;
            for (index, node) in buffers.nodes.iter().enumerate() {
                assert_eq!((node.flags, node.left), (KD_LEAF, next), "{name}");
                next += node.right;
                let list = &buffers.references[node.left as usize..next as usize];
                assert!(list.is_sorted_by(|a, b| a < b), "{name}: {list:?}");
                let (index, [x, y, _]) = (index as u32, count);
                let at = [index % x, index / x % y, index / x / y];
                for (i, triangle) in triangles.iter().enumerate() {
                    let touches = (0..3).all(|k| {
                        let plane = |n: u32| (n as f32).mul_add(cell[k], low[k]);
                        let coordinates = triangle.map(|p| p[k]);
                        let from = coordinates.iter().copied().fold(f32::INFINITY, f32::min);
                        let to = coordinates.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                        (at[k] + 1 == count[k] || from <= plane(at[k] + 1)) && (at[k] == 0 || to >= plane(at[k]))
                    });
                    let listed = list.binary_search(&(i as u32)).is_ok();
                    assert!(listed || !touches, "{name}: cell {at:?} does not list triangle {i}");
                }
            }
            assert_eq!(buffers.references[next as usize..], all(&triangles), "{name}");
            assert_eq!(buffers.bounds[3].y.to_bits(), next, "{name}");
        }
    }
}

#[test]
fn boxes_and_spheres_hold_their_triangles() {
    for (name, triangles) in scenes() {
        for size in [None, Some(1), Some(7), Some(u32::MAX)] {
            let boxes = build_boxes(&triangles, &all(&triangles), size, 0.0);
            let spheres = build_spheres(&triangles, &all(&triangles), size, 0.0);
            for structure in [&boxes, &spheres] {
                let mut sorted = structure.references.clone();
                sorted.sort_unstable();
                assert_eq!(sorted, all(&triangles), "{name}");
                assert_eq!(structure.nodes[0].right as usize, structure.nodes.len() - 1);
                for (cluster, node) in structure.nodes[1..].iter().enumerate() {
                    let list = &structure.references[node.left as usize..(node.left + node.right) as usize];
                    assert!(!list.is_empty() && list.len() <= size.unwrap_or(u32::MAX) as usize);
                    for p in list.iter().flat_map(|&i| triangles[i as usize]) {
                        let sphere = spheres.bounds[cluster];
                        let distance = (p.as_dvec3() - DVec3::from(sphere.xyz())).length();
                        assert!(distance <= f64::from(sphere.w), "{name}: {distance} > {}", sphere.w);
                        let [low, high] = [boxes.bounds[2 * cluster].xyz(), boxes.bounds[2 * cluster + 1].xyz()];
                        assert!(p.cmpge(low).all() && p.cmple(high).all(), "{name}");
                    }
                }
            }
        }
    }
    assert_eq!(build_boxes(&[], &[], None, 0.0).nodes.len(), 1);
}

#[test]
fn every_point_of_a_triangle_is_in_an_octree_leaf_that_lists_it() {
    let mut random = Random::new(SEED);
    for (name, triangles) in scenes() {
        let around = scene_of(&triangles).bounds().unwrap();
        let bounds = raybrook::low_level::accel::Aabb { low: around.0, high: around.1 };
        for (leaf_size, max_depth) in [(None, None), (Some(1), None), (Some(1), Some(60)), (None, Some(2))] {
            let options = BuildOptions::octree(triangles.len(), leaf_size, max_depth);
            let tree = build_octree(&triangles, &all(&triangles), bounds, &options, 0.0);
            assert!(tree.references.len() <= 32 * triangles.len(), "{name}: {} references", tree.references.len());
            for (i, triangle) in triangles.iter().enumerate() {
                let [p0, p1, p2] = triangle.map(|p| p.as_dvec3());
                let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                for point in [p0, p1, p2, p0.lerp(p1, u), p0 * (1.0 - u - v) + p1 * u + p2 * v] {
                    // The point's own error here: a few steps of f64.
                    let error = 1e-14 * p0.abs().max(p1.abs()).max(p2.abs()).max_element();
                    let mut open = vec![(0u32, 0)];
                    let mut listed = false;
                    while let Some((index, depth)) = open.pop() {
                        let node = tree.nodes[index as usize];
                        if node.flags == KD_LEAF {
                            assert!(depth <= options.max_depth);
                            let end = (node.left + node.right) as usize;
                            listed |= tree.references[node.left as usize..end].binary_search(&(i as u32)).is_ok();
                            continue;
                        }
                        let from_centre = point - DVec3::from(tree.bounds[node.right as usize].xyz());
                        let sides = (0..8).filter(|child| {
                            (0..3).all(|k| {
                                let above = child >> k & 1 == 1;
                                if above { from_centre[k] >= -error } else { from_centre[k] <= error }
                            })
                        });
                        open.extend(sides.map(|child| (node.left + child, depth + 1)));
                    }
                    assert!(listed, "{name}, {options:?}: {point} of triangle {i}");
                }
            }
        }
    }
}

#[test]
fn default_grids_are_of_bounded_size() {
    let mut random = Random::new(SEED);
    let one_size = scene_of(&soup(20_000, 0.02, &mut random));
    let options = TraceOptions::of(StructureKind::Grid);
    let stats = |buffers: &SceneBuffers, triangles: usize| {
        StructureStats::new(StructureKind::Grid, &buffers.nodes, &buffers.references, &buffers.bounds, triangles)
    };
    let good = stats(&SceneBuffers::new(&one_size, &options).unwrap(), 20_000);
    println!("{good:?}");
    assert!((100_000..=160_000).contains(&good.cells), "{good:?}");
    assert!(good.references_per_triangle < 12.0 && good.largest_cell < 50, "{good:?}");
    let crossing = scene_of(&soup(2000, 2.0, &mut random));
    let coarse = stats(&SceneBuffers::new(&crossing, &options).unwrap(), 2000);
    println!("{coarse:?}");
    assert!(coarse.references_per_triangle <= 64.0, "{coarse:?}");
    let empty = SceneBuffers::new(&scene_of(&[]), &options).unwrap();
    assert_eq!((empty.nodes.len(), empty.references.len()), (1, 0));

    let limit = asked("structure=grid grid_size=256,256,256");
    let error = SceneBuffers::new(&crossing, &limit).unwrap_err().to_string();
    assert!(error.contains("grid_size") && error.contains("references"), "{error}");
}

#[test]
fn an_empty_scene_is_missed() {
    for options in all_options() {
        let buffers = Arc::new(SceneBuffers::new(&scene_of(&[]), &options).unwrap());
        let rays =
            [buffers.trace_ray(Vec3::ZERO, Vec3::X, 0.0, 1.0), buffers.trace_ray(Vec3::ONE, -Vec3::ONE, 0.0, 9.0)];
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        let hits = ReferenceBackend::new(buffers, options).trace(&job, &|_| ()).unwrap().hits;
        assert!(!hits.iter().any(is_hit), "{options:?}");
    }
}

#[test]
fn options_without_a_meaning_are_refused() {
    for (text, option, remedy) in [
        ("grid build=median", "build", "`structure = kd`"),
        ("grid leaf_size=4", "leaf_size", "`grid_size = X,Y,Z`"),
        ("brute leaf_size=4", "leaf_size", "`structure = boxes` or `structure = spheres`"),
        ("bvh2 leaf_size=16", "leaf_size", "has room for 15"),
        ("bvh8 leaf_size=9", "leaf_size", "has room for 8"),
        ("bvh2 max_depth=4", "max_depth", "`structure = kd` or `structure = octree`"),
        ("spheres max_depth=4", "max_depth", "`structure = kd` or `structure = octree`"),
        ("kd reinsert=1", "reinsert", "`structure = bvh2` or `structure = bvh8`"),
        ("boxes reinsert=0", "reinsert", "means nothing to `structure = boxes`"),
        ("kd spatial_splits=1", "spatial_splits", "`structure = bvh2` or `structure = bvh8`"),
        ("bvh2 spatial_splits=4.5", "spatial_splits", "4.5 is not a number from 0 to 4, or `auto`"),
        ("bvh8 spatial_splits=-0.5", "spatial_splits", "from 0 to 4"),
        ("bvh8 spatial_splits=nan", "spatial_splits", "NaN is not"),
        ("bvh8 spatial_splits=inf", "spatial_splits", "from 0 to 4"),
        ("bvh2 spatial_splits=Auto", "spatial_splits", "'Auto' is not a number from 0 to 4, or `auto`"),
        ("octree spatial_splits=auto", "spatial_splits", "`structure = bvh2` or `structure = bvh8`"),
        ("kd grid_size=4,4,4", "grid_size", "`structure = grid`"),
        ("grid grid_size=4,0,4", "grid_size", "1,1,1"),
        ("grid grid_size=4294967295,2,1", "grid_size", "16777216"),
        ("grid grid_size=257,256,256", "grid_size", "16777216"),
    ] {
        let error = try_asked(&format!("structure={text}")).unwrap_err().to_string();
        assert!(error.contains(&format!("option {option}:")) && error.contains(remedy), "{error}");
    }
    assert!(all_options().iter().all(|options| options.validate().is_ok()));
    assert!(try_asked("structure=grid grid_size=16777216,1,1").is_ok());
}

/// `count` small triangles about the origin, of which some of the first have a corner very far out.
fn with_outliers(count: usize, outliers: usize, far: f32, random: &mut Random) -> Triangles {
    let mut triangles = soup(count, 0.05, random);
    for triangle in triangles.iter_mut().take(outliers) {
        triangle[1] = if outliers == 1 { Vec3::new(-far, 0.5, 0.25) } else { far * random.vec3() };
    }
    triangles
}

/// Rays that start among the small triangles, from beside them, and from far out.
fn rays_among(buffers: &SceneBuffers, random: &mut Random) -> Vec<TraceRay> {
    let mut ray = |i: usize| {
        let from = random.vec3() * [1.0, 1.0, 1.0, 4.0, 1e5][i % 5];
        buffers.trace_ray(from, random.vec3() - [0.0, 0.0, 0.0, 1.0, 1.0][i % 5] * from, 0.0, f32::INFINITY)
    };
    (0..300).map(&mut ray).collect()
}

/// One vertex very far out, or many, change neither what structures find nor, for rays that start where most triangles
/// are, how many triangles they test for it.
#[test]
fn what_lies_very_far_out_does_not_make_structures_test_everything() {
    let mut random = Random::new(SEED + 11);
    // At 1e38 float32 decides nothing about the others any more: what judges there is a kd-tree, and the exact test.
    let float32 = (Intersector::Watertight, StructureKind::Brute);
    let exact = (Intersector::Exact, StructureKind::Kd);
    for (outliers, far, (intersector, judge)) in
        [(1, 1e9, float32), (10, 1e9, float32), (1, 1e38, exact), (10, 1e38, exact)]
    {
        let scene = scene_of(&with_outliers(1000, outliers, far, &mut random));
        let plain = scene_of(&with_outliers(1000, 0, far, &mut random));
        for accel in [
            StructureKind::Bvh2,
            StructureKind::Bvh8,
            StructureKind::Grid,
            StructureKind::Octree,
            StructureKind::Boxes,
            StructureKind::Spheres,
        ] {
            let options = TraceOptions { intersector, counters: true, ..TraceOptions::of(accel) };
            let trace = |scene: &Scene| {
                let buffers = Arc::new(SceneBuffers::new(scene, &options).unwrap());
                let rays = rays_among(&buffers, &mut Random::new(SEED));
                let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
                let found = open_tracer(None, &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap();
                let near = found.work.unwrap().into_iter().enumerate().filter(|(i, _)| i % 5 < 4);
                (buffers, rays, found.hits, near.map(|(_, work)| u64::from(work.get(WorkCounter::Tests))).sum::<u64>())
            };
            if accel == StructureKind::Spheres && far == 1e38 {
                continue; // squares of the others' sizes underflow
            }
            let (buffers, rays, hits, tests) = trace(&scene);
            let (_, _, _, plain_tests) = trace(&plain);
            let all: Vec<Hit> = {
                let judge = TraceOptions { structure: Structure::of(judge), counters: false, ..options };
                let buffers = Arc::new(SceneBuffers::new(&scene, &judge).unwrap());
                let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
                open_tracer(None, &buffers, &judge, 1, None).unwrap().trace(&job, &|_| ()).unwrap().hits
            };
            assert_eq!(hits, all, "{outliers} at {far:e}, {accel}");
            println!(
                "{outliers} at {far:e}, {accel}: {tests} tests, {plain_tests} without; reach {}",
                buffers.params.high.w
            );
            assert!(
                tests < 2 * plain_tests + 240 * (outliers as u64 + 20),
                "{outliers} at {far:e}, {accel}: {tests} tests, {plain_tests} without outliers"
            );
        }
    }
}

/// The same on a device, with what it takes by itself, and with packets.
#[test]
fn a_device_finds_the_same_among_outliers() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED + 12);
    let scene = scene_of(&with_outliers(500, 5, 1e9, &mut random));
    let with = |accel| TraceOptions::of(accel);
    let packets = TraceOptions { packet_size: PacketSize::Sixteen, ..with(StructureKind::Bvh8) };
    for options in [packets, with(StructureKind::Bvh2), with(StructureKind::Grid), with(StructureKind::Octree)] {
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        assert!(buffers.params.high.w > 0.0);
        let rays = rays_among(&buffers, &mut random);
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        let trace =
            |device| open_tracer(device, &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap().hits;
        let (found, expected) = (trace(Some(&device)), trace(None));
        assert_eq!(bytemuck::cast_slice::<_, u32>(&found), bytemuck::cast_slice::<_, u32>(&expected), "{options:?}");
        assert!(expected.iter().filter(|hit| is_hit(hit)).count() > 20, "{options:?}");
    }
}
