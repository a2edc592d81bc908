//! Blocks of a picture that lie in journals: where each is, so that the picture is written from them row by row, with
//! no more of it in memory than [`GROUP_BYTES`], or what one row of patches or one band takes.
//!
//! A journal is read once from its beginning to its end, which finds its blocks and checks them, and a second time
//! where rows are due; what is read then is checked again. Files are opened as they are needed: there may be more
//! journals than files that a program may have open. Patches of a thousand parts lie strewn over all of their journals:
//! where not all can be open, each is opened once for so many rows of patches as are gathered at a time.
//!
//! Bad at: disks that turn, because patches of a row lie far from each other in a journal.

use super::PictureBlocks;
use crate::blocks::Area;
use crate::error::{Error, Result};
use crate::io::film::Film;
use crate::io::input::most_open_files;
use crate::io::rows::PutRows;
use bytemuck::{cast_slice, cast_slice_mut};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What rows of patches take at the most that are gathered together, unless a single one takes more.
pub(super) const GROUP_BYTES: u64 = 128 << 20;

/// What is held at a time.
#[derive(Debug, Clone, Copy)]
struct Limits {
    files: usize,
    bytes: u64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { files: most_open_files(), bytes: GROUP_BYTES }
    }
}

/// Where blocks of a picture lie.
#[derive(Debug, Default)]
pub struct StoredBlocks {
    limits: Limits,
    files: Vec<PathBuf>,
    /// Those that are open, by their numbers.
    open: HashMap<usize, File>,
    /// The same numbers, that of the last one that was opened at the end.
    opened: VecDeque<usize>,
    blocks: BTreeMap<usize, Stored>,
}

/// A block in a file.
#[derive(Debug)]
struct Stored {
    file: usize,
    /// Where its pixels begin, in bytes from the file's beginning.
    place: u64,
    /// CRC-32 of each of its places in the picture.
    checksums: Vec<u32>,
}

/// What a block has of the picture in one place.
struct Piece {
    /// In pixels of what is rendered.
    area: Area,
    file: usize,
    place: u64,
    checksum: u32,
}

impl StoredBlocks {
    /// A file in which blocks lie, open already or to be opened when it is needed. Returns its number.
    pub(super) fn add_file(&mut self, path: &Path, open: Option<File>) -> usize {
        let number = self.files.len();
        self.files.push(path.to_owned());
        if let Some(file) = open {
            self.open.insert(number, file);
            self.opened.push_back(number);
        }
        number
    }

    /// Takes note of a block, whose pixels lie in a file from this place on.
    pub(super) fn note(
        &mut self,
        (blocks, number): (&PictureBlocks, usize),
        file: usize,
        place: u64,
        pixels: &[[f32; 3]],
    ) {
        let mut rest = pixels;
        let checksum = |area: Area| {
            let (now, later) = rest.split_at(area.x.len() * area.y.len());
            rest = later;
            crc32fast::hash(cast_slice(now))
        };
        let checksums = blocks.places(number).into_iter().map(checksum).collect();
        self.blocks.insert(number, Stored { file, place, checksums });
    }

    /// Whether there is this block.
    pub fn has(&self, number: usize) -> bool {
        self.blocks.contains_key(&number)
    }

    /// How many blocks there are.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// The pixels of a block, as [`PictureBlocks::gather`] has them; none where it is not there.
    ///
    /// # Errors
    /// [`Error::Io`] with action "read", and [`Error::Input`] when something else lies there by now.
    pub fn block(&mut self, blocks: &PictureBlocks, number: usize) -> Result<Option<Vec<[f32; 3]>>> {
        if !self.has(number) {
            return Ok(None);
        }
        let mut pixels = Vec::new();
        for piece in self.pieces(blocks, &[number]) {
            pixels.extend(self.read(&piece)?);
        }
        Ok(Some(pixels))
    }

