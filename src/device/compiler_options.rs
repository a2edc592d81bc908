//! Options that the user hands to the device's compiler beside our own, such as `-cl-mad-enable`.

use super::{DeviceContext, DeviceHandle};
use crate::error::{Error, Result};

/// The option of the command line, for messages.
const OPTION: &str = "compiler_options";

impl DeviceHandle {
    /// The same device, whose compiler gets `options`, separated by white space, beside those of raybrook and behind
    /// them. They are part of what a cached program is known by.
    ///
    /// The kernels protect their arithmetic against options that relax it (`cl/shared/compiler.cl`). What an option
    /// does to a driver beyond that is the driver's business.
    ///
    /// # Errors
    /// [`Error::Option`] names what is no option. Whether the compiler knows an option turns out when it builds.
    pub fn with_compiler_options(mut self, options: &str) -> Result<Self> {
        if let Some(word) = options.split_whitespace().next().filter(|word| !word.starts_with('-')) {
            return Err(Error::option(OPTION, format!("'{word}' is no option of a compiler, which begins with '-'")));
        }
        if let Some(c) = options.chars().find(|c| c.is_control() && !c.is_whitespace()) {
            return Err(Error::option(OPTION, format!("no compiler takes the character {c:?}")));
        }
        let words: Vec<_> = options.split_whitespace().collect();
        self.compiler_options = words.join(" ");
        Ok(self)
    }

    /// What [`DeviceHandle::with_compiler_options`] was given; usually empty.
    pub fn compiler_options(&self) -> &str {
        &self.compiler_options
    }
}

/// The options with what belongs to each: `-D NAME` is one.
fn split_options(options: &str) -> Vec<String> {
    let mut split: Vec<String> = Vec::new();
    for word in options.split(' ').filter(|word| !word.is_empty()) {
        match split.last_mut() {
            Some(last) if !word.starts_with('-') => *last += &format!(" {word}"),
            _ => split.push(word.to_owned()),
        }
    }
    split
}

/// The first of the user's options that the compiler refuses; `refusal` is what it says against one.
pub(super) fn find_refused(context: &DeviceContext, refusal: impl Fn(&str) -> Option<String>) -> Option<Error> {
    let refused = |option: &String| Some((option.clone(), refusal(option)?));
    let (option, said) = split_options(&context.0.compiler_options).iter().find_map(refused)?;
    let device = &context.info().name;
    Some(Error::option(OPTION, format!("the compiler of device '{device}' refuses '{option}': {said}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_option_keeps_what_belongs_to_it() {
        assert_eq!(split_options("-w -D A=1 -I a b -cl-x"), ["-w", "-D A=1", "-I a b", "-cl-x"]);
        assert!(split_options("").is_empty());
    }
}
