//! Cuts an OBJ text into parts and counts what each holds, so that the parts can be read beside each other: each then
//! knows the numbers of its first line, vertex and triangle and the material in force at its beginning.

use crate::parallel;
use crate::scene::text::{BYTE_ORDER_MARK, Ignored, Lines, split_keyword};
use memchr::memchr2;
use std::borrow::Cow;
use std::collections::HashMap;

/// Bytes of a part: many parts for each processor, so that all end at about the same time, and each still takes a
/// millisecond.
pub(super) const PART_BYTES: usize = 1 << 18;

/// The name of a material.
pub(super) type Name<'a> = Cow<'a, [u8]>;

/// A piece of the text that begins and ends with a statement.
#[derive(Debug)]
pub(super) struct Part<'a> {
    text: &'a [u8],
    /// Lines before it.
    first_line: usize,
    /// `v`, `vt` and `vn` statements before it, and in it.
    pub(super) before: [usize; 3],
    pub(super) counts: [usize; 3],
    /// Number of `f` statements.
    pub(super) faces: usize,
    /// How many triangles they make.
    pub(super) triangles: usize,
    /// The last `usemtl` before it.
    pub(super) material: Option<Name<'a>>,
}

impl<'a> Part<'a> {
    /// Its statements with the numbers of their lines in the file.
    pub(super) fn lines(&self) -> Lines<'a> {
        Lines::after(self.first_line, self.text)
    }
}

/// What a first look over an OBJ text finds.
#[derive(Debug, Default)]
pub(super) struct Survey<'a> {
    /// The text in pieces.
    pub(super) parts: Vec<Part<'a>>,
    /// Numbers of `v`, `vt` and `vn` statements.
    pub(super) counts: [usize; 3],
    /// Number of `f` statements.
    pub(super) faces: usize,
    /// How many triangles they make.
    pub(super) triangles: usize,
    /// Line and argument of each `mtllib`.
    pub(super) libraries: Vec<(usize, String)>,
    /// Each material that a `usemtl` names and the first line that does, in the order of these.
    pub(super) materials: Vec<(usize, Name<'a>)>,
    /// Whether a face of three or more corners stands before the first `usemtl`.
    pub(super) has_bare_faces: bool,
    /// What is left out.
    pub(super) ignored: Ignored,
}

/// What a look over one part finds; lines are counted from its beginning.
#[derive(Debug, Default)]
struct Found<'a> {
    lines: usize,
    counts: [usize; 3],
    faces: usize,
    triangles: usize,
    libraries: Vec<(usize, String)>,
    /// The first line of each material.
    materials: HashMap<Name<'a>, usize>,
    last_material: Option<Name<'a>>,
    has_bare_faces: bool,
    ignored: Ignored,
}

impl<'a> Survey<'a> {
    /// Counts the statements of `text`, in parts of about `part_bytes`.
    pub(super) fn new(text: &'a [u8], part_bytes: usize) -> Self {
        let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
        let texts = cut(text, part_bytes);
        let found = parallel::map(texts.iter(), |text| Found::new(text));
        let mut survey = Survey::default();
        let (mut first_line, mut material, mut told_apart) = (0, None, true);
        for (text, found) in texts.into_iter().zip(found) {
            survey.has_bare_faces |= found.has_bare_faces && material.is_none();
            let Found { counts, faces, triangles, .. } = found;
            let before = survey.counts;
            survey.parts.push(Part { text, first_line, before, counts, faces, triangles, material: material.clone() });
            for (sum, count) in survey.counts.iter_mut().zip(counts) {
                *sum += count;
            }
            survey.faces += faces;
            survey.triangles += triangles;
            survey.libraries.extend(found.libraries.into_iter().map(|(line, names)| (first_line + line, names)));
            survey.materials.extend(found.materials.into_iter().map(|(name, line)| (first_line + line, name)));
            told_apart &= survey.ignored.append(&found.ignored, first_line);
            material = found.last_material.or(material);
            first_line += found.lines;
        }
        survey.materials.sort_unstable_by_key(|&(line, _)| line);
        if !told_apart {
            survey.ignored = ignored(text);
        }
        survey
    }
}

