//! Bounds of rounding errors that builders, kernels and the twin share: what one of them leaves open another one must
//! cover. Each is derived in `cl/shared/ray.cl` and `cl/shared/slab.cl`, where kernels have the same values, and judged
//! here on its own: the tests repeat the operations that it is for and compare with f64 or integers of any length.
//!
//! A constant that a test finds more than half used up could not be halved; of the others the test says why it is
//! larger.

use crate::layout::device_const;
use glam::Vec3;

device_const! {
    /// Bounds of roundings, planes and hits: `cl/shared/ray.cl`.
    pub group ROUNDING_BOUNDS;
    /// The largest relative error of one rounding.
    pub const EPSILON: f32 = 1.0 / 16_777_216.0;
    /// More than the t of a plane is off by, upwards.
    pub const WIDEN_UP: f32 = 1.0 + 10.0 * EPSILON;
    /// The same downwards.
    pub const WIDEN_DOWN: f32 = 1.0 - 10.0 * EPSILON;
    /// What the distance of a plane from the origin is off by, however small it is.
    pub const PLANE_ERROR: f32 = 1.0 / (1u128 << 64) as f32;
    /// How far a computed hit can lie outside of its triangle's box, in units of EPSILON times the vertices' distance.
    pub const HIT_ERROR: f32 = 32.0;
    /// With it the rounding of the tests of thick boxes.
    pub const SLACK: f32 = (HIT_ERROR + 8.0) * EPSILON;
}

device_const! {
    /// Spheres: `cl/traverse/spheres.cl`.
    pub group SPHERE_BOUNDS;
    /// What a sphere grows by, in units of the farthest distance.
    pub const SPHERE_SLACK: f32 = 96.0 * EPSILON;
}

device_const! {
    /// Boxes: `cl/shared/slab.cl`, those of objects behind its `INSTANCES`.
    pub group SLAB_BOUNDS;
    /// The least component of a direction in slab tests.
    pub const LEAST_SLAB_DIRECTION: f32 = 1.0 / (1u64 << 26) as f32;
    /// What slab tests are off by for a start far from 0, in units of its largest coordinate.
    pub const ORIGIN_ERROR: f32 = 4.0 * EPSILON;
    /// A padding at least this thick stays in float32's range.
    pub const LEAST_PADDING: f32 = 1.0 / (1u128 << 120) as f32;
    /// From a start this far away a ray meets every box.
    pub const FARTHEST_START: f32 = (1u128 << 64) as f32;
    /// What slab tests in an object are off by for a start far from 0 in the scene, in units of its largest coordinate.
    pub const TRANSFORM_ERROR: f32 = 8.0 * EPSILON;
    /// The same for a start far from 0 in the object.
    pub const OBJECT_ORIGIN_ERROR: f32 = 12.0 * EPSILON;
    /// With a thicker padding a ray meets every box of an object.
    pub const THICKEST: f32 = (1u128 << 126) as f32;
}

device_const! {
    /// Distances of points: `cl/kernels/closest_point.cl`.
    pub group DISTANCE_BOUNDS;
    /// What bounds of a triangle's distance are off by, in units of the distance of its farthest corner.
    pub const DISTANCE_ERROR: f32 = 32.0 * EPSILON;
    /// What they are off by, however near the triangle is.
    pub const LEAST_DISTANCE_ERROR: f32 = 1.0 / (1u128 << 60) as f32;
    /// What makes up for the roundings of a distance from the middle of a box.
    pub const BOX_DISTANCE_DOWN: f32 = 1.0 - 4.0 * EPSILON;
    /// What makes up for the roundings of squared distances of boxes.
    pub const BOX_LIMIT_UP: f32 = 1.0 + 16.0 * EPSILON;
    /// Triangles that a point's list has room for.
    pub const MOST_CANDIDATES: u32 = 16;
}

/// Rays that start no farther away than this from any corner of the scene's box, on any axis, in units of the box's
/// largest side, want no more than the padding of its boxes: those that start in it, and from cameras three times its
/// size beside it. Others add a padding of their own. As much again would make boxes larger by a hundred thousandth of
/// the scene.
const PADDED_DISTANCE: f32 = 4.0;

/// By how much boxes are made larger than what they hold, so that most rays need no padding of their own: the thickness
/// of that of a ray from `PADDED_DISTANCE` away. For boxes within `low..high`.
pub fn padding_of_boxes(low: Vec3, high: Vec3) -> f32 {
    let distance = PADDED_DISTANCE * (high - low).max_element();
    let farthest_origin = low.abs().max(high.abs()).max_element() + distance;
    let padding = farthest_origin.mul_add(ORIGIN_ERROR, SLACK.mul_add(distance, LEAST_PADDING));
    if padding.is_finite() { padding } else { 0.0 }
}

/// As [`padding_of_boxes`], for boxes and rays within `near_reach` of 0.
pub fn padding_within(near_reach: f32) -> f32 {
    near_reach.mul_add(ORIGIN_ERROR, SLACK.mul_add(2.0 * near_reach, LEAST_PADDING))
}

#[cfg(test)]
mod tests;
