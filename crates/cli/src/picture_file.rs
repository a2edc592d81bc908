//! Options of a picture's file.

use super::{Talk, heading};
use raybrook::low_level::film::{Film, ImageFormat, expose, non_finite};
use raybrook::low_level::rows::{PutRows, write_by_rows};
use raybrook::{Error, Result};
use std::path::Path;
use std::time::{Duration, Instant};

/// How a picture is written.
#[derive(clap::Args)]
pub struct PictureFileArgs {
    /// Bits per channel: 8 or 16 for .png [default: 8], 32 for .exr and .pfm.
    #[arg(long, value_name = "BITS", hide_short_help = true, help_heading = heading::OUTPUT)]
    bit_depth: Option<u8>,
    /// Make a .png lighter by so many stops, or darker by a negative number [default: 0].
    ///
    /// All light is multiplied by 2 to the power of EV before it becomes sRGB. Not for .exr and .pfm, which hold the
    /// light itself. --error means the picture without it.
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "EV", allow_hyphen_values = true)]
    pub exposure: Option<f32>,
}

impl PictureFileArgs {
    /// Refuses what is asked for of a picture where there is none.
    pub fn refuse(&self) -> Result<()> {
        let given = [("bit_depth", self.bit_depth.is_some()), ("exposure", self.exposure.is_some())];
        let message = "is for pictures, and this is a batch of rays; leave it out";
        given.iter().find(|(_, is_given)| *is_given).map_or(Ok(()), |(option, _)| Err(Error::option(*option, message)))
    }

    /// The format of a file of this name, which can have the exposure that was asked for.
    pub fn format(&self, path: &Path) -> Result<ImageFormat> {
        let format = ImageFormat::from_path(path)?;
        let format = self.bit_depth.map_or(Ok(format), |bits| format.with_bit_depth(bits))?;
        let Some(stops) = self.exposure else { return Ok(format) };
        if matches!(format, ImageFormat::Exr | ImageFormat::Pfm) {
            let message = "an .exr or .pfm holds the light itself, which viewers expose; leave it out, or write a .png";
            return Err(Error::option("exposure", message));
        }
        Film::check_exposure(stops).map(|()| format)
    }

    /// Makes a picture that is about to be written, by this name in messages, as light as was asked for, and tells of
    /// pixels that are no numbers.
    pub fn finish(&self, film: &mut Film, name: &str, talk: Talk) -> Result<()> {
        warn_of(film.non_finite(), name, talk);
        self.expose(film)
    }

    /// Makes a picture as light as was asked for.
    pub fn expose(&self, film: &mut Film) -> Result<()> {
        self.exposure.map_or(Ok(()), |stops| film.expose(stops))
    }

    /// Writes a picture of which `fill` puts the rows, as [`PictureFileArgs::finish`] would finish it. Returns what
    /// `fill` does, and how many seconds writing took.
    pub fn write_rows<T>(
        &self,
        (output, format): (&Path, ImageFormat),
        size: (u32, u32),
        fill: impl FnOnce(PutRows) -> Result<T>,
        talk: Talk,
    ) -> Result<(T, f64)> {
        let (mut bad, mut took) = (0, Duration::ZERO);
        let filled = write_by_rows(output, size, format, |put| {
            fill(&mut |rows| {
                let start = Instant::now();
                bad += non_finite(rows);
                match self.exposure {
                    None => put(rows)?,
                    Some(stops) => rows.chunks(EXPOSED_ROWS * size.0 as usize).try_for_each(|rows| {
                        let mut exposed = rows.to_vec();
                        expose(&mut exposed, stops)?;
                        put(&exposed)
                    })?,
                }
                took += start.elapsed();
                Ok(())
            })
        })?;
        warn_of(bad, &output.display().to_string(), talk);
        Ok((filled, took.as_secs_f64()))
    }
}

/// Rows that are copied at a time to be made lighter.
const EXPOSED_ROWS: usize = 16;

/// Tells of pixels that are no numbers.
fn warn_of(bad: usize, name: &str, talk: Talk) {
    if bad > 0 && !talk.quiet {
        tell!("warning: {name}: {bad} pixels are not finite numbers and are written as 0; please report this scene");
    }
}
