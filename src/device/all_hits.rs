//! All hits of a batch on a device: it counts them, and then lists them, part of the batch by part.

use super::batch::DeviceOrder;
use super::deferred::Deferred;
use super::entry::Entry;
use super::launch::LaunchPlan;
use super::passes::Passes;
use super::rows::Rows;
use super::scene::DeviceScene;
use super::{Buffer, DeviceContext, Kernel};
use crate::error::Result;
use crate::ray_order::Sorted;
use crate::shared::{Hit, TraceRay};
use crate::tracer::{AllHits, AllHitsJob, Progress};
use crate::work::RayWork;
use std::ops::Range;
use std::time::Instant;

/// Hits that the device has room for at a time, but for those of one ray: 64 MiB.
const HITS_AT_A_TIME: usize = 1 << 22;

/// What lists hits: a device, the kernels, and how many rays a launch may have.
pub(super) struct Lister<'a> {
    pub context: &'a DeviceContext,
    pub scene: &'a DeviceScene,
    pub passes: &'a mut Passes,
    pub plan: LaunchPlan,
    pub work_group: usize,
    /// The whole batch, on the device.
    pub rays: Buffer<TraceRay>,
    /// Nothing is deferred.
    pub deferred: Deferred,
}

impl Lister<'_> {
    /// How many hits each ray has, counted by `entry` in that order, if it is not the rays' own; the work that it took
    /// where that is counted; and seconds of device time.
    pub fn count(
        &mut self,
        job: &AllHitsJob,
        (entry, sorted): (Entry, Option<&Sorted>),
        work: &Option<Buffer<RayWork>>,
        progress: impl FnMut(usize),
    ) -> Result<(Vec<u32>, f64)> {
        let counts = Buffer::<u32>::empty(self.context, "numbers of hits", job.rays.len())?;
        let order = DeviceOrder::new(self.context, sorted, || Rows::find(job.rays))?;
        let (scene, rays) = (self.scene, &self.rays);
        let set = |kernel: &mut Kernel| {
            let arguments = scene.geometry_arguments(kernel)?.set(rays)?.set(&counts)?.set_work(work)?;
            order.set(arguments)?.set(job.most).map(|_| ())
        };
        let shape = (0..job.rays.len(), self.work_group);
        let Lister { context, passes, plan, deferred, .. } = self;
        let seconds = passes.run(context, entry, &set, plan, shape, deferred, progress)?;
        Ok((counts.read()?, seconds))
    }

    /// Writes the hits into their places. Returns seconds of device time, and of reading back.
    pub fn list(&mut self, result: &mut AllHits, progress: Progress) -> Result<[f64; 2]> {
        let mut seconds = [0.0; 2];
        let total = result.starts.len() - 1;
        let mut first = 0;
        while first < total {
            let part = part_from(&result.starts, first);
            let places = result.starts[part.start]..result.starts[part.end];
            if !places.is_empty() {
                let starts: Vec<u32> =
                    result.starts[part.start..=part.end].iter().map(|start| (start - places.start) as u32).collect();
                let hits = Buffer::<Hit>::empty(self.context, "hits", places.len())?;
                seconds[0] += self.list_part(part.clone(), &starts, &hits)?;
                let start = Instant::now();
                hits.read_into(0, &mut result.hits[places])?;
                seconds[1] += start.elapsed().as_secs_f64();
            }
            first = part.end;
            progress(0.5 + 0.5 * first as f64 / total as f64);
        }
        Ok(seconds)
    }

    fn list_part(&mut self, part: Range<usize>, starts: &[u32], hits: &Buffer<Hit>) -> Result<f64> {
        let starts = Buffer::from_slice(self.context, "starts of hits", starts)?;
        let (scene, rays) = (self.scene, &self.rays);
        let set = |kernel: &mut Kernel| {
            let arguments = scene.geometry_arguments(kernel)?.set(rays)?.set(&starts)?.set(hits)?;
            arguments.set(part.start as u32).map(|_| ())
        };
        let shape = (0..part.len(), self.work_group);
        let Lister { context, passes, plan, deferred, .. } = self;
        passes.run(context, Entry::ListHits, &set, plan, shape, deferred, |_| ())
    }
}

/// The rays from `first` on whose hits are listed together.
fn part_from(starts: &[usize], first: usize) -> Range<usize> {
    let room = starts[first] + HITS_AT_A_TIME;
    let end = starts.partition_point(|&start| start <= room).saturating_sub(1);
    first..end.max(first + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_room_unless_they_are_one_ray() {
        let counts = [3, 0, HITS_AT_A_TIME, HITS_AT_A_TIME - 1, 1, 1, HITS_AT_A_TIME + 5, 0, 2];
        let mut starts = vec![0];
        starts.extend(counts.iter().scan(0, |end, count| {
            *end += count;
            Some(*end)
        }));
        let mut parts = Vec::new();
        while parts.last().map_or(0, |part: &Range<usize>| part.end) < counts.len() {
            parts.push(part_from(&starts, parts.last().map_or(0, |part: &Range<usize>| part.end)));
        }
        assert_eq!(parts, [0..2, 2..3, 3..5, 5..6, 6..7, 7..9]);
    }
}
