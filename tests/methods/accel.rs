//! Every build × many inputs: the trees keep all promises of `check_tree`, and building twice gives the same tree,
//! whatever the number of threads.

use crate::common::Random;
use crate::common::models::shared_scenes;
use glam::Vec3;
use raybrook::low_level::accel::{Aabb, BuildOptions, KdTree, TreeStats, build_kd_tree, check_tree};
use raybrook::low_level::options::{Build, KdOptions, SplitAxis, Stop, TraceOptions};
use raybrook::low_level::shared::KD_LEAF;
use std::time::{Duration, Instant};

type Triangles = Vec<[Vec3; 3]>;

/// A point in the unit cube.
fn point(random: &mut Random) -> Vec3 {
    Vec3::new(random.unit(), random.unit(), random.unit())
}

/// Triangles in the unit cube, with edges of about `size`.
fn soup(seed: u64, count: usize, size: f32) -> Triangles {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let at = point(&mut random);
            [0; 3].map(|_| at + (point(&mut random) - 0.5) * size)
        })
        .collect()
}

/// Needles with a length of about 1 and a width of `width`, in all directions.
fn slivers(seed: u64, count: usize, width: f32) -> Triangles {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let (a, b) = (point(&mut random), point(&mut random));
            [a, b, b + (point(&mut random) - 0.5) * width]
        })
        .collect()
}

/// Axis-aligned squares at whole coordinates, two triangles each, in planes across all axes: everything lies in some
/// plane.
fn boxes(side: usize) -> Triangles {
    let mut triangles = Vec::new();
    for i in 0..side * side * side {
        let at = Vec3::new((i % side) as f32, (i / side % side) as f32, (i / side / side) as f32);
        for (u, v) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
            triangles.push([at, at + u, at + v]);
            triangles.push([at + u, at + u + v, at + v]);
        }
    }
    triangles
}

/// A height field of two triangles a square; flat for `height` 0.
fn terrain(side: usize, height: f32) -> Triangles {
    let mut random = Random::new(7);
    let heights: Vec<f32> = (0..(side + 1) * (side + 1)).map(|_| random.unit() * height).collect();
    let point = |x: usize, z: usize| Vec3::new(x as f32, heights[z * (side + 1) + x], z as f32);
    (0..side * side)
        .map(|i| (i % side, i / side))
        .flat_map(|(x, z)| {
            let [a, b, c, d] = [point(x, z), point(x + 1, z), point(x, z + 1), point(x + 1, z + 1)];
            [[a, b, c], [b, d, c]]
        })
        .collect()
}

/// Coplanar triangles around one centroid, each a little larger than the one before.
fn nested(count: usize) -> Triangles {
    let corners = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(-0.5, 0.75, 0.0), Vec3::new(-0.5, -0.75, 0.0)];
    (0..count).map(|i| corners.map(|p| p * (1.0 + i as f32 / 1024.0))).collect()
}

fn transformed(triangles: Triangles, scale: f32, offset: Vec3) -> Triangles {
    triangles.into_iter().map(|triangle| triangle.map(|p| p * scale + offset)).collect()
}

/// A quad per diagonal plane, scene-sized, so that every plane straddles nearly all of them.
fn crossing(count: usize) -> Triangles {
    (0..count)
        .map(|i| {
            let lean = i as f32 / count as f32;
            [Vec3::ZERO, Vec3::new(1.0, lean, 1.0), Vec3::new(lean, 1.0, 1.0 - lean)]
        })
        .collect()
}

