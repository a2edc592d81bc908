//! What a chart shows: columns of a table. It has no numbers of its own, so that it cannot tell others than the table.

use super::lab::EXACT;
use super::table::{Row, Table, column, name, number};
use serde::{Deserialize, Serialize};

/// How a chart is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChartKind {
    /// Points joined from left to right, one line a series.
    Lines,
    /// Points that have labels; those that nothing beats in both directions (right of them is worse, above is better)
    /// are joined.
    Front,
    /// A bar for each row, by the name in column x.
    Bars,
    /// Squares of column y's rows and column x's columns, coloured by the value.
    Heat,
}

/// A chart of one table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// Its name among those of its study.
    pub name: String,
    /// Above it.
    pub title: String,
    /// Below it: what was run.
    pub caption: String,
    /// The table.
    pub table: String,
    /// How it is drawn.
    pub kind: ChartKind,
    /// The column along the horizontal axis; of bars and squares that with the names.
    pub x: String,
    /// The column along the vertical axis; of bars the one with the lengths.
    pub y: String,
    /// The column whose values tell series apart; of squares the one with the value.
    pub series: Option<String>,
    /// The columns with the ends of the spread of y.
    pub spread: Option<[String; 2]>,
    /// The columns with the ends of what x may be.
    #[serde(default)]
    pub x_spread: Option<[String; 2]>,
    /// Whether each axis, x and y, is logarithmic.
    pub log: [bool; 2],
    /// Only rows that have this value in this column.
    pub only: Option<[String; 2]>,
}

impl Chart {
    /// A chart of columns `x` and `y` of `table`.
    pub fn new(kind: ChartKind, table: &Table, name: &str, title: impl Into<String>, [x, y]: [&str; 2]) -> Chart {
        Chart {
            name: name.to_owned(),
            title: title.into(),
            caption: String::new(),
            table: table.name.clone(),
            kind,
            x: x.to_owned(),
            y: y.to_owned(),
            series: None,
            spread: None,
            x_spread: None,
            log: [false; 2],
            only: None,
        }
    }

    /// With a series for each value of a column.
    #[must_use]
    pub fn by(self, series: &str) -> Chart {
        Chart { series: Some(series.to_owned()), ..self }
    }

    /// With bars from one column to another.
    #[must_use]
    pub fn spread(self, [low, high]: [&str; 2]) -> Chart {
        Chart { spread: Some([low.to_owned(), high.to_owned()]), ..self }
    }

    /// With bars along x from one column to another.
    #[must_use]
    pub fn x_spread(self, [low, high]: [&str; 2]) -> Chart {
        Chart { x_spread: Some([low.to_owned(), high.to_owned()]), ..self }
    }

    /// With logarithmic axes.
    #[must_use]
    pub fn log(self, x: bool, y: bool) -> Chart {
        Chart { log: [x, y], ..self }
    }

    /// Of those rows only.
    #[must_use]
    pub fn only(self, column: &str, value: &str) -> Chart {
        Chart { only: Some([column.to_owned(), value.to_owned()]), ..self }
    }

    /// With a caption.
    #[must_use]
    pub fn caption(self, caption: impl Into<String>) -> Chart {
        Chart { caption: caption.into(), ..self }
    }

    /// The rows that it shows.
    pub fn rows<'a>(&self, table: &'a Table) -> Vec<&'a Row> {
        let is_shown = |row: &&Row| self.only.as_ref().is_none_or(|[column, value]| name(row, column) == *value);
        table.rows.iter().filter(is_shown).collect()
    }

    /// The label of an axis.
    pub fn label(column_name: &str) -> &'static str {
        column(column_name).label
    }
}

/// A point of a chart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    pub x: f64,
    pub y: f64,
    /// The ends of what y may be, and x; the lower one may be 0 on a logarithmic axis.
    pub spread: Option<[f64; 2]>,
    pub x_spread: Option<[f64; 2]>,
    pub label: String,
    /// Whether an answer of this measurement was wrong; `None` where it was not checked.
    pub is_wrong: Option<bool>,
    /// Whether the method is exact by construction, whatever was measured.
    pub is_exact: bool,
}

/// Points that belong together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Series {
    pub name: String,
    pub points: Vec<Point>,
}

