//! What is right, and what sort of wrong the rest is.
//!
//! Strictly, for methods that promise exact hits: the nearest triangle, of those at exactly the same t the lowest
//! number; the float nearest to t; u and v within [`WEIGHT_ULPS`]. Of any hits only the triangle is judged, which must
//! be hit within the limits.
//!
//! Tolerantly, for float32 methods: any answer that is right for a ray within the bounds of [`super::tolerance`]. A
//! triangle counts that the ray passes within its tolerance, at a t within its tolerance, and that is not behind the
//! exact answer. What lies behind it, or a miss, counts only where a ray displaced by the tolerance gets past the exact
//! answer, at a silhouette or open border: a ray that slips through between two neighbours is wrong. A triangle whose
//! plane the ray lies in never counts.
//!
//! A secondary ray starts exactly where the first one hits; the triangle that it leaves and those that the first ray
//! met at exactly the same t are not there for it. Strictly, because a start has to be told by numbers: at exactly the
//! point whose smaller two weights, of three, are the floats nearest to those of the hit. It lies in the same triangle,
//! on an edge or a vertex just when the hit does.

use super::case::Case;
use super::exact::{Closest, ExactTracer, Interval, Line};
use super::tolerance::{Tolerance, distance_to, point_error};
use glam::Vec3;
use raybrook::low_level::compare::ulp_distance;
use raybrook::low_level::parallel;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE};
use std::sync::Arc;

/// Floats by which u and v may be off from the nearest ones.
const WEIGHT_ULPS: u32 = 2;
/// Displaced rays that are traced to find out whether a ray may get past what it hits.
const DISPLACED: usize = 8;

/// What is wrong with an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A hit is due, and none was reported.
    Miss,
    /// No hit is due, and one was reported.
    False,
    /// Another triangle is due.
    Primitive,
    /// The right triangle, but t is off.
    T,
    /// The right triangle and t, but the weights are off.
    Weights,
    /// The secondary ray hit the triangle that it left; judged tolerantly, one that was met with it, too.
    SelfHit,
    /// The secondary ray passed through what it had to hit.
    Leak,
    /// A list or a walk has a triangle more than once.
    Twice,
    /// The right triangles in another order.
    Order,
    /// The right list, but another number of crossings of surfaces.
    Crossings,
}

impl Fault {
    /// Those of closest hits, in the order in which they are reported.
    pub const OF_CLOSEST: [Fault; 7] =
        [Fault::Miss, Fault::False, Fault::Primitive, Fault::T, Fault::Weights, Fault::SelfHit, Fault::Leak];
    /// Those of lists: a miss and a false hit are triangles that a list lacks, or should lack.
    pub const OF_LISTS: [Fault; 7] =
        [Fault::Miss, Fault::False, Fault::Twice, Fault::Order, Fault::T, Fault::Weights, Fault::Crossings];
    /// Those of walks.
    pub const OF_WALKS: [Fault; 6] = [Fault::Miss, Fault::False, Fault::Twice, Fault::Order, Fault::T, Fault::Weights];

    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Fault::Miss => "miss",
            Fault::False => "false",
            Fault::Primitive => "prim",
            Fault::T => "t",
            Fault::Weights => "uv",
            Fault::SelfHit => "self",
            Fault::Leak => "leak",
            Fault::Twice => "twice",
            Fault::Order => "order",
            Fault::Crossings => "cross",
        }
    }
}

/// The exact answer for one ray.
struct Answer {
    /// `None` for a ray that misses whatever there is, being NaN, infinite or without direction.
    line: Option<Line>,
    hit: Option<Closest>,
    /// Of the secondary ray, if there is one.
    next: Option<NextAnswer>,
}

struct NextAnswer {
    line: Option<Line>,
    /// The hit of a ray that starts at exactly the point that the first hit names, which leaves that triangle alone:
    /// others that were met at the same t may lie ahead of it.
    hit: Option<Closest>,
    /// That of a ray that leaves all of these, too: rounded tests may name any of them.
    tolerant: Option<Closest>,
}

