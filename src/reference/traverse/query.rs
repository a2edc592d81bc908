//! Twin of `cl/traverse/query.cl`: a ray of a picture. The reasons are there.

use super::{finish, traverse};
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::memory::Work;
use crate::reference::shared::ray::Ray;
use crate::shared::Hit;

/// The closest hit of the ray, with t, u and v in full; in the caller's units of t. Adds to `work` what that took.
#[inline(always)]
pub fn closest_hit(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, work: &mut impl Work) -> Hit {
    let mut hit = traverse(buffers, options, ray, false, work);
    finish(buffers, options, ray, &mut hit);
    hit
}
