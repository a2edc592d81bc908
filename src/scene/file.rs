//! TOML scene files: picture, camera, lights, materials and objects in one text. `docs/book/src/scenes.md` documents
//! every key.
//!
//! A scene file is as untrusted as any input: it can name only files in its own folder and below, its size and the
//! fineness of its solids are bounded, and every fault is an error that names file, line and key.

mod object;
mod table;
mod texture;

use super::check::{Fault, camera_fault, frame_fault, light_fault, material_fault, sky_fault, wide_camera_fault};
use super::reading::Loaders;
use super::{
    Background, Builder, Camera, CameraKey, DefaultLight, Falloff, Light, LightKind, Material, MaterialId,
    PictureDefaults, Samples, Scene, Sky, SourceFile, TextureId, WideCamera,
};
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::io::input::open_regular;
use glam::Vec3;
use std::collections::HashMap;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
pub(super) use table::linear;
use table::{Source, Table};
use toml::de::{DeTable, DeValue};

/// The largest scene file, bytes: some 100,000 objects, far more than anyone writes.
const MAX_FILE_BYTES: u64 = 16 << 20;

/// The most frames of an animation.
const MAX_FRAMES: u32 = 99_999;

/// What is known while a scene file is read.
struct Reader<'a> {
    source: Source<'a>,
    /// The scene file's folder.
    folder: &'a Path,
    builder: Builder,
    budget: MemoryBudget,
    models: &'a Loaders,
    materials: HashMap<&'a str, MaterialId>,
    textures: HashMap<String, TextureId>,
    /// Object files that were read, so that ten objects of one file read it once.
    files: HashMap<PathBuf, Scene>,
    /// Textures and pictures of heights that were read.
    pictures: Vec<SourceFile>,
}

/// Loads the scene file `path`, whose objects may name `models`.
pub(super) fn load(path: &Path, budget: &MemoryBudget, models: &Loaders) -> Result<Scene> {
    let text = read_text(path)?;
    let source = Source { path, text: &text };
    let root = DeTable::parse(&text).map_err(|e| {
        let message = format!("not valid TOML: {}", e.message());
        e.span()
            .map_or_else(|| Error::input(path, None, message.clone()), |span| source.error(span.start, message.clone()))
    })?;
    // The parent of a bare file name is "", which no system call takes for the current folder.
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (materials, textures, files) = (HashMap::new(), HashMap::new(), HashMap::new());
    let (builder, pictures) = (Builder::within(*budget), Vec::new());
    let mut reader = Reader { source, folder, builder, budget: *budget, models, materials, textures, files, pictures };

    const KEYS: [&str; 7] = ["image", "camera", "trace", "sky", "light", "material", "object"];
    let root = Table::root(source, root.get_ref()).allow("a scene file", &KEYS)?;
    reader.read_picture(&root)?;
    reader.read_camera(&root)?;
    reader.read_sky(&root)?;
    reader.read_lights(&root)?;
    reader.read_materials(&root)?;
    reader.read_objects(&root)?;
    let mut scene = reader.builder.finish().map_err(|e| Error::input(path, None, e.to_string()))?;
    scene.files.append(&mut reader.pictures);
    Ok(scene)
}

fn read_text(path: &Path) -> Result<String> {
    let (file, _) = open_regular(path)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|e| Error::io("read", path, e))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(Error::input(path, None, format!("is larger than {MAX_FILE_BYTES} bytes; this is no scene file")));
    }
    String::from_utf8(bytes).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::input(path, line, "is not UTF-8 text")
    })
}

impl<'a> Reader<'a> {
    /// `[image]` and `[trace]`.
    fn read_picture(&mut self, root: &Table<'a>) -> Result<()> {
        let mut picture = PictureDefaults::default();
        if let Some(value) = root.get("image") {
            let image =
                Table::of(self.source, "[image]", value)?.allow("[image]", &["width", "height", "samples", "error"])?;
            picture.size = match (
                image.whole("width", 1..=PictureDefaults::MAX_SIDE)?,
                image.whole("height", 1..=PictureDefaults::MAX_SIDE)?,
            ) {
                (None, None) => None,
                (width, height) => Some((image.required("width", width)?, image.required("height", height)?)),
            };
            picture.samples = read_samples(&image)?;
            if let (Some(size), Some(Samples::Corners)) = (picture.size, picture.samples) {
                image
                    .check(Samples::Corners.fault(size).map(|message| Fault { key: "samples", message }), "samples")?;
            }
        }
        if let Some(value) = root.get("trace") {
            const KEYS: [&str; 4] = ["depth", "ambient", "background", "default-light"];
            let trace = Table::of(self.source, "[trace]", value)?.allow("[trace]", &KEYS)?;
            picture.depth = trace.whole("depth", 1..=PictureDefaults::MAX_DEPTH)?;
            self.builder.ambient(trace.colour("ambient")?.unwrap_or(Vec3::ZERO));
            if let Some(background) = self.read_background(&trace)? {
                self.builder.background(background);
            }
            let names: Vec<_> = DefaultLight::ALL.iter().map(|light| light.name()).collect();
            if let Some(choice) = trace.choice("default-light", &names)? {
                self.builder.default_light(DefaultLight::ALL[choice]);
            }
        }
        self.builder.picture(picture);
        Ok(())
    }

