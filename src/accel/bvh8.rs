//! A bounding volume hierarchy of eight children a node as `cl/traverse/bvh8.cl` reads it, made of a binary one.
//!
//! Dammertz, Hanika and Keller, "Shallow Bounding Volume Hierarchies for Fast SIMD Ray Tracing of Incoherent Rays",
//! Eurographics Symposium on Rendering 2008: a node's largest child that is no leaf makes way for its own two until
//! there are eight. Sixteen records a node:
//!
//! ```text
//! low.x of the eight children, two records; high.x; low.y; high.y; low.z; high.z
//! links, two records
//! two that are unused, so that a node starts with a cache line
//!
//! link:  bit 31 clear   an inner node's number; its first record is sixteen times that
//!        bit 31 set     a leaf: bits 0-26 its first reference, a multiple of eight, bits 27-30 how many there are
//! ```
//!
//! Of the children that is the first which is best searched first where any hit will do (`bvh/worth.rs`).
//!
//! A leaf's triangles are in `bounds`, too: `leaf_packets.rs`.

use super::bvh::{Bvh, worths};
use super::bvh2::FAR;
use super::leaf_packets::{WIDTH, pack, push_leaf};
use super::link::{self, NO_CHILD, leaf_link};
use super::{Aabb, Padding, StructureArrays};
use crate::error::{Error, Result};
use crate::options::{BvhOptions, StructureKind};
use crate::shared::{BVH_FIRST_MASK, BVH8_LINKS, BVH8_NODE_RECORDS, KdNode};
use glam::Vec3;

// A node has as many children as a packet triangles.
const _: () = assert!(BvhOptions::BVH8_MAX_LEAF as usize == WIDTH);

/// Upside down, and finite, so that slabs of it are numbers; `cl/shared/slab.cl` tests no ray that comes from so far
/// away.
const NOWHERE: Aabb = Aabb { low: Vec3::splat(FAR), high: Vec3::splat(-FAR) };

/// The most leaves: of the numbers of references that a link has room for each takes eight.
const MAX_LEAVES: usize = (BVH_FIRST_MASK as usize + 1) / WIDTH;

/// A packed tree, and how deep it is.
pub struct Bvh8 {
    /// As the kernels read it.
    pub structure: StructureArrays,
    /// The most entries of a traversal's stack.
    pub stack_entries: u32,
}

/// Packs `tree`, of the triangles `vertices`; its boxes larger by their `padding` on all sides.
///
/// # Errors
/// [`Error::Option`] when a leaf has more than [`BvhOptions::BVH8_MAX_LEAF`] triangles, [`Error::Scene`] when there are
/// more than 2^24 leaves.
pub fn pack_bvh8(tree: &Bvh, vertices: &[[Vec3; 3]], padding: Padding) -> Result<Bvh8> {
    pack_leaves(tree, vertices, padding, MAX_LEAVES)
}

