//! No call of a driver is waited for without a limit.
//!
//! A call that hangs cannot be interrupted: whoever made it is inside the driver for ever. (PoCL 3.1 leaves a build
//! that ran out of memory with the program's lock taken, and waits for it in the release.) So a thread of its own looks
//! at the calls that are under way, and tells a handler of those that take too long, which may end the process: the
//! program does, a library's user may.
//!
//! A driver written in C++ may also leave a call by an exception, as PoCL does when its compiler runs out of memory.
//! Rust cannot catch it: it would abort the process, or hang in the release of what is dropped on the way. The handler
//! is told of that, too.
//!
//! The limits are far beyond what is seen on slow devices: an hour for the first launch of a kernel, whose length
//! nobody knows and in which PoCL compiles it once more, is 36,000 times what it is sized for; Oclgrind, a simulator,
//! takes 1,000 times as long.

use super::owner::Owner;
use crate::error::{Error, Result};
use std::ffi::OsString;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, Once, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// The variable that sets all limits, in seconds; 0: none.
pub(super) const LIMIT_VARIABLE: &str = "RAYBROOK_DRIVER_LIMIT";

/// A release does nothing that takes time, unless commands are still running.
const RELEASE: Duration = Duration::from_secs(30);
/// What does not run kernels: the slowest are the first look for devices and large transfers.
const CALL: Duration = Duration::from_secs(600);
/// Compilers take up to a minute for the largest kernels, on busy machines several.
const BUILD: Duration = Duration::from_secs(1800);
/// Commands of unknown length.
const COMMANDS: Duration = Duration::from_secs(3600);
/// A launch may take so many times as long as it is estimated from the launch before, and in any case as long as other
/// calls.
const ESTIMATES: f64 = 1000.0;
/// This part of a limit is waited for in silence.
const SILENCE: f64 = 0.1;
/// How often the calls are looked at; oftener where a limit is short.
const LOOK: Duration = Duration::from_secs(1);
/// The thread prints a sentence at most. Address space may be what is short.
const STACK_BYTES: usize = 256 << 10;

/// Memory that is set aside for telling of a driver that ran out of memory. Nothing writes to it, so that it takes
/// address space alone.
const RESERVE_BYTES: usize = 4 << 20;

/// How long a call may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Limit {
    Release,
    Call,
    Build,
    /// It waits for commands of which nothing is known.
    Commands,
    /// It waits for a command that is estimated to take so many seconds.
    Estimate(f64),
}

impl Limit {
    fn duration(self) -> Duration {
        match self {
            Limit::Release => RELEASE,
            Limit::Call => CALL,
            Limit::Build => BUILD,
            Limit::Commands => COMMANDS,
            Limit::Estimate(seconds) => {
                CALL.max(Duration::try_from_secs_f64(ESTIMATES * seconds).unwrap_or(Duration::MAX))
            }
        }
    }
}

/// What all limits are instead.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Override {
    /// They stay.
    None,
    /// Calls may take for ever.
    NoLimit,
    All(Duration),
}

impl Override {
    fn of_text(text: Option<OsString>) -> Result<Self> {
        let Some(text) = text.filter(|text| !text.is_empty()) else { return Ok(Override::None) };
        let text = text.to_string_lossy();
        let seconds = text.trim().parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        match seconds {
            Some(Duration::ZERO) => Ok(Override::NoLimit),
            Some(limit) => Ok(Override::All(limit)),
            None => {
                let message = format!("'{text}': expected a number of seconds, 0 to wait for ever");
                Err(Error::option(LIMIT_VARIABLE, message))
            }
        }
    }

    /// The limit of a call, if it has one.
    fn apply(self, limit: Limit) -> Option<Duration> {
        match self {
            Override::None => Some(limit.duration()),
            Override::NoLimit => None,
            Override::All(limit) => Some(limit),
        }
    }
}

/// A call that takes longer than it should, or that will never return.
#[derive(Debug, Clone, PartialEq)]
pub struct Overdue {
    /// The name of the device.
    pub device: String,
    /// The OpenCL call.
    pub call: String,
    /// How long it has been waited for.
    pub waited: Duration,
    /// How long it is waited for at most.
    pub limit: Duration,
    /// What failed on the device before; a driver may hang because of that.
    pub failure: Option<String>,
    /// Whether the driver left the call by an exception.
    pub threw: bool,
}

impl Overdue {
    /// Whether nothing is to be hoped for: the limit is reached, or the driver has left the call. Before that it is
    /// slow.
    pub fn is_over(&self) -> bool {
        self.threw || self.waited >= self.limit
    }

