//! Everything that touches OpenCL: which devices there are, opening one, building programs, buffers and kernels.
//!
//! No other module calls OpenCL. The wrappers turn every failure into an [`Error`] that names the device and the call; none of
//! them panics, also not while it is dropped (see `handle.rs`). What a kernel
//! does inside its buffers is beyond them: a kernel that writes past the end of one is as wild as any C program.
//!
//! ```no_run
//! use raybrook::device::{self, Buffer, CompileOptions, DeviceContext, ProgramSource, Selection};
//!
//! # fn main() -> raybrook::Result<()> {
//! let Selection::OpenCl(handle) = device::select(None)? else { return Ok(()) };
//! let context = DeviceContext::open(&handle)?;
//! let source = ProgramSource::new([("cl/twice.cl", "kernel void twice(global float* x) { x[get_global_id(0)] *= 2.0f; }")]);
//! let built = device::build(&context, &source, &CompileOptions::new(), None)?;
//! let numbers = Buffer::from_slice(&context, "numbers", &[1.0_f32, 2.0])?;
//! let mut twice = built.program.kernel("twice")?;
//! twice.set_arg(0, &numbers)?;
//! let seconds = twice.launch(&[2], None)?.wait()?;
//! assert_eq!(numbers.read()?, [2.0, 4.0]);
//! # Ok(())
//! # }
//! ```

mod adaptive;
mod buffer;
mod cache;
mod compiler_options;
mod definitions;
mod diagnosis;
mod errors;
mod handle;
mod image;
mod kernel;
mod launch;
mod limits;
mod list;
mod passes;
mod program;
mod ptxas;
mod report;
mod resources;
mod rows;
mod scene;
mod select;
mod source;
mod split;
mod tracer;

pub use buffer::Buffer;
pub use cache::{Cache, cache_folder};
pub use diagnosis::{Diagnosis, Problem};
pub use errors::{cl_error, code_hint, code_name};
pub use image::{IMAGE_WIDTH, Image, ImageShape};
pub use kernel::{Event, Kernel, KernelArg};
pub use limits::Limits;
#[cfg(test)]
pub(crate) use list::sample_info;
pub use list::{DeviceHandle, DeviceInfo, DeviceKind, DeviceList, list_devices};
pub use program::{Built, CompileOptions, Program, build};
pub use report::{devices_json, devices_report};
pub use resources::{KernelResources, ProgramResources, kernel_resources};
pub use select::{Selection, select};
pub use source::{KERNEL_FILES, ProgramSource};
pub(crate) use tracer::CompiledAhead;
pub use tracer::OpenClTracer;

use crate::error::{Error, Result};
use handle::Owned;
use opencl3::command_queue::{CL_QUEUE_PROFILING_ENABLE, CommandQueue};
use opencl3::context::Context;
use opencl3::device::Device;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Held while platforms are asked and contexts made: PoCL 3.1 fails when several threads do so at once (7 of 8 runs).
static RUNTIME: Mutex<()> = Mutex::new(());

fn lock_runtime() -> MutexGuard<'static, ()> {
    RUNTIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An opened device: context and command queue. Cheap to clone; buffers, programs and kernels keep it alive.
///
/// Use one at a time on Oclgrind: kernels of several threads are silently lost there (seen with 21.10).
#[derive(Debug, Clone)]
pub struct DeviceContext(Arc<Opened>);

#[derive(Debug)]
struct Opened {
    // In the order in which they are released.
    queue: Owned<CommandQueue>,
    context: Context,
    device: Device,
    info: DeviceInfo,
    /// What the user hands to the compiler.
    compiler_options: String,
    allocated_bytes: AtomicU64,
}

impl DeviceContext {
    /// Opens a device with a queue that runs its commands in order and times them.
    ///
    /// # Errors
    /// [`Error::NoDevice`] when the device is not usable, [`Error::OpenCl`] when the driver refuses.
    pub fn open(handle: &DeviceHandle) -> Result<Self> {
        let info = handle.info.clone();
        if let Some(reason) = &info.unusable {
            return Err(Error::NoDevice(format!("device '{}' cannot be used: {reason}", info.name)));
        }
        let _lock = lock_runtime();
        let fail = |call: &str, error| cl_error(&info.name, call, error);
        let context = Context::from_device(&handle.device).map_err(|e| fail("clCreateContext", e))?;
        // The 1.2 call: clCreateCommandQueueWithProperties does not exist on every driver that offers OpenCL C 1.2.
        #[allow(deprecated)]
        // SAFETY: the device is the one that the context was made for.
        let queue = unsafe { CommandQueue::create(&context, handle.device.id(), CL_QUEUE_PROFILING_ENABLE) };
        let queue = queue.map(Owned::new).map_err(|e| fail("clCreateCommandQueue", e))?;
        Ok(DeviceContext(Arc::new(Opened {
            queue,
            context,
            device: handle.device,
            info,
            compiler_options: handle.compiler_options.clone(),
            allocated_bytes: AtomicU64::new(0),
        })))
    }

    /// What the device says about itself.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// The bytes of all buffers that live on the device now.
    pub fn allocated_bytes(&self) -> u64 {
        self.0.allocated_bytes.load(Ordering::Relaxed)
    }

    /// Waits until every command is done.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver reports that a command failed; some tell only now.
    pub fn finish(&self) -> Result<()> {
        self.0.queue.finish().map_err(|e| self.error("clFinish", e))
    }

    fn error(&self, call: &str, error: opencl3::error_codes::ClError) -> Error {
        cl_error(&self.0.info.name, call, error)
    }
}
