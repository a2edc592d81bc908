//! Journals that were cut off, damaged, or written by others.

use super::*;
use crate::random::Random;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

/// A journal of some records, and where each begins.
fn written(path: &Path) -> (Vec<Vec<u8>>, Vec<u64>) {
    let mut random = Random::new(7);
    let mut records = vec![b"{\"what\": \"a test\"}".to_vec()];
    let mut journal = Journal::create(path, &records[0]).unwrap();
    let mut begins = vec![MAGIC.len() as u64];
    for length in [0, 1, 4, 5000, 70_000] {
        let payload: Vec<u8> = (0..length).map(|_| random.below(256) as u8).collect();
        begins.push(journal.end);
        let (front, back) = payload.split_at(length / 3);
        journal.append(&[front, back]).unwrap();
        records.push(payload);
    }
    begins.push(journal.end);
    (records, begins)
}

fn read_all(path: &Path) -> (Vec<Vec<u8>>, Condition) {
    let mut records = Vec::new();
    let condition = read(path, |record| {
        records.push(record.to_vec());
        Ok(())
    });
    (records, condition.unwrap())
}

#[test]
fn what_is_appended_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let (mut records, _) = written(&path);
    assert_eq!(read_all(&path), (records.clone(), Condition { cut_bytes: 0, damaged_bytes: 0 }));
    assert!(is_journal(&path));
    let (mut journal, _) = Journal::open(&path, |_| Ok(())).unwrap();
    journal.append(&[b"more"]).unwrap();
    records.push(b"more".to_vec());
    assert_eq!(read_all(&path).0, records);
    journal.remove().unwrap();
    assert!(!path.exists());
}

#[test]
fn a_record_that_is_cut_off_is_left_out_and_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let (records, begins) = written(&path);
    let bytes = std::fs::read(&path).unwrap();
    for cut in (17..bytes.len()).step_by(997).chain(begins.iter().flat_map(|&at| [at as usize + 1, at as usize])) {
        if cut > bytes.len() {
            continue;
        }
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let whole = begins.iter().filter(|&&begin| begin <= cut as u64).count() - 1;
        let (read, condition) = read_all(&path);
        assert_eq!(read, records[..whole], "cut at {cut}");
        assert_eq!(condition.cut_bytes, cut as u64 - begins[whole], "cut at {cut}");
        let (mut journal, _) = Journal::open(&path, |_| Ok(())).unwrap();
        journal.append(&[b"x"]).unwrap();
        let (read, condition) = read_all(&path);
        assert_eq!((read.len(), read.last().unwrap().as_slice()), (whole + 1, &b"x"[..]));
        assert_eq!(condition, Condition { cut_bytes: 0, damaged_bytes: 0 });
    }
}

#[test]
fn damaged_records_are_left_out_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let (records, begins) = written(&path);
    let bytes = std::fs::read(&path).unwrap();
    let mut random = Random::new(3);
    for round in 0..300 {
        let mut damaged = bytes.clone();
        let at = MAGIC.len() + random.below(bytes.len() - MAGIC.len());
        damaged[at] ^= 1 << (round % 8);
        std::fs::write(&path, &damaged).unwrap();
        let hurt = begins.iter().filter(|&&begin| begin <= at as u64).count() - 1;
        let mut expected = records.clone();
        expected.remove(hurt);
        let (read, condition) = read_all(&path);
        assert_eq!(read, expected, "byte {at}");
        assert_eq!(condition.damaged_bytes + condition.cut_bytes, begins[hurt + 1] - begins[hurt]);
    }
}

