//! The exact tracer: hit or miss and nearer or farther decided as exact arithmetic has them.
//!
//! Floats are exact integers times a power of two, so that everything up to t = T / D is a quotient of exact integers
//! ([`Ratio`]). They are slow: doubles with an error bound (a static filter; Shewchuk, "Adaptive Precision
//! Floating-Point Arithmetic and Fast Robust Geometric Predicates", Discrete & Computational Geometry 18, 1997) first
//! discard the triangles that the ray surely misses and order the rest, most of them by the boxes around them
//! (`boxes.rs`). It shares no code and no formula with `cl/intersect/exact.cl`, which it is to judge. Nothing in them
//! over- or underflows: coordinates are from 2^-149 to 2^128, starts of secondary rays from 2^-298 on, and products
//! have three factors.
//!
//! Bad at: rays in the plane of many triangles, all of which need exact integers.

use super::boxes::Boxes;
use super::estimate::{Estimate, PRODUCT_ERROR, ROUNDING, size_of_cross};
use super::mesh::Mesh;
use super::ratio::{Ratio, decode};
use glam::{DVec3, Vec3};
use num_bigint::{BigInt, Sign};

type Integer3 = [BigInt; 3];

/// The sum of three products that are each off by [`PRODUCT_ERROR`]: two more roundings of numbers that are 1 / 8 of
/// the bounds' sum in size, and a margin.
const SUM_ERROR: f64 = 1.5;

/// A ray without limits, in doubles and, where these are rounded, in exact integers.
#[derive(Debug, Clone)]
pub struct Line {
    /// Rounded.
    pub origin: DVec3,
    /// In units of which t counts.
    pub direction: DVec3,
    /// How far `origin` may be off on each axis.
    origin_error: f64,
    /// The exact origin is this times 2^unit; `None`: `origin` is exact.
    integer_origin: Option<(Integer3, i32)>,
}

impl Line {
    /// The line of a ray; `None` when a part of it is NaN or infinite, or the direction is zero: such a ray misses
    /// everything.
    pub fn new(origin: DVec3, direction: DVec3) -> Option<Line> {
        let is_ray = origin.is_finite() && direction.is_finite() && direction != DVec3::ZERO;
        is_ray.then_some(Line { origin, direction, origin_error: 0.0, integer_origin: None })
    }

    /// How far `origin` may be off on each axis.
    pub(super) fn origin_error(&self) -> f64 {
        self.origin_error
    }

    /// The exact origin in units of 2^`unit`, which is not above its own.
    fn integer_origin(&self, unit: i32) -> Integer3 {
        match &self.integer_origin {
            None => integer3(self.origin, unit),
            Some((numerator, own)) => std::array::from_fn(|k| &numerator[k] << (own - unit)),
        }
    }

    /// The origin is a multiple of 2 to this power.
    fn unit(&self) -> i32 {
        self.integer_origin.as_ref().map_or_else(|| smallest_unit([&self.origin]), |(_, unit)| *unit)
    }

    /// Where the line crosses the triangle of these corners, exactly: t and the weights of corners 1 and 2. The edges
    /// belong to it. `None` when it does not, and when it runs in the triangle's plane.
    pub fn crossing(&self, corners: [DVec3; 3]) -> Option<[Ratio; 3]> {
        let unit = self.unit().min(smallest_unit(&corners));
        let origin = self.integer_origin(unit);
        let [a, b, c] = corners.map(|p| minus(&integer3(p, unit), &origin));
        let direction_unit = smallest_unit([&self.direction]);
        let d = integer3(self.direction, direction_unit);
        let weights = weights_of(&d, [&a, &b, &c]);
        let det: BigInt = weights.iter().sum();
        let opposite = match det.sign() {
            Sign::NoSign => return None,
            Sign::Plus => Sign::Minus,
            Sign::Minus => Sign::Plus,
        };
        if weights.iter().any(|weight| weight.sign() == opposite) {
            return None;
        }
        // With N = a x b + b x c + c x a the weights' sum is -N . d, and N . a = a . (b x c).
        let distance = -dot(&a, &cross(&b, &c));
        let [_, weight1, weight2] = weights;
        let t = Ratio::new(distance, det.clone(), unit - direction_unit);
        Some([t, Ratio::new(weight1, det.clone(), 0), Ratio::new(weight2, det, 0)])
    }

