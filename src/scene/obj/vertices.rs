//! The `v`, `vt` and `vn` statements of an OBJ text.

use super::survey::{Part, Survey};
use super::{Fault, first_fault, split_by};
use crate::scene::text::{quote, split_keyword, words};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// What faces refer to, in file order.
pub(super) struct Vertices {
    pub(super) positions: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) normals: Vec<Vec3>,
}

/// Reads them from all parts.
pub(super) fn read(survey: &Survey) -> Result<Vertices, Fault> {
    let [positions, uvs, normals] = survey.counts;
    let mut vertices = Vertices {
        positions: vec![Vec3::ZERO; positions],
        uvs: vec![Vec2::ZERO; uvs],
        normals: vec![Vec3::ZERO; normals],
    };
    let counts = |kind: usize| survey.parts.iter().map(move |part| part.counts[kind]);
    let positions = split_by(&mut vertices.positions, counts(0));
    let uvs = split_by(&mut vertices.uvs, counts(1));
    let normals = split_by(&mut vertices.normals, counts(2));
    let parts = survey.parts.par_iter().zip(positions).zip(uvs).zip(normals);
    let read = parts.map(|(((part, positions), uvs), normals)| read_part(part, positions, uvs, normals));
    first_fault(read.collect())?;
    Ok(vertices)
}

/// Fills the slices, which are as long as `part` has statements.
///
/// Weights and colours after the third number are left out, as only curves use the former.
fn read_part(part: &Part, positions: &mut [Vec3], uvs: &mut [Vec2], normals: &mut [Vec3]) -> Result<(), Fault> {
    if part.counts == [0; 3] {
        return Ok(());
    }
    let (mut positions, mut uvs, mut normals) = (positions.iter_mut(), uvs.iter_mut(), normals.iter_mut());
    for (number, line) in part.lines() {
        let (keyword, rest) = split_keyword(&line);
        let read = match keyword {
            b"v" => numbers(rest, 3).map(|found| set(&mut positions, found.into())),
            b"vt" => numbers(rest, 1).map(|found| set(&mut uvs, found.into())),
            b"vn" => numbers(rest, 3).map(|found| set(&mut normals, found.into())),
            _ => continue,
        };
        read.map_err(|fault| (number, fault.message(&line)))?;
    }
    Ok(())
}

fn set<T>(places: &mut std::slice::IterMut<T>, value: T) {
    *places.next().expect("the survey counted the same statements") = value;
}

/// What is wrong with a statement of numbers.
enum NumbersFault {
    /// There are fewer than the least, which is the first number; the second is how many there are.
    TooFew(usize, usize),
    /// One is not a number.
    NoNumber,
}

/// The first numbers of a statement, of which `least` must be there; the others are 0 when missing.
fn numbers<const MOST: usize>(rest: &[u8], least: usize) -> Result<[f32; MOST], NumbersFault> {
    let mut values = [0.0; MOST];
    let (mut found, mut are_numbers) = (0, true);
    for (value, word) in values.iter_mut().zip(words(rest)) {
        match number(word) {
            Some(number) => *value = number,
            None => are_numbers = false,
        }
        found += 1;
    }
    match (found < least, are_numbers) {
        (true, _) => Err(NumbersFault::TooFew(least, found)),
        (false, false) => Err(NumbersFault::NoNumber),
        (false, true) => Ok(values),
    }
}

/// The number that `word` is, rounded to the nearest; what [`str::parse`] reads.
fn number(word: &[u8]) -> Option<f32> {
    match fast_float2::parse_partial::<f32, _>(word) {
        Ok((number, length)) if length == word.len() => Some(number),
        _ => std::str::from_utf8(word).ok()?.trim().parse().ok(), // there are blanks beyond ASCII
    }
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

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_are_those_of_the_standard_library() {
        let mut words: Vec<String> = "0 -0 +1 1. .5 . - + e5 1e 1e5 1E+05 1e-5 1.e3 .e3 nan NaN -nan +inf Infinity infinit in 1e39 1e-46 \
             1_000 0x10 1,5 1f 7.0064923216240853e-46 7.0064923216240854e-46 16777217 16777219 3.4028235677973366e38 \
             0.1000000014901161193847656250000000000000000001 1e99999999999999999999 00000000000000000000000000000000001e-2"
            .split(' ')
            .map(str::to_owned)
            .collect();
        let mut bits = 1u32;
        for _ in 0..100_000 {
            bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (low, high) = (f32::from_bits(bits), f32::from_bits(bits + 1));
            words.extend([format!("{low}"), format!("{low:e}"), format!("{:.6}", low)]);
            // Just between two: the hardest to round.
            words.push(format!("{:e}", (f64::from(low) + f64::from(high)) / 2.0));
        }
        for word in words {
            let expected = word.parse::<f32>().ok();
            let found = number(word.as_bytes());
            assert_eq!(found.is_none(), expected.is_none(), "{word}");
            let (found, expected) = (found.unwrap_or_default(), expected.unwrap_or_default());
            assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{word}: {found}");
        }
        assert_eq!(number("1\u{a0}".as_bytes()), Some(1.0));
        assert_eq!(number(b"1\xff"), None);
    }
}
