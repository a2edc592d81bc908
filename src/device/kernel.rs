//! Kernels: arguments, launches, and how long they took.

use super::buffer::{Buffer, Memory};
use super::errors::{cl_error_with_hint, code_hint};
use super::handle::Owned;
use super::image::{Image, ImageMemory};
use super::watchdog::{Limit, watch};
use super::{DeviceContext, Event};
use crate::error::{Error, Result};
use bytemuck::Pod;
use opencl3::error_codes::ClError;
use opencl3::kernel::{Kernel as ClKernel, set_kernel_arg};
use opencl3::memory::ClMem;
use opencl3::program::Program as ClProgram;
use std::ffi::c_void;
use std::ptr;
use std::sync::Arc;

/// OpenCL's code for a work-group that does not fit.
const INVALID_WORK_GROUP_SIZE: i32 = -54;
/// OpenCL's code for kernel arguments that are not set.
const INVALID_KERNEL_ARGS: i32 = -52;

/// A kernel of a built program with its arguments.
#[derive(Debug)]
pub struct Kernel {
    raw: Owned<ClKernel>,
    name: String,
    context: DeviceContext,
    args: Vec<Slot>,
}

/// What an argument was set to; a kernel does not keep its buffers and images alive by itself.
#[derive(Debug, Clone)]
enum Slot {
    Unset,
    Value,
    Buffer { _memory: Arc<Memory> },
    Image { _memory: Arc<ImageMemory> },
}

/// What can be passed to a kernel: a `&Buffer`, `&Image`, `u32`, `i32`, `f32`, or [`KernelArg::NULL`] for a buffer that
/// is not there.
#[derive(Debug)]
pub struct KernelArg<'a>(Passed<'a>);

#[derive(Debug)]
enum Passed<'a> {
    Buffer(&'a Arc<Memory>),
    Image(&'a Arc<ImageMemory>),
    Word([u8; 4]),
    Null,
}

impl KernelArg<'_> {
    /// A null pointer, for a buffer that the chosen variant does not have.
    pub const NULL: KernelArg<'static> = KernelArg(Passed::Null);
}

impl<'a, T: Pod> From<&'a Buffer<T>> for KernelArg<'a> {
    fn from(buffer: &'a Buffer<T>) -> Self {
        KernelArg(Passed::Buffer(buffer.memory()))
    }
}

impl<'a> From<&'a Image> for KernelArg<'a> {
    fn from(image: &'a Image) -> Self {
        KernelArg(Passed::Image(image.memory()))
    }
}

impl From<u32> for KernelArg<'_> {
    fn from(value: u32) -> Self {
        KernelArg(Passed::Word(value.to_ne_bytes()))
    }
}

impl From<i32> for KernelArg<'_> {
    fn from(value: i32) -> Self {
        KernelArg(Passed::Word(value.to_ne_bytes()))
    }
}

impl From<f32> for KernelArg<'_> {
    fn from(value: f32) -> Self {
        KernelArg(Passed::Word(value.to_ne_bytes()))
    }
}

impl Kernel {
    /// The kernel of this name of a program that was built for the device of `context`.
    pub(super) fn create(context: &DeviceContext, program: &ClProgram, name: &str) -> Result<Self> {
        let fail = |call: &str, error| context.error(&format!("{call} '{name}'"), error);
        let watched = context.watch("clCreateKernel");
        let raw = ClKernel::create(program, name).map(|raw| Owned::new(raw, &context.0.owner));
        let raw = raw.map_err(|e| fail("clCreateKernel", e))?;
        let count = raw.num_args().map_err(|e| fail("clGetKernelInfo of", e))?;
        drop(watched);
        let args = vec![Slot::Unset; count as usize];
        Ok(Kernel { raw, name: name.to_owned(), context: context.clone(), args })
    }

    /// The kernel's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How many arguments it takes.
    pub fn arg_count(&self) -> usize {
        self.args.len()
    }