    /// Whether the line, which is not parallel to the triangle, crosses it when it starts at its origin + (h, h^2,
    /// h^3), with an h less than any number. Each weight is linear in the origin, so that its gains by a step along
    /// each axis tell its sign: it is that of the weight, or where this is zero of the first gain that is not.
    pub fn crosses_when_moved(&self, corners: [DVec3; 3]) -> bool {
        let unit = self.unit().min(smallest_unit(&corners));
        let origin = self.integer_origin(unit);
        let corners = corners.map(|p| integer3(p, unit));
        let d = integer3(self.direction, smallest_unit([&self.direction]));
        let weights_from = |origin: &Integer3| {
            let [a, b, c] = [0, 1, 2].map(|k| minus(&corners[k], origin));
            weights_of(&d, [&a, &b, &c])
        };
        let weights = weights_from(&origin);
        let moved: [_; 3] = std::array::from_fn(|axis| {
            let mut moved = origin.clone();
            moved[axis] += 1;
            weights_from(&moved)
        });
        let signs: [_; 3] = std::array::from_fn(|k| {
            let gains = moved.iter().map(|moved| (&moved[k] - &weights[k]).sign());
            std::iter::once(weights[k].sign()).chain(gains).find(|&sign| sign != Sign::NoSign)
        });
        signs[0].is_some() && signs.iter().all(|sign| *sign == signs[0])
    }
}

/// Where a line meets a triangle.
#[derive(Debug, Clone)]
pub struct Crossing {
    /// The triangle.
    pub primitive: u32,
    /// In units of the direction.
    pub t: Ratio,
    /// Weight of vertex 1.
    pub u: Ratio,
    /// Weight of vertex 2.
    pub v: Ratio,
}

impl Crossing {
    /// Weight of vertex 0.
    pub fn weight0(&self) -> Ratio {
        let (u, v) = (&self.u, &self.v);
        let denominator = u.denominator() * v.denominator();
        let numerator = &denominator - u.numerator() * v.denominator() - v.numerator() * u.denominator();
        Ratio::new(numerator, denominator, 0)
    }

    /// Whether it is exactly on an edge or a vertex.
    pub fn is_on_edge(&self) -> bool {
        [&self.u, &self.v, &self.weight0()].iter().any(|weight| weight.numerator().sign() == Sign::NoSign)
    }
}

/// The nearest crossing and the triangles that are met at exactly its t.
#[derive(Debug, Clone)]
pub struct Closest {
    /// That of the lowest triangle number.
    pub crossing: Crossing,
    /// All of them, in ascending order.
    pub primitives: Vec<u32>,
}

/// Limits of t, which count as the numbers that they are. A t that no float tells, because the nearest one is infinite,
/// is outside of infinite limits, too.
#[derive(Debug, Clone, Copy)]
pub struct Interval {
    /// No hit is nearer.
    pub near: f32,
    /// No hit is farther.
    pub far: f32,
    /// Whether a hit at `near` does not count.
    pub is_open: bool,
}

impl Interval {
    /// Whether exactly `t` is inside. Never when a limit is NaN.
    pub fn contains(&self, t: &Ratio) -> bool {
        let above = match self.near {
            near if near.is_finite() => {
                let near = Ratio::from_float(near.into());
                if self.is_open { *t > near } else { *t >= near }
            }
            near => near == f32::NEG_INFINITY,
        };
        let below = match self.far {
            far if far.is_finite() => *t <= Ratio::from_float(far.into()),
            far => far == f32::INFINITY,
        };
        above && below && t.is_finite_f32()
    }
}

/// What doubles say of a triangle that is not surely missed: its t, if it is hit, is from `low` to `high`.
struct Candidate {
    primitive: u32,
    low: f64,
    high: f64,
}

/// The exact tracer of one mesh.
pub struct ExactTracer {
    /// `None`: a corner is NaN or infinite, so that the triangle does not exist.
    triangles: Vec<Option<[DVec3; 3]>>,
    boxes: Boxes,
}

impl ExactTracer {
    /// A tracer of `mesh`.
    pub fn new(mesh: &Mesh) -> ExactTracer {
        let doubles = |i: usize| {
            let corners = mesh.corners(i);
            corners.iter().all(|p| p.is_finite()).then(|| corners.map(DVec3::from))
        };
        let triangles: Vec<_> = (0..mesh.triangles.len()).map(doubles).collect();
        ExactTracer { boxes: Boxes::new(&triangles), triangles }
    }

