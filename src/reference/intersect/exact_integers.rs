//! Twin of `cl/intersect/exact_integers.cl`: the last step of the exact test, in exact integers. The reasons are there.

use super::exact_filter::Decision;
use super::moller_trumbore::Intersection;
use crate::pack::SceneBuffers;
use crate::reference::shared::integer::{Integer, MAX_LIMBS, float_significand, integer_quotient, widen_exponents};
use crate::reference::shared::memory::vertices;
use crate::reference::shared::ray::{Ray, TrianglePoint};
use crate::shared::constants::{COMPARISON_BITS, INFINITE_EXPONENT, INFINITE_SIGNIFICAND, QUOTIENT_BITS};
use crate::shared::{Hit, NO_PRIMITIVE};
use glam::Vec3;

/// The units in which everything is an integer, as exponents of 2, and the limbs that hold every number.
#[derive(Debug, Clone, Copy)]
struct IntegerUnits {
    position: i32,
    vertex: i32,
    weight: i32,
    direction: i32,
    n: usize,
}

/// A ray as exact integers take it, in any units.
#[derive(Debug, Clone, Copy)]
pub struct IntegerRay {
    /// Where it starts.
    pub start: TrianglePoint,
    /// Where it goes.
    pub direction: Vec3,
    /// The closed interval of t, in the caller's units; an infinite end is open.
    pub limits: [f32; 2],
    /// The caller's t is that of `direction` times 2 to this.
    pub t_exponent: i32,
    /// Whether it leaves a triangle, with all that it starts on, too.
    pub leaves: bool,
}

impl IntegerRay {
    fn new(buffers: &SceneBuffers, ray: &Ray) -> IntegerRay {
        let leaves = ray.starts_on_triangle();
        let start = match leaves {
            true => TrianglePoint::of_weights(vertices(buffers, ray.skip), ray.start_weights),
            false => TrianglePoint::at(ray.origin),
        };
        let (direction, limits) = (ray.direction, [ray.t_min, ray.t_max]);
        IntegerRay { start, direction, limits, t_exponent: ray.t_exponent(), leaves }
    }
}

impl IntegerUnits {
    fn new(start: &TrianglePoint, direction: Vec3, triangles: &[[Vec3; 3]]) -> IntegerUnits {
        let (mut low_p, mut high_p, mut low_d, mut high_d) = (1000, -1000, 1000, -1000);
        let (mut low_w, mut high_w) = (0, 0);
        for p in start.vertices.iter().chain(triangles.iter().flatten()) {
            p.to_array().iter().for_each(|&x| widen_exponents(x, &mut low_p, &mut high_p));
        }
        direction.to_array().iter().for_each(|&x| widen_exponents(x, &mut low_d, &mut high_d));
        start.weights.iter().for_each(|&x| widen_exponents(x, &mut low_w, &mut high_w));
        let position = low_p + low_w;
        let (bits_p, bits_d) = ((high_p - position).max(1), (high_d - low_d).max(1));
        let bits = match triangles.len() > 1 {
            true => 5 * bits_p + bits_d + COMPARISON_BITS,
            false => 3 * bits_p.max(bits_d) + QUOTIENT_BITS,
        };
        let n = (bits as usize).div_ceil(32);
        IntegerUnits { position, vertex: position - low_w, weight: low_w, direction: low_d, n }
    }
}

/// The numbers behind every answer.
struct IntegerNumbers<const ROOM: usize> {
    distance: Integer<ROOM>,
    det: Integer<ROOM>,
    weight1: Integer<ROOM>,
    weight2: Integer<ROOM>,
}

/// Calls a function of numbers with room for `$n` limbs and not many more.
macro_rules! with_room {
    ($n:expr, $function:ident($($argument:expr),*)) => {
        match $n {
            0..=8 => $function::<8>($($argument),*),
            9..=16 => $function::<16>($($argument),*),
            17..=32 => $function::<32>($($argument),*),
            _ => $function::<MAX_LIMBS>($($argument),*),
        }
    };
}

