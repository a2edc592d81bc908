//! What is in the files of frames, so that one that was cut off or damaged is found.

use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

/// Bytes of a file that are read at a time.
const READ_BYTES: usize = 1 << 20;

/// The size and the checksum of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Sum {
    bytes: u64,
    crc32: u32,
}

impl Sum {
    fn of(path: &Path) -> Result<Sum> {
        let read = || -> io::Result<Sum> {
            let mut reader = BufReader::with_capacity(READ_BYTES, File::open(path)?);
            let (mut sum, mut checksum) = (0, crc32fast::Hasher::new());
            loop {
                let bytes = reader.fill_buf()?;
                if bytes.is_empty() {
                    return Ok(Sum { bytes: sum, crc32: checksum.finalize() });
                }
                checksum.update(bytes);
                let count = bytes.len();
                sum += count as u64;
                reader.consume(count);
            }
        };
        read().map_err(|error| Error::io("read", path, error))
    }
}

/// Sums of files by their names.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Sums(Map<String, Value>);

/// Whether a file has what it had when it was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    Same,
    Another,
    /// Nobody has noted what it had.
    Unknown,
}

impl Sums {
    /// Notes what is in a file.
    ///
    /// # Errors
    /// [`Error::Io`] with action "read".
    pub fn note(&mut self, path: &Path) -> Result<()> {
        let Sum { bytes, crc32 } = Sum::of(path)?;
        self.0.insert(name(path), serde_json::json!({ "bytes": bytes, "crc32": crc32 }));
        Ok(())
    }

    /// Whether a file that is there has what was noted.
    ///
    /// # Errors
    /// [`Error::Io`] with action "read".
    pub fn state(&self, path: &Path) -> Result<State> {
        let Some(noted) = self.0.get(&name(path)) else { return Ok(State::Unknown) };
        // What is no sum was damaged itself.
        let Ok(noted) = Sum::deserialize(noted) else { return Ok(State::Another) };
        let length = std::fs::metadata(path).map_err(|error| Error::io("read", path, error))?.len();
        let is_same = length == noted.bytes && Sum::of(path)? == noted;
        Ok(if is_same { State::Same } else { State::Another })
    }
}

/// All lie in one folder.
fn name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_another_if_it_is_cut_off_or_a_bit_of_it_changes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        // More than is read at a time.
        let data: Vec<u8> = (0..READ_BYTES + 1000).map(|i| ((i * i) >> 7) as u8).collect();
        std::fs::write(&path, &data).unwrap();
        let mut sums = Sums::default();
        assert_eq!(sums.state(&path).unwrap(), State::Unknown);
        sums.note(&path).unwrap();
        assert_eq!(sums.state(&path).unwrap(), State::Same);
        let mut changed = data.clone();
        *changed.last_mut().unwrap() ^= 4;
        for other in [&data[..READ_BYTES], &[], &changed, &[&data[..], b"\0"].concat()] {
            std::fs::write(&path, other).unwrap();
            assert_eq!(sums.state(&path).unwrap(), State::Another);
        }
        sums.note(&path).unwrap();
        assert_eq!(sums.state(&path).unwrap(), State::Same);
        std::fs::remove_file(&path).unwrap();
        assert!(sums.state(&path).is_err());
        let damaged: Sums = serde_json::from_str(r#"{"a.png": {"bytes": "many"}}"#).unwrap();
        assert_eq!(damaged.state(&path).unwrap(), State::Another);
    }
}
