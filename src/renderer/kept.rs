//! Pictures whose finished blocks are kept in a journal, so that nothing is rendered twice: a run that was stopped goes
//! on, and parts that several machines rendered are merged.

use super::{Crop, Picture, PictureBlocks, StoredBlocks};
use crate::error::{Error, Result};
use crate::io::journal::{self, Condition, HEADER, Journal, Record, Subject};
use crate::io::rows::PutRows;
use crate::options::TraceOptions;
use crate::scene::{PictureDefaults, Samples, Scene};
use crate::tracer::{Finished, Spent};
use bytemuck::cast_slice;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

/// What a picture's pixels depend on. Journals of different pictures do not go together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureId {
    /// Version of raybrook.
    version: String,
    /// [`Scene::digest`] of the completed scene, its camera included.
    scene: String,
    /// Width and height in pixels.
    size: (u32, u32),
    /// As in the options, of which a picture has one.
    error: Option<String>,
    samples: Option<String>,
    /// The part of the picture that is rendered, as in the option.
    crop: Option<String>,
    depth: u32,
    /// As in the option.
    kill_weight: Option<String>,
    roulette: Option<String>,
    /// Names of values, as in the options.
    texture_filter: String,
    terminator: String,
    /// The options of a method that is not exact; all exact ones have the same pixels.
    method: Option<String>,
}

impl PictureId {
    /// Of a picture of a completed scene.
    pub fn new(scene: &Scene, picture: &Picture, crop: Option<Crop>, options: &TraceOptions) -> PictureId {
        let (error, samples) = match picture.samples {
            Samples::Error(error) => (Some(error.to_string()), None),
            Samples::PerPixel(count) => (None, Some(count.to_string())),
            Samples::Corners => (None, Some(Samples::CORNERS.to_owned())),
        };
        PictureId {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.digest(),
            size: picture.size,
            error,
            samples,
            crop: crop.map(|crop| crop.to_string()),
            depth: picture.depth,
            kill_weight: picture.kill_weight.map(|weight| weight.to_string()),
            roulette: options.picture.roulette.map(|weight| weight.to_string()),
            texture_filter: options.picture.texture_filter.name().to_owned(),
            terminator: options.picture.terminator.name().to_owned(),
            method: (!options.is_exact()).then(|| format!("{:?}", TraceOptions { counters: false, ..*options })),
        }
    }

    /// How the picture is cut into blocks.
    ///
    /// # Errors
    /// Says what in it is no such thing.
    pub fn blocks(&self) -> std::result::Result<PictureBlocks, String> {
        let samples = match (&self.error, &self.samples) {
            (Some(error), None) => Samples::Error(error.parse().map_err(|_| format!("'{error}' is no error"))?),
            (None, Some(samples)) => samples.parse()?,
            _ => return Err("it has no samples and no error, or both".to_owned()),
        };
        let (width, height) = self.size;
        if [width, height].iter().any(|side| !(1..=PictureDefaults::MAX_SIDE).contains(side)) {
            return Err(format!("{width}x{height} is no size of a picture"));
        }
        samples.check(self.size).map_err(|error| error.to_string())?;
        let crop = self.crop.as_ref().map(|crop| crop.parse::<Crop>()).transpose()?;
        crop.map_or(Ok(()), |crop| crop.check(self.size)).map_err(|error| error.to_string())?;
        Ok(PictureBlocks::new(self.size, samples, crop))
    }

    /// What another picture has differently.
    pub fn difference(&self, other: &PictureId) -> Option<String> {
        let or_none = |value: &Option<String>| value.clone().unwrap_or_else(|| "none".to_owned());
        let size = |(width, height): (u32, u32)| format!("{width}x{height}");
        let fields = [
            ("version of raybrook", self.version.clone(), other.version.clone()),
            ("size", size(self.size), size(other.size)),
            ("error", or_none(&self.error), or_none(&other.error)),
            ("samples", or_none(&self.samples), or_none(&other.samples)),
            ("crop", or_none(&self.crop), or_none(&other.crop)),
            ("depth", self.depth.to_string(), other.depth.to_string()),
            ("kill weight", or_none(&self.kill_weight), or_none(&other.kill_weight)),
            ("roulette", or_none(&self.roulette), or_none(&other.roulette)),
            ("texture filter", self.texture_filter.clone(), other.texture_filter.clone()),
            ("terminator", self.terminator.clone(), other.terminator.clone()),
            ("method", or_none(&self.method), or_none(&other.method)),
        ];
        let differs = fields.iter().find(|(_, a, b)| a != b).map(|(name, a, b)| format!("its {name} is {b}, not {a}"));
        differs.or_else(|| (self.scene != other.scene).then(|| "its scene, camera or light is another".to_owned()))
    }
}