    /// Hands on rows of what is rendered, counted from its first one. They begin and end with those of a band, or are
    /// all; their blocks are there.
    ///
    /// # Errors
    /// As [`StoredBlocks::block`], and those of `put`.
    pub fn put_rows(&mut self, blocks: &PictureBlocks, rows: &Range<usize>, put: PutRows) -> Result<()> {
        let width = blocks.size().0 as usize;
        let most = (self.limits.bytes / (Film::PIXEL_BYTES * width as u64)) as usize;
        for numbers in blocks.tiers(rows) {
            let mut pieces = self.pieces(blocks, &numbers);
            let mut rest = &mut pieces[..];
            while let Some(first) = rest.first() {
                let top = first.area.y.start;
                let is_now = |piece: &Piece| piece.area.y.start == top || piece.area.y.end - top <= most;
                let (now, later) = rest.split_at_mut(rest.partition_point(is_now));
                put(&self.strip(now, width)?)?;
                rest = later;
            }
        }
        Ok(())
    }

    /// What some blocks have of the picture, from top to bottom.
    fn pieces(&self, blocks: &PictureBlocks, numbers: &[usize]) -> Vec<Piece> {
        let of_block = |number: &usize| self.blocks.get(number).map(|stored| (*number, stored));
        let pieces = numbers.iter().filter_map(of_block).flat_map(|(number, stored)| {
            let mut place = stored.place;
            let piece = |(area, &checksum): (Area, &u32)| {
                let area = area.seen_from(blocks.place());
                let here = place;
                place += Film::PIXEL_BYTES * (area.x.len() * area.y.len()) as u64;
                Piece { area, file: stored.file, place: here, checksum }
            };
            blocks.places(number).into_iter().zip(&stored.checksums).map(piece).collect::<Vec<_>>()
        });
        let mut pieces: Vec<Piece> = pieces.collect();
        pieces.sort_by_key(|piece| piece.area.y.start);
        pieces
    }

    /// Whole rows of so many pixels, of pieces from top to bottom.
    fn strip(&mut self, pieces: &mut [Piece], width: usize) -> Result<Vec<[f32; 3]>> {
        let (Some(first), Some(last)) = (pieces.first(), pieces.last()) else { return Ok(Vec::new()) };
        let (top, end) = (first.area.y.start, last.area.y.end);
        if let [whole] = pieces {
            return self.read(whole);
        }
        let mut pixels = Film::try_pixels(width * (end - top))?;
        // Each file's one after the other.
        pieces.sort_unstable_by_key(|piece| (piece.file, piece.place));
        for piece in pieces {
            let of_piece = self.read(piece)?;
            let rows = pixels.chunks_exact_mut(width).skip(piece.area.y.start - top);
            let rows = rows.zip(of_piece.chunks_exact(piece.area.x.len()));
            rows.for_each(|(row, of_piece)| row[piece.area.x.clone()].copy_from_slice(of_piece));
        }
        Ok(pixels)
    }

    fn read(&mut self, piece: &Piece) -> Result<Vec<[f32; 3]>> {
        let mut pixels = Film::try_pixels(piece.area.x.len() * piece.area.y.len())?;
        let file = self.file(piece.file)?;
        let bytes: &mut [u8] = cast_slice_mut(&mut pixels);
        let read = file.seek(SeekFrom::Start(piece.place)).and_then(|_| file.read_exact(bytes));
        let path = &self.files[piece.file];
        read.map_err(|error| Error::io("read", path, error))?;
        if crc32fast::hash(cast_slice(&pixels)) == piece.checksum {
            return Ok(pixels);
        }
        let message =
            "the journal is not what it was when it was read first: somebody changes it, or the disk is damaged";
        Err(Error::input(path, None, message))
    }

    /// A file, opened if need be.
    fn file(&mut self, number: usize) -> Result<&mut File> {
        if !self.open.contains_key(&number) {
            while self.opened.len() >= self.limits.files {
                let Some(oldest) = self.opened.pop_front() else { break };
                self.open.remove(&oldest);
            }
            let path = &self.files[number];
            let opened = File::open(path).or_else(|_| {
                // The process may have too many open already.
                self.open.clear();
                self.opened.clear();
                File::open(path)
            });
            self.open.insert(number, opened.map_err(|error| Error::io("read", path, error))?);
            self.opened.push_back(number);
        }
        Ok(self.open.get_mut(&number).expect("it was found or opened"))
    }
}

/// The most pixels of bands that wait for others in memory, where they are kept, too: 192 MiB.
pub(super) const MOST_WAITING: usize = 1 << 24;