/// Name and triangles of every synthetic input.
fn inputs() -> Vec<(&'static str, Triangles)> {
    let one = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let mut teapot_in_stadium = terrain(12, 100.0);
    teapot_in_stadium.extend(transformed(soup(5, 500, 0.1), 0.01, Vec3::new(6.0, 50.0, 6.0)));
    vec![
        ("empty", vec![]),
        ("single", one.clone()),
        ("two far apart", vec![one[0], one[0].map(|p| p + 1e6)]),
        ("identical", vec![one[0]; 1000]),
        ("identical, oblique", vec![[Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::new(3.0, 1.0, -2.0)]; 500]),
        ("same centroid", nested(1000)),
        ("small soup", soup(1, 2000, 0.05)),
        ("large soup", soup(2, 300, 1.0)),
        ("slivers", slivers(3, 300, 1e-4)),
        ("thinnest slivers", slivers(4, 200, 1e-7)),
        ("crossing", crossing(300)),
        ("boxes", boxes(6)),
        ("boxes, not at round numbers", transformed(boxes(4), 0.1, Vec3::new(0.3, -0.7, 100.1))),
        ("terrain", terrain(30, 1.0)),
        ("flat", terrain(30, 0.0)),
        ("flat, offset", transformed(terrain(10, 0.0), 0.1, Vec3::splat(-3.3))),
        ("teapot in a stadium", teapot_in_stadium),
        ("huge", transformed(soup(6, 300, 0.2), 1e18, Vec3::splat(-5e17))),
        ("largest", transformed(soup(6, 100, 0.2), 1e38, Vec3::ZERO)),
        ("tiny", transformed(soup(7, 300, 0.2), 1e-20, Vec3::ZERO)),
        ("denormal", transformed(soup(8, 100, 0.2), 1e-40, Vec3::ZERO)),
        ("far from the origin", transformed(soup(9, 300, 0.2), 1.0, Vec3::splat(1e6))),
        ("both signs of zero", vec![one[0], one[0].map(|p| -p), [Vec3::NEG_X, -Vec3::ZERO, Vec3::Z]]),
    ]
}

fn all(triangles: &Triangles) -> Vec<u32> {
    (0..triangles.len() as u32).collect()
}

/// The defaults of `build`.
fn options_of(build: Build, triangle_count: usize) -> BuildOptions {
    BuildOptions::new(&TraceOptions::of_kd(KdOptions { build, ..KdOptions::DEFAULT }), triangle_count)
}

fn build_checked(build: Build, name: &str, triangles: &Triangles, options: &BuildOptions) -> KdTree {
    let primitives = all(triangles);
    let start = Instant::now();
    let tree = build_kd_tree(build, triangles, &primitives, options);
    // Tens of times what the slowest takes here, not optimised and on a busy machine.
    let limit = Duration::from_secs(20);
    assert!(start.elapsed() < limit, "{build} of '{name}' took {:?}", start.elapsed());
    if let Err(error) = check_tree(&tree, triangles, &primitives, options) {
        panic!("{build} of '{name}': {error}");
    }
    tree
}

#[test]
fn every_build_of_every_input_is_right() {
    for (name, triangles) in inputs() {
        for &build in Build::ALL {
            let options = options_of(build, triangles.len());
            let tree = build_checked(build, name, &triangles, &options);
            let stats = TreeStats::new(&tree, &options);
            println!("{name}: {build}: {stats:?}");
            assert!(stats.references_per_triangle <= 80.0, "{build} of '{name}': {stats:?}");
        }
    }
}

/// Stops and costs that let trees of hostile inputs grow as far as anything does.
fn extreme_options(build: Build, triangle_count: usize) -> Vec<BuildOptions> {
    let base = options_of(build, triangle_count);
    let without_stops = BuildOptions { leaf_size: 1, max_depth: 60, stop: Stop::Size, similar_children: 1.0, ..base };
    let free_steps = BuildOptions { stop: Stop::Cost, cost_traverse: 0.0, empty_bonus: 1.0, ..without_stops };
    vec![
        without_stops,
        BuildOptions { split_axis: SplitAxis::Longest, sample_size: 1, ..without_stops },
        free_steps,
        BuildOptions { cost_traverse: f32::MAX, cost_intersect: f32::from_bits(1), ..without_stops },
        BuildOptions { cost_traverse: f32::from_bits(1), cost_intersect: f32::MAX, ..free_steps },
        BuildOptions { stop: Stop::Cost, ..base },
        BuildOptions { stop: Stop::Size, similar_children: 0.0, ..base },
        // What no user can ask for must not do harm either.
        BuildOptions { cost_traverse: f32::NAN, sample_size: 0, leaf_size: 0, max_depth: u32::MAX, ..without_stops },
    ]
}

