//! Other tracers on the chart of `pareto`: its rays as plain files that anyone can trace ([`export_rays`]), and what
//! other tracers answered ([`Peer`]), judged by the same exact answers as the program's own methods.
//!
//! Both sides make the rays anew from the seed. A checksum of each set says whether the answers are those to the very
//! same bits.
//!
//! Bad at: speeds of other machines, which are drawn on the same axes. Who compares them has them measured on one.

mod export;
mod judge;
mod results;

pub use export::export_rays;
pub(super) use judge::{Judged, judge};
pub use results::Peer;

use super::{Lab, Subject};
use crate::stress::{Case, Kind};
use crc32fast::Hasher;
use raybrook::Result;
use serde::{Deserialize, Serialize};

/// What the rays of a study depend on; another one, other rays.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Of the names and checksums of all sets.
    pub checksum: String,
    /// Version of the program that exported them. Another one may still trace the same rays.
    pub version: String,
    /// Of random numbers.
    pub seed: u64,
    /// Whether they are those of a study in a hurry.
    pub quick: bool,
    /// Width and height of the picture whose camera rays they are.
    pub side: u32,
}

impl Identity {
    fn new(lab: &Lab, checksum: Checksum) -> Identity {
        Identity {
            checksum: checksum.finish(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: lab.seed,
            quick: lab.quick,
            side: lab.side(),
        }
    }
}

/// Where the rays of a set come from.
#[derive(Clone, Copy)]
enum Source<'a> {
    Scene(&'a Subject, usize),
    Stress(&'static Kind, usize),
}

/// Rays of one kind through one mesh.
struct RaySet<'a> {
    /// Its name, which is that of its files, too.
    name: String,
    /// The name of its mesh's files; kinds of rays through one scene share it.
    mesh: String,
    source: Source<'a>,
}

/// All sets of the study: the rays of its scenes, and `rays_a_kind` stress rays of each of `kinds`.
fn sets<'a>(subjects: &'a [Subject], kinds: &[&'static Kind], rays_a_kind: usize) -> Vec<RaySet<'a>> {
    let mut sets = Vec::new();
    for (i, subject) in subjects.iter().enumerate() {
        let mesh = format!("scene-{}-{}", i + 1, name_of_file(&subject.name));
        for (kind, batch) in subject.batches.iter().enumerate().filter(|(_, batch)| !batch.rays.is_empty()) {
            let name = format!("{mesh}-{}", batch.name);
            sets.push(RaySet { name, mesh: mesh.clone(), source: Source::Scene(subject, kind) });
        }
    }
    sets.extend(kinds.iter().map(|&kind| {
        let name = format!("stress-{}", kind.name);
        RaySet { mesh: name.clone(), name, source: Source::Stress(kind, rays_a_kind) }
    }));
    sets
}

impl RaySet<'_> {
    fn case(&self, seed: u64) -> Result<Case> {
        match self.source {
            Source::Scene(subject, kind) => subject.case(kind),
            Source::Stress(kind, rays) => Ok(kind.case(seed, rays)),
        }
    }
}

/// A scene's name without folders, ending and what file systems may not take.
fn name_of_file(scene: &str) -> String {
    const LONGEST: usize = 40;
    let stem = std::path::Path::new(scene).file_stem().unwrap_or_default().to_string_lossy();
    let safe = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' };
    stem.chars().take(LONGEST).map(safe).collect()
}

/// The mesh as its file has it.
fn mesh_bytes(case: &Case) -> Vec<u8> {
    let mesh = &case.mesh;
    let counts = [mesh.positions.len() as u32, mesh.triangles.len() as u32];
    let positions = mesh.positions.iter().flat_map(|p| p.to_array()).map(f32::to_bits);
    let words = counts.into_iter().chain(positions).chain(mesh.triangles.iter().flatten().copied());
    words.flat_map(u32::to_le_bytes).collect()
}

/// The rays as their file has them.
fn ray_bytes(case: &Case) -> Vec<u8> {
    let has_second_rays = case.has_second_rays();
    let numbers = case.rays.iter().flat_map(|ray| {
        let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin.to_array(), ray.direction.to_array());
        [ox, oy, oz, ray.t_min, dx, dy, dz, ray.t_max]
    });
    let next = case.rays.iter().filter_map(|ray| ray.next).flat_map(|next| next.to_array());
    let counts = [case.rays.len() as u32, u32::from(has_second_rays)];
    counts.into_iter().chain(numbers.chain(next).map(f32::to_bits)).flat_map(u32::to_le_bytes).collect()
}

/// CRC-32.
#[derive(Default)]
struct Checksum(Hasher);

impl Checksum {
    /// Of a set's files, and of what is asked of its rays.
    fn of(case: &Case) -> String {
        let mut sum = Checksum::default();
        sum.0.update(&mesh_bytes(case));
        sum.0.update(&ray_bytes(case));
        sum.0.update(&[u8::from(case.any_hit)]);
        sum.finish()
    }

    /// Takes a set in.
    fn add(&mut self, name: &str, checksum: &str) {
        self.0.update(name.as_bytes());
        self.0.update(checksum.as_bytes());
    }

    fn finish(self) -> String {
        format!("{:08x}", self.0.finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::StressRay;
    use glam::Vec3;

    #[test]
    fn a_change_of_anything_that_is_traced_is_another_set() {
        let case = Kind::find("lattice-next").unwrap().case(3, 20);
        let same = Checksum::of(&case);
        assert_eq!(Checksum::of(&Kind::find("lattice-next").unwrap().case(3, 20)), same);
        let changes: [fn(&mut Case); 6] = [
            |case| case.mesh.positions[1].y = case.mesh.positions[1].y.next_up(),
            |case| case.mesh.triangles[0].swap(0, 1),
            |case| case.rays[7].t_max = 2.0,
            |case| case.rays[7].next = Some(Vec3::X * 0.3),
            |case| case.any_hit = true,
            |case| case.rays.truncate(19),
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut other = case.clone();
            change(&mut other);
            assert_ne!(Checksum::of(&other), same, "change {i}");
        }
    }

    #[test]
    fn files_are_as_the_readme_has_them() {
        let mut case = Case::default();
        case.mesh.triangle([Vec3::ZERO, Vec3::X, Vec3::Y]);
        case.rays.push(StressRay::to(Vec3::Z, Vec3::ZERO).within(0.5, 2.0));
        let words = |bytes: Vec<u8>| -> Vec<f32> {
            let word = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
            bytes[8..].chunks(4).map(word).collect()
        };
        assert_eq!(mesh_bytes(&case)[..8], [3, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(mesh_bytes(&case).len(), 8 + 3 * 12 + 12);
        assert_eq!(ray_bytes(&case)[..8], [1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(words(ray_bytes(&case)), [0.0, 0.0, 1.0, 0.5, 0.0, 0.0, -1.0, 2.0]);
        case.rays[0].next = Some(Vec3::new(7.0, 8.0, 9.0));
        assert_eq!(words(ray_bytes(&case))[8..], [7.0, 8.0, 9.0]);
    }

    #[test]
    fn names_of_files_have_nothing_that_a_system_refuses() {
        let names = ["boulder", "../models/my house.obj", "a/b\\c:d*.toml", ""].map(name_of_file);
        assert_eq!(names, ["boulder", "my-house", "b-c-d-", ""]);
    }
}
