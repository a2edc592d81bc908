//! What the frames of a turntable are of: frames of another scene, or of other options, are not mixed with them.

use super::TurntableArgs;
use super::frames::Frames;
use crate::layers;
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::write_json;
use raybrook::low_level::renderer::{Picture, PictureId};
use raybrook::low_level::scene::{CameraPath, Scene};
use raybrook::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Of what kind the file is.
const KIND: &str = "raybrook turntable";

/// What decides the pixels of all frames, by the names of options where there are some.
pub struct Manifest(Map<String, Value>);

impl Manifest {
    pub fn new(
        args: &TurntableArgs,
        scene: &Scene,
        (way, frames): (&CameraPath, u32),
        (picture, format): (&Picture, ImageFormat),
        options: &TraceOptions,
    ) -> Manifest {
        // In the shortest form that is read as the same number, so that texts differ where numbers do.
        let text = |value: &dyn std::fmt::Debug| Value::String(format!("{value:?}"));
        let first = way.camera(1);
        let mut values = json!(PictureId::new(scene, picture, None, options));
        let of_frames = json!({
            "kind": KIND,
            "frames": frames,
            "degrees": args.degrees,
            "camera_keys": if let CameraPath::Keys(keys) = way { text(keys) } else { Value::Null },
            "eye": text(&first.eye),
            "target": text(&first.target),
            "up": text(&first.up),
            "fov": first.fov_degrees,
            "exposure": args.file.exposure,
            "layers": (!args.layers.names().is_empty()).then(|| args.layers.names()),
            "format": text(&format),
        });
        if let (Value::Object(values), Value::Object(of_frames)) = (&mut values, of_frames) {
            values.extend(of_frames);
        }
        match values {
            Value::Object(values) => Manifest(values),
            _ => Manifest(Map::new()),
        }
    }

    /// Keeps the frames that are there, if they are of the same turntable; with `restart` removes them and what was
    /// written `beside` them. The manifest is there then.
    ///
    /// # Errors
    /// [`Error::Option`] when they are of another one, or of nobody knows what.
    pub fn take_over(&self, frames: &Frames, restart: bool, beside: impl Fn(&Path) -> Vec<PathBuf>) -> Result<()> {
        let path = frames.manifest();
        let found = read(&path)?;
        if restart {
            let last = found.as_ref().and_then(|found| found.get("frames")?.as_u64());
            let layers = found.as_ref().and_then(|found| found.get("layers")?.as_array().cloned()).unwrap_or_default();
            let layers: Vec<&str> = layers.iter().filter_map(|name| layers::known(name.as_str()?)).collect();
            let all = |frame: &Path| [beside(frame), layers::files_of(frame, &layers)].concat();
            frames.remove(last.and_then(|last| u32::try_from(last).ok()).unwrap_or(0), all)?;
        } else if let Some(found) = found {
            return self.check(&found, frames);
        } else if frames.any() {
            let message = format!(
                "'{}' has frames, and nothing that tells what they are of; choose another name, or remove them with \
                 --restart",
                frames.name().display()
            );
            return Err(Error::option("-o", message));
        }
        write_json(&path, &self.0)
    }

    fn check(&self, found: &Map<String, Value>, frames: &Frames) -> Result<()> {
        // What an older version did not write is as if nobody had asked for it.
        let of = |values: &Map<String, Value>, key: &str| values.get(key).cloned().unwrap_or_default();
        let differs = |key: &&String| of(found, key) != of(&self.0, key);
        let names: Vec<&str> = self.0.keys().filter(differs).map(String::as_str).collect();
        if names.is_empty() {
            return Ok(());
        }
        let message = format!(
            "'{}' has frames of another turntable, with another {}; choose another name, or make them anew with \
             --restart",
            frames.name().display(),
            names.join(", ").replace('_', "-")
        );
        Err(Error::option("-o", message))
    }
}

/// The manifest that is there; an empty one for a file that is none.
fn read(path: &Path) -> Result<Option<Map<String, Value>>> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(serde_json::from_slice(&bytes).unwrap_or_default())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io("read", path, error)),
    }
}
