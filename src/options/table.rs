//! Every option of methods, described once: command line, book, `raybrook methods` and tests are made of this table.

use super::{
    Build, Decisions, Intersector, KdOptions, KernelFeatures, Kernels, Layout, Memory, NodeOrder, PacketSize, RayOrder,
    SpatialSplits, SplitAxis, Stop, StructureKind, Terminator, TextureFilter, TexturePass, TraceOptions, Traversal,
    TriangleOrder,
};
use crate::error::{Error, Result};
use crate::names::{Names, plain};
use serde::ser::SerializeMap;
use std::fmt;

/// What an option belongs to: a heading of the help and of the book.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heading {
    /// What rays are traced through.
    Structure,
    /// Options of kd-trees alone.
    KdTree,
    /// Options of hierarchies of boxes alone.
    Boxes,
    /// How right answers are.
    Accuracy,
    /// How pictures look.
    Picture,
    /// How arrays lie on a device.
    DeviceMemory,
    /// What changes no answer and no pixel, and is there to be compared.
    Experiments,
}

impl Heading {
    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Heading::Structure => "Structure",
            Heading::KdTree => "kd-tree",
            Heading::Boxes => "Boxes",
            Heading::Accuracy => "Accuracy",
            Heading::Picture => "Picture",
            Heading::DeviceMemory => "Device memory",
            Heading::Experiments => "Experiments",
        }
    }
}

/// A value of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// One of the option's names, by its number.
    Name(usize),
    /// How many.
    Count(u32),
    /// A number.
    Number(f32),
    /// A number, or what leaves it to the builder.
    Splits(SpatialSplits),
    /// Numbers of cells along x, y, z.
    Cells([u32; 3]),
}

/// How an option gets at its field; `None` where the structure has no such field.
#[derive(Debug)]
enum Field {
    Name { names: &'static Names, get: fn(&TraceOptions) -> Option<usize>, set: fn(&mut TraceOptions, usize) -> bool },
    Count(NumberField<u32>),
    Number(NumberField<f32>),
    Splits(NumberField<SpatialSplits>),
    Cells(NumberField<[u32; 3]>),
}

#[derive(Debug)]
struct NumberField<T> {
    /// What it is, in a sentence or two.
    about: &'static str,
    /// What is taken where nothing is asked for.
    default: &'static str,
    /// A value that is within all limits.
    example: T,
    at: fn(&mut TraceOptions) -> Option<&mut Option<T>>,
}

impl<T: Copy> NumberField<T> {
    fn get(&self, options: &TraceOptions) -> Option<Option<T>> {
        (self.at)(&mut options.clone()).map(|value| *value)
    }

