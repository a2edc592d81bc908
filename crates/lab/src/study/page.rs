//! The report as one HTML page that needs nothing else: charts are drawn into it, for wide pages and for phones, in the
//! colours of a light or a dark page.

use super::chart::sizes;
use super::draw::{Format, GRID, INK, MUTED, PAPER, svg};
use super::pictured::{PicturedScene, SIZE};
use super::repeated::repeated;
use super::report::{Entry, Header};
use super::table::{Row, Table, column};
use super::{Chart, Outcome, Study};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use plotters::style::RGBColor;
use serde_json::Value;
use std::collections::BTreeSet;

/// Rows of a table that the page shows; the CSV has all.
const MOST_ROWS: usize = 400;

/// What the title of every page begins with; by this a report knows its own page.
pub const TITLE: &str = "raybrook study: ";

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1b1f; --muted: #5c5c66; --grid: #d8d8de; --paper: #ffffff; \
--holds: #00684c; --fails: #a3420a; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #ececf1; --muted: #a9a9b4; --grid: #3c3c45; --paper: #17171a; --holds: #4ecba4; --fails: #f39a5c; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 60rem; background: var(--paper); color: var(--ink); \
font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid var(--grid); padding-top: 1rem; }
a { color: inherit; } code { font-size: .9em; }
nav ol { columns: 16rem; column-gap: 2.5rem; padding-left: 1.5rem; }
figure { margin: 1.5rem 0; } figcaption { color: var(--muted); font-size: .9rem; }
svg { display: block; width: 100%; height: auto; } .narrow { display: none; }
@media (max-width: 40rem) { .wide { display: none; } .narrow { display: block; } }
.claim { color: var(--muted); } .anew { border-left: .25rem solid var(--fails); padding-left: .75rem; } \
.holds { color: var(--holds); } .fails { color: var(--fails); }
.table { overflow-x: auto; max-width: 100%; } table { border-collapse: collapse; font-size: .8rem; }
th, td { padding: .2rem .5rem; border-bottom: 1px solid var(--grid); text-align: right; white-space: nowrap; \
overflow-wrap: normal; }
.numbered { margin: .3rem 0; font-size: .9rem; } .numbered b { color: var(--muted); }
.scenes { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem; } \
.scenes img { max-width: 100%; height: auto; }
.scenes p { margin: .2rem 0; }
th:first-child, td:first-child, td.text { text-align: left; } details { margin: .5rem 0; }
";

/// The page.
pub fn html(header: &Header, entries: &[Entry], scenes: &[PicturedScene]) -> String {
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
                h1 { "Ray tracing on " (header.device) ": speed against accuracy" }
                (first_screen(&studies))
                (how_to_read())
                (made_on(header, &studies))
                (judged_anew(&studies))
                (timed_twice(entries))
                (scenes_shown(header, scenes))
                nav {
                    h2 { "Studies" }
                    ol {
                        @for (study, entry) in &studies {
                            li { a href={ "#" (study.name) } { (study.title) } ": " (outcome_of(entry)) }
                        }
                    }
                }
                @for (study, entry) in &studies { (section(study, entry)) }
            }
        }
    };
    page.into_string()
}

/// The study with the chart that the page begins with.
const FIRST: &str = "pareto";

/// What a stranger sees first: the chart of speed against accuracy, and what it and the other studies come to.
fn first_screen(studies: &[(&Study, &Entry)]) -> Markup {
    let first = studies.iter().find(|(study, _)| study.name == FIRST);
    let count = |outcome: Outcome| studies.iter().filter(|(_, entry)| entry.findings.outcome == outcome).count();
    let [holds, fails, undecided] = [Outcome::Holds, Outcome::Fails, Outcome::Undecided].map(count);
    html! {
        @if let Some((_, entry)) = first {
            p { (entry.findings.judgement()) (entry.findings.verdict) }
            @if let Some(chart) = entry.findings.charts.first() {
                @if let Some(table) = entry.findings.table(&chart.table) { (figure(entry, chart, table)) }
            }
        }
        p {
            "Claims tested: " (studies.len()) ". Hold here: " (holds) ". Do not hold: " (fails)
            ". Not decided: " (undecided)
            ". Every claim is one of the thesis that this program began with, or of the program itself; each has its \
             measurements below."
        }
    }
}

fn how_to_read() -> Markup {
    html! {
        h2 { "How to read it" }
        ul {
            li { "Each point is a method. In charts of speed against error left and high is better, and a line joins \
                  the points that no other beats." }
            li {
                "A filled mark: no answer of this run was wrong. A hollow one: some were. A ring around it: the method \
                 is exact by construction, which is a claim about the method, not about the run. Points stand at the \
                 upper bound of their rate of wrong answers with 95 % confidence; the bar beside it goes down to the \
                 lower bound."
            }
            li {
                "Methods of a table took turns, round by round. \u{201c}1.20 [1.15, 1.31]\u{201d} is the median of the \
                 rounds' ratios, and their smallest and largest. A claim holds, or does not, where the rounds agree on \
                 it by a sign test at a risk of 5 %; else it is not decided."
            }
            li { "Batches of rays are timed by the device's clock, pictures by the clock on the wall. Point at a mark \
                  to read its numbers." }
        }
    }
}

