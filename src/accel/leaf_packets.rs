//! Packets of eight triangles, so that vectors hold one coordinate of each (`cl/packets/triangles.cl`,
//! `cl/intersect/filter.cl`): what the leaves of wide hierarchies are made of, and those of kd-trees whose rays are
//! traced in packets.
//!
//! Packet number i has the triangles of the references from 8 i on. It takes [`BVH8_PACKET_RECORDS`] records of
//! `bounds`: for each vertex and axis the coordinates of the eight, two records. Where a leaf has fewer, its last
//! triangle is repeated, and nobody looks at it.

use super::KdTree;
use crate::layout::Float4;
use crate::parallel;
use crate::shared::{BVH8_PACKET_RECORDS, KD_LEAF};
use glam::Vec3;

/// Triangles of a packet.
pub(super) const WIDTH: usize = 8;

/// Appends a leaf's triangles to `references`, of which there are whole packets, and what fills up its last packet.
/// Returns its first reference.
pub(super) fn push_leaf(triangles: &[u32], references: &mut Vec<u32>) -> usize {
    let first = references.len();
    references.extend_from_slice(triangles);
    if let Some(&last) = triangles.last() {
        references.resize(references.len().next_multiple_of(WIDTH), last);
    }
    first
}

/// The packets of all `references`, of the triangles `vertices`.
pub(super) fn pack(references: &[u32], vertices: &[[Vec3; 3]]) -> Vec<Float4> {
    let records = BVH8_PACKET_RECORDS as usize;
    let packet = |number: usize| &references[number * WIDTH..][..WIDTH];
    let count = references.len() / WIDTH * records;
    parallel::map_numbers(count, |i| record(packet(i / records), i % records, vertices))
}

/// A record of a packet: half of its triangles' coordinates along an axis, of a corner.
fn record(triangles: &[u32], record: usize, vertices: &[[Vec3; 3]]) -> Float4 {
    let (corner, axis, half) = (record / 6, record / 2 % 3, record % 2);
    let [x, y, z, w] = std::array::from_fn(|i| vertices[triangles[4 * half + i] as usize][corner][axis]);
    Float4 { x, y, z, w }
}

/// Makes whole packets of the leaves of a kd-tree over `vertices`, and returns these.
///
/// # Panics
/// When there are more references than 32 bits can number.
pub fn pack_kd_leaves(tree: &mut KdTree, vertices: &[[Vec3; 3]]) -> Vec<Float4> {
    let mut references = Vec::with_capacity(2 * tree.references.len());
    for leaf in tree.nodes.iter_mut().filter(|node| node.flags == KD_LEAF) {
        let triangles = &tree.references[leaf.left as usize..][..leaf.right as usize];
        leaf.left = u32::try_from(push_leaf(triangles, &mut references)).expect("fewer than 2^32 references");
    }
    tree.references = references;
    pack(&tree.references, vertices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{BuildOptions, build_kd_tree};
    use crate::options::{Build, KdOptions, TraceOptions};

    #[test]
    fn leaves_of_any_size_become_whole_packets_with_their_triangles() {
        let at = |i: usize| Vec3::new((i * 37 % 101) as f32, (i * 53 % 103) as f32, (i * 71 % 97) as f32);
        let vertices: Vec<_> = (0..500).map(|i| [at(i), at(i) + Vec3::X, at(i) + Vec3::Y]).collect();
        let primitives: Vec<_> = (0..500).collect();
        for leaf_size in [1, 8, 30, 500] {
            let options = TraceOptions::of_kd(KdOptions {
                build: Build::Median,
                leaf_size: Some(leaf_size),
                ..KdOptions::DEFAULT
            });
            let before = build_kd_tree(options.kd().build, &vertices, &primitives, &BuildOptions::new(&options, 500));
            let mut tree = before.clone();
            let packets = pack_kd_leaves(&mut tree, &vertices);
            let packets: &[[[[f32; WIDTH]; 3]; 3]] = bytemuck::cast_slice(&packets);
            assert_eq!(tree.references.len(), WIDTH * packets.len());
            for (leaf, old) in tree.nodes.iter().zip(&before.nodes) {
                if leaf.flags != KD_LEAF {
                    assert_eq!(leaf, old);
                    continue;
                }
                assert_eq!((leaf.left as usize % WIDTH, leaf.right), (0, old.right));
                let triangles = &before.references[old.left as usize..][..old.right as usize];
                assert_eq!(&tree.references[leaf.left as usize..][..old.right as usize], triangles);
                for (i, &triangle) in triangles.iter().enumerate() {
                    let packet = &packets[leaf.left as usize / WIDTH + i / WIDTH];
                    let packed = packet.map(|axes| Vec3::from(axes.map(|lanes| lanes[i % WIDTH])));
                    assert_eq!(packed, vertices[triangle as usize]);
                }
            }
        }
    }

    #[test]
    fn a_tree_without_triangles_has_no_packets() {
        let options = BuildOptions::new(&TraceOptions::DEFAULT, 0);
        let mut tree = build_kd_tree(Build::Sah, &[], &[], &options);
        assert!(pack_kd_leaves(&mut tree, &[]).is_empty() && tree.references.is_empty());
    }
}
