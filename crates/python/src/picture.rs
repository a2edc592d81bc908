//! Pictures.

use crate::error::{raise, to_python};
use crate::process;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use raybrook::Plane;
use std::path::PathBuf;

/// A rendered picture.
#[pyclass(frozen, module = "raybrook._raybrook")]
pub struct Picture(pub raybrook::Picture);

#[pymethods]
impl Picture {
    /// A picture of float32 [height, width, 3].
    #[new]
    fn new(py: Python, width: u32, height: u32, pixels: PyReadonlyArray1<f32>) -> PyResult<Picture> {
        let pixels = pixels.as_slice()?.as_chunks().0.to_vec();
        let picture = raybrook::Picture::from_pixels(width, height, pixels);
        picture.map(Picture).map_err(|error| to_python(py, &error))
    }

    #[getter]
    fn width(&self) -> u32 {
        self.0.width()
    }

    #[getter]
    fn height(&self) -> u32 {
        self.0.height()
    }

    /// Linear RGB radiance, three numbers a pixel, top row first.
    fn pixels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, self.0.pixels().as_flattened())
    }

    /// 8-bit sRGB, three bytes a pixel, top row first.
    fn srgb8<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u8>>> {
        process::begin(py)?;
        Ok(PyArray1::from_vec(py, self.0.to_srgb8()))
    }

    /// The layers: each one's name, and its planes of a number a pixel, float32 or uint32, top row first.
    fn layers<'py>(&self, py: Python<'py>) -> Vec<(String, Vec<Bound<'py, PyAny>>)> {
        let plane = |(_, plane): &(char, Plane)| match plane {
            Plane::Float(values) => PyArray1::from_slice(py, values).into_any(),
            Plane::Uint(values) => PyArray1::from_slice(py, values).into_any(),
        };
        let groups = self.0.layers().iter();
        groups.map(|group| (group.name.clone(), group.planes.iter().map(plane).collect())).collect()
    }

    /// The picture made lighter by so many stops.
    fn exposed(&self, py: Python, stops: f32) -> PyResult<Picture> {
        process::begin(py)?;
        py.detach(|| self.0.clone().exposed(stops)).map(Picture).map_err(|error| to_python(py, &error))
    }

    /// The bytes of a PNG file.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        process::begin(py)?;
        let bytes = py.detach(|| self.0.to_png()).map_err(|error| raise(py, "OutputError", &error.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Writes a .png, .exr or .pfm file.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        process::begin(py)?;
        py.detach(|| self.0.save(path)).map_err(|error| to_python(py, &error))
    }

    #[getter]
    fn camera_rays(&self) -> u64 {
        self.0.camera_rays()
    }

    #[getter]
    fn all_rays(&self) -> u64 {
        self.0.all_rays()
    }
}