/// The exact answers of a case.
pub struct Answers<'a> {
    case: &'a Case,
    tracer: Arc<ExactTracer>,
    answers: Vec<Answer>,
}

/// What a secondary ray may hit: anything ahead.
const AHEAD: Interval = Interval { near: 0.0, far: f32::INFINITY, is_open: true };

impl<'a> Answers<'a> {
    /// Traces all rays exactly, on all cores.
    pub fn new(case: &'a Case) -> Answers<'a> {
        Answers::by(&Arc::new(ExactTracer::new(&case.mesh)), case)
    }

    /// The same by a tracer of the case's mesh, which the case then need not have.
    pub fn by(tracer: &Arc<ExactTracer>, case: &'a Case) -> Answers<'a> {
        let answers = parallel::map_numbers(case.rays.len(), |i| answer(tracer, case, i));
        Answers { case, tracer: tracer.clone(), answers }
    }

    /// The exact answer of ray `index`, rounded, and that of its secondary ray; `primitive` is [`NO_PRIMITIVE`] on a
    /// miss.
    pub fn rounded(&self, index: usize) -> (Hit, Option<Hit>) {
        let answer = &self.answers[index];
        (rounded(answer.hit.as_ref()), answer.next.as_ref().map(|next| rounded(next.hit.as_ref())))
    }

    /// What is wrong with `hit`, in world units, as the answer for ray `index`, and with `next` as that of its second
    /// ray. `None`: nothing.
    pub fn judge(&self, index: usize, hit: &Hit, next: Option<&Hit>, strictly: bool) -> Option<Fault> {
        let (ray, answer) = (&self.case.rays[index], &self.answers[index]);
        let Some(line) = &answer.line else { return (hit.primitive != NO_PRIMITIVE).then_some(Fault::False) };
        let interval = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
        let first =
            Question { tracer: &self.tracer, line, interval, exact: answer.hit.as_ref(), left: &[], origin_error: 0.0 };
        if self.case.any_hit {
            return first.judge_any(hit, strictly);
        }
        let fault = if strictly { first.judge_strictly(hit) } else { first.judge_tolerantly(hit) };
        let (Some(closest), Some(next_answer), Some(next), None) = (&answer.hit, &answer.next, next, fault) else {
            return fault;
        };
        let Some(next_line) = &next_answer.line else {
            return (next.primitive != NO_PRIMITIVE).then_some(Fault::False);
        };
        let mut left = if strictly { vec![closest.crossing.primitive] } else { closest.primitives.clone() };
        if hit.primitive != NO_PRIMITIVE && !left.contains(&hit.primitive) {
            left.push(hit.primitive); // a neighbour, within the tolerance
        }
        let is_due = next_answer.hit.as_ref().is_some_and(|due| due.crossing.primitive == next.primitive);
        if left.contains(&next.primitive) || (closest.primitives.contains(&next.primitive) && !is_due) {
            return Some(Fault::SelfHit);
        }
        let origin_error = self
            .tracer
            .corners(closest.crossing.primitive)
            .map_or(0.0, |corners| point_error(line, corners, &Tolerance::new(line, corners, 0.0)));
        let second = Question {
            line: next_line,
            interval: AHEAD,
            exact: if strictly { next_answer.hit.as_ref() } else { next_answer.tolerant.as_ref() },
            left: &left,
            origin_error,
            ..first
        };
        let fault = if strictly { second.judge_strictly(next) } else { second.judge_tolerantly(next) };
        match fault {
            Some(Fault::Miss) => Some(Fault::Leak),
            Some(Fault::Weights) if !strictly => None, // not reported for secondary rays
            other => other,
        }
    }
}

fn answer(tracer: &ExactTracer, case: &Case, index: usize) -> Answer {
    let ray = &case.rays[index];
    let interval = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
    let line = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let hit = line.as_ref().and_then(|line| tracer.closest(line, interval, &[], |_| true));
    let next = match (&line, &hit, ray.next) {
        (Some(_), Some(closest), Some(direction)) => Some(next_answer(tracer, closest, direction)),
        _ => None,
    };
    Answer { line, hit, next }
}

fn next_answer(tracer: &ExactTracer, closest: &Closest, direction: Vec3) -> NextAnswer {
    let line = tracer.line_from(&closest.crossing, direction);
    let leaving = |left: &[u32]| line.as_ref().and_then(|line| tracer.closest(line, AHEAD, left, |_| true));
    let hit = leaving(&[closest.crossing.primitive]);
    let tolerant = if closest.primitives.len() > 1 { leaving(&closest.primitives) } else { hit.clone() };
    NextAnswer { line, hit, tolerant }
}

fn rounded(hit: Option<&Closest>) -> Hit {
    match hit {
        Some(Closest { crossing, .. }) => Hit {
            t: crossing.t.to_f32(),
            u: crossing.u.to_f32(),
            v: crossing.v.to_f32(),
            primitive: crossing.primitive,
        },
        None => Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE },
    }
}

/// A ray, its limits, and what is exactly right.
#[derive(Clone, Copy)]
struct Question<'a> {
    tracer: &'a ExactTracer,
    line: &'a Line,
    interval: Interval,
    exact: Option<&'a Closest>,
    /// Triangles that are not there for this ray.
    left: &'a [u32],
    /// How far off the origin may be.
    origin_error: f64,
}

