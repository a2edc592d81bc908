//! The queue of pieces from which several devices take, and who does what.

use super::{Takeover, Watcher};
use crate::error::Error;
use std::collections::{HashSet, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Pieces that a device is at.
struct Flight {
    begun: Instant,
    pieces: Vec<usize>,
    /// Whether another device is at them, too.
    is_backed: bool,
}

/// A device, and what is known of it.
#[derive(Default)]
struct Member {
    /// Whether it is this machine's processor.
    is_processor: bool,
    /// Whether it does nothing: it has failed, or is the last resort and has not begun.
    is_out: bool,
    flight: Option<Flight>,
    /// Pieces that it did when it was at work last, and how many a second.
    last: Option<(usize, f64)>,
    /// Pieces that it did in all, and the seconds that they took.
    pieces: usize,
    seconds: f64,
}

impl Member {
    /// Pieces a second that it did in all.
    fn speed(&self) -> Option<f64> {
        (self.pieces > 0).then(|| self.pieces as f64 / self.seconds)
    }
}

/// What is left of the work.
pub(super) struct State {
    /// Pieces that nobody is at, in units that are not divided.
    units: VecDeque<Vec<usize>>,
    pub finished: HashSet<usize>,
    pub all: usize,
    /// The devices, and behind them the last resort, if there is one.
    members: Vec<Member>,
    /// How many seconds a device may take for what it has at a time.
    most_time: f64,
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
    /// How many of them it does together. Of what another is at it takes few, so that whoever is first finishes each.
    pub together: usize,
}

/// What a device takes at a time is about this part of what is left for it, so that all end together.
const PART_OF_REST: f64 = 0.5;
/// And no less than this takes, because small lists keep no device busy.
const LEAST_TIME: f64 = 0.25;
/// A device takes so many times as many pieces as before, as long as these take no more than all of the rest.
const GROWTH: usize = 4;
/// And at most so many times as many, and no more than this part of its share of all: the next pieces may be a hundred
/// times as dear as the last ones, as where a sky ends.
const MOST_GROWTH: usize = 16;
const PART_OF_SHARE: f64 = 0.25;
/// A device helps another that is slower by this factor, or takes so many times as long as it would itself.
const HELPS_FROM: f64 = 1.5;
const OVERDUE: f64 = 2.0;
/// What it takes at a time of that takes about so long.
const HELP_TIME: f64 = 0.1;
/// A processor is left out while other devices together are so many times as fast: it adds less than it takes from
/// them, because their threads need its cores.
const LEFT_OUT_FROM: f64 = 10.0;
/// It begins once one of them has been at work for so many seconds, and there is as much left for them: to see how fast
/// it is costs them some tenths of a second.
const BEGINS_AFTER: f64 = 2.0;
/// How often a device that has nothing to do looks for another that has become slow.
const LOOKS_EVERY: Duration = Duration::from_millis(50);

impl Queue {
    /// Of units for devices, of which some are `processors`, each of which may take so long for what it has at a time;
    /// with `has_last_resort` one more works where all of these have failed.
    pub fn new(
        (units, most_time): (Vec<Vec<usize>>, Option<Duration>),
        processors: Vec<bool>,
        has_last_resort: bool,
    ) -> Queue {
        let devices = processors.into_iter().map(|is_processor| Member { is_processor, ..Member::default() });
        let last_resort = has_last_resort.then(|| Member { is_processor: true, is_out: true, ..Member::default() });
        let state = State {
            all: units.iter().map(Vec::len).sum(),
            units: units.into(),
            finished: HashSet::new(),
            members: devices.chain(last_resort).collect(),
            most_time: most_time.map_or(f64::INFINITY, |time| time.as_secs_f64()),
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
            state = self.later(state);
        }
    }

    /// Waits until a device may have something to do; whether it has.
    pub fn wait(&self, worker: usize) -> bool {
        let mut state = self.lock();
        while !state.is_over() && state.is_left_out(worker) {
            state = self.later(state);
        }
        !state.is_over()
    }

    /// Waits until something has changed, or may look different by the time that has passed.
    fn later<'q>(&'q self, state: MutexGuard<'q, State>) -> MutexGuard<'q, State> {
        self.changed.wait_timeout(state, LOOKS_EVERY).unwrap_or_else(PoisonError::into_inner).0
    }

    /// A device has come to the end of what it took.
    pub fn leave(&self, worker: usize, pieces: usize, took: Duration) {
        let mut state = self.lock();
        let member = &mut state.members[worker];
        member.flight = None;
        if pieces > 0 {
            let seconds = took.as_secs_f64().max(1e-3);
            member.last = Some((pieces, pieces as f64 / seconds));
            member.pieces += pieces;
            member.seconds += seconds;
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
        let is_processor = state.members[worker].is_processor;
        let out = Member { is_processor, is_out: true, ..Member::default() };
        if let Some(flight) = std::mem::replace(&mut state.members[worker], out).flight {
            let left: Vec<usize> = flight.pieces.into_iter().filter(|piece| !state.finished.contains(piece)).collect();
            if !left.is_empty() {
                state.units.push_front(left);
            }
        }
        state.was_lost |= state.was_ready && error.is_lost_device();
        let ended = match state.takeover(&error) {
            Some(takeover) => watcher.lost((worker, name), error, takeover),
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
        if std::mem::take(&mut state.has_last_resort)
            && let Some(member) = state.members.last_mut()
        {
            member.is_out = false;
        }
        begins
    }
}

impl State {
    pub fn is_over(&self) -> bool {
        self.failure.is_some() || self.finished.len() >= self.all
    }

    /// Who goes on where a device has failed, if anybody can.
    fn takeover(&self, error: &Error) -> Option<Takeover> {
        match self.members.iter().filter(|member| !member.is_out).count() {
            _ if !error.is_of_device() => None,
            // What keeps every device from beginning is to be mended; it is not a device that is lost.
            0 => (self.has_last_resort && self.was_lost).then_some(Takeover::LastResort),
            _ => Some(Takeover::OtherDevices),
        }
    }

    fn next(&mut self, worker: usize) -> Option<Job> {
        if self.is_left_out(worker) {
            return None;
        }
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
        self.members[worker].flight = Some(Flight { begun: Instant::now(), pieces: pieces.clone(), is_backed: false });
        Some(Job { together: pieces.len(), pieces })
    }

    /// Whether a device is a processor that is to do nothing, or nothing yet, because of others that need its cores.
    fn is_left_out(&self, worker: usize) -> bool {
        let own = &self.members[worker];
        let others = || self.members.iter().filter(|other| !other.is_processor && !other.is_out);
        if !own.is_processor || others().next().is_none() {
            return false;
        }
        let speed: f64 = others().filter_map(Member::speed).sum();
        let worked = others().map(|other| other.seconds).fold(0.0, f64::max);
        let left: usize = self.units.iter().map(Vec::len).sum();
        match own.speed() {
            Some(own) => LEFT_OUT_FROM * own < speed,
            None => worked < BEGINS_AFTER || (left as f64) < BEGINS_AFTER * speed,
        }
    }

    /// How many pieces a device is to take.
    fn wanted(&self, worker: usize) -> f64 {
        let own = &self.members[worker];
        let (Some((last, rate)), Some(speed)) = (own.last, own.speed()) else { return 1.0 };
        let all: f64 = self.members.iter().filter_map(|member| member.last).map(|(_, rate)| rate).sum();
        let left: usize = self.units.iter().map(Vec::len).sum();
        let all_s = left as f64 / all;
        let fair = rate * (PART_OF_REST * all_s).max(LEAST_TIME);
        // Few pieces at a time keep no device busy, so that its rate is no measure: more of them show what it can do.
        let more = (GROWTH * last) as f64;
        let wanted = if more <= rate * all_s { fair.max(more) } else { fair };
        let speeds: f64 = self.members.iter().filter_map(Member::speed).sum();
        let most = PART_OF_SHARE * self.all as f64 * (speed / speeds);
        wanted.min(rate * self.most_time).min((MOST_GROWTH * last) as f64).min(most)
    }

    /// What a slower device has not finished, from its end on.
    fn backup(&mut self, worker: usize) -> Option<Job> {
        let own = self.members[worker].speed()?;
        let is_slow = |member: &Member, flight: &Flight| {
            let seconds = flight.pieces.len() as f64 / own;
            member.speed().is_none_or(|speed| HELPS_FROM * speed < own)
                || flight.begun.elapsed().as_secs_f64() > OVERDUE * seconds
        };
        let left = |flight: &Flight| -> Vec<usize> {
            flight.pieces.iter().rev().filter(|piece| !self.finished.contains(piece)).copied().collect()
        };
        let others = self.members.iter().enumerate().filter(|(other, _)| *other != worker);
        let slow = others.filter_map(|(other, member)| {
            let flight = member.flight.as_ref().filter(|flight| !flight.is_backed && is_slow(member, flight))?;
            Some((other, left(flight)))
        });
        let (other, pieces) = slow.max_by_key(|(_, left)| left.len())?;
        if pieces.is_empty() {
            return None;
        }
        self.members[other].flight.iter_mut().for_each(|flight| flight.is_backed = true);
        self.members[worker].flight = Some(Flight { begun: Instant::now(), pieces: pieces.clone(), is_backed: true });
        Some(Job { pieces, together: ((own * HELP_TIME) as usize).max(1) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    fn queue(units: usize, workers: usize) -> Queue {
        within(units, vec![false; workers], None)
    }

    fn within(units: usize, processors: Vec<bool>, most_time: Option<Duration>) -> Queue {
        Queue::new(((0..units).map(|unit| vec![unit]).collect(), most_time), processors, false)
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
        fn lost(&self, _: (usize, &str), _: Error, _: Takeover) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn devices_take_as_much_as_they_are_fast() {
        let queue = queue(1000, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]], "nobody knows yet");
        finish(&queue, &[0, 1]);
        queue.leave(0, 100, Duration::from_secs(1));
        queue.leave(1, 25, Duration::from_secs(1));
        assert_eq!([take(&queue, 0).len(), take(&queue, 1).len()], [200, 50], "a quarter of four fifths, and of one");
        // Half of what is left, at the end.
        finish(&queue, &(2..900).collect::<Vec<_>>());
        queue.lock().units.drain(..648);
        queue.leave(0, 100, Duration::from_secs(1));
        queue.leave(1, 25, Duration::from_secs(1));
        assert_eq!([take(&queue, 0).len(), take(&queue, 1).len()], [39, 6], "and a quarter of a second's");
    }

    #[test]
    fn where_order_matters_nobody_takes_what_lasts_long() {
        let queue = within(1000, vec![false; 2], Some(Duration::from_millis(400)));
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0, 1]);
        queue.leave(0, 100, Duration::from_secs(1));
        queue.leave(1, 25, Duration::from_secs(1));
        assert_eq!([take(&queue, 0).len(), take(&queue, 1).len()], [40, 10], "work of .4 s each");
    }

    #[test]
    fn a_fast_device_does_what_a_slow_one_has_not_finished() {
        let queue = queue(6, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0]);
        queue.leave(0, 1, Duration::from_millis(1));
        for piece in 2..6 {
            assert_eq!(take(&queue, 0), [piece]);
            finish(&queue, &[piece]);
            queue.leave(0, 1, Duration::from_millis(1));
        }
        assert_eq!(queue.take(0), Some(Job { pieces: vec![1], together: 100 }));
        finish(&queue, &[1]);
        assert_eq!([queue.take(0), queue.take(1)], [None, None]);
    }

    #[test]
    fn pieces_that_take_longer_than_those_before_are_helped_with() {
        let queue = queue(4, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0, 1]);
        let second = Duration::from_secs(1);
        [0, 1].into_iter().for_each(|worker| queue.leave(worker, 1, second));
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![2], vec![3]]);
        finish(&queue, &[2]);
        queue.leave(0, 1, second);
        assert_eq!(queue.lock().next(0), None, "both are as fast, as far as is known");
        let begin_before = |time: Duration| {
            queue.lock().members[1]
                .flight
                .iter_mut()
                .for_each(|flight| flight.begun = Instant::now().checked_sub(time).unwrap());
        };
        begin_before(second);
        assert_eq!(queue.lock().next(0), None, "it may take a little longer");
        begin_before(3 * second);
        assert_eq!(queue.lock().next(0), Some(Job { pieces: vec![3], together: 1 }));
    }

    #[test]
    fn cheap_first_pieces_do_not_make_a_device_take_much() {
        let queue = queue(1000, 2);
        assert_eq!([take(&queue, 0), take(&queue, 1)], [vec![0], vec![1]]);
        finish(&queue, &[0, 1]);
        [0, 1].into_iter().for_each(|worker| queue.leave(worker, 1, Duration::from_millis(1)));
        assert_eq!([take(&queue, 0).len(), take(&queue, 1).len()], [16, 16]);
        queue.leave(0, 16, Duration::from_millis(16));
        assert_eq!(take(&queue, 0).len(), 124, "a quarter of half, and less than that by a rounding");
    }

    #[test]
    fn a_processor_beside_much_faster_devices_is_left_out_as_long_as_they_are_there() {
        for is_processor in [true, false] {
            let queue = within(10_000, vec![false, false, is_processor], None);
            assert_eq!([0, 1].map(|worker| take(&queue, worker)), [vec![0], vec![1]]);
            let is_left_out = || queue.lock().is_left_out(2);
            assert_eq!(is_left_out(), is_processor, "nothing is known of the others");
            finish(&queue, &[0, 1]);
            [0, 1].into_iter().for_each(|worker| queue.leave(worker, 200, Duration::from_secs(2)));
            assert!(!is_left_out(), "there is more than two seconds' work");
            assert_eq!(take(&queue, 2), [2]);
            finish(&queue, &[2]);
            queue.leave(2, 1, Duration::from_millis(150));
            assert_eq!(is_left_out(), is_processor, "the others have thirty times its speed");
            queue.lose(0, "a", lost("a"), &Nobody);
            assert_eq!(is_left_out(), is_processor, "and the other one fifteen times");
            queue.lose(1, "b", lost("b"), &Nobody);
            assert_eq!(take(&queue, 2).len(), 16);
        }
        // What is left by then is not worth while.
        let queue = within(300, vec![false, true], None);
        assert!(queue.wait(0));
        assert_eq!(take(&queue, 0), [0]);
        finish(&queue, &[0]);
        queue.leave(0, 200, Duration::from_secs(1));
        assert!(queue.lock().is_left_out(1), "it may be faster after its first second");
        queue.leave(0, 200, Duration::from_secs(1));
        assert!(queue.lock().is_left_out(1), "there is work for a second and a half");
        finish(&queue, &(1..300).collect::<Vec<_>>());
        assert!(!queue.wait(1), "so it is not even opened");
        // A processor alone, or beside others, waits for nobody.
        for processors in [vec![true], vec![true, true]] {
            assert!(!within(9, processors, None).lock().is_left_out(0));
        }
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
        let with_last_resort = || Queue::new((vec![vec![0], vec![1]], None), vec![false], true);
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
            let queue = Queue::new((vec![vec![0], vec![1]], None), vec![false; 2], true);
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
