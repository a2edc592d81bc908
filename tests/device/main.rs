//! Devices: listing, compiling, memory, and kernels against their twins, file by file and function by function.

#[path = "../common/mod.rs"]
mod common;

mod compiler_options;
mod devices;
mod kernels;
mod layout;
mod memory;
mod mirror;
mod rooms;
mod tune;
