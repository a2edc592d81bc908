//! Memory between a program and a GPU for large transfers.
//!
//! A driver copies what it is given, on one core, into memory of its own that the device reads by itself (*pinned*).
//! Here all cores copy it, part by part, into such memory, while the device has the part before.
//!
//! Bad at: few transfers. To pin memory takes some milliseconds.

use super::handle::Owned;
use super::owner::Owner;
use super::watchdog::{Limit, watch};
use crate::parallel;
use bytemuck::Pod;
use opencl3::command_queue::CommandQueue;
use opencl3::context::Context;
use opencl3::memory::{Buffer, CL_MAP_READ, CL_MAP_WRITE, CL_MEM_ALLOC_HOST_PTR, CL_MEM_READ_WRITE, ClMem};
use opencl3::types::CL_TRUE;
use std::ptr;
use std::sync::Arc;

/// Bytes that are transferred at a time.
pub(super) const PART_BYTES: usize = 4 << 20;
/// What a core copies at a time.
const COPIED_BYTES: usize = 1 << 18;

/// Memory for two parts: one is filled or read by cores, while the device has the other.
#[derive(Debug)]
pub(super) struct Staging {
    memory: Owned<Buffer<u8>>,
    /// Where the memory lies in the process, as long as it is mapped.
    at: *mut u8,
    owner: Arc<Owner>,
}

// SAFETY: the memory belongs to this object alone, whatever thread has it.
unsafe impl Send for Staging {}

impl Staging {
    /// Pins memory of a device; `None` where the driver does not.
    pub fn new(context: &Context, queue: &CommandQueue, owner: &Arc<Owner>) -> Option<Staging> {
        let bytes = 2 * PART_BYTES;
        let _watched = watch(owner, "clEnqueueMapBuffer", Limit::Commands);
        let flags = CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR;
        // SAFETY: no host pointer is given.
        let memory = unsafe { Buffer::<u8>::create(context, flags, bytes, ptr::null_mut()) }.ok()?;
        let memory = Owned::new(memory, owner);
        let mut at = ptr::null_mut();
        // SAFETY: the call blocks, and the range is that of the buffer.
        let mapped =
            unsafe { queue.enqueue_map_buffer(&memory, CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes, &mut at, &[]) };
        drop(Owned::new(mapped.ok()?, owner));
        // Parts are read as elements of up to so many bytes.
        let is_aligned = !at.is_null() && at.addr().is_multiple_of(128);
        let staging = Staging { memory, at: at.cast(), owner: owner.clone() };
        if is_aligned {
            return Some(staging);
        }
        staging.release(queue);
        None
    }

    /// Gives the memory back.
    pub fn release(self, queue: &CommandQueue) {
        // After a failure a driver may hang in that.
        if self.owner.failure().is_some() {
            self.memory.leak();
            return;
        }
        let _watched = watch(&self.owner, "clEnqueueUnmapMemObject", Limit::Call);
        // SAFETY: it was mapped there, and nobody looks at it any more.
        let unmapped = unsafe { queue.enqueue_unmap_mem_object(self.memory.get(), self.at.cast(), &[]) };
        drop(unmapped.map(|event| Owned::new(event, &self.owner)));
    }

    /// Where a part lies, of number 0, 1, 2 and so on: every other one at the same place. The device may have it: who
    /// looks at it waits before.
    pub fn part(&mut self, number: usize) -> *mut u8 {
        // SAFETY: within the memory, which has two parts.
        unsafe { self.at.add(number % 2 * PART_BYTES) }
    }

    /// Fills a part, which the device has not, with at most [`PART_BYTES`].
    pub fn fill(&mut self, number: usize, bytes: &[u8]) {
        assert!(bytes.len() <= PART_BYTES, "{} bytes are more than a part", bytes.len());
        // SAFETY: within the part, and nobody else has it.
        let part = unsafe { std::slice::from_raw_parts_mut(self.part(number), bytes.len()) };
        parallel::each(part.chunks_mut(COPIED_BYTES).zip(bytes.chunks(COPIED_BYTES)), |(to, from)| {
            to.copy_from_slice(from);
        });
    }

    /// The first elements of a part, which the device has not.
    pub fn elements<T: Pod>(&mut self, number: usize, count: usize) -> &[T] {
        assert!(count * size_of::<T>() <= PART_BYTES, "{count} elements are more than a part");
        // SAFETY: within the part, which is aligned for all elements, and has been written by the device.
        unsafe { std::slice::from_raw_parts(self.part(number).cast(), count) }
    }
}
