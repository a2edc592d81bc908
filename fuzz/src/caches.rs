//! What the program keeps between its runs: compiled kernels, and what `raybrook tune` found.

use super::folder::Folder;
use raybrook::low_level::choose::SceneSize;
use raybrook::low_level::choose::tune::{Candidate, DeviceKey, TunedFile, Tuning};
use raybrook::low_level::device::{Cache, CacheKey};
use raybrook::low_level::options::{PacketSize, StructureKind};
use std::path::PathBuf;

/// Some triangle counts of scenes of every size.
const TRIANGLES: [usize; 4] = [1, 1000, 50_000, 10_000_000];

/// What was found to be fastest. It is used or a note says why not; and a measurement takes its place.
pub fn tuned(data: &[u8]) -> bool {
    let file = TunedFile::in_folder(Folder.path("").as_path());
    std::fs::write(file.path(), data).expect("the temporary folder can be written");
    let key = DeviceKey::new(None);
    let found = TRIANGLES.iter().filter_map(|&count| file.find(&key, count).ok()?);
    let is_used = found.filter(|found| !found.reason.is_empty()).count() > 0;
    let kd = Candidate { structure: StructureKind::Kd, packet_size: PacketSize::One };
    let size = SceneSize::of(TRIANGLES[0]);
    let tuning = Tuning { size, fastest: kd, ratio: 1.5, model: kd, triangle_counts: vec![1] };
    file.remember(&key, &[tuning]).expect("a damaged file is replaced");
    let found = file.find(&key, TRIANGLES[0]).expect("it was just written").expect("it was remembered");
    assert_eq!(found.structure, StructureKind::Kd);
    is_used
}

/// Compiled kernels: an input in place of a file is none of them, and one that was stored comes back, until any byte of
/// its file changes.
pub fn kernel_cache(data: &[u8]) -> bool {
    let folder = Folder.path("kernels");
    let _ = std::fs::remove_dir_all(&folder); // mostly it is there
    let cache = Cache::at(&folder);
    let key = CacheKey::of_parts(&["a source", "its options"]);
    cache.store(&key, data).expect("the temporary folder can be written");
    assert_eq!(cache.load(&key).expect("it was just stored").as_deref(), Some(data));
    let path = only_file(&folder);
    let mut bytes = std::fs::read(&path).expect("it was just written");
    let at = data.iter().fold(data.len(), |sum, &byte| sum.wrapping_mul(31).wrapping_add(byte.into())) % bytes.len();
    bytes[at] ^= 1;
    for damaged in [&bytes[..], &bytes[..at], data] {
        std::fs::write(&path, damaged).expect("the temporary folder can be written");
        assert!(cache.load(&key).is_err(), "{} bytes, the one at {at} changed", damaged.len());
    }
    true
}

fn only_file(folder: &std::path::Path) -> PathBuf {
    let mut files = std::fs::read_dir(folder).expect("the folder was made");
    files.next().expect("a file was stored").expect("the folder can be read").path()
}
