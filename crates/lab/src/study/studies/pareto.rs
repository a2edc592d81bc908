//! THE chart: speed against wrong answers.

use super::super::lab::errors;
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{
    ALL_KINDS, BATCH, MOST_FOR_LISTS, PICTURE, by_scene, in_packets, mean, ratio_of, relative, scenes_of, with,
};
use crate::stress::Kind;
use raybrook::Result;
use raybrook::low_level::options::{Intersector, KdOptions, StructureKind, TraceOptions, Traversal};
use serde_json::json;

pub const STUDY: Study = Study {
    name: "pareto",
    title: "Speed against accuracy",
    claim: "What this program is for: exact hits need not cost speed. The claim tested: some method without a wrong answer, of stress rays and of the \
            scene's, has at least half of the speed of the fastest method of all.",
    own_shapes: Some("the meshes of stress rays"),
    measure,
    judge,
};

/// The methods: every structure with exact hits, every traversal of the kd-tree, and every triangle test in a hierarchy
/// and in a kd-tree.
fn variants(lab: &Lab, triangle_count: usize) -> Vec<Variant> {
    let exact = |accel: StructureKind| Variant::new(format!("{accel}, exact"), with(accel));
    let tested = |accel: StructureKind, intersector: Intersector| {
        Variant::new(format!("{accel}, {intersector}"), TraceOptions { intersector, ..with(accel) })
    };
    if lab.quick {
        let packets = lab.is_cpu().then(|| Variant::new("bvh8 in packets, exact", in_packets(StructureKind::Bvh8)));
        let others = [
            exact(StructureKind::Kd),
            exact(StructureKind::Bvh2),
            tested(StructureKind::Bvh2, Intersector::MollerTrumbore),
            tested(StructureKind::Kd, Intersector::Thesis),
        ];
        return packets.into_iter().chain(others).collect();
    }
    let is_list =
        |accel: StructureKind| matches!(accel, StructureKind::Brute | StructureKind::Boxes | StructureKind::Spheres);
    let mut all: Vec<_> = StructureKind::ALL
        .iter()
        .filter(|&&accel| !is_list(accel) || triangle_count <= MOST_FOR_LISTS)
        .map(|&accel| exact(accel))
        .collect();
    if lab.is_cpu() {
        for accel in [StructureKind::Bvh8, StructureKind::Kd] {
            all.push(Variant::new(format!("{accel} in packets, exact"), in_packets(accel)));
        }
    }
    for &traversal in Traversal::ALL.iter().filter(|&&traversal| traversal != Traversal::Stack) {
        all.push(Variant::new(
            format!("kd, {traversal}, exact"),
            TraceOptions::of_kd(KdOptions { traversal, ..KdOptions::DEFAULT }),
        ));
    }
    for accel in [StructureKind::Bvh2, StructureKind::Kd] {
        all.extend(
            Intersector::ALL.iter().filter(|&&test| test != Intersector::Exact).map(|&test| tested(accel, test)),
        );
    }
    all
}

fn measure(lab: &mut Lab) -> Result<Vec<Table>> {
    let subjects = lab.usual_subjects()?;
    let mut rays = Vec::new();
    for subject in &subjects {
        let variants = variants(lab, subject.triangle_count);
        rays.extend(lab.compare(subject, &variants, &ALL_KINDS)?);
    }
    let variants = variants(lab, subjects.iter().map(|subject| subject.triangle_count).max().unwrap_or(0));
    let stressed = stress(lab, &variants)?;
    Ok(vec![
        Table::new("rays", "All measurements on the scenes", rays),
        Table::new("modes", "Wrong answers by kind of stress rays", stressed),
        super::pictures::tradeoff(lab)?,
    ])
}

fn judge(found: &Measured) -> Result<Findings> {
    let rays = found.table("rays", &BATCH)?;
    let modes = found.table("modes", &["method", "mode"])?;
    let pictures = found.table("pictures", &PICTURE)?;
    let scenes = Table::new("scenes", "Speed and wrong answers on the scenes' own rays", relative(&rays)?);
    let stressed = speeds_and_stress(&scenes, &modes)?;
    let stress = Table::new("stress", "Speed on the scenes against wrong answers to stress rays", stressed);
    let (holds, verdict) = verdict(&stress, &scenes);
    let charts = charts(&stress, &scenes, &pictures, found.header.quick);
    let notes = vec![
        "Exact arithmetic decides what is right: stress rays by rational numbers alone, scenes' rays by an oracle in f64 and, where it differs, by \
         rational numbers."
            .to_owned(),
        "Points stand, and beat each other, at the 95 % upper bound of their rate of wrong answers (exact, one-sided), also where none was wrong: \
         few tests do not look better than many."
            .to_owned(),
    ];
    Ok(Findings { holds, verdict, notes, tables: vec![stress, scenes, rays, modes, pictures], charts })
}

