//! All hits of rays: what is asked, and what comes of it.

use super::{ExtremeRay, TraceJob, TraceResult, is_hit};
use crate::budget::{CHECKED_FROM_BYTES, DecidedBy, MemoryBudget, Need, try_repeat};
use crate::error::Result;
use crate::shared::{Hit, TraceRay};
use crate::work::RayWork;
use std::ops::Range;

/// A batch of rays of which all hits are asked for.
///
/// A ray hits each triangle at most once. Hits come in the order of their t; of those at the same t, which edges and
/// vertices give to all triangles around them, the lower number comes first. t is compared as the triangle test knows
/// it: exactly, by [`Intersector::Exact`](crate::low_level::options::Intersector::Exact), also where two are the same
/// once they are rounded.
#[derive(Debug, Clone, Copy)]
pub struct AllHitsJob<'a> {
    /// The rays, as those of [`TraceJob::rays`].
    pub rays: &'a [TraceRay],
    /// Those that tracing space cannot hold.
    pub extreme: &'a [ExtremeRay],
    /// The most hits of a ray that are looked for: the closest ones.
    pub most: u32,
    /// Whether the hits are wanted, or only how many there are.
    pub wants_hits: bool,
    /// How much memory the hits may take, which only counting them tells; `None`: what there is then.
    pub budget: Option<MemoryBudget>,
}

impl<'a> AllHitsJob<'a> {
    /// All hits of the rays of `job`.
    pub fn of(job: &TraceJob<'a>) -> Self {
        AllHitsJob { rays: job.rays, extreme: job.extreme, most: u32::MAX, wants_hits: true, budget: None }
    }

    /// Whether the closest hit of each ray is all that is wanted.
    pub(crate) fn asks_for_closest(&self) -> bool {
        self.wants_hits && self.most == 1
    }

    /// The closest hits of the same rays.
    pub(crate) fn closest(&self) -> TraceJob<'a> {
        TraceJob { rays: self.rays, next_directions: None, extreme: self.extreme, any_hit: false, repeat: 1 }
    }
}

/// Bytes of a hit as callers take it.
const CALLERS_BYTES: usize = 16;

/// All hits of the rays of a batch.
#[derive(Debug, Clone, Default)]
pub struct AllHits {
    /// Where the hits of each ray begin among all, and after the last ray where they end.
    pub starts: Vec<usize>,
    /// Those of the first ray, the closest first, then those of the second, and so on; none where they are not wanted.
    /// t in units of |direction|, as in world space. What is farther than every float is not hit.
    pub hits: Vec<Hit>,
    /// With [`crate::options::TraceOptions::counters`] the work on each ray that counting its hits took.
    pub work: Option<Vec<RayWork>>,
    /// Seconds of device time that counting took, and listing: packets do both in the first.
    pub kernel_s: [f64; 2],
    /// Seconds that it took to sort the rays before their hits were counted; `None` where they were not.
    pub sort_s: Option<f64>,
    /// Seconds that it took to send the rays.
    pub upload_s: f64,
    /// Seconds that it took to fetch counts and hits.
    pub read_s: f64,
    /// Seconds that the host took for extreme rays; `None` where there were none.
    pub extreme_s: Option<f64>,
}

impl AllHits {
    /// Room for so many hits of each ray, if they are wanted, within a budget: without one what there is now.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`] when there is no memory for them.
    pub(crate) fn of_counts(counts: &[u32], wants_hits: bool, budget: Option<MemoryBudget>) -> Result<AllHits> {
        let mut starts = Vec::with_capacity(counts.len() + 1);
        let mut end = 0;
        starts.push(end);
        starts.extend(counts.iter().map(|&count| {
            end += count as usize;
            end
        }));
        if !wants_hits {
            return Ok(AllHits { starts, ..AllHits::default() });
        }
        let room = |need: &Need| try_repeat(Hit::NONE, end).map_err(|_| need.refused());
        let hits = AllHits::checked((end, counts.len()), budget, room)?;
        Ok(AllHits { starts, hits, ..AllHits::default() })
    }

    /// The closest hits of rays as lists.
    pub(crate) fn of_closest(found: TraceResult) -> AllHits {
        let TraceResult { mut hits, kernel_s, sort_s, upload_s, read_s, extreme_s, .. } = found;
        let mut end = 0;
        let ends = hits.iter().map(|hit| {
            end += usize::from(is_hit(hit));
            end
        });
        let starts = std::iter::once(0).chain(ends).collect();
        hits.retain(is_hit);
        AllHits {
            starts,
            hits,
            work: None,
            kernel_s: [0.0, kernel_s.iter().sum()],
            sort_s,
            upload_s,
            read_s,
            extreme_s,
        }
    }

    /// Makes room for more hits behind others, which are then those of so many rays.
    ///
    /// # Errors
    /// As [`AllHits::of_counts`].
    pub(crate) fn make_room(
        hits: &mut Vec<Hit>,
        (more, rays): (usize, usize),
        budget: Option<MemoryBudget>,
    ) -> Result<()> {
        let all = (hits.len() + more, rays);
        AllHits::checked(all, budget, |need| hits.try_reserve(more).map_err(|_| need.refused()))
    }

    /// Checks that there is memory for so many hits of so many rays.
    ///
    /// # Errors
    /// As [`AllHits::of_counts`].
    pub(crate) fn check_room(hits_of_rays: (usize, usize), budget: Option<MemoryBudget>) -> Result<()> {
        AllHits::checked(hits_of_rays, budget, |_| Ok(()))
    }

    fn checked<T>(
        (hits, rays): (usize, usize),
        budget: Option<MemoryBudget>,
        then: impl FnOnce(&Need) -> Result<T>,
    ) -> Result<T> {
        let what = format!("{hits} hits of {rays} rays");
        // As devices and callers have them, too.
        let bytes = (hits * (2 * size_of::<Hit>() + CALLERS_BYTES)) as u64;
        let remedy = "split the batch, ask for fewer hits of each ray, or raise the memory limit";
        let need = Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy };
        if bytes >= CHECKED_FROM_BYTES {
            budget.unwrap_or_else(MemoryBudget::available).check(&need)?;
        }
        then(&need)
    }

    /// How many hits a ray has.
    pub fn count(&self, ray: usize) -> usize {
        self.range(ray).len()
    }

    /// The hits of a ray, the closest first.
    pub fn of_ray(&self, ray: usize) -> &[Hit] {
        &self.hits[self.range(ray)]
    }

    /// Where they are among all.
    pub fn range(&self, ray: usize) -> Range<usize> {
        self.starts[ray]..self.starts[ray + 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_for_which_there_is_no_memory_are_refused_before_it_is_taken() {
        let budget = Some(MemoryBudget::of_bytes(1 << 40));
        AllHits::check_room((1000, 9), budget).unwrap();
        let refused = AllHits::check_room((1 << 40, 9), budget).unwrap_err();
        assert!(refused.to_string().contains("1099511627776 hits of 9 rays"), "{refused}");
        let refused = AllHits::of_counts(&[u32::MAX; 1000], true, budget).unwrap_err();
        assert!(refused.to_string().contains("4294967295000 hits of 1000 rays"), "{refused}");
        // Where only their number is asked for they need none.
        let counted = AllHits::of_counts(&[u32::MAX; 1000], false, budget).unwrap();
        assert!(counted.hits.is_empty() && counted.count(999) == u32::MAX as usize);
    }
}
