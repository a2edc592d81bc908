//! Rays that went wrong, as files to trace again: the mesh as OBJ, the rays as NumPy arrays.

use super::case::Case;
use super::mesh::Mesh;
use crate::error::{Error, Result};
use crate::output::write_atomically;
use crate::rays::RayBatch;
use crate::scene;
use std::path::{Path, PathBuf};

/// The files of one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// The mesh.
    pub mesh: PathBuf,
    /// The rays.
    pub rays: PathBuf,
}

impl Replay {
    /// Writes the mesh of `case` and the rays of the given numbers to `folder`, which is made if it is not there. `mesh` and `rays`
    /// are the files' names without ending.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder or a file cannot be made.
    pub fn write(folder: &Path, case: &Case, numbers: &[usize], mesh: &str, rays: &str) -> Result<Replay> {
        std::fs::create_dir_all(folder).map_err(|e| Error::io("create", folder, e))?;
        let replay = Replay { mesh: folder.join(format!("{mesh}.obj")), rays: folder.join(format!("{rays}.npz")) };
        write_atomically(&replay.mesh, |out| out.write_all(case.mesh.to_obj().as_bytes()))?;
        case.batch(numbers).write(&replay.rays)?;
        Ok(replay)
    }

    /// The case in two files: of these, or any other model and rays.
    ///
    /// # Errors
    /// The files cannot be read, or do not hold what they should.
    pub fn read(&self) -> Result<Case> {
        let batch = RayBatch::read(&self.rays)?;
        Ok(Case::from_batch(Mesh::try_from(&scene::load(&self.mesh)?)?, &batch))
    }
}
