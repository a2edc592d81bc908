//! What structures are made with: cells of a grid, and what ends the division of a kd-tree.

use super::super::lookup::{Clock, is_same_work, speedup};
use super::super::table::name;
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{BATCH, CAMERA, SPREAD, Verdict, alike, by_scene, error_note, largest, scenes_of, usual_rays, with};
use raybrook::Result;
use raybrook::low_level::options::{Build, GridOptions, KdOptions, Stop, Structure, StructureKind, TraceOptions};

pub const GRID_SIZE: Study = Study {
    name: "grid-size",
    title: "Cells of a uniform grid",
    claim: "Thesis, section 2.2.3: a uniform grid is the simplest division of space, and its resolution decides how \
            good it is. The claim tested: the resolution that the program chooses has at least 0.9 of the speed of the \
            best of a series.",
    own_shapes: None,
    source: include_str!("structures.rs"),
    measure: grid_size,
    judge: judge_grid_size,
};

/// The program's own choice.
const CHOSEN: &str = "chosen by the program";

fn grid_size(lab: &mut Lab) -> Result<Vec<Table>> {
    let sizes: &[u32] = if lab.quick { &[8, 32, 64] } else { &[4, 8, 16, 32, 48, 64, 96, 128, 192, 256] };
    let mut variants = vec![Variant::new(CHOSEN, with(StructureKind::Grid))];
    variants.extend(sizes.iter().map(|&size| {
        let structure = Structure::Grid(GridOptions { size: Some([size; 3]) });
        let options = TraceOptions { structure, ..with(StructureKind::Grid) };
        Variant::new(format!("{size} cells a side"), options).with("cells", size)
    }));
    let subjects = lab.usual_subjects()?;
    let rows = lab.compare_all(&subjects, &variants, &[CAMERA])?;
    Ok(vec![Table::new("rays", "Camera rays by the cells along each side of a grid", rows)])
}

fn judge_grid_size(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let chosen = table.one(&[("scene", &scene), ("method", CHOSEN)])?;
        let of_series = table.rows.iter().filter(|row| name(row, "scene") == scene && row.contains_key("cells"));
        let best = largest(of_series, "mrays_per_s");
        match chosen.zip(best).and_then(|(chosen, best)| Some((best, speedup(&[[chosen, best]], Clock::Ray)?))) {
            Some((best, ratio)) => verdict.say(
                ratio.above(0.9),
                format!("{scene}: the chosen grid has {ratio} times the speed of the best, {}", name(best, "method")),
            ),
            None => verdict.not_measured(&scene),
        }
    }
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| {
        Chart::new(ChartKind::Lines, &table, name, title, ["cells", y]).by("scene").log(true, true)
    };
    let charts = vec![
        chart("speed", "Speed by the cells along each side", "mrays_per_s")
            .spread(SPREAD)
            .caption(format!("Camera rays, exact hits. {note}")),
        chart("tests", "Triangle tests by the cells along each side", "tests").caption("The same rays, counted."),
        chart("memory", "Memory by the cells along each side", "bytes_per_triangle"),
    ];
    Ok(verdict.findings(vec![table], charts))
}

pub const STOP: Study = Study {
    name: "stop-rule",
    title: "What ends the division of a kd-tree",
    claim: "Thesis, section 5.5: a node is divided until few triangles are left, until the tree is deep enough, or \
            until it does not pay; Mental Ray's limits of 4 triangles and depth 24 are quoted. The claim tested: trees \
            by areas that end where it does not pay are faster than those that end by any number of triangles in a \
            leaf.",
    own_shapes: None,
    source: include_str!("structures.rs"),
    measure: stop,
    judge: judge_stop,
};

/// The division ends where it does not pay.
const BY_COST: &str = "by cost";
/// The thesis's example.
const MENTAL_RAY: &str = "4 triangles, depth 24";
const STOP_TITLE: &str = "Speed by what ends the division";

fn stop(lab: &mut Lab) -> Result<Vec<Table>> {
    let kd = |kd: KdOptions| TraceOptions::of_kd(KdOptions { build: Build::Sah, ..kd });
    let by_size = KdOptions { stop: Some(Stop::Size), ..KdOptions::DEFAULT };
    let mut variants = vec![
        Variant::new(BY_COST, kd(KdOptions { stop: Some(Stop::Cost), ..KdOptions::DEFAULT })),
        Variant::new(MENTAL_RAY, kd(KdOptions { leaf_size: Some(4), max_depth: Some(24), ..by_size })),
    ];
    let sizes: &[u32] = if lab.quick { &[2, 16] } else { &[1, 2, 4, 8, 16, 32, 64] };
    variants.extend(sizes.iter().map(|&size| {
        let options = kd(KdOptions { leaf_size: Some(size), ..by_size });
        Variant::new(format!("at {size}"), options).with("leaf_size", size)
    }));
    usual_rays(lab, &variants, STOP_TITLE)
}

