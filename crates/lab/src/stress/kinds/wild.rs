//! Numbers from one end of float32 to the other within one scene.

use super::Kind;
use super::lattices::turned;
use super::surfaces::whole3;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "wild", about: "coordinates of 2^-149 to 2^126 within one mesh", make: wild },
    Kind {
        name: "wild-details",
        about: "details of 2^-149 to 2^-20 sizes in scenes of 2^-66 to 2^120",
        make: wild_details,
    },
    Kind { name: "wild-origins", about: "origins up to 2^127 away from scenes of 2^-120 to 2^60", make: wild_origins },
    Kind {
        name: "wild-lengths",
        about: "directions of length 2^-149 to 2^127, and components as far apart",
        make: wild_lengths,
    },
];

/// Powers of two of the smallest and of the largest coordinates; with factors up to 4 and their differences the largest
/// stay floats.
const ENDS: (i32, i32) = (-149, 124);

/// A whole number up to 4 times one of a scene's few sizes: coordinates that are equal, or that no sum of floats can
/// hold.
fn coordinate(sizes: &[f32], random: &mut Random) -> f32 {
    random.whole(-4, 4) as f32 * random.pick(sizes)
}

fn point(sizes: &[f32], random: &mut Random) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| coordinate(sizes, random)))
}

/// Towards `target` along an axis, or nearly so: the other coordinates of the origin are those of the target to the
/// bit. Most rays reach it at a t that is a float.
fn along_axis(target: Vec3, away: f32, random: &mut Random) -> StressRay {
    let axis = random.below(3);
    let (mut origin, mut direction) = (target, Vec3::ZERO);
    origin[axis] = away;
    let way = target[axis] - away;
    direction[axis] = match random.below(4) {
        0 => way,
        1 => random.size(ENDS.0, ENDS.1).copysign(way),
        _ => way * random.size(-20, 20),
    };
    if random.below(4) == 0 {
        direction[(axis + 1) % 3] = random.sign() * f32::from_bits(random.whole(1, 4) as u32);
    }
    if direction[axis] == 0.0 || !direction.is_finite() {
        direction[axis] = 1.0f32.copysign(way);
    }
    StressRay::new(origin, direction)
}

fn wild(random: &mut Random, rays: usize) -> Case {
    let sizes = [(); 4].map(|()| power_of_two(random.whole(ENDS.0, ENDS.1)));
    let mut mesh = Mesh::default();
    for _ in 0..random.pick(&[2, 6, 12]) {
        mesh.triangle([(); 3].map(|()| point(&sizes, random)));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = match i % 3 {
            0 => mesh.random_vertex(random),
            1 => mesh.random_inside(random),
            _ => point(&sizes, random),
        };
        let target = if target.is_finite() { target } else { Vec3::ZERO };
        match random.below(3) {
            0 => StressRay::to(point(&sizes, random), target),
            _ => along_axis(target, coordinate(&sizes, random), random),
        }
    })
}

/// An octahedron, and tiny triangles at its centre and beside one of its corners.
fn wild_details(random: &mut Random, rays: usize) -> Case {
    let size = random.size_or(&[1e-20, 1.0, 1e18], -66, 120);
    let exponent = -random.whole(20, 110);
    let detail = (size * power_of_two(exponent)).max(f32::from_bits(1));
    let mut mesh = Mesh::default();
    for _ in 0..6 {
        mesh.triangle([(); 3].map(|()| whole3(-4, 4, random) * detail));
    }
    // With one corner far away.
    for _ in 0..2 {
        mesh.triangle([whole3(-4, 4, random) * detail, whole3(-4, 4, random) * detail, whole3(-1, 1, random) * size]);
    }
    mesh.append(&Mesh::sphere(0).mapped(|p| p * size));
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let halves = whole3(-8, 8, random) * detail / 2.0;
        match i % 4 {
            0 => along_axis(halves, random.whole(-8, 8) as f32 * detail, random),
            1 => along_axis(halves, random.signed() * size, random),
            2 => along_axis(halves, random.sign() * size * 2.0, random),
            _ => StressRay::to(halves, mesh.random_vertex(random)),
        }
    })
}

fn wild_origins(random: &mut Random, rays: usize) -> Case {
    let size = random.size_or(&[1e-20], -120, 60);
    let mut mesh = Mesh::default();
    for _ in 0..6 {
        mesh.triangle([(); 3].map(|()| whole3(-3, 3, random) * size));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 3 == 0 { mesh.random_vertex(random) } else { whole3(-6, 6, random) / 2.0 * size };
        let away = random.sign() * random.size_or(&[1e20, 1e-20, 1e38], -149, 127);
        along_axis(target, away, random)
    })
}

fn wild_lengths(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for _ in 0..8 {
        mesh.triangle([(); 3].map(|()| whole3(-3, 3, random)));
    }
    let size = power_of_two(random.whole(-40, 40));
    let case = Case::new(mesh.mapped(|p| p * size), rays, random, |_, random, i| {
        let start = whole3(-8, 8, random) / 2.0 * size;
        let far = |random: &mut Random| random.sign() * random.size(-149, 127);
        let direction = match i % 3 {
            // Of one length.
            0 => {
                let steps = whole3(-2, 2, random);
                steps * random.size(-149, 126)
            }
            // Components of any lengths.
            1 => Vec3::new(far(random), far(random), far(random)),
            _ => Vec3::new(far(random), far(random) * power_of_two(-100), 0.0),
        };
        StressRay::new(start, if direction == Vec3::ZERO { Vec3::Z } else { direction })
    });
    turned(case, random)
}
