//! Which combinations there are, from the table of options and its checks.

use raybrook::low_level::options::{
    Choice, Decisions, Intersector, KdOptions, MethodOption, OPTIONS, PictureOptions, RayOrder, SplitAxis, Stop,
    Structure, StructureKind, Terminator, TextureFilter, TexturePass, TraceOptions, combine, fewest_changes,
};
use std::collections::HashSet;

/// Options that refine a method: in the spread, but not in the product.
const REFINEMENTS: [&str; 6] =
    [RayOrder::OPTION, SplitAxis::OPTION, Stop::OPTION, TexturePass::OPTION, TextureFilter::OPTION, Terminator::OPTION];

/// Whether brute force with the same triangle test must have the same hits.
fn is_right(options: &TraceOptions) -> bool {
    options.validate().is_ok() && options.kd().traversal.is_exact() && is_robust_enough(options.intersector)
}

/// Whether a triangle test's hits in these models do not depend on the structure: see the head of the test.
pub fn is_robust_enough(intersector: Intersector) -> bool {
    intersector.is_robust() || intersector == Intersector::Plucker
}

/// The defaults with `choices`, which go together.
fn combined<'a>(choices: impl IntoIterator<Item = &'a Choice>) -> TraceOptions {
    combine(&choices.into_iter().copied().collect::<Vec<_>>()).unwrap()
}

/// Whether anything here could differ by it: pictures have fixed samples, those by their error are in
/// `tests/pictures/adaptive.rs`.
pub fn is_read(choice: &Choice) -> bool {
    choice.option().name != Decisions::OPTION || choice.is_default()
}

/// Values of an option that may be right; `None`, the option left out, where that is not one of them.
fn values(option: &'static MethodOption) -> Vec<Option<Choice>> {
    let may_be_right = |choice: &Choice| {
        let needs = fewest_changes(&[*choice]).expect("every value goes together with something");
        is_right(&combined(needs.iter().chain([choice])))
    };
    let is_other = !option.choices().any(|choice| choice.is_default());
    is_other
        .then_some(None)
        .into_iter()
        .chain(option.choices().filter(is_read).filter(may_be_right).map(Some))
        .collect()
}

/// Every right combination of all values of all methods.
pub fn product() -> Vec<TraceOptions> {
    let is_method = |option: &&MethodOption| !option.is_number() && !REFINEMENTS.contains(&option.name);
    let mut all = vec![TraceOptions::DEFAULT];
    for option in OPTIONS.iter().filter(is_method) {
        let values = values(option);
        let with = |options: &TraceOptions, value: &Option<Choice>| {
            let mut options = *options;
            value.iter().all(|choice| choice.set(&mut options).is_ok()).then_some(options)
        };
        all = all
            .iter()
            .flat_map(|options| values.iter().filter_map(|value| with(options, value)).collect::<Vec<_>>())
            .collect();
    }
    all.retain(is_right);
    all
}

/// A value of an option, by their numbers in the table of axes.
type Value = (usize, usize);

/// The axes of a spread, and which pairs of their values no combination has yet.
struct Pairs {
    axes: Vec<Vec<Option<Choice>>>,
    missing: HashSet<[Value; 2]>,
}

/// A value of each axis.
type Row = Vec<usize>;

impl Pairs {
    /// All pairs that go together of which `is_wanted` holds, given the options of both.
    fn new(is_wanted: impl Fn([&str; 2]) -> bool) -> Pairs {
        let axes: Vec<_> = OPTIONS.iter().map(values).collect();
        let mut missing = HashSet::new();
        let all = || axes.iter().enumerate().flat_map(|(a, values)| (0..values.len()).map(move |i| (a, i)));
        for first in all() {
            for second in all().filter(|second| second.0 > first.0) {
                let (Some(a), Some(b)) = (axes[first.0][first.1], axes[second.0][second.1]) else { continue };
                if is_wanted([a, b].map(|choice| choice.option().name)) && go_together(a, b) {
                    missing.insert([first, second]);
                }
            }
        }
        Pairs { axes, missing }
    }

    fn choices<'a>(&'a self, row: &'a Row) -> impl Iterator<Item = Choice> + 'a {
        row.iter().enumerate().filter_map(|(axis, &i)| self.axes[axis][i])
    }

    /// `None` where they do not go together.
    fn options(&self, row: &Row) -> Option<TraceOptions> {
        combine(&self.choices(row).collect::<Vec<_>>()).ok()
    }

    fn is_right(&self, row: &Row) -> bool {
        self.options(row).is_some_and(|options| is_right(&options))
    }

    /// The structure, whether or not it goes together with the rest.
    fn kind(&self, row: &Row) -> StructureKind {
        let structure = self.choices(row).find(|choice| choice.option().name == StructureKind::OPTION);
        combined(&structure).kind()
    }

    fn row_of(&self, choices: &[Choice]) -> Row {
        let default = |values: &Vec<Option<Choice>>| values.iter().position(|v| v.is_none_or(|c| c.is_default()));
        let mut row: Row = self.axes.iter().map(|values| default(values).expect("the default is right")).collect();
        for (i, values) in row.iter_mut().zip(&self.axes) {
            let chosen = values.iter().position(|value| value.is_some_and(|value| choices.contains(&value)));
            *i = chosen.unwrap_or(*i);
        }
        row
    }

