//! NumPy's `.npz` container: a ZIP archive of `.npy` arrays, as far as ray batches need it.
//!
//! Format: NumPy Enhancement Proposal 1 (Kern 2007) and the documentation of `numpy.lib.format`. Stored and deflated
//! members and ZIP64 are read. float32, little-endian, C order is read straight into place; float64, big-endian numbers
//! and Fortran order are converted on the way. Memory follows what a file holds, not what its headers claim.
//!
//! Stored members are read, checked and converted on all cores, part by part.
//!
//! Bad at: anything but float arrays of one shape; parallel decompression.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

use crate::budget::{DecidedBy, MemoryBudget, Need, try_repeat};
use crate::error::{Error, Result};
use crate::io::input::{open_regular, read_exact_at};
use crate::parallel;

mod write;

pub(crate) use write::{Data, NpyArray, Taker, write_npz};

/// Headers above this are refused, as NumPy itself does by default; ours and NumPy's have 128 bytes.
const HEADER_LIMIT_BYTES: usize = 10_000;
/// Headers nested deeper than this are refused: the header parser recurses, and a plain array needs two levels.
const HEADER_LIMIT_DEPTH: usize = 16;
/// Numbers in a header may have this many bits together, so that no product of them overflows in the header parser.
const HEADER_LIMIT_BITS: usize = 63;
/// Rows that are read at a time where the data may be smaller than claimed, or are converted.
const CHUNK_ROWS: usize = 1 << 14;

/// Bytes of a stored member that one core reads and checks at a time, while they are in its cache.
const PART_BYTES: usize = 1 << 20;

/// What to do about arrays that do not fit.
const REMEDY: &str = "split the batch, or raise `memory_limit`";

/// How many bytes one byte can become: a match of 258 bytes takes two bits (RFC 1951).
const DEFLATE_RATIO: u128 = 1032;

/// An open `.npz` file.
pub(crate) struct NpzFile {
    path: PathBuf,
    budget: MemoryBudget,
    file_bytes: u64,
    archive: ZipArchive<BufReader<File>>,
    /// The same file, for reading at any place.
    file: File,
    /// Names of all members; `.npy` is taken off, as NumPy does.
    names: Vec<String>,
}

impl NpzFile {
    /// Opens `path` and reads its table of contents.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Input`] when it is not an `.npz` file.
    pub(crate) fn open(path: &Path, budget: MemoryBudget) -> Result<Self> {
        let to_io = |e| Error::io("read", path, e);
        let (file, file_bytes) = open_regular(path)?;
        let placed = file.try_clone().map_err(to_io)?;
        let mut file = BufReader::new(file);
        // What is given as /dev/stdin need not be at its beginning.
        file.rewind().map_err(to_io)?;
        let mut magic = Vec::new();
        file.by_ref().take(6).read_to_end(&mut magic).map_err(to_io)?;
        if magic == b"\x93NUMPY" {
            let message = "this is a single array (.npy); a batch needs named arrays: numpy.savez(file, origin=..., \
                           direction=...)";
            return Err(Error::input(path, None, message));
        }
        let archive = ZipArchive::new(file).map_err(|e| zip_error(path, "this is no .npz file", e))?;
        if archive.has_duplicate_names() {
            return Err(Error::input(path, None, "two arrays have the same name"));
        }
        let names = archive.file_names_raw().map(String::from_utf8_lossy);
        let names = names.map(|n| npyz::npz::array_name_from_file_name(&n).unwrap_or(&n).to_owned()).collect();
        Ok(NpzFile { path: path.to_owned(), budget, file_bytes, archive, file: placed, names })
    }

