//! What tells the builds of the kd-tree apart, and what their stops and costs do. That their trees are right is the
//! business of `tests/methods/accel.rs`, that rays find their hits in them that of `tests/methods/traverse.rs`.

use crate::common::{Random, SEED, sheet, soup};
use glam::{DVec3, Vec3};
use raybrook::low_level::accel::{BuildOptions, KdTree, Measure, TreeStats, build_kd_tree, expected_cost};
use raybrook::low_level::options::{Build, KdOptions, SplitAxis, Stop, TraceOptions};
use raybrook::low_level::shared::KD_LEAF;
use std::collections::BTreeSet;

type Triangles = Vec<[Vec3; 3]>;

const MEDIANS: [Build; 3] = [Build::Median, Build::SampledMedian, Build::SpatialMedian];

/// The defaults of `build`.
fn options_of(build: Build, triangles: &Triangles) -> BuildOptions {
    BuildOptions::new(&TraceOptions::of_kd(KdOptions { build, ..KdOptions::DEFAULT }), triangles.len())
}

fn grow(build: Build, triangles: &Triangles, options: &BuildOptions) -> KdTree {
    let primitives: Vec<u32> = (0..triangles.len() as u32).collect();
    build_kd_tree(build, triangles, &primitives, options)
}

/// The triangles of one of our scenes.
fn scene(name: &str) -> Triangles {
    let scene = raybrook::low_level::scene::load(crate::common::root().join("scenes").join(name)).unwrap();
    scene.hittable().into_iter().map(|i| scene.vertices(i as usize)).collect()
}

/// A node as it stands in its tree.
struct Node {
    low: DVec3,
    high: DVec3,
    depth: u32,
    /// What is in the leaves below.
    triangles: BTreeSet<u32>,
    /// Axis, plane and children of an inner node.
    split: Option<(usize, f32, Box<Node>, Box<Node>)>,
}

impl Node {
    fn root(tree: &KdTree) -> Node {
        Node::new(tree, 0, tree.bounds.low.into(), tree.bounds.high.into(), 0)
    }

    fn new(tree: &KdTree, index: u32, low: DVec3, high: DVec3, depth: u32) -> Node {
        let node = tree.nodes[index as usize];
        if node.flags == KD_LEAF {
            let list = &tree.references[node.left as usize..(node.left + node.right) as usize];
            return Node { low, high, depth, triangles: list.iter().copied().collect(), split: None };
        }
        let axis = node.flags as usize;
        let (mut middle_low, mut middle_high) = (low, high);
        middle_high[axis] = node.split.into();
        middle_low[axis] = node.split.into();
        let left = Node::new(tree, node.left, low, middle_high, depth + 1);
        let right = Node::new(tree, node.right, middle_low, high, depth + 1);
        let triangles = left.triangles.union(&right.triangles).copied().collect();
        Node { low, high, depth, triangles, split: Some((axis, node.split, left.into(), right.into())) }
    }

    /// Calls `visit` for every inner node.
    fn for_each_split(&self, visit: &mut impl FnMut(&Node, usize, f32, &Node, &Node)) {
        if let Some((axis, plane, left, right)) = &self.split {
            visit(self, *axis, *plane, left, right);
            left.for_each_split(visit);
            right.for_each_split(visit);
        }
    }