    /// Those of the missing pairs that a combination holds: both values are its own, and its structure reads them.
    fn gain<'a>(&'a self, row: &'a Row) -> impl Iterator<Item = &'a [Value; 2]> {
        let accel = self.kind(row);
        let has = move |&(axis, i): &Value| row[axis] == i && OPTIONS[axis].structures.contains(&accel);
        self.missing.iter().filter(move |pair| pair.iter().all(has))
    }

    /// Of the values of each of `axes` in turn takes that which brings most of the missing pairs; `pair`, one of them,
    /// stays.
    fn climb(&self, mut row: Row, pair: &[Value; 2], axes: impl Fn(usize) -> bool) -> Row {
        for axis in (0..row.len()).filter(|&axis| axes(axis) && pair.iter().all(|value| value.0 != axis)) {
            let mut most = self.gain(&row).count();
            for i in 0..self.axes[axis].len() {
                let before = std::mem::replace(&mut row[axis], i);
                let gain = self.gain(&row).count();
                let keeps_pair = self.gain(&row).any(|gained| gained == pair);
                match gain > most && keeps_pair && self.is_right(&row) {
                    true => most = gain,
                    false => row[axis] = before,
                }
            }
        }
        row
    }
}

/// Which pairs a usual run takes: every value in every structure.
pub fn is_usual(pair: [&str; 2]) -> bool {
    pair.contains(&StructureKind::OPTION)
}

/// A few combinations that hold, between them, each two values of two options that go together and are wanted, numbers
/// and refinements included. Those of the same kernels are neighbours.
///
/// Greedy: each new combination holds a pair that is still missing, and of the values of all other options in turn that
/// with which most missing pairs come in. Pairs of what kernels are compiled for come first; the others are then put
/// into combinations whose kernels there are already, because compiling is what takes time.
pub fn spread(is_wanted: impl Fn([&str; 2]) -> bool) -> Vec<TraceOptions> {
    let mut pairs = Pairs::new(is_wanted);
    let is_compiled: Vec<_> = pairs.axes.iter().map(|values| values.iter().flatten().any(is_compiled)).collect();
    let mut rows: Vec<Row> = Vec::new();
    // Backwards, because the exact test, whose kernels take longest, is the first: little is left for it to be combined
    // with.
    let order = |pair: &[Value; 2]| (pair.iter().all(|value| is_compiled[value.0]), *pair);
    while let Some(pair) = pairs.missing.iter().copied().max_by_key(order) {
        let choices: Vec<_> = pair.iter().filter_map(|&(axis, i)| pairs.axes[axis][i]).collect();
        let with_pair = |row: &Row| {
            let mut row = row.clone();
            pair.iter().for_each(|&(axis, i)| row[axis] = i);
            row
        };
        let has_kernels = |row: &Row| {
            let key = |row: &Row| pairs.options(row).map(|options| kernel_key(&options));
            pairs.is_right(row)
                && pairs.gain(row).any(|&gained| gained == pair)
                && rows.iter().any(|other| key(other) == key(row))
        };
        let known = rows.iter().map(with_pair).filter(has_kernels);
        let row = match known
            .map(|row| pairs.climb(row, &pair, |axis| !is_compiled[axis]))
            .max_by_key(|row| pairs.gain(row).count())
        {
            Some(row) => row,
            None => {
                let changes = fewest_changes(&choices).expect("the pair goes together");
                pairs.climb(pairs.row_of(&[changes, choices].concat()), &pair, |_| true)
            }
        };
        let gained: Vec<_> = pairs.gain(&row).copied().collect();
        pairs.missing.retain(|pair| !gained.contains(pair));
        assert!(!pairs.missing.contains(&pair), "the combination holds it");
        rows.push(row);
    }
    let mut spread: Vec<_> = rows.iter().map(|row| pairs.options(row).expect("they go together")).collect();
    spread.sort_by_key(kernel_key);
    spread
}

/// Whether a combination holds both, of which its structure reads both.
pub fn go_together(first: Choice, second: Choice) -> bool {
    let pair = [first, second];
    fewest_changes(&pair).is_some_and(|changes| {
        let accel = combined(changes.iter().chain(&pair)).kind();
        pair.iter().all(|choice| choice.option().structures.contains(&accel))
    })
}

/// Whether other kernels are compiled for a value than for the default.
fn is_compiled(choice: &Choice) -> bool {
    let needs = fewest_changes(&[*choice]).expect("every value goes together with something");
    kernel_key(&combined(needs.iter().chain([choice]))) != kernel_key(&combined(&needs))
}

/// The same for all combinations that run the same kernels: what only the host's builders read is left out.
pub fn kernel_key(options: &TraceOptions) -> String {
    let host_only = TraceOptions {
        structure: match options.structure {
            Structure::Kd(KdOptions { traversal, stack_size, .. }) => {
                Structure::Kd(KdOptions { traversal, stack_size, ..KdOptions::DEFAULT })
            }
            other => Structure::of(other.kind()),
        },
        picture: PictureOptions { paths_in_flight: None, ..options.picture },
        ray_order: TraceOptions::DEFAULT.ray_order,
        ..*options
    };
    format!("{host_only:?}")
}
