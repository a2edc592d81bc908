//! OpenCL objects that are released quietly.
//!
//! opencl3's objects panic when their release call reports an error, which a runtime does once the device is lost: the
//! panic would hide the error that says so, and abort the process if another panic is under way. Here such a failure is
//! ignored: nothing can be done about it, and the object is gone with the context anyway.

use super::owner::Owner;
use super::watchdog::{Limit, watch};
use opencl3::command_queue::{CommandQueue, release_command_queue};
use opencl3::context::{Context, context::release_context};
use opencl3::event::{Event, release_event};
use opencl3::kernel::{Kernel, release_kernel};
use opencl3::memory::{Buffer, ClMem, Image, release_mem_object};
use opencl3::program::{Program, release_program};
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// An OpenCL object that knows how to give back its one reference.
pub(super) trait Release {
    /// The OpenCL call.
    const CALL: &'static str;

    /// Gives the reference back; the object is never used again.
    fn release(&mut self);
}

/// Owns an OpenCL object and releases it without a panic.
#[derive(Debug)]
pub(super) struct Owned<T: Release> {
    object: ManuallyDrop<T>,
    owner: Arc<Owner>,
}

impl<T: Release> Owned<T> {
    pub fn new(object: T, owner: &Arc<Owner>) -> Self {
        Owned { object: ManuallyDrop::new(object), owner: Arc::clone(owner) }
    }

    /// Never releases the object.
    pub fn leak(self) {
        std::mem::forget(self);
    }
}

impl<T: Release> Drop for Owned<T> {
    fn drop(&mut self) {
        // Drivers may wait for the commands that use an object. After a failure they are of no use, and the failure is
        // to be told soon.
        let waits = self.owner.is_busy() && self.owner.failure().is_none();
        let limit = if waits { Limit::Commands } else { Limit::Release };
        let _watched = watch(&self.owner, T::CALL, limit);
        self.object.release();
    }
}

impl<T: Release> Deref for Owned<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.object
    }
}

impl<T: Release> DerefMut for Owned<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.object
    }
}

/// `Release` for an opencl3 type: its raw handle, the function that releases it, and the name of OpenCL's.
macro_rules! release {
    ($($type:ty => $function:ident, $call:literal;)+) => {$(
        impl Release for $type {
            const CALL: &'static str = $call;

            fn release(&mut self) {
                // SAFETY: `Owned` holds the only reference, its ManuallyDrop keeps opencl3 from releasing it a second
                // time, and it calls this once, when it is dropped itself.
                let _ = unsafe { $function(self.get()) };
            }
        }
    )+};
}

release! {
    Context => release_context, "clReleaseContext";
    CommandQueue => release_command_queue, "clReleaseCommandQueue";
    Program => release_program, "clReleaseProgram";
    Kernel => release_kernel, "clReleaseKernel";
    Buffer<u8> => release_mem_object, "clReleaseMemObject";
    Image => release_mem_object, "clReleaseMemObject";
    Event => release_event, "clReleaseEvent";
}
