//! Textures: 8-bit sRGB pictures, or procedural ones. Decoding is bounded in size, memory and kind.
//!
//! PNG, JPEG, BMP and TGA, decoded by the `image` crate. Samples of 16 bits keep the upper 8, which is what a picture
//! of 8 bits shows. Colour profiles and EXIF orientation are not read.

use super::Procedural;
use crate::budget::{DecidedBy, MemoryBudget, Need};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::{Path, PathBuf};

/// Index of a texture in its scene.
pub type TextureId = u32;

/// What gives a surface more than one colour.
#[derive(Debug, Clone, PartialEq)]
pub enum Texture {
    /// A picture.
    Image(Image),
    /// A computed pattern.
    Procedural(Procedural),
}

impl Texture {
    /// The picture, if it is one.
    pub fn image(&self) -> Option<&Image> {
        match self {
            Texture::Image(image) => Some(image),
            Texture::Procedural(_) => None,
        }
    }
}

impl From<Image> for Texture {
    fn from(image: Image) -> Texture {
        Texture::Image(image)
    }
}

impl From<Procedural> for Texture {
    fn from(procedural: Procedural) -> Texture {
        Texture::Procedural(procedural)
    }
}

/// A picture for a surface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// File it came from, for messages.
    pub name: String,
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` texels of R, G, B, A in 8-bit sRGB (A linear, not used), top row first.
    pub rgba: Vec<[u8; 4]>,
}

impl Image {
    /// The longest side in texels: the largest 2D image that common devices accept.
    pub const MAX_SIDE: u32 = 16_384;
}

/// The most memory that one texture takes while it is loaded: the file (JPEG and TGA are read whole), the decoded
/// samples and the texels. 4096 x 4096 RGBA takes 128 MiB; no file may take more than 200 MB.
const MAX_BYTES: u64 = 160 << 20;

/// Loads the texture `name`, relative to `folder`; nothing outside `folder` is opened.
///
/// # Errors
/// One clause for a warning, without the name: not found, outside, not a regular file, too large, not a picture.
pub(super) fn load_texture(folder: &Path, name: &str, budget: &MemoryBudget) -> Result<Image, String> {
    let root = folder.canonicalize().map_err(|e| format!("its folder cannot be found: {e}"))?;
    decode(&find_inside(&root, &root, name)?, name, budget)
}

/// The canonical path of the regular file `name`, relative to `folder`, if it lies inside `root`, which is canonical.
///
/// Symbolic links are followed before the comparison, so that a link out of `root` is refused as well.
pub(super) fn find_inside(root: &Path, folder: &Path, name: &str) -> Result<PathBuf, String> {
    let path = folder.join(name.replace('\\', "/")).canonicalize().map_err(|e| format!("cannot be opened: {e}"))?;
    if !path.starts_with(root) {
        return Err("lies outside the scene's folder and is not opened".to_owned());
    }
    // Devices may be endless and a pipe blocks on opening.
    if path.metadata().is_ok_and(|m| m.is_file()) { Ok(path) } else { Err("is not a regular file".to_owned()) }
}

/// Decodes the picture at `path`; `name` is for messages.
pub(super) fn decode(path: &Path, name: &str, budget: &MemoryBudget) -> Result<Image, String> {
    let file = File::open(path).map_err(unreadable)?;
    let file_bytes = file.metadata().map_err(unreadable)?.len();
    // For TGA, which has no signature.
    let format = ImageFormat::from_path(path).ok();
    decode_from(BufReader::new(file), file_bytes, format, name, budget)
}

/// Decodes the picture that `bytes` are, of a kind that has a signature; `name` is for messages.
pub(super) fn decode_bytes(bytes: &[u8], name: &str, budget: &MemoryBudget) -> Result<Image, String> {
    decode_from(Cursor::new(bytes), bytes.len() as u64, None, name, budget)
}

fn unreadable(e: std::io::Error) -> String {
    format!("cannot be read: {e}")
}

/// Decodes the picture in `file`, which has `file_bytes`; where it has no signature it is of kind `format`.
fn decode_from(
    file: impl BufRead + Seek,
    file_bytes: u64,
    format: Option<ImageFormat>,
    name: &str,
    budget: &MemoryBudget,
) -> Result<Image, String> {
    let too_large = |bytes: u64| format!("needs {} MiB to load; the most is {} MiB", bytes >> 20, MAX_BYTES >> 20);
    if file_bytes > MAX_BYTES {
        return Err(too_large(file_bytes));
    }
    let mut reader = ImageReader::new(file);
    if let Some(format) = format {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(unreadable)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(Image::MAX_SIDE);
    limits.max_image_height = Some(Image::MAX_SIDE);
    limits.max_alloc = Some(MAX_BYTES);
    reader.limits(limits);

    // Everything so far came from the header; refuse a small file that unpacks to a large picture before it does.
    let decoder = reader.into_decoder().map_err(|e| format!("cannot be decoded: {e}"))?;
    let (width, height) = decoder.dimensions();
    let most = Image::MAX_SIDE;
    if width == 0 || height == 0 || width > most || height > most {
        return Err(format!("has {width} x {height} texels; each side must lie between 1 and {most}"));
    }
    let texel_bytes = u64::from(width) * u64::from(height) * size_of::<[u8; 4]>() as u64;
    let bytes = file_bytes.saturating_add(decoder.total_bytes()).saturating_add(texel_bytes);
    if bytes > MAX_BYTES {
        return Err(too_large(bytes));
    }
    let need =
        Need { what: "it", bytes, decided_by: DecidedBy::Input, remedy: "take a smaller one, or raise `memory_limit`" };
    budget.check(&need).map_err(|e| e.to_string())?;
    let picture = DynamicImage::from_decoder(decoder).map_err(|e| format!("cannot be decoded: {e}"))?;
    Ok(Image { name: name.to_owned(), width, height, rgba: texels(picture) })
}

/// The texels of a picture; the common kinds without a second copy of all of it.
fn texels(picture: DynamicImage) -> Vec<[u8; 4]> {
    match picture {
        DynamicImage::ImageRgb8(rgb) => rgb.pixels().map(|p| [p[0], p[1], p[2], u8::MAX]).collect(),
        DynamicImage::ImageLuma8(gray) => gray.pixels().map(|p| [p[0], p[0], p[0], u8::MAX]).collect(),
        DynamicImage::ImageRgb16(rgb) => {
            rgb.pixels().map(|p| [upper(p[0]), upper(p[1]), upper(p[2]), u8::MAX]).collect()
        }
        DynamicImage::ImageRgba16(rgba) => rgba.pixels().map(|p| p.0.map(upper)).collect(),
        other => other.into_rgba8().pixels().map(|p| p.0).collect(),
    }
}

/// The nearest 8-bit sample.
fn upper(sample: u16) -> u8 {
    ((u32::from(sample) * 255 + 32_767) / 65_535) as u8
}
