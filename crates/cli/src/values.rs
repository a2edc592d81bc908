//! Values that have names: shells complete them.

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Arg, Command, Error};
use std::ffi::OsStr;

/// Parses a value with `parse`, which says itself what is wrong and may know values without names, too.
#[derive(Clone)]
pub struct Named<P> {
    names: Vec<PossibleValue>,
    parse: P,
}

impl<P> Named<P> {
    pub fn new(names: impl IntoIterator<Item = impl Into<PossibleValue>>, parse: P) -> Named<P> {
        Named { names: names.into_iter().map(Into::into).collect(), parse }
    }
}

impl<P: TypedValueParser> TypedValueParser for Named<P> {
    type Value = P::Value;

    fn parse_ref(&self, command: &Command, argument: Option<&Arg>, value: &OsStr) -> Result<P::Value, Error> {
        self.parse.parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.names.iter().cloned()))
    }
}
