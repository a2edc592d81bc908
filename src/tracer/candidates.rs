//! Triangles that may be the nearest ones of points: what is asked, and what comes of it.

use crate::bounds::MOST_CANDIDATES;
use crate::layout::Float4;
use crate::pack::PointScene;
use std::sync::Arc;

/// Points of which the triangles are asked for that may be the nearest ones.
#[derive(Debug, Clone, Copy)]
pub struct CandidatesJob<'a> {
    /// What they are looked for in.
    pub scene: &'a Arc<PointScene>,
    /// The points: world units times [`PointScene::scale`], w unused. One that is NaN has no candidates.
    pub points: &'a [Float4],
}

/// Triangles that may be the nearest ones of points. The nearest one is always among them; what other ones there are is
/// up to rounding.
#[derive(Debug, Clone, Default)]
pub struct Candidates {
    /// How many each point has.
    pub counts: Vec<u32>,
    /// [`MOST_CANDIDATES`] places for each point, of which those that it has are filled; of one that has more all are.
    pub listed: Vec<u32>,
    /// Seconds of device time.
    pub kernel_s: f64,
}

impl Candidates {
    /// Those of a point, unless it has too many for the list.
    pub fn of_point(&self, point: usize) -> Option<&[u32]> {
        let (count, most) = (self.counts[point] as usize, MOST_CANDIDATES as usize);
        (count <= most).then(|| &self.listed[most * point..][..count])
    }
}
