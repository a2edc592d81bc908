//! THE chart: speed against wrong answers; also of other tracers, which trace the same rays in programs of their own.

use super::super::lab::errors;
use super::super::lookup::Clock;
use super::super::outcome::Outcome;
use super::super::peers::{self, Judged};
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Header, Lab, Measured, Study, Table, Variant};
use super::{ALL_KINDS, BATCH, MOST_FOR_LISTS, PICTURE, by_scene, in_packets, mean, relative, scenes_of, with};
use crate::stress::Kind;
use raybrook::Result;
use raybrook::low_level::options::{Intersector, KdOptions, StructureKind, TraceOptions, Traversal};
use serde_json::json;

pub const STUDY: Study = Study {
    name: "pareto",
    title: "Speed against accuracy",
    claim: "What this program is for: exact hits need not cost speed. The claim tested: some method without a wrong \
            answer, of stress rays and of the scene's, has at least half of the speed of the fastest method of all.",
    own_shapes: Some("the meshes of stress rays"),
    source: include_str!("pareto.rs"),
    measure,
    judge,
};

/// The methods: every structure with exact hits, every traversal of the kd-tree, and every triangle test in a hierarchy
/// and in a kd-tree; on CPUs in packets, too, where that goes.
fn variants(lab: &Lab, triangle_count: usize) -> Vec<Variant> {
    let exact = |accel: StructureKind| Variant::new(format!("{accel}, exact"), with(accel));
    let tested = |accel: StructureKind, intersector: Intersector| {
        Variant::new(format!("{accel}, {intersector}"), TraceOptions { intersector, ..with(accel) })
    };
    let packed = |accel: StructureKind, intersector: Intersector| {
        let options = TraceOptions { intersector, ..in_packets(accel) };
        Variant::new(format!("{accel} in packets, {intersector}"), options)
    };
    if lab.quick {
        let packets: Vec<_> = if lab.is_cpu() {
            [Intersector::Exact, Intersector::FASTEST].map(|test| packed(StructureKind::Bvh8, test)).into()
        } else {
            Vec::new()
        };
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
            let tests = Intersector::ALL.iter().filter(|test| test.has_packets());
            all.extend(tests.map(|&test| packed(accel, test)));
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
    // Before an hour of tracing: results of other tracers may be refused.
    let peers = peers::judge(lab, &subjects)?;
    let mut rays = Vec::new();
    for subject in &subjects {
        let variants = variants(lab, subject.triangle_count);
        rays.extend(lab.compare(subject, &variants, &ALL_KINDS)?);
    }
    let variants = variants(lab, subjects.iter().map(|subject| subject.triangle_count).max().unwrap_or(0));
    let stressed = stress(lab, &variants)?;
    let tables = vec![
        Table::new("rays", "All measurements on the scenes", rays),
        Table::new("modes", "Wrong answers by kind of stress rays", stressed),
        super::pictures::tradeoff(lab)?,
    ];
    Ok(with_peers(tables, peers))
}

/// The tables with the lab's other tracers in place of those that they have.
///
/// # Errors
/// As [`peers::judge`].
pub fn beside_peers(lab: &Lab, tables: Vec<Table>) -> Result<Vec<Table>> {
    Ok(with_peers(tables, peers::judge(lab, &lab.usual_subjects()?)?))
}

fn with_peers(mut tables: Vec<Table>, judged: Judged) -> Vec<Table> {
    let old = Peers::of(&tables);
    let Judged { rays, modes, peers } = judged;
    for (name, rows) in [("rays", rays), ("modes", modes)] {
        if let Some(table) = tables.iter_mut().find(|table| table.name == name) {
            table.rows.retain(|row| old.is_own(row));
            table.rows.extend(rows);
        }
    }
    tables.retain(|table| table.name != PEERS);
    if !peers.is_empty() {
        tables.push(Table::new(PEERS, "Other tracers", peers));
    }
    tables
}

/// The table of other tracers, which is there if there are any.
const PEERS: &str = "peers";

/// How they are called together.
const OTHERS: &str = "other tracers";

/// The other tracers of some tables.
struct Peers {
    rows: Vec<Row>,
}

impl Peers {
    fn of(tables: &[Table]) -> Peers {
        let table = tables.iter().find(|table| table.name == PEERS);
        Peers { rows: table.map_or(Vec::new(), |table| table.rows.clone()) }
    }

    /// The tracer of a row.
    fn find(&self, row: &Row) -> Option<&Row> {
        self.rows.iter().find(|peer| name(peer, "method") == name(row, "method"))
    }

    /// Whether a row is one of the program's own methods.
    fn is_own(&self, row: &Row) -> bool {
        self.find(row).is_none()
    }

    /// The rows of the program's own methods.
    fn own(&self, table: &Table) -> Table {
        let rows = table.rows.iter().filter(|row| self.is_own(row)).cloned().collect();
        Table { rows, ..table.clone() }
    }

    /// Says of each row who traced, and by which clock, where several did. Other tracers come first: where there are
    /// many points, the first ones have labels.
    fn name_tracers(&self, table: &mut Table, header: &Header) {
        let own_clock = if header.is_reference() { "wall clock" } else { "device time" };
        for row in &mut table.rows {
            row.shift_remove("tracer");
            let tracer = match self.find(row) {
                Some(peer) => {
                    // They have a colour of their own.
                    row.insert("structure".to_owned(), json!(OTHERS));
                    format!("{OTHERS} ({})", name(peer, "clock"))
                }
                None => format!("raybrook ({own_clock})"),
            };
            if !self.rows.is_empty() {
                row.insert("tracer".to_owned(), json!(tracer));
            }
        }
        table.rows.sort_by_key(|row| self.is_own(row));
    }

    /// Speeds of [`relative`], by that of the fastest of the program's own methods in each scene.
    fn relative_to_own(&self, mut rows: Vec<Row>) -> Vec<Row> {
        for scene in scenes_of(&rows) {
            let own = rows.iter().filter(|row| name(row, "scene") == scene && self.is_own(row));
            let Some(fastest) = super::largest(own, "relative").and_then(|row| number(row, "relative")) else {
                continue;
            };
            for row in rows.iter_mut().filter(|row| name(row, "scene") == scene) {
                for column in ["relative", "relative_low", "relative_high"] {
                    if let Some(speed) = number(row, column) {
                        row.insert(column.to_owned(), json!(speed / fastest));
                    }
                }
            }
        }
        rows
    }

    /// How they were measured, for the captions of charts that they are on.
    fn caption(&self) -> String {
        let mut places: Vec<String> = Vec::new();
        for row in &self.rows {
            let place = format!("by {} on {}", name(row, "clock"), name(row, "machine"));
            if !places.contains(&place) {
                places.push(place);
            }
        }
        match places.is_empty() {
            true => String::new(),
            false => format!(
                " Other tracers traced the same rays in programs of their own, in one batch in memory, not by turns \
                 with these methods: {}. Their answers are judged within float32's rounding errors. Speed 1 is that of \
                 the fastest of raybrook's methods.",
                places.join("; ")
            ),
        }
    }

    /// What each of them reached.
    fn note(&self, stress: &Table, scenes: &Table) -> Option<String> {
        let said = self.rows.iter().filter_map(|peer| {
            let method = name(peer, "method");
            let is_its = |row: &&Row| name(row, "method") == method;
            let stressed = stress.rows.iter().find(is_its)?;
            let sum =
                |column: &str| scenes.rows.iter().filter(is_its).filter_map(|row| number(row, column)).sum::<f64>();
            Some(format!(
                "{method}: {:.3} of the speed of raybrook's fastest method, {} of {} stress rays and {} of {} of the \
                 scenes' rays wrong",
                number(stressed, "relative")?,
                name(stressed, "wrong"),
                name(stressed, "tested"),
                sum("wrong"),
                sum("tested")
            ))
        });
        let said: Vec<_> = said.collect();
        (!said.is_empty()).then(|| format!("Other tracers: {}.", said.join("; ")))
    }
}

fn judge(found: &Measured) -> Result<Findings> {
    let mut rays = found.table("rays", &BATCH)?;
    let mut modes = found.table("modes", &["method", "mode"])?;
    let pictures = found.table("pictures", &PICTURE)?;
    let peers = Peers::of(&found.tables);
    let on_scenes = peers.relative_to_own(relative(&rays)?);
    let mut scenes = Table::new("scenes", "Speed and wrong answers on the scenes' own rays", on_scenes);
    let stressed = speeds_and_stress(&scenes, &modes)?;
    let mut stress = Table::new("stress", "Speed on the scenes against wrong answers to stress rays", stressed);
    for table in [&mut rays, &mut modes, &mut scenes, &mut stress] {
        peers.name_tracers(table, found.header);
    }
    let (outcome, verdict) = verdict(&peers.own(&stress), &peers.own(&scenes), &peers.own(&rays))?;
    let charts = charts(&stress, &scenes, &pictures, &peers, found.header.quick);
    let mut notes = vec![
        "Exact arithmetic decides what is right: stress rays by rational numbers alone, scenes' rays by an oracle in \
         f64 and, where it differs, by rational numbers."
            .to_owned(),
        "Points stand, and beat each other, at the 95 % upper bound of their rate of wrong answers (exact, one-sided), \
         also where none was wrong: few tests do not look better than many."
            .to_owned(),
    ];
    notes.extend(peers.note(&stress, &scenes));
    let mut tables = vec![stress, scenes, rays, modes, pictures];
    tables.extend(found.tables.iter().find(|table| table.name == PEERS).cloned());
    Ok(Findings { outcome, verdict, notes, tables, charts })
}

/// Whether a method without a wrong answer is nearly as fast as the fastest of all, and which these are.
fn verdict(stress: &Table, scenes: &Table, rays: &Table) -> Result<(Outcome, String)> {
    let is_right = |row: &Row| number(row, "wrong") == Some(0.0);
    let is_right_on_scenes =
        |method: &str| scenes.rows.iter().filter(|row| name(row, "method") == method).all(is_right);
    let right = stress.rows.iter().filter(|row| is_right(row) && is_right_on_scenes(&name(row, "method")));
    let best = super::largest(right, "relative");
    let (Some(best), Some(fastest)) = (best, super::largest(&stress.rows, "relative")) else {
        return Ok((Outcome::Undecided, "No method was without a wrong answer.".to_owned()));
    };
    let key = |row: &Row| name(row, "method");
    let ratio =
        rays.speedup(Clock::Ray, &[("method", &key(best))], &[("method", &key(fastest))], &["scene", "rays_of"])?;
    let Some(ratio) = ratio else {
        return Ok((Outcome::Undecided, "No method was timed.".to_owned()));
    };
    let per_million = |row: &Row, column: &str| number(row, column).unwrap_or(0.0).ceil();
    let mut text = format!(
        "{} had no wrong answer of {} stress rays (at 95 % confidence at most {} per million) and ",
        name(best, "method"),
        name(best, "tested"),
        per_million(best, "wrong_bound")
    );
    text += &match key(best) != key(fastest) {
        true => format!(
            "has {ratio} of the speed of the fastest, {} ({} wrong per million stress rays, at most {}).",
            name(fastest, "method"),
            number(fastest, "wrong_per_million").unwrap_or(0.0).round(),
            per_million(fastest, "wrong_bound")
        ),
        false => "is the fastest of all.".to_owned(),
    };
    let outcome = if key(best) == key(fastest) { Outcome::Holds } else { ratio.above(0.5) };
    Ok((outcome, text))
}

fn charts(stress: &Table, scenes: &Table, pictures: &Table, peers: &Peers, is_quick: bool) -> Vec<Chart> {
    const AXES: [&str; 2] = ["wrong_bound", "relative"];
    let on_front = |chart: Chart| {
        let chart = chart.by("structure").spread(["relative_low", "relative_high"]);
        chart.x_spread(["wrong_low", "wrong_bound"]).log(true, true)
    };
    let caption = format!(
        "Left and high is better; the line joins what nothing beats. Speed is the geometric mean over camera, shadow \
         and diffuse rays.{}",
        peers.caption()
    );
    let chart = Chart::new(ChartKind::Front, stress, "stress", "Speed against wrong answers to stress rays", AXES);
    let mut charts = vec![on_front(chart).caption(format!(
        "{caption} Exact methods are judged to the last bit, the others within their rounding errors."
    ))];
    let title = "speed against wrong answers to its own rays";
    charts.extend(by_scene(ChartKind::Front, scenes, "scene", title, AXES, |chart| on_front(chart).caption(&caption)));
    charts.extend(super::pictures::tradeoff_charts(pictures, is_quick));
    charts
}

/// The kinds of stress rays.
pub fn stress_kinds(lab: &Lab) -> Vec<&'static Kind> {
    let quick = ["edges", "vertices", "grid", "t-junctions"];
    Kind::all().filter(|kind| !lab.quick || quick.contains(&kind.name)).collect()
}

