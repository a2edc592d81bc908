//! Inputs that are put together from pieces, and journals of these.

use raybrook::low_level::journal::Journal;
use std::path::Path;

/// What stands between the pieces of an input that is put together from several.
const BETWEEN: &[u8] = b"\n----\n";

/// The pieces of an input.
pub fn pieces(data: &[u8]) -> Vec<&[u8]> {
    let (mut all, mut rest) = (Vec::new(), data);
    while let Some(end) = rest.windows(BETWEEN.len()).position(|window| window == BETWEEN) {
        all.push(&rest[..end]);
        rest = &rest[end + BETWEEN.len()..];
    }
    all.push(rest);
    all
}

/// Writes an input that is a journal to `path`, where nothing is; of another one its pieces are the records of one,
/// whose checksums are right.
pub fn write_journal(path: &Path, data: &[u8]) {
    const WHY: &str = "the temporary folder can be written";
    if data.starts_with(b"raybrook journal") {
        return std::fs::write(path, data).expect(WHY);
    }
    let pieces = pieces(data);
    let mut journal = Journal::create(path, pieces[0]).expect(WHY);
    pieces[1..].iter().for_each(|piece| journal.append(&[piece]).expect(WHY));
}
