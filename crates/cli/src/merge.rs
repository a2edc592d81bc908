//! `raybrook merge`.

use super::files::Files;
use super::picture_file::PictureFileArgs;
use super::{MemoryArgs, Talk, heading, merge_rays};
use raybrook::low_level::budget::{DecidedBy, Need};
use raybrook::low_level::film::{ImageFormat, check_output};
use raybrook::low_level::input::raise_open_files;
use raybrook::low_level::renderer::{Part, PictureBlocks, PictureId, StoredBlocks, bytes_of_rows};
use raybrook::low_level::rows::PutRows;
use raybrook::low_level::stats::RayCounts;
use raybrook::low_level::tracer::Spent;
use raybrook::{Error, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct MergeArgs {
    /// What `render --part` or `trace --part` has left, or one of both that was stopped, in any order.
    #[arg(value_name = "JOURNAL", required = true)]
    pub journals: Vec<PathBuf>,
    /// Picture to write: .png (sRGB), .exr or .pfm (linear); or the hits of rays: .npz.
    #[arg(short, long, value_name = "FILE", help_heading = heading::OUTPUT)]
    pub output: PathBuf,
    #[command(flatten)]
    pub file: PictureFileArgs,
    #[command(flatten)]
    pub memory: MemoryArgs,
}

/// What was merged so far: where blocks lie, and not their pixels.
#[derive(Default)]
struct Merged {
    stored: StoredBlocks,
    first: Option<PictureId>,
    /// Blocks that were in more than one journal.
    doubled: usize,
    spent: Spent,
    /// A part that one of the journals has.
    part: Option<Part>,
}

impl Merged {
    /// Takes note of the blocks of one more journal.
    fn read(&mut self, path: &Path) -> Result<()> {
        let (kept, doubled) = self.stored.add(path, self.first.as_ref())?;
        self.spent.add(&kept.spent);
        self.doubled += doubled;
        self.part = self.part.or(kept.part);
        self.first.get_or_insert(kept.id);
        Ok(())
    }

    /// What is missing, in words, if anything is.
    fn missing(&self, blocks: &PictureBlocks) -> Option<String> {
        let missing: Vec<usize> = blocks.numbers().into_iter().filter(|&number| !self.stored.has(number)).collect();
        if missing.is_empty() {
            return None;
        }
        let all = missing.len() + self.stored.len();
        let parts = self.parts_of(&missing, blocks);
        let advice = match parts.is_empty() {
            true => "let the command that made the journal go on".to_owned(),
            false => format!("render these parts, or let them go on: --part {}", parts.join(", ")),
        };
        Some(format!("{} of {all} blocks are missing; {advice}", missing.len()))
    }

    /// The parts that have the missing blocks.
    fn parts_of(&self, missing: &[usize], blocks: &PictureBlocks) -> Vec<String> {
        let Some(part) = self.part else { return Vec::new() };
        let has_missing = |blocks: &[usize]| blocks.iter().any(|block| missing.binary_search(block).is_ok());
        let pieces = blocks.by_parts(part.of as usize).filter(|(_, blocks)| has_missing(blocks));
        names_of_parts(part, &pieces.map(|(number, _)| number).collect())
    }
}

/// Parts, numbered from 0, as they are typed; `part` is one like them.
pub fn names_of_parts(part: Part, numbers: &BTreeSet<usize>) -> Vec<String> {
    /// More are not listed.
    const MOST: usize = 20;
    let parts = numbers.iter().map(|&number| Part { number: number as u32 + 1, ..part });
    let mut parts: Vec<String> = parts.take(MOST + 1).map(|part| part.to_string()).collect();
    if parts.len() > MOST {
        parts[MOST] = "and more".to_owned();
    }
    parts
}

/// Checks that there is memory for the rows that are read and written at a time.
fn check_memory(size: (u32, u32), format: ImageFormat, memory: MemoryArgs) -> Result<()> {
    let what = format!("a picture of {}x{} pixels", size.0, size.1);
    let bytes = bytes_of_rows(size, format);
    let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "raise --memory-limit" };
    memory.budget().check(&need)
}

pub fn run(args: &MergeArgs, talk: Talk) -> Result<()> {
    if merge_rays::are_batches(&args.journals)? {
        return merge_rays::run(args, talk);
    }
    let format = args.file.format(&args.output)?;
    let mut files = Files::default();
    args.journals.iter().for_each(|journal| files.read(journal, "a journal"));
    files.write(&args.output, "-o")?;
    check_output(&args.output, Some(format))?;
    merge_pictures(args, format, talk)
}

/// Merges journals of parts of a picture: finds out first where blocks lie, and copies them then row by row.
fn merge_pictures(args: &MergeArgs, format: ImageFormat, talk: Talk) -> Result<()> {
    raise_open_files();
    let mut merged = Merged::default();
    args.journals.iter().try_for_each(|path| merged.read(path))?;
    let Some(id) = &merged.first else { return Ok(()) }; // there is at least one journal
    let blocks = id.blocks().map_err(|message| Error::input(&args.journals[0], None, message))?;
    if let Some(missing) = merged.missing(&blocks) {
        return Err(Error::input(&args.journals[0], None, missing));
    }
    let size = blocks.size();
    check_memory(size, format, args.memory)?;
    let fill = |put: PutRows| merged.stored.put_rows(&blocks, &(0..size.1 as usize), put);
    args.file.write_rows((&args.output, format), size, fill, talk)?;
    if talk.quiet {
        return Ok(());
    }
    if merged.doubled > 0 {
        tell!("note: {} blocks are in more than one journal, with the same pixels", merged.doubled);
    }
    say!(
        "{}: {}x{} of {} journals, {} rays",
        args.output.display(),
        size.0,
        size.1,
        args.journals.len(),
        RayCounts::from_counters(&merged.spent.counts).total_cast()
    );
    Ok(())
}
