//! One picture by several devices at once: each takes blocks from one queue, as many as it is fast, until there are
//! none. The bits are those of one device.
//!
//! What a slow device has not finished when the queue is empty, a faster one renders, too, and whichever is first
//! counts: so a slow device never holds the end up. Where a device fails, others render its blocks.

use super::{Picture, PictureBlocks, render_blocks};
use crate::error::{Error, Result};
use crate::pack::SceneBuffers;
use crate::tracer::{Backend, DeviceShare, Finished};
use std::collections::{HashSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What opens a tracer of the scene; called in the thread that uses it.
type Open<'a> = Box<dyn FnOnce() -> Result<(Arc<SceneBuffers>, Box<dyn Backend>)> + Send + 'a>;

/// One of several devices.
pub struct Renderer<'a> {
    /// For messages.
    pub name: String,
    /// Opens it.
    pub open: Open<'a>,
}

/// Who is told of what several devices do, by their threads.
pub trait Watcher: Sync {
    /// Takes blocks that are finished, each once.
    ///
    /// # Errors
    /// Whatever keeps the picture from being finished.
    fn done(&self, finished: &Finished) -> Result<()>;

    /// So much of the picture is done, 0 to 1.
    fn progress(&self, done: f64);

    /// A device failed; others go on, unless this fails, too.
    ///
    /// # Errors
    /// What ends the picture then.
    fn lost(&self, name: &str, error: Error) -> Result<()>;
}

