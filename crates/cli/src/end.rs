//! How the program ends when a device failed: with the documented code, and without the exit handlers of its driver.

use super::code::Code;
use super::{Talk, stop};
use raybrook::Error;
use raybrook::low_level::device::watch_driver;
use std::ffi::c_int;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

unsafe extern "C" {
    /// Ends the process without exit handlers.
    fn _exit(code: c_int) -> !;
}

/// Whether a device failed while others went on.
static LOST_A_DEVICE: AtomicBool = AtomicBool::new(false);

/// A device failed, and the run goes on without it.
pub fn lost_a_device() {
    LOST_A_DEVICE.store(true, Ordering::Relaxed);
}

/// The exit code of a run that is at its end. Where a device failed on the way, the process ends here.
pub fn leave(code: Code) -> Code {
    if LOST_A_DEVICE.load(Ordering::Relaxed) {
        end_now(code);
    }
    code
}

/// Prints the chain of errors and gives the documented code, after which the process ends.
pub fn fail(error: &Error) -> Code {
    const DEVICE: u8 = 4;
    let code = super::print::error(error);
    if error.exit_code() == DEVICE {
        end_now(DEVICE);
    }
    code
}

/// Has calls of drivers that hang end the process; says before that that they take long.
pub fn watch_drivers(talk: Talk) -> Result<(), Error> {
    watch_driver(move |overdue| {
        if overdue.is_over() {
            fail(&overdue.error());
        } else if !talk.quiet {
            tell!("note: {overdue}");
        }
    })
}

/// Ends the process. A driver that failed may hang or crash in its exit handlers: kernels may still be running, locks
/// taken.
fn end_now(code: u8) -> ! {
    stop::work_now();
    let _stopped = raybrook::low_level::output::stop();
    let _ = std::io::stdout().flush();
    super::progress::end_json(code);
    // SAFETY: it takes a number and does not return.
    unsafe { _exit(c_int::from(code)) }
}