    /// One colour, or a table of two.
    fn read_background(&self, trace: &Table<'a>) -> Result<Option<Background>> {
        match trace.get("background") {
            Some(value) if matches!(value.get_ref(), DeValue::Table(_)) => {
                let name = "[trace] background";
                let gradient = Table::of(self.source, name, value)?.allow(name, &["bottom", "top"])?;
                let bottom = gradient.required("bottom", gradient.colour("bottom")?)?;
                let top = gradient.required("top", gradient.colour("top")?)?;
                Ok(Some(Background { bottom, top }))
            }
            _ => Ok(trace.colour("background")?.map(|colour| Background { bottom: colour, top: colour })),
        }
    }

    fn read_camera(&mut self, root: &Table<'a>) -> Result<()> {
        let Some(value) = root.get("camera") else { return Ok(()) };
        let table = Table::of(self.source, "[camera]", value)?
            .allow("[camera]", &["eye", "target", "up", "fov", "key", "wide"])?;
        const FOV: f32 = 40.0; // degrees; as Camera::framing has it
        let (up, fov) = (table.vector("up")?, table.number("fov")?);
        let places = (table.vector("eye")?, table.vector("target")?);
        let keys = self.read_camera_keys(&table, places, (up.unwrap_or(Vec3::Y), fov.unwrap_or(FOV)))?;
        // Where the camera does not say where it is, it is the first key's.
        let first = keys.first().map(|key| key.camera).filter(|_| places.0.is_none() || places.1.is_none());
        let camera = Camera {
            eye: table.required("eye", places.0.or(first.map(|camera| camera.eye)))?,
            target: table.required("target", places.1.or(first.map(|camera| camera.target)))?,
            up: up.or(first.map(|camera| camera.up)).unwrap_or(Vec3::Y),
            fov_degrees: fov.or(first.map(|camera| camera.fov_degrees)).unwrap_or(FOV),
        };
        // Without "up" the default one can still be at fault: the view is then what must change.
        table.check(camera_fault(&camera), "target")?;
        let wide = self.read_wide_cameras(&table, &camera)?;
        self.builder.camera(camera).camera_keys(keys).wide_cameras(wide);
        Ok(())
    }

    /// `[[camera.wide]]`: what one does not say is as in `camera`.
    fn read_wide_cameras(&self, table: &Table<'a>, camera: &Camera) -> Result<Vec<WideCamera>> {
        const NAME: &str = "[[camera.wide]]";
        let mut all: Vec<WideCamera> = Vec::new();
        for value in self.array_of_tables(table, "camera.wide")? {
            let table = Table::of(self.source, NAME, value)?.allow(NAME, &["aspect", "eye", "target", "up", "fov"])?;
            let aspect = table.required("aspect", table.positive("aspect")?)?;
            if let Some(last) = all.last().filter(|last| last.aspect >= aspect) {
                return Err(table.error("aspect", format!("is not above that of the one before it, {}", last.aspect)));
            }
            let camera = Camera {
                eye: table.vector("eye")?.unwrap_or(camera.eye),
                target: table.vector("target")?.unwrap_or(camera.target),
                up: table.vector("up")?.unwrap_or(camera.up),
                fov_degrees: table.number("fov")?.unwrap_or(camera.fov_degrees),
            };
            let wide = WideCamera { aspect, camera };
            table.check(wide_camera_fault(&wide), "aspect")?;
            all.push(wide);
        }
        Ok(all)
    }

