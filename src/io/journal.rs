//! Journals: files that long work is kept in, piece by piece, so that what is done survives whatever ends the program.
//!
//! A journal begins with a header, which tells what work it is of; each piece of work that is finished is a record
//! behind it. Records are appended and never changed. A record that was cut off, as by a full disk or a power failure,
//! or that the disk has damaged, is found by its checksum and left out when the journal is read: its work is done
//! again.
//!
//! ```text
//! bytes  0..16  "raybrook journal"
//!       16..    records; the first one is the header
//! record  0..4  "rec\n"
//!         4..8  CRC-32 of what follows, little endian
//!        8..16  bytes of the payload, little endian
//!        16..   the payload
//! ```

mod syncer;

use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use syncer::Syncer;

/// The first byte of a header; records of work begin with others.
pub const HEADER: u8 = b'H';

const MAGIC: &[u8; 16] = b"raybrook journal";
const RECORD: &[u8; 4] = b"rec\n";
const PREFIX_BYTES: u64 = 16;

/// A journal that can be appended to. One program at a time has it.
///
/// Of what was appended the work of a second is lost at the most where the machine fails. Where only the program ends,
/// nothing is.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Where the next record begins.
    end: u64,
    syncer: Syncer,
}

/// What a journal had when it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condition {
    /// Bytes at its end that are no whole record: something was being written when the program ended. They are
    /// overwritten by what is appended.
    pub cut_bytes: u64,
    /// Bytes between records that are none: the disk has damaged them.
    pub damaged_bytes: u64,
}

/// A whole record of a journal.
#[derive(Debug, Clone, Copy)]
pub struct Record<'a> {
    /// What is in it.
    pub payload: &'a [u8],
    /// Where that lies, in bytes from the file's beginning.
    pub place: u64,
}

impl Journal {
    /// A new journal with this header.
    ///
    /// # Errors
    /// [`Error::Io`] with action "create" when there is a file at `path` or none can be made, and "write".
    pub fn create(path: &Path, header: &[u8]) -> Result<Journal> {
        let new = File::options().read(true).write(true).create_new(true).open(path);
        let file = new.map_err(|error| Error::io("create", path, error))?;
        let begun = Journal::of(path, file, MAGIC.len() as u64).and_then(|mut journal| {
            journal.begin(header)?;
            Ok(journal)
        });
        match begun {
            Ok(journal) => Ok(journal),
            Err(error) => {
                // What has no header is no journal, and nobody could go on with it.
                let _ = std::fs::remove_file(path);
                Err(error)
            }
        }
    }

    /// The journal in `file`, whose next record begins at `end`.
    fn of(path: &Path, file: File, end: u64) -> Result<Journal> {
        let same = file.try_clone().map_err(|error| Error::io("write", path, error))?;
        Ok(Journal { path: path.to_owned(), file, end, syncer: Syncer::new(move || same.sync_data()) })
    }

    fn begin(&mut self, header: &[u8]) -> Result<()> {
        lock(&self.file, &self.path)?;
        self.file.write_all(MAGIC).map_err(|error| Error::io("write", &self.path, error))?;
        self.write(&[header])?;
        self.sync()
    }

