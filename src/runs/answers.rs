//! What is asked of the rays of a batch, and what comes of it.

use super::Runs;
use crate::error::Result;
use crate::io::npz::{Data, NpyArray, Taker, write_npz};
use crate::shared::{Hit, WorkCounter};
use crate::tracer::{TraceResult, is_hit};
use crate::work::RayWork;
use bytemuck::cast_slice;
use std::fmt;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

/// What is asked of each ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// The closest hit, and that of its secondary ray, if it has one.
    Closest,
    /// Whether it hits anything.
    Any,
    /// So many hits, the closest ones.
    All(u32),
    /// How many hits it has.
    Count,
    /// How often it crosses a surface.
    Crossings,
}

impl Asked {
    /// How many hits of a ray are looked for, if not the closest one alone, or any.
    pub fn most(self) -> Option<u32> {
        match self {
            Asked::Closest | Asked::Any => None,
            Asked::All(most) => Some(most),
            Asked::Count | Asked::Crossings => Some(u32::MAX),
        }
    }

    /// Whether the answer is a list of hits.
    pub fn lists_hits(self) -> bool {
        matches!(self, Asked::All(_))
    }
}

/// As in a journal, and in messages.
impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Asked::Closest => f.write_str("closest hits"),
            Asked::Any => f.write_str("any hits"),
            Asked::All(u32::MAX) => f.write_str("all hits"),
            Asked::All(most) => write!(f, "{most} hits"),
            Asked::Count => f.write_str("counts"),
            Asked::Crossings => f.write_str("crossings"),
        }
    }
}

impl FromStr for Asked {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Asked, String> {
        let known = [Asked::Closest, Asked::Any, Asked::All(u32::MAX), Asked::Count, Asked::Crossings];
        let most = || text.strip_suffix(" hits").and_then(|most| most.parse().ok()).map(Asked::All);
        let found = known.into_iter().find(|asked| asked.to_string() == text).or_else(most);
        found.ok_or_else(|| format!("'{text}' is nothing that can be asked of rays"))
    }
}

/// The answers of neighbouring rays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answers {
    /// One of each ray, where hits or crossings are counted.
    pub counts: Vec<u32>,
    /// One hit of each ray; or all that are asked for, those of the first ray first.
    pub hits: Vec<Hit>,
    /// The hit of each secondary ray, if there are any.
    pub next_hits: Vec<Hit>,
}

impl Answers {
    /// Those of a batch.
    pub fn of(result: TraceResult) -> Answers {
        Answers { counts: Vec::new(), hits: result.hits, next_hits: result.next_hits.unwrap_or_default() }
    }

    /// Those of each run, of neighbouring ones of which these are.
    pub(super) fn of_runs(&self, asked: Asked, runs: Runs, numbers: Range<usize>) -> Vec<RunAnswers<'_>> {
        let mut rest = RunAnswers { counts: &self.counts, hits: &self.hits, next_hits: &self.next_hits };
        numbers.map(|run| rest.take(asked, runs.len_of(run))).collect()
    }

    /// Whether both say the same: of any hits, which triangle they name means nothing.
    pub fn agree(&self, other: &Answers, asked: Asked) -> bool {
        if asked == Asked::Any {
            return self.hits.iter().map(is_hit).eq(other.hits.iter().map(is_hit));
        }
        let is_same = |a: &[Hit], b: &[Hit]| cast_slice::<Hit, u8>(a) == cast_slice::<Hit, u8>(b);
        self.counts == other.counts && is_same(&self.hits, &other.hits) && is_same(&self.next_hits, &other.next_hits)
    }
}

/// The answers of a run, among others.
#[derive(Clone, Copy)]
pub(super) struct RunAnswers<'a> {
    pub counts: &'a [u32],
    pub hits: &'a [Hit],
    pub next_hits: &'a [Hit],
}

impl RunAnswers<'_> {
    /// Takes those of the first rays away from these.
    fn take(&mut self, asked: Asked, rays: usize) -> Self {
        let (counts, later_counts) = self.counts.split_at(rays.min(self.counts.len()));
        let hits = match asked {
            Asked::Closest | Asked::Any => rays,
            Asked::All(_) => counts.iter().map(|&count| count as usize).sum(),
            Asked::Count | Asked::Crossings => 0,
        };
        let (hits, later_hits) = self.hits.split_at(hits);
        let (next_hits, later_next) = self.next_hits.split_at(rays.min(self.next_hits.len()));
        *self = RunAnswers { counts: later_counts, hits: later_hits, next_hits: later_next };
        RunAnswers { counts, hits, next_hits }
    }
}

/// Counters of the work on rays and on secondary rays, where it was counted.
pub type CountedWork<'a> = [Option<&'a [RayWork]>; 2];

