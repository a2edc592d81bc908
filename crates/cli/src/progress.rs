//! A progress bar on the terminal, for work that takes longer than a moment.

use super::{Talk, print};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Work that is done sooner shows no bar.
const PATIENCE: Duration = Duration::from_secs(1);
const STEPS: u64 = 1000;

/// A bar that appears after a second, and only when stderr is a terminal and nobody asked for quiet.
pub struct Bar {
    start: Instant,
    what: String,
    shown: bool,
    bar: OnceLock<ProgressBar>,
}

impl Bar {
    /// A bar for work named `what`.
    pub fn new(what: impl Into<String>, talk: Talk) -> Bar {
        let shown = !talk.quiet && std::io::stderr().is_terminal();
        let what = print::escaped(&what.into()).into_owned();
        Bar { start: Instant::now(), what, shown, bar: OnceLock::new() }
    }

    /// Shows that the part `done` (0..=1) is done; `units` is how much work there is, for the rate.
    pub fn update(&self, done: f64, units: f64, unit: &str) {
        let elapsed = self.start.elapsed();
        if !self.shown || elapsed < PATIENCE {
            return;
        }
        let bar = self.bar.get_or_init(|| {
            let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr()).with_elapsed(elapsed);
            let style = ProgressStyle::with_template("{prefix} [{bar:30}] {percent:>3} % {msg}, {eta} left");
            bar.set_style(style.expect("the template is a constant").progress_chars("=> "));
            bar.set_prefix(self.what.clone());
            bar
        });
        bar.set_message(format!("{:.1} {unit}/s", done * units / elapsed.as_secs_f64()));
        bar.set_position((done * STEPS as f64) as u64);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
