//! What is finished of work that is done in pieces, and the journal that keeps it: of pictures, of batches of rays, of
//! stress tests.

use super::{Talk, stop};
use raybrook::low_level::renderer::{Part, PictureJournal};
use raybrook::low_level::runs::BatchJournal;
use raybrook::{Error, Result};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A journal.
pub trait OnDisk: Send + 'static {
    /// Where it is.
    fn path(&self) -> &Path;
    /// Has the disk take what was appended.
    fn sync(&mut self) -> Result<()>;
}

impl OnDisk for PictureJournal {
    fn path(&self) -> &Path {
        self.path()
    }

    fn sync(&mut self) -> Result<()> {
        self.sync()
    }
}

impl OnDisk for BatchJournal {
    fn path(&self) -> &Path {
        self.path()
    }

    fn sync(&mut self) -> Result<()> {
        self.sync()
    }
}

/// What is finished.
pub struct Done<J, M> {
    /// Where it is kept, once it is.
    pub journal: Option<J>,
    pieces: usize,
    /// Pieces that are not in the journal, which is younger.
    unkept: usize,
    /// How many pieces there are in all, and how they are called.
    of: usize,
    called: &'static str,
    /// What else is known of it.
    pub more: M,
}

impl<J: OnDisk, M> Done<J, M> {
    /// Takes what an earlier run of the program has kept: all but `rest` pieces.
    pub fn go_on(&mut self, journal: J, rest: usize, damaged_bytes: u64, talk: Talk) {
        self.pieces = self.of - rest;
        if !talk.quiet {
            tell_begun(journal.path(), (self.pieces, self.of, self.called), damaged_bytes);
        }
        self.journal = Some(journal);
    }

    /// Takes note of so many more pieces that are finished, and has them appended, where `is_worth_it`, by how many are
    /// finished of how many, to a new journal.
    ///
    /// # Errors
    /// Those of `create` and `append`.
    pub fn take(
        &mut self,
        pieces: usize,
        is_worth_it: impl FnOnce(usize, usize) -> bool,
        create: impl FnOnce() -> Result<J>,
        append: impl FnOnce(&mut J) -> Result<()>,
    ) -> Result<()> {
        let finished = self.pieces + pieces;
        if self.journal.is_none() && is_worth_it(finished, self.of) {
            self.journal = Some(create()?);
        }
        match &mut self.journal {
            Some(journal) => append(journal).map_err(|error| what_is_kept(error, self.called))?,
            None => self.unkept += pieces,
        }
        self.pieces = finished;
        Ok(())
    }
}

/// What is finished, for all who do the work and for whoever stops it.
pub struct Log<J, M>(Arc<Mutex<Done<J, M>>>);

impl<J: OnDisk, M: Send + 'static> Log<J, M> {
    /// Nothing is finished of so many pieces, which are called so.
    pub fn new(of: usize, called: &'static str, more: M) -> Log<J, M> {
        Log(Arc::new(Mutex::new(Done { journal: None, pieces: 0, unkept: 0, of, called, more })))
    }

    pub fn lock(&self) -> MutexGuard<'_, Done<J, M>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has the journal brought to the disk, and told of, where the run is stopped.
    pub fn watch(&self, talk: Talk) {
        stop::before_stop(self.last_words(talk));
    }

    /// Brings the journal to the disk, and tells of it.
    pub fn last_words(&self, talk: Talk) -> impl FnOnce() + Send + use<J, M> {
        let log = Log(self.0.clone());
        move || {
            // What is being appended is appended: whoever wants to append more waits for the lock.
            let mut done = log.lock();
            let (kept, of, called) = (done.pieces - done.unkept, done.of, done.called);
            let Some(journal) = &mut done.journal else { return };
            if journal.sync().is_ok() && !talk.quiet {
                tell_kept(journal.path(), (kept, of, called));
            }
        }
    }

    /// Ends keeping: the journal, if there is one, is the caller's.
    pub fn end(&self) -> Option<J> {
        stop::finish(|| self.lock().journal.take())
    }

    /// Ends keeping a part of the work, which took since `start`, and of which the journal at `path` is the result.
    ///
    /// # Errors
    /// The journal cannot be brought to the disk.
    pub fn end_part(&self, path: &Path, part: Part, start: Instant, talk: Talk) -> Result<()> {
        self.end().map_or(Ok(()), |mut journal| journal.sync())?;
        if !talk.quiet {
            let Done { of, called, .. } = *self.lock();
            say!("{}: part {part}, {of} {called}, {:.2} s", path.display(), start.elapsed().as_secs_f64());
        }
        Ok(())
    }
}

/// Says what of an earlier run is there: so much of so much, in such pieces.
fn tell_begun(path: &Path, (done, of, pieces): (usize, usize, &str), damaged_bytes: u64) {
    let path = path.display();
    if damaged_bytes > 0 {
        tell!("warning: {damaged_bytes} bytes of '{path}' are damaged; their {pieces} are done again");
    }
    tell!("note: goes on with '{path}': {done} of {of} {pieces} are finished; --restart begins anew");
}

/// Says what is there for a later run.
fn tell_kept(path: &Path, (done, of, pieces): (usize, usize, &str)) {
    tell!("note: {done} of {of} {pieces} are kept in '{}'; the same command goes on with them", path.display());
}

/// Says, too, what is not lost.
fn what_is_kept(error: Error, pieces: &str) -> Error {
    match error {
        Error::Io { action, path, source } => {
            let message = format!("{source}; the {pieces} before are kept: make room, and the same command goes on");
            Error::io(action, &path, std::io::Error::new(source.kind(), message))
        }
        other => other,
    }
}
