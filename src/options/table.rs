//! Every option of methods as data: what it is called, which structures read it, its values, and how to set them. The checks of
//! [`TraceOptions::validate`] and the table of what goes together ([`super::never_together`]) both read it.
//!
//! A new value is a line of its enum; a new option is a line of [`OPTIONS`].

use super::{
    Accel, Build, Decisions, Intersector, KernelFeatures, Kernels, Layout, Memory, NodeOrder, PacketSize, RayOrder,
    SplitAxis, Stop, Terminator, TextureFilter, TexturePass, TraceOptions, Traversal, TriangleOrder,
};
use std::fmt;

/// An enum of methods as data; the macro `methods` makes it.
#[derive(Debug)]
pub(crate) struct Names {
    /// The option, such as `--accel`.
    pub option: &'static str,
    /// Lines of the enum's documentation.
    pub doc: &'static [&'static str],
    /// Of each variant the name and the lines of its documentation.
    pub values: &'static [(&'static str, &'static [&'static str])],
}

impl Names {
    /// What variant number `index` is, for people.
    pub fn about(&self, index: usize) -> String {
        plain(self.values[index].1)
    }
}

/// An option that chooses a method or a number of one.
#[derive(Debug)]
pub struct MethodOption {
    /// As the user types it, such as `--accel`.
    pub name: &'static str,
    /// The structures that read it.
    pub structures: &'static [Accel],
    /// Its values; none for a number.
    names: Option<&'static Names>,
    set: fn(&mut TraceOptions, usize),
    is_set: fn(&TraceOptions) -> bool,
}

/// The row of an option that takes the names of an enum.
macro_rules! names {
    ($enum:ident, $($field:ident).+, $structures:expr) => {
        MethodOption {
            name: $enum::NAMES.option,
            structures: $structures,
            names: Some(&$enum::NAMES),
            set: |options, index| options.$($field).+ = $enum::ALL[index].into(),
            is_set: |options| options.$($field).+ != TraceOptions::DEFAULT.$($field).+,
        }
    };
}

/// The row of an option that takes a number; `$example` is within its limits.
macro_rules! number {
    ($name:literal, $($field:ident).+, $structures:expr, $example:expr) => {
        MethodOption {
            name: $name,
            structures: $structures,
            names: None,
            set: |options, _| options.$($field).+ = Some($example),
            is_set: |options| options.$($field).+ != TraceOptions::DEFAULT.$($field).+,
        }
    };
}

/// Structures in which every triangle has a place of its own.
const OWN_TRIANGLES: &[Accel] =
    &[Accel::Brute, Accel::Kd, Accel::Bvh2, Accel::Bvh8, Accel::Grid, Accel::Octree, Accel::Boxes, Accel::Spheres];

/// Every option of methods.
pub static OPTIONS: &[MethodOption] = &[
    names!(Accel, accel, Accel::ALL),
    number!("--grid-size", grid_size, &[Accel::Grid], [1, 1, 1]),
    names!(Build, build, &[Accel::Kd]),
    names!(Traversal, traversal, &[Accel::Kd]),
    number!("--stack-size", stack_size, &[Accel::Kd], 1),
    names!(PacketSize, packet_size, &[Accel::Kd, Accel::Bvh8]),
    names!(RayOrder, ray_order, Accel::ALL),
    names!(Intersector, intersector, Accel::ALL),
    number!(
        "--leaf-size",
        leaf_size,
        &[Accel::Kd, Accel::Bvh2, Accel::Bvh8, Accel::Instances, Accel::Octree, Accel::Boxes, Accel::Spheres],
        1
    ),
    number!("--max-depth", max_depth, &[Accel::Kd, Accel::Octree], 1),
    number!("--reinsert", reinsert, &[Accel::Bvh2, Accel::Bvh8, Accel::Instances], 1),
    number!("--spatial-splits", spatial_splits, &[Accel::Bvh2, Accel::Bvh8, Accel::Instances], 1.0),
    names!(SplitAxis, kd.split_axis, &[Accel::Kd]),
    number!("--sample-size", kd.sample_size, &[Accel::Kd], 1),
    names!(Stop, kd.stop, &[Accel::Kd]),
    number!("--cost-traverse", kd.cost_traverse, &[Accel::Kd, Accel::Bvh2, Accel::Bvh8, Accel::Instances], 1.0),
    number!("--cost-intersect", kd.cost_intersect, &[Accel::Kd, Accel::Bvh2, Accel::Bvh8, Accel::Instances], 1.0),
    number!("--empty-bonus", kd.empty_bonus, &[Accel::Kd], 1.0),
    number!("--similar-children", kd.similar_children, &[Accel::Kd], 1.0),
    names!(Memory, memory, Accel::ALL),
    names!(Layout, layout, OWN_TRIANGLES),
    names!(NodeOrder, node_order, &[Accel::Kd]),
    names!(TriangleOrder, triangles, OWN_TRIANGLES),
    names!(Kernels, kernels, Accel::ALL),
    names!(TexturePass, textures, Accel::ALL),
    names!(TextureFilter, texture_filter, Accel::ALL),
    names!(Decisions, decisions, Accel::ALL),
    names!(KernelFeatures, features, Accel::ALL),
    names!(Terminator, terminator, Accel::ALL),
    number!("--paths-in-flight", paths_in_flight, Accel::ALL, 1),
];