#[test]
fn hostile_inputs_are_built_without_stops_too() {
    for (name, triangles) in inputs() {
        for &build in Build::ALL {
            for options in extreme_options(build, triangles.len()) {
                let tree = build_checked(build, &format!("{name}, {options:?}"), &triangles, &options);
                let stats = TreeStats::new(&tree, &options);
                // As `build_kd_tree` promises.
                assert!(stats.references_per_triangle <= 32.0, "{build} of '{name}', {options:?}: {stats:?}");
                assert!(stats.max_depth <= TraceOptions::MAX_DEPTH, "{build} of '{name}', {options:?}: {stats:?}");
            }
        }
    }
}

#[test]
fn limits_are_kept() {
    let triangles = soup(11, 400, 0.3);
    for &build in Build::ALL {
        for (leaf_size, max_depth) in [(1, 0), (1, 1), (1, 5), (400, 40), (399, 40), (20, 10), (1, 60), (1, u32::MAX)] {
            let options = BuildOptions { leaf_size, max_depth, ..options_of(build, triangles.len()) };
            let tree = build_checked(build, "limits", &triangles, &options);
            let stats = TreeStats::new(&tree, &options);
            assert!(stats.max_depth <= max_depth.min(TraceOptions::MAX_DEPTH), "{build}: {stats:?}");
            if leaf_size >= 400 || max_depth == 0 {
                assert_eq!(tree.nodes.len(), 1);
            } else {
                assert!(tree.nodes.len() > 1, "{build} with {leaf_size}, {max_depth}");
            }
        }
    }
}

#[test]
fn only_the_given_primitives_are_in_the_tree() {
    let triangles = soup(12, 500, 0.1);
    let mut primitives: Vec<u32> = (0..500).filter(|i| i % 3 == 1).rev().collect(); // not even sorted
    primitives.push(1); // and one of them twice
    let mut sorted = primitives.clone();
    sorted.sort_unstable();
    for &build in Build::ALL {
        let options = options_of(build, primitives.len());
        let tree = build_kd_tree(build, &triangles, &primitives, &options);
        assert_eq!(check_tree(&tree, &triangles, &primitives, &options), Ok(()), "{build}");
        assert!(tree == build_kd_tree(build, &triangles, &sorted, &options), "{build}: the order changes the tree");
    }
}

#[test]
fn an_empty_scene_is_one_empty_leaf() {
    for &build in Build::ALL {
        let tree = build_kd_tree(build, &[], &[], &options_of(build, 0));
        assert_eq!(tree.bounds, Aabb::EMPTY, "{build}");
        assert_eq!((tree.nodes.len(), tree.references.len()), (1, 0), "{build}");
        assert_eq!((tree.nodes[0].flags, tree.nodes[0].right), (KD_LEAF, 0), "{build}");
    }
}

#[test]
fn threads_do_not_change_the_tree() {
    let triangles = soup(13, 12_000, 0.03);
    let primitives = all(&triangles);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (one, two) = (pool(1), pool(2));
    for &build in Build::ALL {
        let options = options_of(build, triangles.len());
        let alone = one.install(|| build_kd_tree(build, &triangles, &primitives, &options));
        for _ in 0..3 {
            let together = two.install(|| build_kd_tree(build, &triangles, &primitives, &options));
            assert!(alone == together, "{build}");
        }
    }
}

