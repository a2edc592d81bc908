//! Layers as pictures to look at.
//!
//! Measures are scaled to the colours that a PNG has, and it is told how; numbers have a colour each, of no meaning but
//! that neighbours differ. What nothing was hit by is black.

use super::Layer;
use crate::io::film::{Film, SRGB_TO_LINEAR, light_of_colour};
use crate::io::planes::{Plane, PlaneGroup};
use crate::scene::Numbering;

/// A layer in colours.
#[derive(Debug, Clone)]
pub struct Colours {
    /// Written as PNG of 8 bits it has exactly the colours that are meant.
    pub film: Film,
    /// What they mean, for people.
    pub meaning: String,
}

/// What positions and normals are where nothing is hit.
const NOWHERE: [f32; 3] = [0.0; 3];

/// Light that a PNG of 8 bits shows as this code.
fn light_of(code: f64) -> f32 {
    SRGB_TO_LINEAR[usize::from(code.round() as u8)] // saturates
}

/// The channels of measures of a pixel, at most three.
fn measures(group: &PlaneGroup, pixel: usize) -> [f32; 3] {
    let mut all = [0.0; 3];
    for (value, (_, plane)) in all.iter_mut().zip(&group.planes) {
        if let Plane::Float(values) = plane {
            *value = values[pixel];
        }
    }
    all
}

/// The least and the largest of the finite values, or zeros.
fn range(values: impl Iterator<Item = f32>) -> (f32, f32) {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    if low <= high { (low, high) } else { (0.0, 0.0) }
}

/// Where a value lies in a range, 0 to 1.
fn part((low, high): (f32, f32), value: f32) -> f64 {
    let extent = f64::from(high) - f64::from(low);
    if extent > 0.0 { (f64::from(value) - f64::from(low)) / extent } else { 0.0 }
}

/// The colours of a layer of a picture that is `width` x `height` pixels large.
pub fn false_colours(layer: Layer, group: &PlaneGroup, (width, height): (u32, u32)) -> Colours {
    let count = width as usize * height as usize;
    let film = |colour: &dyn Fn(usize) -> [f32; 3]| Film { width, height, pixels: (0..count).map(colour).collect() };
    let (film, meaning) = match layer {
        Layer::Depth => {
            let range = range((0..count).map(|pixel| measures(group, pixel)[0]));
            (film(&|pixel| depth_colour(range, measures(group, pixel)[0])), depth_meaning(range))
        }
        Layer::Position => {
            let hit = || (0..count).map(|pixel| measures(group, pixel)).filter(|&place| place != NOWHERE);
            let ranges = [0, 1, 2].map(|k| range(hit().map(|place| place[k])));
            (film(&|pixel| position_colour(ranges, measures(group, pixel))), position_meaning(ranges))
        }
        Layer::Normal | Layer::GeometricNormal => {
            let meaning = "x, y and z from -1 to 1 are red, green and blue from 0 to 255".to_owned();
            (film(&|pixel| normal_colour(measures(group, pixel))), meaning)
        }
        Layer::Albedo => (film(&|pixel| measures(group, pixel)), "sRGB, as the picture".to_owned()),
        Layer::Uv => {
            let meaning = "what u and v have behind the point, from 0 to 1, is red and green".to_owned();
            (film(&|pixel| uv_colour(measures(group, pixel))), meaning)
        }
        Layer::Samples | Layer::Error => {
            let value = |pixel| numbers(group).get(pixel).map_or_else(|| measures(group, pixel)[0], |&n| n as f32);
            let most = (0..count).map(value).fold(0.0, f32::max);
            (film(&|pixel| amount_colour(value(pixel), most)), format!("from 0 (black) to {most} (brightest)"))
        }
        Layer::Primitive | Layer::Object | Layer::Instance | Layer::Material => {
            let meaning = "each number has a colour; none is black".to_owned();
            (film(&|pixel| number_colour(numbers(group).get(pixel).copied())), meaning)
        }
    };
    Colours { film, meaning }
}

/// The numbers of a layer that has such.
fn numbers(group: &PlaneGroup) -> &[u32] {
    match group.planes.first() {
        Some((_, Plane::Uint(values))) => values,
        _ => &[],
    }
}

/// White is the nearest, and the farthest is not quite black: that is what nothing was hit by.
fn depth_colour(range: (f32, f32), depth: f32) -> [f32; 3] {
    const FARTHEST: f64 = 16.0;
    let grey = || 255.0 - (255.0 - FARTHEST) * part(range, depth);
    [if depth.is_finite() { light_of(grey()) } else { 0.0 }; 3]
}

fn depth_meaning((near, far): (f32, f32)) -> String {
    format!("from {near} (white) to {far} (dark grey); black: nothing is hit")
}

fn position_meaning([x, y, z]: [(f32, f32); 3]) -> String {
    let [x, y, z] = [x, y, z].map(|(low, high)| format!("{low} to {high}"));
    format!("x from {x} is red, y from {y} green, z from {z} blue")
}

