//! A part of a picture, with the bits that the whole picture has there.
//!
//! With a fixed number of samples nothing but the part is rendered. Of a picture by its error the blocks are rendered
//! that have pixels in the part: what becomes of a pixel depends on its block, whose patches are strewn over its area.

use super::{Picture, rendered_params};
use crate::adaptive::{blocks_of, render_area};
use crate::blocks::Area;
use crate::error::{Error, Result};
use crate::io::film::{Film, FilmPlace};
use crate::pack::{SceneBuffers, sample_positions};
use crate::scene::Samples;
use crate::shared::{CameraSample, RenderParams, TILE_SIDE};
use crate::tracer::{Adaptive, Backend, Progress, RenderResult};
use std::fmt;
use std::str::FromStr;

/// A part of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// Column and row of its upper left pixel, from the picture's upper left one.
    pub place: (u32, u32),
    /// Width and height in pixels.
    pub size: (u32, u32),
}

impl Crop {
    /// Checks that a picture of `width` x `height` pixels has this part.
    ///
    /// # Errors
    /// [`Error::Option`] when it has no pixels, or reaches beyond the picture.
    pub fn check(self, (width, height): (u32, u32)) -> Result<()> {
        let Crop { place, size } = self;
        if size.0 == 0 || size.1 == 0 {
            let message = format!("{self} has no pixels; give a width and a height of at least 1");
            return Err(Error::option("crop", message));
        }
        let ends = |place: u32, size: u32, side: u32| u64::from(place) + u64::from(size) <= u64::from(side);
        if ends(place.0, size.0, width) && ends(place.1, size.1, height) {
            return Ok(());
        }
        let message = format!("{self} reaches beyond the picture of {width}x{height}; give a part that lies in it");
        Err(Error::option("crop", message))
    }

    /// Its columns and rows.
    pub(super) fn area(self) -> Area {
        let range = |first: u32, count: u32| first as usize..first as usize + count as usize;
        Area { x: range(self.place.0, self.size.0), y: range(self.place.1, self.size.1) }
    }

    /// Width and height of what is in memory of a picture while this part is rendered: of a picture by its error the
    /// areas that it meets.
    pub fn rendered_size(self, size: (u32, u32), samples: Samples) -> (u32, u32) {
        let Samples::Error(error) = samples else { return self.size };
        let area = blocks_of(size, Adaptive::of_error(error)).area;
        let side = |range: std::ops::Range<usize>, area: usize, side: u32| {
            let end = range.end.next_multiple_of(area).min(side as usize);
            (end - range.start / area * area) as u32
        };
        let part = self.area();
        (side(part.x, area.0, size.0), side(part.y, area.1, size.1))
    }
}

/// As people type it.
impl fmt::Display for Crop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Crop { place: (x, y), size: (width, height) } = self;
        write!(f, "{x},{y},{width}x{height}")
    }
}

impl FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Crop, String> {
        let numbers = || {
            let (x, rest) = text.split_once(',')?;
            let (y, size) = rest.split_once(',')?;
            let (width, height) = size.split_once(['x', 'X'])?;
            let number = |text: &str| text.trim().parse().ok();
            Some(Crop { place: (number(x)?, number(y)?), size: (number(width)?, number(height)?) })
        };
        numbers().ok_or_else(|| "expected X,Y,WIDTHxHEIGHT in pixels, such as 100,50,320x240".to_owned())
    }
}

/// As [`render`](super::render), of a part of the picture alone; of all of it without one.
///
/// # Errors
/// As [`render`](super::render), and as [`Crop::check`].
pub fn render_part(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    picture: &Picture,
    part: Option<Crop>,
    progress: Progress,
) -> Result<RenderResult> {
    render_part_noting(tracer, buffers, picture, part, false, progress)
}

/// As [`render_part`]; with `notes_sampling` a picture by its error tells how each pixel was sampled
/// ([`RenderResult::sampling`]): then the host decides that.
///
/// # Errors
/// As there.
pub fn render_part_noting(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    picture: &Picture,
    part: Option<Crop>,
    notes_sampling: bool,
    progress: Progress,
) -> Result<RenderResult> {
    if let Some(crop) = part {
        crop.check(picture.size)?;
    }
    picture.samples.check(picture.size)?;
    let crop = part.unwrap_or(Crop { place: (0, 0), size: picture.size });
    let params = rendered_params(tracer, buffers, picture);
    match picture.samples {
        Samples::Error(error) => {
            render_area(tracer, &params, Adaptive::of_error(error), &crop.area(), notes_sampling, progress)
        }
        fixed => {
            let most_pixels = match tracer.options().counters {
                // What is counted of each pixel comes in one piece.
                true => u64::MAX,
                false => tracer.pixels_at_a_time(),
            };
            render_fixed((tracer, most_pixels), &params, &sample_positions(fixed), crop, progress)
        }
    }
}