/// Writes the answers of a batch, of which these are all pieces in their order, as an `.npz` file that appears when it
/// is complete.
///
/// Of closest hits and any ones it has the arrays `t`, `u`, `v` float32 and `primitive` int32, -1 where nothing is hit,
/// of each ray; of any ones `hit` uint8, 0 or 1; and where there are secondary rays their `next_t` and
/// `next_primitive`. Otherwise it has `count` uint32 of each ray, and where hits are listed `t`, `primitive`, `u` and
/// `v` of all hits. Work that was counted is in `work_…` and `next_work_…` uint32 of each [`WorkCounter`].
///
/// # Errors
/// As [`crate::low_level::output::write_atomically`].
pub fn write_answers(
    path: &Path,
    pieces: &[Answers],
    (asked, has_second): (Asked, bool),
    work: CountedWork,
) -> Result<()> {
    let mut lens = Lens::default();
    pieces.iter().for_each(|piece| lens.add(piece));
    write_pieces(path, (lens, &|take| pieces.iter().try_for_each(take)), (asked, has_second), work)
}

/// How many counts, hits and hits of secondary rays there are.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lens {
    counts: usize,
    hits: usize,
    next_hits: usize,
}

impl Lens {
    pub fn add(&mut self, piece: &Answers) {
        self.counts += piece.counts.len();
        self.hits += piece.hits.len();
        self.next_hits += piece.next_hits.len();
    }
}

/// Hands all pieces of a batch to what takes them, in their order.
pub(super) type EachPiece<'a> = &'a (dyn Fn(TakePiece) -> io::Result<()> + Sync);

type TakePiece<'t> = &'t mut dyn FnMut(&Answers) -> io::Result<()>;

/// As [`write_answers`], of pieces that have so much. They are gone through once for each array.
pub(super) fn write_pieces(
    path: &Path,
    (lens, each): (Lens, EachPiece),
    (asked, has_second): (Asked, bool),
    work: CountedWork,
) -> Result<()> {
    let names = ["work", "next_work"].map(names_of_work);
    let one_each = matches!(asked, Asked::Closest | Asked::Any);
    let of_hits = |name, type_code, take: TakeValues| array((name, type_code), lens.hits, (each, take));
    let of_next = |name, type_code, take: TakeValues| array((name, type_code), lens.next_hits, (each, take));
    let mut arrays = Vec::new();
    if !one_each {
        let take: TakeValues = |piece, taker| taker.take(&piece.counts, |&count| count);
        arrays.push(array(("count", "u4"), lens.counts, (each, take)));
    }
    if one_each || asked.lists_hits() {
        arrays.push(of_hits("t", "f4", |piece, taker| taker.take(&piece.hits, |hit| hit.t)));
        arrays.push(of_hits("primitive", "i4", |piece, taker| taker.take(&piece.hits, number)));
        arrays.push(of_hits("u", "f4", |piece, taker| taker.take(&piece.hits, |hit| hit.u)));
        arrays.push(of_hits("v", "f4", |piece, taker| taker.take(&piece.hits, |hit| hit.v)));
    }
    if asked == Asked::Any {
        arrays.push(of_hits("hit", "u1", |piece, taker| taker.take(&piece.hits, |hit| u8::from(is_hit(hit)))));
    }
    if one_each && has_second {
        arrays.push(of_next("next_t", "f4", |piece, taker| taker.take(&piece.next_hits, |hit| hit.t)));
        arrays.push(of_next("next_primitive", "i4", |piece, taker| taker.take(&piece.next_hits, number)));
    }
    for (work, names) in work.into_iter().zip(&names) {
        let Some(work) = work else { continue };
        let counters = WorkCounter::ALL.iter().zip(names);
        arrays.extend(counters.map(|(&counter, name)| {
            let make = move |taker: &mut Taker| taker.take(work, |ray| ray.get(counter));
            NpyArray { name, type_code: "u4", len: work.len(), columns: None, data: Data::Made(Box::new(make)) }
        }));
    }
    write_npz(path, &arrays)
}

/// Has an array's values of a piece taken.
type TakeValues = fn(&Answers, &mut Taker) -> io::Result<()>;

/// An array of so many values of all pieces.
fn array<'a>(
    (name, type_code): (&'a str, &'static str),
    len: usize,
    (each, take): (EachPiece<'a>, TakeValues),
) -> NpyArray<'a> {
    let make = move |taker: &mut Taker| each(&mut |piece| take(piece, taker));
    NpyArray { name, type_code, len, columns: None, data: Data::Made(Box::new(make)) }
}

/// The names of arrays of each counter of some work.
fn names_of_work(work: &str) -> Vec<String> {
    WorkCounter::ALL.iter().map(|counter| format!("{work}_{}", counter.key())).collect()
}

/// The triangle's number; of no hit it is -1.
fn number(hit: &Hit) -> i32 {
    hit.primitive as i32
}

#[cfg(test)]
mod tests;
