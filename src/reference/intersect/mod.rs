//! Twins of `cl/intersect/`, file for file: the ray-triangle tests. The reasons are there.

pub mod edges;
pub mod exact;
pub mod exact_filter;
pub mod exact_integers;
pub mod filter;
pub mod moller_trumbore;
pub mod plucker;
pub mod precomputed;
pub mod thesis;
pub mod ties;
pub mod watertight;

use super::shared::memory::{Work, load_transform, load_vertices};
use super::shared::ray::Ray;
use crate::options::Intersector;
use crate::pack::SceneBuffers;
use moller_trumbore::{Intersection, intersect_moller_trumbore};
use plucker::intersect_plucker;
use precomputed::intersect_precomputed;
use thesis::intersect_thesis;
use watertight::intersect_watertight;

/// Where the ray's line meets the closed triangle, by the chosen test.
#[inline(always)]
pub fn intersect(
    buffers: &SceneBuffers,
    intersector: Intersector,
    ray: &Ray,
    primitive: u32,
    work: &mut impl Work,
) -> Option<Intersection> {
    match intersector {
        Intersector::Exact => unreachable!("it has a test of its own"),
        Intersector::MollerTrumbore => intersect_moller_trumbore(ray, load_vertices(buffers, primitive, work)),
        Intersector::Watertight => intersect_watertight(ray, load_vertices(buffers, primitive, work)),
        Intersector::Plucker => intersect_plucker(ray, load_vertices(buffers, primitive, work)),
        Intersector::Precomputed => intersect_precomputed(ray, load_transform(buffers, primitive, work)),
        Intersector::Thesis => intersect_thesis(ray, load_vertices(buffers, primitive, work), buffers.params.scale),
    }
}
