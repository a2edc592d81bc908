//! Twin of `cl/shared/slab.cl`: slab tests of boxes at one fma a plane. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x < limit)` is also true for NaN, and that is meant

use super::instances::{transform_direction, transform_point};
use super::math::{abs3, fma3, max_component, max_or};
use super::ray::{EPSILON, Ray, SLACK};
use crate::layout::Float4;
use crate::shared::{INSTANCE_BLUR, INSTANCE_REACH, INSTANCE_TO_OBJECT};
use glam::Vec3;

const LEAST_SLAB_DIRECTION: f32 = 1.0 / (1u64 << 26) as f32;
const ORIGIN_ERROR: f32 = 4.0 * EPSILON;
/// A pad at least this thick stays in float32's range.
pub const LEAST_PAD: f32 = 1.0 / (1u128 << 120) as f32;
const FARTHEST_START: f32 = (1u128 << 64) as f32;
const TRANSFORM_ERROR: f32 = 8.0 * EPSILON;
const OBJECT_ORIGIN_ERROR: f32 = 12.0 * EPSILON;
const THICKEST: f32 = (1u128 << 126) as f32;

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
fn slab_inverse(direction: f32, least: f32) -> f32 {
    let limited = if direction < 0.0 { -least } else { least };
    1.0 / if direction.abs() >= least { direction } else { limited }
}

impl Slabs {
    /// Those of a ray that meets every box.
    const ALL: Slabs = Slabs { inv: Vec3::ZERO, enter: Vec3::NEG_INFINITY, leave: Vec3::INFINITY };

    /// For boxes within `low..high`.
    #[inline(always)]
    pub fn new(ray: &Ray, low: Vec3, high: Vec3) -> Slabs {
        let distance = ray.farthest_distance(low, high);
        if !(distance < FARTHEST_START) {
            return Slabs::ALL;
        }
        let inv = Vec3::from_array(std::array::from_fn(|k| slab_inverse(ray.direction[k], LEAST_SLAB_DIRECTION)));
        let thickness = SLACK.mul_add(distance, LEAST_PAD);
        Slabs::thick(ray.origin, inv, fma3(abs3(ray.origin), ORIGIN_ERROR, Vec3::splat(thickness)))
    }

    /// Those whose planes are `thickness` away from where they are, on both sides.
    #[inline(always)]
    fn thick(origin: Vec3, inv: Vec3, thickness: Vec3) -> Slabs {
        let pad = thickness * abs3(inv);
        let at_origin = -(origin * inv);
        Slabs { inv, enter: at_origin - pad, leave: at_origin + pad }
    }

    /// For boxes within an object, of whose instance these are the `records`.
    #[inline(always)]
    pub fn of_instance(ray: &Ray, low: Vec3, high: Vec3, records: &[Float4]) -> Slabs {
        let rows = &records[INSTANCE_TO_OBJECT as usize..];
        let (reach, blur) = (records[INSTANCE_REACH as usize].xyz(), records[INSTANCE_BLUR as usize].xyz());
        let distance = ray.farthest_distance(low, high);
        let (origin, direction) = (transform_point(rows, ray.origin), transform_direction(rows, ray.direction));
        let from_ray = SLACK.mul_add(distance, TRANSFORM_ERROR * max_component(abs3(ray.origin)));
        let thickness = fma3(reach, from_ray, fma3(abs3(origin), OBJECT_ORIGIN_ERROR, blur));
        let is_below = |v: Vec3| v.x < THICKEST && v.y < THICKEST && v.z < THICKEST;
        if !(distance < FARTHEST_START && is_below(abs3(direction)) && is_below(thickness)) {
            return Slabs::ALL;
        }
        let inverse = |k: usize| slab_inverse(direction[k], reach[k] * LEAST_SLAB_DIRECTION);
        Slabs::thick(origin, Vec3::from_array([0, 1, 2].map(inverse)), thickness)
    }
}

