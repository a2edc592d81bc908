//! Twin of `cl/traverse/brute_force.cl`.

use super::NO_HIT;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::intersect::intersect;
use crate::reference::ray::Ray;
use crate::shared::{Hit, NO_PRIMITIVE};

/// Tests one triangle.
#[inline(always)]
pub fn test_triangle(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, primitive: u32, hit: &mut Hit) {
    if primitive == ray.skip {
        return;
    }
    if let Some(found) = intersect(buffers, options.intersector, ray, primitive)
        && ray.is_nearer(hit, found.t, primitive)
    {
        *hit = Hit { t: found.t, u: found.u, v: found.v, primitive };
    }
}

#[inline(always)]
pub fn traverse_brute_force(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, any_hit: bool) -> Hit {
    let mut hit = NO_HIT;
    for &primitive in &buffers.references {
        test_triangle(buffers, options, ray, primitive, &mut hit);
        if any_hit && hit.primitive != NO_PRIMITIVE {
            break;
        }
    }
    hit
}
