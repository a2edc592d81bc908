//! Rays that went wrong, as files to trace again: the mesh as OBJ, the rays as NumPy arrays.

use super::case::Case;
use super::mesh::Mesh;
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::write_atomically;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::rays::RayBatch;
use raybrook::low_level::scene::{self, Scene};
use raybrook::{Error, Result};
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
    /// Files in `folder`; `mesh` and `rays` are their names without ending.
    pub fn in_folder(folder: &Path, mesh: &str, rays: &str) -> Replay {
        Replay { mesh: folder.join(format!("{mesh}.obj")), rays: folder.join(format!("{rays}.npz")) }
    }

    /// Both files.
    pub fn files(&self) -> [&Path; 2] {
        [&self.mesh, &self.rays]
    }

    /// Writes the mesh of `case` and the rays of the given numbers. The folders are made if they are not there.
    ///
    /// # Errors
    /// [`Error::Io`] when a folder or a file cannot be made.
    pub fn write(&self, case: &Case, numbers: &[usize]) -> Result<()> {
        for folder in self.files().iter().filter_map(|file| file.parent()) {
            std::fs::create_dir_all(folder).map_err(|e| Error::io("create", folder, e))?;
        }
        write_atomically(&self.mesh, |out| out.write_all(case.mesh.to_obj().as_bytes()))?;
        case.batch(numbers).write(&self.rays)
    }

    /// The case in two files: of these, or any other model and rays.
    ///
    /// # Errors
    /// The files cannot be read, or do not hold what they should.
    pub fn read(&self) -> Result<Case> {
        self.read_within(&MemoryBudget::available())
    }

    /// As [`Replay::read`], with no more memory than `budget` has.
    ///
    /// # Errors
    /// As there, and [`Error::OutOfMemory`].
    pub fn read_within(&self, budget: &MemoryBudget) -> Result<Case> {
        self.case_of(&scene::load_within(&self.mesh, budget)?, budget)
    }

    /// The same where the model is loaded already.
    ///
    /// # Errors
    /// The rays cannot be read, or do not hold what they should, and [`Error::OutOfMemory`].
    pub fn case_of(&self, scene: &Scene, budget: &MemoryBudget) -> Result<Case> {
        let batch = RayBatch::read_within(&self.rays, budget)?;
        budget.check(&Need {
            what: &format!("{}: a mesh of {} triangles", self.mesh.display(), scene.triangle_count()),
            bytes: SceneBuffers::estimated_bytes(scene, &TraceOptions::DEFAULT),
            decided_by: DecidedBy::Input,
            remedy: "take a model of fewer triangles, or raise `memory_limit`",
        })?;
        Ok(Case::from_batch(Mesh::try_from(scene)?, &batch))
    }
}
