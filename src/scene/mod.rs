//! Scenes: triangles with materials, lights and a camera, in world units. Usable alone: nothing here knows of
//! acceleration structures, devices or pictures' pixels.
//!
//! A scene comes from a file ([`load`]) or from the OpenGL-style [`Builder`] (thesis, section 6.2.1).

mod aim;
mod area;
mod builder;
mod camera;
mod check;
mod default_light;
mod digest;
mod file;
mod gltf;
mod height;
mod instances;
mod known;
mod light;
mod load;
mod material;
mod mesh;
mod mtl;
mod nff;
mod numbering;
mod obj;
mod off;
mod open_side;
mod paint;
mod path;
mod ply;
mod procedural;
mod reading;
mod room;
mod samples;
mod solids;
mod stl;
mod text;
mod texture;
mod threemf;
mod triangulate;
mod unused;
mod upright;
mod words;

pub use aim::{Aim, AimSource, Placed, Viewpoint};
pub use area::{PROJECTIONS, projected_area};
pub use builder::{Builder, Normals, Primitive};
pub use camera::{Camera, WideCamera};
pub(crate) use camera::{Framed, Framing};
pub use default_light::DefaultLight;
pub use instances::{Instance, Instances, Object, ObjectId, Transform};
pub(crate) use instances::{row_times_direction, row_times_point, turned};
pub use light::{Falloff, Light, LightKind, Sky};
pub use load::{line_of_vertex, load, load_within};
pub use material::{Material, MaterialId, Toon};
pub use numbering::{Numbering, ObjectEnd};
pub use path::{CameraKey, CameraPath};
pub use procedural::{Pattern, Procedural, TextureSpace};
pub use samples::Samples;
pub use solids::MAX_SEGMENTS;
pub use texture::{Image, Texture, TextureId};
pub(crate) use upright::up_by_shape;

use crate::error::Result;
use crate::parallel;
use bytemuck::Zeroable;
use glam::{Vec2, Vec3};
use std::path::PathBuf;

/// Marks a triangle corner without its own normal or texture coordinates.
pub const NO_INDEX: u32 = u32::MAX;

/// One triangle: indices into the scene's arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Zeroable)]
pub struct Triangle {
    /// Indices into [`Scene::positions`].
    pub positions: [u32; 3],
    /// Indices into [`Scene::normals`], or [`NO_INDEX`]; where one corner has no normal, all have the geometric one.
    pub normals: [u32; 3],
    /// Indices into [`Scene::uvs`], or [`NO_INDEX`]: the corner then has (0, 0).
    pub uvs: [u32; 3],
    /// Index into [`Scene::materials`].
    pub material: MaterialId,
}

/// What a ray that leaves the scene sees, linear RGB: a gradient over the cosine between its direction and up, which
/// from -1 to 1 leads from `bottom` to `top` in a straight line (equal colours: constant). Up is that of the scene's
/// sky; without one it is y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background {
    /// Colour straight down, linear RGB; the horizon has the mean of both.
    pub bottom: Vec3,
    /// Colour straight up, linear RGB.
    pub top: Vec3,
}

impl Default for Background {
    fn default() -> Self {
        Background { bottom: Vec3::splat(0.05), top: Vec3::splat(0.05) }
    }
}

/// What a scene file says of the picture; command-line options override it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PictureDefaults {
    /// Width and height in pixels.
    pub size: Option<(u32, u32)>,
    /// Where camera rays pass.
    pub samples: Option<Samples>,
    /// Longest chain of rays, the camera ray counted as 1.
    pub depth: Option<u32>,
}

impl PictureDefaults {
    /// The longest side of a picture, pixels.
    pub const MAX_SIDE: u32 = 65_535;
    /// The most samples per pixel.
    pub const MAX_SAMPLES: u32 = 65_536;
    /// The longest chain of rays: the stack of pending ones lies in a device's private memory.
    pub const MAX_DEPTH: u32 = 64;
}

