//! An OpenCL library that hands every call to the real one, but for those that it is told to spoil.
//! `tests/cli/device_faults.rs` compiles it by itself (`rustc --crate-type cdylib`), and raybrook loads it in place of
//! the loader (`OPENCL_DYLIB_PATH`). Nothing but the standard library.
//!
//! `OPENCL_FAULT` says what to spoil, one of:
//! - `only:N:CODE`: call number N, counted from 1, fails with that code;
//! - `from:N:CODE`: it and all later ones do;
//! - `hang:N`: it never returns, nor do later ones;
//! - `throw:N`: it is left by an exception, as C++ throws them;
//! - `only:NAME:CODE`, `from:NAME:CODE`, `hang:NAME`, `throw:NAME`: the same of the calls of that name, the first or
//!   all;
//! - `no-images`, `no-profiling`: the device lacks these.
//!
//! `OPENCL_FAULT_LOG` names a file that gets a line for each call, with a word behind the name of those that were
//! spoilt. `OPENCL_FAULT_REAL` is the real library, if it is not `libOpenCL.so.1`.
#![allow(non_snake_case, clippy::too_many_arguments, clippy::missing_safety_doc)]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::io::Write;
use std::ptr::null_mut;
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

type Pointer = *mut c_void;
type Info = u32;

unsafe extern "C" {
    fn dlopen(path: *const c_char, flags: c_int) -> Pointer;
    fn dlsym(library: Pointer, name: *const c_char) -> Pointer;
}

/// Bind now, and keep the names to oneself: that is Linux's 2 and 0.
const RTLD_NOW: c_int = 2;
const INVALID_QUEUE_PROPERTIES: i32 = -35;
const PROFILING: u64 = 2;
const DEVICE_IMAGE_SUPPORT: Info = 0x1016;
const DEVICE_QUEUE_PROPERTIES: Info = 0x102A;

/// Which calls are spoilt.
enum Which {
    Number(u64),
    Name(String),
}

enum Fault {
    None,
    Only(Which, i32),
    From(Which, i32),
    Hang(Which),
    Throw(Which),
    NoImages,
    NoProfiling,
}

impl Fault {
    fn read() -> Fault {
        let text = std::env::var("OPENCL_FAULT").unwrap_or_default();
        let parts: Vec<&str> = text.split(':').collect();
        let which = |text: &str| text.parse().map_or_else(|_| Which::Name(text.to_owned()), Which::Number);
        let code = |text: &str| text.parse().expect("a code in OPENCL_FAULT");
        match parts[..] {
            [""] => Fault::None,
            ["no-images"] => Fault::NoImages,
            ["no-profiling"] => Fault::NoProfiling,
            ["only", call, number] => Fault::Only(which(call), code(number)),
            ["from", call, number] => Fault::From(which(call), code(number)),
            ["hang", call] => Fault::Hang(which(call)),
            ["throw", call] => Fault::Throw(which(call)),
            _ => panic!("OPENCL_FAULT={text}"),
        }
    }
}

/// How a call is spoilt.
#[derive(Clone, Copy)]
enum Spoilt {
    Fails(i32),
    Hangs,
    Throws,
}

/// What is known of the calls so far.
struct Calls {
    fault: Fault,
    count: u64,
    of_name: u64,
    log: Option<std::fs::File>,
}

impl Calls {
    /// What becomes of the next call.
    fn next(&mut self, name: &str) -> Option<Spoilt> {
        self.count += 1;
        let Calls { count, of_name, .. } = self;
        let (count, named) = (*count, of_name);
        let mut begun = |which: &Which| match which {
            Which::Number(number) => (count >= *number, count == *number),
            Which::Name(wanted) => {
                *named += u64::from(wanted == name);
                (wanted == name, wanted == name && *named == 1)
            }
        };
        let spoilt = match &self.fault {
            Fault::Only(which, code) if begun(which).1 => Some(Spoilt::Fails(*code)),
            Fault::From(which, code) if begun(which).0 => Some(Spoilt::Fails(*code)),
            Fault::Hang(which) if begun(which).0 => Some(Spoilt::Hangs),
            Fault::Throw(which) if begun(which).1 => Some(Spoilt::Throws),
            _ => None,
        };
        if let Some(log) = &mut self.log {
            // At once: the process may end without a word.
            let _ = writeln!(log, "{name}{}", if spoilt.is_some() { " spoilt" } else { "" });
        }
        spoilt
    }
}

