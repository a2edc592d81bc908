//! The values of PLY rows in memory, one after the other, binary and text.

use crate::scene::text::number;
use memchr::memchr;
use serde_ply::{PlyProperty, PropertyType, ScalarType};

/// Values that are taken from the front. None means that there is no such value.
pub(super) trait Values: Clone + Send {
    /// Whether nothing is left.
    fn is_empty(&self) -> bool;

    /// Steps over rows of `properties`.
    fn skip_rows(&mut self, properties: &[PlyProperty], rows: usize) -> Option<()>;

    /// Begins a row, of those that were stepped over before.
    fn begin_row(&mut self);

    /// Ends it; false if there was something beside it.
    fn end_row(&mut self) -> bool;

    /// A number of type `kind` as float32.
    fn number(&mut self, kind: ScalarType) -> Option<f32>;

    /// A whole number of type `kind`; none for floats.
    fn integer(&mut self, kind: ScalarType) -> Option<i64>;

    /// How long a list is.
    fn count(&mut self, kind: ScalarType) -> Option<usize> {
        self.integer(kind).and_then(|count| usize::try_from(count).ok())
    }
}

/// Binary data, big-endian or not.
#[derive(Clone)]
pub(super) struct Binary<'a, const BIG: bool>(pub &'a [u8]);

impl<const BIG: bool> Binary<'_, BIG> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        let mut bytes = *bytes;
        if BIG {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn skip(&mut self, bytes: usize) -> Option<()> {
        self.0 = self.0.get(bytes..)?;
        Some(())
    }
}

/// Bytes of a number of type `kind`.
fn size(kind: ScalarType) -> usize {
    match kind {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::F64 => 8,
    }
}

/// Bytes of a row of `properties`, unless it has a list.
fn row_size(properties: &[PlyProperty]) -> Option<usize> {
    let sizes = properties.iter().map(|property| match property.property_type {
        PropertyType::Scalar(kind) => Some(size(kind)),
        PropertyType::List { .. } => None,
    });
    sizes.sum()
}

impl<const BIG: bool> Values for Binary<'_, BIG> {
    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn skip_rows(&mut self, properties: &[PlyProperty], rows: usize) -> Option<()> {
        if let Some(size) = row_size(properties) {
            return self.skip(rows.checked_mul(size)?);
        }
        for _ in 0..rows {
            for property in properties {
                match property.property_type {
                    PropertyType::Scalar(kind) => self.skip(size(kind))?,
                    PropertyType::List { count_type, data_type } => {
                        let count = self.count(count_type)?;
                        self.skip(count.checked_mul(size(data_type))?)?;
                    }
                }
            }
        }
        Some(())
    }

    fn begin_row(&mut self) {}

    fn end_row(&mut self) -> bool {
        true
    }

    fn number(&mut self, kind: ScalarType) -> Option<f32> {
        match kind {
            ScalarType::F32 => self.take().map(f32::from_le_bytes),
            ScalarType::F64 => self.take().map(|bytes| f64::from_le_bytes(bytes) as f32),
            _ => self.integer(kind).map(|integer| integer as f32),
        }
    }

    fn integer(&mut self, kind: ScalarType) -> Option<i64> {
        match kind {
            ScalarType::I8 => self.take().map(|bytes| i8::from_le_bytes(bytes).into()),
            ScalarType::U8 => self.take().map(|bytes| u8::from_le_bytes(bytes).into()),
            ScalarType::I16 => self.take().map(|bytes| i16::from_le_bytes(bytes).into()),
            ScalarType::U16 => self.take().map(|bytes| u16::from_le_bytes(bytes).into()),
            ScalarType::I32 => self.take().map(|bytes| i32::from_le_bytes(bytes).into()),
            ScalarType::U32 => self.take().map(|bytes| u32::from_le_bytes(bytes).into()),
            ScalarType::F32 | ScalarType::F64 => None,
        }
    }
}

/// A text of one row a line.
#[derive(Clone)]
pub(super) struct Text<'a> {
    /// What follows the line in hand.
    rest: &'a [u8],
    /// What is left of the line in hand.
    line: &'a [u8],
    line_end: u8,
}

impl<'a> Text<'a> {
    /// The rows of `rest`, whose lines end with `line_end`.
    pub fn new(rest: &'a [u8], line_end: u8) -> Self {
        Text { rest, line: &[], line_end }
    }

    /// Goes to the next line that is not empty; to an empty one at the end.
    fn next_line(&mut self) {
        self.line = &[];
        while self.line.is_empty() && !self.rest.is_empty() {
            let end = memchr(self.line_end, self.rest).unwrap_or(self.rest.len());
            self.line = self.rest[..end].trim_ascii();
            self.rest = self.rest.get(end + 1..).unwrap_or_default();
        }
    }

    fn word(&mut self) -> Option<&'a [u8]> {
        let line = self.line.trim_ascii_start();
        let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
        let (word, rest) = line.split_at(end);
        self.line = rest;
        (!word.is_empty()).then_some(word)
    }
}

impl Values for Text<'_> {
    fn is_empty(&self) -> bool {
        self.rest.trim_ascii().is_empty()
    }

    fn skip_rows(&mut self, _: &[PlyProperty], rows: usize) -> Option<()> {
        for _ in 0..rows {
            self.next_line();
        }
        (!self.line.is_empty()).then_some(())
    }

    fn begin_row(&mut self) {
        self.next_line();
    }

    fn end_row(&mut self) -> bool {
        self.line.trim_ascii_start().is_empty()
    }

    fn number(&mut self, kind: ScalarType) -> Option<f32> {
        match kind {
            ScalarType::F32 => number(self.word()?),
            ScalarType::F64 => number::<f64>(self.word()?).map(|number| number as f32),
            _ => self.integer(kind).map(|integer| integer as f32),
        }
    }

    fn integer(&mut self, kind: ScalarType) -> Option<i64> {
        let word = self.word()?;
        let range = match kind {
            ScalarType::I8 => i8::MIN.into()..=i8::MAX.into(),
            ScalarType::U8 => 0..=u8::MAX.into(),
            ScalarType::I16 => i16::MIN.into()..=i16::MAX.into(),
            ScalarType::U16 => 0..=u16::MAX.into(),
            ScalarType::I32 => i32::MIN.into()..=i32::MAX.into(),
            ScalarType::U32 => 0..=u32::MAX.into(),
            ScalarType::F32 | ScalarType::F64 => return None,
        };
        let is_allowed = *range.start() < 0 || !word.starts_with(b"-"); // "-0" is no unsigned number
        crate::scene::text::integer(word).filter(|integer| is_allowed && range.contains(integer))
    }
}
