//! Builds scenes in memory in the manner of OpenGL: the current material and transform persist until they are changed
//! (thesis, section 6.2.1). The solids are in `solids.rs`.
//!
//! Transforms are kept in f64 and every vertex is rounded once, so that a stack of many transforms costs no accuracy.

use super::check::{none_of, value_faults};
use super::known::Numbers;
use super::mesh::{Corner, Counts, Mesh, rotation};
use super::{
    Background, Camera, CameraKey, DefaultLight, Instance, Light, LightKind, Material, MaterialId, NO_INDEX, Object,
    ObjectEnd, ObjectId, PictureDefaults, Scene, Sky, Texture, TextureId, Transform, Triangle, WideCamera,
};
use crate::budget::{DecidedBy, MemoryBudget, Need};
use crate::error::{Error, Result};
use glam::{Affine3A, DAffine3, DMat3, Vec2, Vec3};

/// How the vertices between [`Builder::begin`] and [`Builder::end`] make triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Primitive {
    /// Every three vertices are a triangle.
    Triangles,
    /// Every vertex from the third on makes a triangle with the two before it; every second one is turned, as in
    /// OpenGL.
    Strip,
    /// Every vertex from the third on makes a triangle with the first and the one before it: convex polygons.
    Fan,
}

/// The normals of a mesh.
#[derive(Debug, Clone, Copy)]
pub enum Normals<'a> {
    /// Every triangle is flat.
    Flat,
    /// Computed at each vertex from the triangles around it, weighted by their angles there.
    Smooth,
    /// One for each position, in object coordinates.
    Given(&'a [Vec3]),
}

/// Builds a [`Scene`].
///
/// The transform applies to geometry and lights that are added after it, the last one first as in OpenGL:
/// `translate` then `rotate` turns an object about its own origin and then moves it. Camera and background are in world
/// coordinates. What goes wrong is remembered, and the first faults are returned by [`Builder::finish`].
///
/// ```
/// use raybrook::glam::Vec3;
/// use raybrook::{Builder, Camera, Light, Material};
///
/// let mut builder = Builder::new();
/// builder.material(Material::matt(Vec3::new(0.8, 0.2, 0.1)));
/// for i in 0..3 {
///     builder.push().translate(Vec3::X * i as f32 * 2.5).sphere(1.0, 32).pop();
/// }
/// builder.light(Light::point(Vec3::new(0.0, 10.0, 5.0), Vec3::ONE));
/// let (eye, target) = (Vec3::new(2.5, 2.0, 9.0), Vec3::new(2.5, 0.0, 0.0));
/// builder.camera(Camera { eye, target, up: Vec3::Y, fov_degrees: 45.0 });
/// let scene = builder.finish()?;
/// assert_eq!(scene.triangles.len(), 3 * 2 * 32 * 15);
/// # Ok::<(), raybrook::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Builder {
    scene: Scene,
    known_materials: Numbers,
    known_textures: Numbers,
    material: Option<MaterialId>,
    transform: DAffine3,
    stack: Vec<DAffine3>,
    uv_scale: Option<Vec2>,
    pending: Option<Pending>,
    outside: Option<Outside>,
    faults: Vec<String>,
    budget: MemoryBudget,
    /// Bytes of meshes that were added since memory was looked at.
    unchecked_bytes: u64,
}

/// Memory is looked at when so many bytes were added: that takes the time of some thousand triangles.
const CHECK_EVERY_BYTES: u64 = 16 << 20;

/// What waits until an object is ended.
#[derive(Debug, Clone)]
struct Outside {
    transform: DAffine3,
    stack: Vec<DAffine3>,
    /// Lengths of the scene's positions, normals, texture coordinates and triangles before it.
    lengths: [usize; 4],
}

/// The vertices since `begin`.
#[derive(Debug, Clone)]
struct Pending {
    primitive: Primitive,
    mesh: Mesh,
    corners: Vec<Corner>,
    normal: u32,
    uv: u32,
}

impl Builder {
    /// An empty scene; material and transform are the default ones.
    pub fn new() -> Builder {
        Builder::default()
    }

    /// As [`Builder::new`], with this much memory instead of what there is: a solid that takes more is a fault.
    pub fn within(budget: MemoryBudget) -> Builder {
        Builder { budget, ..Builder::default() }
    }