    fn set(&self, options: &mut TraceOptions, value: T) -> bool {
        (self.at)(options).map(|field| *field = Some(value)).is_some()
    }
}

/// An option that chooses a method or a number of one.
#[derive(Debug)]
pub struct MethodOption {
    /// The name of the field, such as `leaf_size`.
    pub name: &'static str,
    /// Where it stands in the help.
    pub heading: Heading,
    /// The structures that read it.
    pub structures: &'static [StructureKind],
    field: Field,
}

/// The row of an option that takes the names of an enum.
macro_rules! name {
    ($enum:ident, $heading:ident, $structures:expr, |$options:ident| $at:expr) => {
        MethodOption {
            name: $enum::OPTION,
            heading: Heading::$heading,
            structures: $structures,
            field: Field::Name {
                names: &$enum::NAMES,
                get: |options| {
                    let mut copy = *options;
                    let $options = &mut copy;
                    $at.map(|value: &mut $enum| *value as usize)
                },
                set: |$options, index| $at.map(|value: &mut $enum| *value = $enum::ALL[index]).is_some(),
            },
        }
    };
}

/// The row of an option that takes a number.
macro_rules! number {
    (
        $name:literal, $kind:ident, $heading:ident, $structures:expr, $at:expr, $example:expr, $about:literal,
        $default:literal
    ) => {
        MethodOption {
            name: $name,
            heading: Heading::$heading,
            structures: $structures,
            field: Field::$kind(NumberField { about: $about, default: $default, example: $example, at: $at }),
        }
    };
}

use StructureKind::{Boxes, Brute, Bvh2, Bvh8, Grid, Instances, Kd, Octree, Spheres};

/// Structures in which every triangle has a place of its own.
const OWN_TRIANGLES: &[StructureKind] = &[Brute, Kd, Bvh2, Bvh8, Grid, Octree, Boxes, Spheres];
const HIERARCHIES: &[StructureKind] = &[Bvh2, Bvh8, Instances];
const BY_COST: &[StructureKind] = &[Kd, Bvh2, Bvh8, Instances];
const ALL: &[StructureKind] = StructureKind::ALL;

/// Every option of methods.
pub static OPTIONS: &[MethodOption] = &[
    MethodOption {
        name: StructureKind::OPTION,
        heading: Heading::Structure,
        structures: ALL,
        field: Field::Name {
            names: &StructureKind::NAMES,
            get: |options| Some(options.kind() as usize),
            set: |options, index| {
                *options = options.with_structure(StructureKind::ALL[index]);
                true
            },
        },
    },
    number!(
        "grid_size",
        Cells,
        Structure,
        &[Grid],
        |o| o.structure.grid_size_mut(),
        [1, 1, 1],
        "Cells of the grid along x, y and z.",
        "nearly cubic ones, about 8 for each triangle"
    ),
    name!(Build, KdTree, &[Kd], |o| o.structure.kd_mut().map(|kd| &mut kd.build)),
    name!(Traversal, KdTree, &[Kd], |o| o.structure.kd_mut().map(|kd| &mut kd.traversal)),
    number!(
        "stack_size",
        Count,
        KdTree,
        &[Kd],
        |o| o.structure.kd_mut().map(|kd| &mut kd.stack_size),
        1,
        "Entries of the short stack, 1 to 60.",
        "8"
    ),
    name!(PacketSize, Experiments, &[Kd, Bvh8], |o| Some(&mut o.packet_size)),
    name!(RayOrder, Experiments, ALL, |o| Some(&mut o.ray_order)),
    name!(Intersector, Accuracy, ALL, |o| Some(&mut o.intersector)),
    number!(
        "leaf_size",
        Count,
        Structure,
        &[Kd, Bvh2, Bvh8, Instances, Octree, Boxes, Spheres],
        |o| o.structure.leaf_size_mut(),
        1,
        "Triangles up to which a node is not split; the most of a leaf of boxes (bvh2: 15, bvh8: 8), or of a cluster.",
        "kd: 1 where the cost decides, else 12 for median and sampled-median, 8 for spatial-median, 4 for sah and \
         volume; octree, bvh2, bvh8: 8; clusters: the square root of the triangles"
    ),
    number!(
        "max_depth",
        Count,
        Structure,
        &[Kd, Octree],
        |o| o.structure.max_depth_mut(),
        1,
        "Depth that no leaf goes beyond, at most 60; the root is 0.",
        "kd: 8 + 1.3 log2(triangles); octree: 4 + 0.5 log2(triangles)"
    ),
    number!(
        "reinsert",
        Count,
        Boxes,
        HIERARCHIES,
        |o| o.structure.bvh_mut().map(|bvh| &mut bvh.reinsert),
        1,
        "Passes over the finished hierarchy, each of which moves large subtrees to where they fit better; 0: none.",
        "5"
    ),
    number!(
        "spatial_splits",
        Splits,
        Boxes,
        HIERARCHIES,
        |o| o.structure.bvh_mut().map(|bvh| &mut bvh.spatial_splits),
        SpatialSplits::Share(1.0),
        "Cut long and large triangles, which makes up to so many more references per triangle, 0 to 4; 0: none; auto: \
         1 where the expected cost says that it pays, else 0; both are built, in three to five times the time.",
        "0"
    ),
    name!(SplitAxis, KdTree, &[Kd], |o| o.structure.kd_mut().map(|kd| &mut kd.split_axis)),
    number!(
        "sample_size",
        Count,
        KdTree,
        &[Kd],
        |o| o.structure.kd_mut().map(|kd| &mut kd.sample_size),
        1,
        "Triangles that the sampled median is taken of.",
        "100"
    ),
    MethodOption {
        name: Stop::OPTION,
        heading: Heading::KdTree,
        structures: &[Kd],
        field: Field::Name {
            names: &Stop::NAMES,
            get: |options| match options.structure {
                super::Structure::Kd(KdOptions { stop: Some(stop), .. }) => Some(stop as usize),
                _ => None,
            },
            set: |options, index| options.structure.kd_mut().map(|kd| kd.stop = Some(Stop::ALL[index])).is_some(),
        },
    },
    number!(
        "cost_traverse",
        Number,
        Structure,
        BY_COST,
        |o| o.structure.cost_traverse_mut(),
        1.0,
        "Cost of a step through the structure, where planes or stops go by cost.",
        "1; 10 through kd in packets of rays"
    ),
    number!(
        "cost_intersect",
        Number,
        Structure,
        BY_COST,
        |o| o.structure.cost_intersect_mut(),
        1.0,
        "Cost of a triangle test, where planes or stops go by cost.",
        "1; less in bvh8, which tests eight at once"
    ),
    number!(
        "empty_bonus",
        Number,
        KdTree,
        &[Kd],
        |o| o.structure.kd_mut().map(|kd| &mut kd.empty_bonus),
        1.0,
        "Part of its cost that a split with an empty side is spared, 0 to 1.",
        "0.1"
    ),
    number!(
        "similar_children",
        Number,
        KdTree,
        &[Kd],
        |o| o.structure.kd_mut().map(|kd| &mut kd.similar_children),
        1.0,
        "Refuse splits whose children both keep more than this share of the triangles, 0 to 1.",
        "0.95 for the median builds, 1 for sah and volume"
    ),
    name!(Memory, DeviceMemory, ALL, |o| Some(&mut o.arrays.memory)),
    name!(Layout, DeviceMemory, OWN_TRIANGLES, |o| Some(&mut o.arrays.layout)),
    name!(NodeOrder, DeviceMemory, &[Kd], |o| o.structure.kd_mut().map(|kd| &mut kd.node_order)),
    name!(TriangleOrder, DeviceMemory, OWN_TRIANGLES, |o| Some(&mut o.arrays.triangles)),
    name!(Kernels, Experiments, ALL, |o| Some(&mut o.picture.kernels)),
    name!(TexturePass, Experiments, ALL, |o| Some(&mut o.picture.textures)),
    name!(TextureFilter, Picture, ALL, |o| Some(&mut o.picture.texture_filter)),
    name!(Decisions, Experiments, ALL, |o| Some(&mut o.picture.decisions)),
    name!(KernelFeatures, Experiments, ALL, |o| Some(&mut o.picture.features)),
    name!(Terminator, Picture, ALL, |o| Some(&mut o.picture.terminator)),
    number!(
        "roulette",
        Number,
        Picture,
        ALL,
        |o| Some(&mut o.picture.roulette),
        0.5,
        "Russian roulette: of the mirrored and refracted rays of less weight than this, kill some at random: one of \
         weight w is cast with a probability of w / this, and then weighs this, so that the picture is right on \
         average, with noise. At most 1; 0: none.",
        "0"
    ),
    number!(
        "paths_in_flight",
        Count,
        Experiments,
        ALL,
        |o| Some(&mut o.picture.paths_in_flight),
        1,
        "Paths (samples of pixels) that the wavefront kernels follow at a time.",
        "as many as fit into 256 MiB"
    ),
];

impl MethodOption {
    /// The option of this name.
    pub fn find(name: &str) -> Option<&'static MethodOption> {
        OPTIONS.iter().find(|option| option.name == name)
    }

