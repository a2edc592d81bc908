//! The nearest of some triangles, exactly, and its closest point with each number rounded once.
//!
//! f64 with bounds of its errors decides what it can, exact integers the rest. Points as far from several triangles are
//! no exception: a vertex that is the nearest point belongs to all triangles around it. These are told by their
//! feature: distances to the same vertex, or to the same edge, are the same, whatever the triangle.

use super::near::distance_bounds;
use super::number::{Ball, Exact, Number, dot};
use super::triangle::{Feature, Location, Shape};
use crate::reference::shared::integer::{Integer, integer_quotient, widen_exponents};
use glam::Vec3;

/// The closest point, as [`crate::ClosestPoint`] has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// Where it is, world units.
    pub point: Vec3,
    /// How far, world units.
    pub distance: f32,
    /// The triangle that it is on.
    pub triangle: u32,
    /// The weight of vertex 1.
    pub u: f32,
    /// The weight of vertex 2.
    pub v: f32,
}

/// A triangle that may be the nearest one.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    number: u32,
    corners: [Vec3; 3],
    feature: Feature,
}

/// The most limbs of a number: of ten differences of floats, which have up to 278 bits.
const MAX_LIMBS: usize = 88;

/// Calls a function of exact numbers with room for products of ten differences of the coordinates of `$positions`.
macro_rules! exactly {
    ($positions:expr, $function:ident($($argument:expr),*)) => {{
        let (exponent, limbs) = units_of($positions);
        match limbs {
            0..=8 => $function::<8>($($argument,)* exponent),
            9..=16 => $function::<16>($($argument,)* exponent),
            17..=32 => $function::<32>($($argument,)* exponent),
            _ => $function::<MAX_LIMBS>($($argument,)* exponent),
        }
    }};
}

/// The unit of which all coordinates are multiples, as an exponent of 2, and the limbs that numbers take. A
/// distance of one triangle compared with that of another one takes ten differences, of a bit more than a coordinate
/// each, and four bits for the sums of three products; a distance compared with a float takes four, and the float's
/// square.
fn units_of<'a>(positions: impl IntoIterator<Item = &'a Vec3>) -> (i32, usize) {
    let (mut low, mut high) = (i32::MAX, i32::MIN);
    for position in positions {
        position.to_array().iter().for_each(|&x| widen_exponents(x, &mut low, &mut high));
    }
    if low > high {
        return (0, 1); // all are zero
    }
    (low, (10 * (high - low + 1) as usize + 24).div_ceil(32))
}

fn exact_shape<const ROOM: usize>(corners: [Vec3; 3], point: Vec3, exponent: i32) -> Shape<Exact<ROOM>> {
    Shape::new(corners, point, |a, b| Exact::difference(a, b, exponent))
}

fn exact_feature<const ROOM: usize>(corners: [Vec3; 3], point: Vec3, exponent: i32) -> Feature {
    exact_shape::<ROOM>(corners, point, exponent).feature().expect("exact numbers have a sign")
}

/// The squared distance as a fraction, in units of 4^`exponent`. The way to the closest point is perpendicular to what
/// it lies inside of, so that its product with the way to any point there is its square.
fn square_of<const ROOM: usize>(shape: &Shape<Exact<ROOM>>, location: &Location<Exact<ROOM>>) -> [Exact<ROOM>; 2] {
    let to = shape.to[location.corner];
    let Some(whole) = location.whole else { return [dot(to, to), Exact(Integer::from_limb(1))] };
    [dot(to, scaled(to, whole, location)), whole]
}

/// `whole` times a position plus the steps.
fn scaled<N: Number>(from: [N; 3], whole: N, location: &Location<N>) -> [N; 3] {
    let mut sum = from.map(|x| x.times(whole));
    for (share, edge) in location.steps.iter().flatten() {
        sum = [0, 1, 2].map(|k| sum[k].plus(edge[k].times(*share)));
    }
    sum
}

