//! Where methods break down.

use super::super::cases::Sweep;
use super::super::table::{Row, name, number};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Table, Variant};
use super::with;
use crate::error::Result;
use crate::options::{Accel, Intersector, TraceOptions, Traversal};
use crate::stress::Kind;
use serde_json::json;

pub const STUDY: Study = Study {
    name: "stability",
    title: "Where methods fail",
    claim: "Listing 5.1 of the thesis has an absolute epsilon, and no float32 test is right at every scale. The claim tested: exact hits are right at \
            every number of every sweep and in every failure mode, and lose no path.",
    run,
};

fn methods(lab: &Lab) -> Vec<Variant> {
    let quick = [Intersector::Exact, Intersector::MollerTrumbore, Intersector::Thesis];
    let tests = Intersector::ALL.iter().filter(|test| !lab.quick || quick.contains(test));
    let mut all: Vec<_> =
        tests.map(|&test| Variant::new(test.name(), TraceOptions { intersector: test, ..with(Accel::Bvh2) })).collect();
    if !lab.quick {
        let thesis =
            TraceOptions { traversal: Traversal::ThesisRestart, intersector: Intersector::Thesis, ..with(Accel::Kd) };
        all.push(Variant::new("thesis, its kd-restart", thesis));
    }
    all
}

fn run(lab: &mut Lab) -> Result<Findings> {
    let methods = methods(lab);
    let seed = lab.seed;
    let rays = if lab.quick { 100 } else { 1000 };
    let mut tables = Vec::new();
    let mut charts = Vec::new();
    for sweep in Sweep::ALL.iter().take(if lab.quick { 2 } else { Sweep::ALL.len() }) {
        let values: Vec<f64> = match lab.quick {
            true => sweep.values.iter().copied().step_by(3).collect(),
            false => sweep.values.to_vec(),
        };
        let mut rows = Vec::new();
        for value in values {
            let make = || sweep.case(value, seed, rays);
            rows.extend(lab.judge_case(&methods, sweep.name, &json!(value), rays, make)?);
        }
        let table = Table::new(sweep.name, format!("Wrong answers: {}", sweep.about), rows);
        let title = format!("Wrong answers by: {}", Chart::label(sweep.name));
        charts.push(
            Chart::new(ChartKind::Lines, &table, sweep.name, title, [sweep.name, "wrong_bound"])
                .by("method")
                .log(sweep.is_log, true)
                .caption(format!(
                    "{rays} rays a point: {}. None wrong is drawn at 3/N, where lines may lie on each other. All in bvh2 but for the thesis's own.",
                    sweep.about
                )),
        );
        tables.push(table);
    }
    let depths: &[u32] = if lab.quick { &[2, 8] } else { &[1, 2, 4, 8, 16, 32, 64] };
    let mut rows = Vec::new();
    for &depth in depths {
        rows.extend(lab.lost_paths(&methods, depth)?);
    }
    let table = Table::new("depth", "Paths that escape from a closed room of mirrors", rows);
    charts.push(
        Chart::new(ChartKind::Lines, &table, "depth", "Paths that get lost by their length", ["depth", "wrong_bound"])
            .by("method")
            .log(true, true)
            .caption("Whole pictures from inside a closed mesh whose triangles are all mirrors: every ray must hit, a path is lost with its first ray that does not."),
    );
    tables.push(table);
    let mut rows = Vec::new();
    let modes = if lab.quick { 4 } else { usize::MAX };
    for kind in Kind::all().take(modes) {
        let make = || kind.case(seed, rays / 2);
        rows.extend(lab.judge_case(&methods, "mode", &json!(kind.name), rays / 2, make)?);
    }
    let table = Table::new("modes", "Wrong answers by failure mode, a kind of `raybrook stress` each", rows);
    charts.push(
        Chart::new(
            ChartKind::Heat,
            &table,
            "modes",
            "Failure modes: wrong answers per million rays",
            ["method", "mode"],
        )
        .by("wrong_per_million")
        .caption(format!("{} rays a square; `raybrook stress --list` tells what each kind is.", rays / 2)),
    );
    tables.push(table);
    let of_exact = |row: &&Row| name(row, "method") == Intersector::Exact.name();
    let sum = |column: &str| -> f64 {
        tables.iter().flat_map(|table| &table.rows).filter(of_exact).filter_map(|row| number(row, column)).sum()
    };
    let (wrong, tested) = (sum("wrong"), sum("tested"));
    let verdict = format!("exact hits had {wrong} wrong answers of {tested}. {}", breakdowns(&tables, &methods));
    let notes = vec![
        "Exact hits are judged to the last bit of t, the others within what rounding in float32 may do to a ray; only what lies beyond that counts as wrong."
            .to_owned(),
    ];
    Ok(Findings { holds: Some(wrong == 0.0), verdict, notes, tables, charts })
}

/// The first sweep's value from which on each method has one wrong answer in a thousand, in a sentence.
fn breakdowns(tables: &[Table], methods: &[Variant]) -> String {
    let mut parts = Vec::new();
    for method in methods.iter().skip(1) {
        let dies: Vec<_> = tables
            .iter()
            .filter(|table| table.name != "modes")
            .filter_map(|table| {
                let bad = |row: &&Row| {
                    name(row, "method") == method.label
                        && number(row, "wrong_per_million").is_some_and(|wrong| wrong >= 1000.0)
                };
                Some(format!("{} {}", table.name, name(table.rows.iter().find(bad)?, &table.name)))
            })
            .collect();
        if !dies.is_empty() {
            parts.push(format!("{} from {} on", method.label, dies.join(", ")));
        }
    }
    match parts.is_empty() {
        true => "No other method had one wrong answer in a thousand in a sweep.".to_owned(),
        false => format!("One answer in a thousand or more is wrong with {}.", parts.join("; with ")),
    }
}
