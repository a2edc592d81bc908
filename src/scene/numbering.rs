//! Which object, instance and material a primitive is of, by their numbers in the scene.

use super::{MaterialId, NO_INDEX, ObjectId, Scene};

/// Where an object of a scene file ends: what there is of its scene up to there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ObjectEnd {
    /// Triangles of the scene's own.
    pub triangles: u32,
    /// Objects of its instances.
    pub shared: ObjectId,
}

/// The numbers of a scene's parts, for what outlives the scene.
#[derive(Debug, Clone, Default)]
pub struct Numbering {
    /// Triangles of the scene's own.
    triangles: u32,
    object_ends: Vec<ObjectEnd>,
    /// Of each instance where its primitives end, and its object.
    instances: Vec<(u32, ObjectId)>,
    /// The materials that triangles have.
    used: Vec<MaterialId>,
}

impl Numbering {
    /// The number of what is not there.
    pub const NONE: u32 = NO_INDEX;

    /// The numbers of `scene`, and of its packed materials: [`Scene::used_materials`].
    pub fn of(scene: &Scene, used: &[MaterialId]) -> Numbering {
        let triangles = scene.triangles.len() as u32;
        let placed = scene.instances.placed().iter().enumerate();
        let instances =
            placed.map(|(i, instance)| (triangles + scene.instances.range(i).end, instance.object)).collect();
        Numbering { triangles, object_ends: scene.object_ends.clone(), instances, used: used.to_vec() }
    }

    /// The instance of a primitive, from 0 in the order of [`Instances::placed`](super::Instances::placed);
    /// [`Numbering::NONE`] for a triangle of the scene's own.
    pub fn instance(&self, primitive: u32) -> u32 {
        match primitive < self.triangles {
            true => Self::NONE,
            false => self.instances.partition_point(|(end, _)| *end <= primitive) as u32,
        }
    }

    /// The object of a primitive: of a scene file the number of its `[[object]]`, from 0; else 0 for all triangles of
    /// the scene's own, and for instances the number of their object behind that.
    pub fn object(&self, primitive: u32) -> u32 {
        let is_own = primitive < self.triangles;
        let shared = || self.instances.get(self.instance(primitive) as usize).map_or(0, |(_, object)| *object);
        let ends = &self.object_ends;
        match (is_own, ends.is_empty()) {
            (true, true) => 0,
            (false, true) => shared() + u32::from(self.triangles > 0),
            (true, false) => ends.partition_point(|end| end.triangles <= primitive) as u32,
            (false, false) => {
                let object = shared();
                ends.partition_point(|end| end.shared <= object) as u32
            }
        }
    }

    /// The number in [`Scene::materials`] of what is material number `packed` of those that triangles have.
    pub fn material(&self, packed: u32) -> u32 {
        self.used.get(packed as usize).copied().unwrap_or(Self::NONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Builder, Material};
    use glam::Vec3;

    #[test]
    fn primitives_are_of_objects_in_the_order_in_which_they_were_added() {
        let mut builder = Builder::new();
        builder.add_material(Material::matt(Vec3::X)); // that nothing has
        builder.material(Material::matt(Vec3::Y));
        builder.cuboid(Vec3::ONE); // 12 triangles
        let cube = builder.begin_object().cuboid(Vec3::ONE).end_object();
        builder.instance(cube, None).translate(Vec3::X * 3.0).instance(cube, None);
        let quad = builder.begin_object().quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1).end_object();
        builder.instance(quad, None).instance(cube, None);
        let scene = builder.finish().unwrap();
        let numbering = Numbering::of(&scene, &scene.used_materials());
        let firsts = [0, 11, 12, 23, 24, 36, 37, 38, 49];
        let numbers = firsts.map(|primitive| (numbering.instance(primitive), numbering.object(primitive)));
        let none = Numbering::NONE;
        assert_eq!(numbers, [(none, 0), (none, 0), (0, 1), (0, 1), (1, 1), (2, 2), (2, 2), (3, 1), (3, 1)]);
        let used = scene.used_materials();
        assert!(used.len() < scene.materials.len(), "{used:?}");
        assert_eq!((numbering.material(0), numbering.material(used.len() as u32)), (used[0], none));
    }
}
