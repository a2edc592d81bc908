//! `raybrook methods`: what exists, what it needs, and what never goes together, from the library's own table.

use super::text::wrapped;
use super::{MethodArgs, print};
use clap::Args;
use raybrook::Result;
use raybrook::low_level::options::{Accel, Choice, MethodOption, NeverTogether, OPTIONS, needs, never_together};
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
    never_together: Vec<NeverTogether>,
}

/// An option that takes a name.
#[derive(Serialize)]
struct OptionEntry {
    option: &'static str,
    about: String,
    structures: Vec<&'static str>,
    values: Vec<ValueEntry>,
}

#[derive(Serialize)]
struct ValueEntry {
    name: &'static str,
    about: String,
    default: bool,
    needs: Vec<Choice>,
}

/// An option that takes a number.
#[derive(Serialize)]
struct NumberEntry {
    option: &'static str,
    about: String,
    structures: Vec<&'static str>,
    needs: Vec<Choice>,
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
        let mut methods = Methods { options: Vec::new(), numbers: Vec::new(), never_together: never_together() };
        for option in OPTIONS {
            let structures = option.structures.iter().map(|accel| accel.name()).collect();
            match option.about() {
                Some(about) => {
                    methods.options.push(OptionEntry { option: option.name, about, structures, values: values(option) })
                }
                None => {
                    let needs = option.choices().flat_map(needs).collect();
                    methods.numbers.push(NumberEntry { option: option.name, about: help(option), structures, needs });
                }
            }
        }
        methods
    }

    fn text(&self) -> String {
        let names = self.options.iter().flat_map(|option| &option.values).map(|value| value.name);
        let longest = names.chain(self.numbers.iter().map(|number| number.option)).map(str::len).max().unwrap_or(0);
        let label = |mark: char, name: &str| format!("  {mark} {name:longest$}  ");

        let mut text = wrapped(
            "",
            "Options that choose the method, for every command that traces. * marks the default, which --accel auto, the \
             program's own, replaces by what is fastest on the device.",
        );
        for option in &self.options {
            text += "\n";
            let only = only_with(&option.structures, &[]);
            text += &wrapped("", &format!("{}: {}{only}", option.option, option.about));
            for value in &option.values {
                let mark = if value.default { '*' } else { ' ' };
                text += &wrapped(&label(mark, value.name), &format!("{}{}", value.about, needed(&value.needs)));
            }
        }
        text += "\nNumbers:\n";
        for number in &self.numbers {
            let only = only_with(&number.structures, &number.needs);
            let about = format!("{}.{only}{}", number.about, needed(&number.needs));
            text += &wrapped(&label(' ', number.option), &about);
        }
        text += "\nNever together:\n";
        for group in groups(&self.never_together) {
            text += &wrapped("    ", &format!("{} with {}", group.values, group.partners));
            text += &wrapped("        ", &group.reason);
        }
        text
    }
}

fn values(option: &'static MethodOption) -> Vec<ValueEntry> {
    let entry = |choice: Choice| {
        let (name, about) = (choice.name()?, choice.about()?);
        Some(ValueEntry { name, about, default: choice.is_default(), needs: needs(choice) })
    };
    option.choices().filter_map(entry).collect()
}

/// What `--help` says of an option.
fn help(option: &MethodOption) -> String {
    let command = MethodArgs::augment_args(clap::Command::new(""));
    let argument = command.get_arguments().find(|a| a.get_long() == option.name.strip_prefix("--"));
    argument.and_then(clap::Arg::get_help).map(ToString::to_string).unwrap_or_default()
}

/// The structures that read an option, unless all do or `needs` has the one.
fn only_with(structures: &[&str], needs: &[Choice]) -> String {
    let is_needed = needs.iter().any(|choice| choice.option().name == Accel::OPTION);
    match structures.len() < Accel::ALL.len() && !is_needed {
        true => format!(" Only with {} {}.", Accel::OPTION, structures.join(", ")),
        false => String::new(),
    }
}

fn needed(needs: &[Choice]) -> String {
    match needs {
        [] => String::new(),
        _ => format!(" Needs {}.", needs.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")),
    }
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
        reason: if values.len() > 1 { general(reason, values[0]) } else { reason.to_owned() },
        values: listed(&values),
        partners: listed(&partners),
    };
    groups.into_iter().map(group).collect()
}

fn general(reason: &str, value: Choice) -> String {
    reason.replace(&value.to_string(), &format!("{} …", value.option().name))
}

/// Values by option: `--accel grid, octree; --leaf-size`.
fn listed(choices: &[Choice]) -> String {
    let of_options = choices.chunk_by(|a, b| a.option().name == b.option().name);
    let names = |choices: &[Choice]| choices.iter().filter_map(Choice::name).collect::<Vec<_>>().join(", ");
    let texts =
        of_options.map(|choices| format!("{} {}", choices[0].option().name, names(choices)).trim_end().to_owned());
    texts.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Options that are other words for one of the table.
    const SHORT_FORMS: [&str; 1] = ["--precision"];

    #[test]
    fn the_table_has_every_option_of_methods_and_help_has_every_option_of_the_table() {
        let command = MethodArgs::augment_args(clap::Command::new(""));
        let mut of_help: Vec<_> = command.get_arguments().map(|a| format!("--{}", a.get_long().unwrap())).collect();
        let mut of_table: Vec<_> = OPTIONS.iter().map(|option| option.name.to_owned()).collect();
        of_help.retain(|name| !SHORT_FORMS.contains(&name.as_str()));
        of_help.sort();
        of_table.sort();
        assert_eq!(of_table, of_help);
        assert!(OPTIONS.iter().all(|option| !help(option).is_empty()));
    }
}