/// A band that is finished, but not those above it.
struct Waiting {
    /// The row behind it.
    end: usize,
    /// Its pixels, row by row; `None` where they are kept.
    pixels: Option<Vec<[f32; 3]>>,
}

/// Hands on the rows of a picture in their order while its blocks are rendered: bands as soon as none above them is
/// missing, in whatever order several devices finish them, and everything else from where it is kept.
pub struct RowsInOrder<'a> {
    blocks: PictureBlocks,
    put: PutRows<'a>,
    /// The first row of what is rendered that was not handed on yet.
    next: usize,
    /// By their first rows.
    waiting: BTreeMap<usize, Waiting>,
    /// Pixels that wait in memory, and the most that do which are kept, too.
    waiting_pixels: usize,
    most: usize,
}

/// Hands on rows that are kept.
type PutKept<'k> = &'k dyn Fn(&Range<usize>, PutRows) -> Result<()>;

impl<'a> RowsInOrder<'a> {
    /// Of a picture of which all blocks but the `rest` are kept, and no row was handed on.
    pub fn new(blocks: &PictureBlocks, rest: &[usize], put: PutRows<'a>) -> Self {
        let kept = blocks.numbers().into_iter().filter(|number| rest.binary_search(number).is_err());
        let bands = kept.filter_map(|number| blocks.rows_of_band(number));
        let waiting = bands.map(|rows| (rows.start, Waiting { end: rows.end, pixels: None })).collect();
        RowsInOrder { blocks: *blocks, put, next: 0, waiting, waiting_pixels: 0, most: MOST_WAITING }
    }

    /// Takes the pixels of a block that is finished. Of a band, which may be kept, too, it hands the rows on, or has
    /// them wait for those above; of others nothing is done.
    ///
    /// # Errors
    /// Those of whatever takes the rows, and of `kept`.
    pub fn take(&mut self, number: usize, pixels: Cow<[[f32; 3]]>, is_kept: bool, kept: PutKept) -> Result<()> {
        let Some(rows) = self.blocks.rows_of_band(number) else { return Ok(()) };
        self.go_on(kept)?;
        if rows.start == self.next {
            (self.put)(&pixels)?;
            self.next = rows.end;
            return self.go_on(kept);
        }
        let may_wait = !is_kept || self.waiting_pixels + pixels.len() <= self.most;
        self.waiting_pixels += if may_wait { pixels.len() } else { 0 };
        let pixels = may_wait.then(|| pixels.into_owned());
        self.waiting.insert(rows.start, Waiting { end: rows.end, pixels });
        Ok(())
    }

    /// Hands on what waits, as far as nothing is missing above it.
    fn go_on(&mut self, kept: PutKept) -> Result<()> {
        while let Some(Waiting { mut end, pixels }) = self.waiting.remove(&self.next) {
            if let Some(pixels) = pixels {
                self.waiting_pixels -= pixels.len();
                (self.put)(&pixels)?;
            } else {
                while let Some(Waiting { end: further, pixels: None }) = self.waiting.get(&end) {
                    let further = *further;
                    self.waiting.remove(&end);
                    end = further;
                }
                kept(&(self.next..end), self.put)?;
            }
            self.next = end;
        }
        Ok(())
    }

