//! Whether a scene is the one that was measured: names and numbers of triangles stay when a model is edited.

use crc32fast::Hasher;
use glam::{Vec2, Vec3};
use raybrook::low_level::scene::{Scene, Texture, Triangle};
use std::fmt::{self, Debug, Write};

/// A checksum of all that a picture of the scene shows.
pub fn fingerprint(scene: &Scene) -> String {
    let Scene {
        positions, normals, uvs, triangles, materials, textures, lights, sky, camera, background, ambient, ..
    } = scene;
    let mut sum = Checksum(Hasher::new());
    sum.geometry(positions, normals, uvs, triangles);
    if !scene.instances.is_empty() {
        for object in scene.instances.objects() {
            sum.geometry(&object.positions, &object.normals, &object.uvs, &object.triangles);
        }
        sum.text(&scene.instances.placed());
    }
    for texture in textures {
        match texture {
            Texture::Image(image) => sum.0.update(image.rgba.as_flattened()),
            Texture::Procedural(pattern) => sum.text(pattern),
        }
    }
    sum.text(&(materials, lights, camera, background, ambient));
    if sky.is_some() {
        sum.text(sky);
    }
    // Numbers of elements, too: where one list ends and the next begins.
    sum.text(&[positions.len(), normals.len(), uvs.len(), triangles.len(), textures.len()]);
    format!("{:08x}", sum.0.finalize())
}

struct Checksum(Hasher);

impl Checksum {
    fn geometry(&mut self, positions: &[Vec3], normals: &[Vec3], uvs: &[Vec2], triangles: &[Triangle]) {
        for p in positions.iter().chain(normals) {
            self.words(p.to_array().map(f32::to_bits));
        }
        uvs.iter().for_each(|uv| self.words(uv.to_array().map(f32::to_bits)));
        for triangle in triangles {
            self.words(triangle.positions);
            self.words(triangle.normals);
            self.words(triangle.uvs);
            self.words([triangle.material]);
        }
    }

    fn words<const N: usize>(&mut self, words: [u32; N]) {
        words.iter().for_each(|word| self.0.update(&word.to_le_bytes()));
    }

    /// Floats are told by as many digits as tell them apart.
    fn text(&mut self, value: &dyn Debug) {
        write!(self, "{value:?}").expect("a checksum takes any text");
    }
}

impl Write for Checksum {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::scenes;

    #[test]
    fn a_change_of_anything_that_shows_is_another_scene() {
        let scene = scenes::still_life(8, true).unwrap();
        let same = fingerprint(&scene);
        assert_eq!(fingerprint(&scenes::still_life(8, true).unwrap()), same);
        let changes: [fn(&mut Scene); 6] = [
            |scene| scene.positions[7].x += 1e-6,
            |scene| scene.triangles[3].positions.swap(0, 1),
            |scene| scene.materials[0].shininess += 1.0,
            |scene| scene.camera.as_mut().unwrap().fov_degrees += 1.0,
            |scene| scene.ambient.x += 0.1,
            |scene| scene.textures.truncate(1),
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut other = scene.clone();
            change(&mut other);
            assert_ne!(fingerprint(&other), same, "change {i}");
        }
        let mut warned = scene;
        warned.warnings.push("told".to_owned());
        assert_eq!(fingerprint(&warned), same);
    }
}