    /// The names of all arrays.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    /// The array `name` as rows of `N` numbers, or `None` if there is none. Its shape is [n] for `N` = 1, [n, `N`]
    /// otherwise.
    ///
    /// # Errors
    /// [`Error::Input`] for another shape or type, or damaged data; [`Error::Io`] when the system cannot read;
    /// [`Error::OutOfMemory`] when there is not enough memory.
    pub(crate) fn read_rows<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[f32; N]>>> {
        let Some(index) = self.names.iter().position(|n| n == name) else { return Ok(None) };
        let path = &self.path;
        let refuse = |message: String| Error::input(path, None, format!("array '{name}' {message}"));
        let damaged = format!("array '{name}' is damaged or cut short");
        let what = format!("array '{name}' of {}", path.display());
        let need = |bytes| Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy: REMEDY };
        let mut member = self.archive.by_index(index).map_err(|e| zip_error(path, &damaged, e))?;
        let member_bytes = member.size();
        let to_error = |e: io::Error| match e.kind() {
            io::ErrorKind::OutOfMemory => need(member_bytes).refused(),
            _ => read_error(path, &damaged, e),
        };
        let (header, header_bytes) = read_header(&mut member).map_err(to_error)?;
        let layout = Layout::of::<N>(&header).map_err(refuse)?;
        let data_bytes = layout.rows as u128 * N as u128 * layout.item_bytes() as u128;
        if u128::from(header_bytes) + data_bytes != u128::from(member_bytes) {
            let held = member_bytes.saturating_sub(header_bytes);
            return Err(refuse(format!(
                "should have {data_bytes} bytes by its shape, but has {held}; the file is damaged"
            )));
        }
        if data_bytes > DEFLATE_RATIO * u128::from(self.file_bytes) {
            return Err(refuse(format!("should have {data_bytes} bytes, more than its file can hold; it is damaged")));
        }
        // Rows of float32 are converted from larger ones piece by piece, and from columns when all are there.
        let row_bytes = (N * size_of::<f32>()) as u128 * if layout.fortran { 2 } else { 1 };
        let bytes = u64::try_from(layout.rows as u128 * row_bytes).unwrap_or(u64::MAX);
        self.budget.check(&need(bytes))?;
        let is_stored = member.compression() == CompressionMethod::Stored && member.compressed_size() == member_bytes;
        if let Some(place) = member.data_start().filter(|_| is_stored && data_bytes <= u128::from(self.file_bytes)) {
            let (checksum, file) = (member.crc32(), &self.file);
            return layout.read_stored(file, place, (header_bytes, checksum)).map(Some).map_err(to_error);
        }
        // A claim within the size of the file costs no more memory than the file; beyond it, memory grows with the
        // data.
        let chunk_rows = if data_bytes <= u128::from(self.file_bytes) { layout.rows.max(1) } else { CHUNK_ROWS };
        let rows = layout.read::<N>(&mut member, chunk_rows).map_err(to_error)?;
        // The checksum is compared when the end is met, which reading an exact number of bytes does not do.
        if member.read(&mut [0]).map_err(to_error)? != 0 {
            return Err(refuse("has data after its end; the file is damaged".into()));
        }
        Ok(Some(rows))
    }
}

/// What the ZIP reader says, as an error of this crate.
fn zip_error(path: &Path, what: &str, error: ZipError) -> Error {
    match error {
        ZipError::Io(source) => read_error(path, what, source),
        other => Error::input(path, None, format!("{what}: {other}")),
    }
}

/// Tells an error of the system from one of the data, which readers report by the same type.
fn read_error(path: &Path, what: &str, error: io::Error) -> Error {
    match error.raw_os_error() {
        Some(_) => Error::io("read", path, error),
        None => Error::input(path, None, format!("{what}: {error}")),
    }
}

