//! Files: pictures, batches of rays and hits, and what is said of them; every file is written whole or not at all,
//! journals apart, which are what is left of work that was stopped.

pub mod animation;
pub mod aov;
pub mod compare;
pub mod film;
pub mod input;
pub mod journal;
pub(crate) mod npz;
pub mod output;
pub mod planes;
mod png_rows;
pub mod rays;
pub mod rows;
