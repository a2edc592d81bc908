//! t at the ends of float32: limits there, hits so near that t is a subnormal number, and hits so far that no float
//! tells t.

use super::Kind;
use super::lattices::turned;
use super::limits::with_limits_at_hits;
use crate::stress::case::{Case, StressRay};
use crate::stress::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "limit-ends", about: "limits at the ends of float32, and hits at t = 0 and beside it", make: ends },
    Kind {
        name: "limit-tiny",
        about: "limits at and one float beside a t of 2^-149 to 2^127, by directions of any length",
        make: tiny_limits,
    },
    Kind { name: "t-subnormal", about: "hits at a t of 2^-149 to 2^-100", make: subnormal },
    Kind { name: "t-infinite", about: "hits at a t just below, at and beyond the largest float", make: infinite },
    Kind { name: "any-infinite", about: "any hit, where some are beyond the largest float", make: any_infinite },
];

/// Limits of all sorts.
const LIMITS: [f32; 16] = [
    f32::NEG_INFINITY,
    f32::MIN,
    -1.0,
    -f32::MIN_POSITIVE,
    -1e-45,
    -0.0,
    0.0,
    1e-45,
    3e-45,
    1.175_494_2e-38, // the largest subnormal number
    f32::MIN_POSITIVE,
    1e-20,
    1.0,
    1e20,
    f32::MAX,
    f32::INFINITY,
];

/// Rectangles across the z axis, from `-half` to `half` in x and y; every second one is inclined by a float's last bit
/// or by half.
fn planes(heights: &[f32], half: f32, random: &mut Random) -> Mesh {
    let mut mesh = Mesh::default();
    for (i, &z) in heights.iter().enumerate() {
        let rise = if i % 2 == 0 { 0.0 } else { random.pick(&[0.5 * z.abs(), z.next_up() - z]) };
        let corner = |x: f32, y: f32| Vec3::new(x * half, y * half, if x > 0.0 { z + rise } else { z });
        mesh.quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    }
    mesh.shuffled(random)
}

/// Ten planes about `size`, that at zero among them, so wide as they are high or as 1.
fn planes_about(size: f32, random: &mut Random) -> Mesh {
    let mut heights = vec![0.0];
    heights.extend((0..6).map(|_| random.whole(-8, 8) as f32 * size));
    heights.extend((0..3).map(|_| random.sign() * size * random.size(-30, 3)));
    let half = random.pick(&[size.max(f32::MIN_POSITIVE), 1.0]);
    planes(&heights, half, random)
}

/// A ray along z, or all but along it, from near one of the planes.
fn down(size: f32, mesh: &Mesh, random: &mut Random) -> StressRay {
    let half = mesh.positions[0].x.abs();
    let z = if random.below(2) == 0 {
        random.whole(-16, 16) as f32 * size / 2.0
    } else {
        let z = mesh.random_vertex(random).z;
        random.pick(&[z, z.next_up(), z.next_down()])
    };
    let origin = Vec3::new(random.whole(-7, 7) as f32 * half / 8.0, random.whole(-7, 7) as f32 * half / 8.0, z);
    // With odd numbers t is mostly no float.
    let length = size * random.size_or(&[1.0, 3.0, 0.7], -60, 60);
    let length = if length.is_finite() && length > 0.0 { length } else { 1.0 };
    StressRay::new(origin, Vec3::Z * random.sign() * length)
}

fn ends(random: &mut Random, rays: usize) -> Case {
    let size = random.size_or(&[0.1, 1.0, 10.0, 1e4], -140, 120);
    let mesh = planes_about(size, random);
    let case = Case::new(mesh, rays, random, |mesh, random, i| {
        let ray = down(size, mesh, random);
        match i % 3 {
            0 => ray.within(random.pick(&LIMITS), f32::INFINITY),
            1 => ray.within(f32::NEG_INFINITY, random.pick(&LIMITS)),
            _ => ray.within(random.pick(&LIMITS), random.pick(&LIMITS)),
        }
    });
    turned(case, random)
}

fn tiny_limits(random: &mut Random, rays: usize) -> Case {
    let size = random.size(-149, 100);
    let mesh = planes_about(size, random);
    let case = Case::new(mesh, rays, random, |mesh, random, i| {
        let mut ray = down(size, mesh, random);
        if i % 2 == 0 {
            ray.direction = Vec3::Z * random.sign() * random.whole(1, 7) as f32 * power_of_two(random.whole(-149, 120));
        }
        ray.within(random.pick(&[0.0, 0.0, f32::NEG_INFINITY]), f32::INFINITY)
    });
    turned(with_limits_at_hits(case, random), random)
}

fn subnormal(random: &mut Random, rays: usize) -> Case {
    // A large scene with a plane at zero, so that t is subnormal in units of the scene where it is not in the caller's.
    let size = random.size_or(&[1.0, 1e18], -20, 100);
    let mesh = planes_about(size, random);
    let case = Case::new(mesh, rays, random, |mesh, random, _| {
        let ray = down(size, mesh, random);
        let origin = ray.origin.with_z(random.size(-149, -40));
        let direction = -Vec3::Z * random.size_or(&[1.0, 3.0], -30, 40);
        StressRay::new(origin, direction)
    });
    turned(case, random)
}

/// Planes of which one has its hit at 2^128 as near as float32 tells, some are before it, and some beyond.
fn at_the_end(any_hit: bool, random: &mut Random, rays: usize) -> Case {
    let exponent = random.whole(2, 120);
    let size = power_of_two(exponent);
    let mut heights = vec![-size, size];
    heights.extend((0..3).map(|_| random.sign() * size * random.size(0, 4)));
    if random.below(2) == 0 {
        heights.extend((0..3).map(|_| random.sign() * size * random.size(-60, 0)));
    }
    let mesh = planes(&heights, size, random);
    let case = Case::new(mesh, rays, random, |_, random, i| {
        // Quarters of the digit after the last one that a float of this size has.
        let quarter = power_of_two(exponent - 27);
        let beside = random.whole(-12, 24) as f32 * quarter;
        let place = |random: &mut Random| random.whole(-7, 7) as f32 * size / 8.0;
        let (x, y) = (place(random), place(random));
        let direction = Vec3::Z * power_of_two(exponent - 128);
        let (origin, direction) = if random.below(2) == 0 {
            (Vec3::new(x, y, -beside), -direction)
        } else {
            (Vec3::new(x, y, beside), direction)
        };
        let near = if i % 3 == 0 { random.pick(&[f32::NEG_INFINITY, f32::MIN]) } else { 0.0 };
        StressRay::new(origin, direction).within(near, random.pick(&[f32::INFINITY, f32::INFINITY, f32::MAX]))
    });
    Case { any_hit, ..turned(case, random) }
}

fn infinite(random: &mut Random, rays: usize) -> Case {
    at_the_end(false, random, rays)
}

fn any_infinite(random: &mut Random, rays: usize) -> Case {
    at_the_end(true, random, rays)
}
