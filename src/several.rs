//! Work in numbered pieces by several devices at once: each takes pieces from one queue, as many as it is fast, until
//! there are none. Pieces are blocks of a picture or runs of a batch, whose bits do not depend on who does them.
//!
//! What a slow device has not finished when the queue is empty, a faster one does, too, and whichever is first counts:
//! so a slow device never holds the end up. Where a device fails, others do its pieces; where none is left, the last
//! resort, if there is one.

mod queue;

use crate::error::{Error, Result};
use crate::pack::SceneBuffers;
use crate::parallel;
use crate::tracer::{Backend, DeviceShare, Progress};
use queue::{Queue, State};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::thread::Scope;
use std::time::{Duration, Instant};

/// What opens a tracer of the scene; called by any thread.
type Open<'a> = Box<dyn FnOnce() -> Result<(Arc<SceneBuffers>, OpenTracer<'a>)> + Send + 'a>;

/// A tracer that is ready.
pub enum OpenTracer<'a> {
    /// It is released once the work is done.
    Own(Box<dyn Backend>),
    /// Its owner goes on with it.
    Lent(&'a mut (dyn Backend + 'static)),
}

impl OpenTracer<'_> {
    /// What traces.
    pub fn tracer(&mut self) -> &mut dyn Backend {
        match self {
            OpenTracer::Own(tracer) => tracer.as_mut(),
            OpenTracer::Lent(tracer) => *tracer,
        }
    }
}

/// One of several devices.
pub struct DeviceTracer<'a> {
    /// For messages.
    pub name: String,
    /// Whether it is this machine's processor, as the reference is, which other devices need, too. Its loops get
    /// threads of their own, for which nobody waits, and beside much faster devices it does little.
    pub is_processor: bool,
    /// Opens it.
    pub open: Open<'a>,
}

impl<'a> DeviceTracer<'a> {
    /// The same for a shorter time: the compiler does not see that what is opened may be needed for less than it lasts.
    fn within<'b>(self) -> DeviceTracer<'b>
    where
        'a: 'b,
    {
        let open = move || -> Result<(Arc<SceneBuffers>, OpenTracer<'b>)> { (self.open)() };
        DeviceTracer { name: self.name, is_processor: self.is_processor, open: Box::new(open) }
    }
}

/// Several devices, and what is left without them.
pub struct Devices<'a> {
    /// Those that share the work.
    pub devices: Vec<DeviceTracer<'a>>,
    /// Does what is left once all devices are lost, if that is wanted: the reference. Without it the work fails then,
    /// and it does in any case where no device was ready to begin.
    pub last_resort: Option<DeviceTracer<'a>>,
}

impl<'a> Devices<'a> {
    /// Has threads of `scope` open the devices now, while the caller does something else. Whatever fails is told where
    /// they are to work.
    #[must_use]
    pub fn opened_by<'scope>(self, scope: &'scope Scope<'scope, '_>) -> Devices<'scope>
    where
        'a: 'scope,
    {
        let ahead = |DeviceTracer { name, is_processor, open }: DeviceTracer<'a>| {
            let opening = scope.spawn(open);
            let open = move || opening.join().unwrap_or_else(|panic| resume_unwind(panic));
            DeviceTracer { name, is_processor, open: Box::new(open) }.within()
        };
        let last_resort = self.last_resort.map(DeviceTracer::within);
        Devices { devices: self.devices.into_iter().map(ahead).collect(), last_resort }
    }
}

/// Who goes on with the work of a device that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Takeover {
    /// The other devices.
    OtherDevices,
    /// The last resort: no other device is left.
    LastResort,
}

/// Who is told how the work of several devices goes, by their threads.
pub trait Watcher: Sync {
    /// So much of it is done, 0 to 1.
    fn progress(&self, done: f64);

    /// Whether the work is to end with [`Error::Stopped`]; asked between launches.
    fn is_over(&self) -> bool {
        false
    }

    /// A device failed, by its place among them and its name; others go on, unless this fails, too.
    ///
    /// # Errors
    /// What ends the work then.
    fn lost(&self, device: (usize, &str), error: Error, takeover: Takeover) -> Result<()>;
}

/// Hands on pieces that are finished, by calling what takes them, unless another device has finished some of them.
pub(crate) type HandOn<'a> = &'a mut dyn FnMut(&[usize], &mut dyn FnMut() -> Result<()>);

/// How much a device does together next, once something is known of it: it need not begin with little each time.
pub(crate) type Pace = Option<u64>;

/// Work in pieces.
pub(crate) trait Pieces: Sync {
    /// About how long a device may take for what it has at a time, where pieces are wanted in their order: others wait
    /// until then for those that come before.
    fn most_time(&self) -> Option<Duration> {
        None
    }

    /// Does some pieces, and hands them on as soon as they are finished. The pace is that of the last time.
    ///
    /// # Errors
    /// The device failed.
    fn work(
        &self,
        tracer: (&mut dyn Backend, &SceneBuffers),
        numbers_at_pace: (&[usize], &mut Pace),
        hand_on: HandOn,
        progress: Progress,
    ) -> Result<()>;
}

