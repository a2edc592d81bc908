//! `raybrook merge` of batches of rays.

use super::Talk;
use super::files::Files;
use super::merge::{MergeArgs, names_of_parts};
use raybrook::low_level::budget::{DecidedBy, Need};
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::journal::Subject;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::renderer::Part;
use raybrook::low_level::runs::{Answers, BatchId, Found, RunEntry, read_kept_runs, write_answers};
use raybrook::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
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

/// What was merged so far.
#[derive(Default)]
struct Merged {
    first: Option<BatchId>,
    runs: BTreeMap<usize, Answers>,
    found: Found,
    /// Runs that were in more than one journal.
    doubled: usize,
    /// A part of which there is a journal.
    part: Option<Part>,
}

impl Merged {
    /// Takes the runs of one more journal.
    fn read(&mut self, path: &Path) -> Result<()> {
        let Merged { runs, found, doubled, .. } = self;
        let mut take = |id: &BatchId, entry: &RunEntry, answers: Answers| {
            let Some(before) = runs.get(&entry.run) else {
                found.add(&entry.found);
                runs.insert(entry.run, answers);
                return Ok(());
            };
            *doubled += 1;
            let asked = id.asked().map_err(|message| Error::input(path, None, message))?;
            if before.agree(&answers, asked) {
                return Ok(());
            }
            let message = format!(
                "run {} has other answers here than in another journal: one of them is damaged, or was traced by another \
                 program; leave out one of the two, or trace that part again with --restart",
                entry.run
            );
            Err(Error::input(path, None, message))
        };
        let kept = read_kept_runs(path, self.first.as_ref(), &mut take)?;
        self.first.get_or_insert(kept.id);
        self.part = self.part.or(kept.part);
        Ok(())
    }

    /// What is missing, in words, if anything is.
    fn missing(&self, all: usize) -> Option<String> {
        let count = all - self.runs.len();
        if count == 0 {
            return None;
        }
        // A journal may promise any number of runs.
        let missing = (0..all).filter(|run| !self.runs.contains_key(run)).take(MOST_MISSING);
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

/// Checks that there is memory for what is in the journals, as it is there and as it is written.
fn check_memory(args: &MergeArgs) -> Result<()> {
    let bytes = |path: &PathBuf| path.metadata().map_or(0, |found| found.len());
    let bytes = 2 * args.journals.iter().map(bytes).sum::<u64>();
    let what = format!("the answers in {} journals", args.journals.len());
    let remedy = "trace smaller batches, or raise --memory-limit";
    args.memory.budget().check(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
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
    check_memory(args)?;
    let mut merged = Merged::default();
    for path in &args.journals {
        merged.read(path)?;
    }
    let wrong = |message| Error::input(&args.journals[0], None, message);
    let Some(id) = merged.first.take() else { return Ok(()) }; // there is at least one journal
    if let Some(missing) = merged.missing(id.runs().count()) {
        return Err(wrong(missing));
    }
    let pieces: Vec<Answers> = merged.runs.into_values().collect();
    write_answers(output, &pieces, id.asked().map_err(wrong)?, id.has_second())?;
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
        merged.found.rays_that_hit
    );
    Ok(())
}
