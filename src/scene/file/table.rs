//! Reads values out of a TOML table so that every fault names the key and its line.
//!
//! Not serde's derive: with it an unknown key, a wrong type and a value out of range would each have another wording
//! and another idea of where they are, and nobody would suggest the key that was meant.

use crate::error::{Error, Result};
use crate::io::film::SRGB_TO_LINEAR;
use crate::scene::check::Fault;
use glam::Vec3;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

/// The text of a scene file, for turning places in it into lines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    pub path: &'a Path,
    pub text: &'a str,
}

impl Source<'_> {
    /// An error at the byte `offset`.
    pub fn error(&self, offset: usize, message: impl Into<String>) -> Error {
        let before = &self.text.as_bytes()[..offset.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
        Error::input(self.path, line, message)
    }
}

/// A table of the file, its keys known to be right.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table<'a> {
    pub source: Source<'a>,
    /// As messages call it: `[camera]`.
    name: &'a str,
    /// Where it begins.
    offset: usize,
    entries: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    /// The table `value`; a fault when it is none.
    pub fn of(source: Source<'a>, name: &'a str, value: &'a Spanned<DeValue<'a>>) -> Result<Table<'a>> {
        match value.get_ref() {
            DeValue::Table(entries) => Ok(Table { source, name, offset: value.span().start, entries }),
            other => Err(source.error(value.span().start, format!("{name} must be a table, not {}", kind_of(other)))),
        }
    }

    /// The table of the whole file.
    pub fn root(source: Source<'a>, entries: &'a DeTable<'a>) -> Table<'a> {
        Table { source, name: "the scene file", offset: 0, entries }
    }

    /// Refuses keys that are not in `known`; `whose` says what has only these.
    pub fn allow(self, whose: &str, known: &[&str]) -> Result<Self> {
        // The first in the file, not in the map's order: mistakes are mended from the top.
        let unknown =
            self.entries.keys().filter(|k| !known.contains(&k.get_ref().as_ref())).min_by_key(|k| k.span().start);
        match unknown {
            None => Ok(self),
            Some(key) => {
                let name = key.get_ref().as_ref();
                let message = format!("{whose} has no key '{name}'; {}", suggestion(name, known.iter().copied()));
                Err(self.source.error(key.span().start, message))
            }
        }
    }

    /// What messages call the table `key` in this one: `[camera] key`.
    pub fn name_of(&self, key: &str) -> String {
        format!("{} {key}", self.name)
    }

    /// The value of `key`, if it is there.
    pub fn get(&self, key: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.entries.get(key)
    }

    /// Whether `key` is there.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// The entries in the order of the file.
    pub fn entries(&self) -> Vec<(&'a str, &'a Spanned<DeValue<'a>>)> {
        let mut entries: Vec<_> = self.entries.iter().collect();
        entries.sort_by_key(|(key, _)| key.span().start);
        entries.into_iter().map(|(key, value)| (key.get_ref().as_ref(), value)).collect()
    }

    /// An error at `key`, or at the table itself without such a key.
    pub fn error(&self, key: &str, message: impl Display) -> Error {
        let offset = self.entries.get_key_value(key).map_or(self.offset, |(key, _)| key.span().start);
        self.source.error(offset, format!("{}: {key} {message}", self.name))
    }

    /// An error about the table as a whole.
    pub fn error_here(&self, message: impl Display) -> Error {
        self.source.error(self.offset, format!("{} {message}", self.name))
    }

    /// Turns a fault into an error at its key; `alias` is the key that stands for it when it is not there.
    pub fn check(&self, fault: Option<Fault>, alias: &str) -> Result<()> {
        match fault {
            None => Ok(()),
            Some(Fault { key, message }) => Err(self.error(if self.has(key) { key } else { alias }, message)),
        }
    }

    /// `value`, or an error that `key` is missing.
    pub fn required<T>(&self, key: &str, value: Option<T>) -> Result<T> {
        value.ok_or_else(|| self.error(key, "is missing"))
    }

    /// An error that the value of `key` should be something else.
    pub fn wrong_type(&self, key: &str, wanted: &str, found: &DeValue) -> Error {
        self.error(key, format!("must be {wanted}, not {}", kind_of(found)))
    }

    /// A text.
    pub fn text(&self, key: &str) -> Result<Option<&'a str>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let text = value.get_ref().as_str().ok_or_else(|| self.wrong_type(key, "a text in quotes", value.get_ref()))?;
        Ok(Some(text))
    }

    /// One of `choices`: its index.
    pub fn choice(&self, key: &str, choices: &[&str]) -> Result<Option<usize>> {
        let Some(text) = self.text(key)? else { return Ok(None) };
        match choices.iter().position(|&c| c == text) {
            Some(index) => Ok(Some(index)),
            None => Err(self.error(key, format!("cannot be '{text}'; {}", suggestion(text, choices.iter().copied())))),
        }
    }

    /// True or false.
    pub fn boolean(&self, key: &str) -> Result<Option<bool>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        value.get_ref().as_bool().map(Some).ok_or_else(|| self.wrong_type(key, "true or false", value.get_ref()))
    }

    /// A whole number in `range`.
    pub fn whole(&self, key: &str, range: RangeInclusive<u32>) -> Result<Option<u32>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let DeValue::Integer(integer) = value.get_ref() else {
            return Err(self.wrong_type(key, "a whole number", value.get_ref()));
        };
        let number = u32::from_str_radix(integer.as_str().trim_start_matches('+'), integer.radix()).ok();
        match number.filter(|n| range.contains(n)) {
            Some(number) => Ok(Some(number)),
            None => {
                Err(self.error(key, format!("is {integer}; it must lie between {} and {}", range.start(), range.end())))
            }
        }
    }

    /// A number that float32 can hold.
    pub fn number(&self, key: &str) -> Result<Option<f32>> {
        self.get(key).map(|value| self.number_in(key, value.get_ref())).transpose()
    }

    /// A number above 0.
    pub fn positive(&self, key: &str) -> Result<Option<f32>> {
        match self.number(key)? {
            Some(number) if number <= 0.0 => Err(self.error(key, format!("is {number}; it must be above 0"))),
            number => Ok(number),
        }
    }

    /// An array of `N` numbers.
    pub fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f32; N]>> {
        self.get(key)
            .map(|value| self.numbers_in(key, value.get_ref(), &format!("an array of {N} numbers")))
            .transpose()
    }

    /// A vector: an array of three numbers.
    pub fn vector(&self, key: &str) -> Result<Option<Vec3>> {
        Ok(self.numbers::<3>(key)?.map(Vec3::from))
    }

    /// A vector, or a number for all three components.
    pub fn vector_or_number(&self, key: &str) -> Result<Option<Vec3>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        Ok(Some(match value.get_ref() {
            number @ (DeValue::Integer(_) | DeValue::Float(_)) => Vec3::splat(self.number_in(key, number)?),
            other => self.numbers_in(key, other, "a number or an array of 3 numbers")?.into(),
        }))
    }

    /// A linear RGB colour: an array, a number for a grey, or "#rrggbb" in sRGB. Not negative.
    pub fn colour(&self, key: &str) -> Result<Option<Vec3>> {
        self.get(key).map(|value| self.colour_in(key, value.get_ref())).transpose()
    }

    /// An array of two colours.
    pub fn two_colours(&self, key: &str) -> Result<Option<[Vec3; 2]>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let two = value.get_ref().as_array().and_then(|array| Some((array.first()?, array.get(1)?, array.len())));
        match two {
            Some((first, second, 2)) => {
                Ok(Some([self.colour_in(key, first.get_ref())?, self.colour_in(key, second.get_ref())?]))
            }
            _ => Err(self.error(key, "must be an array of two colours")),
        }
    }

    fn colour_in(&self, key: &str, value: &DeValue) -> Result<Vec3> {
        let colour = match value {
            DeValue::String(text) => from_hex(text).ok_or_else(|| {
                self.error(
                    key,
                    format!("is '{text}'; a colour as text has the form \"#rrggbb\" with hexadecimal digits"),
                )
            })?,
            number @ (DeValue::Integer(_) | DeValue::Float(_)) => Vec3::splat(self.number_in(key, number)?),
            other => self.numbers_in(key, other, "a colour: [red, green, blue], a number or \"#rrggbb\"")?.into(),
        };
        if colour.min_element() < 0.0 {
            return Err(self.error(key, format!("is {colour}; no component may be negative")));
        }
        Ok(colour)
    }

    fn numbers_in<const N: usize>(&self, key: &str, value: &DeValue, wanted: &str) -> Result<[f32; N]> {
        let array = value.as_array().ok_or_else(|| self.wrong_type(key, wanted, value))?;
        if array.len() != N {
            return Err(self.error(key, format!("has {} values; it must be {wanted}", array.len())));
        }
        let mut numbers = [0.0; N];
        for (number, value) in numbers.iter_mut().zip(array.iter()) {
            *number = self.number_in(key, value.get_ref())?;
        }
        Ok(numbers)
    }

    fn number_in(&self, key: &str, value: &DeValue) -> Result<f32> {
        let text = match value {
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
            DeValue::Integer(integer) => &integer_text(integer),
            DeValue::Float(float) => float.as_str(),
            other => return Err(self.wrong_type(key, "a number", other)),
        };
        let number: f32 = text.parse().map_err(|_| self.error(key, format!("is {text}, which is not a number")))?;
        if !number.is_finite() {
            return Err(self.error(key, format!("is {text}; it must be finite and below {:e}", f32::MAX)));
        }
        Ok(number)
    }
}

