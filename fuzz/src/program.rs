//! What the program alone reads, because it has written it: journals of stress tests, and what the frames of a
//! turntable are of. As in `lib.rs`; `tests/cli/fuzzed.rs` tries the inputs that are kept.

#[path = "errors.rs"]
mod errors;
#[path = "records.rs"]
mod records;
#[path = "target.rs"]
mod target;

use errors::readable;
use raybrook_cli::fuzzed::{Frames, Manifest, ToMake, append, create, read_kept};
use records::write_journal;
use std::path::{Path, PathBuf};
use target::Target;

/// These targets by their names.
pub const TARGETS: [(&str, Target); 2] =
    [("stress_journal", stress_journal), ("turntable_manifest", turntable_manifest)];

const WHY: &str = "the temporary folder can be written";

/// The journal of a stress test. What is in it is the same when it is appended to another journal.
pub fn stress_journal(data: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect(WHY);
    let [path, again] = ["input", "again"].map(|name| folder.path().join(name));
    write_journal(&path, data);
    let Some(found) = readable(read_kept(&path)) else { return false };
    let mut journal = create(&again, &found.id).expect(WHY);
    found.cells.values().for_each(|cell| append(&mut journal, cell).expect(WHY));
    drop(journal);
    assert_eq!(read_kept(&again).expect("it was just written"), found);
    true
}

/// What the frames of a turntable are of. Whatever it says of their files: once those are made that it finds damaged,
/// none is to be made; one that is cut off then is, and no other.
pub fn turntable_manifest(data: &[u8]) -> bool {
    const COUNT: u32 = 3;
    let folder = tempfile::tempdir().expect(WHY);
    let frames = Frames::of(folder.path(), COUNT).expect("a folder");
    let write = |frame: u32| std::fs::write(frames.path(frame), format!("frame {frame}")).expect(WHY);
    (1..=COUNT).for_each(write);
    std::fs::write(frames.manifest(), data).expect(WHY);
    let nothing = |_: &Path| Vec::<PathBuf>::new();
    let Some(manifest) = Manifest::of_frames(&frames).expect("it can be read") else { return false };
    let to_make = |expected: Option<&[u32]>| {
        let mut kept = manifest.clone().take_over(&frames, false, nothing).expect("it is of this turntable");
        let ToMake { frames: found, damaged } = kept.to_make(&frames, nothing, |_| ()).expect("all can be read");
        assert!(found.iter().map(|&frame| frames.path(frame)).eq(damaged), "all are there");
        expected.inspect(|expected| assert_eq!(found, *expected));
        let files: Vec<PathBuf> = found.iter().map(|&frame| frames.path(frame)).collect();
        found.iter().copied().for_each(write);
        kept.note(&files).expect(WHY);
    };
    to_make(None);
    to_make(Some(&[]));
    std::fs::write(frames.path(2), "frame").expect(WHY);
    to_make(Some(&[2]));
    to_make(Some(&[]));
    manifest.take_over(&frames, true, nothing).expect("frames can be removed");
    assert!(!frames.any());
    true
}
