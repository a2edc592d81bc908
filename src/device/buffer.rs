//! Typed buffers in the device's memory.

use super::handle::Owned;
use super::staging::{PART_BYTES, Staging};
use super::watchdog::{Limit, Watched, watch};
use super::{DeviceContext, Event};
use crate::error::{Error, Result};
use crate::parallel;
use bytemuck::Pod;
use opencl3::command_queue::enqueue_write_buffer;
use opencl3::error_codes::{CL_MAP_FAILURE, ClError};
use opencl3::memory::{Buffer as ClBuffer, CL_MAP_READ, CL_MAP_WRITE, CL_MEM_READ_ONLY, CL_MEM_READ_WRITE, ClMem};
use opencl3::types::{CL_FALSE, CL_TRUE, cl_bool, cl_mem_flags};
use std::ffi::c_void;
use std::marker::PhantomData;
use std::mem::ManuallyDrop;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// OpenCL has no empty buffers: one without elements still takes this much, the widest element a kernel may point to.
const MIN_BYTES: usize = 16;

/// How much is read at a time. From an H200 1 MiB takes 1.0 to 1.7 times as long for 16 to 64 MiB, 4 MiB 0.8 to 1.3
/// times, all at once and then converted on one core two to five times.
const READ_BYTES: usize = 2 << 20;

/// So many elements are no work for several cores.
const LEAST_CONVERTED: usize = 4096;

/// OpenCL's calls that transfer.
const WRITE: &str = "clEnqueueWriteBuffer";
const READ: &str = "clEnqueueReadBuffer";

const MAP: &str = "clEnqueueMapBuffer";
const UNMAP: &str = "clEnqueueUnmapMemObject";

/// A transfer that the driver took, or refused.
type Enqueued = std::result::Result<opencl3::event::Event, ClError>;

/// Whether a call waits until its transfer is done.
#[derive(Clone, Copy)]
enum Waits {
    Yes,
    No,
}

impl Waits {
    fn flag(self) -> cl_bool {
        match self {
            Waits::Yes => CL_TRUE,
            Waits::No => CL_FALSE,
        }
    }

    fn watch(self, context: &DeviceContext, call: &'static str) -> Watched {
        match self {
            Waits::Yes => context.watch_transfer(call),
            Waits::No => context.watch(call),
        }
    }
}

/// Waits for a transfer, if there is one.
fn landed(flight: &mut Option<Event>) -> Result<()> {
    flight.take().map_or(Ok(()), |event| event.wait().map(drop))
}

/// `len` elements of `T` in the device's memory.
///
/// Dropping it while a kernel that has it as an argument is alive or running is fine: the memory goes when the last
/// user does.
#[derive(Debug)]
pub struct Buffer<T: Pod> {
    memory: Arc<Memory>,
    len: usize,
    kind: PhantomData<T>,
}

/// The memory of one buffer, whatever its elements are; kernels hold it, too.
#[derive(Debug)]
pub(super) struct Memory {
    pub raw: Owned<ClBuffer<u8>>,
    bytes: usize,
    what: String,
    context: DeviceContext,
}

impl Drop for Memory {
    fn drop(&mut self) {
        self.context.0.allocated_bytes.fetch_sub(self.bytes as u64, Ordering::Relaxed);
    }
}

impl Memory {
    fn create(
        context: &DeviceContext,
        what: &str,
        len: usize,
        element_bytes: usize,
        flags: cl_mem_flags,
    ) -> Result<Self> {
        let wanted = len.checked_mul(element_bytes).ok_or_else(|| too_large(context, what, u64::MAX))?;
        let bytes = wanted.max(MIN_BYTES);
        check_limits(context, what, bytes as u64)?;
        let _watched = context.watch("clCreateBuffer");
        // SAFETY: no host pointer is given.
        let raw = unsafe { ClBuffer::<u8>::create(&context.0.shared.context, flags, bytes, ptr::null_mut()) };
        let raw = raw
            .map(|raw| Owned::new(raw, &context.0.owner))
            .map_err(|e| context.error(&format!("clCreateBuffer of {bytes} bytes for {what}"), e))?;
        context.0.allocated_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        Ok(Memory { raw, bytes, what: what.to_owned(), context: context.clone() })
    }
}