    /// Hands on what is left, all of which is kept.
    ///
    /// # Errors
    /// As [`RowsInOrder::take`].
    pub fn finish(mut self, kept: PutKept) -> Result<()> {
        self.go_on(kept)?;
        let height = self.blocks.size().1 as usize;
        if self.next < height { kept(&(self.next..height), self.put) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Crop, Part, Picture, PictureId, PictureJournal};
    use super::*;
    use crate::io::film::FilmWindow;
    use crate::options::TraceOptions;
    use crate::random::Random;
    use crate::scene::{Builder, Camera, Samples};
    use crate::tracer::{Finished, Spent};
    use glam::Vec3;

    /// A picture, or a part of one, whose pixels are random.
    struct Pictured {
        film: Film,
        blocks: PictureBlocks,
        id: PictureId,
        folder: tempfile::TempDir,
    }

    impl Pictured {
        fn new(size: (u32, u32), samples: Samples, crop: Option<Crop>) -> Pictured {
            let mut builder = Builder::new();
            builder.quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1);
            let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
            let picture = Picture { camera, size, samples, depth: 1, kill_weight: None };
            let id = PictureId::new(&builder.finish().unwrap(), &picture, crop, &TraceOptions::DEFAULT);
            let mut random = Random::new(11);
            let mut film = Film::black(size.0, size.1);
            film.pixels.fill_with(|| [random.below(1 << 20) as f32, 0.5, -1.0]);
            let folder = tempfile::tempdir().unwrap();
            Pictured { film, blocks: PictureBlocks::new(size, samples, crop), id, folder }
        }

        fn finished<'f>(&'f self, blocks: &'f [usize]) -> Finished<'f> {
            let film = FilmWindow { film: &self.film, place: (0, 0) };
            Finished { blocks, film, spent: Spent::default() }
        }

        /// A journal of some blocks.
        fn journal(&self, name: &str, part: Option<Part>, numbers: &[usize]) -> PictureJournal {
            let path = self.folder.path().join(name);
            let mut journal = PictureJournal::create(&path, &self.id, part, &self.blocks).unwrap();
            numbers.chunks(3).for_each(|some| journal.append(&self.finished(some)).unwrap());
            journal
        }

        /// The pixels of what is rendered.
        fn pixels(&self) -> Vec<[f32; 3]> {
            let mut film = self.blocks.empty_film();
            self.blocks.copy(&self.finished(&self.blocks.numbers()), &mut film).unwrap();
            film.pixels
        }

        /// The rows are those of the picture, where a journal has the blocks of `earlier` and gets those of `rest` from
        /// the one of this number on, in this order; so many pixels wait in memory although they are kept.
        fn assert_in_order(&self, (earlier, rest): (&[usize], &[usize]), (journal_from, most): (usize, usize)) {
            let path = self.journal("a", None, earlier).path().to_owned();
            let nobody = &mut |_: &PictureBlocks, _: &super::super::KeptBlock| Ok(());
            let (journal, _) = PictureJournal::open(&path, &self.id, None, &self.blocks, nobody).unwrap();
            let (journal, mut rows) = (std::cell::RefCell::new(journal), Vec::new());
            let mut put = |more: &[[f32; 3]]| {
                rows.extend_from_slice(more);
                Ok(())
            };
            let mut wanted = rest.to_vec();
            wanted.sort_unstable();
            let mut in_order = RowsInOrder { most, ..RowsInOrder::new(&self.blocks, &wanted, &mut put) };
            let put_kept = |rows: &Range<usize>, put: PutRows| journal.borrow().rows().put(rows, put);
            for (i, &number) in rest.iter().enumerate() {
                let (one, is_kept) = ([number], i >= journal_from);
                let finished = self.finished(&one);
                if is_kept {
                    journal.borrow_mut().append(&finished).unwrap();
                }
                let pixels = self.blocks.gather(number, &finished.film);
                in_order.take(number, pixels, is_kept, &put_kept).unwrap();
                let pixels: usize =
                    in_order.waiting.values().filter_map(|band| band.pixels.as_ref().map(Vec::len)).sum();
                assert_eq!(pixels, in_order.waiting_pixels);
                assert!(journal_from > 0 || pixels <= most, "{pixels} of {most}");
            }
            in_order.finish(&put_kept).unwrap();
            assert!(rows == self.pixels(), "{journal_from}, {most}: {:?}", self.blocks);
            std::fs::remove_file(&path).unwrap();
        }

        fn rows(&self) -> Range<usize> {
            0..self.blocks.size().1 as usize
        }

        /// All rows, one after the other.
        fn stored_rows(&self, stored: &mut StoredBlocks) -> Result<Vec<[f32; 3]>> {
            let mut all = Vec::new();
            let mut put = |rows: &[[f32; 3]]| {
                assert!(rows.len().is_multiple_of(self.blocks.size().0 as usize));
                all.extend_from_slice(rows);
                Ok(())
            };
            stored.put_rows(&self.blocks, &self.rows(), &mut put)?;
            Ok(all)
        }
    }

