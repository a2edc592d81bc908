//! The book's page of options is made of the same description as the help: this compares them, and writes the page anew
//! with `UPDATE=1`.

use super::Cli;
use clap::{Arg, Command, CommandFactory};
use std::fmt::Write;
use std::path::Path;

const PAGE: &str = "../../docs/book/src/options.md";
const BEGIN: &str = "<!-- generated: options -->";
const END: &str = "<!-- end -->";
/// Headings in the order of the page; options without one come first.
const HEADINGS: [&str; 12] = [
    "",
    "Picture",
    "Camera",
    "Device",
    "Accuracy",
    "Output",
    "Structure",
    "kd-tree",
    "Boxes",
    "Device memory",
    "Experiments",
    "Diagnosis",
];

/// `--size WxH`, `-q, --quiet`, or the name of an argument without a flag.
fn signature(argument: &Arg) -> String {
    let value = argument.get_value_names().filter(|_| argument.get_action().takes_values());
    let values = value.map(|names| names.iter().map(|name| format!(" {name}")).collect::<String>()).unwrap_or_default();
    let short = argument.get_short().map(|c| format!("-{c}, ")).unwrap_or_default();
    match argument.get_long() {
        Some(long) => format!("`{short}--{long}{values}`"),
        None => format!("`{}`", values.trim_start()),
    }
}

/// What the help says: its paragraphs in one line, and the items of its list in lines of their own. Paragraphs have an
/// empty line between them; lines that follow the first one of a paragraph are items, `name: what it is`.
fn text(argument: &Arg) -> String {
    let help = argument.get_long_help().or_else(|| argument.get_help()).map(ToString::to_string).unwrap_or_default();
    let paragraphs = help.replace('<', "&lt;");
    let (mut words, mut items) = (Vec::new(), String::new());
    for paragraph in paragraphs.split("\n\n") {
        let mut lines = paragraph.lines();
        words.extend(lines.next());
        for line in lines {
            let (name, about) = line.split_once(": ").expect("an item: its name, and what it is");
            let is_value = argument.get_possible_values().iter().any(|value| value.get_name() == name);
            let tick = if is_value { "`" } else { "" };
            write!(items, "\n  - {tick}{name}{tick}: {about}").unwrap();
        }
    }
    words.join(" ") + &items
}

fn arguments(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|argument| !["help", "version"].contains(&argument.get_id().as_str()))
}

/// Lines no longer than 120 columns; those that go on are indented as lists want it.
fn wrapped(line: &str) -> String {
    let indent = line.len() - line.trim_start().len() + 2;
    let mut result = " ".repeat(indent - 2);
    let mut column = result.len();
    for (i, word) in line.split_whitespace().enumerate() {
        if i > 0 && column + 1 + word.chars().count() > 120 {
            result += &format!("\n{}", " ".repeat(indent));
            column = indent;
        } else if i > 0 {
            result.push(' ');
            column += 1;
        }
        result += word;
        column += word.chars().count();
    }
    result
}

fn list(arguments: &[&Arg]) -> String {
    let items = arguments.iter().map(|argument| format!("- {}: {}", signature(argument), text(argument)));
    let lines: Vec<_> = items.flat_map(|item| item.lines().map(wrapped).collect::<Vec<_>>()).collect();
    lines.join("\n") + "\n"
}

/// The generated part of the page.
fn page() -> String {
    let mut all = Cli::command();
    all.build();
    let render = all.find_subcommand("render").expect("a command").clone();
    let mut page = String::from("\n## Options of `render`\n");
    for heading in HEADINGS {
        let of_heading = |argument: &&Arg| argument.get_help_heading().unwrap_or_default() == heading;
        let list_of: Vec<_> = arguments(&render).filter(of_heading).collect();
        if !list_of.is_empty() {
            let title = if heading.is_empty() { "Scene" } else { heading };
            write!(page, "\n### {title}\n\n{}", list(&list_of)).unwrap();
        }
    }
    let known: Vec<_> = arguments(&render).map(Arg::get_id).collect();
    page += "\n## Options that other commands have besides\n";
    for command in all.get_subcommands().filter(|command| !["render", "help"].contains(&command.get_name())) {
        let others: Vec<_> = arguments(command).filter(|argument| !known.contains(&argument.get_id())).collect();
        if !others.is_empty() {
            write!(page, "\n### `raybrook {}`\n\n{}", command.get_name(), list(&others)).unwrap();
        }
    }
    page + "\n"
}

#[test]
fn the_page_of_options_is_fresh() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE);
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (old, after) = rest.split_once(END).unwrap();
    let new = page();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, format!("{before}{BEGIN}{new}{END}{after}")).unwrap();
    } else {
        assert!(old == new, "{PAGE} is stale: run `UPDATE=1 cargo test -p raybrook-cli`");
    }
}

/// Every option is under a heading that the page has, and none is listed without a text.
#[test]
fn every_option_has_a_heading_and_a_text() {
    for command in Cli::command().get_subcommands() {
        for argument in arguments(command) {
            let heading = argument.get_help_heading().unwrap_or_default();
            assert!(HEADINGS.contains(&heading), "{} {}: {heading}", command.get_name(), argument.get_id());
            assert!(!text(argument).is_empty(), "{} {}", command.get_name(), argument.get_id());
        }
    }
}

/// The short help has few options, for people who have not seen any.
#[test]
fn the_short_help_of_render_is_short() {
    let mut all = Cli::command();
    all.build();
    let render = all.find_subcommand("render").expect("a command");
    let shown: Vec<_> =
        arguments(render).filter(|a| !a.is_hide_short_help_set() && a.get_long().is_some()).map(Arg::get_id).collect();
    assert!((12..=14).contains(&shown.len()), "{shown:?}");
}