fn too_large(context: &DeviceContext, what: &str, needed_bytes: u64) -> Error {
    Error::TooLarge {
        device: context.info().name.clone(),
        what: what.to_owned(),
        needed_bytes,
        limit_name: "CL_DEVICE_MAX_MEM_ALLOC_SIZE",
        limit_bytes: context.info().max_alloc_bytes,
    }
}

/// Drivers accept too much and fail at the first use, or swap: refuse what the device says it cannot hold. A limit of 0
/// is unknown.
fn check_limits(context: &DeviceContext, what: &str, bytes: u64) -> Result<()> {
    let info = context.info();
    if bytes > info.max_alloc_bytes && info.max_alloc_bytes > 0 {
        return Err(too_large(context, what, bytes));
    }
    let total = bytes.saturating_add(context.allocated_bytes());
    if total > info.global_memory_bytes && info.global_memory_bytes > 0 {
        return Err(Error::TooLarge {
            device: info.name.clone(),
            what: format!("{what} together with the other buffers"),
            needed_bytes: total,
            limit_name: "CL_DEVICE_GLOBAL_MEM_SIZE",
            limit_bytes: info.global_memory_bytes,
        });
    }
    Ok(())
}

impl<T: Pod> Buffer<T> {
    /// A buffer that kernels only read, filled with `data`; `what` names it in errors. `data` may be empty.
    ///
    /// # Errors
    /// [`Error::TooLarge`] over the device's limits, [`Error::OpenCl`] when the driver refuses.
    pub fn from_slice(context: &DeviceContext, what: &str, data: &[T]) -> Result<Self> {
        let buffer = Self::create(context, what, data.len(), CL_MEM_READ_ONLY)?;
        buffer.write(data)?;
        Ok(buffer)
    }

    /// A buffer that kernels read and write, of `len` elements with unspecified values; `len` may be 0.
    ///
    /// # Errors
    /// [`Error::TooLarge`] over the device's limits, [`Error::OpenCl`] when the driver refuses.
    pub fn empty(context: &DeviceContext, what: &str, len: usize) -> Result<Self> {
        Self::create(context, what, len, CL_MEM_READ_WRITE)
    }

    /// Like [`Buffer::empty`], but filled with `data`.
    ///
    /// # Errors
    /// See [`Buffer::empty`].
    pub fn read_write(context: &DeviceContext, what: &str, data: &[T]) -> Result<Self> {
        let buffer = Self::create(context, what, data.len(), CL_MEM_READ_WRITE)?;
        buffer.write(data)?;
        Ok(buffer)
    }

    fn create(context: &DeviceContext, what: &str, len: usize, flags: cl_mem_flags) -> Result<Self> {
        let memory = Arc::new(Memory::create(context, what, len, size_of::<T>(), flags)?);
        Ok(Buffer { memory, len, kind: PhantomData })
    }

