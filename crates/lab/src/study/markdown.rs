//! A study as Markdown, for documentation that is read where no page is shown.

use super::page::number_text;
use super::table::{Table, column};
use super::{Entry, Study};
use serde_json::Value;
use std::fmt::Write;

/// Title, claim, verdict, notes and tables of each study.
pub fn markdown<'a>(device: &str, studies: impl Iterator<Item = (&'a Study, &'a Entry)>) -> String {
    let mut text = String::new();
    for (study, entry) in studies {
        let findings = &entry.findings;
        let verdict = [findings.judgement(), &findings.verdict].concat();
        let _ = writeln!(text, "# {}\n\n{}\n\n{}\n", study.title, study.claim, plain(&verdict));
        if let Some(earlier) = &entry.earlier {
            let _ = writeln!(
                text,
                "Judged anew from the same measurements, which an earlier version of raybrook judged: {}\n",
                plain(earlier)
            );
        }
        for note in &findings.notes {
            let _ = writeln!(text, "{}\n", plain(note));
        }
        for table in &findings.tables {
            let _ = writeln!(text, "## {}\n", table.caption);
            text += &rows(table);
        }
        let _ = writeln!(text, "Made by `{}` on {device}, version {}.\n", entry.command, entry.header.version);
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}

/// `text` with nothing in it that Markdown takes for HTML or for the end of a line: names of scenes may have that.
fn plain(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace(['\n', '\r'], " ")
}

/// The table, and what its columns mean where their headings do not say it all.
fn rows(table: &Table) -> String {
    let columns = table.shown_columns();
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let is_text = |name: &str| table.rows.iter().any(|row| row.get(name).is_some_and(Value::is_string));
    let mut text = line(columns.iter().map(|name| column(name).label.to_owned()).collect());
    text += &format!(
        "|{}|\n",
        columns.iter().map(|name| if is_text(name) { "---" } else { "--:" }).collect::<Vec<_>>().join("|")
    );
    for row in &table.rows {
        let cell = |name: &&str| match row.get(*name) {
            Some(Value::String(text)) => plain(text).replace('|', "\\|"),
            Some(Value::Number(number)) => number_text(number),
            Some(value) => value.to_string(),
            None => String::new(),
        };
        text += &line(columns.iter().map(cell).collect());
    }
    text.push('\n');
    let explained = columns.iter().map(|name| column(name)).filter(|column| !column.about.is_empty());
    let about: Vec<_> = explained.map(|column| format!("{}: {}", column.label, column.about)).collect();
    if !about.is_empty() {
        let _ = writeln!(text, "{}.\n", about.join(". "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::table::row;
    use serde_json::json;

    #[test]
    fn names_of_scenes_are_no_markup() {
        let rows_of = vec![row([("scene", json!("<b>a|b</b>&\nc.obj"))])];
        let text = rows(&Table::new("name", "caption", rows_of));
        assert!(text.contains("| &lt;b>a\\|b&lt;/b>&amp; c.obj |"), "{text}");
    }
}
