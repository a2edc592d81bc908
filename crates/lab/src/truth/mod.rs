//! The judge of pictures and of their rays: what `raybrook check --truth` asks.
//!
//! Device and twin repeat each other, so that comparing them finds no mistake that both make. This judge shares no code
//! with either: a renderer in f64 with shading of its own ([`Truth`]), and for the rays of the picture rational
//! arithmetic ([`judge_rays`]).

mod kinds;
mod lamp;
mod pattern;
mod picture;
mod rays;
mod refraction;
mod render;
mod surface;
mod texture;
mod trial;

pub use kinds::Kind;
pub use picture::{PictureVerdict, PixelFault, PixelVerdict, judge_picture};
pub use rays::{RayVerdict, RayVerdicts, SampledRays, judge_rays};
pub use render::{Listener, Sent, Truth, TruthRay};
pub use texture::Pyramid;
pub use trial::Trial;
