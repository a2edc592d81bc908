//! A binary bounding volume hierarchy as `cl/traverse/bvh2.cl` reads it: both children's boxes in their parent, 64
//! bytes a node.
//!
//! Aila and Laine, "Understanding the Efficiency of Ray Traversal on GPUs", High Performance Graphics 2009. Four
//! records a node:
//!
//! ```text
//! middle0.x  half0.x  middle0.y  half0.y     the box of child 0: its middle and half of its size
//! middle1.x  half1.x  middle1.y  half1.y     of child 1
//! link0      link1    middle0.z  half0.z     of child 0
//! middle1.z  half1.z  0          0           of child 1
//!
//! link:  bit 31 clear   an inner node's number; its first record is four times that
//!        bit 31 set     a leaf: bits 0-26 its first reference, bits 27-30 how many there are; with instances a
//!                       leaf of none is the instance whose number is one less
//! ```
//!
//! A box is larger than what it holds by some padding on all sides (`cl/shared/slab.cl`), and by what its numbers are
//! rounded.
//!
//! Links lie among numbers of boxes: beside each other alone, a GPU's compiler moves their load behind the tests, and
//! its time adds to each step's.
//!
//! Child 0 is the one that is best searched first where any hit will do (`bvh/worth.rs`), or else the larger one.
//!
//! A node of which there is only one child, the root of a tree of one leaf, has a leaf without triangles for the other,
//! in a box that no ray enters.

use super::bvh::{Bvh, MAX_TRIANGLES, check_triangle_count};
use super::link::{self, NO_CHILD, leaf_link, leaf_range};
use super::{Aabb, Padding, StructureArrays};
use crate::error::Result;
use crate::options::{BvhOptions, StructureKind};
use crate::shared::{BVH_FIRST_MASK, BVH_NODE_RECORDS, KdNode};
use glam::Vec3;
use std::ops::Range;

/// The record of a node that has the links.
const LINKS: usize = 2;

const _: () = assert!(MAX_TRIANGLES < BVH_FIRST_MASK as usize);

/// A box by its middle and half of its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Middle {
    pub middle: Vec3,
    pub half_size: Vec3,
}

/// As that of `bvh8.rs`.
pub(crate) const NOWHERE: Middle = Middle { middle: Vec3::ZERO, half_size: Vec3::splat(-FAR) };
/// What no box of a scene reaches to.
pub(super) const FAR: f32 = (1u128 << 64) as f32;

impl Middle {
    /// A box that holds this one with `padding` on all sides.
    pub fn new(bounds: &Aabb, padding: f32) -> Middle {
        let middle = 0.5 * bounds.low + 0.5 * bounds.high;
        let beyond = |axis: usize| {
            let from = |plane: f32| (f64::from(plane) - f64::from(middle[axis])).abs();
            rounded_up(from(bounds.low[axis]).max(from(bounds.high[axis])) + f64::from(padding))
        };
        Middle { middle, half_size: Vec3::new(beyond(0), beyond(1), beyond(2)) }
    }
}

/// The least float that is not below it, or the next one.
fn rounded_up(x: f64) -> f32 {
    let rounded = x as f32;
    if f64::from(rounded) < x { rounded.next_up() } else { rounded }
}

/// Packs `tree`, depth first as it is, but for its `top` uppermost nodes (level by level), which come before all
/// others; its boxes larger by their `padding` on all sides. `worths`: of all nodes (`bvh/worth.rs`); none, and the
/// children keep the tree's order.
///
/// # Errors
/// [`Error::Option`](crate::Error::Option) when a leaf has more than [`BvhOptions::MAX_LEAF`] triangles,
/// [`Error::Scene`](crate::Error::Scene) when all leaves together have more than 2^27 - 16.
pub fn pack_bvh2(tree: &Bvh, worths: &[f32], top: usize, padding: impl Into<Padding>) -> Result<StructureArrays> {
    let padding = padding.into();
    check_triangle_count(tree.order.len(), MAX_TRIANGLES)?;
    tree.check_leaves(StructureKind::Bvh2, BvhOptions::MAX_LEAF)?;
    let mut references = Vec::with_capacity(tree.order.len());
    // What links to each node say.
    let mut links = vec![0; tree.nodes.len()];
    let order = numbered(tree, top);
    for (number, &index) in order.iter().enumerate() {
        links[index as usize] = number as u32;
    }
    for (index, link) in links.iter_mut().enumerate().filter(|(index, _)| tree.nodes[*index].is_leaf()) {
        let triangles = tree.triangles(index);
        *link = leaf_link(references.len() as u32, triangles.len() as u32);
        references.extend_from_slice(triangles);
    }
    let nowhere = (NOWHERE, NO_CHILD);
    let child = |index: usize| {
        let bounds = &tree.nodes[index].bounds;
        (Middle::new(bounds, padding.of(bounds)), links[index])
    };
    let mut nodes = Vec::with_capacity(BVH_NODE_RECORDS as usize * order.len().max(1));
    for &index in &order {
        nodes.extend(records(by_worth(tree.children(index as usize), worths).map(child)));
    }
    if order.is_empty() {
        let only = if tree.nodes.is_empty() { nowhere } else { child(0) };
        nodes.extend(records([only, nowhere]));
    }
    Ok(StructureArrays { nodes, references, bounds: Vec::new() })
}

