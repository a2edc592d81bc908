//! Built programs on disk, so that a second run starts in milliseconds.
//!
//! One file for each combination of source, options, driver, device and raybrook version. A file is checked before the
//! driver sees it, because PoCL 3.1 crashes on a truncated binary, and it is replaced as a whole, because several
//! processes may share the folder. For the same reason a file may vanish at any time, which is no more than a miss:
//! whoever writes one removes those that were not used for longest where all together are more than the limit. A file's
//! time of modification is that of its last use, because many systems do not keep the time of access.
//!
//! ```text
//! bytes  0..16  "raybrook program"
//!       16..48  the key: SHA-256 of everything the binary depends on
//!       48..56  length of the binary, little endian
//!       56..88  SHA-256 of the binary
//!       88..    the binary
//! ```

use crate::device_info::DeviceInfo;
use crate::error::{Error, Result};
use crate::io::input::read_regular;
use crate::io::output::{is_unfinished, replace};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

const MAGIC: &[u8; 16] = b"raybrook program";
const HASH_BYTES: usize = 32;
const HEADER_BYTES: usize = MAGIC.len() + HASH_BYTES + size_of::<u64>() + HASH_BYTES;

const SUFFIX: &str = ".clbin";
/// What the name of a file began with while earlier versions wrote it.
const UNFINISHED: &str = "unfinished-";
/// A file that is unfinished for so long is one whose process came to a sudden end.
const UNFINISHED_AT_MOST: Duration = Duration::from_secs(3600);

/// The variable that sets the limit of [`Cache::open`], in megabytes.
const LIMIT_VARIABLE: &str = "RAYBROOK_CACHE_MB";
const BYTES_PER_MEGABYTE: u64 = 1_000_000;

