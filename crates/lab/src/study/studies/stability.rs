//! Where methods break down.

use super::super::bound::{RISK, chance_of_more, upper_bound};
use super::super::cases::{Sweep, mesh_of};
use super::super::outcome::Outcome;
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{by_scene, with};
use crate::stress::{Kind, Mesh};
use raybrook::low_level::options::{Intersector, KdOptions, Structure, StructureKind, TraceOptions, Traversal};
use raybrook::{Error, Result};
use serde_json::json;

pub const STUDY: Study = Study {
    name: "stability",
    title: "Where methods fail",
    claim: "Listing 5.1 of the thesis has an absolute epsilon, and no float32 test is right at every scale. The claim \
            tested: exact hits are right at every number of every sweep and in every failure mode, and lose no path.",
    own_shapes: Some("the sweeps by valence and gap, the room of mirrors and the failure modes"),
    source: include_str!("stability.rs"),
    measure,
    judge,
};

fn methods(lab: &Lab) -> Vec<Variant> {
    let quick = [Intersector::Exact, Intersector::MollerTrumbore, Intersector::Thesis];
    let tests = Intersector::ALL.iter().filter(|test| !lab.quick || quick.contains(test));
    let mut all: Vec<_> = tests
        .map(|&test| Variant::new(test.name(), TraceOptions { intersector: test, ..with(StructureKind::Bvh2) }))
        .collect();
    if !lab.quick {
        let thesis = TraceOptions {
            structure: Structure::Kd(KdOptions { traversal: Traversal::ThesisRestart, ..with(StructureKind::Kd).kd() }),
            intersector: Intersector::Thesis,
            ..with(StructureKind::Kd)
        };
        all.push(Variant::new("thesis, its kd-restart", thesis));
    }
    all
}

/// Products of rays and triangles of a case, at most: exact answers take every triangle for every ray.
const MOST_PAIRS: usize = 100_000_000;
/// Rays of a case, of however many triangles.
const FEWEST_RAYS: usize = 100;

fn measure(lab: &mut Lab) -> Result<Vec<Table>> {
    let methods = methods(lab);
    let seed = lab.seed;
    let rays = if lab.quick { 100 } else { 1000 };
    let meshes = meshes(lab)?;
    let mut tables = Vec::new();
    for sweep in Sweep::ALL.iter().take(if lab.quick { 2 } else { Sweep::ALL.len() }) {
        let own = [(String::new(), None)];
        let meshes = if sweep.is_of_any_mesh() && !lab.scenes.is_empty() { &meshes[..] } else { &own };
        let mut rows = Vec::new();
        for (scene, mesh) in meshes {
            let most = mesh.as_ref().map_or(rays, |mesh| MOST_PAIRS / mesh.triangles.len().max(1));
            let rays = rays.min(most.max(FEWEST_RAYS));
            let step = if lab.quick { 3 } else { 1 };
            let is_taken = |(i, value): &(usize, &f64)| i % step == 0 || **value == sweep.base;
            for (_, value) in sweep.values.iter().enumerate().filter(is_taken) {
                let mut case = row([(sweep.name, json!(value))]);
                if mesh.is_some() {
                    case.insert("scene".into(), json!(scene));
                }
                let make = || sweep.case(mesh.as_ref(), *value, seed, rays);
                rows.extend(lab.judge_case(&methods, &case, rays, make)?);
            }
        }
        tables.push(Table::new(sweep.name, format!("Wrong answers: {}", sweep.about), rows));
    }
    let depths: &[u32] = if lab.quick { &[2, 8] } else { &[1, 2, 4, 8, 16, 32, 64] };
    let mut rows = Vec::new();
    for &depth in depths {
        rows.extend(lab.lost_paths(&methods, depth)?);
    }
    tables.push(Table::new(DEPTH, "Paths that escape from a closed room of mirrors", rows));
    let mut rows = Vec::new();
    for kind in Kind::all().take(if lab.quick { 4 } else { usize::MAX }) {
        let make = || kind.case(seed, rays / 2);
        rows.extend(lab.judge_case(&methods, &row([("mode", json!(kind.name))]), rays / 2, make)?);
    }
    tables.push(Table::new(MODES, "Wrong answers by failure mode, a kind of `raybrook stress` each", rows));
    Ok(tables)
}

const DEPTH: &str = "depth";
const MODES: &str = "modes";

/// The meshes of the user's scenes that have triangles, by name.
fn meshes(lab: &Lab) -> Result<Vec<(String, Option<Mesh>)>> {
    let mut meshes = Vec::new();
    for (name, scene) in lab.scenes {
        if let Some(mesh) = mesh_of(scene, lab.seed)? {
            meshes.push((name.clone(), Some(mesh)));
        }
    }
    Ok(meshes)
}

