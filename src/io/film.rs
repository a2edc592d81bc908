//! The picture: linear radiance in memory; its files are PNG, OpenEXR or PFM ([`crate::low_level::rows`]).
//!
//! PNG holds display values by the sRGB transfer curve (IEC 61966-2-1, amendment 1, 2003: the exact two-piece curve, in
//! f64, rounded to nearest) and says so in an `sRGB` chunk; there is no tone mapping: radiance 1 is white and what is
//! above it clips. OpenEXR and PFM hold the radiance itself, every bit of it.

use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::LazyLock;

use crate::blocks::{Area, LARGEST_PATCH};
use crate::budget::{DecidedBy, Need, try_zeros};
use crate::error::{Error, Result};
use crate::io::output::{Output, check_writable, write_atomically};
use crate::io::rows;
use crate::parallel;

/// A rendered picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width` x `height` pixels, linear RGB radiance, top row first. Nothing keeps a value from being negative or not
    /// finite.
    pub pixels: Vec<[f32; 3]>,
}

/// A film that shows all of a picture, or a part of it.
#[derive(Debug, Clone, Copy)]
pub struct FilmWindow<'a> {
    /// The film.
    pub film: &'a Film,
    /// Column and row of its first pixel in the picture.
    pub place: (usize, usize),
}

impl<'a> FilmWindow<'a> {
    /// Pixels of a row of the picture, which must be on the film.
    pub fn row(&self, y: usize, columns: Range<usize>) -> &'a [[f32; 3]] {
        let first = (y - self.place.1) * self.film.width as usize;
        &self.film.pixels[first + columns.start - self.place.0..first + columns.end - self.place.0]
    }

    /// The pixels of a place, row by row, if they lie one after the other on the film: those of whole rows.
    pub(crate) fn rows(&self, place: &Area) -> Option<&'a [[f32; 3]]> {
        let (width, here) = (self.film.width as usize, place.seen_from(self.place));
        (here.x == (0..width)).then(|| &self.film.pixels[here.y.start * width..here.y.end * width])
    }
}

/// A file format for pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageFormat {
    /// PNG with 8 bits a channel, sRGB.
    Png8,
    /// PNG with 16 bits a channel, sRGB.
    Png16,
    /// OpenEXR with 32-bit float channels R, G and B, linear, losslessly compressed.
    Exr,
    /// Portable float map, 32-bit float, linear, little-endian.
    Pfm,
}

impl ImageFormat {
    /// The format that the extension of `path` stands for, in either case; PNG has 8 bits unless
    /// [`ImageFormat::with_bit_depth`] changes it.
    ///
    /// # Errors
    /// [`Error::Option`] for another extension, or none.
    pub fn from_path(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("png") => Ok(ImageFormat::Png8),
            Some("exr") => Ok(ImageFormat::Exr),
            Some("pfm") => Ok(ImageFormat::Pfm),
            _ => {
                let message = format!("the name '{}' must end in .png, .exr or .pfm", path.display());
                Err(Error::option("output", message))
            }
        }
    }

    /// The same kind of file with `bits` bits a channel.
    ///
    /// # Errors
    /// [`Error::Option`] unless `bits` is 8 or 16 for PNG, 32 for OpenEXR and PFM.
    pub fn with_bit_depth(self, bits: u8) -> Result<Self> {
        use ImageFormat::*;
        match (self, bits) {
            (Png8 | Png16, 8) => Ok(Png8),
            (Png8 | Png16, 16) => Ok(Png16),
            (Exr | Pfm, 32) => Ok(self),
            (Png8 | Png16, _) => Err(Error::option("bit_depth", format!("{bits} is not possible; .png has 8 or 16"))),
            (Exr | Pfm, _) => Err(Error::option("bit_depth", format!("{bits} is not possible; .exr and .pfm have 32"))),
        }
    }
}

/// Checks that a picture can be written to `path`, so that a long render is not lost over a mistyped name.
///
/// # Errors
/// As [`ImageFormat::from_path`] unless `format` is given, and as [`check_writable`].
pub fn check_output(path: &Path, format: Option<ImageFormat>) -> Result<()> {
    if format.is_none() {
        ImageFormat::from_path(path)?;
    }
    check_writable(path)
}

