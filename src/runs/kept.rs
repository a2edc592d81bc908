//! Batches whose finished runs are kept in a journal, so that nothing is traced twice.

use super::answers::RunAnswers;
use super::{Answers, Asked, Found, Runs, Took, TracedRuns};
use crate::error::{Error, Result};
use crate::io::input::read_exact_at;
use crate::io::journal::{self, Condition, HEADER, Journal, Record, Subject};
use crate::io::rays::RayBatch;
use crate::options::TraceOptions;
use crate::parallel;
use crate::renderer::Part;
use crate::scene::Scene;
use bytemuck::{Pod, cast_slice};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::path::Path;

/// What the answers of a batch depend on. Journals of different batches do not go together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BatchId {
    /// Version of raybrook.
    version: String,
    /// [`Scene::geometry_digest`]: of the scene nothing else is read. Journals that had all of the scene here are not
    /// read.
    geometry: String,
    /// SHA-256 of the rays' numbers.
    rays: String,
    count: usize,
    /// Rays of a run.
    run: usize,
    /// [`Asked`] in words.
    asked: String,
    has_second: bool,
    /// The options of a method that is not exact; all exact ones have the same hits.
    method: Option<String>,
}

impl BatchId {
    /// Of these rays through a scene.
    pub fn new(scene: &Scene, (batch, runs): (&RayBatch, Runs), asked: Asked, options: &TraceOptions) -> BatchId {
        BatchId {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            geometry: scene.geometry_digest(),
            rays: digest_of(batch, runs),
            count: batch.len(),
            run: runs.length,
            asked: asked.to_string(),
            has_second: asked == Asked::Closest && batch.next_directions.is_some(),
            method: (!options.is_exact()).then(|| format!("{options:?}")),
        }
    }

    /// What is asked of each ray.
    ///
    /// # Errors
    /// Says what stands there instead.
    pub fn asked(&self) -> std::result::Result<Asked, String> {
        self.asked.parse()
    }

    /// Whether there are secondary rays.
    pub fn has_second(&self) -> bool {
        self.has_second
    }

    /// How many rays there are.
    pub fn rays(&self) -> usize {
        self.count
    }

    /// How the batch is cut.
    pub fn runs(&self) -> Runs {
        Runs::of_length(self.count, self.run)
    }

    /// What another batch has differently.
    pub fn difference(&self, other: &BatchId) -> Option<String> {
        let or_none = |value: &Option<String>| value.clone().unwrap_or_else(|| "none".to_owned());
        let fields = [
            ("version of raybrook", self.version.clone(), other.version.clone()),
            ("number of rays", self.count.to_string(), other.count.to_string()),
            ("number of rays of a run", self.run.to_string(), other.run.to_string()),
            ("question", self.asked.clone(), other.asked.clone()),
            ("method", or_none(&self.method), or_none(&other.method)),
        ];
        let differs = fields.iter().find(|(_, a, b)| a != b).map(|(name, a, b)| format!("its {name} is {b}, not {a}"));
        let differs =
            differs.or_else(|| (self.geometry != other.geometry).then(|| "its scene has other triangles".to_owned()));
        differs.or_else(|| (self != other).then(|| "its rays are others".to_owned()))
    }
}

/// SHA-256, in hexadecimal, of those of the runs, which are made on all cores.
fn digest_of(batch: &RayBatch, runs: Runs) -> String {
    fn add<T: Pod>(hash: &mut Sha256, name: &str, values: Option<&[T]>) {
        // What is not there can be taken for nothing else.
        let Some(values) = values else { return };
        hash.update(name);
        hash.update(cast_slice::<T, u8>(values));
    }
    let of_run = |run: usize| {
        let rays = runs.rays_of(run..run + 1);
        let mut hash = Sha256::new();
        add(&mut hash, "origin", Some(&batch.origins[rays.clone()]));
        add(&mut hash, "direction", Some(&batch.directions[rays.clone()]));
        add(&mut hash, "t_min", batch.t_min.as_ref().map(|values| &values[rays.clone()]));
        add(&mut hash, "t_max", batch.t_max.as_ref().map(|values| &values[rays.clone()]));
        add(&mut hash, "next_direction", batch.next_directions.as_ref().map(|values| &values[rays]));
        hash.finalize()
    };
    let of_runs = parallel::map(0..runs.count(), of_run);
    let mut hash = Sha256::new();
    of_runs.iter().for_each(|run| hash.update(run));
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What lies before the answers of a record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RunEntry {
    /// The run's number.
    pub run: usize,
    /// What was found.
    pub found: Found,
    /// What it took, with the runs behind it that were traced together with it, whose records have none.
    pub took: Took,
}

/// The first byte of a record.
const RUN: u8 = b'R';

/// The first record of a journal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Header {
    batch: BatchId,
    part: Option<Part>,
}