/// How many rays of each kind.
pub fn stress_rays_a_kind(lab: &Lab) -> usize {
    if lab.quick { 60 } else { 400 }
}

/// Wrong answers of each method to each kind of stress rays.
fn stress(lab: &mut Lab, variants: &[Variant]) -> Result<Vec<Row>> {
    let (kinds, rays_a_kind) = (stress_kinds(lab), stress_rays_a_kind(lab));
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
        let known = ["structure", "promise"].iter().filter_map(|column| Some((column, own.first()?.get(*column)?)));
        out.extend(known.map(|(column, value)| ((*column).to_owned(), value.clone())));
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
    use serde_json::Value;

    /// Methods with their speed on the scene, and wrong answers of so many stress rays of one kind.
    fn found(methods: &[(&str, f64, usize, usize)]) -> Findings {
        judge(&STUDY, tables(methods), &header(false)).unwrap()
    }

    fn tables(methods: &[(&str, f64, usize, usize)]) -> Vec<Table> {
        let timed: Vec<_> = methods.iter().map(|&(method, speed, ..)| ("s", method, speed)).collect();
        let mut tables = rays(&timed);
        let stressed = methods.iter().map(|&(method, _, wrong, tested)| {
            let mut out = row([("method", json!(method)), ("mode", json!("edges"))]);
            out.extend(errors(wrong, tested));
            out
        });
        tables.push(Table::new("modes", "", stressed.collect()));
        tables.push(Table::new("pictures", "", Vec::new()));
        tables
    }

    #[test]
    fn the_claim_is_that_of_the_fastest_method_without_a_wrong_answer() {
        let holds = found(&[("exact", 8.0, 0, 1000), ("slow", 3.0, 0, 1000), ("leaky", 10.0, 17, 1000)]);
        assert_eq!(holds.outcome, Outcome::Holds);
        assert_eq!(
            holds.verdict,
            "exact had no wrong answer of 1000 stress rays (at 95 % confidence at most 2992 per million) and has 0.80 \
             [0.80, 0.80] of the speed of the fastest, leaky (17000 wrong per million stress rays, at most 25391)."
        );
        assert_eq!(found(&[("exact", 4.0, 0, 1000), ("leaky", 10.0, 17, 1000)]).outcome, Outcome::Fails);
        assert_eq!(found(&[("leaky", 10.0, 17, 1000)]).outcome, Outcome::Undecided);
    }

    /// Whatever other tracers reach, the verdict is that of the program's own methods, and so is speed 1.
    #[test]
    fn other_tracers_stand_beside_the_verdict() {
        let alone = found(&[("exact", 8.0, 0, 1000), ("leaky", 10.0, 17, 1000)]);
        let with = |peer: (&'static str, f64, usize, usize)| {
            let mut tables = tables(&[("exact", 8.0, 0, 1000), ("leaky", 10.0, 17, 1000), peer]);
            let told = row([("method", json!(peer.0)), ("clock", json!("wall clock")), ("machine", json!("m"))]);
            tables.push(Table::new(PEERS, "", vec![told]));
            judge(&STUDY, tables, &header(false)).unwrap()
        };
        let column = |found: &Findings, column: &str| -> Vec<Value> {
            found.tables[0].rows.iter().map(|row| row[column].clone()).collect()
        };
        for peer in [("fast", 20.0, 0, 1000), ("slow", 1.0, 999, 1000)] {
            let found = with(peer);
            assert_eq!((found.outcome, &found.verdict), (alone.outcome, &alone.verdict), "{peer:?}");
            // Means are off by what logarithms are rounded.
            let speeds: Vec<_> = found.tables[0].rows.iter().filter_map(|row| number(row, "relative")).collect();
            let is_near = |(speed, expected): (&f64, f64)| (speed / expected - 1.0).abs() < 1e-12;
            assert!(speeds.iter().zip([peer.1 / 10.0, 0.8, 1.0]).all(is_near) && speeds.len() == 3, "{speeds:?}");
            let tracers = ["other tracers (wall clock)", "raybrook (device time)", "raybrook (device time)"];
            assert_eq!(column(&found, "tracer"), tracers);
            let said = format!("{}: {:.3} of the speed", peer.0, peer.1 / 10.0);
            assert!(found.notes.last().unwrap().contains(&said), "{:?}", found.notes);
            assert!(found.charts[0].caption.contains("by wall clock on m"), "{}", found.charts[0].caption);
            // What was judged once is judged the same again.
            assert_eq!(judge(&STUDY, found.tables.clone(), &header(false)).unwrap(), found);
        }
        assert_eq!(alone.charts[0].series.as_deref(), Some("structure"));
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
