//! Views as Python gives them.

use crate::error::to_python;
use numpy::PyArray1;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use raybrook::{Error, Layer, View, Viewpoint};
use std::str::FromStr;

/// What the arguments of a picture, a dict, ask for.
pub fn view_of(given: &Bound<PyDict>) -> PyResult<View> {
    let of_size = |(width, height): (u32, u32)| View::new(width, height);
    let mut view = field(given, "size")?.map_or_else(View::default, of_size);
    view = field(given, "eye")?.map_or(view, |eye: [f32; 3]| view.eye(eye));
    view = field(given, "target")?.map_or(view, |target: [f32; 3]| view.target(target));
    view = field(given, "up")?.map_or(view, |up: [f32; 3]| view.up(up));
    view = field(given, "fov")?.map_or(view, |degrees: f32| view.fov(degrees));
    let viewpoint = field(given, "view")?.map(|name: String| parsed::<Viewpoint>(given.py(), &name)).transpose()?;
    view = viewpoint.map_or(view, |viewpoint| view.viewpoint(viewpoint));
    view = field(given, "samples")?.map_or(view, |samples: u32| view.samples(samples));
    view = field(given, "error")?.map_or(view, |error: f32| view.error(error));
    view = field(given, "depth")?.map_or(view, |depth: u32| view.depth(depth));
    let of_crop = |[x, y, width, height]: [u32; 4]| view.crop(x, y, width, height);
    view = field(given, "crop")?.map_or(view, of_crop);
    let names: Vec<String> = field(given, "layers")?.unwrap_or_default();
    let layers = names.iter().map(|name| parsed::<Layer>(given.py(), name)).collect::<PyResult<Vec<_>>>()?;
    Ok(view.layers(&layers))
}

/// An argument, if it is given.
fn field<'py, T: FromPyObjectOwned<'py>>(given: &Bound<'py, PyDict>, name: &str) -> PyResult<Option<T>> {
    let py = given.py();
    let Some(value) = given.get_item(name)?.filter(|value| !value.is_none()) else { return Ok(None) };
    let named = |error: PyErr| match error.is_instance_of::<PyTypeError>(py) {
        true => PyTypeError::new_err(format!("argument '{name}': {}", error.value(py))),
        false => error,
    };
    value.extract::<T>().map(Some).map_err(|error| named(error.into()))
}

fn parsed<T: FromStr<Err = Error>>(py: Python, name: &str) -> PyResult<T> {
    name.parse().map_err(|error| to_python(py, &error))
}

/// Rectangles of a picture, or of its part, as column, row, width and height, each with the numbers of the blocks that
/// fill it.
pub type Regions = Vec<([usize; 4], Vec<usize>)>;

/// The pixels of some blocks, by threes, and where they go: column, row, width and height of each of their places.
pub type BlockArrays<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>);
