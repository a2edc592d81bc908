//! A device to open, and the opened one.

use super::errors::cl_error;
use super::handle::Owned;
use super::kept_programs::KeptPrograms;
use super::owner::Owner;
use super::staging::{STAGING_BYTES, Staging};
use super::turns::{Turn, Turns};
use super::watchdog::{Limit, Watched, watch};
use crate::device_info::{DeviceInfo, DeviceKind};
use crate::error::{Error, Result};
use opencl3::command_queue::{CL_QUEUE_PROFILING_ENABLE, CommandQueue, create_command_queue};
use opencl3::context::Context;
use opencl3::device::Device;
use opencl3::error_codes::ClError;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Held while platforms are asked and contexts made: PoCL 3.1 fails when several threads do so at once (7 of 8 runs).
static RUNTIME: Mutex<()> = Mutex::new(());

pub(super) fn lock_runtime() -> MutexGuard<'static, ()> {
    RUNTIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A device and the OpenCL objects to open it with.
#[derive(Debug, Clone)]
pub struct DeviceHandle {
    /// What the device says about itself.
    pub info: DeviceInfo,
    device: Device,
    /// See [`DeviceHandle::with_compiler_options`].
    pub(super) compiler_options: String,
    /// See [`DeviceHandle::ask_host`].
    pub(super) asks_host: bool,
    /// The device, opened already; whoever opens it next has it.
    opened: Arc<Mutex<Option<DeviceContext>>>,
}

impl DeviceHandle {
    /// Of a device that nobody has opened.
    pub(super) fn new(info: DeviceInfo, device: Device) -> Self {
        DeviceHandle { info, device, compiler_options: String::new(), asks_host: false, opened: Arc::default() }
    }

    /// Keeps the opened device for whoever opens it next.
    pub(super) fn keep_opened(&self, context: DeviceContext) {
        *self.opened.lock().unwrap_or_else(PoisonError::into_inner) = Some(context);
    }

    /// The opened device, if it was kept and has the same options for the compiler.
    pub(super) fn take_opened(&self) -> Option<DeviceContext> {
        let kept = self.opened.lock().unwrap_or_else(PoisonError::into_inner).take();
        kept.filter(|context| context.0.compiler_options == self.compiler_options)
    }
}

/// What those share who have a device open, by the device's id.
static SHARED: Mutex<Vec<(usize, Weak<Shared>)>> = Mutex::new(Vec::new());

/// An opened device: context and command queue. Cheap to clone; buffers, programs and kernels keep it alive.
///
/// Who opens the same device meanwhile has a queue of its own, and shares the context and the compiled programs: on an
/// H100 both together take a fifth of a second.
///
/// Use one at a time on Oclgrind: kernels of several threads are silently lost there (seen with 21.10).
#[derive(Debug, Clone)]
pub struct DeviceContext(pub(super) Arc<Opened>);

/// Pinned memory, once there is some.
type Pinned = Mutex<Option<Staging>>;

#[derive(Debug)]
pub(super) struct Opened {
    /// Memory for large transfers, and for what streams, once it pays; released first.
    staging: Pinned,
    streaming: Pinned,
    /// From how many bytes on that is so, and how many were transferred.
    staged_from: AtomicU64,
    transferred: AtomicU64,
    // In the order in which they are released.
    pub queue: Owned<CommandQueue>,
    pub shared: Arc<Shared>,
    pub owner: Arc<Owner>,
    pub device: Device,
    pub info: DeviceInfo,
    /// What the user hands to the compiler.
    pub compiler_options: String,
    pub allocated_bytes: AtomicU64,
    /// What stops commands from being started, if something may.
    pub stop: Mutex<Option<Arc<AtomicBool>>>,
}

impl Drop for Opened {
    fn drop(&mut self) {
        for pinned in [&mut self.staging, &mut self.streaming] {
            let memory = pinned.get_mut().unwrap_or_else(PoisonError::into_inner).take();
            memory.into_iter().for_each(|memory| memory.release(&self.queue));
        }
    }
}

/// What a GPU has transferred in large transfers before memory is pinned for them: one or two pictures are not worth
/// it.
const STAGED_FROM: u64 = 128 << 20;
/// What is a large transfer.
const LEAST_STAGED: usize = STAGING_BYTES;

