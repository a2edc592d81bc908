//! The `[[object]]` tables of scene files: what they show, of which material, and where.

use super::Reader;
use super::table::{Table, suggestion};
use crate::error::Result;
use crate::scene::SourceFile;
use crate::scene::reading::loader_of;
use crate::scene::solids::DEFAULT_SEGMENTS;
use crate::scene::texture::load_texture;
use crate::scene::{Builder, MAX_SEGMENTS, MaterialId, ObjectId, height};
use glam::{Vec2, Vec3};
use std::collections::hash_map::Entry;
use toml::de::DeValue;

/// The keys that every object has.
const COMMON_KEYS: [&str; 7] = ["file", "solid", "material", "translate", "rotate", "scale", "instances"];

/// The keys of an instance.
const INSTANCE_KEYS: [&str; 4] = ["material", "translate", "rotate", "scale"];

/// The solids and the keys of each.
const SOLIDS: [(&str, &[&str]); 8] = [
    ("sphere", &["radius", "segments", "uv-scale"]),
    ("box", &["size", "uv-scale"]),
    ("cylinder", &["radius", "height", "segments", "caps", "uv-scale"]),
    ("cone", &["radius", "top-radius", "height", "segments", "caps", "uv-scale"]),
    ("disc", &["radius", "inner-radius", "segments", "uv-scale"]),
    ("quad", &["origin", "edge-u", "edge-v", "segments", "uv-scale"]),
    ("torus", &["major-radius", "minor-radius", "segments", "sides", "uv-scale"]),
    (
        "height-field",
        &["size", "picture", "height", "formula", "amplitude", "frequency", "seed", "segments", "uv-scale"],
    ),
];

/// Segments along each side of a height field.
const FIELD_SEGMENTS: u32 = 128;

impl<'a> Reader<'a> {
    pub(super) fn read_objects(&mut self, root: &Table<'a>) -> Result<()> {
        for value in self.array_of_tables(root, "object")? {
            let table = Table::of(self.source, "[[object]]", value)?;
            self.builder.push();
            let is_shared = table.has("instances");
            if is_shared {
                self.builder.begin_object();
            }
            match (table.text("file")?, table.choice("solid", &SOLIDS.map(|(name, _)| name))?) {
                (Some(file), None) => {
                    let table = table.allow("an object from a file", &COMMON_KEYS)?;
                    place(&table, &mut self.builder)?;
                    self.add_file(&table, file)?;
                }
                (None, Some(solid)) => {
                    let (name, keys) = SOLIDS[solid];
                    let keys = [&COMMON_KEYS, keys].concat();
                    let table = table.allow(&format!("the solid {name}"), &keys)?;
                    place(&table, &mut self.builder)?;
                    self.add_solid(&table, name)?;
                }
                (Some(_), Some(_)) => {
                    return Err(table.error("solid", "and file are both given; an object is one of them"));
                }
                (None, None) => {
                    // With neither, a misspelt "solid" is the likeliest reason.
                    let keys = SOLIDS.iter().fold(COMMON_KEYS.to_vec(), |all, (_, keys)| [all, keys.to_vec()].concat());
                    return Err(table.allow("an object", &keys)?.error_here("needs a file or a solid"));
                }
            }
            if let Some(fault) = self.builder.take_fault() {
                return Err(table.error_here(format!("cannot be built: {fault}")));
            }
            if is_shared {
                let object = self.builder.end_object();
                self.read_instances(&table, object)?;
            }
            self.builder.pop();
            self.builder.note_object_end();
        }
        Ok(())
    }

