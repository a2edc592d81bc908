//! Output files that are either whole or absent.
//!
//! Everything is written to a file in the target's folder that gets the target's name when it is complete, so that
//! neither a full disk nor an interruption leaves half a file, and the previous file lives until the new one is ready.
//! Where the system can, this file has no name before (`open(2)`, `O_TMPFILE`), so that nothing is left of it however
//! the program ends; elsewhere it has a temporary one, which [`stop`] removes. A device, a pipe or a socket
//! (`/dev/stdout`) cannot be renamed over: it is written to directly, in one go, from memory.
//!
//! Bad at: keeping a file's owner and hard links, which the rename replaces.

use std::collections::BTreeSet;
use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Cursor, ErrorKind, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

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
/// [`Error::Io`] with action "create": there is no such folder, the path is a folder, the file is write-protected, or
/// the folder does not let files be made.
pub fn check_writable(path: &Path) -> Result<()> {
    match find_target(path)? {
        Target::File { folder, permissions, .. } => Temporary::create(&folder, permissions).map(drop),
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
            let temporary = Temporary::create(&folder, permissions).map_err(|e| Error::io("create", path, e))?;
            fill(temporary, &target, write).map_err(to_error)?;
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

/// Writes the file `target` in `folder` as [`write_atomically`] does, whatever is there now: a link or a pipe is
/// replaced.
pub(crate) fn replace(
    target: &Path,
    folder: &Path,
    permissions: Option<Permissions>,
    write: impl FnOnce(&mut dyn Output) -> io::Result<()>,
) -> io::Result<()> {
    fill(Temporary::create(folder, permissions)?, target, write)
}

/// Writes `temporary` by `write`, and gives it the name `target`.
fn fill(temporary: Temporary, target: &Path, write: impl FnOnce(&mut dyn Output) -> io::Result<()>) -> io::Result<()> {
    let mut buffered = BufWriter::with_capacity(BUFFER_BYTES, temporary.file());
    write(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    // A network file system reports a full disk as late as here; without this the file would be cut short, silently.
    temporary.file().sync_all()?;
    temporary.persist(target)
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

/// What temporary names begin and end with.
const TEMPORARY_NAME: (&str, &str) = (".raybrook-", ".tmp");

/// Whether `name` is one of a file that was not finished.
pub(crate) fn is_unfinished(name: &str) -> bool {
    name.starts_with(TEMPORARY_NAME.0) && name.ends_with(TEMPORARY_NAME.1)
}

/// The temporary names that there are. Whoever makes or takes away one holds the lock meanwhile.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    // A set of names is whole even where somebody panicked.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps outputs as they are: none appears or is replaced while this lives.
pub struct Stopped {
    _names: MutexGuard<'static, BTreeSet<PathBuf>>,
}

/// Removes every output that is not complete. For a program that is about to be stopped, as by a signal.
pub fn stop() -> Stopped {
    let mut names = unfinished();
    remove(&mut names);
    Stopped { _names: names }
}

/// What cannot be removed stays; there is nobody left to tell.
fn remove(names: &mut BTreeSet<PathBuf>) {
    for name in std::mem::take(names) {
        let _ = fs::remove_file(name);
    }
}

/// A file that is written, and vanishes unless it gets a name.
enum Temporary {
    /// Without a name; and its folder.
    #[cfg(target_os = "linux")]
    Unnamed(File, PathBuf),
    /// With a temporary one. It is always there until the file is dropped or renamed.
    Named(Option<NamedTempFile>, File),
}

impl Temporary {
    /// An empty file in `folder`, on the same disk as what it will become.
    fn create(folder: &Path, permissions: Option<Permissions>) -> io::Result<Temporary> {
        let temporary = match Self::unnamed(folder) {
            Some(unnamed) => unnamed,
            None => Self::named(folder)?,
        };
        if let Some(permissions) = permissions {
            temporary.file().set_permissions(permissions)?;
        }
        Ok(temporary)
    }

    /// `None` where the system or the file system knows no such files, or whatever else is wrong; then a named one
    /// tells.
    #[cfg(target_os = "linux")]
    fn unnamed(folder: &Path) -> Option<Temporary> {
        use rustix::fs::{Mode, OFlags};
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let file: File = rustix::fs::open(folder, flags, Mode::from_raw_mode(MODE)).ok()?.into();
        // Without /proc it could never get a name.
        link_of(&file).exists().then(|| Temporary::Unnamed(file, folder.to_owned()))
    }

    #[cfg(not(target_os = "linux"))]
    fn unnamed(_: &Path) -> Option<Temporary> {
        None
    }

    fn named(folder: &Path) -> io::Result<Temporary> {
        let mut names = unfinished();
        let named = builder().tempfile_in(folder)?;
        names.insert(named.path().to_owned());
        let file = named.as_file().try_clone()?;
        Ok(Temporary::Named(Some(named), file))
    }

    fn file(&self) -> &File {
        match self {
            #[cfg(target_os = "linux")]
            Temporary::Unnamed(file, _) => file,
            Temporary::Named(_, file) => file,
        }
    }

    /// Gives the file the name `target`, in place of what has it now.
    fn persist(mut self, target: &Path) -> io::Result<()> {
        match &mut self {
            #[cfg(target_os = "linux")]
            Temporary::Unnamed(file, folder) => {
                // The lock keeps a signal from ending the program between link and rename.
                let _names = unfinished();
                match link(file, target) {
                    // No call replaces a name by a link: the file needs a name to be renamed from.
                    Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                        let named = builder().make_in(folder, |name| link(file, name))?;
                        named.persist(target).map(drop).map_err(|error| error.error)
                    }
                    result => result,
                }
            }
            Temporary::Named(named, _) => {
                let mut names = unfinished();
                let Some(named) = named.take() else { return Ok(()) };
                names.remove(named.path());
                named.persist(target).map(drop).map_err(|error| error.error)
            }
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Temporary::Named(named, _) = self
            && let Some(named) = named.take()
        {
            let mut names = unfinished();
            names.remove(named.path());
            drop(named);
        }
    }
}

/// What any program asks for; the umask takes its part off. The default of the crate, 0600, is meant for secrets.
#[cfg(unix)]
const MODE: u32 = 0o666;

fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_NAME.0).suffix(TEMPORARY_NAME.1);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(MODE));
    builder
}

/// Where Linux shows an open file.
#[cfg(target_os = "linux")]
fn link_of(file: &File) -> PathBuf {
    use std::os::fd::AsRawFd;
    PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()))
}

