//! Pictures: decoded once, each kept as a texture only if a material shows it.

use super::Source;
use super::buffers::{Target, follow, name_of};
use crate::io::film::SRGB_TO_LINEAR;
use crate::scene::reading::check_memory;
use crate::scene::text::{Warnings, quote};
use crate::scene::texture::{decode, decode_bytes};
use crate::scene::{Image, SourceFile};
use ::gltf::json::image::Image as Picture;
use glam::{Vec3, Vec4};
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

/// What a material may need of a picture that it does not show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Summary {
    /// The mean colour, taken as sRGB, linear.
    pub colour: Vec3,
    /// The mean of the values as they are stored, 0 to 1.
    pub values: Vec4,
    /// The least and the largest stored values.
    pub range: (Vec4, Vec4),
}

impl Summary {
    fn of(image: &Image) -> Summary {
        let (mut counts, mut low, mut high) = ([[0u32; 256]; 4], [u8::MAX; 4], [0u8; 4]);
        for texel in &image.rgba {
            for part in 0..4 {
                counts[part][usize::from(texel[part])] += 1;
                low[part] = low[part].min(texel[part]);
                high[part] = high[part].max(texel[part]);
            }
        }
        let mean = |part: usize, value: &dyn Fn(usize) -> f64| {
            let sum: f64 = (0..256).map(|level| f64::from(counts[part][level]) * value(level)).sum();
            (sum / image.rgba.len() as f64) as f32
        };
        let stored = |level: usize| level as f64 / 255.0;
        let values = Vec4::from_array(std::array::from_fn(|part| mean(part, &stored)));
        let colour =
            Vec3::from_array(std::array::from_fn(|part| mean(part, &|level| f64::from(SRGB_TO_LINEAR[level]))));
        let ends = [low, high].map(|end| Vec4::from_array(end.map(|value| f32::from(value) / 255.0)));
        Summary { colour, values, range: (ends[0], ends[1]) }
    }

    /// Whether red, green and blue are the same everywhere.
    pub fn is_plain(&self) -> bool {
        self.range.0.truncate() == self.range.1.truncate()
    }
}

/// The pictures of a file.
pub(super) struct Images<'a> {
    source: &'a Source<'a>,
    summaries: HashMap<usize, Option<Summary>>,
    /// The last one that was decoded: mostly it is summed up and then shown.
    last: Option<(usize, Image)>,
    pub warnings: Warnings,
}

impl<'a> Images<'a> {
    pub fn new(source: &'a Source<'a>) -> Images<'a> {
        Images { source, summaries: HashMap::new(), last: None, warnings: Warnings::default() }
    }

    /// What picture `number` is like; none, with a warning, when it cannot be read.
    pub fn summary(&mut self, number: usize) -> Option<Summary> {
        if let Some(&known) = self.summaries.get(&number) {
            return known;
        }
        let summary = match self.decode(number) {
            Ok(image) => {
                let summary = Summary::of(&image);
                self.last = Some((number, image));
                Some(summary)
            }
            Err(message) => {
                self.warnings.add(self.source.path, None, format!("texture {message}; the surface stays plain"));
                None
            }
        };
        self.summaries.insert(number, summary);
        summary
    }

    /// Picture `number`, which has a summary, with its mirror image beside it or below it where that is `wanted` and
    /// there is room; and where there is one.
    pub fn image(&mut self, number: usize, wanted: [bool; 2]) -> Option<(Image, [bool; 2])> {
        let image = match self.last.take() {
            Some((last, image)) if last == number => image,
            _ => self.decode(number).ok()?,
        };
        let texel_bytes = 4 * image.rgba.len() as u64 * size_of::<[u8; 4]>() as u64;
        let has_room = check_memory(self.source.path, texel_bytes, &self.source.budget).is_ok();
        let [across, down] = [(wanted[0], image.width), (wanted[1], image.height)]
            .map(|(wanted, side)| wanted && has_room && 2 * side <= Image::MAX_SIDE);
        Some((mirror(image, across, down), [across, down]))
    }

    fn decode(&self, number: usize) -> Result<Image, String> {
        let picture = self.source.root.images.get(number).ok_or_else(|| format!("{number}: there is none"))?;
        let name = name(picture, number);
        let budget = &self.source.budget;
        let decoded = match (&picture.uri, picture.buffer_view) {
            (Some(uri), _) => follow(self.source.path, uri, budget).and_then(|target| match target {
                Target::Bytes(bytes) => decode_bytes(&bytes, &name, budget),
                Target::File(path) => decode(&path, &name, budget),
            }),
            (None, Some(view)) => {
                let bytes = self.source.buffers.view(view).map_err(|e| e.to_string());
                bytes.and_then(|bytes| decode_bytes(bytes, &name, budget))
            }
            (None, None) => Err("is nowhere".into()),
        };
        decoded.map_err(|fault| format!("'{name}' {fault}"))
    }

    /// The files that pictures are in, used or not.
    pub fn files(&self) -> Vec<SourceFile> {
        let uris = self.source.root.images.iter().filter_map(|picture| picture.uri.as_ref());
        let mut found: BTreeMap<PathBuf, SourceFile> = BTreeMap::new();
        for uri in uris.filter(|uri| !uri.starts_with("data:")).take(MAX_FILES) {
            if let Ok(Target::File(path)) = follow(self.source.path, uri, &self.source.budget) {
                let role = format!("the texture that '{}' names", self.source.path.display());
                found.entry(path.clone()).or_insert(SourceFile { path, role });
            }
        }
        found.into_values().collect()
    }
}

/// How many pictures that a file names are looked for: each costs some system calls.
const MAX_FILES: usize = 65_536;

/// What a picture is called in messages.
fn name(picture: &Picture, number: usize) -> String {
    match (&picture.uri, &picture.name) {
        (Some(uri), _) if !uri.starts_with("data:") => name_of(uri),
        (_, Some(name)) => quote(name.as_bytes()),
        _ => format!("image {number}"),
    }
}

/// A picture with its mirror images beside it, below it, or both.
fn mirror(image: Image, across: bool, down: bool) -> Image {
    if !across && !down {
        return image;
    }
    let rows = image.rgba.chunks_exact(image.width as usize);
    let wide = |row: &[[u8; 4]]| -> Vec<[u8; 4]> {
        let again: &[[u8; 4]] = if across { row } else { &[] };
        row.iter().chain(again.iter().rev()).copied().collect()
    };
    let mut rgba: Vec<[u8; 4]> = rows.clone().flat_map(wide).collect();
    if down {
        rgba.extend(rows.rev().flat_map(wide));
    }
    let (width, height) = (image.width << u32::from(across), image.height << u32::from(down));
    Image { width, height, rgba, ..image }
}
