//! Rays and points in NumPy archives.

use super::errors::readable;
use super::folder::Folder;
use super::models::archive;
use super::pieces;
use raybrook::low_level::rays::{RayBatch, read_points};

const ARRAYS: [&str; 5] = ["origin.npy", "direction.npy", "t_min.npy", "t_max.npy", "next_direction.npy"];

/// An archive; an input that is none is the arrays in one, one after the other. Rays that could be read are the same
/// when they are written and read again.
pub fn npz(data: &[u8]) -> bool {
    let archive = match data.starts_with(b"PK") {
        true => data.to_vec(),
        false => archive(&ARRAYS.into_iter().zip(pieces(data)).collect::<Vec<_>>()),
    };
    let path = Folder.write("rays.npz", &archive);
    readable(read_points(&path, &Folder.budget()));
    let Some(rays) = readable(RayBatch::read_within(&path, &Folder.budget())) else { return false };
    let again = Folder.path("again.npz");
    rays.write(&again).expect("rays that were read can be written");
    let found = RayBatch::read_within(&again, &Folder.budget()).expect("what was written can be read");
    assert!(bits(&found) == bits(&rays) && found.ignored.is_empty());
    true
}

/// The bits of all numbers, of which NaNs are as good as others, and how long each array is.
fn bits(rays: &RayBatch) -> Vec<Option<Vec<u32>>> {
    let of_vectors = |vectors: &[[f32; 3]]| vectors.as_flattened().iter().map(|x| x.to_bits()).collect();
    let of_numbers = |numbers: &Vec<f32>| numbers.iter().map(|x| x.to_bits()).collect();
    vec![
        Some(of_vectors(&rays.origins)),
        Some(of_vectors(&rays.directions)),
        rays.t_min.as_ref().map(of_numbers),
        rays.t_max.as_ref().map(of_numbers),
        rays.next_directions.as_deref().map(of_vectors),
    ]
}