/// A journal of the runs of a batch.
#[derive(Debug)]
pub struct BatchJournal {
    journal: Journal,
    asked: Asked,
    runs: Runs,
}

impl BatchJournal {
    /// A new one, of a batch or a part of the work on it, of which no run is finished.
    ///
    /// # Errors
    /// As [`Journal::create`].
    pub fn create(path: &Path, id: &BatchId, part: Option<Part>) -> Result<BatchJournal> {
        BatchJournal::of(Journal::create_for(path, &Header { batch: id.clone(), part })?, id)
    }

    fn of(journal: Journal, id: &BatchId) -> Result<BatchJournal> {
        let asked = id.asked().map_err(|message| Error::input(journal.path(), None, message))?;
        Ok(BatchJournal { asked, runs: id.runs(), journal })
    }

    /// Opens one to go on with it; `take` gets the runs that are in it.
    ///
    /// # Errors
    /// As [`Journal::open`], those of `take`, and [`Error::Input`] when it is of another batch or part.
    pub fn open(path: &Path, id: &BatchId, part: Option<Part>, take: TakeRun) -> Result<(BatchJournal, KeptRuns)> {
        let mut take = |id: &BatchId, entry: &RunEntry, answers, _| take(id, entry, answers);
        let mut reader = Reader::new(path, Some(id), &mut take);
        let (journal, condition) = Journal::open_placed(path, |record| reader.take(record))?;
        let kept = reader.finish(condition)?;
        Part::check_same(path, kept.part, part, "the whole batch")?;
        Ok((BatchJournal::of(journal, id)?, kept))
    }

    /// Appends runs that are finished, a record each.
    ///
    /// # Errors
    /// As [`Journal::append`].
    pub fn append(&mut self, traced: &TracedRuns) -> Result<()> {
        let mut took = Some(traced.took);
        let answers = traced.answers.of_runs(self.asked, self.runs, traced.runs.clone());
        for ((run, found), answers) in traced.runs.clone().zip(&traced.found).zip(answers) {
            self.append_run(&RunEntry { run, found: *found, took: took.take().unwrap_or_default() }, answers)?;
        }
        Ok(())
    }

    fn append_run(&mut self, entry: &RunEntry, answers: RunAnswers) -> Result<()> {
        let (begin, RunAnswers { counts, hits, next_hits }) = (self.journal.begin_record(RUN, entry)?, answers);
        self.journal.append(&[&begin, cast_slice(counts), cast_slice(hits), cast_slice(next_hits)])
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

    /// Removes it: the answers are written.
    ///
    /// # Errors
    /// As [`Journal::remove`].
    pub fn remove(self) -> Result<()> {
        self.journal.remove()
    }
}

/// What was in a journal.
#[derive(Debug, Clone)]
pub struct KeptRuns {
    /// Of which batch it is.
    pub id: BatchId,
    /// Of which part of the work on it.
    pub part: Option<Part>,
    /// Whether everything in it could be read.
    pub condition: Condition,
}

/// Takes the answers of a run.
pub type TakeRun<'a> = &'a mut dyn FnMut(&BatchId, &RunEntry, Answers) -> Result<()>;

/// Reads the journal of a batch, or of a part of one; `take` gets its runs.
///
/// # Errors
/// As [`journal::read`], those of `take`, and [`Error::Input`] when it is of another batch than `id`.
pub fn read_kept_runs(path: &Path, id: Option<&BatchId>, take: TakeRun) -> Result<KeptRuns> {
    read_placed_runs(path, id, &mut |id, entry, answers, _| take(id, entry, answers))
}

/// Where a run lies in a journal.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunPlace {
    /// Of its record's payload, in bytes from the file's beginning.
    place: u64,
    /// How long that is.
    pub bytes: u64,
    checksum: u32,
}

type TakePlacedRun<'a> = &'a mut dyn FnMut(&BatchId, &RunEntry, Answers, RunPlace) -> Result<()>;

/// As [`read_kept_runs`]; `take` is told, too, where each run lies.
pub(super) fn read_placed_runs(path: &Path, id: Option<&BatchId>, take: TakePlacedRun) -> Result<KeptRuns> {
    let mut reader = Reader::new(path, id, take);
    let condition = journal::read_placed(path, |record| reader.take(record))?;
    reader.finish(condition)
}

