//! The file that remembers what was fastest, beside the compiled kernels.
//!
//! It holds one entry for each device, version of its driver and of raybrook, and size of scene; entries of other
//! versions are kept until the same device is measured again, but not used. It is written as a whole or not at all. Two
//! processes that write it at the same time both succeed, and the file is that of the last one.

use super::{Candidate, SceneTuning, fastest};
use crate::choose::{SceneSize, TunedChoice};
use crate::device_info::DeviceInfo;
use crate::error::{Error, Result};
use crate::io::input::read_regular;
use crate::io::output::{check_writable, write_json};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const FILE_NAME: &str = "tuned.json";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What a measurement holds for: a device with its driver, and this version of raybrook.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceKey {
    /// The driver's name; empty for the reference.
    platform: String,
    /// The device's name.
    device: String,
    /// Versions of the driver and of its device part.
    driver_version: String,
    /// The version of raybrook.
    raybrook_version: String,
}

impl DeviceKey {
    /// The key of `device`; `None`: of the reference.
    pub fn new(device: Option<&DeviceInfo>) -> DeviceKey {
        let raybrook_version = VERSION.to_owned();
        match device {
            Some(info) => DeviceKey {
                platform: info.platform_name.clone(),
                device: info.name.clone(),
                driver_version: format!("{} {}", info.platform_version, info.driver_version),
                raybrook_version,
            },
            None => DeviceKey {
                platform: String::new(),
                device: "reference".to_owned(),
                driver_version: String::new(),
                raybrook_version,
            },
        }
    }

    fn is_same_device(&self, other: &DeviceKey) -> bool {
        (&self.platform, &self.device) == (&other.platform, &other.device)
    }
}

/// What was found for scenes of one size on one device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Entry {
    #[serde(flatten)]
    key: DeviceKey,
    size: String,
    accel: String,
    packet_size: String,
    /// How many times as fast as what the model takes.
    ratio: f64,
    /// What the model takes.
    model: String,
    /// Triangles of the scenes that were measured.
    triangle_counts: Vec<usize>,
}

impl Entry {
    /// The choice, for a scene of so many triangles; the error says what is wrong with the entry.
    fn choice(&self, triangle_count: usize) -> std::result::Result<TunedChoice, String> {
        let read = || -> Result<Candidate> {
            let candidate = Candidate { structure: self.accel.parse()?, packet_size: self.packet_size.parse()? };
            candidate.options().validate().map(|()| candidate)
        };
        let candidate = read().map_err(|error| error.to_string())?;
        let counts: Vec<_> = self.triangle_counts.iter().map(ToString::to_string).collect();
        let speed = match self.model == candidate.to_string() {
            true => format!("nothing was clearly faster than {}", self.model),
            false => format!("{:.2} times the speed of {}", self.ratio, self.model),
        };
        let reason =
            format!("{speed} in {} scenes ({} triangles; this one has {triangle_count})", self.size, counts.join(", "));
        Ok(TunedChoice { structure: candidate.structure, packet_size: candidate.packet_size, reason })
    }
}

/// What is remembered.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Entries {
    entries: Vec<Entry>,
}

/// What was found for one size of scenes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tuning {
    /// The size.
    pub size: SceneSize,
    /// The fastest.
    pub fastest: Candidate,
    /// How many times as fast as the model's choice it is.
    pub ratio: f64,
    /// The model's choice.
    pub model: Candidate,
    /// Triangles of the scenes that were measured.
    pub triangle_counts: Vec<usize>,
}

impl Tuning {
    /// What follows from `scenes`, for each size of which there is one, the smallest first; sizes with different
    /// answers are left out.
    pub fn of(scenes: &[SceneTuning]) -> Vec<Tuning> {
        let tuning = |size| {
            let of_size: Vec<_> = scenes.iter().filter(|scene| scene.size == size).collect();
            let (fastest, ratio) = fastest(&of_size)?;
            let model = of_size.first()?.measured.first()?.candidate;
            let triangle_counts = of_size.iter().map(|scene| scene.triangle_count).collect();
            Some(Tuning { size, fastest, ratio, model, triangle_counts })
        };
        SceneSize::ALL.into_iter().filter_map(tuning).collect()
    }
}

