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
    pub version: String,
    pub seed: u64,
    /// Of each kind.
    pub rays: usize,
    pub question: String,
    pub kinds: Vec<String>,
    /// Their names and options.
    pub methods: Vec<String>,
    /// Whether each is judged strictly.
    pub strict: Vec<bool>,
    /// A method that is not exact may have other answers on another device.
    pub device: String,
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
    pub kind: String,
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
        Journal::create_for(&self.path, &Header { stress: self.id.clone() })
    }

    /// Takes what an earlier run has kept.
    fn go_on(&mut self, of: usize, talk: Talk) -> Result<()> {
        let mut has_header = false;
        let (path, id, kept) = (&self.path, &self.id, &mut self.kept);
        let (journal, condition) = Journal::open(path, |record| {
            match record.split_first() {
                Some((&HEADER, header)) if !has_header => {
                    check_header(path, header, id)?;
                    has_header = true;
                }
                Some((&CELL, rest)) if has_header => {
                    let (cell, _): (Cell, _) = journal::entry_of(path, rest)?;
                    let is_of_run = id.kinds.contains(&cell.kind) && cell.faults.len() == id.methods.len();
                    if !is_of_run {
                        return Err(journal::wrong_record(path));
                    }
                    kept.insert((cell.kind.clone(), cell.scene), cell);
                }
                _ => return Err(journal::no_header(path)),
            }
            Ok(())
        })?;
        if !has_header {
            return Err(journal::no_header(path));
        }
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
        let append = |journal: &mut Journal| {
            let record = journal.begin_record(CELL, cell)?;
            journal.append(&[&record])
        };
        self.log.lock().take(1, is_worth_it, || self.new_journal(), append)
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

fn check_header(path: &Path, header: &[u8], id: &StressId) -> Result<()> {
    let found: std::result::Result<Header, _> = serde_json::from_slice(header);
    let found = found.map_err(|error| Error::input(path, None, Subject::Stress.refusal(header, &error)))?;
    match id.difference(&found.stress) {
        Some(difference) => Err(Error::input(path, None, format!("the journal is of another run: {difference}"))),
        None => Ok(()),
    }
}
