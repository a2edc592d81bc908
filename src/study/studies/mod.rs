//! The studies, and what they have in common.

mod economy;
mod memory;
mod pareto;
mod pictures;
mod rays;
mod stability;
mod trees;

use super::table::{Row, name, number, row, values};
use super::{Chart, ChartKind, Lab, Study, Subject, Table, Variant};
use crate::device::DeviceKind;
use crate::options::{Accel, PacketSize, TraceOptions};
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
    fn compare_all(
        &mut self,
        subjects: &[Subject],
        variants: &[Variant],
        kinds: &[usize],
    ) -> crate::error::Result<Vec<Row>> {
        let mut rows = Vec::new();
        for subject in subjects {
            rows.extend(self.compare(subject, variants, kinds)?);
        }
        Ok(rows)
    }
}

/// Options of a structure.
fn with(accel: Accel) -> TraceOptions {
    TraceOptions { accel, ..TraceOptions::DEFAULT }
}

/// The same with packets.
fn in_packets(accel: Accel) -> TraceOptions {
    TraceOptions { packet_size: PacketSize::Sixteen, ..with(accel) }
}

/// The names of the scenes, in order.
fn scenes_of(rows: &[Row]) -> Vec<String> {
    values(rows, "scene")
}

/// The geometric mean of a column over the rows that `is_meant`; `None` of none.
fn mean(rows: &[Row], column: &str, is_meant: impl Fn(&Row) -> bool) -> Option<f64> {
    let values: Vec<f64> =
        rows.iter().filter(|row| is_meant(row)).filter_map(|row| number(row, column)).filter(|v| *v > 0.0).collect();
    let sum: f64 = values.iter().map(|value| value.ln()).sum();
    (!values.is_empty()).then(|| (sum / values.len() as f64).exp())
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

/// How fast each method is relative to the fastest of its scene, by the geometric mean over the kinds of rays, with the errors of all
/// these rays: one row for each scene and method.
fn relative(rows: &[Row]) -> Vec<Row> {
    let mut out: Vec<Row> = Vec::new();
    for scene in scenes_of(rows) {
        let of = |method: &str, row: &Row| name(row, "scene") == scene && name(row, "method") == method;
        let speed = |method: &str, column: &str| mean(rows, column, |row| of(method, row));
        let methods = values(rows.iter().filter(|row| name(row, "scene") == scene), "method");
        let fastest =
            methods.iter().filter_map(|method| speed(method, "mrays_per_s")).fold(f64::MIN_POSITIVE, f64::max);
        for method in &methods {
            let own = || rows.iter().filter(|row| of(method, row));
            let sum = |column: &str| own().filter_map(|row| number(row, column)).sum::<f64>() as usize;
            let mut new = row([("scene", json!(scene)), ("method", json!(method))]);
            if let Some(triangles) = own().next().and_then(|row| row.get("triangles")) {
                new.insert("triangles".into(), triangles.clone());
            }
            let speeds = [("relative", "mrays_per_s"), ("relative_low", "mrays_low"), ("relative_high", "mrays_high")];
            for (relative, column) in speeds {
                new.extend(speed(method, column).map(|speed| (relative.to_owned(), json!(speed / fastest))));
            }
            new.extend(super::lab::errors(sum("wrong"), sum("tested")));
            out.push(new);
        }
    }
    out
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
        let found = relative(&rows);
        let value = |i: usize, column: &str| number(&found[i], column).unwrap();
        assert!((value(0, "relative") - 1.0).abs() < 1e-12 && (value(1, "relative") - 0.5).abs() < 1e-12);
        assert!((value(1, "relative_high") - 1.0).abs() < 1e-12);
        assert_eq!((value(0, "wrong"), value(0, "wrong_per_million")), (3.0, 1500.0));
        assert_eq!((value(1, "wrong_per_million"), value(1, "wrong_bound")), (0.0, 1500.0));
        assert_eq!(error_note(&rows[2..]), "No answer of 2000 was wrong.");
    }
}
