//! What reads the files that the program keeps for itself, for the fuzz targets of these (`fuzz/src/program.rs`).

pub use crate::stress::kept::{Cell, KeptCells, StressId, append, create, read_kept};
pub use crate::turntable::frames::Frames;
pub use crate::turntable::manifest::{Kept, Manifest, ToMake};
