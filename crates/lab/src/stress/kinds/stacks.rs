//! Many triangles behind each other and in one place, for lists of all hits and walks from hit to hit: at one t
//! exactly, at one t once it is rounded, around one edge or vertex, and at every scale.

use super::Kind;
use super::seams::blob;
use super::surfaces::{moved, whole3};
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "stack-copies", about: "a closed mesh 16 times in one place, facing either way", make: copies },
    Kind { name: "stack-floats", about: "64 layers 0 to 4 floats apart, many at one rounded t", make: floats },
    Kind { name: "stack-edges", about: "through edges of 12 triangles each, one behind the other", make: edges },
    Kind {
        name: "stack-vertices",
        about: "through vertices of 12 triangles each, one behind the other",
        make: vertices,
    },
    Kind { name: "stack-scales", about: "layers from 2^-120 to 2^120 away, before and behind", make: scales },
    Kind { name: "stack-shells", about: "closed meshes in each other, from one float to 1 / 8 apart", make: shells },
    Kind { name: "stack-sheets", about: "edges and vertices of 24 sheets exactly behind each other", make: sheets },
];

/// With limits that leave out a part of the hits, or none; StressRay::to has its target at t = 1.
fn limited(ray: StressRay, random: &mut Random) -> StressRay {
    const ALL: f32 = f32::INFINITY;
    let (t_min, t_max) = random.pick(&[(0.0, ALL), (0.0, ALL), (-ALL, ALL), (-1.0, 1.0), (1.0, ALL), (0.0, 1.0)]);
    ray.within(t_min, t_max)
}

/// The whole case at any scale; every second direction keeps its length, so that t takes the scale.
fn at_any_scale(case: Case, random: &mut Random) -> Case {
    const MOST: i32 = 90;
    let mut scaled = case.clone().scaled(power_of_two(random.whole(-MOST, MOST)));
    for (ray, unscaled) in scaled.rays.iter_mut().zip(&case.rays).step_by(2) {
        ray.direction = unscaled.direction;
    }
    scaled
}

/// A triangle that begins with any corner and faces either way.
fn turned(mut corners: [Vec3; 3], random: &mut Random) -> [Vec3; 3] {
    corners.rotate_left(random.below(3));
    if random.below(2) == 0 {
        corners.swap(1, 2);
    }
    corners
}

fn copies(random: &mut Random, rays: usize) -> Case {
    let base = blob(1, random);
    let mut mesh = Mesh::default();
    for i in 0..16 * base.triangles.len() {
        mesh.triangle(turned(base.corners(i % base.triangles.len()), random));
    }
    let case = Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let target = if i % 3 == 0 { mesh.random_inside(random) } else { mesh.random_seam(random) };
        limited(StressRay::to(random.direction() * random.pick(&[0.2, 3.0]), target), random)
    });
    at_any_scale(case, random)
}

fn floats(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for _ in 0..64 {
        let corners = [(-2.0, -2.0), (6.0, -2.0), (-2.0, 6.0)]
            .map(|(x, y)| Vec3::new(x, y, moved(2.0 + 0.25 * x - 0.125 * y, random.whole(-4, 4))));
        mesh.triangle(turned(corners, random));
    }
    let case = Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 5 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        // From afar, from near, and from between the layers; t has more digits than they are apart, as many, or fewer.
        let side = random.pick(&[-1000.0, 0.0, target.z, 6.0]);
        let ray = match i % 3 {
            0 => StressRay::new(target.with_z(side), Vec3::Z * random.sign() * random.size(-4, 8)),
            _ => StressRay::to(Vec3::new(random.signed(), random.signed(), side), target),
        };
        limited(ray, random)
    });
    at_any_scale(case, random)
}

/// How much y grows with z in the plane of all edges of [`edges`]; dyadic.
const SLOPE: f32 = 0.25;

fn edges(random: &mut Random, rays: usize) -> Case {
    const EDGES: i32 = 8;
    let mut mesh = Mesh::default();
    for k in 0..EDGES {
        let at = |x: f32| Vec3::new(x, SLOPE * 4.0 * k as f32, 4.0 * k as f32);
        for _ in 0..12 {
            let other = at(0.0) + whole3(-6, 6, random);
            mesh.triangle(turned([at(-64.0), at(64.0), other], random));
        }
    }
    let case = Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let in_plane = |x: i32, z: i32| Vec3::new(x as f32 / 4.0, SLOPE * z as f32, z as f32);
        // From an edge, too: every fourth z is one's.
        let origin = in_plane(random.whole(-40, 40), random.whole(-8, 4 * EDGES));
        let ray = match i % 4 {
            0 => StressRay::to(origin, mesh.random_seam(random)),
            _ => StressRay::new(origin, in_plane(random.whole(-8, 8), random.whole(1, 3)) * random.sign()),
        };
        limited(ray, random)
    });
    at_any_scale(case, random)
}

