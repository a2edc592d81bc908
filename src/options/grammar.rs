//! Methods in one word: `bvh8`, `kd+ropes+plucker`, `grid+watertight`.

use super::{Build, Choice, Intersector, MethodOption, StructureKind, Traversal};
use crate::error::{Error, Result};

/// What a part of a method may name.
const PARTS: [&str; 4] = [StructureKind::OPTION, Build::OPTION, Traversal::OPTION, Intersector::OPTION];

/// The choices of a method: structure, build, traversal and triangle test, joined by `+` in any order, each at most
/// once. What is left out is left open: `ropes` alone is a traversal of kd-trees, whichever structure that needs.
///
/// ```
/// use raybrook::low_level::options::parse_method;
///
/// let choices: Vec<_> = parse_method("kd+ropes+plucker").unwrap().iter().map(ToString::to_string).collect();
/// assert_eq!(choices, ["structure = kd", "traversal = ropes", "intersector = plucker"]);
/// ```
///
/// # Errors
/// [`Error::Option`] when a part has no such name, or is there twice.
pub fn parse_method(text: &str) -> Result<Vec<Choice>> {
    let options = || PARTS.iter().filter_map(|name| MethodOption::find(name));
    let mut choices: Vec<Choice> = Vec::new();
    for part in text.split('+') {
        let Some(choice) = options().find_map(|option| option.parse(part).ok()) else {
            let names: Vec<_> = options().flat_map(MethodOption::choices).filter_map(|choice| choice.name()).collect();
            let message = format!("no '{part}'; possible, joined by '+': {}", names.join(", "));
            return Err(Error::option("method", message));
        };
        if let Some(other) = choices.iter().find(|other| other.option().name == choice.option().name) {
            let message = format!("'{text}' has `{other}` and `{choice}`; take one of them");
            return Err(Error::option("method", message));
        }
        choices.push(choice);
    }
    // The structure first: it brings its defaults with it.
    choices.sort_by_key(|choice| PARTS.iter().position(|name| *name == choice.option().name));
    Ok(choices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_names_are_unique() {
        let mut names: Vec<_> = PARTS
            .iter()
            .flat_map(|name| MethodOption::find(name).unwrap().choices())
            .map(|choice| choice.name().unwrap())
            .collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn parts_may_come_in_any_order_but_once() {
        let words = |text: &str| {
            parse_method(text).map(|choices| choices.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))
        };
        assert_eq!(words("ropes+kd").unwrap(), words("kd+ropes").unwrap());
        assert_eq!(words("ropes").unwrap(), "traversal = ropes");
        for (text, complaint) in
            [("best", "no 'best'"), ("", "no ''"), ("kd+grid", "`structure = kd` and `structure = grid`")]
        {
            let message = words(text).unwrap_err().to_string();
            assert!(message.contains(complaint), "{message}");
        }
    }
}