impl<'a> Found<'a> {
    fn new(text: &'a [u8]) -> Self {
        let mut found = Found::default();
        let mut lines = Lines::after(0, text);
        for (number, line) in lines.by_ref() {
            let (keyword, rest) = split_keyword(&line);
            match keyword {
                b"v" => found.counts[0] += 1,
                b"vt" => found.counts[1] += 1,
                b"vn" => found.counts[2] += 1,
                b"f" => {
                    let corners = count_words(rest);
                    found.faces += 1;
                    found.triangles += corners.saturating_sub(2);
                    found.has_bare_faces |= corners > 2 && found.last_material.is_none();
                }
                b"mtllib" => found.libraries.push((number, String::from_utf8_lossy(rest).into_owned())),
                b"usemtl" => {
                    let name = material_name(line);
                    if found.last_material.as_ref() != Some(&name) {
                        found.materials.entry(name.clone()).or_insert(number);
                        found.last_material = Some(name);
                    }
                }
                _ if is_ignored(keyword) => found.ignored.note(keyword, number),
                _ => {}
            }
        }
        found.lines = lines.number();
        found
    }
}

/// The argument of a `usemtl` statement.
pub(super) fn material_name(line: Cow<'_, [u8]>) -> Name<'_> {
    match line {
        Cow::Borrowed(line) => Cow::Borrowed(split_keyword(line).1),
        Cow::Owned(line) => Cow::Owned(split_keyword(&line).1.to_vec()),
    }
}

/// Whether statements of `keyword` are left out. Groups, objects and smoothing change nothing here: normals come from
/// the file or the triangle.
fn is_ignored(keyword: &[u8]) -> bool {
    !matches!(keyword, b"" | b"v" | b"vt" | b"vn" | b"f" | b"mtllib" | b"usemtl" | b"o" | b"g" | b"s" | b"mg")
}

/// What is left out of a text of many unknown keywords: only in one go it is clear which of them come first.
fn ignored(text: &[u8]) -> Ignored {
    let mut ignored = Ignored::default();
    for (number, line) in Lines::after(0, text) {
        let (keyword, _) = split_keyword(&line);
        if is_ignored(keyword) {
            ignored.note(keyword, number);
        }
    }
    ignored
}

/// How many words [`crate::scene::text::words`] finds.
fn count_words(rest: &[u8]) -> usize {
    let (mut count, mut in_word) = (0, false);
    for &byte in rest {
        if byte == b'#' {
            break;
        }
        let is_blank = byte.is_ascii_whitespace();
        count += usize::from(!is_blank && !in_word);
        in_word = !is_blank;
    }
    count
}

/// Cuts `text` into pieces of about `part_bytes` where a statement surely begins: after a line that does not end with a
/// backslash.
fn cut(text: &[u8], part_bytes: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::with_capacity(text.len() / part_bytes + 1);
    let mut rest = text;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(statement_end(rest, part_bytes));
        pieces.push(piece);
        rest = after;
    }
    pieces
}

/// The end of the first statement of `text` that surely ends at `least` or later.
fn statement_end(text: &[u8], least: usize) -> usize {
    let mut searched = least.min(text.len());
    while let Some(found) = memchr2(b'\n', b'\r', &text[searched..]) {
        let end = searched + found;
        let is_half = text[end] == b'\n' && text[..end].ends_with(b"\r"); // the search began within "\r\n"
        let line = &text[..end - usize::from(is_half)];
        searched = end + if text[end..].starts_with(b"\r\n") { 2 } else { 1 };
        if !line.ends_with(b"\\") {
            return searched;
        }
    }
    text.len()
}
