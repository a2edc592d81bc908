//! Objects that stand in a scene many times: one copy of the geometry, many transforms.
//!
//! Where a vertex of an instance lies is defined by [`Transform::point`], in float32 and operation by operation, so
//! that whoever places it, the host beforehand ([`Scene::flattened`]) or a kernel when a ray comes near, gets the same
//! bits.

use super::{DropReason, MaterialId, NO_INDEX, Scene, Triangle};
use crate::error::{Error, Result};
use crate::shared::NO_PRIMITIVE;
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Number of an object in [`Instances`].
pub type ObjectId = u32;

/// A mesh in coordinates of its own.
#[derive(Debug, Clone, Default)]
pub struct Object {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals, as [`Scene::normals`].
    pub normals: Vec<Vec3>,
    /// Texture coordinates.
    pub uvs: Vec<Vec2>,
    /// The triangles; their indices are into the arrays above, their materials the scene's.
    pub triangles: Vec<Triangle>,
}

/// Takes object coordinates to world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Of each world coordinate the factors of x, y and z, and a summand.
    pub rows: [[f32; 4]; 3],
    /// The same for normals, without summands. Its length does not matter.
    pub normal_rows: [[f32; 3]; 3],
    /// Whether it mirrors: triangles are then turned, so that the outside stays outside.
    pub is_mirrored: bool,
}

impl Transform {
    /// Stays where it is.
    pub const IDENTITY: Transform = Transform {
        rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        normal_rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        is_mirrored: false,
    };

    /// `transform`, rounded to float32; `None` when that is not finite or flattens space.
    pub fn new(transform: DAffine3) -> Option<Transform> {
        let m = transform.matrix3;
        let row = |k: usize| {
            // Without a negative zero no coordinate becomes one.
            [m.x_axis[k], m.y_axis[k], m.z_axis[k], transform.translation[k]].map(|x| x as f32 + 0.0)
        };
        let rows = [row(0), row(1), row(2)];
        if !rows.as_flattened().iter().all(|x| x.is_finite()) {
            return None;
        }
        // Of what was rounded: normals stay upright on the triangles as they are.
        let [x, y, z] = linear_rows(&rows);
        let determinant = x.dot(y.cross(z));
        // Normals go with the inverse transpose. Its rows are those of the cofactors, but for the determinant.
        let cofactors = [y.cross(z), z.cross(x), x.cross(y)].map(|row| row * determinant.signum());
        let largest = cofactors.iter().fold(0.0f64, |largest, row| largest.max(row.abs().max_element()));
        if determinant == 0.0 || !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let normal_rows = cofactors.map(|row| (row / largest).as_vec3().to_array());
        Some(Transform { rows, normal_rows, is_mirrored: determinant < 0.0 })
    }

    /// Where a point of the object is in the world.
    #[inline(always)]
    pub fn point(&self, p: Vec3) -> Vec3 {
        Vec3::from_array(self.rows.map(|row| row_times_point(row, p)))
    }

    /// The direction of a normal in the world.
    #[inline(always)]
    pub fn normal(&self, n: Vec3) -> Vec3 {
        Vec3::from_array(self.normal_rows.map(|row| row_times_direction(row, n)))
    }

    /// The rows without the summands, in f64.
    pub(crate) fn linear(&self) -> [DVec3; 3] {
        linear_rows(&self.rows)
    }

    /// From the world back to the object, in f64: the factors, as a matrix of rows, and the summands. Not finite where
    /// `self` is singular.
    pub(crate) fn inverse(&self) -> ([DVec3; 3], DVec3) {
        let [x, y, z] = self.linear();
        let inverse = DMat3::from_cols(x, y, z).transpose().inverse();
        let rows = [0, 1, 2].map(|k| inverse.row(k));
        let offset = DVec3::from_array(self.rows.map(|row| f64::from(row[3])));
        (rows, -(inverse * offset))
    }
}

/// A row of a transform with a summand, applied to a point. Kernels have the same operations: `cl/shared/instances.cl`.
#[inline(always)]
pub(crate) fn row_times_point([x, y, z, w]: [f32; 4], p: Vec3) -> f32 {
    x.mul_add(p.x, y.mul_add(p.y, z.mul_add(p.z, w)))
}

/// A row without one, applied to a direction.
#[inline(always)]
pub(crate) fn row_times_direction([x, y, z]: [f32; 3], d: Vec3) -> f32 {
    x.mul_add(d.x, y.mul_add(d.y, z * d.z))
}

fn linear_rows(rows: &[[f32; 4]; 3]) -> [DVec3; 3] {
    rows.map(|[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()))
}

