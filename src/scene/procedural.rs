//! Procedural textures: patterns in space that are computed, not stored (Peachey 1985, Perlin 1985). What they look
//! like is defined by `cl/shade/procedural.cl`.

use glam::{DAffine3, Vec3};

/// What a procedural texture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Cubes of edge 1 of either colour by turns.
    Checker,
    /// Fractal noise between the colours.
    Noise,
    /// Veins across the axis x, one in each unit, folded by turbulence; the second colour is theirs.
    Marble,
    /// Rings about the axis y, one in each unit, bent by noise; the second colour is the late wood.
    Wood,
}

impl Pattern {
    /// Every pattern.
    pub const ALL: [Pattern; 4] = [Pattern::Checker, Pattern::Noise, Pattern::Marble, Pattern::Wood];

    /// The name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Pattern::Checker => "checker",
            Pattern::Noise => "noise",
            Pattern::Marble => "marble",
            Pattern::Wood => "wood",
        }
    }
}

/// Where the pattern lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TextureSpace {
    /// In the world: surfaces are cut out of it.
    #[default]
    World,
    /// In the plane of the texture coordinates, at (u, v, 0).
    Uv,
}

/// A procedural texture.
#[derive(Debug, Clone, PartialEq)]
pub struct Procedural {
    /// What it shows.
    pub pattern: Pattern,
    /// The two colours that it mixes, linear RGB, 0..1.
    pub colours: [Vec3; 2],
    /// From the pattern's own space, where its features have size 1, to `space`; invertible.
    pub transform: DAffine3,
    /// Where the pattern lies.
    pub space: TextureSpace,
    /// How far noise moves marble's veins and wood's rings, in units of their distance; checker and noise do not use
    /// it.
    pub turbulence: f32,
    /// Octaves of the noise, 1..=[`Procedural::MAX_OCTAVES`]: each has twice the frequency and half the strength of the
    /// last.
    pub octaves: u32,
    /// Which noise.
    pub seed: u32,
}

impl Procedural {
    /// The most octaves: the last has details of 1/32768.
    pub const MAX_OCTAVES: u32 = 16;

    /// `pattern` with its usual colours and numbers, features of size 1 in the world.
    pub fn new(pattern: Pattern) -> Procedural {
        let (colours, turbulence, octaves) = match pattern {
            Pattern::Checker => ([Vec3::splat(0.8), Vec3::splat(0.1)], 0.0, 1),
            Pattern::Noise => ([Vec3::ZERO, Vec3::ONE], 0.0, 5),
            Pattern::Marble => ([Vec3::new(0.86, 0.84, 0.8), Vec3::new(0.24, 0.26, 0.31)], 0.8, 6),
            Pattern::Wood => ([Vec3::new(0.56, 0.31, 0.13), Vec3::new(0.25, 0.1, 0.03)], 0.6, 3),
        };
        let (transform, space) = (DAffine3::IDENTITY, TextureSpace::World);
        Procedural { pattern, colours, transform, space, turbulence, octaves, seed: 0 }
    }
}