/// What lies before the pixels of a record.
#[derive(Serialize, Deserialize)]
struct Entry {
    blocks: Vec<usize>,
    spent: Spent,
}

/// The first byte of a record.
const BLOCKS: u8 = b'B';

/// The first record of a journal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Header {
    picture: PictureId,
    part: Option<Part>,
}

/// One of several parts of the work on a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "PartNumbers")]
pub struct Part {
    /// Counted from 1.
    pub number: u32,
    /// How many there are, 1 to [`Part::MOST`].
    pub of: u32,
}

/// As a journal has them.
#[derive(Deserialize)]
struct PartNumbers {
    number: u32,
    of: u32,
}

impl TryFrom<PartNumbers> for Part {
    type Error = String;

    fn try_from(PartNumbers { number, of }: PartNumbers) -> std::result::Result<Part, String> {
        let part = Part { number, of };
        let is_one = (1..=Part::MOST).contains(&of) && (1..=of).contains(&number);
        if is_one { Ok(part) } else { Err(format!("{part} is no part of a picture or batch")) }
    }
}

impl Part {
    /// The most parts.
    pub const MOST: u32 = 1_000_000;

    /// Checks that a journal is of the part that is wanted; without a number both are `whole`.
    pub(crate) fn check_same(path: &Path, found: Option<Part>, wanted: Option<Part>, whole: &str) -> Result<()> {
        if found == wanted {
            return Ok(());
        }
        let name = |part: Option<Part>| part.map_or(whole.to_owned(), |part| format!("part {part}"));
        let message = format!("the journal is of {}, not of {}", name(found), name(wanted));
        Err(Error::input(path, None, message))
    }

    /// The blocks that this part has of a picture.
    pub fn blocks(self, blocks: &PictureBlocks) -> Vec<usize> {
        blocks.of_part(self.number.max(1) as usize - 1, self.of.max(1) as usize)
    }
}

/// As people type it.
impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Part, String> {
        let numbers = || {
            let (number, of) = text.split_once('/')?;
            Part::try_from(PartNumbers { number: number.parse().ok()?, of: of.parse().ok()? }).ok()
        };
        numbers().ok_or_else(|| format!("expected I/N, part I of N with N up to {}, such as 3/16", Part::MOST))
    }
}

/// A journal of the blocks of a picture.
#[derive(Debug)]
pub struct PictureJournal {
    journal: Journal,
    kept: KeptRows,
}

/// Rows of a picture from its journal, which whoever writes them may have while the journal goes on.
#[derive(Debug, Clone)]
pub struct KeptRows {
    blocks: PictureBlocks,
    stored: Arc<Mutex<StoredBlocks>>,
}

impl KeptRows {
    /// As [`StoredBlocks::put_rows`].
    ///
    /// # Errors
    /// As there.
    pub fn put(&self, rows: &Range<usize>, put: PutRows) -> Result<()> {
        self.with(|stored| stored.put_rows(&self.blocks, rows, put))
    }

