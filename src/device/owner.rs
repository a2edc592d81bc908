//! What the objects of an opened device share: its name, and how it fares.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// What the objects of an opened device share: its name, and how it fares.
#[derive(Debug)]
pub(super) struct Owner {
    pub device: String,
    /// What failed first.
    failure: OnceLock<String>,
    /// How many commands were started, and how many of them, from the first one on, are known to be done.
    started: AtomicU64,
    done: AtomicU64,
    /// Whether the device times its commands.
    has_clock: AtomicBool,
}

impl Owner {
    pub fn new(device: &str) -> Arc<Self> {
        Arc::new(Owner {
            device: device.to_owned(),
            failure: OnceLock::new(),
            started: AtomicU64::new(0),
            done: AtomicU64::new(0),
            has_clock: AtomicBool::new(true),
        })
    }

    /// Remembers a failure, if it is the first.
    pub fn remember_failure(&self, failure: &str) {
        self.failure.get_or_init(|| failure.to_owned());
    }

    pub fn failure(&self) -> Option<&String> {
        self.failure.get()
    }

    /// A command was started. Its number, counted from 1.
    pub fn start_command(&self) -> u64 {
        self.started.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// The command of that number is done, and so are those before it: the queue runs them in their order.
    pub fn command_done(&self, number: u64) {
        self.done.fetch_max(number, Ordering::Relaxed);
    }

    /// Whatever was started until now is done.
    pub fn all_done(&self) {
        self.command_done(self.started.load(Ordering::Relaxed));
    }

    /// Whether commands may still be running.
    pub fn is_busy(&self) -> bool {
        self.done.load(Ordering::Relaxed) < self.started.load(Ordering::Relaxed)
    }

    pub fn has_clock(&self) -> bool {
        self.has_clock.load(Ordering::Relaxed)
    }

    pub fn has_no_clock(&self) {
        self.has_clock.store(false, Ordering::Relaxed);
    }
}
