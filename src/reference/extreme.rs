//! Rays whose numbers tracing space cannot hold: they are answered on the host, exactly as all others, whatever the
//! device and the method.
//!
//! Scenes are brought to tracing space by a power of two ([`crate::low_level::pack`]), which is exact until a number
//! gets lost below 2^-149 or grows beyond 2^128: the origin 1.4e-45 in a scene of size 4, the origin 1e20 in one of
//! size 1e-20, a vertex of 1e-38 in a scene of size 1000. The kernels see of such a ray that it is none, and miss; here
//! each is traced through the scene as it was given, in f64, whose range holds every product of floats, and what that
//! leaves open is decided in exact integers.
//!
//! Filter after Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", Discrete
//! & Computational Geometry 18, 1997. Bad at speed: a scalar search with a plain hierarchy for what is rare. A scene
//! whose own vertices cannot be brought to tracing space has all its batches traced here; its pictures have vertices
//! without their lowest bits.

use crate::layout::Float4;
use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::parallel::{self, lock, unlocked};
use crate::reference::intersect::exact_integers::IntegerRay;
use crate::reference::oracle::{Box64, Bvh, Line};
use crate::reference::shade::surface::start_weights;
use crate::reference::shared::integer::float_significand;
use crate::reference::shared::memory::vertices;
use crate::reference::shared::ray::{NO_HIT, TrianglePoint};
use crate::shared::{Hit, NO_PRIMITIVE, SurfaceHit, TraceRay};
use crate::tracer::{AllHits, AllHitsJob, ExtremeRay, RayStream, TraceJob, TraceResult, is_hit};
use glam::{DVec3, Vec3, Vec3A};
use std::sync::Mutex;
use std::time::Instant;

/// A ray in world units: origin, direction, `t_min` and `t_max`.
pub(crate) type WorldRay = (Vec3, Vec3, f32, f32);

/// So many rays are written before the first of them is read again: a processor that reads at once what it has written
/// in smaller pieces waits until these are in its cache, for a ray twice as long as all else takes.
const BLOCK: usize = 64;

/// A batch as the tracers take it.
#[derive(Debug, Clone, Default)]
pub struct TracingBatch {
    /// In tracing space; those that it cannot hold start nowhere.
    pub rays: Vec<TraceRay>,
    /// Directions of secondary rays.
    pub next_directions: Option<Vec<Float4>>,
    /// The rays, or secondary rays, that tracing space cannot hold.
    pub extreme: Vec<ExtremeRay>,
}

impl TracingBatch {
    /// What a tracer is asked for.
    pub fn job(&self, any_hit: bool, repeat: u32) -> TraceJob<'_> {
        let next_directions = self.next_directions.as_deref();
        TraceJob { rays: &self.rays, next_directions, extreme: &self.extreme, any_hit, repeat }
    }
}

/// The largest coordinate of an origin in tracing space: sums and differences with such numbers are floats.
const LARGEST_ORIGIN: f32 = f32::from_bits((127 + 126) << 23);
/// A ray's largest component is in [1, 2), or in [2^60, 2^61) where others would lose bits below 2^-149 (`aim_ray` in
/// `cl/shared/ray.cl`).
const LOWEST_DIRECTION_BIT: i32 = -149 - 60;

/// Whether an origin times `scale` is exactly what it was.
#[inline]
fn has_room(origin: Vec3, scale: f32) -> bool {
    let given = Vec3A::from(origin);
    let scaled = given * scale;
    // Most numbers stay normal; of the others a division tells, which undoes a product of powers of two exactly.
    let is_plain = scaled.abs().cmpge(Vec3A::splat(f32::MIN_POSITIVE)) | given.cmpeq(Vec3A::ZERO);
    let is_kept = is_plain.all() || (is_plain | (scaled / scale).cmpeq(given)).all();
    is_kept && scaled.abs().cmple(Vec3A::splat(LARGEST_ORIGIN)).all()
}

/// Whether a direction is brought to its unit without losing bits.
#[inline]
fn has_room_for_direction(direction: Vec3) -> bool {
    let parts = Vec3A::from(direction).abs();
    // A ratio of 2^-180 leaves room for the 24 bits of the smaller number.
    const SAFE: f32 = f32::from_bits((127 - 90) << 23);
    let is_near_largest = (parts / SAFE).cmpge(Vec3A::splat(parts.max_element() * SAFE));
    (is_near_largest | parts.cmpeq(Vec3A::ZERO)).all() || keeps_bits(direction)
}