/// The sRGB curve: linear light in 0..=1 to a display value in 0..=1.
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_from_linear`], with the standard's own threshold for this direction.
pub fn linear_from_srgb(display: f64) -> f64 {
    if display <= 0.04045 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

/// Linear light of each 8-bit sRGB value.
pub(crate) static SRGB_TO_LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f64 / 255.0) as f32));

/// Light of a colour of 8 bits, which a PNG of 8 bits shows as just that.
pub(crate) fn light_of_colour(colorous::Color { r, g, b }: colorous::Color) -> [f32; 3] {
    [r, g, b].map(|code| SRGB_TO_LINEAR[usize::from(code)])
}

/// Light in 0..=1 as a display value in 0..=`max`, by the curve itself.
fn on_curve(linear: f32, max: u16) -> u16 {
    // In range: the curve maps 0..=1 to 0..=1.
    (srgb_from_linear(f64::from(linear)) * f64::from(max)).round() as u16
}

/// The display values of [`on_curve`] without its powers: the curve rises, so that a value is the number of those light
/// values at which the next one begins that are not above the light.
struct DisplayValues {
    /// For each display value but the last, the least light that has the next one.
    next: Vec<f32>,
    /// By the upper bits of light, how many of `next` are not above the least light with these bits.
    below: Vec<u16>,
}

impl DisplayValues {
    /// Lower bits of light that `below` does not tell apart: among those with 8 bits there is one of `next` at the
    /// most.
    const SHIFT: u32 = 16;

    fn new(max: u16) -> Self {
        let next: Vec<f32> = (0..max).map(|value| Self::least_above(value, max)).collect();
        let buckets = (1.0_f32.to_bits() >> Self::SHIFT) + 1;
        let below = |bucket: u32| {
            let least = f32::from_bits(bucket << Self::SHIFT);
            next.partition_point(|&next| next <= least) as u16
        };
        let below = (0..=buckets).map(below).collect();
        DisplayValues { next, below }
    }

    /// The least light whose display value is above `value`.
    fn least_above(value: u16, max: u16) -> f32 {
        let is_above = |light: f32| on_curve(light, max) > value;
        let mut light = linear_from_srgb((f64::from(value) + 0.5) / f64::from(max)) as f32;
        while !is_above(light) {
            light = light.next_up();
        }
        while is_above(light.next_down()) {
            light = light.next_down();
        }
        light
    }

    /// One channel as a display value: NaN, infinities and negative values are 0, what is above 1 is the last.
    fn of(&self, linear: f32) -> u16 {
        let light = if linear.is_finite() && linear > 0.0 { linear.min(1.0) } else { 0.0 };
        let bucket = (light.to_bits() >> Self::SHIFT) as usize;
        let (first, end) = (self.below[bucket], self.below[bucket + 1]);
        let within = &self.next[usize::from(first)..usize::from(end)];
        first + within.partition_point(|&next| next <= light) as u16
    }
}

/// The same of 8 bits, without a branch: lights are compared as whole numbers, and a bucket has one value or two.
struct DisplayBytes {
    /// For each bucket its first value, and the bits of the least light that has the next one.
    buckets: Vec<(u32, u8)>,
}

impl DisplayBytes {
    fn new() -> Self {
        let DisplayValues { next, below } = DisplayValues::new(u8::MAX.into());
        let least = |first: u16| next.get(usize::from(first)).map_or(u32::MAX, |next| next.to_bits());
        DisplayBytes { buckets: below.into_iter().map(|first| (least(first), first as u8)).collect() }
    }

    /// As [`DisplayValues::of`].
    fn of(&self, linear: f32) -> u8 {
        let bits = linear.to_bits();
        // Not of NaN, infinity and what has a sign.
        let light = if bits < f32::INFINITY.to_bits() { bits.min(1.0_f32.to_bits()) } else { 0 };
        let (least, first) = self.buckets[(light >> DisplayValues::SHIFT) as usize];
        first + u8::from(least <= light)
    }
}

static DISPLAY_8: LazyLock<DisplayBytes> = LazyLock::new(DisplayBytes::new);
static DISPLAY_16: LazyLock<DisplayValues> = LazyLock::new(|| DisplayValues::new(u16::MAX));

/// As [`Film::to_srgb8`].
pub(super) fn srgb8(pixels: &[[f32; 3]]) -> Vec<[u8; 3]> {
    let values = &*DISPLAY_8;
    parallel::map_slice(pixels, |pixel| pixel.map(|c| values.of(c)))
}

/// As [`Film::to_srgb16`].
pub(super) fn srgb16(pixels: &[[f32; 3]]) -> Vec<[u16; 3]> {
    let values = &*DISPLAY_16;
    parallel::map_slice(pixels, |pixel| pixel.map(|c| values.of(c)))
}

/// As [`Film::non_finite`].
pub fn non_finite(pixels: &[[f32; 3]]) -> usize {
    let is = |i: usize| usize::from(pixels[i].iter().any(|c| !c.is_finite()));
    parallel::reduce_numbers(pixels.len(), 0, is, |a, b| a + b)
}

/// As [`Film::expose`].
///
/// # Errors
/// As there.
pub fn expose(pixels: &mut [[f32; 3]], stops: f32) -> Result<()> {
    Film::check_exposure(stops)?;
    let factor = f64::from(stops).exp2() as f32;
    parallel::each_mut(pixels, |_, pixel| *pixel = pixel.map(|light| light * factor));
    Ok(())
}

/// Where some pixels of a picture lie, in its rows from the first of theirs on.
pub struct FilmPlace<'a> {
    /// Those rows.
    pub rows: &'a mut [[f32; 3]],
    /// Pixels of a row.
    pub width: usize,
    /// Their first column.
    pub column: usize,
    /// Pixels of a row that are theirs.
    pub columns: usize,
}

impl FilmPlace<'_> {
    /// The same, borrowed once more.
    pub fn again(&mut self) -> FilmPlace<'_> {
        FilmPlace { rows: &mut *self.rows, ..*self }
    }

    /// Puts what `convert` makes of pixels there, which are row by row.
    pub fn put<T: Sync>(self, pixels: &[T], convert: impl Fn(&T) -> [f32; 3] + Sync) {
        let FilmPlace { rows, width, column, columns } = self;
        parallel::each(rows.chunks_mut(width).zip(pixels.chunks(columns)), |(row, pixels)| {
            for (pixel, from) in row[column..column + columns].iter_mut().zip(pixels) {
                *pixel = convert(from);
            }
        });
    }
}

impl Film {
    /// Bytes of a pixel.
    pub(crate) const PIXEL_BYTES: u64 = size_of::<[f32; 3]>() as u64;

    /// So many black pixels.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] when the system has no memory for them.
    pub(crate) fn try_pixels(count: usize) -> Result<Vec<[f32; 3]>> {
        let bytes = Self::PIXEL_BYTES * count as u64;
        let what = format!("a picture of {count} pixels");
        let need = Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy: "lower `size`" };
        try_zeros(count).ok_or_else(|| need.refused())
    }

    /// A film without pixels.
    pub(crate) fn none() -> Self {
        Film { width: 0, height: 0, pixels: Vec::new() }
    }

    /// Gives a film black pixels that has none yet.
    ///
    /// # Errors
    /// As [`Film::try_pixels`].
    pub(crate) fn make_pixels(&mut self) -> Result<()> {
        if self.pixels.is_empty() {
            self.pixels = Film::try_pixels(self.width as usize * self.height as usize)?;
        }
        Ok(())
    }

    /// Copies what both show of a place of the picture. `first`: column and row of this film's first pixel.
    pub(crate) fn copy(&mut self, first: (usize, usize), from: &FilmWindow, place: &Area) {
        let (width, here) = (self.width as usize, place.seen_from(first));
        let pixels = &mut self.pixels[here.y.start * width..here.y.end * width];
        // A patch is copied sooner than it is divided.
        let parts = pixels.chunks_mut(LARGEST_PATCH * width).zip(place.y.clone().step_by(LARGEST_PATCH));
        parallel::each(parts, |(rows, first)| {
            for (row, y) in rows.chunks_mut(width).zip(first..) {
                row[here.x.clone()].copy_from_slice(from.row(y, place.x.clone()));
            }
        });
    }

    /// A black film.
    pub fn black(width: u32, height: u32) -> Self {
        Film { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// The most that a picture is made lighter or darker by, in stops: far beyond what any camera does, and well within
    /// float32's range.
    pub const MOST_STOPS: f32 = 100.0;

    /// Checks an exposure, in stops.
    ///
    /// # Errors
    /// [`Error::Option`] unless it lies between -[`Film::MOST_STOPS`] and that.
    pub fn check_exposure(stops: f32) -> Result<()> {
        if stops.abs() <= Self::MOST_STOPS {
            return Ok(()); // NaN is not
        }
        let message = format!("{stops} is no exposure; give stops from -{0} to {0}", Self::MOST_STOPS);
        Err(Error::option("exposure", message))
    }

    /// Multiplies all light by 2 to the power of `stops`: exactly, where that is a whole number and no value reaches
    /// the ends of float32's range.
    ///
    /// # Errors
    /// As [`Film::check_exposure`].
    pub fn expose(&mut self, stops: f32) -> Result<()> {
        expose(&mut self.pixels, stops)
    }

    /// The number of pixels with a channel that is NaN or infinite; PNG shows such a channel as 0.
    pub fn non_finite(&self) -> usize {
        non_finite(&self.pixels)
    }

    /// The picture as 8-bit sRGB. A channel that is NaN, infinite or negative becomes 0, one above 1 becomes 255.
    pub fn to_srgb8(&self) -> Vec<[u8; 3]> {
        srgb8(&self.pixels)
    }

    /// The picture as 16-bit sRGB, with the rules of [`Film::to_srgb8`].
    pub fn to_srgb16(&self) -> Vec<[u16; 3]> {
        srgb16(&self.pixels)
    }

    /// Writes the picture in `format`, or in the one that the extension of `path` stands for.
    ///
    /// PNG shows negative and non-finite channels as 0 and clips at 1; ask [`Film::non_finite`] and tell the user.
    /// OpenEXR and PFM keep every value as it is. The file appears when it is complete (see
    /// [`crate::low_level::output`]).
    ///
    /// # Errors
    /// As [`check_output`]; [`Error::Io`] with action "write" when writing fails or the film has no pixels or not
    /// `width` x `height` of them.
    pub fn write(&self, path: impl AsRef<Path>, format: Option<ImageFormat>) -> Result<()> {
        let path = path.as_ref();
        let format = format.map_or_else(|| ImageFormat::from_path(path), Ok)?;
        let pixel_count = u64::from(self.width) * u64::from(self.height);
        if pixel_count == 0 || pixel_count != self.pixels.len() as u64 {
            let message =
                format!("a film of {} x {} cannot hold {} pixels", self.width, self.height, self.pixels.len());
            return Err(Error::io("write", path, io::Error::new(io::ErrorKind::InvalidInput, message)));
        }
        write_atomically(path, |out| self.encode(out, format))
    }

    fn encode(&self, out: &mut dyn Output, format: ImageFormat) -> io::Result<()> {
        rows::encode(out, (self.width, self.height), format, |put| put(&self.pixels))
    }

    /// The bytes that [`Film::write`] gives a file of this format.
    ///
    /// # Errors
    /// As there, of a film without pixels, or with other than `width` x `height` of them.
    pub fn to_bytes(&self, format: ImageFormat) -> io::Result<Vec<u8>> {
        let mut out = io::Cursor::new(Vec::new());
        self.encode(&mut out, format)?;
        Ok(out.into_inner())
    }

    /// The bytes of a .png file of 8 bits a channel, with the rules of [`Film::to_srgb8`].
    ///
    /// # Errors
    /// The film has no pixels, or not `width` x `height` of them.
    pub fn to_png(&self) -> io::Result<Vec<u8>> {
        self.to_bytes(ImageFormat::Png8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use exr::prelude::{ReadChannels, ReadLayers};
    use std::fs;

    /// A 3 x 2 film with values below, in and above the displayable range.
    fn sample() -> Film {
        let pixels =
            vec![[0.0, 0.5, 1.0], [-1.0, 2.0, 1e-3], [0.0031308, 0.2, 0.9], [1e-30, 3.4e38, 0.1], [0.7; 3], [0.25; 3]];
        Film { width: 3, height: 2, pixels }
    }

    fn written(film: &Film, name: &str, format: Option<ImageFormat>) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        film.write(&path, format).unwrap();
        fs::read(path).unwrap()
    }

    #[test]
    fn the_bytes_of_a_png_are_those_of_its_file() {
        assert_eq!(sample().to_png().unwrap(), written(&sample(), "a.png", None));
        assert!(Film { pixels: Vec::new(), ..sample() }.to_png().is_err());
    }

    #[test]
    fn exposure_multiplies_by_powers_of_two() {
        let mut film = sample();
        film.expose(3.0).unwrap();
        assert!(film.pixels.iter().zip(sample().pixels).all(|(new, old)| *new == old.map(|light| light * 8.0)));
        film.expose(-3.0).unwrap();
        assert_eq!(film.pixels[0], sample().pixels[0]);
        let mut film = sample();
        film.expose(0.5).unwrap();
        assert_eq!(film.pixels[0], [0.0, 0.5 * 2_f32.sqrt(), 2_f32.sqrt()]);
        for wrong in [f32::NAN, f32::INFINITY, 100.5, -101.0] {
            let message = sample().expose(wrong).unwrap_err().to_string();
            assert!(message.contains("exposure: ") && message.contains("from -100 to 100"), "{message}");
        }
    }

    fn decoded_png(bytes: &[u8]) -> (png::Info<'static>, Vec<u8>) {
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        (reader.info().clone(), pixels)
    }

    #[test]
    fn the_curve_has_the_published_values() {
        // 8-bit codes of linear greys: 18 % grey is 118, half is 188, 0.0031308 lies where the pieces meet.
        for (linear, code) in
            [(0.0, 0), (0.18, 118), (0.5, 188), (0.0031308, 10), (0.21404, 127), (0.21405, 128), (1.0, 255)]
        {
            assert_eq!(DISPLAY_8.of(linear), code, "{linear}");
        }
        assert_eq!(DISPLAY_16.of(0.5), 48192);
        assert!((srgb_from_linear(0.0031308) - 0.04045).abs() < 1e-6);
    }

    #[test]
    fn every_display_value_survives_the_way_to_linear_and_back() {
        for code in 0..=u16::MAX {
            let linear = linear_from_srgb(f64::from(code) / 65535.0);
            assert_eq!(DISPLAY_16.of(linear as f32), code);
        }
        for code in 0..=255_u8 {
            assert_eq!(DISPLAY_8.of(linear_from_srgb(f64::from(code) / 255.0) as f32), code);
        }
    }

    #[test]
    fn display_values_are_those_of_the_curve() {
        check_display_values(&DISPLAY_16, u16::MAX, |light| DISPLAY_16.of(light));
        check_display_values(&DisplayValues::new(u8::MAX.into()), u8::MAX.into(), |light| DISPLAY_8.of(light).into());
    }

    fn check_display_values(values: &DisplayValues, max: u16, of: impl Fn(f32) -> u16) {
        let mut random = Random::new(8);
        // Where a value ends and the next begins, and lights of all magnitudes.
        let ends = values.next.iter().flat_map(|&next| [next.next_down(), next, next.next_up()]);
        let others = (0..200_000).map(|_| f32::from_bits((random.bits() as u32) % (1.0_f32.to_bits() + 1)));
        for light in ends.chain(others).chain([0.0, -0.0, 1.0, 1.5, f32::MAX, f32::MIN_POSITIVE, 1e-45]) {
            assert_eq!(of(light), on_curve(light.min(1.0), max), "{light:e} of {max}");
        }
        for light in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -1e-45] {
            assert_eq!(of(light), 0, "{light:e} of {max}");
        }
    }

    #[test]
    fn a_brighter_pixel_is_never_darker_on_screen() {
        let codes: Vec<u16> = (0..=40_000).map(|i| DISPLAY_16.of(i as f32 / 40_000.0)).collect();
        assert!(codes.is_sorted());
    }

    #[test]
    fn values_that_no_screen_shows_are_counted_and_shown_as_documented() {
        let pixels = vec![[f32::NAN, 0.5, 2.0], [f32::INFINITY, f32::NEG_INFINITY, -0.5], [1.0; 3]];
        let film = Film { width: 3, height: 1, pixels };
        assert_eq!(film.non_finite(), 2);
        assert_eq!(film.to_srgb8(), [[0, 188, 255], [0, 0, 0], [255; 3]]);
        assert_eq!(film.to_srgb16()[0], [0, 48192, 65535]);
    }

    #[test]
    fn png_holds_the_display_values_and_says_srgb() {
        for (name, format, depth) in [
            ("a.png", None, png::BitDepth::Eight),
            ("b.PNG", None, png::BitDepth::Eight),
            ("c.png", Some(ImageFormat::Png16), png::BitDepth::Sixteen),
        ] {
            let film = sample();
            let (info, bytes) = decoded_png(&written(&film, name, format));
            assert_eq!((info.width, info.height), (3, 2));
            assert_eq!(info.srgb, Some(png::SrgbRenderingIntent::Perceptual));
            assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, depth));
            match depth {
                png::BitDepth::Eight => assert_eq!(bytes, film.to_srgb8().as_flattened()),
                _ => {
                    let values: Vec<u16> = bytes.chunks(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
                    assert_eq!(values, film.to_srgb16().as_flattened());
                }
            }
        }
    }

    #[test]
    fn exr_holds_every_bit() {
        let mut film = sample();
        film.pixels[4] = [f32::INFINITY, -0.0, f32::NAN];
        let bytes = written(&film, "a.exr", None);
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |size, _| (size.0, vec![[0.0_f32; 3]; size.0 * size.1]),
                |(width, pixels), at, (r, g, b): (f32, f32, f32)| pixels[at.1 * *width + at.0] = [r, g, b],
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(io::Cursor::new(bytes))
            .unwrap();
        let (width, pixels) = image.layer_data.channel_data.pixels;
        let bits = |p: &[[f32; 3]]| p.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!((width, bits(&pixels)), (3, bits(&film.pixels)));
    }

    #[test]
    fn pfm_is_byte_for_byte_what_the_format_says() {
        let film = Film { width: 1, height: 2, pixels: vec![[1.0, 2.0, 3.0], [4.0, 5.0, -6.0]] };
        let mut expected = b"PF\n1 2\n-1.0\n".to_vec();
        for value in [4.0_f32, 5.0, -6.0, 1.0, 2.0, 3.0] {
            expected.extend(value.to_le_bytes());
        }
        assert_eq!(written(&film, "a.pfm", None), expected);
    }

    #[test]
    fn wrong_names_are_refused_before_and_after() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.jpg", "png", "a.", ".png", "a"] {
            let path = folder.path().join(name);
            for error in [check_output(&path, None).unwrap_err(), sample().write(&path, None).unwrap_err()] {
                assert!(matches!(&error, Error::Option { option, .. } if option == "output"), "{name}: {error:?}");
                assert_eq!(error.exit_code(), 2);
            }
        }
        assert_eq!(check_output(&folder.path().join("no/a.png"), None).unwrap_err().exit_code(), 5);
        check_output(&folder.path().join("a.pfm"), None).unwrap();
        check_output(&folder.path().join("a"), Some(ImageFormat::Png8)).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn bit_depths_fit_their_format() {
        assert_eq!(ImageFormat::Png8.with_bit_depth(16).unwrap(), ImageFormat::Png16);
        assert_eq!(ImageFormat::Png16.with_bit_depth(8).unwrap(), ImageFormat::Png8);
        assert_eq!(ImageFormat::Exr.with_bit_depth(32).unwrap(), ImageFormat::Exr);
        assert!(ImageFormat::Exr.with_bit_depth(16).is_err());
        assert!(ImageFormat::Png8.with_bit_depth(10).is_err());
    }

    #[test]
    fn a_film_of_the_wrong_size_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        for (width, height, count) in [(2, 2, 3), (0, 0, 0), (u32::MAX, u32::MAX, 1)] {
            let film = Film { width, height, pixels: vec![[0.0; 3]; count] };
            for name in ["a.png", "a.exr", "a.pfm"] {
                assert_eq!(film.write(folder.path().join(name), None).unwrap_err().exit_code(), 5);
            }
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
