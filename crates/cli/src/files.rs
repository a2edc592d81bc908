//! The files of a run: nothing that it reads is overwritten, and nothing is written twice.
//!
//! Files are the same if the system says so: by device and number after links are followed, so that no spelling of a
//! name hides one. Those that are not there yet are known by their folder and name.

use raybrook::low_level::scene::Scene;
use raybrook::{Error, Result};
use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What tells one file from another.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Identity {
    /// Device and number.
    #[cfg(unix)]
    Present(u64, u64),
    /// A path without links.
    #[cfg(not(unix))]
    Present(PathBuf),
    /// A folder's path without links, and a name in it.
    Absent(PathBuf, OsString),
}

impl Identity {
    /// `None` for what no output replaces, such as a device, and where no file can be.
    fn of(path: &Path) -> Option<Identity> {
        if let Ok(found) = path.metadata() {
            return found.is_file().then(|| Identity::present(path, &found)).flatten();
        }
        // The parent of a bare name is "", which no system call takes for the current folder.
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(Identity::Absent(folder.canonicalize().ok()?, path.file_name()?.to_owned()))
    }

    #[cfg(unix)]
    fn present(_: &Path, found: &std::fs::Metadata) -> Option<Identity> {
        use std::os::unix::fs::MetadataExt;
        Some(Identity::Present(found.dev(), found.ino()))
    }

    #[cfg(not(unix))]
    fn present(path: &Path, _: &std::fs::Metadata) -> Option<Identity> {
        path.canonicalize().ok().map(Identity::Present)
    }
}

/// What a run reads and writes.
#[derive(Clone, Default)]
pub struct Files {
    /// What each file is, as in "it is …".
    roles: HashMap<Identity, String>,
    /// What is read, as it is called.
    inputs: Vec<(PathBuf, String)>,
}

impl Files {
    /// Keeps that `path` is read.
    pub fn read(&mut self, path: &Path, role: &str) {
        if let Some(identity) = Identity::of(path) {
            self.roles.entry(identity).or_insert_with(|| role.to_owned());
            self.inputs.push((path.to_owned(), role.to_owned()));
        }
    }

    /// Keeps that all files of a scene are read.
    pub fn read_scene(&mut self, scene: &Scene) {
        for file in &scene.files {
            self.read(&file.path, &file.role);
        }
    }

    /// Keeps that `option` has `path` written.
    ///
    /// # Errors
    /// [`Error::Option`] when it is read, or written for another option.
    pub fn write(&mut self, path: &Path, option: &str) -> Result<()> {
        let Some(identity) = Identity::of(path) else { return Ok(()) };
        if let Some(role) = self.roles.get(&identity) {
            let message = format!("'{}' is {role}, which would be lost; choose another name", path.display());
            return Err(Error::option(option, message));
        }
        self.roles.insert(identity, format!("what {option} writes"));
        Ok(())
    }

    /// The same for an option that need not be given.
    ///
    /// # Errors
    /// As [`Files::write`].
    pub fn write_if(&mut self, path: Option<&Path>, option: &str) -> Result<()> {
        path.map_or(Ok(()), |path| self.write(path, option))
    }

    /// What is read: the path and what it is.
    pub fn inputs(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.inputs.iter().map(|(path, role)| (path.as_path(), role.as_str()))
    }
}

/// The first name for an output that the user has not named, of which `claim` is content: `wanted`, then with `word`
/// and a number behind its stem.
///
/// # Errors
/// That of the last name, if there is none.
pub fn first_free(wanted: &Path, word: &str, claim: impl Fn(PathBuf) -> Result<PathBuf>) -> Result<PathBuf> {
    /// More names than anyone's scene takes.
    const MOST: u32 = 1000;
    let like = |number: u32| {
        let number = if number == 1 { String::new() } else { format!("-{number}") };
        let mut name = wanted.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-{word}{number}."));
        name.push(wanted.extension().unwrap_or_default());
        wanted.with_file_name(name)
    };
    (1..MOST).fold(claim(wanted.to_owned()), |found, number| found.or_else(|_| claim(like(number))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_by_whatever_name_is_not_written_when_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("below")).unwrap();
        std::fs::write(at("a.png"), "a").unwrap();
        let mut files = Files::default();
        files.read(&at("a.png"), "the texture that 'm.mtl' names");
        let mut same = vec![at("a.png"), at("below/../a.png"), at("./a.png")];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../a.png", at("below/link.png")).unwrap();
            std::os::unix::fs::symlink("link.png", at("below/link of link.png")).unwrap();
            std::os::unix::fs::symlink(folder.path(), at("below/folder")).unwrap();
            std::fs::hard_link(at("a.png"), at("hard.png")).unwrap();
            same.extend(["below/link.png", "below/link of link.png", "below/folder/a.png", "hard.png"].map(at));
        }
        for path in same {
            let error = files.clone().write(&path, "-o").unwrap_err();
            assert_eq!(error.exit_code(), 2);
            let text = error.to_string();
            let path = path.display().to_string();
            assert!(["-o", "the texture that 'm.mtl' names", &path].iter().all(|words| text.contains(words)), "{text}");
        }
        files.write(&at("b.png"), "-o").unwrap();
        let error = files.write(&at("below/../b.png"), "--stats").unwrap_err();
        assert!(error.to_string().contains("what -o writes"), "{error}");
        files.write(&at("below/b.png"), "--stats").unwrap();
        // Any number of outputs may go nowhere.
        files.write(Path::new("/dev/null"), "-o").unwrap();
        files.write(Path::new("/dev/null"), "--stats").unwrap();
    }

    #[test]
    fn names_that_are_not_free_are_passed_over() {
        let (wanted, second) = (Path::new("x/a.b.png"), Path::new("x/a.b-render.png"));
        let free = |taken: &[&Path]| {
            let claim = |path: PathBuf| match taken.contains(&path.as_path()) {
                true => Err(Error::option("-o", "taken")),
                false => Ok(path),
            };
            first_free(wanted, "render", claim).unwrap()
        };
        assert_eq!(free(&[]), wanted);
        assert_eq!(free(&[wanted]), second);
        assert_eq!(free(&[wanted, second]), Path::new("x/a.b-render-2.png"));
    }
}
