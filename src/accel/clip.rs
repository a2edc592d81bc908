//! A triangle's share of a cell, and its split at a plane: "perfect splits".
//!
//! Havran and Bittner, "On improving kd-trees for ray shooting", WSCG 2002, by clipping after Sutherland and Hodgman,
//! "Reentrant polygon clipping", CACM 1974.
//!
//! **Conservative:** the boxes here hold every point of the triangle that lies in the cell, so no rounding can lose a
//! triangle from a cell that it touches. The proof, with M the largest coordinate of the triangle and u = 2^-53:
//! - A corner computed on a plane is off by at most 12 u M: the parameter t has a relative error of 3 u (two
//!   differences, one quotient), the product, the difference and the sum add one u each, and every term is at most 2 M.
//! - A point x of the true triangle has a point x' of the computed polygon within the error e so far. Clipping at
//!   planes moved outwards by at least e keeps x' whenever x lies in the cell; the new corners add 12 u M to e.
//! - There are at most 7 clips, so e <= 84 u M, and [`ERROR`] = 128 u is taken for planes and corners alike.
//!
//! Original corners are exact and get no margin, so neighbours that share one get the same bound from it.

use super::subtree::Cell;
use glam::Vec3;

/// Margin of clip planes and computed corners, relative to the triangle's largest coordinate.
const ERROR: f64 = 128.0 / (1u64 << 53) as f64;

/// A triangle has 3 corners and each of at most 6 clips of a convex polygon adds one; the rest is room for polygons
/// that rounding has made slightly concave.
const MAX_CORNERS: usize = 12;

/// A triangle in a cell: the box around their common points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reference {
    pub low: [f32; 3],
    pub high: [f32; 3],
    pub triangle: u32,
}

impl Reference {
    /// The reference to a whole triangle.
    pub fn whole(vertices: &[[Vec3; 3]], triangle: u32) -> Reference {
        let cell = Cell::around(vertices, &[triangle]);
        Reference { low: cell.low, high: cell.high, triangle }
    }

    /// The parts below and above a plane across `axis` of `cell`, `None` where there is nothing of the triangle.
    ///
    /// `self` must be a reference in `cell`, and the plane strictly within `cell`.
    pub fn split(
        &self,
        vertices: &[[Vec3; 3]],
        cell: &Cell,
        axis: usize,
        plane: f32,
    ) -> (Option<Reference>, Option<Reference>) {
        let (polygon, margin) = Polygon::clipped(&vertices[self.triangle as usize], cell);
        let plane64 = f64::from(plane);
        let below = polygon.bounds(axis, 1.0, plane64 + margin, margin);
        let above = polygon.bounds(axis, -1.0, -plane64 + margin, margin);
        let left = self.shrunk_to(&below).and_then(|mut left| {
            left.high[axis] = left.high[axis].min(plane);
            left.is_valid().then_some(left)
        });
        let right = self.shrunk_to(&above).and_then(|mut right| {
            right.low[axis] = right.low[axis].max(plane);
            right.is_valid().then_some(right)
        });
        (left, right)
    }

    /// The common part with `bounds`, rounded outwards. Both hold all common points of triangle and cell, so this does,
    /// too.
    fn shrunk_to(&self, bounds: &Bounds) -> Option<Reference> {
        if bounds.low[0] > bounds.high[0] {
            return None;
        }
        Some(Reference {
            low: std::array::from_fn(|k| self.low[k].max(round_down(bounds.low[k]))),
            high: std::array::from_fn(|k| self.high[k].min(round_up(bounds.high[k]))),
            triangle: self.triangle,
        })
    }

    fn is_valid(&self) -> bool {
        (0..3).all(|k| self.low[k] <= self.high[k])
    }
}

/// The largest float32 not above `x`; never -0.
fn round_down(x: f64) -> f32 {
    let rounded = x as f32;
    let down = if f64::from(rounded) > x { rounded.next_down() } else { rounded };
    down + 0.0
}

/// The smallest float32 not below `x`; never -0.
fn round_up(x: f64) -> f32 {
    let rounded = x as f32;
    let up = if f64::from(rounded) < x { rounded.next_up() } else { rounded };
    up + 0.0
}

/// A box in f64; empty as long as low > high.
struct Bounds {
    low: [f64; 3],
    high: [f64; 3],
}

impl Bounds {
    fn include(&mut self, corner: &Corner) {
        for k in 0..3 {
            self.low[k] = self.low[k].min(corner.position[k] - corner.margin);
            self.high[k] = self.high[k].max(corner.position[k] + corner.margin);
        }
    }
}

/// A corner of a clipped triangle.
#[derive(Clone, Copy, Default)]
struct Corner {
    position: [f64; 3],
    /// 0 for an original corner, else how far off it may be.
    margin: f64,
}