    /// Opens a journal to append to it. `take` gets the payload of every whole record, the header first; where it
    /// fails, the journal is left as it is.
    ///
    /// # Errors
    /// [`Error::Io`] with action "read", or "write" when another program has it; [`Error::Input`] when the file is no
    /// journal; and those of `take`.
    pub fn open(path: &Path, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<(Journal, Condition)> {
        Self::open_placed(path, |record| take(record.payload))
    }

    /// As [`Journal::open`]; `take` is told, too, where the payload lies.
    ///
    /// # Errors
    /// As there.
    pub fn open_placed(path: &Path, take: impl FnMut(&Record) -> Result<()>) -> Result<(Journal, Condition)> {
        let file = File::options().read(true).write(true).open(path).map_err(|error| Error::io("read", path, error))?;
        lock(&file, path)?;
        let (end, condition) = read_records(&file, path, take)?;
        Ok((Journal::of(path, file, end)?, condition))
    }

    /// A new journal whose header is this, as JSON.
    ///
    /// # Errors
    /// As [`Journal::create`].
    pub fn create_for(path: &Path, header: &impl Serialize) -> Result<Journal> {
        Journal::create(path, &[&[HEADER], &json(path, header)?[..]].concat())
    }

    /// What a record of work begins with: its first byte, and what [`entry_of`] reads. Numbers may follow.
    ///
    /// # Errors
    /// [`Error::Io`] when the entry cannot be written as JSON.
    pub fn begin_record(&self, first: u8, entry: &impl Serialize) -> Result<Vec<u8>> {
        let entry = json(&self.path, entry)?;
        Ok([&[first], &(entry.len() as u32).to_le_bytes()[..], &entry].concat())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the payload of the next record will lie, in bytes from the file's beginning.
    pub fn next_place(&self) -> u64 {
        self.end + PREFIX_BYTES
    }

    /// The file, to read in.
    ///
    /// # Errors
    /// [`Error::Io`] with action "read".
    pub fn reader(&self) -> Result<File> {
        self.file.try_clone().map_err(|error| Error::io("read", &self.path, error))
    }

    /// Appends a record whose payload is `parts` one after the other. Where that fails, the journal has the records
    /// that it had before.
    ///
    /// # Errors
    /// [`Error::Io`] with action "write", also where the disk has not taken what was appended before.
    pub fn append(&mut self, parts: &[&[u8]]) -> Result<()> {
        self.syncer.before_append().map_err(|error| Error::io("write", &self.path, error))?;
        self.write(parts)?;
        self.syncer.appended();
        Ok(())
    }

    fn write(&mut self, parts: &[&[u8]]) -> Result<()> {
        let length = parts.iter().map(|part| part.len() as u64).sum::<u64>();
        let mut checksum = crc32fast::Hasher::new();
        checksum.update(&length.to_le_bytes());
        parts.iter().for_each(|part| checksum.update(part));
        let (checksum, length) = (checksum.finalize().to_le_bytes(), length.to_le_bytes());
        let mut write = || {
            self.file.seek(SeekFrom::Start(self.end))?;
            [RECORD, &checksum[..], &length[..]].iter().chain(parts).try_for_each(|part| self.file.write_all(part))?;
            // What was cut off here before may have been longer.
            self.file.set_len(self.end + PREFIX_BYTES + u64::from_le_bytes(length))
        };
        if let Err(error) = write() {
            // The next reader leaves out what is no whole record anyway.
            let _ = self.file.set_len(self.end);
            return Err(Error::io("write", &self.path, error));
        }
        self.end += PREFIX_BYTES + u64::from_le_bytes(length);
        Ok(())
    }

    /// Has the disk take what was appended.
    ///
    /// # Errors
    /// [`Error::Io`] with action "write", also where the disk has not taken something of it before.
    pub fn sync(&mut self) -> Result<()> {
        self.syncer.sync().map_err(|error| Error::io("write", &self.path, error))
    }

    /// Removes the journal: its work is done.
    ///
    /// # Errors
    /// [`Error::Io`] with action "remove".
    pub fn remove(self) -> Result<()> {
        self.syncer.forget();
        std::fs::remove_file(&self.path).map_err(|error| Error::io("remove", &self.path, error))
    }
}

/// Reads a journal without appending to it. `take` gets the payload of every whole record, the header first.
///
/// # Errors
/// As [`Journal::open`].
pub fn read(path: &Path, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<Condition> {
    read_placed(path, |record| take(record.payload))
}

/// As [`read`]; `take` is told, too, where the payload lies.
///
/// # Errors
/// As there.
pub fn read_placed(path: &Path, take: impl FnMut(&Record) -> Result<()>) -> Result<Condition> {
    let file = File::open(path).map_err(|error| Error::io("read", path, error))?;
    read_records(&file, path, take).map(|(_, condition)| condition)
}

/// What the work is that a journal keeps. Its header tells that: a byte, and a JSON object with a key of this name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// A picture, or a part of one.
    Picture,
    /// A batch of rays, or a part of one.
    Batch,
    /// A stress test.
    Stress,
}

impl Subject {
    const ALL: [Subject; 3] = [Subject::Picture, Subject::Batch, Subject::Stress];

    fn key(self) -> &'static str {
        match self {
            Subject::Picture => "picture",
            Subject::Batch => "batch",
            Subject::Stress => "stress",
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Subject::Picture => "a picture",
            Subject::Batch => "a batch of rays",
            Subject::Stress => "a stress test",
        }
    }

    /// By a header without its first byte.
    fn of(header: &[u8]) -> Option<Subject> {
        let header: serde_json::Value = serde_json::from_slice(header).ok()?;
        Subject::ALL.into_iter().find(|subject| header.get(subject.key()).is_some())
    }

    /// What the journal at `path` keeps; `None` where it does not say.
    ///
    /// # Errors
    /// As [`read`].
    pub fn of_journal(path: &Path) -> Result<Option<Subject>> {
        let file = File::open(path).map_err(|error| Error::io("read", path, error))?;
        let (mut reader, length) = after_magic(&file, path)?;
        let mut header = Vec::new();
        let is_whole = read_record(&mut reader, length - MAGIC.len() as u64, &mut header);
        let is_whole = is_whole.map_err(|error| Error::io("read", path, error))?;
        Ok(header.split_first().filter(|_| is_whole).and_then(|(_, header)| Subject::of(header)))
    }

    /// Why a header, without its first byte, is none of a journal of this subject.
    pub fn refusal(self, header: &[u8], error: &serde_json::Error) -> String {
        match Subject::of(header).filter(|&found| found != self) {
            Some(found) => format!("the journal is of {}, not of {}", found.name(), self.name()),
            None => {
                format!("a journal of another version of raybrook ({error}); finish it with that one, or remove it")
            }
        }
    }
}

fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec(value).map_err(|error| Error::io("write", path, error.into()))
}