fn judge_stop(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let mut verdict = Verdict::default();
    let sizes = super::values(table.rows.iter().filter(|row| row.contains_key("leaf_size")), "method");
    for scene in scenes_of(&table.rows) {
        let by_cost = [("scene", scene.as_str()), ("method", BY_COST)];
        let mut compared = Vec::new();
        for size in &sizes {
            let by_size = [("scene", scene.as_str()), ("method", size.as_str())];
            let Some(pairs) = table.pairs(&by_cost, &by_size, &["rays_of"])? else { continue };
            let ratio = speedup(&pairs, Clock::Ray).filter(|_| !is_same_work(&pairs));
            compared.extend(ratio.map(|ratio| (size, ratio)));
        }
        // The size that leaves the cost the least ahead.
        match compared.into_iter().min_by(|a, b| a.1.ratio().total_cmp(&b.1.ratio())) {
            Some((size, ratio)) => verdict.say(
                ratio.above(1.0),
                format!("{scene}: trees that end by cost have {ratio} times the speed of the best that end {size}"),
            ),
            None => verdict.not_measured(&scene),
        }
    }
    let note = error_note(&table.rows);
    let charts = |file: &str, title: &str, y: &str, caption: &str| {
        by_scene(ChartKind::Bars, &table, file, title, ["method", y], |chart| chart.by("rays_of").caption(caption))
    };
    let speeds = charts("speed", "speed", "mrays_per_s", &format!("kd-tree by areas, full stack, exact hits. {note}"));
    let costs = charts("cost", "expected cost", "tree_cost", "By surface areas; a step and a test cost 1 each.");
    let charts = speeds.into_iter().zip(costs).flat_map(|(speed, cost)| [speed.spread(SPREAD), cost]).collect();
    let notes = alike(&table)?;
    Ok(Findings { notes, ..verdict.findings(vec![table], charts) })
}

#[cfg(test)]
mod tests {
    use super::super::super::outcome::Outcome;
    use super::super::rows_of::{header, judge, rays, with_columns, work};
    use super::*;
    use crate::study::table::number;
    use serde_json::json;

    #[test]
    fn the_chosen_grid_is_compared_with_the_best_of_the_series() {
        let found = |chosen: f64| {
            let rows = rays(&[("s", CHOSEN, chosen), ("s", "8 cells a side", 5.0), ("s", "64 cells a side", 10.0)]);
            let rows = with_columns(rows, |row| {
                let cells = name(row, "method").split(' ').next().and_then(|number| number.parse::<u32>().ok());
                cells.map(|cells| ("cells".to_owned(), json!(cells))).into_iter().collect()
            });
            judge(&GRID_SIZE, rows, &header(false)).unwrap()
        };
        assert_eq!(found(9.5).outcome, Outcome::Holds);
        assert!(found(9.5).verdict.contains("0.95 [0.95, 0.95] times the speed of the best, 64 cells a side"));
        assert_eq!(found(8.0).outcome, Outcome::Fails);
        let alone = judge(&GRID_SIZE, rays(&[("s", CHOSEN, 1.0)]), &header(false)).unwrap();
        assert_eq!(alone.outcome, Outcome::Undecided);
    }

    #[test]
    fn ends_by_cost_are_compared_with_the_best_end_by_size() {
        let found = |best: f64, is_alike: bool| {
            let rows = rays(&[("s", BY_COST, 10.0), ("s", MENTAL_RAY, 99.0), ("s", "at 2", 5.0), ("s", "at 8", best)]);
            let rows = with_columns(rows, |row| {
                let size = name(row, "method").strip_prefix("at ").and_then(|size| size.parse::<u32>().ok());
                let mut out = work(if is_alike { 1.0 } else { number(row, "mrays_per_s").unwrap() });
                out.extend(size.map(|size| ("leaf_size".to_owned(), json!(size))));
                out
            });
            judge(&STOP, rows, &header(false)).unwrap()
        };
        let holds = found(8.0, false);
        assert_eq!(holds.outcome, Outcome::Holds);
        assert!(holds.verdict.contains("1.25 [1.25, 1.25] times the speed of the best that end at 8"));
        assert_eq!(found(12.0, false).outcome, Outcome::Fails);
        // The same tree twice is no comparison.
        assert_eq!(found(12.0, true).outcome, Outcome::Undecided);
    }
}