    /// Puts an object where `instances` of its table says.
    fn read_instances(&mut self, table: &Table<'a>, object: ObjectId) -> Result<()> {
        let Some(value) = table.get("instances") else { return Ok(()) };
        let name = table.name_of("instances");
        let entries = value
            .get_ref()
            .as_array()
            .ok_or_else(|| table.wrong_type("instances", "an array of tables", value.get_ref()))?;
        for entry in entries {
            let entry = Table::of(self.source, &name, entry)?.allow("an instance", &INSTANCE_KEYS)?;
            let material = self.object_material(&entry)?;
            self.builder.push();
            place(&entry, &mut self.builder)?;
            self.builder.instance(object, material);
            if let Some(fault) = self.builder.take_fault() {
                return Err(entry.error_here(format!("cannot be placed: {fault}")));
            }
            self.builder.pop();
        }
        Ok(())
    }

    /// The material that `table` names.
    fn object_material(&self, table: &Table) -> Result<Option<MaterialId>> {
        let Some(name) = table.text("material")? else { return Ok(None) };
        self.materials.get(name).copied().map(Some).ok_or_else(|| {
            // In a fixed order: the map has none.
            let mut names: Vec<&str> = self.materials.keys().copied().collect();
            names.sort_unstable();
            table.error("material", format!("'{name}' is not defined; {}", suggestion(name, names.into_iter())))
        })
    }

    fn add_file(&mut self, table: &Table, file: &str) -> Result<()> {
        let material = self.object_material(table)?;
        let path = self.inside_folder(table, "file", file)?;
        let Some(load) = loader_of(&path, self.models) else {
            let endings: Vec<_> = self.models.iter().map(|(ending, _)| *ending).collect();
            return Err(table.error("file", format!("'{file}' is not a model; possible: .{}", endings.join(", ."))));
        };
        let scene = match self.files.entry(path) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let mut scene = load(new.key(), &self.budget)?;
                let role = format!("the model that '{}' names", self.source.path.display());
                scene.files.push(SourceFile { path: new.key().clone(), role });
                new.insert(scene)
            }
        };
        self.builder.add_scene(scene, material);
        // Told once, however many objects show the file.
        scene.warnings.clear();
        scene.files.clear();
        Ok(())
    }

    fn add_solid(&mut self, table: &Table, name: &str) -> Result<()> {
        match self.object_material(table)? {
            Some(id) => self.builder.use_material(id),
            None => self.builder.reset_material(),
        };
        self.builder.uv_scale(table.numbers::<2>("uv-scale")?.map_or(Vec2::ONE, Vec2::from));
        let positive = |key: &str, default: f32| Ok(table.positive(key)?.unwrap_or(default));
        let number = |key: &str, default: f32| Ok(table.number(key)?.unwrap_or(default));
        let vector = |key: &str, default: Vec3| Ok(table.vector(key)?.unwrap_or(default));
        let segments =
            |key: &str, least: u32, default: u32| Ok(table.whole(key, least..=MAX_SEGMENTS)?.unwrap_or(default));
        let builder = &mut self.builder;
        match name {
            "sphere" => builder.sphere(positive("radius", 1.0)?, segments("segments", 3, DEFAULT_SEGMENTS)?),
            "box" => builder.cuboid(table.vector_or_number("size")?.unwrap_or(Vec3::ONE)),
            "cylinder" | "cone" => {
                let radius = positive("radius", 1.0)?;
                let top = if name == "cylinder" { radius } else { number("top-radius", 0.0)? };
                let caps = table.boolean("caps")?.unwrap_or(true);
                builder.frustum(radius, top, positive("height", 1.0)?, segments("segments", 3, DEFAULT_SEGMENTS)?, caps)
            }
            "disc" => builder.disc(
                number("inner-radius", 0.0)?,
                positive("radius", 1.0)?,
                segments("segments", 3, DEFAULT_SEGMENTS)?,
            ),
            "quad" => {
                let origin = vector("origin", Vec3::new(-0.5, 0.0, 0.5))?;
                let (u, v) = (vector("edge-u", Vec3::X)?, vector("edge-v", Vec3::NEG_Z)?);
                builder.quad(origin, u, v, segments("segments", 1, 1)?)
            }
            "torus" => {
                let (major, minor) = (positive("major-radius", 1.0)?, positive("minor-radius", 0.25)?);
                builder.torus(
                    major,
                    minor,
                    segments("segments", 3, DEFAULT_SEGMENTS)?,
                    segments("sides", 3, DEFAULT_SEGMENTS / 2)?,
                )
            }
            _ => return self.add_height_field(table),
        };
        Ok(())
    }

    fn add_height_field(&mut self, table: &Table) -> Result<()> {
        let [width, depth] = table.numbers::<2>("size")?.unwrap_or([1.0; 2]);
        if width <= 0.0 || depth <= 0.0 {
            return Err(table.error("size", "must be above 0 along both sides"));
        }
        let own_segments = table.whole("segments", 1..=MAX_SEGMENTS)?;
        let formula = table.choice("formula", &height::FORMULAS)?;
        self.builder.scale(Vec3::new(width, 1.0, depth));
        if let Some(file) = table.text("picture")? {
            if let Some(key) = ["formula", "amplitude", "frequency", "seed"].into_iter().find(|key| table.has(key)) {
                return Err(table.error(key, "does not go with a picture; heights come from one or the other"));
            }
            let path = self.inside_folder(table, "picture", file)?;
            self.note_picture(path, "picture of heights");
            let picture = load_texture(self.folder, file, &self.budget)
                .map_err(|e| table.error("picture", format!("'{file}': {e}")))?;
            let side = |texels: u32| own_segments.unwrap_or((texels.max(2) - 1).min(MAX_SEGMENTS));
            let heights = height::from_picture(&picture, table.number("height")?.unwrap_or(1.0));
            self.builder.height_field(side(picture.width), side(picture.height), heights);
            return Ok(());
        }
        let formula = table.required("formula", formula)?;
        if table.has("height") {
            return Err(table.error("height", "goes with a picture; a formula has an amplitude"));
        }
        let amplitude = table.number("amplitude")?.unwrap_or(0.1);
        let frequency = table.positive("frequency")?.unwrap_or(4.0);
        let seed = table.whole("seed", 0..=u32::MAX)?.unwrap_or(0);
        let segments = own_segments.unwrap_or(FIELD_SEGMENTS);
        self.builder.height_field(segments, segments, height::formula(formula, amplitude, frequency, seed));
        Ok(())
    }
}

