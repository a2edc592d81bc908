//! What is taken where nobody asks for anything, and why: what was given, else what measuring on the device found
//! ([`tune`]), else what a model takes.

mod camera;
mod model;
mod request;
mod size;
pub mod tune;

pub use camera::camera_decisions;
pub use model::Workload;
pub use request::{Chosen, Decision, Request, Source, TunedChoice, numbers_in_effect};
pub use size::SceneSize;
