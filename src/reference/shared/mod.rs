//! Twins of `cl/shared/`, file for file: arithmetic, rays, and what traversals read. The reasons are there.

pub mod hash;
pub mod instances;
pub mod integer;
pub mod math;
pub mod memory;
pub mod ray;
pub mod slab;
