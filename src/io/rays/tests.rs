//! Batches in every layout that NumPy writes, and files that are no batches.

use super::*;
use std::fs;
use std::io::{Cursor, Write};
use std::path::PathBuf;
use tempfile::TempDir;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A `.npy` array as NumPy writes it, whatever it claims.
fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let mut text = format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}");
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(data);
    bytes
}

fn f4(shape: &str, numbers: &[f32]) -> Vec<u8> {
    npy("'<f4'", false, shape, bytemuck::cast_slice(numbers))
}

fn npz_bytes(members: &[(&str, Vec<u8>)], method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        zip.start_file(*name, SimpleFileOptions::DEFAULT.compression_method(method).large_file(true)).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn saved(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rays.npz");
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read(bytes: &[u8]) -> Result<RayBatch> {
    let (_folder, path) = saved(bytes);
    RayBatch::read(path)
}

fn read_members(members: &[(&str, Vec<u8>)]) -> Result<RayBatch> {
    read(&npz_bytes(members, CompressionMethod::Stored))
}

/// The text of the error, which must be one of the input's.
fn refusal(members: &[(&str, Vec<u8>)]) -> String {
    let error = read_members(members).unwrap_err();
    assert_eq!(error.exit_code(), 3);
    assert!(matches!(error, Error::Input { .. }), "{error:?}");
    error.to_string()
}

const NUMBERS: [f32; 6] = [1.0, 2.0, 3.0, 4.0, f32::INFINITY, -0.0];
const ROWS: [[f32; 3]; 2] = [[1.0, 2.0, 3.0], [4.0, f32::INFINITY, -0.0]];

#[test]
fn a_full_batch_is_read_stored_and_deflated() {
    let members = [
        ("origin.npy", f4("(2, 3)", &NUMBERS)),
        ("direction.npy", f4("(2, 3)", &[0.5; 6])),
        ("t_min.npy", f4("(2,)", &[0.0, 1.0])),
        ("t_max.npy", f4("(2,)", &[7.0, 8.0])),
        ("next_direction.npy", f4("(2, 3)", &[-1.0; 6])),
        ("colour.npy", f4("(1,)", &[1.0])),
        ("notes.txt", b"hello".to_vec()),
    ];
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        let batch = read(&npz_bytes(&members, method)).unwrap();
        assert_eq!(batch.len(), 2);
        assert_eq!(batch.origins, ROWS);
        assert_eq!(batch.directions, [[0.5; 3]; 2]);
        assert_eq!(batch.t_min.as_deref(), Some(&[0.0, 1.0][..]));
        assert_eq!(batch.t_max.as_deref(), Some(&[7.0, 8.0][..]));
        assert_eq!(batch.next_directions.as_deref(), Some(&[[-1.0; 3]; 2][..]));
        assert_eq!(batch.ignored, ["colour", "notes.txt"]);
    }
}

#[test]
fn other_layouts_are_converted() {
    let column_major = [1.0_f32, 4.0, 2.0, f32::INFINITY, 3.0, -0.0];
    let bytes = |f: fn(f32) -> Vec<u8>, numbers: &[f32]| numbers.iter().flat_map(|&n| f(n)).collect::<Vec<u8>>();
    let cases = [
        npy("'>f4'", false, "(2, 3)", &bytes(|n| n.to_be_bytes().to_vec(), &NUMBERS)),
        npy("'<f8'", false, "(2, 3)", &bytes(|n| f64::from(n).to_le_bytes().to_vec(), &NUMBERS)),
        npy("'>f8'", false, "(2, 3)", &bytes(|n| f64::from(n).to_be_bytes().to_vec(), &NUMBERS)),
        npy("'<f4'", true, "(2, 3)", &bytes(|n| n.to_le_bytes().to_vec(), &column_major)),
        npy("'>f8'", true, "(2, 3)", &bytes(|n| f64::from(n).to_be_bytes().to_vec(), &column_major)),
    ];
    for origin in cases {
        let batch = read_members(&[("origin.npy", origin), ("direction.npy", f4("(2, 3)", &NUMBERS))]).unwrap();
        assert_eq!(batch.origins, ROWS);
        assert!(batch.origins[1][2].is_sign_negative());
    }
    let doubles: Vec<u8> = [0.1_f64, 1e300, -1e300].iter().flat_map(|n| n.to_le_bytes()).collect();
    let members = [("origin.npy", npy("'<f8'", false, "(1, 3)", &doubles)), ("direction.npy", f4("(1, 3)", &[0.0; 3]))];
    assert_eq!(read_members(&members).unwrap().origins, [[0.1, f32::INFINITY, f32::NEG_INFINITY]]);
}

#[test]
fn chunks_join_without_a_seam() {
    // Deflated zeros and a ramp are far larger than their file, so that they are read in many chunks; doubles always
    // are.
    let ramp: Vec<f32> = (0..300_000).map(|i| if i % 1000 == 999 { i as f32 } else { 0.0 }).collect();
    let doubles: Vec<u8> = ramp.iter().flat_map(|&n| f64::from(n).to_le_bytes()).collect();
    let column_major: Vec<f32> = (0..300_000).map(|i| ramp[i % 100_000 * 3 + i / 100_000]).collect();
    let members = [
        ("origin.npy", f4("(100000, 3)", &ramp)),
        ("direction.npy", npy("'<f8'", false, "(100000, 3)", &doubles)),
        ("t_min.npy", f4("(100000,)", &ramp[..100_000])),
        ("next_direction.npy", npy("'<f4'", true, "(100000, 3)", bytemuck::cast_slice(&column_major))),
    ];
    for method in [CompressionMethod::Deflated, CompressionMethod::Stored] {
        let batch = read(&npz_bytes(&members, method)).unwrap();
        assert!(batch.origins.as_flattened() == ramp && batch.directions == batch.origins, "{method}");
        assert!(batch.t_min.unwrap() == ramp[..100_000], "{method}");
        assert!(batch.next_directions.unwrap() == batch.origins, "{method}");
    }
}

#[test]
fn damage_is_found_in_every_part_of_a_large_array() {
    let zeros = vec![0.0; 300_000];
    let members = [("origin.npy", f4("(100000, 3)", &zeros)), ("direction.npy", f4("(100000, 3)", &zeros))];
    let whole = npz_bytes(&members, CompressionMethod::Stored);
    for at in [500, 600_000, 1_199_000] {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        let text = read(&bytes).unwrap_err().to_string();
        assert!(text.contains("'origin' is damaged or cut short"), "{at}: {text}");
    }
}

#[test]
fn no_rays_are_fine() {
    let empty = || f4("(0, 3)", &[]);
    let members = [("origin.npy", empty()), ("direction.npy", empty()), ("t_min.npy", f4("(0,)", &[]))];
    let batch = read_members(&members).unwrap();
    assert!(batch.is_empty() && batch.t_min == Some(vec![]) && batch.ignored.is_empty());
}

#[test]
fn what_is_wrong_with_an_array_is_named() {
    let good = || f4("(2, 3)", &NUMBERS);
    let cases: [(&str, Vec<u8>, &[&str]); 12] = [
        ("origin", f4("(3, 2)", &NUMBERS), &["'origin' has shape [3, 2], but must have [n, 3]"]),
        ("origin", f4("(6,)", &NUMBERS), &["shape [6]"]),
        ("origin", f4("(1, 2, 3)", &NUMBERS), &["shape [1, 2, 3]"]),
        ("t_max", f4("(2, 1)", &[0.0; 2]), &["'t_max' has shape [2, 1], but must have [n]"]),
        ("t_max", f4("()", &[0.0]), &["'t_max' has shape [], but"]),
        ("t_max", f4("(3,)", &[0.0; 3]), &["'origin' has 2 rays, but 't_max' has 3"]),
        ("direction", npy("'<i4'", false, "(2, 3)", &[0; 24]), &["'direction' has type '<i4', but must be float32"]),
        ("direction", npy("'<f2'", false, "(2, 3)", &[0; 12]), &["type '<f2'"]),
        ("direction", npy("'|O'", false, "(2, 3)", &[0; 24]), &["type '|O'"]),
        ("direction", npy("[('x', '<f4')]", false, "(2, 3)", &[0; 24]), &["type [('x', '<f4')"]),
        ("direction", f4("(2, 3)", &NUMBERS[..5]), &["should have 24 bytes by its shape, but has 20"]),
        ("direction", f4("(1, 3)", &NUMBERS), &["should have 12 bytes", "has 24"]),
    ];
    for (name, bytes, messages) in cases {
        let file = format!("{name}.npy");
        let mut members = vec![("origin.npy", good()), ("direction.npy", good())];
        members.retain(|(n, _)| *n != file);
        members.push((&file, bytes));
        let text = refusal(&members);
        assert!(text.contains("rays.npz") && messages.iter().all(|m| text.contains(m)), "{text}");
    }
}

#[test]
fn missing_arrays_are_named_with_what_is_there() {
    let good = || f4("(2, 3)", &NUMBERS);
    let text = refusal(&[("origins.npy", good()), ("direction.npy", good())]);
    assert!(text.contains("no array 'origin'") && text.contains("it has origins, direction"), "{text}");
    assert!(refusal(&[("origin.npy", good())]).contains("no array 'direction'"));
    assert!(refusal(&[]).contains("it is empty"));
}

#[test]
fn hostile_headers_are_refused_without_panic_or_memory() {
    let claim =
        |shape: &str| refusal(&[("origin.npy", f4(shape, &NUMBERS)), ("direction.npy", f4("(2, 3)", &NUMBERS))]);
    assert!(claim("(1000000000000, 3)").contains("should have 12000000000000 bytes"));
    assert!(claim("(99999999999999999999, 3)").contains("not one of a plain array"));
    assert!(claim("(4294967296, 4294967296, 4294967296)").contains("not one of a plain array"));
    assert!(claim(&"(".repeat(9_000)).contains("not one of a plain array"));
    assert!(claim("(-2, 3)").contains("damaged"));
    assert!(claim("'no'").contains("damaged"));
    let raw = |bytes: &[u8]| refusal(&[("origin.npy", bytes.to_vec()), ("direction.npy", vec![])]);
    assert!(raw(b"").contains("damaged or cut short"));
    assert!(raw(b"NUMPY, or not, and some more").contains("does not begin like an array"));
    assert!(raw(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{").contains("header is too long"));
    assert!(raw(b"\x93NUMPY\x09\x00\x01\x00\x00\x00{").contains("damaged"));
}

#[test]
fn files_that_are_no_npz_are_refused() {
    let good = || f4("(2, 3)", &NUMBERS);
    let whole = npz_bytes(&[("origin.npy", good()), ("direction.npy", good())], CompressionMethod::Deflated);
    // Wherever the file is cut, or whichever byte is flipped, an error is told or the batch is right; never a panic.
    for length in 0..whole.len() {
        assert!(matches!(read(&whole[..length]).unwrap_err(), Error::Input { .. }), "cut at {length}");
    }
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x41;
        if let Ok(batch) = read(&bytes) {
            assert_eq!(batch.origins, ROWS, "byte {at}");
        }
    }
    assert!(read(&good()).unwrap_err().to_string().contains("numpy.savez"));
    assert!(read(b"hello").unwrap_err().to_string().contains("no .npz file"));
}

#[test]
fn a_wrong_checksum_is_told() {
    let good = || f4("(2, 3)", &NUMBERS);
    let mut bytes = npz_bytes(&[("origin.npy", good()), ("direction.npy", good())], CompressionMethod::Stored);
    let at = bytes.windows(4).position(|w| w == 4.0_f32.to_le_bytes()).unwrap();
    bytes[at] ^= 1;
    let text = read(&bytes).unwrap_err().to_string();
    assert!(text.contains("'origin' is damaged"), "{text}");
}

#[test]
fn a_giant_member_that_is_not_there_costs_nothing() {
    // A deflated member that claims 12 TB: the sizes in the ZIP and the array agree, the data ends at once.
    let giant = f4("(1000000000000, 3)", &NUMBERS);
    let claimed = giant.len() as u64 - 24 + 12_000_000_000_000;
    let real = (giant.len() as u64).to_le_bytes();
    let mut bytes = npz_bytes(&[("origin.npy", giant), ("direction.npy", vec![])], CompressionMethod::Deflated);
    // ZIP64 fields hold the size as u64 in the local header and, here, u32 in the central one; write what fits there.
    let mut patched = 0;
    for at in 0..bytes.len() - 8 {
        if bytes[at..at + 8] == real {
            bytes[at..at + 8].copy_from_slice(&claimed.to_le_bytes());
            patched += 1;
        }
    }
    let result = read(&bytes);
    assert!(patched > 0 && matches!(result, Err(Error::Input { .. })), "{patched} {result:?}");
}

#[test]
fn missing_files_and_folders_are_errors_of_the_system() {
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().join("none.npz"), folder.path().to_owned()] {
        let error = RayBatch::read(path).unwrap_err();
        assert!(matches!(error, Error::Io { action: "read", .. }), "{error:?}");
        assert_eq!(error.exit_code(), 3);
    }
}

#[test]
fn what_the_writer_writes_the_reader_reads() {
    let (_folder, path) = saved(b"old");
    let batch = RayBatch {
        origins: ROWS.to_vec(),
        directions: vec![[0.5; 3]; 2],
        t_max: Some(vec![f32::INFINITY, -0.0]),
        ..RayBatch::default()
    };
    batch.write(&path).unwrap();
    assert_eq!(RayBatch::read(&path).unwrap(), batch);
    let mut file = NpzFile::open(&path, MemoryBudget::UNLIMITED).unwrap();
    assert!(file.read_rows::<1>("none").unwrap().is_none());
}
