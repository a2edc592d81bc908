//! Batches that stream through a GPU: while it has some rays, all cores take the hits of those before and make those
//! that come next, where the GPU reads and writes by itself.
//!
//! Bad at: rays that take long, beside which transfers are nothing.

use super::deferred::Deferred;
use super::entry::Entry;
use super::launch::LaunchPlan;
use super::passes::Passes;
use super::rows::Rows;
use super::scene::DeviceScene;
use super::staging::{ALIGNMENT, Staging};
use super::{Buffer, DeviceContext, Event, Kernel};
use crate::error::Result;
use crate::parallel;
use crate::shared::{Hit, TraceRay};
use crate::tracer::{Progress, RayStream, take_in_pieces};
use std::ops::Range;

/// Rays of a part at most.
const MOST_RAYS: usize = 1 << 18;
/// So many parts, if they are not too short for that: the first one is made, and the hits of the last one are taken,
/// while the device has nothing to do.
const PARTS: usize = 8;
/// Shorter parts leave a GPU idle.
const LEAST_RAYS: usize = 1 << 16;

/// Deferred rays of a part that are fetched with its hits; of more the others are fetched then.
const MOST_DEFERRED: usize = 1023;

/// Where in the pinned memory of a part its rays, its hits, and its deferred items are.
const RAYS_AT: usize = 0;
const HITS_AT: usize = RAYS_AT + MOST_RAYS * size_of::<TraceRay>();
const DEFERRED_AT: usize = HITS_AT + MOST_RAYS * size_of::<Hit>();
const PART_BYTES: usize = DEFERRED_AT + (1 + MOST_DEFERRED) * size_of::<u32>();
/// Of two parts, and a number that is zero.
const ZERO_AT: usize = 2 * PART_BYTES;
/// Pinned memory of a stream.
pub(super) const PINNED_BYTES: usize = ZERO_AT + ALIGNMENT;

/// Bytes of rays and hits that are transferred.
pub(super) fn transferred_bytes(rays: usize) -> usize {
    rays.saturating_mul(size_of::<TraceRay>() + size_of::<Hit>())
}

/// Whether so many rays fill enough parts for one to be under way while others are made and taken.
pub(super) fn is_worth_streaming(rays: usize) -> bool {
    rays >= 3 * LEAST_RAYS
}

/// What a tracer keeps from one stream to the next.
pub(super) struct StreamBuffers {
    /// The device's memory of the two parts that are under way.
    parts: [PartBuffers; 2],
    /// Of the part before.
    rows: Rows,
}

struct PartBuffers {
    rays: Buffer<TraceRay>,
    hits: Buffer<Hit>,
    deferred: Deferred,
    /// Whether rays of the last part here may have been deferred, and are counted still.
    has_deferred: bool,
}

impl StreamBuffers {
    pub fn new(context: &DeviceContext, defers: bool) -> Result<StreamBuffers> {
        let part = || {
            Ok(PartBuffers {
                rays: Buffer::empty(context, "rays", MOST_RAYS)?,
                hits: Buffer::empty(context, "hits", MOST_RAYS)?,
                deferred: Deferred::new(context, defers, MOST_RAYS)?,
                has_deferred: false,
            })
        };
        Ok(StreamBuffers { parts: [part()?, part()?], rows: Rows::default() })
    }
}

/// A part that the device has.
struct Flight {
    rays: Range<usize>,
    sent: Event,
    /// Its launch; where it took several, these are done, and have taken so many seconds.
    launched: Option<Event>,
    launches_s: f64,
    fetched: [Event; 2],
}

/// The parts that are under way. The device is done with their memory when it goes away.
struct UnderWay<'a> {
    context: &'a DeviceContext,
    flights: [Option<Flight>; 2],
}

impl Drop for UnderWay<'_> {
    fn drop(&mut self) {
        // Where something failed there may be commands that no flight has; after a failure of the driver's they are of
        // no use, and it may hang.
        if self.context.0.owner.failure().is_none() {
            let _ = self.context.finish();
        }
    }
}

/// What traces a stream.
pub(super) struct Streaming<'a> {
    pub context: &'a DeviceContext,
    pub scene: &'a DeviceScene,
    pub passes: &'a mut Passes,
    pub plan: &'a mut LaunchPlan,
    pub buffers: &'a mut StreamBuffers,
    pub pinned: &'a mut Staging,
    pub entry: Entry,
    pub work_group: usize,
}