/// The last record is brought to the disk although none follows, and a disk that did not take one is told of.
#[test]
fn the_disk_takes_every_record_soon() {
    const LONG: Duration = Duration::from_secs(60);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let mut journal = Journal::create(&path, b"header").unwrap();
    let (syncs, synced) = channel();
    // What the file had when the disk was called for; the second call and all later ones fail.
    let file = journal.reader().unwrap();
    let sync = move || {
        let bytes = file.metadata()?.len();
        let is_first = bytes == PREFIX_BYTES * 3 + MAGIC.len() as u64 + 6 + 3 + 4;
        let _ = syncs.send(bytes); // at the end nobody listens
        if is_first { Ok(()) } else { Err(io::Error::other("the disk is gone")) }
    };
    journal.syncer = Syncer::with_times(sync, Duration::from_millis(50), LONG);
    journal.append(&[b"one"]).unwrap();
    journal.append(&[b"more"]).unwrap();
    assert_eq!(synced.recv_timeout(LONG).unwrap(), journal.end);
    journal.append(&[b"last"]).unwrap();
    let end = journal.end;
    assert_eq!(synced.recv_timeout(LONG).unwrap(), end);
    let message = format!("{:?}", journal.sync().unwrap_err());
    assert!(message.contains("the disk is gone") && message.contains("a.partial"), "{message}");
    journal.remove().unwrap();
}

/// Every sixteen bytes of a file say that the rest of it is a record.
#[test]
fn records_that_are_none_take_no_time() {
    const COUNT: u64 = 1 << 18;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    Journal::create(&path, b"header").unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    for left in (0..COUNT).rev() {
        bytes.extend([&RECORD[..], b"none", &(PREFIX_BYTES * left).to_le_bytes()].concat());
    }
    std::fs::write(&path, &bytes).unwrap();
    let started = Instant::now();
    let (records, condition) = read_all(&path);
    assert_eq!((records, condition.cut_bytes), (vec![b"header".to_vec()], PREFIX_BYTES * COUNT));
    assert!(started.elapsed().as_secs() < 20, "{:?}", started.elapsed());
}

#[test]
fn other_files_are_no_journals_and_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    for text in [&b""[..], b"raybrook journa", b"\x89PNG and so on and on"] {
        std::fs::write(&path, text).unwrap();
        let message = Journal::open(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(message.contains("a.png") && message.contains("not a journal"), "{message}");
        assert!(Journal::create(&path, b"").is_err() && !is_journal(&path));
        assert_eq!(std::fs::read(&path).unwrap(), text);
    }
}

#[test]
fn what_has_no_whole_header_is_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let (_, begins) = written(&path);
    let whole = std::fs::read(&path).unwrap();
    for cut in 0..begins[1] as usize {
        std::fs::write(&path, &whole[..cut]).unwrap();
        remove_unbegun(&path).unwrap();
        assert!(!path.exists(), "cut at {cut}");
    }
    remove_unbegun(&path).unwrap(); // there is none
    // A header alone; a damaged one, with work behind it; a long file of nothing; and what is no journal.
    let mut damaged = whole.clone();
    damaged[20] ^= 1;
    let nothing = [&MAGIC[..], &[0; LARGEST_HEADER as usize]].concat();
    for kept in [&whole[..begins[1] as usize], &damaged, &nothing, b"raybrook journe", b"ray tracing"] {
        std::fs::write(&path, kept).unwrap();
        remove_unbegun(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), kept);
    }
    std::fs::create_dir(folder.path().join("b.partial")).unwrap();
    remove_unbegun(&folder.path().join("b.partial")).unwrap();
    assert!(folder.path().join("b.partial").is_dir());
}

#[cfg(unix)]
#[test]
fn one_program_at_a_time_appends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let first = Journal::create(&path, b"x").unwrap();
    let error = Journal::open(&path, |_| Ok(())).unwrap_err();
    assert!(format!("{error:?}").contains("another run") && error.exit_code() == 5, "{error:?}");
    // Nor is one taken away whose header is not there yet.
    first.file.set_len(3).unwrap();
    assert_eq!(remove_unbegun(&path).unwrap_err().exit_code(), 5);
    assert!(path.exists());
    drop(first);
    remove_unbegun(&path).unwrap();
    Journal::create(&path, b"x").unwrap();
    Journal::open(&path, |_| Ok(())).unwrap();
}
