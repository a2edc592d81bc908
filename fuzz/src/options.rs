//! Options as they are typed: what is understood is told in words that are understood as the same.

use super::errors::check_error;
use raybrook::low_level::options::parse_method;
use raybrook::low_level::renderer::{Crop, Part, PictureBlocks};
use raybrook::low_level::runs::Asked;
use raybrook::low_level::scene::{PictureDefaults, Samples};
use std::fmt::{Debug, Display};
use std::str::FromStr;

/// A line for each option.
pub fn options(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    text.lines().map(check_line).filter(|is_known| !is_known).count() == 0
}

fn check_line(line: &str) -> bool {
    let asked = told_again::<Asked>(line);
    let part = told_again::<Part>(line);
    assert!(part.is_none_or(|part| (1..=part.of).contains(&part.number)));
    let crop = told_again::<Crop>(line);
    if let Some(crop) = crop {
        check_crop(crop);
    }
    let samples = line.parse();
    if let Ok(Samples::PerPixel(count)) = samples {
        assert!((1..=PictureDefaults::MAX_SAMPLES).contains(&count));
    }
    let method = parse_method(line);
    match &method {
        Ok(choices) => {
            let names: Vec<_> = choices.iter().filter_map(|choice| choice.name()).collect();
            assert_eq!(&parse_method(&names.join("+")).expect("names of choices"), choices);
        }
        Err(error) => check_error(error),
    }
    asked.is_some() || part.is_some() || crop.is_some() || samples.is_ok() || method.is_ok()
}

fn told_again<T: FromStr + Display + PartialEq + Debug>(line: &str) -> Option<T> {
    let read = line.parse::<T>().ok()?;
    assert_eq!(read.to_string().parse::<T>().ok().as_ref(), Some(&read), "'{line}'");
    Some(read)
}

/// A part that lies in a picture has blocks, and each pixel is in one of them.
fn check_crop(crop: Crop) {
    const SIZE: (u32, u32) = (300, 200);
    if crop.check(SIZE).is_err() {
        return;
    }
    for samples in [Samples::PerPixel(16), Samples::Error(2.0)] {
        let blocks = PictureBlocks::new(SIZE, samples, Some(crop));
        let pixels: usize = blocks.numbers().into_iter().map(|number| blocks.pixels(number)).sum();
        assert_eq!(pixels, crop.size.0 as usize * crop.size.1 as usize);
    }
}