/// Renders a part of a picture with these samples of each pixel, at a time as many rows as have so many pixels.
fn render_fixed(
    (tracer, most_pixels): (&mut dyn Backend, u64),
    params: &RenderParams,
    samples: &[CameraSample],
    part: Crop,
    progress: Progress,
) -> Result<RenderResult> {
    let Crop { place: (left, top), size: (width, height) } = part;
    let tiles = most_pixels / u64::from(width * TILE_SIDE);
    if tiles * u64::from(TILE_SIDE) >= u64::from(height) {
        return tracer.render(&params.cropped(part.place, part.size), samples, progress);
    }
    let (band, columns) = (tiles.max(1) as u32 * TILE_SIDE, width as usize);
    let pixels = Film::try_pixels(columns * height as usize)?;
    let mut result = RenderResult::of_film(Film { width, height, pixels });
    for first in (0..height).step_by(band as usize) {
        let rows = band.min(height - first);
        let pixels = &mut result.film.pixels[first as usize * columns..(first + rows) as usize * columns];
        let place = FilmPlace { rows: pixels, width: columns, column: 0, columns };
        let params = params.cropped((left, top + first), (width, rows));
        let progress = |done: f64| progress((f64::from(first) + done * f64::from(rows)) / f64::from(height));
        let traced = tracer.render_into(&params, samples, place, &progress)?;
        result.add(&traced);
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::renderer::open_tracer;
    use crate::scene::{Builder, Camera, Light, Material};
    use glam::Vec3;
    use std::sync::{Arc, Mutex};

    #[test]
    fn rows_at_a_time_are_the_rows_of_the_whole_part() {
        let mut builder = Builder::new();
        builder.material(Material::matt(Vec3::new(0.8, 0.6, 0.3)));
        builder.sphere(1.0, 8).light(Light::point(Vec3::new(2.0, 5.0, 4.0), Vec3::ONE));
        let scene = builder.finish().unwrap();
        let options = TraceOptions::DEFAULT;
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let mut tracer = open_tracer(None, &buffers, &options, 2, None).unwrap();
        let camera = Camera::framing([-Vec3::ONE, Vec3::ONE].into_iter(), 1.0);
        let samples = Samples::PerPixel(3);
        let picture = Picture { camera, size: (40, 39), samples, depth: 2, kill_weight: None };
        let (params, samples) = (rendered_params(tracer.as_ref(), &buffers, &picture), sample_positions(samples));
        let crop = Crop { place: (2, 1), size: (37, 37) };
        let mut render = |most_pixels| {
            let told = Mutex::new(Vec::new());
            let progress = |done: f64| told.lock().unwrap().push(done);
            let result = render_fixed((tracer.as_mut(), most_pixels), &params, &samples, crop, &progress).unwrap();
            (result, told.into_inner().unwrap())
        };
        let (whole, _) = render(u64::MAX);
        assert!(whole.counts[0] == 37 * 37 * 3 && whole.film.pixels.iter().any(|pixel| *pixel != whole.film.pixels[0]));
        // A tile's rows at the least; two; all but one pixel; all.
        for most_pixels in [1, 37 * 16, 37 * 40 - 1, 37 * 40] {
            let (rows, told) = render(most_pixels);
            assert_eq!(rows.film, whole.film, "{most_pixels} pixels at a time");
            assert_eq!(rows.counts, whole.counts, "{most_pixels} pixels at a time");
            assert!(told.is_sorted() && told.last() == Some(&1.0), "{most_pixels}: {told:?}");
        }
    }

    #[test]
    fn parts_are_typed_as_they_are_written_and_nothing_else() {
        for text in ["0,0,1x1", "12,345,6789x10"] {
            assert_eq!(text.parse::<Crop>().unwrap().to_string(), text);
        }
        for text in ["", "1,2", "1,2,3", "1,2,3,4", "-1,2,3x4", "1,2,3x", "1.5,2,3x4", "4294967296,0,1x1"] {
            assert!(text.parse::<Crop>().unwrap_err().contains("100,50,320x240"), "{text}");
        }
    }

    #[test]
    fn parts_lie_in_their_picture() {
        let check = |text: &str| text.parse::<Crop>().unwrap().check((8, 6)).map_err(|error| error.to_string());
        for inside in ["0,0,8x6", "7,5,1x1", "2,3,6x3"] {
            assert_eq!(check(inside), Ok(()), "{inside}");
        }
        for beyond in ["0,0,9x6", "8,0,1x1", "0,6,1x1", "4294967295,0,1x1", "1,1,4294967295x1"] {
            assert!(check(beyond).unwrap_err().contains("beyond the picture of 8x6"), "{beyond}");
        }
        for empty in ["0,0,0x6", "0,0,8x0"] {
            assert!(check(empty).unwrap_err().contains("no pixels"), "{empty}");
        }
    }

    #[test]
    fn areas_that_a_part_meets_are_in_memory() {
        let of = |text: &str, size| text.parse::<Crop>().unwrap().rendered_size(size, Samples::Error(1.0));
        assert_eq!(of("9,8,17x11", (1920, 1080)), (1920, 1080));
        assert_eq!(of("9,8,17x11", (65535, 65535)), (2048, 2048));
        assert_eq!(of("2047,65530,2x5", (65535, 65535)), (4096, 2047));
        let fixed = "9,8,17x11".parse::<Crop>().unwrap().rendered_size((1920, 1080), Samples::PerPixel(4));
        assert_eq!(fixed, (17, 11));
    }
}