    fn with<T>(&self, ask: impl FnOnce(&mut StoredBlocks) -> T) -> T {
        ask(&mut self.stored.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl PictureJournal {
    /// A new one, of a picture or a part of the work on it, of which no block is finished.
    ///
    /// # Errors
    /// As [`Journal::create`].
    pub fn create(path: &Path, id: &PictureId, part: Option<Part>, blocks: &PictureBlocks) -> Result<PictureJournal> {
        let journal = Journal::create_for(path, &Header { picture: id.clone(), part })?;
        Self::with_blocks(journal, blocks, StoredBlocks::default())
    }

    fn with_blocks(journal: Journal, blocks: &PictureBlocks, mut stored: StoredBlocks) -> Result<PictureJournal> {
        // The first file: what is noted of its blocks says so.
        stored.add_file(journal.path(), Some(journal.reader()?));
        let kept = KeptRows { blocks: *blocks, stored: Arc::new(Mutex::new(stored)) };
        Ok(PictureJournal { journal, kept })
    }

    /// Opens one to go on with it; `take` gets the blocks that are in it.
    ///
    /// # Errors
    /// As [`Journal::open`], those of `take`, and [`Error::Input`] when it is of another picture or part.
    pub fn open(
        path: &Path,
        id: &PictureId,
        part: Option<Part>,
        blocks: &PictureBlocks,
        take: TakeBlock,
    ) -> Result<(PictureJournal, Kept)> {
        let mut stored = StoredBlocks::default();
        let mut note = |blocks: &PictureBlocks, block: &KeptBlock| {
            stored.note((blocks, block.number), 0, block.place, block.pixels);
            take(blocks, block)
        };
        let mut reader = Reader::new(path, Some(id), &mut note);
        let (journal, condition) = Journal::open_placed(path, |record| reader.take(record))?;
        let kept = reader.finish(condition)?;
        Part::check_same(path, kept.part, part, "the whole picture")?;
        Ok((Self::with_blocks(journal, blocks, stored)?, kept))
    }

    /// Appends blocks that are finished.
    ///
    /// # Errors
    /// As [`Journal::append`].
    pub fn append(&mut self, finished: &Finished) -> Result<()> {
        let entry = Entry { blocks: finished.blocks.to_vec(), spent: finished.spent };
        let begin = self.journal.begin_record(BLOCKS, &entry)?;
        let blocks = &self.kept.blocks;
        let pixels: Vec<_> = finished.blocks.iter().map(|&number| blocks.gather(number, &finished.film)).collect();
        let mut parts: Vec<&[u8]> = vec![&begin];
        let mut place = self.journal.next_place() + begin.len() as u64;
        parts.extend(pixels.iter().map(|pixels| cast_slice::<[f32; 3], u8>(pixels)));
        self.journal.append(&parts)?;
        self.kept.with(|stored| {
            for (&number, pixels) in finished.blocks.iter().zip(&pixels) {
                stored.note((blocks, number), 0, place, pixels);
                place += size_of_val(&pixels[..]) as u64;
            }
        });
        Ok(())
    }

    /// Where its blocks are to be had.
    pub fn rows(&self) -> KeptRows {
        self.kept.clone()
    }

    /// Has the disk take what was appended.
    ///
    /// # Errors
    /// As [`Journal::sync`].
    pub fn sync(&mut self) -> Result<()> {
        self.journal.sync()
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.journal.path()
    }

    /// Removes it: the picture is written.
    ///
    /// # Errors
    /// As [`Journal::remove`].
    pub fn remove(self) -> Result<()> {
        self.journal.remove()
    }
}

/// What was in a journal.
#[derive(Debug, Clone)]
pub struct Kept {
    /// Of which picture it is.
    pub id: PictureId,
    /// Of which part of the work on it.
    pub part: Option<Part>,
    /// The numbers of its blocks, in ascending order.
    pub blocks: Vec<usize>,
    /// What they took.
    pub spent: Spent,
    /// Whether everything in it could be read.
    pub condition: Condition,
}

/// A block in a journal.
#[derive(Debug, Clone, Copy)]
pub struct KeptBlock<'a> {
    /// Its number.
    pub number: usize,
    /// Its pixels, as [`PictureBlocks::gather`] has them.
    pub pixels: &'a [[f32; 3]],
    /// Where these lie, in bytes from the file's beginning.
    pub place: u64,
}

/// Takes a block.
pub type TakeBlock<'a> = &'a mut dyn FnMut(&PictureBlocks, &KeptBlock) -> Result<()>;

/// Reads the journal of a picture, or of a part of one; `take` gets its blocks.
///
/// # Errors
/// As [`journal::read`], those of `take`, and [`Error::Input`] when it is of another picture than `id`.
pub fn read_kept(path: &Path, id: Option<&PictureId>, take: TakeBlock) -> Result<Kept> {
    let mut reader = Reader::new(path, id, take);
    let condition = journal::read_placed(path, |record| reader.take(record))?;
    reader.finish(condition)
}

impl StoredBlocks {
    /// Takes note of the blocks in a journal, which stays where it is. Returns what is in it, and how many of its
    /// blocks were there already.
    ///
    /// # Errors
    /// As [`read_kept`], and [`Error::Input`] when a block has other pixels than before.
    pub fn add(&mut self, path: &Path, id: Option<&PictureId>) -> Result<(Kept, usize)> {
        let (file, mut doubled) = (self.add_file(path, None), 0);
        let mut take = |blocks: &PictureBlocks, block: &KeptBlock| {
            let Some(before) = self.block(blocks, block.number)? else {
                self.note((blocks, block.number), file, block.place, block.pixels);
                return Ok(());
            };
            doubled += 1;
            if cast_slice::<_, u8>(&before) == cast_slice::<_, u8>(block.pixels) {
                return Ok(());
            }
            let message = format!(
                "block {} has other pixels here than in another journal: one of them is damaged, or was rendered by \
                 another program; leave out one of the two, or render that part anew",
                block.number
            );
            Err(Error::input(path, None, message))
        };
        let kept = read_kept(path, id, &mut take)?;
        Ok((kept, doubled))
    }
}

/// A journal that is being read.
struct Reader<'a> {
    path: &'a Path,
    /// Of which picture it must be.
    wanted: Option<&'a PictureId>,
    put: TakeBlock<'a>,
    found: Option<(Header, PictureBlocks)>,
    blocks: Vec<usize>,
    spent: Spent,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, wanted: Option<&'a PictureId>, put: TakeBlock<'a>) -> Self {
        Reader { path, wanted, put, found: None, blocks: Vec::new(), spent: Spent::default() }
    }

