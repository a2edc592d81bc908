//! Rays at edges and vertices: nothing slips through between two triangles, and nothing is hit beside them.

use super::Kind;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::{Mat3, Vec3};
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "edges", about: "edges of a closed mesh, seen from inside", make: edges },
    Kind { name: "vertices", about: "vertices of a closed mesh, seen from inside", make: vertices },
    Kind { name: "silhouettes", about: "edges and vertices of a closed mesh, seen from outside", make: silhouettes },
    Kind { name: "spikes", about: "edges and vertices of a sphere whose vertices are moved in and out", make: spikes },
    Kind { name: "offset", about: "edges and vertices of a closed mesh 1e5 sizes away from zero", make: offset },
    Kind { name: "snapped", about: "the same at 1e6 sizes, where vertices fall together", make: snapped },
    Kind { name: "grid", about: "exactly through edges and vertices of a height field", make: grid },
    Kind {
        name: "t-junctions",
        about: "exactly through vertices that lie within a neighbour's edge",
        make: t_junctions,
    },
    Kind { name: "fans", about: "hubs and spokes of closed fans of 64 to 256 triangles", make: fans },
    Kind { name: "needle-fans", about: "closed fans of needles, 1e2 to 1e6 times as long as wide", make: needle_fans },
    Kind {
        name: "borders",
        about: "exactly through open edges and corners, which belong to a triangle",
        make: borders,
    },
    Kind {
        name: "open-edges",
        about: "within rounding of the edges of single triangles: hit or miss",
        make: open_edges,
    },
];

/// A matrix that turns and distorts by up to a third.
fn distortion(random: &mut Random) -> Mat3 {
    let (x, y) = random.direction().any_orthonormal_pair();
    Mat3::from_cols(x, y, x.cross(y)) + Mat3::from_cols(random.vec3(), random.vec3(), random.vec3()) * (1.0 / 6.0)
}

/// A closed mesh around the origin without any symmetry.
pub(super) fn blob(levels: u32, random: &mut Random) -> Mesh {
    let matrix = distortion(random);
    Mesh::sphere(levels).mapped(|p| matrix * p).shuffled(random)
}

fn edges(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(4, random);
    Case::new(mesh, rays, random, |mesh, random, _| StressRay::to(random.vec3() * 0.2, mesh.random_edge_point(random)))
}

fn vertices(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(4, random);
    Case::new(mesh, rays, random, |mesh, random, _| StressRay::to(random.vec3() * 0.2, mesh.random_vertex(random)))
}

fn silhouettes(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let origin = random.direction() * (1.5 + 4.0 * random.unit());
        StressRay::to(origin, mesh.random_seam(random))
    })
}

fn spikes(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::sphere(3).mapped(|p| p * (1.0 + 5.0 * random.unit())).shuffled(random);
    Case::new(mesh, rays, random, |mesh, random, _| StressRay::to(random.vec3() * 0.3, mesh.random_seam(random)))
}

fn offset_by(bits: i32, random: &mut Random, rays: usize) -> Case {
    let center = random.direction() * power_of_two(bits) * (1.0 + random.unit());
    let mesh = blob(3, random).mapped(|p| p + center);
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(center + random.vec3() * 0.2, mesh.random_seam(random))
    })
}

fn offset(random: &mut Random, rays: usize) -> Case {
    offset_by(16, random, rays)
}

fn snapped(random: &mut Random, rays: usize) -> Case {
    offset_by(20, random, rays)
}

/// A dyadic direction downwards.
fn down(random: &mut Random) -> Vec3 {
    let lean = |random: &mut Random| random.whole(-3, 3) as f32 / 16.0;
    Vec3::new(lean(random), lean(random), -0.25 * random.whole(1, 4) as f32)
}

/// The ray that reaches `target` in `direction` at t = `steps`.
fn back_from(target: Vec3, direction: Vec3, steps: i32) -> StressRay {
    StressRay::new(target - direction * steps as f32, direction)
}

/// A dyadic point of an edge.
fn dyadic_edge_point(corners: [Vec3; 3], random: &mut Random) -> Vec3 {
    let k = random.below(3);
    corners[k] + (corners[(k + 1) % 3] - corners[k]) * (0.125 * random.below(8) as f32)
}