/// What those share who have the same device open.
#[derive(Debug)]
pub(super) struct Shared {
    // In the order in which they are released.
    pub programs: Mutex<KeptPrograms>,
    pub context: Owned<Context>,
    /// Whether a call failed: who opens the device next is to have a context that nothing has happened to.
    pub has_failed: AtomicBool,
    /// Whose kernels run, where that is one queue at a time.
    turns: Option<Arc<Turns>>,
}

impl Shared {
    /// Of a device that is open already, unless a call failed there; else a new one.
    fn of(handle: &DeviceHandle) -> Result<Arc<Self>> {
        let mut known = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, shared)| shared.strong_count() > 0);
        let id = handle.device.id() as usize;
        let of_device = known.iter().filter(|(device, _)| *device == id);
        let mut open = of_device.filter_map(|(_, shared)| shared.upgrade());
        if let Some(shared) = open.find(|shared| !shared.has_failed.load(Ordering::Relaxed)) {
            return Ok(shared);
        }
        let made = Arc::new(Shared::new(handle)?);
        known.push((id, Arc::downgrade(&made)));
        Ok(made)
    }

    fn new(handle: &DeviceHandle) -> Result<Self> {
        let owner = Owner::new(&handle.info.name);
        let watched = watch(&owner, "clCreateContext", Limit::Call);
        let context = Context::from_device(&handle.device).map(|context| Owned::new(context, &owner));
        drop(watched);
        let context = context.map_err(|e| cl_error(&handle.info.name, "clCreateContext", e))?;
        let turns = handle.info.is_pocl().then(Arc::default);
        Ok(Shared { programs: Mutex::default(), context, has_failed: AtomicBool::new(false), turns })
    }
}

/// What a driver answers that has no queues of that kind.
const NO_SUCH_QUEUE: [i32; 2] = [-35, -30];

/// opencl3 keeps this number with a queue and never looks at it.
const DIMENSIONS: u32 = 3;

impl DeviceContext {
    /// Opens a device with a queue that runs its commands in order and times them, where the device does that.
    ///
    /// # Errors
    /// [`Error::NoDevice`] when the device is not usable, [`Error::OpenCl`] when the driver refuses.
    pub fn open(handle: &DeviceHandle) -> Result<Self> {
        if let Some(opened) = handle.take_opened() {
            return Ok(opened);
        }
        let info = handle.info.clone();
        if let Some(reason) = &info.unusable {
            return Err(Error::NoDevice(format!("device '{}' cannot be used: {reason}", info.name)));
        }
        let _lock = lock_runtime();
        let shared = Shared::of(handle)?;
        let owner = Owner::new(&info.name);
        let queue = create_queue(&owner, &shared.context, &handle.device);
        let queue = queue.map_err(|e| cl_error(&info.name, "clCreateCommandQueue", e))?;
        // Whose memory is the host's has nothing to gain.
        let watched = watch(&owner, "clGetDeviceInfo", Limit::Call);
        let gains = info.kind == DeviceKind::Gpu && handle.device.host_unified_memory() == Ok(false);
        drop(watched);
        Ok(DeviceContext(Arc::new(Opened {
            staging: Pinned::default(),
            streaming: Pinned::default(),
            staged_from: AtomicU64::new(if gains { STAGED_FROM } else { u64::MAX }),
            transferred: AtomicU64::new(0),
            queue,
            shared,
            owner,
            device: handle.device,
            info,
            compiler_options: handle.compiler_options.clone(),
            allocated_bytes: AtomicU64::new(0),
            stop: Mutex::default(),
        })))
    }

    /// What the device says about itself.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// Whether the device times its commands. Some drivers refuse that only when they are asked for the first time;
    /// until then it is so.
    pub fn has_clock(&self) -> bool {
        self.0.owner.has_clock()
    }

    /// The bytes of all buffers that live on the device now.
    pub fn allocated_bytes(&self) -> u64 {
        self.0.allocated_bytes.load(Ordering::Relaxed)
    }

    /// Has all large transfers go through pinned memory, whatever the device. A GPU does so by itself once it pays.
    pub fn stage_transfers(&self) {
        self.0.staged_from.store(0, Ordering::Relaxed);
    }

    /// Has `transfer` done through pinned memory, if that is sooner for so many bytes; else it is not called.
    pub(super) fn staged<T>(&self, bytes: usize, transfer: impl FnOnce(&mut Staging) -> T) -> Option<T> {
        self.pinned(&self.0.staging, (STAGING_BYTES, bytes), transfer)
    }

