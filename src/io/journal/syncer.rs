//! Has the disk take what is appended to a journal soon afterwards, also where nothing more is appended.
//!
//! A thread sleeps until something is appended, gathers what else comes within [`GATHERED`], and calls for the disk.
//! Where the disk takes long, whoever appends waits, so that never more than what was appended within [`LOST_AT_MOST`]
//! is at stake.

use std::fmt;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Work of this time is lost at the most where the machine fails.
const LOST_AT_MOST: Duration = Duration::from_secs(1);

/// So long what is appended waits for more. The other half of the time is the disk's: a call takes it milliseconds.
const GATHERED: Duration = Duration::from_millis(500);

/// The thread, and what it has to know.
pub struct Syncer {
    shared: Arc<Shared>,
    /// Since the first append.
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    /// Has the disk take what is there.
    sync: Box<dyn Fn() -> io::Result<()> + Send + Sync>,
    gathered: Duration,
    lost_at_most: Duration,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// When the first of what nobody has called for the disk to take was appended.
    waiting: Option<Instant>,
    /// The same of what the disk is taking.
    syncing: Option<Instant>,
    /// Why the disk has not taken something that was appended.
    error: Option<io::Error>,
    is_ended: bool,
}

impl Syncer {
    /// One that calls `sync`.
    pub fn new(sync: impl Fn() -> io::Result<()> + Send + Sync + 'static) -> Syncer {
        Syncer::with_times(sync, GATHERED, LOST_AT_MOST)
    }

    pub(super) fn with_times(
        sync: impl Fn() -> io::Result<()> + Send + Sync + 'static,
        gathered: Duration,
        lost_at_most: Duration,
    ) -> Syncer {
        let (state, changed) = (Mutex::default(), Condvar::new());
        let shared = Arc::new(Shared { sync: Box::new(sync), gathered, lost_at_most, state, changed });
        Syncer { shared, thread: None }
    }

    /// To be called before something is appended: waits while too much is at stake.
    ///
    /// # Errors
    /// The disk has not taken something that was appended before; or there can be no thread.
    pub fn before_append(&mut self) -> io::Result<()> {
        if self.thread.is_none() {
            let shared = self.shared.clone();
            let thread = std::thread::Builder::new().name("journal".to_owned());
            self.thread = Some(thread.spawn(move || shared.run())?);
        }
        let is_too_much = |state: &mut State| {
            let first = state.syncing.or(state.waiting);
            first.is_some_and(|first| first.elapsed() >= self.shared.lost_at_most)
        };
        let mut state = self.shared.wait_while(self.shared.lock(), is_too_much);
        state.error.take().map_or(Ok(()), Err)
    }

    /// To be called when something was appended.
    pub fn appended(&self) {
        self.shared.lock().waiting.get_or_insert_with(Instant::now);
        self.shared.changed.notify_all();
    }

    /// Has the disk take all that was appended.
    ///
    /// # Errors
    /// It has not taken some of it, now or before.
    pub fn sync(&self) -> io::Result<()> {
        // A file tells of an error once: who else asks gets it.
        let mut state = self.shared.wait_while(self.shared.lock(), |state| state.syncing.is_some());
        state.waiting = None;
        let result = (self.shared.sync)();
        state.error.take().map_or(result, Err)
    }

    /// What was appended need not be kept any more.
    pub fn forget(&self) {
        self.shared.lock().waiting = None;
    }
}

impl Drop for Syncer {
    /// What was appended is brought to the disk, unless it may be forgotten.
    fn drop(&mut self) {
        self.shared.lock().is_ended = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // It does not panic, and nobody is left who would hear of it.
            let _ = thread.join();
        }
    }
}

