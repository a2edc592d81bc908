//! A run that is stopped leaves nothing unfinished behind: Ctrl-C, `kill`, a terminal that is closed, a limit of file
//! size.

#[cfg(unix)]
use signal_hook::consts::signal::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What is done before the program ends; by another thread than the one that works.
type LastWork = Box<dyn FnOnce() + Send>;

static LAST_WORK: Mutex<Option<LastWork>> = Mutex::new(None);

fn last_work() -> MutexGuard<'static, Option<LastWork>> {
    LAST_WORK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Has `work` done where the run is stopped from now on, in place of what was to be done so far.
pub fn before_stop(work: impl FnOnce() + Send + 'static) {
    *last_work() = Some(Box::new(work));
}

/// Does now what was to be done where the run is stopped: it ends by itself, but too early.
pub fn work_now() {
    if let Some(work) = last_work().take() {
        work();
    }
}

/// Does `work` in place of what was to be done where the run is stopped; a signal waits for it.
pub fn finish<T>(work: impl FnOnce() -> T) -> T {
    let mut last_work = last_work();
    last_work.take();
    work()
}

/// The exit code of a run that `signal` stopped, as shells have it.
#[cfg(unix)]
fn exit_code(signal: i32) -> i32 {
    const FIRST: i32 = 128;
    FIRST + signal
}

/// Takes care of signals from now on.
#[cfg(unix)]
pub fn watch_signals() -> std::io::Result<()> {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;
    // A signal that is caught lets the write fail, which is an error like any other; by default it ends the program.
    signal_hook::flag::register(SIGXFSZ, Arc::default())?;
    let ignored = ignored_signals();
    let signals: Vec<i32> = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&s| ignored >> (s - 1) & 1 == 0).collect();
    for &signal in &signals {
        // The second one ends the program whatever the first one has led to.
        let is_second = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register_conditional_shutdown(signal, exit_code(signal), is_second.clone())?;
        signal_hook::flag::register(signal, is_second)?;
    }
    let mut waiting = signal_hook::iterator::Signals::new(signals)?;
    let wait = move || {
        if let Some(signal) = waiting.forever().next() {
            stop(signal);
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait).map(drop)
}

#[cfg(not(unix))]
pub fn watch_signals() -> std::io::Result<()> {
    Ok(())
}

/// The signals that whoever started the program wants it to ignore, as `nohup` does with SIGHUP: a bit each.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
}

/// Ends the program.
#[cfg(unix)]
fn stop(signal: i32) {
    // In this order: the last work may write files. The main thread cannot end meanwhile with other work for the same
    // file.
    let mut work = last_work();
    if let Some(work) = work.take() {
        work();
    }
    let _stopped = raybrook::low_level::output::stop();
    tell!("raybrook: stopped by {}", signal_hook::low_level::signal_name(signal).unwrap_or("a signal"));
    super::progress::end_json(exit_code(signal) as u8);
    // At once: a driver may be in the middle of anything, and its own ending could wait for that for ever.
    signal_hook::low_level::exit(exit_code(signal));
}
