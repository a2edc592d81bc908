//! Errors of the library as exceptions of Python, and warnings.

use pyo3::prelude::*;
use raybrook::Error;

/// The class of `raybrook._errors` for an error: those of one class have one exit code of the command line.
fn class(error: &Error) -> &'static str {
    match (error, error.exit_code()) {
        (Error::OutOfMemory { .. }, _) => "OutOfMemoryError",
        (_, 2) => "OptionError",
        (_, 3) => "InputError",
        (_, 5) => "OutputError",
        _ => "DeviceError",
    }
}

/// The exception, with the words of the command line: the error and what caused it.
pub fn to_python(py: Python, error: &Error) -> PyErr {
    raise(py, class(error), &raybrook_cli::with_causes(error.to_string(), error))
}

/// An exception of a class of `raybrook._errors`.
pub fn raise(py: Python, class: &str, text: &str) -> PyErr {
    let made = py.import("raybrook._errors").and_then(|module| module.getattr(class)).and_then(|c| c.call1((text,)));
    made.map_or_else(|failure| failure, PyErr::from_value)
}

/// Warns whoever called the package, as `raybrook._errors.warn` does, of something worth a note.
///
/// # Errors
/// What the user has made of warnings.
pub fn warn(py: Python, text: &str) -> PyResult<()> {
    let errors = py.import("raybrook._errors")?;
    errors.call_method1("warn", (text, errors.getattr("NoteWarning")?)).map(drop)
}
