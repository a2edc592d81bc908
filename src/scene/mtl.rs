//! Material libraries (MTL) and their textures, turned into the scene's materials as an OBJ file uses them.
//!
//! Format: Wavefront, "MTL material format", 1995 (Paul Bourke's copy). Read here and not by `tobj`, whose MTL parser
//! panics on a colour of one number, which the format allows. The mapping to [`Material`], colours taken as linear RGB:
//!
//! | MTL | material |
//! |---|---|
//! | `Kd` | diffuse; 0.8 when missing, 1 when missing beside a `map_Kd` |
//! | `map_Kd` | diffuse texture; options such as `-s` are read over |
//! | `Ka` | ambient; the diffuse colour when missing or 0 0 0. With a component above 1 it is no reflectance but a lamp (the Cornell box: 20): emission |
//! | `Ke` | emission |
//! | `Ks`, `Ns` | specular and shininess (at most [`Material::MAX_SHININESS`]; 10 when missing) |
//! | `d`, `Tr` | opacity d, or 1 - Tr; `d` wins |
//! | `Tf` | colour of what passes, 1 when missing: transmission = (1 - d) Tf |
//! | `Ni` | index of refraction; 1 (straight through) when missing |
//! | `illum 0` | no light needed: emission = Kd, all else black |
//! | `illum 1` | no specular |
//! | `illum 2`, none, 10 | Blinn–Phong |
//! | `illum 3`, `5`, `8` | and mirror = Ks |
//! | `illum 4`, `6`, `7`, `9` | glass: as 2, but with d = 1 (or missing) transmission = Tf |
//!
//! Light that passes is not scattered: ambient and diffuse are scaled by d, or for glass with d = 1 by 1 - Tf. A
//! statement that makes no sense (NaN, negative, too few numbers) is left out with a warning. Materials, and so
//! textures, are loaded when a face first needs them; an unused one costs nothing.

use super::text::{Ignored, Lines, Warnings, quote, split_keyword, words};
use super::texture::{Texture, TextureId, decode, find_inside};
use super::{Material, MaterialId, SourceFile};
use crate::budget::MemoryBudget;
use glam::Vec3;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

/// The largest emission that is kept: sums of many samples of it stay far from the largest float.
const MAX_EMISSION: f32 = 1e6;

/// The range of `Ni` in the format.
const IOR_RANGE: std::ops::RangeInclusive<f32> = 0.001..=10.0;

/// Blinn–Phong exponent of a material with `Ks` but without `Ns`: a broad highlight.
const DEFAULT_SHININESS: f32 = 10.0;

/// The largest library that is read; real ones have kilobytes.
const MAX_LIBRARY_BYTES: u64 = 16 << 20;

/// How many libraries a file may name: each costs some system calls.
const MAX_LIBRARIES: usize = 1000;

/// How many materials the libraries of a file may define: each takes about a kilobyte.
pub(super) const MAX_MATERIALS: usize = 65_536;

/// How many pictures that statements name are looked for, beside those that are read: each costs some system calls.
const MAX_MAPS: usize = MAX_MATERIALS;

/// The statements that name a picture, beside those that begin with `map_`.
const PICTURE_KEYWORDS: [&[u8]; 5] = [b"bump", b"disp", b"decal", b"norm", b"refl"];

/// What a library says of one material.
#[derive(Debug, Clone, Default)]
struct Definition {
    name: String,
    library: PathBuf,
    ambient: Option<Vec3>,
    diffuse: Option<Vec3>,
    specular: Option<Vec3>,
    emission: Option<Vec3>,
    filter: Option<Vec3>,
    shininess: Option<f32>,
    ior: Option<f32>,
    dissolve: Option<f32>,
    transparency: Option<f32>,
    illum: Option<u8>,
    diffuse_map: Option<(usize, String)>,
    ambient_map: Option<(usize, String)>,
}

