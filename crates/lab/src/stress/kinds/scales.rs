//! Whole scenes from one end of float32 to the other: nothing may depend on the unit of length.

use super::Kind;
use super::seams::blob;
use crate::stress::case::{Case, StressRay};
use raybrook::low_level::random::{Random, power_of_two};

pub(super) const KINDS: &[Kind] = &[
    Kind { name: "scale-1e-20", about: "a scene of size 1e-20: products of coordinates underflow", make: tiny },
    Kind { name: "scale-1e-6", about: "a scene of size 1e-6: absolute epsilons are larger than it", make: small },
    Kind { name: "scale-1e6", about: "a scene of size 1e6: absolute epsilons are lost in it", make: large },
    Kind { name: "scale-1e18", about: "a scene of size 1e18: products of coordinates overflow", make: huge },
    Kind { name: "scale-any", about: "a scene of size 2^-100 to 2^100, another one with each seed", make: any },
    Kind {
        name: "subnormal",
        about: "a scene of size 2^-130, whose coordinates are subnormal numbers",
        make: subnormal,
    },
    Kind { name: "largest", about: "a scene of size 2^126: differences of coordinates overflow", make: largest },
];

/// Seams and insides of a closed mesh from inside and outside, `factor` times as large; every second direction keeps
/// its length of about 1.
fn of_size(factor: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    let case = Case::new(mesh, rays, random, |mesh, random, i| {
        let target = if i % 3 == 0 { mesh.random_inside(random) } else { mesh.random_seam(random) };
        StressRay::to(random.direction() * random.pick(&[0.1, 1.875]), target)
    });
    let mut scaled = case.clone().scaled(factor);
    for (ray, unscaled) in scaled.rays.iter_mut().zip(&case.rays).step_by(2) {
        ray.direction = unscaled.direction;
    }
    scaled
}

fn tiny(random: &mut Random, rays: usize) -> Case {
    of_size(1e-20, random, rays)
}

fn small(random: &mut Random, rays: usize) -> Case {
    of_size(1e-6, random, rays)
}

fn large(random: &mut Random, rays: usize) -> Case {
    of_size(1e6, random, rays)
}

fn huge(random: &mut Random, rays: usize) -> Case {
    of_size(1e18, random, rays)
}

fn any(random: &mut Random, rays: usize) -> Case {
    of_size(random.size(-100, 100), random, rays)
}

fn subnormal(random: &mut Random, rays: usize) -> Case {
    of_size(power_of_two(-130), random, rays)
}

fn largest(random: &mut Random, rays: usize) -> Case {
    of_size(power_of_two(126), random, rays)
}
