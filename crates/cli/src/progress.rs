//! How far work is that takes longer than a moment: a bar on the terminal, or lines of JSON for programs that wrap this
//! one.

use super::{Talk, print};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::IsTerminal;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Work that is done sooner shows no bar.
const PATIENCE: Duration = Duration::from_secs(1);
const STEPS: u64 = 1000;

/// Lines of JSON are at least so far apart.
const PACE: Duration = Duration::from_millis(250);

/// How progress is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Form {
    /// A bar, where standard error is a terminal
    Bar,
    /// A JSON object a line on standard error, for other programs; messages are such lines, too
    Json,
}

/// A line of JSON; the book's page "Programs that wrap this one" is its description.
#[derive(Debug, Serialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum Event<'a> {
    /// A task begins.
    Start { task: &'a str },
    /// Part of a task is done.
    Progress {
        task: &'a str,
        /// 0 to 1.
        done: f64,
        elapsed_s: f64,
        /// As it looks.
        left_s: Option<f64>,
        /// How much is done a second, in the unit.
        rate: f64,
        unit: &'a str,
    },
    /// A task has ended, done or failed.
    End { task: &'a str, elapsed_s: f64 },
    /// What is told to people otherwise.
    Message { text: &'a str },
    /// The program ends.
    Done { exit_code: u8, elapsed_s: f64 },
}

/// When the program began to tell events.
static BEGINNING: OnceLock<Instant> = OnceLock::new();

/// Has everything on standard error be JSON from now on.
pub fn begin_json() {
    BEGINNING.get_or_init(Instant::now);
}

/// Whether it is.
pub fn is_json() -> bool {
    BEGINNING.get().is_some()
}

/// Tells that the program ends with `exit_code`, if events are told.
pub fn end_json(exit_code: u8) {
    if let Some(beginning) = BEGINNING.get() {
        print::event(&Event::Done { exit_code, elapsed_s: beginning.elapsed().as_secs_f64() });
    }
}

/// A bar that appears after a second, and only when stderr is a terminal and nobody asked for quiet; or lines of JSON.
pub struct Bar {
    start: Instant,
    what: String,
    shown: bool,
    bar: OnceLock<ProgressBar>,
    /// When it was last told how much is done, in nanoseconds from the start.
    told_ns: AtomicU64,
}

impl Bar {
    /// A bar for work named `what`.
    pub fn new(what: impl Into<String>, talk: Talk) -> Bar {
        let what = what.into();
        if is_json() {
            print::event(&Event::Start { task: &what });
        }
        let shown = !talk.quiet && std::io::stderr().is_terminal();
        Bar { start: Instant::now(), what, shown, bar: OnceLock::new(), told_ns: AtomicU64::default() }
    }

    /// Shows that the part `done` (0..=1) is done; `units` is how much work there is, for the rate.
    pub fn update(&self, done: f64, units: f64, unit: &str) {
        let elapsed = self.start.elapsed();
        if is_json() {
            self.tell(done, done * units / elapsed.as_secs_f64(), unit, elapsed);
        } else if self.shown && elapsed >= PATIENCE {
            self.draw(done, format!("{:.1} {unit}/s", done * units / elapsed.as_secs_f64()), elapsed);
        }
    }

    fn draw(&self, done: f64, rate: String, elapsed: Duration) {
        let bar = self.bar.get_or_init(|| {
            let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr()).with_elapsed(elapsed);
            let style = ProgressStyle::with_template("{prefix} [{bar:30}] {percent:>3} % {msg}, {eta} left");
            bar.set_style(style.expect("the template is a constant").progress_chars("=> "));
            bar.set_prefix(print::escaped(&self.what).into_owned());
            bar
        });
        bar.set_message(rate);
        bar.set_position((done * STEPS as f64) as u64);
    }

    fn tell(&self, done: f64, rate: f64, unit: &str, elapsed: Duration) {
        let (now, last) = (elapsed.as_nanos() as u64, self.told_ns.load(Ordering::Relaxed));
        let is_due = now >= last.saturating_add(PACE.as_nanos() as u64);
        // Of several threads that find it due one tells.
        if !is_due || self.told_ns.compare_exchange(last, now, Ordering::Relaxed, Ordering::Relaxed).is_err() {
            return;
        }
        let elapsed_s = elapsed.as_secs_f64();
        let left_s = (done > 0.0).then(|| elapsed_s * (1.0 - done) / done);
        print::event(&Event::Progress { task: &self.what, done, elapsed_s, left_s, rate, unit });
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if is_json() {
            print::event(&Event::End { task: &self.what, elapsed_s: self.start.elapsed().as_secs_f64() });
        }
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
