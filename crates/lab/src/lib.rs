//! The laboratory of [`raybrook`]: what tests and measures its methods.
//!
//! * [`stress`]: rays on which ray tracers fail, with exact answers by rational arithmetic, and what each method gets
//!   wrong.
//! * [`study`]: methods measured against each other, speed beside accuracy, and a report of charts and tables.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))] // only the command line prints

pub mod stress;
pub mod study;