    /// What the option chooses, for people.
    pub fn about(&self) -> String {
        match &self.field {
            Field::Name { names, .. } => plain(names.doc),
            Field::Count(NumberField { about, .. })
            | Field::Number(NumberField { about, .. })
            | Field::Splits(NumberField { about, .. })
            | Field::Cells(NumberField { about, .. }) => (*about).to_owned(),
        }
    }

    /// What is taken where nothing is asked for, for people.
    pub fn default_words(&self) -> String {
        match &self.field {
            Field::Name { .. } if self.name == StructureKind::OPTION => "auto".to_owned(),
            Field::Name { names, get, .. } => match get(&TraceOptions::of(self.structures[0])) {
                Some(index) => names.values[index].0.to_owned(),
                None => "cost for sah and volume, size for the median builds".to_owned(),
            },
            Field::Count(NumberField { default, .. })
            | Field::Number(NumberField { default, .. })
            | Field::Splits(NumberField { default, .. })
            | Field::Cells(NumberField { default, .. }) => (*default).to_owned(),
        }
    }

    /// What stands for its value in the help.
    pub fn value_name(&self) -> &'static str {
        match self.field {
            Field::Name { .. } => "NAME",
            Field::Count(_) => "N",
            Field::Number(_) => "X",
            Field::Splits(_) => "X|auto",
            Field::Cells(_) => "X,Y,Z",
        }
    }

    fn names(&self) -> Option<&'static Names> {
        if let Field::Name { names, .. } = self.field { Some(names) } else { None }
    }

    /// Whether it takes a number instead of a name.
    pub fn is_number(&self) -> bool {
        self.names().is_none()
    }

    /// Its values; of a number one that is within its limits.
    pub fn choices(&'static self) -> impl Iterator<Item = Choice> {
        let values: Vec<Value> = match &self.field {
            Field::Name { names, .. } => (0..names.values.len()).map(Value::Name).collect(),
            Field::Count(field) => vec![Value::Count(field.example)],
            Field::Number(field) => vec![Value::Number(field.example)],
            Field::Splits(field) => vec![Value::Splits(field.example)],
            Field::Cells(field) => vec![Value::Cells(field.example)],
        };
        values.into_iter().map(move |value| Choice { option: self, value })
    }

    /// The value that `text` means.
    ///
    /// # Errors
    /// [`Error::Option`] tells what is possible. Whether a number is within its limits [`TraceOptions::validate`]
    /// tells.
    pub fn parse(&'static self, text: &str) -> Result<Choice> {
        let wrong = |words: &str| Error::option(self.name, format!("'{text}' is not {words}"));
        let value = match &self.field {
            Field::Name { names, .. } => names.find(text).map(Value::Name).ok_or_else(|| {
                let all: Vec<_> = names.values.iter().map(|(name, _)| *name).collect();
                Error::option(self.name, format!("no '{text}'; possible: {}", all.join(", ")))
            })?,
            Field::Count(_) => Value::Count(text.parse().map_err(|_| wrong("a number of 0, 1, 2, ..."))?),
            Field::Number(_) => Value::Number(text.parse().map_err(|_| wrong("a number"))?),
            Field::Splits(_) => Value::Splits(text.parse()?),
            Field::Cells(_) => {
                let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
                let cells = numbers.and_then(|numbers| <[u32; 3]>::try_from(numbers).ok());
                Value::Cells(cells.ok_or_else(|| wrong("three numbers of cells, such as 32,32,16"))?)
            }
        };
        Ok(Choice { option: self, value })
    }

    /// The value in `options`: `None` where their structure has no such option, `Some(None)` where it is left to the
    /// build.
    pub fn value(&self, options: &TraceOptions) -> Option<Option<Value>> {
        let value = self.value_of_field(options);
        (value.is_some() || self.structures.contains(&options.kind())).then_some(value)
    }

    /// Its value in `options` as a choice; `None` where they have no such option, or leave it to the build.
    pub fn choice_in(&'static self, options: &TraceOptions) -> Option<Choice> {
        self.value_of_field(options).map(|value| Choice { option: self, value })
    }

    fn value_of_field(&self, options: &TraceOptions) -> Option<Value> {
        match &self.field {
            Field::Name { get, .. } => get(options).map(Value::Name),
            Field::Count(field) => field.get(options).flatten().map(Value::Count),
            Field::Number(field) => field.get(options).flatten().map(Value::Number),
            Field::Splits(field) => field.get(options).flatten().map(Value::Splits),
            Field::Cells(field) => field.get(options).flatten().map(Value::Cells),
        }
    }

    /// Whether `options` has another value than the default.
    pub fn is_set(&self, options: &TraceOptions) -> bool {
        if self.name == StructureKind::OPTION {
            return options.kind() != TraceOptions::DEFAULT.kind();
        }
        let default = self.value_of_field(&TraceOptions::of(options.kind()));
        self.value_of_field(options) != default
    }

    /// Why the option cannot be set for a structure that does not read it.
    pub(crate) fn means_nothing_to(&self, kind: StructureKind) -> Error {
        let others: Vec<_> = self.structures.iter().map(|kind| format!("`structure = {kind}`")).collect();
        // The limits that octrees have, too, are what a grid has its number of cells for.
        let nearest = match kind {
            Grid if self.structures.contains(&Octree) => "; a grid's cells are set by `grid_size = X,Y,Z`",
            _ => "",
        };
        let message =
            format!("means nothing to `structure = {kind}`; leave it out, or take {}{nearest}", others.join(" or "));
        Error::option(self.name, message)
    }

    pub(super) fn serialize_value<M: SerializeMap>(
        &self,
        map: &mut M,
        key: &str,
        value: Value,
    ) -> std::result::Result<(), M::Error> {
        match (value, self.names()) {
            (Value::Name(index), Some(names)) => map.serialize_entry(key, names.values[index].0),
            (Value::Name(_), None) => Ok(()),
            (Value::Count(count), _) => map.serialize_entry(key, &count),
            (Value::Number(number), _) => map.serialize_entry(key, &number),
            (Value::Splits(splits), _) => map.serialize_entry(key, &splits),
            (Value::Cells(cells), _) => map.serialize_entry(key, &cells),
        }
    }
}

