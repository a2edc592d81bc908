//! The rows of a PNG, filtered and compressed in parts at the same time.
//!
//! A file's rows are one stream of DEFLATE. It is cut into parts of whole rows, each of which is compressed by a thread
//! of its own; what repeats something of the part before is found there, too, as that part's end is a preset
//! dictionary. This is how pigz does it (Mark Adler, pigz 2.0, 2007). The filter of a row is the one whose bytes have
//! the least sum of absolute values (PNG Specification, third edition, 2025, section 12.7). The bytes depend neither
//! on the number of threads nor on how many rows come at a time.
//!
//! Bad at: small pictures, which are one part.

use crate::parallel;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

use flate2::{Compress, Compression, FlushCompress, Status};
use simd_adler32::Adler32;

/// Bytes of a part, about: each loses a few bytes at its end, and the time until its thread is there.
const PART_BYTES: usize = 1 << 18;
/// Bytes of rows that are compressed together, while the next ones come.
const BATCH_BYTES: usize = 1 << 23;
/// How far back DEFLATE finds what repeats (RFC 1951, section 2).
const WINDOW_BYTES: usize = 1 << 15;
/// What a stream of zlib begins with: DEFLATE with that window, compressed by the default level (RFC 1950, section
/// 2.2).
const ZLIB_HEADER: [u8; 2] = [0x78, 0x9c];
/// The number of filters of the specification, from 0: none, left, above, their mean, Paeth's.
const FILTERS: usize = 5;

/// About how many bytes are in use while a picture of so many bytes is written: a batch as it comes; another one as it
/// came, filtered, and compressed.
pub(super) fn writing_bytes(picture: u64) -> u64 {
    4 * picture.min(BATCH_BYTES as u64)
}

/// Writes rows as IDAT chunks. They are compressed by rayon's threads while the next ones come.
pub(super) struct PngRows<'a, W: Write> {
    writer: &'a mut png::Writer<W>,
    shape: Shape,
    /// Rows that are not compressed yet.
    waiting: Vec<u8>,
    /// The row before these; zeros above the first one.
    above: Vec<u8>,
    /// What is being compressed.
    running: Option<Receiver<io::Result<Batch>>>,
    /// The end of what is compressed, as it was before.
    window: Vec<u8>,
    check: Adler32,
}

#[derive(Clone, Copy)]
struct Shape {
    row_bytes: usize,
    pixel_bytes: usize,
    /// Of the rows of a part.
    part_bytes: usize,
}

/// Parts of the stream.
struct Batch {
    filtered: Vec<Vec<u8>>,
    compressed: Vec<Vec<u8>>,
}

impl<'a, W: Write> PngRows<'a, W> {
    /// Begins the stream, for rows of `row_bytes`, with `pixel_bytes` for each pixel.
    pub fn begin(writer: &'a mut png::Writer<W>, row_bytes: usize, pixel_bytes: usize) -> io::Result<Self> {
        writer.write_chunk(png::chunk::IDAT, &ZLIB_HEADER)?;
        let part_bytes = (PART_BYTES / row_bytes).max(1) * row_bytes;
        Ok(PngRows {
            writer,
            shape: Shape { row_bytes, pixel_bytes, part_bytes },
            waiting: Vec::new(),
            above: vec![0; row_bytes],
            running: None,
            window: Vec::new(),
            check: Adler32::new(),
        })
    }

    /// Takes the next bytes of rows, of any number.
    pub fn put(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        let part = self.shape.part_bytes;
        let most = (BATCH_BYTES / part).max(1) * part;
        while !bytes.is_empty() {
            // What is last is left to `finish`: the stream must end with it.
            if self.waiting.len() == most {
                self.write_running()?;
                self.compress_waiting(FlushCompress::Sync);
            }
            let (now, later) = bytes.split_at(bytes.len().min(most - self.waiting.len()));
            self.waiting.extend_from_slice(now);
            bytes = later;
        }
        Ok(())
    }

    /// Ends the stream; all rows must have come.
    pub fn finish(mut self) -> io::Result<()> {
        self.write_running()?;
        self.compress_waiting(FlushCompress::Finish);
        self.write_running()?;
        self.writer.write_chunk(png::chunk::IDAT, &self.check.finish().to_be_bytes())?;
        Ok(())
    }

    /// Has what is waiting compressed; nothing else may be running.
    fn compress_waiting(&mut self, end: FlushCompress) {
        let rows = std::mem::take(&mut self.waiting);
        let last_row = rows[rows.len() - self.shape.row_bytes..].to_vec();
        let above = std::mem::replace(&mut self.above, last_row);
        let (window, shape) = (std::mem::take(&mut self.window), self.shape);
        let (send, receive) = sync_channel(1);
        self.running = Some(receive);
        rayon::spawn(move || {
            let batch = compress_rows(&rows, &above, &window, (shape, end));
            // Nobody waits any more where something failed.
            drop(send.send(batch));
        });
    }

