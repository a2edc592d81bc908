//! What of the time goes into triangle tests.
//!
//! Trees with leaves of different sizes make the same rays take steps and tests in different proportions. A line is
//! laid through their times by least squares: time = a steps + b tests, both counted. b times the tests is the tests'
//! share. Nothing in the kernels is changed, so that what is measured is what runs.
//!
//! Bad at: times that go with something else, such as caches that a deep tree does not fit into. The part of the
//! variation that the line explains is told.

use super::super::lookup::Clock;
use super::super::outcome::{Outcome, Rounds};
use super::super::table::{Row, name, number, row, values};
use super::super::{ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{CAMERA, Verdict, by_scene, error_note, largest, scenes_of};
use raybrook::Result;
use raybrook::low_level::options::{Build, Intersector, KdOptions, TraceOptions};
use serde_json::json;

pub const STUDY: Study = Study {
    name: "test-share",
    title: "What triangle tests take of the time",
    claim: "Thesis, section 5.4.3: the triangle tests take 1/6 to 1/5 of the traversal's time. The claim tested: at \
            the fastest size of leaves they take between 1/8 and 1/4.",
    own_shapes: None,
    source: include_str!("share.rs"),
    measure,
    judge,
};

/// The share that is about the claimed one.
const CLAIMED: [f64; 2] = [0.125, 0.25];

fn measure(lab: &mut Lab) -> Result<Vec<Table>> {
    let sizes: &[u32] = if lab.quick { &[1, 8, 32] } else { &[1, 2, 4, 8, 16, 32, 64] };
    let tests = [Intersector::MollerTrumbore, Intersector::Exact];
    let variants = tests.iter().flat_map(|&intersector| {
        sizes.iter().map(move |&size| {
            let kd = KdOptions { build: Build::Median, leaf_size: Some(size), ..KdOptions::DEFAULT };
            let options = TraceOptions { intersector, ..TraceOptions::of_kd(kd) };
            Variant::new(format!("{intersector}, {size}"), options)
                .with("leaf_size", size)
                .with("test", intersector.name())
        })
    });
    let variants: Vec<_> = variants.collect();
    let subjects = lab.usual_subjects()?;
    let rows = lab.compare_all(&subjects, &variants, &[CAMERA])?;
    Ok(vec![Table::new("rays", "Camera rays by triangle test and the most triangles of a leaf", rows)])
}

fn judge(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "test", "leaf_size"])?;
    let mut verdict = Verdict::default();
    let mut shares = Vec::new();
    for scene in scenes_of(&table.rows) {
        for test in values(&table.rows, "test") {
            let of = |row: &&Row| name(row, "scene") == scene && name(row, "test") == test;
            let rows: Vec<&Row> = table.rows.iter().filter(of).collect();
            let Some(Shares { best, of_tests, explained }) = shares_of(&rows) else {
                verdict.not_measured(&format!("{scene}, {test}"));
                continue;
            };
            let outcome = Outcome::all([of_tests.above(CLAIMED[0]), of_tests.below(CLAIMED[1])]);
            let (size, told) = (name(best, "leaf_size"), 100.0 * explained);
            let part = format!(
                "{scene}, {test}: tests take {of_tests} of the time with at most {size} triangles a leaf (the line \
                 explains {told:.0} % of the variation)"
            );
            // The thesis had one test; the exact one is there to be compared.
            match test == Intersector::MollerTrumbore.name() {
                true => verdict.say(outcome, part),
                false => verdict.add(part),
            }
            let mut out = row([("scene", json!(scene)), ("test", json!(test)), ("share", json!(of_tests.ratio()))]);
            out.extend(
                ["leaf_size", "steps", "tests", "wrong", "tested"]
                    .iter()
                    .filter_map(|column| Some(((*column).to_owned(), best.get(*column)?.clone()))),
            );
            out.insert("explained".into(), json!(explained));
            shares.push(out);
        }
    }
    let shares = Table::new("shares", "Share of triangle tests at the fastest size of leaves", shares);
    let note = error_note(&table.rows);
    let charts =
        by_scene(ChartKind::Lines, &table, "speed", "speed by size of leaves", ["leaf_size", "mrays_per_s"], |chart| {
            let chart = chart.by("test").spread(super::SPREAD).log(true, true);
            chart.caption(format!("Camera rays, kd-tree by medians, full stack. {note}"))
        });
    Ok(verdict.findings(vec![shares, table], charts))
}