    /// Sets argument number `index`, counted from 0. The kernel keeps a buffer's memory alive until it is set anew.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the kernel has no such argument or the driver finds that the value does not fit it.
    pub fn set_arg<'a>(&mut self, index: usize, value: impl Into<KernelArg<'a>>) -> Result<()> {
        const INVALID_ARG_INDEX: i32 = -49;
        let call = || format!("clSetKernelArg {index} of '{}'", self.name);
        if index >= self.args.len() {
            let hint =
                format!("the kernel has {} arguments; this is a bug in raybrook, please report it", self.args.len());
            return Err(cl_error_with_hint(&self.context.info().name, &call(), INVALID_ARG_INDEX, hint));
        }
        let value = value.into();
        let (bytes, slot): (&[u8], _) = match &value.0 {
            Passed::Buffer(memory) => {
                (&(memory.raw.get() as usize).to_ne_bytes(), Slot::Buffer { _memory: Arc::clone(memory) })
            }
            Passed::Image(memory) => {
                (&(memory.raw.get() as usize).to_ne_bytes(), Slot::Image { _memory: Arc::clone(memory) })
            }
            Passed::Word(word) => (word, Slot::Value),
            Passed::Null => (&0_usize.to_ne_bytes(), Slot::Value),
        };
        let _watched = self.context.watch("clSetKernelArg");
        // SAFETY: the driver copies `bytes` before it returns and checks index and size against the kernel's signature;
        // a buffer's memory lives as long as the slot that is filled below.
        let result =
            unsafe { set_kernel_arg(self.raw.get(), index as u32, bytes.len(), bytes.as_ptr().cast::<c_void>()) };
        result.map_err(|code| self.context.error(&call(), ClError(code)))?;
        self.args[index] = slot;
        Ok(())
    }

    /// Starts `global` work items (1 to 3 dimensions) in work-groups of `local`, or of the driver's choice.
    ///
    /// Returns at once; [`Event::wait`] tells when it is done. No work items at all is an event that is already over.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when an argument was not set, the work-group does not fit, or the driver refuses otherwise;
    /// [`Error::Stopped`] when the context is stopped.
    ///
    /// # Panics
    /// When `global` has not 1 to 3 dimensions or `local` has another number of them.
    pub fn launch(&self, global: &[usize], local: Option<&[usize]>) -> Result<Event> {
        assert!((1..=3).contains(&global.len()), "work items have 1 to 3 dimensions, not {}", global.len());
        assert!(local.is_none_or(|l| l.len() == global.len()), "work-groups have as many dimensions as work items");
        self.context.check_stop()?;
        let call =
            format!("clEnqueueNDRangeKernel of '{}' with {global:?} work items in groups of {local:?}", self.name);
        let device = &self.context.info().name;
        if let Some(unset) = self.args.iter().position(|slot| matches!(slot, Slot::Unset)) {
            let hint = format!("argument {unset} was never set; this is a bug in raybrook, please report it");
            return Err(cl_error_with_hint(device, &call, INVALID_KERNEL_ARGS, hint));
        }
        if global.contains(&0) {
            return Ok(Event::of_nothing(self.context.clone(), call));
        }
        let turn = self.context.take_turn()?;
        let local_sizes = local.map_or(ptr::null(), <[usize]>::as_ptr);
        // PoCL compiles kernels once more when they are started; simulators may run them at once.
        let watched = watch(&self.context.0.owner, "clEnqueueNDRangeKernel", Limit::Commands);
        let (raw, dimensions) = (self.raw.get(), global.len() as u32);
        let queue = &self.context.0.queue;
        // SAFETY: all arguments are set and alive, both size arrays have as many elements as there are dimensions.
        let event = watched.call(|| unsafe {
            queue.enqueue_nd_range_kernel(raw, dimensions, ptr::null(), global.as_ptr(), local_sizes, &[])
        });
        let event = event.map_err(|e| match (e.0, self.max_work_group_size()) {
            (INVALID_WORK_GROUP_SIZE, Ok(limit)) => {
                let hint = format!("{}: at most {limit} items, and a divisor of the work items", code_hint(e.0));
                cl_error_with_hint(device, &call, e.0, hint)
            }
            _ => self.context.error(&call, e),
        })?;
        let event = Event::new(self.context.clone(), call, event).in_turn(turn);
        let watched = watch(&self.context.0.owner, "clFlush", Limit::Commands);
        // Without this some drivers do not start before somebody waits, and the host's work would not overlap.
        watched.call(|| self.context.0.queue.flush()).map_err(|e| event.error_of("clFlush", e))?;
        Ok(event)
    }

    /// `CL_KERNEL_WORK_GROUP_SIZE`: the most work items in a work-group of this kernel.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver does not tell.
    pub fn max_work_group_size(&self) -> Result<usize> {
        self.raw
            .get_work_group_size(self.context.0.device.id())
            .map_err(|e| self.info_error("CL_KERNEL_WORK_GROUP_SIZE", e))
    }

    /// `CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE`: warp, wavefront or vector width.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver does not tell.
    pub fn preferred_work_group_multiple(&self) -> Result<usize> {
        let multiple = self.raw.get_work_group_size_multiple(self.context.0.device.id());
        multiple.map_err(|e| self.info_error("CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE", e))
    }

    /// `CL_KERNEL_PRIVATE_MEM_SIZE`: bytes of private memory of one work item, as far as the driver counts them.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver does not tell.
    pub fn private_memory_bytes(&self) -> Result<u64> {
        self.raw
            .get_private_mem_size(self.context.0.device.id())
            .map_err(|e| self.info_error("CL_KERNEL_PRIVATE_MEM_SIZE", e))
    }

    /// `CL_KERNEL_LOCAL_MEM_SIZE`: bytes of local memory of a work-group.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver does not tell.
    pub fn local_memory_bytes(&self) -> Result<u64> {
        self.raw
            .get_local_mem_size(self.context.0.device.id())
            .map_err(|e| self.info_error("CL_KERNEL_LOCAL_MEM_SIZE", e))
    }

    fn info_error(&self, query: &str, error: ClError) -> Error {
        self.context.error(&format!("clGetKernelWorkGroupInfo ({query}) of '{}'", self.name), error)
    }
}