/// Two children, the one of more worth first.
fn by_worth([a, b]: [usize; 2], worths: &[f32]) -> [usize; 2] {
    if !worths.is_empty() && worths[b] > worths[a] { [b, a] } else { [a, b] }
}

/// The inner nodes in their order in memory.
fn numbered(tree: &Bvh, top: usize) -> Vec<u32> {
    let is_inner = |index: &usize| !tree.nodes[*index].is_leaf();
    let mut is_taken = vec![false; tree.nodes.len()];
    let mut order = Vec::new();
    let mut level: Vec<usize> = (0..tree.nodes.len().min(1)).filter(is_inner).collect();
    while !level.is_empty() && order.len() < top {
        level.truncate(top - order.len());
        for &index in &level {
            is_taken[index] = true;
            order.push(index as u32);
        }
        level = level.iter().flat_map(|&index| tree.children(index)).filter(is_inner).collect();
    }
    order.extend((0..tree.nodes.len()).filter(is_inner).filter(|&index| !is_taken[index]).map(|index| index as u32));
    order
}

fn records([(box0, link0), (box1, link1)]: [(Middle, u32); 2]) -> [KdNode; BVH_NODE_RECORDS as usize] {
    let numbers =
        |[a, b, c, d]: [f32; 4]| KdNode { flags: a.to_bits(), left: b.to_bits(), right: c.to_bits(), split: d };
    let xy = |b: Middle| numbers([b.middle.x, b.half_size.x, b.middle.y, b.half_size.y]);
    [
        xy(box0),
        xy(box1),
        KdNode { flags: link0, left: link1, right: box0.middle.z.to_bits(), split: box0.half_size.z },
        numbers([box1.middle.z, box1.half_size.z, 0.0, 0.0]),
    ]
}

/// Renumbers what links lead to: nodes are `first_node` further on, and leaves have the links that `leaf` makes of
/// their references.
pub fn move_links(nodes: &mut [KdNode], leaf: impl Fn(Range<usize>) -> u32, first_node: u32) {
    let links = nodes.chunks_exact_mut(BVH_NODE_RECORDS as usize).map(|records| &mut records[LINKS]);
    for link in links.flat_map(|record| [&mut record.flags, &mut record.left]).filter(|link| **link != NO_CHILD) {
        *link = leaf_range(*link).map_or(*link + first_node, &leaf);
    }
}

