//! Checks and cleans OBJ text, one statement at a time, before the `tobj` crate reads it.
//!
//! Format: Wavefront, "Advanced Visualizer" manual, appendix B1 (Object Files), as written in practice.
//!
//! `tobj` 4.0.5 alone fails on a byte order mark, on `\` continuation, on old Mac line ends and on comments that are not
//! UTF-8; it gives a corner without normal or texture coordinate those of the corner before it, merges groups with objects,
//! opens any `mtllib` and has no line numbers in its errors. [`Cleaner`] therefore hands it a canonical text that leaves
//! none of these cases to it: first all `v`, `vt`, `vn` lines with exactly 3, 2 and 3 numbers, then the faces with checked,
//! absolute indices, then nothing else. Writing vertices first also allows faces before their vertices, and every index
//! error is found here, with its line.
//!
//! Bad at: the text is scanned three times (survey, vertices, faces); at about 1 GB/s that is less than `tobj` takes.

use super::MaterialId;
use super::mtl::Library;
use std::borrow::Cow;
use std::io::{self, BufRead, Read};
use std::path::Path;

/// The largest number of corners of one face: bounds the memory that splitting it takes.
pub(super) const MAX_CORNERS: usize = 65_536;

/// `tobj` keeps about 30 bytes per corner of a group until the group ends; a new group after this many corners bounds that.
const CORNERS_PER_GROUP: usize = 1 << 18;

/// How many warnings a scene keeps; a hostile file could fill the memory with more.
const MAX_WARNINGS: usize = 50;

/// How many different unknown keywords are reported by name.
const MAX_KEYWORDS: usize = 16;

/// The longest piece of a file that a message quotes, in characters.
const MAX_QUOTE: usize = 60;

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
        Lines { rest: text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text), number: 0 }
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
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

/// What a first look over an OBJ text finds.
#[derive(Debug, Default)]
pub(super) struct Survey {
    /// Numbers of `v`, `vt` and `vn` statements.
    counts: [usize; 3],
    /// Number of `f` statements.
    pub(super) faces: usize,
    /// Line and argument of each `mtllib`.
    pub(super) libraries: Vec<(usize, String)>,
    /// What is left out.
    pub(super) ignored: Ignored,
}

impl Survey {
    /// Counts the statements of `text`.
    pub(super) fn new(text: &[u8]) -> Self {
        let mut survey = Survey::default();
        for (number, line) in Lines::new(text) {
            match split_keyword(&line) {
                (b"v", _) => survey.counts[0] += 1,
                (b"vt", _) => survey.counts[1] += 1,
                (b"vn", _) => survey.counts[2] += 1,
                (b"f", _) => survey.faces += 1,
                (b"mtllib", rest) => survey.libraries.push((number, String::from_utf8_lossy(rest).into_owned())),
                // Groups, objects and smoothing change nothing here: normals come from the file or the triangle.
                (b"" | b"o" | b"g" | b"s" | b"mg" | b"usemtl", _) => {}
                (keyword, _) => survey.ignored.note(keyword, number),
            }
        }
        survey
    }
}

/// Names of the three kinds of index of a face's corner, in the order of a corner.
const INDEX_KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// Which statements [`Cleaner`] hands over at present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pass {
    Vertices,
    Faces,
    Done,
}

/// Reads as the canonical text of an OBJ text, one statement per buffer, so that [`Cleaner::line`] is the line at fault
/// when `tobj` stops.
///
/// Faces come in file order; [`Cleaner::materials`] says which have which material, as a group for each change of it would
/// cost `tobj` some 400 bytes.
/// A corner without texture coordinates (normal) in a file that has some refers to an extra one that is NaN.
pub(super) struct Cleaner<'a> {
    text: &'a [u8],
    lines: Lines<'a>,
    pass: Pass,
    counts: [usize; 3],
    seen: [usize; 3],
    library: &'a mut Library,
    corners_in_group: usize,
    faces: usize,
    buffer: Vec<u8>,
    consumed: usize,
    material: Option<MaterialId>,
    /// Number of the first face, counted without those left out, and material of each run of faces of one material.
    pub(super) materials: Vec<(usize, MaterialId)>,
    /// The line of the statement in hand.
    pub(super) line: usize,
    /// What is wrong with it.
    pub(super) fault: Option<String>,
    /// Lines with faces of fewer than three corners, which are left out.
    pub(super) short_faces: Tally,
    /// Lines with texture or normal indices that refer to nothing, which are left out.
    pub(super) dangling: Tally,
}