/// Packs a tree of at most `most_leaves`.
fn pack_leaves(tree: &Bvh, vertices: &[[Vec3; 3]], padding: Padding, most_leaves: usize) -> Result<Bvh8> {
    tree.check_leaves(StructureKind::Bvh8, BvhOptions::BVH8_MAX_LEAF)?;
    let leaf_count = tree.nodes.iter().filter(|node| node.is_leaf()).count();
    if leaf_count > most_leaves {
        let reason = format!(
            "its hierarchy of boxes has {leaf_count} leaves, and `structure = bvh8` can number {most_leaves}; take \
             `structure = bvh2`"
        );
        return Err(Error::Scene(reason));
    }
    let mut nodes: Vec<KdNode> = Vec::new();
    let mut references = Vec::new();
    let mut deepest = 0;
    // Inner nodes of the binary tree whose wide node is still to be written: number, index, depth.
    let mut open = vec![(0, 0, 1)];
    let mut numbered = 1;
    let worths = worths(tree, vertices);
    while let Some((number, index, depth)) = open.pop() {
        deepest = deepest.max(depth);
        let mut boxes = [NOWHERE; WIDTH];
        let mut links = [NO_CHILD; WIDTH];
        let first_open = open.len();
        let mut children = children(tree, index);
        children.sort_by(|&a, &b| worths[b].total_cmp(&worths[a]));
        for (slot, child) in children.into_iter().enumerate() {
            boxes[slot] = padding.around(tree.nodes[child].bounds);
            links[slot] = if tree.nodes[child].is_leaf() {
                let triangles = tree.triangles(child);
                leaf_link(push_leaf(triangles, &mut references) as u32, triangles.len() as u32)
            } else {
                open.push((numbered, child, depth + 1));
                numbered += 1;
                numbered as u32 - 1
            };
        }
        // Depth first, in the order of the children.
        open[first_open..].reverse();
        let end = BVH8_NODE_RECORDS as usize * (number + 1);
        nodes.resize(nodes.len().max(end), KdNode::default());
        write_node(&mut nodes[end - BVH8_NODE_RECORDS as usize..end], &boxes, &links);
    }
    let packets = pack(&references, vertices);
    // Of each node on the way down all children but the one that is visited, and the end.
    let stack_entries = (WIDTH as u32 - 1) * deepest + 2;
    Ok(Bvh8 { structure: StructureArrays { nodes, references, bounds: packets }, stack_entries })
}

/// The up to eight nodes that become the children of `index`; none of an empty tree, and of one that is a leaf that
/// itself.
fn children(tree: &Bvh, index: usize) -> Vec<usize> {
    let mut children: Vec<usize> = (!tree.nodes.is_empty()).then_some(index).into_iter().collect();
    while children.len() < WIDTH {
        let inner = children.iter().enumerate().filter(|&(_, &child)| !tree.nodes[child].is_leaf());
        let area = |&(_, &child): &(usize, &usize)| tree.nodes[child].bounds.half_area();
        // Of several that are as large the first.
        let Some((slot, &largest)) = inner.rev().max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
        let [first, second] = tree.children(largest);
        children[slot] = first;
        children.insert(slot + 1, second);
    }
    children
}

fn write_node(records: &mut [KdNode], boxes: &[Aabb; WIDTH], links: &[u32; WIDTH]) {
    for axis in 0..3 {
        write_eight(&mut records[4 * axis..], boxes.map(|b| b.low[axis].to_bits()));
        write_eight(&mut records[4 * axis + 2..], boxes.map(|b| b.high[axis].to_bits()));
    }
    write_eight(&mut records[BVH8_LINKS as usize..], *links);
}

fn write_eight(records: &mut [KdNode], words: [u32; WIDTH]) {
    for (record, words) in records.iter_mut().zip(words.chunks_exact(4)) {
        *record = KdNode { flags: words[0], left: words[1], right: words[2], split: f32::from_bits(words[3]) };
    }
}

