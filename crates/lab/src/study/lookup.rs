//! How verdicts find their numbers in the rows of a table: by exact values of named columns. A beginning or a part of
//! a name would take rows of other methods along; a row that is there twice would be counted twice, one that lacks its
//! other side would shift a mean. None of these may turn into a number without a word.

use super::Table;
use super::outcome::Rounds;
use super::table::{Row, name, number};
use raybrook::{Error, Result};
use serde_json::Value;

/// Columns, and the value that each has in the rows that are meant, numbers as text.
pub type Key<'a> = [(&'a str, &'a str)];

/// What a study counts of the work on a ray.
const WORK: [&str; 6] = ["steps", "leaves", "tests", "restarts", "node_bytes", "triangle_bytes"];

fn has(row: &Row, key: &Key) -> bool {
    key.iter().all(|(column, value)| row.contains_key(*column) && name(row, column) == *value)
}

/// A key in words.
fn told(key: &Key) -> String {
    key.iter().map(|(column, value)| format!("{column} '{value}'")).collect::<Vec<_>>().join(", ")
}

/// Two rows that differ in nothing but the method.
pub type Pair<'a> = [&'a Row; 2];

/// Which times are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// The device's, for one ray of a batch.
    Ray,
    /// What the user waits for a picture.
    Wall,
}

impl Clock {
    /// The column with the seconds of each round.
    pub fn column(self) -> &'static str {
        match self {
            Clock::Ray => "rounds_s",
            Clock::Wall => "wall_rounds_s",
        }
    }

    /// The times of a row in each round; `None`: they were not measured.
    pub fn times(self, row: &Row) -> Option<Vec<f64>> {
        let rounds = row.get(self.column())?.as_array()?;
        let share = match self {
            Clock::Ray => number(row, "rays").filter(|rays| *rays > 0.0)?,
            Clock::Wall => 1.0,
        };
        rounds.iter().map(|seconds| Value::as_f64(seconds).map(|seconds| seconds / share)).collect()
    }
}

impl Table {
    fn error(&self, message: String) -> Error {
        Error::input(format!("table '{}'", self.name), None, message)
    }

    /// The row of this key; `None`: it was not measured.
    ///
    /// # Errors
    /// [`Error::Input`] when there are several.
    pub fn one(&self, key: &Key) -> Result<Option<&Row>> {
        let mut rows = self.rows.iter().filter(|row| has(row, key));
        match (rows.next(), rows.next()) {
            (found, None) => Ok(found),
            _ => {
                let several = format!("several rows have {}; name each scene and each measurement once", told(key));
                Err(self.error(several))
            }
        }
    }

    /// For each row of key `a` that one of key `b` with the same values in the columns `along`; `None`: one side was
    /// not measured at all.
    ///
    /// # Errors
    /// As [`Table::one`], and when a row lacks its other side.
    pub fn pairs(&self, a: &Key, b: &Key, along: &[&str]) -> Result<Option<Vec<Pair<'_>>>> {
        let count = |key: &Key| self.rows.iter().filter(|row| has(row, key)).count();
        if count(a) == 0 || count(b) == 0 {
            return Ok(None);
        }
        let partners = self.partners(a, b, along)?;
        self.partners(b, a, along)?;
        Ok(Some(partners))
    }

    /// The rows of key `a`, each with its one of key `b`.
    fn partners(&self, a: &Key, b: &Key, along: &[&str]) -> Result<Vec<Pair<'_>>> {
        let rows = self.rows.iter().filter(|row| has(row, a));
        let pairs = rows.map(|row| {
            let values: Vec<String> = along.iter().map(|column| name(row, column)).collect();
            let own: Vec<_> = along.iter().copied().zip(values.iter().map(String::as_str)).collect();
            let [a, b] = [a, b].map(|key| [key, &own].concat());
            self.one(&a)?;
            match self.one(&b)? {
                Some(other) => Ok([row, other]),
                None => Err(self.error(format!("there is a row of {} and none of {}", told(&a), told(&b)))),
            }
        });
        pairs.collect()
    }

    /// How many times the value of the rows of key `b` those of key `a` have in a column: the geometric mean over
    /// pairs of rows that agree in the columns `along`. `None`: one side was not measured.
    ///
    /// # Errors
    /// As [`Table::pairs`].
    pub fn ratio(&self, column: &str, a: &Key, b: &Key, along: &[&str]) -> Result<Option<f64>> {
        Ok(self.pairs(a, b, along)?.and_then(|pairs| mean_ratio(&pairs, column)))
    }

    /// How many times as fast as those of key `b` those of key `a` are, round by round: the geometric mean over pairs
    /// of rows that agree in the columns `along`. `None`: one side was not timed.
    ///
    /// # Errors
    /// As [`Table::pairs`].
    pub fn speedup(&self, clock: Clock, a: &Key, b: &Key, along: &[&str]) -> Result<Option<Rounds>> {
        Ok(self.pairs(a, b, along)?.and_then(|pairs| speedup(&pairs, clock)))
    }
}

/// How many times as fast as the second rows the first ones are, round by round.
pub fn speedup(pairs: &[Pair], clock: Clock) -> Option<Rounds> {
    let times = pairs.iter().map(|[a, b]| Some([clock.times(a)?, clock.times(b)?])).collect::<Option<Vec<_>>>()?;
    let rounds = times.iter().flatten().map(Vec::len).min()?;
    let ratio = |round: usize| geometric_mean(times.iter().map(|[a, b]| Some(b[round] / a[round])));
    Rounds::new((0..rounds).map(ratio).collect::<Option<Vec<_>>>()?)
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
    fn what_lacks_its_other_side_is_named() {
        let lacking = table(&[("s", "a", 8.0), ("s", "b", 2.0), ("t", "a", 100.0)]);
        for (a, b) in [("a", "b"), ("b", "a")] {
            let message = ratio(&lacking, a, b).unwrap_err().to_string();
            assert!(message.contains("a row of method 'a', scene 't' and none of method 'b', scene 't'"), "{message}");
        }
        assert_eq!(ratio(&lacking, "a", "c").unwrap(), None);
        let whole = table(&[("s", "a", 8.0), ("s", "b", 2.0), ("t", "b", 100.0), ("t", "a", 100.0)]);
        assert!((ratio(&whole, "a", "b").unwrap().unwrap() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn rounds_are_compared_one_by_one_and_rays_of_other_numbers_by_the_ray() {
        let timed = |method: &str, rays: u32, rounds: &[f64]| {
            row([("method", json!(method)), ("rays", json!(rays)), ("rounds_s", json!(rounds))])
        };
        let rows = vec![timed("a", 100, &[1.0, 4.0, 1.0]), timed("b", 200, &[4.0, 16.0, 3.0]), timed("c", 100, &[])];
        let table = Table::new("rays", "", rows);
        let speedup = |a, b| table.speedup(Clock::Ray, &[("method", a)], &[("method", b)], &[]).unwrap();
        assert_eq!(speedup("a", "b"), Rounds::new(vec![2.0, 2.0, 1.5]));
        assert_eq!([speedup("a", "c"), speedup("a", "d")], [None, None]);
        let walled = table.speedup(Clock::Wall, &[("method", "a")], &[("method", "b")], &[]).unwrap();
        assert_eq!(walled, None);
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
