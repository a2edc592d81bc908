//! The scenes of studies that are given none, made in code; without lights, as models are.

use crate::stress::Mesh;
use glam::{DAffine3, DVec3, Vec2, Vec3};
use raybrook::Result;
use raybrook::low_level::random::Random;
use raybrook::low_level::scene::{Builder, Camera, Material, Normals, Pattern, Procedural, Scene, TextureSpace};

/// A closed boulder of 8 * 4^`levels` triangles: a sphere with 40 smooth bumps and dents, the same ones at every level.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for more triangles than a scene holds.
pub fn boulder(levels: u32) -> Result<Scene> {
    let mut builder = Builder::new();
    add_mesh(&mut builder, &boulder_mesh(levels));
    builder.finish()
}

fn boulder_mesh(levels: u32) -> Mesh {
    const BUMPS: usize = 40;
    let mut random = Random::new(2008);
    let bumps: Vec<_> =
        (0..BUMPS).map(|_| (random.direction(), 0.3 + 0.5 * random.unit(), 0.35 * random.signed())).collect();
    Mesh::sphere(levels).mapped(|p| {
        // (1 - d^2)^2 within the radius of a bump: smooth, and the same floats everywhere.
        let height: f32 = bumps
            .iter()
            .map(|&(center, radius, height)| {
                let inside = (1.0 - (p - center).length_squared() / (radius * radius)).max(0.0);
                height * inside * inside
            })
            .sum();
        p * (1.0 + height)
    })
}

/// A hall of `rows` x `rows` leaning columns of long thin triangles, floor and ceiling: 96 `rows`² + 4 triangles, about
/// 50 times as long as wide. Its camera stands in it.
///
/// # Errors
/// None for `rows` up to 500.
pub fn hall(rows: u32) -> Result<Scene> {
    const HEIGHT: f32 = 4.0;
    const SEGMENTS: u32 = 24;
    let mut builder = Builder::new();
    let side = rows as f32;
    for x in 0..rows {
        for z in 0..rows {
            let lean = Vec3::new((x % 3) as f32 - 1.0, 0.0, (z % 5) as f32 - 2.0);
            builder.push().translate(Vec3::new(x as f32, 0.0, z as f32)).rotate(lean + Vec3::X * 0.5, 6.0);
            builder.cylinder(0.15, HEIGHT, SEGMENTS).pop();
        }
    }
    for y in [0.0, HEIGHT] {
        builder.quad(Vec3::new(-1.0, y, side), Vec3::X * (side + 1.0), Vec3::NEG_Z * (side + 1.0), 1);
    }
    let (eye, target) = (Vec3::new(side / 2.0 - 0.5, 1.7, side - 0.5), Vec3::new(0.3, 1.4, 0.0));
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 60.0 });
    builder.finish()
}

/// `count` cubes in rows of six, 12 triangles each, seen from above, with nothing else.
///
/// # Errors
/// None for any number that fits into memory.
pub fn cubes(count: u32) -> Result<Scene> {
    let mut builder = Builder::new();
    add_cubes(&mut builder, count);
    builder.camera(Camera {
        eye: Vec3::new(2.5, 8.0, 9.0),
        target: Vec3::new(2.5, 0.0, 1.5),
        up: Vec3::Y,
        fov_degrees: 40.0,
    });
    builder.finish()
}

fn add_cubes(builder: &mut Builder, count: u32) {
    for i in 0..count {
        builder.push().translate(Vec3::new((i % 6) as f32, 0.0, (i / 6) as f32));
        builder.rotate(Vec3::Y, 7.0 * i as f32).cuboid(Vec3::splat(0.7)).pop();
    }
}

/// About 700 triangles: a boulder of 512 or 17 cubes, and with `has_plane` a plane of 2 triangles that is 1,000 times
/// as large (the thesis's two scenes with and without one, section 5.5.2).
///
/// # Errors
/// None that a caller could cause.
pub fn on_plane(is_boulder: bool, has_plane: bool) -> Result<Scene> {
    const PLANE: f32 = 1000.0;
    let mut builder = Builder::new();
    let (center, floor) = match is_boulder {
        true => {
            add_mesh(&mut builder, &boulder_mesh(3));
            builder.push().translate(Vec3::new(2.5, 0.0, 0.0)).sphere(0.8, 14).pop();
            (Vec3::new(1.2, 0.0, 0.0), -1.3)
        }
        false => {
            add_cubes(&mut builder, 58);
            (Vec3::new(2.5, 0.0, 4.0), -0.5)
        }
    };
    if has_plane {
        builder.quad(Vec3::new(-PLANE, floor, PLANE), Vec3::X * 2.0 * PLANE, Vec3::NEG_Z * 2.0 * PLANE, 1);
    }
    let eye = center + Vec3::new(2.0, 6.0, 9.0);
    builder.camera(Camera { eye, target: center, up: Vec3::Y, fov_degrees: 45.0 });
    builder.finish()
}

