//! How verdicts find their numbers in the rows of a table: by exact values of named columns. A beginning or a part of
//! a name would take rows of other methods along; a row that is there twice would be counted twice. Neither may turn
//! into a number without a word.

use super::Table;
use super::table::{Row, name, number};
use raybrook::{Error, Result};

/// Columns, and the value that each has in the rows that are meant, numbers as text.
pub type Key<'a> = [(&'a str, &'a str)];

/// What a study counts of the work on a ray.
const WORK: [&str; 6] = ["steps", "leaves", "tests", "restarts", "node_bytes", "triangle_bytes"];

fn has(row: &Row, key: &Key) -> bool {
    key.iter().all(|(column, value)| row.contains_key(*column) && name(row, column) == *value)
}

/// Two rows that differ in nothing but the method.
pub type Pair<'a> = [&'a Row; 2];

impl Table {
    /// The row of this key; `None`: it was not measured.
    ///
    /// # Errors
    /// [`Error::Input`] when there are several.
    pub fn one(&self, key: &Key) -> Result<Option<&Row>> {
        let mut rows = self.rows.iter().filter(|row| has(row, key));
        match (rows.next(), rows.next()) {
            (found, None) => Ok(found),
            _ => Err(Error::input(format!("table '{}'", self.name), None, {
                let parts: Vec<_> = key.iter().map(|(column, value)| format!("{column} '{value}'")).collect();
                format!("several rows have {}; name each scene and each measurement once", parts.join(", "))
            })),
        }
    }

    /// For each row of key `a` that one of key `b` with the same values in the columns `along`; `None` where one of
    /// them lacks the other: what is compared must have been measured on both sides.
    ///
    /// # Errors
    /// As [`Table::one`].
    pub fn pairs(&self, a: &Key, b: &Key, along: &[&str]) -> Result<Option<Vec<Pair<'_>>>> {
        let mut pairs = Vec::new();
        for row in self.rows.iter().filter(|row| has(row, a)) {
            let values: Vec<String> = along.iter().map(|column| name(row, column)).collect();
            let with_values = |key: &Key| -> Result<Option<&Row>> {
                let own = along.iter().copied().zip(values.iter().map(String::as_str));
                self.one(&key.iter().copied().chain(own).collect::<Vec<_>>())
            };
            let (Some(first), Some(second)) = (with_values(a)?, with_values(b)?) else { return Ok(None) };
            pairs.push([first, second]);
        }
        let of_b = self.rows.iter().filter(|row| has(row, b)).count();
        Ok((!pairs.is_empty() && of_b == pairs.len()).then_some(pairs))
    }

    /// How many times the value of the rows of key `b` those of key `a` have in a column: the geometric mean over
    /// pairs of rows that agree in the columns `along`. `None`: one side was not measured.
    ///
    /// # Errors
    /// As [`Table::one`].
    pub fn ratio(&self, column: &str, a: &Key, b: &Key, along: &[&str]) -> Result<Option<f64>> {
        Ok(self.pairs(a, b, along)?.and_then(|pairs| mean_ratio(&pairs, column)))
    }
}

/// The geometric mean; `None` of nothing, or where a value is missing.
pub fn geometric_mean(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let logs = values.into_iter().map(|value| value.filter(|v| *v > 0.0 && v.is_finite()).map(f64::ln));
    let logs = logs.collect::<Option<Vec<_>>>().filter(|logs| !logs.is_empty())?;
    Some((logs.iter().sum::<f64>() / logs.len() as f64).exp())
}

/// The geometric mean of the first rows' values by the second ones'; `None` where a value is missing.
pub fn mean_ratio(pairs: &[Pair], column: &str) -> Option<f64> {
    geometric_mean(pairs.iter().map(|[a, b]| Some(number(a, column)? / number(b, column)?)))
}

/// Whether the rows of every pair count the same work, so that what was timed is one thing twice.
pub fn is_same_work(pairs: &[Pair]) -> bool {
    let is_same = |[a, b]: &Pair| WORK.iter().all(|column| a.contains_key(*column) && a.get(*column) == b.get(*column));
    !pairs.is_empty() && pairs.iter().all(is_same)
}

#[cfg(test)]
mod tests {
    use super::super::table::row;
    use super::*;
    use serde_json::json;

    fn table(rows: &[(&str, &str, f64)]) -> Table {
        let rows = rows.iter().map(|(scene, method, rate)| {
            row([("scene", json!(scene)), ("method", json!(method)), ("mrays_per_s", json!(rate))])
        });
        Table::new("rays", "", rows.collect())
    }

    fn ratio(table: &Table, a: &str, b: &str) -> Result<Option<f64>> {
        table.ratio("mrays_per_s", &[("method", a)], &[("method", b)], &["scene"])
    }

    #[test]
    fn a_longer_name_is_another_row() {
        let table =
            table(&[("s", "restart", 2.0), ("s", "restart as the thesis prints it", 50.0), ("s", "stack", 4.0)]);
        assert_eq!(ratio(&table, "stack", "restart").unwrap(), Some(2.0));
        assert_eq!(ratio(&table, "restart", "stack").unwrap(), Some(0.5));
        assert_eq!(table.one(&[("method", "rest")]).unwrap(), None);
    }

    #[test]
    fn what_lacks_its_other_side_is_not_measured() {
        let lacking = table(&[("s", "a", 8.0), ("s", "b", 2.0), ("t", "a", 100.0)]);
        assert_eq!(ratio(&lacking, "a", "b").unwrap(), None);
        assert_eq!(ratio(&lacking, "b", "a").unwrap(), None);
        assert_eq!(ratio(&lacking, "a", "c").unwrap(), None);
        let whole = table(&[("s", "a", 8.0), ("s", "b", 2.0), ("t", "b", 100.0), ("t", "a", 100.0)]);
        assert!((ratio(&whole, "a", "b").unwrap().unwrap() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_row_that_is_there_twice_is_an_error() {
        let doubled = table(&[("s", "a", 8.0), ("s", "a", 2.0), ("s", "b", 1.0)]);
        let error = doubled.one(&[("scene", "s"), ("method", "a")]).unwrap_err().to_string();
        assert!(error.contains("scene 's', method 'a'") && error.contains("'rays'"), "{error}");
        assert!(ratio(&doubled, "a", "b").is_err() && ratio(&doubled, "b", "a").is_err());
    }

    #[test]
    fn the_same_work_is_noticed_and_unknown_work_is_not_the_same() {
        let counted = |tests: f64| row(WORK.map(|column| (column, json!(if column == "tests" { tests } else { 1.0 }))));
        let (a, b, unknown) = (counted(2.0), counted(3.0), Row::new());
        assert!(is_same_work(&[[&a, &a.clone()]]));
        assert!(!is_same_work(&[[&a, &a], [&a, &b]]));
        assert!(!is_same_work(&[[&unknown, &unknown]]) && !is_same_work(&[]));
    }
}
