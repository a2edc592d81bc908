//! What goes together with what, found by trying: [`TraceOptions::validate`] is the only place that knows.

use super::{Choice, OPTIONS, StructureKind, TraceOptions, choices};
use crate::error::{Error, Result};

/// Other options that are changed, at most, in the search for a combination that holds two given values. The test that
/// tries every combination of all options would fail if more were ever needed.
const MOST_CHANGES: usize = 2;

/// Two values that no combination holds.
#[derive(Debug, Clone)]
pub struct NeverTogether {
    /// The two, in the order of [`OPTIONS`].
    pub values: [Choice; 2],
    /// The option that [`TraceOptions::validate`] refuses.
    pub refused: String,
    /// What it says.
    pub reason: String,
}

/// The fewest values of other options that `choice` needs; none when it goes together with the defaults.
pub fn needs(choice: Choice) -> Vec<Choice> {
    fewest_changes(&[choice]).unwrap_or_default()
}

/// Every pair of values of two options that never goes together, and why.
pub fn never_together() -> Vec<NeverTogether> {
    let all: Vec<_> = choices().map(|choice| (choice, needs(choice))).collect();
    let mut never = Vec::new();
    for (i, (first, first_needs)) in all.iter().enumerate() {
        for (second, second_needs) in &all[i + 1..] {
            if first.option().name == second.option().name {
                continue;
            }
            let pair = [*first, *second];
            // What each needs by itself: what is wrong then is wrong with the pair.
            let fulfilled: Vec<_> = first_needs.iter().chain(second_needs).chain(&pair).copied().collect();
            if let Err(error) = combine(&fulfilled)
                && fewest_changes(&pair).is_none()
            {
                let (refused, reason) = match error {
                    Error::Option { option, message } => (option, message),
                    error => (String::new(), error.to_string()),
                };
                never.push(NeverTogether { values: pair, refused, reason });
            }
        }
    }
    never
}

/// The defaults with `choices`, of which later ones win; the structure comes first, as it brings its defaults with it.
///
/// # Errors
/// [`Error::Option`] when they do not go together.
pub fn combine(choices: &[Choice]) -> Result<TraceOptions> {
    let is_structure = |choice: &&Choice| choice.option().name == StructureKind::OPTION;
    let (structures, others): (Vec<&Choice>, Vec<&Choice>) = choices.iter().partition(is_structure);
    let mut options = TraceOptions::DEFAULT;
    structures.into_iter().chain(others).try_for_each(|choice: &Choice| choice.set(&mut options))?;
    options.validate().map(|()| options)
}

/// The fewest values of other options with which those of `fixed` go together; `None` if they never do.
pub fn fewest_changes(fixed: &[Choice]) -> Option<Vec<Choice>> {
    (0..=MOST_CHANGES).find_map(|count| {
        let mut changes = Vec::new();
        search(fixed, 0, count, &mut changes).then_some(changes)
    })
}

/// Adds `count` values of the options from number `from` on to `changes` so that all is valid; whether that is
/// possible.
fn search(fixed: &[Choice], from: usize, count: usize, changes: &mut Vec<Choice>) -> bool {
    if count == 0 {
        let all: Vec<_> = changes.iter().chain(fixed).copied().collect();
        return combine(&all).is_ok();
    }
    let is_fixed = |name| fixed.iter().any(|choice| choice.option().name == name);
    for (i, option) in OPTIONS.iter().enumerate().skip(from).filter(|(_, option)| !is_fixed(option.name)) {
        // No value needs a number: numbers only refine.
        for choice in option.choices().filter(|choice| !option.is_number() && !choice.is_default()) {
            changes.push(choice);
            if search(fixed, i + 1, count - 1, changes) {
                return true;
            }
            changes.pop();
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choice(text: &str) -> Choice {
        choices().find(|choice| choice.to_string() == text).unwrap()
    }

    #[test]
    fn needs_are_the_fewest_changes() {
        for (value, expected) in [
            ("structure = kd", ""),
            ("triangles = leaf-order", ""),
            ("traversal = ropes", ""),
            ("stack_size = 1", "traversal = short-stack"),
            ("grid_size = 1,1,1", "structure = grid"),
        ] {
            let needs: Vec<_> = needs(choice(value)).iter().map(ToString::to_string).collect();
            assert_eq!(needs.join(" "), expected, "{value}");
        }
    }

    #[test]
    fn what_never_goes_together_has_the_reason_of_the_pair() {
        let never = never_together();
        let reason = |first: &str, second: &str| {
            let pair = [choice(first), choice(second)];
            never.iter().find(|n| n.values == pair).map(|n| format!("{}: {}", n.refused, n.reason))
        };
        assert_eq!(reason("structure = kd", "build = median"), None);
        for (first, second, words) in [
            ("structure = grid", "build = median", "build: means nothing to `structure = grid`"),
            ("layout = whole", "triangles = leaf-order", "nearest: `layout = split`"),
            ("traversal = stack", "stack_size = 1", "`traversal = short-stack`"),
            ("grid_size = 1,1,1", "stack_size = 1", "means nothing to `structure = grid`"),
        ] {
            assert!(reason(first, second).unwrap().contains(words), "{first} {second}");
        }
    }
}
