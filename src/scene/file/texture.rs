//! What a material of a scene file says of its texture and of threshold shading.

use super::Reader;
use super::object::place;
use super::table::Table;
use crate::error::Result;
use crate::scene::check::{procedural_fault, toon_fault};
use crate::scene::texture::load_texture;
use crate::scene::{Builder, Pattern, Procedural, TextureId, TextureSpace, Toon};
use toml::de::DeValue;

/// The keys that every procedural texture has.
const COMMON_KEYS: [&str; 6] = ["kind", "colors", "scale", "rotate", "translate", "space"];

/// The keys of `pattern` besides.
fn own_keys(pattern: Pattern) -> &'static [&'static str] {
    match pattern {
        Pattern::Checker => &[],
        Pattern::Noise => &["octaves", "seed"],
        Pattern::Marble | Pattern::Wood => &["turbulence", "octaves", "seed"],
    }
}

impl Reader<'_> {
    /// `texture` of a material: a path, or a table of a procedural one.
    pub(super) fn read_texture(&mut self, material: &Table) -> Result<Option<TextureId>> {
        let Some(value) = material.get("texture") else { return Ok(None) };
        match value.get_ref() {
            DeValue::String(file) => self.image(material, file).map(Some),
            DeValue::Table(_) => {
                let name = material.name_of("texture");
                let procedural = read_procedural(&Table::of(self.source, &name, value)?)?;
                Ok(Some(self.builder.add_texture(procedural)))
            }
            other => Err(material.wrong_type("texture", "a path in quotes or a table with a kind", other)),
        }
    }

    fn image(&mut self, material: &Table, file: &str) -> Result<TextureId> {
        if let Some(&id) = self.textures.get(file) {
            return Ok(id);
        }
        let path = self.inside_folder(material, "texture", file)?;
        self.note_picture(path, "texture");
        let image = load_texture(self.folder, file, &self.budget)
            .map_err(|e| material.error("texture", format!("'{file}': {e}")))?;
        let id = self.builder.add_texture(image);
        self.textures.insert(file.to_owned(), id);
        Ok(id)
    }
}

fn read_procedural(table: &Table) -> Result<Procedural> {
    let kind = table.required("kind", table.choice("kind", &Pattern::ALL.map(Pattern::name))?)?;
    let pattern = Pattern::ALL[kind];
    let keys = [&COMMON_KEYS, own_keys(pattern)].concat();
    let table = table.allow(&format!("the texture {}", pattern.name()), &keys)?;
    // Placed as objects are, by the same words.
    let mut place_of_pattern = Builder::new();
    place(&table, &mut place_of_pattern)?;
    if let Some(fault) = place_of_pattern.take_fault() {
        return Err(table.error_here(format!("cannot be placed: {fault}")));
    }
    let usual = Procedural::new(pattern);
    let procedural = Procedural {
        pattern,
        colours: table.two_colours("colors")?.unwrap_or(usual.colours),
        transform: place_of_pattern.current_transform(),
        space: match table.choice("space", &["world", "uv"])? {
            Some(1) => TextureSpace::Uv,
            _ => TextureSpace::World,
        },
        turbulence: table.number("turbulence")?.unwrap_or(usual.turbulence),
        octaves: table.whole("octaves", 1..=Procedural::MAX_OCTAVES)?.unwrap_or(usual.octaves),
        seed: table.whole("seed", 0..=u32::MAX)?.unwrap_or(usual.seed),
    };
    table.check(procedural_fault(&procedural), "kind")?;
    Ok(procedural)
}

/// `toon` of a material: how many tones, or a table that also tells from which cosine on.
pub(super) fn read_toon(material: &Table) -> Result<Option<Toon>> {
    match material.get("toon") {
        Some(value) if matches!(value.get_ref(), DeValue::Table(_)) => {
            let name = material.name_of("toon");
            let table = Table::of(material.source, &name, value)?.allow(&name, &["steps", "threshold"])?;
            let even = Toon::new(table.required("steps", table.whole("steps", 1..=Toon::MAX_STEPS)?)?);
            let toon = Toon { threshold: table.number("threshold")?.unwrap_or(even.threshold), ..even };
            table.check(toon_fault(&toon), "steps")?;
            Ok(Some(toon))
        }
        _ => Ok(material.whole("toon", 0..=Toon::MAX_STEPS)?.filter(|&steps| steps > 0).map(Toon::new)),
    }
}
