//! Several meshes as one scene.

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use raybrook::scene::ObjectEnd;
use raybrook::{Error, Result, Scene};

/// Which mesh a triangle belongs to.
pub struct Meshes {
    /// Of each mesh the number of its first triangle in the scene, ascending.
    pub starts: Vec<u32>,
}

impl Meshes {
    /// The mesh of a triangle of the scene, and the triangle's number in it. Of meshes without triangles, that start
    /// at the same number, the last one has the triangle.
    pub fn place(&self, triangle: u32) -> (u32, u32) {
        let mesh = self.starts.partition_point(|&start| start <= triangle) - 1;
        (mesh as u32, triangle - self.starts[mesh])
    }
}

/// Meshes of one scene: positions and triangles. With `is_strict` vertices must be finite.
pub fn join(
    meshes: &[(PyReadonlyArray2<f32>, PyReadonlyArray2<u32>)],
    is_strict: bool,
) -> PyResult<Result<(Scene, Vec<u32>)>> {
    let (mut scene, mut starts, mut ends) = (Scene::default(), Vec::new(), Vec::new());
    for (i, (positions, triangles)) in meshes.iter().enumerate() {
        let (positions, triangles) = (positions.as_slice()?.as_chunks().0, triangles.as_slice()?.as_chunks().0);
        starts.push(scene.triangles.len() as u32);
        if let Err(error) = add_mesh(&mut scene, positions, triangles, is_strict) {
            return Ok(Err(match error {
                Error::Scene(message) if meshes.len() > 1 => Error::Scene(format!("mesh {i}: {message}")),
                other => other,
            }));
        }
        ends.push(ObjectEnd { triangles: scene.triangles.len() as u32, shared: 0 });
    }
    scene.object_ends = ends;
    Ok(Ok((scene, starts)))
}

fn add_mesh(scene: &mut Scene, positions: &[[f32; 3]], triangles: &[[u32; 3]], is_strict: bool) -> Result<()> {
    if triangles.is_empty() {
        return Ok(());
    }
    // Numbers of vertices and triangles have 32 bits, and the last one says that there is none.
    let too_many = |own: usize, new: usize| own + new >= u32::MAX as usize;
    if too_many(scene.positions.len(), positions.len()) || too_many(scene.triangles.len(), triangles.len()) {
        return Err(Error::Scene("there are more triangles or vertices than 32-bit numbers can tell apart".into()));
    }
    let is_finite = |p: &[f32; 3]| p.iter().all(|x| x.is_finite());
    let invisible: Vec<_> = if is_strict { vec![] } else { positions.iter().map(|p| !is_finite(p)).collect() };
    let kept: Vec<[f32; 3]>;
    let checked = if invisible.contains(&true) {
        kept = positions.iter().map(|p| if is_finite(p) { *p } else { [0.0; 3] }).collect();
        &kept
    } else {
        positions
    };
    let mut mesh = Scene::from_mesh(checked, triangles)?;
    for (i, _) in invisible.iter().enumerate().filter(|(_, is_invisible)| **is_invisible) {
        mesh.positions[i] = positions[i].into();
    }
    let first = scene.positions.len() as u32;
    mesh.triangles.iter_mut().for_each(|triangle| triangle.positions = triangle.positions.map(|i| i + first));
    if scene.triangles.is_empty() {
        *scene = mesh;
    } else {
        scene.positions.append(&mut mesh.positions);
        scene.triangles.append(&mut mesh.triangles);
    }
    Ok(())
}