/// An option with one of its values.
#[derive(Debug, Clone, Copy)]
pub struct Choice {
    option: &'static MethodOption,
    value: Value,
}

/// Every value of every option; of a number one that stands for all that are within its limits.
pub fn choices() -> impl Iterator<Item = Choice> {
    OPTIONS.iter().flat_map(MethodOption::choices)
}

impl Choice {
    /// The option.
    pub fn option(&self) -> &'static MethodOption {
        self.option
    }

    /// The value.
    pub fn value(&self) -> Value {
        self.value
    }

    /// The value as the user types it; `None` for a number.
    pub fn name(&self) -> Option<&'static str> {
        match (self.value, self.option.names()) {
            (Value::Name(index), Some(names)) => Some(names.values[index].0),
            _ => None,
        }
    }

    /// What the value is, for people; `None` for a number.
    pub fn about(&self) -> Option<String> {
        match (self.value, self.option.names()) {
            (Value::Name(index), Some(names)) => Some(names.about(index)),
            _ => None,
        }
    }

    /// Sets it in `options`, whether or not it goes together with the rest.
    ///
    /// # Errors
    /// [`Error::Option`]: the structure of `options` does not read it, and it is not the default.
    pub fn set(&self, options: &mut TraceOptions) -> Result<()> {
        let is_set = self.option.structures.contains(&options.kind())
            && match (&self.option.field, self.value) {
                (Field::Name { set, .. }, Value::Name(index)) => set(options, index),
                (Field::Count(field), Value::Count(count)) => field.set(options, count),
                (Field::Number(field), Value::Number(number)) => field.set(options, number),
                (Field::Splits(field), Value::Splits(splits)) => field.set(options, splits),
                (Field::Cells(field), Value::Cells(cells)) => field.set(options, cells),
                _ => false,
            };
        if is_set || self.is_default() { Ok(()) } else { Err(self.option.means_nothing_to(options.kind())) }
    }

    /// Whether it is what is used unless something else is asked for.
    pub fn is_default(&self) -> bool {
        let options = match self.option.name {
            StructureKind::OPTION => TraceOptions::DEFAULT,
            _ => TraceOptions::of(self.option.structures[0]),
        };
        self.option.value_of_field(&options) == Some(self.value)
    }
}