    /// Another handle of the same memory.
    pub(super) fn share(&self) -> Self {
        Buffer { memory: self.memory.clone(), len: self.len, kind: PhantomData }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub(super) fn memory(&self) -> &Arc<Memory> {
        &self.memory
    }

    /// Overwrites the first elements with `data` and waits until that is done.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver fails, also by what was still running.
    ///
    /// # Panics
    /// When `data` is longer than the buffer.
    pub fn write(&self, data: &[T]) -> Result<()> {
        assert!(
            data.len() <= self.len,
            "{} elements do not fit into the {} of {}",
            data.len(),
            self.len,
            self.memory.what
        );
        if data.is_empty() {
            return Ok(());
        }
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let staged = self.memory.context.staged(bytes.len(), |staging| self.write_by_parts(staging, bytes));
        // SAFETY: the call waits, so `bytes` outlives the transfer, and it fits (asserted above).
        staged.unwrap_or_else(|| self.done(WRITE, unsafe { self.enqueue_write(Waits::Yes, 0, bytes) }))
    }

    /// Overwrites the elements from number `first` on.
    ///
    /// # Errors
    /// See [`Buffer::write`].
    ///
    /// # Panics
    /// When the range ends after the buffer.
    pub(super) fn write_from(&self, first: usize, data: &[T]) -> Result<()> {
        self.check_range(first, data.len());
        let (offset, bytes) = (first * size_of::<T>(), bytemuck::cast_slice(data));
        // SAFETY: the call waits, so `bytes` outlives the transfer, and it fits (asserted above).
        self.done(WRITE, unsafe { self.enqueue_write(Waits::Yes, offset, bytes) })
    }

    /// Overwrites the first bytes through pinned memory.
    fn write_by_parts(&self, staging: &mut Staging, bytes: &[u8]) -> Result<()> {
        let mut flights = [const { None }; 2];
        let sent = bytes.chunks(PART_BYTES).enumerate().try_for_each(|(number, bytes)| -> Result<()> {
            // What was there before is to be on the device.
            landed(&mut flights[number % 2])?;
            let part = staging.fill(number, bytes);
            // SAFETY: nobody touches the part until the event is waited for.
            let event = unsafe { self.enqueue_write(Waits::No, number * PART_BYTES, part) };
            flights[number % 2] = Some(self.flight(WRITE, event)?);
            Ok(())
        });
        // The device may still have parts where something failed.
        let [first, second] = flights.each_mut().map(landed);
        sent.and(first).and(second)
    }

    /// As [`Buffer::read_as`], through pinned memory.
    fn read_by_parts<R: Send>(&self, staging: &mut Staging, convert: impl Fn(T) -> R + Sync) -> Result<Vec<R>>
    where
        T: Send + Sync,
    {
        let (mut all, mut flights) = (Vec::with_capacity(self.len), [const { None }; 2]);
        let most = PART_BYTES / size_of::<T>();
        let count = |number: usize| most.min(self.len.saturating_sub(number * most));
        let fetch = |staging: &mut Staging, number: usize, flight: &mut Option<Event>| -> Result<()> {
            if count(number) > 0 {
                // SAFETY: nobody touches the part until the event is waited for.
                *flight = Some(unsafe { self.begin_read(number * most, staging.part(number, count(number))) }?);
            }
            Ok(())
        };
        let mut fetched = fetch(staging, 0, &mut flights[0]);
        let mut number = 0;
        while fetched.is_ok() && count(number) > 0 {
            // One part is fetched while the one before is converted.
            fetched = fetch(staging, number + 1, &mut flights[(number + 1) % 2])
                .and_then(|()| landed(&mut flights[number % 2]));
            if fetched.is_ok() {
                let part = staging.part(number, count(number));
                parallel::extend(&mut all, part.len(), |i| convert(part[i]));
                number += 1;
            }
        }
        let [first, second] = flights.each_mut().map(landed);
        fetched.and(first).and(second).map(|()| all)
    }

    /// Begins to overwrite the first elements with `data`, which lies in pinned memory.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver fails.
    ///
    /// # Safety
    /// Nobody writes `data`, and it stays where it is, until the event is waited for.
    ///
    /// # Panics
    /// When `data` is longer than the buffer.
    pub(super) unsafe fn begin_write(&self, data: &[T]) -> Result<Event> {
        self.check_range(0, data.len());
        // SAFETY: as above.
        self.flight(WRITE, unsafe { self.enqueue_write(Waits::No, 0, bytemuck::cast_slice(data)) })
    }

    /// Has the driver write bytes from an offset on.
    ///
    /// # Safety
    /// They fit there. Nobody writes them, and they stay where they are, until the transfer is done.
    unsafe fn enqueue_write(&self, waits: Waits, offset: usize, bytes: &[u8]) -> Enqueued {
        let Memory { raw, context, .. } = &*self.memory;
        let _watched = waits.watch(context, WRITE);
        // The plain call: opencl3's method wants `&mut`, although the runtime does the writing.
        // SAFETY: as above.
        let event = unsafe {
            let (queue, data) = (context.0.queue.get(), bytes.as_ptr().cast_mut().cast());
            enqueue_write_buffer(queue, raw.get(), waits.flag(), offset, bytes.len(), data, 0, ptr::null())
        };
        event.map(opencl3::event::Event::new).map_err(ClError)
    }

    /// Begins to read the elements from number `first` on into `data`, which lies in pinned memory.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver fails.
    ///
    /// # Safety
    /// Nobody touches `data`, and it stays where it is, until the event is waited for.
    ///
    /// # Panics
    /// When the range ends after the buffer.
    pub(super) unsafe fn begin_read(&self, first: usize, data: &mut [T]) -> Result<Event> {
        self.check_range(first, data.len());
        // SAFETY: as above, and the range is inside the buffer.
        self.flight(READ, unsafe { self.enqueue_read(Waits::No, first, data) })
    }

    /// Has the driver read the elements from number `first` on.
    ///
    /// # Safety
    /// The buffer has them. Nobody touches `data`, and it stays where it is, until the transfer is done.
    unsafe fn enqueue_read(&self, waits: Waits, first: usize, data: &mut [T]) -> Enqueued {
        let Memory { raw, context, .. } = &*self.memory;
        let (offset, bytes) = (first * size_of::<T>(), bytemuck::cast_slice_mut(data));
        let _watched = waits.watch(context, READ);
        // SAFETY: as above.
        unsafe { context.0.queue.enqueue_read_buffer(raw, waits.flag(), offset, bytes, &[]) }
    }

    /// Panics where the buffer has not so many elements from number `first` on.
    fn check_range(&self, first: usize, count: usize) {
        let fits = first.checked_add(count).is_some_and(|end| end <= self.len);
        assert!(fits, "{count} elements from {first} on are not in the {} of {}", self.len, self.memory.what);
    }

    /// A transfer that was begun.
    fn flight(&self, call: &str, event: Enqueued) -> Result<Event> {
        let context = &self.memory.context;
        let (call, event) = self.begun(call, event)?;
        let event = Event::new(context.clone(), call, event);
        let watched = context.watch("clFlush");
        let flushed = context.0.queue.flush();
        drop(watched);
        match flushed {
            Ok(()) => Ok(event),
            Err(error) => {
                let error = context.error("clFlush", error);
                event.wait().and(Err(error))
            }
        }
    }

    /// All elements, after every command before this one is done.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver fails, also by what was still running.
    pub fn read(&self) -> Result<Vec<T>>
    where
        T: Send + Sync,
    {
        self.read_as(|element| element)
    }

    /// What `convert` makes of each element, after every command before this one is done.
    ///
    /// Where they lie, if the device shares memory with the host; else part by part through a small array. Either way
    /// on all cores: where the memory of the result is new, most of the time goes into getting it from the operating
    /// system, and a transfer alone does that on one core.
    ///
    /// # Errors
    /// See [`Buffer::read`].
    pub fn read_as<R: Send>(&self, convert: impl Fn(T) -> R + Sync) -> Result<Vec<R>>
    where
        T: Send + Sync,
    {
        if self.shares_host_memory() {
            return self.in_place(self.len, |all| parallel::map_slice(all, |&element| convert(element)));
        }
        let bytes = self.len * size_of::<T>();
        if let Some(read) = self.memory.context.staged(bytes, |staging| self.read_by_parts(staging, &convert)) {
            return read;
        }
        let mut all = Vec::with_capacity(self.len);
        let room = self.len.min(READ_BYTES.div_ceil(size_of::<T>().max(1)));
        let mut part = bytemuck::zeroed_vec::<T>(room);
        let mut next = bytemuck::zeroed_vec::<T>(room.min(self.len - room));
        let mut count = room;
        self.read_into(0, &mut part[..count])?;
        while count > 0 {
            let first = all.len() + count;
            let next_count = room.min(self.len - first);
            // One part is fetched while the one before is converted.
            let (fetched, ()) = rayon::join(
                || self.read_into(first, &mut next[..next_count]),
                || match count < LEAST_CONVERTED {
                    true => all.extend(part[..count].iter().map(|&element| convert(element))),
                    false => parallel::extend(&mut all, count, |i| convert(part[i])),
                },
            );
            fetched?;
            std::mem::swap(&mut part, &mut next);
            count = next_count;
        }
        Ok(all)
    }

    fn shares_host_memory(&self) -> bool {
        self.memory.context.info().shares_host_memory()
    }

    /// Has `work` look at all elements, after every command before this one is done: where they lie, or once they are
    /// read.
    ///
    /// # Errors
    /// See [`Buffer::read`].
    pub(super) fn look_at<R>(&self, work: impl FnOnce(&[T]) -> R) -> Result<R>
    where
        T: Send + Sync,
    {
        if self.shares_host_memory() {
            self.in_place(self.len, |all| work(all))
        } else {
            self.read().map(|all| work(&all))
        }
    }

    /// What `work` makes of the first elements, after every command before this one is done: where the device has them,
    /// if it shares memory with the host. They are the device's again when this returns.
    ///
    /// # Errors
    /// See [`Buffer::read`].
    ///
    /// # Panics
    /// When the buffer has not so many.
    pub(super) fn in_place<R>(&self, count: usize, work: impl FnOnce(&mut [T]) -> R) -> Result<R> {
        self.check_range(0, count);
        if count == 0 {
            return Ok(work(&mut []));
        }
        let Memory { raw, context, .. } = &*self.memory;
        let (bytes, flags, mut at) = (count * size_of::<T>(), CL_MAP_READ | CL_MAP_WRITE, ptr::null_mut());
        let watched = context.watch_transfer(MAP);
        // SAFETY: the call waits, and the range is inside the buffer (asserted above).
        let mapped = unsafe { context.0.queue.enqueue_map_buffer(raw, CL_TRUE, flags, 0, bytes, &mut at, &[]) };
        drop(watched);
        self.done(MAP, mapped)?;
        let mapped = Mapped { buffer: self, at };
        // OpenCL aligns buffers for its widest type.
        if at.is_null() || !at.cast::<T>().is_aligned() {
            return Err(context.error(&format!("{MAP} of {} to {at:?}", self.memory.what), ClError(CL_MAP_FAILURE)));
        }
        // SAFETY: the driver has them there until they are unmapped, which comes after; they are aligned, and all bits
        // are values of their type.
        let done = work(unsafe { std::slice::from_raw_parts_mut(at.cast(), count) });
        ManuallyDrop::new(mapped).unmap().map(|()| done)
    }

    /// The first `len` elements of another kind in the same memory.
    ///
    /// # Panics
    /// When they do not fit.
    pub(super) fn as_of<U: Pod>(&self, len: usize) -> Buffer<U> {
        assert!(len * size_of::<U>() <= self.memory.bytes, "{} has no room for {len} elements", self.memory.what);
        Buffer { memory: self.memory.clone(), len, kind: PhantomData }
    }

    /// The elements from number `first` on, as many as `data` has room for.
    ///
    /// # Errors
    /// See [`Buffer::read`].
    ///
    /// # Panics
    /// When the range ends after the buffer.
    pub fn read_into(&self, first: usize, data: &mut [T]) -> Result<()> {
        self.check_range(first, data.len());
        if data.is_empty() {
            return Ok(());
        }
        // SAFETY: the call waits, so `data` outlives the transfer, and the range is inside the buffer (asserted above).
        self.done(READ, unsafe { self.enqueue_read(Waits::Yes, first, data) })
    }

    /// Looks at a finished transfer's status as well.
    fn done(&self, call: &str, event: Enqueued) -> Result<()> {
        let (call, event) = self.begun(call, event)?;
        Event::check_transfer(self.memory.context.clone(), call, event)
    }

    /// A transfer that the driver took, with what errors call it.
    fn begun(&self, call: &str, event: Enqueued) -> Result<(String, opencl3::event::Event)> {
        let Memory { context, what, .. } = &*self.memory;
        let call = format!("{call} of {what}");
        let event = event.map_err(|e| context.error(&call, e))?;
        Ok((call, event))
    }
}

/// Elements that the host has, until this is unmapped, or goes away.
struct Mapped<'a, T: Pod> {
    buffer: &'a Buffer<T>,
    at: *mut c_void,
}

impl<T: Pod> Mapped<'_, T> {
    /// Called once.
    fn unmap(&self) -> Result<()> {
        let Memory { raw, context, .. } = &*self.buffer.memory;
        let _watched = watch(&context.0.owner, UNMAP, Limit::Call);
        // SAFETY: it was mapped there, and nobody looks at it any more.
        let unmapped = unsafe { context.0.queue.enqueue_unmap_mem_object(raw.get(), self.at, &[]) };
        self.buffer.begun(UNMAP, unmapped).map(|(_, event)| drop(Owned::new(event, &context.0.owner)))
    }
}

impl<T: Pod> Drop for Mapped<'_, T> {
    fn drop(&mut self) {
        // There is another error that says more.
        let _ = self.unmap();
    }
}
