//! Twins of `cl/kernels/`: what a launch does, on one core.

pub mod closest_point;
pub mod count_hits;
pub mod list_hits;
pub mod render;
pub mod trace;
