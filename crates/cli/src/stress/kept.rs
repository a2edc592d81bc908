//! What a stress test has found is kept beside the file of `--json`, scene by scene, in `FILE.partial`.

use crate::Talk;
use crate::keep::{Keep, KeepArgs, to_begin_anew};
use crate::limit::Limit;
use crate::log::{Log, OnDisk};
use raybrook::low_level::journal::{self, HEADER, Journal, Subject};
use raybrook::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Wrong answers by their sort.
pub type Counts = BTreeMap<String, usize>;

/// What the answers of a run depend on. Journals of other runs are refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StressId {
    /// Of raybrook.
    pub version: String,
    /// Of all rays.
    pub seed: u64,
    /// Of each kind.
    pub rays: usize,
    /// What is asked of each, as in the option.
    pub question: String,
    /// The kinds of rays.
    pub kinds: Vec<String>,
    /// Their names and options.
    pub methods: Vec<String>,
    /// Whether each is judged strictly.
    pub strict: Vec<bool>,
    /// A method that is not exact may have other answers on another device.
    pub device: String,
    /// What its compiler was given beside the usual.
    pub compiler_options: Option<String>,
    /// Where wrong rays are written, which an earlier run has done for what it kept.
    pub write: Option<String>,
}

impl StressId {
    /// What another run has differently.
    fn difference(&self, other: &StressId) -> Option<String> {
        type Field<'f> = (&'f str, &'f dyn Fn(&StressId) -> String);
        let fields: [Field; 7] = [
            ("version of raybrook", &|id| id.version.clone()),
            ("seed", &|id| id.seed.to_string()),
            ("number of rays", &|id| id.rays.to_string()),
            ("question", &|id| id.question.clone()),
            ("device", &|id| id.device.clone()),
            ("list of kinds", &|id| id.kinds.join(", ")),
            ("--write", &|id| id.write.clone().unwrap_or_else(|| "none".to_owned())),
        ];
        let differs = fields.iter().map(|(name, of)| (name, of(self), of(other))).find(|(_, a, b)| a != b);
        let differs = differs.map(|(name, a, b)| format!("its {name} is {b}, not {a}"));
        differs.or_else(|| (self != other).then(|| "its methods, or how they are judged, are others".to_owned()))
    }
}

/// What all methods made of one scene of a kind.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cell {
    /// Its name.
    pub kind: String,
    /// The scene's number in it.
    pub scene: usize,
    /// How many hits the lists or walks have.
    pub hits: Option<usize>,
    /// Of each method.
    pub faults: Vec<Counts>,
    /// What traces rays again that were written.
    pub commands: Vec<String>,
}

/// The first byte of a record.
const CELL: u8 = b'S';

/// The first record of a journal.
#[derive(Serialize, Deserialize)]
struct Header {
    stress: StressId,
}

impl OnDisk for Journal {
    fn path(&self) -> &Path {
        self.path()
    }

    fn sync(&mut self) -> Result<()> {
        self.sync()
    }
}

/// Keeps what is found.
pub struct StressKeeper {
    log: Log<Journal, ()>,
    path: PathBuf,
    id: StressId,
    keep: Keep,
    /// What an earlier run has found, by kind and scene.
    kept: BTreeMap<(String, usize), Cell>,
    start: Instant,
}

impl StressKeeper {
    /// Opens what is kept of a run of so many scenes, if anything is.
    ///
    /// # Errors
    /// What is kept is of another run, or cannot be read; or it cannot be removed where that is asked for.
    pub fn open(
        (args, limit): (&KeepArgs, Limit),
        output: &Path,
        (id, of): (StressId, usize),
        talk: Talk,
    ) -> Result<StressKeeper> {
        let (args, path) = args.begin(limit, (output, None), false)?;
        let log = Log::new(of, "scenes", ());
        let mut keeper = StressKeeper { log, path, id, keep: args.keep, kept: BTreeMap::new(), start: Instant::now() };
        if args.goes_on(&keeper.path) {
            keeper.go_on(of, talk).map_err(|error| to_begin_anew(error, &keeper.path))?;
        } else if args.keep == Keep::Always {
            keeper.log.lock().journal = Some(keeper.new_journal()?);
        }
        Ok(keeper)
    }

