//! Triangles that are hard by their size and form.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::{Mesh, inside_of};
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "sizes", about: "single triangles of size 2^-20 to 2^14, seen from a few sizes away", make: sizes },
    Kind { name: "small-far", about: "a sheet seen from 2^5 to 2^20 of its triangles' sizes away", make: small_far },
    Kind {
        name: "needles",
        about: "triangles 2^10 to 2^23 times as long as wide, aimed at their middle line",
        make: needles,
    },
    Kind { name: "slivers", about: "obtuse triangles whose corners are nearly on a line", make: slivers },
    Kind { name: "stadium", about: "a ball of 1e-3 on a floor of 1e5", make: stadium },
    Kind { name: "giants", about: "giant needles across tiny triangles: every box is the scene's", make: giants },
    Kind {
        name: "nested",
        about: "sheets of size 2^-30 to 2^30 about one point, each hit through its own",
        make: nested,
    },
];

/// A triangle at `center`: one long edge, and a third corner at `along` of it and `height` aside.
fn on_edge(center: Vec3, length: f32, height: f32, along: f32, random: &mut Random) -> [Vec3; 3] {
    let (x, y) = random.direction().any_orthonormal_pair();
    let start = center - x * (0.5 * length);
    [start, start + x * length, start + x * (length * along) + y * height]
}

fn sizes(random: &mut Random, rays: usize) -> Case {
    const TRIANGLES: usize = 136;
    let mut mesh = Mesh::default();
    for i in 0..TRIANGLES {
        // Every size in a place of its own, so that none hides another.
        let size = power_of_two(i as i32 % 34 - 20);
        let place = Vec3::new((i / 34) as f32 * 4.0, 0.0, 0.0) * size + Vec3::Z * size * 8.0;
        mesh.triangle([(); 3].map(|()| place + random.vec3() * size));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let corners = mesh.corners(random.below(TRIANGLES));
        let size = (corners[1] - corners[0]).length();
        let target = if i % 4 == 0 { corners[0].lerp(corners[1], random.unit()) } else { inside_of(corners, random) };
        StressRay::to(target + random.direction() * size * random.pick(&[1.0, 4.0, 64.0]), target)
    })
}

fn small_far(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::sheet(20, |_, _| 0.25 * random.signed());
    let mesh = mesh.mapped(|p| p + random.vec3() * 0.25).shuffled(random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 3 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        let aside = Vec3::new(random.signed(), random.signed(), 1.0);
        StressRay::to(target + aside * random.size(5, 20), target)
    })
}

fn needles(random: &mut Random, rays: usize) -> Case {
    const NEEDLES: usize = 150;
    let mut mesh = Mesh::default();
    for _ in 0..NEEDLES {
        let along = random.pick(&[0.0, 1.0]);
        let corners = on_edge(random.vec3() * 4.0, 4.0, random.size(-21, -8), along, random);
        mesh.triangle(corners);
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let [a, b, c] = mesh.corners(random.below(NEEDLES));
        let target = match i % 4 {
            0 => a.lerp(b, random.unit()),
            _ => a.lerp(b.midpoint(c), random.unit()),
        };
        StressRay::to(random.vec3() * 10.0, target)
    })
}

fn slivers(random: &mut Random, rays: usize) -> Case {
    const SLIVERS: usize = 150;
    let mut mesh = Mesh::default();
    for _ in 0..SLIVERS {
        let along = 0.2 + 0.6 * random.unit();
        let corners = on_edge(random.vec3() * 4.0, 4.0, random.size(-24, -8), along, random);
        mesh.triangle(corners);
    }
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(random.vec3() * 10.0, inside_of(mesh.corners(random.below(SLIVERS)), random))
    })
}

fn stadium(random: &mut Random, rays: usize) -> Case {
    const FLOOR: f32 = 1e5;
    const BALL: f32 = 1e-3;
    let ball_at = Vec3::new(random.signed() * 3.0, random.signed() * 3.0, BALL);
    let mut mesh = blob(2, random).mapped(|p| p * (0.5 * BALL) + ball_at);
    let ball = mesh.clone();
    let corner = |x: f32, y: f32| Vec3::new(x * FLOOR, y * FLOOR, 0.0);
    mesh.quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    mesh.quad([
        corner(-1.0, 1.0),
        corner(1.0, 1.0),
        corner(1.0, 1.0) + Vec3::Z * FLOOR,
        corner(-1.0, 1.0) + Vec3::Z * FLOOR,
    ]);
    Case::new(mesh, rays, random, |_, random, i| {
        let target = if i % 3 == 0 { ball.random_seam(random) } else { ball.random_inside(random) };
        let towards = random.direction();
        let distance = random.size(-10, 15);
        let origin = target + Vec3::new(towards.x, towards.y, towards.z.abs()) * distance;
        StressRay::to(origin, if i % 4 == 3 { target + random.vec3() * distance } else { target })
    })
}

fn giants(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for _ in 0..100 {
        let side = |random: &mut Random| Vec3::new(random.signed(), random.signed(), random.signed() * 0.1) * 0.2;
        let (from, to) = (Vec3::splat(-1.0) + side(random), Vec3::splat(1.0) + side(random));
        mesh.triangle([from, to, to + random.vec3() * 0.003]);
    }
    mesh.append(&Mesh::soup(250, 0.004, random));
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| match i % 3 {
        0 => StressRay::to(random.direction() * 3.0, mesh.random_seam(random)),
        1 => StressRay::to(random.vec3(), mesh.random_inside(random)),
        _ => StressRay::new(random.vec3(), random.direction()),
    })
}

fn nested(random: &mut Random, rays: usize) -> Case {
    let center = random.vec3() * power_of_two(-28);
    let mut mesh = Mesh::default();
    for k in -30..=30 {
        // Each with a hole that the smaller ones are seen through.
        let size = power_of_two(k);
        let sheet = Mesh::sheet(3, |_, _| 0.125 * random.signed());
        let mut ring = sheet.mapped(|p| (p - Vec3::new(1.5, 1.5, 0.0)) * size + center);
        ring.triangles.retain(|corners| corners.iter().any(|&i| ![5, 6, 9, 10].contains(&i)));
        mesh.append(&ring);
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let corners = mesh.corners(random.below(mesh.triangles.len()));
        let size = (corners[1] - corners[0]).length();
        let target = if i % 3 == 0 { corners[0].lerp(corners[1], random.unit()) } else { inside_of(corners, random) };
        StressRay::to(target + random.direction() * size * random.pick(&[0.25, 2.0, 1024.0]), target)
    })
}