/// The same by the exponents of the lowest bits.
#[cold]
fn keeps_bits(direction: Vec3) -> bool {
    let parts = direction.to_array().map(f32::abs);
    let largest = parts.iter().fold(0.0, |a, &b| f32::max(a, b));
    let (significand, exponent) = float_significand(largest);
    let unit = exponent + 31 - significand.leading_zeros() as i32;
    parts.iter().filter(|&&x| x != 0.0).all(|&x| {
        let (significand, exponent) = float_significand(x);
        exponent + significand.trailing_zeros() as i32 - unit >= LOWEST_DIRECTION_BIT
    })
}

impl SceneBuffers {
    /// The vertices of a triangle in world units, as the scene has them; zeros of one that cannot be hit.
    pub(crate) fn given_triangle(&self, primitive: u32) -> [Vec3; 3] {
        match self.given_vertices() {
            Some(given) => given[primitive as usize],
            None => vertices(self, primitive).map(|p| p / self.params.scale),
        }
    }

    /// Whether tracing space cannot hold a ray in world units.
    #[inline]
    pub(crate) fn is_extreme(&self, origin: Vec3, direction: Vec3) -> bool {
        let has_room = has_room(origin, self.params.scale) && has_room_for_direction(direction);
        !(self.keeps_vertices() && has_room) && origin.is_finite() && direction.is_finite()
    }

    /// `count` rays in world units as the tracers take them: `ray` makes number i of them (origin, direction, t_min,
    /// t_max), `next` the direction of its secondary ray.
    pub fn batch(
        &self,
        count: usize,
        ray: impl Fn(usize) -> (Vec3, Vec3, f32, f32) + Sync,
        next: Option<&(dyn Fn(usize) -> Vec3 + Sync)>,
    ) -> TracingBatch {
        let mut batch = TracingBatch::default();
        self.batch_into(&mut batch, count, ray, next);
        batch
    }

    /// The same in the memory of another batch, whose rays are no longer needed.
    pub(crate) fn batch_into(
        &self,
        batch: &mut TracingBatch,
        count: usize,
        ray: impl Fn(usize) -> WorldRay + Sync,
        next: Option<&(dyn Fn(usize) -> Vec3 + Sync)>,
    ) {
        let TracingBatch { rays, next_directions, extreme } = batch;
        if rays.capacity() < count {
            *rays = bytemuck::zeroed_vec(count); // which many threads get from the system
        }
        rays.resize(count, TraceRay::default());
        let found = Mutex::new(Vec::new());
        parallel::each(rays.chunks_mut(RayStream::PIECE).enumerate(), |(piece, places)| {
            let mut extreme = Vec::new(); // all rays, where the scene's own vertices have no room
            self.make_rays(piece * RayStream::PIECE, places, &ray, &mut |index, origin, _| {
                extreme.push(ExtremeRay { index, origin, is_second: false });
            });
            lock(&found).append(&mut extreme);
        });
        *extreme = unlocked(found);
        if let Some(next) = next {
            extreme.extend(parallel::flat_map_numbers(count, |index| {
                let ((origin, direction, ..), next) = (ray(index), next(index));
                let are_finite = origin.is_finite() && direction.is_finite() && next.is_finite();
                let is_second = are_finite && !has_room_for_direction(next) && !self.is_extreme(origin, direction);
                is_second.then_some(ExtremeRay { index, origin, is_second })
            }));
        }
        extreme.sort_unstable_by_key(|ray| ray.index);
        *next_directions = next.map(|next| parallel::map_numbers(count, |i| Float4::new(next(i), 0.0)));
    }