/// The same for two boxes at a time. Near planes are selected here; on GPUs the kernels multiply both, one of
/// them by 0: the same numbers.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::ray::HIT_ERROR;
    use crate::shared::NO_PRIMITIVE;
    use crate::stress::Random;

    const SEED: u64 = 20_081_121;

    /// A component of a direction: ordinary, zero, subnormal, or about the least that is not changed.
    fn component(random: &mut Random) -> f32 {
        let sign = if random.bits().is_multiple_of(2) { 1.0 } else { -1.0 };
        let least = LEAST_SLAB_DIRECTION;
        let kinds = [0.0, 1e-45, 1e-40, 1.2e-38, 1e-30, least, least.next_down(), least.next_up(), 1e-4, 1.0];
        match random.bits() % 3 {
            0 => sign * kinds[random.bits() as usize % kinds.len()],
            1 => random.signed() * 2f32.powi(-(random.bits() as i32 % 30).abs()),
            _ => random.signed(),
        }
    }

    /// A ray about a scene, and a box in it whose planes the ray may run in.
    struct Query {
        ray: Ray,
        scene: [Vec3; 2],
        bounds: [Vec3; 2],
    }

    fn query(i: usize, random: &mut Random) -> Query {
        // Scenes about the origin of space, far from it, and flat ones.
        let middle = random.vec3() * [0.0, 1.0, 1.9][i % 3];
        let size = [1.0, 1e-3, 1e-7][i / 3 % 3];
        let mut corners =
            [(); 4].map(|()| (middle + random.vec3() * size).clamp(Vec3::splat(-1.99), Vec3::splat(1.99)));
        if i.is_multiple_of(5) {
            corners.iter_mut().for_each(|corner| corner.x = middle.x);
        }
        let low = |points: &[Vec3]| points.iter().copied().reduce(Vec3::min).unwrap();
        let high = |points: &[Vec3]| points.iter().copied().reduce(Vec3::max).unwrap();
        let bounds = [low(&corners[..2]), high(&corners[..2])];
        let mut origin = match i / 9 % 4 {
            0 => corners[0],
            1 => corners[3] + random.vec3() * size,
            2 => random.vec3() * 2f32.powi((random.bits() % 60) as i32),
            _ => random.vec3() * 2f32.powi((random.bits() % 127) as i32),
        };
        for axis in 0..3 {
            let plane = bounds[random.bits() as usize % 2][axis];
            match random.bits() % 6 {
                0 => origin[axis] = plane,
                1 => origin[axis] = plane.next_up(),
                2 => origin[axis] = plane.next_down(),
                _ => {}
            }
        }
        let direction = Vec3::new(component(random), component(random), component(random));
        let mut ray = Ray::new(origin, direction, f32::NEG_INFINITY, f32::INFINITY, NO_PRIMITIVE);
        if i.is_multiple_of(2) {
            ray.origin_low = ray.origin * random.vec3() * EPSILON; // as of a ray that leaves a triangle
        }
        Query { ray, scene: [low(&corners), high(&corners)], bounds }
    }

    /// When the ray is between two planes of a box that is larger by `thickness`, in f64: the pads' room for second order is some 2^28
    /// times its errors.
    fn interval(ray: &Ray, axis: usize, [low, high]: [f32; 2], thickness: f64) -> [f64; 2] {
        let direction = f64::from(ray.direction[axis]);
        let from = |plane: f32| f64::from(plane) - f64::from(ray.origin[axis]) - f64::from(ray.origin_low[axis]);
        let (to_low, to_high) = (from(low) - thickness, from(high) + thickness);
        if direction == 0.0 {
            let is_inside = to_low <= 0.0 && to_high >= 0.0;
            return if is_inside { [f64::NEG_INFINITY, f64::INFINITY] } else { [f64::INFINITY, f64::NEG_INFINITY] };
        }
        let (t_low, t_high) = (to_low / direction, to_high / direction);
        [t_low.min(t_high), t_low.max(t_high)]
    }

    /// Largest distance on any axis, and with it the largest t of a hit.
    fn reach(query: &Query) -> (f64, f64) {
        let from = |p: Vec3| p.as_dvec3() - query.ray.origin.as_dvec3() - query.ray.origin_low.as_dvec3();
        let distance = query.scene.map(|p| from(p).abs().max_element()).into_iter().fold(0.0, f64::max);
        (distance, distance * (1.0 + f64::from(HIT_ERROR * EPSILON)))
    }

    fn slab_interval(slabs: &Slabs, axis: usize, [low, high]: [f32; 2]) -> [f32; 2] {
        let (near, far) = if slabs.inv[axis] < 0.0 { (high, low) } else { (low, high) };
        [near.mul_add(slabs.inv[axis], slabs.enter[axis]), far.mul_add(slabs.inv[axis], slabs.leave[axis])]
    }

    #[test]
    fn no_slab_is_left_before_or_entered_after_any_hit_in_it() {
        let mut random = Random(SEED);
        let (mut checked, mut huge) = (0, 0);
        for i in 0..400_000 {
            let query = query(i, &mut random);
            if query.ray.t_near > query.ray.t_far {
                continue; // no direction
            }
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1]);
            let (distance, most) = reach(&query);
            huge += usize::from(slabs.enter == Vec3::NEG_INFINITY);
            for axis in 0..3 {
                let planes = query.bounds.map(|corner| corner[axis]);
                let [t_enter, t_leave] = slab_interval(&slabs, axis, planes).map(f64::from);
                let [from, to] = interval(&query.ray, axis, planes, f64::from(HIT_ERROR * EPSILON) * distance);
                let (from, to) = (from.max(-most), to.min(most));
                if from <= to {
                    checked += 1;
                    let message = || format!("{i}, axis {axis}: {:?} {planes:?} (seed {SEED})", query.ray);
                    assert!(t_enter <= from && t_leave >= to, "{t_enter}..{t_leave} {from}..{to}, {}", message());
                }
            }
        }
        assert!(checked > 500_000 && huge > 10_000, "{checked} {huge}");
    }

    #[test]
    fn slabs_are_no_thicker_than_twice_the_errors() {
        let mut random = Random(SEED + 1);
        let mut culled = 0;
        for i in 0..200_000 {
            let query = query(i, &mut random);
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1]);
            let (distance, most) = reach(&query);
            if query.ray.t_near > query.ray.t_far || slabs.enter == Vec3::NEG_INFINITY {
                continue;
            }
            for axis in 0..3 {
                let planes = query.bounds.map(|corner| corner[axis]);
                let origin = f64::from(query.ray.origin[axis].abs());
                let thickness =
                    f64::from(EPSILON) * (2.0 * f64::from(SLACK / EPSILON) * distance + 8.0 * origin) + 1e-30;
                let [from, to] = interval(&query.ray, axis, planes, thickness);
                let [t_enter, t_leave] = slab_interval(&slabs, axis, planes).map(f64::from);
                // Where the thick slab is not met within reach, zero components among them, neither is the computed one.
                if from.max(-most) > to.min(most) {
                    culled += 1;
                    assert!(t_enter.max(-most) > t_leave.min(most), "{i}, axis {axis}: {:?} {planes:?}", query.ray);
                }
            }
        }
        assert!(culled > 30_000, "{culled}");
    }

    #[test]
    fn pairs_clip_as_slabs_one_by_one() {
        let mut random = Random(SEED + 2);
        for i in 0..20_000 {
            let (query, other) = (query(i, &mut random), random.vec3());
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1]);
            let boxes = [query.bounds, [query.bounds[0].min(other), query.bounds[1].max(other)]];
            let xy = boxes.map(|[low, high]| [low.x, high.x, low.y, high.y]);
            let [[low0, high0], [low1, high1]] = boxes;
            let (t_near, t_far) = (0.25, 2.0);
            let limits = [t_near, -t_far, t_near, -t_far];
            let got = PairSlabs::new(&slabs).clip(limits, xy[0], xy[1], [low0.z, high0.z, low1.z, high1.z]);
            for (k, [low, high]) in boxes.into_iter().enumerate() {
                let t = [0, 1, 2].map(|axis| slab_interval(&slabs, axis, [low[axis], high[axis]]));
                let t_enter = t.iter().map(|t| t[0]).fold(t_near, f32::max);
                let t_leave = t.iter().map(|t| t[1]).fold(t_far, f32::min);
                assert_eq!([got[2 * k], -got[2 * k + 1]], [t_enter, t_leave], "{i}: {:?}", query.ray);
            }
        }
    }
}
