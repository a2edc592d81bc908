//! Enums of things that people choose by name: each name is typed once, with its documentation, and everything else is
//! made of that.

/// Defines an enum of named things: `ALL`, `name`, `about` (the documentation, for people), `Display` and `FromStr`.
/// The word in parentheses names the option that takes the names. `= "new" or "old"`: the old name is still understood.
macro_rules! names {
    ($(#[doc = $doc:literal])* pub enum $enum:ident ($option:literal) {
        $($(#[doc = $variant_doc:literal])* $variant:ident = $name:literal $(or $old:literal)?,)+
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum $enum { $($(#[doc = $variant_doc])* $variant,)+ }

        impl $enum {
            /// The option that takes the names.
            pub const OPTION: &'static str = $option;

            /// The names and what they mean.
            pub(crate) const NAMES: $crate::names::Names = $crate::names::Names {
                doc: &[$($doc),*],
                values: &[$(($name, &[$($variant_doc),*])),+],
                old: &[$($(($old, $name),)?)+],
            };

            /// Every variant, in the order of the documentation.
            pub const ALL: &'static [$enum] = &[$($enum::$variant),+];

            /// The name as the user types it.
            pub fn name(self) -> &'static str {
                match self { $($enum::$variant => $name),+ }
            }

            /// What it is, for people: the first paragraph of its documentation, without marks and links.
            pub fn about(self) -> String {
                Self::NAMES.about(self as usize)
            }

            /// All names, for messages: "a, b, c".
            pub fn names() -> String {
                [$($name),+].join(", ")
            }
        }

        impl std::fmt::Display for $enum {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $enum {
            type Err = $crate::error::Error;

            fn from_str(text: &str) -> $crate::error::Result<Self> {
                Self::NAMES.find(text).map(|index| $enum::ALL[index]).ok_or_else(|| {
                    $crate::error::Error::option($option, format!("no '{text}'; possible: {}", $enum::names()))
                })
            }
        }
    };
}
pub(crate) use names;

/// The names of an enum, and what it and they are.
#[derive(Debug)]
pub(crate) struct Names {
    /// Documentation of the enum, line by line.
    pub doc: &'static [&'static str],
    /// Each name, and its documentation line by line.
    pub values: &'static [(&'static str, &'static [&'static str])],
    /// Names of earlier versions, and what they are called now.
    pub old: &'static [(&'static str, &'static str)],
}

impl Names {
    /// The number of the value that `text` names.
    pub fn find(&self, text: &str) -> Option<usize> {
        let name = self.old.iter().find(|(old, _)| *old == text).map_or(text, |&(_, new)| new);
        self.values.iter().position(|(value, _)| *value == name)
    }

    /// What a value is, for people.
    pub fn about(&self, index: usize) -> String {
        plain(self.values[index].1)
    }
}

/// Writes a value by its name.
pub(crate) fn as_name<T: std::fmt::Display, S: serde::Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

/// The first paragraph of lines of documentation without Markdown's marks: a link's words stay, and of a path its last
/// parts.
pub(crate) fn plain(doc: &[&str]) -> String {
    let lines: Vec<_> = doc.iter().map(|line| line.trim()).take_while(|line| !line.is_empty()).collect();
    let text = without_links(&lines.join(" "));
    let mut parts = text.split('`');
    let mut result = parts.next().unwrap_or_default().to_owned();
    while let Some(code) = parts.next() {
        // `crate::options::Layout::Split` is `Layout::Split` to people, who know no modules.
        let words: Vec<_> = code.split("::").skip_while(|part| part.starts_with(|c: char| c.is_lowercase())).collect();
        result += &if words.is_empty() { code.to_owned() } else { words.join("::") };
        result += parts.next().unwrap_or_default();
    }
    result
}

/// `[words](address)` becomes `words`, and code in brackets the code alone; other brackets stay.
fn without_links(text: &str) -> String {
    let mut result = String::new();
    let mut rest = text;
    while let Some((before, inside)) = rest.split_once('[') {
        let Some((words, after)) = inside.split_once(']') else { break };
        let address = after.strip_prefix('(').and_then(|address| address.split_once(')'));
        let is_link = address.is_some() || words.starts_with('`');
        result += before;
        result += &if is_link { words.to_owned() } else { format!("[{words}]") };
        rest = address.map_or(after, |(_, after)| after);
    }
    result + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documentation_becomes_plain_words() {
        for (doc, expected) in [
            (&[" One line."][..], "One line."),
            (&[" Two", " lines.", "", " Another paragraph."], "Two lines."),
            (&[" Fits into [`crate::pack::CONSTANT_BYTES`] bytes."], "Fits into CONSTANT_BYTES bytes."),
            (&[" Only with [`Layout::Split`], see `layout`."], "Only with Layout::Split, see layout."),
            (&[" See [the book](https://example.com/a) and [`f`](x)."], "See the book and f."),
            (&[" The intervals [0, 1] and [0, 1) and", " `text`"], "The intervals [0, 1] and [0, 1) and text"),
            (&[""], ""),
            (&[], ""),
        ] {
            assert_eq!(plain(doc), expected);
        }
    }
}