    /// Remembers `fault` for [`Builder::finish`].
    pub(super) fn fail(&mut self, fault: impl Into<String>) -> &mut Self {
        self.faults.push(fault.into());
        self
    }

    /// Remembers what is wrong with the scene.
    fn fail_with(&mut self, error: Error) -> &mut Self {
        match error {
            Error::Scene(fault) => self.fail(fault),
            other => self.fail(other.to_string()),
        }
    }

    /// Takes back the first fault so far, for a caller that can tell where it comes from.
    pub(super) fn take_fault(&mut self) -> Option<String> {
        if self.faults.is_empty() { None } else { Some(self.faults.remove(0)) }
    }

    // ---- current material
    // --------------------------------------------------------------------------------------------

    /// Makes `material` the current one, and adds it unless the scene has an equal one.
    pub fn material(&mut self, material: Material) -> &mut Self {
        let id = self.add_material(material);
        self.use_material(id)
    }

    /// Adds `material` without making it the current one, unless the scene has an equal one, and tells its number.
    pub fn add_material(&mut self, material: Material) -> MaterialId {
        match self.known_materials.find(&self.scene.materials, &material) {
            Some(id) => id,
            None => self.push_material(material),
        }
    }

    /// As [`Builder::add_material`], for a caller that knows that the scene has no equal one: looking takes time with
    /// many.
    pub(super) fn push_material(&mut self, material: Material) -> MaterialId {
        self.scene.materials.push(material);
        (self.scene.materials.len() - 1) as MaterialId
    }

    /// Makes material number `id` the current one.
    pub fn use_material(&mut self, id: MaterialId) -> &mut Self {
        if id as usize >= self.scene.materials.len() {
            return self.fail(format!("use_material: there is no material number {id}"));
        }
        self.material = Some(id);
        self
    }

    /// Makes the default material, a matt grey, the current one again.
    pub fn reset_material(&mut self) -> &mut Self {
        self.material = None;
        self
    }

    /// Adds a texture for [`Material::diffuse_texture`], unless the scene has an equal one, and tells its number.
    pub fn add_texture(&mut self, texture: impl Into<Texture>) -> TextureId {
        let texture = texture.into();
        let textures = &mut self.scene.textures;
        self.known_textures.find(textures, &texture).unwrap_or_else(|| {
            textures.push(texture);
            (textures.len() - 1) as TextureId
        })
    }

    /// Multiplies the texture coordinates of everything that follows: 4 repeats a texture four times. Persists, and is
    /// not part of what [`Builder::push`] keeps.
    pub fn uv_scale(&mut self, scale: Vec2) -> &mut Self {
        if !scale.is_finite() {
            return self.fail(format!("uv_scale: {scale} is not finite"));
        }
        self.uv_scale = Some(scale);
        self
    }

    // ---- current transform
    // -------------------------------------------------------------------------------------------

    /// Keeps the current transform for [`Builder::pop`].
    pub fn push(&mut self) -> &mut Self {
        self.stack.push(self.transform);
        self
    }

    /// Takes back the transform of the last [`Builder::push`] without a `pop`; a fault when there is none.
    pub fn pop(&mut self) -> &mut Self {
        match self.stack.pop() {
            Some(transform) => self.transform = transform,
            None => self.faults.push("pop: more pops than pushes".into()),
        }
        self
    }

    /// Forgets the current transform: object coordinates are world coordinates again.
    pub fn reset_transform(&mut self) -> &mut Self {
        self.transform = DAffine3::IDENTITY;
        self
    }

    /// Multiplies the current transform by `transform`, which acts first on what follows; a fault when it is singular
    /// or not finite. A mirroring transform is fine: triangles are turned so that the outside stays outside.
    pub fn transform(&mut self, transform: Affine3A) -> &mut Self {
        self.multiply("transform", transform.as_daffine3())
    }

    /// Moves what follows by `offset`.
    pub fn translate(&mut self, offset: Vec3) -> &mut Self {
        self.multiply("translate", DAffine3::from_translation(offset.as_dvec3()))
    }