/// The decimal digits of a hexadecimal, octal or binary number.
fn integer_text(integer: &DeInteger) -> String {
    u64::from_str_radix(integer.as_str(), integer.radix()).map_or_else(|_| integer.to_string(), |n| n.to_string())
}

/// What stands in the file, for "not a …".
fn kind_of(value: &DeValue) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}

/// "did you mean 'x'?" when something in `known` is near, or all of `known`.
pub(super) fn suggestion<'k>(name: &str, known: impl Iterator<Item = &'k str> + Clone) -> String {
    let lower = name.to_lowercase();
    let nearest = known
        .clone()
        .map(|k| (strsim::osa_distance(&lower, &k.to_lowercase()), k))
        .min_by_key(|&(distance, _)| distance);
    match nearest {
        // Up to a third of the letters wrong is a slip; "colour" for "color" is 1 of 5.
        Some((distance, nearest)) if distance <= 1 + nearest.chars().count() / 3 => {
            format!("did you mean '{nearest}'?")
        }
        Some(_) => format!("possible: {}", known.collect::<Vec<_>>().join(", ")),
        None => "there is none".into(),
    }
}

/// The linear colour of "#rrggbb".
fn from_hex(text: &str) -> Option<Vec3> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let value = u32::from_str_radix(digits, 16).ok()?;
    Some(Vec3::from([16, 8, 0].map(|shift| linear((value >> shift & 0xff) as u8))))
}

/// The linear value of an 8-bit sRGB one (IEC 61966-2-1).
pub(in crate::scene) fn linear(srgb: u8) -> f32 {
    SRGB_TO_LINEAR[usize::from(srgb)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_colours_are_srgb() {
        assert_eq!(from_hex("#ff0000"), Some(Vec3::X));
        assert_eq!(from_hex("#FFFFFF"), Some(Vec3::ONE));
        let grey = from_hex("#808080").expect("a colour");
        assert!((grey.x - 0.215_861).abs() < 1e-6, "{grey}");
        for bad in ["ff0000", "#ff00", "#ff00000", "#gg0000", "#+f0000", "#ä000"] {
            assert_eq!(from_hex(bad), None, "{bad}");
        }
    }

    #[test]
    fn suggestions_are_near_or_everything() {
        let known = ["eye", "target", "up", "fov"];
        assert_eq!(suggestion("traget", known.into_iter()), "did you mean 'target'?");
        assert_eq!(suggestion("Eye", known.into_iter()), "did you mean 'eye'?");
        assert_eq!(suggestion("aperture", known.into_iter()), "possible: eye, target, up, fov");
    }
}
