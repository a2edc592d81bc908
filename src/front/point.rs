//! The closest point of a scene.

use crate::closest::Closest;

/// The point of a scene that is closest to a point; from [`Tracer::closest_points`](crate::Tracer::closest_points).
///
/// Each number is the exact one, rounded once to the nearest float32. So the rounded point need not be at exactly
/// `distance`, nor at the weights `u` and `v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// Where it is, world units.
    pub point: [f32; 3],
    /// How far that is, world units; infinite beyond the largest float.
    pub distance: f32,
    /// The triangle that it is on, the first being 0; of several that are as near the lowest number.
    pub triangle: u32,
    /// Where on the triangle: the weight of its second vertex. The first has 1 - u - v.
    pub u: f32,
    /// The weight of its third vertex.
    pub v: f32,
}

impl ClosestPoint {
    pub(super) fn of(closest: &Closest) -> ClosestPoint {
        let Closest { point, distance, triangle, u, v } = *closest;
        ClosestPoint { point: point.to_array(), distance, triangle, u, v }
    }
}
