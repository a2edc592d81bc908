//! Twin of `cl/shared/slab.cl`: slab tests of boxes at one fma a plane. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x < limit)` is also true for NaN, and that is meant

use super::instances::{transform_direction, transform_point};
use super::math::{abs3, fma3, max_component, max_or};
use super::ray::Ray;
use crate::bounds::{
    FARTHEST_START, LEAST_PADDING, LEAST_SLAB_DIRECTION, OBJECT_ORIGIN_ERROR, ORIGIN_ERROR, SLACK, THICKEST,
    TRANSFORM_ERROR,
};
use crate::layout::Float4;
use crate::shared::{INSTANCE_BLUR, INSTANCE_REACH, INSTANCE_TO_OBJECT};
use glam::Vec3;

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

#[inline(always)]
fn slab_inverses(ray: &Ray) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| slab_inverse(ray.direction[k], LEAST_SLAB_DIRECTION)))
}

/// Whether boxes within `low..high` that are larger by `padding` than what they hold need no padding of this ray.
#[inline(always)]
pub fn is_padding_enough(ray: &Ray, low: Vec3, high: Vec3, near_reach: f32, padding: f32) -> bool {
    let thickness = SLACK.mul_add(padding_distance(ray, low, high, near_reach), LEAST_PADDING);
    max_component(abs3(ray.origin)).mul_add(ORIGIN_ERROR, thickness) <= padding
}

/// How far boxes within `low..high` are from the start of the ray at most, but for what those have been made larger by
/// that are not within `near_reach` of 0, if the ray starts there.
#[inline(always)]
pub fn padding_distance(ray: &Ray, low: Vec3, high: Vec3, near_reach: f32) -> f32 {
    let (farthest, nearer) = (ray.farthest_distance(low, high), 2.0 * near_reach);
    let is_near = nearer > 0.0 && max_component(abs3(ray.origin)) <= near_reach;
    if is_near && nearer < farthest { nearer } else { farthest }
}

impl Slabs {
    /// Those of a ray that meets every box.
    const ALL: Slabs = Slabs { inv: Vec3::ZERO, enter: Vec3::NEG_INFINITY, leave: Vec3::INFINITY };

    /// For boxes within `low..high`.
    #[inline(always)]
    pub fn new(ray: &Ray, low: Vec3, high: Vec3, near_reach: f32) -> Slabs {
        let distance = padding_distance(ray, low, high, near_reach);
        if !(distance < FARTHEST_START) {
            return Slabs::ALL;
        }
        let thickness = SLACK.mul_add(distance, LEAST_PADDING);
        Slabs::thick(ray.origin, slab_inverses(ray), fma3(abs3(ray.origin), ORIGIN_ERROR, Vec3::splat(thickness)))
    }

    /// Those without padding: for rays for which boxes have [padding enough](is_padding_enough).
    #[inline(always)]
    pub fn without_padding(ray: &Ray) -> Slabs {
        let inv = slab_inverses(ray);
        let at_origin = -(ray.origin * inv);
        Slabs { inv, enter: at_origin, leave: at_origin }
    }