    /// The error that a call is which is given up.
    pub fn error(&self) -> Error {
        if self.threw {
            return Error::OpenCl {
                device: self.device.clone(),
                call: self.call.clone(),
                code: "the driver threw an exception".to_owned(),
                hint: "this computer probably ran out of memory; close other programs, or use `device = reference`"
                    .to_owned(),
            };
        }
        Error::Hang {
            device: self.device.clone(),
            call: self.call.clone(),
            limit_s: self.limit.as_secs_f64(),
            failure: self.failure.clone(),
        }
    }
}

impl fmt::Display for Overdue {
    /// What to tell a user while there is hope.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Overdue { device, call, waited, limit, .. } = self;
        let (waited, limit) = (waited.as_secs_f64(), limit.as_secs_f64());
        write!(f, "device '{device}': {call} has not returned for {waited:.1} s; after {limit:.1} s it is given up")
    }
}

type Handler = Box<dyn Fn(&Overdue) + Send + Sync>;

struct Watchdog {
    handler: Handler,
    limits: Override,
    under_way: Mutex<Calls>,
    thread: Once,
    reserve: Mutex<Vec<u8>>,
}

#[derive(Default)]
struct Calls {
    calls: Vec<Call>,
    next: u64,
}

struct Call {
    number: u64,
    owner: Arc<Owner>,
    name: &'static str,
    since: Instant,
    limit: Duration,
    was_told: bool,
}

impl Call {
    fn overdue(&self, now: Instant) -> Overdue {
        Overdue {
            device: self.owner.device.clone(),
            call: self.name.to_owned(),
            waited: now.saturating_duration_since(self.since),
            limit: self.limit,
            failure: self.owner.failure().cloned(),
            threw: false,
        }
    }
}

static WATCHDOG: OnceLock<Watchdog> = OnceLock::new();

/// Has `handler` told of every call of an OpenCL driver that takes longer than it should: once when a tenth of its
/// limit is over, and once when all of it is; and of every call that the driver leaves by an exception. It is called
/// from another thread than the one that hangs. The call that hangs never returns, nor does whoever made it: a handler
/// that wants more than to tell ends the process, without the drivers' own exit handlers, which may hang as well.
///
/// The limits are 30 seconds for a release, 10 minutes for other calls, 30 for builds; launches have a thousand times
/// what the launch before took, at least 10 minutes, and an hour where there was none. `RAYBROOK_DRIVER_LIMIT` sets all
/// of them, in seconds; 0: none.
///
/// Without a handler nothing is watched. A second one is ignored.
///
/// # Errors
/// [`Error::Option`] when the variable is not a number.
pub fn watch_driver(handler: impl Fn(&Overdue) + Send + Sync + 'static) -> Result<()> {
    let limits = Override::of_text(std::env::var_os(LIMIT_VARIABLE))?;
    let watchdog = Watchdog {
        handler: Box::new(handler),
        limits,
        under_way: Mutex::new(Calls::default()),
        thread: Once::new(),
        reserve: Mutex::new(vec![0; RESERVE_BYTES]),
    };
    // Whoever came first is told.
    let _ = WATCHDOG.set(watchdog);
    Ok(())
}

/// A call is under way while this lives.
pub(super) struct Watched(Option<(&'static Watchdog, u64)>);

/// Begins to watch a call.
pub(super) fn watch(owner: &Arc<Owner>, name: &'static str, limit: Limit) -> Watched {
    let Some(watchdog) = WATCHDOG.get() else { return Watched(None) };
    let Some(limit) = watchdog.limits.apply(limit) else { return Watched(None) };
    watchdog.thread.call_once(|| {
        // Without a thread, for want of memory, nothing is watched: that is no reason not to try.
        let _ = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(|| watchdog.look_for_ever());
    });
    let call = Call { number: 0, owner: Arc::clone(owner), name, since: Instant::now(), limit, was_told: false };
    Watched(Some((watchdog, watchdog.lock().begin(call))))
}

impl Watched {
    /// Makes the call, which the driver may leave by an exception.
    pub fn call<T>(self, call: impl FnOnce() -> T) -> T {
        let left = LeftByException(&self);
        let result = call();
        std::mem::forget(left);
        result
    }
}

/// Lives while a call is under way, and is dropped only where that is left by an exception.
struct LeftByException<'a>(&'a Watched);

impl Drop for LeftByException<'_> {
    fn drop(&mut self) {
        if let (Some((watchdog, number)), false) = (self.0.0, std::thread::panicking()) {
            watchdog.give_up_reserve();
            let call = watchdog
                .lock()
                .calls
                .iter()
                .find(|call| call.number == number)
                .map(|call| call.overdue(Instant::now()));
            if let Some(overdue) = call {
                (watchdog.handler)(&Overdue { threw: true, ..overdue });
            }
        }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        if let Some((watchdog, number)) = self.0 {
            watchdog.lock().end(number);
        }
    }
}

