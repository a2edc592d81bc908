//! float64 numbers as float32.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::prelude::*;

/// Numbers that one task rounds.
const PART: usize = 1 << 16;

/// `numbers` rounded to the nearest float32 numbers; how many that changed, and the largest change. NaN stays NaN.
#[pyfunction]
pub fn round_to_float32<'py>(
    py: Python<'py>,
    numbers: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Bound<'py, PyArray1<f32>>, usize, f64)> {
    let numbers = numbers.as_slice()?;
    let rounded = PyArray1::zeros(py, numbers.len(), false);
    // SAFETY: nobody else has the new array yet.
    let results: &mut [f32] = unsafe { rounded.as_slice_mut() }?;
    let (changed, largest) = py.detach(|| {
        let parts = results.par_chunks_mut(PART).zip(numbers.par_chunks(PART));
        let round = |(results, numbers): (&mut [f32], &[f64])| {
            let (mut changed, mut largest) = (0, 0.0f64);
            for (result, &number) in results.iter_mut().zip(numbers) {
                *result = number as f32;
                let back = f64::from(*result);
                if back != number && !number.is_nan() {
                    changed += 1;
                    largest = largest.max((back - number).abs());
                }
            }
            (changed, largest)
        };
        parts.map(round).reduce(|| (0, 0.0), |a, b| (a.0 + b.0, a.1.max(b.1)))
    });
    Ok((rounded, changed, largest))
}
