//! Limits of t, rays that begin on a surface, and numbers that are no numbers.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use crate::stress::exact::{ExactTracer, Interval};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::Random;

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "t-limits", about: "limits exactly at a hit and one float beside it", make: t_limits },
    Kind {
        name: "t-rounded",
        about: "limits at the float next to a hit's t, which lies between two floats",
        make: t_rounded,
    },
    Kind { name: "intervals", about: "negative, empty, reversed, infinite and NaN limits", make: intervals },
    Kind { name: "on-surface", about: "origins exactly on a surface, and within rounding of it", make: on_surface },
    Kind { name: "bad-rays", about: "NaN, infinite and zero parts: such rays miss", make: bad_rays },
    Kind {
        name: "any-floats",
        about: "random bits, and origins and lengths of 2^-120 to 2^120 aimed at a mesh",
        make: any_floats,
    },
    Kind {
        name: "bad-vertices",
        about: "NaN and infinite vertices in a good mesh, which is still hit",
        make: bad_vertices,
    },
];

/// Sheets of dyadic corners in the planes z = 4, 8, 12, 16 or sloping up from there.
fn sheets(random: &mut Random) -> Mesh {
    let mut mesh = Mesh::default();
    for k in 1..=4 {
        let (x, y) = (random.whole(-1, 1) as f32 / 8.0, random.whole(-1, 1) as f32 / 8.0);
        mesh.append(&Mesh::sheet(5, |i, j| 4.0 * k as f32 + x * i as f32 + y * j as f32));
    }
    mesh.shuffled(random)
}

/// A dyadic point above or below the sheets' inside.
fn dyadic_below(random: &mut Random) -> Vec3 {
    Vec3::new(random.whole(0, 40) as f32 / 8.0, random.whole(0, 40) as f32 / 8.0, random.whole(-8, 8) as f32 / 4.0)
}

/// The limits of every ray moved to where it has its first hit, or up to one float beside that.
pub(super) fn with_limits_at_hits(mut case: Case, random: &mut Random) -> Case {
    let tracer = ExactTracer::new(&case.mesh);
    for ray in &mut case.rays {
        let anything = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
        let line = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let Some(hit) = line.and_then(|line| tracer.closest(&line, anything, &[], |_| true)) else { continue };
        let t = hit.crossing.t.to_f32();
        let limit = random.pick(&[t.next_down(), t, t, t.next_up()]);
        match random.below(3) {
            0 => ray.t_min = limit,
            1 => ray.t_max = limit,
            _ => (ray.t_min, ray.t_max) = (limit, limit),
        }
    }
    case
}

fn t_limits(random: &mut Random, rays: usize) -> Case {
    let mesh = sheets(random);
    let case = Case::new(mesh, rays, random, |_, random, _| {
        StressRay::new(dyadic_below(random), Vec3::Z * random.pick(&[0.5, 1.0, 2.0]))
    });
    with_limits_at_hits(case, random)
}

fn t_rounded(random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::soup(60, 1.0, random);
    let case = Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 4 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        StressRay::to(random.vec3() * 3.0, target)
    });
    with_limits_at_hits(case, random)
}

fn intervals(random: &mut Random, rays: usize) -> Case {
    const LIMITS: [f32; 12] =
        [f32::NEG_INFINITY, -1e30, -2.0, -1.0, -0.0, 0.0, 1e-30, 1.0, 2.0, 1e30, f32::INFINITY, f32::NAN];
    let mesh = blob(2, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let ray = StressRay::to(random.vec3() * 2.0, mesh.random_inside(random));
        ray.within(random.pick(&LIMITS), random.pick(&LIMITS))
    })
}

fn on_surface(random: &mut Random, rays: usize) -> Case {
    let mesh = sheets(random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        if i % 3 == 0 {
            return StressRay::new(mesh.random_inside(random), random.direction());
        }
        let [a, b, c] = mesh.corners(random.below(mesh.triangles.len()));
        let (u, v) = (random.whole(0, 8), random.whole(0, 8));
        let (u, v) = if u + v > 8 { (8 - u, 8 - v) } else { (u, v) };
        let origin = a + (b - a) * (u as f32 / 8.0) + (c - a) * (v as f32 / 8.0);
        StressRay::new(origin, Vec3::new(random.signed(), random.signed(), random.sign()))
    })
}

fn bad_rays(random: &mut Random, rays: usize) -> Case {
    const BAD: [f32; 4] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN];
    let mesh = blob(2, random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        let ray = StressRay::to(random.vec3() * 2.0, mesh.random_inside(random));
        let mut numbers: [f32; 6] = std::array::from_fn(|k| if k < 3 { ray.origin[k] } else { ray.direction[k - 3] });
        match i % 6 {
            0 => {} // a good one
            1 => numbers[3..].fill(0.0),
            2 => numbers[3..].fill(-0.0),
            _ => {
                for _ in 0..random.whole(1, 3) {
                    numbers[random.below(6)] = random.pick(&BAD);
                }
            }
        }
        let [x, y, z, dx, dy, dz] = numbers;
        StressRay::new(Vec3::new(x, y, z), Vec3::new(dx, dy, dz))
    })
}

fn any_floats(random: &mut Random, rays: usize) -> Case {
    let mesh = blob(2, random);
    Case::new(mesh, rays, random, |mesh, random, i| {
        if i % 4 == 0 {
            let bits = |random: &mut Random| Vec3::from_array([(); 3].map(|()| random.any_float()));
            return StressRay::new(bits(random), bits(random));
        }
        // Along an axis, so that what is not along it stays what it is.
        let target = mesh.random_inside(random);
        let axis = random.pick(&[Vec3::X, Vec3::Y, Vec3::Z]) * random.sign();
        let aside = random.vec3() * random.size(-149, -20);
        StressRay::new(target - axis * random.size(-120, 120), (axis + aside) * random.size(-120, 120))
    })
}

fn bad_vertices(random: &mut Random, rays: usize) -> Case {
    const BAD: [f32; 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let mut mesh = blob(3, random);
    for _ in 0..40 {
        let mut corners = [(); 3].map(|()| random.vec3() * 2.0);
        for _ in 0..random.whole(1, 4) {
            corners[random.below(3)][random.below(3)] = random.pick(&BAD);
        }
        mesh.triangle(corners);
    }
    Case::new(mesh.shuffled(random), rays, random, |mesh, random, i| {
        let target = if i % 2 == 0 { mesh.random_seam(random) } else { mesh.random_inside(random) };
        let target = if target.is_finite() { target } else { random.vec3() };
        StressRay::to(random.direction() * random.pick(&[0.2, 3.0]), target)
    })
}
