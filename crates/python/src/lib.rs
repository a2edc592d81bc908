//! The Python package's module in Rust, `raybrook._raybrook`: what takes time or needs the library. What users see,
//! with its documentation, is written in Python, in `python/raybrook`: it checks shapes and makes all arrays contiguous
//! before they come here.

use pyo3::prelude::*;

mod choices;
mod core;
mod error;
mod meshes;
mod output;
mod parts;
mod picture;
mod points;
mod process;
mod rays;
mod round;
mod run;
mod view;

/// The part of raybrook that is written in Rust.
#[pymodule]
mod _raybrook {
    use super::error::to_python;
    use super::*;
    use std::ffi::OsString;

    #[pymodule_export]
    use super::core::Core;
    #[pymodule_export]
    use super::picture::Picture;
    #[pymodule_export]
    use super::round::{origin_around, round_to_float32};

    /// The version of the Rust package.
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // the name that Python has for it
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Name, platform, kind, and why it cannot be used, or None.
    type Device = (String, String, String, Option<String>);

    /// The OpenCL devices.
    #[pyfunction]
    fn devices(py: Python) -> PyResult<Vec<Device>> {
        process::begin(py)?;
        let devices = py.detach(raybrook::devices).map_err(|error| to_python(py, &error))?;
        Ok(devices.into_iter().map(|d| (d.name, d.platform, d.kind.to_string(), d.unusable)).collect())
    }

    /// Does what the command line says, the program's name first; tells the exit code.
    #[pyfunction]
    fn run_command_line(py: Python, arguments: Vec<OsString>) -> PyResult<u8> {
        process::begin(py)?;
        Ok(py.detach(|| raybrook_cli::run(arguments)))
    }
}
