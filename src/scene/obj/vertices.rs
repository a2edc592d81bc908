//! The `v`, `vt` and `vn` statements of an OBJ text.

use super::survey::{Part, Survey};
use super::{Fault, first_fault};
use crate::parallel;
use crate::scene::reading::split_by;
use crate::scene::text::{Tally, number, quote, split_keyword, words};
use glam::{Vec2, Vec3};

/// What faces refer to, in file order.
pub(super) struct Vertices {
    pub(super) positions: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) normals: Vec<Vec3>,
    /// Positions with more than three numbers, by line: a weight, of which only curves make use, or a colour.
    pub(super) extras: Tally,
}

/// Reads them from all parts.
pub(super) fn read(survey: &Survey) -> Result<Vertices, Fault> {
    let [positions, uvs, normals] = survey.counts;
    let mut vertices = Vertices {
        positions: vec![Vec3::ZERO; positions],
        uvs: vec![Vec2::ZERO; uvs],
        normals: vec![Vec3::ZERO; normals],
        extras: Tally::default(),
    };
    let counts = |kind: usize| survey.parts.iter().map(move |part| part.counts[kind]);
    let positions = split_by(&mut vertices.positions, counts(0));
    let uvs = split_by(&mut vertices.uvs, counts(1));
    let normals = split_by(&mut vertices.normals, counts(2));
    let parts = survey.parts.iter().zip(positions).zip(uvs).zip(normals);
    let read = parallel::map(parts, |(((part, positions), uvs), normals)| read_part(part, positions, uvs, normals));
    for extras in first_fault(read)? {
        vertices.extras.append(extras, 0);
    }
    Ok(vertices)
}

/// Fills the slices, which are as long as `part` has statements; which positions have more than is used.
fn read_part(part: &Part, positions: &mut [Vec3], uvs: &mut [Vec2], normals: &mut [Vec3]) -> Result<Tally, Fault> {
    let mut extras = Tally::default();
    if part.counts == [0; 3] {
        return Ok(extras);
    }
    let (mut positions, mut uvs, mut normals) = (positions.iter_mut(), uvs.iter_mut(), normals.iter_mut());
    for (number, line) in part.lines() {
        let (keyword, rest) = split_keyword(&line);
        let read = match keyword {
            b"v" => numbers(rest, 3).map(|(found, after)| {
                set(&mut positions, found.into());
                if !is_weight_of_one(after) {
                    extras.note(number);
                }
            }),
            b"vt" => numbers(rest, 1).map(|(found, _)| set(&mut uvs, found.into())),
            b"vn" => numbers(rest, 3).map(|(found, _)| set(&mut normals, found.into())),
            _ => continue,
        };
        read.map_err(|fault| (number, fault.message(&line)))?;
    }
    Ok(extras)
}

/// Whether what stands after a position changes nothing: no words, or a weight of 1.
fn is_weight_of_one(after: After) -> bool {
    match after {
        [None, _] => true,
        [Some(word), None] => number(word) == Some(1.0f32),
        _ => false,
    }
}

fn set<T>(places: &mut std::slice::IterMut<T>, value: T) {
    *places.next().expect("the survey counted the same statements") = value;
}

/// The two words after the numbers of a statement.
type After<'a> = [Option<&'a [u8]>; 2];

/// What is wrong with a statement of numbers.
enum NumbersFault {
    /// There are fewer than the least, which is the first number; the second is how many there are.
    TooFew(usize, usize),
    /// One is not a number.
    NoNumber,
}

/// The first numbers of a statement, of which `least` must be there; the others are 0 when missing. And the two words
/// after them.
fn numbers<const MOST: usize>(rest: &[u8], least: usize) -> Result<([f32; MOST], After<'_>), NumbersFault> {
    let mut values = [0.0; MOST];
    let (mut found, mut are_numbers) = (0, true);
    let mut words = words(rest);
    for value in &mut values {
        let Some(word) = words.next() else { break };
        match number(word).or_else(|| number(trimmed(word))) {
            Some(number) => *value = number,
            None => are_numbers = false,
        }
        found += 1;
    }
    match (found < least, are_numbers) {
        (true, _) => Err(NumbersFault::TooFew(least, found)),
        (false, false) => Err(NumbersFault::NoNumber),
        (false, true) => Ok((values, [words.next(), words.next()])),
    }
}

/// `word` without the blanks that ASCII does not have.
fn trimmed(word: &[u8]) -> &[u8] {
    std::str::from_utf8(word).map_or(word, |word| word.trim().as_bytes())
}

impl NumbersFault {
    /// The message about the statement `line`.
    fn message(self, line: &[u8]) -> String {
        let (keyword, rest) = split_keyword(line);
        match self {
            NumbersFault::TooFew(least, found) => {
                format!("'{}' needs {least} numbers, found {found}: '{}'", quote(keyword), quote(rest))
            }
            NumbersFault::NoNumber => {
                let what = match keyword {
                    b"vt" => "texcoord",
                    b"vn" => "normal",
                    _ => "position",
                };
                let comma = if line.contains(&b',') { "; decimals take a point, not a comma" } else { "" };
                format!("{what} parse error: '{}' is not made of numbers{comma}", quote(line.trim_ascii()))
            }
        }
    }
}
