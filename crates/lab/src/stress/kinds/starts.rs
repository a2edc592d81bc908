//! Secondary rays whose start or direction has tiny parts, down to the smallest that float32 has.

use super::Kind;
use super::lattices::turned;
use super::surfaces::whole3;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind {
        name: "next-tiny",
        about: "secondary rays with components of 2^-100 to 2^-149, from weights as small",
        make: tiny_directions,
    },
    Kind {
        name: "next-raised",
        about: "secondary rays from triangles that have a corner 2^-98 to 2^-149 above their plane",
        make: raised,
    },
    Kind {
        name: "next-small",
        about: "secondary rays from triangles of size 2^-20 to 2^-140 to others of size 1",
        make: small_starts,
    },
];

/// A weight of any size, often none, a quarter or a half.
fn weight(random: &mut Random) -> f32 {
    random.size_or(&[0.0, 0.25, 0.5, power_of_two(-88), f32::from_bits(1)], -149, -60)
}

/// A component of a direction: tiny, small, or of about 1.
fn component(random: &mut Random) -> f32 {
    if random.below(2) == 0 {
        return random.sign() * random.size(-149, -100);
    }
    random.sign() * random.pick(&[0.0, 0.0, 0.5, 1.0, 1.0, power_of_two(-16)])
}

fn next_direction(random: &mut Random) -> Vec3 {
    let direction = Vec3::new(component(random), component(random), component(random));
    if direction == Vec3::ZERO { Vec3::Z } else { direction }
}

/// Walls of whole corners about the start, and a box around them.
fn walls(random: &mut Random) -> Mesh {
    let mut mesh = Mesh::default();
    for _ in 0..random.whole(2, 8) {
        let mut corners = [(); 3].map(|()| whole3(-3, 3, random) + Vec3::new(0.0, random.pick(&[0.0, 0.25]), 0.0));
        // Steep ones that pass by the first triangle's sides.
        let x = random.pick(&[0.0, 0.25, 1.0]);
        if random.below(2) == 0 {
            corners = [Vec3::new(x, 0.25, -1.0), Vec3::new(-x, -2.0, 1.0), Vec3::new(-x, 3.0, 1.0)];
        }
        mesh.triangle(corners);
    }
    mesh.append(&Mesh::cube(Vec3::splat(-4.0), Vec3::splat(4.0)));
    mesh
}

/// First rays straight down onto the triangle (0,0) (1,0) (0,1) times `size`, and second ones in any direction.
fn from_triangle(base: [Vec3; 3], size: f32, random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    mesh.triangle(base);
    mesh.append(&walls(random));
    let case = Case::new(mesh, rays, random, |_, random, _| {
        let (x, y) = (weight(random) * size, weight(random) * size);
        // So near that no wall is between.
        let above = size * power_of_two(-random.whole(0, 9));
        StressRay::new(Vec3::new(x, y, above), -Vec3::Z * size).then(next_direction(random))
    });
    turned(case, random)
}

fn tiny_directions(random: &mut Random, rays: usize) -> Case {
    from_triangle([Vec3::ZERO, Vec3::X, Vec3::Y], 1.0, random, rays)
}

fn raised(random: &mut Random, rays: usize) -> Case {
    let mut base = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for _ in 0..random.whole(1, 3) {
        base[random.below(3)] += random.direction().signum() * Vec3::Z * random.size(-149, -98);
    }
    let corner = random.below(3);
    base[corner] += Vec3::Z * f32::from_bits(1);
    from_triangle(base, 1.0, random, rays)
}

fn small_starts(random: &mut Random, rays: usize) -> Case {
    let size = power_of_two(-random.whole(20, 140));
    from_triangle([Vec3::ZERO, Vec3::X * size, Vec3::Y * size], size, random, rays)
}
