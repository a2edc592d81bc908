//! `raybrook merge` of batches of rays.

use super::Talk;
use super::files::Files;
use super::merge::{MergeArgs, names_of_parts};
use raybrook::low_level::budget::{DecidedBy, Need};
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::journal::Subject;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::renderer::Part;
use raybrook::low_level::runs::StoredRuns;
use raybrook::{Error, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Whether journals are of batches of rays.
///
/// # Errors
/// One cannot be read, is none, or is of something else than the others.
pub fn are_batches(journals: &[PathBuf]) -> Result<bool> {
    let mut first: Option<(&Path, Subject)> = None;
    for path in journals {
        let Some(subject) = Subject::of_journal(path)? else { continue };
        let (other, wanted) = *first.get_or_insert((path, subject));
        if subject != wanted {
            let (name, other, wanted) = (subject.name(), other.display(), wanted.name());
            let message = format!("the journal is of {name}, but '{other}' is of {wanted}; merge them one by one");
            return Err(Error::input(path, None, message));
        }
    }
    Ok(first.is_some_and(|(_, subject)| subject == Subject::Batch))
}

/// Of more missing runs it is not looked for whose they are.
const MOST_MISSING: usize = 1 << 20;

/// What was merged so far: where runs lie, and not their answers.
#[derive(Default)]
struct Merged {
    stored: StoredRuns,
    /// Runs that were in more than one journal.
    doubled: usize,
    /// A part of which there is a journal.
    part: Option<Part>,
}

impl Merged {
    /// Takes note of the runs of one more journal.
    fn read(&mut self, path: &Path) -> Result<()> {
        let (kept, doubled) = self.stored.add(path)?;
        self.doubled += doubled;
        self.part = self.part.or(kept.part);
        Ok(())
    }

    /// What is missing, in words, if anything is.
    fn missing(&self, all: usize) -> Option<String> {
        let count = all - self.stored.len();
        if count == 0 {
            return None;
        }
        // A journal may promise any number of runs.
        let missing = (0..all).filter(|run| !self.stored.has(*run)).take(MOST_MISSING);
        let parts = |part: Part| -> BTreeSet<usize> { missing.map(|run| run % part.of as usize).collect() };
        let advice = match self.part {
            None => "let the command that made the journal go on".to_owned(),
            Some(part) => {
                let parts = names_of_parts(part, &parts(part)).join(", ");
                format!("trace these parts, or let them go on: --part {parts}")
            }
        };
        Some(format!("{count} of {all} runs are missing; {advice}"))
    }
}

/// Checks that there is memory for the answers that are read and written at a time.
fn check_memory(args: &MergeArgs, stored: &StoredRuns) -> Result<()> {
    let what = format!("the answers of a run in {} journals", args.journals.len());
    let remedy = "trace fewer hits at a time, or raise --memory-limit";
    args.memory.budget().check(&Need {
        what: &what,
        bytes: stored.writing_bytes(),
        decided_by: DecidedBy::Input,
        remedy,
    })
}

/// Merges journals of batches of rays.
///
/// # Errors
/// They do not belong together, something is missing, or the output cannot be written.
pub fn run(args: &MergeArgs, talk: Talk) -> Result<()> {
    args.file.refuse()?;
    let output = &args.output;
    if ImageFormat::from_path(output).is_ok() {
        let message = format!("'{}': the answers of rays are no picture but arrays, a .npz", output.display());
        return Err(Error::option("-o", message));
    }
    let mut files = Files::default();
    args.journals.iter().for_each(|journal| files.read(journal, "a journal"));
    files.write(output, "-o")?;
    check_writable(output)?;
    let mut merged = Merged::default();
    args.journals.iter().try_for_each(|path| merged.read(path))?;
    let Some(id) = merged.stored.id() else { return Ok(()) }; // there is at least one journal
    if let Some(missing) = merged.missing(id.runs().count()) {
        return Err(Error::input(&args.journals[0], None, missing));
    }
    check_memory(args, &merged.stored)?;
    merged.stored.write(output)?;
    if talk.quiet {
        return Ok(());
    }
    if merged.doubled > 0 {
        tell!("note: {} runs are in more than one journal, with the same answers", merged.doubled);
    }
    say!(
        "{}: {} rays of {} journals, {} hit",
        output.display(),
        id.rays(),
        args.journals.len(),
        merged.stored.found().rays_that_hit
    );
    Ok(())
}
