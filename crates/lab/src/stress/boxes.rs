//! A binary tree of boxes, which tells of most triangles of a mesh that a line passes by, before any is looked at.
//!
//! A line meets a box just when it does as seen along the line's cross products with each axis (separating axes:
//! Gottschalk, Lin and Manocha, "OBBTree", SIGGRAPH 1996): a few products, no quotient, and so a simple bound of the
//! error in doubles.

use super::estimate::{ROUNDING, size_of_cross};
use super::exact::Line;
use glam::DVec3;

/// Triangles of a leaf at most: a box takes about half of what a triangle takes.
const LEAF: usize = 4;
/// A difference, a product, a difference of products, and the same of the magnitudes: four roundings, and as many for
/// the second order.
const ERROR: f64 = 8.0 * ROUNDING;

struct Node {
    middle: DVec3,
    half: DVec3,
    /// The node that follows where the box is not met; nodes are in preorder.
    next: usize,
    /// The part of `order` that a leaf has; empty for others.
    first: usize,
    end: usize,
}

/// Boxes around triangles.
pub struct Boxes {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Boxes {
    /// Boxes around those triangles that there are.
    pub fn new(triangles: &[Option<[DVec3; 3]>]) -> Boxes {
        let order: Vec<u32> = (0..).zip(triangles).filter_map(|(i, triangle)| triangle.map(|_| i)).collect();
        let bounds = |i: u32| {
            let [a, b, c] = triangles[i as usize].unwrap_or_default();
            (a.min(b).min(c), a.max(b).max(c))
        };
        let mut boxes = Boxes { nodes: Vec::new(), order };
        if !boxes.order.is_empty() {
            boxes.divide(&bounds, 0, boxes.order.len());
        }
        boxes
    }

    fn divide(&mut self, bounds: &impl Fn(u32) -> (DVec3, DVec3), first: usize, end: usize) {
        let part = &mut self.order[first..end];
        let all = part.iter().map(|&i| bounds(i));
        let (low, high) =
            all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| (low.min(b.0), high.max(b.1)));
        let middle = (low + high) / 2.0;
        let half = (high - middle).max(middle - low);
        let node = self.nodes.len();
        let is_leaf = end - first <= LEAF;
        self.nodes.push(Node { middle, half, next: 0, first, end: if is_leaf { end } else { first } });
        if !is_leaf {
            let axis = half.max_position();
            let count = part.len() / 2;
            let key = |i: &u32| {
                let (low, high) = bounds(*i);
                low[axis] + high[axis]
            };
            part.select_nth_unstable_by(count, |a, b| key(a).total_cmp(&key(b)));
            self.divide(bounds, first, first + count);
            self.divide(bounds, first + count, end);
        }
        self.nodes[node].next = self.nodes.len();
    }

    /// The triangles that `line` does not surely pass by.
    pub fn near<'a>(&'a self, line: &'a Line) -> impl Iterator<Item = u32> + 'a {
        let mut node = 0;
        let leaves = std::iter::from_fn(move || {
            while let Some(Node { middle, half, next, first, end }) = self.nodes.get(node) {
                let is_met = line.meets(*middle, *half);
                node = if is_met { node + 1 } else { *next };
                if is_met && first < end {
                    return Some(&self.order[*first..*end]);
                }
            }
            None
        });
        leaves.flatten().copied()
    }
}

impl Line {
    /// Whether the line may meet a box, before or behind its origin.
    fn meets(&self, middle: DVec3, half: DVec3) -> bool {
        let way = middle - self.origin;
        let reach = half * (1.0 + ERROR) + way.abs() * ERROR + self.origin_error();
        self.direction.cross(way).abs().cmple(size_of_cross(self.direction.abs(), reach)).all()
    }
}
