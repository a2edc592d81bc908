//! What loaders of texts share: the statements of OBJ and MTL files, and the warnings of all formats.
//!
//! Statements follow Wavefront, "Advanced Visualizer" manual, appendix B1 (Object Files), as written in practice: with
//! a byte order mark, `\` continuation, any line ends and comments in any encoding.

use fast_float2::FastFloat;
use memchr::memchr2;
use std::borrow::Cow;
use std::path::Path;
use std::str::FromStr;

/// How many warnings a scene keeps; a hostile file could fill the memory with more.
const MAX_WARNINGS: usize = 50;

/// How many different unknown keywords are reported by name.
const MAX_KEYWORDS: usize = 16;

/// The longest piece of a file that a message quotes, in characters.
const MAX_QUOTE: usize = 60;

/// What some writers begin a text in UTF-8 with.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Piece of a file for a message: short, without control characters, never invalid.
pub(super) fn quote(text: &[u8]) -> String {
    let head = &text[..text.len().min(4 * MAX_QUOTE)];
    let text = String::from_utf8_lossy(head);
    let mut quoted: String =
        text.chars().take(MAX_QUOTE).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if text.chars().count() > MAX_QUOTE {
        quoted.push('…');
    }
    quoted
}

/// Collects what was repaired or left out.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    list: Vec<String>,
    left_out: usize,
}

impl Warnings {
    /// Adds a warning about `path`, at `line` if it is known.
    pub(super) fn add(&mut self, path: &Path, line: impl Into<Option<usize>>, message: impl AsRef<str>) {
        if self.list.len() == MAX_WARNINGS {
            self.left_out += 1;
            return;
        }
        let line = line.into().map(|l: usize| format!(":{l}")).unwrap_or_default();
        self.list.push(format!("{}{line}: {}", path.display(), message.as_ref()));
    }

    /// Adds what there is to say of the whole of `path`.
    pub(super) fn extend(&mut self, path: &Path, message: Option<String>) {
        if let Some(message) = message {
            self.add(path, None, message);
        }
    }

    /// Adds what was counted of one problem, if it was met at all, at the line of the first.
    pub(super) fn tally(&mut self, path: &Path, tally: Tally, what: &str) {
        if tally.count > 0 {
            self.add(path, tally.first, format!("{what}: {}, this is the first", tally.count));
        }
    }

    /// All warnings, and how many more there were.
    pub(super) fn into_vec(mut self) -> Vec<String> {
        if self.left_out > 0 {
            self.list.push(format!("more warnings left out: {}", self.left_out));
        }
        self.list
    }
}

/// Counts occurrences of one problem and remembers the first.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    /// Line or primitive of the first occurrence.
    pub(super) first: usize,
    /// How many there were.
    pub(super) count: usize,
}

impl Tally {
    /// Counts one more.
    pub(super) fn note(&mut self, place: usize) {
        if self.count == 0 {
            self.first = place;
        }
        self.count += 1;
    }

    /// Adds what was counted in a part that begins `offset` places further on, after all that was counted so far.
    pub(super) fn append(&mut self, later: Tally, offset: usize) {
        if self.count == 0 {
            self.first = later.first + offset;
        }
        self.count += later.count;
    }
}

/// The statements that are not supported, by keyword.
#[derive(Debug, Default)]
pub(super) struct Ignored {
    kinds: Vec<(Vec<u8>, Tally)>,
    others: Tally,
}

impl Ignored {
    /// Counts a statement that is left out.
    pub(super) fn note(&mut self, keyword: &[u8], line: usize) {
        if let Some((_, tally)) = self.kinds.iter_mut().find(|(k, _)| k == keyword) {
            tally.note(line);
        } else if self.kinds.len() < MAX_KEYWORDS {
            self.kinds.push((keyword.to_vec(), Tally { first: line, count: 1 }));
        } else {
            self.others.note(line);
        }
    }

    /// Adds what was counted in a part that begins `offset` lines further on. False when that part has so many keywords
    /// that it did not tell all apart: then a count of one keyword may be wrong.
    pub(super) fn append(&mut self, later: &Ignored, offset: usize) -> bool {
        for (keyword, tally) in &later.kinds {
            if let Some((_, known)) = self.kinds.iter_mut().find(|(k, _)| k == keyword) {
                known.append(*tally, offset);
            } else if self.kinds.len() < MAX_KEYWORDS {
                self.kinds.push((keyword.clone(), Tally { first: tally.first + offset, count: tally.count }));
            } else {
                self.others.append(*tally, offset);
            }
        }
        later.others.count == 0
    }