    /// Makes the rays from a number on of those that `ray` makes. `extreme` is told of those that tracing space cannot
    /// hold, which start nowhere: their numbers, and where they start.
    pub(crate) fn make_rays(
        &self,
        first: usize,
        places: &mut [TraceRay],
        ray: &impl Fn(usize) -> WorldRay,
        extreme: &mut dyn FnMut(usize, Vec3, TraceRay),
    ) {
        for (block, places) in places.chunks_mut(BLOCK).enumerate() {
            let first = first + block * BLOCK;
            for (number, place) in (first..).zip(&mut *places) {
                let (origin, direction, t_min, t_max) = ray(number);
                let (origin_t_min, direction_t_max) = (Float4::new(origin, t_min), Float4::new(direction, t_max));
                *place = TraceRay { origin_t_min, direction_t_max };
            }
            for (number, place) in (first..).zip(places) {
                let (origin, direction) = (place.origin_t_min.xyz(), place.direction_t_max.xyz());
                *place = self.trace_ray(origin, direction, place.origin_t_min.w, place.direction_t_max.w);
                if self.is_extreme(origin, direction) {
                    *place = nowhere(*place);
                    extreme(number, origin, *place);
                }
            }
        }
    }
}

/// A ray that starts nowhere, and hits nothing.
fn nowhere(ray: TraceRay) -> TraceRay {
    TraceRay { origin_t_min: Float4::new(Vec3::NAN, ray.origin_t_min.w), ..ray }
}

/// From this number of extreme rays on a hierarchy is built for them: before, it takes longer than testing every
/// triangle.
const RAYS_FOR_HIERARCHY: usize = 64;

/// The triangles of a scene in world units.
struct World<'a> {
    buffers: &'a SceneBuffers,
    count: usize,
    hierarchy: Option<Bvh>,
}

impl World<'_> {
    fn new(buffers: &SceneBuffers, rays: usize) -> World<'_> {
        let mut world = World { buffers, count: buffers.triangle_count(), hierarchy: None };
        // What instances share is not spread out for a few rays.
        if rays >= RAYS_FOR_HIERARCHY && !buffers.has_instances() {
            let boxes: Vec<_> =
                (0..world.count).map(|i| Box64::around(&world.triangle(i as u32).map(DVec3::from))).collect();
            world.hierarchy = Some(Bvh::new(&boxes));
        }
        world
    }

    fn triangle(&self, primitive: u32) -> [Vec3; 3] {
        self.buffers.given_triangle(primitive)
    }

    /// The closest hit, or with `any_hit` some hit; never `skip`.
    fn trace(&self, ray: &IntegerRay, skip: u32, any_hit: bool) -> Hit {
        self.trace_among(ray, any_hit, |primitive, _| primitive != skip)
    }

    /// The closest hits, at most so many.
    fn all(&self, ray: &IntegerRay, most: u32) -> Vec<Hit> {
        let mut hits: Vec<Hit> = Vec::new();
        while (hits.len() as u64) < u64::from(most) {
            let last = hits.last().map(|hit| (hit.primitive, self.triangle(hit.primitive)));
            let is_later = |primitive: u32, triangle: [Vec3; 3]| match last {
                Some((other, _)) if other == primitive => false,
                Some((other, vertices)) => !ray.is_nearer([triangle, vertices], primitive < other),
                None => true,
            };
            // What is farther than every float is not hit.
            match self.trace_among(ray, false, is_later) {
                hit if is_hit(&hit) && hit.t.is_finite() => hits.push(hit),
                _ => break,
            }
        }
        hits
    }

    /// The closest hit of those triangles that are `wanted` if they are hit, or with `any_hit` some hit.
    fn trace_among(&self, ray: &IntegerRay, any_hit: bool, wanted: impl Fn(u32, [Vec3; 3]) -> bool) -> Hit {
        let line = FilterRay::new(ray);
        let mut best: Option<(u32, [Vec3; 3], f64)> = None; // with a bound of t from above
        let mut test = |primitive: u32| {
            let triangle = self.triangle(primitive);
            let farthest = best.map_or(f64::INFINITY, |best| best.2);
            let limits = if any_hit && best.is_some() { None } else { line.limits(triangle) };
            if let Some([_, t_high]) = limits.filter(|[t_low, _]| *t_low <= farthest)
                && ray.t_inside(triangle).is_some()
                && wanted(primitive, triangle)
            {
                let is_nearer =
                    best.is_none_or(|(other, vertices, _)| ray.is_nearer([triangle, vertices], primitive < other));
                if is_nearer {
                    best = Some((primitive, triangle, t_high.min(farthest)));
                }
            }
            match best {
                Some(_) if any_hit => f64::NEG_INFINITY,
                Some((_, _, t_high)) => t_high,
                None => f64::INFINITY,
            }
        };
        match &self.hierarchy {
            Some(hierarchy) if ray.start.weights == [0.0; 2] => {
                let along = Line::new(ray.start.vertices[0].into(), ray.direction.into());
                hierarchy.visit(&along, f64::NEG_INFINITY, f64::INFINITY, test);
            }
            _ => (0..self.count as u32).for_each(|primitive| {
                test(primitive);
            }),
        }
        let Some((primitive, triangle, _)) = best else { return NO_HIT };
        if any_hit {
            return Hit { t: 0.0, u: 0.0, v: 0.0, primitive };
        }
        let at = ray.finish(triangle);
        Hit { t: at.t, u: at.u, v: at.v, primitive }
    }

    fn first_ray(&self, ray: &TraceRay, origin: Vec3) -> IntegerRay {
        IntegerRay {
            start: TrianglePoint::at(origin),
            direction: ray.direction_t_max.xyz(),
            limits: [ray.origin_t_min.w, ray.direction_t_max.w],
            t_exponent: 0,
            leaves: false,
        }
    }

    /// The secondary ray from the hit of a first one, as `leave_surface` starts it.
    fn second_ray(&self, first: &IntegerRay, from: &Hit, direction: Vec3, is_exact: bool) -> IntegerRay {
        let triangle = self.triangle(from.primitive);
        let weight0 = if is_exact { first.weight0(triangle) } else { ((1.0 - from.u) - from.v).max(0.0) };
        let at = SurfaceHit { weight0, u: from.u, v: from.v, primitive: from.primitive };
        IntegerRay {
            start: TrianglePoint::of_weights(triangle, start_weights(&at)),
            direction,
            limits: [0.0, f32::INFINITY],
            t_exponent: 0,
            leaves: true,
        }
    }
}

