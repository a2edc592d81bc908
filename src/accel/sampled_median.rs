//! kd-tree by the median of a random sample: [`super::median`], but for a node of many triangles the median is that of
//! a fixed number of them, drawn at random (thesis, section 5.5).
//!
//! Of n triangles drawn, the median stands at a rank whose share of all is off 1/2 by 1/(2 sqrt n) (the standard
//! deviation), however many there are, so the plane takes constant time instead of linear time; handing the triangles
//! down stays linear.
//!
//! Bad at: what the median is bad at. Small samples make uneven children, hence deeper trees.

use super::median::median_plane;
use super::memory::GrowthLimit;
use super::{BuildOptions, KdTree, divide};
use glam::Vec3;
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// Builds the tree; see [`super::build_kd_tree`].
pub(super) fn build(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
    growth: &GrowthLimit,
) -> KdTree {
    let size = options.sample_size.max(1) as usize;
    divide::build(vertices, primitives, options, growth, |axis, triangles, place| {
        if triangles.len() <= size {
            return median_plane(vertices, axis, triangles.iter().copied());
        }
        // Each node has its own random numbers: they do not depend on the thread that builds it, or on when.
        let mut random = SplitMix64::seed_from_u64(place.number);
        let sample = (0..size).map(|_| {
            // The upper half of the product of 32 random bits and a length below 2^32 is below the length.
            let index = (u64::from(random.next_u32()) * triangles.len() as u64) >> 32;
            triangles[index as usize]
        });
        median_plane(vertices, axis, sample)
    })
}
