//! Large batches, which are traced in runs, and pictures that the devices of a tracer share, with the bits of one
//! device.

use super::tracer::{Share, Tracer, WHOLE, in_share};
use crate::crossings::{OfPoints, QUESTIONS, are_odd, contains_by, require_exact, trace_crossings};
use crate::device::DeviceKind;
use crate::error::Result;
use crate::parallel::{self, lock, rays_in_caches, unlocked};
use crate::reference::extreme::WorldRay;
use crate::renderer::{Picture, PictureBlocks, render_by_several};
use crate::runs::{Asked, BatchJob, RUN_RAYS, RaysOnDemand, RunRays, Runs, TracedRuns, trace_by_several, trace_runs};
use crate::shared::Hit;
use crate::streamed::{OfHit, trace_streamed};
use crate::tracer::{AllHits, Finished, RayStream, RenderResult, Spent};
use std::sync::Mutex;

/// The rays of a batch.
type RayOf<'a> = &'a (dyn Fn(usize) -> WorldRay + Sync);

impl Tracer {
    /// Whether a batch of so many rays is traced in runs, so that several devices share it, and a processor's cores go
    /// over the same memory again and again, if it does not stream. Hits that are not exact may depend on which rays
    /// share a packet; those of a batch are traced together.
    pub(super) fn goes_in_runs(&self, rays: usize) -> bool {
        let gains = self.team.is_several() || self.is_on_processor();
        gains && rays > self.run_length() && self.team.opening().options.has_independent_hits()
    }

    fn is_on_processor(&self) -> bool {
        DeviceKind::is_processor(self.device_kind())
    }

    /// How many rays a run has.
    pub(super) fn run_length(&self) -> usize {
        if self.is_on_processor() { rays_in_caches() } else { RUN_RAYS }
    }

    /// What is wanted of one hit of each of `count` rays.
    pub(super) fn hits<T: OfHit>(
        &mut self,
        count: usize,
        ray: impl Fn(usize) -> WorldRay + Sync,
        (asked, share): (Asked, Share),
    ) -> Result<Vec<T>> {
        let goes_in_runs = self.goes_in_runs(count);
        if goes_in_runs && self.team.is_several() {
            return self.hits_in_runs(count, &ray, (asked, share));
        }
        let (any_hit, buffers, mut batch) = (asked == Asked::Any, self.buffers.clone(), None);
        let found = self.timed(self.depth, |backend, progress| {
            let progress = in_share(progress, share);
            let streamed = trace_streamed((&mut *backend, &buffers), (count, &ray), any_hit, &progress)?;
            if streamed.is_some() || goes_in_runs {
                return Ok(streamed);
            }
            let batch = batch.get_or_insert_with(|| buffers.batch(count, &ray, None));
            backend.trace(&batch.job(any_hit, 1), &progress).map(|traced| Some(T::of_all(traced.hits)))
        })?;
        found.map_or_else(|| self.hits_in_runs(count, &ray, (asked, share)), Ok)
    }

    fn hits_in_runs<T: OfHit>(&mut self, count: usize, ray: RayOf, asked: (Asked, Share)) -> Result<Vec<T>> {
        let (traced, all) = parallel::filled((count, RayStream::PIECE), |room| {
            let take = |first: usize, hits: &[Hit]| room.put(first, hits.iter().map(T::of));
            self.trace_in_runs(count, &RaysOnDemand::taken_by(ray, &take), asked, &|_| Ok(()))
        });
        traced?;
        Ok(all.expect("all runs were traced"))
    }

    /// How many hits each of `count` rays has, and, if they are asked for, which.
    pub(super) fn all_hits_in_runs(&mut self, count: usize, ray: RayOf, asked: Asked) -> Result<AllHits> {
        let (found, budget) = (Mutex::new((0, Vec::new())), self.chosen.limit);
        self.trace_in_runs(count, &RaysOnDemand::new(ray), (asked, WHOLE), &|traced| {
            let (hits, answers) = &mut *lock(&found);
            *hits += traced.answers.hits.len();
            answers.push((traced.runs.start, traced.answers));
            AllHits::check_room((*hits, count), budget)
        })?;
        let (_, mut found) = unlocked(found);
        found.sort_unstable_by_key(|(run, _)| *run);
        let counts: Vec<u32> = found.iter().flat_map(|(_, answers)| &answers.counts).copied().collect();
        let mut all = AllHits::of_counts(&counts, asked.lists_hits(), budget)?;
        let mut room = &mut all.hits[..];
        for (_, answers) in found {
            let (now, later) = room.split_at_mut(answers.hits.len());
            now.copy_from_slice(&answers.hits);
            room = later;
        }
        Ok(all)
    }