impl Watchdog {
    fn lock(&self) -> MutexGuard<'_, Calls> {
        self.under_way.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn give_up_reserve(&self) {
        *self.reserve.lock().unwrap_or_else(PoisonError::into_inner) = Vec::new();
    }

    fn look_for_ever(&self) {
        let look = match self.limits {
            Override::All(limit) => LOOK.min(limit.mul_f64(SILENCE)),
            _ => LOOK,
        };
        loop {
            std::thread::sleep(look);
            let overdue = self.lock().look(Instant::now());
            if overdue.iter().any(Overdue::is_over) {
                self.give_up_reserve();
            }
            overdue.iter().for_each(|overdue| (self.handler)(overdue));
        }
    }
}

impl Calls {
    fn begin(&mut self, call: Call) -> u64 {
        self.next += 1;
        self.calls.push(Call { number: self.next, ..call });
        self.next
    }

    fn end(&mut self, number: u64) {
        self.calls.retain(|call| call.number != number);
    }

    /// What is to be told now. A call over its limit is told of once and forgotten.
    fn look(&mut self, now: Instant) -> Vec<Overdue> {
        let mut overdue = Vec::new();
        self.calls.retain_mut(|call| {
            let waited = now.saturating_duration_since(call.since);
            let (is_over, is_late) = (waited >= call.limit, waited >= call.limit.mul_f64(SILENCE));
            if is_over || is_late && !call.was_told {
                call.was_told = true;
                overdue.push(call.overdue(now));
            }
            !is_over
        });
        overdue
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn call(limit: Limit, since: Instant) -> Call {
        let (owner, limit) = (Owner::new("toaster"), limit.duration());
        Call { number: 0, owner, name: "clFinish", since, limit, was_told: false }
    }

    #[test]
    fn a_call_is_told_of_when_it_is_late_and_when_it_is_over() {
        let start = Instant::now();
        let after = |seconds: u64| start + Duration::from_secs(seconds);
        let mut calls = Calls::default();
        let number = calls.begin(call(Limit::Call, start));
        let other = calls.begin(call(Limit::Build, start));
        calls.lock_step(after(59), &[]);
        calls.lock_step(after(60), &["clFinish has not returned for 60.0 s; after 600.0 s it is given up"]);
        calls.lock_step(after(150), &[]);
        calls.end(other);
        let over = calls.look(after(601));
        assert!(over.len() == 1 && over[0].is_over());
        let error = over[0].error();
        let expected = "device 'toaster': clFinish did not return in 600 s: the driver hangs";
        assert!(error.exit_code() == 4 && error.to_string().starts_with(expected), "{error}");
        calls.lock_step(after(10_000), &[]);
        calls.end(number);
    }

    impl Calls {
        fn lock_step(&mut self, now: Instant, expected: &[&str]) {
            let told: Vec<String> = self.look(now).iter().map(Overdue::to_string).collect();
            assert_eq!(told.len(), expected.len(), "{told:?}");
            assert!(told.iter().zip(expected).all(|(told, expected)| told.contains(expected)), "{told:?}");
        }
    }

    #[test]
    fn a_hang_after_a_failure_tells_the_failure() {
        let start = Instant::now();
        let mut calls = Calls::default();
        let call = call(Limit::Release, start);
        call.owner.remember_failure("clBuildProgram failed: CL_OUT_OF_HOST_MEMORY (-6)");
        call.owner.remember_failure("and more");
        calls.begin(call);
        let text = calls.look(start + RELEASE)[0].error().to_string();
        assert!(text.contains("clBuildProgram failed: CL_OUT_OF_HOST_MEMORY (-6); then clFinish did not"), "{text}");
    }

    #[test]
    fn launches_have_a_thousand_times_their_estimate_and_never_less_than_ten_minutes() {
        let limits = [0.001, 0.6, 5.0, f64::MAX].map(|seconds| Limit::Estimate(seconds).duration());
        assert_eq!(limits, [CALL, CALL, Duration::from_secs(5000), Duration::MAX]);
        assert_eq!(Limit::Estimate(f64::NAN).duration(), Duration::MAX);
    }

    #[test]
    fn the_variable_is_a_number_of_seconds() {
        let of = |text: &str| Override::of_text(Some(text.into()));
        assert_eq!(Override::of_text(None).unwrap(), Override::None);
        assert_eq!([of("").unwrap(), of("0").unwrap()], [Override::None, Override::NoLimit]);
        assert_eq!(of(" 2.5 ").unwrap().apply(Limit::Build), Some(Duration::from_millis(2500)));
        for bad in ["soon", "-1", "NaN", "inf", "1e99"] {
            let error = of(bad).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains(LIMIT_VARIABLE), "{error}");
        }
    }
}
