//! Scenes from files and from slices.

use crate::error::{Error, Result};
use crate::scene::{Material, NO_INDEX, Scene, Triangle, load};
use glam::Vec3;
use std::path::Path;

impl Scene {
    /// Loads the scene in `path`: a `.toml` scene file (see `docs/book/src/scenes.md`), a Wavefront `.obj`, a `.ply`, a
    /// `.stl`, glTF 2.0 as `.gltf` or `.glb`, an `.off`, a `.3mf` or a Haines `.nff`. What was repaired or left out is
    /// in [`Scene::warnings`]. A file without a triangle is a scene that every ray misses.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read; [`Error::Input`] when it is of no known kind or what it holds is not
    /// usable, with file and line; [`Error::OutOfMemory`] when it takes more than nine tenths of the memory that is
    /// left.
    pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
        load(path)
    }

    /// A scene of one mesh, matt grey, without light or camera: [`Tracer::render`](crate::Tracer::render) adds both.
    ///
    /// `positions`: world units. `triangles`: three indices into `positions` each; `triangles[i]` is
    /// [`Hit::triangle`](crate::Hit) number `i`. A triangle without area keeps its number and is never hit.
    ///
    /// ```
    /// use raybrook::Scene;
    ///
    /// let scene = Scene::from_mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// assert_eq!(scene.triangle_count(), 1);
    /// let error = Scene::from_mesh(&[[0.0; 3]; 3], &[[0, 1, 3]]).unwrap_err();
    /// assert!(error.to_string().contains("triangle 0 names vertex 3"));
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Scene`] names the first position that is not finite or the first triangle with an index that is out of
    /// range, or says that there are no triangles.
    pub fn from_mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Scene> {
        if triangles.is_empty() {
            return Err(Error::Scene("the mesh has no triangles".to_owned()));
        }
        check_positions(positions)?;
        let out_of_range = |triangle: &[u32; 3]| triangle.iter().find(|&&i| i as usize >= positions.len()).copied();
        if let Some((i, vertex)) = triangles.iter().enumerate().find_map(|(i, t)| Some((i, out_of_range(t)?))) {
            let count = positions.len();
            return Err(Error::Scene(format!("triangle {i} names vertex {vertex}, but the mesh has {count} vertices")));
        }
        let triangle =
            |&positions: &[u32; 3]| Triangle { positions, normals: [NO_INDEX; 3], uvs: [NO_INDEX; 3], material: 0 };
        Ok(Scene {
            positions: positions.iter().copied().map(Vec3::from).collect(),
            triangles: triangles.iter().map(triangle).collect(),
            materials: vec![Material::default()],
            ..Scene::default()
        })
    }

    /// Moves all vertices: `positions`, world units, one for each of [`Scene::positions`], whose triangles stay.
    /// [`Tracer::update`](crate::Tracer::update) takes them over.
    ///
    /// # Errors
    /// [`Error::Scene`] when there are more or fewer vertices, and names the first position that is not finite.
    pub fn update_vertices(&mut self, positions: &[[f32; 3]]) -> Result<()> {
        let (given, count) = (positions.len(), self.positions.len());
        if given != count {
            return Err(Error::Scene(format!(
                "the scene has {count} vertices, and there are {given} positions for them"
            )));
        }
        check_positions(positions)?;
        self.positions.iter_mut().zip(positions).for_each(|(to, &from)| *to = from.into());
        Ok(())
    }
}

fn check_positions(positions: &[[f32; 3]]) -> Result<()> {
    match positions.iter().position(|p| !Vec3::from(*p).is_finite()) {
        None => Ok(()),
        Some(i) => {
            let [x, y, z] = positions[i];
            Err(Error::Scene(format!("vertex {i} of the mesh is ({x}, {y}, {z}), which is no place")))
        }
    }
}

/// Checks that the triangles of a scene that was put together by hand name positions and materials that it has.
pub(super) fn check_indices(scene: &Scene) -> Result<()> {
    let (positions, materials) = (scene.positions.len(), scene.materials.len());
    let is_wrong = |triangle: &Triangle| {
        triangle.positions.iter().any(|&i| i as usize >= positions) || triangle.material as usize >= materials
    };
    match scene.triangles.iter().position(is_wrong) {
        None => Ok(()),
        Some(i) => {
            let Triangle { positions: [a, b, c], material, .. } = scene.triangles[i];
            Err(Error::Scene(format!(
                "triangle {i} names the vertices {a}, {b}, {c} and material {material}, but there are {positions} \
                 vertices and {materials} materials"
            )))
        }
    }
}
