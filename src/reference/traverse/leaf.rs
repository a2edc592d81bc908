//! Twin of `cl/traverse/leaf.cl`: the triangles of a leaf. The reasons are there.

use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::intersect::exact::test_exactly;
use crate::reference::intersect::intersect;
use crate::reference::shared::fma::with_fma;
use crate::reference::shared::memory::{Work, load_reference};
use crate::reference::shared::ray::Ray;
use crate::shared::{Hit, KdNode, NO_PRIMITIVE, WorkCounter};
use std::ops::Range;

#[inline(always)]
fn test_rounded(
    buffers: &SceneBuffers,
    intersector: Intersector,
    ray: &Ray,
    primitive: u32,
    hit: &mut Hit,
    work: &mut impl Work,
) {
    if let Some(found) = intersect(buffers, intersector, ray, primitive, work)
        && ray.is_nearer(hit, found.t, primitive)
    {
        *hit = Hit { t: found.t, u: found.u, v: found.v, primitive };
    }
}

/// Tests a triangle by the method that is chosen.
#[inline(always)]
fn test(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    primitive: u32,
    hit: &mut Hit,
    work: &mut impl Work,
) {
    match options.intersector {
        Intersector::Exact => test_exactly(buffers, ray, primitive, hit, work),
        rounded => test_rounded(buffers, rounded, ray, primitive, hit, work),
    }
}

with_fma! {
    /// Tests a triangle that counts only if it comes after `ray.after`.
    fn test_later<W: Work>(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        ray: &Ray,
        primitive: u32,
        hit: &mut Hit,
        work: &mut W,
    ) {
        if primitive == ray.after.primitive {
            return;
        }
        let mut found = *hit;
        test(buffers, options, ray, primitive, &mut found, work);
        if found.primitive != primitive || hit.primitive == primitive {
            return;
        }
        let mut earlier = ray.after;
        test(buffers, options, ray, primitive, &mut earlier, work);
        if earlier.primitive != primitive {
            *hit = found;
        }
    }
}

/// Tests the triangle of one reference, whose number is `to_primitive` further on in the scene.
#[inline(always)]
fn test_triangle(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    reference: usize,
    to_primitive: u32,
    hit: &mut Hit,
    work: &mut impl Work,
) {
    let primitive = load_reference(buffers, reference, work).wrapping_add(to_primitive);
    if primitive == ray.skip {
        return;
    }
    work.count(WorkCounter::Tests, 1);
    if ray.after.primitive == NO_PRIMITIVE {
        test(buffers, options, ray, primitive, hit, work);
    } else {
        test_later(buffers, options, ray, primitive, hit, work);
    }
}

/// Tests the triangles of some references, whose numbers are `to_primitive` further on. True when that answers the
/// query.
#[inline(always)]
#[expect(clippy::too_many_arguments)]
pub fn test_triangles(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    references: Range<usize>,
    to_primitive: u32,
    any_hit: bool,
    hit: &mut Hit,
    work: &mut impl Work,
) -> bool {
    for reference in references {
        test_triangle(buffers, options, ray, reference, to_primitive, hit, work);
        if any_hit && hit.primitive != NO_PRIMITIVE {
            return true;
        }
    }
    false
}

/// The same for the references of a leaf, which are counted.
#[inline(always)]
#[expect(clippy::too_many_arguments)]
pub fn test_listed(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    references: Range<usize>,
    to_primitive: u32,
    any_hit: bool,
    hit: &mut Hit,
    work: &mut impl Work,
) -> bool {
    work.count(WorkCounter::Leaves, 1);
    work.count(WorkCounter::EmptyLeaves, u32::from(references.is_empty()));
    test_triangles(buffers, options, ray, references, to_primitive, any_hit, hit, work)
}

/// The same for the references of a leaf record.
#[inline(always)]
pub fn test_leaf(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    leaf: &KdNode,
    any_hit: bool,
    hit: &mut Hit,
    work: &mut impl Work,
) -> bool {
    let references = leaf.left as usize..(leaf.left + leaf.right) as usize;
    test_listed(buffers, options, ray, references, 0, any_hit, hit, work)
}
