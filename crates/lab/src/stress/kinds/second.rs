//! Secondary rays, from exactly where the first one hits: they neither hit the surface that they leave nor skip the
//! next one.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "spawn-sphere", about: "from a closed mesh in any direction, inwards and outwards", make: sphere },
    Kind { name: "spawn-small", about: "the same in a scene of size 1e-4", make: small },
    Kind { name: "spawn-offset", about: "the same 1e5 sizes away from zero", make: offset },
    Kind { name: "spawn-scales", about: "the same in a scene of size 2^-60 to 2^60", make: scales },
    Kind { name: "spawn-far", about: "from a surface that was hit from 2^10 to 2^18 sizes away", make: far },
    Kind { name: "spawn-corners", about: "within concave corners: the next wall is as near as can be", make: corners },
    Kind { name: "spawn-seams", about: "from exactly on edges and vertices of a height field", make: seams },
    Kind { name: "spawn-shells", about: "between closed meshes 1e-4 apart", make: shells },
    Kind { name: "spawn-layers", about: "between parallel triangles a few floats apart", make: layers },
    Kind {
        name: "spawn-grazing",
        about: "at angles of 2^-3 to 2^-23 to the surface, as near total reflection",
        make: grazing,
    },
    Kind {
        name: "spawn-flat",
        about: "exactly within a floor of many triangles, and at small angles to it",
        make: flat,
    },
    Kind { name: "spawn-glass", about: "straight on through walls of 2^-4 to 2^-20 thickness", make: glass },
    Kind { name: "spawn-needles", about: "from needles to the needles beside them", make: needles },
];

fn from_blob(mesh: Mesh, center: Vec3, rays: usize, random: &mut Random) -> Case {
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        let origin = center + random.direction() * random.pick(&[0.2, 3.0]);
        StressRay::to(origin, target).then(random.direction())
    })
}

fn sphere(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    from_blob(mesh, Vec3::ZERO, rays, random)
}

fn small(random: &mut Random, rays: usize) -> Case {
    sphere(random, rays).scaled(1e-4)
}

fn offset(random: &mut Random, rays: usize) -> Case {
    let center = random.direction() * 1e5;
    let mesh = blob(3, random).mapped(|p| p + center);
    from_blob(mesh, center, rays, random)
}

fn scales(random: &mut Random, rays: usize) -> Case {
    let factor = random.size(-60, 60);
    sphere(random, rays).scaled(factor)
}

fn far(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(random.direction() * random.size(10, 18), mesh.random_inside(random)).then(random.direction())
    })
}

fn corners(random: &mut Random, rays: usize) -> Case {
    let (low, high) = (-Vec3::ONE - random.vec3().abs(), Vec3::ONE + random.vec3().abs());
    let mesh = Mesh::cube(low, high);
    Case::new(mesh, rays, random, |_, random, i| {
        // A point near an edge or a corner, up to exactly there.
        let corner = Vec3::from_array([0, 1, 2].map(|k| random.pick(&[low[k], high[k]])));
        let mut target = corner * (1.0 - random.pick(&[0.0, power_of_two(-20), power_of_two(-10)]));
        target[i % 3] = corner[i % 3];
        if i % 2 == 0 {
            target[(i + 1) % 3] *= random.signed();
        }
        StressRay::to(random.vec3() * 0.5, target).then(random.direction())
    })
}

fn seams(random: &mut Random, rays: usize) -> Case {
    let heights: Vec<f32> = (0..13 * 13).map(|_| random.whole(0, 8) as f32 / 8.0).collect();
    let mut mesh = Mesh::sheet(12, |x, y| heights[13 * y + x]);
    mesh.append(&Mesh::cube(Vec3::splat(-20.0), Vec3::splat(20.0)));
    let count = mesh.triangles.len() - 12;
    Case::new(mesh, rays, random, |mesh, random, _| {
        let corners = mesh.corners(random.below(count));
        let k = random.below(3);
        let target = corners[k] + (corners[(k + 1) % 3] - corners[k]) * (0.25 * random.below(4) as f32);
        // Dyadic, so that the first hit is exactly on the edge.
        let direction = Vec3::new(random.whole(-2, 2) as f32 / 8.0, random.whole(-2, 2) as f32 / 8.0, -1.0);
        StressRay::new(target - direction * 8.0, direction).then(random.direction())
    })
}