/// The materials of an OBJ file: those its libraries define and, of these, those it uses.
pub(super) struct Library {
    obj: PathBuf,
    budget: MemoryBudget,
    root: PathBuf,
    definitions: Vec<Definition>,
    by_name: HashMap<String, usize>,
    /// Whether a definition beyond [`MAX_MATERIALS`] was left out.
    full: bool,
    /// Which material each definition became.
    ids: HashMap<usize, MaterialId>,
    missing: HashMap<String, MaterialId>,
    default: Option<MaterialId>,
    tried: HashSet<String>,
    read: HashSet<PathBuf>,
    /// Folders and names of pictures that were looked for.
    maps: HashSet<(PathBuf, String)>,
    texture_ids: HashMap<PathBuf, Option<TextureId>>,
    /// The materials in use.
    pub(super) materials: Vec<Material>,
    /// The textures in use.
    pub(super) textures: Vec<Texture>,
    /// What was wrong so far.
    pub(super) warnings: Warnings,
    /// Libraries and pictures that are there and that the OBJ file or a library names, whether they are of use or not.
    files: BTreeMap<PathBuf, SourceFile>,
}

impl Library {
    /// No materials yet, for the file `obj`; nothing outside the folder `root`, which is canonical, will be opened.
    pub(super) fn new(obj: &Path, root: PathBuf, budget: MemoryBudget) -> Self {
        Library {
            obj: obj.to_owned(),
            budget,
            root,
            definitions: Vec::new(),
            by_name: HashMap::new(),
            full: false,
            ids: HashMap::new(),
            missing: HashMap::new(),
            default: None,
            tried: HashSet::new(),
            read: HashSet::new(),
            maps: HashSet::new(),
            texture_ids: HashMap::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            warnings: Warnings::default(),
            files: BTreeMap::new(),
        }
    }

    /// Takes out the files that are named and there.
    pub(super) fn take_files(&mut self) -> Vec<SourceFile> {
        std::mem::take(&mut self.files).into_values().collect()
    }

    /// Keeps that `by` names the file at `path`, whose kind is `kind`.
    fn note_file(&mut self, path: &Path, kind: &str, by: &Path) {
        let role = || format!("the {kind} that '{}' names", by.display());
        self.files.entry(path.to_owned()).or_insert_with(|| SourceFile { path: path.to_owned(), role: role() });
    }

    /// Reads the libraries that a `mtllib` statement on `line` names.
    pub(super) fn read_libraries(&mut self, line: usize, names: &str) {
        for name in self.split_names(names) {
            if !self.tried.insert(name.to_owned()) {
                continue;
            }
            if self.tried.len() > MAX_LIBRARIES {
                self.warnings.add(
                    &self.obj,
                    line,
                    format!("only the first {MAX_LIBRARIES} material libraries are read"),
                );
                return;
            }
            let path = match find_inside(&self.root, &self.root, name) {
                Ok(path) => path,
                Err(reason) => {
                    let message = format!("material library '{}' {reason}", quote(name.as_bytes()));
                    self.warnings.add(&self.obj, line, message);
                    continue;
                }
            };
            if !self.read.insert(path.clone()) {
                continue;
            }
            let obj = self.obj.clone();
            self.note_file(&path, "material library", &obj);
            match std::fs::metadata(&path).map(|m| m.len()) {
                Ok(bytes) if bytes > MAX_LIBRARY_BYTES => {
                    self.warnings.add(
                        &path,
                        None,
                        format!("is larger than {} MiB and not read", MAX_LIBRARY_BYTES >> 20),
                    );
                }
                Ok(_) => match std::fs::read(&path) {
                    Ok(text) => self.parse(&path, &text),
                    Err(error) => self.warnings.add(&path, None, format!("cannot be read: {error}")),
                },
                Err(error) => self.warnings.add(&path, None, format!("cannot be read: {error}")),
            }
        }
    }

