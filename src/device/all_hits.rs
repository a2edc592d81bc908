//! All hits of a batch on a device: packets list them in one traversal, part of the batch by part. Else it counts them,
//! and then lists them ray by ray, as many at a time as it has room for.

use super::batch::{DeviceOrder, Order};
use super::deferred::Deferred;
use super::entry::Entry;
use super::launch::LaunchPlan;
use super::passes::Passes;
use super::rows::Rows;
use super::scene::DeviceScene;
use super::{Buffer, DeviceContext, Kernel};
use crate::error::Result;
use crate::parallel;
use crate::reference::extreme::AllOfExtreme;
use crate::shared::{Hit, MOST_LISTED, NOT_LISTED, TraceRay};
use crate::tracer::{AllHits, AllHitsJob, Progress};
use crate::work::RayWork;
use std::cell::Cell;
use std::ops::Range;
use std::time::Instant;

/// Hits that the device has room for at a time, but for those of one ray: 64 MiB.
const HITS_AT_A_TIME: usize = 1 << 22;

/// Rays whose hits packets list at a time: they have room for 64 of each, in the mean. Random rays through rooms of up
/// to a million triangles have 8, those through vertices of voxels 20 to 68.
const RAYS_AT_A_TIME: usize = HITS_AT_A_TIME / 64;

/// So many rays are listed at a time at least: there is room for all hits that packets list of them.
const LEAST_RAYS_AT_A_TIME: usize = 1 << 12;

/// Rays whose hits a thread takes from the device at a time.
const RAYS_TAKEN: usize = 1 << 12;

/// What lists hits: a device, the kernels, and how many rays a launch may have.
pub(super) struct Lister<'a> {
    pub context: &'a DeviceContext,
    pub scene: &'a DeviceScene,
    pub passes: &'a mut Passes,
    pub plan: LaunchPlan,
    pub work_group: usize,
    /// Nothing is deferred.
    pub deferred: Deferred,
}

