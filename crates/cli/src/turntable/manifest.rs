//! What the frames of a turntable are of: frames of another scene, or of other options, are not mixed with them.

use super::TurntableArgs;
use super::frames::Frames;
use raybrook::low_level::input::open_regular;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::write_json;
use raybrook::low_level::renderer::Picture;
use raybrook::low_level::scene::{CameraPath, Scene};
use raybrook::{Error, Result};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

/// Of what kind the file is.
const KIND: &str = "raybrook turntable";

/// What decides the pixels of all frames, by the names of options where there are some.
pub struct Manifest(Map<String, Value>);

impl Manifest {
    pub fn new(
        args: &TurntableArgs,
        scene: &Scene,
        (way, frames): (&CameraPath, u32),
        picture: &Picture,
        options: &TraceOptions,
    ) -> Result<Manifest> {
        // In the shortest form that is read as the same number, so that texts differ where numbers do.
        let text = |value: &dyn std::fmt::Debug| Value::String(format!("{value:?}"));
        let first = way.camera(1);
        let of_picture = &options.picture;
        let values = json!({
            "kind": KIND,
            "version": env!("CARGO_PKG_VERSION"),
            "scene": hashes(scene)?,
            "frames": frames,
            "degrees": args.degrees,
            "camera_keys": if let CameraPath::Keys(keys) = way { text(keys) } else { Value::Null },
            "eye": text(&first.eye),
            "target": text(&first.target),
            "up": text(&first.up),
            "fov": first.fov_degrees,
            "size": text(&picture.size),
            "samples": picture.samples,
            "depth": picture.depth,
            "kill_weight": picture.kill_weight,
            "exposure": args.file.exposure,
            "bit_depth": text(&args.file.format(Path::new("a.png")).ok()),
            "intersector": options.intersector.name(),
            "terminator": of_picture.terminator.name(),
            "texture_filter": of_picture.texture_filter.name(),
            "roulette": of_picture.roulette,
        });
        match values {
            Value::Object(values) => Ok(Manifest(values)),
            _ => Ok(Manifest(Map::new())),
        }
    }

    /// Keeps the frames that are there, if they are of the same turntable; with `restart` removes them. The manifest is
    /// there then.
    ///
    /// # Errors
    /// [`Error::Option`] when they are of another one, or of nobody knows what.
    pub fn take_over(&self, frames: &Frames, restart: bool) -> Result<()> {
        let path = frames.manifest();
        let found = read(&path)?;
        if restart {
            let last = found.as_ref().and_then(|found| found.get("frames")?.as_u64());
            frames.remove(last.and_then(|last| u32::try_from(last).ok()).unwrap_or(0))?;
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
        let differs = |key: &&String| found.get(*key) != self.0.get(*key);
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

/// The names of the files that a scene is made of, without their folders, each with a checksum of what is in it.
fn hashes(scene: &Scene) -> Result<Value> {
    let mut all = Map::new();
    for file in &scene.files {
        // A picture that a library names, and that is not read, may be anything.
        let Ok((opened, _)) = open_regular(&file.path) else { continue };
        let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        all.insert(name, Value::String(checksum(opened).map_err(|e| Error::io("read", &file.path, e))?));
    }
    Ok(Value::Object(all))
}

/// SHA-256, in hexadecimal digits.
fn checksum(mut file: std::fs::File) -> std::io::Result<String> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match file.read(&mut buffer)? {
            0 => break,
            length => hash.update(&buffer[..length]),
        }
    }
    let mut text = String::new();
    for byte in hash.finalize() {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
    }
    Ok(text)
}
