//! What tells scenes apart: a hash of everything that pictures of a scene depend on, and one of what hits depend on.

use super::{Instance, NO_INDEX, Object, Scene, Texture, Transform, Triangle};
use bytemuck::{Pod, cast_slice};
use glam::{Vec2, Vec3};
use sha2::{Digest, Sha256};

impl Scene {
    /// SHA-256, in hexadecimal, of what is in the scene: triangles, instances, materials, textures, lights, camera and
    /// background. Names of files, warnings and what is said of the picture are left out, so that a scene that is moved
    /// to another folder or machine remains the same.
    pub fn digest(&self) -> String {
        // Whoever adds a field decides about it here.
        #[rustfmt::skip]
        let Scene {
            positions, normals, uvs, triangles, instances, materials, textures, lights, sky, default_light, camera,
            wide_cameras, background, has_background, ambient, up: _, object_ends: _, camera_keys: _, picture: _,
            warnings: _, files: _,
        } = self;
        let mut hash = Hash(Sha256::new());
        hash.geometry((positions, normals, uvs), triangles);
        hash.number(instances.objects().len());
        for object in instances.objects() {
            let Object { positions, normals, uvs, triangles } = &**object;
            hash.geometry((positions, normals, uvs), triangles);
        }
        hash.list(instances.placed(), |Instance { object, transform, material }| {
            let Transform { rows, normal_rows, is_mirrored } = transform;
            let others = [*object, material.unwrap_or(NO_INDEX), u32::from(*is_mirrored)];
            let numbers = rows.as_flattened().iter().chain(normal_rows.as_flattened()).map(|x| x.to_bits());
            let mut all = [0u32; 24];
            all.iter_mut().zip(numbers.chain(others)).for_each(|(to, number)| *to = number);
            all
        });
        hash.text(materials);
        hash.number(textures.len());
        for texture in textures {
            match texture {
                Texture::Image(image) => {
                    hash.text(&(image.width, image.height));
                    hash.bytes(image.rgba.as_flattened());
                }
                Texture::Procedural(procedural) => hash.text(procedural),
            }
        }
        hash.text(&(lights, camera, background, ambient));
        // Only where pictures depend on them: scenes with nothing but lights keep the digest that they had.
        if lights.is_empty() || sky.is_some() {
            hash.text(&(sky, default_light, has_background));
        }
        if !wide_cameras.is_empty() {
            hash.text(wide_cameras);
        }
        hash.in_hexadecimal()
    }

    /// SHA-256, in hexadecimal, of what rays and points meet: the corners of all triangles by their numbers, and where
    /// instances stand. Hits depend on nothing else: traversal reads no shading data, and whatever a surface looks
    /// like, be it glass, it is hit.
    pub fn geometry_digest(&self) -> String {
        // Whoever adds a field decides about it here.
        #[rustfmt::skip]
        let Scene {
            positions, triangles, instances, normals: _, uvs: _, materials: _, textures: _, lights: _, sky: _,
            default_light: _, camera: _, wide_cameras: _, background: _, has_background: _, ambient: _, up: _,
            object_ends: _, camera_keys: _, picture: _, warnings: _, files: _,
        } = self;
        let mut hash = Hash(Sha256::new());
        hash.corners(positions, triangles);
        hash.number(instances.objects().len());
        for object in instances.objects() {
            let Object { positions, triangles, normals: _, uvs: _ } = &**object;
            hash.corners(positions, triangles);
        }
        hash.list(instances.placed(), |Instance { object, transform, material: _ }| {
            // The rows for normals follow from the others.
            let Transform { rows, normal_rows: _, is_mirrored } = transform;
            let mut all = [0u32; 14];
            let numbers = rows.as_flattened().iter().map(|x| x.to_bits());
            all.iter_mut().zip(numbers.chain([*object, u32::from(*is_mirrored)])).for_each(|(to, number)| *to = number);
            all
        });
        hash.in_hexadecimal()
    }
}

/// A hash of parts that cannot be taken for each other: each has its length before it.
struct Hash(Sha256);