/// The sign of the first candidate's distance minus the second one's.
fn compare<const ROOM: usize>(first: &Candidate, second: &Candidate, point: Vec3, exponent: i32) -> i32 {
    let [first, second] = [first, second].map(|candidate| {
        let shape = exact_shape::<ROOM>(candidate.corners, point, exponent);
        square_of(&shape, &shape.location(candidate.feature))
    });
    first[0].times(second[1]).minus(second[0].times(first[1])).known_sign()
}

impl Candidate {
    fn new(number: u32, corners: [Vec3; 3], point: Vec3) -> Candidate {
        let feature = Shape::new(corners, point, Ball::difference).feature();
        let exact = || exactly!(corners.iter().chain([&point]), exact_feature(corners, point));
        Candidate { number, corners, feature: feature.unwrap_or_else(exact) }
    }

    /// The positions that its distance depends on, in an order of their own.
    fn positions(&self) -> [[u32; 3]; 3] {
        // -0 becomes 0
        let bits = |i: usize| (self.corners[i % 3] + Vec3::ZERO).to_array().map(f32::to_bits);
        let mut positions = match self.feature {
            Feature::Vertex(i) => [bits(i); 3],
            Feature::Edge(i) => [bits(i), bits(i + 1), bits(i)],
            Feature::Face => [bits(0), bits(1), bits(2)],
        };
        positions.sort_unstable();
        if let Feature::Edge(_) = self.feature {
            positions[1] = positions[0];
        }
        positions
    }

    /// Whether it is nearer than `other`, or as near and of a lower number.
    fn is_nearer(&self, other: &Candidate, point: Vec3) -> bool {
        let order = match self.positions() == other.positions() {
            true => 0,
            false => {
                let all = self.corners.iter().chain(&other.corners).chain([&point]);
                exactly!(all, compare(self, other, point))
            }
        };
        order < 0 || (order == 0 && self.number < other.number)
    }
}

/// The closest point of the nearest of some triangles; of two that are as near the lower number. `None` of none.
pub(super) fn decide(triangles: &[(u32, [Vec3; 3])], point: Vec3) -> Option<Closest> {
    let bounds: Vec<_> = triangles.iter().map(|(_, corners)| distance_bounds(*corners, point)).collect();
    let limit = bounds.iter().fold(f64::INFINITY, |limit, bounds| limit.min(bounds[1]));
    let near = triangles.iter().zip(&bounds).filter(|(_, bounds)| bounds[0] <= limit);
    let candidates = near.map(|((number, corners), _)| Candidate::new(*number, *corners, point));
    let nearest = candidates.reduce(|best, other| if other.is_nearer(&best, point) { other } else { best })?;
    let closest = rounded(&nearest, point);
    Some(closest.unwrap_or_else(|| exactly!(nearest.corners.iter().chain([&point]), rounded_exactly(&nearest, point))))
}

/// The numbers of the closest point, where f64 has them.
fn rounded(nearest: &Candidate, point: Vec3) -> Option<Closest> {
    let shape = Shape::new(nearest.corners, point, Ball::difference);
    let location = shape.location(nearest.feature);
    let corner = nearest.corners[location.corner];
    let (mut to, mut at) = (shape.to[location.corner], corner.to_array().map(|x| Ball::exact(x.into())));
    let [mut u, mut v] = [1, 2].map(|i| Ball::exact(f64::from(u8::from(nearest.feature == Feature::Vertex(i)))));
    if let Some(whole) = location.whole {
        for (share, edge) in location.steps.iter().flatten() {
            let share = share.over(whole)?;
            let step = edge.map(|x| x.times(share));
            to = [0, 1, 2].map(|k| to[k].plus(step[k]));
            at = [0, 1, 2].map(|k| at[k].plus(step[k]));
        }
        let share = |weight: Option<Ball>| weight.map_or(Some(Ball::exact(0.0)), |weight| weight.over(whole));
        (u, v) = (share(location.weights[0])?, share(location.weights[1])?);
    }
    let square = dot(to, to);
    Some(Closest {
        point: Vec3::new(at[0].to_f32()?, at[1].to_f32()?, at[2].to_f32()?),
        distance: if square.sign() == Some(0) { 0.0 } else { square.sqrt_to_f32()? },
        triangle: nearest.number,
        u: u.to_f32()?,
        v: v.to_f32()?,
    })
}