    /// One name with blanks where that is a file; else the statement is cut after each ".mtl", or at blanks.
    fn split_names<'n>(&self, names: &'n str) -> Vec<&'n str> {
        if self.tried.len() > MAX_LIBRARIES {
            return Vec::new(); // a warning was given
        }
        if find_inside(&self.root, &self.root, names).is_ok() {
            return vec![names];
        }
        let lower_case = names.to_ascii_lowercase();
        let mut split = Vec::new();
        let mut start = 0;
        for (found, extension) in lower_case.match_indices(".mtl") {
            let end = found + extension.len();
            split.push(names[start..end].trim());
            start = end;
        }
        split.extend(names[start..].split_whitespace());
        split
    }

    /// The material called `name` on `line` of the OBJ file.
    pub(super) fn find(&mut self, name: &str, line: usize) -> MaterialId {
        // A '#' may belong to the name or begin a comment.
        let known = self.by_name.get(name).or_else(|| self.by_name.get(name.split('#').next()?.trim_end()));
        let Some(&index) = known else {
            if let Some(&id) = self.missing.get(name) {
                return id;
            }
            let message = format!("material '{}' is not defined; the default is used", quote(name.as_bytes()));
            self.warnings.add(&self.obj, line, message);
            let id = self.default_material();
            self.missing.insert(name.to_owned(), id);
            return id;
        };
        if let Some(&id) = self.ids.get(&index) {
            return id;
        }
        let definition = self.definitions[index].clone();
        let material = self.material(&definition);
        let id = self.push(material);
        self.ids.insert(index, id);
        id
    }

    /// The material of faces without one.
    pub(super) fn default_material(&mut self) -> MaterialId {
        if let Some(id) = self.default {
            return id;
        }
        let id = self.push(Material::default());
        self.default = Some(id);
        id
    }

    fn push(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        (self.materials.len() - 1) as MaterialId
    }

    /// Turns what the library says into the scene's model; see the table above.
    fn material(&mut self, definition: &Definition) -> Material {
        let texture = definition.diffuse_map.as_ref().and_then(|(line, name)| self.texture(definition, *line, name));
        let default = Material::default();
        let diffuse = definition.diffuse.unwrap_or(if texture.is_some() { Vec3::ONE } else { default.diffuse });
        let specular = definition.specular.unwrap_or_default();
        let mut material = Material {
            name: definition.name.clone(),
            // Exporters write `Ka 0 0 0` where they mean nothing by it; the scene decides whether there is ambient
            // light.
            ambient: definition.ambient.filter(|&ka| ka != Vec3::ZERO).unwrap_or(diffuse),
            diffuse,
            diffuse_texture: texture,
            specular,
            shininess: definition.shininess.unwrap_or(DEFAULT_SHININESS).min(Material::MAX_SHININESS),
            ior: definition.ior.unwrap_or(default.ior),
            emission: definition.emission.unwrap_or_default(),
            ..default
        };
        if material.ambient.max_element() > 1.0 {
            material.emission = material.emission.max(material.ambient);
            material.ambient = diffuse;
        }
        let opacity = definition.dissolve.or(definition.transparency.map(|t| 1.0 - t)).unwrap_or(1.0);
        let filter = definition.filter.unwrap_or(Vec3::ONE);
        let mut scattered = Vec3::splat(opacity);
        material.transmission = (1.0 - opacity) * filter;
        match definition.illum.unwrap_or(2) {
            0 => {
                let emission = diffuse.max(material.emission);
                return Material { name: material.name, emission, ambient: Vec3::ZERO, diffuse: Vec3::ZERO, ..default };
            }
            1 => material.specular = Vec3::ZERO,
            3 | 5 | 8 => material.mirror = specular,
            4 | 6 | 7 | 9 if opacity == 1.0 => {
                material.transmission = filter;
                scattered = Vec3::ONE - filter;
            }
            _ => {}
        }
        material.ambient *= scattered;
        material.diffuse *= scattered;
        material
    }

    /// The texture `name` of a `map_Kd` statement, loaded once however many materials use it.
    fn texture(&mut self, definition: &Definition, line: usize, name: &str) -> Option<TextureId> {
        let folder = definition.library.parent().unwrap_or(&self.root);
        let found = find_inside(&self.root, folder, name).and_then(|path| {
            if let Some(&id) = self.texture_ids.get(&path) {
                return Ok(id);
            }
            self.note_file(&path, "texture", &definition.library);
            let decoded = decode(&path, name, &self.budget);
            let id = decoded.is_ok().then_some(self.textures.len() as TextureId);
            self.texture_ids.insert(path, id);
            self.textures.push(decoded?.into());
            Ok(id)
        });
        found.unwrap_or_else(|reason| {
            let message = format!("texture '{}' {reason}; the surface stays plain", quote(name.as_bytes()));
            self.warnings.add(&definition.library, line, message);
            None
        })
    }

    /// Adds the materials that `text` defines. The first of a name counts, as in the format's search order.
    fn parse(&mut self, path: &Path, text: &[u8]) {
        let mut ignored = Ignored::default();
        let mut current: Option<Definition> = None;
        for (line, statement) in Lines::new(text) {
            let (keyword, rest) = split_keyword(&statement);
            if keyword.is_empty() {
                continue;
            }
            if keyword.eq_ignore_ascii_case(b"newmtl") {
                self.define(current.take());
                let name = String::from_utf8_lossy(rest).into_owned();
                if name.is_empty() {
                    self.warnings.add(path, line, "material without a name");
                }
                current = Some(Definition { name, library: path.to_owned(), ..Definition::default() });
                continue;
            }
            self.note_map(path, keyword, rest);
            let Some(definition) = &mut current else {
                ignored.note(keyword, line);
                continue;
            };
            match definition.set(keyword, rest, line) {
                Ok(true) => {}
                Ok(false) => ignored.note(keyword, line),
                Err(fault) => {
                    let message = format!("'{}' {fault}", quote(&statement));
                    self.warnings.add(path, line, message);
                }
            }
        }
        self.define(current);
        ignored.report(path, &mut self.warnings);
    }

    /// Keeps what picture a statement names, also one that is not read: it is no less the user's.
    fn note_map(&mut self, library: &Path, keyword: &[u8], rest: &[u8]) {
        let keyword = keyword.to_ascii_lowercase();
        if !keyword.starts_with(b"map_") && !PICTURE_KEYWORDS.contains(&&keyword[..]) {
            return;
        }
        let name = split_map(&String::from_utf8_lossy(rest)).0;
        let folder = library.parent().unwrap_or(&self.root);
        if self.maps.len() < MAX_MAPS
            && self.maps.insert((folder.to_owned(), name.clone()))
            && let Ok(path) = find_inside(&self.root, folder, &name)
        {
            self.note_file(&path, "texture", library);
        }
    }

    fn define(&mut self, definition: Option<Definition>) {
        let Some(definition) = definition else { return };
        if let (Some((line, map)), diffuse) = (&definition.ambient_map, &definition.diffuse_map)
            && diffuse.as_ref().is_none_or(|(_, d)| d != map)
        {
            self.warnings.add(
                &definition.library,
                *line,
                "a 'map_Ka' other than the 'map_Kd' is not supported and ignored",
            );
        }
        if self.by_name.contains_key(&definition.name) {
            let message =
                format!("material '{}' is defined again; the first counts", quote(definition.name.as_bytes()));
            self.warnings.add(&definition.library, None, message);
            return;
        }
        if self.definitions.len() == MAX_MATERIALS {
            if !std::mem::replace(&mut self.full, true) {
                let message = format!("only the first {MAX_MATERIALS} materials are kept");
                self.warnings.add(&definition.library, None, message);
            }
            return;
        }
        self.by_name.insert(definition.name.clone(), self.definitions.len());
        self.definitions.push(definition);
    }
}

