//! Makes a finished hierarchy better: large subtrees are taken out and put back where they enlarge boxes least.
//!
//! Bittner, Hapala and Havran, "Fast Insertion-Based Optimization of Bounding Volume Hierarchies", Computer Graphics
//! Forum 32(1), 2013; with all searches of a pass before all its moves, as in Meister and Bittner, "Parallel
//! Reinsertion for Bounding Volume Hierarchy Optimization", Computer Graphics Forum 37(2) (Eurographics), 2018. Leaves
//! stay as they are, so that only the areas of inner nodes change the expected cost: to decide anew what is a leaf
//! afterwards saved less than 0.5 %, and less than the moves did to grow a tree of single triangles first.
//!
//! Searches only read and use all cores. Moves come one after the other, that which promises most first, and each is
//! weighed again in the tree as it is by then. That takes the place of the locks of 2018: the tree is the same whatever
//! the number of threads, and its expected cost never rises.
//!
//! Bad at: trees of small triangles of one size, in which nothing is out of place.

use super::items::Bounds;
use super::{Bvh, BvhNode};
use crate::options::TraceOptions;
use crate::parallel;

/// A pass searches for one of so many nodes, the largest ones. All of them took seven times the time or more, for steps
/// that were 1 to 2 % more on gears, half a percent fewer on bunny, and about as many on sponza.
const NODES_PER_SEARCH: usize = 20;

/// A move must save so many times the moved node's area. Less promises fewer steps than it brings: rays end at their
/// first hit, and boxes that overlap cost more than their areas tell (Aila, Karras and Laine, "On Quality Metrics of
/// Bounding Volume Hierarchies", High Performance Graphics 2013). With any gain bunny took up to 0.8 % more steps and
/// gears 0.3 %, at 1 neither any more, and sponza's rays keep all (camera) to three quarters (diffuse) of what they are
/// spared.
const LEAST_GAIN: f64 = 1.0;

/// Inner nodes at which a search ends with what it has: where boxes are alike there is nothing to bound it. On meshes
/// the longest of all searches took 34.
const MAX_VISITS: u32 = 256;

/// Searches of one task.
const CHUNK: usize = 256;

/// Areas that a move changes at most, before and after it.
const CHANGED_AREAS: f64 = 4.0 * (TraceOptions::MAX_DEPTH + 1) as f64;

/// Rounding errors of a gain in the root's area: of each area (three operations) and of their sum, in which no partial
/// sum exceeds their number.
const GAIN_ERROR: f64 = CHANGED_AREAS * (1.5 + 0.5 * CHANGED_AREAS) * f64::EPSILON;

/// A node of the tree while it changes, in one cache line.
#[derive(Clone, Copy)]
struct Node {
    bounds: Bounds,
    half_area: f64,
    /// The children of an inner node; the `first` and `count` of a leaf.
    links: [u32; 2],
    /// [`NONE`] above the root.
    parent: u32,
    /// The most inner nodes on a path from here to a leaf; 0 for a leaf.
    height: u32,
}

const NONE: u32 = u32::MAX;

/// A subtree that is to be elsewhere.
#[derive(Clone, Copy)]
struct Move {
    node: u32,
    /// What becomes its sibling.
    target: u32,
    /// By how much all half areas together become smaller.
    gain: f64,
}

impl Bvh {
    /// Optimises the tree in so many passes, or in fewer when nothing is left to gain.
    pub(super) fn reinsert(&mut self, passes: u32) {
        // Three leaves: of two there is only one tree.
        const FEWEST_NODES: usize = 5;
        if passes == 0 || self.nodes.len() < FEWEST_NODES {
            return;
        }
        let mut tree = Tree::new(self);
        let useful_passes = (0..passes).take_while(|_| tree.improve()).count();
        if useful_passes > 0 {
            self.nodes = tree.into_nodes();
        }
    }
}

struct Tree {
    nodes: Vec<Node>,
    root: u32,
}

