//! Everything that touches OpenCL: which devices there are, opening one, building programs, buffers and kernels.
//!
//! No other module calls OpenCL. The wrappers turn every failure into an [`Error`] that names the device and the call;
//! none of them panics, also not while it is dropped (see `handle.rs`). What a kernel does inside its buffers is beyond
//! them: a kernel that writes past the end of one is as wild as any C program.
//!
//! ```no_run
//! use raybrook::low_level::device::{self, Buffer, CompileOptions, DeviceContext, ProgramSource, Selection};
//!
//! # fn main() -> raybrook::Result<()> {
//! let Selection::OpenCl(handle) = device::select(None)? else { return Ok(()) };
//! let context = DeviceContext::open(&handle)?;
//! let text = "kernel void twice(global float* x) { x[get_global_id(0)] *= 2.0f; }";
//! let source = ProgramSource::new([("cl/twice.cl", text)]);
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
mod all_hits;
mod batch;
mod buffer;
mod cache;
mod compiler_options;
mod context;
mod defaults;
mod deferred;
mod definitions;
mod diagnosis;
mod entry;
mod errors;
mod event;
mod handle;
mod image;
mod in_place;
mod kept_programs;
mod kernel;
mod launch;
mod limits;
mod list;
mod on_host;
mod owner;
mod passes;
mod picture;
mod points;
mod program;
mod ptxas;
mod report;
mod resources;
mod rows;
mod scene;
mod select;
mod source;
mod staging;
mod stream;
mod tracer;
mod turns;
mod watchdog;
mod wavefront;

pub use crate::device_info::{DeviceInfo, DeviceKind};
pub use buffer::Buffer;
pub use cache::{Cache, CacheKey, cache_folder};
pub use context::{DeviceContext, DeviceHandle};
pub(crate) use defaults::{who_decides, work_group_size};
pub use diagnosis::{Diagnosis, Problem};
pub use errors::{cl_error, code_hint, code_name};
pub use event::Event;
pub use image::{IMAGE_WIDTH, Image, ImageShape};
pub use kernel::{Kernel, KernelArg};
pub use limits::Limits;
pub use list::{DeviceList, list_devices};
pub use program::{Built, CompileOptions, Program, build};
pub use report::{devices_json, devices_report};
pub use resources::{KernelResources, Looked, ProgramResources, kernel_resources};
pub use select::{Selection, select, select_several, select_working};
pub use source::{KERNEL_FILES, ProgramSource};
pub(crate) use tracer::CompiledAhead;
pub use tracer::OpenClBackend;
pub use watchdog::{Overdue, watch_driver};