    /// Adds one warning for each keyword.
    pub(super) fn report(&self, path: &Path, warnings: &mut Warnings) {
        for (keyword, tally) in &self.kinds {
            let message = format!("'{}' is not supported and ignored (statements: {})", quote(keyword), tally.count);
            warnings.add(path, tally.first, message);
        }
        if self.others.count > 0 {
            warnings.add(path, self.others.first, format!("other unknown statements ignored: {}", self.others.count));
        }
    }
}

/// The statements of an OBJ or MTL text, each with the number of its first line. Lines end with `\n`, `\r\n` or `\r`.
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    /// The statements of `text`.
    pub(super) fn new(text: &'a [u8]) -> Self {
        Lines::after(0, text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text))
    }

    /// The statements of `text`, which begins after line `number` of a file.
    pub(super) fn after(number: usize, text: &'a [u8]) -> Self {
        Lines { rest: text, number }
    }

    /// Number of the last line that was read.
    pub(super) fn number(&self) -> usize {
        self.number
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let end = memchr2(b'\n', b'\r', self.rest).unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        let line_end = if rest.starts_with(b"\r\n") { 2 } else { 1 };
        self.rest = rest.get(line_end..).unwrap_or_default();
        self.number += 1;
        Some(line)
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.physical()?;
        let number = self.number;
        // A comment may end with a backslash ("# C:\models\") without swallowing the next line.
        if !line.ends_with(b"\\") || line.contains(&b'#') {
            return Some((number, Cow::Borrowed(line)));
        }
        let mut joined = line.to_vec();
        while joined.ends_with(b"\\") {
            joined.pop();
            joined.push(b' ');
            let Some(next) = self.physical() else { break };
            joined.extend_from_slice(next);
        }
        Some((number, Cow::Owned(joined)))
    }
}

/// The first word of a statement and what follows it, both without blanks around; an empty word for a comment.
pub(super) fn split_keyword(line: &[u8]) -> (&[u8], &[u8]) {
    let line = line.trim_ascii();
    if line.starts_with(b"#") {
        return (&[], &[]);
    }
    let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_ascii())
}

/// The words of a statement of numbers, up to a comment.
pub(super) fn words(rest: &[u8]) -> impl Iterator<Item = &[u8]> {
    let end = rest.iter().position(|&b| b == b'#').unwrap_or(rest.len());
    rest[..end].split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// The number that `word` is, rounded to the nearest; what [`str::parse`] reads, in less time for most.
pub(super) fn number<T: FastFloat + FromStr>(word: &[u8]) -> Option<T> {
    match fast_float2::parse_partial(word) {
        Ok((number, length)) if length == word.len() => Some(number),
        _ => std::str::from_utf8(word).ok()?.parse().ok(),
    }
}

/// The integer that `word` is; what [`str::parse`] reads, in less time for most.
pub(super) fn integer(word: &[u8]) -> Option<i64> {
    const FEW_DIGITS: usize = 18; // any so many fit
    let (digits, sign) = word.strip_prefix(b"-").map_or((word, 1), |digits| (digits, -1));
    let is_short = (1..=FEW_DIGITS).contains(&digits.len());
    if is_short && digits.iter().all(u8::is_ascii_digit) {
        return Some(sign * digits.iter().fold(0, |value, digit| 10 * value + i64::from(digit - b'0')));
    }
    std::str::from_utf8(word).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_are_those_of_the_standard_library() {
        let mut words: Vec<String> = "0 -0 +1 1. .5 . - + e5 1e 1e5 1E+05 1e-5 1.e3 .e3 nan NaN -nan +inf Infinity \
             infinit in 1e39 1e-46 1_000 0x10 1,5 1f 7.0064923216240853e-46 7.0064923216240854e-46 16777217 16777219 \
             3.4028235677973366e38 0.1000000014901161193847656250000000000000000001 1e99999999999999999999 \
             00000000000000000000000000000000001e-2"
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
            let found = number::<f32>(word.as_bytes());
            assert_eq!(found.is_none(), expected.is_none(), "{word}");
            let (found, expected) = (found.unwrap_or_default(), expected.unwrap_or_default());
            assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{word}: {found}");
        }
        assert_eq!(number::<f32>(b"1\xff"), None);
    }
}
