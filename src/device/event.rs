//! Commands that were started.

use super::DeviceContext;
use super::handle::Owned;
use super::turns::Turn;
use super::watchdog::{Limit, watch};
use crate::error::{Error, Result};
use crate::parallel::lock;
use opencl3::error_codes::ClError;
use opencl3::event::Event as ClEvent;
use std::sync::Mutex;
use std::time::Instant;

/// A command that was started.
#[derive(Debug)]
#[must_use = "a launch that is not waited for may fail unseen"]
pub struct Event {
    raw: Option<Owned<ClEvent>>,
    call: String,
    context: DeviceContext,
    /// See [`Owner::start_command`](super::owner::Owner::start_command).
    number: u64,
    started: Instant,
    limit: Limit,
    /// Kept until the command has ended.
    turn: Mutex<Option<Turn>>,
}

impl Event {
    pub(super) fn new(context: DeviceContext, call: String, event: ClEvent) -> Self {
        let number = context.0.owner.start_command();
        let raw = Some(Owned::new(event, &context.0.owner));
        Event { raw, number, ..Event::of_nothing(context, call) }
    }

    /// A command that has nothing to do.
    pub(super) fn of_nothing(context: DeviceContext, call: String) -> Self {
        let (started, limit, turn) = (Instant::now(), Limit::Commands, Mutex::default());
        Event { raw: None, call, context, number: 0, started, limit, turn }
    }

    /// The error that a transfer ended with, which the host has waited for, if it did: some drivers return success from
    /// a blocking call that failed.
    pub(super) fn check_transfer(context: DeviceContext, call: String, event: ClEvent) -> Result<()> {
        let raw = Some(Owned::new(event, &context.0.owner));
        let event = Event { raw, ..Event::of_nothing(context, call) };
        event.check()?;
        event.context.0.owner.all_done();
        Ok(())
    }

    /// The same command, which is believed to take so many seconds, where that is known: how long it is waited for
    /// follows from that.
    pub(super) fn estimated(self, seconds: Option<f64>) -> Self {
        Event { limit: seconds.map_or(Limit::Commands, Limit::Estimate), ..self }
    }

    /// The same command, which began in a turn.
    pub(super) fn in_turn(self, turn: Option<Turn>) -> Self {
        Event { turn: Mutex::new(turn), ..self }
    }

    /// Waits until the command is done; the seconds that it ran on the device, by the device's own clock. Where the
    /// device refuses to time its commands ([`DeviceContext::has_clock`]) they are the host's, from when it was
    /// started, the commands before it included.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the command failed; drivers report here what went wrong inside a kernel.
    pub fn wait(&self) -> Result<f64> {
        let Some(event) = &self.raw else { return Ok(0.0) };
        let watched = watch(&self.context.0.owner, "clWaitForEvents", self.limit);
        // Its code only says that some event failed: the event's own status, asked for next, says why.
        let waited = watched.call(|| event.wait());
        *lock(&self.turn) = None;
        self.check()?;
        waited.map_err(|e| self.error_of("clWaitForEvents", e))?;
        self.context.0.owner.command_done(self.number);
        let host_s = self.started.elapsed().as_secs_f64();
        Ok(self.device_s(event).unwrap_or(host_s))
    }

    /// What the device's clock says of a command that is done. A picture needs no times, so a device that refuses them
    /// is none that fails.
    fn device_s(&self, event: &ClEvent) -> Option<f64> {
        const SECONDS_PER_NS: f64 = 1e-9;
        if !self.context.has_clock() {
            return None;
        }
        let _watched = self.context.watch("clGetEventProfilingInfo");
        let times = event.profiling_command_start().and_then(|start| Ok((start, event.profiling_command_end()?)));
        match times {
            Ok((start_ns, end_ns)) => Some(end_ns.saturating_sub(start_ns) as f64 * SECONDS_PER_NS),
            Err(_) => {
                self.context.0.owner.has_no_clock();
                None
            }
        }
    }

    /// The error that the command ended with, if it did.
    fn check(&self) -> Result<()> {
        let Some(event) = &self.raw else { return Ok(()) };
        let _watched = self.context.watch("clGetEventInfo");
        let status = event.command_execution_status().map_err(|e| self.error_of("clGetEventInfo", e))?.0;
        // 0 to 3 are complete, running, submitted and queued.
        if status < 0 { Err(self.context.error(&self.call, ClError(status))) } else { Ok(()) }
    }

    /// The error of a later call about this command.
    pub(super) fn error_of(&self, later: &str, error: ClError) -> Error {
        self.context.error(&format!("{later} after {}", self.call), error)
    }
}
