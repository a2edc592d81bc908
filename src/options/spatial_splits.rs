//! How many references splits of space may add to a hierarchy of boxes: a number, or as many as pay.

use super::BvhOptions;
use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// How many references splits of space may add to a hierarchy of boxes, as a share of its triangles: each part of a
/// triangle that is cut has one.
///
/// ```
/// use raybrook::low_level::options::SpatialSplits;
///
/// assert_eq!("0.5".parse::<SpatialSplits>().unwrap(), 0.5.into());
/// assert_eq!("auto".parse::<SpatialSplits>().unwrap(), SpatialSplits::Auto);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpatialSplits {
    /// At most so many per triangle, 0 (none) to [`BvhOptions::MAX_SPATIAL_SPLITS`].
    Share(f32),
    /// [`SpatialSplits::AUTO_SHARE`] where the builder's own expected cost says that they pay, else none. Hierarchies
    /// of both kinds are built, which takes three to five times as long as one without.
    Auto,
}

impl SpatialSplits {
    /// No triangle is cut.
    pub const NONE: SpatialSplits = SpatialSplits::Share(0.0);

    /// The share that [`SpatialSplits::Auto`] tries: 0.1 and 2 changed speeds by a few hundredths
    /// (docs/record/2026-11-22-h200-spatial-splits.md).
    pub const AUTO_SHARE: f32 = 1.0;

    /// The name of [`SpatialSplits::Auto`].
    const AUTO: &'static str = "auto";

    /// The most references that they may add per triangle.
    pub fn most(self) -> f32 {
        match self {
            SpatialSplits::Share(share) => share,
            SpatialSplits::Auto => Self::AUTO_SHARE,
        }
    }

    /// Checks the number.
    pub(super) fn validate(self) -> Result<()> {
        let is_possible = (0.0..=BvhOptions::MAX_SPATIAL_SPLITS).contains(&self.most());
        if is_possible { Ok(()) } else { Err(impossible(&self.to_string())) }
    }
}

/// The error of a value that is not possible.
fn impossible(value: &str) -> Error {
    let (most, auto) = (BvhOptions::MAX_SPATIAL_SPLITS, SpatialSplits::AUTO);
    Error::option("spatial_splits", format!("{value} is not a number from 0 to {most}, or `{auto}`"))
}

impl From<f32> for SpatialSplits {
    fn from(share: f32) -> Self {
        SpatialSplits::Share(share)
    }
}

impl fmt::Display for SpatialSplits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SpatialSplits::Share(share) => write!(f, "{share}"),
            SpatialSplits::Auto => f.write_str(Self::AUTO),
        }
    }
}

impl FromStr for SpatialSplits {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            Self::AUTO => Ok(SpatialSplits::Auto),
            _ => text.parse().map(SpatialSplits::Share).map_err(|_| impossible(&format!("'{text}'"))),
        }
    }
}

/// A number, or the name.
impl serde::Serialize for SpatialSplits {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            SpatialSplits::Share(share) => serializer.serialize_f32(*share),
            SpatialSplits::Auto => serializer.serialize_str(Self::AUTO),
        }
    }
}