impl<'a> Cleaner<'a> {
    /// Cleans `text`; `library` gives numbers to material names.
    pub(super) fn new(text: &'a [u8], survey: &Survey, library: &'a mut Library) -> Self {
        Cleaner {
            text,
            lines: Lines::new(text),
            pass: Pass::Vertices,
            counts: survey.counts,
            seen: [0; 3],
            library,
            corners_in_group: 0,
            faces: 0,
            material: None,
            materials: Vec::new(),
            buffer: Vec::new(),
            consumed: 0,
            line: 0,
            fault: None,
            short_faces: Tally::default(),
            dangling: Tally::default(),
        }
    }

    /// Fills the empty buffer with the next statement; leaves it empty at the end.
    fn produce(&mut self) -> Result<(), String> {
        while self.buffer.is_empty() && self.pass != Pass::Done {
            let Some((number, line)) = self.lines.next() else {
                self.end_pass();
                continue;
            };
            self.line = number;
            let (keyword, rest) = split_keyword(&line);
            let vertex_kind = match keyword {
                b"v" => 0,
                b"vt" => 1,
                b"vn" => 2,
                b"f" if self.pass == Pass::Faces => {
                    self.face(rest)?;
                    continue;
                }
                b"usemtl" if self.pass == Pass::Faces => {
                    self.material = Some(self.library.find(&String::from_utf8_lossy(rest), number));
                    continue;
                }
                _ => continue,
            };
            if self.pass == Pass::Vertices {
                self.vertex(vertex_kind, keyword, rest)?;
            } else {
                self.seen[vertex_kind] += 1; // what negative indices count back from
            }
        }
        Ok(())
    }

    fn end_pass(&mut self) {
        if self.pass == Pass::Faces {
            self.pass = Pass::Done;
            return;
        }
        self.pass = Pass::Faces;
        self.lines = Lines::new(self.text);
        if self.counts[1] > 0 {
            self.buffer.extend_from_slice(b"vt nan nan\n");
        }
        if self.counts[2] > 0 {
            self.buffer.extend_from_slice(b"vn nan nan nan\n");
        }
    }

