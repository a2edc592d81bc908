//! Triangles that are hard by how they lie: to the ray, and to each other.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::{Mesh, inside_of};
use glam::Vec3;
use raybrook::low_level::random::Random;

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "coplanar", about: "exactly in the planes of triangles, with a wall behind", make: coplanar },
    Kind { name: "nearly-coplanar", about: "a few floats beside the planes of triangles", make: nearly_coplanar },
    Kind { name: "grazing", about: "at angles of 2^-3 to 2^-23 to the surface", make: grazing },
    Kind { name: "back-faces", about: "triangles seen from behind", make: back_faces },
    Kind {
        name: "layers",
        about: "nearly parallel triangles 0 to 512 floats apart: the nearer one is due",
        make: layers,
    },
    Kind {
        name: "crossings",
        about: "where triangles run through each other: equal t but for rounding",
        make: crossings,
    },
    Kind {
        name: "duplicates",
        about: "the same triangle several times, with other first corners and facings",
        make: duplicates,
    },
    Kind {
        name: "overlaps",
        about: "different triangles in one plane: exactly equal t by different sums",
        make: overlaps,
    },
    Kind { name: "same-centre", about: "triangles about one centre that no plane separates", make: same_centre },
    Kind {
        name: "degenerate",
        about: "points, segments and nearly such triangles in front of a mesh",
        make: degenerate,
    },
    Kind {
        name: "outside-cells",
        about: "long triangles through many cells: hits beyond the cell that is looked at",
        make: outside_cells,
    },
];

pub(super) fn whole3(low: i32, high: i32, random: &mut Random) -> Vec3 {
    Vec3::new(random.whole(low, high) as f32, random.whole(low, high) as f32, random.whole(low, high) as f32)
}

/// Triangles of dyadic corners, and walls around them.
fn room(count: usize, random: &mut Random) -> Mesh {
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let at = whole3(-8, 8, random);
        mesh.triangle([(); 3].map(|()| at + whole3(-4, 4, random) / 2.0));
    }
    mesh.append(&Mesh::cube(Vec3::splat(-32.0), Vec3::splat(32.0)));
    mesh
}

fn coplanar(random: &mut Random, rays: usize) -> Case {
    const TRIANGLES: usize = 40;
    let mesh = room(TRIANGLES, random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        // Dyadic, so that origin and direction are exactly in the plane.
        let [a, b, c] = mesh.corners(random.below(TRIANGLES));
        let (u, v) = (random.whole(-4, 4) as f32 / 4.0, random.whole(-4, 4) as f32 / 4.0);
        let direction = match i % 3 {
            0 => b - a,
            1 => c - b,
            _ => (b - a) * u + (c - a) * v,
        };
        let from = a + (b - a) * (random.whole(0, 4) as f32 / 4.0);
        StressRay::new(from - direction * random.whole(0, 4) as f32, direction)
    })
}

fn nearly_coplanar(random: &mut Random, rays: usize) -> Case {
    const TRIANGLES: usize = 60;
    let mut mesh = Mesh::soup(TRIANGLES, 1.0, random);
    mesh.append(&Mesh::cube(Vec3::splat(-4.0), Vec3::splat(4.0)));
    Case::new(mesh, rays, random, |mesh, random, _| {
        let corners = mesh.corners(random.below(TRIANGLES));
        let (from, to) = (inside_of(corners, random), inside_of(corners, random));
        // Rounding alone keeps these from being in the plane.
        let direction = to - from;
        StressRay::new(from - direction * random.size(0, 3), direction)
    })
}

fn grazing(random: &mut Random, rays: usize) -> Case {
    const TRIANGLES: usize = 100;
    let mut mesh = Mesh::soup(TRIANGLES, 0.5, random).mapped(|p| p * 4.0);
    mesh.append(&Mesh::cube(Vec3::splat(-40.0), Vec3::splat(40.0)));
    Case::new(mesh, rays, random, |mesh, random, i| {
        let corners = mesh.corners(random.below(TRIANGLES));
        let target = if i % 3 == 0 { mesh.random_edge_point(random) } else { inside_of(corners, random) };
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let along = normal.cross(random.direction()).normalize_or_zero();
        StressRay::to(target - (along + normal * random.sign() * random.size(-23, -3)) * 8.0, target)
    })
}

fn back_faces(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(2, random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        StressRay::to(random.vec3() * 0.4, target)
    })
}

/// `x` moved on by `steps` floats.
pub(super) fn moved(x: f32, steps: i32) -> f32 {
    (0..steps.unsigned_abs()).fold(x, |x, _| if steps < 0 { x.next_down() } else { x.next_up() })
}

