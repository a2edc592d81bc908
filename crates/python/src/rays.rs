//! Rays as arrays have them.

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use raybrook::Ray;
use raybrook::low_level::parallel;
use std::ops::Range;

/// Rays as Python gives them: rows of 6 or 8 numbers; or rows of 3 and directions; and the least and the largest t of
/// those whose rows have none.
pub type GivenRays<'py> = (PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray2<'py, f32>>, [f32; 2]);

/// Rays in the memory of arrays: rows of origin and direction, with or without limits of t; or origins alone, and
/// directions in an array of their own.
#[derive(Clone, Copy)]
pub struct Rays<'a> {
    rows: &'a [f32],
    width: usize,
    directions: Option<&'a [f32]>,
    limits: [f32; 2],
}

impl<'a> Rays<'a> {
    pub fn new((rows, directions, limits): &'a GivenRays<'_>) -> PyResult<Rays<'a>> {
        let directions = directions.as_ref().map(|array| array.as_slice()).transpose()?;
        Ok(Rays { rows: rows.as_slice()?, width: rows.shape()[1], directions, limits: *limits })
    }

    pub fn len(&self) -> usize {
        self.rows.len() / self.width
    }

    /// One of the rays as the library takes them.
    pub fn ray(&self, i: usize) -> Ray {
        let three = |numbers: &[f32], first: usize| [numbers[first], numbers[first + 1], numbers[first + 2]];
        let first = i * self.width;
        let direction = self.directions.map_or_else(|| three(self.rows, first + 3), |all| three(all, 3 * i));
        let [t_min, t_max] = if self.width == 8 { [self.rows[first + 6], self.rows[first + 7]] } else { self.limits };
        Ray { origin: three(self.rows, first), direction, t_min, t_max }
    }

    /// Some of the rays as the library takes them.
    pub fn part(&self, range: Range<usize>) -> Vec<Ray> {
        parallel::map_numbers(range.len(), |i| self.ray(range.start + i))
    }
}