impl Corner {
    /// The point of the edge from `self` to `other` at the given coordinate.
    fn towards(&self, other: &Corner, axis: usize, coordinate: f64, margin: f64) -> Corner {
        let (a, b) = (&self.position, &other.position);
        let t = (coordinate - a[axis]) / (b[axis] - a[axis]);
        let mut position = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t);
        position[axis] = coordinate;
        Corner { position, margin }
    }
}

/// A convex polygon, up to rounding.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [Corner; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    /// The part of a triangle in a cell widened by the margin, and that margin.
    fn clipped(vertices: &[Vec3; 3], cell: &Cell) -> (Polygon, f64) {
        let mut polygon = Polygon { corners: [Corner::default(); MAX_CORNERS], count: 3 };
        for (corner, vertex) in polygon.corners.iter_mut().zip(vertices) {
            corner.position = vertex.as_dvec3().to_array();
        }
        let low = vertices[0].min(vertices[1]).min(vertices[2]).to_array();
        let high = vertices[0].max(vertices[1]).max(vertices[2]).to_array();
        let largest = (0..3).fold(0f32, |largest, k| largest.max(high[k]).max(-low[k]));
        let margin = f64::from(largest) * ERROR;
        for axis in 0..3 {
            if low[axis] < cell.low[axis] {
                polygon = polygon.clip(axis, -1.0, -f64::from(cell.low[axis]) + margin, margin);
            }
            if high[axis] > cell.high[axis] {
                polygon = polygon.clip(axis, 1.0, f64::from(cell.high[axis]) + margin, margin);
            }
        }
        (polygon, margin)
    }

    fn corners(&self) -> &[Corner] {
        &self.corners[..self.count]
    }

    /// Calls `visit` for the corners of the part with `sign * coordinate <= limit`, in order.
    fn visit_clipped(&self, axis: usize, sign: f64, limit: f64, margin: f64, mut visit: impl FnMut(Corner)) {
        let Some(mut previous) = self.corners().last() else {
            return;
        };
        for corner in self.corners() {
            let was_inside = sign * previous.position[axis] <= limit;
            let is_inside = sign * corner.position[axis] <= limit;
            if was_inside != is_inside {
                visit(previous.towards(corner, axis, sign * limit, margin));
            }
            if is_inside {
                visit(*corner);
            }
            previous = corner;
        }
    }

    fn clip(&self, axis: usize, sign: f64, limit: f64, margin: f64) -> Polygon {
        let mut clipped = Polygon { corners: [Corner::default(); MAX_CORNERS], count: 0 };
        let mut fits = true;
        self.visit_clipped(axis, sign, limit, margin, |corner| {
            fits &= clipped.count < MAX_CORNERS;
            if fits {
                clipped.corners[clipped.count] = corner;
                clipped.count += 1;
            }
        });
        if !fits {
            return *self; // not clipped at all: larger, hence still conservative
        }
        clipped
    }

    /// The box around the part with `sign * coordinate <= limit`.
    fn bounds(&self, axis: usize, sign: f64, limit: f64, margin: f64) -> Bounds {
        let mut bounds = Bounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };
        self.visit_clipped(axis, sign, limit, margin, |corner| bounds.include(&corner));
        bounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_split_triangle_has_tight_parts() {
        let vertices = [[Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0)]];
        let whole = Reference::whole(&vertices, 0);
        let cell = Cell::around(&vertices, &[0]);
        let (left, right) = whole.split(&vertices, &cell, 0, 3.0);
        let (left, right) = (left.unwrap(), right.unwrap());
        assert_eq!((left.low, left.high), ([0.0; 3], [3.0, 4.0, 0.0]));
        assert_eq!((right.low, right.high[0]), ([3.0, 0.0, 0.0], 4.0));
        assert!(right.high[1] >= 1.0 && right.high[1] <= 1.0f32.next_up());
    }

    #[test]
    fn a_corner_outside_of_the_cell_leaves_nothing() {
        let vertices = [[Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0)]];
        let cell = Cell { low: [2.0, 0.0, 0.0], high: [4.0, 4.0, 1.0] };
        let loose = Reference { low: [2.0, 0.0, 0.0], high: [4.0, 4.0, 0.0], triangle: 0 };
        let (below, above) = loose.split(&vertices, &cell, 1, 2.5);
        assert_eq!(below.unwrap().high[1], 2.0f32.next_up());
        assert_eq!(above, None, "y > 2.5 has x < 1.5 only");
    }

    #[test]
    fn rounding_is_outwards() {
        let x = 0.1f64;
        assert!(f64::from(round_down(x)) <= x && f64::from(round_up(x)) >= x);
        assert_eq!(round_down(0.5), 0.5);
        assert_eq!(round_down(-0.0).to_bits(), 0);
        assert!(round_up(1e-60) > 0.0 && round_down(-1e-60) < 0.0);
    }
}