/// Renders the `wanted` blocks of a picture by all of `renderers`. Returns what each did.
///
/// # Errors
/// The last device has failed, too; and those of `watcher`.
pub fn render_by_several<'a>(
    renderers: Vec<Renderer<'a>>,
    picture: &Picture,
    blocks: &PictureBlocks,
    wanted: &[usize],
    watcher: &dyn Watcher,
) -> Result<Vec<DeviceShare>> {
    picture.samples.check(picture.size)?;
    let queue = Queue::new(blocks.units_of(wanted, renderers.len()), renderers.len());
    let shares = std::thread::scope(|scope| {
        let work = |(worker, renderer): (usize, Renderer<'a>)| {
            let queue = &queue;
            scope.spawn(move || Worker { queue, worker, picture, blocks, watcher }.run(renderer))
        };
        let threads: Vec<_> = renderers.into_iter().enumerate().map(work).collect();
        threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    match queue.lock().failure.take() {
        Some(error) => Err(error),
        None => Ok(shares),
    }
}

/// Blocks that a device is rendering.
struct Flight {
    blocks: Vec<usize>,
    /// Whether another device renders them, too.
    is_backed: bool,
}

/// What is left of a picture.
struct State {
    /// Blocks that nobody renders, in pieces that are not divided.
    units: VecDeque<Vec<usize>>,
    finished: HashSet<usize>,
    all: usize,
    flights: Vec<Option<Flight>>,
    /// Blocks a second of each device, where that is known, and how many it took last.
    rates: Vec<Option<f64>>,
    last: Vec<usize>,
    /// Devices that have not failed.
    alive: usize,
    failure: Option<Error>,
}

struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

/// What a device is to render next.
#[derive(Debug, PartialEq)]
struct Job {
    blocks: Vec<usize>,
    /// Whether another device is at it.
    is_backup: bool,
}

/// Thrown through the work of a device whose blocks others have finished. [`Backend::stop_when`] would make all launches
/// short: nobody watches this picture, and it is to be done soon.
struct Cancelled;

/// What a device takes at a time is about this part of what is left for it, so that all end together.
const PART_OF_REST: f64 = 0.5;
/// And no less than this takes, because small lists keep no device busy.
const LEAST_TIME: f64 = 0.25;
/// A device takes so many times as many blocks as before, as long as these take no more than all of the rest.
const GROWTH: usize = 4;
/// A device helps another that is slower by this factor.
const HELPS_FROM: f64 = 1.5;

impl Queue {
    fn new(units: Vec<Vec<usize>>, workers: usize) -> Queue {
        let state = State {
            all: units.iter().map(Vec::len).sum(),
            units: units.into(),
            finished: HashSet::new(),
            flights: (0..workers).map(|_| None).collect(),
            rates: vec![None; workers],
            last: vec![0; workers],
            alive: workers,
            failure: None,
        };
        Queue { state: Mutex::new(state), changed: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next blocks of a device; waits where there may be some later. None: the picture is done, or failed.
    fn take(&self, worker: usize) -> Option<Job> {
        let mut state = self.lock();
        loop {
            if state.is_over() {
                return None;
            }
            if let Some(job) = state.next(worker) {
                return Some(job);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A device has come to the end of what it took.
    fn leave(&self, worker: usize, blocks: usize, took: Duration) {
        let mut state = self.lock();
        state.flights[worker] = None;
        if blocks > 0 {
            state.last[worker] = blocks;
            state.rates[worker] = Some(blocks as f64 / took.as_secs_f64().max(1e-3));
        }
        self.changed.notify_all();
    }

    /// A device has failed: what it had is to be rendered by others, if there are any.
    fn lose(&self, worker: usize, name: &str, error: Error, watcher: &dyn Watcher) {
        let mut state = self.lock();
        state.alive -= 1;
        if let Some(flight) = state.flights[worker].take() {
            let left: Vec<usize> = flight.blocks.into_iter().filter(|block| !state.finished.contains(block)).collect();
            if !left.is_empty() {
                state.units.push_front(left);
            }
        }
        let ended = if state.alive == 0 { Err(error) } else { watcher.lost(name, error) };
        if let Err(error) = ended {
            state.failure.get_or_insert(error);
        }
        self.changed.notify_all();
    }
}

impl State {
    fn is_over(&self) -> bool {
        self.failure.is_some() || self.finished.len() >= self.all
    }

    fn next(&mut self, worker: usize) -> Option<Job> {
        if self.units.is_empty() {
            return self.backup(worker);
        }
        let mut blocks = self.units.pop_front()?;
        let wanted = self.wanted(worker);
        while let Some(unit) = self.units.front()
            && (blocks.len() + unit.len()) as f64 <= wanted
        {
            blocks.extend(unit);
            self.units.pop_front();
        }
        blocks.sort_unstable();
        self.flights[worker] = Some(Flight { blocks: blocks.clone(), is_backed: false });
        Some(Job { blocks, is_backup: false })
    }

    /// How many blocks a device is to take.
    fn wanted(&self, worker: usize) -> f64 {
        let Some(rate) = self.rates[worker] else { return 1.0 };
        let all: f64 = self.rates.iter().flatten().sum();
        let left: usize = self.units.iter().map(Vec::len).sum();
        let all_s = left as f64 / all;
        let fair = rate * (PART_OF_REST * all_s).max(LEAST_TIME);
        // Few blocks at a time keep no device busy, so that its rate is no measure: more of them show what it can do.
        let more = (GROWTH * self.last[worker]) as f64;
        if more <= rate * all_s { fair.max(more) } else { fair }
    }

    /// What a slower device has not finished, from its end on.
    fn backup(&mut self, worker: usize) -> Option<Job> {
        let own = self.rates[worker]?;
        let is_slower = |rate: Option<f64>| rate.is_none_or(|rate| HELPS_FROM * rate < own);
        let finished = &self.finished;
        let left = |flight: &Flight| -> Vec<usize> {
            flight.blocks.iter().rev().filter(|block| !finished.contains(block)).copied().collect()
        };
        let others = self.flights.iter_mut().zip(&self.rates).enumerate().filter(|(other, _)| *other != worker);
        let slower = others.filter(|(_, (_, rate))| is_slower(**rate)).filter_map(|(_, (flight, _))| flight.as_mut());
        let flight = slower.filter(|flight| !flight.is_backed).max_by_key(|flight| left(flight).len())?;
        let blocks = left(flight);
        if blocks.is_empty() {
            return None;
        }
        flight.is_backed = true;
        self.flights[worker] = Some(Flight { blocks: blocks.clone(), is_backed: true });
        Some(Job { blocks, is_backup: true })
    }
}

/// Ends the work of all devices where one of their threads panics: the others would wait for it for ever.
struct Ending<'a>(&'a Queue);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.lock().failure.get_or_insert(Error::Stopped);
            self.0.changed.notify_all();
        }
    }
}

/// The thread of a device.
struct Worker<'a> {
    queue: &'a Queue,
    worker: usize,
    picture: &'a Picture,
    blocks: &'a PictureBlocks,
    watcher: &'a dyn Watcher,
}

impl Worker<'_> {
    fn run(&self, Renderer { name, open }: Renderer) -> DeviceShare {
        let _ending = Ending(self.queue);
        let mut share = DeviceShare { name, blocks: 0, busy_s: 0.0 };
        let ended = open().and_then(|(buffers, mut tracer)| {
            let start = Instant::now();
            let ended = self.work((tracer.as_mut(), &buffers), &mut share.blocks);
            share.busy_s = start.elapsed().as_secs_f64();
            ended
        });
        if let Err(error) = ended {
            self.queue.lose(self.worker, &share.name, error, self.watcher);
        }
        share
    }

    /// Takes blocks until there are none, and counts those that nobody else has finished before.
    fn work(&self, (tracer, buffers): (&mut dyn Backend, &SceneBuffers), count: &mut usize) -> Result<()> {
        while let Some(job) = self.queue.take(self.worker) {
            let (begun, before) = (Instant::now(), *count);
            // What another is at is taken block by block, so that whoever is first finishes each.
            let piece = if job.is_backup { 1 } else { job.blocks.len() };
            for blocks in job.blocks.chunks(piece) {
                match catch_unwind(AssertUnwindSafe(|| self.render(tracer, buffers, blocks, count))) {
                    Ok(rendered) => rendered?,
                    Err(panic) if panic.is::<Cancelled>() => {}
                    Err(panic) => resume_unwind(panic),
                }
            }
            self.queue.leave(self.worker, *count - before, begun.elapsed());
        }
        Ok(())
    }

    /// Renders some blocks, and counts those that nobody else has finished before. Unwinds with [`Cancelled`] when
    /// there is nothing more to do.
    fn render(
        &self,
        tracer: &mut dyn Backend,
        buffers: &SceneBuffers,
        blocks: &[usize],
        count: &mut usize,
    ) -> Result<()> {
        let left = |state: &State| blocks.iter().any(|block| !state.finished.contains(block));
        if !left(&self.queue.lock()) {
            return Ok(());
        }
        let progress = |_: f64| {
            let state = self.queue.lock();
            if state.is_over() || !left(&state) {
                drop(state);
                resume_unwind(Box::new(Cancelled));
            }
        };
        let mut done = |finished: &Finished| {
            *count += self.finish(finished)?;
            Ok(())
        };
        render_blocks(tracer, buffers, self.picture, self.blocks, (blocks, None), &mut done, &progress).map(drop)
    }

    /// Hands blocks on that are finished, all or none of them: what they took cannot be divided. Those of which another
    /// device has finished some are rendered by that one. Returns how many were handed on.
    fn finish(&self, finished: &Finished) -> Result<usize> {
        let mut state = self.queue.lock();
        if state.failure.is_some() || finished.blocks.iter().any(|block| state.finished.contains(block)) {
            return Ok(0);
        }
        state.finished.extend(finished.blocks);
        let part = state.finished.len() as f64 / state.all as f64;
        drop(state);
        // Without the lock, for which the other devices' launches would wait.
        let done = self.watcher.done(finished);
        if let Err(error) = done {
            self.queue.lock().failure.get_or_insert(error);
            self.queue.changed.notify_all();
            resume_unwind(Box::new(Cancelled));
        }
        self.watcher.progress(part);
        self.queue.changed.notify_all();
        Ok(finished.blocks.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn queue(units: usize, workers: usize) -> Queue {
        Queue::new((0..units).map(|unit| vec![unit]).collect(), workers)
    }

    /// As if the device had finished these.
    fn finish(queue: &Queue, blocks: &[usize]) {
        queue.lock().finished.extend(blocks);
    }

    fn take(queue: &Queue, worker: usize) -> Vec<usize> {
        queue.take(worker).unwrap().blocks
    }

    struct Nobody;

    impl Watcher for Nobody {
        fn done(&self, _: &Finished) -> Result<()> {
            Ok(())
        }
        fn progress(&self, _: f64) {}
        fn lost(&self, _: &str, _: Error) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn devices_take_as_much_as_they_are_fast() {
        let queue = queue(1000, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]], "nobody knows yet");
        finish(&queue, &[0, 1]);
        queue.leave(0, 1, Duration::from_millis(10));
        queue.leave(1, 1, Duration::from_millis(40));
        let [fast, slow] = [take(&queue, 0).len(), take(&queue, 1).len()];
        assert!((395..=402).contains(&fast), "{fast}: four fifths of half of the rest");
        assert!((55..=65).contains(&slow), "{slow}: a fifth of half of what was left then");
    }

    #[test]
    fn a_fast_device_renders_what_a_slow_one_has_not_finished() {
        let queue = queue(6, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0]);
        queue.leave(0, 1, Duration::from_millis(1));
        assert_eq!(take(&queue, 0), [2, 3, 4, 5]);
        finish(&queue, &[2, 3, 4, 5]);
        queue.leave(0, 4, Duration::from_millis(4));
        assert_eq!(queue.take(0), Some(Job { blocks: vec![1], is_backup: true }));
        finish(&queue, &[1]);
        assert_eq!([queue.take(0), queue.take(1)], [None, None]);
    }

    #[test]
    fn what_a_lost_device_had_goes_to_another() {
        let queue = queue(3, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        queue.lose(0, "a", Error::NoDevice("gone".into()), &Nobody);
        finish(&queue, &[1]);
        queue.leave(1, 1, Duration::from_secs(10));
        assert_eq!(take(&queue, 1), [0]);
        queue.lose(1, "b", Error::NoDevice("gone, too".into()), &Nobody);
        assert!(queue.take(1).is_none());
        assert!(queue.lock().failure.as_ref().unwrap().to_string().contains("gone, too"));
    }
}