fn judge(found: &Measured) -> Result<Findings> {
    let mut tables = Vec::new();
    let mut charts = Vec::new();
    for sweep in Sweep::ALL {
        if found.tables.iter().all(|table| table.name != sweep.name) {
            continue; // in a hurry
        }
        let table = found.table(sweep.name, &["scene", "method", sweep.name])?;
        charts.extend(charts_of(sweep, &table));
        tables.push(table);
    }
    let depth = found.table(DEPTH, &["method", DEPTH])?;
    charts.push(
        Chart::new(ChartKind::Lines, &depth, DEPTH, "Paths that get lost by their length", [DEPTH, "wrong_bound"])
            .by("method")
            .spread(["wrong_low", "wrong_bound"])
            .log(true, true)
            .caption(format!(
                "Whole pictures from inside a closed mesh whose triangles are all mirrors: every ray must hit, a path \
                 is lost with its first ray that does not. {BOUNDS}"
            )),
    );
    let modes = found.table(MODES, &["method", "mode"])?;
    charts.push(
        Chart::new(ChartKind::Heat, &modes, MODES, "Failure modes: wrong answers per million rays", ["method", "mode"])
            .by("wrong_per_million")
            .caption(format!("{} rays a square; `raybrook stress --list` tells what each kind is.", rays_of(&modes))),
    );
    tables.extend([depth, modes]);
    let of_exact = |row: &&Row| name(row, "method") == Intersector::Exact.name();
    let sum = |column: &str| -> f64 {
        tables.iter().flat_map(|table| &table.rows).filter(of_exact).filter_map(|row| number(row, column)).sum()
    };
    let (wrong, tested) = (sum("wrong"), sum("tested"));
    let verdict = format!(
        "exact hits had {wrong} wrong answers of {tested} (at 95 % confidence at most {:.1} per million). {}",
        1e6 * upper_bound(wrong as u64, tested as u64),
        breakdowns(&tables)?
    );
    let mut notes = vec![
        "Exact hits are judged to the last bit of t, the others within what rounding in float32 may do to a ray; only \
         what lies beyond that counts as wrong. The charts of sweeps show all answers that differ from those of exact \
         arithmetic in the triangle, and hollow points where some are wrong."
            .to_owned(),
        "A method breaks down at the first number, from where nothing is hard yet, at which it differs more often than \
         it does there: by Fisher's exact test at a risk of 5 % for a whole sweep."
            .to_owned(),
    ];
    if !found.header.scenes.is_empty() {
        notes.push(note_on_scenes(found, &tables));
    }
    let outcome = if tested > 0.0 { Outcome::of(wrong == 0.0) } else { Outcome::Undecided };
    Ok(Findings { outcome, verdict, notes, tables, charts })
}

const BOUNDS: &str = "Points stand at the 95 % upper bound, about 3/N where none of N; bars go down to the lower one. \
                      Lines may lie on each other.";

/// A chart for each mesh.
fn charts_of(sweep: &Sweep, table: &Table) -> Vec<Chart> {
    let axes = [sweep.name, "differing_bound"];
    let title = format!("answers that differ, by: {}", Chart::label(sweep.name));
    let is_of_scenes = table.rows.iter().any(|row| row.contains_key("scene"));
    let mesh = if is_of_scenes { " The mesh is the scene's, closed or not." } else { "" };
    let finish = |chart: Chart| {
        let chart = chart.by("method").spread(["differing_low", "differing_bound"]).log(true, true);
        let about = format!(
            "{} rays a point: {}.{mesh} {BOUNDS} All in bvh2 but for the thesis's own.",
            rays_of(table),
            sweep.about
        );
        chart.caption([&about, sweep.remark].join(" ").trim_end().to_owned())
    };
    match is_of_scenes {
        true => by_scene(ChartKind::Lines, table, sweep.name, &title, axes, finish),
        false => vec![finish(Chart::new(ChartKind::Lines, table, sweep.name, upper(&title), axes))],
    }
}