/// How many triangles each leaf has.
pub(super) fn leaf_counts(nodes: &[KdNode]) -> impl Iterator<Item = u32> {
    let nodes = nodes.chunks_exact(BVH_NODE_RECORDS as usize);
    link::leaf_counts(nodes.flat_map(|records| [records[LINKS].flags, records[LINKS].left]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::bvh::{before_a_wall, worths};
    use crate::accel::{BuildOptions, build_bvh};
    use crate::bounds::EPSILON;
    use crate::random::Random;

    fn tree(count: usize, leaf_size: u32) -> (Bvh, Vec<[Vec3; 3]>) {
        let triangle = |i: usize| {
            let at = Vec3::new((i * 37 % 101) as f32, (i * 53 % 103) as f32, (i * 71 % 97) as f32);
            [at, at + Vec3::X, at + Vec3::Y]
        };
        let vertices: Vec<_> = (0..count).map(triangle).collect();
        let options = BvhOptions { leaf_size: Some(leaf_size), ..BvhOptions::DEFAULT };
        let primitives: Vec<_> = (0..count as u32).collect();
        (build_bvh(&vertices, &primitives, &BuildOptions::bvh(&options, StructureKind::Bvh2)).unwrap(), vertices)
    }

    /// The boxes and links of a node, from its records.
    fn children(structure: &StructureArrays, number: usize) -> [(Middle, u32); 2] {
        let records = &structure.nodes[4 * number..][..4];
        let numbers = |record: &KdNode| bytemuck::cast::<KdNode, [f32; 4]>(*record);
        let [xy0, xy1, z0, z1] = [0, 1, 2, 3].map(|i| numbers(&records[i]));
        let of = |xy: [f32; 4], z: &[f32]| Middle {
            middle: [xy[0], xy[2], z[0]].into(),
            half_size: [xy[1], xy[3], z[1]].into(),
        };
        [(of(xy0, &z0[2..]), records[LINKS].flags), (of(xy1, &z1[..2]), records[LINKS].left)]
    }

    #[test]
    fn links_lead_to_every_node_and_triangle_with_the_boxes_of_the_tree() {
        for (count, top) in [(0, 0), (1, 0), (2, 0), (3, 100), (500, 0), (500, 1), (500, 40), (500, 10_000)] {
            let (tree, vertices) = tree(count, 4);
            let padding = [0.0, 1e-4][count % 2];
            let worths = worths(&tree, &vertices);
            let structure = pack_bvh2(&tree, &worths, top, padding).unwrap();
            let inner = tree.nodes.iter().filter(|node| !node.is_leaf()).count();
            assert_eq!(structure.nodes.len(), 4 * inner.max(1));
            let mut seen = vec![false; count];
            let mut visited = 0;
            let mut open = vec![(0, (inner > 0).then_some(0))];
            while let Some((number, index)) = open.pop() {
                visited += 1;
                for (i, (bounds, link)) in children(&structure, number).into_iter().enumerate() {
                    let child = index.map_or(0, |index| by_worth(tree.children(index), &worths)[i]);
                    if link == NO_CHILD {
                        assert_eq!(bounds, NOWHERE);
                        continue;
                    }
                    assert_eq!(bounds, Middle::new(&tree.nodes[child].bounds, padding));
                    let Some(leaf) = link::leaf_range(link) else {
                        open.push((link as usize, Some(child)));
                        continue;
                    };
                    let list = &structure.references[leaf];
                    assert_eq!(list, tree.triangles(child));
                    list.iter().for_each(|&triangle| assert!(!std::mem::replace(&mut seen[triangle as usize], true)));
                }
            }
            assert_eq!(visited, inner.max(1));
            assert!(seen.iter().all(|&seen| seen));
            assert_eq!(leaf_counts(&structure.nodes).sum::<u32>() as usize, count);
        }
    }

    /// Rays for which any hit will do go to child 0 first.
    #[test]
    fn a_wall_behind_small_triangles_is_the_first_child() {
        let (tree, vertices) = before_a_wall(StructureKind::Bvh2, None);
        let structure = pack_bvh2(&tree, &worths(&tree, &vertices), 0, 0.0).unwrap();
        let mut link = 0;
        let leaf = loop {
            link = children(&structure, link as usize)[0].1;
            if let Some(leaf) = leaf_range(link) {
                break leaf;
            }
        };
        assert!(structure.references[leaf].contains(&(vertices.len() as u32 - 1)));
    }

    #[test]
    fn boxes_hold_what_they_are_made_of_and_hardly_more() {
        let mut random = Random::new(20_081_121);
        for i in 0..100_000 {
            let (p, q) = (random.vec3() * 2f32.powi(i % 40 - 30), random.vec3());
            let q = if i % 3 == 0 { p } else { q };
            let bounds = Aabb { low: p.min(q), high: p.max(q) };
            let padding = [0.0, 1e-5, 1e-3][i as usize / 3 % 3];
            let Middle { middle, half_size } = Middle::new(&bounds, padding);
            for axis in 0..3 {
                let at = f64::from(middle[axis]);
                let [low, high] = [bounds.low, bounds.high].map(|corner| f64::from(corner[axis]));
                let beyond = [low - (at - f64::from(half_size[axis])), at + f64::from(half_size[axis]) - high];
                // The middle is rounded once, the half size once.
                let most =
                    f64::from(padding) + 2.5 * f64::from(EPSILON) * (low.abs().max(high.abs()) + f64::from(padding));
                assert!(
                    beyond.iter().all(|&x| x >= f64::from(padding) && x <= most),
                    "{bounds:?} {padding}: {beyond:?}"
                );
            }
        }
    }

    #[test]
    fn what_links_have_no_room_for_is_refused() {
        let large = pack_bvh2(&Bvh::of_one_leaf(16), &[], 0, 0.0).map(drop).unwrap_err().to_string();
        assert!(large.starts_with("option leaf_size: there is a leaf of 16 triangles"), "{large}");
        let limit = MAX_TRIANGLES;
        check_triangle_count(limit, limit).unwrap();
        let many = check_triangle_count(limit + 1, limit).unwrap_err();
        assert!(many.exit_code() == 3 && many.to_string().contains("134217713 triangles"), "{many}");
        assert!(many.to_string().ends_with("; take `structure = kd`"), "{many}");
    }

    #[test]
    fn the_top_of_the_tree_comes_first_level_by_level() {
        let (tree, _) = tree(500, 1);
        let order = numbered(&tree, 7);
        let level = |nodes: &[u32]| -> Vec<u32> {
            nodes.iter().flat_map(|&index| tree.children(index as usize)).map(|index| index as u32).collect()
        };
        assert_eq!(order[0], 0);
        assert_eq!(order[1..3], level(&order[..1]));
        assert_eq!(order[3..7], level(&order[1..3]));
        assert!(order[7..].is_sorted());
        assert!(numbered(&tree, 0).is_sorted());
    }
}
