//! What the frames of a turntable are of: frames of another scene, or of other options, are not mixed with them. And
//! what was in each when it was written.

use super::frames::Frames;
use super::sums::{State, Sums};
use super::{MOST_FRAMES, TurntableArgs};
use crate::layers;
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::write_json;
use raybrook::low_level::renderer::{Picture, PictureId};
use raybrook::low_level::scene::{CameraPath, Scene};
use raybrook::{Error, Result};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Of what kind the file is.
const KIND: &str = "raybrook turntable";

/// The key of the sums of all files, which do not decide anything.
const FILES: &str = "files";

/// What decides the pixels of all frames, by the names of options where there are some.
#[derive(Debug, Clone)]
pub struct Manifest(Map<String, Value>);

impl Manifest {
    /// Of so many frames of a scene.
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

    /// Of whatever the frames that are there are of; `None` where nothing tells that.
    ///
    /// # Errors
    /// The file that does cannot be read.
    pub fn of_frames(frames: &Frames) -> Result<Option<Manifest>> {
        let mut found = read(&frames.manifest())?.filter(|values| !values.is_empty());
        if let Some(values) = &mut found {
            values.remove(FILES);
        }
        Ok(found.map(Manifest))
    }

    /// Keeps the frames that are there, if they are of the same turntable; with `restart` removes them and what was
    /// written `beside` them. The manifest is there then.
    ///
    /// # Errors
    /// [`Error::Option`] when they are of another one, or of nobody knows what.
    pub fn take_over(self, frames: &Frames, restart: bool, beside: impl Fn(&Path) -> Vec<PathBuf>) -> Result<Kept> {
        let path = frames.manifest();
        let found = read(&path)?;
        if restart {
            // No turntable has more; a file may say anything.
            let last =
                found.as_ref().and_then(|found| found.get("frames")?.as_u64()).unwrap_or(0).min(MOST_FRAMES.into());
            let layers = found.as_ref().and_then(|found| found.get("layers")?.as_array().cloned()).unwrap_or_default();
            let layers: Vec<&str> = layers.iter().filter_map(|name| layers::known(name.as_str()?)).collect();
            let all = |frame: &Path| [beside(frame), layers::files_of(frame, &layers)].concat();
            frames.remove(last as u32, all)?;
        } else if let Some(found) = found {
            self.check(&found, frames)?;
            // What is none of that was damaged; it is as if nothing had been noted.
            let sums = found.get(FILES).and_then(|files| Sums::deserialize(files).ok()).unwrap_or_default();
            return Ok(Kept { path, manifest: self, sums });
        } else if frames.any() {
            let message = format!(
                "'{}' has frames, and nothing that tells what they are of; choose another name, or remove them with \
                 --restart",
                frames.name().display()
            );
            return Err(Error::option("-o", message));
        }
        let kept = Kept { path, manifest: self, sums: Sums::default() };
        kept.write()?;
        Ok(kept)
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

/// Frames that are there, and what is noted of them.
#[derive(Debug)]
pub struct Kept {
    path: PathBuf,
    manifest: Manifest,
    sums: Sums,
}

/// Frames that are to be made.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct ToMake {
    /// Their numbers.
    pub frames: Vec<u32>,
    /// Files that are there, and have not what was written.
    pub damaged: Vec<PathBuf>,
}

impl Kept {
    /// The frames of which a file is not there, the frame itself or one `beside` it, or has not what was written;
    /// `progress` is told how many frames were looked at.
    ///
    /// Files of which nothing is noted are taken for whole, because they get their names when they are: the run ended
    /// right then. What they have is noted now.
    ///
    /// # Errors
    /// A file cannot be read, or the manifest not be written.
    pub fn to_make(
        &mut self,
        frames: &Frames,
        beside: impl Fn(&Path) -> Vec<PathBuf>,
        progress: impl Fn(u32),
    ) -> Result<ToMake> {
        let (mut to_make, mut is_noted) = (ToMake::default(), false);
        for frame in frames.all() {
            let path = frames.path(frame);
            let files = [vec![path.clone()], beside(&path)].concat();
            let damaged = to_make.damaged.len();
            let is_there = files.iter().all(|file| file.exists());
            for file in files.into_iter().filter(|_| is_there) {
                match self.sums.state(&file)? {
                    State::Same => {}
                    State::Another => to_make.damaged.push(file),
                    State::Unknown => {
                        self.sums.note(&file)?;
                        is_noted = true;
                    }
                }
            }
            if !is_there || to_make.damaged.len() > damaged {
                to_make.frames.push(frame);
            }
            progress(frame);
        }
        if is_noted {
            self.write()?;
        }
        Ok(to_make)
    }

    /// Notes what is in files that were written.
    ///
    /// # Errors
    /// One of them cannot be read, or the manifest not be written.
    pub fn note(&mut self, files: &[PathBuf]) -> Result<()> {
        files.iter().try_for_each(|file| self.sums.note(file))?;
        self.write()
    }

    fn write(&self) -> Result<()> {
        let mut values = self.manifest.0.clone();
        values.insert(FILES.to_owned(), json!(self.sums));
        write_json(&self.path, &values)
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
