//! Loads Neutral File Format files (NFF), the format of the Standard Procedural Databases.
//!
//! E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications 7(11), 1987;
//! format: the SPD's NFF document, version 3.1, 1992. Entities may be broken into lines as one likes; the view has its
//! own words.
//!
//! | NFF | scene |
//! |---|---|
//! | `v`, `from`, `at`, `up`, `angle` | camera; the angle is the vertical field of view. `hither` is not used |
//! | `resolution` | size of the picture, unless something else is asked for |
//! | `b` | background; black when missing |
//! | `l` | point light without falloff; n lights without a colour have an intensity of 1/√n each |
//! | `f` | diffuse = colour Kd; specular and mirror = Ks, white; shininess; transmission = T, white; index of refraction |
//! | `p`, `pp` | triangles, from both sides; concave polygons are split by [`super::triangulate`] |
//! | `s`, `c` | solids of as many segments as [`solids::MAX_TRIANGLES`] allows; cones and cylinders are open, as the format has them |
//!
//! Bad at: scenes of many spheres, which become coarse; sharing vertices, which the format does not know. A file is
//! read whole, and while it is turned into a scene takes up to nine times its size, but for the triangles of solids.

mod looks;
mod solids;

use super::check::{camera_fault, light_fault};
use super::obj::read_text;
use super::reading::warn_of_dropped;
use super::text::{Ignored, Tally, Warnings, quote};
use super::triangulate::{MAX_CORNERS, Triangulator};
use super::words::{Word, Words};
use super::{Background, Builder, Camera, Light, MaterialId, Normals, PictureDefaults, Scene};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use glam::Vec3;
use std::collections::HashMap;
use std::fmt::Display;
use std::iter::Peekable;
use std::ops::RangeInclusive;
use std::path::Path;

/// What a file takes while it is turned into a scene, in its own size, without the solids.
const BYTES_PER_BYTE: u64 = 9;

/// A part of the view and the line it stands on.
type Placed<T> = Option<(T, usize)>;

/// The view, as far as it has been read.
#[derive(Debug, Default)]
struct View {
    line: Option<usize>,
    from: Placed<Vec3>,
    at: Placed<Vec3>,
    up: Placed<Vec3>,
    angle: Placed<f32>,
}

/// What is known while a file is read.
struct Reader<'a> {
    path: &'a Path,
    words: Peekable<Words<'a>>,
    /// The line of the last word.
    line: usize,
    builder: Builder,
    view: View,
    /// Position, and colour if there is one.
    lights: Vec<(Vec3, Option<Vec3>)>,
    materials: HashMap<[u32; 8], MaterialId>,
    triangulator: Triangulator,
    segments: u32,
    /// Vertices and normals of the polygon in hand.
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    warnings: Warnings,
    ignored: Ignored,
    short_polygons: Tally,
    solids_without_size: Tally,
    inside_out: Tally,
    extra_materials: Tally,
}

/// Loads the NFF file at `path`.
pub(super) fn load(path: &Path, budget: &MemoryBudget) -> Result<Scene> {
    let text = read_text(path, BYTES_PER_BYTE, budget)?;
    let mut warnings = Warnings::default();
    let mut reader = Reader {
        path,
        words: Words::new(&text).peekable(),
        line: 1,
        builder: Builder::within(*budget),
        view: View::default(),
        lights: Vec::new(),
        materials: HashMap::new(),
        triangulator: Triangulator::new(),
        segments: solids::segments(path, &text, &mut warnings)?,
        positions: Vec::new(),
        normals: Vec::new(),
        warnings,
        ignored: Ignored::default(),
        short_polygons: Tally::default(),
        solids_without_size: Tally::default(),
        inside_out: Tally::default(),
        extra_materials: Tally::default(),
    };
    reader.builder.background(Background { bottom: Vec3::ZERO, top: Vec3::ZERO });
    while let Some(word) = reader.next_word() {
        reader.read_entity(word)?;
        if let Some(fault) = reader.builder.take_fault() {
            return Err(reader.error(word.line, fault));
        }
    }
    reader.finish()
}