impl Hash {
    fn in_hexadecimal(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn number(&mut self, number: usize) {
        self.0.update((number as u64).to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.number(bytes.len());
        self.0.update(bytes);
    }

    /// Everything that a few values are: numbers are written so that they can be read back to the bit.
    fn text(&mut self, value: &impl std::fmt::Debug) {
        self.bytes(format!("{value:?}").as_bytes());
    }

    fn geometry(&mut self, (positions, normals, uvs): (&[Vec3], &[Vec3], &[Vec2]), triangles: &[Triangle]) {
        self.list(positions, |p| p.to_array());
        self.list(normals, |n| n.to_array());
        self.list(uvs, |uv| uv.to_array());
        self.list(triangles, |t| [t.positions, t.normals, t.uvs, [t.material, 0, 0]]);
    }

    fn corners(&mut self, positions: &[Vec3], triangles: &[Triangle]) {
        self.list(positions, |p| p.to_array());
        self.list(triangles, |t| t.positions);
    }

    fn list<T, N: Pod>(&mut self, list: &[T], numbers_of: impl Fn(&T) -> N) {
        self.number(list.len());
        for chunk in list.chunks(1 << 12) {
            let numbers: Vec<N> = chunk.iter().map(&numbers_of).collect();
            self.0.update(cast_slice::<N, u8>(&numbers));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Background, DefaultLight, Image, Light, Material, Sky};
    use super::*;

    fn scene() -> Scene {
        let triangle = Triangle { positions: [0, 1, 2], normals: [0; 3], uvs: [0; 3], material: 0 };
        let object = Object {
            positions: vec![Vec3::X; 3],
            normals: vec![Vec3::Y],
            uvs: vec![Vec2::ONE],
            triangles: vec![triangle],
        };
        let mut scene = Scene {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z],
            uvs: vec![Vec2::ZERO],
            triangles: vec![triangle],
            materials: vec![Material::default()],
            textures: vec![Image { name: "a".into(), width: 1, height: 1, rgba: vec![[1, 2, 3, 4]] }.into()],
            ..Scene::default()
        };
        let object = scene.instances.add_object(object).unwrap();
        scene.instances.add(Instance { object, transform: Transform::IDENTITY, material: None }).unwrap();
        scene
    }

    fn changed(change: &fn(&mut Scene), digest: fn(&Scene) -> String) -> String {
        let mut scene = scene();
        change(&mut scene);
        digest(&scene)
    }

    #[test]
    fn what_is_hit_changes_the_digest_of_the_geometry_and_nothing_else_does() {
        let changes: [fn(&mut Scene); 7] = [
            |_| (),
            |scene| scene.positions[1].x = 1.0_f32.next_up(),
            |scene| scene.positions[0].x = -0.0,
            |scene| scene.triangles[0].positions = [1, 2, 0],
            |scene| scene.triangles.push(scene.triangles[0]),
            |scene| {
                let object = scene.instances.placed()[0];
                scene.instances.add(object).unwrap();
            },
            |scene| {
                let moved = Transform::new(glam::DAffine3::from_translation(glam::DVec3::X)).unwrap();
                scene.instances.set_transform(0, moved).unwrap();
            },
        ];
        let digest = |change: &fn(&mut Scene)| changed(change, Scene::geometry_digest);
        let mut all: Vec<String> = changes.iter().map(digest).collect();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), changes.len());
        let others: [fn(&mut Scene); 8] = [
            |scene| scene.normals[0] = Vec3::X,
            |scene| scene.triangles[0].material = 1,
            |scene| scene.materials[0].transmission = Vec3::ONE,
            |scene| scene.textures.clear(),
            |scene| scene.lights.push(Light::directional(Vec3::Y, Vec3::ONE)),
            |scene| scene.camera = None,
            |scene| scene.sky = Some(Sky::default()),
            |scene| scene.background = Background { bottom: Vec3::ZERO, ..Background::default() },
        ];
        for (number, change) in others.iter().enumerate() {
            assert_eq!(digest(change), scene().geometry_digest(), "change {number}");
        }
    }

    #[test]
    fn everything_that_shows_changes_the_digest() {
        let changes: [fn(&mut Scene); 15] = [
            |scene| scene.positions[1].x = 1.0_f32.next_up(),
            |scene| scene.positions[0].x = -0.0,
            |scene| scene.normals[0] = Vec3::X,
            |scene| scene.uvs[0] = Vec2::ONE,
            |scene| scene.triangles[0].positions = [1, 2, 0],
            |scene| scene.triangles[0].material = 1,
            |scene| scene.materials[0].shininess = 1e-30,
            |scene| {
                scene.textures[0] = Image { name: "a".into(), width: 1, height: 1, rgba: vec![[1, 2, 3, 5]] }.into()
            },
            |scene| scene.lights.push(Light::directional(Vec3::Y, Vec3::ONE)),
            |scene| scene.background = Background { bottom: Vec3::ZERO, ..Background::default() },
            |scene| scene.ambient = Vec3::splat(0.1),
            |scene| scene.sky = Some(Sky::default()),
            |scene| scene.default_light = DefaultLight::Plain,
            |scene| scene.has_background = true,
            |scene| {
                let object = scene.instances.placed()[0];
                scene.instances.add(object).unwrap();
            },
        ];
        let digest = |change: &fn(&mut Scene)| changed(change, Scene::digest);
        let mut all: Vec<String> = changes.iter().map(digest).collect();
        all.push(scene().digest());
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), changes.len() + 1);
        assert!(all.iter().all(|digest| digest.len() == 64));
    }

    #[test]
    fn where_a_scene_lies_does_not_change_the_digest() {
        let mut moved = scene();
        moved.warnings.push("a repair".into());
        moved.files.push(super::super::SourceFile { path: "elsewhere.obj".into(), role: "the scene".into() });
        moved.textures[0] = Image { name: "b".into(), width: 1, height: 1, rgba: vec![[1, 2, 3, 4]] }.into();
        assert_eq!(moved.digest(), scene().digest());
    }
}