fn upper(title: &str) -> String {
    let mut letters = title.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Rays of each case of a table, the fewest and the most.
fn rays_of(table: &Table) -> String {
    let counts = || table.rows.iter().filter_map(|row| number(row, "tested"));
    match (counts().min_by(f64::total_cmp), counts().max_by(f64::total_cmp)) {
        (Some(fewest), Some(most)) if fewest < most => format!("{fewest} to {most}"),
        (Some(count), _) => count.to_string(),
        _ => "0".to_owned(),
    }
}

/// What of the user's scenes was measured.
fn note_on_scenes(found: &Measured, tables: &[Table]) -> String {
    let is_swept = |scene: &str| tables.iter().flat_map(|table| &table.rows).any(|row| name(row, "scene") == scene);
    let (swept, empty): (Vec<_>, Vec<_>) =
        found.header.scenes.iter().map(|scene| scene.name.as_str()).partition(|scene| is_swept(scene));
    let mut note = "Scenes that were named are moved to zero and scaled to the size of 1 before the sweeps by scale, \
                    offset, distance, angle and aspect."
        .to_owned();
    if swept.is_empty() {
        note.clear();
    }
    if !empty.is_empty() {
        note += &format!(" Nothing can be hit in: {}.", empty.join(", "));
    }
    note.trim_start().to_owned()
}

/// Where in each sweep each method breaks down, in a sentence.
fn breakdowns(tables: &[Table]) -> Result<String> {
    let mut parts = Vec::new();
    let methods = values(tables.iter().flat_map(|table| &table.rows), "method");
    let swept = || Sweep::ALL.iter().filter_map(|sweep| Some((sweep, tables.iter().find(|t| t.name == sweep.name)?)));
    for method in methods.iter().filter(|method| *method != Intersector::Exact.name()) {
        let mut told = Vec::new();
        for (sweep, table) in swept() {
            for scene in values(&table.rows, "scene") {
                let of = |row: &&Row| name(row, "method") == *method && name(row, "scene") == scene;
                let own: Vec<&Row> = table.rows.iter().filter(of).collect();
                let Some(words) = breakdown(sweep, &own)? else { continue };
                let of_scene = if scene.is_empty() { String::new() } else { format!(" of {scene}") };
                told.push(format!("{}{of_scene} {words}", table.name));
            }
        }
        if !told.is_empty() {
            parts.push(format!("{method}: {}", told.join(", ")));
        }
    }
    Ok(match parts.is_empty() {
        true => "No other method breaks down in a sweep.".to_owned(),
        false => format!("Other methods break down, with {}.", parts.join("; with ")),
    })
}

/// Where a method breaks down in a sweep, going from its base to either end, and the rate at the base, in words;
/// `None`: nowhere.
fn breakdown(sweep: &Sweep, rows: &[&Row]) -> Result<Option<String>> {
    let mut rows: Vec<_> = rows.iter().filter_map(|row| Some((number(row, sweep.name)?, counts(row)?))).collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(_, base)) = rows.iter().find(|(value, _)| *value == sweep.base) else {
        let message =
            format!("there is no row of {} {}, which others are compared with", sweep.name, short(sweep.base));
        return if rows.is_empty() { Ok(None) } else { Err(Error::input("study stability", None, message)) };
    };
    // Every number is a chance to err.
    let risk = RISK / (rows.len() - 1).max(1) as f64;
    let is_worse = |(_, counts): &&(f64, [u64; 2])| chance_of_more(*counts, base) <= risk;
    let up = rows.iter().filter(|(value, _)| *value > sweep.base).find(is_worse);
    let down = rows.iter().rev().filter(|(value, _)| *value < sweep.base).find(is_worse);
    let mut ends = Vec::new();
    ends.extend(down.map(|(value, _)| format!("at {} and below", short(*value))));
    ends.extend(up.map(|(value, _)| format!("at {} and above", short(*value))));
    let [wrong, tested] = base.map(|count| count as f64);
    let of_base = format!("{:.0} per million differ at {}", 1e6 * wrong / tested.max(1.0), short(sweep.base));
    Ok((!ends.is_empty()).then(|| format!("{} ({of_base})", ends.join(" and "))))
}

/// Answers that differ, and all.
fn counts(row: &Row) -> Option<[u64; 2]> {
    let count = |column: &str| row.get(column).and_then(serde_json::Value::as_u64);
    Some([count("differing")?, count("tested")?])
}

/// A number of a sweep in few digits.
fn short(value: f64) -> String {
    if (1e-3..1e5).contains(&value) { value.to_string() } else { format!("{value:e}") }
}

#[cfg(test)]
mod tests {
    use super::super::super::StudiedScene;
    use super::super::rows_of::{self, header};
    use super::*;
    use crate::study::lab::{differences, errors};

    fn sweep(column: &str, rows: &[(&str, f64, usize)]) -> Table {
        let rows = rows.iter().map(|&(method, value, wrong)| {
            let mut out = row([("method", json!(method)), (column, json!(value))]);
            out.extend(errors(wrong, 1000));
            out.extend(differences(wrong, 1000));
            out
        });
        Table::new(column, "", rows.collect())
    }

