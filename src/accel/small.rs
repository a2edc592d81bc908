//! Small nodes of the surface area heuristic: every candidate plane is counted against every triangle.
//!
//! For up to [`CAPACITY`] triangles the n² comparisons, which compilers turn into vector instructions, are faster than
//! keeping event lists sorted, and most nodes of a tree are that small. Candidates, costs and the choice among equals
//! are those of [`super::events`]; the tree is the same whichever of the two builds a node.

use super::clip::Reference;
use super::cost::{Costs, Side, Split};
use super::subtree::Cell;
use glam::Vec3;

/// The most references of a small node.
pub(super) const CAPACITY: usize = 32;

/// Candidate planes that are counted together: two SSE or one AVX register.
const LANES: usize = 8;

/// The lower and upper bound of every reference can be a plane.
const MAX_CANDIDATES: usize = 2 * CAPACITY;

/// A node of few references, ascending by triangle; the bounds of each axis lie together.
pub(super) struct SmallNode {
    low: [[f32; CAPACITY]; 3],
    high: [[f32; CAPACITY]; 3],
    triangles: [u32; CAPACITY],
    count: usize,
}

impl SmallNode {
    /// The node of `references`.
    ///
    /// # Panics
    /// When there are more than [`CAPACITY`].
    pub fn new(references: &[Reference]) -> SmallNode {
        let mut node = SmallNode::empty();
        references.iter().for_each(|reference| node.push(reference));
        node
    }

    fn empty() -> SmallNode {
        SmallNode { low: [[0.0; CAPACITY]; 3], high: [[0.0; CAPACITY]; 3], triangles: [0; CAPACITY], count: 0 }
    }

    fn push(&mut self, reference: &Reference) {
        for axis in 0..3 {
            self.low[axis][self.count] = reference.low[axis];
            self.high[axis][self.count] = reference.high[axis];
        }
        self.triangles[self.count] = reference.triangle;
        self.count += 1;
    }

    fn reference(&self, number: usize) -> Reference {
        Reference {
            low: std::array::from_fn(|axis| self.low[axis][number]),
            high: std::array::from_fn(|axis| self.high[axis][number]),
            triangle: self.triangles[number],
        }
    }

    /// The triangles, ascending.
    pub fn triangles(&self) -> &[u32] {
        &self.triangles[..self.count]
    }

    /// The cheapest split.
    pub fn best_split(&self, cell: &Cell, costs: &Costs) -> Option<Split> {
        let mut best: Option<Split> = None;
        for axis in 0..3 {
            self.improve_on_axis(axis, cell, costs, &mut best);
        }
        best
    }

    fn improve_on_axis(&self, axis: usize, cell: &Cell, costs: &Costs, best: &mut Option<Split>) {
        let Some(plane_cost) = costs.across(cell, axis) else {
            return;
        };
        let (lows, highs) = (&self.low[axis][..self.count], &self.high[axis][..self.count]);

        // Many bounds lie on the cell's own, where straddling references were cut: collect the others.
        let mut candidates = [0f32; MAX_CANDIDATES];
        let mut candidate_count = 0;
        let mut has_planar = false;
        for (&low, &high) in lows.iter().zip(highs) {
            candidates[candidate_count] = low;
            candidate_count += usize::from(cell.is_split_by(axis, low));
            candidates[candidate_count] = high;
            candidate_count += usize::from(cell.is_split_by(axis, high) && low != high);
            has_planar |= low == high;
        }

        for (tile, planes) in candidates[..candidate_count.next_multiple_of(LANES)].chunks_exact(LANES).enumerate() {
            let planes: &[f32; LANES] = planes.try_into().expect("chunks have LANES elements");
            let (left, right) = count_sides(lows, highs, planes);
            for lane in 0..LANES.min(candidate_count - tile * LANES) {
                let plane = planes[lane];
                let planar = if has_planar { count_planar(lows, highs, plane) } else { 0 };
                let split = plane_cost.split(plane, left[lane], planar, right[lane]);
                if best.is_none_or(|best| split.is_better_than(&best)) {
                    *best = Some(split);
                }
            }
        }
    }

    /// The two sides of a split, straddling references clipped to both.
    pub fn split(&self, vertices: &[[Vec3; 3]], cell: &Cell, split: &Split) -> (SmallNode, SmallNode) {
        let (mut left, mut right) = (SmallNode::empty(), SmallNode::empty());
        for number in 0..self.count {
            let reference = self.reference(number);
            match split.side_of(reference.low[split.axis], reference.high[split.axis]) {
                Side::Left => left.push(&reference),
                Side::Right => right.push(&reference),
                Side::Both => {
                    let (below, above) = reference.split(vertices, cell, split.axis, split.plane);
                    below.iter().for_each(|reference| left.push(reference));
                    above.iter().for_each(|reference| right.push(reference));
                }
            }
        }
        (left, right)
    }
}

/// How many references have something below and above each plane.
fn count_sides(lows: &[f32], highs: &[f32], planes: &[f32; LANES]) -> ([u32; LANES], [u32; LANES]) {
    let (mut left, mut right) = ([0; LANES], [0; LANES]);
    for (&low, &high) in lows.iter().zip(highs) {
        for lane in 0..LANES {
            left[lane] += u32::from(low < planes[lane]);
            right[lane] += u32::from(high > planes[lane]);
        }
    }
    (left, right)
}

fn count_planar(lows: &[f32], highs: &[f32], plane: f32) -> u32 {
    lows.iter().zip(highs).map(|(&low, &high)| u32::from(low == plane && high == plane)).sum()
}