    /// The corners of a triangle; `None` when it does not exist.
    pub fn corners(&self, primitive: u32) -> Option<[DVec3; 3]> {
        self.triangles.get(primitive as usize).copied().flatten()
    }

    /// As [`Line::new`].
    pub fn line(&self, origin: DVec3, direction: DVec3) -> Option<Line> {
        Line::new(origin, direction)
    }

    /// The line from where a triangle is crossed: from the point of which the two smaller weights are the floats
    /// nearest to those of the crossing. `None` as for [`ExactTracer::line`].
    pub fn line_from(&self, crossing: &Crossing, direction: Vec3) -> Option<Line> {
        let next = self.line(DVec3::ZERO, direction.as_dvec3())?;
        let [a, b, c] = self.corners(crossing.primitive)?;
        let (u, v) = (crossing.u.to_f32(), crossing.v.to_f32());
        let rest = (1.0 - u) - v;
        let weight0 = crossing.weight0().to_f32();
        // The largest one makes up for the others' rounding.
        let (base, others) = if rest >= u && rest >= v {
            (a, [(b, u), (c, v)])
        } else if u >= v {
            (b, [(c, v), (a, weight0)])
        } else {
            (c, [(a, weight0), (b, u)])
        };
        let weight_unit = others.iter().map(|&(_, weight)| decode(weight.into()).1).min().unwrap_or(0).min(0);
        let own = smallest_unit(&[a, b, c]);
        let unit = own + weight_unit;
        let mut numerator = integer3(base, unit);
        let base = integer3(base, own);
        for (other, weight) in others {
            let (significand, exponent) = decode(weight.into());
            let weight: BigInt = BigInt::from(significand) << (exponent - weight_unit);
            let edge = minus(&integer3(other, own), &base);
            numerator.iter_mut().zip(&edge).for_each(|(sum, edge)| *sum += &weight * edge);
        }
        let rounded = |n: &BigInt| Ratio::new(n.clone(), 1.into(), unit).to_f64();
        let origin = DVec3::new(rounded(&numerator[0]), rounded(&numerator[1]), rounded(&numerator[2]));
        let origin_error = ROUNDING * origin.abs().max_element();
        Some(Line { origin, origin_error, integer_origin: Some((numerator, unit)), ..next })
    }

    /// Where `line` crosses triangle `primitive`, exactly; its edges belong to it. `None` when it does not, and when it
    /// runs in the triangle's plane.
    pub fn crossing(&self, line: &Line, primitive: u32) -> Option<Crossing> {
        let [t, u, v] = line.crossing(self.corners(primitive)?)?;
        Some(Crossing { primitive, t, u, v })
    }

    /// Whether `line` runs parallel to the plane of triangle `primitive`, or the triangle has no area or does not
    /// exist.
    pub fn is_parallel(&self, line: &Line, primitive: u32) -> bool {
        let Some(corners) = self.corners(primitive) else { return true };
        let unit = smallest_unit(&corners);
        let [a, b, c] = corners.map(|p| integer3(p, unit));
        let direction = integer3(line.direction, smallest_unit([&line.direction]));
        dot(&direction, &cross(&minus(&b, &a), &minus(&c, &a))).sign() == Sign::NoSign
    }

    /// The nearest crossing inside of `interval` with a triangle that is not `excluded`, and that `accepts` does not
    /// refuse.
    pub fn closest(
        &self,
        line: &Line,
        interval: Interval,
        excluded: &[u32],
        accepts: impl Fn(&Crossing) -> bool,
    ) -> Option<Closest> {
        let mut candidates: Vec<Candidate> = self
            .boxes
            .near(line)
            .filter(|i| !excluded.contains(i))
            .filter_map(|i| self.candidate(line, i))
            .filter(|c| c.high >= f64::from(interval.near) && c.low <= f64::from(interval.far))
            .collect();
        candidates.sort_by(|a, b| a.low.total_cmp(&b.low));
        let mut best: Option<(f64, Closest)> = None;
        for candidate in candidates {
            if best.as_ref().is_some_and(|(high, _)| candidate.low > *high) {
                break; // as are all that follow
            }
            let Some(crossing) = self.crossing(line, candidate.primitive) else { continue };
            if !interval.contains(&crossing.t) || !accepts(&crossing) {
                continue;
            }
            let primitives = match &best {
                Some((_, closest)) if crossing.t > closest.crossing.t => continue,
                Some((_, closest)) if crossing.t == closest.crossing.t => closest.primitives.clone(),
                _ => Vec::new(),
            };
            // Where doubles knew nothing, what is known by now discards the candidates that follow.
            let high = if candidate.high == f64::INFINITY { crossing.t.to_f64().next_up() } else { candidate.high };
            let closest = Closest { primitives: [primitives, vec![candidate.primitive]].concat(), crossing };
            best = Some((high, closest));
        }
        let (_, mut closest) = best?;
        closest.primitives.sort_unstable();
        if closest.primitives[0] != closest.crossing.primitive {
            closest.crossing = self.crossing(line, closest.primitives[0])?;
        }
        Some(closest)
    }

