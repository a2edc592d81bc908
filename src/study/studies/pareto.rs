//! THE chart: speed against wrong answers.

use super::super::lab::errors;
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Table, Variant};
use super::{ALL_KINDS, MOST_FOR_LISTS, by_scene, in_packets, relative, with};
use crate::error::Result;
use crate::options::{Accel, Intersector, TraceOptions, Traversal};
use crate::stress::Kind;
use serde_json::json;

pub const STUDY: Study = Study {
    name: "pareto",
    title: "Speed against accuracy",
    claim: "What this program is for: exact hits need not cost speed. The claim tested: some method without a wrong answer, of stress rays and of the \
            scene's, has at least half of the speed of the fastest method of all.",
    run,
};

/// The methods: every structure with exact hits, every traversal of the kd-tree, and every triangle test in a hierarchy and in a kd-tree.
fn variants(lab: &Lab, triangle_count: usize) -> Vec<Variant> {
    let exact = |accel: Accel| Variant::new(format!("{accel}, exact"), with(accel));
    let tested = |accel: Accel, intersector: Intersector| {
        Variant::new(format!("{accel}, {intersector}"), TraceOptions { intersector, ..with(accel) })
    };
    if lab.quick {
        let packets = lab.is_cpu().then(|| Variant::new("bvh8 in packets, exact", in_packets(Accel::Bvh8)));
        let others = [
            exact(Accel::Kd),
            exact(Accel::Bvh2),
            tested(Accel::Bvh2, Intersector::MollerTrumbore),
            tested(Accel::Kd, Intersector::Thesis),
        ];
        return packets.into_iter().chain(others).collect();
    }
    let is_list = |accel: Accel| matches!(accel, Accel::Brute | Accel::Boxes | Accel::Spheres);
    let mut all: Vec<_> = Accel::ALL
        .iter()
        .filter(|&&accel| !is_list(accel) || triangle_count <= MOST_FOR_LISTS)
        .map(|&accel| exact(accel))
        .collect();
    if lab.is_cpu() {
        for accel in [Accel::Bvh8, Accel::Kd] {
            all.push(Variant::new(format!("{accel} in packets, exact"), in_packets(accel)));
        }
    }
    for &traversal in Traversal::ALL.iter().filter(|&&traversal| traversal != Traversal::Stack) {
        all.push(Variant::new(format!("kd, {traversal}, exact"), TraceOptions { traversal, ..with(Accel::Kd) }));
    }
    for accel in [Accel::Bvh2, Accel::Kd] {
        all.extend(
            Intersector::ALL.iter().filter(|&&test| test != Intersector::Exact).map(|&test| tested(accel, test)),
        );
    }
    all
}

