//! Files of pictures, written row by row: PNG, OpenEXR or PFM from rows that come one after the other, so that no more
//! of a picture is in memory than a few of them, whatever its size.
//!
//! The bytes do not depend on how many rows come at a time. A device, a pipe or a socket is written from memory
//! ([`crate::io::output`]), which then has all of the compressed file.

use std::io::{self, SeekFrom, Write};
use std::panic::resume_unwind;
use std::path::Path;
use std::thread::Builder;

use exr::block::chunk::Chunk;
use exr::block::writer::{ChunkWriter, ChunksWriter};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::image::write::WritableImage;
use exr::meta::{Headers, MetaData};
use exr::prelude::{Encoding, Image, SpecificChannels, Vec2};

use crate::error::{Error, Result};
use crate::io::film::{Film, ImageFormat, srgb8, srgb16};
use crate::io::output::{Output, write_atomically};
use crate::io::png_rows::{self, PngRows};
use crate::parallel;

/// Takes the next rows of a picture, top row first: linear RGB radiance of as many whole rows as there are.
pub type PutRows<'a> = &'a mut dyn FnMut(&[[f32; 3]]) -> Result<()>;

/// The same, with what the system says where they cannot be written.
type Put<'a> = &'a mut dyn FnMut(&[[f32; 3]]) -> io::Result<()>;

/// Pixels that are converted at a time.
const PIECE_PIXELS: usize = 1 << 18;
/// Pixels of OpenEXR's blocks that are compressed at a time, each by a thread.
const EXR_PIXELS: usize = 1 << 22;

/// About how many bytes writing a picture of so many pixels takes, beside the rows that are handed over.
pub(crate) fn writing_bytes(format: ImageFormat, pixels: u64) -> u64 {
    let piece = pixels.min(PIECE_PIXELS as u64);
    match format {
        ImageFormat::Png8 => png_rows::writing_bytes(3 * pixels),
        ImageFormat::Png16 => png_rows::writing_bytes(6 * pixels),
        // As they come, as bytes, as bytes in another order, and compressed.
        ImageFormat::Exr => 4 * Film::PIXEL_BYTES * pixels.min(EXR_PIXELS as u64),
        ImageFormat::Pfm => Film::PIXEL_BYTES * piece,
    }
}

/// Writes a picture of `width` x `height` pixels to `path`. `fill` is given what takes its rows, of which all must
/// come; what it returns is returned. The file appears when it is complete (see [`crate::low_level::output`]), and not
/// at all where `fill` fails.
///
/// # Errors
/// Those of `fill`, and [`Error::Io`] when the file cannot be written, or has more or fewer rows.
pub fn write_by_rows<T>(
    path: &Path,
    size: (u32, u32),
    format: ImageFormat,
    fill: impl FnOnce(PutRows) -> Result<T>,
) -> Result<T> {
    let to_error = |error| Error::io("write", path, error);
    let mut outcome = None;
    let written = write_atomically(path, |out| {
        encode(out, size, format, |put| {
            let filled = fill(&mut |rows| put(rows).map_err(to_error));
            // Whoever made the rows knows better what went wrong.
            let ended = filled.as_ref().map(|_| ()).map_err(|_| io::Error::other("its rows could not be made"));
            outcome = Some(filled);
            ended
        })
    });
    match outcome {
        Some(Err(error)) => Err(error),
        Some(Ok(value)) => written.map(|()| value),
        None => Err(written.err().unwrap_or_else(|| to_error(io::Error::other("nobody asked for its rows")))),
    }
}

/// The bytes of such a file, as `fill` puts its rows.
pub(super) fn encode(
    out: &mut dyn Output,
    size: (u32, u32),
    format: ImageFormat,
    fill: impl FnOnce(Put) -> io::Result<()>,
) -> io::Result<()> {
    let all = size.0 as usize * size.1 as usize;
    let refuse = |count| {
        let message = format!("a file of {} x {} pixels cannot hold {count} of them", size.0, size.1);
        io::Error::new(io::ErrorKind::InvalidInput, message)
    };
    if all == 0 {
        return Err(refuse(0));
    }
    let fill = |put: Put| {
        let mut count = 0;
        fill(&mut |pixels| {
            count += pixels.len();
            if count > all { Err(refuse(count)) } else { put(pixels) }
        })?;
        if count < all { Err(refuse(count)) } else { Ok(()) }
    };
    match format {
        ImageFormat::Png8 | ImageFormat::Png16 => write_png(out, size, format, fill),
        ImageFormat::Exr => write_exr(out, size, fill),
        ImageFormat::Pfm => write_pfm(out, size, fill),
    }
}

