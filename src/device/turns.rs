//! Kernels of one device that several threads start, one thread at a time.
//!
//! PoCL keeps a compiled kernel once for each larger grid that it was started over, with a count of its uses. At the
//! end of a kernel it takes one from the count of whichever of these was started last. Where two threads have started
//! the same kernel over grids of different sizes a count goes below 0, and an assertion ends the process: of PoCL 5.0,
//! `pocl_release_dlhandle_cache`, in 8 of 13 runs of tests by 16 threads and in none of 12 by one. Nothing is lost by
//! turns, as a kernel has all cores.

use crate::error::Result;
use crate::parallel::lock;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Who waits looks so often whether it is to stop.
const LOOK: Duration = Duration::from_millis(20);
/// Nobody waits longer than this: a kernel may hang, and a call that unwound may have left some that nobody waits for.
/// Sixteen threads that all have a kernel compiled, which PoCL does when it is started, wait for more than ten seconds.
const PATIENCE: Duration = Duration::from_secs(120);

/// Whose turn it is on a device.
#[derive(Debug, Default)]
pub(super) struct Turns {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The queue whose commands run, and how many have not ended.
    running: Option<(usize, usize)>,
    /// Those who wait, in their order.
    waiting: VecDeque<u64>,
    next: u64,
}

/// A command that may run until this is dropped.
#[derive(Debug)]
pub(super) struct Turn {
    turns: Arc<Turns>,
}

impl Turns {
    /// Waits until no other queue has commands that have not ended, unless this one has; none if that takes too long.
    ///
    /// # Errors
    /// Those of `check`, which is asked while this waits.
    pub fn take(self: &Arc<Self>, queue: usize, check: impl Fn() -> Result<()>) -> Result<Option<Turn>> {
        let mut state = lock(&self.state);
        if let Some((owner, commands)) = &mut state.running
            && *owner == queue
        {
            *commands += 1;
            return Ok(Some(Turn { turns: self.clone() }));
        }
        let (ticket, begun) = (state.next, Instant::now());
        state.next += 1;
        state.waiting.push_back(ticket);
        loop {
            let is_mine = state.running.is_none() && state.waiting.front() == Some(&ticket);
            let checked = if is_mine { Ok(()) } else { check() };
            if is_mine || checked.is_err() || begun.elapsed() > PATIENCE {
                state.waiting.retain(|waiting| *waiting != ticket);
                if is_mine {
                    state.running = Some((queue, 1));
                }
                drop(state);
                self.changed.notify_all();
                return checked.map(|()| is_mine.then(|| Turn { turns: self.clone() }));
            }
            state = self.changed.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut state = lock(&self.turns.state);
        let left = state.running.map(|(queue, commands)| (queue, commands.saturating_sub(1)));
        state.running = left.filter(|(_, commands)| *commands > 0);
        drop(state);
        self.turns.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::parallel::unlocked;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn one_queue_at_a_time() {
        let (turns, running) = (Arc::new(Turns::default()), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for queue in 0..4 {
                let (turns, running) = (&turns, &running);
                scope.spawn(move || {
                    for _ in 0..50 {
                        let first = turns.take(queue, || Ok(())).unwrap().unwrap();
                        assert_eq!(running.fetch_add(1, Ordering::SeqCst), 0, "two queues at once");
                        // A second command of the same queue does not wait for the first.
                        let second = turns.take(queue, || Ok(())).unwrap().unwrap();
                        std::thread::sleep(Duration::from_micros(200));
                        drop(first);
                        running.fetch_sub(1, Ordering::SeqCst);
                        drop(second);
                    }
                });
            }
        });
        let state = lock(&turns.state);
        assert!(state.running.is_none() && state.waiting.is_empty() && state.next >= 4);
    }

    #[test]
    fn who_waits_longest_is_next() {
        let (turns, order) = (Arc::new(Turns::default()), Mutex::new(Vec::new()));
        let held = turns.take(0, || Ok(())).unwrap();
        std::thread::scope(|scope| {
            for queue in 1..=5 {
                let (turns, order) = (&turns, &order);
                scope.spawn(move || {
                    let _turn = turns.take(queue, || Ok(())).unwrap().unwrap();
                    lock(order).push(queue);
                });
                while lock(&turns.state).waiting.len() < queue {
                    std::thread::yield_now();
                }
            }
            assert!(lock(&order).is_empty());
            drop(held);
        });
        assert_eq!(unlocked(order), [1, 2, 3, 4, 5]);
    }

    #[test]
    fn who_waits_can_be_stopped() {
        let turns = Arc::new(Turns::default());
        let held = turns.take(1, || Ok(())).unwrap();
        assert!(matches!(turns.take(2, || Err(Error::Stopped)), Err(Error::Stopped)));
        drop(held);
        assert!(turns.take(2, || Err(Error::Stopped)).unwrap().is_some(), "nobody is before it");
    }
}