    /// Turns what follows about `axis` (any length but zero) through the origin, counter-clockwise seen against the
    /// axis.
    pub fn rotate(&mut self, axis: Vec3, degrees: f32) -> &mut Self {
        let Some(a) = axis.as_dvec3().try_normalize() else {
            return self.fail(format!("rotate: the axis {axis} has no direction"));
        };
        self.multiply("rotate", DAffine3::from_mat3(rotation(a, f64::from(degrees))))
    }

    /// Scales what follows along the coordinate axes; negative factors mirror, zero is a fault.
    pub fn scale(&mut self, factors: Vec3) -> &mut Self {
        self.multiply("scale", DAffine3::from_scale(factors.as_dvec3()))
    }

    /// The current transform, object to world.
    pub(super) fn current_transform(&self) -> DAffine3 {
        self.transform
    }

    /// As [`Builder::transform`], in f64; `caller` begins the message of a fault.
    pub(super) fn multiply(&mut self, caller: &str, transform: DAffine3) -> &mut Self {
        if !transform.is_finite() {
            return self.fail(format!("{caller}: a value is not finite"));
        }
        if transform.matrix3.determinant() == 0.0 {
            return self.fail(format!("{caller}: the transform flattens space"));
        }
        self.transform *= transform;
        self
    }

    // ---- geometry
    // ----------------------------------------------------------------------------------------------------

    /// Starts a list of vertices, to be closed by [`Builder::end`].
    pub fn begin(&mut self, primitive: Primitive) -> &mut Self {
        if self.pending.is_some() {
            return self.fail("begin: the last one was not ended");
        }
        self.pending =
            Some(Pending { primitive, mesh: Mesh::default(), corners: Vec::new(), normal: NO_INDEX, uv: NO_INDEX });
        self
    }

    /// Sets the normal of the vertices that follow, up to [`Builder::end`]; without one, or with a zero one, a vertex
    /// has the normal of its triangle.
    pub fn normal(&mut self, normal: Vec3) -> &mut Self {
        match &mut self.pending {
            Some(pending) => pending.normal = pending.mesh.add_normal(normal.as_dvec3()),
            None => self.faults.push("normal: outside of begin and end".into()),
        }
        self
    }

    /// Sets the texture coordinates of the vertices that follow, up to [`Builder::end`].
    pub fn uv(&mut self, u: f32, v: f32) -> &mut Self {
        match &mut self.pending {
            Some(pending) => pending.uv = pending.mesh.add_uv(f64::from(u), f64::from(v)),
            None => self.faults.push("uv: outside of begin and end".into()),
        }
        self
    }

    /// Adds a vertex.
    pub fn vertex(&mut self, position: Vec3) -> &mut Self {
        match &mut self.pending {
            Some(pending) => {
                let position = pending.mesh.add_position(position.as_dvec3());
                pending.corners.push(Corner { position, normal: pending.normal, uv: pending.uv });
            }
            None => self.faults.push("vertex: outside of begin and end".into()),
        }
        self
    }

