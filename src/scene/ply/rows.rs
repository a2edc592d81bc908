//! Streams the rows of a PLY element through serde, without a copy of the element in between.
//!
//! `serde-ply` gives a row as a map from property to value, in the header's order. Here the name is read over and the
//! property's number counts, so that nothing is looked up by name once the header is read.

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::cell::Cell;
use std::fmt;

/// Takes the rows of one element.
pub(super) trait Sink {
    /// Takes the value of property number `property` from `row`.
    fn property<'de, A: MapAccess<'de>>(&mut self, property: usize, row: &mut A) -> Result<(), A::Error>;

    /// Ends a row whose properties were all taken; a fault says what is wrong with it.
    fn end_row(&mut self) -> Result<(), String>;
}

/// Reads over an element.
pub(super) struct Skip;

impl Sink for Skip {
    fn property<'de, A: MapAccess<'de>>(&mut self, _: usize, row: &mut A) -> Result<(), A::Error> {
        row.next_value::<IgnoredAny>().map(|_| ())
    }

    fn end_row(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// An element to be read into `sink`.
pub(super) struct Element<'a, S> {
    /// How many properties it has.
    pub properties: usize,
    /// Where its rows go.
    pub sink: &'a mut S,
    /// Counts its complete rows.
    pub rows: &'a Cell<usize>,
    /// Told when a row is complete.
    pub row_ended: &'a Cell<bool>,
}

impl<'de, S: Sink> DeserializeSeed<'de> for Element<'_, S> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, S: Sink> Visitor<'de> for Element<'_, S> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        if self.properties == 0 {
            return Ok(()); // its rows take no bytes: a header can promise any number of them
        }
        while rows.next_element_seed(Row { properties: self.properties, sink: &mut *self.sink })?.is_some() {
            self.sink.end_row().map_err(Error::custom)?;
            self.row_ended.set(true);
            self.rows.set(self.rows.get() + 1);
        }
        Ok(())
    }
}

/// A row to be read into `sink`.
struct Row<'a, S> {
    properties: usize,
    sink: &'a mut S,
}

impl<'de, S: Sink> DeserializeSeed<'de> for Row<'_, S> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de, S: Sink> Visitor<'de> for Row<'_, S> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a row")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut row: A) -> Result<(), A::Error> {
        for property in 0..self.properties {
            row.next_key::<IgnoredAny>()?;
            self.sink.property(property, &mut row)?;
        }
        Ok(())
    }
}