impl Streaming<'_> {
    /// Traces all rays of a stream; seconds of device time.
    pub fn run(mut self, stream: &RayStream, progress: Progress) -> Result<f64> {
        let count = stream.count;
        let length = count.div_ceil(PARTS).clamp(LEAST_RAYS, MOST_RAYS).next_multiple_of(RayStream::PIECE);
        let mut under_way = UnderWay { context: self.context, flights: [const { None }; 2] };
        let mut kernel_s = 0.0;
        self.pinned.elements(ZERO_AT, 1).fill(0_u32);
        let parts = (0..count).step_by(length).map(|first| first..count.min(first + length));
        for (number, rays) in parts.enumerate() {
            let place = number % 2;
            kernel_s += self.land(place, stream, under_way.flights[place].take())?;
            let part_of = |ray: usize| ray as f64 / count as f64;
            progress(part_of(rays.start));
            let begun = self.begin(place, stream, rays, &|ray| progress(part_of(ray)))?;
            under_way.flights[place] = Some(begun);
        }
        let older = count.div_ceil(length) % 2;
        for place in [older, 1 - older] {
            kernel_s += self.land(place, stream, under_way.flights[place].take())?;
        }
        progress(1.0);
        Ok(kernel_s)
    }

    /// Makes rays, and gives them to the device.
    fn begin(
        &mut self,
        place: usize,
        stream: &RayStream,
        rays: Range<usize>,
        traced: &dyn Fn(usize),
    ) -> Result<Flight> {
        let (count, at) = (rays.len(), place * PART_BYTES);
        let StreamBuffers { parts, rows } = &mut *self.buffers;
        let part = &mut parts[place];
        let made: &mut [TraceRay] = self.pinned.elements(at + RAYS_AT, count);
        parallel::each(made.chunks_mut(RayStream::PIECE).enumerate(), |(piece, made)| {
            (stream.make)(rays.start + piece * RayStream::PIECE, made);
        });
        *rows = rows.find_after(made);
        // SAFETY: of this and all that follows: nobody touches this memory before the flight has landed, or, where
        // there is none because something failed, before `UnderWay` is gone; and it outlives both.
        let sent = unsafe { part.rays.begin_write(made) }?;
        if part.has_deferred {
            // SAFETY: as above.
            drop(unsafe { part.deferred.items.begin_write(self.pinned.elements(ZERO_AT, 1)) }?);
        }
        // Until the opposite is known: this part may never land.
        part.has_deferred = self.passes.defers();
        let set = |kernel: &mut Kernel| {
            let arguments = self.scene.geometry_arguments(kernel)?.set(&part.rays)?.set(&part.hits)?;
            arguments.set(&part.deferred.items)?.set_order(*rows, None).map(|_| ())
        };
        let (mut first, mut launches_s) = (rays.start, 0.0);
        let shape = (count, self.work_group);
        let launched =
            self.passes.begin_first(self.context, self.entry, &set, self.plan, shape, |items, launch_s| {
                // Little is known of how long such rays take, or they take long.
                (first, launches_s) = (first + items, launches_s + launch_s);
                traced(first);
            })?;
        let most = (1 + MOST_DEFERRED).min(part.deferred.items.len());
        // SAFETY: as above.
        let fetched = unsafe {
            let deferred = part.deferred.items.begin_read(0, self.pinned.elements(at + DEFERRED_AT, most))?;
            [deferred, part.hits.begin_read(0, self.pinned.elements(at + HITS_AT, count))?]
        };
        Ok(Flight { rays, sent, launched, launches_s, fetched })
    }

    /// Waits for a part, if there is one under way, and passes its hits on; its seconds of device time.
    fn land(&mut self, place: usize, stream: &RayStream, flight: Option<Flight>) -> Result<f64> {
        let Some(Flight { rays, sent, launched, launches_s, fetched }) = flight else { return Ok(0.0) };
        let (count, at) = (rays.len(), place * PART_BYTES);
        sent.wait()?;
        let mut kernel_s = launches_s;
        if let Some(launched) = launched {
            let launch_s = launched.wait()?;
            self.plan.learn(count, launch_s);
            kernel_s += launch_s;
        }
        fetched.iter().try_for_each(|fetched| fetched.wait().map(drop))?;
        if self.passes.defers() {
            self.defer(place, rays.clone(), stream)?;
        }
        let hits: &[Hit] = self.pinned.elements(at + HITS_AT, count);
        take_in_pieces(stream.take, rays.start, hits);
        Ok(kernel_s)
    }

    /// Passes those on that the first pass has deferred.
    fn defer(&mut self, place: usize, rays: Range<usize>, stream: &RayStream) -> Result<()> {
        let (at, part) = (place * PART_BYTES, &mut self.buffers.parts[place]);
        let fetched: &[u32] = self.pinned.elements(at + DEFERRED_AT, 1 + MOST_DEFERRED);
        let count = (fetched[0] as usize).min(rays.len());
        let mut items = fetched[1..=count.min(MOST_DEFERRED)].to_vec();
        if count > items.len() {
            items.resize(count, 0);
            part.deferred.items.read_into(1, &mut items)?;
        }
        part.has_deferred = count > 0;
        let made: &[TraceRay] = self.pinned.elements(at + RAYS_AT, rays.len());
        items.iter().for_each(|&item| (stream.defer)(rays.start + item as usize, &made[item as usize]));
        Ok(())
    }
}