fn invalid(message: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

/// Reads the header of an array, and tells its length in bytes. What the parser could choke on is refused first.
fn read_header(reader: &mut impl Read) -> io::Result<(NpyHeader, u64)> {
    let mut text = vec![0; 8];
    reader.read_exact(&mut text)?;
    let length_bytes = if text[6] == 1 { 2 } else { 4 };
    let mut length = [0; 4];
    reader.read_exact(&mut length[..length_bytes])?;
    text.extend_from_slice(&length[..length_bytes]);
    let header_bytes = u32::from_le_bytes(length) as usize;
    if !text.starts_with(b"\x93NUMPY") {
        return Err(invalid("it does not begin like an array"));
    }
    if header_bytes > HEADER_LIMIT_BYTES {
        return Err(invalid("its header is too long"));
    }
    let start = text.len();
    text.resize(start + header_bytes, 0);
    reader.read_exact(&mut text[start..])?;

    let header = &text[start..];
    let depth = header.iter().filter(|&b| b"([{".contains(b)).count();
    let digits = header.split(|b| !b.is_ascii_digit()).filter(|run| !run.is_empty());
    let bits: usize = digits.map(|run| run.len() * 10 / 3 + 1).sum();
    if depth > HEADER_LIMIT_DEPTH || bits > HEADER_LIMIT_BITS {
        return Err(invalid("its header is not one of a plain array"));
    }
    Ok((NpyHeader::from_reader(text.as_slice())?, text.len() as u64))
}

/// How the numbers of an array lie in the file.
struct Layout {
    rows: usize,
    double: bool,
    big_endian: bool,
    /// Column after column; for one column it makes no difference.
    fortran: bool,
}

impl Layout {
    /// Checks type and shape; the error continues "array 'name' ...".
    fn of<const N: usize>(header: &NpyHeader) -> std::result::Result<Self, String> {
        let dtype = header.dtype();
        let plain = match &dtype {
            DType::Plain(plain) if plain.type_char() == TypeChar::Float && [4, 8].contains(&plain.size_field()) => {
                plain
            }
            _ => return Err(format!("has type {}, but must be float32 or float64", dtype.descr())),
        };
        let rows = match *header.shape() {
            [rows] if N == 1 => rows,
            [rows, columns] if N > 1 && columns == N as u64 => rows,
            ref shape => {
                let expected = if N == 1 { "[n]".into() } else { format!("[n, {N}]") };
                return Err(format!("has shape {shape:?}, but must have {expected}"));
            }
        };
        Ok(Layout {
            rows: usize::try_from(rows).map_err(|_| "is too large for this machine".to_owned())?,
            double: plain.size_field() == 8,
            big_endian: plain.endianness() == Endianness::Big,
            fortran: N > 1 && header.order() == Order::Fortran,
        })
    }

    fn item_bytes(&self) -> usize {
        if self.double { 8 } else { 4 }
    }

    /// Reads the data, making room for `chunk_rows` rows at a time.
    fn read<const N: usize>(&self, reader: &mut impl Read, chunk_rows: usize) -> io::Result<Vec<[f32; N]>> {
        let native = self.is_native();
        let chunk_rows = if native { chunk_rows } else { chunk_rows.min(CHUNK_ROWS) };
        // The first chunk is fresh zero pages from the system, filled in place; in the usual case it is the only one.
        let mut rows = try_repeat([0.0_f32; N], self.rows.min(chunk_rows))?;
        let mut buffer = Vec::new();
        let mut done = 0;
        while done < self.rows {
            if done > 0 {
                let count = (self.rows - done).min(chunk_rows);
                rows.try_reserve(count)?;
                rows.resize(done + count, [0.0; N]);
            }
            let target = rows[done..].as_flattened_mut();
            if native {
                reader.read_exact(bytemuck::cast_slice_mut(target))?;
            } else {
                buffer.resize(target.len() * self.item_bytes(), 0);
                reader.read_exact(&mut buffer)?;
                self.convert_all(&buffer, target);
            }
            done = rows.len();
        }
        self.in_rows(rows)
    }

    /// The same of a stored member that begins at `place` of its file with so many bytes of header, on all cores.
    fn read_stored<const N: usize>(
        &self,
        file: &File,
        place: u64,
        (header_bytes, checksum): (u64, u32),
    ) -> io::Result<Vec<[f32; N]>> {
        let mut header = vec![0; header_bytes as usize];
        read_exact_at(file, &mut header, place)?;
        // What the system refuses is an error, and no allocation that aborts.
        Vec::<[f32; N]>::new().try_reserve_exact(self.rows)?;
        // Fresh zero pages, which each core has made for the parts that it reads.
        let mut rows = vec![[0.0_f32; N]; self.rows];
        let row_bytes = N * self.item_bytes();
        let part_rows = (PART_BYTES / row_bytes).max(1);
        let read_part = |(part, target): (usize, &mut [[f32; N]])| {
            let at = place + header_bytes + part as u64 * (part_rows * row_bytes) as u64;
            self.read_part(file, at, target.as_flattened_mut())
        };
        let parts = parallel::map(rows.chunks_mut(part_rows).enumerate(), read_part);
        let mut found = Hasher::new();
        found.update(&header);
        for part in parts {
            found.combine(&part?);
        }
        if found.finalize() != checksum {
            return Err(invalid("Invalid checksum"));
        }
        self.in_rows(rows)
    }

    /// Reads numbers from `place` of a file on, and tells their bytes' checksum.
    fn read_part(&self, file: &File, place: u64, target: &mut [f32]) -> io::Result<Hasher> {
        let mut checksum = Hasher::new();
        if self.is_native() {
            let bytes = bytemuck::cast_slice_mut(target);
            read_exact_at(file, bytes, place)?;
            checksum.update(bytes);
        } else {
            let mut bytes = vec![0; target.len() * self.item_bytes()];
            read_exact_at(file, &mut bytes, place)?;
            checksum.update(&bytes);
            self.convert_all(&bytes, target);
        }
        Ok(checksum)
    }

    /// The rows of numbers that were read in the file's order.
    fn in_rows<const N: usize>(&self, rows: Vec<[f32; N]>) -> io::Result<Vec<[f32; N]>> {
        if !self.fortran {
            return Ok(rows);
        }
        let numbers = rows.as_flattened();
        let mut turned: Vec<[f32; N]> = Vec::new();
        turned.try_reserve_exact(self.rows)?;
        let row = |row: usize| -> [f32; N] { std::array::from_fn(|column| numbers[column * self.rows + row]) };
        parallel::extend(&mut turned, self.rows, row);
        Ok(turned)
    }

    /// Whether the file's numbers are those of this machine.
    fn is_native(&self) -> bool {
        !self.double && self.big_endian == cfg!(target_endian = "big")
    }

    fn convert_all(&self, bytes: &[u8], target: &mut [f32]) {
        for (number, bytes) in target.iter_mut().zip(bytes.chunks_exact(self.item_bytes())) {
            *number = self.convert(bytes);
        }
    }

    /// One number of the file. A double rounds to the nearest float; one beyond the floats' range becomes an infinity.
    fn convert(&self, bytes: &[u8]) -> f32 {
        // Both lengths come from `item_bytes`; zeros would stand in for missing bytes.
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        if self.big_endian {
            word[..bytes.len()].reverse();
        }
        let bits = u64::from_le_bytes(word);
        if self.double { f64::from_bits(bits) as f32 } else { f32::from_bits(bits as u32) }
    }
}