fn run(lab: &mut Lab) -> Result<Findings> {
    let subjects = lab.usual_subjects()?;
    let mut rays = Vec::new();
    for subject in &subjects {
        let variants = variants(lab, subject.triangle_count);
        rays.extend(lab.compare(subject, &variants, &ALL_KINDS)?);
    }
    let on_scenes = relative(&rays);
    let variants = variants(lab, subjects.iter().map(|subject| subject.triangle_count).max().unwrap_or(0));
    let stressed = stress(lab, &variants)?;
    let with_speed = speeds_and_stress(&on_scenes, &stressed);

    let holds_of = |row: &&Row| number(row, "wrong") == Some(0.0);
    let is_right_on_scenes = |method: &str| {
        on_scenes.iter().filter(|row| name(row, "method") == method).all(|row| number(row, "wrong") == Some(0.0))
    };
    let best = with_speed
        .iter()
        .filter(holds_of)
        .filter(|row| is_right_on_scenes(&name(row, "method")))
        .max_by(|a, b| number(a, "relative").unwrap_or(0.0).total_cmp(&number(b, "relative").unwrap_or(0.0)));
    let fastest = super::largest(&with_speed, "relative");
    let (holds, verdict) = match (best, fastest) {
        (Some(best), Some(fastest)) => {
            let ratio = number(best, "relative").unwrap_or(0.0) / number(fastest, "relative").unwrap_or(1.0);
            let mut verdict =
                format!("{} had no wrong answer of {} stress rays and ", name(best, "method"), name(best, "tested"));
            verdict += &match ratio < 1.0 {
                true => format!(
                    "has {ratio:.2} of the speed of the fastest, {} ({} wrong per million stress rays).",
                    name(fastest, "method"),
                    number(fastest, "wrong_per_million").unwrap_or(0.0).round()
                ),
                false => "is the fastest of all.".to_owned(),
            };
            (Some(ratio >= 0.5), verdict)
        }
        _ => (None, "No method was without a wrong answer.".to_owned()),
    };
    let (pictures, picture_charts) = super::pictures::tradeoff(lab)?;
    let tables = vec![
        Table::new("stress", "Speed on the scenes against wrong answers to stress rays", with_speed),
        Table::new("scenes", "Speed and wrong answers on the scenes' own rays", on_scenes),
        Table::new("rays", "All measurements on the scenes", rays),
        Table::new("modes", "Wrong answers by kind of stress rays", stressed),
        pictures,
    ];
    const AXES: [&str; 2] = ["wrong_bound", "relative"];
    let on_front = |chart: Chart| chart.spread(["relative_low", "relative_high"]).log(true, true);
    let caption = "Left and high is better; the line joins what nothing beats. Speed is the geometric mean over camera, shadow and diffuse rays.";
    let stress = Chart::new(ChartKind::Front, &tables[0], "stress", "Speed against wrong answers to stress rays", AXES);
    let mut charts = vec![on_front(stress).caption(format!(
        "{caption} Exact methods are judged to the last bit, the others within their rounding errors."
    ))];
    let title = "speed against wrong answers to its own rays";
    charts
        .extend(by_scene(ChartKind::Front, &tables[1], "scene", title, AXES, |chart| on_front(chart).caption(caption)));
    charts.extend(picture_charts);
    let notes = vec![
        "Exact arithmetic decides what is right: stress rays by rational numbers alone, scenes' rays by an oracle in f64 and, where it differs, by \
         rational numbers."
            .to_owned(),
    ];
    Ok(Findings { holds, verdict, notes, tables, charts })
}

/// Wrong answers of each method to each kind of stress rays.
fn stress(lab: &mut Lab, variants: &[Variant]) -> Result<Vec<Row>> {
    let rays_a_kind = if lab.quick { 60 } else { 400 };
    let quick = ["edges", "vertices", "grid", "t-junctions"];
    let kinds: Vec<_> = Kind::all().filter(|kind| !lab.quick || quick.contains(&kind.name)).collect();
    let mut rows = Vec::new();
    let seed = lab.seed;
    for kind in kinds {
        rows.extend(lab.judge_case(variants, "mode", &json!(kind.name), rays_a_kind, || kind.case(seed, rays_a_kind))?);
    }
    Ok(rows)
}

/// For each method its speed, by the geometric mean over the scenes, and its wrong answers to all stress rays.
fn speeds_and_stress(on_scenes: &[Row], stressed: &[Row]) -> Vec<Row> {
    let mut rows = Vec::new();
    for method in values(on_scenes, "method") {
        let speed = |column: &str| super::mean(on_scenes, column, |row| name(row, "method") == method);
        let own = || stressed.iter().filter(|row| name(row, "method") == method);
        let sum = |column: &str| own().filter_map(|row| number(row, column)).sum::<f64>() as usize;
        let (Some(relative), 1..) = (speed("relative"), own().count()) else { continue };
        let mut out = row([
            ("method", json!(method)),
            ("relative", json!(relative)),
            ("relative_low", json!(speed("relative_low"))),
            ("relative_high", json!(speed("relative_high"))),
        ]);
        out.extend(errors(sum("wrong"), sum("tested")));
        rows.push(out);
    }
    rows
}

/// What is the fastest, or nearly so, with exact hits.
pub(super) fn fast_options(lab: &Lab) -> TraceOptions {
    if lab.is_cpu() { in_packets(Accel::Bvh8) } else { with(Accel::Bvh2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_method_has_the_sum_of_its_wrong_answers() {
        let on_scenes = [("a", 1.0), ("b", 0.5), ("a", 0.25)]
            .map(|(method, relative)| row([("method", json!(method)), ("relative", json!(relative))]));
        let stressed = [("a", 1), ("a", 2), ("b", 0)].map(|(method, wrong)| {
            let mut out = row([("method", json!(method))]);
            out.extend(errors(wrong, 100));
            out
        });
        let found = speeds_and_stress(&on_scenes, &stressed);
        let values: Vec<_> =
            found.iter().map(|row| (number(row, "relative"), number(row, "wrong_per_million"))).collect();
        assert_eq!(values, [(Some(0.5), Some(15_000.0)), (Some(0.5), Some(0.0))]);
    }
}
