//! The report as one HTML page that needs nothing else: charts are drawn into it, for wide pages and for phones, in the
//! colours of a light or a dark page.

use super::draw::{Format, GRID, INK, MUTED, PAPER, svg};
use super::report::{Entry, Header};
use super::table::{Row, Table, column};
use super::{Chart, Study};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use plotters::style::RGBColor;
use serde_json::Value;

/// Rows of a table that the page shows; the CSV has all.
const MOST_ROWS: usize = 400;

/// What the title of every page begins with; by this a report knows its own page.
pub const TITLE: &str = "raybrook study: ";

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1b1f; --muted: #5c5c66; --grid: #d8d8de; --paper: #ffffff; --holds: #00684c; --fails: #a3420a; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #ececf1; --muted: #a9a9b4; --grid: #3c3c45; --paper: #17171a; --holds: #4ecba4; --fails: #f39a5c; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 60rem; background: var(--paper); color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid var(--grid); padding-top: 1rem; }
a { color: inherit; } code { font-size: .9em; }
nav ol { columns: 16rem; padding-left: 1.5rem; }
figure { margin: 1.5rem 0; } figcaption { color: var(--muted); font-size: .9rem; }
svg { display: block; width: 100%; height: auto; } .narrow { display: none; }
@media (max-width: 40rem) { .wide { display: none; } .narrow { display: block; } }
.claim { color: var(--muted); } .anew { border-left: .25rem solid var(--fails); padding-left: .75rem; } .holds { color: var(--holds); } .fails { color: var(--fails); }
.table { overflow-x: auto; max-width: 100%; } table { border-collapse: collapse; font-size: .8rem; }
th, td { padding: .2rem .5rem; border-bottom: 1px solid var(--grid); text-align: right; white-space: nowrap; overflow-wrap: normal; }
th:first-child, td:first-child, td.text { text-align: left; } details { margin: .5rem 0; }
";

/// The page.
pub fn html(header: &Header, entries: &[Entry]) -> String {
    let studies: Vec<_> = entries.iter().filter_map(|entry| Some((Study::find(&entry.study).ok()?, entry))).collect();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (TITLE) (header.device) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Speed against accuracy on " (header.device) }
                p {
                    "raybrook " (header.version) "; seed " (header.seed)
                    @if !header.device_details.is_empty() { "; " (header.device_details) }
                    @if header.quick { "; in a hurry (" code { "--quick" } "): few rays, few passes, wide spreads" }
                    "."
                }
                p {
                    @if header.scenes.is_empty() { "Scenes made by the program." }
                    @else {
                        "Scenes: "
                        @for (i, scene) in header.scenes.iter().enumerate() {
                            @if i > 0 { ", " } code { (scene.name) } " (" (scene.triangles) " triangles)"
                        }
                        "."
                    }

                }
                p {
                    "Every speed stands beside the errors of the same run: filled points and bars had no wrong answer, hollow ones had some. "
                    "Methods of a table were timed by turns; points are medians, thin bars go from the slowest to the fastest pass."
                }
                (judged_anew(&studies))
                nav {
                    ol { @for (study, _) in &studies { li { a href={ "#" (study.name) } { (study.title) } } } }
                }
                @for (study, entry) in &studies { (section(study, entry)) }
            }
        }
    };
    page.into_string()
}

/// The studies whose verdict is no more what an earlier version of the program said.
fn judged_anew(studies: &[(&Study, &Entry)]) -> Markup {
    let anew: Vec<_> = studies.iter().filter(|(_, entry)| entry.earlier.is_some()).collect();
    html! {
        @if !anew.is_empty() {
            p.anew {
                "Verdicts, and bounds of wrong answers in all tables and charts, were computed anew from the same measurements; these \
                 verdicts changed: "
                @for (i, (study, _)) in anew.iter().enumerate() {
                    @if i > 0 { ", " }
                    a href={ "#" (study.name) } { (study.title) }
                }
                ". What was said before stands below each."
            }
        }
    }
}

