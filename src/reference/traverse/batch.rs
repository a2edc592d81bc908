//! Twin of `cl/traverse/batch.cl`: a ray of the caller's. The reasons are there.

use super::{finish, traverse};
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{abs3, exponent_field, max_component};
use crate::reference::shared::memory::Work;
use crate::reference::shared::ray::{NO_HIT, Ray};
use crate::shared::{Hit, NO_PRIMITIVE, TraceRay};
use glam::Vec3;

/// Turns the ray's factors of t into those of the caller, whose direction this is.
#[inline(always)]
pub fn use_callers_units(ray: &mut Ray, direction: Vec3, scale: f32) {
    let highest = |v: Vec3| exponent_field(max_component(abs3(v)));
    let exponent = highest(ray.direction) - highest(direction) + 127 - exponent_field(scale);
    let power = |exponent: i32| f32::from_bits(((exponent + 127) as u32) << 23);
    ray.t_lift = power(exponent / 2);
    ray.t_scale = power(exponent - exponent / 2);
}

/// The ray of a query.
#[inline(always)]
pub fn batch_ray(query: &TraceRay, scale: f32) -> Ray {
    let (origin, direction) = (query.origin_t_min, query.direction_t_max);
    let mut ray = Ray::new(origin.xyz(), direction.xyz(), 0.0, f32::INFINITY, NO_PRIMITIVE);
    if ray.t_near <= ray.t_far {
        use_callers_units(&mut ray, direction.xyz(), scale);
        if origin.w <= direction.w {
            ray.limit(origin.w, direction.w);
        } else {
            (ray.t_near, ray.t_far) = (f32::INFINITY, f32::NEG_INFINITY);
        }
    }
    ray
}

/// A hit in the caller's units of t, in which what is farther than every float is not hit.
#[inline(always)]
pub fn batch_hit(hit: Hit) -> Hit {
    if hit.primitive != NO_PRIMITIVE && hit.t.is_finite() { hit } else { NO_HIT }
}

/// The closest hit of a ray, or with `any_hit` which triangle some hit is on.
#[inline(always)]
pub fn trace_batch(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    query: &TraceRay,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let ray = batch_ray(query, buffers.params.scale);
    let mut hit = traverse(buffers, options, &ray, any_hit, work);
    if any_hit {
        return if hit.primitive != NO_PRIMITIVE { Hit { t: 0.0, u: 0.0, v: 0.0, ..hit } } else { NO_HIT };
    }
    finish(buffers, options, &ray, &mut hit);
    batch_hit(hit)
}