/// Whether a method without a wrong answer is nearly as fast as the fastest of all, and which these are.
fn verdict(stress: &Table, scenes: &Table) -> (Option<bool>, String) {
    let is_right = |row: &Row| number(row, "wrong") == Some(0.0);
    let is_right_on_scenes =
        |method: &str| scenes.rows.iter().filter(|row| name(row, "method") == method).all(is_right);
    let right = stress.rows.iter().filter(|row| is_right(row) && is_right_on_scenes(&name(row, "method")));
    let best = super::largest(right, "relative");
    let (Some(best), Some(fastest)) = (best, super::largest(&stress.rows, "relative")) else {
        return (None, "No method was without a wrong answer.".to_owned());
    };
    let Some(ratio) = ratio_of(best, fastest, "relative") else {
        return (None, "No method was timed.".to_owned());
    };
    let per_million = |row: &Row, column: &str| number(row, column).unwrap_or(0.0).ceil();
    let mut text = format!(
        "{} had no wrong answer of {} stress rays (at 95 % confidence at most {} per million) and ",
        name(best, "method"),
        name(best, "tested"),
        per_million(best, "wrong_bound")
    );
    text += &match ratio < 1.0 {
        true => format!(
            "has {ratio:.2} of the speed of the fastest, {} ({} wrong per million stress rays, at most {}).",
            name(fastest, "method"),
            number(fastest, "wrong_per_million").unwrap_or(0.0).round(),
            per_million(fastest, "wrong_bound")
        ),
        false => "is the fastest of all.".to_owned(),
    };
    (Some(ratio >= 0.5), text)
}

fn charts(stress: &Table, scenes: &Table, pictures: &Table, is_quick: bool) -> Vec<Chart> {
    const AXES: [&str; 2] = ["wrong_bound", "relative"];
    let on_front = |chart: Chart| chart.spread(["relative_low", "relative_high"]).log(true, true);
    let caption = "Left and high is better; the line joins what nothing beats. Speed is the geometric mean over camera, shadow and diffuse rays.";
    let chart = Chart::new(ChartKind::Front, stress, "stress", "Speed against wrong answers to stress rays", AXES);
    let mut charts = vec![on_front(chart).caption(format!(
        "{caption} Exact methods are judged to the last bit, the others within their rounding errors."
    ))];
    let title = "speed against wrong answers to its own rays";
    charts.extend(by_scene(ChartKind::Front, scenes, "scene", title, AXES, |chart| on_front(chart).caption(caption)));
    charts.extend(super::pictures::tradeoff_charts(pictures, is_quick));
    charts
}

/// Wrong answers of each method to each kind of stress rays.
fn stress(lab: &mut Lab, variants: &[Variant]) -> Result<Vec<Row>> {
    let rays_a_kind = if lab.quick { 60 } else { 400 };
    let quick = ["edges", "vertices", "grid", "t-junctions"];
    let kinds: Vec<_> = Kind::all().filter(|kind| !lab.quick || quick.contains(&kind.name)).collect();
    let mut rows = Vec::new();
    let seed = lab.seed;
    for kind in kinds {
        let mode = row([("mode", json!(kind.name))]);
        rows.extend(lab.judge_case(variants, &mode, rays_a_kind, || kind.case(seed, rays_a_kind))?);
    }
    Ok(rows)
}

/// For each method its speed, by the geometric mean over the scenes, and its wrong answers to all stress rays. What
/// lacks a scene, its speed there, or a kind of stress rays that others have is left out: sums and means over other
/// rays are no equals.
fn speeds_and_stress(scenes: &Table, modes: &Table) -> Result<Vec<Row>> {
    let (all_scenes, all_modes) = (scenes_of(&scenes.rows), values(&modes.rows, "mode"));
    let mut rows = Vec::new();
    for method in values(&scenes.rows, "method") {
        let own = all_scenes.iter().map(|scene| scenes.one(&[("scene", scene), ("method", &method)]));
        let own = own.collect::<Result<Option<Vec<_>>>>()?;
        let stressed = all_modes.iter().map(|mode| modes.one(&[("mode", mode), ("method", &method)]));
        let stressed = stressed.collect::<Result<Option<Vec<_>>>>()?;
        let (Some(own), Some(stressed)) = (own, stressed.filter(|rows| !rows.is_empty())) else { continue };
        let speeds = ["relative", "relative_low", "relative_high"].map(|column| Some((column, mean(&own, column)?)));
        let [Some(speed), Some(low), Some(high)] = speeds else { continue };
        let sum = |column: &str| stressed.iter().filter_map(|row| number(row, column)).sum::<f64>() as usize;
        let mut out = row([("method", json!(method))]);
        out.extend(row([speed, low, high].map(|(column, speed)| (column, json!(speed)))));
        out.extend(errors(sum("wrong"), sum("tested")));
        rows.push(out);
    }
    Ok(rows)
}

