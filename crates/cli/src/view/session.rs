//! One page: where its camera is, what it shows, and what it is told.

use super::facts::{CameraText, Layer, SceneFacts, Shown, Told};
use super::navigator::Navigator;
use raybrook::Camera;
use raybrook::low_level::film::Film;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// For a page that has not asked for so long nothing is made until it asks again: it is closed, or asleep.
pub const ASLEEP_AFTER: Duration = Duration::from_secs(5);

/// News for a page.
pub struct News {
    /// What it tells, as JSON.
    pub text: String,
    /// The picture, if it is another one than the page has, with its exposure.
    pub picture: Option<(Arc<Film>, f32)>,
}

/// One page.
pub struct Session {
    pub navigator: Navigator,
    pub layer: Layer,
    pub exposure: f32,
    /// Counts what makes pictures that are on their way worthless.
    pub generation: u64,
    /// The next step of refinement; `None` when the picture is finished.
    pub step: Option<usize>,
    /// How coarse the coarse picture was.
    pub divisor: u32,
    pub shown: Option<Shown>,
    /// Why there is no picture.
    pub refused: Option<String>,
    /// Number of the picture.
    pub frame: u64,
    /// Counts all that the page tells.
    pub version: u64,
    pub asked: Instant,
}

impl Session {
    /// A page that begins, in a scene of that diagonal, which `camera` sees first.
    pub fn new(camera: Camera, diagonal: f64) -> Session {
        Session {
            navigator: Navigator::new(camera, diagonal),
            layer: Layer::Picture,
            exposure: 0.0,
            generation: 0,
            step: Some(0),
            divisor: 1,
            shown: None,
            refused: None,
            frame: 0,
            version: 1,
            asked: Instant::now(),
        }
    }

    pub fn is_asleep(&self) -> bool {
        self.asked.elapsed() >= ASLEEP_AFTER
    }

    pub fn begin_anew(&mut self) {
        self.generation += 1;
        (self.step, self.refused) = (Some(0), None);
        self.version += 1;
    }

    /// Whether the picture is the finished one of what is to be shown. This alone decides it for pages, and for files
    /// that are saved.
    pub fn is_finished(&self, facts: &SceneFacts) -> bool {
        let has_all = self.shown.is_some() && self.step.is_none();
        has_all && self.refused.is_none() && facts.busy.is_none()
    }

    /// What the page is told that has the picture number `frame`.
    pub fn news(&self, facts: &SceneFacts, frame: u64) -> News {
        let told = Told {
            version: self.version,
            frame: self.frame,
            layer: self.layer.name(),
            exposure: self.exposure,
            is_finished: self.is_finished(facts),
            camera: CameraText::of(&self.navigator.camera()),
            picture: self.shown.as_ref().map(|shown| &shown.facts),
            refused: self.refused.as_deref(),
            facts,
        };
        let text = serde_json::to_string(&told).expect("numbers and names serialise");
        let shown = self.shown.as_ref().filter(|_| self.frame != frame);
        News { text, picture: shown.map(|shown| (shown.film.clone(), self.exposure)) }
    }
}
