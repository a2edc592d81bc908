//! Views as Python gives them.

use crate::error::to_python;
use numpy::PyArray1;
use pyo3::prelude::*;
use raybrook::{Layer, Result, View, Viewpoint};

/// What a picture shows and how, a dict.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct GivenView {
    size: Option<(u32, u32)>,
    eye: Option<[f32; 3]>,
    target: Option<[f32; 3]>,
    up: Option<[f32; 3]>,
    /// Degrees.
    fov: Option<f32>,
    /// The name of a viewpoint.
    view: Option<String>,
    samples: Option<u32>,
    error: Option<f32>,
    depth: Option<u32>,
    crop: Option<[u32; 4]>,
    layers: Vec<String>,
}

impl GivenView {
    pub fn view(&self, py: Python) -> PyResult<View> {
        self.parsed().map_err(|error| to_python(py, &error))
    }

    fn parsed(&self) -> Result<View> {
        let mut view = self.size.map_or_else(View::default, |(width, height)| View::new(width, height));
        view = self.eye.map_or(view, |eye| view.eye(eye));
        view = self.target.map_or(view, |target| view.target(target));
        view = self.up.map_or(view, |up| view.up(up));
        view = self.fov.map_or(view, |fov| view.fov(fov));
        let viewpoint: Option<Viewpoint> = self.view.as_ref().map(|name| name.parse()).transpose()?;
        view = viewpoint.map_or(view, |viewpoint| view.viewpoint(viewpoint));
        view = self.samples.map_or(view, |samples| view.samples(samples));
        view = self.error.map_or(view, |error| view.error(error));
        view = self.depth.map_or(view, |depth| view.depth(depth));
        view = self.crop.map_or(view, |[x, y, width, height]| view.crop(x, y, width, height));
        let layers: Vec<Layer> = self.layers.iter().map(|name| name.parse()).collect::<Result<_>>()?;
        Ok(view.layers(&layers))
    }
}

/// Width and height of a picture, or of its part; and rectangles of it, as column, row, width and height, each with
/// the numbers of the blocks that fill it.
pub type Regions = ((u32, u32), Vec<([usize; 4], Vec<usize>)>);

/// The pixels of some blocks, by threes, and where they go: column, row, width and height of each of their places.
pub type BlockArrays<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>);