    /// Waits for what is being compressed, and writes it.
    fn write_running(&mut self) -> io::Result<()> {
        let Some(running) = self.running.take() else { return Ok(()) };
        let Batch { filtered, compressed } = wait(&running)?;
        for (filtered, compressed) in filtered.iter().zip(&compressed) {
            self.check.write(filtered);
            self.writer.write_chunk(png::chunk::IDAT, compressed)?;
        }
        self.window = filtered.into_iter().next_back().unwrap_or_default();
        Ok(())
    }
}

/// Waits for a batch. A thread of rayon's works meanwhile: it may be the only one.
fn wait(running: &Receiver<io::Result<Batch>>) -> io::Result<Batch> {
    let ended = || io::Error::other("a thread that compresses rows has ended");
    if rayon::current_thread_index().is_none() {
        return running.recv().map_err(|_| ended())?;
    }
    loop {
        match running.try_recv() {
            Ok(batch) => return batch,
            Err(TryRecvError::Disconnected) => return Err(ended()),
            Err(TryRecvError::Empty) => drop(rayon::yield_now()),
        }
    }
}

/// Filters and compresses rows in parts, each on a thread; `window` is what comes before them.
fn compress_rows(rows: &[u8], above: &[u8], window: &[u8], (shape, end): (Shape, FlushCompress)) -> io::Result<Batch> {
    let Shape { row_bytes, pixel_bytes, part_bytes } = shape;
    let filtered = parallel::map(rows.chunks(part_bytes).enumerate(), |(i, part)| {
        let above = if i == 0 { above } else { &rows[i * part_bytes - row_bytes..i * part_bytes] };
        filter(part, above, pixel_bytes)
    });
    let last = filtered.len().saturating_sub(1);
    let compressed = parallel::map(filtered.iter().enumerate(), |(i, bytes)| {
        let before = if i == 0 { window } else { &filtered[i - 1] };
        compress(bytes, before, if i == last { end } else { FlushCompress::Sync })
    });
    let compressed = compressed.into_iter().collect::<io::Result<_>>()?;
    Ok(Batch { filtered, compressed })
}

/// Whole rows, each with the number of its filter before it, from the row above the first one on.
fn filter(rows: &[u8], above: &[u8], pixel_bytes: usize) -> Vec<u8> {
    let row_bytes = above.len();
    let mut out = Vec::with_capacity(rows.len() + rows.len() / row_bytes);
    // Left of each row is a pixel of zeros.
    let mut above = [&vec![0; pixel_bytes], above].concat();
    let mut row = vec![0; pixel_bytes + row_bytes];
    let mut tried = [const { Vec::new() }; FILTERS];
    for bytes in rows.chunks_exact(row_bytes) {
        row[pixel_bytes..].copy_from_slice(bytes);
        let (left, above_left) = (&row[..row_bytes], &above[..row_bytes]);
        let above_row = &above[pixel_bytes..];
        let around = || left.iter().zip(above_row).zip(above_left).map(|((&a, &b), &c)| (a, b, c));
        fill(&mut tried[0], bytes, around().map(|_| 0));
        fill(&mut tried[1], bytes, around().map(|(left, ..)| left));
        fill(&mut tried[2], bytes, around().map(|(_, above, _)| above));
        fill(&mut tried[3], bytes, around().map(|(left, above, _)| left.midpoint(above)));
        fill(&mut tried[4], bytes, around().map(|(left, above, corner)| paeth(left, above, corner)));
        let best = (0..FILTERS).min_by_key(|&i| sum(&tried[i])).unwrap_or(0);
        out.push(best as u8);
        out.extend_from_slice(&tried[best]);
        std::mem::swap(&mut row, &mut above);
    }
    out
}

fn fill(out: &mut Vec<u8>, row: &[u8], predicted: impl Iterator<Item = u8>) {
    out.clear();
    out.extend(row.iter().zip(predicted).map(|(&byte, predicted)| byte.wrapping_sub(predicted)));
}

/// The sum of the absolute values of signed bytes.
fn sum(bytes: &[u8]) -> u64 {
    // Vectors of 32 bits hold what at most 2^25 bytes add up to.
    let of = |bytes: &[u8]| bytes.iter().map(|&byte| u32::from((byte as i8).unsigned_abs())).sum::<u32>();
    bytes.chunks(1 << 16).map(|bytes| u64::from(of(bytes))).sum()
}

