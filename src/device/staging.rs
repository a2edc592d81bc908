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
/// What is large enough for two such parts.
pub(super) const STAGING_BYTES: usize = 2 * PART_BYTES;
/// Elements are aligned to so many bytes at most.
pub(super) const ALIGNMENT: usize = 128;
/// What a core copies at a time.
const COPIED_BYTES: usize = 1 << 18;

/// Memory that a device reads and writes by itself. It is for two parts: one is filled or read by cores, while the
/// device has the other.
#[derive(Debug)]
pub(super) struct Staging {
    memory: Owned<Buffer<u8>>,
    /// Where the memory lies in the process, as long as it is mapped.
    at: *mut u8,
    bytes: usize,
    owner: Arc<Owner>,
}

// SAFETY: the memory belongs to this object alone, whatever thread has it.
unsafe impl Send for Staging {}

impl Staging {
    /// Pins so many bytes for a device; `None` where the driver does not.
    pub fn new(context: &Context, queue: &CommandQueue, owner: &Arc<Owner>, bytes: usize) -> Option<Staging> {
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
        let is_aligned = !at.is_null() && at.addr().is_multiple_of(ALIGNMENT);
        let staging = Staging { memory, at: at.cast(), bytes, owner: owner.clone() };
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

    /// Elements that lie from a byte on. The device may have them: who looks at them waits before.
    ///
    /// # Panics
    /// Where the memory has none there, or they would not be aligned.
    pub fn elements<T: Pod>(&mut self, from: usize, count: usize) -> &mut [T] {
        let is_inside = count.checked_mul(size_of::<T>()).is_some_and(|bytes| bytes <= self.bytes.saturating_sub(from));
        assert!(is_inside && from.is_multiple_of(ALIGNMENT), "{count} elements from {from} of {}", self.bytes);
        // SAFETY: within the memory, aligned as all elements are, and of a type of which all bits are values.
        unsafe { std::slice::from_raw_parts_mut(self.at.add(from).cast(), count) }
    }

    /// The same of a part, of number 0, 1, 2 and so on: every other one lies at the same place.
    pub fn part<T: Pod>(&mut self, number: usize, count: usize) -> &mut [T] {
        assert!(count * size_of::<T>() <= PART_BYTES, "{count} elements are more than a part");
        self.elements(number % 2 * PART_BYTES, count)
    }

    /// Fills a part, which the device has not, with at most [`PART_BYTES`], and returns it.
    pub fn fill(&mut self, number: usize, bytes: &[u8]) -> &[u8] {
        let part = self.part(number, bytes.len());
        parallel::each(part.chunks_mut(COPIED_BYTES).zip(bytes.chunks(COPIED_BYTES)), |(to, from)| {
            to.copy_from_slice(from);
        });
        part
    }
}
