//! Twins of `cl/kernels/`: what a launch does, on one core.

pub mod closest_point;
pub mod render;
pub mod trace;
pub mod trace_all;
