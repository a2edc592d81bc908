//! `raybrook merge`.

use super::files::Files;
use super::picture_file::PictureFileArgs;
use super::{MemoryArgs, Talk, heading, merge_rays};
use raybrook::low_level::budget::{DecidedBy, Need};
use raybrook::low_level::film::{Film, FilmWindow, check_output};
use raybrook::low_level::renderer::{Kept, Part, PictureBlocks, PictureId, read_kept};
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

/// What was merged so far.
#[derive(Default)]
struct Merged {
    film: Option<Film>,
    first: Option<PictureId>,
    have: BTreeSet<usize>,
    /// Blocks that were in more than one journal.
    doubled: usize,
    spent: Spent,
    /// What each journal has.
    parts: Vec<Kept>,
}

impl Merged {
    /// Takes the blocks of one more journal.
    fn read(&mut self, path: &Path, memory: MemoryArgs) -> Result<()> {
        let Merged { film, have, doubled, .. } = self;
        let mut take = |blocks: &PictureBlocks, number: usize, pixels: &[[f32; 3]]| {
            let film = match film {
                Some(film) => film,
                None => film.insert(new_film(blocks, memory)?),
            };
            if have.insert(number) {
                return blocks.scatter(number, pixels, film);
            }
            *doubled += 1;
            let before = blocks.gather(number, &FilmWindow { film, place: blocks.place() });
            let is_same = |(a, b): (&[f32; 3], &[f32; 3])| a.map(f32::to_bits) == b.map(f32::to_bits);
            if before.iter().zip(pixels).all(is_same) {
                return Ok(());
            }
            let message = format!(
                "block {number} has other pixels here than in another journal: one of them is damaged, or was rendered by another \
                 program; leave out one of the two, or render that part again with --restart"
            );
            Err(Error::input(path, None, message))
        };
        let kept = read_kept(path, self.first.as_ref(), &mut take)?;
        self.first.get_or_insert_with(|| kept.id.clone());
        self.spent.add(&kept.spent);
        self.parts.push(kept);
        Ok(())
    }

    /// What is missing, in words, if anything is.
    fn missing(&self, blocks: &PictureBlocks) -> Option<String> {
        let missing: Vec<usize> = blocks.numbers().into_iter().filter(|number| !self.have.contains(number)).collect();
        if missing.is_empty() {
            return None;
        }
        let all = missing.len() + self.have.len();
        let parts = self.parts_of(&missing, blocks);
        let advice = match parts.is_empty() {
            true => "let the command that made the journal go on".to_owned(),
            false => format!("render these parts, or let them go on: --part {}", parts.join(", ")),
        };
        Some(format!("{} of {all} blocks are missing; {advice}", missing.len()))
    }

    /// The parts that have the missing blocks.
    fn parts_of(&self, missing: &[usize], blocks: &PictureBlocks) -> Vec<String> {
        let Some(part) = self.parts.iter().find_map(|kept| kept.part) else { return Vec::new() };
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

/// A film for the whole picture, if there is memory for it.
fn new_film(blocks: &PictureBlocks, memory: MemoryArgs) -> Result<Film> {
    let film = blocks.empty_film();
    let what = format!("a picture of {}x{} pixels", film.width, film.height);
    let bytes = u64::from(film.width) * u64::from(film.height) * size_of::<[f32; 3]>() as u64;
    let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "raise --memory-limit" };
    memory.budget().check(&need)?;
    Ok(film)
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
    let mut merged = Merged::default();
    for path in &args.journals {
        merged.read(path, args.memory)?;
    }
    let Some(id) = &merged.first else { return Ok(()) }; // there is at least one journal
    let blocks = id.blocks().map_err(|message| Error::input(&args.journals[0], None, message))?;
    if let Some(missing) = merged.missing(&blocks) {
        return Err(Error::input(&args.journals[0], None, missing));
    }
    let mut film = merged.film.take().unwrap_or_else(|| blocks.empty_film());
    args.file.finish(&mut film, &args.output.display().to_string(), talk)?;
    film.write(&args.output, Some(format))?;
    if talk.quiet {
        return Ok(());
    }
    if merged.doubled > 0 {
        tell!("note: {} blocks are in more than one journal, with the same pixels", merged.doubled);
    }
    say!(
        "{}: {}x{} of {} journals, {} rays",
        args.output.display(),
        film.width,
        film.height,
        merged.parts.len(),
        RayCounts::from_counters(&merged.spent.counts).total_cast()
    );
    Ok(())
}
