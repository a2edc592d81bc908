//! Writes `.npz` files. Arrays that have to be made of something else are made on all cores, part by part, while one
//! core writes what was made before: writing is most of the work, and the system lets one at a time write to a file.
//!
//! Bad at: several arrays at a time.

use std::io::{self, Write};
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread::Builder;

use bytemuck::{Pod, bytes_of, cast_slice};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::error::Result;
use crate::io::output::{Output, write_atomically};
use crate::parallel;

/// From this size on a ZIP member needs 64-bit fields; the margin is room for the header.
const LARGE_MEMBER_BYTES: usize = u32::MAX as usize - (1 << 16);
/// Bytes that are made while those before are written, and what one core makes of them at a time.
const WRITE_BYTES: usize = 8 << 20;
const MADE_BYTES: usize = 1 << 18;

/// An array to be written: numbers of this machine's byte order in C order.
pub(crate) struct NpyArray<'a> {
    /// Its name.
    pub(crate) name: &'a str,
    /// NumPy's type code without the byte order: "f4", "i4", "u1".
    pub(crate) type_code: &'static str,
    /// Its length.
    pub(crate) len: usize,
    /// Numbers in each row of an array of two dimensions; `None` for one dimension.
    pub(crate) columns: Option<usize>,
    /// Its data.
    pub(crate) data: Data<'a>,
}

/// The data of an array.
pub(crate) enum Data<'a> {
    /// As it is written.
    Bytes(&'a [u8]),
    /// Made where it is written, of one dimension: this has all of it taken.
    Made(MakeData<'a>),
}

/// Has the data of an array taken, from its beginning to its end.
pub(crate) type MakeData<'a> = Box<dyn Fn(&mut Taker) -> io::Result<()> + Send + Sync + 'a>;

/// Takes data that is made.
pub(crate) struct Taker {
    made: SyncSender<Vec<u8>>,
    /// What was written, for the next data.
    written: Receiver<Vec<u8>>,
}

impl Taker {
    /// Takes the next `values`, as bytes of what `of` makes of each. They are made by all cores.
    pub(crate) fn take<V: Sync, T: Pod>(&mut self, values: &[V], of: impl Fn(&V) -> T + Sync) -> io::Result<()> {
        let item_bytes = size_of::<T>();
        let make = |(bytes, values): (&mut [u8], &[V])| {
            for (bytes, value) in bytes.chunks_exact_mut(item_bytes).zip(values) {
                bytes.copy_from_slice(bytes_of(&of(value)));
            }
        };
        for values in values.chunks(WRITE_BYTES / item_bytes) {
            let mut buffer = self.written.try_recv().unwrap_or_default();
            buffer.resize(values.len() * item_bytes, 0);
            parallel::each(buffer.chunks_mut(MADE_BYTES).zip(values.chunks(MADE_BYTES / item_bytes)), make);
            // Who takes no more has failed, and tells why.
            self.made.send(buffer).map_err(|_| io::Error::other("the data is not taken any more"))?;
        }
        Ok(())
    }
}

impl<'a> NpyArray<'a> {
    /// One whose data is there, of one dimension.
    pub(crate) fn of<T: Pod>(name: &'a str, type_code: &'static str, values: &'a [T]) -> NpyArray<'a> {
        NpyArray { name, type_code, len: values.len(), columns: None, data: Data::Bytes(cast_slice(values)) }
    }

    /// Bytes of an element, with which its type code ends.
    fn item_bytes(&self) -> usize {
        self.type_code.bytes().last().map_or(1, |digit| usize::from(digit - b'0'))
    }

    fn data_bytes(&self) -> usize {
        match &self.data {
            Data::Bytes(bytes) => bytes.len(),
            Data::Made(_) => self.len * self.item_bytes(),
        }
    }
}

/// Writes `arrays`, uncompressed as `numpy.savez` does. The same arrays always make the same bytes.
///
/// # Errors
/// As [`write_atomically`].
pub(crate) fn write_npz(path: &Path, arrays: &[NpyArray]) -> Result<()> {
    write_atomically(path, |out| {
        let mut archive = ZipWriter::new(out);
        let written = arrays.iter().try_for_each(|array| write_array(&mut archive, array));
        if written.is_err() {
            // Dropped, it would try to end the archive, fail once more, and say so on standard error.
            std::mem::forget(archive);
            return written;
        }
        archive.finish().map(drop).map_err(io_error)
    })
}

fn write_array(archive: &mut ZipWriter<&mut dyn Output>, array: &NpyArray) -> io::Result<()> {
    let options = SimpleFileOptions::DEFAULT
        .compression_method(CompressionMethod::Stored)
        .large_file(array.data_bytes() >= LARGE_MEMBER_BYTES);
    archive.start_file(npyz::npz::file_name_from_array_name(array.name), options).map_err(io_error)?;
    archive.write_all(&header_of(array))?;
    match &array.data {
        Data::Bytes(bytes) => archive.write_all(bytes),
        Data::Made(make) => write_made(archive, array.data_bytes(), make),
    }
}

/// Writes so many bytes of data, which are made while those before are written.
fn write_made(out: &mut impl Write, bytes: usize, make: &MakeData) -> io::Result<()> {
    std::thread::scope(|scope| {
        let (made, ready) = mpsc::sync_channel(1);
        let (send_back, written) = mpsc::channel();
        let maker = Builder::new().spawn_scoped(scope, move || make(&mut Taker { made, written }))?;
        let mut count = 0;
        for buffer in ready {
            out.write_all(&buffer)?;
            count += buffer.len();
            // After the last one nobody takes it.
            let _ = send_back.send(buffer);
        }
        maker.join().unwrap_or_else(|panic| resume_unwind(panic))?;
        if count == bytes { Ok(()) } else { Err(io::Error::other("an array has not as much data as it should have")) }
    })
}

/// What the system said, without what the ZIP writer says of it.
fn io_error(error: ZipError) -> io::Error {
    match error {
        ZipError::Io(source) => source,
        other => other.into(),
    }
}

/// The header of an array, to the byte as NumPy writes it: version 1.0, the data begins at a multiple of 64 bytes.
fn header_of(array: &NpyArray) -> Vec<u8> {
    /// Magic, version and length, before the text.
    const PREFIX_BYTES: usize = 10;
    /// NumPy leaves room for the first dimension to grow to any 64-bit number without moving the data.
    const GROWTH_DIGITS: usize = 21;
    const ALIGNMENT_BYTES: usize = 64;
    let byte_order = match array.type_code {
        "u1" => '|',
        _ if cfg!(target_endian = "big") => '>',
        _ => '<',
    };
    let columns = array.columns.map_or(String::new(), |columns| format!(" {columns}"));
    let mut text = format!(
        "{{'descr': '{byte_order}{}', 'fortran_order': False, 'shape': ({},{columns}), }}",
        array.type_code, array.len
    );
    let grown = text.len() + GROWTH_DIGITS - array.len.to_string().len();
    let text_bytes = (PREFIX_BYTES + grown + 1).next_multiple_of(ALIGNMENT_BYTES) - PREFIX_BYTES;
    text += &" ".repeat(text_bytes - 1 - text.len());
    text.push('\n');
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    // Well below 65,536: type code and one dimension are short.
    header.extend((text_bytes as u16).to_le_bytes());
    header.extend(text.as_bytes());
    header
}
