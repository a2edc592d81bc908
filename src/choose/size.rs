//! How large a scene is, as far as what is fastest depends on it.

use serde::Serialize;
use std::fmt;

/// Sizes of scenes. What [`crate::choose::tune`] finds is remembered for each of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneSize {
    /// Up to 99 triangles.
    Tiny,
    /// Up to 9,999.
    Small,
    /// Up to 299,999.
    Medium,
    /// More.
    Large,
}

impl SceneSize {
    /// Every size, the smallest first.
    pub const ALL: [SceneSize; 4] = [SceneSize::Tiny, SceneSize::Small, SceneSize::Medium, SceneSize::Large];

    /// The size of a scene of so many triangles that can be hit.
    pub fn of(triangle_count: usize) -> SceneSize {
        let fits = |size: &SceneSize| triangle_count >= size.fewest();
        Self::ALL.into_iter().rfind(fits).expect("the smallest has no fewest triangles")
    }

    /// The fewest triangles of a scene of this size.
    pub fn fewest(self) -> usize {
        match self {
            SceneSize::Tiny => 0,
            SceneSize::Small => 100,
            SceneSize::Medium => 10_000,
            SceneSize::Large => 300_000,
        }
    }

    /// The name.
    pub fn name(self) -> &'static str {
        match self {
            SceneSize::Tiny => "tiny",
            SceneSize::Small => "small",
            SceneSize::Medium => "medium",
            SceneSize::Large => "large",
        }
    }
}

impl fmt::Display for SceneSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
