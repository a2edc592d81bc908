//! `raybrook methods`: what exists, what it needs, and what never goes together, from the library's own table.

use super::flags::{flag, in_flags, only_with, typed};
use super::print;
use super::text::wrapped;
use raybrook::Result;
use raybrook::low_level::options::{
    Choice, MethodOption, NeverTogether, OPTIONS, StructureKind, needs, never_together,
};
use serde::Serialize;

#[derive(clap::Args)]
pub struct MethodsArgs {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Everything that is printed, as text or as JSON.
#[derive(Serialize)]
struct Methods {
    options: Vec<OptionEntry>,
    numbers: Vec<NumberEntry>,
    never_together: Vec<Pair>,
    #[serde(skip)]
    groups: Vec<Group>,
}

/// An option that takes a name.
#[derive(Serialize)]
struct OptionEntry {
    option: String,
    about: String,
    structures: Vec<&'static str>,
    #[serde(skip)]
    only: String,
    values: Vec<ValueEntry>,
}

#[derive(Serialize)]
struct ValueEntry {
    name: &'static str,
    about: String,
    default: bool,
    needs: Vec<String>,
}

/// An option that takes a number.
#[derive(Serialize)]
struct NumberEntry {
    option: String,
    about: String,
    structures: Vec<&'static str>,
    #[serde(skip)]
    only: String,
    needs: Vec<String>,
}

/// Two values that no combination of options holds.
#[derive(Serialize)]
struct Pair {
    values: [String; 2],
    refused: String,
    reason: String,
}

impl Pair {
    fn of(never: &NeverTogether) -> Pair {
        Pair {
            values: never.values.map(|choice| shown(&choice)),
            refused: flag(&never.refused),
            reason: in_flags(&never.reason).into_owned(),
        }
    }
}

/// A choice as it is typed; of a number the option alone, for all that are within its limits.
fn shown(choice: &Choice) -> String {
    if choice.option().is_number() { flag(choice.option().name) } else { typed(choice) }
}

pub fn run(args: &MethodsArgs) -> Result<()> {
    let methods = Methods::collect();
    if args.json {
        print::json(&methods);
    } else {
        say!("{}", methods.text().trim_end());
    }
    Ok(())
}

impl Methods {
    fn collect() -> Methods {
        let never_together = never_together();
        let mut methods = Methods {
            options: Vec::new(),
            numbers: Vec::new(),
            never_together: never_together.iter().map(Pair::of).collect(),
            groups: groups(&never_together),
        };
        for option in OPTIONS {
            let structures = option.structures.iter().map(|kind| kind.name()).collect();
            let (name, about) = (flag(option.name), option.about());
            let only = only_with(option.structures).map_or(String::new(), |only| format!(" {only}."));
            if option.is_number() {
                let needs: Vec<_> = option.choices().flat_map(needs).collect();
                let needs_structure = needs.iter().any(|choice| choice.option().name == StructureKind::OPTION);
                let only = if needs_structure { String::new() } else { only };
                let needs = needs.iter().map(shown).collect();
                let about = format!("{} [default: {}]", about.trim_end_matches('.'), option.default_words());
                methods.numbers.push(NumberEntry { option: name, about, structures, only, needs });
            } else {
                methods.options.push(OptionEntry { option: name, about, structures, only, values: values(option) });
            }
        }
        methods
    }

    fn text(&self) -> String {
        let names = self.options.iter().flat_map(|option| &option.values).map(|value| value.name);
        let numbers = self.numbers.iter().map(|number| &number.option[..]);
        let longest = names.chain(numbers).map(str::len).max().unwrap_or(0);
        let label = |mark: char, name: &str| format!("  {mark} {name:longest$}  ");

        let mut text = wrapped(
            "",
            "Options that choose the method, for every command that traces. * marks the default; the structure is the \
             fastest on the device unless it is asked for.",
        );
        for option in &self.options {
            text += "\n";
            text += &wrapped("", &format!("{}: {}{}", option.option, option.about, option.only));
            for value in &option.values {
                let mark = if value.default { '*' } else { ' ' };
                text += &wrapped(&label(mark, value.name), &format!("{}{}", value.about, needed(&value.needs)));
            }
        }
        text += "\nNumbers:\n";
        for number in &self.numbers {
            let about = format!("{}.{}{}", number.about, number.only, needed(&number.needs));
            text += &wrapped(&label(' ', &number.option), &about);
        }
        text += "\nNever together:\n";
        for group in &self.groups {
            text += &wrapped("    ", &format!("{} with {}", group.values, group.partners));
            text += &wrapped("        ", &group.reason);
        }
        text
    }
}

fn values(option: &'static MethodOption) -> Vec<ValueEntry> {
    let entry = |choice: Choice| {
        let (name, about) = (choice.name()?, choice.about()?);
        Some(ValueEntry { name, about, default: choice.is_default(), needs: needs(choice).iter().map(shown).collect() })
    };
    option.choices().filter_map(entry).collect()
}

fn needed(needs: &[String]) -> String {
    if needs.is_empty() { String::new() } else { format!(" Needs {}.", needs.join(" ")) }
}

/// Pairs that have the same reason: each of `values` with each of `partners`.
struct Group {
    values: String,
    partners: String,
    reason: String,
}

/// The pairs in few lines. A reason that differs only in the value that it names has `…` there.
fn groups(never: &[NeverTogether]) -> Vec<Group> {
    // All partners of a value for the same reason, then all values of an option with the same partners.
    let mut of_values: Vec<(Choice, Vec<Choice>, &str)> = Vec::new();
    for NeverTogether { values: [value, partner], reason, .. } in never {
        match of_values.iter_mut().find(|(v, _, r)| v == value && r == reason) {
            Some((_, partners, _)) => partners.push(*partner),
            None => of_values.push((*value, vec![*partner], reason)),
        }
    }
    let mut groups: Vec<(Vec<Choice>, Vec<Choice>, &str)> = Vec::new();
    for (value, partners, reason) in of_values {
        let is_same = |(values, p, r): &&mut (Vec<Choice>, Vec<Choice>, &str)| {
            values[0].option().name == value.option().name
                && *p == partners
                && general(r, values[0]) == general(reason, value)
        };
        match groups.iter_mut().find(is_same) {
            Some((values, ..)) => values.push(value),
            None => groups.push((vec![value], partners, reason)),
        }
    }
    let group = |(values, partners, reason): (Vec<Choice>, Vec<Choice>, &str)| Group {
        reason: in_flags(&if values.len() > 1 { general(reason, values[0]) } else { reason.to_owned() }).into_owned(),
        values: listed(&values),
        partners: listed(&partners),
    };
    groups.into_iter().map(group).collect()
}

fn general(reason: &str, value: Choice) -> String {
    reason.replace(&value.to_string(), &format!("{} = …", value.option().name))
}

/// Values by option: `--accel grid, octree; --leaf-size`.
fn listed(choices: &[Choice]) -> String {
    let of_options = choices.chunk_by(|a, b| a.option().name == b.option().name);
    let names = |choices: &[Choice]| choices.iter().filter_map(Choice::name).collect::<Vec<_>>().join(", ");
    let texts = of_options
        .map(|choices| format!("{} {}", flag(choices[0].option().name), names(choices)).trim_end().to_owned());
    texts.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_option_of_methods_is_told_of() {
        let methods = Methods::collect();
        assert_eq!(methods.options.len() + methods.numbers.len(), OPTIONS.len());
        let text = methods.text();
        assert!(OPTIONS.iter().all(|option| text.contains(&flag(option.name))), "{text}");
    }
}