/// A ray in f64 with bounds, for all that is certain without exact integers.
struct FilterRay {
    start: DVec3,
    /// By how much `start` may be off, as magnitudes that times f64's rounding error are bounds.
    start_magnitude: DVec3,
    direction: DVec3,
}

/// With u = 2^-53 none of the numbers below is off by more than 9 u P, W by 12 u P, as `cl/intersect/exact_filter.cl`
/// derives, P the same expression of magnitudes; half as much again is for the rounding of the bounds. Products of four
/// floats are within f64's range.
const FILTER_ERROR: f64 = 9.0 * f64::EPSILON;

impl FilterRay {
    fn new(ray: &IntegerRay) -> FilterRay {
        let [base, other1, other2] = ray.start.vertices.map(DVec3::from);
        let [weight1, weight2] = ray.start.weights.map(f64::from);
        let (edge1, edge2) = (other1 - base, other2 - base);
        let starts_at_vertex = ray.start.weights == [0.0; 2];
        FilterRay {
            start: base + edge1 * weight1 + edge2 * weight2,
            // Of a sum of five roundings; FILTER_ERROR is for one.
            start_magnitude: if starts_at_vertex { DVec3::ZERO } else { base.abs() + edge1.abs() + edge2.abs() },
            direction: ray.direction.into(),
        }
    }

    /// Limits of t where the triangle may be hit; infinite ones where t is open. `None` where it is surely missed.
    fn limits(&self, triangle: [Vec3; 3]) -> Option<[f64; 2]> {
        let [p0, p1, p2] = triangle.map(DVec3::from);
        let (edge1, edge2, from) = (p1 - p0, p2 - p0, p0 - self.start);
        let (normal, moment) = (edge1.cross(edge2), from.cross(self.direction));
        let (distance, det) = (normal.dot(from), normal.dot(self.direction));
        let (weight1, weight2) = (edge2.dot(moment), -edge1.dot(moment));
        let weight0 = det - weight1 - weight2;

        let (size1, size2, size) = (edge1.abs(), edge2.abs(), self.direction.abs());
        let from_size = from.abs() + self.start_magnitude;
        let normal_size = magnitude_cross(size1, size2);
        let moment_size = magnitude_cross(from_size, size);
        let (distance_bound, det_bound) =
            (FILTER_ERROR * normal_size.dot(from_size), FILTER_ERROR * normal_size.dot(size));
        let (bound1, bound2) = (FILTER_ERROR * size2.dot(moment_size), FILTER_ERROR * size1.dot(moment_size));
        let bound0 = det_bound + bound1 + bound2;
        let signs = [(weight0, bound0), (weight1, bound1), (weight2, bound2), (det, det_bound)]
            .map(|(number, bound)| i32::from(number > bound) - i32::from(number < -bound));
        if signs.contains(&1) && signs.contains(&-1) {
            return None;
        }
        let rest = det.abs() - det_bound;
        if rest <= 0.25 * det.abs() {
            return Some([f64::NEG_INFINITY, f64::INFINITY]);
        }
        let t = distance / det;
        let error = 1.01 * (t.abs() * det_bound + distance_bound) / rest + 4.0 * f64::EPSILON * t.abs();
        Some([t - error, t + error])
    }
}

