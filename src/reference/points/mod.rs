//! Twins of `cl/points/`: which triangles may be the nearest one of a point.

pub mod binary;
mod distance;
pub mod wide;

use crate::math::min_or;
use distance::{farthest_distance, limit_of, may_be_within};
use glam::Vec3;

/// What a traversal looks for, and what it has found.
pub struct Search<'a> {
    /// Within this there surely is a triangle; or, with a list, triangles are looked for within this.
    pub distance: f32,
    /// How many are listed.
    pub listed: u32,
    /// Boxes are farther where the square of their distance is larger than this.
    limit: f32,
    list: Option<&'a mut dyn FnMut(u32)>,
}

impl<'a> Search<'a> {
    /// For a distance within which there surely is a triangle.
    #[inline(always)]
    pub fn nearest() -> Search<'a> {
        Search { distance: f32::INFINITY, listed: 0, limit: limit_of(f32::INFINITY), list: None }
    }

    /// For all triangles that may be within `distance`.
    #[inline(always)]
    pub fn within(distance: f32, list: &'a mut dyn FnMut(u32)) -> Search<'a> {
        Search { distance, listed: 0, limit: limit_of(distance), list: Some(list) }
    }

    /// Looks at a triangle, from the point as the origin.
    #[inline(always)]
    fn take(&mut self, primitive: u32, corners: [Vec3; 3]) {
        match &mut self.list {
            None => {
                self.distance = min_or(farthest_distance(corners), self.distance);
                self.limit = limit_of(self.distance);
            }
            Some(list) if may_be_within(corners, self.distance) => {
                list(primitive);
                self.listed += 1;
            }
            Some(_) => {}
        }
    }
}

/// The least float that is no less than a distance: what boxes must be within the limit of.
#[cfg(test)]
fn reached(exact: f64) -> f32 {
    let rounded = exact as f32;
    if f64::from(rounded) < exact { rounded.next_up() } else { rounded }
}