    fn new_journal(&self) -> Result<Journal> {
        create(&self.path, &self.id)
    }

    /// Takes what an earlier run has kept.
    fn go_on(&mut self, of: usize, talk: Talk) -> Result<()> {
        let mut reader = Reader::new(&self.path, Some(&self.id));
        let (journal, condition) = Journal::open(&self.path, |record| reader.take(record))?;
        self.kept = reader.finish()?.cells;
        self.log.lock().go_on(journal, of.saturating_sub(self.kept.len()), condition.damaged_bytes, talk);
        Ok(())
    }

    /// What an earlier run has found of a scene.
    pub fn kept(&self, kind: &str, scene: usize) -> Option<&Cell> {
        self.kept.get(&(kind.to_owned(), scene))
    }

    /// Keeps what was found of a scene.
    ///
    /// # Errors
    /// The journal cannot be made or written.
    pub fn take(&self, cell: &Cell) -> Result<()> {
        let is_worth_it = |done, of| self.keep.is_worth_it(self.start, done, of);
        self.log.lock().take(1, is_worth_it, || self.new_journal(), |journal| append(journal, cell))
    }

    /// What is to be done where the run is stopped.
    pub fn last_words(&self, talk: Talk) -> impl FnOnce() + Send + 'static {
        self.log.last_words(talk)
    }

    /// Ends keeping: the report is written.
    ///
    /// # Errors
    /// The journal cannot be removed.
    pub fn finish(self) -> Result<()> {
        self.log.end().map_or(Ok(()), Journal::remove)
    }
}

/// A new journal, of a run of which nothing is found yet.
///
/// # Errors
/// As [`Journal::create_for`].
pub fn create(path: &Path, id: &StressId) -> Result<Journal> {
    Journal::create_for(path, &Header { stress: id.clone() })
}

/// Appends what was found of a scene.
///
/// # Errors
/// As [`Journal::append`].
pub fn append(journal: &mut Journal, cell: &Cell) -> Result<()> {
    let record = journal.begin_record(CELL, cell)?;
    journal.append(&[&record])
}

/// What is in a journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeptCells {
    /// Of which run it is.
    pub id: StressId,
    /// By kind and scene.
    pub cells: BTreeMap<(String, usize), Cell>,
}

/// Reads a journal, of whatever run it is.
///
/// # Errors
/// As [`journal::read`], and [`Error::Input`] when it is none of a stress test.
pub fn read_kept(path: &Path) -> Result<KeptCells> {
    let mut reader = Reader::new(path, None);
    journal::read(path, |record| reader.take(record))?;
    reader.finish()
}

/// A journal that is being read.
struct Reader<'a> {
    path: &'a Path,
    /// Of which run it must be.
    wanted: Option<&'a StressId>,
    found: Option<KeptCells>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, wanted: Option<&'a StressId>) -> Reader<'a> {
        Reader { path, wanted, found: None }
    }

    fn take(&mut self, record: &[u8]) -> Result<()> {
        match (record.split_first(), &mut self.found) {
            (Some((&HEADER, header)), None) => {
                let id = self.header(header)?;
                self.found = Some(KeptCells { id, cells: BTreeMap::new() });
            }
            (Some((&CELL, rest)), Some(found)) => {
                let (cell, _): (Cell, _) = journal::entry_of(self.path, rest)?;
                let is_of_run = found.id.kinds.contains(&cell.kind) && cell.faults.len() == found.id.methods.len();
                if !is_of_run {
                    return Err(journal::wrong_record(self.path));
                }
                found.cells.insert((cell.kind.clone(), cell.scene), cell);
            }
            _ => return Err(journal::no_header(self.path)),
        }
        Ok(())
    }

    fn header(&self, header: &[u8]) -> Result<StressId> {
        let found: std::result::Result<Header, _> = serde_json::from_slice(header);
        let refuse = |message| Error::input(self.path, None, message);
        let found = found.map_err(|error| refuse(Subject::Stress.refusal(header, &error)))?.stress;
        match self.wanted.and_then(|wanted| wanted.difference(&found)) {
            Some(difference) => Err(refuse(format!("the journal is of another run: {difference}"))),
            None => Ok(found),
        }
    }

    fn finish(self) -> Result<KeptCells> {
        self.found.ok_or_else(|| journal::no_header(self.path))
    }
}
