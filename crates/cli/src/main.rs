//! The program.

use std::process::ExitCode;

/// Parses, runs, prints the chain of errors, and exits with the documented code.
fn main() -> ExitCode {
    ExitCode::from(raybrook_cli::run(std::env::args_os()))
}
