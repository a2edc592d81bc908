//! How often rays cross surfaces, and which points closed meshes contain.
//!
//! A ray that goes through an edge hits two triangles and crosses one surface; one that touches an edge from outside
//! hits two as well, and crosses none. To tell them apart the ray is moved sideways by less than any number, so that it
//! goes through no edge and no vertex any more: Edelsbrunner and Mücke, "Simulation of Simplicity", ACM Transactions on
//! Graphics 9(1), 1990. The weight of a vertex is linear in where the ray starts. Moved by s, a weight that is exactly
//! zero becomes s . (e x d), with d the ray's direction and e the edge opposite of the vertex, from the next corner but
//! one to the next. With s = (h, h^2, h^3) its sign is that of the first component of e x d that is not zero. There is
//! one, because a triangle that is hit is not parallel to d. Two triangles that share an edge have it in opposite
//! directions if they are on two sides of it, so of those around an edge or a vertex the moved ray crosses just those
//! that it must: of a closed surface an even number in all.
//!
//! The triangles of edges and vertices that are hit at the same t are one meeting. The ray crosses there once if the
//! moved ray crosses an odd number of them, and else it touches. What is hit inside of triangles is always crossed.
//! All signs are exact.
//!
//! Closed is what has every edge, between the same two positions, in an even number of triangles. Then how many
//! crossings there are from a point on, odd or even, does not depend on the direction.

use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::options::Intersector;
use crate::pack::SceneBuffers;
use crate::parallel;
use crate::reference::intersect::exact_integers::{IntegerRay, Meeting};
use crate::reference::shared::ray::TrianglePoint;
use crate::shared::Hit;
use crate::tracer::{AllHits, AllHitsJob, Backend, Progress, is_hit};
use glam::Vec3;
use rayon::slice::ParallelSliceMut;

/// Refuses a triangle test whose hits are not exact.
///
/// # Errors
/// [`Error::Option`].
pub fn require_exact(intersector: Intersector) -> Result<()> {
    if intersector == Intersector::Exact {
        return Ok(());
    }
    let message = format!("{intersector} cannot tell crossings from touches; nearest: {}", Intersector::Exact);
    Err(Error::option(Intersector::OPTION, message))
}

/// How often each ray crosses a surface, of which `all` has the exact hits; `ray` tells origin and direction in world
/// units.
pub fn count_crossings(buffers: &SceneBuffers, all: &AllHits, ray: impl Fn(usize) -> (Vec3, Vec3) + Sync) -> Vec<u32> {
    let count = all.starts.len().saturating_sub(1);
    let of_ray = |i: usize| {
        let (origin, direction) = ray(i);
        crossings_of_ray(buffers, all.of_ray(i), origin, direction)
    };
    parallel::map_numbers(count, of_ray)
}

/// Whether a ray that hits two triangles, the second one not nearer than the first, hits both at exactly the same t;
/// `origin` and `direction` are in world units.
pub fn is_tie(buffers: &SceneBuffers, triangles: [u32; 2], origin: Vec3, direction: Vec3) -> bool {
    let triangles = triangles.map(|triangle| buffers.given_triangle(triangle));
    !exact_ray(origin, direction).is_nearer(triangles, false)
}

/// A ray without limits, for exact integers.
fn exact_ray(origin: Vec3, direction: Vec3) -> IntegerRay {
    IntegerRay {
        start: TrianglePoint::at(origin),
        direction,
        limits: [f32::NEG_INFINITY, f32::INFINITY],
        t_exponent: 0,
        leaves: false,
    }
}

/// Rays whose hits are listed at a time.
const RAYS_AT_A_TIME: usize = 1 << 20;

/// How often each of `count` rays crosses a surface between its limits of t; `ray` tells origin, direction and limits
/// in world units. The hits of a part of them may take as much memory as `budget` has.
///
/// # Errors
/// As [`Backend::trace_all`]; [`Error::Option`] when the tracer's hits are not exact.
pub fn trace_crossings(
    backend: &mut dyn Backend,
    buffers: &SceneBuffers,
    count: usize,
    ray: impl Fn(usize) -> (Vec3, Vec3, f32, f32) + Sync,
    budget: Option<MemoryBudget>,
    progress: Progress,
) -> Result<Vec<u32>> {
    require_exact(backend.options().intersector)?;
    let mut counts = Vec::with_capacity(count);
    for first in (0..count).step_by(RAYS_AT_A_TIME) {
        let part = RAYS_AT_A_TIME.min(count - first);
        let batch = buffers.batch(part, |i| ray(first + i), None);
        let job = AllHitsJob { budget, ..AllHitsJob::of(&batch.job(false, 1)) };
        let all = backend.trace_all(&job, &|done| progress((first as f64 + done * part as f64) / count as f64))?;
        counts.extend(count_crossings(buffers, &all, |i| {
            let (origin, direction, ..) = ray(first + i);
            (origin, direction)
        }));
    }
    Ok(counts)
}