fn vertices(random: &mut Random, rays: usize) -> Case {
    const VERTICES: i32 = 8;
    let step = Vec3::new(1.0, -2.0, 4.0);
    let mut mesh = Mesh::default();
    for k in 0..VERTICES {
        let vertex = step * k as f32;
        let ring: Vec<Vec3> = (0..12).map(|_| vertex + whole3(-5, 5, random)).collect();
        for (i, &corner) in ring.iter().enumerate() {
            mesh.triangle(turned([vertex, corner, ring[(i + 1) % ring.len()]], random));
        }
    }
    let case = Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        // On the line of all vertices: before, at and between them.
        let origin = step * (random.whole(-4, 4 * VERTICES) as f32 / 2.0);
        let ray = match i % 4 {
            0 => StressRay::to(random.direction() * 40.0, mesh.random_vertex(random)),
            1 => StressRay::to(origin, mesh.random_seam(random)),
            _ => StressRay::new(origin, step * random.sign() * random.size(-2, 3)),
        };
        limited(ray, random)
    });
    at_any_scale(case, random)
}

fn scales(random: &mut Random, rays: usize) -> Case {
    // Of many exponents the rays are answered on the host.
    let most = random.pick(&[8, 30, 120]);
    let mut mesh = Mesh::default();
    for _ in 0..48 {
        let size = random.size(-most, most);
        let z = size * random.sign();
        let corners = [(-1.0, -1.0), (3.0, -1.0), (-1.0, 3.0)];
        let corners = corners.map(|(x, y)| Vec3::new(x * size, y * size, z * (1.0 + random.unit() / 4.0)));
        mesh.triangle(turned(corners, random));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let origin = if i % 2 == 0 { Vec3::ZERO } else { random.vec3() * random.size(-most, most) };
        let ray = match i % 3 {
            0 => StressRay::to(origin, mesh.random_inside(random)),
            1 => StressRay::to(origin, mesh.random_seam(random)),
            _ => StressRay::new(origin, Vec3::new(random.signed() / 4.0, random.signed() / 4.0, random.sign())),
        };
        limited(ray, random)
    })
}

fn shells(random: &mut Random, rays: usize) -> Case {
    let base = blob(1, random);
    let mut mesh = Mesh::default();
    for i in 0..24 {
        let size = if i % 2 == 0 { moved(1.0, i / 2) } else { 1.0 + i as f32 / 8.0 };
        let shell = base.clone().mapped(|p| p * size);
        mesh.append(&if random.below(2) == 0 { shell } else { shell.turned_around() });
    }
    let case = Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let target = if i % 3 == 0 { mesh.random_inside(random) } else { mesh.random_seam(random) };
        let ray = match i % 4 {
            0 => StressRay::new(target, -target), // through the centre of all
            1 => StressRay::new(Vec3::ZERO, target),
            _ => StressRay::to(random.direction() * random.pick(&[0.3, 2.0, 9.0]), target),
        };
        limited(ray, random)
    });
    at_any_scale(case, random)
}

fn sheets(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for k in 0..24 {
        let [x, y] = [(); 2].map(|()| random.whole(-1, 1) as f32 / 8.0);
        // Each height twice, so that sheets lie in each other or cross.
        mesh.append(&Mesh::sheet(4, |i, j| (k / 2) as f32 + x * i as f32 + y * j as f32));
    }
    let case = Case::new(mesh.shuffled(random), rays, random, |_, random, i| {
        // A whole x or y is on an edge, both are a vertex, and x = y may be a square's diagonal.
        let step = |random: &mut Random| random.whole(0, 16) as f32 / 4.0;
        let target = match i % 3 {
            0 => Vec3::new(random.whole(0, 4) as f32, random.whole(0, 4) as f32, step(random)),
            1 => Vec3::new(random.whole(0, 4) as f32, step(random), step(random)),
            _ => Vec3::new(step(random), step(random), step(random)),
        };
        let direction = match i % 2 {
            0 => Vec3::Z * random.sign(),
            _ => Vec3::new(random.whole(-2, 2) as f32, random.whole(-2, 2) as f32, 8.0 * random.sign()),
        };
        limited(StressRay::new(target - direction * random.whole(0, 2) as f32, direction), random)
    });
    at_any_scale(case, random)
}
