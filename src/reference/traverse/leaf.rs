//! Twin of `cl/traverse/leaf.cl`: the triangles of a leaf. The reasons are there.

use super::finish;
use crate::fma::with_fma;
use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::intersect::exact::test_exactly;
use crate::reference::intersect::intersect;
use crate::reference::shared::memory::{NoWork, Work, load_reference};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, KdNode, NO_PRIMITIVE, WorkCounter};
use std::ops::Range;

with_fma! {
    /// Not inlined, as the exact test is: five tests in each of the traversals were a third of what they are compiled
    /// to.
    fn test_rounded<W: Work>(
        buffers: &SceneBuffers,
        intersector: Intersector,
        ray: &Ray,
        primitive: u32,
        hit: &mut Hit,
        work: &mut W,
    ) {
        if let Some(found) = intersect(buffers, intersector, ray, primitive, work)
            && ray.is_nearer(hit, found.t, primitive)
        {
            *hit = Hit { t: found.t, u: found.u, v: found.v, primitive };
        }
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

/// Whether the t of a hit that a triangle test has found is a float in the caller's units.
#[inline(always)]
pub fn has_float_t(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, mut hit: Hit) -> bool {
    if !ray.callers_t(hit.t).is_finite() {
        finish(buffers, options, ray, &mut hit);
    }
    hit.t.is_finite()
}

/// How many hits were counted, of what a traversal that counts them has left.
pub fn counted_hits(hit: &Hit) -> u32 {
    hit.v.to_bits()
}

with_fma! {
    /// Counts a triangle that the ray hits, which is in no other leaf.
    fn test_for_count<W: Work>(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        ray: &Ray,
        primitive: u32,
        hit: &mut Hit,
        work: &mut W,
    ) {
        let mut found = no_hit_yet(ray);
        test(buffers, options, ray, primitive, &mut found, work);
        if found.primitive == NO_PRIMITIVE || !has_float_t(buffers, options, ray, found) {
            return;
        }
        let count = counted_hits(hit) + 1;
        hit.v = f32::from_bits(count);
        if count == ray.most {
            hit.primitive = primitive;
        }
    }
}

/// Whether a triangle that is hit comes before a hit.
#[inline(always)]
fn comes_before(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, primitive: u32, other: &Hit) -> bool {
    let mut nearer = *other;
    test(buffers, options, ray, primitive, &mut nearer, &mut NoWork);
    nearer.primitive != other.primitive
}

with_fma! {
    /// Puts a triangle that the ray hits into its place in the list, which has room for one hit at least. `hit` is the
    /// last one of a full list: what lies behind it need not be looked at.
    fn test_for_list(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        ray: &Ray,
        primitive: u32,
        hit: &mut Hit,
        list: (&mut [Hit], &mut usize),
    ) {
        let (hits, count) = list;
        let mut found = *hit;
        test(buffers, options, ray, primitive, &mut found, &mut NoWork);
        if found.primitive == hit.primitive {
            return;
        }
        let is_full = *count == hits.len();
        let (mut low, mut high) = (0, *count - usize::from(is_full));
        let mut middle = high.saturating_sub(1);
        while low < high {
            match comes_before(buffers, options, ray, primitive, &hits[middle]) {
                true => high = middle,
                false => low = middle + 1,
            }
            middle = (low + high) / 2;
        }
        if low > 0 && hits[low - 1].primitive == primitive {
            return;
        }
        *count += usize::from(!is_full);
        hits[low..*count].rotate_right(1);
        hits[low] = found;
        if *count == hits.len() {
            *hit = hits[*count - 1];
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
    if let Some(list) = work.list() {
        test_for_list(buffers, options, ray, primitive, hit, list);
    } else if ray.most > 0 {
        test_for_count(buffers, options, ray, primitive, hit, work);
    } else if ray.after.primitive == NO_PRIMITIVE {
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