impl Tree {
    fn new(tree: &Bvh) -> Tree {
        let mut nodes = parallel::map_numbers(tree.nodes.len(), |index| {
            let node = &tree.nodes[index];
            Node {
                bounds: Bounds { low: node.bounds.low.extend(0.0), high: node.bounds.high.extend(0.0) },
                half_area: node.bounds.half_area(),
                links: if node.is_leaf() { [node.first, node.count] } else { [index as u32 + 1, node.first] },
                parent: NONE,
                height: 0,
            }
        });
        // Children come behind their parents.
        for index in (0..nodes.len()).rev().filter(|&index| !tree.nodes[index].is_leaf()) {
            let heights = nodes[index].links.map(|child| {
                nodes[child as usize].parent = index as u32;
                nodes[child as usize].height
            });
            nodes[index].height = heights[0].max(heights[1]) + 1;
        }
        Tree { nodes, root: 0 }
    }

    fn node(&self, index: u32) -> &Node {
        &self.nodes[index as usize]
    }

    /// The other child of the parent of `index`, which is not the root.
    fn sibling(&self, index: u32) -> u32 {
        let [first, second] = self.node(self.node(index).parent).links;
        if first == index { second } else { first }
    }

    /// One pass; whether it moved anything.
    fn improve(&mut self) -> bool {
        let search = |chunk: &[u32]| {
            let mut open = Vec::new();
            chunk.iter().filter_map(|&node| self.best_move(node, &mut open)).collect::<Vec<_>>()
        };
        let mut moves = parallel::map(self.largest_nodes().chunks(CHUNK), search).concat();
        moves.sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.node.cmp(&b.node)));
        moves.iter().filter(|wanted| self.apply(wanted)).count() > 0
    }

    /// The nodes to search for, in any order.
    fn largest_nodes(&self) -> Vec<u32> {
        let count = (self.nodes.len() - 1).div_ceil(NODES_PER_SEARCH);
        let mut nodes: Vec<_> = (0..self.nodes.len() as u32).filter(|&index| index != self.root).collect();
        let area = |index: u32| self.node(index).half_area;
        nodes.select_nth_unstable_by(count - 1, |&a, &b| area(b).total_cmp(&area(a)).then(a.cmp(&b)));
        nodes.truncate(count);
        nodes
    }

    /// What a move of `node` must save.
    fn least_gain(&self, node: u32) -> f64 {
        (LEAST_GAIN * self.node(node).half_area).max(GAIN_ERROR * self.node(self.root).half_area)
    }

    /// The best place for `node`, by branch and bound through the subtrees beside the way up to the root; `open` is
    /// room for a stack.
    ///
    /// Its parent disappears and all above become smaller; the inner nodes from a common ancestor down to the target
    /// grow, and a node with both takes the target's place.
    fn best_move(&self, node: u32, open: &mut Vec<(f64, u32)>) -> Option<Move> {
        let Node { bounds, half_area, parent, .. } = *self.node(node);
        let sibling = self.sibling(node);
        let mut best = Move { node, target: NONE, gain: self.least_gain(node) };
        // Weighs a target, when all changes but those from the target down save `saved`, and keeps it when what is
        // below may be better.
        let weigh = |saved: f64, target: u32, best: &mut Move, open: &mut Vec<(f64, u32)>| {
            let other = self.node(target);
            let gain = saved - other.bounds.union(bounds).half_area();
            if gain > best.gain && target != sibling {
                *best = Move { node, target, gain };
            }
            let saved_below = gain + other.half_area;
            if other.height > 0 && saved_below - half_area > best.gain {
                open.push((saved_below, target));
            }
        };
        let mut visits = 0;
        let mut saved = self.node(parent).half_area;
        let mut pivot = parent;
        // What is left below the pivot.
        let (mut beside, mut rest) = (sibling, self.node(sibling).bounds);
        loop {
            open.clear();
            weigh(saved, beside, &mut best, open);
            while let Some((saved, inner)) = open.pop() {
                // No place is smaller than the node itself.
                if saved - half_area <= best.gain {
                    continue;
                }
                visits += 1;
                let first = open.len();
                for child in self.node(inner).links {
                    weigh(saved, child, &mut best, open);
                }
                // The one that promises more is next.
                if open.len() == first + 2 && open[first].0 > open[first + 1].0 {
                    open.swap(first, first + 1);
                }
                if visits == MAX_VISITS {
                    return (best.target != NONE).then_some(best);
                }
            }
            if pivot == self.root {
                return (best.target != NONE).then_some(best);
            }
            if pivot != parent {
                saved += self.node(pivot).half_area - rest.half_area();
            }
            beside = self.sibling(pivot);
            pivot = self.node(pivot).parent;
            rest = rest.union(self.node(beside).bounds);
        }
    }

    /// Moves a node, unless earlier moves have made that useless or impossible; whether it did.
    fn apply(&mut self, wanted: &Move) -> bool {
        let Move { node, target, .. } = *wanted;
        if node == self.root || target == self.node(node).parent || self.ancestors(target).any(|above| above == node) {
            return false;
        }
        let sibling = self.sibling(node);
        if target == sibling {
            return false;
        }
        let gain = self.detach(node) + self.attach(node, target);
        let parent = self.node(node).parent;
        let deepest = self.ancestors(parent).count() as u32 + self.node(parent).height;
        let is_better = gain > self.least_gain(node) && deepest <= TraceOptions::MAX_DEPTH;
        if !is_better {
            self.detach(node);
            self.attach(node, sibling);
        }
        is_better
    }

    /// All nodes above `index`, upwards.
    fn ancestors(&self, index: u32) -> impl Iterator<Item = u32> {
        let above = |index: u32| Some(self.node(index).parent).filter(|&parent| parent != NONE);
        std::iter::successors(above(index), move |&index| above(index))
    }

    /// Takes `node` and its parent out of the tree, which then are only linked to each other; returns the area that
    /// saves.
    fn detach(&mut self, node: u32) -> f64 {
        let (parent, sibling) = (self.node(node).parent, self.sibling(node));
        self.replace(parent, sibling);
        self.node(parent).half_area + self.refit(self.node(sibling).parent)
    }

    /// Puts the detached `node` and its parent back, `target` beside it; returns the area that saves, a negative one.
    fn attach(&mut self, node: u32, target: u32) -> f64 {
        let parent = self.node(node).parent;
        self.replace(target, parent);
        self.nodes[target as usize].parent = parent;
        self.nodes[parent as usize].links = [node, target];
        self.update(parent);
        self.refit(self.node(parent).parent) - self.node(parent).half_area
    }

    /// Links what is above `old` to `new`.
    fn replace(&mut self, old: u32, new: u32) {
        let above = self.node(old).parent;
        self.nodes[new as usize].parent = above;
        if above == NONE {
            self.root = new;
        } else {
            let links = &mut self.nodes[above as usize].links;
            links[usize::from(links[1] == old)] = new;
        }
    }

    /// Box and height of `index` and of what is above it after a change below; returns the area that saves.
    fn refit(&mut self, mut index: u32) -> f64 {
        let mut saved = 0.0;
        while index != NONE {
            let before = self.node(index).half_area;
            if !self.update(index) {
                break;
            }
            saved += before - self.node(index).half_area;
            index = self.node(index).parent;
        }
        saved
    }

    /// Box and height of an inner node by its children; whether they changed.
    fn update(&mut self, index: u32) -> bool {
        let [first, second] = self.node(index).links.map(|child| self.node(child));
        let bounds = first.bounds.union(second.bounds);
        let height = first.height.max(second.height) + 1;
        let half_area = bounds.half_area();
        let node = &mut self.nodes[index as usize];
        let is_new = (bounds.low, bounds.high, height) != (node.bounds.low, node.bounds.high, node.height);
        *node = Node { bounds, half_area, height, ..*node };
        is_new
    }

    /// The nodes in the order of [`Bvh::nodes`].
    fn into_nodes(self) -> Vec<BvhNode> {
        let mut nodes: Vec<BvhNode> = Vec::with_capacity(self.nodes.len());
        // What comes next, and of a second child the number of its parent.
        let mut open: Vec<(u32, Option<usize>)> = vec![(self.root, None)];
        while let Some((index, parent)) = open.pop() {
            let number = nodes.len();
            if let Some(parent) = parent {
                nodes[parent].first = number as u32;
            }
            let node = self.node(index);
            let bounds = node.bounds.to_aabb();
            if node.height == 0 {
                nodes.push(BvhNode { bounds, first: node.links[0], count: node.links[1] });
                continue;
            }
            nodes.push(BvhNode { bounds, first: 0, count: 0 });
            let [a, b] = node.links;
            let b_is_larger = self.node(b).half_area > self.node(a).half_area;
            let (first, second) = if b_is_larger { (b, a) } else { (a, b) };
            open.extend([(second, Some(number)), (first, None)]);
        }
        nodes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Aabb;
    use glam::Vec3;

    /// A chain of unit cubes at x = 1 to `count`, each the sibling of all that follow; beside it one more at the end's
    /// place, whose sibling is far away. As deep as there are cubes in the chain.
    fn chain_with_a_stray(count: u32) -> Bvh {
        let node = |low: f32, high: f32, first: u32, count: u32| BvhNode {
            bounds: Aabb { low: Vec3::X * low, high: Vec3::new(high, 1.0, 1.0) },
            first,
            count,
        };
        let (far, end) = (-1000.0, count as f32);
        let mut nodes = vec![node(far, end + 1.0, 4, 0)];
        nodes.extend([node(far, end + 1.0, 3, 0), node(end, end + 1.0, 0, 1), node(far, far + 1.0, 1, 1)]);
        for i in 1..count {
            let index = nodes.len() as u32;
            // The leaf second, so that the chain goes on with the next node.
            nodes.push(node(i as f32, end + 1.0, index + 2 * (count - i), 0));
        }
        nodes.extend((1..=count).rev().map(|i| node(i as f32, i as f32 + 1.0, i + 1, 1)));
        Bvh { nodes, order: (0..count + 2).collect(), splits_ratio: None }
    }

    #[test]
    fn a_move_that_makes_the_tree_too_deep_is_refused() {
        for (count, is_moved) in [(TraceOptions::MAX_DEPTH - 1, true), (TraceOptions::MAX_DEPTH, false)] {
            let before = chain_with_a_stray(count);
            assert_eq!(before.depth(), count);
            let mut tree = Tree::new(&before);
            let wanted = tree.best_move(2, &mut Vec::new()).expect("a better place");
            assert_eq!(
                before.nodes[wanted.target as usize].bounds, before.nodes[2].bounds,
                "beside the end of the chain"
            );
            assert_eq!(tree.apply(&wanted), is_moved);
            assert!(!tree.apply(&wanted), "it is there, or too deep");
            let after = Bvh { nodes: tree.into_nodes(), ..before.clone() };
            assert_eq!(after.depth(), if is_moved { count + 1 } else { count });
            assert_eq!(after.nodes.len(), before.nodes.len());
        }
    }

    #[test]
    fn what_is_promised_is_what_a_move_saves() {
        let sum = |tree: &Tree| -> f64 {
            let inner = tree.nodes.iter().filter(|node| node.height > 0);
            inner.map(|node| node.half_area).sum()
        };
        let before = chain_with_a_stray(20);
        let mut tree = Tree::new(&before);
        let wanted = tree.best_move(2, &mut Vec::new()).expect("a better place");
        let area = sum(&tree);
        assert!(tree.apply(&wanted));
        assert_eq!(area - sum(&tree), wanted.gain, "small whole numbers");
        // What is above may not go below, nor the root anywhere.
        let useless = |node, target| Move { node, target, gain: 1.0 };
        let root = tree.root;
        let child = tree.node(root).links[0];
        assert!(!tree.apply(&useless(root, child)) && !tree.apply(&useless(child, root)));
        assert!(!tree.apply(&useless(child, tree.sibling(child))));
        let inner = tree.node(root).links.into_iter().find(|&child| tree.node(child).height > 0).expect("a chain");
        let below = tree.node(inner).links[0];
        assert!(!tree.apply(&useless(inner, below)));
    }
}