    fn pictures() -> Vec<Pictured> {
        let crop = Some(Crop { place: (3, 5), size: (690, 500) });
        let samples = [Samples::PerPixel(16), Samples::Error(1.0), Samples::Error(4.0)];
        let small = samples.into_iter().flat_map(|samples| [None, crop].map(|crop| ((700, 520), samples, crop)));
        // Areas below and beside each other, and many bands.
        let others = [((3100, 150), Samples::Error(2.0), None), ((128, 2240), Samples::PerPixel(256), None)];
        small.chain(others).map(|(size, samples, crop)| Pictured::new(size, samples, crop)).collect()
    }

    #[test]
    fn rows_from_journals_are_those_of_the_picture() {
        for picture in pictures() {
            let of = picture.blocks.numbers().len().min(70) as u32;
            let parts: Vec<Part> = (1..=of).rev().map(|number| Part { number, of }).collect();
            let journal = |part: &Part| {
                picture.journal(&part.number.to_string(), Some(*part), &part.blocks(&picture.blocks)).path().to_owned()
            };
            let journals: Vec<PathBuf> = parts.iter().map(journal).collect();
            // All files and rows at a time; fewer files than parts, and rows of a few patches; as little as can be.
            let few = Limits { files: 3, bytes: Film::PIXEL_BYTES * u64::from(picture.blocks.size().0) * 150 };
            for limits in [Limits::default(), few, Limits { files: 1, bytes: 0 }] {
                let mut stored = StoredBlocks { limits, ..StoredBlocks::default() };
                for (part, path) in parts.iter().zip(&journals) {
                    let (kept, doubled) = stored.add(path, Some(&picture.id)).unwrap();
                    assert_eq!((kept.part, doubled), (Some(*part), 0));
                }
                assert_eq!(stored.len(), picture.blocks.numbers().len());
                let found = picture.stored_rows(&mut stored).unwrap();
                assert!(found == picture.pixels(), "{limits:?} {:?}", picture.blocks);
                assert!(stored.open.len() <= limits.files);
            }
        }
    }

    #[test]
    fn what_is_there_twice_is_compared_and_what_changes_is_found() {
        let mut picture = Pictured::new((700, 520), Samples::Error(1.0), None);
        let all = picture.blocks.numbers();
        let first = picture.journal("first", None, &all);
        let mut stored = StoredBlocks::default();
        stored.add(first.path(), None).unwrap();
        let again = picture.journal("again", None, &all[1..]);
        assert_eq!(stored.add(again.path(), None).unwrap().1, all.len() - 1);
        picture.film.pixels[0][2] = -0.0;
        let other = picture.journal("other", None, &all);
        let message = stored.add(other.path(), None).unwrap_err().to_string();
        assert!(message.contains("other: block 0 has other pixels here"), "{message}");

        let mut bytes = std::fs::read(first.path()).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(first.path(), &bytes).unwrap();
        let message = picture.stored_rows(&mut stored).unwrap_err().to_string();
        assert!(message.contains("first: the journal is not what it was"), "{message}");
        bytes.truncate(middle);
        std::fs::write(first.path(), &bytes).unwrap();
        assert_eq!(picture.stored_rows(&mut stored).unwrap_err().exit_code(), 3, "it is cut short");
    }

    #[test]
    fn rows_come_in_order_from_what_is_finished_and_from_what_is_kept() {
        for picture in pictures() {
            let numbers = picture.blocks.numbers();
            let is_kept = |number: &usize| number % 5 < 2 || number % 7 == 6;
            let (kept, rest): (Vec<usize>, Vec<usize>) = numbers.into_iter().partition(is_kept);
            picture.assert_in_order((&kept, &rest), (0, MOST_WAITING));
        }
    }

    #[test]
    fn bands_come_in_order_whatever_the_order_in_which_they_are_finished() {
        let mut random = Random::new(5);
        for picture in pictures().into_iter().filter(|picture| picture.blocks.are_bands()) {
            // Some are kept by an earlier run; others once they are finished, where there is a journal by then.
            let (earlier, mut rest): (Vec<usize>, Vec<usize>) =
                picture.blocks.numbers().into_iter().partition(|number| number % 4 == 1);
            for i in (1..rest.len()).rev() {
                rest.swap(i, random.below(i + 1));
            }
            for waiting in [(0, 0), (0, 5000), (rest.len() / 2, 0), (rest.len(), 0)] {
                picture.assert_in_order((&earlier, &rest), waiting);
            }
        }
    }
}
