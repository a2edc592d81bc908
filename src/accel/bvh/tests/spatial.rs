//! Trees with splits of space.

use super::*;
use glam::DVec3;

/// Long thin oblique triangles around one of their ends.
fn fan(count: usize) -> Triangles {
    let blade = |i: usize| {
        let angle = i as f32 / count as f32 * std::f32::consts::TAU;
        let (end, aside) = (Vec3::new(angle.cos(), angle.sin(), (3.0 * angle).sin()), Vec3::new(0.0, 0.0, 1e-3));
        [Vec3::ZERO, end, end + aside]
    };
    (0..count).map(blade).collect()
}

/// Such triangles side by side.
fn stripes(count: usize) -> Triangles {
    let stripe = |i: usize| [Vec3::ZERO, Vec3::ONE, Vec3::new(1.0, 1.0, 1.001)].map(|p| p + Vec3::X * i as f32 * 0.01);
    (0..count).map(stripe).collect()
}

/// Scenes of which some are made to be cut, and some to be cut badly.
fn cut_scenes() -> Vec<(&'static str, Triangles)> {
    let mut all = scenes();
    let huge = [Vec3::new(-9.0, -8.0, -7.0), Vec3::new(9.0, -6.0, 8.0), Vec3::new(-5.0, 9.0, 6.0)];
    let needles = soup(400, 1.0).into_iter().map(|[a, b, c]| [a, b, b + (c - b) * 1e-6]);
    let beams = (0..300).map(|i| (i % 10, i / 10)).map(|(i, k)| {
        let (at, along) = (Vec3::new(0.1 * i as f32, 0.2 * k as f32, 0.0), Vec3::AXES[i % 3]);
        [at, at + along * 7.0, at + along * 7.0 + Vec3::AXES[(i + 1) % 3] * 1e-4]
    });
    all.extend([
        ("fan", fan(500)),
        ("stripes", stripes(500)),
        ("needles", needles.collect()),
        ("beams along the axes", beams.collect()),
        ("a huge one among tiny ones", std::iter::once(huge).chain(soup(2000, 0.01)).collect()),
        ("oblique duplicates", vec![huge; 700]),
        ("far away", soup(400, 1.0).into_iter().map(|t| t.map(|p| p + Vec3::new(1e6, -2e6, 3e5))).collect()),
    ]);
    all
}

fn cutting(splits: impl Into<SpatialSplits>, leaf_size: Option<u32>, reinsert: u32) -> BuildOptions {
    BuildOptions { spatial_splits: splits.into(), reinsert, ..options(leaf_size) }
}

/// Whether the point, known up to `error`, is in the boxes of a leaf that lists the triangle and of all nodes from
/// there up to `index`.
fn is_listed(tree: &Bvh, index: usize, triangle: u32, point: DVec3, error: f64) -> bool {
    let Aabb { low, high } = tree.nodes[index].bounds;
    if point.cmplt(low.as_dvec3() - error).any() || point.cmpgt(high.as_dvec3() + error).any() {
        return false;
    }
    if tree.nodes[index].is_leaf() {
        return tree.triangles(index).contains(&triangle);
    }
    tree.children(index).into_iter().any(|child| is_listed(tree, child, triangle, point, error))
}

#[test]
fn every_point_of_a_triangle_is_in_a_leaf_that_lists_it() {
    const POINTS: usize = 12;
    let mut cut = 0;
    for (name, triangles) in cut_scenes() {
        for (share, leaf_size, reinsert) in [(0.1, None, 5), (0.5, Some(1), 0), (4.0, Some(2), 9)] {
            let options = cutting(share, leaf_size, reinsert);
            let tree = build_bvh(&triangles, &all(&triangles), &options).unwrap();
            let times = check_nodes(name, &triangles, options.leaf_size, &tree);
            let whole = triangles.iter().map(Aabb::of_triangle).fold(Aabb::EMPTY, Aabb::union);
            assert!(triangles.is_empty() || tree.nodes[0].bounds == whole, "{name}: {:?}", tree.nodes[0].bounds);
            let budget = (f64::from(share) * triangles.len() as f64) as usize;
            assert!(tree.order.len() <= triangles.len() + budget, "{name}: {} references", tree.order.len());
            cut += times.iter().filter(|&&times| times > 1).count();
            let mut random = Random::new(7);
            for (i, triangle) in triangles.iter().enumerate() {
                let corners = triangle.map(|p| p.as_dvec3());
                let largest = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
                for k in 0..POINTS {
                    // The corners, points of an edge, others.
                    let [u, v] = match k {
                        0..3 => [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k],
                        3..6 => [f64::from(random.unit()), 0.0],
                        _ => [random.unit(), random.unit()].map(f64::from),
                    };
                    let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                    let point = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
                    // Three roundings of weights and products each, two of sums, of numbers up to the largest
                    // coordinate.
                    let error = 8.0 * f64::EPSILON * largest;
                    assert!(is_listed(&tree, 0, i as u32, point, error), "{name}: {triangle:?}, {point}");
                }
            }
        }
    }
    assert!(cut > 5000, "only {cut} triangles are in several leaves");
}