/// The file in a folder such as [`cache_folder`](crate::device::cache_folder). It need not exist.
#[derive(Debug, Clone)]
pub struct TunedFile {
    path: PathBuf,
}

impl TunedFile {
    /// The file in `folder`.
    pub fn in_folder(folder: impl AsRef<Path>) -> TunedFile {
        TunedFile { path: folder.as_ref().join(FILE_NAME) }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The entries, none without a file; the error says what is wrong with the file.
    fn read(&self) -> std::result::Result<Entries, String> {
        match read_regular(&self.path) {
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| error.to_string()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Entries::default()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// What is remembered for scenes of `triangle_count` triangles, if anything is. The error is a note for people, and
    /// no reason to fail: the file is damaged, or what it says of this device holds for other versions.
    pub fn find(&self, key: &DeviceKey, triangle_count: usize) -> std::result::Result<Option<TunedChoice>, String> {
        let ignored = |why: String| {
            format!("'{}' is ignored: {why}; `raybrook tune` makes it anew, `forget` removes it", self.path.display())
        };
        let entries = self.read().map_err(ignored)?.entries;
        let size = SceneSize::of(triangle_count).name();
        let of_device: Vec<_> =
            entries.iter().filter(|entry| entry.key.is_same_device(key) && entry.size == size).collect();
        match (of_device.iter().find(|entry| entry.key == *key), of_device.first()) {
            (Some(entry), _) => entry.choice(triangle_count).map(Some).map_err(ignored),
            (None, Some(Entry { key: old, .. })) => Err(format!(
                "what `raybrook tune` found on {} is ignored: it was measured with driver '{}' and raybrook {}, now \
                 these are '{}' and {}; measure again",
                key.device, old.driver_version, old.raybrook_version, key.driver_version, key.raybrook_version
            )),
            (None, None) => Ok(None),
        }
    }

    /// Remembers `tunings` of a device, in place of what was known of the same sizes. Returns a note where the old file
    /// was damaged.
    ///
    /// # Errors
    /// [`Error::Io`]: the folder cannot be made or the file not be written.
    pub fn remember(&self, key: &DeviceKey, tunings: &[Tuning]) -> Result<Option<String>> {
        let (mut all, note) = match self.read() {
            Ok(entries) => (entries, None),
            Err(why) => (Entries::default(), Some(format!("'{}' is replaced: {why}", self.path.display()))),
        };
        let is_replaced = |entry: &Entry| {
            entry.key.is_same_device(key) && tunings.iter().any(|tuning| tuning.size.name() == entry.size)
        };
        all.entries.retain(|entry| !is_replaced(entry));
        all.entries.extend(tunings.iter().map(|tuning| Entry {
            key: key.clone(),
            size: tuning.size.name().to_owned(),
            accel: tuning.fastest.structure.name().to_owned(),
            packet_size: tuning.fastest.packet_size.name().to_owned(),
            ratio: tuning.ratio,
            model: tuning.model.to_string(),
            triangle_counts: tuning.triangle_counts.clone(),
        }));
        if self.path.metadata().is_ok_and(|found| !found.is_file()) {
            let source = std::io::Error::other("it is not a regular file; remove it");
            return Err(Error::io("write", &self.path, source));
        }
        self.make_folder()?;
        write_json(&self.path, &all).map(|()| note)
    }

    /// Checks that it can be written, and makes the folder that it belongs into.
    ///
    /// # Errors
    /// [`Error::Io`]: the folder cannot be made or the file not be written.
    pub fn check_writable(&self) -> Result<()> {
        self.make_folder()?;
        check_writable(&self.path)
    }

    fn make_folder(&self) -> Result<()> {
        let folder = self.path.parent();
        folder.map_or(Ok(()), |folder| std::fs::create_dir_all(folder).map_err(|e| Error::io("create", folder, e)))
    }

    /// Removes the file; whether there was one.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be removed.
    pub fn forget(&self) -> Result<bool> {
        match std::fs::remove_file(&self.path) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(Error::io("remove", &self.path, error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_info::sample_info;
    use crate::options::{PacketSize, StructureKind};

    fn tuning(size: SceneSize, accel: StructureKind) -> Tuning {
        let candidate = |accel| Candidate { structure: accel, packet_size: PacketSize::One };
        Tuning {
            size,
            fastest: candidate(accel),
            ratio: 1.5,
            model: candidate(StructureKind::Bvh2),
            triangle_counts: vec![7],
        }
    }

    /// A file in a folder that does not exist yet, and the key of a device.
    fn file() -> (tempfile::TempDir, TunedFile, DeviceKey) {
        let folder = tempfile::tempdir().unwrap();
        let file = TunedFile::in_folder(folder.path().join("made/when/needed"));
        (folder, file, DeviceKey::new(Some(&sample_info())))
    }

    #[test]
    fn what_is_remembered_is_found_for_its_device_and_size() {
        let (_folder, file, key) = file();
        assert_eq!(file.find(&key, 7), Ok(None));
        assert!(!file.forget().unwrap());
        file.remember(
            &key,
            &[tuning(SceneSize::Tiny, StructureKind::Kd), tuning(SceneSize::Large, StructureKind::Bvh2)],
        )
        .unwrap();
        let found = |count| file.find(&key, count).unwrap();
        let tiny = found(12).unwrap();
        assert_eq!((tiny.structure, tiny.packet_size), (StructureKind::Kd, PacketSize::One));
        for words in ["1.50 times the speed of bvh2", "tiny", "this one has 12"] {
            assert!(tiny.reason.contains(words), "{}", tiny.reason);
        }
        assert!(found(1 << 20).unwrap().reason.contains("nothing was clearly faster than bvh2"));
        assert_eq!(found(1000), None);
        assert_eq!(file.find(&DeviceKey::new(None), 12), Ok(None));

        // Another device and a new measurement of one size leave the rest as it is.
        file.remember(&DeviceKey::new(None), &[tuning(SceneSize::Tiny, StructureKind::Grid)]).unwrap();
        file.remember(&key, &[tuning(SceneSize::Tiny, StructureKind::Octree)]).unwrap();
        assert_eq!(found(12).unwrap().structure, StructureKind::Octree);
        assert_eq!(found(1 << 20).unwrap().structure, StructureKind::Bvh2);
        assert_eq!(file.find(&DeviceKey::new(None), 12).unwrap().unwrap().structure, StructureKind::Grid);
        assert!(file.forget().unwrap());
        assert_eq!(found(12), None);
    }

    #[test]
    fn other_versions_and_damage_are_notes() {
        let (_folder, file, key) = file();
        file.remember(&key, &[tuning(SceneSize::Tiny, StructureKind::Bvh2)]).unwrap();
        let newer = DeviceKey::new(Some(&DeviceInfo { driver_version: "newer".to_owned(), ..sample_info() }));
        let note = file.find(&newer, 7).unwrap_err();
        assert!(note.contains("measured with driver") && note.contains("newer"), "{note}");
        assert_eq!(file.find(&newer, 5000), Ok(None));

        let good = std::fs::read_to_string(file.path()).unwrap();
        for (from, to, words) in [
            ("\"bvh2\"", "\"tree\"", "no 'tree'"),
            ("\"1\"", "\"16\"", "packet_size"),
            ("\"entries\"", "\"others\"", "entries"),
        ] {
            std::fs::write(file.path(), good.replace(from, to)).unwrap();
            let note = file.find(&key, 7).unwrap_err();
            assert!(note.contains(words) && note.contains("forget"), "{note}");
        }
        for length in 0..good.trim_end().len() {
            std::fs::write(file.path(), &good[..length]).unwrap();
            assert!(file.find(&key, 7).is_err(), "truncated to {length} bytes");
        }
        let note = file.remember(&key, &[tuning(SceneSize::Tiny, StructureKind::Grid)]).unwrap();
        assert!(note.unwrap().contains("is replaced"));
        assert_eq!(file.find(&key, 7).unwrap().unwrap().structure, StructureKind::Grid);
        std::fs::remove_file(file.path()).unwrap();
        std::fs::create_dir(file.path()).unwrap();
        assert!(file.find(&key, 7).is_err());
        assert_eq!(file.forget().unwrap_err().exit_code(), 5);
    }
}