impl Question<'_> {
    fn judge_strictly(&self, hit: &Hit) -> Option<Fault> {
        let right = rounded(self.exact);
        if let Some(fault) = fault_of_triangle(hit, self.exact, |closest| hit.primitive == closest.crossing.primitive) {
            return Some(fault);
        }
        if right.primitive == NO_PRIMITIVE {
            return None;
        }
        if hit.t != right.t {
            return Some(Fault::T);
        }
        let off = ulp_distance(hit.u, right.u).max(ulp_distance(hit.v, right.v));
        (off > WEIGHT_ULPS).then_some(Fault::Weights)
    }

    /// Any triangle that is hit within the limits is right.
    fn judge_any(&self, hit: &Hit, strictly: bool) -> Option<Fault> {
        let is_met = |primitive: u32| {
            let crossing = self.tracer.crossing(self.line, primitive);
            crossing.is_some_and(|crossing| self.interval.contains(&crossing.t))
        };
        match fault_of_triangle(hit, self.exact, |_| is_met(hit.primitive)) {
            Some(Fault::Miss) if !strictly => (!self.may_pass(None)).then_some(Fault::Miss),
            Some(fault) if !strictly => self.passes_at(hit.primitive).is_none().then_some(fault),
            fault => fault,
        }
    }

    fn judge_tolerantly(&self, hit: &Hit) -> Option<Fault> {
        match fault_of_triangle(hit, self.exact, |closest| closest.primitives.contains(&hit.primitive)) {
            None => self.exact.and_then(|closest| self.fault_of_numbers(hit, closest)),
            Some(Fault::Miss) => (!self.may_pass(None)).then_some(Fault::Miss),
            Some(fault) => (!self.is_near_answer(hit)).then_some(fault),
        }
    }

    /// Whether t and weights are off, for a triangle that is exactly right.
    fn fault_of_numbers(&self, hit: &Hit, closest: &Closest) -> Option<Fault> {
        let crossing = self.tracer.crossing(self.line, hit.primitive)?;
        let tolerance = self.tolerance(hit.primitive)?;
        let t = closest.crossing.t.to_f64();
        let off = |found: f32, exact: f64, by: f64| (f64::from(found) - exact).abs() <= by;
        if !off(hit.t, t, tolerance.of_t(t)) {
            return Some(Fault::T);
        }
        let [of_u, of_v] = tolerance.weights;
        let is_close = off(hit.u, crossing.u.to_f64(), of_u) && off(hit.v, crossing.v.to_f64(), of_v);
        (!is_close).then_some(Fault::Weights)
    }

    fn tolerance(&self, primitive: u32) -> Option<Tolerance> {
        Some(Tolerance::new(self.line, self.tracer.corners(primitive)?, self.origin_error))
    }

    /// The t at which a triangle is nearest to the ray, and how far off it may be, for one that a ray within the
    /// tolerance hits.
    fn passes_at(&self, primitive: u32) -> Option<(f64, f64)> {
        let corners = self.tracer.corners(primitive)?;
        if self.left.contains(&primitive) || self.tracer.is_parallel(self.line, primitive) {
            return None;
        }
        let tolerance = Tolerance::new(self.line, corners, self.origin_error);
        let (distance, t) = distance_to(self.line, corners);
        let off = tolerance.of_t(t);
        let is_inside = t + off >= f64::from(self.interval.near) && t - off <= f64::from(self.interval.far);
        (is_inside && distance <= tolerance.lateral).then_some((t, off))
    }

    /// Whether a hit of another triangle than the right one, or where none is due, is right for a ray within the
    /// tolerance.
    fn is_near_answer(&self, hit: &Hit) -> bool {
        let Some((t, off)) = self.passes_at(hit.primitive) else { return false };
        if (f64::from(hit.t) - t).abs() > off {
            return false;
        }
        let Some(closest) = self.exact else { return true };
        let exact_t = closest.crossing.t.to_f64();
        let exact_off = self.tolerance(closest.crossing.primitive).map_or(0.0, |tolerance| tolerance.of_t(exact_t));
        t - off <= exact_t + exact_off || self.may_pass(Some(t - off))
    }

    /// Whether a ray within the tolerance meets nothing before `t`, or nothing at all. A hit within its tolerance of a
    /// limit need not be met.
    fn may_pass(&self, t: Option<f64>) -> bool {
        let Some(closest) = self.exact else { return true };
        let Some(tolerance) = self.tolerance(closest.crossing.primitive) else { return true };
        let (right, up) = (self.line.direction / self.line.direction.length()).any_orthonormal_pair();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let around = [
            (1.0, 0.0),
            (half, half),
            (0.0, 1.0),
            (-half, half),
            (-1.0, 0.0),
            (-half, -half),
            (0.0, -1.0),
            (half, -half),
        ];
        let offsets: [_; DISPLACED] = around.map(|(x, y)| (right * x + up * y) * tolerance.lateral);
        let displaced = offsets.iter().filter_map(|&by| self.tracer.line(self.line.origin + by, self.line.direction));
        let mut lines = displaced.chain([self.line.clone()]);
        let limits = [self.interval.near, self.interval.far].map(f64::from);
        lines.any(|line| {
            let hit = self.tracer.closest(&line, self.interval, self.left, |crossing| {
                let at = crossing.t.to_f64();
                let off = self.tolerance(crossing.primitive).map_or(0.0, |tolerance| tolerance.of_t(at));
                limits.iter().all(|limit| (at - limit).abs() > off)
            });
            match (hit, t) {
                (None, _) => true,
                (Some(hit), Some(t)) => hit.crossing.t.to_f64() >= t,
                (Some(_), None) => false,
            }
        })
    }
}

/// Whether a hit is reported where none is due, none where one is due, or one that `is_right` refuses.
fn fault_of_triangle(hit: &Hit, exact: Option<&Closest>, is_right: impl Fn(&Closest) -> bool) -> Option<Fault> {
    match (hit.primitive, exact) {
        (NO_PRIMITIVE, None) => None,
        (NO_PRIMITIVE, Some(_)) => Some(Fault::Miss),
        (_, None) => Some(Fault::False),
        (_, Some(closest)) => (!is_right(closest)).then_some(Fault::Primitive),
    }
}
