//! The `raybrook` program: parse, run, print the chain of errors, exit with the documented code.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    let code = cli::run().unwrap_or_else(|error| cli::fail(&error));
    cli::print::finish(code)
}