fn layers(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for i in 0..48 {
        let reach = random.pick(&[0, 1, 3, 16, 256]);
        let corner = |x: f32, y: f32, random: &mut Random| {
            Vec3::new(x, y, moved(2.0 + 0.25 * x - 0.125 * y, random.whole(-reach, reach)))
        };
        let corners = [corner(-2.0, -2.0, random), corner(6.0, -2.0, random), corner(-2.0, 6.0, random)];
        mesh.triangle(if i % 2 == 0 { corners } else { [corners[2], corners[1], corners[0]] });
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let side = if i % 2 == 0 { 0.0 } else { 6.0 };
        let target = if i % 5 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        match i % 3 {
            0 => StressRay::new(target.with_z(side), Vec3::Z * (2.0 - side).signum()),
            _ => StressRay::to(Vec3::new(random.signed(), random.signed(), side), target),
        }
    })
}

fn crossings(random: &mut Random, rays: usize) -> Case {
    // Pairs of triangles through a common segment, which no float32 point of lies in both planes.
    const PAIRS: usize = 60;
    let mut mesh = Mesh::default();
    for _ in 0..PAIRS {
        let (a, b) = (random.vec3(), random.vec3());
        for _ in 0..2 {
            let across = random.vec3();
            mesh.triangle([a + across, a - across, b.lerp(a, -0.5)]);
        }
    }
    Case::new(mesh, rays, random, |mesh, random, _| {
        let pair = random.below(PAIRS);
        let [p, q] = [mesh.corners(2 * pair), mesh.corners(2 * pair + 1)];
        let target = p[0].midpoint(p[1]).lerp(q[2], random.unit());
        StressRay::to(random.direction() * 4.0, target)
    })
}

fn duplicates(random: &mut Random, rays: usize) -> Case {
    let base = blob(1, random);
    let mut mesh = Mesh::default();
    for _ in 0..5 {
        let mut copy = base.clone();
        for triangle in &mut copy.triangles {
            triangle.rotate_left(random.below(3));
            if random.below(2) == 0 {
                triangle.swap(1, 2);
            }
        }
        mesh.append(&copy);
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 2 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        StressRay::to(random.direction() * random.pick(&[0.2, 3.0]), target)
    })
}

fn overlaps(random: &mut Random, rays: usize) -> Case {
    // z = (x + 2 y) / 8 at whole x and y: every triangle lies exactly in this plane, or in the one 16 above it.
    let mut mesh = Mesh::default();
    for i in 0..90 {
        mesh.triangle([(); 3].map(|()| {
            let (x, y) = (random.whole(-40, 40) as f32, random.whole(-40, 40) as f32);
            Vec3::new(x, y, (x + 2.0 * y) / 8.0 + if i % 3 == 0 { 16.0 } else { 0.0 })
        }));
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        let side = if i % 2 == 0 { 50.0 } else { -50.0 };
        StressRay::to(Vec3::new(random.signed() * 20.0, random.signed() * 20.0, side), target)
    })
}

fn same_centre(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for _ in 0..60 {
        let (a, b) = (random.direction(), random.direction());
        mesh.triangle([a, b, -(a + b)]);
    }
    let repeated = mesh.corners(0);
    for _ in 0..60 {
        mesh.triangle(repeated);
    }
    Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        StressRay::to(random.direction() * 3.0, target)
    })
}

fn degenerate(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::default();
    for i in 0..150 {
        let (a, b) = (random.direction() * 1.2, random.direction() * 1.2);
        mesh.triangle(match i % 5 {
            0 => [a, a, a],
            1 => [a, b, a],
            2 => [a, b, b],
            // On a line exactly, and within rounding.
            3 => [Vec3::ONE * a.x, Vec3::ONE * a.y, Vec3::ONE * b.x],
            _ => [a, b, a.lerp(b, random.unit())],
        });
    }
    mesh.append(&blob(2, random));
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let target = if i % 2 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        StressRay::to(random.direction() * 4.0, target)
    })
}

fn outside_cells(random: &mut Random, rays: usize) -> Case {
    let mut mesh = Mesh::soup(250, 0.03, random);
    for _ in 0..40 {
        let (from, to) = (random.vec3() * 1.5, random.vec3() * 1.5);
        mesh.triangle([from, to, to + random.vec3() * 0.05]);
    }
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| match i % 3 {
        0 => StressRay::new(random.vec3() * 2.0, random.direction()),
        1 => StressRay::to(random.vec3() * 2.0, mesh.random_seam(random)),
        _ => StressRay::to(random.vec3() * 2.0, mesh.random_inside(random)),
    })
}