/// Has all devices do the pieces of `units`, which are not divided unless a device fails or is slow. Returns what each
/// did.
///
/// # Errors
/// The last device has failed, too; something failed that is none; and those of `watcher` and of whoever takes what is
/// finished.
pub(crate) fn share_out<'a>(
    Devices { devices, last_resort }: Devices<'a>,
    units: Vec<Vec<usize>>,
    pieces: &dyn Pieces,
    watcher: &dyn Watcher,
) -> Result<Vec<DeviceShare>> {
    let count = devices.len();
    let processors = devices.iter().map(|device| device.is_processor).collect();
    let queue = Queue::new((units, pieces.most_time()), processors, last_resort.is_some());
    let worker = |number: usize| Worker { queue: &queue, number, pieces, watcher };
    let mut shares: Vec<DeviceShare> = std::thread::scope(|scope| {
        let work = |(number, device): (usize, DeviceTracer<'a>)| {
            let worker = worker(number);
            scope.spawn(move || worker.run_when_needed(device, count > 1))
        };
        let threads: Vec<_> = devices.into_iter().enumerate().map(work).collect();
        threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    if let Some(last_resort) = last_resort
        && queue.begin_last_resort()
    {
        shares.push(worker(count).run(last_resort));
    }
    match queue.lock().failure.take() {
        Some(error) => Err(error),
        None => Ok(shares),
    }
}

/// Thrown through the work of a device whose pieces others have finished. [`Backend::stop_when`] would make all
/// launches short: nobody watches this work, and it is to be done soon.
struct Cancelled;

/// Ends the work of all devices where one of their threads panics: the others would wait for it for ever.
struct Ending<'a>(&'a Queue);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.fail(Error::Stopped);
        }
    }
}

/// The thread of a device.
struct Worker<'a> {
    queue: &'a Queue,
    number: usize,
    pieces: &'a dyn Pieces,
    watcher: &'a dyn Watcher,
}

impl Worker<'_> {
    /// Nothing is opened of a device that is not needed: nobody waits for its compiler.
    fn run_when_needed(&self, device: DeviceTracer, has_others: bool) -> DeviceShare {
        match self.queue.wait(self.number) {
            false => DeviceShare { name: device.name, pieces: 0, busy_s: 0.0 },
            true if device.is_processor && has_others => parallel::on_own_threads(|| self.run(device)),
            true => self.run(device),
        }
    }

    fn run(&self, DeviceTracer { name, open, .. }: DeviceTracer) -> DeviceShare {
        let _ending = Ending(self.queue);
        let mut share = DeviceShare { name, pieces: 0, busy_s: 0.0 };
        let ended = open().and_then(|(buffers, mut tracer)| {
            self.queue.lock().was_ready = true;
            let ended = self.work((tracer.tracer(), &buffers), &mut share);
            if ended.as_ref().is_err_and(Error::is_lost_device) {
                // A driver that failed may hang in the release of what is left.
                std::mem::forget(tracer);
            }
            ended
        });
        if let Err(error) = ended {
            self.queue.lose(self.number, &share.name, error, self.watcher);
        }
        share
    }

    /// Takes pieces until there are none, and counts those that nobody else has finished before.
    fn work(&self, (tracer, buffers): (&mut dyn Backend, &SceneBuffers), share: &mut DeviceShare) -> Result<()> {
        let mut pace = None;
        while let Some(job) = self.queue.take(self.number) {
            let (begun, before) = (Instant::now(), share.pieces);
            for numbers in job.pieces.chunks(job.together) {
                let some = || self.some((&mut *tracer, buffers), (numbers, &mut pace), &mut share.pieces);
                match catch_unwind(AssertUnwindSafe(some)) {
                    Ok(done) => done?,
                    Err(panic) if panic.is::<Cancelled>() => {}
                    Err(panic) => resume_unwind(panic),
                }
            }
            share.busy_s += begun.elapsed().as_secs_f64();
            self.queue.leave(self.number, share.pieces - before, begun.elapsed());
        }
        Ok(())
    }

    /// Does some pieces, and counts those that nobody else has finished before. Unwinds with [`Cancelled`] when there
    /// is nothing more to do.
    fn some(
        &self,
        tracer: (&mut dyn Backend, &SceneBuffers),
        (numbers, pace): (&[usize], &mut Pace),
        count: &mut usize,
    ) -> Result<()> {
        let left = |state: &State| numbers.iter().any(|number| !state.finished.contains(number));
        if !left(&self.queue.lock()) {
            return Ok(());
        }
        let progress = |_: f64| {
            if self.watcher.is_over() {
                self.queue.fail(Error::Stopped);
            }
            let state = self.queue.lock();
            if state.is_over() || !left(&state) {
                drop(state);
                resume_unwind(Box::new(Cancelled));
            }
        };
        let mut hand_on =
            |numbers: &[usize], take: &mut dyn FnMut() -> Result<()>| *count += self.finish(numbers, take);
        self.pieces.work(tracer, (numbers, pace), &mut hand_on, &progress)
    }

    /// Hands pieces on that are finished, all or none of them: what they took cannot be divided. Those of which another
    /// device has finished some are done by that one. Returns how many were handed on.
    fn finish(&self, numbers: &[usize], take: &mut dyn FnMut() -> Result<()>) -> usize {
        let mut state = self.queue.lock();
        if state.failure.is_some() || numbers.iter().any(|number| state.finished.contains(number)) {
            return 0;
        }
        state.finished.extend(numbers);
        let part = state.finished.len() as f64 / state.all as f64;
        drop(state);
        // Without the lock, for which the other devices' launches would wait.
        if let Err(error) = take() {
            self.queue.fail(error);
            resume_unwind(Box::new(Cancelled));
        }
        self.watcher.progress(part);
        self.queue.changed.notify_all();
        numbers.len()
    }
}