/// Gives an unnamed file a name that nothing has.
#[cfg(target_os = "linux")]
fn link(file: &File, name: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    Ok(linkat(CWD, link_of(file), CWD, name, AtFlags::SYMLINK_FOLLOW)?)
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
    fn a_temporary_name_is_known_while_it_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let own =
            || unfinished().iter().filter(|name| name.starts_with(folder.path())).cloned().collect::<BTreeSet<_>>();
        let first = Temporary::named(folder.path()).unwrap();
        let second = Temporary::named(folder.path()).unwrap();
        assert_eq!((own().len(), files_in(folder.path()).len()), (2, 2));
        assert!(files_in(folder.path()).iter().all(|name| is_unfinished(name)));
        drop(first);
        assert_eq!((own().len(), files_in(folder.path()).len()), (1, 1));
        second.file().write_all(b"whole").unwrap();
        second.persist(&folder.path().join("a.bin")).unwrap();
        assert!(own().is_empty());
        assert_eq!(fs::read(folder.path().join("a.bin")).unwrap(), b"whole");
        // What a signal would lead to.
        let _third = Temporary::named(folder.path()).unwrap();
        remove(&mut own());
        assert_eq!(files_in(folder.path()), ["a.bin"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn an_unnamed_file_replaces_an_old_one_and_leaves_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.bin");
        for text in ["first", "second"] {
            let Some(unnamed) = Temporary::unnamed(folder.path()) else {
                // Past `eprintln!`, of which nobody sees what tests print that pass.
                return writeln!(std::io::stderr(), "SKIPPED, this file system has no unnamed files").unwrap();
            };
            unnamed.file().write_all(text.as_bytes()).unwrap();
            assert!(files_in(folder.path()).len() < 2);
            unnamed.persist(&target).unwrap();
            assert_eq!(fs::read_to_string(&target).unwrap(), text);
        }
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
