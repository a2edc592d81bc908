//! The surface area heuristic: what a split plane costs.
//!
//! MacDonald and Booth, "Heuristics for ray tracing using space subdivision", The Visual Computer 1990; in the notation of
//! Wald and Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", IEEE Symposium on
//! Interactive Ray Tracing 2006, section 3.1: K_T + K_I (P_L N_L + P_R N_R), times lambda when a side is empty.
//!
//! The thesis (section 5.5) speaks of volumes; the probability that a line through a convex cell meets a convex part of it
//! is the ratio of their surface areas.

use super::BuildOptions;
use super::subtree::Cell;

/// The costs of a build, as f64.
#[derive(Debug, Clone, Copy)]
pub(super) struct Costs {
    traverse: f64,
    intersect: f64,
    /// Factor on the cost of a split with an empty side (lambda of the paper).
    empty_factor: f64,
}

impl Costs {
    pub fn new(options: &BuildOptions) -> Costs {
        Costs {
            traverse: f64::from(options.cost_traverse),
            intersect: f64::from(options.cost_intersect),
            empty_factor: 1.0 - f64::from(options.empty_bonus),
        }
    }

    /// The cost of a node that is not split.
    pub fn leaf(&self, count: usize) -> f64 {
        self.intersect * count as f64
    }

    /// The costs of the planes across `axis` in `cell`, or `None` for a cell without area or without room on that axis.
    pub fn across(&self, cell: &Cell, axis: usize) -> Option<PlaneCost> {
        let (width, height) = (cell.extent((axis + 1) % 3), cell.extent((axis + 2) % 3));
        let half_area = cell.half_area();
        (half_area > 0.0 && cell.low[axis] < cell.high[axis]).then(|| PlaneCost {
            costs: *self,
            low: f64::from(cell.low[axis]),
            high: f64::from(cell.high[axis]),
            face: width * height,
            rim: width + height,
            per_area: self.intersect / half_area,
        })
    }
}

/// The cost of the planes across one axis of one cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneCost {
    costs: Costs,
    low: f64,
    high: f64,
    /// Area of the plane within the cell.
    face: f64,
    /// Half the length of its border: a side's half area is `face + rim * thickness`.
    rim: f64,
    /// Cost of one triangle per unit of a side's half area.
    per_area: f64,
}

impl PlaneCost {
    /// The cost of splitting at `plane` with so many triangles left and right of it.
    pub fn of(&self, plane: f32, left: u32, right: u32) -> f64 {
        let plane = f64::from(plane);
        let left_area = self.face + self.rim * (plane - self.low);
        let right_area = self.face + self.rim * (self.high - plane);
        let tests = left_area * f64::from(left) + right_area * f64::from(right);
        let cost = self.costs.traverse + self.per_area * tests;
        if left == 0 || right == 0 { cost * self.costs.empty_factor } else { cost }
    }

    /// The better side for the triangles that lie in the plane; the left one on a tie.
    pub fn with_planar(&self, plane: f32, left: u32, planar: u32, right: u32) -> (f64, bool) {
        let on_left = self.of(plane, left + planar, right);
        if planar == 0 {
            return (on_left, true);
        }
        let on_right = self.of(plane, left, right + planar);
        if on_left <= on_right { (on_left, true) } else { (on_right, false) }
    }
}

/// A split plane that was found best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    pub axis: usize,
    pub plane: f32,
    /// Whether the triangles that lie in the plane go left.
    pub planar_left: bool,
    /// References on both sides together, before those that straddle the plane are clipped.
    pub parts: u32,
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
