//! Opens input files: regular ones alone, as a pipe would block and a device may have no end.

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