impl MethodOption {
    /// What the option chooses, for people; `None` for a number, which the help of the program explains.
    pub fn about(&self) -> Option<String> {
        self.names.map(|names| plain(names.doc))
    }

    /// Whether it takes a number instead of a name.
    pub fn is_number(&self) -> bool {
        self.names.is_none()
    }

    /// Its values; of a number one that is within its limits.
    pub fn choices(&'static self) -> impl Iterator<Item = Choice> {
        (0..self.names.map_or(1, |names| names.values.len())).map(move |index| Choice { option: self, index })
    }

    /// Whether `options` has another value than the default.
    pub fn is_set(&self, options: &TraceOptions) -> bool {
        (self.is_set)(options)
    }
}

/// An option with one of its values: a name, or, of a number, one that stands for all that are within its limits.
#[derive(Debug, Clone, Copy)]
pub struct Choice {
    option: &'static MethodOption,
    index: usize,
}

/// Every value of every option.
pub fn choices() -> impl Iterator<Item = Choice> {
    OPTIONS.iter().flat_map(MethodOption::choices)
}

impl Choice {
    /// The option.
    pub fn option(&self) -> &'static MethodOption {
        self.option
    }

    /// The value as the user types it; `None` for a number.
    pub fn name(&self) -> Option<&'static str> {
        self.option.names.map(|names| names.values[self.index].0)
    }

    /// What the value is, for people; `None` for a number.
    pub fn about(&self) -> Option<String> {
        self.option.names.map(|names| names.about(self.index))
    }

    /// Sets it in `options`, whether or not it goes together with the rest.
    pub fn set(&self, options: &mut TraceOptions) {
        (self.option.set)(options, self.index);
    }

    /// Whether it is what is used unless something else is asked for.
    pub fn is_default(&self) -> bool {
        let mut options = TraceOptions::DEFAULT;
        self.set(&mut options);
        options == TraceOptions::DEFAULT
    }
}

impl PartialEq for Choice {
    fn eq(&self, other: &Self) -> bool {
        self.option.name == other.option.name && self.index == other.index
    }
}

/// As the user types it, such as `--accel kd`; of a number the option alone.
impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.option.name)?;
        self.name().map_or(Ok(()), |name| write!(f, " {name}"))
    }
}

impl serde::Serialize for Choice {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The first paragraph of lines of documentation without Markdown's marks: a link's words stay, and of a path its last parts.
fn plain(doc: &[&str]) -> String {
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
            (&[" Only with [`Layout::Split`], see `--layout`."], "Only with Layout::Split, see --layout."),
            (&[" See [the book](https://example.com/a) and [`f`](x)."], "See the book and f."),
            (&[" The intervals [0, 1] and [0, 1) and", " `text`"], "The intervals [0, 1] and [0, 1) and text"),
            (&[""], ""),
            (&[], ""),
        ] {
            assert_eq!(plain(doc), expected);
        }
    }

    #[test]
    fn every_name_sets_its_value_and_the_defaults_are_those_of_the_options() {
        for &traversal in Traversal::ALL {
            let choice = choices().find(|c| c.to_string() == format!("--traversal {traversal}")).unwrap();
            let mut options = TraceOptions::DEFAULT;
            choice.set(&mut options);
            assert_eq!(options, TraceOptions { traversal, ..TraceOptions::DEFAULT });
            assert_eq!(choice.is_default(), traversal == TraceOptions::DEFAULT.traversal);
            assert_eq!(choice.option().is_set(&options), !choice.is_default());
            assert_eq!(choice.about().unwrap(), traversal.about());
        }
    }

    #[test]
    fn options_are_listed_once_and_numbers_are_within_their_limits() {
        for (i, option) in OPTIONS.iter().enumerate() {
            assert!(OPTIONS[..i].iter().all(|other| other.name != option.name), "{}", option.name);
            for choice in option.choices() {
                let mut options = TraceOptions::DEFAULT;
                choice.set(&mut options);
                assert!(choice.is_default() || option.is_set(&options), "{choice}");
                assert_eq!(choice.name().is_none(), option.is_number(), "{choice}");
            }
        }
    }
}
