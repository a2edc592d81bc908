//! Closest points as arrays of numbers.

use crate::meshes::Meshes;
use crate::output::{NO_HIT, unit_normal};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use raybrook::{ClosestPoint, Scene};

/// The closest points of a scene to some points.
#[derive(Default)]
pub struct PointList {
    point: Vec<f32>,
    distance: Vec<f32>,
    triangle: Vec<u32>,
    mesh: Vec<u32>,
    uv: Vec<f32>,
    normals: Vec<f32>,
}

/// Points by threes, distances, triangles, meshes, u and v by twos, normals by threes.
pub type PointArrays<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
);

impl PointList {
    /// Adds points; with their triangles' normals, if `scene` is there to tell them.
    pub fn extend(&mut self, closest: &[Option<ClosestPoint>], meshes: &Meshes, scene: Option<&Scene>) {
        for closest in closest {
            match closest {
                Some(closest) => {
                    let (mesh, triangle) = meshes.place(closest.triangle);
                    self.point.extend(closest.point);
                    self.distance.push(closest.distance);
                    self.triangle.push(triangle);
                    self.mesh.push(mesh);
                    self.uv.extend([closest.u, closest.v]);
                }
                None => {
                    self.point.extend([f32::NAN; 3]);
                    self.distance.push(f32::NAN);
                    self.triangle.push(NO_HIT);
                    self.mesh.push(NO_HIT);
                    self.uv.extend([0.0; 2]);
                }
            }
            if let Some(scene) = scene {
                let normal = closest.as_ref().map_or([0.0; 3], |closest| unit_normal(scene, closest.triangle));
                self.normals.extend(normal);
            }
        }
    }

    pub fn into_arrays(self, py: Python<'_>) -> PointArrays<'_> {
        let PointList { point, distance, triangle, mesh, uv, normals } = self;
        let ids = (triangle.into_pyarray(py), mesh.into_pyarray(py));
        let numbers = (uv.into_pyarray(py), normals.into_pyarray(py));
        (point.into_pyarray(py), distance.into_pyarray(py), ids.0, ids.1, numbers.0, numbers.1)
    }
}
