//! Runs of a batch that lie in journals: where each is, so that the answers are written from them with no more than a
//! run in memory.
//!
//! A journal is read once from its beginning to its end, which finds its runs and checks them, and then once for each
//! array of the output; what is read then is checked again. There may be more journals than files that a program may
//! have open: each is open only while a run of it is read.
//!
//! Bad at: disks, where the journals do not fit into the system's cache: each answer is read up to six times.

use super::answers::{CountedWork, Lens, write_pieces};
use super::kept::{RunPlace, read_placed_runs, read_run};
use super::{Answers, BatchId, Found, KeptRuns, RunEntry};
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Where the runs of a batch lie.
#[derive(Debug, Default)]
pub struct StoredRuns {
    id: Option<BatchId>,
    files: Vec<PathBuf>,
    /// The number of a file, and where the run lies in it.
    runs: BTreeMap<usize, (usize, RunPlace)>,
    found: Found,
    lens: Lens,
    /// Bytes of the largest run.
    largest: u64,
}

impl StoredRuns {
    /// Takes note of the runs of one more journal. Tells what it is of, too, and how many of its runs there were
    /// before, with the same answers.
    ///
    /// # Errors
    /// As [`super::read_kept_runs`], and [`Error::Input`] where a run has other answers than it had before.
    pub fn add(&mut self, path: &Path) -> Result<(KeptRuns, usize)> {
        let wanted = self.id.clone();
        let mut doubled = 0;
        let file = self.files.len();
        self.files.push(path.to_owned());
        let mut take = |id: &BatchId, entry: &RunEntry, answers: Answers, place: RunPlace| {
            self.largest = self.largest.max(place.bytes);
            if let Some(&(other, before)) = self.runs.get(&entry.run) {
                doubled += 1;
                return self.check_same(id, entry.run, (path, &answers), (other, before));
            }
            self.found.add(&entry.found);
            self.lens.add(&answers);
            self.runs.insert(entry.run, (file, place));
            Ok(())
        };
        let kept = read_placed_runs(path, wanted.as_ref(), &mut take)?;
        self.id.get_or_insert_with(|| kept.id.clone());
        Ok((kept, doubled))
    }

    /// Checks that a run has the same answers in two places.
    fn check_same(
        &self,
        id: &BatchId,
        run: usize,
        (path, answers): (&Path, &Answers),
        (other, before): (usize, RunPlace),
    ) -> Result<()> {
        let asked = id.asked().map_err(|message| Error::input(path, None, message))?;
        if read_run(&self.files[other], id, run, before)?.agree(answers, asked) {
            return Ok(());
        }
        let message = format!(
            "run {run} has other answers here than in another journal: one of them is damaged, or was traced by \
             another program; leave out one of the two, or trace that part anew"
        );
        Err(Error::input(path, None, message))
    }

    /// Which batch the runs are of; none before there is a journal.
    pub fn id(&self) -> Option<&BatchId> {
        self.id.as_ref()
    }

    /// Whether there is this run.
    pub fn has(&self, run: usize) -> bool {
        self.runs.contains_key(&run)
    }

    /// How many runs there are.
    pub fn len(&self) -> usize {
        self.runs.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// What was found in all of them.
    pub fn found(&self) -> Found {
        self.found
    }

    /// About how many bytes it takes at the most to write the answers.
    pub fn writing_bytes(&self) -> u64 {
        // As it lies in the journal, and as answers.
        2 * self.largest
    }

    /// Writes the answers of the batch, of which all runs are there, as [`super::write_answers`] does.
    ///
    /// # Errors
    /// As there; [`Error::Io`] with action "read", and [`Error::Input`] when something else lies in a journal by now.
    pub fn write(&self, path: &Path) -> Result<()> {
        let Some(id) = &self.id else { return Ok(()) };
        let asked = id.asked().map_err(|message| Error::input(&self.files[0], None, message))?;
        // What a journal's fault is, is no fault of the output.
        let failure: Mutex<Option<Error>> = Mutex::new(None);
        let fail = |error: Error| {
            let told = io::Error::other(error.to_string());
            failure.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
            told
        };
        let each = |take: &mut dyn FnMut(&Answers) -> io::Result<()>| {
            self.runs.iter().try_for_each(|(&run, &(file, place))| {
                let answers = read_run(&self.files[file], id, run, place).map_err(fail)?;
                take(&answers)
            })
        };
        let work: CountedWork = [None; 2];
        let written = write_pieces(path, (self.lens, &each), (asked, id.has_second()), work);
        match failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
            Some(error) => Err(error),
            None => written,
        }
    }
}