    /// `[[camera.key]]`: what a key does not say, the one before it does, or the camera.
    fn read_camera_keys(
        &self,
        camera: &Table<'a>,
        (mut eye, mut target): (Option<Vec3>, Option<Vec3>),
        (mut up, mut fov_degrees): (Vec3, f32),
    ) -> Result<Vec<CameraKey>> {
        const NAME: &str = "[[camera.key]]";
        let mut keys: Vec<CameraKey> = Vec::new();
        for value in self.array_of_tables(camera, "camera.key")? {
            let table = Table::of(self.source, NAME, value)?.allow(NAME, &["frame", "eye", "target", "up", "fov"])?;
            let frame = table.required("frame", table.whole("frame", 1..=MAX_FRAMES)?)?;
            table.check(frame_fault(keys.last().map(|key| key.frame), frame), "frame")?;
            eye = table.vector("eye")?.or(eye);
            target = table.vector("target")?.or(target);
            up = table.vector("up")?.unwrap_or(up);
            fov_degrees = table.number("fov")?.unwrap_or(fov_degrees);
            let (eye, target) = (table.required("eye", eye)?, table.required("target", target)?);
            let camera = Camera { eye, target, up, fov_degrees };
            table.check(camera_fault(&camera), "frame")?;
            keys.push(CameraKey { frame, camera });
        }
        Ok(keys)
    }

    fn read_sky(&mut self, root: &Table<'a>) -> Result<()> {
        let Some(value) = root.get("sky") else { return Ok(()) };
        let table = Table::of(self.source, "[sky]", value)?.allow("[sky]", &["top", "bottom", "viewer", "up"])?;
        let none = Sky::default();
        let sky = Sky {
            top: table.colour("top")?.unwrap_or(none.top),
            bottom: table.colour("bottom")?.unwrap_or(none.bottom),
            viewer: table.colour("viewer")?.unwrap_or(none.viewer),
            up: table.vector("up")?.unwrap_or(none.up),
        };
        table.check(sky_fault(&sky), "")?;
        self.builder.sky(sky);
        Ok(())
    }

    fn read_lights(&mut self, root: &Table<'a>) -> Result<()> {
        for value in self.array_of_tables(root, "light")? {
            let table = Table::of(self.source, "[[light]]", value)?;
            let (light, alias) = read_light(&table)?;
            table.check(light_fault(&light), alias)?;
            self.builder.light(light);
        }
        Ok(())
    }

    /// The elements of `[[path]]`, whose last part `table` has.
    fn array_of_tables(&self, table: &Table<'a>, path: &str) -> Result<Vec<&'a toml::Spanned<DeValue<'a>>>> {
        let key = path.rsplit('.').next().unwrap_or(path);
        let Some(value) = table.get(key) else { return Ok(Vec::new()) };
        let array = value.get_ref().as_array().ok_or_else(|| {
            self.source
                .error(value.span().start, format!("there can be several of {path}: write [[{path}]], not [{path}]"))
        })?;
        Ok(array.iter().collect())
    }

    fn read_materials(&mut self, root: &Table<'a>) -> Result<()> {
        let Some(value) = root.get("material") else { return Ok(()) };
        let materials = Table::of(self.source, "[material]", value)?;
        for (name, value) in materials.entries() {
            let title = format!("[material.{name}]");
            let material = self.read_material(name, &title, value)?;
            self.materials.insert(name, self.builder.add_material(material));
        }
        Ok(())
    }

    fn read_material(&mut self, name: &'a str, title: &str, value: &'a toml::Spanned<DeValue<'a>>) -> Result<Material> {
        const KEYS: [&str; 10] = [
            "ambient",
            "diffuse",
            "texture",
            "specular",
            "shininess",
            "mirror",
            "transmission",
            "ior",
            "emission",
            "toon",
        ];
        let table = Table::of(self.source, title, value)?.allow(title, &KEYS)?;
        let diffuse_texture = self.read_texture(&table)?;
        // A texture is shown as it is; without one, the same grey as Material::default().
        let diffuse =
            table.colour("diffuse")?.unwrap_or(if diffuse_texture.is_some() { Vec3::ONE } else { Vec3::splat(0.8) });
        let default = Material { ior: DEFAULT_IOR, shininess: DEFAULT_SHININESS, ..Material::default() };
        let material = Material {
            name: name.to_owned(),
            ambient: table.colour("ambient")?.unwrap_or(diffuse),
            diffuse,
            diffuse_texture,
            specular: table.colour("specular")?.unwrap_or(default.specular),
            shininess: table.number("shininess")?.unwrap_or(default.shininess),
            mirror: table.colour("mirror")?.unwrap_or(default.mirror),
            transmission: table.colour("transmission")?.unwrap_or(default.transmission),
            ior: table.number("ior")?.unwrap_or(default.ior),
            emission: table.colour("emission")?.unwrap_or(default.emission),
            toon: texture::read_toon(&table)?,
        };
        table.check(material_fault(&material), "")?;
        Ok(material)
    }

