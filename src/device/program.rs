//! Builds programs, from source or from a cached binary.
//!
//! Arithmetic must be the same on every device, so nothing here ever asks for relaxed mathematics; who does it
//! nevertheless ([`DeviceHandle::with_compiler_options`](super::DeviceHandle::with_compiler_options)) finds the kernels
//! protected (`cl/shared/compiler.cl`).

use super::cache::{Cache, CacheKey};
use super::compiler_options::find_refused;
use super::handle::Owned;
use super::kept_programs::Kept;
use super::watchdog::{Limit, watch};
use super::{DeviceContext, DeviceKind, Kernel, ProgramSource};
use crate::error::{Error, Result};
use opencl3::error_codes::ClError;
use opencl3::program::{Program as ClProgram, build_program};
use std::ffi::CString;
use std::fmt;
use std::ptr;
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// What is passed to the device's compiler apart from the source.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CompileOptions {
    defines: Vec<(String, String)>,
    verbose: bool,
    most_registers: Option<u32>,
}

impl CompileOptions {
    /// No definitions.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds `-D name=value`. Neither may contain white space: drivers split the options at it.
    ///
    /// # Panics
    /// When one does.
    #[must_use]
    pub fn define(mut self, name: &str, value: impl fmt::Display) -> Self {
        let value = value.to_string();
        assert!(
            !name.contains(char::is_whitespace) && !value.contains(char::is_whitespace),
            "white space in -D {name}={value}"
        );
        self.defines.push((name.to_owned(), value));
        self
    }

    /// Lets the compiler tell in its log what each kernel takes of the device, where it can.
    #[must_use]
    pub fn verbose(self) -> Self {
        CompileOptions { verbose: true, ..self }
    }

    /// Lets a kernel take at most so many registers, on devices whose compiler can be told. What its rare calls need
    /// beyond that lies in memory; without a limit they set the number for all, and fewer work-items run at once.
    #[must_use]
    pub fn most_registers(self, count: u32) -> Self {
        CompileOptions { most_registers: Some(count), ..self }
    }

    /// The options for a device, as the compiler gets them; the user's own come last.
    pub fn text(&self, context: &DeviceContext) -> String {
        let device = context.info();
        let mut text = String::from("-cl-std=CL1.2");
        // Without it a division may be off by 2.5 units in the last place. Not every compiler knows the option.
        if device.correctly_rounded_divide_sqrt {
            text += " -cl-fp32-correctly-rounded-divide-sqrt";
        }
        // Kernels take other instructions on GPUs, with the same results.
        if device.kind == DeviceKind::Gpu {
            text += " -D GPU";
        }
        if self.verbose && device.nvidia_options {
            text += " -cl-nv-verbose";
        }
        if let Some(count) = self.most_registers.filter(|_| device.nvidia_options) {
            text += &format!(" -cl-nv-maxrregcount={count}");
        }
        for (name, value) in &self.defines {
            text += &format!(" -D {name}={value}");
        }
        if !context.0.compiler_options.is_empty() {
            text += &format!(" {}", context.0.compiler_options);
        }
        text
    }
}

/// A program that is ready to run on the device it was built for. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Program {
    raw: Arc<Owned<ClProgram>>,
    context: DeviceContext,
}

/// OpenCL's code for build options that are none.
const INVALID_BUILD_OPTIONS: i32 = -43;

impl Program {
    /// A kernel of the program, with no argument set yet.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when there is none of that name.
    pub fn kernel(&self, name: &str) -> Result<Kernel> {
        Kernel::create(&self.context, &self.raw, name)
    }

    /// The names of its kernels, sorted.
    ///
    /// # Errors
    /// [`Error::OpenCl`] when the driver does not tell.
    pub fn kernel_names(&self) -> Result<Vec<String>> {
        let _watched = self.context.watch("clGetProgramInfo");
        let names = self.raw.get_kernel_names();
        let names = names.map_err(|e| self.context.error("clGetProgramInfo (CL_PROGRAM_KERNEL_NAMES)", e))?;
        let mut names: Vec<_> = names.split(';').filter(|name| !name.is_empty()).map(str::to_owned).collect();
        names.sort_unstable();
        Ok(names)
    }

    /// Size of the binary, bytes; `None` when the driver gives none.
    pub fn binary_bytes(&self) -> Option<u64> {
        let _watched = self.context.watch("clGetProgramInfo");
        self.raw.get_binary_sizes().ok()?.first().map(|&bytes| bytes as u64).filter(|&bytes| bytes > 0)
    }
}

/// A built program and how it came about.
#[derive(Debug, Clone)]
pub struct Built {
    /// The program.
    pub program: Program,
    /// Seconds that the driver took, from source or from the binary, without writing the cache.
    pub compile_s: f64,
    /// Whether the binary came from the cache.
    pub from_cache: bool,
    /// What the compiler said although it succeeded, places mapped to files; often empty.
    pub log: String,
    /// What went wrong with the cache, for `-v`. The program is fine all the same.
    pub notes: Vec<String>,
}

/// Builds `source` for the device of `context`; takes the binary from `cache`, or puts it there, if there is one. Takes
/// no time where somebody who shares the context has built it already.
///
/// # Errors
/// [`Error::Option`] when the compiler refuses an option of the user's, [`Error::Build`] with the compiler's log,
/// [`Error::OpenCl`] when the driver fails otherwise.
pub fn build(
    context: &DeviceContext,
    source: &ProgramSource,
    options: &CompileOptions,
    cache: Option<&Cache>,
) -> Result<Built> {
    let options = options.text(context);
    let key = CacheKey::new(source.text(), &options, context.info());
    let programs = || context.0.shared.programs.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(Kept { raw, log, .. }) = programs().find(&key) {
        let program = Program { raw, context: context.clone() };
        return Ok(Built { program, compile_s: 0.0, from_cache: false, log, notes: Vec::new() });
    }
    let built = build_or_load(context, source, &options, &key, cache)?;
    programs().keep(Kept { key, raw: built.program.raw.clone(), log: built.log.clone() });
    Ok(built)
}

