//! Devices: listing, compiling, memory, and the functions of the kernels against their twins.

#[path = "../common/mod.rs"]
mod common;

mod compiler_options;
mod devices;
mod kernels;
mod layout;
mod memory;
mod tune;
