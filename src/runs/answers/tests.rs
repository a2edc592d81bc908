//! Files of answers, byte for byte.

use super::*;
use std::fs;
use std::io::{Read, Write};
use tempfile::TempDir;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

const MISS: Hit = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: u32::MAX };

fn sample() -> Answers {
    Answers { hits: vec![Hit { t: 1.5, u: 0.25, v: 0.5, primitive: 7 }, MISS], ..Answers::default() }
}

/// A file of answers, in a folder that is removed with it.
struct Written {
    folder: TempDir,
}

impl Written {
    fn new(pieces: &[Answers], asked: Asked, has_second: bool, work: CountedWork) -> Written {
        let written = Written { folder: tempfile::tempdir().unwrap() };
        write_answers(&written.path(), pieces, (asked, has_second), work).unwrap();
        written
    }

    fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("hits.npz")
    }

    fn bytes(&self) -> Vec<u8> {
        fs::read(self.path()).unwrap()
    }

    fn names(&self) -> Vec<String> {
        let archive = ZipArchive::new(fs::File::open(self.path()).unwrap()).unwrap();
        archive.file_names().map(|name| name.unwrap().into_owned()).collect()
    }

    fn member(&self, name: &str) -> Vec<u8> {
        let mut archive = ZipArchive::new(fs::File::open(self.path()).unwrap()).unwrap();
        let mut bytes = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    }
}

#[test]
fn hits_are_written_byte_for_byte_as_numpy_does() {
    let write = || Written::new(&[sample()], Asked::Closest, false, [None; 2]);
    let written = write();
    assert_eq!(written.names(), ["t.npy", "primitive.npy", "u.npy", "v.npy"]);
    let bytes = written.member("t.npy");
    let header = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }";
    assert_eq!(&bytes[..header.len()], header);
    assert!(bytes[header.len()..127].iter().all(|&b| b == b' ') && bytes[127] == b'\n');
    assert_eq!(&bytes[128..], [1.5_f32.to_le_bytes(), f32::INFINITY.to_le_bytes()].as_flattened());
    let bytes = written.member("primitive.npy");
    assert!(bytes.windows(5).any(|w| w == b"'<i4'"));
    assert_eq!(&bytes[128..], [7_i32.to_le_bytes(), (-1_i32).to_le_bytes()].as_flattened());
    assert_eq!(written.bytes(), write().bytes());
}

#[test]
fn what_else_is_asked_for_is_written_and_nothing_of_no_rays() {
    let any = Written::new(&[sample()], Asked::Any, false, [None; 2]);
    let bytes = any.member("hit.npy");
    assert!(bytes.windows(5).any(|w| w == b"'|u1'"));
    assert_eq!(&bytes[bytes.len() - 2..], [1, 0]);
    let with_next = Answers { next_hits: vec![Hit { t: 2.0, ..MISS }, Hit { primitive: 3, ..MISS }], ..sample() };
    let written = Written::new(&[with_next], Asked::Closest, true, [None; 2]);
    assert_eq!(written.names()[4..], ["next_t.npy", "next_primitive.npy"]);
    assert_eq!(&written.member("next_t.npy")[128..132], 2.0_f32.to_le_bytes());
    assert_eq!(&written.member("next_primitive.npy")[132..], 3_i32.to_le_bytes());

    let mut work = RayWork::default();
    work.count(WorkCounter::Tests, 513);
    let written = Written::new(&[sample()], Asked::Closest, false, [Some(&[work; 2]), Some(&[])]);
    let names = written.names();
    assert_eq!(names.len(), 4 + 2 * WorkCounter::ALL.len());
    assert_eq!(names[4..7], ["work_steps.npy", "work_leaves.npy", "work_empty_leaves.npy"]);
    assert_eq!(names.last().unwrap(), "next_work_deepest_stack.npy");
    let bytes = written.member("work_tests.npy");
    assert!(bytes.windows(5).any(|w| w == b"'<u4'"));
    assert_eq!(&bytes[bytes.len() - 8..], [1, 2, 0, 0, 1, 2, 0, 0]);

    let bytes = Written::new(&[], Asked::Closest, false, [None; 2]).member("u.npy");
    assert!(bytes.windows(4).any(|w| w == b"(0,)") && bytes.len() == 128);
}

#[test]
fn lists_and_counts_have_arrays_of_their_own() {
    let list = Answers { counts: vec![0, 2], ..sample() };
    let written = Written::new(&[list.clone(), list], Asked::All(2), false, [None; 2]);
    assert_eq!(written.names(), ["count.npy", "t.npy", "primitive.npy", "u.npy", "v.npy"]);
    assert_eq!(&written.member("count.npy")[128..], bytemuck::cast_slice::<u32, u8>(&[0, 2, 0, 2]));
    assert_eq!(written.member("v.npy").len(), 128 + 4 * 4);
    for asked in [Asked::Count, Asked::Crossings] {
        let counts = Answers { counts: vec![5], ..Answers::default() };
        assert_eq!(Written::new(&[counts], asked, false, [None; 2]).names(), ["count.npy"]);
    }
}

#[test]
fn many_pieces_make_the_bytes_that_one_core_writes_in_one_go() {
    // More than is made at a time, in pieces whose ends are none of the parts' ends; and some that have nothing.
    const LENGTHS: [usize; 6] = [1_000_003, 0, 1, 1_500_000, 77_777, 0];
    let hit = |i: usize| Hit {
        t: i as f32,
        u: 0.5 / i as f32,
        v: -0.0,
        primitive: if i.is_multiple_of(3) { u32::MAX } else { i as u32 },
    };
    let mut count = 0;
    let pieces = LENGTHS.map(|length| {
        let hits: Vec<Hit> = (count..count + length).map(hit).collect();
        count += length;
        Answers { hits, ..Answers::default() }
    });
    let written = Written::new(&pieces, Asked::Any, false, [None; 2]);
    let all: Vec<Hit> = pieces.iter().flat_map(|piece| &piece.hits).copied().collect();
    let data: [Vec<u8>; 5] = [
        all.iter().flat_map(|hit| hit.t.to_ne_bytes()).collect(),
        all.iter().flat_map(|hit| (hit.primitive as i32).to_ne_bytes()).collect(),
        all.iter().flat_map(|hit| hit.u.to_ne_bytes()).collect(),
        all.iter().flat_map(|hit| hit.v.to_ne_bytes()).collect(),
        all.iter().map(|hit| u8::from(is_hit(hit))).collect(),
    ];
    let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, data) in ["t.npy", "primitive.npy", "u.npy", "v.npy", "hit.npy"].into_iter().zip(data) {
        let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored);
        zip.start_file(name, options).unwrap();
        zip.write_all(&written.member(name)[..128]).unwrap();
        zip.write_all(&data).unwrap();
    }
    assert!(written.bytes() == zip.finish().unwrap().into_inner());
}
