//! raybrook
pub mod accel;
pub mod error;
pub mod layout;
pub mod options;
pub mod scene;
pub mod shared;
pub use error::{Error, Result};