/// A file that a scene was read from, or that its files name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceFile {
    /// Where it is.
    pub path: PathBuf,
    /// What it is to the scene, as in "it is …": `the texture that 'scene.mtl' names`.
    pub role: String,
}

/// A scene in world units.
///
/// `triangles[i]` is primitive number `i` of every hit: file order after polygons are triangulated; those of
/// `instances` come behind them. Triangles that cannot be hit (NaN, infinite, zero area) stay in the list and keep
/// their number; [`Scene::drop_reason`] tells them.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Vertex positions, world units.
    pub positions: Vec<Vec3>,
    /// Vertex normals; need not be of unit length, a zero or non-finite one means "the geometric normal".
    pub normals: Vec<Vec3>,
    /// Texture coordinates, v upwards.
    pub uvs: Vec<Vec2>,
    /// The triangles, in primitive order.
    pub triangles: Vec<Triangle>,
    /// Objects that stand in the scene many times.
    pub instances: Instances,
    /// Of a scene file where each of its objects ends, in its order; else empty.
    pub object_ends: Vec<ObjectEnd>,
    /// The materials; triangles refer to them by index.
    pub materials: Vec<Material>,
    /// The textures; materials refer to them by index.
    pub textures: Vec<Texture>,
    /// The lights. Without any, and without a sky, pictures add light.
    pub lights: Vec<Light>,
    /// Light from all around that depends on the normal.
    pub sky: Option<Sky>,
    /// What light pictures add where the scene has none.
    pub default_light: DefaultLight,
    /// The camera; without one the renderer frames the scene (see [`Camera::framing`]).
    pub camera: Option<Camera>,
    /// Cameras of wider pictures, by rising aspect.
    pub wide_cameras: Vec<WideCamera>,
    /// Where the camera is in some frames of an animation, in their order.
    pub camera_keys: Vec<CameraKey>,
    /// Which way is up by the rule of the file's format, or of the program that wrote it; `None`: as the scene's shape
    /// tells, or else y. A camera says it for itself.
    pub up: Option<Vec3>,
    /// What rays that miss everything see.
    pub background: Background,
    /// Whether that is meant as it is: else the default one makes room for a lighter one in pictures of a scene without
    /// light.
    pub has_background: bool,
    /// Light from everywhere, multiplied by [`Material::ambient`], linear RGB.
    pub ambient: Vec3,
    /// What the scene file says of the picture.
    pub picture: PictureDefaults,
    /// What was repaired, ignored or left out while loading; one sentence each, file named.
    pub warnings: Vec<String>,
    /// The files that it was read from, and those that these name and that are there: whoever writes beside a scene
    /// leaves them alone.
    pub files: Vec<SourceFile>,
}

/// The smallest box around some triangles.
fn around([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3) {
    (a.min(b).min(c), a.max(b).max(c))
}

fn around_both(one: (Vec3, Vec3), other: (Vec3, Vec3)) -> (Vec3, Vec3) {
    (one.0.min(other.0), one.1.max(other.1))
}

/// The box around nothing.
const AROUND_NOTHING: (Vec3, Vec3) = (Vec3::INFINITY, Vec3::NEG_INFINITY);

/// Why a triangle cannot be hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropReason {
    /// A vertex is NaN or infinite.
    NotFinite,
    /// The three vertices lie exactly on one line or in one point.
    ZeroArea,
}

impl DropReason {
    /// Why a triangle with these vertices can never be hit; see [`Scene::drop_reason`].
    pub(crate) fn of([a, b, c]: [Vec3; 3]) -> Option<DropReason> {
        if !(a.is_finite() && b.is_finite() && c.is_finite()) {
            return Some(DropReason::NotFinite);
        }
        (!area::has_area([a, b, c])).then_some(DropReason::ZeroArea)
    }
}