    fn half_area(&self) -> f64 {
        let size = self.high - self.low;
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    /// The cost of a line that does not end at a hit, 0 if it misses the cell.
    fn cost_of_line(&self, origin: DVec3, direction: DVec3, options: &BuildOptions) -> f64 {
        let (to_low, to_high) = ((self.low - origin) / direction, (self.high - origin) / direction);
        if to_low.min(to_high).max_element() > to_low.max(to_high).min_element() {
            return 0.0;
        }
        match &self.split {
            None => self.triangles.len() as f64 * f64::from(options.cost_intersect),
            Some((_, _, left, right)) => {
                let below = [left, right].map(|child| child.cost_of_line(origin, direction, options));
                f64::from(options.cost_traverse) + below[0] + below[1]
            }
        }
    }
}

/// The measured law behind `sah` and against `volume`: lines of all directions and positions, and what they cost on
/// average.
#[test]
fn lines_meet_cells_by_their_area_and_not_by_their_volume() {
    let triangles = scene("knot.obj");
    let options = BuildOptions { leaf_size: 16, ..options_of(Build::Sah, &triangles) };
    let tree = grow(Build::Sah, &triangles, &options);
    let root = Node::root(&tree);
    let (centre, radius) = ((root.low + root.high) / 2.0, (root.high - root.low).length() / 2.0);
    let mut random = Random::new(SEED);
    // A line through two random points of a sphere is a random line through it (Crofton's measure).
    let mut on_sphere = || loop {
        let point = DVec3::from(random.vec3());
        if (0.01..1.0).contains(&point.length_squared()) {
            return centre + point.normalize() * radius;
        }
    };
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for _ in 0..40_000 {
        let (a, b) = (on_sphere(), on_sphere());
        let cost = root.cost_of_line(a, b - a, &options);
        if cost > 0.0 {
            (sum, squares, count) = (sum + cost, squares + cost * cost, count + 1.0);
        }
    }
    let mean: f64 = sum / count;
    let error: f64 = ((squares / count - mean * mean) / count).sqrt();
    let [by_area, by_volume] = [Measure::Surface, Measure::Volume].map(|law| expected_cost(&tree, law, &options));
    println!("measured {mean} ± {error}, expected by area {by_area}, by volume {by_volume}");
    assert!((mean - by_area).abs() < 5.0 * error, "{mean} ± {error} instead of {by_area} (seed {SEED})");
    assert!((mean - by_volume).abs() > 20.0 * error, "{mean} ± {error} and {by_volume} (seed {SEED})");
    assert_eq!(by_area, TreeStats::new(&tree, &options).sah_cost);
}

#[test]
fn volumes_promise_less_and_cost_more() {
    for name in ["knot.obj", "vase.obj", "showcase.toml"] {
        let triangles = scene(name);
        // With the bonus of Wald and Havran: with less the greedy choice may lose by its own law, too.
        let [of_areas, of_volumes] = [Build::Sah, Build::Volume].map(|build| options_of(build, &triangles));
        assert_eq!(of_areas, of_volumes, "only the measure differs");
        let options = BuildOptions { empty_bonus: 0.2, ..of_areas };
        let [sah, volume] = [Build::Sah, Build::Volume].map(|build| grow(build, &triangles, &options));
        let [[sah_area, sah_volume], [volume_area, volume_volume]] =
            [&sah, &volume].map(|tree| [Measure::Surface, Measure::Volume].map(|m| expected_cost(tree, m, &options)));
        println!("{name}: by area {sah_area} (sah) {volume_area} (volume); by volume {sah_volume}, {volume_volume}");
        assert!(volume_area > sah_area, "{name}: {volume_area} {sah_area}");
        assert!(volume_volume < sah_volume, "{name}: {volume_volume} {sah_volume}");
        assert!(volume.nodes.len() > sah.nodes.len(), "{name}: {} {}", volume.nodes.len(), sah.nodes.len());
    }
}

#[test]
fn a_sampled_median_is_as_close_as_its_size_allows() {
    let mut random = Random::new(SEED);
    for size in [10, 100, 1000] {
        // How far off the rank of the root's plane is, in standard deviations, 1/(2 sqrt n); its square has mean 1,
        // variance 2.
        let deviations: Vec<f64> = (0..50)
            .map(|_| {
                let triangles = soup(5000, 0.01, &mut random);
                let options =
                    BuildOptions { max_depth: 1, sample_size: size, ..options_of(Build::SampledMedian, &triangles) };
                let root = grow(Build::SampledMedian, &triangles, &options).nodes[0];
                let below = triangles.iter().filter(|&&[a, b, c]| (a + b + c).x < 3.0 * root.split).count();
                (below as f64 / triangles.len() as f64 - 0.5) * 2.0 * f64::from(size).sqrt()
            })
            .collect();
        let n = deviations.len() as f64;
        let square: f64 = deviations.iter().map(|d| d * d).sum();
        println!("size {size}: variance {}", square / n);
        assert!(deviations.iter().all(|d| d.abs() < 5.0), "{size}: {deviations:?} (seed {SEED})");
        assert!((square - n).abs() < 5.0 * (2.0 * n).sqrt(), "{size}: {deviations:?} (seed {SEED})");
    }
}

#[test]
fn a_sample_of_all_is_the_median() {
    for triangles in [scene("knot.obj"), soup(500, 0.2, &mut Random::new(SEED))] {
        let median = grow(Build::Median, &triangles, &options_of(Build::Median, &triangles));
        let base = options_of(Build::SampledMedian, &triangles);
        for (sample_size, is_same) in [(triangles.len() as u32, true), (u32::MAX, true), (20, false)] {
            let sampled = grow(Build::SampledMedian, &triangles, &BuildOptions { sample_size, ..base });
            assert_eq!(sampled == median, is_same, "{sample_size} of {}", triangles.len());
        }
    }
}

#[test]
fn the_spatial_median_is_the_middle() {
    for triangles in [scene("knot.obj"), soup(500, 0.2, &mut Random::new(SEED)), sheet(16)] {
        let options = options_of(Build::SpatialMedian, &triangles);
        let mut planes = 0;
        Node::root(&grow(Build::SpatialMedian, &triangles, &options)).for_each_split(&mut |node, axis, plane, _, _| {
            assert_eq!(plane, (node.low[axis] as f32) * 0.5 + (node.high[axis] as f32) * 0.5);
            planes += 1;
        });
        assert!(planes > 20, "{planes}");
    }
}

#[test]
fn axes_come_in_turn_or_by_length() {
    // Triangles so small that no split is refused, in a box of 1 x 5 x 2.
    let triangles: Triangles = soup(3000, 0.003, &mut Random::new(SEED))
        .into_iter()
        .map(|triangle| triangle.map(|p| p * Vec3::new(1.0, 5.0, 2.0)))
        .collect();
    for build in MEDIANS {
        for split_axis in [SplitAxis::Turn, SplitAxis::Longest] {
            let options = BuildOptions { split_axis, ..options_of(build, &triangles) };
            let root = Node::root(&grow(build, &triangles, &options));
            root.for_each_split(&mut |node, axis, _, _, _| {
                let size = node.high - node.low;
                match split_axis {
                    SplitAxis::Longest => assert_eq!(size[axis], size.max_element(), "{build}, depth {}", node.depth),
                    _ => assert_eq!(axis, node.depth as usize % 3, "{build}"),
                }
            });
            assert!(root.split.is_some());
        }
    }
}

/// The share of a node's triangles that both children keep.
fn similarity(node: &Node, left: &Node, right: &Node) -> f32 {
    left.triangles.len().min(right.triangles.len()) as f32 / node.triangles.len() as f32
}

#[test]
fn no_children_are_more_alike_than_allowed() {
    let triangles = soup(600, 0.4, &mut Random::new(SEED));
    for build in MEDIANS {
        let mut most_alike = 0f32;
        for share in [0.3, 0.6, 0.8, 0.95, 1.0] {
            let options = BuildOptions { similar_children: share, leaf_size: 4, ..options_of(build, &triangles) };
            most_alike = 0.0;
            Node::root(&grow(build, &triangles, &options)).for_each_split(&mut |node, _, _, left, right| {
                most_alike = most_alike.max(similarity(node, left, right));
            });
            assert!(most_alike <= share, "{build}: {most_alike} > {share}");
        }
        assert!(most_alike > 0.95, "{build}: nothing was alike, so nothing was tested");
    }
}

/// One triangle is on the left alone, one on the right, and 18 are on both sides of every plane between them.
#[test]
fn a_share_that_is_met_exactly_is_allowed_in_every_build() {
    let spanning = |from: f32, to: f32| {
        [Vec3::new(from, -1.0, -1.0), Vec3::new(to, 1.0, 1.0), Vec3::new((from + to) / 2.0, 1.0, -1.0)]
    };
    let mut triangles = vec![spanning(-1.0, -0.5), spanning(0.5, 1.0)];
    triangles.extend([spanning(-1.0, 1.0); 18]);
    for &build in Build::ALL {
        for (share, is_split) in [(1.0, true), (0.95, true), (0.949, false), (0.0, false)] {
            let options = BuildOptions {
                stop: Stop::Size,
                similar_children: share,
                max_depth: 1,
                ..options_of(build, &triangles)
            };
            let tree = grow(build, &triangles, &options);
            assert_eq!(tree.nodes.len() == 3, is_split, "{build} with {share}: {:?}", tree.nodes);
        }
    }
}

#[test]
fn a_split_that_does_not_pay_is_not_made() {
    let triangles = soup(600, 0.4, &mut Random::new(SEED));
    for build in MEDIANS {
        let by_size = BuildOptions { leaf_size: 1, ..options_of(build, &triangles) };
        // A node's saving of a split, for the worst one of the tree, relative to its cost as a leaf.
        let worst = |options: &BuildOptions| {
            let mut worst = f64::INFINITY;
            Node::root(&grow(build, &triangles, options)).for_each_split(&mut |node, _, _, left, right| {
                let tests = |child: &Node| child.half_area() / node.half_area() * child.triangles.len() as f64;
                let bonus =
                    if left.triangles.is_empty() || right.triangles.is_empty() { options.empty_bonus } else { 0.0 };
                let intersect = f64::from(options.cost_intersect);
                let split = f64::from(options.cost_traverse) + intersect * (tests(left) + tests(right));
                let leaf = intersect * node.triangles.len() as f64;
                worst = worst.min(1.0 - split * (1.0 - f64::from(bonus)) / leaf);
            });
            worst
        };
        assert!(worst(&by_size) < 0.0, "{build}: every split pays, so nothing was tested");
        for (cost_traverse, cost_intersect, empty_bonus) in [(1.0, 1.0, 0.2), (0.0, 1.0, 0.0), (3.0, 0.5, 1.0)] {
            let by_cost = BuildOptions { stop: Stop::Cost, cost_traverse, cost_intersect, empty_bonus, ..by_size };
            // The costs here and there are equal up to some roundings of f64.
            assert!(worst(&by_cost) > -1e-12, "{build}: {} {by_cost:?}", worst(&by_cost));
        }
    }
}

#[test]
fn costs_change_the_tree_as_they_should() {
    let triangles = scene("knot.obj");
    for &build in Build::ALL {
        let base = BuildOptions { stop: Stop::Cost, leaf_size: 1, ..options_of(build, &triangles) };
        let stats = |options: &BuildOptions| TreeStats::new(&grow(build, &triangles, options), options);

        // Only the ratio counts; a power of two changes no rounding.
        let fourfold = BuildOptions { cost_traverse: 4.0, cost_intersect: 4.0, ..base };
        assert_eq!(grow(build, &triangles, &fourfold), grow(build, &triangles, &base), "{build}");
        assert_eq!(stats(&fourfold).sah_cost, 4.0 * stats(&base).sah_cost, "{build}");

        // The dearer a step, the fewer; at the price of all triangles there is none.
        let all = triangles.len() as f32;
        let nodes = [0.0, 1.0, 4.0, 30.0, all].map(|cost| stats(&BuildOptions { cost_traverse: cost, ..base }).nodes);
        assert!(nodes.is_sorted_by(|a, b| a > b) && nodes[4] == 1, "{build}: {nodes:?}");
        let nodes = [0.25, 1.0, 4.0].map(|cost| stats(&BuildOptions { cost_intersect: cost, ..base }).nodes);
        assert!(nodes.is_sorted_by(|a, b| a < b), "{build}: {nodes:?}");

        // Without regard to cost a tree grows to its limits; that costs more than it saves.
        let by_size = stats(&BuildOptions { stop: Stop::Size, ..base });
        assert!(by_size.nodes > stats(&base).nodes, "{build}: {by_size:?}");
        assert!(by_size.sah_cost > stats(&base).sah_cost, "{build}: {by_size:?} {:?}", stats(&base));
    }
    // What the bonus is for: more of the space is cut off empty.
    for build in [Build::Sah, Build::Volume] {
        let [none, some, much] = [0.0, 0.2, 0.8].map(|empty_bonus| {
            let options = BuildOptions { empty_bonus, ..options_of(build, &triangles) };
            let mut empty = 0.0;
            let root = Node::root(&grow(build, &triangles, &options));
            root.for_each_split(&mut |_, _, _, left, right| {
                empty += [left, right].iter().filter(|n| n.triangles.is_empty()).map(|n| n.half_area()).sum::<f64>();
            });
            empty
        });
        assert!(none < some && some < much, "{build}: {none} {some} {much}");
    }
}

#[test]
fn by_size_leaves_are_as_large_as_allowed() {
    let triangles = soup(3000, 0.003, &mut Random::new(SEED));
    for &build in Build::ALL {
        for leaf_size in [1, 5, 60] {
            let options = BuildOptions { stop: Stop::Size, leaf_size, max_depth: 60, ..options_of(build, &triangles) };
            let stats = TreeStats::new(&grow(build, &triangles, &options), &options);
            println!("{build}, {leaf_size}: {stats:?}");
            assert!(stats.largest_leaf <= leaf_size, "{build}, {leaf_size}: {stats:?}");
        }
    }
}
