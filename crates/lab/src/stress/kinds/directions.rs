//! Directions and origins that are hard for the structures: zero and nearly zero components, rays in the planes that
//! divide space.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "axis", about: "parallel to an axis, in faces and edges of boxes: 0 times infinity", make: axis },
    Kind { name: "negative-zero", about: "the same with -0 as zero", make: negative_zero },
    Kind {
        name: "nearly-axis",
        about: "components of 2^-10 down to the smallest float beside one of 1",
        make: nearly_axis,
    },
    Kind { name: "in-planes", about: "oblique, in planes in which faces lie and trees split", make: in_planes },
    Kind {
        name: "diagonals",
        about: "through corners of boxes, where planes of two or three axes are met at once",
        make: diagonals,
    },
    Kind {
        name: "cell-planes",
        about: "in the faces and along the edges of a grid's or octree's cells",
        make: cell_planes,
    },
    Kind {
        name: "scene-box",
        about: "in the faces, along the edges and through the corners of the scene's box",
        make: scene_box,
    },
    Kind { name: "flat", about: "flat boxes: every triangle in a plane that may split the tree", make: flat },
    Kind { name: "inside", about: "origins amid the scene: planes behind the origin", make: inside },
    Kind {
        name: "far-origins",
        about: "origins 2^10 to 2^20 sizes away, aimed at edges and vertices",
        make: far_origins,
    },
    Kind { name: "lengths", about: "directions of length 2^-40 to 2^40", make: lengths },
];

/// A multiple of 1/2 from below the boxes of [`Mesh::cubes`] to beyond them.
fn half(random: &mut Random) -> f32 {
    random.whole(-2, 14) as f32 / 2.0
}

fn halves(random: &mut Random) -> Vec3 {
    Vec3::new(half(random), half(random), half(random))
}

/// A point in or beside the boxes, on each axis a multiple of 1/2 two times of three.
fn near_faces(random: &mut Random) -> Vec3 {
    let at = halves(random).to_array();
    Vec3::from_array(at.map(|x| if random.below(3) == 0 { x + 0.5 * random.unit() } else { x }))
}

fn axis_with(zero: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::cubes(4).shuffled(random);
    Case::new(mesh, rays, random, |_, random, i| {
        let mut direction = [zero; 3];
        direction[i % 3] = random.sign() * random.pick(&[0.5, 1.0, 3.0]);
        let mut origin = near_faces(random).to_array();
        if random.below(2) == 0 {
            origin[i % 3] = -direction[i % 3].signum() * 10.0;
        }
        StressRay::new(origin.into(), direction.into())
    })
}

fn axis(random: &mut Random, rays: usize) -> Case {
    axis_with(0.0, random, rays)
}

fn negative_zero(random: &mut Random, rays: usize) -> Case {
    axis_with(-0.0, random, rays)
}

fn nearly_axis(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::cubes(4).shuffled(random);
    Case::new(mesh, rays, random, |_, random, i| {
        let mut direction = [(); 3].map(|()| random.sign() * power_of_two(-random.whole(10, 149)));
        direction[i % 3] = random.sign();
        let mut origin = near_faces(random).to_array();
        origin[i % 3] = -direction[i % 3] * random.pick(&[1.0, 100.0, 10_000.0]);
        StressRay::new(origin.into(), direction.into())
    })
}

fn in_planes(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::cubes(4).shuffled(random);
    Case::new(mesh, rays, random, |_, random, i| {
        let mut direction = random.direction().to_array();
        direction[i % 3] = 0.0;
        let mut origin = near_faces(random).to_array();
        origin[i % 3] = half(random);
        StressRay::new(origin.into(), direction.into())
    })
}

fn diagonals(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::cubes(4).shuffled(random);
    Case::new(mesh, rays, random, |_, random, _| {
        let step = |random: &mut Random| random.pick(&[-2.0, -1.0, 0.0, 1.0, 2.0]);
        let direction = Vec3::new(step(random), step(random), step(random));
        let direction = if direction == Vec3::ZERO { Vec3::ONE } else { direction };
        StressRay::new(halves(random) - direction * random.whole(0, 8) as f32, direction)
    })
}

