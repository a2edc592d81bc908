//! The studies, and what they have in common.

mod device;
mod economy;
mod killing;
mod memory;
mod pareto;
mod pictures;
mod rays;
mod share;
mod stability;
mod structures;
mod trees;

use super::lookup::{geometric_mean, is_same_work};
use super::outcome::{Outcome, Rounds};
use super::table::{Row, name, number, row, values};
use super::{Chart, ChartKind, Findings, Header, Lab, Study, Subject, Table, Variant};
use raybrook::Result;
use raybrook::low_level::device::DeviceKind;
use raybrook::low_level::options::{PacketSize, StructureKind, TraceOptions};
use serde_json::json;

pub use pareto::{STUDY as OF_PEERS, beside_peers, stress_kinds, stress_rays_a_kind};

/// All of them, in the order of the report.
pub const ALL: &[Study] = &[
    pareto::STUDY,
    stability::STUDY,
    rays::INTERSECTION,
    share::STUDY,
    trees::LEAF_SIZE,
    trees::DEPTH,
    structures::STOP,
    trees::TRIANGLES,
    trees::SPLIT_RULE,
    trees::TRAVERSAL,
    structures::GRID_SIZE,
    memory::MEMORY_KIND,
    memory::LAYOUT,
    pictures::KERNELS,
    device::STUDY,
    rays::RAY_KIND,
    rays::TRANSFER,
    rays::CPU_GPU,
    pictures::TEXTURING,
    pictures::SUBSAMPLING,
    trees::BOUNDING_VOLUMES,
    killing::STUDY,
    economy::STUDY,
];

/// The columns by which rows of [`Lab::compare`] are told apart.
const BATCH: [&str; 3] = ["scene", "method", "rays_of"];
/// The same of [`Lab::pictures`].
const PICTURE: [&str; 2] = ["scene", "method"];

const CAMERA: usize = 0;
const ALL_KINDS: [usize; 3] = [0, 1, 2];

/// The columns of a speed's spread.
const SPREAD: [&str; 2] = ["mrays_low", "mrays_high"];

/// Triangles up to which a ray may look at all of them.
const MOST_FOR_LISTS: usize = 6000;

impl Lab<'_> {
    fn is_cpu(&self) -> bool {
        self.device.is_some_and(|device| device.info.kind == DeviceKind::Cpu)
    }

    /// [`Lab::compare`] over several subjects, one after the other.
    fn compare_all(&mut self, subjects: &[Subject], variants: &[Variant], kinds: &[usize]) -> Result<Vec<Row>> {
        let mut rows = Vec::new();
        for subject in subjects {
            rows.extend(self.compare(subject, variants, kinds)?);
        }
        Ok(rows)
    }
}

/// The table of rays through the usual scenes by turns with all `variants`; in a hurry of camera rays alone.
fn usual_rays(lab: &mut Lab, variants: &[Variant], title: &str) -> Result<Vec<Table>> {
    let subjects = lab.usual_subjects()?;
    let kinds: &[usize] = if lab.quick { &[CAMERA] } else { &ALL_KINDS };
    let rows = lab.compare_all(&subjects, variants, kinds)?;
    Ok(vec![Table::new("rays", format!("{title}: all measurements"), rows)])
}

/// Options of a structure.
fn with(accel: StructureKind) -> TraceOptions {
    TraceOptions::of(accel)
}

/// The same with packets.
fn in_packets(accel: StructureKind) -> TraceOptions {
    TraceOptions { packet_size: PacketSize::Sixteen, ..with(accel) }
}

/// The names of the scenes, in order.
fn scenes_of(rows: &[Row]) -> Vec<String> {
    values(rows, "scene")
}

/// What a verdict says part by part, and what follows in each for the claim.
#[derive(Debug, Default)]
struct Verdict {
    parts: Vec<String>,
    outcomes: Vec<Outcome>,
}

impl Verdict {
    /// A part with a bearing on the claim.
    fn say(&mut self, outcome: Outcome, part: String) {
        let open = if outcome == Outcome::Undecided { " (not decided at this spread)" } else { "" };
        self.outcomes.push(outcome);
        self.parts.push(part + open);
    }

    /// A part that leaves the claim open for another reason than the spread, which `part` tells.
    fn leave_open(&mut self, part: String) {
        self.outcomes.push(Outcome::Undecided);
        self.parts.push(part);
    }

    fn not_measured(&mut self, what: &str) {
        self.leave_open(format!("{what}: not measured"));
    }

    /// What is said without a bearing on the claim.
    fn add(&mut self, part: String) {
        self.parts.push(part);
    }

    /// Whether the claim holds in every part.
    fn all(&self) -> Outcome {
        Outcome::all(self.outcomes.iter().copied())
    }

    /// Whether the claim holds in some part.
    fn any(&self) -> Outcome {
        Outcome::any(self.outcomes.iter().copied())
    }

    /// These findings, where the claim is to hold in every part.
    fn findings(self, tables: Vec<Table>, charts: Vec<Chart>) -> Findings {
        Findings { outcome: self.all(), verdict: self.text(), notes: Vec::new(), tables, charts }
    }