fn calls() -> &'static Mutex<Calls> {
    static CALLS: OnceLock<Mutex<Calls>> = OnceLock::new();
    CALLS.get_or_init(|| {
        let log = std::env::var_os("OPENCL_FAULT_LOG").map(|path| std::fs::File::create(path).expect("the log"));
        Mutex::new(Calls { fault: Fault::read(), count: 0, of_name: 0, log })
    })
}

/// Counts a call. The code that it fails with.
fn spoilt(name: &CStr) -> Option<i32> {
    let next = calls().lock().unwrap().next(name.to_str().unwrap());
    match next? {
        Spoilt::Fails(code) => Some(code),
        Spoilt::Hangs => loop {
            std::thread::sleep(Duration::from_secs(3600));
        },
        // To a program with a standard library of its own this is as foreign as an exception of C++.
        Spoilt::Throws => std::panic::resume_unwind(Box::new("thrown")),
    }
}

fn is(fault: fn(&Fault) -> bool) -> bool {
    fault(&calls().lock().unwrap().fault)
}

/// A function of the real library.
fn real(name: &CStr) -> Pointer {
    static LIBRARY: OnceLock<usize> = OnceLock::new();
    let library = *LIBRARY.get_or_init(|| {
        let path = std::env::var("OPENCL_FAULT_REAL").unwrap_or_else(|_| "libOpenCL.so.1".to_owned());
        let path = CString::new(path).unwrap();
        // SAFETY: a path that ends with a zero.
        unsafe { dlopen(path.as_ptr(), RTLD_NOW) as usize }
    });
    assert!(library != 0, "there is no real OpenCL library");
    // SAFETY: the library was opened, the name ends with a zero.
    let function = unsafe { dlsym(library as Pointer, name.as_ptr()) };
    assert!(!function.is_null(), "the real library lacks {name:?}");
    function
}

/// Calls the real function of that name.
macro_rules! forward {
    ($name:ident($($argument:ident: $type:ty),*) -> $result:ty) => {{
        let name = CString::new(stringify!($name)).unwrap();
        // SAFETY: OpenCL's headers give this signature.
        let function: unsafe extern "C" fn($($type),*) -> $result = unsafe { std::mem::transmute(real(&name)) };
        // SAFETY: the caller answers for the arguments.
        unsafe { function($($argument),*) }
    }};
}

/// Functions that return a code.
macro_rules! codes {
    ($($name:ident($($argument:ident: $type:ty),*);)+) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C-unwind" fn $name($($argument: $type),*) -> i32 {
            match spoilt(&CString::new(stringify!($name)).unwrap()) {
                Some(code) => code,
                None => forward!($name($($argument: $type),*) -> i32),
            }
        }
    )+};
}

/// Functions that return an object, and a code through their last argument.
macro_rules! objects {
    ($($name:ident($($argument:ident: $type:ty),*);)+) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C-unwind" fn $name($($argument: $type,)* status: *mut i32) -> Pointer {
            match spoilt(&CString::new(stringify!($name)).unwrap()) {
                Some(code) => {
                    // SAFETY: the caller passes room for the code, as raybrook always does.
                    unsafe { *status = code };
                    null_mut()
                }
                None => forward!($name($($argument: $type,)* status: *mut i32) -> Pointer),
            }
        }
    )+};
}