impl<const ROOM: usize> IntegerNumbers<ROOM> {
    fn new(start: &TrianglePoint, direction: Vec3, [p0, p1, p2]: [Vec3; 3], units: &IntegerUnits) -> Self {
        let n = units.n;
        let integers = |v: Vec3, exponent: i32| v.to_array().map(|x| Integer::from_float(x, exponent, n));
        let minus = |mut a: [Integer<ROOM>; 3], b: &[Integer<ROOM>; 3]| {
            a.iter_mut().zip(b).for_each(|(a, b)| a.add(b, -1, n));
            a
        };
        let [base, others @ ..] = start.vertices;
        let mut origin = integers(base, units.position);
        for (other, &weight) in others.iter().zip(&start.weights).filter(|(_, weight)| **weight != 0.0) {
            let edge = minus(integers(*other, units.vertex), &integers(base, units.vertex));
            let weight = Integer::from_float(weight, units.weight, n);
            origin.iter_mut().zip(&edge).for_each(|(origin, edge)| origin.add_product(&weight, edge, 1, n));
        }
        let corner = integers(p0, units.position);
        let edge1 = minus(integers(p1, units.position), &corner);
        let edge2 = minus(integers(p2, units.position), &corner);
        let from = minus(corner, &origin);
        let direction = integers(direction, units.direction);
        let zero = Integer::ZERO;
        let mut numbers = IntegerNumbers { distance: zero, det: zero, weight1: zero, weight2: zero };
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let mut normal = zero;
            normal.add_product(&edge1[i], &edge2[j], 1, n);
            normal.add_product(&edge1[j], &edge2[i], -1, n);
            numbers.distance.add_product(&normal, &from[k], 1, n);
            numbers.det.add_product(&normal, &direction[k], 1, n);
            let mut moment = zero;
            moment.add_product(&from[i], &direction[j], 1, n);
            moment.add_product(&from[j], &direction[i], -1, n);
            numbers.weight1.add_product(&moment, &edge2[k], 1, n);
            numbers.weight2.add_product(&moment, &edge1[k], -1, n);
        }
        numbers
    }

    fn weight0(&self, n: usize) -> Integer<ROOM> {
        let mut weight0 = self.det;
        weight0.add(&self.weight1, -1, n);
        weight0.add(&self.weight2, -1, n);
        weight0
    }

    /// The float nearest to t times 2 to `exponent`.
    fn t(&self, units: &IntegerUnits, exponent: i32) -> f32 {
        integer_quotient(self.distance, self.det, units.position - units.direction + exponent, units.n)
    }

    /// The sign of the caller's t minus `limit`; t whose nearest float is infinite is not less than an infinite limit.
    fn compare_with_limit(&self, units: &IntegerUnits, t_exponent: i32, limit: f32) -> i32 {
        let n = units.n;
        let (mut distance, mut det, mut scaled) = (self.distance, self.det, Integer::ZERO);
        let sign = distance.take_sign(n) * det.take_sign(n);
        let limit_sign = i32::from(limit > 0.0) - i32::from(limit < 0.0);
        if sign != limit_sign || sign == 0 {
            return (sign - limit_sign).signum();
        }
        let (significand, exponent) = match limit.is_infinite() {
            true => (INFINITE_SIGNIFICAND, INFINITE_EXPONENT),
            false => float_significand(limit),
        };
        scaled.add_product(&Integer::from_limb(significand), &det, 1, n);
        let shift = units.position - units.direction + t_exponent - exponent;
        let (bits, limit_bits) = (distance.bits(n) + shift, scaled.bits(n));
        if bits != limit_bits {
            return if bits < limit_bits { -sign } else { sign };
        }
        if shift > 0 {
            distance.shift_up(shift as usize, n);
        } else {
            scaled.shift_up(-shift as usize, n);
        }
        distance.add(&scaled, -1, n);
        sign * distance.sign(n)
    }

    /// Whether the ray meets the triangle, and inside of its interval.
    fn is_hit(&self, ray: &IntegerRay, units: &IntegerUnits) -> bool {
        let n = units.n;
        let sign = self.det.sign(n);
        let is_outside = |weight: &Integer<ROOM>| sign * weight.sign(n) < 0;
        if sign == 0 || [&self.weight0(n), &self.weight1, &self.weight2].into_iter().any(is_outside) {
            return false;
        }
        let [t_min, t_max] = ray.limits;
        let after = self.compare_with_limit(units, ray.t_exponent, t_min);
        let before = -self.compare_with_limit(units, ray.t_exponent, t_max);
        // What a ray that leaves a triangle starts on, too, it leaves with it.
        after >= i32::from(ray.leaves || t_min.is_infinite()) && before >= i32::from(t_max.is_infinite())
    }
}

