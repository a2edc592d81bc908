//! Twin of `cl/traverse/brute_force.cl`.

use super::NO_HIT;
use super::leaf::test_triangles;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::memory::Work;
use crate::reference::ray::Ray;
use crate::shared::Hit;

#[inline(always)]
pub fn traverse_brute_force(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let mut hit = NO_HIT;
    test_triangles(buffers, options, ray, 0..buffers.references.len(), 0, any_hit, &mut hit, work);
    hit
}