fn shells(random: &mut Random, rays: usize) -> Case {
    let inner = blob(3, random);
    let mut mesh = inner.clone();
    for k in 1..=3 {
        mesh.append(&inner.clone().mapped(|p| p * (1.0 + 1e-4 * k as f32)));
    }
    from_blob(mesh, Vec3::ZERO, rays, random)
}

fn layers(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    let tilt = random.vec3() * 0.25;
    for i in 0..32u32 {
        let corner = |x: f32, y: f32| {
            let z = 2.0 + tilt.x * x + tilt.y * y;
            Vec3::new(x, y, f32::from_bits(z.to_bits() + i * (1 + i / 4)))
        };
        mesh.triangle([corner(-2.0, -2.0), corner(6.0, -2.0), corner(-2.0, 6.0)]);
    }
    Case::new(mesh.shuffled(random), rays, random, |_, random, i| {
        let target = Vec3::new(random.signed(), random.signed(), 2.0);
        let origin = Vec3::new(random.signed(), random.signed(), if i % 2 == 0 { 0.0 } else { 4.0 });
        let along = random.direction();
        let flat = if i % 3 == 0 { Vec3::new(1.0, 1.0, 0.1) } else { Vec3::ONE };
        StressRay::to(origin, target).then(along * flat)
    })
}

fn grazing(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let corners = mesh.corners(random.below(mesh.triangles.len()));
        let target = crate::stress::mesh::inside_of(corners, random);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let along = normal.cross(random.direction()).normalize_or_zero();
        let next = along + normal * random.sign() * random.size(-23, -3);
        StressRay::to(target * random.pick(&[0.5, 3.0]) + random.vec3() * 0.1, target).then(next)
    })
}

fn flat(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::sheet(12, |_, _| 0.0);
    mesh.append(&Mesh::cube(Vec3::new(3.0, 3.0, 0.0), Vec3::new(4.0, 4.0, 2.0)));
    mesh.append(&Mesh::cube(Vec3::new(7.0, 6.0, 0.0), Vec3::new(8.0, 9.0, 1.0)));
    let mesh = mesh.mapped(|p| Vec3::new(p.x, p.y, 0.5 * p.x + 0.25 * p.y + p.z));
    Case::new(mesh.shuffled(random), rays, random, |_, random, i| {
        let (x, y) = (random.whole(1, 95) as f32 / 8.0, random.whole(1, 95) as f32 / 8.0);
        let target = Vec3::new(x, y, 0.5 * x + 0.25 * y);
        let (dx, dy) = (random.whole(-4, 4) as f32, random.whole(-4, 4) as f32);
        let rise = match i % 3 {
            0 => 0.0,
            _ => random.sign() * random.size(-23, -3),
        };
        StressRay::new(target + Vec3::Z * 8.0, -Vec3::Z).then(Vec3::new(dx, dy, 0.5 * dx + 0.25 * dy + rise))
    })
}

fn glass(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for k in 0..8 {
        let place = random.vec3() * 4.0;
        let half = Vec3::new(1.0, 1.0, power_of_two(-5 - 2 * k));
        let (x, y) = random.direction().any_orthonormal_pair();
        let turned = |p: Vec3| x * p.x + y * p.y + x.cross(y) * p.z + place;
        mesh.append(&Mesh::cube(-half, half).mapped(turned));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        let ray = StressRay::to(random.direction() * 8.0, target);
        ray.then(ray.direction + random.vec3() * random.pick(&[0.0, 0.25]))
    })
}

fn needles(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    let ahead = random.direction();
    let (aside, up) = ahead.any_orthonormal_pair();
    for i in 0..120 {
        let start = aside * ((i % 12) as f32 * 0.01) + up * ((i / 12) as f32 * 0.01) + random.vec3() * 0.002;
        mesh.triangle([start, start + ahead * 4.0, start + ahead * 4.0 + random.vec3() * 0.01]);
    }
    Case::new(mesh, rays, random, |mesh, random, _| {
        let target = mesh.random_inside(random);
        StressRay::to(target + random.direction() * 2.0, target).then(random.direction())
    })
}