    /// How often each of `count` rays crosses a surface.
    pub(super) fn crossings(&mut self, count: usize, ray: RayOf, share: Share) -> Result<Vec<u32>> {
        require_exact(self.team.opening().options.intersector)?;
        if !self.goes_in_runs(count) {
            let (buffers, budget) = (self.buffers.clone(), self.chosen.limit);
            return self.timed(self.depth, |backend, progress| {
                trace_crossings(backend, &buffers, count, ray, budget, &in_share(progress, share))
            });
        }
        let length = self.run_length();
        let (traced, all) = parallel::filled((count, length), |room| {
            self.trace_in_runs(count, &RaysOnDemand::new(ray), (Asked::Crossings, share), &|traced| {
                room.put(traced.runs.start * length, traced.answers.counts.iter().copied());
                Ok(())
            })
        });
        traced?;
        Ok(all.expect("all runs were traced"))
    }

    /// Whether each point is inside of the scene, which is closed, or on its surface.
    pub(super) fn are_inside(&mut self, points: &[[f32; 3]], share: Share) -> Result<Vec<bool>> {
        let (count, step) = (points.len(), (share.1 - share.0) / QUESTIONS as f64);
        let mut from = share.0;
        contains_by(points, |asked, ray| {
            let now = (from, from + step);
            from = now.1;
            match asked {
                OfPoints::IsHit => self.hits(count, ray, (Asked::Any, now)),
                OfPoints::IsOdd => self.crossings(count, ray, now).map(are_odd),
            }
        })
    }

    fn trace_in_runs(
        &mut self,
        count: usize,
        rays: &RaysOnDemand,
        (asked, share): (Asked, Share),
        take: &(dyn Fn(TracedRuns) -> Result<()> + Sync),
    ) -> Result<()> {
        let (runs, buffers) = (Runs::of_length(count, self.run_length()), self.buffers.clone());
        let job = BatchJob { given: rays, rays: RunRays::OnDemand(rays), asked, budget: self.chosen.budget() };
        let all: Vec<usize> = (0..runs.count()).collect();
        match self.team.is_several() {
            true => self.timed_together((self.depth, share), |devices, watcher| {
                trace_by_several(devices, &job, (runs, &all), take, watcher).map(drop)
            }),
            false => self.timed(self.depth, |backend, progress| {
                let progress = in_share(progress, share);
                trace_runs((backend, &buffers), &job, (runs, &all), &mut |traced| take(traced), &progress)
            }),
        }
    }

    /// Some blocks of a picture; `take` is told of them.
    pub(super) fn render_together(
        &mut self,
        (picture, blocks): (&Picture, &PictureBlocks),
        wanted: &[usize],
        take: &(dyn Fn(&Finished) -> Result<()> + Sync),
    ) -> Result<()> {
        self.timed_together((picture.depth, WHOLE), |devices, watcher| {
            render_by_several(devices, picture, (blocks, wanted), take, watcher).map(drop)
        })
    }

    /// All of a picture, or of a part of it.
    pub(super) fn film_together(&mut self, picture: &Picture, blocks: &PictureBlocks) -> Result<RenderResult> {
        let (film, all_spent) = (Mutex::new(blocks.empty_film()), Mutex::new(Spent::default()));
        self.render_together((picture, blocks), &blocks.numbers(), &|finished| {
            lock(&all_spent).add(&finished.spent);
            blocks.copy(finished, &mut lock(&film))
        })?;
        let counts = unlocked(all_spent).counts;
        Ok(RenderResult { counts, ..RenderResult::of_film(unlocked(film)) })
    }
}