impl Scene {
    /// The three vertices of primitive `primitive`.
    pub fn vertices(&self, primitive: usize) -> [Vec3; 3] {
        match self.triangles.get(primitive) {
            Some(triangle) => triangle.positions.map(|i| self.positions[i as usize]),
            None => self.instances.vertices(primitive - self.triangles.len()),
        }
    }

    /// Why primitive `primitive` can never be hit, or `None` for a proper triangle.
    ///
    /// Whether there is an area is decided exactly, so that no thin but proper triangle is lost, however far apart its
    /// coordinates are in magnitude: without it rays would slip through a closed solid.
    pub fn drop_reason(&self, primitive: usize) -> Option<DropReason> {
        DropReason::of(self.vertices(primitive))
    }

    /// Checks what a scene may hold: camera, lights, materials, textures, ambient light and background. Loaders and
    /// [`Builder`] have done it; a scene that was put together or changed by hand is checked before it is traced.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) tells the first faults.
    pub fn check_values(&self) -> Result<()> {
        check::none_of(check::value_faults(self))
    }

    /// The primitives that can be hit, in order.
    pub fn hittable(&self) -> Vec<u32> {
        let first = self.triangles.len();
        let own = |i: usize| self.drop_reason(i).is_none().then_some(i as u32);
        let placed = |i: usize| self.instances.hittable(i).map(move |(number, _)| first as u32 + number);
        let mut all = parallel::flat_map_numbers(first, own);
        all.extend(parallel::flat_map_numbers(self.instances.placed().len(), placed));
        all
    }

    /// The materials that triangles have, in order; of others nothing reaches a picture.
    pub fn used_materials(&self) -> Vec<MaterialId> {
        let mut is_used = vec![false; self.materials.len()];
        let mut uses = |material: MaterialId| {
            // A scene that was not checked may name materials that it has not.
            if let Some(is_used) = is_used.get_mut(material as usize) {
                *is_used = true;
            }
        };
        self.triangles.iter().for_each(|triangle| uses(triangle.material));
        let mut uses_own = vec![false; self.instances.objects().len()];
        for instance in self.instances.placed() {
            match instance.material {
                Some(material) => uses(material),
                None => uses_own[instance.object as usize] = true,
            }
        }
        for (object, _) in self.instances.objects().iter().zip(uses_own).filter(|(_, uses_own)| *uses_own) {
            object.triangles.iter().for_each(|triangle| uses(triangle.material));
        }
        (0..).zip(is_used).filter_map(|(id, is_used)| is_used.then_some(id)).collect()
    }

    /// The lights that are not black, each with its number.
    pub fn shining_lights(&self) -> impl Iterator<Item = (usize, &Light)> {
        self.lights.iter().enumerate().filter(|(_, light)| light.intensity != Vec3::ZERO)
    }

    /// The smallest box around all triangles that can be hit: (min, max), or `None` when there is no such triangle.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let own = |i: usize| {
            let triangle = self.vertices(i);
            if DropReason::of(triangle).is_none() { around(triangle) } else { AROUND_NOTHING }
        };
        let placed = |i: usize| {
            let hittable = self.instances.hittable(i);
            hittable.fold(AROUND_NOTHING, |all, (_, triangle)| around_both(all, around(triangle)))
        };
        let own = parallel::reduce_numbers(self.triangles.len(), AROUND_NOTHING, own, around_both);
        let placed = parallel::reduce_numbers(self.instances.placed().len(), AROUND_NOTHING, placed, around_both);
        let all = around_both(own, placed);
        (all != AROUND_NOTHING).then_some(all)
    }

    /// The smallest box around `primitives`: (min, max), or `None` when there are none.
    pub fn bounds_of(&self, primitives: &[u32]) -> Option<(Vec3, Vec3)> {
        let of = |i: usize| around(self.vertices(primitives[i] as usize));
        let all = parallel::reduce_numbers(primitives.len(), AROUND_NOTHING, of, around_both);
        (!primitives.is_empty()).then_some(all)
    }
}
