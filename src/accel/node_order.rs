//! The order of a kd-tree's nodes in memory: the same tree, so the same hits.
//!
//! Pre-order puts a lower child next to its parent and an upper child anywhere. Level by level suits what all rays
//! share, the top of the tree. The order of van Emde Boas (Prokop, "Cache-Oblivious Algorithms", MIT 1999) divides the
//! tree at half its height, puts the upper part first and the subtrees below it one after the other, each divided in
//! the same way: whatever the size of a cache line, a way down of length h meets about h / log2(nodes a line) lines.

use crate::options::NodeOrder;
use crate::shared::{KD_LEAF, KdNode};

/// The nodes of the tree in another order; the root stays node 0. The first `top` nodes are the topmost ones, level by
/// level, whatever the order of the others.
///
/// # Panics
/// When the nodes are no tree with its root in front.
pub fn reorder(nodes: &[KdNode], order: NodeOrder, top: usize) -> Vec<KdNode> {
    let mut old_index = breadth_first(nodes, if order == NodeOrder::BreadthFirst { nodes.len() } else { top });
    let mut new_index = vec![u32::MAX; nodes.len()];
    let number = |old_index: &[u32], first: usize, new_index: &mut [u32]| {
        for (new, &old) in old_index.iter().enumerate().skip(first) {
            new_index[old as usize] = new as u32;
        }
    };
    number(&old_index, 0, &mut new_index);
    let numbered = old_index.len();
    let rest = match order {
        NodeOrder::BreadthFirst => Vec::new(),
        NodeOrder::Preorder => pre_order(nodes),
        NodeOrder::VanEmdeBoas => van_emde_boas(nodes),
    };
    old_index.extend(rest.into_iter().filter(|&old| new_index[old as usize] == u32::MAX));
    number(&old_index, numbered, &mut new_index);
    assert_eq!(old_index.len(), nodes.len(), "a node is missing or in two places");
    old_index
        .iter()
        .map(|&old| {
            let node = nodes[old as usize];
            if node.flags == KD_LEAF {
                return node;
            }
            KdNode { left: new_index[node.left as usize], right: new_index[node.right as usize], ..node }
        })
        .collect()
}

/// The topmost `count` nodes.
fn breadth_first(nodes: &[KdNode], count: usize) -> Vec<u32> {
    let mut order = vec![0];
    let mut next = 0;
    while next < order.len() && order.len() < count {
        let node = &nodes[order[next] as usize];
        if node.flags != KD_LEAF {
            order.extend([node.left, node.right]);
        }
        next += 1;
    }
    order.truncate(count);
    order
}

fn pre_order(nodes: &[KdNode]) -> Vec<u32> {
    let mut order = Vec::with_capacity(nodes.len());
    let mut open = vec![0];
    while let Some(index) = open.pop() {
        order.push(index);
        let node = &nodes[index as usize];
        if node.flags != KD_LEAF {
            open.extend([node.right, node.left]);
        }
    }
    order
}

fn van_emde_boas(nodes: &[KdNode]) -> Vec<u32> {
    let mut height = 0;
    let mut open = vec![(0, 1)];
    while let Some((index, depth)) = open.pop() {
        height = depth.max(height);
        let node = &nodes[index as usize];
        if node.flags != KD_LEAF {
            open.extend([(node.left, depth + 1), (node.right, depth + 1)]);
        }
    }
    let mut order = Vec::with_capacity(nodes.len());
    append_levels(nodes, 0, height, &mut order, &mut Vec::new());
    order
}

/// Appends `height` levels below and with `root` to `order`, and the roots of what is below them to `below`.
fn append_levels(nodes: &[KdNode], root: u32, height: u32, order: &mut Vec<u32>, below: &mut Vec<u32>) {
    let node = &nodes[root as usize];
    if node.flags == KD_LEAF {
        order.push(root);
    } else if height == 1 {
        order.push(root);
        below.extend([node.left, node.right]);
    } else {
        let upper = height / 2;
        let mut roots = Vec::new();
        append_levels(nodes, root, upper, order, &mut roots);
        for root in roots {
            append_levels(nodes, root, height - upper, order, below);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A complete tree of `levels` levels in pre-order; a leaf's first reference numbers it.
    fn complete(levels: u32) -> Vec<KdNode> {
        fn append(levels: u32, nodes: &mut Vec<KdNode>) {
            let index = nodes.len();
            let leaf = KdNode { flags: KD_LEAF, left: index as u32, right: 1, split: 0.0 };
            nodes.push(leaf);
            if levels > 1 {
                append(levels - 1, nodes);
                let right = nodes.len() as u32;
                append(levels - 1, nodes);
                nodes[index] = KdNode { flags: 0, left: index as u32 + 1, right, split: index as f32 };
            }
        }
        let mut nodes = Vec::new();
        append(levels, &mut nodes);
        nodes
    }

    /// Planes and leaves in the order of a walk: the same for the same tree.
    fn walk(nodes: &[KdNode]) -> Vec<f32> {
        let mut seen = Vec::new();
        let mut open = vec![0u32];
        while let Some(index) = open.pop() {
            let node = &nodes[index as usize];
            if node.flags == KD_LEAF {
                seen.push(node.left as f32);
            } else {
                seen.push(node.split);
                open.extend([node.right, node.left]);
            }
        }
        seen
    }

    #[test]
    fn every_order_is_the_same_tree() {
        for levels in 1..8 {
            let nodes = complete(levels);
            for &order in NodeOrder::ALL {
                for top in [0, 1, 2, 5, nodes.len(), nodes.len() + 1] {
                    assert_eq!(walk(&reorder(&nodes, order, top)), walk(&nodes), "{order}, {levels} levels, top {top}");
                }
            }
            assert_eq!(reorder(&nodes, NodeOrder::Preorder, 0), nodes, "a tree in pre-order stays as it is");
        }
    }

    #[test]
    fn van_emde_boas_puts_small_subtrees_together() {
        // Four levels: the two upper ones, then each of the four subtrees of two levels.
        let nodes = complete(4);
        let reordered = reorder(&nodes, NodeOrder::VanEmdeBoas, 0);
        let children = |index: usize| (reordered[index].left, reordered[index].right);
        assert_eq!(children(0), (1, 2));
        assert_eq!([children(1), children(2)], [(3, 6), (9, 12)]);
        assert_eq!([children(3), children(6), children(9), children(12)], [(4, 5), (7, 8), (10, 11), (13, 14)]);
    }

    #[test]
    fn the_top_comes_first() {
        let nodes = complete(6);
        for &order in NodeOrder::ALL {
            let reordered = reorder(&nodes, order, 7);
            let children: Vec<_> = reordered[..3].iter().map(|node| (node.left, node.right)).collect();
            assert_eq!(children, [(1, 2), (3, 4), (5, 6)], "{order}");
        }
    }
}