    fn text(&self) -> String {
        match &self.parts[..] {
            [] => "Nothing could be measured.".to_owned(),
            parts => parts.join("; ") + ".",
        }
    }
}

/// A ratio in words; its spread in brackets.
fn told(ratio: Option<&Rounds>) -> String {
    ratio.map_or("(not measured)".to_owned(), Rounds::to_string)
}

impl Findings {
    /// The same, without a judgement where the reference did one and the same work on both sides.
    fn on(self, header: &Header) -> Findings {
        match header.is_reference() {
            true => Findings { outcome: Outcome::Undecided, ..self },
            false => self,
        }
    }
}

/// Methods that did the same work for every ray of the table: no option that was to tell them apart reached the
/// structure or its traversal.
fn alike(table: &Table) -> Result<Vec<String>> {
    let methods = values(&table.rows, "method");
    let mut notes = Vec::new();
    for (i, a) in methods.iter().enumerate() {
        for b in &methods[i + 1..] {
            let pairs = table.pairs(&[("method", a)], &[("method", b)], &["scene", "rays_of"])?;
            if pairs.is_some_and(|pairs| is_same_work(&pairs)) {
                notes.push(format!(
                    "'{a}' and '{b}' did the same work for every ray: between them nothing was compared."
                ));
            }
        }
    }
    Ok(notes)
}

/// The geometric mean of a column; `None` of no rows, or where a row lacks its value.
fn mean(rows: &[&Row], column: &str) -> Option<f64> {
    geometric_mean(rows.iter().map(|row| number(row, column)))
}

/// A column of one row by that of another, where both have it.
fn ratio_of(a: &Row, b: &Row, column: &str) -> Option<f64> {
    geometric_mean([Some(number(a, column)? / number(b, column)?)])
}

/// The row with the largest value.
fn largest<'a>(rows: impl IntoIterator<Item = &'a Row>, column: &str) -> Option<&'a Row> {
    let value = |row: &Row| number(row, column).unwrap_or(f64::NEG_INFINITY);
    rows.into_iter().max_by(|a, b| value(a).total_cmp(&value(b))).filter(|row| number(row, column).is_some())
}

/// Of all rows the answers that were wrong and those that were checked, as a sentence.
fn error_note(rows: &[Row]) -> String {
    let sum = |column: &str| rows.iter().filter_map(|row| number(row, column)).sum::<f64>();
    let (wrong, tested) = (sum("wrong"), sum("tested"));
    match wrong == 0.0 {
        true => format!("No answer of {tested} was wrong."),
        false => format!("{wrong} answers of {tested} were wrong, those of the hollow points or bars."),
    }
}

/// How fast each method is relative to the fastest of its scene, by the geometric mean over the kinds of rays, with
/// the errors of all these rays: one row for each scene and method. Without a speed where a kind was not timed: means
/// over other kinds are no equals.
fn relative(rays: &Table) -> Result<Vec<Row>> {
    let mut out: Vec<Row> = Vec::new();
    for scene in scenes_of(&rays.rows) {
        let of_scene = || rays.rows.iter().filter(|row| name(row, "scene") == scene);
        let kinds = values(of_scene(), "rays_of");
        let mut methods = Vec::new();
        for method in values(of_scene(), "method") {
            let own = kinds.iter().map(|kind| rays.one(&[("scene", &scene), ("method", &method), ("rays_of", kind)]));
            let own: Vec<&Row> = own.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
            let is_whole = own.len() == kinds.len();
            methods.push((method, own, is_whole));
        }
        let speed = |own: &[&Row], is_whole: bool, column: &str| mean(own, column).filter(|_| is_whole);
        let fastest = methods.iter().filter_map(|(_, own, is_whole)| speed(own, *is_whole, "mrays_per_s"));
        let fastest = fastest.fold(f64::MIN_POSITIVE, f64::max);
        for (method, own, is_whole) in methods {
            let sum = |column: &str| own.iter().filter_map(|row| number(row, column)).sum::<f64>() as usize;
            let mut new = row([("scene", json!(scene)), ("method", json!(method))]);
            let of_method = ["triangles", "structure", "promise"];
            let known = of_method.iter().filter_map(|column| Some((column, own.first()?.get(*column)?)));
            new.extend(known.map(|(column, value)| ((*column).to_owned(), value.clone())));
            let speeds = [("relative", "mrays_per_s"), ("relative_low", "mrays_low"), ("relative_high", "mrays_high")];
            for (relative, column) in speeds {
                let speed = speed(&own, is_whole, column);
                new.extend(speed.map(|speed| (relative.to_owned(), json!(speed / fastest))));
            }
            new.extend(super::lab::errors(sum("wrong"), sum("tested")));
            out.push(new);
        }
    }
    Ok(out)
}