/// Where built programs are kept unless the user says otherwise: `$RAYBROOK_CACHE_DIR`, else
/// `$XDG_CACHE_HOME/raybrook`, else `~/.cache/raybrook`. `None` when none of these variables is set.
pub fn cache_folder() -> Option<PathBuf> {
    folder_of(|name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn folder_of(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    variable("RAYBROOK_CACHE_DIR")
        // The XDG base directory specification: a relative path is invalid and ignored.
        .or_else(|| variable("XDG_CACHE_HOME").filter(|path| path.is_absolute()).map(|path| path.join("raybrook")))
        .or_else(|| variable("HOME").map(|home| home.join(".cache").join("raybrook")))
}

/// The limit in bytes that the text of [`LIMIT_VARIABLE`] sets.
fn limit_of(megabytes: &str) -> Result<u64> {
    let limit = megabytes.trim().parse::<u64>().ok().and_then(|number| number.checked_mul(BYTES_PER_MEGABYTE));
    limit.ok_or_else(|| {
        Error::option(LIMIT_VARIABLE, format!("'{megabytes}': expected a number of megabytes, 0 to keep nothing"))
    })
}

/// A folder of built programs. It is made when the first one is stored.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: PathBuf,
    limit_bytes: u64,
}

/// Everything that a binary depends on, hashed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CacheKey([u8; HASH_BYTES]);

impl CacheKey {
    pub(super) fn new(source: &str, options: &str, device: &DeviceInfo) -> Self {
        CacheKey::of_parts(&[
            env!("CARGO_PKG_VERSION"),
            &device.platform_name,
            &device.platform_version,
            &device.name,
            &device.driver_version,
            options,
            source,
        ])
    }

    /// Of whatever a binary depends on.
    pub fn of_parts(parts: &[&str]) -> Self {
        let mut hash = Sha256::new();
        for part in parts {
            // The length first, so that no two lists of parts give the same bytes.
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        CacheKey(hash.finalize().into())
    }

    fn file_name(&self) -> String {
        let hex: String = self.0.iter().map(|byte| format!("{byte:02x}")).collect();
        hex + SUFFIX
    }
}

/// A file in the folder.
struct Entry {
    last_used: SystemTime,
    path: PathBuf,
    bytes: u64,
}

impl Entry {
    /// `None` for what is not ours, what vanishes, and what may still be written.
    fn of(found: &std::fs::DirEntry) -> Option<Entry> {
        let name = found.file_name().into_string().ok()?;
        let stem = name.strip_suffix(SUFFIX).unwrap_or_default();
        let is_unfinished = stem.starts_with(UNFINISHED) || is_unfinished(&name);
        let is_key = stem.len() == 2 * HASH_BYTES && stem.bytes().all(|byte| byte.is_ascii_hexdigit());
        let metadata = found.metadata().ok().filter(|metadata| metadata.is_file())?;
        let last_used = metadata.modified().ok()?;
        let is_old = last_used.elapsed().is_ok_and(|age| age > UNFINISHED_AT_MOST);
        let is_removable = is_key || is_unfinished && is_old;
        is_removable.then(|| Entry { last_used, path: found.path(), bytes: metadata.len() })
    }
}

impl Cache {
    /// The most bytes of all files together unless something else is asked for; a program took 0.4 MB on PoCL.
    pub const LIMIT_BYTES: u64 = 512 * BYTES_PER_MEGABYTE;

    /// The cache in [`cache_folder`], if there is such a folder, of at most `$RAYBROOK_CACHE_MB` megabytes; `None` as
    /// well where these are 0.
    ///
    /// # Errors
    /// [`Error::Option`] when the variable is not a number.
    pub fn open() -> Result<Option<Self>> {
        let limit_bytes = match std::env::var_os(LIMIT_VARIABLE).filter(|value| !value.is_empty()) {
            Some(megabytes) => limit_of(&megabytes.to_string_lossy())?,
            None => Self::LIMIT_BYTES,
        };
        Ok(cache_folder().filter(|_| limit_bytes > 0).map(|folder| Cache { folder, limit_bytes }))
    }

    /// A cache in `folder`, which need not exist, of at most [`Cache::LIMIT_BYTES`].
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Cache { folder: folder.into(), limit_bytes: Self::LIMIT_BYTES }
    }

    /// The same of at most `limit_bytes`.
    pub fn with_limit(self, limit_bytes: u64) -> Self {
        Cache { limit_bytes, ..self }
    }

    /// Where the files are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn path(&self, key: &CacheKey) -> PathBuf {
        self.folder.join(key.file_name())
    }

    /// The binary for `key`; `None` if there is none or the folder cannot be read.
    ///
    /// # Errors
    /// Says how the file is damaged.
    pub fn load(&self, key: &CacheKey) -> std::result::Result<Option<Vec<u8>>, String> {
        let path = self.path(key);
        // A pipe would block.
        if path.metadata().is_ok_and(|found| !found.is_file()) {
            return Err("it is not a regular file".to_owned());
        }
        let Ok(mut bytes) = read_regular(&path) else { return Ok(None) };
        check(&bytes, key)?;
        bytes.drain(..HEADER_BYTES);
        // In a folder that cannot be written it is not removed either.
        let _ = File::options().append(true).open(&path).and_then(|file| file.set_modified(SystemTime::now()));
        Ok(Some(bytes))
    }

    /// Removes a file that turned out useless; returns the note about it.
    pub(super) fn discard(&self, key: &CacheKey, why: &str) -> String {
        let path = self.path(key);
        // A file that cannot be removed is found useless again the next time; nothing is lost but time.
        let _ = std::fs::remove_file(&path);
        format!("cached kernels in '{}' were not used: {why}", path.display())
    }

    /// Writes the binary for `key`, and removes others beyond the limit.
    ///
    /// # Errors
    /// Says what went wrong, for people, not for the program: a run without a cache is as good.
    pub fn store(&self, key: &CacheKey, binary: &[u8]) -> std::result::Result<(), String> {
        let path = self.path(key);
        let bytes = (HEADER_BYTES + binary.len()) as u64;
        if bytes > self.limit_bytes {
            return Err(format!(
                "they take {bytes} bytes, all of the cache may take {} ({LIMIT_VARIABLE})",
                self.limit_bytes
            ));
        }
        let write = || -> std::io::Result<()> {
            std::fs::create_dir_all(&self.folder)?;
            // A reader sees the old file or the new one, whole.
            replace(&path, &self.folder, None, |file| {
                file.write_all(&header(key, binary))?;
                file.write_all(binary)
            })
        };
        write().map_err(|error| format!("cannot write '{}': {error}", path.display()))?;
        self.remove_oldest(&path);
        Ok(())
    }

    /// Removes files, that which was not used for longest first, until those that are left keep the limit; never
    /// `newest`. What cannot be listed or removed stays: the limit is no reason to fail.
    fn remove_oldest(&self, newest: &Path) {
        let Ok(folder) = std::fs::read_dir(&self.folder) else { return };
        let mut entries: Vec<Entry> = folder.flatten().filter_map(|found| Entry::of(&found)).collect();
        entries.sort_by(|a, b| (a.last_used, &a.path).cmp(&(b.last_used, &b.path)));
        let mut bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        for entry in entries.iter().filter(|entry| entry.path != newest) {
            if bytes <= self.limit_bytes {
                break;
            }
            match std::fs::remove_file(&entry.path) {
                // Another process may be doing the same.
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {}
                _ => bytes -= entry.bytes,
            }
        }
    }
}

fn header(key: &CacheKey, binary: &[u8]) -> Vec<u8> {
    let checksum = Sha256::digest(binary);
    [&MAGIC[..], &key.0, &(binary.len() as u64).to_le_bytes(), &checksum].concat()
}

