//! What a file has that is not used, or not as it is meant: told once, by name.

use std::collections::BTreeMap;

/// How many names are told. Those behind them are counted.
pub(super) const MAX_NAMES: usize = 16;

/// What is not used, each with how often it was met.
#[derive(Debug, Default)]
pub(super) struct Unused {
    left_out: Names,
    reduced: Names,
}

/// Names, and how often each was met.
#[derive(Debug, Default)]
struct Names {
    names: BTreeMap<String, usize>,
    /// How often names were met that there was no room for any more: a hostile file could fill the memory with them.
    others: usize,
}

impl Names {
    fn add(&mut self, name: String, count: usize) {
        if self.names.len() < MAX_NAMES || self.names.contains_key(&name) {
            *self.names.entry(name).or_default() += count;
        } else {
            self.others += count;
        }
    }

    /// A list in words; none where it is empty.
    fn told(&self) -> Option<String> {
        let told = |(name, count): (&String, &usize)| match count {
            1 => name.clone(),
            _ => format!("{name} ({count})"),
        };
        let mut told: Vec<String> = self.names.iter().map(told).collect();
        if self.others > 0 {
            told.push(format!("and {} more", self.others));
        }
        (!told.is_empty()).then(|| told.join(", "))
    }
}

impl Unused {
    /// Counts one more of what is left out.
    pub(super) fn note(&mut self, what: impl Into<String>) {
        self.add(what, 1);
    }

    /// Counts so many more of it.
    pub(super) fn add(&mut self, what: impl Into<String>, count: usize) {
        if count > 0 {
            self.left_out.add(what.into(), count);
        }
    }

    /// Counts one more of what has fewer values than it should have.
    pub(super) fn note_reduced(&mut self, what: &'static str) {
        self.reduced.add(what.into(), 1);
    }

    /// What a file without triangles has.
    pub(super) fn instead(&self) -> String {
        self.left_out.told().map_or(String::new(), |list| format!("; not used: {list}"))
    }

    /// The warning, if there is anything to tell.
    pub(super) fn message(&self) -> Option<String> {
        let left_out = self.left_out.told().map(|list| format!("not used: {list}"));
        let reduced = self.reduced.told().map(|list| format!("only their mean is used: {list}"));
        let parts: Vec<_> = left_out.into_iter().chain(reduced).collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_up_to_a_number_and_others_counted() {
        let mut unused = Unused::default();
        assert_eq!((unused.message(), unused.instead()), (None, String::new()));
        unused.add("nothing", 0);
        unused.note("b");
        unused.add("a", 2);
        unused.note_reduced("c");
        assert_eq!(unused.message().unwrap(), "not used: a (2), b; only their mean is used: c");
        assert_eq!(unused.instead(), "; not used: a (2), b");
        (0..100_000).for_each(|number| unused.note(format!("x{number:06}")));
        unused.note("b");
        let message = unused.message().unwrap();
        assert!(message.starts_with("not used: a (2), b (2), x000000, x000001"), "{message}");
        assert!(message.ends_with("x000013, and 99986 more; only their mean is used: c"), "{message}");
    }
}
