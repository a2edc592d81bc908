//! All that is printed goes through here.
//!
//! Names and texts come from files and arguments, and may hold what a terminal takes for commands: such characters are
//! escaped. Standard output is a result: that it cannot be written is an error in the end ([`finish`]). Standard error
//! is a courtesy: a run whose messages nobody can read goes on.

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::progress::{self, Event};
use raybrook::Error;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt::{Arguments, Write as _};
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// Prints a line to standard output.
macro_rules! say {
    ($($argument:tt)*) => { $crate::print::line(format_args!($($argument)*)) };
}

/// Prints a line to standard error.
macro_rules! tell {
    ($($argument:tt)*) => { $crate::print::message(format_args!($($argument)*)) };
}

/// The first failure of standard output.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Whether a terminal may take this for a command, or show what follows in another order than it is written in.
fn is_unsafe(c: char) -> bool {
    let turns_the_direction = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns_the_direction || c.is_control() && !matches!(c, '\n' | '\t')
}

/// `text` with everything escaped that could command a terminal.
pub fn escaped(text: &str) -> Cow<'_, str> {
    escaped_by(text, |escaped, c| write!(escaped, "{}", c.escape_unicode()))
}

fn escaped_by(text: &str, escape: impl Fn(&mut String, char) -> std::fmt::Result) -> Cow<'_, str> {
    if !text.contains(is_unsafe) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(2 * text.len());
    for c in text.chars() {
        match is_unsafe(c) {
            // Writing to a string does not fail.
            true => _ = escape(&mut escaped, c),
            false => escaped.push(c),
        }
    }
    Cow::Owned(escaped)
}

/// Prints a line to standard output; see [`finish`] for what happens if that fails.
pub fn line(text: Arguments) {
    print(&escaped(&text.to_string()));
}

/// Prints `value` as JSON to standard output.
pub fn json(value: &impl Serialize) {
    json_text(&serde_json::to_string_pretty(value).expect("numbers and names serialise"));
}

/// Prints `text`, which is JSON, to standard output.
pub fn json_text(text: &str) {
    print(&escaped_json(text));
}

/// JSON has its own way to write any character, and lets these be raw: DEL, for example.
fn escaped_json(text: &str) -> Cow<'_, str> {
    escaped_by(text, |escaped, c| write!(escaped, "\\u{:04x}", u32::from(c)))
}

fn print(text: &str) {
    let mut stdout = io::stdout().lock();
    remember(stdout.write_all(text.as_bytes()).and_then(|()| stdout.write_all(b"\n")));
}

/// Keeps the first failure of standard output for [`finish`].
pub fn remember(written: io::Result<()>) {
    if let Err(error) = written {
        FAILURE.get_or_init(|| error);
    }
}

/// Prints a line to standard error, if that can be written: as an event where these are told.
pub fn message(text: Arguments) {
    let text = text.to_string();
    match progress::is_json() {
        true => event(&Event::Message { text: &text }),
        false => error_line(&escaped(&text)),
    }
}

/// Prints an event to standard error, if that can be written.
pub fn event(event: &Event) {
    error_line(&escaped_json(&serde_json::to_string(event).expect("numbers and names serialise")));
}

/// In one piece, so that lines of several threads do not mix.
fn error_line(text: &str) {
    let _ = io::stderr().write_all(format!("{text}\n").as_bytes());
}

/// Prints an error and its causes, and returns its exit code.
pub fn error(error: &Error) -> Code {
    tell!("raybrook: {}", super::chain(error));
    error.exit_code()
}

/// The exit code of a run that ended with `code`, once standard output has all of its text. A reader that has seen
/// enough (`| head`) is no failure, and a run that failed has told of something worse.
pub fn finish(code: Code) -> Code {
    remember(io::stdout().flush());
    let has_results = code == SUCCESS || code == FOUND_A_DIFFERENCE;
    match FAILURE.get() {
        Some(failure) if has_results && failure.kind() != ErrorKind::BrokenPipe => {
            let source = io::Error::new(failure.kind(), failure.to_string());
            error(&Error::io("write", "standard output", source))
        }
        _ => code,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_commands_terminals_is_escaped_and_nothing_else() {
        assert_eq!(
            escaped("a\u{1b}[31mb\u{7}\u{7f}\u{9b}2J\u{202e}c\r"),
            r"a\u{1b}[31mb\u{7}\u{7f}\u{9b}2J\u{202e}c\u{d}"
        );
        for text in ["", "two\nlines\tand a tab", "Füße, 漢字, שלום, 👍🏽, a\\u{1b}"] {
            assert!(matches!(escaped(text), Cow::Borrowed(same) if same == text));
        }
        let all = (0..=0x10_ffff).filter_map(char::from_u32).collect::<String>();
        let left: Vec<char> = escaped(&all).chars().filter(|&c| is_unsafe(c)).collect();
        assert!(left.is_empty(), "{left:?}");
    }

    #[test]
    fn json_stays_json_of_the_same_text() {
        let text = "a\u{1b}[31m\u{7f}\u{9b}\u{202e}\u{2069}\"\\";
        let json = serde_json::to_string(text).unwrap();
        let printed = escaped_json(&json);
        assert!(!printed.contains(is_unsafe));
        assert_eq!(serde_json::from_str::<String>(&printed).unwrap(), text);
    }
}
