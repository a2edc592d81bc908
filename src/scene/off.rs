//! Loads OFF files (Object File Format), text.
//!
//! Format: Geomview, "OFF Files", manual of version 1.9, and what writers make of it: the counts may follow the first
//! word at once (ModelNet), the number of edges may be missing, and colours are 0 to 255 or 0 to 1.
//!
//! | header | a vertex has |
//! |---|---|
//! | `OFF`, or none at all | x y z |
//! | `N` | a normal behind that |
//! | `C` | a colour behind that |
//! | `ST` | texture coordinates behind that |
//!
//! Letters stand before `OFF` in the order `ST` `C` `N`. A face is a number of corners, these, and a colour, which
//! counts where vertices have none; a single number there is one of a table of colours, which is not read. Colours
//! become materials (`paint.rs`). `4OFF` and `nOFF`, which are not of three dimensions, and binary files are refused.
//!
//! Bad at: memory, as a file is read whole.

use super::obj::read_text;
use super::paint;
use super::reading::{make_room, warn_of_dropped};
use super::text::{Tally, Warnings, integer, quote};
use super::triangulate::{MAX_CORNERS, Triangulator};
use super::words::{Word, Words};
use super::{NO_INDEX, Scene, Triangle};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use glam::{Vec2, Vec3};
use std::fmt::{Display, Formatter};
use std::iter::Peekable;
use std::path::Path;

/// What a file takes while it is turned into a scene, in its own size and beside its triangles: "0 0 0" is a vertex. Of
/// triangles a polygon has nearly as many as corners, of two bytes each: there memory is checked as they are made.
const BYTES_PER_BYTE: u64 = 8;

/// Loads the OFF file at `path`: a scene without lights and camera.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let text = read_text(path, BYTES_PER_BYTE, budget)?;
    let mut reader = Reader::new(path, &text, *budget);
    let header = reader.read_header()?;
    let [vertices, faces] = reader.read_counts(&header)?;
    for number in 0..vertices {
        reader.read_vertex(&header, number, vertices)?;
    }
    for number in 0..faces {
        reader.read_face(number, faces)?;
    }
    reader.finish()
}

/// What the first word says that a vertex has.
#[derive(Debug, Default, PartialEq)]
struct Header {
    normals: bool,
    colours: bool,
    uvs: bool,
    /// The number of vertices, where it follows at once.
    glued: Option<usize>,
}

impl Header {
    /// What `word` says, or why it is refused; none when it is no header.
    fn of(word: &[u8]) -> std::result::Result<Option<Header>, &'static str> {
        let text = String::from_utf8_lossy(word);
        let Some((letters, rest)) = text.split_once("OFF").or_else(|| text.split_once("off")) else { return Ok(None) };
        let glued = match rest {
            "" => None,
            digits => Some(digits.parse().map_err(|_| "is not an OFF file: it begins with a word like 'OFF'")?),
        };
        let (uvs, letters) = letters.strip_prefix("ST").map_or((false, letters), |rest| (true, rest));
        let (colours, letters) = letters.strip_prefix('C').map_or((false, letters), |rest| (true, rest));
        let (normals, letters) = letters.strip_prefix('N').map_or((false, letters), |rest| (true, rest));
        match letters {
            "" => Ok(Some(Header { normals, colours, uvs, glued })),
            "4" | "n" | "4n" => {
                Err("has vertices that are not of three dimensions (4OFF, nOFF), which are not supported")
            }
            _ => Err("is not an OFF file: it begins with a word like 'OFF'"),
        }
    }
}

/// Colours as they stand there: whether they are 0 to 255 or 0 to 1 is known when all are read.
#[derive(Debug, Default)]
struct Colours {
    list: Vec<Option<[f32; 3]>>,
    has_points: bool,
    largest: f32,
    transparent: usize,
}

