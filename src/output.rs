//! Output files that are either whole or absent.
//!
//! Everything is written to a temporary name in the target's folder and renamed when it is complete, so that neither a full
//! disk nor an interruption leaves half a file, and the previous file lives until the new one is ready. A device, a pipe or a
//! socket (`/dev/stdout`) cannot be renamed over: it is written to directly, in one go, from memory.
//!
//! Bad at: keeping a file's owner and hard links, which the rename replaces.

use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Cursor, ErrorKind, Seek, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// What an output file can do while it is written; a ZIP archive and OpenEXR go back to fill in sizes and offsets.
pub trait Output: Write + Seek {}
impl<T: Write + Seek> Output for T {}

/// Bytes gathered before they are handed to the system; a temporary file is written in pieces of this size.
const BUFFER_BYTES: usize = 1 << 18;

/// Where the bytes go.
enum Target {
    /// A regular file, present or not, after following links.
    File { path: PathBuf, folder: PathBuf, permissions: Option<Permissions> },
    /// A device, pipe or socket.
    Special,
}

/// Checks that `path` can be written, without changing it: call it before long work whose result goes there.
///
/// # Errors
/// [`Error::Io`] with action "create": there is no such folder, the path is a folder, the file is write-protected, or the
/// folder does not let files be made.
pub fn check_writable(path: &Path) -> Result<()> {
    match find_target(path)? {
        Target::File { folder, permissions, .. } => create_temporary(&folder, permissions).map(drop),
        Target::Special => Ok(()),
    }
    .map_err(|e| Error::io("create", path, e))
}

/// Writes `path` by `write`, and leaves the old file, or none, unless all of it succeeds.
///
/// A new file gets the permissions that the process's umask leaves of 0666; a file that is replaced keeps its own.
///
/// # Errors
/// [`Error::Io`] with action "create" as for [`check_writable`], or "write" for what `write` and the system report.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Output) -> io::Result<()>) -> Result<()> {
    let to_error = |e| Error::io("write", path, e);
    match find_target(path)? {
        Target::File { path: target, folder, permissions } => {
            let temporary = create_temporary(&folder, permissions).map_err(|e| Error::io("create", path, e))?;
            let mut buffered = BufWriter::with_capacity(BUFFER_BYTES, temporary);
            write(&mut buffered).map_err(to_error)?;
            let temporary = buffered.into_inner().map_err(|e| to_error(e.into_error()))?;
            // A network file system reports a full disk as late as here; without this the file would be cut short, silently.
            temporary.as_file().sync_all().map_err(to_error)?;
            temporary.persist(&target).map_err(|e| to_error(e.error))?;
        }
        Target::Special => {
            let mut bytes = Cursor::new(Vec::new());
            write(&mut bytes).map_err(to_error)?;
            let mut file = File::options().write(true).open(path).map_err(to_error)?;
            file.write_all(bytes.get_ref()).map_err(to_error)?;
        }
    }
    Ok(())
}

/// Writes `value` to `path` as JSON that people can read, too.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_atomically(path, |mut out| {
        serde_json::to_writer_pretty(&mut out, value)?;
        out.write_all(b"\n")
    })
}

/// Follows links and tells what lies at `path`; refuses what can never become an output file.
fn find_target(path: &Path) -> Result<Target> {
    let refuse = |kind, why: String| Err(Error::io("create", path, io::Error::new(kind, why)));
    let mut target = path.to_owned();
    let mut permissions = None;
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => return refuse(ErrorKind::IsADirectory, "it is a folder".into()),
        Ok(found) if !found.is_file() => return Ok(Target::Special),
        Ok(found) if found.permissions().readonly() => {
            return refuse(ErrorKind::PermissionDenied, "the file is there and write-protected".into());
        }
        Ok(found) => {
            target = fs::canonicalize(path).map_err(|e| Error::io("create", path, e))?;
            permissions = Some(found.permissions());
        }
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) => return Err(Error::io("create", path, e)),
    }
    if target.file_name().is_none() {
        return refuse(ErrorKind::InvalidInput, "that is not the name of a file".into());
    }
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    if !folder.is_dir() {
        return refuse(ErrorKind::NotFound, format!("there is no folder '{}'", folder.display()));
    }
    Ok(Target::File { path: target, folder, permissions })
}

/// An empty file with a name of its own that is deleted when dropped.
fn create_temporary(folder: &Path, permissions: Option<Permissions>) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".raybrook-").suffix(".tmp");
    // The crate's default of 0600 is meant for secrets; 0666 is what any program asks for, and the umask takes its part off.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder)?;
    if let Some(permissions) = permissions {
        temporary.as_file().set_permissions(permissions)?;
    }
    Ok(temporary)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::SeekFrom;

    fn files_in(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_written_file_is_whole_and_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, |out| {
            out.write_all(b"hello")?;
            out.seek(SeekFrom::Start(0))?;
            out.write_all(b"J")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"Jello");
        assert_eq!(files_in(folder.path()), ["a.bin"]);
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        fs::write(&path, "old").unwrap();
        let error = write_atomically(&path, |out| {
            out.write_all(&vec![0; 2 * BUFFER_BYTES])?;
            Err(io::Error::other("disk on fire"))
        })
        .unwrap_err();
        assert!(matches!(error, Error::Io { action: "write", .. }), "{error:?}");
        assert_eq!(error.exit_code(), 5);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(files_in(folder.path()), ["a.bin"]);
    }

    #[test]
    fn impossible_targets_are_refused_early() {
        let folder = tempfile::tempdir().unwrap();
        let protected = folder.path().join("protected");
        fs::write(&protected, "keep").unwrap();
        let mut permissions = fs::metadata(&protected).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&protected, permissions).unwrap();
        let cases = [
            (folder.path().join("no/such/a.bin"), "there is no folder"),
            (folder.path().to_owned(), "it is a folder"),
            (protected.clone(), "write-protected"),
            (protected.join("a.bin"), "ot a directory"),
            (PathBuf::new(), "not the name of a file"),
        ];
        for (path, message) in cases {
            for error in [check_writable(&path).unwrap_err(), write_atomically(&path, |_| Ok(())).unwrap_err()] {
                let Error::Io { action: "create", source, .. } = &error else { panic!("{path:?}: {error:?}") };
                assert!(source.to_string().contains(message), "{path:?}: {source}");
                assert_eq!(error.exit_code(), 5);
            }
        }
        check_writable(&folder.path().join("fine.bin")).unwrap();
        assert_eq!(files_in(folder.path()), ["protected"]);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_follow_the_umask_or_the_old_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_atomically(&ours, |out| out.write_all(b"1")).unwrap();
        File::create(&plain).unwrap();
        assert_eq!(mode(&ours), mode(&plain));
        fs::set_permissions(&ours, Permissions::from_mode(0o640)).unwrap();
        write_atomically(&ours, |out| out.write_all(b"2")).unwrap();
        assert_eq!((mode(&ours), fs::read(&ours).unwrap()), (0o640, b"2".to_vec()));
    }

    #[cfg(unix)]
    #[test]
    fn links_and_devices_stay_what_they_are() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        symlink(&file, &link).unwrap();
        write_atomically(&link, |out| out.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");

        let null = Path::new("/dev/null");
        write_atomically(null, |out| out.write_all(b"gone")).unwrap();
        assert!(fs::metadata(null).unwrap().file_type().is_char_device());
    }
}
