//! Pictures that several studies of one report timed. Methods of one study take turns, studies do not, and they may be
//! of different days: how far the times of one picture lie apart says how far times of different studies can be
//! compared at all.

use super::Entry;
use super::table::{name, number};
use std::collections::BTreeMap;

/// What makes a picture the same: with as many pixels and rays it took the same work.
const SAME: [&str; 6] = ["scene", "triangles", "method", "depth", "pixels", "rays"];

/// A picture, and the seconds that each study waited for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Repeated {
    /// Its scene and its method.
    pub name: String,
    /// Studies and their medians, the shortest first.
    pub times: Vec<(String, f64)>,
}

impl Repeated {
    /// The longest of its times by the shortest.
    pub fn ratio(&self) -> f64 {
        let seconds = |time: Option<&(String, f64)>| time.map_or(1.0, |(_, seconds)| *seconds);
        seconds(self.times.last()) / seconds(self.times.first())
    }
}

/// Pictures that more than one study timed by the wall clock, those whose times agree best first.
pub fn repeated(entries: &[Entry]) -> Vec<Repeated> {
    let mut pictures: BTreeMap<[String; SAME.len()], Vec<(String, f64)>> = BTreeMap::new();
    for entry in entries {
        for row in entry.findings.tables.iter().flat_map(|table| &table.rows) {
            let Some(seconds) = number(row, "wall_s").filter(|seconds| *seconds > 0.0) else { continue };
            if SAME.iter().all(|column| row.contains_key(*column)) {
                let times = pictures.entry(SAME.map(|column| name(row, column))).or_default();
                times.push((entry.study.clone(), seconds));
            }
        }
    }
    let mut found: Vec<Repeated> = pictures
        .into_iter()
        .filter(|(_, times)| times.iter().any(|(study, _)| *study != times[0].0))
        .map(|([scene, _, method, ..], mut times)| {
            times.sort_by(|a, b| a.1.total_cmp(&b.1));
            Repeated { name: format!("{scene}, {method}"), times }
        })
        .collect();
    found.sort_by(|a, b| a.ratio().total_cmp(&b.ratio()));
    found
}

#[cfg(test)]
mod tests {
    use super::super::report::Header;
    use super::super::table::{Row, Table, row};
    use super::super::{Findings, Outcome};
    use super::*;
    use serde_json::json;

    fn picture(scene: &str, rays: u64, seconds: f64) -> Row {
        row([
            ("scene", json!(scene)),
            ("triangles", json!(12)),
            ("method", json!("1 sample")),
            ("depth", json!(8)),
            ("pixels", json!(100)),
            ("rays", json!(rays)),
            ("wall_s", json!(seconds)),
        ])
    }

    fn entry(study: &str, rows: Vec<Row>) -> Entry {
        let header = Header {
            version: String::new(),
            device: String::new(),
            device_details: String::new(),
            machine: String::new(),
            scenes: Vec::new(),
            seed: 1,
            quick: false,
        };
        let tables = vec![Table::new("pictures", "", rows)];
        let (verdict, notes, charts) = (String::new(), Vec::new(), Vec::new());
        let findings = Findings { outcome: Outcome::Undecided, verdict, notes, tables, charts };
        let text = String::new;
        Entry {
            study: study.to_owned(),
            findings,
            command: text(),
            seconds: 0.0,
            header,
            date: text(),
            commit: text(),
            sources: text(),
            earlier: None,
        }
    }

    #[test]
    fn the_same_picture_of_two_studies_is_found_and_others_are_not() {
        let batches = row([("scene", json!("hall")), ("method", json!("1 sample")), ("wall_s", json!(1.0))]);
        let first = vec![picture("hall", 200, 0.25), picture("still life", 300, 1.0), batches.clone()];
        let second = vec![picture("hall", 201, 9.0), picture("still life", 300, 0.5), batches];
        let third = vec![picture("hall", 200, 0.5), picture("hall", 201, 9.0), picture("hall", 200, 0.125)];
        let found = repeated(&[entry("a", first), entry("b", second), entry("c", third)]);
        let told: Vec<_> = found.iter().map(|picture| (picture.name.as_str(), picture.ratio())).collect();
        assert_eq!(told, [("hall, 1 sample", 1.0), ("still life, 1 sample", 2.0), ("hall, 1 sample", 4.0)]);
        let studies: Vec<_> = found[2].times.iter().map(|(study, _)| study.as_str()).collect();
        assert_eq!(studies, ["c", "a", "c"]);
        // One study alone has nothing to be compared with.
        let twice = vec![picture("hall", 1, 1.0), picture("hall", 1, 2.0)];
        assert_eq!(repeated(&[entry("a", twice)]), []);
    }
}
