//! What a fuzz target is.

/// Does with an input what must be done, panics where something does not hold, and tells whether the input could be
/// used.
pub type Target = fn(&[u8]) -> bool;