fn magnitude_cross(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::new(a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x)
}

/// Answers the extreme rays of a job in `result`, which has the answers of all others, and notes how long that took.
pub(crate) fn answer_extreme(job: &TraceJob, options: &TraceOptions, buffers: &SceneBuffers, result: &mut TraceResult) {
    if job.extreme.is_empty() {
        return;
    }
    let start = Instant::now();
    let world = World::new(buffers, job.extreme.len());
    let is_exact = options.intersector == Intersector::Exact;
    let given = &*result;
    let answered = parallel::map_slice(job.extreme, |extreme| {
        let first = world.first_ray(&job.rays[extreme.index], extreme.origin);
        let hit = if extreme.is_second { given.hits[extreme.index] } else { traced(&world, &first, job.any_hit) };
        let next = job.next_directions.map(|directions| {
            let direction = directions[extreme.index].xyz();
            if !is_hit(&hit) || !direction.is_finite() || direction == Vec3::ZERO {
                return NO_HIT;
            }
            let second = world.second_ray(&first, &hit, direction, is_exact || !extreme.is_second);
            world.trace(&second, hit.primitive, false)
        });
        (extreme.index, hit, next)
    });
    for (index, hit, next) in answered {
        result.hits[index] = hit;
        if let (Some(all), Some(next)) = (&mut result.next_hits, next) {
            all[index] = next;
        }
    }
    result.extreme_s = Some(start.elapsed().as_secs_f64());
}

fn traced(world: &World, ray: &IntegerRay, any_hit: bool) -> Hit {
    if is_empty(ray) { NO_HIT } else { world.trace(ray, NO_PRIMITIVE, any_hit) }
}

/// Whether a ray goes nowhere.
fn is_empty(ray: &IntegerRay) -> bool {
    let [t_min, t_max] = ray.limits;
    ray.direction == Vec3::ZERO || t_min.is_nan() || t_max.is_nan() || t_min > t_max
}

/// All hits of the extreme rays of a job.
#[derive(Debug, Default)]
pub(crate) struct AllOfExtreme {
    /// Those of each ray, and its number.
    hits: Vec<(usize, Vec<Hit>)>,
    seconds: Option<f64>,
}

impl AllOfExtreme {
    /// Writes how many hits they have.
    pub(crate) fn count_in(&self, counts: &mut [u32]) {
        self.hits.iter().for_each(|(index, hits)| counts[*index] = hits.len() as u32);
    }

    /// Their numbers.
    pub(crate) fn rays(&self) -> impl Iterator<Item = usize> {
        self.hits.iter().map(|(ray, _)| *ray)
    }

    /// Writes their hits where they are wanted, and how long they took.
    pub(crate) fn list_in(&self, result: &mut AllHits) {
        if !result.hits.is_empty() {
            for (index, hits) in &self.hits {
                let range = result.range(*index);
                result.hits[range].copy_from_slice(hits);
            }
        }
        result.extreme_s = self.seconds;
    }
}

/// Traces the extreme rays of a job.
pub(crate) fn all_extreme(job: &AllHitsJob, buffers: &SceneBuffers) -> AllOfExtreme {
    if job.extreme.is_empty() {
        return AllOfExtreme::default();
    }
    let start = Instant::now();
    let world = World::new(buffers, job.extreme.len());
    let firsts: Vec<_> = job.extreme.iter().filter(|extreme| !extreme.is_second).collect();
    let hits = parallel::map_slice(&firsts, |extreme| {
        let ray = world.first_ray(&job.rays[extreme.index], extreme.origin);
        (extreme.index, if is_empty(&ray) { Vec::new() } else { world.all(&ray, job.most) })
    });
    AllOfExtreme { hits, seconds: Some(start.elapsed().as_secs_f64()) }
}