impl fmt::Debug for Syncer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Syncer").field("is_running", &self.thread.is_some()).finish_non_exhaustive()
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Every change of it is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait_while<'s>(
        &self,
        state: MutexGuard<'s, State>,
        is_so: impl FnMut(&mut State) -> bool,
    ) -> MutexGuard<'s, State> {
        self.changed.wait_while(state, is_so).unwrap_or_else(PoisonError::into_inner)
    }

    /// What the thread does.
    fn run(&self) {
        let mut state = self.lock();
        loop {
            state = self.wait_while(state, |state| state.waiting.is_none() && !state.is_ended);
            let Some(first) = state.waiting else { return };
            let left = self.gathered.saturating_sub(first.elapsed());
            let is_early = |state: &mut State| state.waiting.is_some() && !state.is_ended;
            let waited = self.changed.wait_timeout_while(state, left, is_early);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
            state.syncing = state.waiting.take();
            if state.syncing.is_none() {
                continue;
            }
            drop(state);
            let result = (self.sync)();
            state = self.lock();
            state.syncing = None;
            if let Err(error) = result {
                state.error = Some(error);
            }
            self.changed.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Receiver, Sender, channel};

    /// Longer than any test waits where all is right.
    const LONG: Duration = Duration::from_secs(60);
    const SHORT: Duration = Duration::from_millis(20);

    /// A syncer whose disk tells of each call, and when it has come.
    fn watched(gathered: Duration) -> (Syncer, Receiver<Instant>) {
        let (calls, called) = channel();
        let sync = move || {
            let _ = calls.send(Instant::now()); // at the end nobody listens
            Ok(())
        };
        (Syncer::with_times(sync, gathered, LONG), called)
    }

    fn append(syncer: &mut Syncer) -> io::Result<()> {
        syncer.before_append()?;
        syncer.appended();
        Ok(())
    }

    #[test]
    fn what_is_appended_last_is_synced_although_nothing_follows() {
        let (mut syncer, called) = watched(SHORT);
        for _ in 0..3 {
            let begun = Instant::now();
            append(&mut syncer).unwrap();
            assert!(called.recv_timeout(LONG).unwrap().duration_since(begun) >= SHORT);
            // Nothing was appended since, so nobody calls.
            assert!(called.recv_timeout(2 * SHORT).is_err());
        }
    }

    #[test]
    fn what_comes_together_is_synced_together() {
        let (mut syncer, called) = watched(LONG);
        (0..100).for_each(|_| append(&mut syncer).unwrap());
        assert!(called.try_recv().is_err());
        // The end does not wait for more.
        drop(syncer);
        assert_eq!(called.iter().count(), 1);
    }

    #[test]
    fn what_was_synced_by_hand_or_is_forgotten_is_not_synced_again() {
        let (mut syncer, called) = watched(LONG);
        append(&mut syncer).unwrap();
        syncer.sync().unwrap();
        append(&mut syncer).unwrap();
        syncer.forget();
        drop(syncer);
        assert_eq!(called.iter().count(), 1);
        // And one to which nothing is appended has no thread.
        let (syncer, called) = watched(SHORT);
        assert!(syncer.thread.is_none());
        drop(syncer);
        assert_eq!(called.iter().count(), 0);
    }

    #[test]
    fn an_error_is_told_by_the_next_append_or_by_hand_and_once() {
        let (calls, called) = channel();
        let sync = move || {
            calls.send(()).unwrap();
            Err(io::Error::other("no disk"))
        };
        let mut syncer = Syncer::with_times(sync, SHORT, LONG);
        append(&mut syncer).unwrap();
        called.recv_timeout(LONG).unwrap();
        // It is told when the call has returned; then what is appended is as if there had been none.
        let mut told = append(&mut syncer);
        while told.is_ok() {
            told = append(&mut syncer);
        }
        assert_eq!(told.unwrap_err().to_string(), "no disk");
        assert_eq!(syncer.sync().unwrap_err().to_string(), "no disk");
    }

    /// A disk that takes each call when it is told to.
    fn slow() -> (impl Fn() -> io::Result<()> + Send + Sync, Receiver<()>, Sender<()>) {
        let ((calls, called), (go_on, may_go_on)) = (channel(), channel());
        let may_go_on = Mutex::new(may_go_on);
        let sync = move || {
            calls.send(()).unwrap();
            may_go_on.lock().unwrap().recv().unwrap();
            Ok(())
        };
        (sync, called, go_on)
    }

    #[test]
    fn who_appends_waits_for_a_disk_that_is_too_slow_and_for_no_other() {
        let (sync, called, go_on) = slow();
        let mut syncer = Syncer::with_times(sync, Duration::ZERO, LONG);
        append(&mut syncer).unwrap();
        called.recv_timeout(LONG).unwrap();
        append(&mut syncer).unwrap(); // while the disk is busy
        go_on.send(()).unwrap();
        called.recv_timeout(LONG).unwrap();
        go_on.send(()).unwrap();
        drop(syncer);

        let (sync, called, go_on) = slow();
        let mut syncer = Syncer::with_times(sync, Duration::ZERO, Duration::ZERO);
        append(&mut syncer).unwrap();
        called.recv_timeout(LONG).unwrap();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| syncer.before_append());
            std::thread::sleep(SHORT);
            assert!(!waiting.is_finished());
            go_on.send(()).unwrap();
            waiting.join().unwrap().unwrap();
        });
    }
}
