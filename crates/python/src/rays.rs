//! Rays as arrays have them.

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use raybrook::Ray;
use raybrook::low_level::parallel;
use std::ops::Range;

/// Rays as Python gives them: rows of 6 or 8 numbers; or rows of 3 and directions; and the least and the largest t of
/// those whose rows have none.
pub type GivenRays<'py> = (PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray2<'py, f32>>, [f32; 2]);

/// Rays in the memory of arrays.
#[derive(Clone, Copy)]
pub enum Rays<'a> {
    /// Rows of origin and direction; the limits of all.
    Lines(&'a [[f32; 6]], [f32; 2]),
    /// Rows of origin, direction and limits.
    Limited(&'a [[f32; 8]]),
    /// Origins alone, and directions in an array of their own, as many; the limits of all.
    Apart(&'a [[f32; 3]], &'a [[f32; 3]], [f32; 2]),
}

impl<'a> Rays<'a> {
    pub fn new((rows, directions, limits): &'a GivenRays<'_>) -> PyResult<Rays<'a>> {
        let numbers = rows.as_slice()?;
        Ok(match directions {
            Some(directions) => Rays::Apart(numbers.as_chunks().0, directions.as_slice()?.as_chunks().0, *limits),
            None if rows.shape()[1] == 8 => Rays::Limited(numbers.as_chunks().0),
            None => Rays::Lines(numbers.as_chunks().0, *limits),
        })
    }

    pub fn len(&self) -> usize {
        match self {
            Rays::Lines(rows, _) => rows.len(),
            Rays::Limited(rows) => rows.len(),
            Rays::Apart(origins, ..) => origins.len(),
        }
    }

    /// One of the rays as the library takes them.
    // Where it is not inlined, a ray goes through memory, which takes longer than all that is done with it.
    #[inline(always)]
    pub fn ray(&self, i: usize) -> Ray {
        let (origin, direction, [t_min, t_max]) = match *self {
            Rays::Lines(rows, limits) => {
                let [x, y, z, u, v, w] = rows[i];
                ([x, y, z], [u, v, w], limits)
            }
            Rays::Limited(rows) => {
                let [x, y, z, u, v, w, t_min, t_max] = rows[i];
                ([x, y, z], [u, v, w], [t_min, t_max])
            }
            Rays::Apart(origins, directions, limits) => (origins[i], directions[i], limits),
        };
        Ray { origin, direction, t_min, t_max }
    }

    /// Some of the rays as the library takes them.
    pub fn part(&self, range: Range<usize>) -> Vec<Ray> {
        parallel::map_numbers(range.len(), |i| self.ray(range.start + i))
    }
}
