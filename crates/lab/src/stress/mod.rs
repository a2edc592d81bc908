//! Hard cases with exact answers: which rays does a method get wrong, and how?
//!
//! [`Kind`]s make meshes and rays from a seed, one for each way in which a ray tracer can fail. [`Answers`] are found
//! in exact arithmetic, and [`Answers::judge`] tells what is wrong with a tracer's. [`Found`] traces a case with any
//! method, and [`Replay`] keeps the rays that went wrong. [`Question`]s other than that for closest hits are answered
//! by [`Lists`]: all hits of the rays, and walks from hit to hit. [`closed`] traces rays by the billion that must hit,
//! through closed meshes of any origin.
//!
//! ```
//! use raybrook::low_level::options::{Intersector, TraceOptions};
//! use raybrook_lab::stress::{Answers, Found, Kind};
//!
//! let case = Kind::find("edges")?.case(7, 500);
//! let answers = Answers::new(&case);
//! let wrong = |intersector| -> raybrook::Result<usize> {
//!     let found = Found::new(&case, &TraceOptions { intersector, ..TraceOptions::DEFAULT }, None, None)?;
//!     Ok(found.faults(&answers, false).len())
//! };
//! assert_eq!(wrong(Intersector::Exact)?, 0);
//! assert!(wrong(Intersector::MollerTrumbore)? > 0, "rays slip through between neighbours");
//! # Ok::<(), raybrook::Error>(())
//! ```

mod boxes;
mod case;
pub mod closed;
mod estimate;
mod exact;
mod judge;
mod kinds;
mod lists;
mod mesh;
mod method;
mod question;
mod ratio;
mod replay;
mod run;
mod tolerance;

pub use case::{Case, StressRay};
pub use exact::{Closest, Crossing, ExactTracer, Interval, Line};
pub use judge::{Answers, Fault};
pub use kinds::Kind;
pub use lists::Lists;
pub use mesh::Mesh;
pub(crate) use mesh::inside_of;
pub use method::Method;
pub use question::{Exact, FoundLists, Given, Question};
pub use ratio::Ratio;
pub use replay::Replay;
pub use run::Found;
pub(crate) use tolerance::{EPSILON, Tolerance};