/// One object in one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// Which object.
    pub object: ObjectId,
    /// Where.
    pub transform: Transform,
    /// The material of all its triangles; `None`: those that the object's have.
    pub material: Option<MaterialId>,
}

/// The objects of a scene that stand in it any number of times. Their triangles are the primitives behind
/// [`Scene::triangles`], instance after instance.
#[derive(Debug, Clone, Default)]
pub struct Instances {
    objects: Vec<Arc<Object>>,
    /// Of each object its farthest finite coordinates.
    reaches: Vec<Vec3>,
    placed: Vec<Instance>,
    /// Of each instance how many triangles there are up to its end.
    ends: Vec<u32>,
}

impl Instances {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.placed.is_empty()
    }

    /// Adds an object, which is nowhere yet.
    ///
    /// # Errors
    /// [`Error::Scene`] when a triangle has an index beyond the end of its list.
    pub fn add_object(&mut self, object: Object) -> Result<ObjectId> {
        let Object { positions, normals, uvs, triangles } = &object;
        let is_in = |indices: [u32; 3], list: usize| indices.iter().all(|&i| (i as usize) < list);
        let is_in_or_none =
            |indices: [u32; 3], list: usize| indices.iter().all(|&i| i == NO_INDEX || (i as usize) < list);
        let is_whole = |t: &Triangle| {
            is_in(t.positions, positions.len())
                && is_in_or_none(t.normals, normals.len())
                && is_in_or_none(t.uvs, uvs.len())
        };
        if let Some(i) = triangles.iter().position(|triangle| !is_whole(triangle)) {
            return Err(Error::Scene(format!("object: triangle {i} has an index beyond the end of its list")));
        }
        let finite = positions.iter().filter(|p| p.is_finite());
        self.reaches.push(finite.fold(Vec3::ZERO, |farthest, p| farthest.max(p.abs())));
        self.objects.push(Arc::new(object));
        Ok((self.objects.len() - 1) as ObjectId)
    }

    /// Puts an object somewhere.
    ///
    /// # Errors
    /// [`Error::Scene`] when there is no such object, when it would reach out of float32's range, or when there are
    /// more triangles than 32 bits can number.
    pub fn add(&mut self, instance: Instance) -> Result<()> {
        let Some(object) = self.objects.get(instance.object as usize) else {
            return Err(Error::Scene(format!("instance: there is no object number {}", instance.object)));
        };
        self.check_reach(instance.object, &instance.transform)?;
        let end = self.ends.last().map_or(0, |&end| u64::from(end)) + object.triangles.len() as u64;
        let end = u32::try_from(end).ok().filter(|&end| end < NO_PRIMITIVE);
        let message = "the instances have more triangles than 32-bit numbers can tell apart";
        self.ends.push(end.ok_or_else(|| Error::Scene(message.into()))?);
        self.placed.push(instance);
        Ok(())
    }

    /// Moves the instance of this number, from 0 in the order of their primitives.
    ///
    /// # Errors
    /// [`Error::Scene`] when there is no such instance, or when it would reach out of float32's range.
    pub fn set_transform(&mut self, instance: usize, transform: Transform) -> Result<()> {
        let Some(object) = self.placed.get(instance).map(|placed| placed.object) else {
            return Err(Error::Scene(format!("instance: there is no instance number {instance}")));
        };
        self.check_reach(object, &transform)?;
        self.placed[instance].transform = transform;
        Ok(())
    }

    fn check_reach(&self, object: ObjectId, transform: &Transform) -> Result<()> {
        let farthest = self.reaches[object as usize].as_dvec3();
        let reach =
            |[x, y, z, w]: [f32; 4]| DVec3::new(x.into(), y.into(), z.into()).abs().dot(farthest) + f64::from(w.abs());
        if transform.rows.into_iter().any(|row| reach(row) > f64::from(f32::MAX) / 2.0) {
            return Err(Error::Scene("the transform moves an instance out of float32's range".into()));
        }
        Ok(())
    }

    /// The objects, by their numbers.
    pub fn objects(&self) -> &[Arc<Object>] {
        &self.objects
    }

    /// The instances, in the order of their primitives.
    pub fn placed(&self) -> &[Instance] {
        &self.placed
    }

    /// Triangles of all instances.
    pub fn triangle_count(&self) -> usize {
        self.ends.last().map_or(0, |&end| end as usize)
    }

    /// Triangles of all objects that stand somewhere, each counted once.
    pub fn shared_triangle_count(&self) -> usize {
        let mut is_placed = vec![false; self.objects.len()];
        self.placed.iter().for_each(|instance| is_placed[instance.object as usize] = true);
        self.objects.iter().zip(is_placed).filter(|(_, placed)| *placed).map(|(object, _)| object.triangles.len()).sum()
    }

    /// The triangles of instance `index`, counted from the first one of all instances.
    pub fn range(&self, index: usize) -> Range<u32> {
        let first = if index == 0 { 0 } else { self.ends[index - 1] };
        first..self.ends[index]
    }

    /// The triangles of instance `index` that can be hit, each with its number among those of all instances and its
    /// vertices, world units.
    pub(crate) fn hittable(&self, index: usize) -> impl Iterator<Item = (u32, [Vec3; 3])> + '_ {
        let instance = &self.placed[index];
        let (transform, object) = (instance.transform, &self.objects[instance.object as usize]);
        self.range(index).zip(&object.triangles).filter_map(move |(number, triangle)| {
            let place = |i: u32| transform.point(object.positions[i as usize]);
            let vertices = turned(triangle.positions, transform.is_mirrored).map(place);
            DropReason::of(vertices).is_none().then_some((number, vertices))
        })
    }

    /// The vertices of triangle number `triangle` of all instances, world units.
    pub fn vertices(&self, triangle: usize) -> [Vec3; 3] {
        let index = self.ends.partition_point(|&end| end as usize <= triangle);
        let Instance { object, transform, .. } = &self.placed[index];
        let object = &self.objects[*object as usize];
        let place = |i: u32| transform.point(object.positions[i as usize]);
        turned(object.triangles[triangle - self.range(index).start as usize].positions, transform.is_mirrored)
            .map(place)
    }
}