    /// Those whose planes are `thickness` away from where they are, on both sides.
    #[inline(always)]
    fn thick(origin: Vec3, inv: Vec3, thickness: Vec3) -> Slabs {
        let padding = thickness * abs3(inv);
        let at_origin = -(origin * inv);
        Slabs { inv, enter: at_origin - padding, leave: at_origin + padding }
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

/// The same for two boxes at a time, each given by its middle and half of its size.
#[derive(Debug, Clone, Copy)]
pub struct PairSlabs {
    xy: AxisPair,
    zz: AxisPair,
}

/// Of two axes, or one twice.
#[derive(Debug, Clone, Copy)]
struct AxisPair {
    inv: [f32; 4],
    offset: [f32; 4],
    half_inv: [f32; 4],
}

impl AxisPair {
    #[inline(always)]
    fn new(s: &Slabs, [i, j]: [usize; 2]) -> AxisPair {
        AxisPair {
            inv: [s.inv[i], -s.inv[i], s.inv[j], -s.inv[j]],
            offset: [s.enter[i], -s.leave[i], s.enter[j], -s.leave[j]],
            half_inv: [i, i, j, j].map(|axis| -s.inv[axis].abs()),
        }
    }

    /// `[t_enter, -t_leave]` of `[middle, half_size]` of each axis.
    #[inline(always)]
    fn times(&self, [middle0, half0, middle1, half1]: [f32; 4]) -> [f32; 4] {
        let (middle, half) = ([middle0, middle0, middle1, middle1], [half0, half0, half1, half1]);
        std::array::from_fn(|i| half[i].mul_add(self.half_inv[i], middle[i].mul_add(self.inv[i], self.offset[i])))
    }
}

impl PairSlabs {
    /// For the same ray as `s`.
    #[inline(always)]
    pub fn new(s: &Slabs) -> PairSlabs {
        PairSlabs { xy: AxisPair::new(s, [0, 1]), zz: AxisPair::new(s, [2, 2]) }
    }

    /// Where the ray enters and leaves two boxes, `[t_enter, -t_leave]` of each, no wider than `limits` are, of
    /// `t_near` and `t_limit`. The boxes are `[middle.x, half_size.x, middle.y, half_size.y]` of each, and z of both.
    #[inline(always)]
    pub fn clip(&self, [t_near, t_limit]: [f32; 2], xy0: [f32; 4], xy1: [f32; 4], zz: [f32; 4]) -> [f32; 4] {
        let (t0, t1, tz) = (self.xy.times(xy0), self.xy.times(xy1), self.zz.times(zz));
        let (tx, ty) = ([t0[0], t0[1], t1[0], t1[1]], [t0[2], t0[3], t1[2], t1[3]]);
        let limits = [t_near, -t_limit, t_near, -t_limit];
        std::array::from_fn(|i| max_or(max_or(tx[i], ty[i]), max_or(tz[i], limits[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Aabb, Middle, NOWHERE};
    use crate::bounds::{EPSILON, HIT_ERROR, padding_of_boxes};
    use crate::random::Random;
    use crate::shared::NO_PRIMITIVE;

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

    /// When the ray is between two planes of a box that is larger by `thickness`, in f64: the padding for
    /// second order is some 2^28 times its errors.
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

    /// Asserts that no hit between the planes of the query's box is outside of the interval. False where there can be
    /// none.
    fn holds_hits(query: &Query, axis: usize, computed: [f32; 2]) -> bool {
        let planes = query.bounds.map(|corner| corner[axis]);
        let (distance, most) = reach(query);
        let [from, to] = interval(&query.ray, axis, planes, f64::from(HIT_ERROR * EPSILON) * distance);
        let (from, to) = (from.max(-most), to.min(most));
        let [t_enter, t_leave] = computed.map(f64::from);
        let is_held = t_enter <= from && t_leave >= to;
        let message = || format!("axis {axis}: {:?} {planes:?} (seed {SEED})", query.ray);
        assert!(from > to || is_held, "{t_enter}..{t_leave} {from}..{to}, {}", message());
        from <= to
    }

    fn slab_interval(slabs: &Slabs, axis: usize, [low, high]: [f32; 2]) -> [f32; 2] {
        let (near, far) = if slabs.inv[axis] < 0.0 { (high, low) } else { (low, high) };
        [near.mul_add(slabs.inv[axis], slabs.enter[axis]), far.mul_add(slabs.inv[axis], slabs.leave[axis])]
    }

    #[test]
    fn no_slab_is_left_before_or_entered_after_any_hit_in_it() {
        let mut random = Random::new(SEED);
        let (mut checked, mut huge) = (0, 0);
        for i in 0..400_000 {
            let query = query(i, &mut random);
            if query.ray.t_near > query.ray.t_far {
                continue; // no direction
            }
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1], 0.0);
            huge += usize::from(slabs.enter == Vec3::NEG_INFINITY);
            for axis in 0..3 {
                let planes = query.bounds.map(|corner| corner[axis]);
                checked += usize::from(holds_hits(&query, axis, slab_interval(&slabs, axis, planes)));
            }
        }
        assert!(checked > 500_000 && huge > 10_000, "{checked} {huge}");
    }

    #[test]
    fn slabs_are_no_thicker_than_twice_the_errors() {
        let mut random = Random::new(SEED + 1);
        let mut culled = 0;
        for i in 0..200_000 {
            let query = query(i, &mut random);
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1], 0.0);
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
                // Where the thick slab is not met within reach, zero components among them, neither is the computed
                // one.
                if from.max(-most) > to.min(most) {
                    culled += 1;
                    assert!(t_enter.max(-most) > t_leave.min(most), "{i}, axis {axis}: {:?} {planes:?}", query.ray);
                }
            }
        }
        assert!(culled > 30_000, "{culled}");
    }

    /// As [`slab_interval`], of a box that is given by its middle.
    fn middle_interval(slabs: &Slabs, axis: usize, bounds: &Middle) -> [f32; 2] {
        let (inv, half) = (slabs.inv[axis], bounds.half_size[axis]);
        let middle = |offset: f32| bounds.middle[axis].mul_add(inv, offset);
        [(-half).mul_add(inv.abs(), middle(slabs.enter[axis])), half.mul_add(inv.abs(), middle(slabs.leave[axis]))]
    }

    fn middle_of([low, high]: [Vec3; 2], padding: f32) -> Middle {
        Middle::new(&Aabb { low, high }, padding)
    }

    #[test]
    fn no_padded_box_is_left_before_or_entered_after_any_hit_in_it() {
        let mut random = Random::new(SEED + 3);
        let (mut checked, mut without_padding) = (0, 0);
        for i in 0..400_000 {
            let query = query(i, &mut random);
            let [low, high] = query.scene;
            if query.ray.t_near > query.ray.t_far {
                continue; // no direction
            }
            let padding = padding_of_boxes(low, high);
            let needs_no_padding = is_padding_enough(&query.ray, low, high, 0.0, padding);
            let with_padding = (Slabs::new(&query.ray, low, high, 0.0), middle_of(query.bounds, 0.0));
            let padded_box = (Slabs::without_padding(&query.ray), middle_of(query.bounds, padding));
            without_padding += usize::from(needs_no_padding);
            for (slabs, bounds) in std::iter::once(&with_padding).chain(needs_no_padding.then_some(&padded_box)) {
                for axis in 0..3 {
                    checked += usize::from(holds_hits(&query, axis, middle_interval(slabs, axis, bounds)));
                }
            }
        }
        assert!(
            checked > 700_000 && without_padding > 100_000 && without_padding < 300_000,
            "{checked} {without_padding}"
        );
    }

    #[test]
    fn rays_that_start_in_the_scene_or_not_far_away_have_padding_enough() {
        let mut random = Random::new(SEED + 4);
        for i in 0..100_000 {
            let query = query(i, &mut random);
            let [low, high] = query.scene;
            let side = (high - low).max_element();
            if side < 1e-5 {
                continue; // that is a few roundings, and so would be the distances here
            }
            let from_corner = (2.9 * random.vec3()) * side; // up to 2.9 sides beside a corner, 3.9 from the others
            for origin in [low.lerp(high, 0.5 + 0.5 * random.signed()), low + from_corner, high + from_corner] {
                let ray = Ray::new(origin, Vec3::ONE, 0.0, f32::INFINITY, NO_PRIMITIVE);
                assert!(
                    is_padding_enough(&ray, low, high, 0.0, padding_of_boxes(low, high)),
                    "{i}: {origin} {low} {high}"
                );
                // Padding is for the origin's distance from that of space, too, which is small here.
                let far = Ray::new(origin + 9.0 * side, Vec3::ONE, 0.0, f32::INFINITY, NO_PRIMITIVE);
                let is_about_zero = side > 0.2;
                assert!(
                    !is_about_zero || !is_padding_enough(&far, low, high, 0.0, padding_of_boxes(low, high)),
                    "{i}: {far:?}"
                );
            }
        }
    }

    #[test]
    fn a_box_that_there_is_not_is_never_entered() {
        let mut random = Random::new(SEED + 5);
        for i in 0..100_000 {
            let query = query(i, &mut random);
            let slabs =
                [Slabs::new(&query.ray, query.scene[0], query.scene[1], 0.0), Slabs::without_padding(&query.ray)];
            let needs_no_padding = is_padding_enough(&query.ray, query.scene[0], query.scene[1], 0.0, 1.0);
            for slabs in
                slabs.iter().take(1 + usize::from(needs_no_padding)).filter(|slabs| slabs.enter != Vec3::NEG_INFINITY)
            {
                for axis in 0..3 {
                    let [t_enter, t_leave] = middle_interval(slabs, axis, &NOWHERE);
                    assert!(t_enter > t_leave, "{i}, axis {axis}: {:?} {t_enter} {t_leave}", query.ray);
                }
            }
        }
    }

    #[test]
    fn pairs_clip_as_slabs_one_by_one() {
        let mut random = Random::new(SEED + 2);
        for i in 0..20_000 {
            let (query, other) = (query(i, &mut random), random.vec3());
            let slabs = Slabs::new(&query.ray, query.scene[0], query.scene[1], 0.0);
            let boxes = [query.bounds, [query.bounds[0].min(other), query.bounds[1].max(other)]];
            let boxes = boxes.map(|corners| middle_of(corners, 0.0));
            let [xy0, xy1] = boxes.map(|Middle { middle, half_size }| [middle.x, half_size.x, middle.y, half_size.y]);
            let zz = boxes.map(|Middle { middle, half_size }| [middle.z, half_size.z]);
            let limits = [0.25, 2.0];
            let got = PairSlabs::new(&slabs).clip(limits, xy0, xy1, [zz[0][0], zz[0][1], zz[1][0], zz[1][1]]);
            for (k, bounds) in boxes.iter().enumerate() {
                let t = [0, 1, 2].map(|axis| middle_interval(&slabs, axis, bounds));
                let t_enter = t.iter().map(|t| t[0]).fold(limits[0], f32::max);
                let t_leave = t.iter().map(|t| t[1]).fold(limits[1], f32::min);
                assert_eq!([got[2 * k], -got[2 * k + 1]], [t_enter, t_leave], "{i}: {:?}", query.ray);
            }
        }
    }
}
