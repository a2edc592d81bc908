//! Built programs on disk, so that a second run starts in milliseconds.
//!
//! One file for each combination of source, options, driver, device and raybrook version. A file is checked before the driver
//! sees it, because PoCL 3.1 crashes on a truncated binary, and it is replaced as a whole, because several processes may share
//! the folder.
//!
//! ```text
//! bytes  0..16  "raybrook program"
//!       16..48  the key: SHA-256 of everything the binary depends on
//!       48..56  length of the binary, little endian
//!       56..88  SHA-256 of the binary
//!       88..    the binary
//! ```

use super::DeviceInfo;
use sha2::{Digest, Sha256};
use std::io::Write;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 16] = b"raybrook program";
const HASH_BYTES: usize = 32;
const HEADER_BYTES: usize = MAGIC.len() + HASH_BYTES + size_of::<u64>() + HASH_BYTES;

/// Where built programs are kept unless the user says otherwise: `$RAYBROOK_CACHE_DIR`, else `$XDG_CACHE_HOME/raybrook`, else
/// `~/.cache/raybrook`. `None` when none of these variables is set.
pub fn cache_folder() -> Option<PathBuf> {
    folder_of(|name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn folder_of(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    variable("RAYBROOK_CACHE_DIR")
        // The XDG base directory specification: a relative path is invalid and ignored.
        .or_else(|| variable("XDG_CACHE_HOME").filter(|path| path.is_absolute()).map(|path| path.join("raybrook")))
        .or_else(|| variable("HOME").map(|home| home.join(".cache").join("raybrook")))
}

/// A folder of built programs. It is made when the first one is stored.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: PathBuf,
}

/// Everything that a binary depends on, hashed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CacheKey([u8; HASH_BYTES]);

impl CacheKey {
    pub fn new(source: &str, options: &str, device: &DeviceInfo) -> Self {
        let mut hash = Sha256::new();
        let parts = [
            env!("CARGO_PKG_VERSION"),
            &device.platform_name,
            &device.platform_version,
            &device.name,
            &device.driver_version,
            options,
            source,
        ];
        for part in parts {
            // The length first, so that no two lists of parts give the same bytes.
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        CacheKey(hash.finalize().into())
    }

    fn file_name(&self) -> String {
        let hex: String = self.0.iter().map(|byte| format!("{byte:02x}")).collect();
        hex + ".clbin"
    }
}

impl Cache {
    /// The cache in [`cache_folder`], if there is such a folder.
    pub fn open() -> Option<Self> {
        cache_folder().map(Cache::at)
    }

    /// A cache in `folder`, which need not exist.
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Cache { folder: folder.into() }
    }

    /// Where the files are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn path(&self, key: &CacheKey) -> PathBuf {
        self.folder.join(key.file_name())
    }

    /// The binary for `key`; `None` if there is none or the folder cannot be read. The error says how a file is damaged.
    pub(super) fn load(&self, key: &CacheKey) -> Result<Option<Vec<u8>>, String> {
        let Ok(mut bytes) = std::fs::read(self.path(key)) else { return Ok(None) };
        check(&bytes, key)?;
        bytes.drain(..HEADER_BYTES);
        Ok(Some(bytes))
    }

    /// Removes a file that turned out useless; returns the note about it.
    pub(super) fn discard(&self, key: &CacheKey, why: &str) -> String {
        let path = self.path(key);
        // A file that cannot be removed is found useless again the next time; nothing is lost but time.
        let _ = std::fs::remove_file(&path);
        format!("cached kernels in '{}' were not used: {why}", path.display())
    }

    /// Writes the binary for `key`. The error is for people, not for the program: a run without a cache is as good.
    pub(super) fn store(&self, key: &CacheKey, binary: &[u8]) -> Result<(), String> {
        let path = self.path(key);
        let write = || -> std::io::Result<()> {
            std::fs::create_dir_all(&self.folder)?;
            let mut file = tempfile::NamedTempFile::new_in(&self.folder)?;
            file.write_all(&header(key, binary))?;
            file.write_all(binary)?;
            // A reader sees the old file or the new one, whole.
            file.persist(&path)?;
            Ok(())
        };
        write().map_err(|error| format!("cannot write '{}': {error}", path.display()))
    }
}

fn header(key: &CacheKey, binary: &[u8]) -> Vec<u8> {
    let checksum = Sha256::digest(binary);
    [&MAGIC[..], &key.0, &(binary.len() as u64).to_le_bytes(), &checksum].concat()
}

fn check(bytes: &[u8], key: &CacheKey) -> Result<(), String> {
    let Some((head, binary)) = bytes.split_at_checked(HEADER_BYTES) else {
        return Err(format!("it has {} bytes, less than a header", bytes.len()));
    };
    if head == header(key, binary) {
        Ok(())
    } else {
        Err("its header or checksum is wrong: the file is damaged".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(byte: u8) -> CacheKey {
        CacheKey([byte; HASH_BYTES])
    }

    #[test]
    fn a_binary_comes_back_and_any_damage_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path().join("made/when/needed"));
        assert_eq!(cache.load(&key(1)), Ok(None));
        cache.store(&key(1), b"the binary").unwrap();
        assert_eq!(cache.load(&key(1)), Ok(Some(b"the binary".to_vec())));
        assert_eq!(cache.load(&key(2)), Ok(None));

        let path = cache.path(&key(1));
        let good = std::fs::read(&path).unwrap();
        for length in 0..good.len() {
            std::fs::write(&path, &good[..length]).unwrap();
            assert!(cache.load(&key(1)).is_err(), "truncated to {length} bytes");
        }
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            std::fs::write(&path, bad).unwrap();
            assert!(cache.load(&key(1)).is_err(), "byte {at} changed");
        }
        std::fs::write(&path, [&good[..], b"x"].concat()).unwrap();
        assert!(cache.load(&key(1)).is_err(), "a byte too many");
        cache.discard(&key(1), "test");
        assert_eq!(cache.load(&key(1)), Ok(None));
    }

    #[test]
    fn a_file_under_another_key_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        cache.store(&key(1), b"the binary").unwrap();
        std::fs::rename(cache.path(&key(1)), cache.path(&key(2))).unwrap();
        assert!(cache.load(&key(2)).is_err());
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_an_error_text() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let cache = Cache::at(file.path().join("below a file"));
        assert_eq!(cache.load(&key(1)), Ok(None));
        assert!(cache.store(&key(1), b"the binary").unwrap_err().starts_with("cannot write '"));
    }

    #[test]
    fn the_folder_follows_the_variables() {
        for (variables, expected) in [
            (&[("RAYBROOK_CACHE_DIR", "/a"), ("XDG_CACHE_HOME", "/b"), ("HOME", "/c")][..], Some("/a")),
            (&[("XDG_CACHE_HOME", "/b"), ("HOME", "/c")], Some("/b/raybrook")),
            (&[("XDG_CACHE_HOME", "relative"), ("HOME", "/c")], Some("/c/.cache/raybrook")),
            (&[("HOME", "/c")], Some("/c/.cache/raybrook")),
            (&[], None),
        ] {
            let folder =
                folder_of(|name| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| PathBuf::from(value)));
            assert_eq!(folder, expected.map(PathBuf::from));
        }
    }
}