/// A closed boulder of mirrors of 2,048 triangles that face inwards, where the camera is: paths in it have no end.
///
/// # Errors
/// None that a caller could cause.
pub fn mirror_room() -> Result<Scene> {
    let mut builder = Builder::new();
    builder.material(Material { mirror: Vec3::ONE, ..Material::matt(Vec3::ZERO) });
    add_mesh(&mut builder, &boulder_mesh(4).turned_around());
    let (eye, target) = (Vec3::new(0.1, 0.2, 0.3), Vec3::new(-1.0, 0.3, -0.2));
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 90.0 });
    builder.finish()
}

/// A still life for pictures: a boulder, a mirror ball of `detail` segments around and a floor, plain or of marble and
/// wood.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) when the ball cannot have so many segments.
pub fn still_life(detail: u32, is_textured: bool) -> Result<Scene> {
    let mut builder = Builder::new();
    let matt = |builder: &mut Builder, diffuse: Vec3, pattern: Pattern| {
        let texture = is_textured.then(|| builder.add_texture(procedural(pattern)));
        Material { diffuse_texture: texture, ..Material::matt(if is_textured { Vec3::ONE } else { diffuse }) }
    };
    let boulder = Material {
        specular: Vec3::splat(0.3),
        shininess: 40.0,
        ..matt(&mut builder, Vec3::new(0.7, 0.3, 0.2), Pattern::Marble)
    };
    let floor = matt(&mut builder, Vec3::new(0.5, 0.6, 0.5), Pattern::Wood);
    builder.material(boulder);
    builder.push().translate(Vec3::new(-1.3, 0.0, 0.0));
    add_mesh(&mut builder, &boulder_mesh(4));
    builder.pop();
    builder.material(Material { mirror: Vec3::splat(0.8), ..Material::matt(Vec3::splat(0.05)) });
    builder.push().translate(Vec3::new(1.2, 0.0, 0.6)).sphere(1.0, detail).pop();
    builder.material(floor);
    builder.quad(Vec3::new(-6.0, -1.3, 6.0), Vec3::X * 12.0, Vec3::NEG_Z * 12.0, 4);
    let (eye, target) = (Vec3::new(0.5, 2.2, 6.0), Vec3::ZERO);
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 40.0 });
    builder.finish()
}

/// The same with a ball of glass in place of the mirror.
///
/// # Errors
/// As [`still_life`].
pub fn glass_still_life(detail: u32) -> Result<Scene> {
    let mut scene = still_life(detail, false)?;
    for material in scene.materials.iter_mut().filter(|material| material.mirror != Vec3::ZERO) {
        *material = Material { mirror: Vec3::ZERO, transmission: Vec3::splat(0.9), ior: 1.5, ..material.clone() };
    }
    Ok(scene)
}

/// Mirror balls and glass balls of `detail` segments around by turns, on a glossy floor before a mirror: chains of rays
/// end late, and many branch.
///
/// # Errors
/// As [`still_life`].
pub fn mirrors_and_glass(detail: u32) -> Result<Scene> {
    let mut builder = Builder::new();
    let mirror = Material { mirror: Vec3::splat(0.8), ..Material::matt(Vec3::splat(0.05)) };
    let glass = Material { transmission: Vec3::splat(0.9), ior: 1.5, ..Material::matt(Vec3::ZERO) };
    for (i, x) in (-2..=2).enumerate() {
        builder.material(if i % 2 == 0 { mirror.clone() } else { glass.clone() });
        builder.push().translate(Vec3::new(1.7 * x as f32, 0.0, 0.6 * (i % 3) as f32)).sphere(0.8, detail).pop();
    }
    builder.material(Material { mirror: Vec3::splat(0.7), ..Material::matt(Vec3::new(0.05, 0.06, 0.08)) });
    builder.quad(Vec3::new(-6.0, -0.8, -2.5), Vec3::X * 12.0, Vec3::Y * 4.0, 1);
    builder.material(Material { mirror: Vec3::splat(0.2), ..Material::matt(Vec3::new(0.5, 0.45, 0.4)) });
    builder.quad(Vec3::new(-6.0, -0.8, 6.0), Vec3::X * 12.0, Vec3::NEG_Z * 8.5, 1);
    let (eye, target) = (Vec3::new(0.6, 2.4, 7.5), Vec3::new(0.0, 0.2, 0.0));
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 42.0 });
    builder.finish()
}

