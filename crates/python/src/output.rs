//! Hits as arrays of numbers.

use crate::meshes::Meshes;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use raybrook::low_level::parallel;
use raybrook::{AllHits, Hit, Hits, Scene};

/// Marks a ray that hits nothing, as triangle and as mesh.
pub const NO_HIT: u32 = u32::MAX;

/// Hits that a thread writes at a time.
const CHUNK: usize = 4096;

/// Where the closest hits of some rays go, an element of each for a ray: u and v, and normals, by twos and threes.
pub struct ClosestHits<'a> {
    pub t: &'a mut [f32],
    pub uv: &'a mut [f32],
    pub triangle: &'a mut [u32],
    pub mesh: &'a mut [u32],
    /// Empty where they are not wanted.
    pub normals: &'a mut [f32],
}

impl<'a> ClosestHits<'a> {
    /// Takes the places of the first `count` rays away.
    pub fn split(&mut self, count: usize) -> ClosestHits<'a> {
        fn take<'a, T>(all: &mut &'a mut [T], count: usize) -> &'a mut [T] {
            let (first, rest) = std::mem::take(all).split_at_mut(count);
            *all = rest;
            first
        }
        let normals = if self.normals.is_empty() { 0 } else { 3 * count };
        ClosestHits {
            t: take(&mut self.t, count),
            uv: take(&mut self.uv, 2 * count),
            triangle: take(&mut self.triangle, count),
            mesh: take(&mut self.mesh, count),
            normals: take(&mut self.normals, normals),
        }
    }

    /// Writes the hits of all rays.
    pub fn write(self, hits: &Hits, meshes: &Meshes, scene: &Scene) {
        let ids = self.triangle.chunks_mut(CHUNK).zip(self.mesh.chunks_mut(CHUNK));
        let numbers = self.t.chunks_mut(CHUNK).zip(self.uv.chunks_mut(2 * CHUNK));
        parallel::each(ids.zip(numbers).enumerate(), |(chunk, ((triangle, mesh), (t, uv)))| {
            let of_each = triangle.iter_mut().zip(mesh).zip(t.iter_mut().zip(uv.chunks_mut(2)));
            for (i, ((triangle, mesh), (t, uv))) in (chunk * CHUNK..).zip(of_each) {
                match hits.get(i) {
                    Some(hit) => {
                        (*mesh, *triangle) = meshes.place(hit.triangle);
                        *t = hit.t;
                        uv.copy_from_slice(&[hit.u, hit.v]);
                    }
                    None => {
                        (*mesh, *triangle) = (NO_HIT, NO_HIT);
                        *t = f32::INFINITY;
                        uv.fill(0.0);
                    }
                }
            }
        });
        parallel::each(self.normals.chunks_mut(3 * CHUNK).enumerate(), |(chunk, normals)| {
            for (i, normal) in (chunk * CHUNK..).zip(normals.chunks_mut(3)) {
                normal.copy_from_slice(&hits.get(i).map_or([0.0; 3], |hit| unit_normal(scene, hit.triangle)));
            }
        });
    }
}

/// The unit normal of a triangle, on the side from which its vertices go counter-clockwise.
pub fn unit_normal(scene: &Scene, triangle: u32) -> [f32; 3] {
    let [a, b, c] = scene.vertices(triangle as usize).map(|vertex| vertex.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3().to_array()
}

/// All hits of rays, ray after ray.
#[derive(Default)]
pub struct HitList {
    /// Where the hits of each ray start, and where those of the last one end.
    pub starts: Vec<i64>,
    t: Vec<f32>,
    uv: Vec<[f32; 2]>,
    triangle: Vec<u32>,
    mesh: Vec<u32>,
}

/// The arrays of a list: starts, t, u and v by twos, triangle, mesh.
pub type Arrays<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
);

impl HitList {
    pub fn new() -> HitList {
        HitList { starts: vec![0], ..HitList::default() }
    }

    /// Adds a hit to the ray that is under way.
    pub fn push(&mut self, hit: &Hit, (mesh, triangle): (u32, u32)) {
        self.t.push(hit.t);
        self.uv.push([hit.u, hit.v]);
        self.triangle.push(triangle);
        self.mesh.push(mesh);
    }

    /// Ends the ray that is under way.
    pub fn end_ray(&mut self) {
        self.starts.push(self.t.len() as i64);
    }

    /// Adds all hits of further rays.
    pub fn extend(&mut self, all: &AllHits, meshes: &Meshes) {
        let hits = all.hits();
        parallel::extend(&mut self.t, hits.len(), |i| hits[i].t);
        parallel::extend(&mut self.uv, hits.len(), |i| [hits[i].u, hits[i].v]);
        parallel::extend(&mut self.mesh, hits.len(), |i| meshes.place(hits[i].triangle).0);
        parallel::extend(&mut self.triangle, hits.len(), |i| meshes.place(hits[i].triangle).1);
        let mut end = (self.t.len() - hits.len()) as i64;
        self.starts.extend(all.counts().map(|count| {
            end += count as i64;
            end
        }));
    }

    pub fn into_arrays(self, py: Python<'_>) -> Arrays<'_> {
        let HitList { starts, t, uv, triangle, mesh } = self;
        let numbers = (t.into_pyarray(py), uv.into_flattened().into_pyarray(py));
        (starts.into_pyarray(py), numbers.0, numbers.1, triangle.into_pyarray(py), mesh.into_pyarray(py))
    }
}
