//! Twins of `cl/traverse/boxes.cl` and `cl/traverse/spheres.cl`: bounding volumes one after the other. The reasons are there.

use super::leaf::test_leaf;
use super::no_hit_yet;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::math::{dot3, fma3};
use crate::reference::memory::{Work, load_bounds, load_node};
use crate::reference::ray::{Ray, SLACK, widen_down, widen_up};
use crate::reference::slab::pad_distance;
use crate::shared::{Hit, WorkCounter};

pub use crate::shared::constants::SPHERE_SLACK;

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

#[inline(always)]
fn traverse_clusters<W: Work>(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut W,
    may_meet: impl Fn(usize, &Hit, &mut W) -> bool,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    for cluster in 0..load_node(buffers, 0, work).right as usize {
        work.count(WorkCounter::Steps, 1);
        if !may_meet(cluster, &hit, work) {
            continue;
        }
        let leaf = load_node(buffers, 1 + cluster, work);
        if test_leaf(buffers, options, ray, &leaf, any_hit, &mut hit, work) {
            return hit;
        }
    }
    hit
}

#[inline(always)]
fn pad_distance_in(buffers: &SceneBuffers, ray: &Ray) -> f32 {
    let (low, high) = (buffers.params.low, buffers.params.high);
    pad_distance(ray, low.xyz(), high.xyz(), high.w)
}

/// Twin of `cl/traverse/boxes.cl`.
#[inline(always)]
pub fn traverse_boxes(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let slack = SLACK * pad_distance_in(buffers, ray);
    traverse_clusters(buffers, options, ray, any_hit, work, |cluster, hit, work| {
        let low = load_bounds(buffers, 2 * cluster, work).xyz();
        let high = load_bounds(buffers, 2 * cluster + 1, work).xyz();
        ray.clip_to_thick_box(slack, low, high).is_some_and(|(t_near, _)| hit.t >= t_near)
    })
}

/// Twin of `cl/traverse/spheres.cl`.
#[inline(always)]
pub fn traverse_spheres(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let slack = SPHERE_SLACK * pad_distance_in(buffers, ray);
    traverse_clusters(buffers, options, ray, any_hit, work, |cluster, hit, work| {
        may_meet_sphere(ray, slack, load_bounds(buffers, cluster, work), hit.t)
    })
}
