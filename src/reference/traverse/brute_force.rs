//! Twin of `cl/traverse/brute_force.cl`.

use super::leaf::test_triangles;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::Work;
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::Hit;

#[inline(always)]
pub fn traverse_brute_force(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = no_hit_yet(ray);
    test_triangles(buffers, options, ray, 0..buffers.references.len(), 0, any_hit, &mut hit, work);
    hit
}
