//! Journals of pictures and of batches of rays.

use super::errors::readable;
use super::folder::Folder;
use super::records::write_journal;
use raybrook::low_level::film::{Film, FilmWindow};
use raybrook::low_level::journal::{Subject, is_journal};
use raybrook::low_level::renderer::{Kept, KeptBlock, PictureBlocks, PictureJournal, StoredBlocks, read_kept};
use raybrook::low_level::runs::{
    Answers, BatchId, BatchJournal, Found, KeptRuns, RunEntry, Took, TracedRuns, read_kept_runs, write_answers,
};
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::{Finished, Spent};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Pictures of more pixels, and batches of more rays, are not put together.
const SMALL: usize = 1 << 16;

/// The journal that an input is, or that has its pieces.
fn journal_of(data: &[u8]) -> PathBuf {
    let path = Folder.remove("input.partial");
    write_journal(&path, data);
    path
}

/// The blocks of a journal by their numbers: the first one of each.
type Blocks = BTreeMap<usize, Vec<[f32; 3]>>;

/// A picture's journal. What is in it belongs to the picture, and is the same when it is appended to another journal;
/// the rows of a small picture that is complete are those of its blocks.
pub fn picture_journal(data: &[u8]) -> bool {
    let path = journal_of(data);
    assert!(is_journal(&path));
    readable(Subject::of_journal(&path));
    let mut found = Blocks::new();
    let mut doubled = false;
    let mut take = |blocks: &PictureBlocks, block: &KeptBlock| {
        assert!(blocks.has(block.number) && block.pixels.len() == blocks.pixels(block.number));
        doubled |= found.insert(block.number, block.pixels.to_vec()).is_some();
        Ok(())
    };
    let Some(kept) = readable(read_kept(&path, None, &mut take)) else { return false };
    assert!(kept.blocks.iter().eq(found.keys()));
    let blocks = kept.id.blocks().expect("they were read");
    let (width, height) = blocks.size();
    if width as usize * height as usize <= SMALL && !doubled {
        check_picture(&path, &kept, &blocks, &found);
    }
    true
}

fn check_picture(path: &Path, kept: &Kept, blocks: &PictureBlocks, found: &Blocks) {
    let again = Folder.remove("again.partial");
    let mut journal = PictureJournal::create(&again, &kept.id, kept.part, blocks).expect("it can be written");
    let (mut film, window_of) = (blocks.empty_film(), blocks.place());
    for (&number, pixels) in found {
        blocks.scatter(number, pixels, &mut film).expect("a small picture");
        let film = FilmWindow { film: &film, place: window_of };
        let finished = Finished { blocks: &[number], film, spent: Spent::default() };
        journal.append(&finished).expect("it can be written");
    }
    drop(journal);
    let mut stored = StoredBlocks::default();
    stored.add(path, None).expect("it was read before");
    let (other, doubled) = stored.add(&again, Some(&kept.id)).expect("the same picture, with the same pixels");
    assert_eq!((other.part, other.blocks, doubled), (kept.part, kept.blocks.clone(), found.len()));
    if !found.is_empty() && blocks.numbers().iter().all(|number| stored.has(*number)) {
        check_rows(&mut stored, blocks, &film);
    }
}

fn check_rows(stored: &mut StoredBlocks, blocks: &PictureBlocks, film: &Film) {
    let mut rows = Vec::new();
    let mut put = |more: &[[f32; 3]]| {
        rows.extend_from_slice(more);
        Ok(())
    };
    stored.put_rows(blocks, &(0..blocks.size().1 as usize), &mut put).expect("all blocks are there");
    let bits = |pixels: &[[f32; 3]]| pixels.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert!(bits(&rows) == bits(&film.pixels));
}

/// A batch's journal. What is in it belongs to the batch, and is the same when it is appended to another journal; the
/// answers of a small batch that is complete can be written.
pub fn batch_journal(data: &[u8]) -> bool {
    let path = journal_of(data);
    readable(Subject::of_journal(&path));
    let mut found = BTreeMap::new();
    let mut take = |id: &BatchId, entry: &RunEntry, answers: Answers| {
        let asked = id.asked().expect("it was read");
        let rays = id.runs().len_of(entry.run);
        assert!(entry.run < id.runs().count());
        assert_eq!(answers.counts.len(), if asked.most().is_some() { rays } else { 0 });
        assert_eq!(answers.next_hits.len(), if id.has_second() { rays } else { 0 });
        found.insert(entry.run, answers);
        Ok(())
    };
    let Some(kept) = readable(read_kept_runs(&path, None, &mut take)) else { return false };
    if kept.id.rays() <= SMALL {
        check_batch(&kept, found);
    }
    true
}

fn check_batch(kept: &KeptRuns, found: BTreeMap<usize, Answers>) {
    let again = Folder.remove("again.partial");
    let asked = kept.id.asked().expect("it was read");
    let mut journal = BatchJournal::create(&again, &kept.id, kept.part).expect("it can be written");
    for (&run, answers) in &found {
        let (found, took) = (vec![Found::default()], Took::default());
        let traced = TracedRuns { runs: run..run + 1, answers: answers.clone(), found, took };
        journal.append(&traced).expect("it can be written");
    }
    drop(journal);
    let mut runs = 0;
    let mut take = |_: &BatchId, entry: &RunEntry, answers: Answers| {
        runs += 1;
        assert!(same(&found[&entry.run], &answers));
        Ok(())
    };
    let other = read_kept_runs(&again, Some(&kept.id), &mut take).expect("it was just written");
    assert_eq!((other.part, runs), (kept.part, found.len()));
    if found.len() == kept.id.runs().count() {
        let pieces: Vec<Answers> = found.into_values().collect();
        let written = write_answers(&Folder.path("answers.npz"), &pieces, (asked, kept.id.has_second()), [None; 2]);
        written.expect("the temporary folder can be written");
    }
}

/// Whether both have the same bits.
fn same(a: &Answers, b: &Answers) -> bool {
    let bits = |hits: &[Hit]| hits.iter().map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.primitive]).collect();
    let all = |answers: &Answers| -> [Vec<[u32; 4]>; 2] { [bits(&answers.hits), bits(&answers.next_hits)] };
    a.counts == b.counts && all(a) == all(b)
}