codes! {
    clGetPlatformIDs(count: u32, platforms: Pointer, found: Pointer);
    clGetPlatformInfo(platform: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
    clGetDeviceIDs(platform: Pointer, kind: u64, count: u32, devices: Pointer, found: Pointer);
    clReleaseContext(context: Pointer);
    clReleaseCommandQueue(queue: Pointer);
    clReleaseMemObject(memory: Pointer);
    clReleaseProgram(program: Pointer);
    clReleaseKernel(kernel: Pointer);
    clReleaseEvent(event: Pointer);
    clBuildProgram(program: Pointer, count: u32, devices: Pointer, options: Pointer, notify: Pointer, data: Pointer);
    clGetProgramInfo(program: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
    clGetProgramBuildInfo(program: Pointer, device: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
    clSetKernelArg(kernel: Pointer, index: u32, size: usize, value: Pointer);
    clGetKernelInfo(kernel: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
    clGetKernelWorkGroupInfo(kernel: Pointer, device: Pointer, what: Info, size: usize, value: Pointer,
        needed: Pointer);
    clEnqueueNDRangeKernel(queue: Pointer, kernel: Pointer, dimensions: u32, offset: Pointer, global: Pointer,
        local: Pointer, count: u32, waits: Pointer, event: Pointer);
    clEnqueueReadBuffer(queue: Pointer, buffer: Pointer, blocks: u32, offset: usize, size: usize, data: Pointer,
        count: u32, waits: Pointer, event: Pointer);
    clEnqueueWriteBuffer(queue: Pointer, buffer: Pointer, blocks: u32, offset: usize, size: usize, data: Pointer,
        count: u32, waits: Pointer, event: Pointer);
    clEnqueueWriteImage(queue: Pointer, image: Pointer, blocks: u32, origin: Pointer, region: Pointer, row: usize,
        slice: usize, data: Pointer, count: u32, waits: Pointer, event: Pointer);
    clEnqueueUnmapMemObject(queue: Pointer, memory: Pointer, at: Pointer, count: u32, waits: Pointer, event: Pointer);
    clFlush(queue: Pointer);
    clFinish(queue: Pointer);
    clWaitForEvents(count: u32, events: Pointer);
    clGetEventInfo(event: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
    clGetEventProfilingInfo(event: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer);
}

objects! {
    clCreateContext(properties: Pointer, count: u32, devices: Pointer, notify: Pointer, data: Pointer);
    clCreateBuffer(context: Pointer, flags: u64, size: usize, data: Pointer);
    clCreateImage(context: Pointer, flags: u64, format: Pointer, description: Pointer, data: Pointer);
    clCreateProgramWithSource(context: Pointer, count: u32, texts: Pointer, lengths: Pointer);
    clCreateProgramWithBinary(context: Pointer, count: u32, devices: Pointer, lengths: Pointer, binaries: Pointer,
        states: Pointer);
    clCreateKernel(program: Pointer, name: Pointer);
    clEnqueueMapBuffer(queue: Pointer, buffer: Pointer, blocks: u32, flags: u64, offset: usize, size: usize,
        count: u32, waits: Pointer, event: Pointer);
}

/// As the real one, but for a device that lacks something.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn clGetDeviceInfo(
    device: Pointer,
    what: Info,
    size: usize,
    value: Pointer,
    needed: Pointer,
) -> i32 {
    if let Some(code) = spoilt(c"clGetDeviceInfo") {
        return code;
    }
    let code =
        forward!(clGetDeviceInfo(device: Pointer, what: Info, size: usize, value: Pointer, needed: Pointer) -> i32);
    let lacks = what == DEVICE_IMAGE_SUPPORT && is(|fault| matches!(fault, Fault::NoImages))
        || what == DEVICE_QUEUE_PROPERTIES && is(|fault| matches!(fault, Fault::NoProfiling));
    if lacks && !value.is_null() {
        // SAFETY: the caller has room for so many bytes.
        unsafe { std::ptr::write_bytes(value.cast::<u8>(), 0, size) };
    }
    code
}

/// As the real one, but for a device whose queues do not time their commands.
#[unsafe(no_mangle)]
pub unsafe extern "C-unwind" fn clCreateCommandQueue(
    context: Pointer,
    device: Pointer,
    properties: u64,
    status: *mut i32,
) -> Pointer {
    let refused = properties & PROFILING != 0 && is(|fault| matches!(fault, Fault::NoProfiling));
    match spoilt(c"clCreateCommandQueue").or(refused.then_some(INVALID_QUEUE_PROPERTIES)) {
        Some(code) => {
            // SAFETY: the caller passes room for the code.
            unsafe { *status = code };
            null_mut()
        }
        None => {
            forward!(clCreateCommandQueue(
                context: Pointer,
                device: Pointer,
                properties: u64,
                status: *mut i32
            ) -> Pointer)
        }
    }
}
