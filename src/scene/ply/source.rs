//! The bytes of a PLY file as the `serde-ply` crate can read them: a header in UTF-8 of bounded size, then the data, in
//! text one row a line.
//!
//! `serde-ply` 0.2.2 alone refuses comments that are not UTF-8 and old Mac line ends, keeps a header of any size, has
//! no line numbers, refuses a text whose last number ends with the file, and takes numbers from wherever they stand.
//! Rows are lines: MeshLab writes face colours to text files as ten numbers where its header promises four, and a line
//! that is too short must not borrow from the next.

use crate::error::{Error, Result};
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// The largest header that is read; real ones have hundreds of bytes, and many names of textures some thousands.
const MAX_HEADER_BYTES: usize = 1 << 20;

/// Bytes that are read at once: few calls, and still in the processor's cache.
const BUFFER_BYTES: usize = 1 << 18;

/// A PLY file that is being read.
pub(super) struct Source<'a> {
    header: Cursor<Vec<u8>>,
    /// Where the data begin.
    data: u64,
    file: BufReader<File>,
    /// Whether the data are text.
    pub text: bool,
    /// What ends a line.
    pub line_end: u8,
    /// Number of the line in hand, from 1; in binary data that of the header's last.
    pub line: usize,
    /// The line in hand of a text's data, and how much of it was read.
    row: Vec<u8>,
    taken: usize,
    /// Set by whoever reads when a row is complete: what its line has beside it is left out.
    pub row_ended: &'a Cell<bool>,
    /// Whether a line had something beside its row.
    pub left_out: bool,
}

impl<'a> Source<'a> {
    /// Reads the header of `file`, which was opened from `path`.
    pub fn new(path: &Path, file: File, row_ended: &'a Cell<bool>) -> Result<Self> {
        let unreadable = |e| Error::io("read", path, e);
        let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
        let head = file.fill_buf().map_err(unreadable)?;
        if !head.starts_with(b"ply") {
            return Err(Error::input(path, None, "is not a PLY file: it does not begin with 'ply'"));
        }
        let old_mac = head
            .iter()
            .position(|&b| b == b'\n' || b == b'\r')
            .is_some_and(|end| head[end] == b'\r' && head.get(end + 1) != Some(&b'\n'));
        let line_end = if old_mac { b'\r' } else { b'\n' };
        let (mut header, mut text, mut lines, mut data) = (Vec::new(), false, 0, 0);
        loop {
            let mut line = Vec::new();
            let rest = MAX_HEADER_BYTES - data;
            data += (&mut file).take(rest as u64).read_until(line_end, &mut line).map_err(unreadable)?;
            lines += 1;
            if line.last() != Some(&line_end) {
                let message = match line.len() == rest {
                    true => format!("the PLY header is longer than {} MiB", MAX_HEADER_BYTES >> 20),
                    false => "the file ends within its PLY header (there is no 'end_header')".to_owned(),
                };
                return Err(Error::input(path, lines, message));
            }
            line.pop();
            let line = String::from_utf8_lossy(&line);
            header.extend_from_slice(line.as_bytes());
            header.push(b'\n');
            let mut words = line.split_whitespace();
            match (words.next(), words.next()) {
                (Some("format"), encoding) => text = encoding == Some("ascii"),
                (Some("end_header"), None) => break,
                _ => {}
            }
        }
        let header = Cursor::new(header);
        let (row, data) = (Vec::new(), data as u64);
        Ok(Source { header, data, file, text, line_end, line: 0, row, taken: 0, row_ended, left_out: false })
    }

    /// Goes back to the header.
    pub fn rewind(&mut self) -> io::Result<()> {
        self.header.set_position(0);
        self.line = 0;
        self.row_ended.set(true);
        self.file.seek(SeekFrom::Start(self.data)).map(|_| ())
    }

    /// All that follows the header.
    pub fn data(&mut self) -> io::Result<Vec<u8>> {
        self.rewind()?;
        let mut data = Vec::new();
        self.file.read_to_end(&mut data)?;
        Ok(data)
    }

    /// What is read of the line in hand of a text; empty for binary data and at the end.
    pub fn row(&self) -> &[u8] {
        self.row.trim_ascii()
    }

    /// Whether something follows the rows that were read.
    pub fn has_more(&mut self) -> io::Result<bool> {
        self.row_ended.set(true);
        Ok(!self.fill_buf()?.is_empty())
    }

    fn in_header(&self) -> bool {
        self.header.position() < self.header.get_ref().len() as u64
    }

    /// Goes to the next line that is not empty; to an empty one at the end of the file.
    fn next_line(&mut self) -> io::Result<()> {
        self.left_out |= !self.row[self.taken..].trim_ascii().is_empty();
        self.taken = 0;
        loop {
            self.row.clear();
            if self.file.read_until(self.line_end, &mut self.row)? == 0 {
                return Ok(());
            }
            self.line += 1;
            if !self.row().is_empty() {
                self.row.push(b'\n'); // a number ends where a blank follows
                return Ok(());
            }
        }
    }
}

impl BufRead for Source<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.in_header() {
            return self.header.fill_buf();
        }
        if !self.text {
            return self.file.fill_buf();
        }
        if self.row_ended.replace(false) {
            self.next_line()?;
        }
        Ok(&self.row[self.taken..])
    }

    fn consume(&mut self, count: usize) {
        if self.in_header() {
            let first = self.header.position() as usize;
            self.line += self.header.get_ref()[first..first + count].iter().filter(|&&b| b == b'\n').count();
            self.header.consume(count);
        } else if self.text {
            self.taken += count;
        } else {
            self.file.consume(count);
        }
    }
}

impl Read for Source<'_> {
    fn read(&mut self, target: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(target)?;
        self.consume(count);
        Ok(count)
    }

    fn read_exact(&mut self, target: &mut [u8]) -> io::Result<()> {
        if !self.text && !self.in_header() {
            return self.file.read_exact(target); // the quick way for most of a large file
        }
        let mut filled = 0;
        while filled < target.len() {
            match self.read(&mut target[filled..])? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                count => filled += count,
            }
        }
        Ok(())
    }
}