    /// Keeps that the scene is made of the picture at `path`.
    fn note_picture(&mut self, path: PathBuf, kind: &str) {
        let role = format!("the {kind} that '{}' names", self.source.path.display());
        self.pictures.push(SourceFile { path, role });
    }

    /// The path of `file`, which `key` of `table` names: in the scene file's folder or below, and there.
    fn inside_folder(&self, table: &Table, key: &str, file: &str) -> Result<PathBuf> {
        let leaves =
            || table.error(key, format!("'{file}' leads out of the scene file's folder; keep what it names beside it"));
        // First by its letters alone, so that nothing outside is so much as looked for.
        let mut level = 0;
        for component in Path::new(file).components() {
            level += match component {
                Component::Normal(_) => 1,
                Component::CurDir => 0,
                Component::ParentDir => -1,
                Component::RootDir | Component::Prefix(_) => return Err(leaves()),
            };
            if level < 0 {
                return Err(leaves());
            }
        }
        // Then for real: a link can lead anywhere.
        let canonical =
            |path: &Path| path.canonicalize().map_err(|e| table.error(key, format!("'{file}' cannot be read: {e}")));
        let path = self.folder.join(file);
        if !canonical(&path)?.starts_with(canonical(self.folder)?) {
            return Err(leaves());
        }
        Ok(path)
    }
}

/// The index of refraction of a transparent material whose file does not tell: glass.
const DEFAULT_IOR: f32 = 1.5;
/// The Blinn–Phong exponent of a material whose file does not tell; without `specular` it is of no consequence.
const DEFAULT_SHININESS: f32 = 50.0;

/// A count for each pixel, "corners", or an error for the picture.
fn read_samples(image: &Table) -> Result<Option<Samples>> {
    if let Some(error) = image.positive("error")? {
        if image.has("samples") {
            return Err(
                image.error("error", "either `samples` or `error`: fixed samples have the error that they have")
            );
        }
        let samples = Samples::Error(error);
        image.check(samples.fault((1, 1)).map(|message| Fault { key: "error", message }), "error")?;
        return Ok(Some(samples));
    }
    if image.get("samples").is_some_and(|value| value.get_ref().is_str()) {
        return Ok(image.choice("samples", &[Samples::CORNERS])?.map(|_| Samples::Corners));
    }
    Ok(image.whole("samples", 1..=PictureDefaults::MAX_SAMPLES)?.map(Samples::PerPixel))
}

/// A light, and the key that stands for its direction.
fn read_light(table: &Table) -> Result<(Light, &'static str)> {
    const KINDS: [&str; 3] = ["point", "directional", "spot"];
    const POINT: &[&str] = &["kind", "position", "intensity", "color", "falloff"];
    const DIRECTIONAL: &[&str] = &["kind", "position", "direction", "target", "intensity", "color"];
    const SPOT: &[&str] =
        &["kind", "position", "direction", "target", "intensity", "color", "falloff", "inner", "outer"];
    let kind = table.required("kind", table.choice("kind", &KINDS)?)?;
    let table = table.allow(&format!("a {} light", KINDS[kind]), [POINT, DIRECTIONAL, SPOT][kind])?;

    let position = || table.required("position", table.vector("position")?);
    let kind = match kind {
        0 => LightKind::Point { position: position()? },
        1 => LightKind::Directional { direction: read_direction(&table)? },
        _ => {
            const OUTER: f32 = 30.0; // degrees
            const INNER_SHARE: f32 = 0.8; // of the outer angle: a soft rim
            let outer_degrees = table.number("outer")?.unwrap_or(OUTER);
            let inner_degrees = table.number("inner")?.unwrap_or(INNER_SHARE * outer_degrees);
            LightKind::Spot { position: position()?, direction: read_direction(&table)?, inner_degrees, outer_degrees }
        }
    };
    let intensity = table.colour("intensity")?.unwrap_or(Vec3::ONE) * table.colour("color")?.unwrap_or(Vec3::ONE);
    let falloff = match table.choice("falloff", &["none", "quadratic"])? {
        Some(1) => Falloff::Quadratic,
        _ => Falloff::None,
    };
    Ok((Light { kind, intensity, falloff }, if table.has("target") { "target" } else { "direction" }))
}

/// Where a light shines: along `direction`, or from `position` to `target`.
fn read_direction(table: &Table) -> Result<Vec3> {
    match (table.vector("direction")?, table.vector("target")?) {
        (Some(direction), None) => Ok(direction),
        (None, Some(target)) => Ok(target - table.required("position", table.vector("position")?)?),
        (Some(_), Some(_)) => Err(table.error("target", "and direction say the same twice; keep one")),
        (None, None) => Err(table.error_here("needs a direction or a target")),
    }
}