/// How many triangles each leaf has.
pub(super) fn leaf_counts(nodes: &[KdNode]) -> impl Iterator<Item = u32> {
    link::leaf_counts(
        nodes.chunks_exact(BVH8_NODE_RECORDS as usize).flat_map(|records| {
            bytemuck::cast_slice::<KdNode, u32>(&records[BVH8_LINKS as usize..][..2]).iter().copied()
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::bvh::before_a_wall;
    use crate::accel::link::leaf_range;
    use crate::accel::{BuildOptions, build_bvh};

    fn tree(count: usize, leaf_size: Option<u32>) -> (Bvh, Vec<[Vec3; 3]>) {
        let triangle = |i: usize| {
            let at = Vec3::new((i * 37 % 101) as f32, (i * 53 % 103) as f32, (i * 71 % 97) as f32);
            [at, at + Vec3::X, at + Vec3::Y]
        };
        let vertices: Vec<_> = (0..count).map(triangle).collect();
        let options = BvhOptions { leaf_size, ..BvhOptions::DEFAULT };
        let primitives: Vec<_> = (0..count as u32).collect();
        (build_bvh(&vertices, &primitives, &BuildOptions::bvh(&options, StructureKind::Bvh8)).unwrap(), vertices)
    }

    #[test]
    fn what_links_have_no_room_for_is_refused() {
        let error = pack_bvh8(&Bvh::of_one_leaf(9), &[[Vec3::ZERO; 3]; 9], Padding::from(0.0))
            .map(drop)
            .unwrap_err()
            .to_string();
        assert!(error.starts_with("option leaf_size: there is a leaf of 9 triangles"), "{error}");

        let (tree, vertices) = tree(100, Some(1));
        pack_leaves(&tree, &vertices, Padding::from(0.0), 100).unwrap();
        let error = pack_leaves(&tree, &vertices, Padding::from(0.0), 99).map(drop).unwrap_err();
        assert!(error.exit_code() == 3 && error.to_string().contains("100 leaves"), "{error}");
        assert!(error.to_string().ends_with("; take `structure = bvh2`"), "{error}");
        let last = WIDTH * (MAX_LEAVES - 1);
        assert_eq!(leaf_range(leaf_link(last as u32, WIDTH as u32)), Some(last..last + WIDTH));
    }

    /// Rays for which any hit will do go to the first of the children first.
    #[test]
    fn a_wall_behind_small_triangles_is_the_first_child() {
        let (tree, vertices) = before_a_wall(StructureKind::Bvh8, None);
        let Bvh8 { structure, .. } = pack_bvh8(&tree, &vertices, Padding::from(0.0)).unwrap();
        let words: &[u32] = bytemuck::cast_slice(&structure.nodes);
        let first = leaf_range(words[4 * BVH8_LINKS as usize]).expect("a leaf");
        assert!(structure.references[first].contains(&(vertices.len() as u32 - 1)));
    }

    #[test]
    fn links_lead_to_every_triangle_through_boxes_that_hold_it() {
        for count in [0, 1, 2, 8, 9, 60, 3000] {
            let (tree, vertices) = tree(count, None);
            let Bvh8 { structure, stack_entries } = pack_bvh8(&tree, &vertices, Padding::from(0.0)).unwrap();
            let words: &[u32] = bytemuck::cast_slice(&structure.nodes);
            let mut seen = vec![0; count];
            let everywhere = Aabb { low: Vec3::NEG_INFINITY, high: Vec3::INFINITY };
            let mut open = vec![(0, everywhere, 1)];
            let mut visited = 0;
            while let Some((number, outer, depth)) = open.pop() {
                visited += 1;
                assert!(7 * depth + 2 <= stack_entries);
                let node = &words[4 * BVH8_NODE_RECORDS as usize * number..];
                for slot in 0..WIDTH {
                    let plane = |axis: usize, high: usize| f32::from_bits(node[16 * axis + 8 * high + slot]);
                    let [low, high] = [0, 1].map(|high| Vec3::new(plane(0, high), plane(1, high), plane(2, high)));
                    let link = node[4 * BVH8_LINKS as usize + slot];
                    if link == NO_CHILD {
                        assert!(low.cmpgt(high).all());
                        continue;
                    }
                    assert!(low.cmpge(outer.low).all() && high.cmple(outer.high).all());
                    let Some(leaf) = leaf_range(link) else {
                        open.push((link as usize, Aabb { low, high }, depth + 1));
                        continue;
                    };
                    assert!(leaf.start % WIDTH == 0 && (1..=8).contains(&leaf.len()));
                    let packet: &[[f32; 8]] = bytemuck::cast_slice(&structure.bounds[leaf.start / WIDTH * 18..][..18]);
                    for (lane, &number) in structure.references[leaf].iter().enumerate() {
                        let number = number as usize;
                        seen[number] += 1;
                        for (corner, at) in vertices[number].iter().enumerate() {
                            assert!(at.cmpge(low).all() && at.cmple(high).all());
                            let packed = packet[3 * corner..][..3].iter().map(|lanes| lanes[lane]);
                            assert!(at.to_array().into_iter().eq(packed));
                        }
                    }
                }
            }
            assert_eq!(visited * BVH8_NODE_RECORDS as usize, structure.nodes.len());
            assert!(seen.iter().all(|&times| times == 1));
            assert_eq!(leaf_counts(&structure.nodes).sum::<u32>() as usize, count);
        }
    }
}