    fn judged(scale: &[(&str, f64, usize)]) -> Findings {
        let depth = sweep(DEPTH, &[("exact", 1.0, 0), ("plucker", 1.0, 0)]);
        let tables = vec![sweep("scale", scale), depth, Table::new(MODES, "", Vec::new())];
        rows_of::judge(&STUDY, tables, &header(false)).unwrap()
    }

    #[test]
    fn exact_hits_are_right_only_without_a_wrong_answer() {
        let exact = |wrong: usize| [("exact", 1e-20, wrong), ("exact", 1.0, 0)];
        let right = judged(&[&exact(0)[..], &[("plucker", 1e-20, 9), ("plucker", 1.0, 0)]].concat());
        assert_eq!(right.outcome, Outcome::Holds);
        assert_eq!(
            right.verdict,
            "exact hits had 0 wrong answers of 3000 (at 95 % confidence at most 998.1 per million). Other methods \
             break down, with plucker: scale at 1e-20 and below (0 per million differ at 1)."
        );
        assert_eq!(judged(&exact(1)).outcome, Outcome::Fails);
        let nothing = rows_of::judge(&STUDY, vec![sweep(DEPTH, &[]), sweep(MODES, &[])], &header(false)).unwrap();
        assert_eq!(nothing.outcome, Outcome::Undecided);
    }

    /// As published: "from scale 1e-20 on" was said of a test that errs as often at scale 1.
    #[test]
    fn a_method_breaks_down_where_it_differs_more_often_than_at_the_base() {
        let rows = |wrong: [usize; 5]| -> Vec<_> {
            let values = [1e-20, 1e-10, 1.0, 1e10, 1e18].iter().zip(wrong);
            values.map(|(&value, wrong)| ("plucker", value, wrong)).chain([("exact", 1.0, 0)]).collect()
        };
        for (wrong, expected) in [
            ([86, 117, 127, 115, 123], "No other method breaks down in a sweep."),
            ([1000, 143, 127, 115, 123], "plucker: scale at 1e-20 and below (127000 per million differ at 1)."),
            (
                [1000, 1000, 127, 115, 190],
                "scale at 1e-10 and below and at 1e18 and above (127000 per million differ at 1).",
            ),
            ([0, 0, 0, 9, 0], "scale at 1e10 and above (0 per million differ at 1)."),
            // Five of a thousand are no more than chance may bring.
            ([5, 0, 0, 0, 5], "No other method breaks down in a sweep."),
        ] {
            let verdict = judged(&rows(wrong)).verdict;
            assert!(verdict.ends_with(expected), "{verdict}");
        }
        let without_base = vec![sweep("scale", &[("plucker", 1e10, 9)]), sweep(DEPTH, &[]), sweep(MODES, &[])];
        let message = rows_of::judge(&STUDY, without_base, &header(false)).unwrap_err().to_string();
        assert!(message.contains("no row of scale 1"), "{message}");
    }

    #[test]
    fn sweeps_of_the_users_scenes_are_told_apart_and_the_others_are_named() {
        let rows =
            [("exact", 1.0, 0), ("plucker", 1.0, 0), ("plucker", 1e3, 9), ("plucker", 1.0, 0), ("plucker", 1e3, 0)];
        let mut table = sweep("scale", &rows);
        for (row, scene) in table.rows.iter_mut().zip(["a.obj", "a.obj", "a.obj", "b.obj", "b.obj"]) {
            row.insert("scene".into(), json!(scene));
        }
        let mut header = header(false);
        header.scenes = ["a.obj", "b.obj", "empty.obj"]
            .map(|name| StudiedScene { name: name.into(), triangles: 1, fingerprint: String::new() })
            .to_vec();
        let tables = vec![table, sweep(DEPTH, &[]), sweep(MODES, &[])];
        let found = rows_of::judge(&STUDY, tables, &header).unwrap();
        assert!(
            found.verdict.ends_with("plucker: scale of a.obj at 1000 and above (0 per million differ at 1)."),
            "{}",
            found.verdict
        );
        let titles: Vec<_> = found.charts.iter().map(|chart| chart.title.as_str()).collect();
        assert!(titles[0].starts_with("a.obj: answers") && titles[1].starts_with("b.obj: answers"), "{titles:?}");
        let notes = found.notes.join(" ");
        assert!(notes.contains("moved to zero") && notes.contains("Nothing can be hit in: empty.obj"), "{notes}");
        assert!(notes.contains("shapes of the program's own: the sweeps by valence"), "{notes}");
    }
}
