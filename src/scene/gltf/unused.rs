//! What a file has that is not used, or not as it is meant: told once, by name.

use super::KNOWN;
use crate::scene::text::quote;
use ::gltf::json::Root;
use std::collections::BTreeMap;

/// How many names are told.
const MAX_NAMES: usize = 16;

/// What is not used, each with how often it was met.
#[derive(Debug, Default)]
pub(super) struct Unused {
    left_out: BTreeMap<String, usize>,
    reduced: BTreeMap<&'static str, usize>,
}

impl Unused {
    /// What nobody looks at while the scene is read.
    pub fn of(root: &Root) -> Unused {
        let mut unused = Unused::default();
        let unknown = root.extensions_used.iter().filter(|name| !KNOWN.contains(&name.as_str()));
        for name in unknown.take(MAX_NAMES) {
            unused.note(format!("extension {}", quote(name.as_bytes())));
        }
        unused.add("animations", root.animations.len());
        unused.add("other scenes", root.scenes.len().saturating_sub(1));
        unused
    }

    /// Counts one more of what is left out.
    pub fn note(&mut self, what: impl Into<String>) {
        self.add(what, 1);
    }

    pub fn add(&mut self, what: impl Into<String>, count: usize) {
        if count > 0 {
            *self.left_out.entry(what.into()).or_default() += count;
        }
    }

    /// Counts one more of what has fewer values than it should have.
    pub fn note_reduced(&mut self, what: &'static str) {
        *self.reduced.entry(what).or_default() += 1;
    }

    /// What a file without triangles has.
    pub fn instead(&self) -> String {
        if self.left_out.is_empty() { String::new() } else { format!("; not used: {}", list(&self.left_out)) }
    }

    /// The warning, if there is anything to tell.
    pub fn message(&self) -> Option<String> {
        let left_out = (!self.left_out.is_empty()).then(|| format!("not used: {}", list(&self.left_out)));
        let reduced = (!self.reduced.is_empty()).then(|| format!("only their mean is used: {}", list(&self.reduced)));
        let parts: Vec<_> = left_out.into_iter().chain(reduced).collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

fn list(names: &BTreeMap<impl AsRef<str>, usize>) -> String {
    let told = |(name, count): (&_, &usize)| {
        let name: &str = AsRef::<str>::as_ref(name);
        if *count > 1 { format!("{name} ({count})") } else { name.to_owned() }
    };
    let mut told: Vec<_> = names.iter().take(MAX_NAMES).map(told).collect();
    if names.len() > MAX_NAMES {
        told.push(format!("and {} more", names.len() - MAX_NAMES));
    }
    told.join(", ")
}
