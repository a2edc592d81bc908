//! Ropes: links from every face of a kd-tree's leaf to what lies behind it. Popov, Günther, Seidel and Slusallek,
//! "Stackless KD-Tree Traversal for High Performance GPU Ray Tracing", Computer Graphics Forum 26(3), 2007, sections
//! 3.1 and 3.2.
//!
//! A rope leads to the deepest node whose cell still has all neighbours behind the face in it, so that it needs no
//! further choice until the ray's own place decides. Ropes that end at the sibling instead would cost a descent at each
//! crossing.
//!
//! Bad at: memory. Leaf number l, in pre-order, has three records of 16 bytes, one an axis:
//!
//! ```text
//!   bounds[3 l + axis] = | x: low     | y: high    | z: rope below | w: rope above |
//!                        | f32        | f32        | u32 bits      | u32 bits      |
//! ```
//!
//! low and high are the leaf's box, tracing space; a rope is a node index, [`NO_ROPE`] where the scene's box ends. The
//! leaf's node has l in the bits of its `split`.

use super::Aabb;
use crate::layout::Float4;
use crate::shared::{KD_LEAF, KdNode, NO_ROPE};

/// What lies behind the faces of a cell, by axis: below, above.
type Ropes = [[u32; 2]; 3];

/// Makes the ropes of a tree in the box `bounds`, writes the leaves' numbers into their nodes and returns the records.
pub fn link_leaves(nodes: &mut [KdNode], bounds: &Aabb) -> Vec<Float4> {
    let mut records = Vec::with_capacity(3 * (nodes.len() / 2 + 1));
    // Cells that are still to come, the next one last.
    let mut open = vec![(0, [bounds.low.to_array(), bounds.high.to_array()], [[NO_ROPE; 2]; 3])];
    while let Some((node_index, cell, mut ropes)) = open.pop() {
        shorten(nodes, &cell, &mut ropes);
        let node = &mut nodes[node_index as usize];
        if node.flags == KD_LEAF {
            node.split = f32::from_bits(records.len() as u32 / 3);
            records.extend((0..3).map(|axis| Float4 {
                x: cell[0][axis],
                y: cell[1][axis],
                z: f32::from_bits(ropes[axis][0]),
                w: f32::from_bits(ropes[axis][1]),
            }));
            continue;
        }
        let axis = node.flags as usize;
        let (mut below, mut above) = ((cell, ropes), (cell, ropes));
        below.0[1][axis] = node.split;
        below.1[axis][1] = node.right;
        above.0[0][axis] = node.split;
        above.1[axis][0] = node.left;
        open.push((node.right, above.0, above.1));
        open.push((node.left, below.0, below.1));
    }
    records
}

/// Moves each rope down to the deepest node that has all neighbours of the cell behind that face.
fn shorten(nodes: &[KdNode], cell: &[[f32; 3]; 2], ropes: &mut Ropes) {
    for (face_axis, sides) in ropes.iter_mut().enumerate() {
        for (side, rope) in sides.iter_mut().enumerate().filter(|(_, rope)| **rope != NO_ROPE) {
            loop {
                let node = &nodes[*rope as usize];
                let axis = node.flags as usize;
                *rope = if node.flags == KD_LEAF {
                    break;
                } else if axis == face_axis {
                    // The child at the face: the upper one for neighbours below.
                    if side == 0 { node.right } else { node.left }
                } else if node.split >= cell[1][axis] {
                    node.left
                } else if node.split <= cell[0][axis] {
                    node.right
                } else {
                    break;
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{BuildOptions, build_kd_tree};
    use crate::options::{Build, KdOptions, TraceOptions};
    use glam::Vec3;

    /// Leaf boxes below `node_index` by node index, found by going down.
    fn leaves_below(nodes: &[KdNode], node_index: u32, cell: [[f32; 3]; 2], leaves: &mut Vec<(u32, [[f32; 3]; 2])>) {
        let node = &nodes[node_index as usize];
        if node.flags == KD_LEAF {
            leaves.push((node_index, cell));
            return;
        }
        let axis = node.flags as usize;
        let (mut below, mut above) = (cell, cell);
        below[1][axis] = node.split;
        above[0][axis] = node.split;
        leaves_below(nodes, node.left, below, leaves);
        leaves_below(nodes, node.right, above, leaves);
    }

    /// Nodes in `node_index`'s subtree; pre-order makes them a range.
    fn subtree_end(nodes: &[KdNode], mut node_index: u32) -> u32 {
        while nodes[node_index as usize].flags != KD_LEAF {
            node_index = nodes[node_index as usize].right;
        }
        node_index + 1
    }

    #[test]
    fn ropes_lead_to_all_neighbours_and_no_higher_than_needed() {
        let mut state = 1u32;
        let mut unit = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let triangles: Vec<[Vec3; 3]> = (0..150)
            .map(|_| {
                let center = Vec3::new(unit(), unit(), unit());
                [(); 3].map(|()| center + 0.2 * Vec3::new(unit(), unit(), unit()))
            })
            .collect();
        let primitives: Vec<u32> = (0..150).collect();
        for &build in Build::ALL {
            let options = BuildOptions::new(
                &TraceOptions::of_kd(KdOptions { build, leaf_size: Some(2), ..KdOptions::DEFAULT }),
                150,
            );
            let mut tree = build_kd_tree(build, &triangles, &primitives, &options);
            let records = link_leaves(&mut tree.nodes, &tree.bounds);
            let mut leaves = Vec::new();
            leaves_below(&tree.nodes, 0, [tree.bounds.low.to_array(), tree.bounds.high.to_array()], &mut leaves);
            assert_eq!(records.len(), 3 * leaves.len());
            assert!(leaves.len() > 50, "{build}: {} leaves", leaves.len());
            for (number, (node_index, cell)) in leaves.iter().enumerate() {
                assert_eq!(tree.nodes[*node_index as usize].split.to_bits(), number as u32);
                for axis in 0..3 {
                    let record = records[3 * number + axis];
                    assert_eq!([record.x, record.y], [cell[0][axis], cell[1][axis]]);
                    for (side, rope) in [(0, record.z.to_bits()), (1, record.w.to_bits())] {
                        let neighbours: Vec<u32> = leaves
                            .iter()
                            .filter(|(_, other)| {
                                other[1 - side][axis] == cell[side][axis]
                                    && (0..3)
                                        .all(|b| b == axis || (other[0][b] < cell[1][b] && cell[0][b] < other[1][b]))
                            })
                            .map(|(index, _)| *index)
                            .collect();
                        assert_eq!(rope == NO_ROPE, neighbours.is_empty());
                        if rope == NO_ROPE {
                            continue;
                        }
                        assert!(neighbours.iter().all(|n| (rope..subtree_end(&tree.nodes, rope)).contains(n)));
                        let node = &tree.nodes[rope as usize];
                        if node.flags != KD_LEAF {
                            let in_left = neighbours.iter().filter(|n| **n < node.right).count();
                            assert!(0 < in_left && in_left < neighbours.len(), "the rope could be shorter");
                        }
                    }
                }
            }
        }
    }
}
