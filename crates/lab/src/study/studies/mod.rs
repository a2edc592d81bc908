//! The studies, and what they have in common.

mod economy;
mod memory;
mod pareto;
mod pictures;
mod rays;
mod stability;
mod trees;

use super::lookup::{geometric_mean, is_same_work};
use super::table::{Row, name, number, row, values};
use super::{Chart, ChartKind, Findings, Header, Lab, Study, Subject, Table, Variant};
use raybrook::Result;
use raybrook::low_level::device::DeviceKind;
use raybrook::low_level::options::{PacketSize, StructureKind, TraceOptions};
use serde_json::json;

/// All of them, in the order of the report.
pub const ALL: &[Study] = &[
    pareto::STUDY,
    stability::STUDY,
    rays::INTERSECTION,
    trees::LEAF_SIZE,
    trees::DEPTH,
    trees::TRIANGLES,
    trees::SPLIT_RULE,
    trees::TRAVERSAL,
    memory::MEMORY_KIND,
    memory::LAYOUT,
    pictures::KERNELS,
    rays::RAY_KIND,
    rays::TRANSFER,
    rays::CPU_GPU,
    pictures::TEXTURING,
    pictures::SUBSAMPLING,
    trees::BOUNDING_VOLUMES,
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

/// What a verdict says part by part, and whether the claim holds in each; `None`: that was not measured.
#[derive(Debug, Default)]
struct Verdict {
    parts: Vec<String>,
    holds: Vec<Option<bool>>,
}

impl Verdict {
    fn say(&mut self, holds: impl Into<Option<bool>>, part: String) {
        self.holds.push(holds.into());
        self.parts.push(part);
    }

    fn not_measured(&mut self, what: &str) {
        self.say(None, format!("{what}: not measured"));
    }

    /// What is said without a bearing on the claim.
    fn add(&mut self, part: String) {
        self.parts.push(part);
    }

    /// Whether the claim holds in every part: not if it fails in one, and unknown if one was not measured.
    fn all(&self) -> Option<bool> {
        match (self.holds.contains(&Some(false)), self.holds.contains(&None) || self.holds.is_empty()) {
            (true, _) => Some(false),
            (false, true) => None,
            (false, false) => Some(true),
        }
    }

    /// Whether the claim holds in some part; unknown where it was measured in none.
    fn any(&self) -> Option<bool> {
        match (self.holds.contains(&Some(true)), self.holds.contains(&Some(false))) {
            (false, false) => None,
            (is_somewhere, _) => Some(is_somewhere),
        }
    }

    /// These findings, where the claim is to hold in every part.
    fn findings(self, tables: Vec<Table>, charts: Vec<Chart>) -> Findings {
        Findings { holds: self.all(), verdict: self.text(), notes: Vec::new(), tables, charts }
    }

    fn text(&self) -> String {
        match &self.parts[..] {
            [] => "Nothing could be measured.".to_owned(),
            parts => parts.join("; ") + ".",
        }
    }
}

impl Findings {
    /// The same, without a judgement where the reference did one and the same work on both sides.
    fn on(self, header: &Header) -> Findings {
        Findings { holds: self.holds.filter(|_| !header.is_reference()), ..self }
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
            if let Some(triangles) = own.first().and_then(|row| row.get("triangles")) {
                new.insert("triangles".into(), triangles.clone());
            }
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

    pub fn header(is_quick: bool) -> Header {
        Header {
            version: String::new(),
            device: "a device".into(),
            device_details: "gpu".into(),
            scenes: Vec::new(),
            seed: 1,
            quick: is_quick,
        }
    }

    /// Of a report that was made without a device.
    pub fn of_reference() -> Header {
        Header { device: crate::study::report::REFERENCE.to_owned(), ..header(false) }
    }

    /// Camera rays: scenes, methods and speeds, none wrong.
    pub fn rays(rows: &[(&str, &str, f64)]) -> Vec<Table> {
        let rows = rows.iter().map(|&(scene, method, rate)| {
            let mut out = row([
                ("scene", json!(scene)),
                ("method", json!(method)),
                ("rays_of", json!("camera")),
                ("mrays_per_s", json!(rate)),
                ("mrays_low", json!(rate)),
                ("mrays_high", json!(rate)),
            ]);
            out.extend(crate::study::lab::errors(0, 1000));
            out
        });
        vec![Table::new("rays", "", rows.collect())]
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

    #[test]
    fn a_claim_holds_only_where_everything_was_measured() {
        let all = |holds: &[Option<bool>]| Verdict { holds: holds.to_vec(), ..Verdict::default() }.all();
        assert_eq!((all(&[]), all(&[None])), (None, None));
        assert_eq!((all(&[Some(true)]), all(&[Some(true), None])), (Some(true), None));
        assert_eq!(all(&[Some(true), None, Some(false)]), Some(false));
    }
}
