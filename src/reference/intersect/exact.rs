//! Twin of `cl/intersect/exact.cl`: the ray-triangle test that is right. The reasons are there. There is no step
//! between extended numbers and exact integers here (`cl/intersect/exact_closer.cl`), as on devices without double: the
//! answers are the same.

use super::exact_filter::{Decision, decide_extended, decide_rounded, finish_extended, place_hit, weight0_extended};
use super::exact_integers::{decide_by_integers, finish_by_integers, weight0_by_integers};
use super::moller_trumbore::Intersection;
use super::ties::{are_in_one_plane, are_same_points};
use super::watertight::shear_triangle;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::{Work, load_vertices, vertices};
use crate::reference::shared::ray::Ray;
use crate::shared::{Hit, NO_PRIMITIVE, WorkCounter};
use glam::Vec3;

/// Twin of `is_in_plane_along`.
fn is_in_plane_along(direction: Vec3, triangle: &[Vec3; 3]) -> bool {
    let [p0, p1, p2] = triangle;
    (direction.cmpeq(Vec3::ZERO) & p0.cmpeq(*p1) & p0.cmpeq(*p2)).any()
}

/// Twin of `decide_tie`.
#[inline(never)]
fn decide_tie(
    buffers: &SceneBuffers,
    ray: &Ray,
    triangle: &[Vec3; 3],
    primitive: u32,
    hit: &Hit,
    is_hit: bool,
) -> Decision {
    if hit.primitive != NO_PRIMITIVE {
        let best = vertices(buffers, hit.primitive);
        if are_same_points(triangle, &best) || (is_hit && are_in_one_plane(triangle, &best)) {
            return if primitive < hit.primitive { Decision::Hit([hit.u, hit.t]) } else { Decision::Miss };
        }
    }
    if ray.starts_on_triangle() && ray.t_near >= 0.0 {
        let left = vertices(buffers, ray.skip);
        if are_same_points(triangle, &left) || are_in_one_plane(triangle, &left) {
            return Decision::Miss;
        }
    }
    Decision::Undecided
}

/// Twin of `test_exactly`.
#[inline(always)]
pub fn test_exactly(buffers: &SceneBuffers, ray: &Ray, primitive: u32, hit: &mut Hit, work: &mut impl Work) {
    if primitive == hit.primitive {
        return;
    }
    let triangle = load_vertices(buffers, primitive, work);
    let placed = |hit: &Hit, decision| match decision {
        Decision::Hit(limits) => place_hit(ray, hit, limits),
        other => other,
    };
    let mut is_hit = false;
    let mut decision = match decide_rounded(&shear_triangle(ray, triangle)) {
        None => Decision::Miss,
        Some((is_sure, limits)) => match place_hit(ray, hit, limits) {
            place if is_sure || place == Decision::Miss => place,
            _ => Decision::Undecided,
        },
    };
    if decision == Decision::Undecided && is_in_plane_along(ray.direction, &triangle) {
        return;
    }
    if decision == Decision::Undecided {
        work.count(WorkCounter::ExtendedTests, 1);
        let extended = decide_extended(ray, triangle);
        is_hit = extended != Decision::Undecided;
        decision = placed(hit, extended);
    }
    if decision == Decision::Undecided {
        work.count(WorkCounter::CloseTests, 1);
        decision = decide_tie(buffers, ray, &triangle, primitive, hit, is_hit);
    }
    if decision == Decision::Undecided {
        decision = decide_by_integers(buffers, ray, triangle, primitive, hit);
    }
    if let Decision::Hit([t_low, t_high]) = decision {
        *hit = Hit { t: t_high, u: t_low, v: 0.0, primitive };
    }
}

/// Twin of `finish_exactly`.
#[inline(always)]
pub fn finish_exactly(buffers: &SceneBuffers, ray: &Ray, hit: &mut Hit) {
    if hit.primitive == NO_PRIMITIVE {
        return;
    }
    let triangle = vertices(buffers, hit.primitive);
    let Intersection { t, u, v } =
        finish_extended(ray, triangle).unwrap_or_else(|| finish_by_integers(buffers, ray, triangle));
    *hit = Hit { t, u, v, ..*hit };
}

/// The weight of vertex 0 of a hit.
#[inline(always)]
pub fn weight0_exactly(buffers: &SceneBuffers, ray: &Ray, hit: &Hit) -> f32 {
    let triangle = vertices(buffers, hit.primitive);
    weight0_extended(ray, triangle).unwrap_or_else(|| weight0_by_integers(buffers, ray, triangle))
}
