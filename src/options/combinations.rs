//! What goes together with what, found by trying: [`TraceOptions::validate`] is the only place that knows.

use super::{Choice, OPTIONS, TraceOptions, choices};
use crate::error::Error;

/// Other options that are changed, at most, in the search for a combination that holds two given values. The test that tries every
/// combination of all options would fail if more were ever needed.
const MOST_CHANGES: usize = 2;

/// Two values that no combination holds.
#[derive(Debug, Clone, serde::Serialize)]
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
            if let Err(error) = combine(&fulfilled).validate()
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

/// The defaults with `choices`, of which later ones win.
fn combine(choices: &[Choice]) -> TraceOptions {
    let mut options = TraceOptions::DEFAULT;
    choices.iter().for_each(|choice| choice.set(&mut options));
    options
}

/// The fewest values of other options with which those of `fixed` go together; `None` if they never do.
pub fn fewest_changes(fixed: &[Choice]) -> Option<Vec<Choice>> {
    (0..=MOST_CHANGES).find_map(|count| {
        let mut changes = Vec::new();
        search(fixed, 0, count, &mut changes).then_some(changes)
    })
}

/// Adds `count` values of the options from number `from` on to `changes` so that all is valid; whether that is possible.
fn search(fixed: &[Choice], from: usize, count: usize, changes: &mut Vec<Choice>) -> bool {
    if count == 0 {
        let all: Vec<_> = changes.iter().chain(fixed).copied().collect();
        return combine(&all).validate().is_ok();
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
            ("--accel kd", ""),
            ("--triangles leaf-order", ""),
            ("--traversal ropes", ""),
            ("--stack-size", "--traversal short-stack"),
            ("--grid-size", "--accel grid"),
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
        assert_eq!(reason("--accel kd", "--build median"), None);
        for (first, second, words) in [
            ("--accel grid", "--build median", "--build: means nothing to --accel grid"),
            ("--layout whole", "--triangles leaf-order", "nearest: --layout split"),
            ("--traversal stack", "--stack-size", "--traversal short-stack"),
            ("--grid-size", "--stack-size", "means nothing to --accel grid"),
        ] {
            assert!(reason(first, second).unwrap().contains(words), "{first} {second}");
        }
    }
}
