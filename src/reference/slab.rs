//! Twin of `cl/shared/slab.cl`: slab tests of boxes at one fma a plane. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x < limit)` is also true for NaN, and that is meant

use super::math::{abs3, fma3, max_or};
use super::ray::{EPSILON, Ray, SLACK};
use glam::Vec3;

const LEAST_SLAB_DIRECTION: f32 = 1.0 / (1u64 << 26) as f32;
const ORIGIN_ERROR: f32 = 4.0 * EPSILON;
const LEAST_PAD: f32 = 1.0 / (1u128 << 120) as f32;
const FARTHEST_START: f32 = (1u128 << 64) as f32;

/// Of a ray. The near plane of a slab is the upper one where `inv` < 0.
#[derive(Debug, Clone, Copy)]
pub struct Slabs {
    /// The reciprocal of the direction, limited.
    pub inv: Vec3,
    /// The t of a near plane is it times `inv`, plus this.
    pub enter: Vec3,
    /// The same of a far plane.
    pub leave: Vec3,
}

#[inline(always)]
fn slab_inverse(direction: f32, inv_direction: f32) -> f32 {
    let largest = 1.0 / LEAST_SLAB_DIRECTION;
    if direction.abs() >= LEAST_SLAB_DIRECTION {
        inv_direction
    } else if direction < 0.0 {
        -largest
    } else {
        largest
    }
}

impl Slabs {
    /// For boxes within `low..high`.
    #[inline(always)]
    pub fn new(ray: &Ray, low: Vec3, high: Vec3) -> Slabs {
        let distance = ray.farthest_distance(low, high);
        if !(distance < FARTHEST_START) {
            return Slabs { inv: Vec3::ZERO, enter: Vec3::NEG_INFINITY, leave: Vec3::INFINITY };
        }
        let inv = Vec3::from_array(std::array::from_fn(|k| slab_inverse(ray.direction[k], ray.inv_direction[k])));
        let thickness = SLACK.mul_add(distance, LEAST_PAD);
        let pad = fma3(abs3(ray.origin), ORIGIN_ERROR, Vec3::splat(thickness)) * abs3(inv);
        let at_origin = -(ray.origin * inv);
        Slabs { inv, enter: at_origin - pad, leave: at_origin + pad }
    }
}

/// The same for two boxes at a time.
#[derive(Debug, Clone, Copy)]
pub struct PairSlabs {
    inv_xy: [f32; 4],
    inv_zz: [f32; 4],
    offset_xy: [f32; 4],
    offset_zz: [f32; 4],
    swap_xy: [bool; 2],
    swap_zz: [bool; 2],
}

impl PairSlabs {
    /// For the same ray as `s`.
    #[inline(always)]
    pub fn new(s: &Slabs) -> PairSlabs {
        let swap = [0, 1, 2].map(|k| s.inv[k] < 0.0);
        PairSlabs {
            inv_xy: [s.inv.x, -s.inv.x, s.inv.y, -s.inv.y],
            inv_zz: [s.inv.z, -s.inv.z, s.inv.z, -s.inv.z],
            offset_xy: [s.enter.x, -s.leave.x, s.enter.y, -s.leave.y],
            offset_zz: [s.enter.z, -s.leave.z, s.enter.z, -s.leave.z],
            swap_xy: [swap[0], swap[1]],
            swap_zz: [swap[2]; 2],
        }
    }

    /// Where the ray enters and leaves two boxes, `[t_enter, -t_leave]` of each, no wider than `limits` are. The boxes are
    /// `[low.x, high.x, low.y, high.y]` of each, and z of both.
    #[inline(always)]
    pub fn clip(&self, limits: [f32; 4], xy0: [f32; 4], xy1: [f32; 4], zz: [f32; 4]) -> [f32; 4] {
        let t0 = times(xy0, self.swap_xy, self.inv_xy, self.offset_xy);
        let t1 = times(xy1, self.swap_xy, self.inv_xy, self.offset_xy);
        let tz = times(zz, self.swap_zz, self.inv_zz, self.offset_zz);
        let (tx, ty) = ([t0[0], t0[1], t1[0], t1[1]], [t0[2], t0[3], t1[2], t1[3]]);
        std::array::from_fn(|i| max_or(max_or(tx[i], ty[i]), max_or(tz[i], limits[i])))
    }
}

/// The t of two pairs of planes, each pair swapped or not.
#[inline(always)]
fn times([a, b, c, d]: [f32; 4], swap: [bool; 2], inv: [f32; 4], offset: [f32; 4]) -> [f32; 4] {
    let (a, b) = if swap[0] { (b, a) } else { (a, b) };
    let (c, d) = if swap[1] { (d, c) } else { (c, d) };
    let near_far = [a, b, c, d];
    std::array::from_fn(|i| near_far[i].mul_add(inv[i], offset[i]))
}