fn check(bytes: &[u8], key: &CacheKey) -> std::result::Result<(), String> {
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

    /// The files in the folder, and the bytes of all.
    fn used(cache: &Cache) -> (usize, u64) {
        let sizes = std::fs::read_dir(cache.folder()).unwrap().map(|found| found.unwrap().metadata().unwrap().len());
        sizes.fold((0, 0), |(files, bytes), size| (files + 1, bytes + size))
    }

    /// Pretends that a file was last used so many seconds ago.
    fn age(path: &Path, seconds: u64) {
        let then = SystemTime::now() - Duration::from_secs(seconds);
        File::options().append(true).open(path).unwrap().set_modified(then).unwrap();
    }

    const BINARY: &[u8] = &[7; 1000];
    const FILE_BYTES: u64 = (HEADER_BYTES + BINARY.len()) as u64;

    #[test]
    fn what_was_not_used_for_longest_makes_room() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path()).with_limit(3 * FILE_BYTES);
        let is_there = |number: u8| cache.path(&key(number)).exists();
        for number in [1, 2, 3] {
            cache.store(&key(number), BINARY).unwrap();
            age(&cache.path(&key(number)), 1000 - u64::from(number));
        }
        assert_eq!(used(&cache), (3, 3 * FILE_BYTES));
        // The oldest one is used again.
        assert!(cache.load(&key(1)).unwrap().is_some());
        cache.store(&key(4), BINARY).unwrap();
        assert_eq!([1, 2, 3, 4].map(is_there), [true, false, true, true]);
        // One byte more than fits beside two others.
        cache.store(&key(5), &[BINARY, b"x"].concat()).unwrap();
        assert_eq!([1, 3, 4, 5].map(is_there).into_iter().filter(|&is_there| is_there).count(), 2);
        assert!(!is_there(3) && is_there(5));
        // The new one stays although the clock says that it is the oldest.
        age(&cache.path(&key(5)), 5);
        let ahead = SystemTime::now() + Duration::from_secs(1000);
        let others = std::fs::read_dir(folder.path()).unwrap().map(|found| found.unwrap().path());
        others.for_each(|path| File::options().append(true).open(path).unwrap().set_modified(ahead).unwrap());
        cache.store(&key(6), BINARY).unwrap();
        assert!(is_there(6) && used(&cache).1 <= 3 * FILE_BYTES);
    }

    #[test]
    fn nothing_is_removed_but_what_the_cache_wrote_and_nobody_writes() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path()).with_limit(FILE_BYTES);
        let kept = ["notes.txt", "program.clbin", "unfinished-now.clbin", "unfinished-paper.txt"];
        let removed = ["unfinished-long-ago.clbin", ".raybrook-f1le.tmp"];
        for name in kept.into_iter().chain(removed) {
            std::fs::write(folder.path().join(name), BINARY).unwrap();
            age(&folder.path().join(name), if name.contains("now") { 60 } else { 86_400 });
        }
        std::fs::create_dir(cache.path(&key(9))).unwrap();
        cache.store(&key(1), BINARY).unwrap();
        cache.store(&key(2), BINARY).unwrap();
        assert!(!cache.path(&key(1)).exists() && cache.path(&key(2)).exists() && cache.path(&key(9)).is_dir());
        assert!(kept.iter().all(|name| folder.path().join(name).exists()));
        assert!(removed.iter().all(|name| !folder.path().join(name).exists()));
        let refused = cache.store(&key(3), &[BINARY, b"x"].concat()).unwrap_err();
        assert!(refused.contains("may take") && cache.load(&key(3)) == Ok(None), "{refused}");
        assert!(cache.load(&key(2)).unwrap().is_some(), "what does not fit removes nothing");
    }

    #[test]
    fn several_may_write_read_and_remove_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path()).with_limit(4 * FILE_BYTES);
        std::thread::scope(|scope| {
            for thread in 0..8u8 {
                let cache = cache.clone();
                scope.spawn(move || {
                    for turn in 0..100u8 {
                        cache.store(&key(thread ^ (turn % 16)), BINARY).unwrap();
                        // Whole or a miss, never damaged.
                        let found = cache.load(&key(turn % 11)).unwrap();
                        assert!(found.is_none_or(|binary| binary == BINARY));
                    }
                });
            }
        });
        cache.store(&key(99), BINARY).unwrap();
        assert!(used(&cache).1 <= 4 * FILE_BYTES, "{:?}", used(&cache));
        assert!(cache.load(&key(99)).unwrap().is_some());
    }

    #[test]
    fn the_limit_is_a_number_of_megabytes() {
        assert_eq!([limit_of("0").unwrap(), limit_of(" 512 ").unwrap()], [0, Cache::LIMIT_BYTES]);
        for bad in ["", "many", "-1", "1.5", "99999999999999999999", "18446744073709551615"] {
            let error = limit_of(bad).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains("RAYBROOK_CACHE_MB"), "{error}");
        }
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
