//! Cases that grow harder with a number: where does a method break down?

use crate::stress::{Case, Mesh, Random, StressRay};
use glam::Vec3;

/// One way in which cases grow harder.
pub struct Sweep {
    /// The column of the number, and the sweep's name.
    pub name: &'static str,
    /// What is traced.
    pub about: &'static str,
    /// The numbers, from easy to hard.
    pub values: &'static [f64],
    /// Whether they are of so different sizes that only logarithms show them.
    pub is_log: bool,
    make: fn(f32, &mut Random, usize) -> Case,
}

impl Sweep {
    /// The case of a number: always the same for a seed.
    pub fn case(&self, value: f64, seed: u64, rays: usize) -> Case {
        (self.make)(value as f32, &mut Random(seed ^ u64::from(crc32fast::hash(self.name.as_bytes())) << 32), rays)
    }

    /// All of them.
    pub const ALL: &'static [Sweep] = &[
        Sweep {
            name: "scale",
            about: "edges and vertices of a closed mesh seen from inside, all coordinates multiplied",
            values: &[1e-20, 1e-15, 1e-10, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e10, 1e14, 1e18],
            is_log: true,
            make: scale,
        },
        Sweep {
            name: "offset",
            about: "the same mesh, moved away from zero by so many times its size",
            values: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7],
            is_log: true,
            make: offset,
        },
        Sweep {
            name: "distance",
            about: "insides of the same mesh's triangles, from so many times its size away",
            values: &[2.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
            is_log: true,
            make: distance,
        },
        Sweep {
            name: "angle",
            about: "a rough sheet, seen under so small an angle",
            values: &[1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0],
            is_log: true,
            make: grazing,
        },
        Sweep {
            name: "aspect",
            about: "edges and vertices of a closed mesh, so much longer than wide, from inside",
            values: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
            is_log: true,
            make: aspect,
        },
        Sweep {
            name: "valence",
            about: "hub and spokes of a closed double fan of so many triangles a hub",
            values: &[8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0],
            is_log: true,
            make: valence,
        },
        Sweep {
            name: "gap",
            about: "two rough sheets, one over the other by so many floats",
            values: &[1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 1024.0],
            is_log: true,
            make: gap,
        },
    ];
}

/// A closed mesh around zero without symmetry, in random order.
fn blob(levels: u32, random: &mut Random) -> Mesh {
    let stretch = Vec3::new(1.0, 0.8, 0.9) + random.vec3() * 0.1;
    let shear = random.vec3() * 0.2;
    Mesh::sphere(levels)
        .mapped(|p| Vec3::new(p.x + shear.x * p.y, p.y + shear.y * p.z, p.z + shear.z * p.x) * stretch)
        .shuffled(random)
}

/// Rays see fronts: the thesis's test, which knows no backs, is to show where its numbers fail.
fn from_inside(mesh: Mesh, center: Vec3, size: Vec3, rays: usize, random: &mut Random) -> Case {
    Case::new(mesh.turned_around(), rays, random, |mesh, random, _| {
        StressRay::to(center + random.vec3() * 0.2 * size, mesh.random_seam(random))
    })
}

fn scale(factor: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    from_inside(mesh, Vec3::ZERO, Vec3::ONE, rays, random).scaled(factor)
}

fn offset(distance: f32, random: &mut Random, rays: usize) -> Case {
    let center = random.direction() * distance;
    let mesh = blob(3, random).mapped(|p| p + center);
    from_inside(mesh, center, Vec3::ONE, rays, random)
}

fn distance(distance: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = blob(3, random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(random.direction() * distance, mesh.random_inside(random))
    })
}

fn grazing(angle: f32, random: &mut Random, rays: usize) -> Case {
    const SIDE: usize = 12;
    let mesh = Mesh::sheet(SIDE, |_, _| random.signed() * 1e-3);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let target = mesh.random_inside(random);
        let around = Vec3::new(random.signed(), random.signed(), 0.0);
        let direction = around.normalize_or(Vec3::X) * -2.0 + Vec3::Z * (2.0 * angle);
        StressRay::to(target + direction, target)
    })
}

fn aspect(ratio: f32, random: &mut Random, rays: usize) -> Case {
    let size = Vec3::new(1.0, 1.0 / ratio, 1.0 / ratio);
    let mesh = blob(3, random).mapped(|p| p * size);
    from_inside(mesh, Vec3::ZERO, size, rays, random)
}

fn valence(triangles: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = Mesh::double_fan(triangles.log2().round() as u32, 0.5);
    from_inside(mesh, Vec3::ZERO, Vec3::splat(0.5), rays, random)
}

fn gap(floats: f32, random: &mut Random, rays: usize) -> Case {
    const SIDE: usize = 12;
    let lower = Mesh::sheet(SIDE, |_, _| 1.0 + random.unit() * 0.5);
    let mut mesh = lower.clone().mapped(|p| p.with_z(f32::from_bits(p.z.to_bits() + floats as u32)));
    mesh.append(&lower);
    let mesh = mesh.shuffled(random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let target = mesh.random_inside(random);
        StressRay::to(target + Vec3::new(3.0 * random.signed(), 0.0, 3.0), target)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::stress::{Answers, Found};

    #[test]
    fn exact_hits_are_right_at_every_number_and_rays_hit() {
        for sweep in Sweep::ALL {
            for &value in [sweep.values[0], *sweep.values.last().unwrap()].iter() {
                let case = sweep.case(value, 7, 60);
                let answers = Answers::new(&case);
                let found = Found::new(&case, &TraceOptions::DEFAULT, None, None).unwrap();
                let faults = found.faults(&answers, true);
                assert!(faults.is_empty(), "{} {value}: {faults:?}", sweep.name);
                let hits = found.hits.iter().filter(|hit| crate::tracer::is_hit(hit)).count();
                assert!(hits > 20, "{} {value}: {hits} hits", sweep.name);
            }
        }
    }
}