impl Definition {
    /// Applies a statement; false when it is not supported.
    ///
    /// A fault says what was wrong with the statement, and leaves what it would have set (clamped values are set).
    fn set(&mut self, keyword: &[u8], rest: &[u8], line: usize) -> Result<bool, String> {
        match keyword.to_ascii_lowercase().as_slice() {
            b"ka" => set_colour(&mut self.ambient, rest, MAX_EMISSION)?,
            b"kd" => set_colour(&mut self.diffuse, rest, 1.0)?,
            b"ks" => set_colour(&mut self.specular, rest, 1.0)?,
            b"ke" => set_colour(&mut self.emission, rest, MAX_EMISSION)?,
            b"tf" => set_colour(&mut self.filter, rest, 1.0)?,
            b"ns" => self.shininess = Some(number(rest, 0.0..=f32::MAX)?.min(Material::MAX_SHININESS)),
            b"ni" => self.ior = Some(number(rest, IOR_RANGE)?),
            b"d" => self.dissolve = Some(number(rest.strip_prefix(b"-halo").unwrap_or(rest), 0.0..=1.0)?),
            b"tr" => self.transparency = Some(number(rest, 0.0..=1.0)?),
            b"illum" => {
                let model = number(rest, 0.0..=10.0)?;
                self.illum = Some(model as u8);
            }
            b"map_kd" => {
                let (name, options) = split_map(&String::from_utf8_lossy(rest));
                if name.is_empty() {
                    return Err("names no file and is ignored".to_owned());
                }
                self.diffuse_map = Some((line, name));
                if !options.is_empty() {
                    return Err(format!("has options that are not supported and ignored: {}", options.join(" ")));
                }
            }
            b"map_ka" => self.ambient_map = Some((line, split_map(&String::from_utf8_lossy(rest)).0)),
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// Sets a colour of one (gray) or three numbers from 0; those above `most` are clamped, with a fault all the same.
fn set_colour(colour: &mut Option<Vec3>, rest: &[u8], most: f32) -> Result<(), String> {
    let mut values = [0.0; 3];
    let mut count = 0;
    for (value, word) in values.iter_mut().zip(words(rest)) {
        *value = number(word, 0.0..=f32::MAX)?;
        count += 1;
    }
    let given = match count {
        1 => Vec3::splat(values[0]),
        3 => Vec3::from_array(values),
        _ => return Err(format!("has {count} numbers, not 3, and is ignored")),
    };
    *colour = Some(given.min(Vec3::splat(most)));
    if given.max_element() > most {
        return Err(format!("is above {most}, which is taken instead"));
    }
    Ok(())
}

/// The first word of `rest` as a number in `range`.
fn number(rest: &[u8], range: std::ops::RangeInclusive<f32>) -> Result<f32, String> {
    let word = words(rest).next().ok_or("has no number and is ignored")?;
    let value: Option<f32> = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
    match value {
        Some(value) if range.contains(&value) => Ok(value),
        Some(value) if range.end() == &f32::MAX => Err(format!("has {value}, not a number from 0, and is ignored")),
        Some(value) => Err(format!("has {value}, not in {} to {}, and is ignored", range.start(), range.end())),
        None => Err(format!("has '{}', not a number, and is ignored", quote(word))),
    }
}

/// The file name of a map statement, which may have blanks, and the options before it.
fn split_map(statement: &str) -> (String, Vec<String>) {
    let mut rest = statement.trim();
    let mut options = Vec::new();
    while let Some(option) = rest.split_whitespace().next() {
        // The least and most arguments of each option of the format.
        let (least, most) = match option.to_ascii_lowercase().as_str() {
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-bm" | "-boost" | "-imfchan" | "-texres" | "-type" => (1, 1),
            "-mm" => (2, 2),
            "-o" | "-s" | "-t" => (1, 3),
            _ => break,
        };
        options.push(option.to_owned());
        rest = rest[option.len()..].trim_start();
        for argument in 0..most {
            let Some(word) = rest.split_whitespace().next() else { break };
            let last = rest.len() == word.len(); // the file name may look like a number
            if argument >= least && (last || word.parse::<f32>().is_err()) {
                break;
            }
            rest = rest[word.len()..].trim_start();
        }
    }
    (rest.trim_matches('"').to_owned(), options)
}
