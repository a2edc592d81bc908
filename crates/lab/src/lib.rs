//! The laboratory of [`raybrook`]: what tests and measures its methods.
//!
//! * [`cross_check`]: an OBJ file read by another reader, too.
//! * [`stress`]: rays on which ray tracers fail, with exact answers by rational arithmetic, and what each method gets
//!   wrong.
//! * [`study`]: methods measured against each other, speed beside accuracy, and a report of charts and tables.
//! * [`truth`]: a judge of pictures and of their rays that shares no code with what it judges.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))] // only the command line prints

pub mod cross_check;
pub mod stress;
pub mod study;
pub mod truth;
