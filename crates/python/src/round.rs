//! float64 numbers as float32.

use crate::process;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use raybrook::low_level::parallel;
use raybrook::{LocalSpace, Rounding};

/// Rows that one task rounds; of fewer this thread does, so that they start no others.
const ROWS: usize = 1 << 14;

/// Rows of `width` numbers, of which the first three count from `origin` on, rounded to the nearest float32 numbers;
/// how many that changed, and the largest change. NaN stays NaN.
#[pyfunction]
pub fn round_to_float32<'py>(
    py: Python<'py>,
    numbers: PyReadonlyArray1<'py, f64>,
    width: usize,
    origin: [f64; 3],
) -> PyResult<(Bound<'py, PyArray1<f32>>, usize, f64)> {
    let (numbers, space) = (numbers.as_slice()?, LocalSpace::at(origin));
    let rounded = PyArray1::zeros(py, numbers.len(), false);
    // SAFETY: nobody else has the new array yet.
    let results: &mut [f32] = unsafe { rounded.as_slice_mut() }?;
    let round = |(results, numbers): (&mut [f32], &[f64])| {
        let mut rounding = Rounding::default();
        for (i, (result, &number)) in results.iter_mut().zip(numbers).enumerate() {
            let column = i % width;
            let in_space = if column < 3 { space } else { LocalSpace::default() };
            let (number, lost) = in_space.coordinate(column % 3, number);
            *result = number;
            rounding += lost;
        }
        rounding
    };
    let size = ROWS * width;
    if numbers.len() <= size {
        let rounding = round((results, numbers));
        return Ok((rounded, rounding.rounded, rounding.largest));
    }
    process::begin(py)?;
    let rounding = py.detach(|| {
        let rounded = parallel::map(results.chunks_mut(size).zip(numbers.chunks(size)), round);
        rounded.into_iter().fold(Rounding::default(), |mut all, of_part| {
            all += of_part;
            all
        })
    });
    Ok((rounded, rounding.rounded, rounding.largest))
}

/// Where float32 numbers for what is around `points` best count from.
#[pyfunction]
pub fn origin_around(points: PyReadonlyArray2<f64>) -> PyResult<[f64; 3]> {
    Ok(LocalSpace::around(points.as_slice()?.as_chunks().0).origin())
}
