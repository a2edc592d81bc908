//! Calls that Ctrl-C stops and that tell their progress, while other threads of Python go on.
//!
//! A thread of its own works, and the caller's thread looks after signals: on the scalar reference no thread of Python
//! takes part in the work at all. To stop, the function that the library tells of its progress unwinds: the library
//! calls it where no kernel runs. The tracer is thrown away then.

use crate::error::{to_python, warn};
use crate::process;
use pyo3::prelude::*;
use raybrook::Error;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often signals are looked after: no user notices that, and it takes no time.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What unwinds when a call is stopped.
pub struct Stopped;

/// Why a call has no result.
pub enum Failure {
    Library(Error),
    Stopped,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        Failure::Library(error)
    }
}

/// A call under way.
#[derive(Default)]
pub struct Call {
    is_stopped: AtomicBool,
    /// Bits of the f64: how much is done, where the part that is under way starts, and how much that part is.
    done: AtomicU64,
    start: AtomicU64,
    share: AtomicU64,
    /// What the caller is warned of at its end.
    notes: Mutex<Vec<String>>,
}

impl Call {
    /// From now on the part from `start` on is under way, which is `share` of the whole.
    pub fn begin_part(&self, start: f64, share: f64) {
        self.start.store(start.to_bits(), Ordering::Relaxed);
        self.share.store(share.to_bits(), Ordering::Relaxed);
        self.told(0.0);
    }

    /// Has the caller warned of something at the end of the call.
    pub fn note(&self, text: String) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    fn told(&self, done: f64) {
        let [start, share] = [&self.start, &self.share].map(|bits| f64::from_bits(bits.load(Ordering::Relaxed)));
        // A call may ask several things of the library, of which each tells its own progress. Bits of numbers that are
        // not negative are in the order of the numbers.
        self.done.fetch_max((start + done * share).to_bits(), Ordering::Relaxed);
        if self.is_stopped.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
    }

    fn done(&self) -> f64 {
        f64::from_bits(self.done.load(Ordering::Relaxed))
    }
}

/// The call that a tracer works on, which its function of progress tells.
#[derive(Clone, Default)]
pub struct Current(Arc<Mutex<Arc<Call>>>);

impl Current {
    pub fn set(&self, call: &Arc<Call>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = call.clone();
    }

    pub fn told(&self, done: f64) {
        // Nothing may be locked when it unwinds.
        let call = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        call.told(done);
    }
}

/// Has `work` done. `progress` is called with the part of it that is done, 0 to 1; what it raises stops the work.
///
/// # Errors
/// What the work, `progress` or a handler of a signal says, such as `KeyboardInterrupt`.
pub fn run<T: Send>(
    py: Python,
    progress: Option<&Bound<PyAny>>,
    work: impl FnOnce(&Arc<Call>) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    process::begin(py)?;
    let call = Arc::new(Call::default());
    let progress = progress.map(|progress| progress.clone().unbind());
    let mut refusal = None;
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let (end, ended) = channel::<()>();
            let worker = {
                let call = call.clone();
                scope.spawn(move || {
                    let _end = end; // closes the channel, whatever happens
                    work(&call)
                })
            };
            while refusal.is_none() && ended.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                let look = Python::attach(|py| look(py, progress.as_ref(), call.done()));
                refusal = look.err();
                call.is_stopped.store(refusal.is_some(), Ordering::Relaxed);
            }
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    match (result, refusal) {
        (_, Some(refusal)) => Err(refusal),
        (Ok(result), None) => {
            look(py, progress.as_ref(), 1.0)?;
            let notes = std::mem::take(&mut *call.notes.lock().unwrap_or_else(PoisonError::into_inner));
            notes.iter().try_for_each(|note| warn(py, note))?;
            Ok(result)
        }
        (Err(Failure::Library(error)), None) => Err(to_python(py, &error)),
        (Err(Failure::Stopped), None) => unreachable!("only a refusal stops"),
    }
}

/// Has handlers of signals run, and tells the progress.
fn look(py: Python, progress: Option<&Py<PyAny>>, done: f64) -> PyResult<()> {
    py.check_signals()?;
    progress.map_or(Ok(()), |progress| progress.call1(py, (done.min(1.0),)).map(drop))
}