fn write_png(
    out: &mut dyn Output,
    (width, height): (u32, u32),
    format: ImageFormat,
    fill: impl FnOnce(Put) -> io::Result<()>,
) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    let is_deep = format == ImageFormat::Png16;
    encoder.set_depth(if is_deep { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    // Perceptual is what the PNG specification suggests for pictures whose author states no intent.
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    let pixel_bytes = if is_deep { 6 } else { 3 };
    let mut rows = PngRows::begin(&mut writer, pixel_bytes * width as usize, pixel_bytes)?;
    fill(&mut |pixels| {
        pixels.chunks(PIECE_PIXELS).try_for_each(|piece| match is_deep {
            false => rows.put(srgb8(piece).as_flattened()),
            true => {
                let values: Vec<[u8; 2]> = srgb16(piece).as_flattened().iter().map(|c| c.to_be_bytes()).collect();
                rows.put(values.as_flattened())
            }
        })
    })?;
    rows.finish()?;
    Ok(writer.finish()?)
}

/// Paul Debevec's portable float map: a text header, then the rows from the bottom up; a negative scale means
/// little-endian. So what comes first is written last in the file.
fn write_pfm(
    out: &mut dyn Output,
    (width, height): (u32, u32),
    fill: impl FnOnce(Put) -> io::Result<()>,
) -> io::Result<()> {
    write!(out, "PF\n{width} {height}\n-1.0\n")?;
    let (first, width) = (out.stream_position()?, width as usize);
    let mut left = height as usize;
    fill(&mut |pixels| {
        for rows in pixels.chunks((PIECE_PIXELS / width).max(1) * width) {
            left -= rows.len() / width;
            out.seek(SeekFrom::Start(first + Film::PIXEL_BYTES * (left * width) as u64))?;
            for row in rows.chunks_exact(width).rev() {
                let numbers = row.as_flattened();
                if cfg!(target_endian = "little") {
                    out.write_all(bytemuck::cast_slice(numbers))?;
                } else {
                    let bytes: Vec<[u8; 4]> = numbers.iter().map(|c| c.to_le_bytes()).collect();
                    out.write_all(bytes.as_flattened())?;
                }
            }
        }
        Ok(())
    })
}

fn write_exr(out: &mut dyn Output, size: (u32, u32), fill: impl FnOnce(Put) -> io::Result<()>) -> io::Result<()> {
    let written = exr::block::write(out, exr_headers(size), true, |meta, chunks| {
        let mut blocks = ExrBlocks { meta: &meta, chunks, width: size.0 as usize, waiting: Vec::new(), next: 0 };
        fill(&mut |pixels| blocks.put(pixels).map_err(of_exr)).map_err(exr::error::Error::Io)?;
        blocks.write()
    });
    written.map_err(of_exr)
}

/// One part with the channels R, G and B. ZIP in blocks of 16 rows is the compression that every reader knows.
fn exr_headers((width, height): (u32, u32)) -> Headers {
    let nothing = |_: Vec2<usize>| (0.0_f32, 0.0_f32, 0.0_f32);
    let size = (width as usize, height as usize);
    let image = Image::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, SpecificChannels::rgb(nothing));
    image.write().infer_meta_data()
}

/// What the system said, if it was that.
pub(super) fn of_exr(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(source) => source,
        other => io::Error::other(other),
    }
}

fn rows_of_block(meta: &MetaData) -> usize {
    meta.headers[0].compression.scan_lines_per_block()
}

/// Blocks of rows of an OpenEXR file.
struct ExrBlocks<'a, W> {
    meta: &'a MetaData,
    chunks: &'a mut ChunkWriter<W>,
    width: usize,
    /// Pixels whose blocks are not written yet.
    waiting: Vec<[f32; 3]>,
    /// The first of these.
    next: usize,
}

impl<W: Write + io::Seek> ExrBlocks<'_, W> {
    fn put(&mut self, mut pixels: &[[f32; 3]]) -> exr::error::UnitResult {
        let of_block = rows_of_block(self.meta) * self.width;
        let most = (EXR_PIXELS / of_block).max(1) * of_block;
        while !pixels.is_empty() {
            let (now, later) = pixels.split_at(pixels.len().min(most - self.waiting.len()));
            self.waiting.extend_from_slice(now);
            if self.waiting.len() == most {
                self.write()?;
            }
            pixels = later;
        }
        Ok(())
    }

    /// Writes what is waiting: whole blocks, or the last one.
    fn write(&mut self) -> exr::error::UnitResult {
        let (meta, width, first) = (self.meta, self.width, self.next);
        let blocks = self.waiting.chunks(rows_of_block(self.meta) * width).enumerate();
        let compress = |(i, rows)| compressed(meta, first + i, (rows, width));
        // The system keeps for each thread what this has once taken: three times a block, which may have 13 MB. So
        // where blocks are fewer than threads, only as many threads take something.
        let chunks = match blocks.len() < rayon::current_num_threads() {
            true => std::thread::scope(|scope| {
                let begin = |block| Builder::new().spawn_scoped(scope, move || compress(block));
                let threads = blocks.map(begin).collect::<io::Result<Vec<_>>>()?;
                let chunks =
                    threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
                Ok::<Vec<_>, io::Error>(chunks.collect())
            })?,
            false => parallel::map(blocks, compress),
        };
        for chunk in chunks {
            self.chunks.write_chunk(self.next, chunk?)?;
            self.next += 1;
        }
        self.waiting.clear();
        Ok(())
    }
}

