//! What is asked of the rays of a batch, and what comes of it.

use super::Runs;
use crate::error::Result;
use crate::io::rays::{AllHitsBatch, HitBatch};
use crate::shared::Hit;
use crate::tracer::{TraceResult, is_hit};
use bytemuck::cast_slice;
use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

/// What is asked of each ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// The closest hit, and that of its second ray, if it has one.
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
    /// The hit of each second ray, if there are any.
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

/// A number of each hit of all pieces.
fn column<'a, T>(pieces: &'a [Answers], hits: fn(&'a Answers) -> &'a [Hit], of: impl Fn(&Hit) -> T) -> Vec<T> {
    let mut column = Vec::with_capacity(pieces.iter().map(|piece| hits(piece).len()).sum());
    pieces.iter().for_each(|piece| column.extend(hits(piece).iter().map(&of)));
    column
}

fn of_first(piece: &Answers) -> &[Hit] {
    &piece.hits
}

fn of_next(piece: &Answers) -> &[Hit] {
    &piece.next_hits
}

/// The triangle's number; of no hit it is -1.
fn number(hit: &Hit) -> i32 {
    hit.primitive as i32
}

/// Closest hits, or any, as NumPy users take them, of neighbouring pieces of a batch; `has_second` tells whether there
/// are second rays. It has no work.
pub fn hit_batch(pieces: &[Answers], asked: Asked, has_second: bool) -> HitBatch {
    HitBatch {
        t: column(pieces, of_first, |hit| hit.t),
        primitive: column(pieces, of_first, number),
        u: column(pieces, of_first, |hit| hit.u),
        v: column(pieces, of_first, |hit| hit.v),
        hit: (asked == Asked::Any).then(|| column(pieces, of_first, |hit| u8::from(is_hit(hit)))),
        next_t: has_second.then(|| column(pieces, of_next, |hit| hit.t)),
        next_primitive: has_second.then(|| column(pieces, of_next, number)),
        work: None,
        next_work: None,
    }
}

/// The same of lists of hits, of counts and of crossings.
pub fn list_batch(pieces: &[Answers], asked: Asked) -> AllHitsBatch {
    let mut count = Vec::with_capacity(pieces.iter().map(|piece| piece.counts.len()).sum());
    pieces.iter().for_each(|piece| count.extend(&piece.counts));
    AllHitsBatch {
        count,
        t: column(pieces, of_first, |hit| hit.t),
        primitive: column(pieces, of_first, number),
        u: column(pieces, of_first, |hit| hit.u),
        v: column(pieces, of_first, |hit| hit.v),
        has_hits: asked.lists_hits(),
        work: None,
    }
}

/// Writes the answers of a batch, of which these are all pieces in their order, as an `.npz` file.
///
/// # Errors
/// As [`HitBatch::write`].
pub fn write_answers(path: &Path, pieces: &[Answers], asked: Asked, has_second: bool) -> Result<()> {
    match asked {
        Asked::Closest | Asked::Any => hit_batch(pieces, asked, has_second).write(path),
        Asked::All(_) | Asked::Count | Asked::Crossings => list_batch(pieces, asked).write(path),
    }
}
