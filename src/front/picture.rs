//! Rendered pictures.

use crate::error::{Error, Result};
use crate::io::film::{Film, ImageFormat};
use crate::io::planes::{PlaneGroup, write_exr};
use crate::layers::Layer;
use crate::stats::RayCounts;
use crate::tracer::RenderResult;
use std::path::Path;

/// A rendered picture: linear radiance, which files and [`Picture::to_srgb8`] turn into what a screen shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    film: Film,
    rays: RayCounts,
    layers: Vec<PlaneGroup>,
}

impl Picture {
    pub(super) fn new(result: RenderResult, layers: Vec<PlaneGroup>) -> Picture {
        Picture { rays: RayCounts::from_counters(&result.counts), film: result.film, layers }
    }

    /// A picture of linear radiance, `width` x `height` pixels, top row first, as [`Picture::pixels`] has them: such
    /// as blocks that were rendered elsewhere. It has no layers, and nobody counted its rays.
    ///
    /// # Errors
    /// [`Error::Option`] when there are more or fewer pixels.
    pub fn from_pixels(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Result<Picture> {
        if u64::from(width) * u64::from(height) != pixels.len() as u64 || pixels.is_empty() {
            let message = format!("{width}x{height} is no size for {} pixels", pixels.len());
            return Err(Error::option("size", message));
        }
        Ok(Picture::new(RenderResult::of_film(Film { width, height, pixels }), Vec::new()))
    }

    /// Pixels a row.
    pub fn width(&self) -> u32 {
        self.film.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.film.height
    }

    /// `width` x `height` pixels, linear RGB radiance, top row first. Nothing keeps a value from being above 1.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.film.pixels
    }

    /// 3 x `width` x `height` bytes, R, G and B of the top left pixel first, as 8-bit sRGB (IEC 61966-2-1). There is no
    /// tone mapping: what is above 1 becomes 255; NaN, infinite and negative values become 0.
    pub fn to_srgb8(&self) -> Vec<u8> {
        self.film.to_srgb8().into_flattened()
    }

    /// The picture made lighter, or darker by a negative number: all light multiplied by 2 to the power of `stops`.
    ///
    /// # Errors
    /// [`Error::Option`](crate::Error::Option) unless `stops` lies between -100 and 100.
    pub fn exposed(mut self, stops: f32) -> Result<Picture> {
        self.film.expose(stops)?;
        Ok(self)
    }

    /// The layers that the view asked for ([`View::layers`](crate::View::layers)), in the order of
    /// [`Layer::ALL`](crate::Layer::ALL): each has a plane of `width` x `height` numbers, top row first, for each of
    /// its channels. They are of the first hit on the ray through the middle of a pixel, and the same bits on every
    /// device.
    pub fn layers(&self) -> &[PlaneGroup] {
        &self.layers
    }

    /// One of them, if the view asked for it.
    pub fn layer(&self, layer: Layer) -> Option<&PlaneGroup> {
        self.layers.iter().find(|group| group.name == layer.name())
    }

    /// The bytes of a .png file with these values.
    ///
    /// # Errors
    /// What the encoder says.
    pub fn to_png(&self) -> std::io::Result<Vec<u8>> {
        self.film.to_png()
    }

    /// Writes the picture to `path`, in the format that the ending names: `.png` (8-bit sRGB), `.exr` (OpenEXR, 32-bit
    /// linear) or `.pfm` (portable float map, 32-bit linear). An `.exr` has the layers in it, too. The file appears
    /// when it is complete.
    ///
    /// # Errors
    /// [`Error::Option`](crate::Error::Option) for another ending; [`Error::Io`](crate::Error::Io) when the file cannot
    /// be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if !self.layers.is_empty() && ImageFormat::from_path(path)? == ImageFormat::Exr {
            return write_exr(path, &self.film, self.layers.clone());
        }
        self.film.write(path, None)
    }

    /// How many rays came from the camera.
    pub fn camera_rays(&self) -> u64 {
        self.rays.camera.cast
    }

    /// How many rays were cast all together: from the camera, towards lights, off mirrors and through glass.
    pub fn all_rays(&self) -> u64 {
        self.rays.total_cast()
    }
}
