//! What pages are told: of the scene, of the method, of the picture and its camera.

use raybrook::Camera;
use raybrook::glam::Vec3;
use raybrook::low_level::film::Film;
use raybrook::low_level::shared::WorkCounter;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What a page shows of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// The picture.
    Picture,
    /// Counted work as false colours.
    Work(WorkCounter),
    /// Pixels whose hit is not the exact one.
    Wrong,
}

impl Layer {
    /// The counters that can be shown.
    pub const COUNTERS: [WorkCounter; 3] = [WorkCounter::Steps, WorkCounter::Tests, WorkCounter::Leaves];

    /// The name that the page has for it.
    pub fn name(self) -> &'static str {
        match self {
            Layer::Picture => "picture",
            Layer::Work(counter) => counter.name(),
            Layer::Wrong => "wrong",
        }
    }

    /// The layer of that name.
    pub fn find(name: &str) -> Option<Layer> {
        let work = Self::COUNTERS.map(Layer::Work);
        [Layer::Picture, Layer::Wrong].into_iter().chain(work).find(|layer| layer.name() == name)
    }
}

/// A picture that a page shows, and what it took.
#[derive(Debug, Clone)]
pub struct Shown {
    /// Linear radiance, or false colours.
    pub film: Arc<Film>,
    /// What the page tells of it.
    pub facts: PictureFacts,
    /// Pixels of a side for one that was made.
    pub divisor: u32,
    /// Whether no finer picture follows.
    pub is_last: bool,
}

/// What the page tells of a picture.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PictureFacts {
    /// How fine it is.
    pub label: String,
    /// Rays that were cast.
    pub rays: u64,
    /// Millions of rays a second of device time.
    pub mrays_per_s: f64,
    /// The error that is left, as estimated, steps of 8-bit sRGB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f32>,
    /// What false colours mean: black is 0, and this the brightest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brightest: Option<u32>,
    /// Pixels whose hit is not the exact one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wrong: Option<u64>,
    /// Pixels of the picture.
    pub pixels: usize,
}

/// What the page can choose of the method; `auto` leaves a part to the program.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct AskedMethod {
    /// The structure.
    pub structure: String,
    /// The way through a kd-tree.
    pub traversal: String,
    /// The triangle test.
    pub intersector: String,
}

/// What is true of all pages.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SceneFacts {
    /// The scene's file.
    pub scene: String,
    /// Triangles.
    pub triangles: usize,
    /// Where is traced.
    pub device: String,
    /// Width and height of the picture.
    pub size: (u32, u32),
    /// The method in effect, as options.
    pub method: String,
    /// What is typed for a picture such as this one, but for the camera.
    pub command: String,
    /// The method that was asked for.
    pub asked: AskedMethod,
    /// What is wrong, if something is.
    pub notice: Option<String>,
    /// What is being done that takes long, if anything is.
    pub busy: Option<String>,
}

/// What a page learns.
#[derive(Serialize)]
pub struct Told<'a> {
    /// Counts all that the page is told.
    pub version: u64,
    /// Number of the picture.
    pub frame: u64,
    /// What it shows.
    pub layer: &'static str,
    /// Stops by which the picture is lighter.
    pub exposure: f32,
    /// Whether it has the finished picture of what it is to show.
    pub is_finished: bool,
    /// Where the camera is.
    pub camera: CameraText,
    /// What there is to tell of the picture, once there is one.
    pub picture: Option<&'a PictureFacts>,
    /// Why there is no picture.
    pub refused: Option<&'a str>,
    /// What is true of all pages.
    #[serde(flatten)]
    pub facts: &'a SceneFacts,
}

/// A camera as it is written.
#[derive(Debug, PartialEq, Serialize)]
pub struct CameraText {
    /// In a scene file.
    pub toml: String,
    /// On the command line.
    pub options: String,
}

impl CameraText {
    /// `camera` with all digits that its numbers have.
    pub fn of(camera: &Camera) -> CameraText {
        let Camera { eye, target, up, fov_degrees } = *camera;
        // Adding 0 makes -0 positive. TOML has no whole numbers as large as floats, which have a point or an exponent.
        let list = |v: Vec3| v.to_array().map(|x| format!("{:?}", x + 0.0)).join(", ");
        let toml = format!(
            "[camera]\neye = [{}]\ntarget = [{}]\nup = [{}]\nfov = {fov_degrees:?}\n",
            list(eye),
            list(target),
            list(up)
        );
        let [eye, target, up] = [eye, target, up].map(|v| v.to_array().map(|x| (x + 0.0).to_string()).join(","));
        CameraText { toml, options: format!("--eye={eye} --target={target} --up={up} --fov={fov_degrees}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        for eye in [Vec3::new(0.1, -2.5e-7, 3.0), Vec3::new(1e25, -0.0, 1.0 / 3.0)] {
            let camera = Camera { eye, target: Vec3::new(1.0, 2.0, -3.3), up: Vec3::Y, fov_degrees: 40.1 };
            std::fs::write(&path, CameraText::of(&camera).toml).unwrap();
            assert_eq!(raybrook::Scene::load(&path).unwrap().camera, Some(camera));
        }
    }

    #[test]
    fn every_layer_is_found_by_its_name() {
        for name in ["picture", "wrong", "steps", "tests", "leaves"] {
            assert_eq!(Layer::find(name).map(Layer::name), Some(name));
        }
        assert_eq!(Layer::find("bytes"), None);
    }
}