fn grid(random: &mut Random, rays: usize) -> Case {
    let heights: Vec<f32> = (0..17 * 17).map(|_| random.whole(0, 8) as f32 / 8.0).collect();
    let mesh = Mesh::sheet(16, |x, y| heights[17 * y + x]).shuffled(random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = dyadic_edge_point(mesh.corners(random.below(mesh.triangles.len())), random);
        let direction = if i % 3 == 0 { -Vec3::Z } else { down(random) };
        back_from(target, direction, 16)
    })
}

fn t_junctions(random: &mut Random, rays: usize) -> Case {
    const ROWS: u32 = 8;
    const COLUMNS: u32 = 8;
    // Strips between rows of vertices on straight lines: every second strip uses all vertices of a row, the others its
    // ends alone.
    let mut mesh = Mesh::default();
    for row in 0..=ROWS {
        let (height, slope) = (random.whole(0, 8) as f32 / 8.0, random.whole(-2, 2) as f32 / 8.0);
        for column in 0..=COLUMNS {
            mesh.vertex(Vec3::new(column as f32, row as f32, height + slope * column as f32));
        }
    }
    let at = |column: u32, row: u32| row * (COLUMNS + 1) + column;
    for row in 0..ROWS {
        let step = if row % 2 == 0 { COLUMNS } else { 1 };
        for left in (0..COLUMNS).step_by(step as usize) {
            let right = left + step;
            mesh.triangles.push([at(left, row), at(right, row), at(right, row + 1)]);
            mesh.triangles.push([at(left, row), at(right, row + 1), at(left, row + 1)]);
        }
    }
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let row = random.below(ROWS as usize + 1);
        let column = random.below(COLUMNS as usize);
        let [left, right] = [0, 1].map(|k| mesh.positions[row * (COLUMNS as usize + 1) + column + k]);
        let direction = if i % 3 == 0 { -Vec3::Z } else { down(random) };
        back_from(left + (right - left) * (0.25 * random.below(4) as f32), direction, 16)
    })
}

fn fans(random: &mut Random, rays: usize) -> Case {
    let matrix = distortion(random);
    let mesh = Mesh::double_fan(6 + random.below(3) as u32, 0.5).mapped(|p| matrix * p);
    Case::new(mesh, rays, random, |mesh, random, i| {
        let hub = mesh.positions[random.below(2)];
        let rim = mesh.positions[2 + random.below(mesh.positions.len() - 2)];
        let origin = if i % 4 < 2 { random.vec3() * 0.1 } else { random.direction() * 3.0 };
        StressRay::to(origin, if i % 2 == 0 { hub } else { hub.lerp(rim, random.unit()) })
    })
}

fn needle_fans(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for k in 0..6 {
        let (matrix, place) = (distortion(random), random.vec3() * 2.0);
        let radius = power_of_two(-4 - 3 * k);
        mesh.append(&Mesh::double_fan(4, 1.0).mapped(|p| matrix * (p * Vec3::new(radius, radius, 1.0)) + place));
    }
    Case::new(mesh, rays, random, |mesh, random, _| StressRay::to(random.direction() * 5.0, mesh.random_seam(random)))
}

fn borders(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for i in 0..100 {
        let corner = Vec3::new(4.0 * (i % 10) as f32, 4.0 * (i / 10) as f32, 0.0);
        let point = |random: &mut Random| {
            corner + Vec3::new(random.whole(0, 8) as f32, random.whole(0, 8) as f32, random.whole(0, 8) as f32) / 4.0
        };
        mesh.triangle([point(random), point(random), point(random)]);
    }
    Case::new(mesh, rays, random, |mesh, random, _| {
        let target = dyadic_edge_point(mesh.corners(random.below(mesh.triangles.len())), random);
        back_from(target, down(random), 16)
    })
}

fn open_edges(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::soup(100, 0.4, random);
    Case::new(mesh, rays, random, |mesh, random, _| StressRay::to(random.vec3() * 2.0, mesh.random_seam(random)))
}
