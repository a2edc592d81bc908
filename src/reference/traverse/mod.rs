//! Twins of `cl/traverse/`, file for file: how a ray finds the triangles that it may hit. The reasons are there.

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
mod leaf;
mod octree;
mod thesis_restart;
pub mod volumes;

use super::exact::finish_exactly;
use super::fma::with_fma;
use super::instances::placed_vertices;
use super::memory::Work;
use super::ray::Ray;
use crate::options::{Intersector, StructureKind, TraceOptions, Traversal};
use crate::pack::SceneBuffers;
use crate::shared::{Hit, NO_PRIMITIVE};
use glam::Vec3;
use grid::traverse_grid;
use octree::traverse_octree;
use volumes::{traverse_boxes, traverse_spheres};

/// The hit of a ray that missed.
pub const NO_HIT: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };

/// What a traversal begins with: no hit, but nothing behind the ray's end is nearer.
#[inline(always)]
pub fn no_hit_yet(ray: &Ray) -> Hit {
    Hit { t: ray.t_far, u: ray.t_far, ..NO_HIT }
}

/// The vertices of a triangle, tracing space.
#[inline(always)]
pub fn vertices(buffers: &SceneBuffers, primitive: u32) -> [Vec3; 3] {
    if buffers.has_instances() {
        return placed_vertices(buffers, primitive);
    }
    let first = 3 * primitive as usize;
    [buffers.vertices[first].xyz(), buffers.vertices[first + 1].xyz(), buffers.vertices[first + 2].xyz()]
}

/// The closest hit of the ray, with t, u and v in full; in the caller's units of t. Adds to `work` what that took.
#[inline(always)]
pub fn closest_hit(buffers: &SceneBuffers, options: &TraceOptions, ray: &Ray, work: &mut impl Work) -> Hit {
    let mut hit = traverse(buffers, options, ray, false, work);
    finish(buffers, options, ray, &mut hit);
    hit
}

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
    /// The closest hit of the ray, or with `any_hit` some hit, of which only the primitive is final before [`finish`]. Adds to `work` what
    /// that took.
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
            (StructureKind::Kd, Traversal::Restart) => kd_restart::traverse_kd_restart(buffers, options, ray, any_hit, work),
            (StructureKind::Kd, Traversal::PushDown) => kd_push_down::traverse_kd_push_down(buffers, options, ray, any_hit, work),
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
