//! Twins of `cl/points/`: which triangles may be the nearest one of a point.

pub mod binary;
mod distance;
pub mod wide;