    /// The same with so much pinned memory of its own.
    pub(super) fn streamed<T>(
        &self,
        memory_and_bytes: (usize, usize),
        stream: impl FnOnce(&mut Staging) -> T,
    ) -> Option<T> {
        self.pinned(&self.0.streaming, memory_and_bytes, stream)
    }

    fn pinned<T>(
        &self,
        pinned: &Pinned,
        (memory, bytes): (usize, usize),
        transfer: impl FnOnce(&mut Staging) -> T,
    ) -> Option<T> {
        let Opened { staged_from, transferred, queue, shared, owner, .. } = &*self.0;
        if bytes < LEAST_STAGED {
            return None;
        }
        let all = transferred.fetch_add(bytes as u64, Ordering::Relaxed).saturating_add(bytes as u64);
        if all < staged_from.load(Ordering::Relaxed) {
            return None;
        }
        let mut pinned = pinned.lock().unwrap_or_else(PoisonError::into_inner);
        if pinned.is_none() {
            *pinned = Staging::new(&shared.context, queue, owner, memory);
        }
        let Some(memory) = &mut *pinned else {
            // The driver does not: nobody asks again.
            staged_from.store(u64::MAX, Ordering::Relaxed);
            return None;
        };
        Some(transfer(memory))
    }

    /// Forgets compiled programs, so that the next ones are compiled, or loaded from a cache, as by a new process.
    pub fn forget_programs(&self) {
        self.0.shared.programs.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Has launches fail with [`Error::Stopped`] while `stop` is true, in place of the flag that did so before.
    pub(super) fn stop_when(&self, stop: Arc<AtomicBool>) {
        *self.stop_flag() = Some(stop);
    }

    /// Whether something may stop it.
    pub(super) fn is_stoppable(&self) -> bool {
        self.stop_flag().is_some()
    }

    /// Refuses to go on where it is stopped.
    pub(super) fn check_stop(&self) -> Result<()> {
        let is_stopped = self.stop_flag().as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed));
        if is_stopped { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Waits until a kernel may be started, where only one queue's run at a time.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub(super) fn take_turn(&self) -> Result<Option<Turn>> {
        let Some(turns) = &self.0.shared.turns else { return Ok(None) };
        turns.take(Arc::as_ptr(&self.0) as usize, || self.check_stop())
    }

    fn stop_flag(&self) -> MutexGuard<'_, Option<Arc<AtomicBool>>> {
        self.0.stop.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until every command is done.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver reports that a command failed; some tell only now.
    pub fn finish(&self) -> Result<()> {
        let _watched = self.watch_transfer("clFinish");
        self.0.queue.finish().map_err(|e| self.error("clFinish", e))?;
        self.0.owner.all_done();
        Ok(())
    }

    /// Watches a call that does not wait for commands.
    pub(super) fn watch(&self, call: &'static str) -> Watched {
        watch(&self.0.owner, call, Limit::Call)
    }

    /// Watches a call that waits for all commands.
    pub(super) fn watch_transfer(&self, call: &'static str) -> Watched {
        watch(&self.0.owner, call, if self.0.owner.is_busy() { Limit::Commands } else { Limit::Call })
    }

    pub(super) fn error(&self, call: &str, error: ClError) -> Error {
        let error = cl_error(&self.0.info.name, call, error);
        if let Error::OpenCl { call, code, .. } = &error {
            self.0.owner.remember_failure(&format!("{call} failed: {code}"));
            self.0.shared.has_failed.store(true, Ordering::Relaxed);
        }
        error
    }
}

/// A queue that times its commands, or else one that does not.
fn create_queue(
    owner: &Arc<Owner>,
    context: &Context,
    device: &Device,
) -> std::result::Result<Owned<CommandQueue>, ClError> {
    let _watched = watch(owner, "clCreateCommandQueue", Limit::Call);
    // The 1.2 call: clCreateCommandQueueWithProperties does not exist on every driver that offers OpenCL C 1.2.
    #[allow(deprecated)]
    // SAFETY: the device is the one that the context was made for.
    let create = |properties| unsafe { create_command_queue(context.get(), device.id(), properties) };
    let mut queue = create(CL_QUEUE_PROFILING_ENABLE);
    if queue.is_err_and(|code| NO_SUCH_QUEUE.contains(&code)) {
        owner.has_no_clock();
        queue = create(0);
    }
    Ok(Owned::new(CommandQueue::new(queue?, DIMENSIONS), owner))
}
