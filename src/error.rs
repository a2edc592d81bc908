//! The one error type of the crate. Every variant names the file, option or device at fault and, where there is one,
//! the remedy.

mod memory;

pub use memory::{BudgetOrigin, Bytes, DecidedBy, MemoryBudget};
use std::path::{Path, PathBuf};

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Why raybrook could not do what it was asked to.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("cannot {action} '{}'", path.display())]
    Io {
        /// "read", "write", "create", …
        action: &'static str,
        /// The file at fault.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file was read, but what it holds is not usable.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Input {
        /// The file at fault.
        path: PathBuf,
        /// The line at fault, counted from 1, where one is known.
        line: Option<usize>,
        /// What is wrong and what to do.
        message: String,
    },
    /// A scene that was built in memory cannot be traced.
    #[error("the scene cannot be traced: {0}")]
    Scene(String),
    /// An option has a value that cannot be used.
    #[error("option {option}: {message}")]
    Option {
        /// The option by its name in the library, such as `max_depth`.
        option: String,
        /// What is wrong and what is possible.
        message: String,
    },
    /// No device matches what was asked for, or there is none at all.
    #[error("{0}")]
    NoDevice(String),
    /// An OpenCL call failed.
    #[error(
        "device '{device}': {call} failed: {code}{}",
        if hint.is_empty() { String::new() } else { format!(" ({hint})") }
    )]
    OpenCl {
        /// The name of the device.
        device: String,
        /// The OpenCL call and what was asked of it.
        call: String,
        /// The decoded error, such as `CL_OUT_OF_RESOURCES (-5)`.
        code: String,
        /// The limit that was met or the remedy; may be empty.
        hint: String,
    },
    /// An OpenCL call did not return.
    #[error(
        "device '{device}': {}{call} did not return in {limit_s} s: the driver hangs; start again, choose another with \
         `device`, or let RAYBROOK_DRIVER_LIMIT be more seconds where the device is that slow",
        failure.as_ref().map(|failure| format!("{failure}; then ")).unwrap_or_default()
    )]
    Hang {
        /// The name of the device.
        device: String,
        /// The OpenCL call.
        call: String,
        /// How many seconds it was waited for.
        limit_s: f64,
        /// What failed before, if anything did.
        failure: Option<String>,
    },
    /// The call was stopped by the flag that was given for that.
    #[error("the call was stopped")]
    Stopped,
    /// The device's compiler refused the kernels.
    #[error("device '{device}': the kernels do not build with '{options}':\n{log}")]
    Build {
        /// The name of the device.
        device: String,
        /// The build options.
        options: String,
        /// The compiler's log; it names the file and line under `cl/`.
        log: String,
    },
    /// The device's memory cannot hold the scene or the picture.
    #[error(
        "device '{device}': {what} needs {needed_bytes} bytes, but {limit_name} is {limit_bytes} bytes; \
         use `device = reference` or a smaller {}",
        if what.starts_with("picture") { "picture" } else { "scene" }
    )]
    TooLarge {
        /// The name of the device.
        device: String,
        /// The buffer that does not fit; that of a picture is called so.
        what: String,
        /// Its size.
        needed_bytes: u64,
        /// The OpenCL limit that it exceeds.
        limit_name: &'static str,
        /// The value of that limit.
        limit_bytes: u64,
    },
    /// The host's memory cannot hold what was asked for, or may not.
    #[error("{what} takes the process to about {} of memory, but {budget}; {remedy}", Bytes(*needed_bytes))]
    OutOfMemory {
        /// What does not fit.
        what: String,
        /// The bytes that the process would have.
        needed_bytes: u64,
        /// The bytes that it may have.
        budget: MemoryBudget,
        /// Whether an input or the picture that is asked for takes so much.
        decided_by: DecidedBy,
        /// What takes less.
        remedy: String,
    },
}

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(action: &'static str, path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Error::Io { action, path: path.as_ref().to_owned(), source }
    }

    /// An [`Error::Input`] for `path`, at `line` if it is known.
    pub fn input(path: impl AsRef<Path>, line: impl Into<Option<usize>>, message: impl Into<String>) -> Self {
        Error::Input { path: path.as_ref().to_owned(), line: line.into(), message: message.into() }
    }

    /// An [`Error::Option`] for `option`.
    pub fn option(option: impl Into<String>, message: impl Into<String>) -> Self {
        Error::Option { option: option.into(), message: message.into() }
    }

    /// Whether a device cannot do what others may.
    pub fn is_of_device(&self) -> bool {
        let cannot_begin = matches!(self, Error::NoDevice(_) | Error::Build { .. } | Error::TooLarge { .. });
        cannot_begin || self.is_lost_device()
    }

    /// Whether a call of a driver failed. Of a device that was ready to work it is the end.
    pub fn is_lost_device(&self) -> bool {
        matches!(self, Error::OpenCl { .. } | Error::Hang { .. })
    }

    /// The documented exit code of the binary for this error: 2 usage, 3 input, 4 device, 5 output, 130 stopped.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Option { .. } => 2,
            Error::Io { action: "read", .. } | Error::Input { .. } | Error::Scene(_) => 3,
            Error::OutOfMemory { decided_by: DecidedBy::Input, .. } => 3,
            Error::OutOfMemory { decided_by: DecidedBy::Picture, .. } => 4,
            Error::NoDevice(_)
            | Error::OpenCl { .. }
            | Error::Hang { .. }
            | Error::Build { .. }
            | Error::TooLarge { .. } => 4,
            Error::Io { .. } => 5,
            Error::Stopped => 130,
        }
    }
}
