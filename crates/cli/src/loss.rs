//! Devices that fail in the middle of their work, and who goes on in their place.

use super::flags::in_flags;
use super::limit::Limit;
use super::open::Opened;
use super::progress::Bar;
use super::{Talk, chain, end, heading};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::renderer::{FallBack, OnLoss};
use raybrook::low_level::several::{Takeover, Watcher};
use raybrook::low_level::tracer::LostDevice;
use raybrook::{Error, Result};
use std::sync::{Mutex, PoisonError};

#[derive(Clone, Copy, clap::Args)]
pub struct LossArgs {
    /// End with code 4 where a device fails in the middle of its work.
    ///
    /// Without it the other devices go on, or the reference where none is left, with the same bits and a note. What was
    /// kept until then stays either way. Where work is counted or timed, a device that fails always ends the run.
    #[arg(long, hide_short_help = true, help_heading = heading::DEVICE)]
    strict_device: bool,
}

impl LossArgs {
    /// The same, where what is asked for is to be told of the device itself.
    pub fn strict_if(self, is_strict: bool) -> LossArgs {
        LossArgs { strict_device: self.strict_device || is_strict }
    }

    /// Whether the run ends where a device fails.
    pub fn is_strict(self) -> bool {
        self.strict_device
    }

    /// Has the reference go on where `device`, on which this was opened, fails.
    pub fn guard(self, opened: Opened, device: Option<&DeviceHandle>, talk: Talk) -> Opened {
        if self.strict_device || device.is_none() {
            return opened;
        }
        let on_loss: OnLoss = Box::new(move |lost: &LostDevice| {
            end::lost_a_device();
            if !talk.quiet {
                tell_reference(&lost.device, &in_flags(&lost.error));
            }
        });
        let Opened { buffers, tracer, stats } = opened;
        Opened { tracer: Box::new(FallBack::new(tracer, &buffers, on_loss)), buffers, stats }
    }
}

/// Says that the reference goes on in place of a device that failed.
fn tell_reference(name: &str, why: &str) {
    tell!(
        "note: the reference goes on in place of '{name}', which failed: {why}; --strict-device ends the run instead"
    );
}

/// Tells how far several devices are, and which of them fail.
pub struct Watching {
    bar: Bar,
    /// How much work there is, in these units.
    work: (f64, &'static str),
    loss: LossArgs,
    limit: Limit,
    talk: Talk,
    /// The devices that failed.
    lost: Mutex<Vec<LostDevice>>,
}

impl Watching {
    pub fn new(bar: Bar, work: (f64, &'static str), (loss, limit): (LossArgs, Limit), talk: Talk) -> Watching {
        Watching { bar, work, loss, limit, talk, lost: Mutex::default() }
    }

    /// The devices that failed.
    pub fn into_lost(self) -> Vec<LostDevice> {
        self.lost.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Watcher for Watching {
    fn progress(&self, done: f64) {
        self.bar.update(done, self.work.0, self.work.1);
    }

    fn is_over(&self) -> bool {
        self.limit.is_over()
    }

    fn lost(&self, (_, name): (usize, &str), error: Error, takeover: Takeover) -> Result<()> {
        if self.loss.strict_device {
            return Err(error);
        }
        end::lost_a_device();
        let why = chain(&error);
        match takeover {
            _ if self.talk.quiet => {}
            Takeover::OtherDevices => tell!("note: the other devices go on without '{name}', which failed: {why}"),
            Takeover::LastResort => tell_reference(name, &why),
        }
        let lost = LostDevice { device: name.to_owned(), error: error.to_string() };
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).push(lost);
        Ok(())
    }
}
