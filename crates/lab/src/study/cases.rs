//! Cases that grow harder with a number: where does a method break down?

use crate::stress::{Case, Mesh, StressRay, inside_of};
use glam::{DVec3, Vec3};
use raybrook::Result;
use raybrook::low_level::random::Random;
use raybrook::low_level::scene::Scene;

/// One way in which cases grow harder.
pub struct Sweep {
    /// The column of the number, and the sweep's name.
    pub name: &'static str,
    /// What is traced.
    pub about: &'static str,
    /// The numbers, from easy to hard.
    pub values: &'static [f64],
    /// The one where nothing is hard yet: other numbers are compared with it.
    pub base: f64,
    /// What is to be known of its chart.
    pub remark: &'static str,
    shape: Shape,
}

/// Makes the mesh of a sweep.
type MakeMesh<'a> = &'a dyn Fn(&mut Random) -> Mesh;

/// What a sweep is made of.
#[derive(Clone, Copy)]
enum Shape {
    /// A mesh of any shape, of about the size of 1 around zero.
    Any(fn(MakeMesh, f32, &mut Random, usize) -> Case),
    /// A shape of its own, which the number makes hard.
    Own(fn(f32, &mut Random, usize) -> Case),
}

impl Sweep {
    /// The case of a number: always the same for a seed. With `mesh` instead of the program's own, where the sweep is
    /// of any mesh.
    pub fn case(&self, mesh: Option<&Mesh>, value: f64, seed: u64, rays: usize) -> Case {
        let random = &mut Random::new(seed ^ u64::from(crc32fast::hash(self.name.as_bytes())) << 32);
        match self.shape {
            Shape::Own(make) => make(value as f32, random, rays),
            Shape::Any(make) => {
                let mesh = |random: &mut Random| mesh.cloned().unwrap_or_else(|| blob(3, random));
                make(&mesh, value as f32, random, rays)
            }
        }
    }

    /// Whether it can be made of the user's mesh.
    pub fn is_of_any_mesh(&self) -> bool {
        matches!(self.shape, Shape::Any(_))
    }