    /// Writes a vertex, texture coordinate or normal. Weights and colours after the third number are left out, as only
    /// curves use the former; that the numbers are numbers is checked by `tobj`.
    fn vertex(&mut self, kind: usize, keyword: &[u8], rest: &[u8]) -> Result<(), String> {
        let (least, most) = if kind == 1 { (1, 2) } else { (3, 3) };
        self.buffer.extend_from_slice(keyword);
        let mut found = 0;
        for word in words(rest).take(most) {
            self.buffer.push(b' ');
            self.buffer.extend_from_slice(word);
            found += 1;
        }
        if found < least {
            return Err(format!("'{}' needs {least} numbers, found {found}: '{}'", quote(keyword), quote(rest)));
        }
        self.buffer.extend_from_slice(if found < most { b" 0\n" } else { b"\n" });
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<(), String> {
        if self.corners_in_group >= CORNERS_PER_GROUP {
            self.buffer.extend_from_slice(b"g\n");
            self.corners_in_group = 0;
        }
        let start = self.buffer.len();
        self.buffer.push(b'f');
        let mut corners = 0;
        for word in words(rest) {
            self.corner(word)?;
            corners += 1;
        }
        if corners < 3 {
            self.short_faces.note(self.line);
            self.buffer.truncate(start);
        } else if corners > MAX_CORNERS {
            return Err(format!("a face of {corners} corners; the most is {MAX_CORNERS}: split it"));
        } else {
            self.buffer.push(b'\n');
            self.corners_in_group += corners;
            let material = *self.material.get_or_insert_with(|| self.library.default_material());
            if self.materials.last().is_none_or(|&(_, last)| last != material) {
                self.materials.push((self.faces, material));
            }
            self.faces += 1;
        }
        Ok(())
    }

    /// Writes a corner `v/vt/vn` with absolute indices.
    fn corner(&mut self, word: &[u8]) -> Result<(), String> {
        let mut parts = word.split(|&b| b == b'/');
        let mut written = 0;
        for kind in 0..3 {
            let part = parts.next().unwrap_or_default();
            if kind > 0 && self.counts[kind] == 0 {
                if !part.is_empty() {
                    self.dangling.note(self.line);
                }
                continue;
            }
            let index = match self.resolve(part, kind) {
                Ok(index) => index,
                Err(Dangling::Nothing) if kind > 0 => {
                    if !part.is_empty() {
                        self.dangling.note(self.line);
                    }
                    self.counts[kind] + 1 // the extra one
                }
                Err(_) => return Err(self.index_fault(part, kind, word)),
            };
            self.buffer.push(if kind == 0 { b' ' } else { b'/' });
            for _ in written + 1..kind {
                self.buffer.push(b'/'); // an empty texture index before a normal
            }
            push_number(&mut self.buffer, index);
            written = kind;
        }
        if parts.next().is_some() {
            return Err(format!("'{}' has more than vertex/texture/normal", quote(word)));
        }
        Ok(())
    }

    /// The absolute index, from 1, that `part` means.
    fn resolve(&self, part: &[u8], kind: usize) -> Result<usize, Dangling> {
        if part.is_empty() {
            return Err(Dangling::Nothing);
        }
        let index: i64 = std::str::from_utf8(part).ok().and_then(|p| p.parse().ok()).ok_or(Dangling::NoInteger)?;
        let absolute = if index < 0 { index.saturating_add(self.seen[kind] as i64 + 1) } else { index };
        usize::try_from(absolute).ok().filter(|i| (1..=self.counts[kind]).contains(i)).ok_or(Dangling::Nothing)
    }

    fn index_fault(&self, part: &[u8], kind: usize, word: &[u8]) -> String {
        let (what, text, count) = (INDEX_KINDS[kind], quote(part), self.counts[kind]);
        let digits = part.strip_prefix(b"-").unwrap_or(part);
        if part.is_empty() {
            format!("face corner '{}' has no {what} index", quote(word))
        } else if !digits.iter().all(u8::is_ascii_digit) || digits.is_empty() {
            format!("{what} index '{text}' is not a whole number")
        } else if digits.iter().all(|&d| d == b'0') {
            format!("{what} index 0; indices count from 1")
        } else if part.starts_with(b"-") {
            format!("{what} index {text} reaches before the first {what}: there are {} up to here", self.seen[kind])
        } else {
            format!("{what} index {text} is too large: the file has {count}")
        }
    }
}

/// Why an index means nothing.
enum Dangling {
    /// It is empty, zero or out of range.
    Nothing,
    /// It is not an integer of 64 bits.
    NoInteger,
}

impl Read for Cleaner<'_> {
    fn read(&mut self, target: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(target)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for Cleaner<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.consumed == self.buffer.len() {
            self.buffer.clear();
            self.consumed = 0;
            if let Err(fault) = self.produce() {
                self.fault = Some(fault);
                return Err(io::ErrorKind::InvalidData.into());
            }
        }
        Ok(&self.buffer[self.consumed..])
    }

    fn consume(&mut self, count: usize) {
        self.consumed += count;
    }
}

/// Appends `number` in decimal.
fn push_number(buffer: &mut Vec<u8>, mut number: usize) {
    let mut digits = [0; 20]; // usize::MAX has 20
    let mut first = digits.len();
    loop {
        first -= 1;
        digits[first] = b'0' + (number % 10) as u8;
        number /= 10;
        if number == 0 {
            break;
        }
    }
    buffer.extend_from_slice(&digits[first..]);
}
