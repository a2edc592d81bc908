//! Batches of rays on their way are kept beside their output, as pictures are: run by run, in `OUT.partial`.

use super::Talk;
use super::keep::{Keep, KeepArgs, to_begin_anew};
use super::limit::Limit;
use super::log::Log;
use super::loss::{LossArgs, Watching};
use super::open::Opened;
use super::progress::Bar;
use raybrook::Result;
use raybrook::low_level::renderer::Part;
use raybrook::low_level::runs::{
    Answers, Asked, BatchId, BatchJob, BatchJournal, Found, RunEntry, Runs, Took, TracedRuns, trace_by_several,
    trace_runs, write_answers,
};
use raybrook::low_level::several::Devices;
use raybrook::low_level::tracer::{DeviceShare, LostDevice};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

/// What a batch is, found out where it is needed: hashing takes a while.
pub type LazyId<'a> = LazyLock<BatchId, Box<dyn FnOnce() -> BatchId + Send + 'a>>;

/// What was found in all runs, and what they took.
type RaysTraced = (Found, Took);

/// Keeps the runs of a batch, or of a part of the work on it.
pub struct RayKeeper<'a> {
    log: Log<BatchJournal, Traced>,
    path: PathBuf,
    id: LazyId<'a>,
    part: Option<Part>,
    keep: Keep,
    limit: Limit,
    runs: Runs,
    /// What is to be traced.
    rest: Vec<usize>,
    start: Instant,
}

/// What there is of a batch beside its journal.
#[derive(Default)]
struct Traced {
    /// All that is finished, by the first run; none of a part.
    pieces: BTreeMap<usize, Answers>,
    found: Found,
    took: Took,
}

impl<'a> RayKeeper<'a> {
    /// Opens what is kept of the batch, or of a part of the work on it, if anything is.
    ///
    /// # Errors
    /// What is kept is of another batch, or cannot be read; or it cannot be removed where that is asked for.
    pub fn open(
        (args, limit): (&KeepArgs, Limit),
        (output, part): (&Path, Option<Part>),
        (id, runs): (LazyId<'a>, Runs),
        talk: Talk,
    ) -> Result<RayKeeper<'a>> {
        let (args, path) = args.begin(limit, (output, part), part.is_some())?;
        let rest: Vec<usize> = part.map_or_else(|| (0..runs.count()).collect(), |part| runs.of_part(part));
        let mut keeper = RayKeeper {
            log: Log::new(rest.len(), "runs", Traced::default()),
            keep: args.keep,
            start: Instant::now(),
            path,
            id,
            part,
            limit,
            runs,
            rest,
        };
        if args.goes_on(&keeper.path) {
            keeper.go_on(talk).map_err(|error| to_begin_anew(error, &keeper.path))?;
        } else if part.is_some() || args.keep == Keep::Always {
            keeper.log.lock().journal = Some(keeper.new_journal()?);
        }
        keeper.log.watch(talk);
        Ok(keeper)
    }

    fn new_journal(&self) -> Result<BatchJournal> {
        BatchJournal::create(&self.path, &self.id, self.part)
    }

    /// Takes what an earlier run of the program has kept.
    fn go_on(&mut self, talk: Talk) -> Result<()> {
        let (mut log, part) = (self.log.lock(), self.part);
        let Traced { pieces, found, took } = &mut log.more;
        let mut done = BTreeSet::new();
        let mut take = |_: &BatchId, entry: &RunEntry, answers: Answers| {
            if !done.insert(entry.run) {
                return Ok(());
            }
            found.add(&entry.found);
            took.add(&entry.took);
            if part.is_none() {
                pieces.insert(entry.run, answers);
            }
            Ok(())
        };
        let (journal, kept) = BatchJournal::open(&self.path, &self.id, part, &mut take)?;
        self.rest.retain(|run| !done.contains(run));
        log.go_on(journal, self.rest.len(), kept.condition.damaged_bytes, talk);
        Ok(())
    }

    /// Takes runs that are finished.
    fn take(&self, traced: TracedRuns) -> Result<()> {
        let is_worth_it = |done, of| self.keep.is_worth_it(self.start, done, of);
        let append = |journal: &mut BatchJournal| journal.append(&traced);
        let mut log = self.log.lock();
        log.take(traced.runs.len(), is_worth_it, || self.new_journal(), append)?;
        let Traced { pieces, found, took } = &mut log.more;
        traced.found.iter().for_each(|of_run| found.add(of_run));
        took.add(&traced.took);
        if self.part.is_none() {
            pieces.insert(traced.runs.start, traced.answers);
        }
        Ok(())
    }

    /// What was found in all runs, and what they took.
    fn traced(&self) -> (Found, Took) {
        let log = self.log.lock();
        (log.more.found, log.more.took)
    }

    /// About how many rays are to be traced, in millions.
    fn million_rays(&self) -> f64 {
        self.rest.iter().map(|&run| self.runs.len_of(run)).sum::<usize>() as f64 / 1e6
    }

    /// Traces the runs that are not kept yet. Returns what was found in all, with those of earlier runs of the program,
    /// and what they took.
    ///
    /// # Errors
    /// As [`trace_runs`], and where the journal cannot be made or written.
    pub fn trace(&mut self, opened: &mut Opened, job: &BatchJob, talk: Talk) -> Result<(Found, Took)> {
        let bar = Bar::new("trace", talk);
        let million_rays = self.million_rays();
        let progress = |done: f64| {
            self.limit.check();
            bar.update(done, million_rays, "M rays");
        };
        self.start = Instant::now();
        let mut take = |traced: TracedRuns| self.take(traced);
        let tracer = opened.tracer.as_mut();
        trace_runs((tracer, &opened.buffers), job, (self.runs, &self.rest), &mut take, &progress)?;
        Ok(self.traced())
    }

    /// As [`RayKeeper::trace`], by several devices; tells, too, what each did, and which failed.
    ///
    /// # Errors
    /// As [`trace_by_several`], and where the journal cannot be made or written; [`Error::Stopped`] when the time is
    /// up.
    pub fn trace_by(
        &mut self,
        devices: Devices,
        job: &BatchJob,
        (loss, talk): (LossArgs, Talk),
    ) -> Result<(RaysTraced, Vec<DeviceShare>, Vec<LostDevice>)> {
        self.start = Instant::now();
        let watching =
            Watching::new(Bar::new("trace", talk), (self.million_rays(), "M rays"), (loss, self.limit), talk);
        let take = |traced: TracedRuns| self.take(traced);
        let shares = trace_by_several(devices, job, (self.runs, &self.rest), &take, &watching)?;
        Ok((self.traced(), shares, watching.into_lost()))
    }

    /// Writes the answers of all runs, and ends keeping.
    ///
    /// # Errors
    /// As [`write_answers`]; the journal cannot be removed.
    pub fn write(self, output: &Path, asked: Asked, has_second: bool) -> Result<()> {
        let pieces: Vec<Answers> = std::mem::take(&mut self.log.lock().more.pieces).into_values().collect();
        write_answers(output, &pieces, (asked, has_second), [None; 2])?;
        self.log.end().map_or(Ok(()), BatchJournal::remove)
    }

    /// Ends keeping a part of the work, of which the journal is the result.
    ///
    /// # Errors
    /// The journal cannot be brought to the disk.
    pub fn finish_part(self, part: Part, talk: Talk) -> Result<()> {
        self.log.end_part(&self.path, part, self.start, talk)
    }
}