fn build_or_load(
    context: &DeviceContext,
    source: &ProgramSource,
    options: &str,
    key: &CacheKey,
    cache: Option<&Cache>,
) -> Result<Built> {
    let mut notes = Vec::new();
    if let Some(cache) = cache {
        match cache.load(key) {
            Ok(None) => {}
            Ok(Some(binary)) => {
                let start = Instant::now();
                match build_binary(context, &binary, options) {
                    Ok(raw) => return Ok(Built::new(context, raw, start, true, String::new(), notes)),
                    Err(error) => notes.push(cache.discard(key, &format!("the driver refused the binary: {error}"))),
                }
            }
            Err(damage) => notes.push(cache.discard(key, &damage)),
        }
    }

    let start = Instant::now();
    let (raw, log) = build_source(context, source, options).map_err(|e| refused_option(context).unwrap_or(e))?;
    let built = Built::new(context, raw, start, false, log, notes);
    Ok(match cache {
        Some(cache) => built.stored(cache, key),
        None => built,
    })
}

impl Built {
    fn new(
        context: &DeviceContext,
        raw: Owned<ClProgram>,
        start: Instant,
        from_cache: bool,
        log: String,
        notes: Vec<String>,
    ) -> Self {
        let program = Program { raw: Arc::new(raw), context: context.clone() };
        Built { program, compile_s: start.elapsed().as_secs_f64(), from_cache, log, notes }
    }

    /// Puts the binary into the cache; a failure is only a note.
    fn stored(mut self, cache: &Cache, key: &CacheKey) -> Self {
        // PoCL compiles every kernel once more when it is asked for them.
        let watched = watch(&self.program.context.0.owner, "clGetProgramInfo", Limit::Build);
        let binaries = watched.call(|| self.program.raw.get_binaries());
        let problem = match binaries {
            Ok(binaries) => match binaries.first() {
                Some(binary) if !binary.is_empty() => cache.store(key, binary).err(),
                _ => Some("the driver gives no binary".to_owned()),
            },
            Err(error) => Some(format!("the driver gives no binary: {error}")),
        };
        self.notes.extend(problem.map(|p| format!("the built kernels are not cached: {p}")));
        self
    }
}

fn build_binary(
    context: &DeviceContext,
    binary: &[u8],
    options: &str,
) -> std::result::Result<Owned<ClProgram>, ClError> {
    let device = context.0.device.id();
    let watched = context.watch("clCreateProgramWithBinary");
    // SAFETY: the context has this one device; the cache's checksum says that the driver wrote exactly these bytes.
    let program = unsafe { ClProgram::create_from_binary(&context.0.shared.context, &[device], &[binary]) };
    let program = program.map(|program| Owned::new(program, &context.0.owner))?;
    drop(watched);
    match compile(context, &program, options) {
        Ok(()) => Ok(program),
        Err(error) => {
            program.leak();
            Err(error)
        }
    }
}

/// Compiles, or links, a program. A program of which that fails is not to be released: PoCL 3.1 leaves a build that ran
/// out of memory with the program's lock taken, and waits for it in the release for ever.
fn compile(context: &DeviceContext, program: &ClProgram, options: &str) -> std::result::Result<(), ClError> {
    // No text that a user types at a command line has a zero byte.
    let options = CString::new(options).map_err(|_| ClError(INVALID_BUILD_OPTIONS))?;
    let watched = watch(&context.0.owner, "clBuildProgram", Limit::Build);
    let device = context.0.device.id();
    watched.call(|| build_program(program.get(), &[device], &options, None, ptr::null_mut())).map_err(ClError)
}

fn build_source(context: &DeviceContext, source: &ProgramSource, options: &str) -> Result<(Owned<ClProgram>, String)> {
    let watched = context.watch("clCreateProgramWithSource");
    let program = ClProgram::create_from_source(&context.0.shared.context, source.text());
    drop(watched);
    let program = program.map_err(|e| context.error("clCreateProgramWithSource", e))?;
    let program = Owned::new(program, &context.0.owner);
    let result = compile(context, &program, options);
    let result = result.map_err(|error| context.error(&format!("clBuildProgram with '{options}'"), error));
    let watched = context.watch("clGetProgramBuildInfo");
    let log = program.get_build_log(context.0.device.id()).unwrap_or_default();
    drop(watched);
    let log = source.map_log(log.trim());
    match result {
        Ok(()) => Ok((program, log)),
        Err(error) => {
            program.leak();
            // Some drivers use other codes than CL_BUILD_PROGRAM_FAILURE for errors in the source; a log tells more
            // than any code.
            if log.is_empty() {
                return Err(error);
            }
            Err(Error::Build { device: context.info().name.clone(), options: options.to_owned(), log })
        }
    }
}

/// After a build that failed: the first of the user's options that the compiler refuses even for a program that does
/// nothing.
fn refused_option(context: &DeviceContext) -> Option<Error> {
    find_refused(context, |option| match build_source(context, &ProgramSource::empty(), option) {
        Ok(_) => None,
        Err(Error::Build { log, .. }) => Some(log),
        Err(other) => Some(other.to_string()),
    })
}