/// Reads a run again.
pub(super) fn read_run(path: &Path, id: &BatchId, run: usize, place: RunPlace) -> Result<Answers> {
    let mut payload = vec![0; place.bytes as usize];
    let read = File::open(path).and_then(|file| read_exact_at(&file, &mut payload, place.place));
    read.map_err(|error| Error::io("read", path, error))?;
    if crc32fast::hash(&payload) != place.checksum {
        let message =
            "the journal is not what it was when it was read first: somebody changes it, or the disk is damaged";
        return Err(Error::input(path, None, message));
    }
    let wrong = || journal::wrong_record(path);
    let asked = id.asked().map_err(|message| Error::input(path, None, message))?;
    let (_, rest) = payload.split_first().ok_or_else(wrong)?;
    let (_, answers): (RunEntry, _) = journal::entry_of(path, rest)?;
    answers_of(answers, asked, (id.runs().len_of(run), id.has_second)).ok_or_else(wrong)
}

/// A journal that is being read.
struct Reader<'a> {
    path: &'a Path,
    /// Of which batch it must be.
    wanted: Option<&'a BatchId>,
    put: TakePlacedRun<'a>,
    found: Option<(Header, Asked)>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, wanted: Option<&'a BatchId>, put: TakePlacedRun<'a>) -> Self {
        Reader { path, wanted, put, found: None }
    }

    fn refuse(&self, message: String) -> Error {
        Error::input(self.path, None, message)
    }

    fn take(&mut self, record: &Record) -> Result<()> {
        match (record.payload.split_first(), &self.found) {
            (Some((&HEADER, header)), None) => self.take_header(header),
            (Some((&RUN, rest)), Some(_)) => self.take_run(record, rest),
            _ => Err(journal::no_header(self.path)),
        }
    }

    fn take_header(&mut self, header: &[u8]) -> Result<()> {
        let header: Header =
            serde_json::from_slice(header).map_err(|error| self.refuse(Subject::Batch.refusal(header, &error)))?;
        if let Some(difference) = self.wanted.and_then(|wanted| wanted.difference(&header.batch)) {
            return Err(self.refuse(format!("the journal is of another batch: {difference}")));
        }
        let asked = header.batch.asked();
        let asked = asked.map_err(|message| self.refuse(format!("the journal's header is wrong: {message}")))?;
        self.found = Some((header, asked));
        Ok(())
    }

    fn take_run(&mut self, record: &Record, rest: &[u8]) -> Result<()> {
        let wrong = || journal::wrong_record(self.path);
        let Some((Header { batch, .. }, asked)) = &self.found else { return Err(journal::no_header(self.path)) };
        let (entry, answers): (RunEntry, _) = journal::entry_of(self.path, rest)?;
        if entry.run >= batch.runs().count() {
            return Err(wrong());
        }
        let (rays, has_second) = (batch.runs().len_of(entry.run), batch.has_second);
        let answers = answers_of(answers, *asked, (rays, has_second)).ok_or_else(wrong)?;
        let &Record { payload, place } = record;
        let place = RunPlace { place, bytes: payload.len() as u64, checksum: crc32fast::hash(payload) };
        (self.put)(batch, &entry, answers, place)
    }

    fn finish(mut self, condition: Condition) -> Result<KeptRuns> {
        let Some((Header { batch, part }, _)) = self.found.take() else { return Err(journal::no_header(self.path)) };
        Ok(KeptRuns { id: batch, part, condition })
    }
}

/// The answers of so many rays as a record has them, if it has just these.
fn answers_of(bytes: &[u8], asked: Asked, (rays, has_second): (usize, bool)) -> Option<Answers> {
    let mut rest = bytes;
    let mut answers = Answers::default();
    let mut hits = rays;
    if asked.most().is_some() {
        answers.counts = taken(&mut rest, rays)?;
        let all = || answers.counts.iter().map(|&count| count as usize).sum();
        hits = if asked.lists_hits() { all() } else { 0 };
    }
    answers.hits = taken(&mut rest, hits)?;
    answers.next_hits = taken(&mut rest, if has_second { rays } else { 0 })?;
    rest.is_empty().then_some(answers)
}

/// The first values of some bytes, which lie anywhere, and are taken away.
fn taken<T: Pod>(bytes: &mut &[u8], count: usize) -> Option<Vec<T>> {
    let (now, later) = bytes.split_at_checked(count.checked_mul(size_of::<T>())?)?;
    *bytes = later;
    Some(bytemuck::pod_collect_to_vec(now))
}