/// On what, when and of which code the report was made.
fn made_on(header: &Header, studies: &[(&Study, &Entry)]) -> Markup {
    let each = |part: fn(&Entry) -> &str| {
        let parts: BTreeSet<&str> =
            studies.iter().map(|(_, entry)| part(entry)).filter(|part| !part.is_empty()).collect();
        parts.into_iter().collect::<Vec<_>>().join(", ")
    };
    let (dates, commits) = (each(|entry| &entry.date), each(|entry| &entry.commit));
    html! {
        p {
            "raybrook " (header.version)
            @if !commits.is_empty() { ", commit " (commits) }
            @if !dates.is_empty() { ", " (dates) }
            ". " (header.device)
            @if !header.device_details.is_empty() { " (" (header.device_details) ")" }
            @if !header.machine.is_empty() { ", in a computer with " (header.machine) }
            ". Seed " (header.seed) "."
            @if header.quick {
                " Made in a hurry (" code { "--quick" } "): few rays, few rounds. A method without a wrong answer of \
                 some hundred may still err once in a hundred times."
            }
        }
    }
}

/// What the scenes look like.
fn scenes_shown(header: &Header, scenes: &[PicturedScene]) -> Markup {
    let (width, height) = SIZE;
    html! {
        h2 { "Scenes" }
        @if scenes.is_empty() && header.scenes.is_empty() { p { "Made by the program." } }
        @if scenes.is_empty() {
            @for scene in &header.scenes { p { code { (scene.name) } " (" (scene.triangles) " triangles)" } }
        }
        div.scenes {
            @for scene in scenes {
                div {
                    img src={ "data:image/png;base64," (scene.png) } width=(width) height=(height) alt=(scene.name);
                    p { b { (scene.name) } ", " (scene.triangles) " triangles. " (scene.about) }
                }
            }
        }
    }
}

/// Whether the claim of a study holds, in a word or two.
fn outcome_of(entry: &Entry) -> &'static str {
    match entry.findings.outcome {
        Outcome::Holds => "holds",
        Outcome::Fails => "does not hold",
        Outcome::Undecided => "not decided",
    }
}

/// The studies whose verdict is no more what an earlier version of the program said.
fn judged_anew(studies: &[(&Study, &Entry)]) -> Markup {
    let anew: Vec<_> = studies.iter().filter(|(_, entry)| entry.earlier.is_some()).collect();
    html! {
        @if !anew.is_empty() {
            p.anew {
                "Verdicts, and bounds of wrong answers in all tables and charts, were computed anew from the same \
                 measurements; these verdicts changed: "
                @for (i, (study, _)) in anew.iter().enumerate() {
                    @if i > 0 { ", " }
                    a href={ "#" (study.name) } { (study.title) }
                }
                ". What was said before stands below each."
            }
        }
    }
}

/// How far the times of pictures lie apart that several studies timed: what times of different studies are worth beside
/// each other.
fn timed_twice(entries: &[Entry]) -> Markup {
    let pictures = repeated(entries);
    let milliseconds = |(study, seconds): &(String, f64)| format!("{:.1} ms in {study}", 1e3 * seconds);
    html! {
        @if let Some(widest) = pictures.last() {
            p {
                (pictures.len())
                " pictures were timed by several studies, not by turns. The longest of a picture's times is "
                (format!("{:.2}", pictures[pictures.len() / 2].ratio())) " times its shortest in the middle, "
                (format!("{:.2}", widest.ratio())) " times at most (" (widest.name) ": "
                (widest.times.iter().map(milliseconds).collect::<Vec<_>>().join(", "))
                "). Smaller differences between times of two studies mean nothing; compare the rows of one."
            }
        }
    }
}

fn section(study: &Study, entry: &Entry) -> Markup {
    let findings = &entry.findings;
    let class = match findings.outcome {
        Outcome::Holds => "holds",
        Outcome::Fails => "fails",
        Outcome::Undecided => "",
    };
    html! {
        section id=(study.name) {
            h2 { (study.title) }
            p.claim { (study.claim) }
            p class=(class) { (findings.judgement()) (findings.verdict) }
            @if let Some(earlier) = &entry.earlier {
                p.anew {
                    "Judged anew from the same measurements, which an earlier version of raybrook judged: \u{201c}"
                    (earlier) "\u{201d}"
                }
            }
            @for chart in &findings.charts {
                @if let Some(table) = findings.table(&chart.table) { (figure(entry, chart, table)) }
            }
            @for note in &findings.notes { p { (note) } }
            @for table in &findings.tables { (data(entry, table)) }
            p.claim {
                "Made by " code { (entry.command) } " in " (format!("{:.0}", entry.seconds)) " s"
                @if !entry.date.is_empty() { ", " (entry.date) }
                "."
            }
        }
    }
}

fn figure(entry: &Entry, chart: &Chart, table: &Table) -> Markup {
    let drawn =
        [(Format::WIDE, "wide"), (Format::NARROW, "narrow")].map(|(format, class)| (svg(chart, table, format), class));
    let file = format!("charts/{}-{}.svg", entry.study, chart.name);
    html! {
        figure {
            @for (drawing, class) in &drawn {
                @match drawing {
                    Ok(drawing) => div class=(class) {
                        div role="img" aria-label=(chart.title) { (PreEscaped(in_page(&drawing.svg))) }
                        @if !drawing.numbered.is_empty() {
                            p.numbered {
                                @for (i, name) in drawing.numbered.iter().enumerate() { b { (i + 1) } " " (name) " " }
                            }
                        }
                    },
                    Err(error) => p { "This chart could not be drawn: " (error) },
                }
            }
            figcaption { (chart.caption) " " (sizes(chart, table)) " " a href=(file) { "SVG" } }
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
    let columns = table.shown_columns();
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
