//! `raybrook methods`: what exists, what it needs, and what never goes together, from the library's own table.

use super::MethodArgs;
use clap::Args;
use raybrook::Result;
use raybrook::options::{Accel, Choice, MethodOption, NeverTogether, OPTIONS, needs, never_together};
use serde::Serialize;

/// Columns of the text.
const WIDTH: usize = 100;
/// Columns in front of a description.
const INDENT: usize = 21;

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
        say!("{}", serde_json::to_string_pretty(&methods).expect("strings and lists are always JSON"));
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
        let mut text =
            wrapped("", "Options of render, trace, check and info that choose the method. * marks the default.");
        for option in &self.options {
            text += "\n";
            text += &wrapped("", &format!("{}: {}{}", option.option, option.about, only_with(&option.structures)));
            for value in &option.values {
                let mark = if value.default { '*' } else { ' ' };
                let label = format!("  {mark} {}", value.name);
                text += &wrapped(&format!("{label:INDENT$}"), &format!("{}{}", value.about, needed(&value.needs)));
            }
        }
        text += "\nNumbers, each with its default:\n";
        for number in &self.numbers {
            let about = format!("{}.{}{}", number.about, only_with(&number.structures), needed(&number.needs));
            text += &wrapped(&format!("{:INDENT$}", format!("    {}", number.option)), &about);
        }
        text += "\nNever together:\n";
        for (group, reason) in grouped(&self.never_together) {
            text += &wrapped("    ", &group);
            text += &wrapped("        ", &reason);
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

fn only_with(structures: &[&str]) -> String {
    match structures.len() < Accel::ALL.len() {
        true => format!(" Only with --accel {}.", structures.join(", ")),
        false => String::new(),
    }
}

fn needed(needs: &[Choice]) -> String {
    match needs {
        [] => String::new(),
        _ => format!(" Needs {}.", needs.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")),
    }
}

/// Pairs with the same reason in one line: who with whom, and why. A reason that differs only in the first one's name has `…` there.
fn grouped(never: &[NeverTogether]) -> Vec<(String, String)> {
    /// The names of one option.
    struct Side(&'static str, Vec<&'static str>);
    impl Side {
        fn of(choice: Choice) -> Side {
            Side(choice.option().name, choice.name().into_iter().collect())
        }
        fn text(&self) -> String {
            if self.1.is_empty() { self.0.to_owned() } else { format!("{} {}", self.0, self.1.join(", ")) }
        }
    }
    // First value by value of the first option, then those together that have the same partners.
    let mut rows: Vec<(Side, Side, &str)> = Vec::new();
    for NeverTogether { values: [first, second], reason } in never {
        let (first, mut second) = (Side::of(*first), Side::of(*second));
        match rows.iter_mut().find(|(a, b, r)| (a.text(), b.0, *r) == (first.text(), second.0, reason)) {
            Some((_, partners, _)) => partners.1.append(&mut second.1),
            None => rows.push((first, second, reason)),
        }
    }
    let mut groups: Vec<(Side, Side, String, &str)> = Vec::new();
    for (mut first, second, reason) in rows {
        let general = reason.replace(&first.text(), &format!("{} …", first.0));
        match groups.iter_mut().find(|(a, b, r, _)| (a.0, b.text(), &*r) == (first.0, second.text(), &general)) {
            Some((firsts, ..)) => firsts.1.append(&mut first.1),
            None => groups.push((first, second, general, reason)),
        }
    }
    let line = |(first, second, general, reason): (Side, Side, String, &str)| {
        let reason = if first.1.len() > 1 { general } else { reason.to_owned() };
        (format!("{} with {}", first.text(), second.text()), reason)
    };
    groups.into_iter().map(line).collect()
}

/// `label` and `text` in lines of [`WIDTH`] columns; those after the first begin below the text's begin.
fn wrapped(label: &str, text: &str) -> String {
    let indent = label.chars().count();
    let mut result = label.to_owned();
    let mut column = indent;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if column > indent {
            if column + 1 + length > WIDTH {
                result += "\n";
                result += &" ".repeat(indent);
                column = indent;
            } else {
                result += " ";
                column += 1;
            }
        }
        result += word;
        column += length;
    }
    result + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_every_option_of_methods_and_help_has_every_option_of_the_table() {
        let command = MethodArgs::augment_args(clap::Command::new(""));
        let mut of_help: Vec<_> = command.get_arguments().map(|a| format!("--{}", a.get_long().unwrap())).collect();
        let mut of_table: Vec<_> = OPTIONS.iter().map(|option| option.name.to_owned()).collect();
        of_help.sort();
        of_table.sort();
        assert_eq!(of_table, of_help);
        assert!(OPTIONS.iter().all(|option| !help(option).is_empty()));
    }

    #[test]
    fn lines_break_between_words() {
        let text = wrapped("  ab   ", &"word ".repeat(40));
        assert!(text.lines().count() > 1 && text.lines().all(|line| line.chars().count() <= WIDTH));
        assert!(text.lines().skip(1).all(|line| line.starts_with("       word")), "{text}");
        assert_eq!(wrapped("x ", "one two"), "x one two\n");
    }
}
