//! Options of the library by the names that are typed here. The library names fields (`leaf_size`), and writes them in
//! its messages between backticks, alone or with a value (`` `leaf_size = 4` ``); here they become flags (`--leaf-size
//! 4`).

use clap::CommandFactory;
use raybrook::Error;
use raybrook::low_level::choose::{Decision, Request};
use raybrook::low_level::options::{Choice, Heading, StructureKind, TraceOptions};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::LazyLock;

/// The names of all options of all commands, as the library writes them.
static NAMES: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let mut names = BTreeSet::new();
    let mut open = vec![super::Cli::command()];
    while let Some(command) = open.pop() {
        names.extend(command.get_arguments().filter_map(|a| a.get_long()).map(|long| long.replace('-', "_")));
        open.extend(command.get_subcommands().cloned());
    }
    names
});

/// The flag of an option: `--leaf-size` of `leaf_size`.
pub fn flag(name: &str) -> String {
    format!("--{}", name.replace('_', "-"))
}

/// Whether a library's name is that of an option here.
fn is_option(name: &str) -> bool {
    NAMES.contains(name)
}

/// A choice as it is typed: `--structure kd`.
pub fn typed(choice: &Choice) -> String {
    as_typed(&choice.to_string()).expect("an option of methods")
}

/// `name` or `name = value` as it is typed; `None` where that is no option.
fn as_typed(code: &str) -> Option<String> {
    let (name, value) = code.split_once(" = ").map_or((code, None), |(name, value)| (name, Some(value)));
    let flag = is_option(name).then(|| flag(name))?;
    Some(value.map_or(flag.clone(), |value| format!("{flag} {value}")))
}

/// `text` with flags in place of the library's names between backticks.
pub fn in_flags(text: &str) -> Cow<'_, str> {
    if !text.contains('`') {
        return Cow::Borrowed(text);
    }
    let mut result = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('`') {
        result += before;
        match after.split_once('`').and_then(|(code, after)| Some((as_typed(code)?, after))) {
            Some((flag, after)) => {
                result += &flag;
                rest = after;
            }
            None => {
                result += "`";
                rest = after;
            }
        }
    }
    Cow::Owned(result + rest)
}

/// Which structures read an option, where not all do.
pub fn only_with(structures: &[StructureKind]) -> Option<String> {
    let names: Vec<_> = structures.iter().map(|kind| kind.name()).collect();
    let are_all = names.len() == StructureKind::ALL.len();
    (!are_all).then(|| format!("Only with {} {}", flag(StructureKind::OPTION), names.join(", ")))
}

/// What an error says, with flags.
pub fn message(error: &Error) -> String {
    match error {
        Error::Option { option, message } if is_option(option) => {
            format!("option {}: {}", flag(option), in_flags(message))
        }
        // These name files, and what stands in them; what stands between backticks there is the user's.
        Error::Io { .. } | Error::Input { .. } => error.to_string(),
        other => in_flags(&other.to_string()).into_owned(),
    }
}

/// Decisions with flags.
pub fn decisions(mut decisions: Vec<Decision>) -> Vec<Decision> {
    for decision in &mut decisions {
        if is_option(&decision.option) {
            decision.option = flag(&decision.option).into();
        }
        decision.reason = in_flags(&decision.reason).into_owned();
    }
    decisions
}

/// The arguments that ask for `options`: the structure, and what differs from its defaults.
pub fn arguments(options: &TraceOptions) -> Vec<String> {
    let mut words = words(options, |_| true);
    words.extend(options.counters.then(|| flag("counters")));
    words
}

/// The arguments on which the pixels of pictures depend: exact hits are the same by any method.
pub fn pixel_arguments(options: &TraceOptions) -> Vec<String> {
    words(options, |choice| !options.is_exact() || choice.option().heading == Heading::Picture)
}

fn words(options: &TraceOptions, is_wanted: impl Fn(&Choice) -> bool) -> Vec<String> {
    let request = Request::of(options);
    let typed: Vec<_> = request.given().iter().filter(|choice| is_wanted(choice)).map(typed).collect();
    typed.iter().flat_map(|choice| choice.split(' ')).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::options::{GridOptions, Intersector, OPTIONS, Structure};

    #[test]
    fn names_between_backticks_become_flags_and_nothing_else() {
        for (text, expected) in [
            ("take `structure = kd` or bvh2", "take --structure kd or bvh2"),
            ("nearest: `traversal = short-stack` `stack_size = 4`", "nearest: --traversal short-stack --stack-size 4"),
            ("raise `memory_limit`", "raise --memory-limit"),
            ("`raybrook tune` makes it, `forget` removes it", "`raybrook tune` makes it, --forget removes it"),
            ("one ` alone", "one ` alone"),
            ("a `b` and `leaf_size`", "a `b` and --leaf-size"),
        ] {
            assert_eq!(in_flags(text), expected);
        }
        let error = Error::option("leaf_size", "must be at least 1");
        assert_eq!(message(&error), "option --leaf-size: must be at least 1");
    }

    #[test]
    fn every_option_of_methods_has_a_flag() {
        assert!(OPTIONS.iter().all(|option| is_option(option.name)));
        assert!(["method", "counters", "memory_limit", "device", "no_cache", "size"].into_iter().all(is_option));
    }

    #[test]
    fn options_become_arguments() {
        let structure = Structure::Grid(GridOptions { size: Some([4, 5, 6]) });
        let options = TraceOptions { structure, intersector: Intersector::Plucker, ..TraceOptions::DEFAULT };
        let arguments = arguments(&options).join(" ");
        assert_eq!(arguments, "--structure grid --grid-size 4,5,6 --intersector plucker");
    }
}