/// Scales, then rotates, then moves what follows.
pub(super) fn place(table: &Table, builder: &mut Builder) -> Result<()> {
    if let Some(offset) = table.vector("translate")? {
        builder.translate(offset);
    }
    rotate(table, builder)?;
    if let Some(factors) = table.vector_or_number("scale")? {
        if factors.to_array().contains(&0.0) {
            return Err(table.error("scale", "is 0 along an axis, which flattens everything to nothing"));
        }
        builder.scale(factors);
    }
    Ok(())
}

/// Angles about x, then y, then z, or a table of axis and angle.
fn rotate(table: &Table, builder: &mut Builder) -> Result<()> {
    match table.get("rotate") {
        Some(value) if matches!(value.get_ref(), DeValue::Table(_)) => {
            let name = table.name_of("rotate");
            let turn = Table::of(table.source, &name, value)?.allow(&name, &["axis", "degrees"])?;
            let axis = turn.required("axis", turn.vector("axis")?)?;
            if axis == Vec3::ZERO {
                return Err(turn.error("axis", "is zero: it has no direction"));
            }
            let degrees = turn.required("degrees", turn.number("degrees")?)?;
            builder.rotate(axis, degrees);
        }
        _ => {
            let Some(angles) = table.vector("rotate")? else { return Ok(()) };
            // The last call acts first.
            builder.rotate(Vec3::Z, angles.z).rotate(Vec3::Y, angles.y).rotate(Vec3::X, angles.x);
        }
    }
    Ok(())
}
