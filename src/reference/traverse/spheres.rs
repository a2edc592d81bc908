//! Twin of `cl/traverse/spheres.cl`: bounding spheres one after the other. The reasons are there.

use super::boxes::{padding_distance_in, traverse_clusters};
use crate::bounds::SPHERE_SLACK;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{dot3, fma3};
use crate::reference::shared::memory::{Work, load_bounds};
use crate::reference::shared::ray::{Ray, widen_down, widen_up};
use crate::shared::Hit;

/// Whether the ray may meet the sphere within its limits before `t_hit`.
#[inline(always)]
pub fn may_meet_sphere(ray: &Ray, slack: f32, sphere: Float4, t_hit: f32) -> bool {
    let to_centre = ray.from_origin(sphere.xyz());
    let square = dot3(ray.direction, ray.direction);
    let along = dot3(ray.direction, to_centre) / square;
    if !along.is_finite() {
        return true;
    }
    let beside = fma3(ray.direction, -along, to_centre);
    let radius = sphere.w + slack;
    let beside2 = widen_down(dot3(beside, beside));
    let radius2 = widen_up(radius * radius);
    if beside2 > radius2 {
        return false;
    }
    let half_chord = ((radius2 - beside2) / square).sqrt();
    let t_near = (along - half_chord) - slack;
    let t_far = (along + half_chord) + slack;
    !(t_near > ray.t_far || t_far < ray.t_near || t_hit < t_near)
}

/// Tests the triangles of the clusters whose spheres the ray may meet.
#[inline(always)]
pub fn traverse_spheres(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let slack = SPHERE_SLACK * padding_distance_in(buffers, ray);
    traverse_clusters(buffers, options, ray, any_hit, work, |cluster, hit, work| {
        may_meet_sphere(ray, slack, load_bounds(buffers, cluster, work), hit.t)
    })
}