/// Which of left, above and upper left is nearest to `left + above - corner` (the specification's section 9.4).
fn paeth(left: u8, above: u8, corner: u8) -> u8 {
    let (a, b, c) = (i16::from(left), i16::from(above), i16::from(corner));
    let (to_left, to_above, to_corner) = ((b - c).abs(), (a - c).abs(), (a + b - 2 * c).abs());
    if to_left <= to_above && to_left <= to_corner {
        left
    } else if to_above <= to_corner {
        above
    } else {
        corner
    }
}

/// DEFLATE's blocks for `bytes`, which come after `before`.
fn compress(bytes: &[u8], before: &[u8], end: FlushCompress) -> io::Result<Vec<u8>> {
    let mut deflate = Compress::new(Compression::default(), false);
    let dictionary = &before[before.len().saturating_sub(WINDOW_BYTES)..];
    if !dictionary.is_empty() {
        deflate.set_dictionary(dictionary).map_err(io::Error::other)?;
    }
    let mut out = Vec::with_capacity(bytes.len() / 2 + 64);
    loop {
        let status = deflate.compress_vec(&bytes[deflate.total_in() as usize..], &mut out, end)?;
        // What has no room is written by the next call.
        if status == Status::StreamEnd || end != FlushCompress::Finish && out.len() < out.capacity() {
            return Ok(out);
        }
        out.reserve(out.capacity().max(64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Rows of one picture: smooth, noise, and repeated from far above.
    fn picture(width: usize, height: usize, pixel_bytes: usize) -> Vec<u8> {
        let mut random = Random::new(3);
        let row_bytes = width * pixel_bytes;
        let mut bytes: Vec<u8> = Vec::with_capacity(row_bytes * height);
        for y in 0..height {
            match y % 5 {
                4 if y > 8 => bytes.extend_from_within((y - 7) * row_bytes..(y - 6) * row_bytes),
                3 => bytes.extend((0..row_bytes).map(|_| random.below(256) as u8)),
                _ => bytes.extend((0..row_bytes).map(|x| (x / pixel_bytes + 3 * y) as u8)),
            }
        }
        bytes
    }

    fn encode(picture: &[u8], (width, height): (usize, usize), is_deep: bool, at_a_time: usize) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(if is_deep { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
        let mut writer = encoder.write_header().unwrap();
        let pixel_bytes = if is_deep { 6 } else { 3 };
        let mut rows = PngRows::begin(&mut writer, width * pixel_bytes, pixel_bytes).unwrap();
        picture.chunks(at_a_time).for_each(|bytes| rows.put(bytes).unwrap());
        rows.finish().unwrap();
        writer.finish().unwrap();
        out
    }

    fn decode(file: &[u8]) -> Vec<u8> {
        let mut reader = png::Decoder::new(io::Cursor::new(file)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        reader.finish().unwrap();
        bytes
    }

    #[test]
    fn readers_find_the_rows_again() {
        // One part, several, rows longer than a part, and more than is waiting at a time.
        for (width, height) in [(1, 1), (1, 700), (90_000, 3), (333, 700), (2000, 3000)] {
            for is_deep in [false, true] {
                let picture = picture(width, height, if is_deep { 6 } else { 3 });
                let file = encode(&picture, (width, height), is_deep, picture.len());
                assert!(decode(&file) == picture, "{width} x {height}, 16 bits: {is_deep}");
                let rows = encode(&picture, (width, height), is_deep, picture.len().div_ceil(7).max(1));
                assert!(rows == file, "{width} x {height}: the bytes depend on how rows come");
            }
        }
    }

    #[test]
    fn the_only_thread_of_a_pool_may_write() {
        let picture = picture(2000, 3000, 3);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let file = pool.install(|| encode(&picture, (2000, 3000), false, picture.len()));
        assert!(decode(&file) == picture);
    }

    /// Parts cost next to nothing: what repeats is found across them.
    #[test]
    fn files_are_as_small_as_those_of_one_part() {
        let (width, height) = (1500, 1000);
        let picture = picture(width, height, 3);
        let mut whole = Vec::new();
        let mut encoder = png::Encoder::new(&mut whole, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&picture).unwrap();
        writer.finish().unwrap();
        let parts = encode(&picture, (width, height), false, picture.len());
        assert!(parts.len() as f64 <= 1.01 * whole.len() as f64, "{} of {}", parts.len(), whole.len());
    }

    /// The predictor of the specification, written as there.
    #[test]
    fn paeth_takes_the_nearest() {
        for (left, above, corner) in (0..=255).step_by(15).flat_map(|a: u16| {
            (0..=255).step_by(17).flat_map(move |b: u16| (0..=255).step_by(5).map(move |c: u16| (a, b, c)))
        }) {
            let p = i32::from(left) + i32::from(above) - i32::from(corner);
            let nearest = [left, above, corner].into_iter().min_by_key(|&x| (p - i32::from(x)).abs()).unwrap();
            assert_eq!(u16::from(paeth(left as u8, above as u8, corner as u8)), nearest);
        }
    }
}
