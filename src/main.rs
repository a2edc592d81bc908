//! The `raybrook` program: parse, run, print the chain of errors, exit with the documented code.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    match cli::run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("raybrook: {}", cli::chain(&error));
            ExitCode::from(error.exit_code())
        }
    }
}