/// Whether each point, in world units, is inside of a closed scene or exactly on its surface. [`check_closed`] tells
/// whether it is closed.
///
/// # Errors
/// As [`trace_crossings`].
pub fn contains(
    backend: &mut dyn Backend,
    buffers: &SceneBuffers,
    points: &[[f32; 3]],
    budget: Option<MemoryBudget>,
    progress: Progress,
) -> Result<Vec<bool>> {
    require_exact(backend.options().intersector)?;
    contains_by(points, |asked, ray| match asked {
        OfPoints::IsHit => {
            let batch = buffers.batch(points.len(), ray, None);
            Ok(backend.trace(&batch.job(true, 1), &|_| ())?.hits.iter().map(is_hit).collect())
        }
        OfPoints::IsOdd => trace_crossings(backend, buffers, points.len(), ray, budget, progress).map(are_odd),
    })
}

/// What [`contains_by`] asks of a ray of each point: whether it hits anything, or crosses surfaces an odd number of
/// times.
#[derive(Clone, Copy)]
pub(crate) enum OfPoints {
    IsHit,
    IsOdd,
}

/// How many questions [`contains_by`] asks.
pub(crate) const QUESTIONS: usize = 4;

/// [`contains`], with the answers of whatever traces.
pub(crate) fn contains_by(
    points: &[[f32; 3]],
    mut answer: impl FnMut(OfPoints, &(dyn Fn(usize) -> (Vec3, Vec3, f32, f32) + Sync)) -> Result<Vec<bool>>,
) -> Result<Vec<bool>> {
    let mut ask = |asked, axis, t_max| answer(asked, &|i| (points[i].into(), axis, 0.0, t_max));
    let mut inside = vec![false; points.len()];
    // A ray without length hits what its point lies on: of three axes one at least is not in a triangle's plane.
    let questions: [_; QUESTIONS] = [
        (OfPoints::IsHit, Vec3::X, 0.0),
        (OfPoints::IsHit, Vec3::Y, 0.0),
        (OfPoints::IsHit, Vec3::Z, 0.0),
        (OfPoints::IsOdd, Vec3::X, f32::INFINITY),
    ];
    for (asked, axis, t_max) in questions {
        inside.iter_mut().zip(ask(asked, axis, t_max)?).for_each(|(inside, answer)| *inside |= answer);
    }
    Ok(inside)
}

/// Of each number of crossings, whether it is odd.
pub(crate) fn are_odd(crossings: Vec<u32>) -> Vec<bool> {
    crossings.into_iter().map(|count| count % 2 == 1).collect()
}

/// A hit whose weights are all at least this is inside of its triangle; where one is less, it is looked at closely.
const SURELY_INSIDE: f32 = 4.0 * f32::EPSILON;

fn crossings_of_ray(buffers: &SceneBuffers, hits: &[Hit], origin: Vec3, direction: Vec3) -> u32 {
    let mut count = 0;
    // The last meeting: a triangle of it, and whether the moved ray has crossed an odd number of them so far.
    let mut meeting: Option<([Vec3; 3], bool)> = None;
    for hit in hits {
        if hit.u >= SURELY_INSIDE && hit.v >= SURELY_INSIDE && (1.0 - hit.u) - hit.v >= SURELY_INSIDE {
            count += 1;
            continue;
        }
        let (ray, triangle) = (exact_ray(origin, direction), buffers.given_triangle(hit.primitive));
        match ray.meeting(triangle) {
            Meeting::Inside => count += 1,
            Meeting::Seam { crosses } => {
                let odd = match meeting {
                    // Hits come in their order, so the second one is farther or as far.
                    Some((other, odd)) if !ray.is_nearer([other, triangle], false) => odd,
                    Some((_, odd)) => {
                        count += u32::from(odd);
                        false
                    }
                    None => false,
                };
                meeting = Some((triangle, odd != crosses));
            }
        }
    }
    count + u32::from(meeting.is_some_and(|(_, odd)| odd))
}

/// Refuses a scene that is not closed.
///
/// # Errors
/// [`Error::Scene`] names an edge that is in an odd number of triangles.
pub fn check_closed(buffers: &SceneBuffers) -> Result<()> {
    let edges = |i: usize| {
        let corners = buffers.given_triangle(i as u32);
        (0..3).filter_map(move |k| edge_of(corners[k], corners[(k + 1) % 3]))
    };
    let mut edges = parallel::flat_map_numbers(buffers.triangle_count(), edges);
    edges.par_sort_unstable();
    let open: Vec<_> = edges.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1).map(|same| same[0]).collect();
    let Some([from, to]) = open.first().map(|ends| ends.map(|end| end.map(f32::from_bits))) else { return Ok(()) };
    let message = format!(
        "it is not closed, so that inside and outside mean nothing: {} of its edges are in an odd number of triangles, \
         such as that from {from:?} to {to:?}",
        open.len()
    );
    Err(Error::Scene(message))
}

/// An edge as bits, the same in both directions; none between a position and itself.
fn edge_of(a: Vec3, b: Vec3) -> Option<[[u32; 3]; 2]> {
    // -0 becomes 0
    let [a, b] = [a, b].map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
    (a != b).then(|| if a < b { [a, b] } else { [b, a] })
}