impl Colours {
    /// Adds the colour that `words` are; false when they are none.
    fn add(&mut self, words: &[Word]) -> bool {
        let numbers: Option<Vec<f32>> = words.iter().map(Word::number).collect();
        let Some(numbers) = numbers.filter(|numbers| (3..=4).contains(&numbers.len())) else {
            self.list.push(None);
            return false;
        };
        let is_point = |word: &Word| word.text.iter().any(|&b| !b.is_ascii_digit());
        self.has_points |= words.iter().any(is_point);
        self.largest = numbers.iter().fold(self.largest, |largest, &x| largest.max(x));
        self.transparent += usize::from(numbers.get(3).is_some_and(|&alpha| alpha != 255.0 && alpha != 1.0));
        self.list.push(Some([numbers[0], numbers[1], numbers[2]]));
        true
    }

    /// All of them in 8 bits.
    fn to_8_bits(&self) -> Vec<Option<[u8; 3]>> {
        let factor = if self.has_points || self.largest <= 1.0 { 255.0 } else { 1.0 };
        let to_8_bits = |colour: [f32; 3]| colour.map(|part| paint::to_8_bits(factor * part));
        self.list.iter().map(|colour| colour.map(to_8_bits)).collect()
    }
}

/// A vertex or a face, for messages.
struct Row {
    kind: &'static str,
    number: usize,
    count: usize,
}

impl Display for Row {
    fn fmt(&self, f: &mut Formatter) -> std::fmt::Result {
        let Row { kind, number, count } = self;
        write!(f, "{kind} {number} of {count} (counted from 0)")
    }
}

