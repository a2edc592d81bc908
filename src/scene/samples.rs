//! Where the camera rays of a picture pass.

use super::PictureDefaults;
use crate::error::{Error, Result};

/// Where the camera rays of a picture pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples {
    /// As many as the picture needs ([`crate::low_level::adaptive`]) for this root of its mean squared error, in steps
    /// of 8-bit sRGB, 0 to [`Samples::MOST_ERROR`].
    Error(f32),
    /// So many through each pixel, in a fixed pattern, 1 to [`PictureDefaults::MAX_SAMPLES`].
    PerPixel(u32),
    /// One through each corner: the first and last rays of a row and of a column pass exactly through the rim of the
    /// picture, so that 513 x 513 rays lie around 512 x 512 pixels. So NFF defines its angle of view, and so the rays
    /// of Haines' Standard Procedural Databases are counted.
    Corners,
}

impl Samples {
    /// [`Samples::Corners`] as users write it.
    pub const CORNERS: &str = "corners";
    /// What a picture takes of which nobody says anything: an error of one step of 8-bit sRGB.
    pub const DEFAULT: Samples = Samples::Error(1.0);
    /// The largest error that makes sense: a step from black to white.
    pub const MOST_ERROR: f32 = 255.0;

    /// How many intervals between neighbouring rays, or pixels, a side of `count` rays spans.
    pub fn intervals(self, count: u32) -> u32 {
        match self {
            Samples::Error(_) | Samples::PerPixel(_) => count,
            Samples::Corners => count.saturating_sub(1),
        }
    }

    /// Width / height of the picture that `size` asks for: rays lie as far apart across as upwards.
    pub fn aspect(self, (width, height): (u32, u32)) -> f64 {
        f64::from(self.intervals(width)) / f64::from(self.intervals(height))
    }

    /// Camera rays for each value of the picture; with a bounded error of those that have one sample.
    pub fn per_pixel(self) -> u32 {
        match self {
            Samples::PerPixel(count) => count,
            Samples::Error(_) | Samples::Corners => 1,
        }
    }

    /// Checks that a picture of `size` has such samples.
    ///
    /// # Errors
    /// [`Error::Option`] when it has no two corners, or the count or the error is out of range.
    pub fn check(self, size: (u32, u32)) -> Result<()> {
        let option = if matches!(self, Samples::Error(_)) { "error" } else { "samples" };
        self.fault(size).map_or(Ok(()), |fault| Err(Error::option(option, fault)))
    }

    /// What is wrong with it in a picture of `size`, if anything.
    pub(super) fn fault(self, (width, height): (u32, u32)) -> Option<String> {
        match self {
            Samples::Corners if width < 2 || height < 2 => {
                Some(format!("corners need a picture of at least 2x2, not {width}x{height}"))
            }
            Samples::PerPixel(count) if !(1..=PictureDefaults::MAX_SAMPLES).contains(&count) => {
                Some(format!("{count} is not in 1 to {}", PictureDefaults::MAX_SAMPLES))
            }
            Samples::Error(error) if !(0.0..=Self::MOST_ERROR).contains(&error) => {
                Some(format!("{error} is not in 0 to {}", Self::MOST_ERROR))
            }
            _ => None,
        }
    }
}

impl std::str::FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text == Self::CORNERS {
            return Ok(Samples::Corners);
        }
        match text.parse() {
            Ok(count) if (1..=PictureDefaults::MAX_SAMPLES).contains(&count) => Ok(Samples::PerPixel(count)),
            _ => Err(format!("expected a number from 1 to {}, or {}", PictureDefaults::MAX_SAMPLES, Self::CORNERS)),
        }
    }
}

/// A number, the word of [`Samples::CORNERS`], or `{"error": E}`.
impl serde::Serialize for Samples {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Samples::Error(error) => serializer.collect_map([("error", error)]),
            Samples::PerPixel(count) => serializer.serialize_u32(*count),
            Samples::Corners => serializer.serialize_str(Self::CORNERS),
        }
    }
}