    /// Makes triangles of the vertices since [`Builder::begin`].
    pub fn end(&mut self) -> &mut Self {
        let Some(Pending { primitive, mut mesh, corners, .. }) = self.pending.take() else {
            return self.fail("end: nothing was begun");
        };
        let n = corners.len();
        if n < 3 || (primitive == Primitive::Triangles && n % 3 != 0) {
            return self.fail(format!("end: {n} vertices do not make {primitive:?}"));
        }
        mesh.triangles = match primitive {
            Primitive::Triangles => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
            Primitive::Fan => corners[1..].windows(2).map(|c| [corners[0], c[0], c[1]]).collect(),
            Primitive::Strip => {
                let turned =
                    |(i, c): (usize, &[Corner])| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] };
                corners.windows(3).enumerate().map(turned).collect()
            }
        };
        self.add_mesh(&mesh)
    }

    /// Adds one flat triangle, counter-clockwise seen from its outside.
    pub fn triangle(&mut self, p0: Vec3, p1: Vec3, p2: Vec3) -> &mut Self {
        self.mesh(&[p0, p1, p2], Normals::Flat, &[], &[[0, 1, 2]])
    }

    /// Adds a mesh: triangles of `positions`, with one of `uvs` for each position or none at all.
    pub fn mesh(&mut self, positions: &[Vec3], normals: Normals, uvs: &[Vec2], triangles: &[[u32; 3]]) -> &mut Self {
        if let Some(index) = triangles.iter().flatten().find(|&&i| i as usize >= positions.len()) {
            return self.fail(format!("mesh: there is no vertex {index}, only {}", positions.len()));
        }
        if !uvs.is_empty() && uvs.len() != positions.len() {
            return self.fail(format!("mesh: {} texture coordinates for {} positions", uvs.len(), positions.len()));
        }
        let given = if let Normals::Given(given) = normals { given } else { &[] };
        if matches!(normals, Normals::Given(_)) && given.len() != positions.len() {
            return self.fail(format!("mesh: {} normals for {} positions", given.len(), positions.len()));
        }
        let corner = |i: u32| Corner {
            position: i,
            normal: if given.is_empty() { NO_INDEX } else { i },
            uv: if uvs.is_empty() { NO_INDEX } else { i },
        };
        let mut mesh = Mesh {
            positions: positions.iter().map(|p| p.as_dvec3()).collect(),
            normals: given.iter().map(|n| n.as_dvec3()).collect(),
            uvs: uvs.to_vec(),
            triangles: triangles.iter().map(|t| t.map(corner)).collect(),
        };
        if matches!(normals, Normals::Smooth) {
            mesh.smooth();
        }
        self.add_mesh(&mesh)
    }

    /// Whether there is memory for a mesh of so many parts, and for what it becomes in the scene. It is a fault if not.
    pub(super) fn has_room(&mut self, what: &str, counts: Counts) -> bool {
        self.unchecked_bytes = self.unchecked_bytes.saturating_add(counts.bytes());
        if self.unchecked_bytes < CHECK_EVERY_BYTES {
            return true;
        }
        let what = format!("{what} of {} triangles", counts.triangles);
        let remedy = "lower its segments, or raise `memory_limit`";
        let bytes = std::mem::take(&mut self.unchecked_bytes);
        let need = Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy };
        self.budget.check(&need).map_err(|error| self.faults.push(error.to_string())).is_ok()
    }

    /// Adds `mesh` with the current material and transform.
    pub(super) fn add_mesh(&mut self, mesh: &Mesh) -> &mut Self {
        let material = self.current_material();
        self.add_geometry(mesh, |_| material)
    }

    /// Adds the triangles of `other` with the current transform and with `material`, or their own materials without
    /// one. Materials, textures, warnings and names of files come along; lights, camera, background and ambient light
    /// do not. Instances become triangles.
    pub fn add_scene(&mut self, other: &Scene, material: Option<MaterialId>) -> &mut Self {
        if let Some(id) = material.filter(|&id| id as usize >= self.scene.materials.len()) {
            return self.fail(format!("add_scene: there is no material number {id}"));
        }
        let mut counts = Counts { triangles: other.triangle_count() as u64, ..Counts::default() };
        let lists = [&other.positions, &other.normals].map(|list| list.len() as u64);
        [counts.positions, counts.normals, counts.uvs] = [lists[0], lists[1], other.uvs.len() as u64];
        if !self.has_room("the model", counts.and_bytes(other.flattened_bytes())) {
            return self;
        }
        let other = match other.flattened() {
            Ok(flat) => flat,
            Err(error) => return self.fail_with(error),
        };
        self.scene.warnings.extend_from_slice(&other.warnings);
        self.scene.files.extend_from_slice(&other.files);
        let mut own_material: Vec<MaterialId> = Vec::new();
        if material.is_none() {
            let textures: Vec<TextureId> = other.textures.iter().map(|t| self.add_texture(t.clone())).collect();
            for m in &other.materials {
                let diffuse_texture = m.diffuse_texture.map(|t| textures[t as usize]);
                own_material.push(self.add_material(Material { diffuse_texture, ..m.clone() }));
            }
        }
        let corners =
            |t: &Triangle| [0, 1, 2].map(|k| Corner { position: t.positions[k], normal: t.normals[k], uv: t.uvs[k] });
        let mesh = Mesh {
            positions: other.positions.iter().map(|p| p.as_dvec3()).collect(),
            normals: other.normals.iter().map(|n| n.as_dvec3()).collect(),
            uvs: other.uvs.clone(),
            triangles: other.triangles.iter().map(corners).collect(),
        };
        self.add_geometry(&mesh, |i| material.unwrap_or_else(|| own_material[other.triangles[i].material as usize]))
    }

    /// Sets where the camera is in some frames.
    pub(super) fn camera_keys(&mut self, keys: Vec<CameraKey>) -> &mut Self {
        self.scene.camera_keys = keys;
        self
    }

    /// Keeps that an object of a scene file ends here.
    pub(super) fn note_object_end(&mut self) {
        let (triangles, shared) = (self.scene.triangles.len() as u32, self.scene.instances.objects().len() as u32);
        self.scene.object_ends.push(ObjectEnd { triangles, shared });
    }

    /// Starts an object: what is added up to [`Builder::end_object`] is in its coordinates, and nowhere in the scene
    /// before [`Builder::instance`] puts it there. Lights that are added meanwhile are the scene's.
    pub fn begin_object(&mut self) -> &mut Self {
        if self.outside.is_some() {
            return self.fail("begin_object: the last one was not ended");
        }
        let scene = &self.scene;
        let lengths = [scene.positions.len(), scene.normals.len(), scene.uvs.len(), scene.triangles.len()];
        let transform = std::mem::replace(&mut self.transform, DAffine3::IDENTITY);
        self.outside = Some(Outside { transform, stack: std::mem::take(&mut self.stack), lengths });
        self
    }

    /// Ends an object and tells its number. The transform is that of before [`Builder::begin_object`] again.
    pub fn end_object(&mut self) -> ObjectId {
        let Some(Outside { transform, stack, lengths: [positions, normals, uvs, triangles] }) = self.outside.take()
        else {
            self.fail("end_object: nothing was begun");
            return 0;
        };
        if !std::mem::replace(&mut self.stack, stack).is_empty() {
            self.fail("end_object: more pushes than pops in it");
        }
        self.transform = transform;
        let scene = &mut self.scene;
        let mut object = Object {
            positions: scene.positions.split_off(positions),
            normals: scene.normals.split_off(normals),
            uvs: scene.uvs.split_off(uvs),
            triangles: scene.triangles.split_off(triangles),
        };
        for triangle in &mut object.triangles {
            let lists =
                [(&mut triangle.positions, positions), (&mut triangle.normals, normals), (&mut triangle.uvs, uvs)];
            for (indices, first) in lists {
                indices.iter_mut().filter(|index| **index != NO_INDEX).for_each(|index| *index -= first as u32);
            }
        }
        scene.instances.add_object(object).unwrap_or_else(|error| {
            self.fail_with(error);
            0
        })
    }

    /// Puts an object where the current transform says, of one material or, without, of its own ones. The transform is
    /// rounded to float32 there, and so is every vertex: see [`Transform::point`].
    pub fn instance(&mut self, object: ObjectId, material: Option<MaterialId>) -> &mut Self {
        if self.outside.is_some() {
            return self.fail("instance: an object has no instances");
        }
        if let Some(id) = material.filter(|&id| id as usize >= self.scene.materials.len()) {
            return self.fail(format!("instance: there is no material number {id}"));
        }
        let Some(transform) = Transform::new(self.transform) else {
            return self.fail("instance: the transform flattens space or is not finite in float32");
        };
        match self.scene.instances.add(Instance { object, transform, material }) {
            Ok(()) => self,
            Err(error) => self.fail_with(error),
        }
    }

    fn current_material(&mut self) -> MaterialId {
        if let Some(id) = self.material {
            return id;
        }
        let id = self.add_material(Material { name: "default".into(), ..Material::default() });
        self.material = Some(id);
        id
    }

    /// Transforms `mesh` and appends it; `material(i)` is that of its triangle `i`.
    pub(super) fn add_geometry(&mut self, mesh: &Mesh, material: impl Fn(usize) -> MaterialId) -> &mut Self {
        let first = [self.scene.positions.len(), self.scene.normals.len(), self.scene.uvs.len()];
        let added = [mesh.positions.len(), mesh.normals.len(), mesh.uvs.len()];
        if first.iter().zip(added).any(|(&a, b)| a + b >= NO_INDEX as usize) {
            return self.fail("the scene has more vertices than 32-bit indices can tell apart");
        }
        let m = self.transform.matrix3;
        let sign = m.determinant().signum();
        // Normals go with the inverse transpose. The matrix of cofactors is that times the determinant, and the length
        // does not matter; only the sign does, for mirrors.
        let normal_matrix =
            DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)) * sign;
        for &p in &mesh.positions {
            let position = self.transform.transform_point3(p).as_vec3();
            if p.is_finite() && !position.is_finite() {
                return self.fail(format!("the transform moves the vertex {p} out of float32's range"));
            }
            self.scene.positions.push(position);
        }
        self.scene.normals.extend(mesh.normals.iter().map(|&n| (normal_matrix * n).normalize_or_zero().as_vec3()));
        let uv_scale = self.uv_scale.unwrap_or(Vec2::ONE);
        self.scene.uvs.extend(mesh.uvs.iter().map(|&uv| uv * uv_scale));

        let offset = |index: u32, first: usize| if index == NO_INDEX { NO_INDEX } else { index + first as u32 };
        for (i, &[a, b, c]) in mesh.triangles.iter().enumerate() {
            // A mirrored triangle is clockwise: exchange two corners.
            let corners = if sign < 0.0 { [a, c, b] } else { [a, b, c] };
            self.scene.triangles.push(Triangle {
                positions: corners.map(|c| offset(c.position, first[0])),
                normals: corners.map(|c| offset(c.normal, first[1])),
                uvs: corners.map(|c| offset(c.uv, first[2])),
                material: material(i),
            });
        }
        self
    }

    // ---- everything else
    // ---------------------------------------------------------------------------------------------

    /// Adds a light; the current transform moves and turns it. Intensity and angles stay as they are.
    pub fn light(&mut self, light: Light) -> &mut Self {
        let transform = self.transform;
        let point = |p: Vec3| transform.transform_point3(p.as_dvec3()).as_vec3();
        let vector = |v: Vec3| transform.transform_vector3(v.as_dvec3()).as_vec3();
        let kind = match light.kind {
            LightKind::Point { position } => LightKind::Point { position: point(position) },
            LightKind::Directional { direction } => LightKind::Directional { direction: vector(direction) },
            LightKind::Spot { position, direction, inner_degrees, outer_degrees } => LightKind::Spot {
                position: point(position),
                direction: vector(direction),
                inner_degrees,
                outer_degrees,
            },
        };
        self.scene.lights.push(Light { kind, ..light });
        self
    }

    /// Sets the camera, in world coordinates.
    pub fn camera(&mut self, camera: Camera) -> &mut Self {
        self.scene.camera = Some(camera);
        self
    }

    /// Sets the cameras of wider pictures, by rising aspect, in world coordinates.
    pub fn wide_cameras(&mut self, cameras: Vec<WideCamera>) -> &mut Self {
        self.scene.wide_cameras = cameras;
        self
    }

    /// Sets what rays that miss everything see.
    pub fn background(&mut self, background: Background) -> &mut Self {
        (self.scene.background, self.scene.has_background) = (background, true);
        self
    }

    /// Sets the light from everywhere, linear RGB.
    pub fn ambient(&mut self, ambient: Vec3) -> &mut Self {
        self.scene.ambient = ambient;
        self
    }

    /// Sets the light from all around that depends on the normal, in world coordinates.
    pub fn sky(&mut self, sky: Sky) -> &mut Self {
        self.scene.sky = Some(sky);
        self
    }

    /// Sets what light pictures add where the scene has none.
    pub fn default_light(&mut self, default_light: DefaultLight) -> &mut Self {
        self.scene.default_light = default_light;
        self
    }

    /// Sets what the scene says of its picture.
    pub fn picture(&mut self, picture: PictureDefaults) -> &mut Self {
        self.scene.picture = picture;
        self
    }

    /// The scene.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) tells the first faults of the calls so far, or what is out of range in
    /// camera, lights, materials, ambient light and background.
    pub fn finish(mut self) -> Result<Scene> {
        if self.pending.is_some() {
            self.fail("begin: not ended");
        }
        if self.outside.is_some() {
            self.fail("begin_object: not ended");
        }
        self.faults.extend(value_faults(&self.scene));
        none_of(self.faults).map(|()| self.scene)
    }
}
