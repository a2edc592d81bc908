//! The files of a turntable.

use crate::files::Files;
use raybrook::low_level::film::ImageFormat;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};

/// The fewest digits of a frame's number.
const DIGITS: usize = 4;

/// Where numbered frames are.
pub struct Frames {
    folder: PathBuf,
    /// What their names begin with, and end with behind the number.
    stem: String,
    ending: String,
    count: u32,
    /// As the user has named it.
    name: PathBuf,
}

impl Frames {
    /// Of a folder, for names such as `frame-0001.png`, or of a picture's name, for names such as that with a number.
    pub fn of(output: &Path, count: u32) -> Result<Frames> {
        let is_folder = output.is_dir() || output.extension().is_none();
        let name = output.to_owned();
        if is_folder {
            let folder = output.to_owned();
            return Ok(Frames { folder, stem: "frame".into(), ending: "png".into(), count, name });
        }
        ImageFormat::from_path(output)?;
        let text = |part: Option<&std::ffi::OsStr>| {
            let text = part.and_then(|part| part.to_str()).map(str::to_owned);
            text.ok_or_else(|| Error::option("-o", format!("'{}' is not a name in Unicode", output.display())))
        };
        let (stem, ending) = (text(output.file_stem())?, text(output.extension())?);
        let folder = output.parent().map(Path::to_owned).unwrap_or_default();
        Ok(Frames { folder, stem, ending, count, name })
    }

    /// As the user has named it.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// The file of frame number `frame`, from 1.
    pub fn path(&self, frame: u32) -> PathBuf {
        self.folder.join(format!("{}-{frame:0DIGITS$}.{}", self.stem, self.ending))
    }

    /// The same files, of another number.
    pub fn with_count(self, count: u32) -> Frames {
        Frames { count, ..self }
    }

    /// How many there are.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The files of all frames.
    pub fn paths(&self) -> Vec<PathBuf> {
        self.all().map(|frame| self.path(frame)).collect()
    }

    /// All frames.
    pub fn all(&self) -> impl Iterator<Item = u32> {
        1..=self.count
    }

    /// The file that tells what the frames are of.
    pub fn manifest(&self) -> PathBuf {
        self.folder.join(format!("{}-turntable.json", self.stem))
    }

    /// Whether some frame is there.
    pub fn any(&self) -> bool {
        self.all().any(|frame| self.path(frame).exists())
    }

    /// Makes the folder, if it is not there.
    pub fn make_folder(&self) -> Result<()> {
        if self.folder.as_os_str().is_empty() {
            return Ok(());
        }
        std::fs::create_dir_all(&self.folder).map_err(|e| Error::io("create", &self.folder, e))
    }

    /// Removes all frames that are there, up to number `last` or the last one, with the files `beside` them.
    pub fn remove(&self, last: u32, beside: impl Fn(&Path) -> Vec<PathBuf>) -> Result<()> {
        for frame in (1..=self.count.max(last)).map(|frame| self.path(frame)) {
            // The frame first: one without a file beside it is made anew, and is never taken for another one.
            let files = std::iter::once(frame.clone()).chain(beside(&frame));
            for path in files.filter(|path| path.exists()) {
                std::fs::remove_file(&path).map_err(|e| Error::io("remove", &path, e))?;
            }
        }
        Ok(())
    }

    /// Keeps that these files are written.
    pub fn claim(&self, files: &mut Files) -> Result<()> {
        files.write(&self.manifest(), "-o")?;
        self.all().try_for_each(|frame| files.write(&self.path(frame), "-o"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered_in_a_folder_or_like_a_picture() {
        for (output, first, manifest) in [
            ("out", "out/frame-0001.png", "out/frame-turntable.json"),
            ("turn.png", "turn-0001.png", "turn-turntable.json"),
            ("a/b.c.exr", "a/b.c-0001.exr", "a/b.c-turntable.json"),
        ] {
            let frames = Frames::of(Path::new(output), 3).unwrap();
            assert_eq!((frames.path(1), frames.manifest()), (first.into(), manifest.into()));
            assert_eq!(frames.all().collect::<Vec<_>>(), [1, 2, 3]);
        }
        assert_eq!(Frames::of(Path::new("a.gif"), 3).err().map(|error| error.exit_code()), Some(2));
        assert_eq!(Frames::of(Path::new("x"), 99_999).unwrap().path(12_345), Path::new("x/frame-12345.png"));
    }
}
