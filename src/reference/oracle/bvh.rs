//! Bounding volume hierarchy in f64, by the median of the triangles along the longest axis, two children a node.
//!
//! Rubin and Whitted, "A 3-Dimensional Representation for Fast Rendering of Complex Scenes", SIGGRAPH 1980; boxes as in
//! Kay and Kajiya, "Ray Tracing Complex Scenes", SIGGRAPH 1986.
//!
//! It loses no hit of the oracle, by construction and not by a tolerance: a hit's t lies in the [`Line::passage`]
//! through the box of its own triangle, and the passage through a box that holds another one holds the passage through
//! that, to the last bit, because every step of its computation is a monotone function of the box. So the oracle gives
//! the same answer with and without it. Quick to write and to trust; bad at speed: the median knows no cost.

use glam::DVec3;

/// A node with at most this many triangles is not split.
const LEAF_SIZE: usize = 4;

/// Halving 2^32 triangles ends at this depth, and each step leaves one node on the stack.
const STACK_SIZE: usize = 33;

/// How far outside of its triangle's box the line of a hit may pass, in units of the farthest distance from the origin
/// to the box on any axis. With u = EPSILON / 2 of the largest: a vertex relative to the origin is off by u; an edge
/// function of unsure sign (see `edge_volume`) has errors of 5 u |b| |moment of a|, so that the sign is wrong only
/// where the line passes within 5 u |b| of the edge, 9 u on the scale of an axis; the differences below round twice. 12
/// u; 32 are taken.
const SLACK: f64 = 16.0 * f64::EPSILON;
/// Factors that move a positive t up and down, and a negative one down and up, by more than the roundings of
/// reciprocal, product and factor: 3 u; 4 are taken. Products, so that infinity stays infinity.
const UP: f64 = 1.0 + 2.0 * f64::EPSILON;
const DOWN: f64 = 1.0 - 2.0 * f64::EPSILON;

/// A box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Box64 {
    low: DVec3,
    high: DVec3,
}

impl Box64 {
    /// The smallest box around `points`.
    pub fn around(points: &[DVec3; 3]) -> Box64 {
        let [a, b, c] = *points;
        Box64 { low: a.min(b).min(c), high: a.max(b).max(c) }
    }

    fn union(self, other: Box64) -> Box64 {
        Box64 { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// The whole straight line of a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    origin: DVec3,
    inv_direction: DVec3,
}

impl Line {
    /// The line through `origin` along `direction`, both finite.
    pub fn new(origin: DVec3, direction: DVec3) -> Line {
        Line { origin, inv_direction: direction.recip() }
    }

    /// Where the line enters and leaves `bounds`, made larger by [`SLACK`]; the second is smaller when it passes by.
    pub fn passage(&self, bounds: &Box64) -> (f64, f64) {
        let (to_low, to_high) = (bounds.low - self.origin, bounds.high - self.origin);
        let slack = SLACK * to_low.abs().max(to_high.abs()).max_element();
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let inv = self.inv_direction[axis];
            let (low, high) = ((to_low[axis] - slack) * inv, (to_high[axis] + slack) * inv);
            let (first, last) = if inv >= 0.0 { (low, high) } else { (high, low) };
            // A line in a face gives 0 * infinity = NaN, for which both comparisons are false: the slab does not
            // narrow.
            let (first, last) =
                (first * if first > 0.0 { DOWN } else { UP }, last * if last > 0.0 { UP } else { DOWN });
            if first > enter {
                enter = first;
            }
            if last < leave {
                leave = last;
            }
        }
        (enter, leave)
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Box64,
    /// Inner: the second child, the first being the next node. Leaf: the first entry of `order`.
    next: u32,
    /// Triangles of a leaf, 0 for an inner node.
    count: u32,
}

/// The hierarchy over some triangles.
#[derive(Debug, Clone)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Bvh {
    /// Over triangles with these `boxes`.
    pub fn new(boxes: &[Box64]) -> Bvh {
        let mut bvh = Bvh { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            let mut order = std::mem::take(&mut bvh.order);
            bvh.add(boxes, &mut order, 0);
            bvh.order = order;
        }
        bvh
    }

    /// Adds the node of the triangles `order`, which are entries `first` and following, and those below it.
    fn add(&mut self, boxes: &[Box64], order: &mut [u32], first: usize) {
        let of = |&i: &u32| boxes[i as usize];
        let bounds = order[1..].iter().map(of).fold(of(&order[0]), Box64::union);
        let node = self.nodes.len();
        self.nodes.push(Node { bounds, next: first as u32, count: order.len() as u32 });
        if order.len() <= LEAF_SIZE {
            return;
        }
        // Twice the centres: halves would round.
        let centre = |i: &u32| of(i).low + of(i).high;
        let (low, high) = order[1..]
            .iter()
            .map(centre)
            .fold((centre(&order[0]), centre(&order[0])), |(low, high), c| (low.min(c), high.max(c)));
        let extent = high - low;
        let axis = (0..3).fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
        let (left, right) = order.split_at_mut(middle);
        self.add(boxes, left, first);
        self.nodes[node].next = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.add(boxes, right, first + middle);
    }

    /// Calls `test` for the triangles whose boxes the line may pass between `t_min` and `t_max`; `test` gives the
    /// `t_max` from then on.
    pub fn visit(&self, line: &Line, t_min: f64, mut t_max: f64, mut test: impl FnMut(u32) -> f64) {
        let mut stack = [(0u32, 0.0); STACK_SIZE];
        let mut stacked = 0;
        let mut next = match self.nodes.first() {
            Some(root) if reaches(line.passage(&root.bounds), t_min, t_max) => Some(0),
            _ => None,
        };
        while let Some(index) = next {
            let node = &self.nodes[index as usize];
            next = None;
            if node.count > 0 {
                for &triangle in &self.order[node.next as usize..(node.next + node.count) as usize] {
                    t_max = test(triangle);
                }
            } else {
                let children = [index + 1, node.next];
                let passages = children.map(|child| line.passage(&self.nodes[child as usize].bounds));
                let met = passages.map(|passage| reaches(passage, t_min, t_max));
                let near = usize::from(if met[0] && met[1] { passages[1].0 < passages[0].0 } else { met[1] });
                if met[near] {
                    next = Some(children[near]);
                }
                if met[1 - near] {
                    stack[stacked] = (children[1 - near], passages[1 - near].0);
                    stacked += 1;
                }
            }
            while next.is_none() && stacked > 0 {
                stacked -= 1;
                let (child, enter) = stack[stacked];
                if enter <= t_max {
                    next = Some(child);
                }
            }
        }
    }
}

fn reaches((enter, leave): (f64, f64), t_min: f64, t_max: f64) -> bool {
    enter <= leave && enter <= t_max && leave >= t_min
}