#[test]
fn cut_triangles_depend_neither_on_threads_nor_on_the_order_of_triangles() {
    let long: Triangles = soup(40_000, 1.0).into_iter().map(|[a, b, c]| [a, b, b + (c - b) * 1e-3]).collect();
    for (name, triangles, splits) in [
        ("long", long, SpatialSplits::Share(0.3)),
        ("mixed", small_and_large(4000), SpatialSplits::Share(0.3)),
        ("fan", fan(3000), SpatialSplits::Auto),
    ] {
        let options = cutting(splits, None, 5);
        let in_threads = |threads: usize, primitives: &[u32]| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| build_bvh(&triangles, primitives, &options).unwrap())
        };
        let mut order = all(&triangles);
        let expected = in_threads(1, &order);
        assert!(expected.order.len() > triangles.len(), "{name}: nothing is cut");
        assert!(in_threads(2, &order) == expected, "{name}: 2 threads");
        assert!(in_threads(7, &order) == expected, "{name}: 7 threads");
        order.reverse();
        assert!(in_threads(2, &order) == expected, "{name}: order");
    }
}

#[test]
fn long_oblique_triangles_cost_less_when_they_are_cut() {
    let scenes = [("fan", fan(2000)), ("stripes", stripes(2000)), ("large among small", small_and_large(5000))];
    for (name, triangles) in scenes {
        for reinsert in [0, 5] {
            let cost = |share: f32| {
                let options = cutting(share, None, reinsert);
                build_bvh(&triangles, &all(&triangles), &options).unwrap().expected_cost(&options)
            };
            let costs = [0.0, 2.0].map(cost);
            println!("{name}, {reinsert} passes: {costs:?}");
            assert!(costs[1] < costs[0], "{name}: {costs:?}");
        }
    }
}

#[test]
fn a_share_of_less_than_a_triangle_changes_nothing() {
    let triangles = fan(500);
    let build = |share: f32| build_bvh(&triangles, &all(&triangles), &cutting(share, None, 5)).unwrap();
    assert!(build(0.0019) == build(0.0) && build(0.1) != build(0.0));
}

/// A sheet of small squares with slight waves.
fn squares(side: usize) -> Triangles {
    let at = |x: usize, y: usize| Vec3::new(x as f32, y as f32, 0.3 * ((3 * x + 5 * y) as f32).sin());
    let cells = (0..side * side).map(|i| (i % side, i / side));
    let halves = |(x, y)| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
        [[a, b, c], [b, d, c]]
    };
    cells.flat_map(halves).collect()
}

#[test]
fn splits_are_kept_where_they_pay_and_the_tree_is_that_of_the_share() {
    let named = |wanted: &str| cut_scenes().into_iter().find(|(name, _)| *name == wanted).unwrap();
    for ((name, triangles), pay, are_there) in [
        (("long oblique triangles", fan(2000)), true, true),
        (("the same side by side", stripes(2000)), true, true),
        (named("one centroid"), true, true),
        // A hundredth of its triangles is cut, which saves less than a hundredth of the cost.
        (named("soup"), false, true),
        (("squares", squares(40)), false, false),
        (named("one"), false, false),
        (named("empty"), false, false),
    ] {
        let build = |splits: SpatialSplits| build_bvh(&triangles, &all(&triangles), &cutting(splits, None, 5)).unwrap();
        let [without, with, chosen] =
            [SpatialSplits::NONE, SpatialSplits::AUTO_SHARE.into(), SpatialSplits::Auto].map(build);
        assert_eq!(with != without, are_there, "{name}");
        let expected = if pay { with } else { without };
        assert!(chosen.nodes == expected.nodes && chosen.order == expected.order, "{name}: {:?}", chosen.splits_ratio);
        assert!(expected.splits_ratio.is_none() && chosen.splits_ratio.is_some(), "{name}");
    }
}