    /// All crossings inside of `interval`, by t, those at exactly the same t by number.
    pub fn all(&self, line: &Line, interval: Interval) -> Vec<Crossing> {
        let may_be_inside = |candidate: Candidate| {
            candidate.high >= f64::from(interval.near) && candidate.low <= f64::from(interval.far)
        };
        let near = self.boxes.near(line).filter(|&i| self.candidate(line, i).is_some_and(may_be_inside));
        let crossings = near.filter_map(|i| self.crossing(line, i));
        let mut all: Vec<_> = crossings.filter(|crossing| interval.contains(&crossing.t)).collect();
        all.sort_by(|a, b| a.t.cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        all
    }

    /// What doubles know; `None` when the line surely misses the triangle.
    fn candidate(&self, line: &Line, primitive: u32) -> Option<Candidate> {
        let corners = self.corners(primitive)?;
        let d = line.direction;
        let relative = corners.map(|p| p - line.origin);
        let [a, b, c] = relative;
        // A difference is off by ROUNDING of itself and by the origin's error: by ROUNDING of the sum of the two.
        let [size_a, size_b, size_c] = relative.map(|p| p.abs() + line.origin_error / ROUNDING);
        let weights = [d.dot(c.cross(b)), d.dot(a.cross(c)), d.dot(b.cross(a))];
        let bound = |x: DVec3, y: DVec3| PRODUCT_ERROR * d.abs().dot(size_of_cross(x, y));
        let bounds = [bound(size_c, size_b), bound(size_a, size_c), bound(size_b, size_a)];
        let sure = |sign: f64| weights.iter().zip(&bounds).any(|(weight, bound)| sign * weight > *bound);
        if sure(1.0) && sure(-1.0) {
            return None;
        }
        let det: f64 = weights.iter().sum();
        let det_bound = SUM_ERROR * bounds.iter().sum::<f64>();
        // From edges rather than from corners relative to the origin: close to each other these would cancel.
        let (edge1, edge2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let distance = -edge1.cross(edge2).dot(a);
        let distance_bound = PRODUCT_ERROR * size_of_cross(edge1.abs(), edge2.abs()).dot(size_a);
        let t = Estimate { value: distance, bound: distance_bound }.over(Estimate { value: det, bound: det_bound });
        Some(match t {
            Some(t) => Candidate { primitive, low: t.low(), high: t.high() },
            None => Candidate { primitive, low: f64::NEG_INFINITY, high: f64::INFINITY },
        })
    }
}

/// The largest k such that all coordinates are whole multiples of 2^k.
fn smallest_unit<'a>(points: impl IntoIterator<Item = &'a DVec3>) -> i32 {
    let coordinates = points.into_iter().flat_map(|p| p.to_array());
    coordinates.filter(|&x| x != 0.0).map(|x| decode(x).1).min().unwrap_or(0)
}

/// A vector in units of 2^unit.
fn integer3(v: DVec3, unit: i32) -> Integer3 {
    v.to_array().map(|x| match decode(x) {
        (0, _) => BigInt::ZERO,
        (significand, exponent) => BigInt::from(significand) << (exponent - unit),
    })
}

fn minus(a: &Integer3, b: &Integer3) -> Integer3 {
    std::array::from_fn(|k| &a[k] - &b[k])
}

fn cross(a: &Integer3, b: &Integer3) -> Integer3 {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        &a[i] * &b[j] - &a[j] * &b[i]
    })
}

fn dot(a: &Integer3, b: &Integer3) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

/// The weights of a triangle's corners, which are relative to the origin, times the determinant.
fn weights_of(d: &Integer3, [a, b, c]: [&Integer3; 3]) -> [BigInt; 3] {
    [dot(d, &cross(c, b)), dot(d, &cross(a, c)), dot(d, &cross(b, a))]
}
