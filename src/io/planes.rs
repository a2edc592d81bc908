//! Numbers of pixels beside their light: named layers of channels, and the OpenEXR files that hold them together with
//! the picture.
//!
//! One part with a channel for each number, as most readers know it. A channel is called `layer.CHANNEL`, of one letter
//! behind the dot: so Blender and Nuke find layers. The picture itself is in R, G and B, which every viewer shows.

use crate::error::{Error, Result};
use crate::io::film::Film;
use crate::io::output::{Output, write_atomically};
use crate::io::rows::of_exr;
use exr::image::write::WritableImage;
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, SmallVec};
use std::io;
use std::path::Path;

/// One number of each pixel, top row first.
#[derive(Debug, Clone, PartialEq)]
pub enum Plane {
    /// Measures.
    Float(Vec<f32>),
    /// Numbers and counts.
    Uint(Vec<u32>),
}

impl Plane {
    /// How many pixels there are.
    pub fn len(&self) -> usize {
        match self {
            Plane::Float(values) => values.len(),
            Plane::Uint(values) => values.len(),
        }
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Channels that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneGroup {
    /// As it is typed, such as `geometric-normal`.
    pub name: String,
    /// Each with its letter.
    pub planes: Vec<(char, Plane)>,
}

impl PlaneGroup {
    /// The names of its channels in a file: without hyphens, which Nuke does not have in names.
    fn channel_name(&self, letter: char) -> String {
        format!("{}.{letter}", self.name.replace('-', "_"))
    }
}

/// Writes `film` and `groups` to an OpenEXR file: 32-bit float and 32-bit unsigned channels, losslessly compressed. The
/// file appears when it is complete.
///
/// # Errors
/// [`Error::Io`] when it cannot be written, or when the groups have not the pixels of the film, or share a name.
pub fn write_exr(path: &Path, film: &Film, groups: Vec<PlaneGroup>) -> Result<()> {
    let refuse = |message: String| Error::io("write", path, io::Error::new(io::ErrorKind::InvalidInput, message));
    let pixels = film.width as usize * film.height as usize;
    let lengths = groups.iter().flat_map(|group| group.planes.iter().map(|(_, plane)| plane.len()));
    if pixels == 0 || lengths.chain([film.pixels.len()]).any(|length| length != pixels) {
        return Err(refuse(format!("layers and film have not all of {} x {} pixels", film.width, film.height)));
    }
    let mut names: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(refuse(format!("there are two layers {}", twice[0])));
    }
    write_atomically(path, |out| write_channels(out, film, groups))
}

fn write_channels(out: &mut dyn Output, film: &Film, groups: Vec<PlaneGroup>) -> io::Result<()> {
    let light = |k: usize| FlatSamples::F32(film.pixels.iter().map(|pixel| pixel[k]).collect());
    let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        ["R", "G", "B"].into_iter().enumerate().map(|(k, name)| AnyChannel::new(name, light(k))).collect();
    for group in groups {
        let names: Vec<String> = group.planes.iter().map(|(letter, _)| group.channel_name(*letter)).collect();
        let named = names.into_iter().zip(group.planes);
        channels.extend(named.map(|(name, (_, plane))| AnyChannel::new(name.as_str(), samples(plane))));
    }
    let size = (film.width as usize, film.height as usize);
    let image = Image::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels));
    image.write().to_buffered(out).map_err(of_exr)
}

fn samples(plane: Plane) -> FlatSamples {
    match plane {
        Plane::Float(values) => FlatSamples::F32(values),
        Plane::Uint(values) => FlatSamples::U32(values),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};

    fn film() -> Film {
        Film { width: 3, height: 2, pixels: (0..6).map(|i| [i as f32, 0.5, -1e-30]).collect() }
    }

    fn group(name: &str, planes: Vec<(char, Plane)>) -> PlaneGroup {
        PlaneGroup { name: name.to_owned(), planes }
    }

    #[test]
    fn channels_come_back_with_their_names_kinds_and_bits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let ids = vec![0, 1, u32::MAX, 0x0100_0001, 7, 8];
        let depths = vec![f32::INFINITY, 1.5, 1e-40, 3.0, -0.0, 5.0];
        let groups = vec![
            group("geometric-normal", vec![('X', Plane::Float(depths.clone())), ('Y', Plane::Float(vec![0.0; 6]))]),
            group("primitive", vec![('X', Plane::Uint(ids.clone()))]),
        ];
        write_exr(&path, &film(), groups).unwrap();
        let image =
            read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
        let image = image.from_file(&path).unwrap();
        let channels = &image.layer_data.channel_data.list;
        let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R", "geometric_normal.X", "geometric_normal.Y", "primitive.X"]);
        let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        match (&channels[2].sample_data, &channels[3].sample_data, &channels[5].sample_data) {
            (FlatSamples::F32(red), FlatSamples::F32(x), FlatSamples::U32(primitive)) => {
                assert_eq!(red, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
                assert_eq!(bits(x), bits(&depths));
                assert_eq!(primitive, &ids);
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_no_layer_of_the_film_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let of = |length: usize| vec![('X', Plane::Uint(vec![0; length]))];
        for (groups, words) in [
            (vec![group("a", of(5))], "3 x 2 pixels"),
            (vec![group("a", of(6)), group("b", of(6)), group("a", of(6))], "two layers a"),
        ] {
            let error = write_exr(&path, &film(), groups).unwrap_err();
            let source = std::error::Error::source(&error).unwrap().to_string();
            assert!(source.contains(words), "{source}");
        }
        assert!(!path.exists());
    }
}