fn position_colour(ranges: [(f32, f32); 3], place: [f32; 3]) -> [f32; 3] {
    if place == NOWHERE { place } else { [0, 1, 2].map(|k| light_of(255.0 * part(ranges[k], place[k]))) }
}

fn normal_colour(normal: [f32; 3]) -> [f32; 3] {
    if normal == NOWHERE { normal } else { normal.map(|x| light_of(127.5 + 127.5 * f64::from(x))) }
}

fn uv_colour([u, v, _]: [f32; 3]) -> [f32; 3] {
    let behind_point = |x: f32| if x.is_finite() { light_of(255.0 * f64::from(x - x.floor())) } else { 0.0 };
    [behind_point(u), behind_point(v), 0.0]
}

/// Of Inferno, as counted work has it.
fn amount_colour(value: f32, most: f32) -> [f32; 3] {
    let part = if most > 0.0 { f64::from(value) / f64::from(most) } else { 0.0 };
    light_of_colour(colorous::INFERNO.eval_continuous(part))
}

/// Neighbours are far from each other on the circle of colours: multiples of the golden ratio fill it evenly.
fn number_colour(number: Option<u32>) -> [f32; 3] {
    const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
    let Some(number) = number.filter(|&number| number != Numbering::NONE) else { return [0.0; 3] };
    light_of_colour(colorous::SINEBOW.eval_continuous((f64::from(number) * GOLDEN_RATIO).fract()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(layer: Layer, planes: Vec<Plane>) -> (Vec<[u8; 3]>, String) {
        let group = PlaneGroup {
            name: layer.name().to_owned(),
            planes: layer.channels().iter().copied().zip(planes).collect(),
        };
        let Colours { film, meaning } = false_colours(layer, &group, (4, 1));
        (film.to_srgb8(), meaning)
    }

    #[test]
    fn measures_are_scaled_as_it_is_told() {
        let (depth, meaning) = codes(Layer::Depth, vec![Plane::Float(vec![2.0, 4.0, f32::INFINITY, 3.0])]);
        assert_eq!(depth, [[255; 3], [16; 3], [0; 3], [136; 3]]);
        assert!(meaning.starts_with("from 2 (white) to 4 "), "{meaning}");
        let plane = |values: [f32; 4]| Plane::Float(values.to_vec());
        let places = vec![plane([-1.0, 0.0, 1.0, 3.0]), plane([5.0, 0.0, 5.0, 5.0]), plane([0.0, 0.0, 2.0, 1.0])];
        let (position, meaning) = codes(Layer::Position, places);
        assert_eq!(position, [[0; 3], [0; 3], [128, 0, 255], [255, 0, 128]]);
        assert!(meaning.contains("x from -1 to 3 ") && meaning.contains("y from 5 to 5 "), "{meaning}");
        let (normal, _) =
            codes(Layer::Normal, vec![plane([0.0, -1.0, 0.6, 0.0]), plane([1.0, 0.0, 0.8, 0.0]), plane([0.0; 4])]);
        assert_eq!(normal, [[128, 255, 128], [0, 128, 128], [204, 230, 128], [0; 3]]);
        let (uv, _) = codes(Layer::Uv, vec![plane([0.2, 1.2, -0.2, f32::NAN]), plane([0.0, 0.5, 7.0, 1.0])]);
        assert_eq!(uv, [[51, 0, 0], [51, 128, 0], [204, 0, 0], [0; 3]]);
        let nothing = codes(Layer::Depth, vec![Plane::Float(vec![f32::INFINITY; 4])]);
        assert_eq!(nothing.0, [[0; 3]; 4]);
    }

    #[test]
    fn amounts_are_the_brighter_the_larger() {
        for (layer, plane) in [
            (Layer::Samples, Plane::Uint(vec![0, 16, 64, 256])),
            (Layer::Error, Plane::Float(vec![0.0, 0.5, 1.5, 3.0])),
        ] {
            let (amounts, meaning) = codes(layer, vec![plane]);
            let lightness = |code: [u8; 3]| code.iter().map(|&c| u32::from(c)).sum::<u32>();
            assert!(amounts.iter().map(|&code| lightness(code)).is_sorted_by(|a, b| a < b), "{amounts:?}");
            assert!(meaning.starts_with("from 0 (black) to "), "{meaning}");
        }
    }

    #[test]
    fn neighbouring_numbers_have_colours_of_their_own_and_none_is_black() {
        let (numbers, _) = codes(Layer::Object, vec![Plane::Uint(vec![0, 1, 2, u32::MAX])]);
        let far = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap();
        assert!(far(numbers[0], numbers[1]) > 90 && far(numbers[1], numbers[2]) > 90, "{numbers:?}");
        assert!(numbers[..3].iter().all(|code| code.iter().any(|&c| c > 100)));
        assert_eq!(numbers[3], [0; 3]);
    }
}
