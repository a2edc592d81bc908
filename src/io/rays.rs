//! Batches of rays from NumPy `.npz` files, and answers about points to such files.
//!
//! | array | shape | |
//! |---|---|---|
//! | `origin` | `[n, 3]` | world units |
//! | `direction` | `[n, 3]` | any length: t counts in it |
//! | `t_min`, `t_max` | `[n]` | optional interval of t |
//! | `next_direction` | `[n, 3]` | optional: a secondary ray from each hit |
//!
//! The arrays are float32. float64, big-endian numbers and Fortran order are converted: a double rounds to the nearest
//! float, and one beyond the floats' range becomes an infinity. Values are not judged here; tracing says what NaN or
//! zero means.
//!
//! Bad at: batches that do not fit in memory, which are read and written whole.

use std::path::Path;

use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::io::npz::{NpyArray, NpzFile, write_npz};

/// Names of the arrays that a batch may have.
const ARRAY_NAMES: [&str; 5] = ["origin", "direction", "t_min", "t_max", "next_direction"];

/// Rays to be traced; all arrays have the same length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RayBatch {
    /// Where each ray starts, world units.
    pub origins: Vec<[f32; 3]>,
    /// Where it goes, any length.
    pub directions: Vec<[f32; 3]>,
    /// Hits nearer than this do not count; in units of |direction|.
    pub t_min: Option<Vec<f32>>,
    /// Hits farther than this do not count; in units of |direction|.
    pub t_max: Option<Vec<f32>>,
    /// Direction of a secondary ray that starts at each hit.
    pub next_directions: Option<Vec<[f32; 3]>>,
    /// Names of arrays in the file that mean nothing here, so that a misspelt one can be told to the user.
    pub ignored: Vec<String>,
}

impl RayBatch {
    /// Reads an `.npz` file as `numpy.savez` and `numpy.savez_compressed` write it. No rays at all are fine.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read; [`Error::Input`] when it is no `.npz` file, is damaged, lacks
    /// `origin` or `direction`, or has an array of another type, shape or length than described above.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::read_within(path, &MemoryBudget::available())
    }

    /// As [`RayBatch::read`], with a memory of its own choice.
    ///
    /// # Errors
    /// As there, and [`Error::OutOfMemory`] when an array takes more than `budget` has.
    pub fn read_within(path: impl AsRef<Path>, budget: &MemoryBudget) -> Result<Self> {
        let path = path.as_ref();
        let mut file = NpzFile::open(path, *budget)?;
        let names = file.names().to_vec();
        let missing = |name: &str| {
            let found =
                if names.is_empty() { "it is empty".to_owned() } else { format!("it has {}", names.join(", ")) };
            Error::input(path, None, format!("there is no array '{name}' (float32, [n, 3]); {found}"))
        };
        let batch = RayBatch {
            origins: file.read_rows("origin")?.ok_or_else(|| missing("origin"))?,
            directions: file.read_rows("direction")?.ok_or_else(|| missing("direction"))?,
            t_min: file.read_rows::<1>("t_min")?.map(Vec::into_flattened),
            t_max: file.read_rows::<1>("t_max")?.map(Vec::into_flattened),
            next_directions: file.read_rows("next_direction")?,
            ignored: names.iter().filter(|n| !ARRAY_NAMES.contains(&n.as_str())).cloned().collect(),
        };
        let count = batch.len();
        let lengths = [
            ("direction", Some(batch.directions.len())),
            ("t_min", batch.t_min.as_ref().map(Vec::len)),
            ("t_max", batch.t_max.as_ref().map(Vec::len)),
            ("next_direction", batch.next_directions.as_ref().map(Vec::len)),
        ];
        for (name, length) in lengths {
            if let Some(length) = length.filter(|&l| l != count) {
                let message = format!("array 'origin' has {count} rays, but '{name}' has {length}");
                return Err(Error::input(path, None, message));
            }
        }
        Ok(batch)
    }

    /// Writes an `.npz` file that [`RayBatch::read`] reads; absent arrays are left out. The file appears when it is
    /// complete.
    ///
    /// # Errors
    /// As [`crate::io::output::write_atomically`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut arrays = vec![rows("origin", &self.origins), rows("direction", &self.directions)];
        arrays.extend(self.t_min.iter().map(|t| NpyArray::of("t_min", "f4", t)));
        arrays.extend(self.t_max.iter().map(|t| NpyArray::of("t_max", "f4", t)));
        arrays.extend(self.next_directions.iter().map(|d| rows("next_direction", d)));
        write_npz(path.as_ref(), &arrays)
    }

    /// The number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }
}

/// Reads points: the array `point` float32 `[n, 3]` of an `.npz` file; and names of arrays that mean nothing here.
///
/// # Errors
/// As [`RayBatch::read_within`].
pub fn read_points(path: impl AsRef<Path>, budget: &MemoryBudget) -> Result<(Vec<[f32; 3]>, Vec<String>)> {
    let path = path.as_ref();
    let mut file = NpzFile::open(path, *budget)?;
    let others: Vec<_> = file.names().iter().filter(|name| *name != "point").cloned().collect();
    match file.read_rows("point")? {
        Some(points) => Ok((points, others)),
        None => {
            let found =
                if others.is_empty() { "it is empty".to_owned() } else { format!("it has {}", others.join(", ")) };
            Err(Error::input(path, None, format!("there is no array 'point' (float32, [n, 3]); {found}")))
        }
    }
}

/// Writes the array `inside` uint8 of an `.npz` file, 0 or 1 for each point, and, if there are any, winding numbers as
/// the array `winding` float64.
///
/// # Errors
/// As [`crate::io::output::write_atomically`].
pub fn write_inside(path: impl AsRef<Path>, inside: &[bool], winding: Option<&[f64]>) -> Result<()> {
    let bytes: Vec<u8> = inside.iter().map(|&is_inside| u8::from(is_inside)).collect();
    let mut arrays = vec![NpyArray::of("inside", "u1", &bytes)];
    arrays.extend(winding.map(|numbers| NpyArray::of("winding", "f8", numbers)));
    write_npz(path.as_ref(), &arrays)
}

/// What is closest to points; every array has one entry per point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ClosestBatch {
    /// How far it is, world units; negative inside where signs were asked for.
    pub distance: Vec<f32>,
    /// Where it is, world units; NaN where there is none.
    pub closest: Vec<[f32; 3]>,
    /// Triangle number in file order; -1 where there is none.
    pub primitive: Vec<i32>,
    /// Barycentric weight of vertex 1.
    pub u: Vec<f32>,
    /// Barycentric weight of vertex 2.
    pub v: Vec<f32>,
}

impl ClosestBatch {
    /// Writes an `.npz` file with an array for each field. The file appears when it is complete.
    ///
    /// # Errors
    /// As [`crate::io::output::write_atomically`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let arrays = [
            NpyArray::of("distance", "f4", &self.distance),
            rows("closest", &self.closest),
            NpyArray::of("primitive", "i4", &self.primitive),
            NpyArray::of("u", "f4", &self.u),
            NpyArray::of("v", "f4", &self.v),
        ];
        write_npz(path.as_ref(), &arrays)
    }
}

fn rows<'a>(name: &'static str, rows: &'a [[f32; 3]]) -> NpyArray<'a> {
    NpyArray { columns: Some(3), ..NpyArray::of(name, "f4", rows) }
}

#[cfg(test)]
mod tests;
