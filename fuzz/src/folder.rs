//! A folder that inputs are written into, as the program reads files.

use raybrook::low_level::budget::MemoryBudget;
use std::cell::OnceCell;
use std::path::PathBuf;
use tempfile::TempDir;

/// What reading an input may take beside what the process has.
const LOAD_BYTES: u64 = 256 << 20;

thread_local! {
    /// One for all inputs that a thread tries, which replace each other.
    static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
}

/// The folder of this thread.
#[derive(Clone, Copy)]
pub struct Folder;

impl Folder {
    /// Where the file `name` is.
    pub fn path(self, name: &str) -> PathBuf {
        FOLDER.with(|folder| {
            let folder = folder.get_or_init(|| tempfile::tempdir().expect("a temporary folder can be made"));
            folder.path().join(name)
        })
    }

    /// Writes the file `name`.
    pub fn write(self, name: &str, data: &[u8]) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, data).expect("the temporary folder can be written");
        path
    }

    /// Removes the file `name`, if it is there.
    pub fn remove(self, name: &str) -> PathBuf {
        let path = self.path(name);
        let _ = std::fs::remove_file(&path); // mostly it is not
        path
    }

    /// The memory that reading an input may take.
    pub fn budget(self) -> MemoryBudget {
        const MUCH: u64 = 1 << 62;
        let resident = MUCH - MemoryBudget::of_bytes(MUCH).left();
        MemoryBudget::of_bytes(resident + LOAD_BYTES)
    }
}