impl Lister<'_> {
    /// Counts the hits of a job by `entry`, and lists them ray by ray where they are wanted.
    pub fn count_and_list(
        &mut self,
        (job, entry): (&AllHitsJob, Entry),
        order: &Order,
        (extreme, work): (&AllOfExtreme, &Option<Buffer<RayWork>>),
        progress: Progress,
    ) -> Result<AllHits> {
        let sorted = if entry == Entry::CountHitsPackets { order.of_counts(job.rays)? } else { None };
        let start = Instant::now();
        let rays = Buffer::from_slice(self.context, "rays", job.rays)?;
        self.context.finish()?;
        let upload_s = start.elapsed().as_secs_f64();
        let counts = Buffer::<u32>::empty(self.context, "numbers of hits", job.rays.len())?;
        let order = DeviceOrder::new(self.context, sorted.as_ref(), || Rows::find(job.rays))?;
        let passes = if job.wants_hits { 2.0 } else { 1.0 };
        let mut done = 0;
        let count_s = self.run(
            entry,
            job.rays.len(),
            |scene, kernel| {
                let arguments = scene.geometry_arguments(kernel)?.set(&rays)?.set(&counts)?.set_work(work)?;
                order.set(arguments)?.set(job.most).map(|_| ())
            },
            |rays| {
                done += rays;
                progress(part_of(done, job.rays.len()) / passes);
            },
        )?;
        let mut counts = counts.read()?;
        extreme.count_in(&mut counts);
        let mut result = AllHits { upload_s, ..AllHits::of_counts(&counts, job.wants_hits, job.budget)? };
        let list_s = match job.wants_hits {
            true => self.list(&rays, &mut result, &|done| progress(0.5 + 0.5 * done))?,
            false => 0.0,
        };
        result.kernel_s = [count_s, list_s];
        result.sort_s = sorted.map(|sorted| sorted.sort_s);
        Ok(result)
    }

    /// Counts and lists the hits of a job in packets; then, ray by ray, lists those that packets have only counted.
    pub fn list_in_packets(
        &mut self,
        job: &AllHitsJob,
        order: &Order,
        extreme: &AllOfExtreme,
        progress: Progress,
    ) -> Result<AllHits> {
        let parts = PacketLists::new(self.context, job.rays.len())?;
        let mut result = AllHits::default();
        let mut counts = vec![0; job.rays.len()];
        let (mut hits, mut left) = (Vec::new(), Vec::new());
        let (mut first, mut length, farthest) = (0, parts.length(), Cell::new(0));
        while first < job.rays.len() {
            let part = first..job.rays.len().min(first + length);
            let of_part = |rays: usize| {
                farthest.set(farthest.get().max(first + rays));
                progress(0.5 * part_of(farthest.get(), job.rays.len()));
            };
            let wanted = parts.run(self, &job.rays[part.clone()], job.most, order, (&mut result, &of_part))?;
            if let Some(shorter) = parts.shorter(part.len(), wanted) {
                length = shorter;
                continue;
            }
            if wanted < parts.room() / 2 {
                length = parts.length().min(2 * length);
            }
            first = part.end;
            let start = Instant::now();
            parts.take(job, part, extreme, (&mut counts, &mut hits, &mut left))?;
            result.read_s += start.elapsed().as_secs_f64();
        }
        let AllHits { upload_s, kernel_s, read_s, sort_s, .. } = result;
        let starts = AllHits::of_counts(&counts, false, job.budget)?.starts;
        let mut result = AllHits { starts, hits, upload_s, kernel_s, read_s, sort_s, ..AllHits::default() };
        self.list_left(job, &left, &mut result, &|done| progress(0.5 + 0.5 * done))?;
        progress(1.0);
        Ok(result)
    }

    /// Lists the hits of those rays, ray by ray, into their places.
    fn list_left(&mut self, job: &AllHitsJob, left: &[usize], result: &mut AllHits, progress: Progress) -> Result<()> {
        if left.is_empty() {
            return Ok(());
        }
        let rays: Vec<TraceRay> = left.iter().map(|&ray| job.rays[ray]).collect();
        let counts: Vec<u32> = left.iter().map(|&ray| result.count(ray) as u32).collect();
        let rays = Buffer::from_slice(self.context, "rays", &rays)?;
        let mut listed = AllHits::of_counts(&counts, true, job.budget)?;
        result.kernel_s[1] += self.list(&rays, &mut listed, progress)?;
        result.read_s += listed.read_s;
        for (place, &ray) in left.iter().enumerate() {
            let range = result.range(ray);
            result.hits[range].copy_from_slice(listed.of_ray(place));
        }
        Ok(())
    }

    /// Writes the hits of `rays`, which are counted, into their places. Returns seconds of device time.
    fn list(&mut self, rays: &Buffer<TraceRay>, result: &mut AllHits, progress: Progress) -> Result<f64> {
        let mut kernel_s = 0.0;
        let total = result.starts.len() - 1;
        let mut first = 0;
        while first < total {
            let part = part_from(&result.starts, first);
            let places = result.starts[part.start]..result.starts[part.end];
            if !places.is_empty() {
                let starts: Vec<u32> =
                    result.starts[part.start..=part.end].iter().map(|start| (start - places.start) as u32).collect();
                let hits = Buffer::<Hit>::empty(self.context, "hits", places.len())?;
                let starts = Buffer::from_slice(self.context, "starts of hits", &starts)?;
                kernel_s += self.run(
                    Entry::ListHits,
                    part.len(),
                    |scene, kernel| {
                        let arguments = scene.geometry_arguments(kernel)?.set(rays)?.set(&starts)?.set(&hits)?;
                        arguments.set(part.start as u32).map(|_| ())
                    },
                    |_| (),
                )?;
                let start = Instant::now();
                hits.read_into(0, &mut result.hits[places])?;
                result.read_s += start.elapsed().as_secs_f64();
            }
            first = part.end;
            progress(part_of(first, total));
        }
        Ok(kernel_s)
    }

    /// Runs a kernel over so many rays; `set` sets its arguments but the last two. Returns seconds of device time.
    fn run(
        &mut self,
        entry: Entry,
        rays: usize,
        set: impl Fn(&DeviceScene, &mut Kernel) -> Result<()>,
        progress: impl FnMut(usize),
    ) -> Result<f64> {
        let Lister { context, scene, passes, plan, work_group, deferred } = self;
        let set = |kernel: &mut Kernel| set(scene, kernel);
        passes.run(context, entry, &set, plan, (0..rays, *work_group), (deferred, None), progress)
    }
}

/// The memory in which packets list the hits of a part of a batch.
struct PacketLists {
    rays: Buffer<TraceRay>,
    counts: Buffer<u32>,
    starts: Buffer<u32>,
    hits: Buffer<Hit>,
    /// How many of `hits` are taken, or more.
    used: Buffer<u32>,
}

impl PacketLists {
    /// Room for the parts of a batch of so many rays.
    fn new(context: &DeviceContext, rays: usize) -> Result<PacketLists> {
        let rays = rays.clamp(1, RAYS_AT_A_TIME);
        let room = HITS_AT_A_TIME / RAYS_AT_A_TIME * rays;
        let least_room = MOST_LISTED as usize * rays.min(LEAST_RAYS_AT_A_TIME);
        Ok(PacketLists {
            rays: Buffer::empty(context, "rays", rays)?,
            counts: Buffer::empty(context, "numbers of hits", rays)?,
            starts: Buffer::empty(context, "starts of hits", rays)?,
            hits: Buffer::empty(context, "hits", room.max(least_room))?,
            used: Buffer::empty(context, "places of hits", 1)?,
        })
    }

