//! Opens input files: regular ones alone, as a pipe would block and a device may have no end; and how many at a time.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// What a message says of anything else.
const NOT_REGULAR: &str = "is not a regular file";

/// Opens the regular file `path` for reading, and tells its size in bytes.
pub fn open_regular(path: &Path) -> Result<(File, u64)> {
    match open(path).map_err(|e| Error::io("read", path, e))? {
        Some(opened) => Ok(opened),
        None => Err(Error::input(path, None, NOT_REGULAR)),
    }
}

/// All of the regular file `path`.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let Some((mut file, _)) = open(path)? else { return Err(io::Error::other(format!("it {NOT_REGULAR}"))) };
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// `None` for what is no regular file, which is not opened: that alone may block.
fn open(path: &Path) -> io::Result<Option<(File, u64)>> {
    let metadata = path.metadata()?;
    if metadata.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
    }
    if !metadata.is_file() {
        return Ok(None);
    }
    Ok(Some((File::open(path)?, metadata.len())))
}

/// Fills `bytes` from `place` of a file on, wherever others read in it.
///
/// # Errors
/// The system cannot read, or the file ends before.
#[cfg(unix)]
pub(crate) fn read_exact_at(file: &File, bytes: &mut [u8], place: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, place)
}

#[cfg(windows)]
pub(crate) fn read_exact_at(file: &File, bytes: &mut [u8], place: u64) -> io::Result<()> {
    let (mut rest, mut place) = (bytes, place);
    while !rest.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, rest, place)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => (rest, place) = (&mut rest[count..], place + count as u64),
        }
    }
    Ok(())
}

/// Files that the rest of a process may have open: outputs, libraries, a driver's devices.
const OTHER_FILES: u64 = 64;
/// More are not open at a time, however many may be.
const MOST_FILES: u64 = 1 << 16;
/// Where nobody says how many may be.
#[cfg(not(unix))]
const USUAL_FILES: u64 = 512;

/// How many input files may be open at a time, beside those that a process needs for other things.
pub fn most_open_files() -> usize {
    #[cfg(unix)]
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).current.unwrap_or(u64::MAX);
    #[cfg(not(unix))]
    let limit = USUAL_FILES;
    limit.saturating_sub(OTHER_FILES).clamp(1, MOST_FILES) as usize
}

/// Has the system let this process open as many files as it may have at all: a shell's limit is mostly 1024, far below
/// that. Where the system refuses, it stays as it is.
pub fn raise_open_files() {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let limit = getrlimit(Resource::Nofile);
        let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
    }
}
