//! The closest points of scenes to points, distances, and on which side of a closed surface points are: exactly.
//!
//! A device, or the twin, lists for each point the few triangles that may be the nearest one
//! (`cl/kernels/closest_point.cl`); the host decides among them exactly (`closest/decide.rs`). Which ones are listed is
//! up to rounding, the answer is not: it is the same, to the bit, on every device and by every structure. Each number
//! is the exact one, rounded once.
//!
//! Triangles without area have closest points, too. Points that tracing space cannot hold, and those with more
//! candidates than a list has room for, are answered on the host.

mod decide;
mod near;
mod number;
mod triangle;

pub use decide::Closest;

use crate::budget::MemoryBudget;
use crate::crossings::contains;
use crate::error::Result;
use crate::layout::Float4;
use crate::pack::{PointScene, SceneBuffers};
use crate::parallel;
use crate::reference::kernels::closest_point::all_candidates;
use crate::tracer::{Backend, CandidatesJob, Progress};
use glam::Vec3;
use std::sync::Arc;

/// Points whose candidates are listed at a time: 18 MiB of lists.
const POINTS_AT_A_TIME: usize = 1 << 18;

/// A point farther away in tracing space than this is answered on the host: squares of distances stay far from the
/// largest float, and before that f64 has to tell the triangles apart.
const FARTHEST_POINT: f32 = (1u64 << 40) as f32;

/// A scene as point queries want it: on a processor's device, or on another one, or the reference.
///
/// # Errors
/// As [`PointScene::new`].
pub fn point_scene(
    buffers: &Arc<SceneBuffers>,
    is_for_processor: bool,
    budget: &MemoryBudget,
) -> Result<Arc<PointScene>> {
    PointScene::new(buffers, |i| given_triangle(buffers, i), is_for_processor, budget).map(Arc::new)
}

/// The vertices of a triangle in world units, also of one without area; some are not finite of one that has no closest
/// point.
fn given_triangle(buffers: &SceneBuffers, primitive: u32) -> [Vec3; 3] {
    buffers.left_out(primitive).unwrap_or_else(|| buffers.given_triangle(primitive))
}

/// The closest point of the scene to each of some points, all in world units; of triangles that are as near that of the
/// lowest number. `None` for a point that is not finite, and of a scene without triangles.
///
/// # Errors
/// As [`Backend::find_candidates`].
pub fn closest_points(
    backend: &mut dyn Backend,
    scene: &Arc<PointScene>,
    points: &[[f32; 3]],
    progress: Progress,
) -> Result<Vec<Option<Closest>>> {
    let mut closest = Vec::with_capacity(points.len());
    for part in points.chunks(POINTS_AT_A_TIME) {
        let scaled = |point: &[f32; 3]| {
            let scaled = Vec3::from(*point) * scene.scale();
            Float4::new(if scaled.abs().max_element() <= FARTHEST_POINT { scaled } else { Vec3::NAN }, 0.0)
        };
        let in_tracing_space = parallel::map_slice(part, scaled);
        let job = CandidatesJob { scene, points: &in_tracing_space };
        let done = closest.len();
        let found = backend.find_candidates(&job, &|of_part| {
            progress((done as f64 + of_part * part.len() as f64) / points.len() as f64);
        })?;
        let answer = |i: usize| {
            let (point, scaled) = (Vec3::from(part[i]), in_tracing_space[i]);
            if !point.is_finite() {
                return None;
            }
            if scaled.x.is_nan() {
                return nearest_of(scene, 0..scene.buffers().triangle_count() as u32, point);
            }
            match found.of_point(i) {
                Some(candidates) => nearest_of(scene, candidates.iter().copied(), point),
                None => nearest_of(scene, all_candidates(scene, scaled), point),
            }
        };
        parallel::extend(&mut closest, part.len(), answer);
    }
    Ok(closest)
}

/// The closest point of the nearest of the triangles with these numbers.
fn nearest_of(scene: &PointScene, numbers: impl IntoIterator<Item = u32>, point: Vec3) -> Option<Closest> {
    let given = |number| (number, given_triangle(scene.buffers(), number));
    let is_sound = |(_, corners): &(u32, [Vec3; 3])| corners.iter().all(|corner| corner.is_finite());
    let triangles: Vec<_> = numbers.into_iter().map(given).filter(is_sound).collect();
    decide::decide(&triangles, point)
}

/// The distance of each point from the scene: NaN of a point that is not finite, infinite of a scene without triangles.
pub fn distances(points: &[[f32; 3]], closest: &[Option<Closest>]) -> Vec<f32> {
    let distance = |(point, closest): (&[f32; 3], &Option<Closest>)| match closest {
        Some(closest) => closest.distance,
        None if Vec3::from(*point).is_finite() => f32::INFINITY,
        None => f32::NAN,
    };
    points.iter().zip(closest).map(distance).collect()
}

/// Makes the distances of points inside of a closed scene negative. [`crate::crossings::check_closed`] tells whether it
/// is closed.
///
/// # Errors
/// As [`contains`].
pub fn take_signs(
    backend: &mut dyn Backend,
    buffers: &SceneBuffers,
    points: &[[f32; 3]],
    distances: &mut [f32],
    budget: Option<MemoryBudget>,
    progress: Progress,
) -> Result<()> {
    negate(distances, &contains(backend, buffers, points, budget, progress)?);
    Ok(())
}

/// Makes the distances of points that are inside negative.
pub(crate) fn negate(distances: &mut [f32], inside: &[bool]) {
    let within = distances.iter_mut().zip(inside).filter(|(distance, is_inside)| **is_inside && **distance > 0.0);
    within.for_each(|(distance, _)| *distance = -*distance);
}
