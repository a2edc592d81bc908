//! Twins of `cl/traverse/`, file for file: how a ray finds the triangles that it may hit. The reasons are there.

pub mod batch;
mod boxes;
mod brute_force;
mod bvh2;
mod bvh8;
mod grid;
mod instances;
mod kd_push_down;
mod kd_restart;
mod kd_ropes;
mod kd_short_stack;
mod kd_stack;
mod kd_step;
pub mod leaf;
mod octree;
pub mod query;
pub mod spheres;
mod thesis_restart;
pub mod wide_stack;

use super::intersect::exact::finish_exactly;
use super::shared::memory::Work;
use super::shared::ray::Ray;
use crate::fma::with_fma;
use crate::options::{Intersector, StructureKind, TraceOptions, Traversal};
use crate::pack::SceneBuffers;
use crate::shared::Hit;
use boxes::traverse_boxes;
use grid::traverse_grid;
use octree::traverse_octree;
use spheres::traverse_spheres;

/// Writes t, u and v of what [`traverse`] has found, t in the caller's units.
#[inline(always)]
pub fn finish(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, hit: &mut Hit) {
    if options.intersector == Intersector::Exact {
        finish_exactly(buffers, ray, hit);
    } else {
        hit.t = ray.callers_t(hit.t);
    }
}

with_fma! {
    /// The closest hit of the ray, or with `any_hit` some hit, of which only the primitive is final before [`finish`].
    /// Adds to `work` what that took.
    pub fn traverse<W: Work>(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        ray: &Ray,
        any_hit: bool,
        work: &mut W,
    ) -> Hit {
        match (options.kind(), options.kd().traversal) {
            (StructureKind::Bvh2, _) => bvh2::traverse_bvh2(buffers, options, ray, any_hit, work),
            (StructureKind::Bvh8, _) => bvh8::traverse_bvh8(buffers, options, ray, any_hit, work),
            (StructureKind::Instances, _) => instances::traverse_instances(buffers, options, ray, any_hit, work),
            (StructureKind::Grid, _) => traverse_grid(buffers, options, ray, any_hit, work),
            (StructureKind::Octree, _) => traverse_octree(buffers, options, ray, any_hit, work),
            (StructureKind::Boxes, _) => traverse_boxes(buffers, options, ray, any_hit, work),
            (StructureKind::Spheres, _) => traverse_spheres(buffers, options, ray, any_hit, work),
            (StructureKind::Brute, _) => brute_force::traverse_brute_force(buffers, options, ray, any_hit, work),
            (StructureKind::Kd, Traversal::Stack) => kd_stack::traverse_kd_stack(buffers, options, ray, any_hit, work),
            (StructureKind::Kd, Traversal::Restart) => {
                kd_restart::traverse_kd_restart(buffers, options, ray, any_hit, work)
            }
            (StructureKind::Kd, Traversal::PushDown) => {
                kd_push_down::traverse_kd_push_down(buffers, options, ray, any_hit, work)
            }
            (StructureKind::Kd, Traversal::ShortStack) => {
                kd_short_stack::traverse_kd_short_stack(buffers, options, ray, any_hit, work)
            }
            (StructureKind::Kd, Traversal::Ropes) => kd_ropes::traverse_kd_ropes(buffers, options, ray, any_hit, work),
            (StructureKind::Kd, Traversal::ThesisRestart) => {
                thesis_restart::traverse_thesis_restart(buffers, options, ray, any_hit, work)
            }
        }
    }
}
