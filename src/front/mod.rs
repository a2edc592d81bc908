//! The front door: from a file to a picture, and from arrays to hits, in world units.
//!
//! It chooses the device and the method as the command line does, says what it chose and why, and prints nothing. It
//! adds no arithmetic of its own: hits and pictures are those of [`crate::low_level`], bit for bit.

mod all_hits;
mod blocks;
mod builder;
mod devices;
mod framing;
mod local;
mod picture;
mod point;
mod ray;
mod scene;
mod team;
mod together;
mod tracer;
mod view;

pub use all_hits::AllHits;
pub use builder::{Precision, TracerBuilder};
pub use devices::{Device, devices};
pub use local::{LocalSpace, Rounding};
pub use picture::Picture;
pub use point::ClosestPoint;
pub use ray::{Hit, Hits, Ray};
pub use tracer::Tracer;
pub use view::View;