/// Whether the first of two triangles that are hit is nearer than the second one, or as near and `is_lower`.
fn is_nearer<const ROOM: usize>(
    start: &TrianglePoint,
    direction: Vec3,
    triangles: [[Vec3; 3]; 2],
    units: &IntegerUnits,
    is_lower: bool,
) -> bool {
    let n = units.n;
    let [numbers, best] = triangles.map(|triangle| IntegerNumbers::<ROOM>::new(start, direction, triangle, units));
    let sign = numbers.det.sign(n) * best.det.sign(n);
    let mut difference = Integer::ZERO;
    difference.add_product(&numbers.distance, &best.det, sign, n);
    difference.add_product(&best.distance, &numbers.det, -sign, n);
    let order = difference.sign(n);
    order < 0 || (order == 0 && is_lower)
}

/// The float nearest to the t, in the ray's own units, of a triangle that is hit inside of the ray's interval.
fn t_inside<const ROOM: usize>(ray: &IntegerRay, triangle: [Vec3; 3], units: &IntegerUnits) -> Option<f32> {
    let numbers = IntegerNumbers::<ROOM>::new(&ray.start, ray.direction, triangle, units);
    numbers.is_hit(ray, units).then(|| numbers.t(units, 0))
}

impl IntegerRay {
    /// Whether the triangle is hit inside of the ray's interval, and the float nearest to its t in the ray's own units.
    pub fn t_inside(&self, triangle: [Vec3; 3]) -> Option<f32> {
        let units = IntegerUnits::new(&self.start, self.direction, &[triangle]);
        with_room!(units.n, t_inside(self, triangle, &units))
    }

    /// Whether the first of two triangles that are hit is nearer than the second one, or as near and `is_lower`.
    pub fn is_nearer(&self, triangles: [[Vec3; 3]; 2], is_lower: bool) -> bool {
        let units = IntegerUnits::new(&self.start, self.direction, &triangles);
        with_room!(units.n, is_nearer(&self.start, self.direction, triangles, &units, is_lower))
    }

    /// Where in a triangle that is hit the ray meets it.
    pub fn meeting(&self, triangle: [Vec3; 3]) -> Meeting {
        let units = IntegerUnits::new(&self.start, self.direction, &[triangle]);
        with_room!(units.n, meeting(self, triangle, &units))
    }

    /// t in the caller's units, u and v of a triangle that is hit.
    pub fn finish(&self, triangle: [Vec3; 3]) -> Intersection {
        let units = IntegerUnits::new(&self.start, self.direction, &[triangle]);
        with_room!(units.n, finish(self, triangle, &units))
    }

    /// The weight of vertex 0 of a triangle that is hit.
    pub fn weight0(&self, triangle: [Vec3; 3]) -> f32 {
        let units = IntegerUnits::new(&self.start, self.direction, &[triangle]);
        with_room!(units.n, weight0(&self.start, self.direction, triangle, &units))
    }
}

/// Where a ray meets a triangle that it hits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meeting {
    /// Not at an edge or a vertex.
    Inside,
    /// At an edge or a vertex.
    Seam {
        /// Whether the ray goes through the inside once it is moved (`src/crossings.rs`).
        crosses: bool,
    },
}

