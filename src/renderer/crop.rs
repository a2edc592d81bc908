//! A part of a picture, with the bits that the whole picture has there.
//!
//! With a fixed number of samples nothing but the part is rendered. Of a picture by its error the areas are rendered that
//! the part meets: what becomes of a pixel there depends on its block, whose patches are strewn over all of its area.
//! Where work is counted, all of the picture is.

use super::{Picture, PictureBlocks, render_as, render_blocks, rendered_params};
use crate::blocks::Area;
use crate::error::{Error, Result};
use crate::io::film::Film;
use crate::pack::{SceneBuffers, sample_positions};
use crate::scene::Samples;
use crate::tracer::{Backend, Progress, RenderResult, Sampling};
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

    /// Width and height of what is rendered of a picture for this part.
    pub fn rendered_size(self, size: (u32, u32), samples: Samples) -> (u32, u32) {
        if matches!(samples, Samples::Error(_)) { size } else { self.size }
    }

    /// What this part has of `values`, one for each pixel of a picture that is `width` pixels wide.
    fn cut<T: Copy>(self, values: &[T], width: u32) -> Vec<T> {
        let [x, y, columns, rows] = [self.place.0, self.place.1, self.size.0, self.size.1].map(|n| n as usize);
        let rows = values.chunks_exact(width as usize).skip(y).take(rows);
        rows.flat_map(|row| &row[x..x + columns]).copied().collect()
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
    let Some(crop) = part else { return render_as(tracer, buffers, picture, notes_sampling, progress) };
    crop.check(picture.size)?;
    if !matches!(picture.samples, Samples::Error(_)) {
        picture.samples.check(picture.size)?;
        let params = rendered_params(tracer, buffers, picture).cropped(crop.place, crop.size);
        return tracer.render(&params, &sample_positions(picture.samples), progress);
    }
    if !tracer.options().counters && !notes_sampling {
        let blocks = PictureBlocks::new(picture.size, picture.samples, part);
        let (wanted, film) = (blocks.numbers(), blocks.empty_film());
        return render_blocks(tracer, buffers, picture, &blocks, (&wanted, Some(film)), &mut |_| Ok(()), progress);
    }
    let whole = render_as(tracer, buffers, picture, notes_sampling, progress)?;
    let (width, height) = crop.size;
    let film = Film { width, height, pixels: crop.cut(&whole.film.pixels, whole.film.width) };
    let work = whole.work.map(|work| crop.cut(&work, whole.film.width));
    let cut = |sampling: Sampling| Sampling {
        samples: crop.cut(&sampling.samples, whole.film.width),
        errors: crop.cut(&sampling.errors, whole.film.width),
    };
    let sampling = whole.sampling.map(cut);
    Ok(RenderResult { film, work, sampling, ..whole })
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn what_is_cut_out_is_in_order() {
        let crop = Crop { place: (1, 2), size: (2, 2) };
        assert_eq!(crop.cut(&(0..20).collect::<Vec<_>>(), 4), [9, 10, 13, 14]);
    }
}
