//! Corners, origins and directions on small lattices: planes, lines and points coincide, and every answer is decided by
//! a tie.

use super::Kind;
use super::limits::with_limits_at_hits;
use super::surfaces::whole3;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "lattice", about: "triangles and rays on a small lattice: in planes, along edges", make: lattice },
    Kind {
        name: "lattice-limits",
        about: "the same with limits exactly at a hit and one float beside it",
        make: lattice_limits,
    },
    Kind { name: "lattice-next", about: "secondary rays on a small lattice, within a closed box", make: lattice_next },
    Kind {
        name: "sliver-areas",
        about: "triangles of area 2^-50 to 2^-140, hit within and along their edges",
        make: sliver_areas,
    },
];

/// The farthest lattice point of a mesh, and the longest step of a direction.
const REACH: i32 = 3;
const STEP: i32 = 2;

/// Triangles of whole corners; some have no area, and some are there twice.
fn lattice_mesh(random: &mut Random) -> Mesh {
    let reach = random.whole(1, REACH);
    let mut mesh = Mesh::default();
    for _ in 0..random.pick(&[3, 8, 20]) {
        mesh.triangle([(); 3].map(|()| whole3(-reach, reach, random)));
    }
    mesh.triangle(mesh.corners(random.below(mesh.triangles.len())));
    mesh.shuffled(random)
}

/// A direction of whole steps.
fn step(random: &mut Random) -> Vec3 {
    let step = whole3(-STEP, STEP, random);
    if step == Vec3::ZERO { Vec3::new(1.0, 0.0, -1.0) } else { step }
}

/// A ray between halves, a third of the time through a corner.
fn lattice_ray(mesh: &Mesh, random: &mut Random, i: usize) -> StressRay {
    let direction = step(random);
    let halves = whole3(-2 * REACH, 2 * REACH, random) / 2.0;
    let target = if i.is_multiple_of(3) { mesh.random_vertex(random) } else { halves };
    let factor = power_of_two(random.whole(-2, 2));
    StressRay::new(target - direction * random.whole(0, 6) as f32 / 2.0, direction * factor)
}

fn lattice(random: &mut Random, rays: usize) -> Case {
    Case::new(lattice_mesh(random), rays, random, lattice_ray)
}

fn lattice_limits(random: &mut Random, rays: usize) -> Case {
    let case = Case::new(lattice_mesh(random), rays, random, |mesh, random, i| {
        // Thirds are no floats.
        let ray = lattice_ray(mesh, random, i);
        StressRay { direction: ray.direction * random.pick(&[1.0, 3.0, 5.0]), ..ray }
    });
    with_limits_at_hits(case, random)
}

fn lattice_next(random: &mut Random, rays: usize) -> Case {
    let mut mesh = lattice_mesh(random);
    mesh.append(&Mesh::cube(Vec3::splat(-4.0), Vec3::splat(4.0)));
    Case::new(mesh, rays, random, |mesh, random, i| {
        let next = step(random) * power_of_two(random.whole(-2, 2));
        lattice_ray(mesh, random, i).then(next)
    })
}

/// Slivers one above the other: from far corners on a diagonal to one that lies `height` beside it, as the noise of cos
/// 90 degrees puts it. A floor is below them.
fn sliver_areas(random: &mut Random, rays: usize) -> Case {
    const HALVINGS: (i32, i32) = (-140, -50);
    let size = power_of_two(random.whole(-20, 20));
    let heights: Vec<f32> = (0..random.whole(1, 4)).map(|_| random.size(HALVINGS.0, HALVINGS.1)).collect();
    let mut mesh = Mesh::default();
    for (z, &height) in heights.iter().enumerate() {
        let at = |x: f32, y: f32| Vec3::new(x * size, y * size, z as f32 * size);
        let (near, far) = random.pick(&[(-1.0, 1.0), (4.0, 8.0)]);
        let beside = at(0.0, 0.0) + random.pick(&[Vec3::X, Vec3::Y]) * height;
        mesh.triangle([at(near, near), beside, at(far, far)]);
    }
    let floor = |x: f32, y: f32| Vec3::new(x * size, y * size, -size);
    mesh.quad([floor(-16.0, -16.0), floor(16.0, -16.0), floor(16.0, 16.0), floor(-16.0, 16.0)]);
    let case = Case::new(mesh.shuffled(random), rays, random, |_, random, _| {
        // At t = 1 exactly as far beside a lattice point as the origin is beside the axis: up to a sliver's height, and
        // within a plane.
        let part = random.pick(&heights) / 8.0;
        let (x, y) = (random.whole(-4, 10) as f32 * part, random.whole(-4, 10) as f32 * part);
        let plane = random.below(heights.len()) as f32;
        let way = random.whole(1, 4) as f32 * random.sign();
        let along = random.whole(-1, 9) as f32;
        let direction = Vec3::new(along, along, -way) * size;
        StressRay::new(Vec3::new(x, y, (plane + way) * size), direction)
    });
    turned(case, random)
}

/// The case with its axes exchanged and turned around at random: numbers stay what they are but for their signs.
pub(super) fn turned(mut case: Case, random: &mut Random) -> Case {
    let (rotation, is_mirrored) = (random.below(3), random.below(2) == 1);
    let signs = Vec3::new(random.sign(), random.sign(), random.sign());
    let turn = |p: Vec3| {
        let mut turned = (p * signs).to_array();
        turned.rotate_left(rotation);
        if is_mirrored {
            turned.swap(0, 1);
        }
        Vec3::from_array(turned)
    };
    case.mesh = case.mesh.mapped(turn);
    for ray in &mut case.rays {
        (ray.origin, ray.direction, ray.next) = (turn(ray.origin), turn(ray.direction), ray.next.map(turn));
    }
    case
}
