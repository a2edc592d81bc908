//! Processes that were forked from one in which the library has started threads: these, the library's own and those of
//! OpenCL drivers, are not there. What would wait for them is refused; what would only free them is left alone.

use crate::error::raise;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// The process that started threads first.
static PROCESS: AtomicU32 = AtomicU32::new(0);

/// Takes note that this process starts threads from now on.
///
/// # Errors
/// `DeviceError` in a process that was forked from one that did.
pub fn begin(py: Python) -> PyResult<()> {
    let this = std::process::id();
    match PROCESS.compare_exchange(0, this, Ordering::Relaxed, Ordering::Relaxed) {
        Err(first) if first != this => {
            let text = "this process was forked from one that has used raybrook, and threads do not outlive that; \
                        start processes by 'spawn' or 'forkserver' (multiprocessing.set_start_method)";
            Err(raise(py, "DeviceError", text))
        }
        _ => Ok(()),
    }
}

/// Whether the threads that were started are another process's.
pub fn is_forked() -> bool {
    ![0, std::process::id()].contains(&PROCESS.load(Ordering::Relaxed))
}