    /// All of them.
    pub const ALL: &'static [Sweep] = &[
        Sweep {
            name: "scale",
            about: "edges and vertices of a closed mesh seen from inside, all coordinates multiplied",
            values: &[1e-20, 1e-15, 1e-10, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e10, 1e14, 1e18],
            base: 1.0,
            remark: "",
            shape: Shape::Any(scale),
        },
        Sweep {
            name: "offset",
            about: "the same mesh, moved away from zero by so many times its size",
            values: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7],
            base: 1.0,
            remark: "Errors fall with the distance: the farther from zero, the fewer bits tell the corners apart, so \
                     that float32 computes their differences without an error. What is lost is the mesh: its corners \
                     are moved onto a coarse lattice before any method sees them.",
            shape: Shape::Any(offset),
        },
        Sweep {
            name: "distance",
            about: "insides of the same mesh's triangles, from so many times its size away",
            values: &[2.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
            base: 2.0,
            remark: "",
            shape: Shape::Any(distance),
        },
        Sweep {
            name: "angle",
            about: "a mesh's triangles, each seen under so small an angle",
            values: &[1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0],
            base: 1.0,
            remark: "",
            shape: Shape::Any(grazing),
        },
        Sweep {
            name: "aspect",
            about: "edges and vertices of a closed mesh, so much longer than wide, from inside",
            values: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
            base: 1.0,
            remark: "",
            shape: Shape::Any(aspect),
        },
        Sweep {
            name: "valence",
            about: "hub and spokes of a closed double fan of so many triangles a hub",
            values: &[8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0],
            base: 8.0,
            remark: "",
            shape: Shape::Own(valence),
        },
        Sweep {
            name: "gap",
            about: "two rough sheets, one over the other by so many floats",
            values: &[1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 1024.0],
            base: 1024.0,
            remark: "The sheets are apart by less than float32 can tell along most rays; an answer that takes one for \
                     the other there differs, and is not wrong.",
            shape: Shape::Own(gap),
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

/// The user's triangles that can be hit, moved to zero and scaled to the size of 1, as the program's own mesh has it;
/// in random order. `None`: there is none.
///
/// # Errors
/// As [`Mesh::try_from`].
pub fn mesh_of(scene: &Scene, seed: u64) -> Result<Option<Mesh>> {
    let Some((low, high)) = scene.bounds() else { return Ok(None) };
    let (low, high) = (low.as_dvec3(), high.as_dvec3());
    let (center, half) = ((low + high) / 2.0, (high - low).max_element() / 2.0);
    if !(half > 0.0 && half.is_finite()) {
        return Ok(None);
    }
    let mut mesh = Mesh::try_from(scene)?;
    mesh.triangles.retain(|corners| corners.iter().all(|&i| mesh.positions[i as usize].is_finite()));
    let mesh = mesh.mapped(|p| ((p.as_dvec3() - center) / half).as_vec3()).shuffled(&mut Random::new(seed));
    Ok((!mesh.triangles.is_empty()).then_some(mesh))
}

fn scale(mesh: MakeMesh, factor: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = mesh(random);
    from_inside(mesh, Vec3::ZERO, Vec3::ONE, rays, random).scaled(factor)
}

fn offset(mesh: MakeMesh, distance: f32, random: &mut Random, rays: usize) -> Case {
    let center = random.direction() * distance;
    let mesh = mesh(random).mapped(|p| p + center);
    from_inside(mesh, center, Vec3::ONE, rays, random)
}

fn distance(mesh: MakeMesh, distance: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = mesh(random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        StressRay::to(random.direction() * distance, mesh.random_inside(random))
    })
}

/// Rays to the insides of triangles, in any direction along their planes and so far off them.
fn grazing(mesh: MakeMesh, angle: f32, random: &mut Random, rays: usize) -> Case {
    let mesh = mesh(random);
    Case::new(mesh, rays, random, |mesh, random, _| {
        let triangle = random.below(mesh.triangles.len());
        let corners = mesh.corners(triangle);
        let target = inside_of(corners, random);
        let [p0, p1, p2] = corners.map(|p| p.as_dvec3());
        // In doubles: of a needle float32 may not know the plane.
        let normal = (p1 - p0).cross(p2 - p0).normalize_or(DVec3::Z);
        let (right, up) = normal.any_orthonormal_pair();
        let (sine, cosine) = (std::f64::consts::TAU * f64::from(random.unit())).sin_cos();
        let along = right * cosine + up * sine;
        let direction = (along * -2.0 + normal * (2.0 * f64::from(angle))).as_vec3();
        StressRay::to(target + direction, target)
    })
}

fn aspect(mesh: MakeMesh, ratio: f32, random: &mut Random, rays: usize) -> Case {
    let size = Vec3::new(1.0, 1.0 / ratio, 1.0 / ratio);
    let mesh = mesh(random).mapped(|p| p * size);
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
    use crate::stress::{Answers, Found};
    use raybrook::low_level::options::TraceOptions;

    #[test]
    fn exact_hits_are_right_at_every_number_and_rays_hit() {
        for sweep in Sweep::ALL {
            for &value in [sweep.values[0], *sweep.values.last().unwrap()].iter() {
                let case = sweep.case(None, value, 7, 60);
                let answers = Answers::new(&case);
                let found = Found::new(&case, &TraceOptions::DEFAULT, None, None).unwrap();
                let faults = found.faults(&answers, true);
                assert!(faults.is_empty(), "{} {value}: {faults:?}", sweep.name);
                let hits = found.hits.iter().filter(|hit| raybrook::low_level::tracer::is_hit(hit)).count();
                assert!(hits > 20, "{} {value}: {hits} hits", sweep.name);
            }
        }
    }
    #[test]
    fn the_users_mesh_takes_the_place_of_the_programs_own() {
        let tetrahedron = Mesh::sphere(0).mapped(|p| p * 1e-3 + Vec3::splat(7.0));
        let mesh = mesh_of(&tetrahedron.scene(), 1).unwrap().unwrap();
        let corners = || mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]);
        assert!(corners().all(|p| p.abs().max_element() < 1.001) && corners().any(|p| p.x > 0.999));
        for sweep in Sweep::ALL.iter().filter(|sweep| sweep.is_of_any_mesh()) {
            let case = sweep.case(Some(&mesh), sweep.values[0], 7, 20);
            assert_eq!(case.mesh.triangles.len(), tetrahedron.triangles.len(), "{}", sweep.name);
            assert_ne!(sweep.case(None, sweep.values[0], 7, 20).mesh.triangles.len(), case.mesh.triangles.len());
        }
        assert_eq!(mesh_of(&Scene::default(), 1).unwrap(), None);
    }
}