    fn refuse(&self, message: String) -> Error {
        Error::input(self.path, None, message)
    }

    fn take(&mut self, record: &Record) -> Result<()> {
        match (record.payload.split_first(), &self.found) {
            (Some((&HEADER, header)), None) => self.take_header(header),
            (Some((&BLOCKS, rest)), Some((_, blocks))) => {
                let blocks = *blocks;
                self.take_blocks(rest, record.place + record.payload.len() as u64, &blocks)
            }
            _ => Err(journal::no_header(self.path)),
        }
    }

    fn take_header(&mut self, header: &[u8]) -> Result<()> {
        let header: Header =
            serde_json::from_slice(header).map_err(|error| self.refuse(Subject::Picture.refusal(header, &error)))?;
        if let Some(difference) = self.wanted.and_then(|wanted| wanted.difference(&header.picture)) {
            return Err(self.refuse(format!("the journal is of another picture: {difference}")));
        }
        let blocks = header
            .picture
            .blocks()
            .map_err(|message| self.refuse(format!("the journal's header is wrong: {message}")))?;
        self.found = Some((header, blocks));
        Ok(())
    }

    /// `end`: where the record ends in the file.
    fn take_blocks(&mut self, rest: &[u8], end: u64, blocks: &PictureBlocks) -> Result<()> {
        let wrong = || journal::wrong_record(self.path);
        let (entry, mut pixels): (Entry, _) = journal::entry_of(self.path, rest)?;
        for &number in &entry.blocks {
            let count = if blocks.has(number) { blocks.pixels(number) } else { return Err(wrong()) };
            let (now, later) = pixels.split_at_checked(count * size_of::<[f32; 3]>()).ok_or_else(wrong)?;
            // Bytes of a record lie anywhere.
            let values: Vec<[f32; 3]> = bytemuck::pod_collect_to_vec(now);
            (self.put)(blocks, &KeptBlock { number, pixels: &values, place: end - pixels.len() as u64 })?;
            pixels = later;
        }
        if !pixels.is_empty() {
            return Err(wrong());
        }
        self.blocks.extend(entry.blocks);
        self.spent.add(&entry.spent);
        Ok(())
    }

    fn finish(mut self, condition: Condition) -> Result<Kept> {
        let Some((Header { picture, part }, _)) = self.found.take() else { return Err(journal::no_header(self.path)) };
        self.blocks.sort_unstable();
        self.blocks.dedup();
        Ok(Kept { id: picture, part, blocks: self.blocks, spent: self.spent, condition })
    }
}