fn section(study: &Study, entry: &Entry) -> Markup {
    let findings = &entry.findings;
    let class = match findings.holds {
        Some(true) => "holds",
        Some(false) => "fails",
        None => "",
    };
    html! {
        section id=(study.name) {
            h2 { (study.title) }
            p.claim { (study.claim) }
            p class=(class) { (findings.judgement()) (findings.verdict) }
            @if let Some(earlier) = &entry.earlier {
                p.anew {
                    "Judged anew from the same measurements, which an earlier version of raybrook judged: \u{201c}" (earlier) "\u{201d}"
                }
            }
            @for chart in &findings.charts {
                @if let Some(table) = findings.table(&chart.table) { (figure(entry, chart, table)) }
            }
            @for note in &findings.notes { p { (note) } }
            @for table in &findings.tables { (data(entry, table)) }
            p.claim { "Made by " code { (entry.command) } " in " (format!("{:.0}", entry.seconds)) " s." }
        }
    }
}

fn figure(entry: &Entry, chart: &Chart, table: &Table) -> Markup {
    let drawn = [(Format::WIDE, "wide"), (Format::NARROW, "narrow")]
        .map(|(format, class)| (svg(chart, table, format).map(|svg| in_page(&svg)), class));
    let file = format!("charts/{}-{}", entry.study, chart.name);
    html! {
        figure {
            @for (svg, class) in &drawn {
                @match svg {
                    Ok(svg) => div class=(class) role="img" aria-label=(chart.title) { (PreEscaped(svg)) },
                    Err(error) => p { "This chart could not be drawn: " (error) },
                }
            }
            figcaption {
                (chart.caption) " "
                a href={ (file) ".svg" } { "SVG" } ", " a href={ (file) ".png" } { "PNG" }
            }
        }
    }
}

/// The drawing with the page's colours in place of those of paper.
fn in_page(svg: &str) -> String {
    let mut text = svg.to_owned();
    for (RGBColor(r, g, b), name) in [(INK, "ink"), (MUTED, "muted"), (GRID, "grid"), (PAPER, "paper")] {
        text = text.replace(&format!("\"#{r:02X}{g:02X}{b:02X}\""), &format!("\"var(--{name})\""));
    }
    text
}

fn data(entry: &Entry, table: &Table) -> Markup {
    let columns = table.columns();
    let file = format!("data/{}-{}.csv", entry.study, table.name);
    html! {
        details {
            summary { (table.caption) " (" (table.rows.len()) " rows; " a href=(file) { "CSV" } ")" }
            div.table {
                table {
                    thead { tr { @for name in &columns { th title=(column(name).about) { (column(name).label) } } } }
                    tbody { @for row in table.rows.iter().take(MOST_ROWS) { (line(row, &columns)) } }
                }
            }
            @if table.rows.len() > MOST_ROWS { p { "The first " (MOST_ROWS) " rows; the CSV has all." } }
        }
    }
}

fn line(row: &Row, columns: &[&str]) -> Markup {
    html! {
        tr {
            @for name in columns {
                @match row.get(*name) {
                    Some(Value::String(text)) => td.text { (text) },
                    Some(Value::Number(number)) => td { (number_text(number)) },
                    Some(value) => td { (value) },
                    None => td {},
                }
            }
        }
    }
}

/// Four digits of a number that is not whole.
pub(super) fn number_text(number: &serde_json::Number) -> String {
    match number.as_f64() {
        Some(value) if !(number.is_i64() || number.is_u64()) => match value.abs() {
            0.0 => "0".to_owned(),
            1e-3..1e6 => format!("{value:.*}", (3 - value.abs().log10().floor() as i32).clamp(0, 6) as usize),
            _ => format!("{value:.3e}"),
        },
        _ => number.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn numbers_have_four_digits() {
        let text = |value: Value| number_text(value.as_number().unwrap());
        let texts =
            [json!(12.34567), json!(0.012_345_6), json!(123_456.7), json!(7), json!(0.0), json!(1e-9)].map(text);
        assert_eq!(texts, ["12.35", "0.01235", "123457", "7", "0", "1.000e-9"]);
    }
}
