//! OpenCL objects that are released quietly.
//!
//! opencl3's objects panic when their release call reports an error, which a runtime does once a kernel has crashed the device:
//! the panic would then hide the error that says so, and abort the process if another panic is under way. Here such a failure is
//! ignored: nothing can be done about it, and the object is gone with the context anyway. (The
//! context itself stays with opencl3, which does not offer its release call; it is released last, when nothing is left to fail.)

use opencl3::command_queue::{CommandQueue, release_command_queue};
use opencl3::event::{Event, release_event};
use opencl3::kernel::{Kernel, release_kernel};
use opencl3::memory::{Buffer, ClMem, Image, release_mem_object};
use opencl3::program::{Program, release_program};
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};

/// An OpenCL object that knows how to give back its one reference.
pub(super) trait Release {
    /// Gives the reference back; the object is never used again.
    fn release(&mut self);
}

/// Owns an OpenCL object and releases it without a panic.
#[derive(Debug)]
pub(super) struct Owned<T: Release>(ManuallyDrop<T>);

impl<T: Release> Owned<T> {
    pub fn new(object: T) -> Self {
        Owned(ManuallyDrop::new(object))
    }
}

impl<T: Release> Drop for Owned<T> {
    fn drop(&mut self) {
        self.0.release();
    }
}

impl<T: Release> Deref for Owned<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T: Release> DerefMut for Owned<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

/// `Release` for an opencl3 type: its raw handle and the call that releases it.
macro_rules! release {
    ($($type:ty => $call:ident;)+) => {$(
        impl Release for $type {
            fn release(&mut self) {
                // SAFETY: `Owned` holds the only reference, its ManuallyDrop keeps opencl3 from releasing it a second time, and
                // it calls this once, when it is dropped itself.
                let _ = unsafe { $call(self.get()) };
            }
        }
    )+};
}

release! {
    CommandQueue => release_command_queue;
    Program => release_program;
    Kernel => release_kernel;
    Buffer<u8> => release_mem_object;
    Image => release_mem_object;
    Event => release_event;
}