/// The corners of a triangle, two of them exchanged where that is mirrored.
pub(crate) fn turned<T>([a, b, c]: [T; 3], is_mirrored: bool) -> [T; 3] {
    if is_mirrored { [a, c, b] } else { [a, b, c] }
}

impl Scene {
    /// The scene with every instance as triangles of its own, of the same numbers; itself when it has none.
    ///
    /// # Errors
    /// [`Error::Scene`] when there are more vertices or triangles than 32-bit indices can tell apart.
    pub fn flattened(&self) -> Result<Cow<'_, Scene>> {
        if self.instances.is_empty() {
            return Ok(Cow::Borrowed(self));
        }
        let instances = &self.instances;
        let total = |count: fn(&Object) -> usize| -> usize {
            instances.placed.iter().map(|instance| count(&instances.objects[instance.object as usize])).sum()
        };
        let positions = self.positions.len() + total(|object| object.positions.len());
        let normals = self.normals.len() + total(|object| object.normals.len());
        let triangles = self.triangle_count();
        if [positions, normals, triangles].into_iter().any(|count| count >= NO_INDEX as usize) {
            let reason =
                "its instances have more vertices than 32-bit indices can tell apart; take `structure = instances`";
            return Err(Error::Scene(reason.into()));
        }
        let mut flat = Scene { instances: Instances::default(), ..self.clone() };
        flat.positions.reserve_exact(positions - self.positions.len());
        flat.normals.reserve_exact(normals - self.normals.len());
        flat.triangles.reserve_exact(triangles - self.triangles.len());
        // Texture coordinates stay as they are: one copy serves all instances.
        let mut uvs = Vec::new();
        for object in &instances.objects {
            uvs.push(flat.uvs.len());
            flat.uvs.extend_from_slice(&object.uvs);
        }
        for Instance { object: id, transform, material } in &instances.placed {
            let object = &instances.objects[*id as usize];
            let first = [flat.positions.len(), flat.normals.len(), uvs[*id as usize]];
            flat.positions.extend(object.positions.iter().map(|&p| transform.point(p)));
            flat.normals.extend(object.normals.iter().map(|&n| transform.normal(n)));
            let moved = |corners: [u32; 3], first: usize| {
                turned(corners.map(|i| if i == NO_INDEX { i } else { i + first as u32 }), transform.is_mirrored)
            };
            flat.triangles.extend(object.triangles.iter().map(|triangle| Triangle {
                positions: moved(triangle.positions, first[0]),
                normals: moved(triangle.normals, first[1]),
                uvs: moved(triangle.uvs, first[2]),
                material: material.unwrap_or(triangle.material),
            }));
        }
        Ok(Cow::Owned(flat))
    }

    /// Bytes that [`Scene::flattened`] takes.
    pub(crate) fn flattened_bytes(&self) -> u64 {
        if self.instances.is_empty() {
            return 0;
        }
        let bytes = |positions: usize, normals: usize, uvs: usize, triangles: usize| {
            (size_of::<Vec3>() * (positions + normals) + size_of::<Vec2>() * uvs + size_of::<Triangle>() * triangles)
                as u64
        };
        let own = bytes(self.positions.len(), self.normals.len(), self.uvs.len(), self.triangles.len());
        let of_object =
            |object: &Object| bytes(object.positions.len(), object.normals.len(), 0, object.triangles.len());
        let of_uvs = |object: &Arc<Object>| bytes(0, 0, object.uvs.len(), 0);
        let placed = self.instances.placed.iter().map(|i| of_object(&self.instances.objects[i.object as usize]));
        own + placed.sum::<u64>() + self.instances.objects.iter().map(of_uvs).sum::<u64>()
    }

    /// Triangles of the scene, those of its instances among them: primitives are numbered below this.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() + self.instances.triangle_count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Builder, Material};

    fn two_boxes() -> Scene {
        let mut builder = Builder::new();
        builder.sphere(0.5, 8);
        let object = builder.begin_object().cuboid(Vec3::ONE).end_object();
        builder.push().translate(Vec3::X * 3.0).rotate(Vec3::Y, 30.0).instance(object, None).pop();
        let red = builder.add_material(Material::matt(Vec3::X));
        builder.scale(Vec3::new(-2.0, 1.0, 1.0)).instance(object, Some(red));
        builder.finish().unwrap()
    }

    #[test]
    fn flattening_keeps_numbers_vertices_and_materials() {
        let scene = two_boxes();
        let flat = scene.flattened().unwrap();
        assert_eq!(flat.triangle_count(), scene.triangle_count());
        assert_eq!((flat.triangles.len(), scene.instances.triangle_count()), (scene.triangles.len() + 24, 24));
        assert_eq!(scene.instances.shared_triangle_count(), 12);
        for primitive in 0..scene.triangle_count() {
            assert_eq!(scene.vertices(primitive), flat.vertices(primitive), "{primitive}");
        }
        assert_eq!((scene.bounds(), scene.hittable()), (flat.bounds(), flat.hittable()));
        assert_eq!(scene.used_materials(), flat.used_materials());
        assert!(flat.flattened().unwrap().instances.is_empty());
    }

    /// The outside of a mirrored box is outside: its volume, by the divergence theorem, is positive.
    #[test]
    fn mirrored_instances_are_turned() {
        let scene = two_boxes();
        for (index, volume) in [(0, 1.0), (1, 2.0)] {
            let range = scene.instances.range(index);
            let signed: f32 =
                range.map(|i| scene.instances.vertices(i as usize)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
            assert!((signed - volume).abs() < 1e-5, "instance {index}: {signed}");
        }
    }

    #[test]
    fn normals_stay_upright_and_transforms_that_flatten_are_refused() {
        let transform = DAffine3::from_scale(DVec3::new(1.0, 4.0, -0.5)) * DAffine3::from_rotation_y(0.7);
        let placed = Transform::new(transform).unwrap();
        assert!(placed.is_mirrored);
        let (tangent, normal) = (Vec3::new(1.0, 2.0, 0.5), Vec3::new(2.0, -1.25, 1.0));
        assert!(tangent.dot(normal).abs() < 1e-6);
        assert!((placed.point(tangent) - placed.point(Vec3::ZERO)).dot(placed.normal(normal)).abs() < 1e-6);
        let (rows, offset) = placed.inverse();
        let back = DVec3::from_array(rows.map(|row| row.dot(placed.point(tangent).as_dvec3()))) + offset;
        assert!((back - tangent.as_dvec3()).length() < 1e-5);
        for singular in [DVec3::new(1.0, 0.0, 1.0), DVec3::splat(1e60), DVec3::NAN] {
            assert_eq!(Transform::new(DAffine3::from_scale(singular)), None, "{singular}");
        }
    }

    #[test]
    fn what_cannot_be_placed_is_told() {
        let mut instances = Instances::default();
        let place = |object| Instance { object, transform: Transform::IDENTITY, material: None };
        assert!(instances.add(place(0)).unwrap_err().to_string().contains("no object number 0"));
        let positions = vec![Vec3::splat(3e38), Vec3::ZERO, Vec3::X];
        let id = instances.add_object(Object { positions, ..Object::default() }).unwrap();
        assert!(instances.add(place(id)).unwrap_err().to_string().contains("float32's range"));
        assert!(instances.is_empty());
        let triangles =
            vec![Triangle { positions: [0, 1, 2], normals: [NO_INDEX; 3], uvs: [NO_INDEX; 3], material: 0 }];
        for positions in [vec![Vec3::ZERO; 2], vec![]] {
            let object = Object { positions, triangles: triangles.clone(), ..Object::default() };
            assert!(instances.add_object(object).unwrap_err().to_string().contains("triangle 0 has an index"));
        }
        let mut scene = two_boxes();
        scene.materials.truncate(1);
        assert!(scene.check_values().unwrap_err().to_string().contains("no material number"));
    }
}
