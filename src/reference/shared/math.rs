//! Twin of `cl/shared/math.cl`. It stands in `src/math.rs`, because builders use it, too.

pub use crate::math::*;