impl<'a> Reader<'a> {
    fn error(&self, line: usize, message: impl Into<String>) -> Error {
        Error::input(self.path, line, message)
    }

    fn next_word(&mut self) -> Option<Word<'a>> {
        let word = self.words.next()?;
        self.line = word.line;
        Some(word)
    }

    /// The next word as a number, which `what` calls for.
    fn number(&mut self, what: impl Display) -> Result<f32> {
        let Some(word) = self.next_word() else {
            return Err(self.error(self.line, format!("the file ends where {what} should be")));
        };
        word.number().ok_or_else(|| {
            let comma = if word.text.contains(&b',') { "; decimals take a point, not a comma" } else { "" };
            self.error(word.line, format!("{what} should be a number, not '{}'{comma}", quote(word.text)))
        })
    }

    fn vector(&mut self, what: impl Display) -> Result<Vec3> {
        Ok(Vec3::new(self.number(&what)?, self.number(&what)?, self.number(&what)?))
    }

    /// A whole number in `range`, of which float32 holds both ends.
    fn whole(&mut self, what: &str, range: RangeInclusive<u32>) -> Result<u32> {
        let number = self.number(what)?;
        let (least, most) = (*range.start(), *range.end());
        if !(number >= least as f32 && number <= most as f32 && number.fract() == 0.0) {
            let message = format!("{what} is {number}; it must be a whole number from {least} to {most}");
            return Err(self.error(self.line, message));
        }
        Ok(number as u32)
    }

    /// The next number, if it stands on the same line as the last word.
    fn number_on_line(&mut self) -> Option<f32> {
        let number = self.words.peek().filter(|word| word.line == self.line)?.number()?;
        self.next_word();
        Some(number)
    }

    fn read_entity(&mut self, entity: Word<'a>) -> Result<()> {
        let line = entity.line;
        match entity.text {
            b"v" => self.view.line = Some(line),
            b"from" => self.view.from = Some((self.vector("'from'")?, line)),
            b"at" => self.view.at = Some((self.vector("'at'")?, line)),
            b"up" => self.view.up = Some((self.vector("'up'")?, line)),
            b"angle" => self.view.angle = Some((self.number("'angle'")?, line)),
            b"hither" | b"yon" => _ = self.number("a clipping distance")?,
            b"resolution" => {
                let mut side = || self.whole("'resolution'", 1..=PictureDefaults::MAX_SIDE);
                let size = Some((side()?, side()?));
                self.builder.picture(PictureDefaults { size, ..PictureDefaults::default() });
            }
            b"b" => {
                if let Some(colour) = self.looks::<3>(entity).map(Vec3::from) {
                    self.builder.background(Background { bottom: colour, top: colour });
                }
            }
            b"l" => self.read_light(line)?,
            b"f" => self.read_material(entity),
            b"p" | b"pp" => self.read_polygon(line, entity.text == b"pp")?,
            b"s" => self.read_sphere(line)?,
            b"c" => self.read_cone(line)?,
            _ if entity.number().is_some() => {
                let message =
                    format!("the number '{}' belongs to nothing: are there too many before it?", quote(entity.text));
                return Err(self.error(line, message));
            }
            _ => self.skip_unknown(entity),
        }
        Ok(())
    }

    /// Leaves out the rest of an entity's line, and the numbers on the lines that follow.
    fn skip_unknown(&mut self, entity: Word) {
        self.ignored.note(entity.text, entity.line);
        while self.words.peek().is_some_and(|word| word.line == entity.line || word.number().is_some()) {
            self.next_word();
        }
    }

    fn read_light(&mut self, line: usize) -> Result<()> {
        let position = self.vector("the position of a light")?;
        let colour = match self.number_on_line() {
            Some(red) => Some(Vec3::new(red, self.number("green of a light")?, self.number("blue of a light")?)),
            None => None,
        };
        if let Some(fault) = light_fault(&Light::point(position, colour.unwrap_or(Vec3::ONE))) {
            return Err(self.error(line, format!("light: {} {}", fault.key, fault.message)));
        }
        self.lights.push((position, colour));
        Ok(())
    }

    fn read_polygon(&mut self, line: usize, has_normals: bool) -> Result<()> {
        let corners = self.whole("the number of vertices of a polygon", 0..=MAX_CORNERS as u32)?;
        self.positions.clear();
        self.normals.clear();
        for corner in 1..=corners {
            let position = self.vector(format_args!("vertex {corner} of {corners}"))?;
            self.positions.push(position);
            if has_normals {
                let normal = self.vector(format_args!("normal {corner} of {corners}"))?;
                self.normals.push(normal);
            }
        }
        if corners < 3 {
            self.short_polygons.note(line);
            return Ok(());
        }
        let normals = if has_normals { Normals::Given(&self.normals) } else { Normals::Flat };
        let triangles = self.triangulator.split(&self.positions);
        self.builder.mesh(&self.positions, normals, &[], triangles);
        Ok(())
    }

    /// The scene, once all words are read.
    fn finish(mut self) -> Result<Scene> {
        self.finish_view()?;
        // The format leaves their strength open. With this one a scene neither darkens nor burns out when lights are
        // added.
        let strength = Vec3::splat((self.lights.len() as f32).sqrt().recip());
        for (position, colour) in std::mem::take(&mut self.lights) {
            self.builder.light(Light::point(position, colour.unwrap_or(strength)));
        }
        self.ignored.report(self.path, &mut self.warnings);
        for (tally, what) in [
            (self.short_polygons, "polygons with fewer than three vertices ignored"),
            (
                self.solids_without_size,
                "spheres, cones and cylinders without size, or with NaN or infinite numbers, ignored",
            ),
            (self.inside_out, "negative radii, of which only the inside should be seen; both sides are"),
            (self.extra_materials, "'f' with new looks ignored after the most that are kept"),
        ] {
            self.warnings.tally(self.path, tally, what);
        }
        if self.triangulator.fans > 0 {
            self.warnings.add(self.path, None, self.triangulator.fans_message());
        }
        let mut scene = self.builder.finish().map_err(|e| Error::input(self.path, None, e.to_string()))?;
        if scene.triangles.is_empty() {
            let message = "has no objects (p and pp of three or more vertices, s, c); is it a file in Haines' NFF?";
            return Err(Error::input(self.path, None, message));
        }
        warn_of_dropped(self.path, &scene, &mut self.warnings);
        scene.warnings = self.warnings.into_vec();
        Ok(scene)
    }

    /// The camera of the view, if the file has one: then all of it.
    fn finish_view(&mut self) -> Result<()> {
        let View { line, from, at, up, angle } = std::mem::take(&mut self.view);
        let Some(line) = line.or(from.or(at).or(up).map(|(_, line)| line)).or(angle.map(|(_, line)| line)) else {
            return Ok(());
        };
        let missing = |part: &str| self.error(line, format!("the view has no '{part}'"));
        let (eye, from_line) = from.ok_or_else(|| missing("from"))?;
        let (target, at_line) = at.ok_or_else(|| missing("at"))?;
        let (up, up_line) = up.ok_or_else(|| missing("up"))?;
        let (fov_degrees, angle_line) = angle.ok_or_else(|| missing("angle"))?;
        let camera = Camera { eye, target, up, fov_degrees };
        if let Some(fault) = camera_fault(&camera) {
            let (part, line) = match fault.key {
                "eye" => ("from", from_line),
                "target" => ("at", at_line),
                "up" => ("up", up_line),
                _ => ("angle", angle_line),
            };
            return Err(self.error(line, format!("'{part}' {}", fault.message)));
        }
        self.builder.camera(camera);
        Ok(())
    }
}