/// The block of this number, of rows of so many pixels.
fn compressed(meta: &MetaData, number: usize, (rows, width): (&[[f32; 3]], usize)) -> exr::error::Result<Chunk> {
    let mut data = Vec::with_capacity(size_of_val(rows));
    for row in rows.chunks_exact(width) {
        // Channels lie in the order of their names: B, G, R.
        (0..3).rev().for_each(|channel| data.extend(row.iter().flat_map(|pixel| pixel[channel].to_ne_bytes())));
    }
    let index = BlockIndex {
        layer: 0,
        pixel_position: Vec2(0, number * rows_of_block(meta)),
        pixel_size: Vec2(width, rows.len() / width),
        level: Vec2(0, 0),
    };
    UncompressedBlock { index, data }.compress_to_chunk(&meta.headers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use std::fs;

    const FORMATS: [(ImageFormat, &str); 4] = [
        (ImageFormat::Png8, "a.png"),
        (ImageFormat::Png16, "b.png"),
        (ImageFormat::Exr, "a.exr"),
        (ImageFormat::Pfm, "a.pfm"),
    ];

    fn film(width: u32, height: u32) -> Film {
        let mut random = Random::new(5);
        // Smooth in parts: rows that compress and rows that do not.
        let pixels = (0..width * height).map(|i| {
            let noise = if i % 7 < 3 { random.below(1000) as f32 / 999.0 } else { 0.5 };
            [i as f32 / (width * height) as f32, noise, -0.5]
        });
        Film { width, height, pixels: pixels.collect() }
    }

    #[test]
    fn the_bytes_do_not_depend_on_how_rows_come() {
        let folder = tempfile::tempdir().unwrap();
        for (width, height) in [(1, 1), (70, 1), (1, 70), (70, 53), (300, 2000)] {
            let film = film(width, height);
            for (format, name) in FORMATS {
                let whole = film.to_bytes(format).unwrap();
                for rows in [1, 16, 23] {
                    let path = folder.path().join(name);
                    let put_all = |put: PutRows| {
                        film.pixels.chunks(rows * width as usize).try_for_each(&mut *put)?;
                        Ok(17)
                    };
                    assert_eq!(write_by_rows(&path, (width, height), format, put_all).unwrap(), 17);
                    assert!(fs::read(&path).unwrap() == whole, "{name} {width} x {height}, {rows} rows at a time");
                }
            }
        }
    }

    /// The crate that writes whole images makes the same file of them.
    #[test]
    fn blocks_of_exr_are_those_of_a_whole_image() {
        let film = film(70, 53);
        let channels = SpecificChannels::rgb(|Vec2(x, y): Vec2<usize>| {
            let [red, green, blue] = film.pixels[y * 70 + x];
            (red, green, blue)
        });
        let image = Image::from_encoded_channels((70, 53), Encoding::SMALL_LOSSLESS, channels);
        let mut whole = io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut whole).unwrap();
        assert!(film.to_bytes(ImageFormat::Exr).unwrap() == whole.into_inner());
    }

    #[test]
    fn files_appear_with_all_of_their_rows_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let film = film(20, 40);
        for (format, name) in FORMATS {
            let path = folder.path().join(name);
            for count in [0, 39, 41] {
                let put_some = |put: PutRows| (0..count).try_for_each(|row| put(&film.pixels[row % 40 * 20..][..20]));
                let error = write_by_rows(&path, (20, 40), format, put_some).unwrap_err();
                assert!(error.exit_code() == 5 && format!("{error:?}").contains("cannot hold"), "{name}: {error:?}");
            }
            let stop = |put: PutRows| {
                put(&film.pixels[..200])?;
                Err::<(), _>(Error::Stopped)
            };
            let error = write_by_rows(&path, (20, 40), format, stop).unwrap_err();
            assert!(matches!(error, Error::Stopped), "{error:?}");
        }
        let nowhere = folder.path().join("no/a.png");
        let error = write_by_rows(&nowhere, (1, 1), ImageFormat::Png8, |put| put(&[[0.0; 3]])).unwrap_err();
        assert_eq!(error.exit_code(), 5);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
