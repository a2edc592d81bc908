//! Writes the rays of `pareto`, and the meshes that they go through, as plain files.

use super::{Checksum, Identity, RaySet, Source, mesh_bytes, ray_bytes, sets};
use crate::study::Lab;
use crate::study::studies::{stress_kinds, stress_rays_a_kind};
use raybrook::low_level::input::read_regular;
use raybrook::low_level::output::{write_atomically, write_json};
use raybrook::{Error, Result};
use serde::Serialize;
use std::fs;
use std::path::Path;

/// What a manifest begins with.
const FORMAT: &str = "raybrook rays 1";
const MANIFEST: &str = "manifest.json";
const README: &str = include_str!("README.md");

#[derive(Serialize)]
struct Manifest {
    format: &'static str,
    #[serde(flatten)]
    identity: Identity,
    sets: Vec<Entry>,
}

/// A set as the manifest has it.
#[derive(Serialize)]
struct Entry {
    name: String,
    /// Of a scene's rays.
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rays_of: Option<&'static str>,
    /// Of stress rays.
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<&'static str>,
    /// `closest` or `any`.
    query: &'static str,
    rays: usize,
    second_rays: bool,
    triangles: usize,
    vertices: usize,
    mesh_bin: String,
    mesh_obj: String,
    rays_bin: String,
    rays_npz: String,
    checksum: String,
}

impl Entry {
    fn new(set: &RaySet, case: &crate::stress::Case) -> Entry {
        let (scene, rays_of, mode) = match set.source {
            Source::Scene(subject, kind) => (Some(subject.name.clone()), Some(subject.batches[kind].name), None),
            Source::Stress(kind, _) => (None, None, Some(kind.name)),
        };
        Entry {
            name: set.name.clone(),
            scene,
            rays_of,
            mode,
            query: if case.any_hit { "any" } else { "closest" },
            rays: case.rays.len(),
            second_rays: case.has_second_rays(),
            triangles: case.mesh.triangles.len(),
            vertices: case.mesh.positions.len(),
            mesh_bin: format!("{}.mesh.bin", set.mesh),
            mesh_obj: format!("{}.obj", set.mesh),
            rays_bin: format!("{}.rays.bin", set.name),
            rays_npz: format!("{}.npz", set.name),
            checksum: Checksum::of(case),
        }
    }
}

/// Writes the rays that study `pareto` traces in this lab to `folder`: of every scene and kind of rays, and of every
/// kind of stress rays, the same files for the same seed. Tells how many sets there are.
///
/// # Errors
/// [`Error::Option`] when something else is in the folder, [`Error::Io`] when it cannot be written, and those of the
/// scenes.
pub fn export_rays(lab: &Lab, folder: &Path) -> Result<usize> {
    refuse_foreign(folder)?;
    let subjects = lab.usual_subjects()?;
    fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
    let mut sum = Checksum::default();
    let mut entries: Vec<Entry> = Vec::new();
    for set in sets(&subjects, &stress_kinds(lab), stress_rays_a_kind(lab)) {
        (lab.progress)(&set.name);
        let case = set.case(lab.seed)?;
        let entry = Entry::new(&set, &case);
        let write = |name: &str, bytes: &[u8]| write_atomically(&folder.join(name), |out| out.write_all(bytes));
        if entries.last().is_none_or(|last| last.mesh_bin != entry.mesh_bin) {
            write(&entry.mesh_bin, &mesh_bytes(&case))?;
            write(&entry.mesh_obj, case.mesh.to_obj().as_bytes())?;
        }
        write(&entry.rays_bin, &ray_bytes(&case))?;
        case.batch(&(0..case.rays.len()).collect::<Vec<_>>()).write(folder.join(&entry.rays_npz))?;
        sum.add(&entry.name, &entry.checksum);
        entries.push(entry);
    }
    write_atomically(&folder.join("README.md"), |out| out.write_all(README.as_bytes()))?;
    let count = entries.len();
    // Last: with this file the folder is whole.
    let manifest = Manifest { format: FORMAT, identity: Identity::new(lab, sum), sets: entries };
    write_json(&folder.join(MANIFEST), &manifest)?;
    Ok(count)
}

/// Refuses a folder with files that no export has written.
fn refuse_foreign(folder: &Path) -> Result<()> {
    let is_empty = fs::read_dir(folder).map_or(true, |mut files| files.next().is_none());
    let is_own = || {
        let bytes = read_regular(&folder.join(MANIFEST)).unwrap_or_default();
        serde_json::from_slice(&bytes).is_ok_and(|value: serde_json::Value| value["format"] == FORMAT)
    };
    if is_empty || is_own() {
        return Ok(());
    }
    let message = format!("'{}' has other files than exported rays; choose another folder", folder.display());
    Err(Error::option("export_rays", message))
}