/// `count` boulders of 8 * 4^`levels` triangles as instances of one on a floor, turned and between 0.5 and 1.2 of its
/// size.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for more triangles than a scene holds.
pub fn boulder_field(levels: u32, count: u32) -> Result<Scene> {
    let mut random = Random::new(1980);
    let mut builder = Builder::new();
    let side = (f64::from(count).sqrt().ceil() as u32).max(1);
    let width = 2.2 * side as f32;
    builder.material(Material::matt(Vec3::new(0.4, 0.45, 0.35)));
    builder.quad(Vec3::new(-width, -0.9, width), Vec3::X * 2.0 * width, Vec3::NEG_Z * 2.0 * width, 1);
    let stones = [[0.7, 0.6, 0.5], [0.5, 0.5, 0.55], [0.65, 0.4, 0.3]].map(Vec3::from);
    let stones = stones.map(|colour| builder.add_material(Material::matt(colour)));
    builder.begin_object();
    add_mesh(&mut builder, &boulder_mesh(levels));
    let boulder = builder.end_object();
    for i in 0..count {
        let at = Vec3::new((i % side) as f32, 0.0, (i / side) as f32) - Vec3::new(0.5, 0.0, 0.5) * (side - 1) as f32;
        builder.push().translate(at * 2.2).rotate(random.direction(), 360.0 * random.unit());
        builder.scale(Vec3::splat(0.5 + 0.7 * random.unit()));
        builder.instance(boulder, Some(stones[i as usize % stones.len()])).pop();
    }
    let eye = Vec3::new(0.2, 0.35, 0.6) * 2.2 * side as f32 + Vec3::Y * 2.0;
    builder.camera(Camera { eye, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 });
    builder.finish()
}

/// A scene of most studies, as the page of a report shows it.
pub struct Own {
    /// What it is called.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Makes it, in a hurry of fewer triangles.
    make: fn(is_quick: bool) -> Result<Scene>,
    /// Whether it is measured in a hurry, too.
    is_quick: bool,
}

/// The scenes of most studies.
const OWN: [Own; 6] = [
    Own {
        name: "boulder",
        about: "A closed stone of small, even triangles: what scans and models are like.",
        make: |is_quick| boulder(if is_quick { 4 } else { 6 }),
        is_quick: true,
    },
    Own {
        name: "hall",
        about: "Leaning columns of long, thin triangles, seen from among them: what structures find hard.",
        make: |is_quick| hall(if is_quick { 4 } else { 18 }),
        is_quick: false,
    },
    Own {
        name: STILL_LIFE,
        about: "A boulder and a mirror ball on a floor: reflected and shadow rays.",
        make: |is_quick| still_life(detail(is_quick), false),
        is_quick: true,
    },
    Own {
        name: TEXTURED_STILL_LIFE,
        about: "The same with procedural textures.",
        make: |is_quick| still_life(detail(is_quick), true),
        is_quick: false,
    },
    Own {
        name: "still life with glass",
        about: "The same with a ball of glass: refracted rays, and chains that are longest.",
        make: |is_quick| glass_still_life(detail(is_quick)),
        is_quick: false,
    },
    Own {
        name: "100 boulders",
        about: "One boulder in a hundred places, turned and scaled: triangles shared by instances.",
        make: |is_quick| boulder_field(if is_quick { 2 } else { 4 }, 100),
        is_quick: false,
    },
];

/// The still life without textures.
pub const STILL_LIFE: &str = "still life";
/// The one of marble and wood.
pub const TEXTURED_STILL_LIFE: &str = "still life of marble and wood";

/// Segments around the still life's ball.
fn detail(is_quick: bool) -> u32 {
    if is_quick { 24 } else { 96 }
}

/// The scenes of most studies, in a hurry fewer.
pub fn own(is_quick: bool) -> impl Iterator<Item = &'static Own> {
    OWN.iter().filter(move |own| own.is_quick || !is_quick)
}

impl Own {
    /// The scene.
    ///
    /// # Errors
    /// None that a caller could cause.
    pub fn scene(&self, is_quick: bool) -> Result<Scene> {
        (self.make)(is_quick)
    }
}

/// The scene of this name.
///
/// # Panics
/// When there is none.
pub fn named(name: &str, is_quick: bool) -> Result<Scene> {
    OWN.iter().find(|own| own.name == name).expect("a scene of the list").scene(is_quick)
}

fn procedural(pattern: Pattern) -> Procedural {
    Procedural {
        pattern,
        colours: [Vec3::new(0.8, 0.75, 0.7), Vec3::new(0.3, 0.2, 0.15)],
        transform: DAffine3::from_scale(DVec3::splat(0.5)),
        space: TextureSpace::World,
        turbulence: 0.8,
        octaves: 6,
        seed: 1,
    }
}

fn add_mesh(builder: &mut Builder, mesh: &Mesh) {
    builder.mesh(&mesh.positions, Normals::Flat, &[] as &[Vec2], &mesh.triangles);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_as_many_triangles_as_they_say() {
        let count = |scene: Result<Scene>| scene.unwrap().hittable().len();
        assert_eq!([boulder(0), boulder(3), cubes(5), hall(3)].map(count), [8, 512, 60, 868]);
        assert_eq!(count(boulder_field(2, 10)), 10 * 128 + 2);
        for is_boulder in [false, true] {
            let [without, with] = [false, true].map(|has_plane| count(on_plane(is_boulder, has_plane)));
            assert!((600..800).contains(&without) && with == without + 2, "{without}, {with}");
        }
    }
}