impl PartialEq for Choice {
    fn eq(&self, other: &Self) -> bool {
        self.option.name == other.option.name && self.value == other.value
    }
}

/// `structure = kd`, as messages have it; of a number its value, too.
impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = ", self.option.name)?;
        match self.value {
            Value::Name(_) => f.write_str(self.name().unwrap_or_default()),
            Value::Count(count) => write!(f, "{count}"),
            Value::Number(number) => write!(f, "{number}"),
            Value::Splits(splits) => write!(f, "{splits}"),
            Value::Cells([x, y, z]) => write!(f, "{x},{y},{z}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Structure;

    #[test]
    fn every_name_sets_its_value_and_the_defaults_are_those_of_the_options() {
        for &traversal in Traversal::ALL {
            let choice = choices().find(|c| c.to_string() == format!("traversal = {traversal}")).unwrap();
            let mut options = TraceOptions::DEFAULT;
            choice.set(&mut options).unwrap();
            let kd = KdOptions { traversal, ..KdOptions::DEFAULT };
            assert_eq!(options, TraceOptions { structure: Structure::Kd(kd), ..TraceOptions::DEFAULT });
            assert_eq!(choice.is_default(), traversal == KdOptions::DEFAULT.traversal);
            assert_eq!(choice.option().is_set(&options), !choice.is_default());
            assert_eq!(choice.about().unwrap(), traversal.about());
        }
        let defaults: Vec<_> = choices().filter(Choice::is_default).map(|choice| choice.option().name).collect();
        let named: Vec<_> = OPTIONS.iter().filter(|option| !option.is_number()).map(|option| option.name).collect();
        // What makes a leaf depends on the build.
        assert_eq!(defaults, named.into_iter().filter(|name| *name != Stop::OPTION).collect::<Vec<_>>());
    }

    /// The list of structures is what the fields say, and what is set can be read and written again.
    #[test]
    fn options_are_listed_once_and_reach_their_fields() {
        for (i, option) in OPTIONS.iter().enumerate() {
            assert!(OPTIONS[..i].iter().all(|other| other.name != option.name), "{}", option.name);
            assert!(!option.about().is_empty() && !option.default_words().is_empty(), "{}", option.name);
            for choice in option.choices() {
                for &kind in StructureKind::ALL {
                    let mut options = TraceOptions::of(kind);
                    let done = choice.set(&mut options);
                    let is_read = option.structures.contains(&kind);
                    assert_eq!(done.is_ok(), is_read || choice.is_default(), "{choice} for {kind}");
                    if !is_read {
                        assert_eq!(options, TraceOptions::of(kind));
                        continue;
                    }
                    assert!(choice.is_default() || option.is_set(&options), "{choice}");
                    assert_eq!(option.value(&options), Some(Some(choice.value())), "{choice}");
                    let text = choice.to_string().split_once(" = ").unwrap().1.to_owned();
                    assert_eq!(option.parse(&text).unwrap(), choice);
                }
                assert_eq!(choice.name().is_none(), option.is_number(), "{choice}");
            }
        }
    }

    #[test]
    fn what_is_no_value_is_told_with_what_is() {
        for (option, text, words) in [
            ("structure", "tree", "no 'tree'; possible: brute, kd"),
            ("leaf_size", "-1", "'-1' is not a number of 0"),
            ("empty_bonus", "much", "'much' is not a number"),
            ("spatial_splits", "much", "'much' is not a number from 0 to 4, or `auto`"),
            ("grid_size", "1,2", "three numbers of cells"),
        ] {
            let message = MethodOption::find(option).unwrap().parse(text).unwrap_err().to_string();
            assert!(message.contains(option) && message.contains(words), "{message}");
        }
        let splits = MethodOption::find("spatial_splits").unwrap();
        for (text, value) in [("auto", SpatialSplits::Auto), ("0.5", SpatialSplits::Share(0.5))] {
            let choice = splits.parse(text).unwrap();
            assert_eq!(
                (choice.value(), choice.to_string()),
                (Value::Splits(value), format!("spatial_splits = {text}"))
            );
        }
        let old = MethodOption::find("kernels").unwrap().parse("split").unwrap();
        assert_eq!(old.name(), Some("wavefront"), "the name of an earlier version");
    }
}