/// Small triangles in a box from 0 to 64, and nothing at its corners but triangles that make it so large.
fn cells(random: &mut Random) -> Mesh {
    let mut mesh = Mesh::soup(250, 0.08, random).mapped(|p| (p * 24.0 + 32.0).clamp(Vec3::ZERO, Vec3::splat(64.0)));
    for (corner, inwards) in [(0.0, 1.0), (64.0, -1.0)] {
        let corner = Vec3::splat(corner);
        mesh.triangle([corner, corner + Vec3::X * inwards, corner + Vec3::Y * inwards]);
    }
    // Some in the planes themselves.
    for _ in 0..60 {
        let at = Vec3::new(random.whole(0, 15) as f32, random.whole(0, 15) as f32, random.whole(0, 15) as f32) * 4.0;
        let (x, y) = random.pick(&[(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)]);
        mesh.triangle([at, at + x * 4.0, at + y * 4.0]);
    }
    mesh.shuffled(random)
}

fn cell_planes(random: &mut Random, rays: usize) -> Case {
    let mesh = cells(random);
    Case::new(mesh, rays, random, |_, random, i| {
        let plane = |random: &mut Random| random.whole(0, 64) as f32;
        let mut origin = [plane(random), plane(random), plane(random)];
        let mut direction = random.direction().to_array();
        let axis = i % 3;
        match random.below(3) {
            0 => {
                direction = [0.0; 3]; // along the edges of cells
                direction[axis] = random.sign();
            }
            1 => direction[axis] = 0.0,                       // in their faces
            _ => direction = [(); 3].map(|()| random.sign()), // through their corners
        }
        origin[axis] = random.pick(&[0.0, 64.0, -8.0, 72.0, origin[axis]]);
        StressRay::new(origin.into(), direction.into())
    })
}

fn scene_box(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::soup(150, 0.2, random).mapped(|p| p.clamp(Vec3::splat(-0.75), Vec3::splat(0.75)));
    // Triangles at all corners, of which two are in the box's faces and one is across.
    for i in 0..8 {
        let corner = Vec3::from_array([0, 1, 2].map(|bit| if i >> bit & 1 == 1 { 1.0 } else { -1.0 }));
        let arm = |axis: Vec3| corner - axis * corner.dot(axis) * 0.25;
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(arm);
        mesh.triangle([corner, x, y]);
        mesh.triangle([corner, y, z]);
        mesh.triangle([x, y, z]);
    }
    Case::new(mesh.shuffled(random), rays, random, |_, random, i| {
        let mut origin = random.vec3().to_array();
        let mut direction = random.direction().to_array();
        let axes = [i % 3, (i + 1) % 3, (i + 2) % 3];
        let on_faces = 1 + random.below(3);
        for &axis in &axes[..on_faces] {
            origin[axis] = random.sign();
            if random.below(3) > 0 {
                direction[axis] = 0.0;
            }
        }
        if direction == [0.0; 3] {
            direction[axes[0]] = random.sign();
        }
        let start = Vec3::from_array(origin) - Vec3::from_array(direction) * random.pick(&[0.0, 1.0, 2.0, 4.0]);
        StressRay::new(start, direction.into())
    })
}

fn flat(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for _ in 0..160 {
        let at = Vec3::new(random.whole(0, 15) as f32, random.whole(0, 15) as f32, random.whole(0, 15) as f32);
        let (x, y) = random.pick(&[(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)]);
        let (x, y) = (x * random.whole(1, 4) as f32, y * random.whole(1, 4) as f32);
        mesh.quad([at, at + x, at + x + y, at + y]);
    }
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| match i % 3 {
        0 => StressRay::to(random.vec3() * 10.0 + 8.0, mesh.random_inside(random)),
        1 => StressRay::to(random.vec3() * 10.0 + 8.0, mesh.random_seam(random)),
        _ => {
            let at = [(); 3].map(|()| random.whole(0, 32) as f32 / 2.0);
            let mut direction = [0.0; 3];
            direction[random.below(3)] = random.sign();
            StressRay::new(at.into(), direction.into())
        }
    })
}

fn inside(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::soup(400, 0.1, random);
    Case::new(mesh, rays, random, |mesh, random, i| match i % 2 {
        0 => StressRay::new(random.vec3() * 0.9, random.direction()),
        _ => StressRay::to(random.vec3() * 0.9, mesh.random_inside(random)),
    })
}

fn far_origins(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(random.direction() * random.size(10, 20), mesh.random_seam(random))
    })
}

fn lengths(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let origin = random.direction() * (4.0 * random.unit());
        StressRay::new(origin, (mesh.random_seam(random) - origin) * random.size(-40, 40))
    })
}