fn meeting<const ROOM: usize>(ray: &IntegerRay, triangle: [Vec3; 3], units: &IntegerUnits) -> Meeting {
    let n = units.n;
    let numbers = IntegerNumbers::<ROOM>::new(&ray.start, ray.direction, triangle, units);
    let side = numbers.det.sign(n);
    let weights = [numbers.weight0(n), numbers.weight1, numbers.weight2].map(|weight| weight.sign(n));
    if !weights.contains(&0) {
        return Meeting::Inside;
    }
    let is_inside = |(k, weight): (usize, i32)| match weight {
        0 => sign_once_moved::<ROOM>(ray, triangle, k, units) == side,
        sign => sign == side,
    };
    Meeting::Seam { crosses: weights.into_iter().enumerate().all(is_inside) }
}

/// The sign of the weight of vertex `k`, which is zero, once the ray is moved.
fn sign_once_moved<const ROOM: usize>(ray: &IntegerRay, triangle: [Vec3; 3], k: usize, units: &IntegerUnits) -> i32 {
    let n = units.n;
    let integers = |v: Vec3, exponent: i32| v.to_array().map(|x| Integer::<ROOM>::from_float(x, exponent, n));
    let [to, from] = [triangle[(k + 1) % 3], triangle[(k + 2) % 3]].map(|p| integers(p, units.position));
    let mut edge = to;
    edge.iter_mut().zip(&from).for_each(|(edge, from)| edge.add(from, -1, n));
    let direction = integers(ray.direction, units.direction);
    let component = |axis: usize| {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut product = Integer::<ROOM>::ZERO;
        product.add_product(&edge[i], &direction[j], 1, n);
        product.add_product(&edge[j], &direction[i], -1, n);
        product.sign(n)
    };
    (0..3).map(component).find(|&sign| sign != 0).unwrap_or(0)
}

/// Whether the triangle is hit inside of the ray's interval and nearer than `hit`; never [`Decision::Undecided`].
#[inline(never)]
pub fn decide_by_integers(
    buffers: &SceneBuffers,
    ray: &Ray,
    triangle: [Vec3; 3],
    primitive: u32,
    hit: &Hit,
) -> Decision {
    let has_interval = ray.t_near <= ray.t_far;
    if !has_interval {
        return Decision::Miss;
    }
    let exact = IntegerRay::new(buffers, ray);
    let Some(t) = exact.t_inside(triangle) else { return Decision::Miss };
    let limits = Decision::Hit([t.next_down(), t.next_up()]);
    if hit.primitive == NO_PRIMITIVE || t < hit.u {
        return limits;
    }
    if t > hit.t || !exact.is_nearer([triangle, vertices(buffers, hit.primitive)], primitive < hit.primitive) {
        return Decision::Miss;
    }
    limits
}

fn finish<const ROOM: usize>(ray: &IntegerRay, triangle: [Vec3; 3], units: &IntegerUnits) -> Intersection {
    let numbers = IntegerNumbers::<ROOM>::new(&ray.start, ray.direction, triangle, units);
    Intersection {
        t: numbers.t(units, ray.t_exponent),
        u: integer_quotient(numbers.weight1, numbers.det, 0, units.n),
        v: integer_quotient(numbers.weight2, numbers.det, 0, units.n),
    }
}

/// t in the caller's units, u and v of a triangle that is hit.
#[inline(never)]
pub fn finish_by_integers(buffers: &SceneBuffers, ray: &Ray, triangle: [Vec3; 3]) -> Intersection {
    IntegerRay::new(buffers, ray).finish(triangle)
}

fn weight0<const ROOM: usize>(
    start: &TrianglePoint,
    direction: Vec3,
    triangle: [Vec3; 3],
    units: &IntegerUnits,
) -> f32 {
    let numbers = IntegerNumbers::<ROOM>::new(start, direction, triangle, units);
    integer_quotient(numbers.weight0(units.n), numbers.det, 0, units.n)
}

/// The weight of vertex 0 of a triangle that is hit.
#[inline(never)]
pub fn weight0_by_integers(buffers: &SceneBuffers, ray: &Ray, triangle: [Vec3; 3]) -> f32 {
    IntegerRay::new(buffers, ray).weight0(triangle)
}
