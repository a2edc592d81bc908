//! Twin of `cl/kernels/closest_point.cl`: which triangles may be the nearest one of a point. The reasons are there.

use crate::bounds::MOST_CANDIDATES;
use crate::fma::with_fma;
use crate::layout::Float4;
use crate::math::is_finite3;
use crate::pack::PointScene;
use crate::reference::points::{Search, binary, wide};

/// How many triangles may be the nearest one of a point; `list` gets them.
#[inline(always)]
fn candidates(scene: &PointScene, point: Float4, list: &mut dyn FnMut(u32)) -> u32 {
    let point = point.xyz();
    if !is_finite3(point) {
        return 0;
    }
    let visit_triangles = if scene.is_wide() { wide::visit_triangles } else { binary::visit_triangles };
    let mut nearest = Search::nearest();
    visit_triangles(scene, point, &mut nearest);
    let mut within = Search::within(nearest.distance, list);
    visit_triangles(scene, point, &mut within);
    within.listed
}

with_fma! {
    /// How many triangles may be the nearest one of each point, and the first `MOST_CANDIDATES` of them.
    pub fn list_candidates(scene: &PointScene, points: &[Float4], counts: &mut [u32], lists: &mut [u32]) {
        let lists = lists.chunks_exact_mut(MOST_CANDIDATES as usize);
        for ((point, count), list) in points.iter().zip(counts).zip(lists) {
            let mut places = list.iter_mut();
            *count = candidates(scene, *point, &mut |primitive| {
                if let Some(place) = places.next() {
                    *place = primitive;
                }
            });
        }
    }
}

with_fma! {
    /// All triangles that may be the nearest one of a point.
    pub fn all_candidates(scene: &PointScene, point: Float4) -> Vec<u32> {
        let mut all = Vec::new();
        candidates(scene, point, &mut |primitive| all.push(primitive));
        all
    }
}