/// The entry that a record of work has behind its first byte, and the bytes behind it.
///
/// # Errors
/// [`Error::Input`] when it has none of this kind.
pub fn entry_of<'r, T: DeserializeOwned>(path: &Path, rest: &'r [u8]) -> Result<(T, &'r [u8])> {
    let split = || {
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let (entry, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        Some((serde_json::from_slice(entry).ok()?, rest))
    };
    split().ok_or_else(|| wrong_record(path))
}

/// The error of a record whose content does not fit together.
pub fn wrong_record(path: &Path) -> Error {
    Error::input(path, None, "a record of the journal does not hold what it says")
}

/// The error of a journal of which nobody knows what is in it.
pub fn no_header(path: &Path) -> Error {
    Error::input(path, None, "the journal's header is damaged or missing; remove the file to begin anew")
}

/// Whether `path` is a journal.
pub fn is_journal(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok() && magic == *MAGIC
}

/// Removes the file at `path` if it is a journal whose program ended before its header was whole, so that nothing is in
/// it: an empty file, or the first bytes of one. Other files are left alone.
///
/// # Errors
/// [`Error::Io`] with action "write" when another program is about to write it, and "remove".
pub fn remove_unbegun(path: &Path) -> Result<()> {
    // What cannot be read or written, whoever opens it tells.
    let Ok(file) = File::options().read(true).write(true).open(path) else { return Ok(()) };
    // A program that is about to write it has the lock.
    lock(&file, path)?;
    match is_unbegun(&file, path) {
        true => std::fs::remove_file(path).map_err(|error| Error::io("remove", path, error)),
        false => Ok(()),
    }
}

/// No header takes so many bytes. A longer file in which nothing can be read was damaged, of which somebody should
/// know.
const LARGEST_HEADER: u64 = 64 << 10;

/// Whether a file is a journal, or the first bytes of one, without a whole record.
fn is_unbegun(file: &File, path: &Path) -> bool {
    let is_short = |found: &std::fs::Metadata| found.is_file() && found.len() < LARGEST_HEADER;
    if !file.metadata().is_ok_and(|found| is_short(&found)) {
        return false;
    }
    let mut first = Vec::new();
    let mut reader = file.take(MAGIC.len() as u64);
    if reader.read_to_end(&mut first).is_err() || !MAGIC.starts_with(&first) {
        return false;
    }
    let mut records = 0;
    let mut count = |_: &Record| {
        records += 1;
        Ok(())
    };
    first.len() < MAGIC.len() || read_records(file, path, &mut count).is_ok() && records == 0
}

/// Keeps other programs from appending to the same journal. The system lets go when the program ends, however it does.
#[cfg(unix)]
fn lock(file: &File, path: &Path) -> Result<()> {
    use rustix::fs::{FlockOperation, flock};
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => {
            let message = "another run is writing it; wait until that has ended, or choose another output";
            Err(Error::io("write", path, io::Error::new(ErrorKind::WouldBlock, message)))
        }
        // Where a file system has no locks, one does without.
        _ => Ok(()),
    }
}