/// The series of a chart with numbers on both axes, in the order of their first rows. Rows without a number, or with
/// one that a logarithmic axis cannot show, are left out.
pub(super) fn series(chart: &Chart, table: &Table) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for row in chart.rows(table) {
        let (Some(x), Some(y)) = (number(row, &chart.x), number(row, &chart.y)) else { continue };
        let can_be_shown = |value: f64, is_log: bool| value.is_finite() && (!is_log || value > 0.0);
        if !(can_be_shown(x, chart.log[0]) && can_be_shown(y, chart.log[1])) {
            continue;
        }
        let [spread, x_spread] = [&chart.spread, &chart.x_spread].map(|ends| ends_of(row, ends.as_ref()));
        let (label, is_wrong, is_exact) = (name(row, "method"), is_wrong(row), is_exact(row));
        let point = Point { x, y, spread, x_spread, label, is_wrong, is_exact };
        let series_name = chart.series.as_ref().map(|series| name(row, series)).unwrap_or_default();
        match all.iter_mut().find(|series| series.name == series_name) {
            Some(series) => series.points.push(point),
            None => all.push(Series { name: series_name, points: vec![point] }),
        }
    }
    if chart.kind == ChartKind::Lines {
        all.iter_mut().for_each(|series| series.points.sort_by(|a, b| a.x.total_cmp(&b.x)));
    }
    all
}

/// How much the rows of a chart were measured with, in a sentence: rays, triangles, pixels, answers, rounds.
pub(super) fn sizes(chart: &Chart, table: &Table) -> String {
    let rows = chart.rows(table);
    let range = |column: &str| {
        let values = || rows.iter().filter_map(|row| number(row, column));
        let (low, high) = (values().min_by(f64::total_cmp)?, values().max_by(f64::total_cmp)?);
        Some(if low == high { low.to_string() } else { format!("{low} to {high}") })
    };
    let what = [
        ("triangles", "triangles"),
        ("pixels", "pixels a picture"),
        ("rays", if rows.iter().any(|row| row.contains_key("pixels")) { "rays a picture" } else { "rays a pass" }),
        ("tested", "answers checked a point"),
        ("passes", "rounds"),
    ];
    let told: Vec<_> =
        what.into_iter().filter_map(|(column, unit)| Some(format!("{} {unit}", range(column)?))).collect();
    if told.is_empty() { String::new() } else { format!("Measured with {}.", told.join(", ")) }
}

/// The ends of a spread, both of them finite.
fn ends_of(row: &Row, columns: Option<&[String; 2]>) -> Option<[f64; 2]> {
    let [low, high] = columns?.each_ref().map(|column| number(row, column).filter(|end| end.is_finite()));
    Some([low?, high?])
}

/// Whether the method is exact by construction.
pub(super) fn is_exact(row: &Row) -> bool {
    name(row, "promise") == EXACT
}

/// Whether an answer of the measurement was wrong.
pub(super) fn is_wrong(row: &Row) -> Option<bool> {
    number(row, "wrong").or_else(|| number(row, "wrong_pixels")).map(|wrong| wrong > 0.0)
}

/// The points that no other beats: none is as far left and higher, or as high and farther left. From left to right.
pub(super) fn front(points: &[Point]) -> Vec<&Point> {
    let is_beaten = |p: &&Point| points.iter().any(|q| q.x <= p.x && q.y >= p.y && (q.x < p.x || q.y > p.y));
    let mut front: Vec<_> = points.iter().filter(|p| !is_beaten(p)).collect();
    front.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    front
}

#[cfg(test)]
mod tests {
    use super::super::table::row;
    use super::*;
    use serde_json::json;

    fn table() -> Table {
        let rows = [("a", 4.0, 2.0), ("b", 1.0, 1.0), ("a", 1.0, 3.0), ("a", 0.0, 9.0)];
        let rows = rows.map(|(method, x, y)| {
            row([("method", json!(method)), ("steps", json!(x)), ("tests", json!(y)), ("wrong", json!(y as u64 % 2))])
        });
        Table::new("t", "", rows.to_vec())
    }

    #[test]
    fn lines_go_from_left_to_right_and_leave_out_what_has_no_logarithm() {
        let table = table();
        let chart = Chart::new(ChartKind::Lines, &table, "c", "", ["steps", "tests"]).by("method").log(true, false);
        let shown: Vec<_> = series(&chart, &table)
            .into_iter()
            .map(|series| (series.name, series.points.iter().map(|p| (p.x, p.y, p.is_wrong)).collect::<Vec<_>>()))
            .collect();
        let expected = [
            ("a".to_owned(), vec![(1.0, 3.0, Some(true)), (4.0, 2.0, Some(false))]),
            ("b".to_owned(), vec![(1.0, 1.0, Some(true))]),
        ];
        assert_eq!(shown, expected);
        assert_eq!(chart.only("method", "b").rows(&table).len(), 1);
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let point = |x: f64, y: f64| Point {
            x,
            y,
            spread: None,
            x_spread: None,
            label: String::new(),
            is_wrong: None,
            is_exact: false,
        };
        let points =
            [point(3.0, 3.0), point(1.0, 1.0), point(2.0, 3.0), point(1.0, 0.5), point(4.0, 5.0), point(5.0, 4.0)];
        let found: Vec<_> = front(&points).iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(found, [(1.0, 1.0), (2.0, 3.0), (4.0, 5.0)]);
    }
}
