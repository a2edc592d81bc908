//! Files: pictures, batches of rays and hits, and what is said of them; every file is written whole or not at all.

pub mod animation;
pub mod aov;
pub mod compare;
pub mod film;
pub mod input;
mod npz;
pub mod output;
pub mod planes;
pub mod rays;