fn rounded_exactly<const ROOM: usize>(nearest: &Candidate, point: Vec3, exponent: i32) -> Closest {
    let shape = exact_shape::<ROOM>(nearest.corners, point, exponent);
    let location = shape.location(nearest.feature);
    let corner = nearest.corners[location.corner];
    let whole = location.whole.unwrap_or(Exact(Integer::from_limb(1)));
    let from = corner.to_array().map(|x| Exact::difference(x, 0.0, exponent));
    let at = scaled(from, whole, &location).map(|x| integer_quotient(x.0, whole.0, exponent, ROOM));
    let weight = |i: usize| match location.weights[i - 1] {
        Some(weight) => integer_quotient(weight.0, whole.0, 0, ROOM),
        None => f32::from(u8::from(nearest.feature == Feature::Vertex(i))),
    };
    Closest {
        point: at.into(),
        distance: root(&square_of(&shape, &location), exponent),
        triangle: nearest.number,
        u: weight(1),
        v: weight(2),
    }
}

/// The float nearest to the square root of a fraction of units of 4^`exponent`, ties to even.
fn root<const ROOM: usize>([numerator, denominator]: &[Exact<ROOM>; 2], exponent: i32) -> f32 {
    if numerator.known_sign() == 0 {
        return 0.0;
    }
    // An estimate that is off by no more than a float's last bit; then step by step.
    let half_bits = (numerator.0.bits(ROOM) - denominator.0.bits(ROOM)).div_euclid(2);
    let square = integer_quotient(numerator.0, denominator.0, -2 * half_bits, ROOM);
    let mut nearest = (f64::from(square).sqrt() * 2f64.powi(half_bits + exponent)) as f32;
    // Behind the last float there is one more: what is nearer to it is infinite.
    let value = |x: f32| if x.is_infinite() { 2f64.powi(128) } else { f64::from(x) };
    let is_above = |low: f32, high: f32, at_tie: bool| {
        let middle = 0.5 * (value(low) + value(high));
        let order = compare_with_float([numerator, denominator], exponent, middle);
        order > 0 || (order == 0 && at_tie)
    };
    let is_even = |x: f32| x.to_bits() & 1 == 0;
    while nearest.is_finite() && is_above(nearest, nearest.next_up(), !is_even(nearest)) {
        nearest = nearest.next_up();
    }
    while nearest > 0.0 && !is_above(nearest.next_down(), nearest, is_even(nearest)) {
        nearest = nearest.next_down();
    }
    nearest
}

/// The sign of the square root of a fraction of units of 4^`exponent` minus a positive number of at most 25 bits.
fn compare_with_float<const ROOM: usize>(fraction: [&Exact<ROOM>; 2], exponent: i32, number: f64) -> i32 {
    let [numerator, denominator] = fraction;
    let (significand, own) = significand_of(number);
    let factor = Exact(Integer::from_limb(significand));
    let mut square = denominator.times(factor).times(factor);
    let mut numerator = *numerator;
    // numerator 4^exponent against square 4^own
    let shift = 2 * (exponent - own);
    let difference = numerator.0.bits(ROOM) + shift - square.0.bits(ROOM);
    if difference != 0 {
        return difference.signum();
    }
    if shift > 0 {
        numerator.0.shift_up(shift as usize, ROOM);
    } else {
        square.0.shift_up(-shift as usize, ROOM);
    }
    numerator.minus(square).known_sign()
}

/// The integer and the exponent with `number = integer * 2^exponent`, of a positive number of at most 25 bits.
fn significand_of(number: f64) -> (u32, i32) {
    let bits = number.to_bits();
    let significand = bits & ((1 << 52) - 1) | (1 << 52);
    let zeros = significand.trailing_zeros();
    ((significand >> zeros) as u32, (bits >> 52) as i32 - 1075 + zeros as i32)
}
