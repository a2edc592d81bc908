//! The kinds of hard cases: one small function each, that makes a mesh and rays from random numbers.
//!
//! Coordinates called dyadic are small multiples of a small power of two, so that sums, and so hits, are exact in
//! float32.

mod directions;
mod far;
mod lattices;
mod limits;
mod scales;
mod seams;
mod second;
mod sizes;
mod stacks;
mod starts;
mod surfaces;
mod wild;

use super::case::Case;
use raybrook::low_level::random::Random;
use raybrook::{Error, Result};

/// Kinds of which one scene tells little: few triangles of wild numbers, another few in each scene.
const OF_MANY_SCENES: [&[Kind]; 4] = [lattices::KINDS, wild::KINDS, far::KINDS, starts::KINDS];
/// Kinds that are made for lists and walks, of many scenes, too.
const STACKS: &[Kind] = stacks::KINDS;
/// Rays through one of many scenes, if there are not so many rays that there are more scenes than the most.
const RAYS_OF_SCENE: usize = 40;
/// Scenes of a kind at most: a device takes a while for each.
const MOST_SCENES: usize = 250;

/// One kind of hard cases.
pub struct Kind {
    /// As the user types it.
    pub name: &'static str,
    /// What is hard about it, in one line.
    pub about: &'static str,
    make: fn(&mut Random, usize) -> Case,
}

impl Kind {
    /// Every kind for closest hits.
    pub fn all() -> impl Iterator<Item = &'static Kind> {
        [seams::KINDS, directions::KINDS, surfaces::KINDS, sizes::KINDS, limits::KINDS, scales::KINDS, second::KINDS]
            .into_iter()
            .chain(OF_MANY_SCENES)
            .flatten()
    }

    /// The kinds that are made for lists and walks.
    pub fn stacks() -> impl Iterator<Item = &'static Kind> {
        STACKS.iter()
    }

    /// The kind of this name, of both.
    ///
    /// # Errors
    /// [`Error::Option`] when there is none; the message has the nearest name.
    pub fn find(name: &str) -> Result<&'static Kind> {
        Kind::all().chain(Kind::stacks()).find(|kind| kind.name == name).ok_or_else(|| {
            let nearest = Kind::all().chain(Kind::stacks()).max_by(|a, b| {
                let likeness = |kind: &Kind| strsim::jaro_winkler(kind.name, name);
                likeness(a).total_cmp(&likeness(b))
            });
            let hint = nearest.map_or("", |kind| kind.name);
            Error::option("KIND", format!("there is no kind '{name}'; nearest: {hint}; `list` lists all"))
        })
    }

    /// How many scenes `rays` of them come from.
    pub fn scene_count(&self, rays: usize) -> usize {
        let is_one = !OF_MANY_SCENES.into_iter().chain([STACKS]).flatten().any(|kind| kind.name == self.name);
        if is_one { 1 } else { rays.div_ceil(RAYS_OF_SCENE).clamp(1, MOST_SCENES) }
    }

    /// The cases of this kind that belong to `seed`, with `rays` rays together: one, or of kinds whose scenes are small
    /// many.
    pub fn cases(&self, seed: u64, rays: usize) -> impl Iterator<Item = Case> {
        (0..self.scene_count(rays)).map(move |scene| self.case_of_scene(seed, rays, scene))
    }

    /// Number `scene` of [`Kind::cases`].
    pub fn case_of_scene(&self, seed: u64, rays: usize, scene: usize) -> Case {
        let (scenes, i) = (self.scene_count(rays), scene);
        let seed = if i == 0 { seed } else { Random::new(seed ^ (i as u64) << 40).bits() };
        self.case(seed, rays * (i + 1) / scenes - rays * i / scenes)
    }

    /// The case of this kind that belongs to `seed`, with `rays` rays: always the same, whatever else is made.
    pub fn case(&self, seed: u64, rays: usize) -> Case {
        let mut random = Random::new(seed ^ u64::from(crc32fast::hash(self.name.as_bytes())) << 32);
        (self.make)(&mut random, rays)
    }
}