/// What is the fastest, or nearly so, with exact hits.
pub(super) fn fast_options(lab: &Lab) -> TraceOptions {
    if lab.is_cpu() { in_packets(StructureKind::Bvh8) } else { with(StructureKind::Bvh2) }
}

#[cfg(test)]
mod tests {
    use super::super::super::chart::{front, series};
    use super::super::rows_of::{header, judge, rays};
    use super::*;

    /// Methods with their speed on the scene, and wrong answers of so many stress rays of one kind.
    fn found(methods: &[(&str, f64, usize, usize)]) -> Findings {
        let timed: Vec<_> = methods.iter().map(|&(method, speed, ..)| ("s", method, speed)).collect();
        let mut tables = rays(&timed);
        let stressed = methods.iter().map(|&(method, _, wrong, tested)| {
            let mut out = row([("method", json!(method)), ("mode", json!("edges"))]);
            out.extend(errors(wrong, tested));
            out
        });
        tables.push(Table::new("modes", "", stressed.collect()));
        tables.push(Table::new("pictures", "", Vec::new()));
        judge(&STUDY, tables, &header(false)).unwrap()
    }

    #[test]
    fn the_claim_is_that_of_the_fastest_method_without_a_wrong_answer() {
        let holds = found(&[("exact", 8.0, 0, 1000), ("slow", 3.0, 0, 1000), ("leaky", 10.0, 17, 1000)]);
        assert_eq!(holds.holds, Some(true));
        assert_eq!(
            holds.verdict,
            "exact had no wrong answer of 1000 stress rays (at 95 % confidence at most 2992 per million) and has 0.80 of the speed of the \
             fastest, leaky (17000 wrong per million stress rays, at most 25391)."
        );
        assert_eq!(found(&[("exact", 4.0, 0, 1000), ("leaky", 10.0, 17, 1000)]).holds, Some(false));
        assert_eq!(found(&[("leaky", 10.0, 17, 1000)]).holds, None);
    }

    /// One wrong answer of 1000 was drawn at 1000 per million, none at 3000: a faster method that errs would have
    /// beaten the right one in accuracy, too.
    #[test]
    fn no_wrong_answer_is_never_beaten_in_accuracy_by_one() {
        let front_of = |methods: &[(&str, f64, usize, usize)]| {
            let found = found(methods);
            let points = series(&found.charts[0], &found.tables[0]).remove(0).points;
            front(&points).into_iter().map(|point| point.label.clone()).collect::<Vec<_>>()
        };
        assert_eq!(front_of(&[("exact", 8.0, 0, 1000), ("leaky", 10.0, 1, 1000)]), ["exact", "leaky"]);
        assert_eq!(front_of(&[("exact", 10.0, 0, 1000), ("leaky", 8.0, 1, 1000)]), ["exact"]);
        // Few tests show little: one wrong answer of a million is better than none of ten.
        assert_eq!(front_of(&[("hardly tested", 8.0, 0, 10), ("tested", 10.0, 1, 1_000_000)]), ["tested"]);
    }

    #[test]
    fn a_method_has_the_sum_of_its_wrong_answers_and_all_scenes_or_none() {
        let on_scenes = [("s", "a", 1.0), ("s", "b", 0.5), ("t", "a", 0.25), ("t", "b", 0.5), ("s", "c", 1.0)];
        let on_scenes = on_scenes.map(|(scene, method, speed)| {
            let speeds = ["relative", "relative_low", "relative_high"].map(|column| (column, json!(speed)));
            let mut out = row([("scene", json!(scene)), ("method", json!(method))]);
            out.extend(row(speeds));
            out
        });
        let stressed = [("a", "x", 1), ("a", "y", 2), ("b", "x", 0), ("b", "y", 0), ("c", "x", 0), ("c", "y", 0)];
        let stressed = stressed.map(|(method, mode, wrong)| {
            let mut out = row([("method", json!(method)), ("mode", json!(mode))]);
            out.extend(errors(wrong, 100));
            out
        });
        let (scenes, modes) = (Table::new("s", "", on_scenes.to_vec()), Table::new("m", "", stressed.to_vec()));
        let found = speeds_and_stress(&scenes, &modes).unwrap();
        let values: Vec<_> =
            found.iter().map(|row| (number(row, "relative"), number(row, "wrong_per_million"))).collect();
        assert_eq!(values, [(Some(0.5), Some(15_000.0)), (Some(0.5), Some(0.0))]);
    }
}
