//! The queue of pieces from which several devices take, and who does what.

use super::{Takeover, Watcher};
use crate::error::Error;
use std::collections::{HashSet, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Pieces that a device is at.
struct Flight {
    pieces: Vec<usize>,
    /// Whether another device is at them, too.
    is_backed: bool,
}

/// What is left of the work.
pub(super) struct State {
    /// Pieces that nobody is at, in units that are not divided.
    units: VecDeque<Vec<usize>>,
    pub finished: HashSet<usize>,
    pub all: usize,
    flights: Vec<Option<Flight>>,
    /// Pieces a second of each device, where that is known, and how many it took last.
    rates: Vec<Option<f64>>,
    last: Vec<usize>,
    /// How many seconds a device may take for what it has at a time.
    most_time: f64,
    /// Devices that have not failed.
    alive: usize,
    /// Whether any device was ready to work.
    pub was_ready: bool,
    /// Whether a device was lost in the middle of its work.
    was_lost: bool,
    /// Whether something takes what is left where no device is.
    has_last_resort: bool,
    pub failure: Option<Error>,
}

pub(super) struct Queue {
    state: Mutex<State>,
    pub changed: Condvar,
}

/// What a device is to do next.
#[derive(Debug, PartialEq)]
pub(super) struct Job {
    pub pieces: Vec<usize>,
    /// Whether another device is at it.
    pub is_backup: bool,
}

/// What a device takes at a time is about this part of what is left for it, so that all end together.
const PART_OF_REST: f64 = 0.5;
/// And no less than this takes, because small lists keep no device busy.
const LEAST_TIME: f64 = 0.25;
/// A device takes so many times as many pieces as before, as long as these take no more than all of the rest.
const GROWTH: usize = 4;
/// A device helps another that is slower by this factor.
const HELPS_FROM: f64 = 1.5;

impl Queue {
    /// Of units for so many devices, each of which may take so long for what it has at a time; with `has_last_resort`
    /// one more works where all of these have failed.
    pub fn new(
        (units, most_time): (Vec<Vec<usize>>, Option<Duration>),
        devices: usize,
        has_last_resort: bool,
    ) -> Queue {
        let workers = devices + usize::from(has_last_resort);
        let state = State {
            all: units.iter().map(Vec::len).sum(),
            units: units.into(),
            finished: HashSet::new(),
            flights: (0..workers).map(|_| None).collect(),
            rates: vec![None; workers],
            last: vec![0; workers],
            most_time: most_time.map_or(f64::INFINITY, |time| time.as_secs_f64()),
            alive: devices,
            was_ready: false,
            was_lost: false,
            has_last_resort,
            failure: None,
        };
        Queue { state: Mutex::new(state), changed: Condvar::new() }
    }

    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next pieces of a device; waits where there may be some later. None: the work is done, or failed.
    pub fn take(&self, worker: usize) -> Option<Job> {
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
    pub fn leave(&self, worker: usize, pieces: usize, took: Duration) {
        let mut state = self.lock();
        state.flights[worker] = None;
        if pieces > 0 {
            state.last[worker] = pieces;
            state.rates[worker] = Some(pieces as f64 / took.as_secs_f64().max(1e-3));
        }
        self.changed.notify_all();
    }

    /// Ends all work.
    pub fn fail(&self, error: Error) {
        self.lock().failure.get_or_insert(error);
        self.changed.notify_all();
    }

    /// A device has failed: what it had is to be done by others, if there are any.
    pub fn lose(&self, worker: usize, name: &str, error: Error, watcher: &dyn Watcher) {
        let mut state = self.lock();
        state.alive -= 1;
        state.rates[worker] = None;
        if let Some(flight) = state.flights[worker].take() {
            let left: Vec<usize> = flight.pieces.into_iter().filter(|piece| !state.finished.contains(piece)).collect();
            if !left.is_empty() {
                state.units.push_front(left);
            }
        }
        state.was_lost |= state.was_ready && error.is_lost_device();
        let ended = match state.takeover(&error) {
            Some(takeover) => watcher.lost(name, error, takeover),
            None => Err(error),
        };
        if let Err(error) = ended {
            state.failure.get_or_insert(error);
        }
        self.changed.notify_all();
    }

    /// Whether something is left that the last resort is to do, which is then the one device.
    pub fn begin_last_resort(&self) -> bool {
        let mut state = self.lock();
        let begins = state.has_last_resort && !state.is_over();
        (state.has_last_resort, state.alive) = (false, 1);
        begins
    }
}

impl State {
    pub fn is_over(&self) -> bool {
        self.failure.is_some() || self.finished.len() >= self.all
    }

    /// Who goes on where a device has failed, if anybody can.
    fn takeover(&self, error: &Error) -> Option<Takeover> {
        match self.alive {
            _ if !error.is_of_device() => None,
            // What keeps every device from beginning is to be mended; it is not a device that is lost.
            0 => (self.has_last_resort && self.was_lost).then_some(Takeover::LastResort),
            _ => Some(Takeover::OtherDevices),
        }
    }

    fn next(&mut self, worker: usize) -> Option<Job> {
        if self.units.is_empty() {
            return self.backup(worker);
        }
        let mut pieces = self.units.pop_front()?;
        let wanted = self.wanted(worker);
        while let Some(unit) = self.units.front()
            && (pieces.len() + unit.len()) as f64 <= wanted
        {
            pieces.extend(unit);
            self.units.pop_front();
        }
        pieces.sort_unstable();
        self.flights[worker] = Some(Flight { pieces: pieces.clone(), is_backed: false });
        Some(Job { pieces, is_backup: false })
    }

    /// How many pieces a device is to take.
    fn wanted(&self, worker: usize) -> f64 {
        let Some(rate) = self.rates[worker] else { return 1.0 };
        let all: f64 = self.rates.iter().flatten().sum();
        let left: usize = self.units.iter().map(Vec::len).sum();
        let all_s = left as f64 / all;
        let fair = rate * (PART_OF_REST * all_s).max(LEAST_TIME);
        // Few pieces at a time keep no device busy, so that its rate is no measure: more of them show what it can do.
        let more = (GROWTH * self.last[worker]) as f64;
        let wanted = if more <= rate * all_s { fair.max(more) } else { fair };
        wanted.min(rate * self.most_time)
    }

    /// What a slower device has not finished, from its end on.
    fn backup(&mut self, worker: usize) -> Option<Job> {
        let own = self.rates[worker]?;
        let is_slower = |rate: Option<f64>| rate.is_none_or(|rate| HELPS_FROM * rate < own);
        let finished = &self.finished;
        let left = |flight: &Flight| -> Vec<usize> {
            flight.pieces.iter().rev().filter(|piece| !finished.contains(piece)).copied().collect()
        };
        let others = self.flights.iter_mut().zip(&self.rates).enumerate().filter(|(other, _)| *other != worker);
        let slower = others.filter(|(_, (_, rate))| is_slower(**rate)).filter_map(|(_, (flight, _))| flight.as_mut());
        let flight = slower.filter(|flight| !flight.is_backed).max_by_key(|flight| left(flight).len())?;
        let pieces = left(flight);
        if pieces.is_empty() {
            return None;
        }
        flight.is_backed = true;
        self.flights[worker] = Some(Flight { pieces: pieces.clone(), is_backed: true });
        Some(Job { pieces, is_backup: true })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    fn queue(units: usize, workers: usize) -> Queue {
        within(units, workers, None)
    }

    fn within(units: usize, workers: usize, most_time: Option<Duration>) -> Queue {
        Queue::new(((0..units).map(|unit| vec![unit]).collect(), most_time), workers, false)
    }

    /// As if the device had finished these.
    fn finish(queue: &Queue, pieces: &[usize]) {
        queue.lock().finished.extend(pieces);
    }

    fn take(queue: &Queue, worker: usize) -> Vec<usize> {
        queue.take(worker).unwrap().pieces
    }

    struct Nobody;

    impl Watcher for Nobody {
        fn progress(&self, _: f64) {}
        fn lost(&self, _: &str, _: Error, _: Takeover) -> Result<()> {
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
    fn where_order_matters_nobody_takes_what_lasts_long() {
        let queue = within(1000, 2, Some(Duration::from_secs(2)));
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0, 1]);
        queue.leave(0, 1, Duration::from_millis(10));
        queue.leave(1, 1, Duration::from_millis(40));
        assert_eq!([take(&queue, 0).len(), take(&queue, 1).len()], [200, 50], "two seconds' work each");
    }

    #[test]
    fn a_fast_device_does_what_a_slow_one_has_not_finished() {
        let queue = queue(6, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0]);
        queue.leave(0, 1, Duration::from_millis(1));
        assert_eq!(take(&queue, 0), [2, 3, 4, 5]);
        finish(&queue, &[2, 3, 4, 5]);
        queue.leave(0, 4, Duration::from_millis(4));
        assert_eq!(queue.take(0), Some(Job { pieces: vec![1], is_backup: true }));
        finish(&queue, &[1]);
        assert_eq!([queue.take(0), queue.take(1)], [None, None]);
    }

    fn lost(device: &str) -> Error {
        let [device, call, code, hint] = [device, "clFinish", "CL_OUT_OF_RESOURCES (-5)", ""].map(str::to_owned);
        Error::OpenCl { device, call, code, hint }
    }

    fn failure(queue: &Queue) -> String {
        queue.lock().failure.as_ref().unwrap().to_string()
    }

    #[test]
    fn what_a_lost_device_had_goes_to_another() {
        let queue = queue(3, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        queue.lose(0, "a", lost("a"), &Nobody);
        finish(&queue, &[1]);
        queue.leave(1, 1, Duration::from_secs(10));
        assert_eq!(take(&queue, 1), [0]);
        queue.lose(1, "b", lost("b"), &Nobody);
        assert!(queue.take(1).is_none() && !queue.begin_last_resort());
        assert!(failure(&queue).contains("'b': clFinish"));
    }

    #[test]
    fn the_last_resort_takes_what_devices_leave_that_were_ready() {
        let with_last_resort = || Queue::new((vec![vec![0], vec![1]], None), 1, true);
        let queue = with_last_resort();
        queue.lock().was_ready = true;
        assert_eq!(take(&queue, 0), [0]);
        queue.lose(0, "a", lost("a"), &Nobody);
        assert!(queue.begin_last_resort());
        assert_eq!(take(&queue, 1), [0]);
        queue.lose(1, "reference", lost("reference"), &Nobody);
        assert!(failure(&queue).contains("'reference'") && !queue.begin_last_resort());
        // In whatever order: one is lost, and another cannot begin.
        let no_device = || Error::NoDevice("b".to_owned());
        for is_lost_first in [true, false] {
            let queue = Queue::new((vec![vec![0], vec![1]], None), 2, true);
            queue.lock().was_ready = true;
            if is_lost_first {
                queue.lose(0, "a", lost("a"), &Nobody);
                queue.lose(1, "b", no_device(), &Nobody);
            } else {
                queue.lose(1, "b", no_device(), &Nobody);
                queue.lose(0, "a", lost("a"), &Nobody);
            }
            assert!(queue.begin_last_resort(), "{is_lost_first}");
        }
        // What fails before it begins, and what fails on the host, is an error.
        let queue = with_last_resort();
        queue.lose(0, "a", lost("a"), &Nobody);
        assert!(failure(&queue).contains("'a'") && !queue.begin_last_resort());
        let queue = with_last_resort();
        queue.lock().was_ready = true;
        queue.lose(0, "a", Error::Scene("no memory".into()), &Nobody);
        assert!(failure(&queue).contains("no memory") && !queue.begin_last_resort());
    }
}
