//! What a split plane costs.
//!
//! MacDonald and Booth, "Heuristics for ray tracing using space subdivision", The Visual Computer 1990; in the notation
//! of Wald and Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", IEEE Symposium on
//! Interactive Ray Tracing 2006, section 3.1: K_T + K_I (P_L N_L + P_R N_R), times lambda when a side is empty.
//!
//! The probability P that a line through a convex cell meets a convex part of it is the ratio of their surface areas.
//! The thesis (section 5.5) says that it is the ratio of their volumes: [`Measure`] has both.

use super::subtree::Cell;
use super::{BuildOptions, half_area};

/// What the probability that a ray meets a cell is taken to be proportional to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Surface area, the right law for lines of all directions and positions.
    Surface,
    /// Volume, the thesis's law. It is wrong: it gives a thin cell next to no rays, although those through its large
    /// faces meet it.
    ///
    /// An axis on which the whole scene is flat counts as 1, which is the law's limit for a scene of vanishing
    /// thickness.
    Volume,
}

impl Measure {
    /// The measure of a cell, the area halved, in f64: products of float32 lengths neither over- nor underflow there.
    pub(super) fn of(self, cell: &Cell) -> f64 {
        match self {
            Measure::Surface => half_area([cell.extent(0), cell.extent(1), cell.extent(2)]),
            Measure::Volume => length_or_one(cell, 0) * length_or_one(cell, 1) * length_or_one(cell, 2),
        }
    }

    /// The measure of a slice of a cell across `axis` is linear in its thickness: the constant, and the factor of the
    /// thickness.
    fn of_slices(self, cell: &Cell, axis: usize) -> (f64, f64) {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        match self {
            Measure::Surface => (cell.extent(u) * cell.extent(v), cell.extent(u) + cell.extent(v)),
            Measure::Volume => (0.0, length_or_one(cell, u) * length_or_one(cell, v)),
        }
    }
}

/// No split makes a cell flat, so an axis counts as 1 in all cells of a scene or in none.
fn length_or_one(cell: &Cell, axis: usize) -> f64 {
    let length = cell.extent(axis);
    if length > 0.0 { length } else { 1.0 }
}

/// The costs of a build, as f64.
#[derive(Debug, Clone, Copy)]
pub(super) struct Costs {
    measure: Measure,
    traverse: f64,
    intersect: f64,
    /// Factor on the cost of a split with an empty side (lambda of the paper).
    empty_factor: f64,
}

impl Costs {
    pub fn new(measure: Measure, options: &BuildOptions) -> Costs {
        Costs {
            measure,
            traverse: f64::from(options.cost_traverse),
            intersect: f64::from(options.cost_intersect),
            empty_factor: 1.0 - f64::from(options.empty_bonus),
        }
    }

    /// The cost of a node that is not split.
    pub fn leaf(&self, count: usize) -> f64 {
        self.intersect * count as f64
    }

    /// The cost of a node whose children, in parts of its cell, cost so much.
    pub fn inner(&self, cell: &Cell, parts: [&Cell; 2], costs: [f64; 2]) -> f64 {
        let below = self.measure.of(parts[0]) * costs[0] + self.measure.of(parts[1]) * costs[1];
        self.traverse + below / self.measure.of(cell)
    }

    /// The costs of the planes across `axis` in `cell`, or `None` for a cell that no ray meets or without room on that
    /// axis.
    pub fn across(&self, cell: &Cell, axis: usize) -> Option<PlaneCost> {
        let whole = self.measure.of(cell);
        let (constant, per_thickness) = self.measure.of_slices(cell, axis);
        (whole > 0.0 && cell.low[axis] < cell.high[axis]).then(|| PlaneCost {
            costs: *self,
            axis,
            low: f64::from(cell.low[axis]),
            high: f64::from(cell.high[axis]),
            constant,
            per_thickness,
            per_measure: self.intersect / whole,
        })
    }
}

/// The cost of the planes across one axis of one cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneCost {
    costs: Costs,
    axis: usize,
    low: f64,
    high: f64,
    /// A side's measure is `constant + per_thickness * thickness`.
    constant: f64,
    per_thickness: f64,
    /// Cost of one triangle per unit of a side's measure.
    per_measure: f64,
}

impl PlaneCost {
    /// The cost of splitting at `plane` with so many triangles left and right of it.
    pub fn of(&self, plane: f32, left: u32, right: u32) -> f64 {
        let plane = f64::from(plane);
        let left_measure = self.constant + self.per_thickness * (plane - self.low);
        let right_measure = self.constant + self.per_thickness * (self.high - plane);
        let tests = left_measure * f64::from(left) + right_measure * f64::from(right);
        let cost = self.costs.traverse + self.per_measure * tests;
        if left == 0 || right == 0 { cost * self.costs.empty_factor } else { cost }
    }

    /// The split at `plane`, with the triangles that lie in it on the better side; the left one on a tie.
    pub fn split(&self, plane: f32, left: u32, planar: u32, right: u32) -> Split {
        let on_left = Split {
            axis: self.axis,
            plane,
            planar_left: true,
            left: left + planar,
            right,
            cost: self.of(plane, left + planar, right),
        };
        if planar == 0 {
            return on_left;
        }
        let cost = self.of(plane, left, right + planar);
        if on_left.cost <= cost {
            on_left
        } else {
            Split { planar_left: false, left, right: right + planar, cost, ..on_left }
        }
    }
}

/// A split plane that was found best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    pub axis: usize,
    pub plane: f32,
    /// Whether the triangles that lie in the plane go left.
    pub planar_left: bool,
    /// References on the left, before those that straddle the plane are clipped.
    pub left: u32,
    /// References on the right, before those that straddle the plane are clipped.
    pub right: u32,
    pub cost: f64,
}

impl Split {
    /// Where a reference with this extent on the split axis goes.
    pub fn side_of(&self, low: f32, high: f32) -> Side {
        if low == high && low == self.plane {
            if self.planar_left { Side::Left } else { Side::Right }
        } else if high <= self.plane {
            Side::Left
        } else if low >= self.plane {
            Side::Right
        } else {
            Side::Both
        }
    }

    /// Whether this one is to be taken before `other`: cheaper, and of equals the first by axis and plane, so that the
    /// order in which planes are tried has no influence on the tree. NaN costs are never better.
    pub fn is_better_than(&self, other: &Split) -> bool {
        self.cost < other.cost || (self.cost == other.cost && (self.axis, self.plane) < (other.axis, other.plane))
    }
}

/// Where a reference goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Left = 0,
    Right = 1,
    Both = 2,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_add_up() {
        let cell = Cell { low: [1.0, -2.0, 0.0], high: [3.0, 3.0, 7.0] };
        let flat = Cell { low: [1.0, -2.0, 5.0], high: [3.0, 3.0, 5.0] };
        assert_eq!((Measure::Surface.of(&cell), Measure::Volume.of(&cell)), (59.0, 70.0));
        assert_eq!((Measure::Surface.of(&flat), Measure::Volume.of(&flat)), (10.0, 10.0));
        for measure in [Measure::Surface, Measure::Volume] {
            for cell in [cell, flat] {
                for axis in (0..3).filter(|&axis| cell.extent(axis) > 0.0) {
                    let (constant, per_thickness) = measure.of_slices(&cell, axis);
                    let (left, _) = cell.split(axis, cell.low[axis] + 0.5);
                    assert_eq!(constant + per_thickness * 0.5, measure.of(&left), "{measure:?}, {axis}");
                    assert_eq!(constant + per_thickness * cell.extent(axis), measure.of(&cell), "{measure:?}, {axis}");
                }
            }
        }
    }
}