    /// Rays of a part.
    fn length(&self) -> usize {
        self.rays.len()
    }

    /// Hits of a part for which there is room.
    fn room(&self) -> usize {
        self.hits.len()
    }

    /// How many rays to list in place of so many, for whose hits `wanted` places were not enough room; `None` where
    /// they were. One by one, rays of which there is no room for the hits would take several times as long. Whole
    /// items: packets do not answer a few rays at the end of a part.
    fn shorter(&self, rays: usize, wanted: usize) -> Option<usize> {
        let leasts = || 7 * (rays / 8) * self.room() / wanted / LEAST_RAYS_AT_A_TIME;
        (wanted > self.room() && rays > LEAST_RAYS_AT_A_TIME).then(|| LEAST_RAYS_AT_A_TIME * leasts().max(1))
    }

    /// Lists up to `most` hits of each of the rays of a part, in an order of their own. Returns for how many there was
    /// to be room: where that is more than there is, some rays are only counted. What it takes is added to `spent`;
    /// `progress` is told how many rays are done.
    fn run(
        &self,
        lister: &mut Lister,
        rays: &[TraceRay],
        most: u32,
        order: &Order,
        (spent, progress): (&mut AllHits, &dyn Fn(usize)),
    ) -> Result<usize> {
        let sorted = order.of_counts(rays)?;
        if let Some(sorted) = &sorted {
            *spent.sort_s.get_or_insert(0.0) += sorted.sort_s;
        }
        let start = Instant::now();
        self.rays.write(rays)?;
        self.used.write(&[0])?;
        let order = DeviceOrder::new(lister.context, sorted.as_ref(), || Rows::find(rays))?;
        spent.upload_s += start.elapsed().as_secs_f64();
        // Of rays with more hits than packets list, which are listed one by one, it does not matter how many more.
        let most = most.max(MOST_LISTED + 1);
        let mut done = 0;
        spent.kernel_s[0] += lister.run(
            Entry::ListHitsPackets,
            rays.len(),
            |scene, kernel| {
                let arguments = scene.geometry_arguments(kernel)?.set(&self.rays)?.set(&self.counts)?;
                let arguments = arguments.set(&self.starts)?.set(&self.hits)?.set(&self.used)?;
                order.set(arguments)?.set(most)?.set(self.hits.len() as u32).map(|_| ())
            },
            |rays| {
                done += rays;
                progress(done);
            },
        )?;
        let mut used = [0];
        self.used.read_into(0, &mut used)?;
        Ok(used[0] as usize)
    }

    /// Takes the answers of `part`: how many hits its rays have, behind all others the hits, and the rays whose hits
    /// are not listed.
    fn take(
        &self,
        job: &AllHitsJob,
        part: Range<usize>,
        extreme: &AllOfExtreme,
        (counts, hits, left): (&mut [u32], &mut Vec<Hit>, &mut Vec<usize>),
    ) -> Result<()> {
        self.counts.read_into(0, &mut counts[part.clone()])?;
        extreme.count_in(counts);
        let counts = &mut counts[part.clone()];
        counts.iter_mut().for_each(|count| *count = job.most.min(*count));
        let counts = &*counts;
        let total = counts.iter().map(|&count| count as usize).sum();
        AllHits::make_room(hits, (total, part.end), job.budget)?;
        let mut starts = vec![0; part.len()];
        self.starts.read_into(0, &mut starts)?;
        for ray in extreme.rays().filter(|ray| part.contains(ray)) {
            starts[ray - part.start] = NOT_LISTED;
        }
        let lengths: Vec<usize> =
            counts.chunks(RAYS_TAKEN).map(|counts| counts.iter().map(|&count| count as usize).sum()).collect();
        self.hits.in_place(self.hits.len(), |listed| {
            parallel::extend_by_pieces(hits, &lengths, |number, piece| {
                let rays = number * RAYS_TAKEN..counts.len().min((number + 1) * RAYS_TAKEN);
                for (&count, &start) in counts[rays.clone()].iter().zip(&starts[rays]) {
                    match start {
                        NOT_LISTED => piece.put(std::iter::repeat_n(Hit::NONE, count as usize)),
                        _ => piece.put(listed[start as usize..][..count as usize].iter().copied()),
                    }
                }
            });
        })?;
        let is_left = |(&count, &start): (&u32, &u32)| count > 0 && start == NOT_LISTED;
        left.extend(part.zip(counts.iter().zip(&starts)).filter(|(_, of_ray)| is_left(*of_ray)).map(|(ray, _)| ray));
        Ok(())
    }
}

/// Which part of all `done` of them are.
fn part_of(done: usize, all: usize) -> f64 {
    (done as f64 / all.max(1) as f64).min(1.0)
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
