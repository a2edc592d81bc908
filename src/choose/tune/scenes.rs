//! Scenes of every size, made in code.

use crate::choose::SceneSize;
use crate::error::Result;
use crate::renderer::complete;
use crate::scene::{Builder, Camera, Scene};
use glam::Vec3;

/// A scene of this size: 38, 1,202, 99,202 or 990,002 triangles.
///
/// # Errors
/// None that a caller could cause.
pub fn scene_of(size: SceneSize) -> Result<Scene> {
    match size {
        SceneSize::Tiny => cubes(3),
        SceneSize::Small => balls(8),
        SceneSize::Medium => balls(64),
        SceneSize::Large => balls(200),
    }
}

/// 25 balls of `segments` around on a floor: 50 `segments` (`segments`/2 - 1) + 2 triangles. Shadow rays and diffuse
/// ones meet something, as a ball alone would not have it.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) when `segments` are more or less than [`Builder::sphere`] knows.
pub fn balls(segments: u32) -> Result<Scene> {
    const SIDE: u8 = 5;
    on_a_floor((0..SIDE).flat_map(|x| (0..SIDE).map(move |z| [x, z])), |builder| {
        builder.sphere(0.5, segments);
    })
}

/// `count` cubes on a floor, 25 at most: 12 `count` + 2 triangles.
///
/// # Errors
/// None that a caller could cause.
pub fn cubes(count: u8) -> Result<Scene> {
    // Those in the middle of the picture come first.
    const PLACES: [u8; 5] = [2, 1, 3, 0, 4];
    let places = PLACES.into_iter().flat_map(|z| PLACES.into_iter().map(move |x| [x, z]));
    on_a_floor(places.take(count.into()), |builder| {
        builder.cuboid(Vec3::splat(0.8));
    })
}

/// `solid` at each of `places` on a floor of 6 x 6, in the middle of a square picture.
fn on_a_floor(places: impl Iterator<Item = [u8; 2]>, mut solid: impl FnMut(&mut Builder)) -> Result<Scene> {
    let mut builder = Builder::new();
    for [x, z] in places {
        builder.push().translate(Vec3::new(x.into(), 0.5, z.into()));
        solid(&mut builder);
        builder.pop();
    }
    builder.quad(Vec3::new(-1.0, 0.0, 5.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 1);
    // Near enough that the floor fills most of the picture.
    let (eye, target) = (Vec3::new(3.5, 7.0, 7.0), Vec3::new(2.0, 0.3, 2.0));
    builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 40.0 });
    let mut scene = builder.finish()?;
    complete(&mut scene, 1.0);
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_as_many_triangles_as_they_say() {
        for segments in [4, 8, 20] {
            assert_eq!(balls(segments).unwrap().triangles.len() as u32, 50 * segments * (segments / 2 - 1) + 2);
        }
        for count in [0, 1, 3, 25] {
            assert_eq!(cubes(count).unwrap().hittable().len(), 12 * usize::from(count) + 2);
        }
        assert!(balls(1).is_err());
    }

    #[test]
    fn scenes_have_the_size_that_they_are_for() {
        for size in SceneSize::ALL.into_iter().filter(|&size| size < SceneSize::Large) {
            assert_eq!(SceneSize::of(scene_of(size).unwrap().hittable().len()), size);
        }
        assert_eq!([0, 99, 100, 300_000].map(SceneSize::of).map(SceneSize::name), ["tiny", "tiny", "small", "large"]);
    }
}