/// A chart for each scene of a table, of the same columns.
fn by_scene(
    kind: ChartKind,
    table: &Table,
    file: &str,
    title: &str,
    columns: [&str; 2],
    finish: impl Fn(Chart) -> Chart,
) -> Vec<Chart> {
    let chart = |(i, scene): (usize, &String)| {
        let title = format!("{scene}: {title}");
        finish(Chart::new(kind, table, &format!("{file}-{}", i + 1), title, columns).only("scene", scene))
    };
    scenes_of(&table.rows).iter().enumerate().map(chart).collect()
}

/// Made-up rows for tests of verdicts.
#[cfg(test)]
mod rows_of {
    use super::super::{Findings, Header, Study};
    use super::*;
    use serde_json::Value;

    pub fn header(is_quick: bool) -> Header {
        Header {
            version: String::new(),
            device: "a device".into(),
            device_details: "gpu".into(),
            machine: String::new(),
            scenes: Vec::new(),
            seed: 1,
            quick: is_quick,
        }
    }

    /// Of a report that was made without a device.
    pub fn of_reference() -> Header {
        Header { device: crate::study::report::REFERENCE.to_owned(), ..header(false) }
    }

    /// Seconds of nine rounds, each a little off.
    pub fn rounds(seconds: f64) -> Value {
        json!((0..9).map(|i| seconds * (1.0 + 1e-3 * f64::from(i % 3))).collect::<Vec<_>>())
    }

    /// The speed of a row, in million rays a second, in nine rounds.
    pub fn timed(rate: f64) -> Row {
        row([
            ("rays", json!(1_000_000)),
            ("mrays_per_s", json!(rate)),
            ("mrays_low", json!(rate)),
            ("mrays_high", json!(rate)),
            ("rounds_s", rounds(1.0 / rate)),
        ])
    }

    /// Camera rays: scenes, methods and speeds, none wrong.
    pub fn rays(rows: &[(&str, &str, f64)]) -> Vec<Table> {
        let rows = rows.iter().map(|&(scene, method, rate)| {
            let mut out = row([("scene", json!(scene)), ("method", json!(method)), ("rays_of", json!("camera"))]);
            out.extend(timed(rate));
            out.extend(crate::study::lab::errors(0, 1000));
            out
        });
        vec![Table::new("rays", "", rows.collect())]
    }

    /// Counted work, told apart by its steps.
    pub fn work(steps: f64) -> Row {
        let rest = ["leaves", "tests", "restarts", "node_bytes", "triangle_bytes"].map(|column| (column, json!(1.0)));
        row([("steps", json!(steps))]).into_iter().chain(row(rest)).collect()
    }

    /// The same rows, each with further columns.
    pub fn with_columns(mut tables: Vec<Table>, columns: impl Fn(&Row) -> Row) -> Vec<Table> {
        tables.iter_mut().flat_map(|table| &mut table.rows).for_each(|row| row.extend(columns(row)));
        tables
    }

    pub fn judge(study: &Study, tables: Vec<Table>, header: &Header) -> Result<Findings> {
        study.judge(tables, header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(method: &str, kind: &str, rate: f64, wrong: u64) -> Row {
        row([
            ("scene", json!("s")),
            ("method", json!(method)),
            ("rays_of", json!(kind)),
            ("mrays_per_s", json!(rate)),
            ("mrays_low", json!(rate / 2.0)),
            ("mrays_high", json!(rate * 2.0)),
            ("wrong", json!(wrong)),
            ("tested", json!(1000)),
        ])
    }

    #[test]
    fn speeds_are_relative_to_the_fastest_and_errors_are_summed() {
        let rows = [
            measured("a", "camera", 8.0, 1),
            measured("a", "shadow", 2.0, 2),
            measured("b", "camera", 2.0, 0),
            measured("b", "shadow", 2.0, 0),
        ];
        let found = relative(&Table::new("rays", "", rows.to_vec())).unwrap();
        let value = |i: usize, column: &str| number(&found[i], column).unwrap();
        assert!((value(0, "relative") - 1.0).abs() < 1e-12 && (value(1, "relative") - 0.5).abs() < 1e-12);
        assert!((value(1, "relative_high") - 1.0).abs() < 1e-12);
        assert_eq!((value(0, "wrong"), value(0, "wrong_per_million")), (3.0, 1500.0));
        assert_eq!(value(1, "wrong_per_million"), 0.0);
        assert!((1490.0..1500.0).contains(&value(1, "wrong_bound")) && value(0, "wrong_bound") > 3000.0);
        assert_eq!(error_note(&rows[2..]), "No answer of 2000 was wrong.");
    }

    #[test]
    fn a_method_that_lacks_a_kind_of_rays_has_no_speed() {
        let rows = [measured("a", "camera", 8.0, 0), measured("a", "shadow", 2.0, 0), measured("b", "camera", 7.0, 0)];
        let found = relative(&Table::new("rays", "", rows.to_vec())).unwrap();
        assert_eq!((number(&found[0], "relative"), number(&found[1], "relative")), (Some(1.0), None));
        let doubled = [measured("a", "camera", 8.0, 0), measured("a", "camera", 2.0, 0)];
        assert!(relative(&Table::new("rays", "", doubled.to_vec())).is_err());
    }
}