#[test]
fn the_numbers_of_a_known_tree_are_right() {
    // Two unit squares at x = 0 and x = 4, seen by a plane at each: empty space between them is cut off.
    let square = [[Vec3::ZERO, Vec3::Y, Vec3::Z], [Vec3::Y, Vec3::Z, Vec3::Y + Vec3::Z]];
    let triangles: Triangles = square.into_iter().chain(square.map(|t| t.map(|p| p + Vec3::X * 4.0))).collect();
    let options = BuildOptions { cost_traverse: 0.5, leaf_size: 2, ..options_of(Build::Median, 4) };
    let tree = build_checked(Build::Median, "squares", &triangles, &options);
    let stats = TreeStats::new(&tree, &options);
    assert_eq!((stats.nodes, stats.inner, stats.leaves, stats.empty_leaves), (3, 1, 2, 0));
    assert_eq!((stats.references, stats.references_per_triangle, stats.largest_leaf), (4, 1.0, 2));
    assert_eq!((stats.max_depth, stats.mean_leaf_depth, stats.mean_leaf_triangles), (1, 1.0, 2.0));
    assert_eq!(stats.bytes, 3 * 16 + 4 * 4);
    // Half areas: root 1 + 4 + 4, child 1 + 2 + 2.
    let expected = 0.5 + 2.0 * (5.0 / 9.0) * 2.0 * f64::from(options.cost_intersect);
    assert!((stats.sah_cost - expected).abs() < 1e-12, "{}", stats.sah_cost);
}

/// The triangles of an OBJ file of the shared test scenes (`v` and `f` lines, polygons as fans), or `None` without the
/// file. Triangles without area are left out, as they are before a tree is built.
fn model(path: &str) -> Option<Triangles> {
    let text = std::fs::read_to_string(shared_scenes(path)?).unwrap();
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut next = || words.next().and_then(|word| word.parse().ok()).unwrap_or(f32::NAN);
                points.push(Vec3::new(next(), next(), next()));
            }
            Some("f") => {
                let corners: Vec<Vec3> = words
                    .filter_map(|word| word.split('/').next()?.parse::<isize>().ok())
                    .map(|i| if i < 0 { points.len() as isize + i } else { i - 1 })
                    .map(|i| points[i as usize])
                    .collect();
                triangles.extend((2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]]));
            }
            _ => {}
        }
    }
    triangles.retain(|[a, b, c]: &[Vec3; 3]| {
        let [a, b, c] = [a.as_dvec3(), b.as_dvec3(), c.as_dvec3()];
        (b - a).cross(c - a).length_squared() > 0.0
    });
    Some(triangles)
}

const MODELS: &[&str] = &[
    "objects/cow.obj",
    "objects/suzanne.obj",
    "objects/teapot.obj",
    "quirks/same_centroid_1000.obj",
    "spd/tree.obj",
    "spd/gears.obj",
    "sponza/sponza.obj",
    "bunny/bunny-69451.obj",
];

#[test]
fn trees_of_models_are_right() {
    for name in MODELS {
        let Some(triangles) = model(name) else { continue };
        for &build in Build::ALL {
            let options = options_of(build, triangles.len());
            let tree = build_checked(build, name, &triangles, &options);
            println!("{name}: {build}: {:?}", TreeStats::new(&tree, &options));
        }
    }
}

/// Prints build times: `cargo test --release --test methods time_builds -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement, not a check"]
fn time_builds_of_models() {
    for name in MODELS {
        let Some(triangles) = model(name) else {
            continue;
        };
        let primitives = all(&triangles);
        for &build in Build::ALL {
            let options = options_of(build, triangles.len());
            let mut best = Duration::MAX;
            for _ in 0..10 {
                let start = Instant::now();
                std::hint::black_box(build_kd_tree(build, &triangles, &primitives, &options));
                best = best.min(start.elapsed());
            }
            let stats = TreeStats::new(&build_kd_tree(build, &triangles, &primitives, &options), &options);
            println!("{name}, {} triangles, {build}: {best:?}\n    {stats:?}", triangles.len());
        }
    }
}
