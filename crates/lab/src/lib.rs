//! The laboratory of [`raybrook`]: what tests and measures its methods.
//!
//! * [`stress`]: rays on which ray tracers fail, with exact answers by rational arithmetic, and what each method gets wrong.
//! * [`study`]: methods measured against each other, speed beside accuracy, and a report of charts and tables.

pub mod stress;
pub mod study;