#[cfg(not(unix))]
fn lock(_: &File, _: &Path) -> Result<()> {
    Ok(())
}

/// Hands all whole records to `take`. Returns where the last one ends.
fn read_records(file: &File, path: &Path, mut take: impl FnMut(&Record) -> Result<()>) -> Result<(u64, Condition)> {
    let to_error = |error| Error::io("read", path, error);
    let (mut reader, length) = after_magic(file, path)?;
    let (mut at, mut end) = (MAGIC.len() as u64, MAGIC.len() as u64);
    let mut condition = Condition { cut_bytes: 0, damaged_bytes: 0 };
    let mut payload = Vec::new();
    let mut in_vain = 0;
    while at < length {
        go_to(&mut reader, at).map_err(to_error)?;
        if read_record(&mut reader, length - at, &mut payload).map_err(to_error)? {
            take(&Record { payload: &payload, place: at + PREFIX_BYTES })?;
            condition.damaged_bytes += at - end;
            at += PREFIX_BYTES + payload.len() as u64;
            end = at;
            continue;
        }
        in_vain += payload.len() as u64;
        if in_vain > IN_VAIN * length {
            break;
        }
        at = match next_record(&mut reader, at + 1).map_err(to_error)? {
            Some(next) => next,
            None => length,
        };
    }
    condition.cut_bytes = length - end;
    Ok((end, condition))
}

/// So many times its length is read of a journal for records that turn out to be none: a damaged one is read once, but
/// a file may be made so that every sixteen bytes promise the rest of it. What is left then counts as cut off.
const IN_VAIN: u64 = 16;

/// A reader behind what tells that a file is a journal, and the file's length.
fn after_magic<'a>(file: &'a File, path: &Path) -> Result<(BufReader<&'a File>, u64)> {
    let to_error = |error| Error::io("read", path, error);
    let length = file.metadata().map_err(to_error)?.len();
    let mut reader = BufReader::with_capacity(1 << 20, file);
    reader.seek(SeekFrom::Start(0)).map_err(to_error)?;
    let mut magic = [0; MAGIC.len()];
    match reader.read_exact(&mut magic).is_ok() && magic == *MAGIC {
        true => Ok((reader, length)),
        false => Err(Error::input(path, None, "not a journal of raybrook")),
    }
}

/// Reads the record that begins here, if there is a whole one in so many bytes. Else `payload` has what was read for
/// it.
fn read_record(reader: &mut impl Read, most: u64, payload: &mut Vec<u8>) -> io::Result<bool> {
    let mut prefix = [0; PREFIX_BYTES as usize];
    payload.clear();
    if most < PREFIX_BYTES {
        return Ok(false);
    }
    reader.read_exact(&mut prefix)?;
    let (checksum, length) = (&prefix[4..8], &prefix[8..16]);
    let count = u64::from_le_bytes(std::array::from_fn(|i| length[i]));
    if prefix[..4] != *RECORD || count > most - PREFIX_BYTES {
        return Ok(false);
    }
    reader.take(count).read_to_end(payload)?;
    let mut found = crc32fast::Hasher::new();
    found.update(length);
    found.update(payload);
    Ok(payload.len() as u64 == count && found.finalize().to_le_bytes() == *checksum)
}

/// Where something begins, from here on, that may be a record: its first byte is that of one.
fn next_record(reader: &mut BufReader<&File>, from: u64) -> io::Result<Option<u64>> {
    go_to(reader, from)?;
    let mut at = from;
    loop {
        let bytes = reader.fill_buf()?;
        if bytes.is_empty() {
            return Ok(None);
        }
        if let Some(found) = memchr::memchr(RECORD[0], bytes) {
            return Ok(Some(at + found as u64));
        }
        let count = bytes.len();
        reader.consume(count);
        at += count as u64;
    }
}

/// Goes to a place in the file. What was read already and lies there is not read again.
fn go_to(reader: &mut BufReader<&File>, place: u64) -> io::Result<()> {
    let now = reader.stream_position()?;
    reader.seek_relative(place as i64 - now as i64)
}

#[cfg(test)]
mod tests;