struct Shares<'a> {
    /// The row of the fastest size.
    best: &'a Row,
    /// Of the time there, round by round.
    of_tests: Rounds,
    /// The part of the variation that the line explains, 0 to 1, of the medians.
    explained: f64,
}

/// The share of tests in the time of the fastest of `rows`; `None`: too little was measured, or it does not go with
/// steps and tests.
fn shares_of<'a>(rows: &[&'a Row]) -> Option<Shares<'a>> {
    let best = largest(rows.iter().copied(), "mrays_per_s")?;
    let work = |row: &Row| Some([number(row, "steps")?, number(row, "tests")?]);
    let works = rows.iter().map(|row| work(row)).collect::<Option<Vec<_>>>()?;
    let times = rows.iter().map(|row| Clock::Ray.times(row)).collect::<Option<Vec<_>>>()?;
    let rounds = times.iter().map(Vec::len).min().filter(|_| rows.len() >= 3)?;
    let [steps, tests] = work(best)?;
    let share = |round: usize| {
        let [a, b] = line(works.iter().copied().zip(times.iter().map(|rounds| rounds[round])))?;
        (a > 0.0 && b > 0.0).then(|| b * tests / (a * steps + b * tests))
    };
    let of_tests = Rounds::new((0..rounds).map(share).collect::<Option<Vec<_>>>()?)?;
    let medians: Vec<f64> =
        times.iter().map(|rounds| raybrook::low_level::stats::median(rounds)).collect::<Option<Vec<_>>>()?;
    let [a, b] = line(works.iter().copied().zip(medians.iter().copied()))?;
    let mean = medians.iter().sum::<f64>() / medians.len() as f64;
    let squares = |error: &dyn Fn(usize) -> f64| (0..medians.len()).map(|i| error(i).powi(2)).sum::<f64>();
    let left = squares(&|i| medians[i] - a * works[i][0] - b * works[i][1]);
    let all = squares(&|i| medians[i] - mean);
    Some(Shares { best, of_tests, explained: (1.0 - left / all).max(0.0) })
}

/// a and b of time = a steps + b tests, by least squares of relative errors: slow trees shall not count for more than
/// fast ones.
fn line(points: impl Iterator<Item = ([f64; 2], f64)>) -> Option<[f64; 2]> {
    let (mut ss, mut st, mut tt, mut s, mut t) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for ([steps, tests], time) in points {
        let (steps, tests) = (steps / time, tests / time);
        ss += steps * steps;
        st += steps * tests;
        tt += tests * tests;
        s += steps;
        t += tests;
    }
    let det = ss * tt - st * st;
    let solved = [(s * tt - t * st) / det, (t * ss - s * st) / det];
    solved.iter().all(|value| value.is_finite()).then_some(solved)
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{self, header, timed};
    use super::*;

    /// Trees of leaves of 1, 8 and 64 whose rays take 1 for a step and `cost` for a test.
    fn judged(cost: f64, noise: f64) -> Findings {
        let rows = [(1, 30.0, 2.0), (8, 20.0, 10.0), (64, 12.0, 80.0)].map(|(size, steps, tests)| {
            let mut out = row([("scene", json!("s")), ("test", json!("moller-trumbore")), ("leaf_size", json!(size))]);
            out.extend(row([("steps", json!(steps)), ("tests", json!(tests))]));
            out.extend(timed(1000.0 / (steps + cost * tests + noise * f64::from(size % 5))));
            out.extend(crate::study::lab::errors(0, 100));
            out
        });
        rows_of::judge(&STUDY, vec![Table::new("rays", "", rows.to_vec())], &header(false)).unwrap()
    }

    #[test]
    fn the_share_of_tests_is_found_from_counts_and_times() {
        // The fastest has 20 steps and 10 tests: 5 of 25.
        let holds = judged(0.5, 0.0);
        assert_eq!(holds.outcome, Outcome::Holds, "{}", holds.verdict);
        let words = "tests take 0.20 [0.20, 0.20] of the time with at most 8 triangles a leaf (the line explains 100 %";
        assert!(holds.verdict.contains(words), "{}", holds.verdict);
        assert_eq!(judged(2.0, 0.0).outcome, Outcome::Fails);
        assert_eq!(judged(0.1, 0.0).outcome, Outcome::Fails);
        // What goes with neither is told.
        let noisy = judged(0.5, 20.0);
        assert!(!noisy.verdict.contains("explains 100 %"), "{}", noisy.verdict);
        let nothing = rows_of::judge(&STUDY, vec![Table::new("rays", "", Vec::new())], &header(false)).unwrap();
        assert_eq!(nothing.outcome, Outcome::Undecided);
    }
}