/// What is known while a file is read.
struct Reader<'a> {
    path: &'a Path,
    budget: MemoryBudget,
    words: Peekable<Words<'a>>,
    line: usize,
    triangulator: Triangulator,
    scene: Scene,
    has_normals: bool,
    /// One for each vertex, or none.
    vertex_colours: Colours,
    /// One for each face.
    face_colours: Colours,
    has_face_colours: bool,
    /// The face of each triangle.
    faces: Vec<u32>,
    polygon: Vec<Vec3>,
    corners: Vec<u32>,
    short: Tally,
    numbers_beside: Tally,
    table_colours: Tally,
    missing_colours: Tally,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, text: &'a [u8], budget: MemoryBudget) -> Reader<'a> {
        Reader {
            path,
            budget,
            words: Words::new(text).peekable(),
            line: 1,
            triangulator: Triangulator::new(),
            scene: Scene::default(),
            has_normals: false,
            vertex_colours: Colours::default(),
            face_colours: Colours::default(),
            has_face_colours: false,
            faces: Vec::new(),
            polygon: Vec::new(),
            corners: Vec::new(),
            short: Tally::default(),
            numbers_beside: Tally::default(),
            table_colours: Tally::default(),
            missing_colours: Tally::default(),
        }
    }

    fn error(&self, line: usize, message: impl Into<String>) -> Error {
        Error::input(self.path, line, message)
    }

    /// The next word, which `what` calls for.
    fn next_word(&mut self, what: impl Display) -> Result<Word<'a>> {
        match self.words.next() {
            Some(word) => {
                self.line = word.line;
                Ok(word)
            }
            None => Err(self.error(self.line, format!("the file ends where {what} should be"))),
        }
    }

    fn number(&mut self, what: impl Display) -> Result<f32> {
        let word = self.next_word(&what)?;
        word.number()
            .ok_or_else(|| self.error(word.line, format!("{what} should be a number, not '{}'", quote(word.text))))
    }

    fn whole(&mut self, what: impl Display) -> Result<usize> {
        let word = self.next_word(&what)?;
        let number = integer(word.text).and_then(|number| usize::try_from(number).ok());
        number.ok_or_else(|| {
            self.error(word.line, format!("{what} should be a whole number, not '{}'", quote(word.text)))
        })
    }

    /// The words that follow on the line of the last one.
    fn rest_of_line(&mut self) -> Vec<Word<'a>> {
        let line = self.line;
        std::iter::from_fn(|| self.words.next_if(|word| word.line == line)).collect()
    }

    fn read_header(&mut self) -> Result<Header> {
        let Some(&first) = self.words.peek() else { return Err(Error::input(self.path, None, "is empty")) };
        // The word may be missing.
        if first.number().is_some() {
            return Ok(Header::default());
        }
        self.next_word("the first word")?;
        let header = Header::of(first.text).map_err(|fault| self.error(first.line, fault))?;
        let header =
            header.ok_or_else(|| self.error(first.line, "is not an OFF file: it begins with a word like 'OFF'"))?;
        if self.words.peek().is_some_and(|word| word.text.eq_ignore_ascii_case(b"BINARY")) {
            return Err(self.error(first.line, "is a binary OFF file, which is not supported; save it as text"));
        }
        Ok(header)
    }

    /// How many vertices and faces there are.
    fn read_counts(&mut self, header: &Header) -> Result<[usize; 2]> {
        let vertices = match header.glued {
            Some(count) => count,
            None => self.whole("the number of vertices")?,
        };
        let faces = self.whole("the number of faces")?;
        self.rest_of_line(); // edges, of which nothing depends
        if vertices >= NO_INDEX as usize {
            let message = format!("has {vertices} vertices, more than 32-bit indices can tell apart");
            return Err(self.error(self.line, message));
        }
        if faces == 0 {
            return Err(Error::input(self.path, None, "has no faces"));
        }
        self.has_normals = header.normals;
        Ok([vertices, faces])
    }

    fn vector(&mut self, what: impl Display) -> Result<Vec3> {
        Ok(Vec3::new(self.number(&what)?, self.number(&what)?, self.number(&what)?))
    }

    fn read_vertex(&mut self, header: &Header, number: usize, count: usize) -> Result<()> {
        let what = Row { kind: "vertex", number, count };
        let position = self.vector(&what)?;
        self.scene.positions.push(position);
        if header.normals {
            let normal = self.vector(format_args!("the normal of {what}"))?;
            self.scene.normals.push(if normal.is_finite() { normal } else { Vec3::ZERO });
        }
        let mut rest = self.rest_of_line();
        if header.uvs {
            let uv = rest.split_off(rest.len().saturating_sub(2));
            let uv: Vec<f32> = uv.iter().filter_map(Word::number).filter(|x| x.is_finite()).collect();
            let [u, v] = uv[..] else {
                return Err(self.error(self.line, format!("{what} has no texture coordinates on its line")));
            };
            self.scene.uvs.push(Vec2::new(u, v));
        }
        if header.colours {
            if !self.vertex_colours.add(&rest) {
                self.missing_colours.note(self.line);
            }
        } else if !rest.is_empty() {
            self.numbers_beside.note(self.line);
        }
        Ok(())
    }

    fn read_face(&mut self, number: usize, count: usize) -> Result<()> {
        let what = Row { kind: "face", number, count };
        let corners = self.whole(&what)?;
        let line = self.line;
        if corners > MAX_CORNERS {
            return Err(self.error(line, format!("{what} has {corners} corners; the most is {MAX_CORNERS}")));
        }
        self.corners.clear();
        self.polygon.clear();
        for _ in 0..corners {
            let index = self.whole(format_args!("a corner of {what}"))?;
            let vertices = self.scene.positions.len();
            let Some(&position) = self.scene.positions.get(index) else {
                return Err(self.error(self.line, format!("{what} names vertex {index}, but there are {vertices}")));
            };
            self.corners.push(index as u32);
            self.polygon.push(position);
        }
        let colour = self.rest_of_line();
        let is_colour = self.face_colours.add(&colour);
        self.has_face_colours |= is_colour;
        if !is_colour && !colour.is_empty() {
            self.table_colours.note(line);
        }
        if corners < 3 {
            self.short.note(line);
        }
        let (has_normals, has_uvs) = (self.has_normals, !self.scene.uvs.is_empty());
        let triangles = self.triangulator.split(&self.polygon);
        make_room(&mut self.scene.triangles, triangles.len(), self.path, &self.budget)?;
        make_room(&mut self.faces, triangles.len(), self.path, &self.budget)?;
        for triangle in triangles {
            let positions = triangle.map(|corner| self.corners[corner as usize]);
            let normals = if has_normals { positions } else { [NO_INDEX; 3] };
            let uvs = if has_uvs { positions } else { [NO_INDEX; 3] };
            self.scene.triangles.push(Triangle { positions, normals, uvs, material: paint::PLAIN });
            self.faces.push(number as u32);
        }
        Ok(())
    }

    /// Gives each triangle its paint; whether it is the mean of several colours.
    fn paint(&mut self) -> bool {
        let mut blended = false;
        if !self.vertex_colours.list.is_empty() {
            let colours = self.vertex_colours.to_8_bits();
            for triangle in &mut self.scene.triangles {
                let [Some(a), Some(b), Some(c)] = triangle.positions.map(|i| colours[i as usize]) else { continue };
                blended |= a != b || a != c;
                triangle.material = paint::coloured(paint::mean([a, b, c]));
            }
        } else if self.has_face_colours {
            let colours = self.face_colours.to_8_bits();
            for (triangle, &face) in self.scene.triangles.iter_mut().zip(&self.faces) {
                triangle.material = colours[face as usize].map_or(paint::PLAIN, paint::coloured);
            }
        }
        blended
    }

    fn finish(mut self) -> Result<Scene> {
        if self.scene.triangles.is_empty() {
            return Err(Error::input(self.path, None, "has no face of three or more corners"));
        }
        let blended = self.paint();
        let mut warnings = Warnings::default();
        for (tally, what) in [
            (self.short, "faces with fewer than three corners ignored"),
            (self.numbers_beside, "numbers beside vertices, of which the first word says nothing, not used"),
            (self.missing_colours, "vertices without the colour that the first word promises"),
            (self.table_colours, "colours of faces by their number in a table not used"),
        ] {
            warnings.tally(self.path, tally, what);
        }
        let transparent = self.vertex_colours.transparent + self.face_colours.transparent;
        if transparent > 0 {
            warnings.add(self.path, None, format!("not used: transparency of colours ({transparent})"));
        }
        if let Some(word) = self.words.next() {
            warnings.add(self.path, word.line, "has more than its first lines promise; the rest is not read");
        }
        if self.triangulator.fans > 0 {
            warnings.add(self.path, None, self.triangulator.fans_message());
        }
        let (materials, reduced) = paint::materials(&mut self.scene.triangles, &[], blended);
        warnings.extend(self.path, reduced);
        let mut scene = Scene { materials, ..self.scene };
        warn_of_dropped(self.path, &scene, &mut warnings);
        scene.warnings = warnings.into_vec();
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_words() {
        let of = |word: &str| Header::of(word.as_bytes());
        let plain = Header::default;
        assert_eq!(of("OFF"), Ok(Some(plain())));
        assert_eq!(of("off"), Ok(Some(plain())));
        assert_eq!(of("STCNOFF"), Ok(Some(Header { normals: true, colours: true, uvs: true, glued: None })));
        assert_eq!(of("COFF"), Ok(Some(Header { colours: true, ..plain() })));
        assert_eq!(of("OFF490"), Ok(Some(Header { glued: Some(490), ..plain() })));
        assert_eq!(of("solid"), Ok(None));
        for (word, part) in [
            ("4OFF", "three dimensions"),
            ("N4OFF", "three dimensions"),
            ("nOFF", "three dimensions"),
            ("XOFF", "not an OFF"),
            ("OFFx", "not an OFF"),
        ] {
            assert!(of(word).unwrap_err().contains(part), "{word}");
        }
    }
}
