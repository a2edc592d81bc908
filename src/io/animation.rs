//! Animated PNG: pictures of one size, one after the other, in one file (PNG specification, third edition, 2025, chunks
//! acTL, fcTL and fdAT). Programs that know no animation show the first.

use crate::error::{Error, Result};
use crate::io::input::read_regular;
use crate::io::output::write_atomically;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

/// Pixels of a file, and what they are.
struct Decoded {
    size: (u32, u32),
    kind: (png::ColorType, png::BitDepth),
    bytes: Vec<u8>,
}

fn decode(path: &Path) -> io::Result<Decoded> {
    let mut reader = png::Decoder::new(Cursor::new(read_regular(path)?)).read_info()?;
    let too_large = || io::Error::other("it is too large");
    let mut bytes = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    let info = reader.next_frame(&mut bytes)?;
    bytes.truncate(info.buffer_size());
    Ok(Decoded { size: (info.width, info.height), kind: (info.color_type, info.bit_depth), bytes })
}

/// Writes the PNG files `frames` to `path` as an animation that goes on for ever, with `fps` pictures a second. One of
/// them is in memory at a time. The file appears when it is complete.
///
/// # Errors
/// [`Error::Io`] when a frame cannot be read or the file cannot be written; [`Error::Input`] when a frame is not of the
/// size and kind of the first one.
pub fn write_animation(path: &Path, frames: &[PathBuf], fps: u16) -> Result<()> {
    let read = |frame: &PathBuf| decode(frame).map_err(|e| Error::io("read", frame, e));
    let Some(first) = frames.first() else {
        return Err(Error::io("write", path, io::Error::new(io::ErrorKind::InvalidInput, "there are no frames")));
    };
    let Decoded { size, kind, .. } = read(first)?;
    let mut failed = None;
    let written = write_atomically(path, |out| {
        let mut encoder = png::Encoder::new(out, size.0, size.1);
        encoder.set_color(kind.0);
        encoder.set_depth(kind.1);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_animated(frames.len() as u32, 0)?;
        encoder.set_frame_delay(1, fps)?;
        let mut writer = encoder.write_header()?;
        for frame in frames {
            let decoded = read(frame).and_then(|decoded| match (decoded.size, decoded.kind) == (size, kind) {
                true => Ok(decoded),
                false => Err(Error::input(frame, None, "is not of the size and bit depth of the first frame")),
            });
            match decoded {
                Ok(decoded) => writer.write_image_data(&decoded.bytes)?,
                Err(error) => {
                    failed = Some(error);
                    return Err(io::Error::other("a frame is missing"));
                }
            }
        }
        Ok(writer.finish()?)
    });
    failed.map_or(written, Err)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::film::Film;

    fn frame(folder: &Path, i: u32, size: (u32, u32)) -> PathBuf {
        let path = folder.join(format!("{i}.png"));
        let pixels = (0..size.0 * size.1).map(|pixel| [pixel as f32 / 20.0, i as f32 / 3.0, 0.5]).collect();
        Film { width: size.0, height: size.1, pixels }.write(&path, None).unwrap();
        path
    }

    #[test]
    fn an_animation_has_all_frames_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.png");
        let frames: Vec<_> = (0..3).map(|i| frame(folder.path(), i, (5, 4))).collect();
        write_animation(&path, &frames, 24).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(std::fs::read(&path).unwrap())).read_info().unwrap();
        let control = reader.info().animation_control.unwrap();
        assert_eq!((control.num_frames, control.num_plays), (3, 0));
        for frame in &frames {
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            let delay = reader.info().frame_control.unwrap();
            assert_eq!((delay.delay_num, delay.delay_den), (1, 24));
            assert!(bytes == decode(frame).unwrap().bytes);
        }
    }

    #[test]
    fn frames_that_do_not_fit_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.png");
        let frames = [frame(folder.path(), 0, (5, 4)), frame(folder.path(), 1, (4, 5))];
        assert!(write_animation(&path, &frames, 24).unwrap_err().to_string().contains("1.png: is not of the size"));
        let missing = [frames[0].clone(), folder.path().join("none.png")];
        assert!(write_animation(&path, &missing, 24).unwrap_err().to_string().contains("none.png"));
        assert_eq!(write_animation(&path, &[], 24).unwrap_err().exit_code(), 5);
        assert!(!path.exists());
    }
}
