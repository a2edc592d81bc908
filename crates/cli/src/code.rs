//! Exit codes of the program, apart from those of errors ([`raybrook::Error::exit_code`]) and of signals.

/// An exit code.
pub type Code = u8;

/// Done.
pub const SUCCESS: Code = 0;
/// A command that compares found a difference.
pub const FOUND_A_DIFFERENCE: Code = 1;
/// A wrong option or argument, as [`raybrook::Error::Option`].
pub const WRONG_ARGUMENTS: Code = 2;
/// The time that was given was up before the work was done, as `timeout` has it.
pub const TIME_IS_UP: Code = 124;
