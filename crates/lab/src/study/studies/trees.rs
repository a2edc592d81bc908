//! Structures: how they are built, how deep, and how rays go through them.

use super::super::lookup::{Clock, is_same_work, speedup};
use super::super::outcome::{Outcome, Rounds};
use super::super::table::{Row, name, number, values};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Subject, Table, Variant, scenes};
use super::{
    BATCH, CAMERA, MOST_FOR_LISTS, SPREAD, Verdict, alike, by_scene, error_note, largest, scenes_of, told, usual_rays,
    with,
};
use raybrook::Result;
use raybrook::low_level::options::{Build, Intersector, KdOptions, StructureKind, TraceOptions, Traversal};
use raybrook::low_level::scene::Scene;
use serde_json::json;

const SPLIT_TITLE: &str = "Speed by the rule that splits";
const TRAVERSAL_TITLE: &str = "Speed by traversal";
const VOLUMES_TITLE: &str = "Speed by bounding volume";

pub const LEAF_SIZE: Study = Study {
    name: "leaf-size",
    title: "Triangles in a leaf of the kd-tree",
    claim: "Thesis, graph 5.1 (section 5.5.2): the median kd-tree is fastest with 30 to 60 triangles in a leaf.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: leaf_size,
    judge: judge_leaf_size,
};

fn leaf_size(lab: &mut Lab) -> Result<Vec<Table>> {
    let sizes: &[u32] = if lab.quick { &[1, 8, 32, 128] } else { &[1, 2, 4, 8, 12, 16, 24, 32, 48, 64, 128, 256] };
    let variant = |&size: &u32| {
        let options =
            TraceOptions::of_kd(KdOptions { build: Build::Median, leaf_size: Some(size), ..KdOptions::DEFAULT });
        Variant::new(format!("median, {size}"), options).with("leaf_size", size)
    };
    let variants: Vec<_> = sizes.iter().map(variant).collect();
    let subjects = lab.usual_subjects()?;
    let rows = lab.compare_all(&subjects, &variants, &[CAMERA])?;
    Ok(vec![Table::new("rays", "Camera rays by the most triangles of a leaf", rows)])
}

fn judge_leaf_size(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "leaf_size"])?;
    let is_claimed = |row: &Row| number(row, "leaf_size").is_some_and(|size| (30.0..=60.0).contains(&size));
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let of_scene = || table.rows.iter().filter(|row| name(row, "scene") == scene);
        let best = largest(of_scene(), "mrays_per_s");
        let claimed = largest(of_scene().filter(|row| is_claimed(row)), "mrays_per_s");
        let other = largest(of_scene().filter(|row| !is_claimed(row)), "mrays_per_s");
        let (Some(best), Some(claimed), Some(other)) = (best, claimed, other) else {
            verdict.not_measured(&scene);
            continue;
        };
        if is_same_work(&[[other, claimed]]) {
            verdict.leave_open(format!("{scene}: leaves of every size do the same work: nothing was compared"));
            continue;
        }
        match speedup(&[[claimed, other]], Clock::Ray) {
            Some(ratio) => verdict.say(
                ratio.above(1.0),
                format!(
                    "{scene} is fastest with at most {} triangles a leaf; the best of 30 to 60 has {ratio} times the \
                     speed of the best other one",
                    name(best, "leaf_size")
                ),
            ),
            None => verdict.not_measured(&scene),
        }
    }
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| {
        Chart::new(ChartKind::Lines, &table, name, title, ["leaf_size", y]).by("scene").log(true, false)
    };
    let charts = vec![
        chart("speed", "Speed by the most triangles in a leaf", "mrays_per_s")
            .spread(SPREAD)
            .caption(format!("Camera rays, kd-tree by medians, full stack, exact hits. {note}")),
        chart("tests", "Triangle tests by the most triangles in a leaf", "tests")
            .log(true, true)
            .caption("The same rays, counted."),
    ];
    Ok(verdict.findings(vec![table], charts))
}

pub const DEPTH: Study = Study {
    name: "depth",
    title: "Depth of the tree, and one huge plane",
    claim: "Thesis, graph 5.2 (section 5.5.2): with scenes of about 700 triangles a plane of 2 huge triangles ruins \
            the median kd-tree, which may then be slower than brute force.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: depth,
    judge: judge_depth,
};

fn depth(lab: &mut Lab) -> Result<Vec<Table>> {
    let depths: &[u32] = if lab.quick { &[0, 4, 10] } else { &[0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20] };
    let builds = if lab.quick { &[Build::Median][..] } else { &[Build::Median, Build::Sah] };
    let mut rows = Vec::new();
    let mut add = |scene: &str, plane: &str, variants: &[Variant], lab: &mut Lab, made| -> Result<()> {
        let subject = Subject::new(scene, made, lab.side_for_lists(), lab.seed)?;
        let found = lab.compare(&subject, variants, &[CAMERA])?;
        rows.extend(found.into_iter().map(|mut row| {
            row.insert("plane".into(), json!(plane));
            let series = format!("{}, {plane} plane", name(&row, "build"));
            row.insert("panel".into(), json!(series));
            row
        }));
        Ok(())
    };
    let mut variants =
        vec![Variant::new("brute force", with(StructureKind::Brute)).with("max_depth", 0).with("build", "brute force")];
    for &build in builds {
        variants.extend(depths.iter().filter(|&&depth| depth > 0).map(|&depth| {
            let options = TraceOptions::of_kd(KdOptions {
                build,
                leaf_size: Some(1),
                max_depth: Some(depth),
                ..KdOptions::DEFAULT
            });
            Variant::new(format!("{build}, {depth}"), options).with("max_depth", depth).with("build", build.name())
        }));
    }
    if lab.scenes.is_empty() {
        for (scene, is_boulder) in [("boulder", true), ("cubes", false)] {
            for (plane, has_plane) in [("without", false), ("with", true)] {
                add(scene, plane, &variants, lab, scenes::on_plane(is_boulder, has_plane)?)?;
            }
        }
    } else {
        for (scene, made) in lab.scenes {
            // Brute force on a large scene would take hours.
            let first = usize::from(made.hittable().len() > MOST_FOR_LISTS);
            add(scene, "without a further", &variants[first..], lab, made.clone())?;
        }
    }
    Ok(vec![Table::new("rays", "Camera rays by the limit of the tree's depth", rows)])
}

fn judge_depth(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "plane", "method"])?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let best = |build: &str, plane: &str| {
            let of = table.rows.iter().filter(|row| {
                name(row, "scene") == scene && name(row, "build") == build && name(row, "plane") == plane
            });
            largest(of, "mrays_per_s")
        };
        let median = Build::Median.name();
        let ratio =
            |plane: &str, a: &str, b: &str, plane_b: &str| speedup(&[[best(a, plane)?, best(b, plane_b)?]], Clock::Ray);
        let with_and_without = ratio("with", median, median, "without");
        match (with_and_without, ratio("with", median, "brute force", "with")) {
            (Some(of_its_own), Some(of_brute)) => verdict.say(
                of_brute.below(1.0),
                format!(
                    "{scene}: the best median tree has {of_its_own} of its speed when the plane is there, \
                     {of_brute:.1} times that of brute force"
                ),
            ),
            _ => verdict.leave_open(format!("{scene}: not measured with and without a plane")),
        }
    }
    let note = error_note(&table.rows);
    let charts = by_scene(ChartKind::Lines, &table, "scene", "speed by depth", ["max_depth", "mrays_per_s"], |chart| {
        let caption = format!("Camera rays, exact hits; depth 0 is brute force. {note}");
        chart.by("panel").spread(SPREAD).log(false, true).caption(caption)
    });
    // It may be slower: one scene is enough.
    let outcome = verdict.any();
    Ok(Findings { outcome, ..verdict.findings(vec![table], charts) })
}

pub const TRIANGLES: Study = Study {
    name: "triangles",
    title: "Time by the number of triangles",
    claim: "Thesis, graph 5.3 (section 5.6.2): at 70,000 triangles a kd-tree is over 20 times as fast as brute force, \
            at some hundred no faster; and the time of a ray in a tree grows with the logarithm of the triangles.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: triangles,
    judge: judge_triangles,
};

fn triangles(lab: &mut Lab) -> Result<Vec<Table>> {
    let levels = match (lab.quick, lab.device.is_some()) {
        (true, _) => 0..=4,
        (false, false) => 0..=7,
        // 8 million triangles.
        (false, true) => 0..=10,
    };
    let structures = if lab.quick {
        &[StructureKind::Kd, StructureKind::Bvh2][..]
    } else {
        &[StructureKind::Kd, StructureKind::Bvh2, StructureKind::Bvh8, StructureKind::Grid]
    };
    let mut rows = Vec::new();
    let mut measure = |name: &str, scene: Scene, lab: &mut Lab| -> Result<()> {
        let variants: Vec<_> = structures.iter().map(|&accel| Variant::new(accel.name(), with(accel))).collect();
        let subject = lab.subject(name, scene.clone())?;
        rows.extend(lab.compare(&subject, &variants, &[CAMERA])?);
        if subject.triangle_count <= if lab.quick { 600 } else { 40_000 } {
            let fewer = Subject::new(name, scene, lab.side_for_lists(), lab.seed)?;
            rows.extend(lab.compare(&fewer, &[Variant::new("brute", with(StructureKind::Brute))], &[CAMERA])?);
        }
        Ok(())
    };
    if lab.scenes.is_empty() {
        for level in levels {
            measure("boulder", scenes::boulder(level)?, lab)?;
        }
    } else {
        for (name, scene) in lab.scenes {
            measure(name, scene.clone(), lab)?;
        }
    }
    Ok(vec![Table::new("rays", "Camera rays by the number of triangles", rows)])
}

fn judge_triangles(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "triangles", "method"])?;
    let mut verdict = Verdict::default();
    let mut ratios = Vec::new();
    for row in table.rows.iter().filter(|row| name(row, "method") == StructureKind::Brute.name()) {
        let (scene, count) = (name(row, "scene"), name(row, "triangles"));
        let tree = table.one(&[("scene", &scene), ("triangles", &count), ("method", StructureKind::Kd.name())])?;
        let ratio = tree.and_then(|tree| speedup(&[[tree, row]], Clock::Ray));
        let Some((ratio, triangles)) = ratio.zip(number(row, "triangles")) else { continue };
        ratios.push((triangles, ratio, count));
    }
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, ratio, count) in &ratios {
        verdict.add(format!("{count} triangles: the kd-tree has {ratio:.1} times the speed of brute force"));
    }
    let large = ratios.iter().find(|(count, ..)| *count >= 30_000.0);
    let small = ratios.iter().find(|(count, ..)| (100.0..1000.0).contains(count));
    verdict.outcomes.extend(match large.zip(small) {
        Some(((_, large, _), (_, small, _))) => vec![large.above(20.0), small.below(2.0)],
        None => vec![Outcome::Undecided],
    });
    growth(&table, &mut verdict);
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| {
        Chart::new(ChartKind::Lines, &table, name, title, ["triangles", y]).by("method").log(true, true)
    };
    let charts = vec![
        chart("speed", "Speed by the number of triangles", "mrays_per_s")
            .spread(SPREAD)
            .caption(format!("Camera rays, exact hits, ray by ray. {note}")),
        chart("build", "Time to build", "build_s").caption("On the host, all cores."),
        chart("memory", "Memory", "bytes_per_triangle").caption("Everything on the device, shading data included."),
    ];
    Ok(verdict.findings(vec![table], charts))
}

/// What a doubling of the triangles costs a ray in the kd-tree: of one and the same scene, since other scenes cost
/// something else.
fn growth(table: &Table, verdict: &mut Verdict) {
    for scene in scenes_of(&table.rows) {
        let of = |row: &&Row| name(row, "scene") == scene && name(row, "method") == StructureKind::Kd.name();
        let points = table.rows.iter().filter(of);
        let points = points.filter_map(|row| Some((number(row, "triangles")?, 1e3 / number(row, "mrays_per_s")?)));
        let mut points: Vec<_> = points.filter(|(count, _)| *count >= 1.0).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let [(first, first_ns), .., (last, last_ns)] = points[..]
            && last > first
        {
            let cost = (last_ns - first_ns) / (last / first).log2();
            verdict.add(format!("in the kd-tree a ray costs {cost:.2} ns more for each doubling"));
        }
    }
}

pub const SPLIT_RULE: Study = Study {
    name: "split-rule",
    title: "Where a kd-tree is split",
    claim: "Thesis, section 5.5: the probability that a ray hits a cell is its share of the VOLUME; children that are \
            nearly alike (within 5 %) end the division. The law is surface area (MacDonald and Booth 1990). The claim \
            tested: trees by volumes are as fast, within 5 %, as trees by areas.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: split_rule,
    judge: judge_split_rule,
};

/// The median tree without the end that similar children are to it; by default both may keep 95 % of the triangles.
const ANY_CHILDREN: &str = "median, however similar children are";

fn split_rule(lab: &mut Lab) -> Result<Vec<Table>> {
    let mut variants: Vec<_> = Build::ALL
        .iter()
        .map(|&build| Variant::new(build.name(), TraceOptions::of_kd(KdOptions { build, ..KdOptions::DEFAULT })))
        .collect();
    let any =
        TraceOptions::of_kd(KdOptions { build: Build::Median, similar_children: Some(1.0), ..KdOptions::DEFAULT });
    variants.push(Variant::new(ANY_CHILDREN, any));
    usual_rays(lab, &variants, SPLIT_TITLE)
}

/// How many times the speed of method `b` method `a` has in a scene.
fn faster(table: &Table, scene: &str, a: &str, b: &str) -> Result<Compared> {
    let key = |method| [("scene", scene), ("method", method)];
    let Some(pairs) = table.pairs(&key(a), &key(b), &["rays_of"])? else { return Ok(Compared::NotMeasured) };
    if is_same_work(&pairs) {
        return Ok(Compared::Alike);
    }
    Ok(speedup(&pairs, Clock::Ray).map_or(Compared::NotMeasured, Compared::Ratio))
}

/// What a comparison of two methods in a scene came to.
enum Compared {
    Ratio(Rounds),
    /// Both did the same work: what was timed is one thing twice.
    Alike,
    NotMeasured,
}

fn judge_split_rule(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        match faster(&table, &scene, Build::Volume.name(), Build::Sah.name())? {
            Compared::Ratio(ratio) => verdict.say(
                ratio.above(0.95),
                format!(
                    "{scene}: trees by volumes have {ratio} of the speed of trees by areas, at {} of their expected \
                     cost",
                    told_cost(&table, &scene)?
                ),
            ),
            Compared::Alike => {
                verdict.leave_open(format!("{scene}: trees by volumes and by areas are alike: nothing was compared"));
            }
            Compared::NotMeasured => verdict.not_measured(&format!("{scene}: trees by volumes against trees by areas")),
        }
        verdict.add(match faster(&table, &scene, Build::Median.name(), ANY_CHILDREN)? {
            Compared::Ratio(ratio) => {
                format!(
                    "{scene}: median trees that end at similar children have {ratio} of the speed of those that do not"
                )
            }
            Compared::Alike => {
                format!("{scene}: no median tree ended at similar children: of that nothing was compared")
            }
            Compared::NotMeasured => {
                format!("{scene}: median trees that do not end at similar children were not measured")
            }
        });
    }
    bars_of(table, verdict, SPLIT_TITLE, "kd-tree, full stack, exact hits")
}

/// The expected cost of trees by volumes, of that of trees by areas.
fn told_cost(table: &Table, scene: &str) -> Result<String> {
    let key = |build: Build| [("scene", scene), ("method", build.name())];
    let ratio = table.ratio("tree_cost", &key(Build::Volume), &key(Build::Sah), &["rays_of"])?;
    Ok(ratio.map_or("(not measured)".to_owned(), |ratio| format!("{ratio:.2}")))
}

/// Findings with a chart of speeds for each scene, one bar for each method and kind of rays, and one of steps and of
/// tests.
fn bars_of(table: Table, verdict: Verdict, title: &str, what: &str) -> Result<Findings> {
    let note = error_note(&table.rows);
    let charts = |file: &str, title: &str, y: &str, caption: &str| {
        by_scene(ChartKind::Bars, &table, file, title, ["method", y], |chart| chart.by("rays_of").caption(caption))
    };
    let speeds = charts("speed", &lower(title), "mrays_per_s", &format!("{what}. {note}"));
    let steps = charts("steps", "steps", "steps", "Counted ray by ray on a part of the same rays.");
    let charts = speeds.into_iter().zip(steps).flat_map(|(speed, steps)| [speed.spread(SPREAD), steps]).collect();
    let notes = alike(&table)?;
    Ok(Findings { notes, ..verdict.findings(vec![table], charts) })
}

fn lower(title: &str) -> String {
    let mut letters = title.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

pub const TRAVERSAL: Study = Study {
    name: "traversal",
    title: "How rays find their way through a kd-tree",
    claim: "Thesis, section 5.6.1: a short stack is about twice as fast as restarts; ropes take over 3 times the \
            memory for fewer steps, perhaps more accesses to memory.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: traversal,
    judge: judge_traversal,
};

const STACK: &str = "stack";
const RESTART: &str = "restart";
const ROPES: &str = "ropes";

fn short_stack(size: &str) -> String {
    format!("short stack of {size}")
}

fn traversal(lab: &mut Lab) -> Result<Vec<Table>> {
    let mut variants = vec![
        Variant::new(STACK, with(StructureKind::Kd)),
        Variant::new(RESTART, TraceOptions::of_kd(KdOptions { traversal: Traversal::Restart, ..KdOptions::DEFAULT })),
        Variant::new(
            "push-down",
            TraceOptions::of_kd(KdOptions { traversal: Traversal::PushDown, ..KdOptions::DEFAULT }),
        ),
    ];
    let sizes: &[u32] = if lab.quick { &[4] } else { &[1, 2, 4, 8, 16] };
    variants.extend(sizes.iter().map(|&size| {
        let options = TraceOptions::of_kd(KdOptions {
            traversal: Traversal::ShortStack,
            stack_size: Some(size),
            ..KdOptions::DEFAULT
        });
        Variant::new(short_stack(&size.to_string()), options).with("stack_size", size)
    }));
    variants.push(Variant::new(
        ROPES,
        TraceOptions::of_kd(KdOptions { traversal: Traversal::Ropes, ..KdOptions::DEFAULT }),
    ));
    if !lab.quick {
        let thesis = TraceOptions::of_kd(KdOptions { traversal: Traversal::ThesisRestart, ..KdOptions::DEFAULT });
        variants.push(Variant::new("restart as the thesis prints it", thesis));
    }
    usual_rays(lab, &variants, TRAVERSAL_TITLE)
}

fn judge_traversal(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let sizes = values(table.rows.iter().filter(|row| row.contains_key("stack_size")), "stack_size");
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let ratio = |a: &str, b: &str, column: &str| {
            table.ratio(column, &[("scene", &scene), ("method", a)], &[("scene", &scene), ("method", b)], &["rays_of"])
        };
        let short = short_stacks(&table, &scene, &sizes)?;
        let (memory, steps) = (ratio(ROPES, STACK, "device_bytes")?, ratio(ROPES, STACK, "steps")?);
        let count = |holds: Option<bool>| holds.map_or(Outcome::Undecided, Outcome::of);
        let text = |value: Option<f64>| value.map_or("(not measured)".to_owned(), |value| format!("{value:.2}"));
        // About twice: nearer to it than to 1.6 or 2.5 times.
        let outcomes = short.as_ref().map(|short| [short.above(1.6), short.below(2.5)]);
        let is_twice = Outcome::all(outcomes.into_iter().flatten());
        let outcomes = [is_twice, count(memory.map(|memory| memory > 3.0)), count(steps.map(|steps| steps < 1.0))];
        verdict.outcomes.push(Outcome::all(outcomes));
        verdict.add(format!(
            "{scene}: short stacks have {} times the speed of restarts; ropes take {} times the memory and {} of the \
             steps of a full stack",
            told(short.as_ref()),
            text(memory),
            text(steps)
        ));
    }
    bars_of(table, verdict, TRAVERSAL_TITLE, "kd-tree by surface areas, exact hits")
}

/// How many times the speed of restarts short stacks have, over all sizes; `None`: they were not timed.
fn short_stacks(table: &Table, scene: &str, sizes: &[String]) -> Result<Option<Rounds>> {
    let mut pairs = Vec::new();
    for size in sizes {
        let (short, restart) = (short_stack(size), [("scene", scene), ("method", RESTART)]);
        match table.pairs(&[("scene", scene), ("method", &short)], &restart, &["rays_of"])? {
            Some(found) => pairs.extend(found),
            None => return Ok(None),
        }
    }
    Ok(speedup(&pairs, Clock::Ray))
}

pub const BOUNDING_VOLUMES: Study = Study {
    name: "bounding-volumes",
    title: "Bounding volumes",
    claim: "Thesis, section 2.2.2: bounding volumes make tracing over 10 times as fast, and the sphere is the cheapest \
            to test.",
    own_shapes: None,
    source: include_str!("trees.rs"),
    measure: bounding_volumes,
    judge: judge_bounding_volumes,
};

fn bounding_volumes(lab: &mut Lab) -> Result<Vec<Table>> {
    let levels = if lab.quick { 3 } else { 4 };
    let subjects = lab.subjects(&[
        ("boulder", &|| scenes::boulder(levels)),
        ("cubes", &|| scenes::cubes(if levels == 3 { 20 } else { 160 })),
    ])?;
    let fit: Vec<_> = subjects.into_iter().filter(|subject| subject.triangle_count <= MOST_FOR_LISTS).collect();
    let structures = [
        StructureKind::Brute,
        StructureKind::Spheres,
        StructureKind::Boxes,
        StructureKind::Octree,
        StructureKind::Grid,
        StructureKind::Bvh2,
    ];
    let variants: Vec<_> = structures
        .iter()
        .filter(|accel| !lab.quick || !matches!(accel, StructureKind::Octree | StructureKind::Grid))
        .map(|&accel| Variant::new(accel.name(), TraceOptions { intersector: Intersector::Watertight, ..with(accel) }))
        .collect();
    let rows = lab.compare_all(&fit, &variants, &[CAMERA])?;
    Ok(vec![Table::new("rays", format!("{VOLUMES_TITLE}: all measurements"), rows)])
}

fn judge_bounding_volumes(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let key = |accel: StructureKind| [("scene", scene.as_str()), ("method", accel.name())];
        let ratio = |a, b| table.speedup(Clock::Ray, &key(a), &key(b), &["rays_of"]);
        let (spheres, boxes) = (StructureKind::Spheres, StructureKind::Boxes);
        let of_brute = |accel| ratio(accel, StructureKind::Brute);
        match (of_brute(spheres)?, of_brute(boxes)?, ratio(spheres, boxes)?) {
            (Some(spheres), Some(boxes), Some(to_boxes)) => verdict.say(
                Outcome::all([spheres.above(10.0), to_boxes.above(1.0)]),
                format!("{scene}: spheres have {spheres:.1} times and boxes {boxes:.1} times the speed of brute force"),
            ),
            _ => verdict.not_measured(&scene),
        }
    }
    if table.rows.is_empty() {
        verdict.add(format!(
            "lists of volumes are measured in scenes of up to {MOST_FOR_LISTS} triangles, and there is none"
        ));
    }
    bars_of(table, verdict, VOLUMES_TITLE, "Camera rays, watertight test, lists of clusters and trees of boxes")
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, rays, timed, with_columns, work};
    use super::*;
    use crate::study::table::row;

    /// Each row with work of its own.
    fn worked(tables: Vec<Table>) -> Vec<Table> {
        with_columns(tables, |row| work(number(row, "mrays_per_s").unwrap_or(0.0)))
    }

    fn found(study: &Study, tables: Vec<Table>) -> Findings {
        judge(study, tables, &header(false)).unwrap()
    }

    #[test]
    fn the_fastest_leaves_must_be_of_the_claimed_size() {
        let sizes = |middle: f64, is_alike: bool| {
            let rows = rays(&[("s", "median, 8", 8.0), ("s", "median, 32", middle), ("s", "median, 128", 7.0)]);
            with_columns(rows, |row| {
                let size: u32 = name(row, "method").rsplit(' ').next().unwrap().parse().unwrap();
                let mut out = work(if is_alike { 1.0 } else { size.into() });
                out.insert("leaf_size".into(), json!(size));
                out
            })
        };
        assert_eq!(found(&LEAF_SIZE, sizes(9.0, false)).outcome, Outcome::Holds);
        let fails = found(&LEAF_SIZE, sizes(6.0, false));
        assert_eq!(fails.outcome, Outcome::Fails);
        assert!(
            fails.verdict.contains("at most 8 triangles a leaf; the best of 30 to 60 has 0.75 "),
            "{}",
            fails.verdict
        );
        let alike = found(&LEAF_SIZE, sizes(6.0, true));
        assert_eq!(
            (alike.outcome, alike.verdict.contains("nothing was compared")),
            (Outcome::Undecided, true),
            "{}",
            alike.verdict
        );
    }

    #[test]
    fn a_plane_ruins_the_median_tree_where_brute_force_is_faster() {
        let scene = |median_with: f64| {
            let rows = ["brute force", "median, 4", "median, 8", "sah, 8", "median, 8"];
            let rows = rays(&rows.map(|method| ("s", method, 1.0)));
            let columns = [
                ("brute force", "with", 2.0),
                ("median", "with", median_with / 2.0),
                ("median", "with", median_with),
                ("sah", "with", 90.0),
                ("median", "without", 10.0),
            ];
            let mut rows = rows;
            for (out, (build, plane, rate)) in rows[0].rows.iter_mut().zip(columns) {
                out.extend(row([("build", json!(build)), ("plane", json!(plane))]));
                out.extend(timed(rate));
            }
            rows
        };
        let fails = found(&DEPTH, scene(4.0));
        assert_eq!(fails.outcome, Outcome::Fails);
        assert!(
            fails.verdict.contains("0.40 [0.40, 0.40] of its speed when the plane is there, 2.0 [2.0, 2.0] times"),
            "{}",
            fails.verdict
        );
        assert_eq!(found(&DEPTH, scene(1.0)).outcome, Outcome::Holds);
        let users = with_columns(rays(&[("s", "median, 8", 1.0)]), |_| row([("plane", json!("without a further"))]));
        let users = found(&DEPTH, users);
        assert_eq!(
            (users.outcome, &users.verdict[..]),
            (Outcome::Undecided, "s: not measured with and without a plane.")
        );
    }

    #[test]
    fn trees_are_compared_with_brute_force_in_the_same_scene() {
        let rows = |large: f64| {
            let rows = [
                ("a", "kd", 30.0),
                ("a", "brute", 20.0),
                ("b", "kd", large),
                ("b", "brute", 1.0),
                // As many triangles as another scene has, but far faster.
                ("c", "kd", 5000.0),
            ];
            let mut rows = rays(&rows);
            for (out, count) in rows[0].rows.iter_mut().zip([500, 500, 40_000, 40_000, 40_000]) {
                out.insert("triangles".into(), json!(count));
            }
            rows
        };
        let holds = found(&TRIANGLES, rows(25.0));
        assert_eq!(holds.outcome, Outcome::Holds);
        assert_eq!(
            holds.verdict,
            "500 triangles: the kd-tree has 1.5 [1.5, 1.5] times the speed of brute force; 40000 triangles: the \
             kd-tree has 25.0 [25.0, 25.0] times the speed of brute force."
        );
        assert_eq!(found(&TRIANGLES, rows(15.0)).outcome, Outcome::Fails);
        let grown = with_columns(rays(&[("a", "kd", 10.0)]), |_| row([("triangles", json!(100))]));
        let mut grown = grown;
        let mut larger = grown[0].rows[0].clone();
        larger.extend(row([("triangles", json!(400))]));
        larger.extend(timed(5.0));
        grown[0].rows.push(larger);
        assert_eq!(found(&TRIANGLES, grown).verdict, "in the kd-tree a ray costs 50.00 ns more for each doubling.");
    }

    #[test]
    fn trees_by_volumes_must_be_as_fast_as_trees_by_areas() {
        let rows = |volume: f64| {
            worked(rays(&[("s", "median", 4.0), ("s", ANY_CHILDREN, 5.0), ("s", "sah", 10.0), ("s", "volume", volume)]))
        };
        let holds = found(&SPLIT_RULE, rows(9.8));
        assert_eq!((holds.outcome, holds.notes.len()), (Outcome::Holds, 0));
        assert!(holds.verdict.contains("end at similar children have 0.80 [0.80, 0.80] of the speed"));
        assert_eq!(found(&SPLIT_RULE, rows(9.0)).outcome, Outcome::Fails);
    }

    /// As published: similar children ended the median tree already, and the second side was the first one again.
    #[test]
    fn two_sides_of_the_same_work_compare_nothing() {
        let same = |row: &Row| {
            work(if name(row, "method").starts_with("median") { 1.0 } else { number(row, "mrays_per_s").unwrap() })
        };
        let published = [
            ("s", "median", 4.0),
            ("s", "median, similar children 5 %", 4.1),
            ("s", "sah", 10.0),
            ("s", "volume", 9.8),
        ];
        let published = found(&SPLIT_RULE, with_columns(rays(&published), same));
        assert_eq!(published.outcome, Outcome::Holds);
        assert!(published.verdict.contains("were not measured"), "{}", published.verdict);
        assert_eq!(
            published.notes,
            ["'median' and 'median, similar children 5 %' did the same work for every ray: between them nothing was \
              compared."]
        );
        let rows = [("s", "median", 4.0), ("s", ANY_CHILDREN, 4.1), ("s", "sah", 10.0), ("s", "volume", 9.8)];
        let alike = found(&SPLIT_RULE, with_columns(rays(&rows), same));
        assert!(alike.verdict.contains("no median tree ended at similar children"), "{}", alike.verdict);
        let both = found(&SPLIT_RULE, with_columns(rays(&rows), |_| work(1.0)));
        assert_eq!((both.outcome, both.verdict.contains("alike: nothing was compared")), (Outcome::Undecided, true));
    }

    /// As published of the H200: the thesis's restart, which is fast and wrong, was taken for a further row of the
    /// restart.
    #[test]
    fn restarts_are_not_those_of_the_thesis() {
        let rows = |short: f64, memory: f64, thesis: Option<f64>| {
            let small = ("s", "short stack of 2", short / 2.0);
            let mut all = vec![
                ("s", STACK, 9.0),
                ("s", RESTART, 5.0),
                small,
                ("s", "short stack of 8", short * 2.0),
                ("s", ROPES, 4.0),
            ];
            all.extend(thesis.map(|speed| ("s", "restart as the thesis prints it", speed)));
            with_columns(worked(rays(&all)), |row| {
                let method = name(row, "method");
                let size = method
                    .strip_prefix("short stack of ")
                    .map(|size| ("stack_size".to_owned(), json!(size.parse::<u32>().unwrap())));
                let bytes = if method == ROPES { memory } else { 1.0 };
                size.into_iter().chain([("device_bytes".to_owned(), json!(bytes))]).collect()
            })
        };
        let holds = found(&TRAVERSAL, rows(10.0, 3.5, Some(50.0)));
        assert_eq!(holds.outcome, Outcome::Holds);
        assert!(holds.verdict.starts_with("s: short stacks have 2.00 [2.00, 2.00] times the speed of restarts; ropes"));
        assert_eq!(found(&TRAVERSAL, rows(10.0, 3.5, None)).verdict, holds.verdict);
        assert_eq!(found(&TRAVERSAL, rows(6.0, 3.5, Some(1.5))).outcome, Outcome::Fails);
        assert_eq!(found(&TRAVERSAL, rows(10.0, 1.6, Some(50.0))).outcome, Outcome::Fails);
        let without_ropes: Vec<_> = rows(10.0, 3.5, None)
            .into_iter()
            .map(|mut table| {
                table.rows.retain(|row| name(row, "method") != ROPES);
                table
            })
            .collect();
        let lacking = found(&TRAVERSAL, without_ropes);
        assert_eq!(
            (lacking.outcome, lacking.verdict.contains("ropes take (not measured)")),
            (Outcome::Undecided, true)
        );
    }

    #[test]
    fn spheres_must_beat_boxes_and_brute_force() {
        let rows = |spheres: f64| worked(rays(&[("s", "brute", 1.0), ("s", "spheres", spheres), ("s", "boxes", 11.0)]));
        assert_eq!(found(&BOUNDING_VOLUMES, rows(12.0)).outcome, Outcome::Holds);
        assert_eq!(found(&BOUNDING_VOLUMES, rows(10.5)).outcome, Outcome::Fails);
        // Rows without a speed are no confirmation.
        let untimed = found(&BOUNDING_VOLUMES, rays(&[("s", "brute", 1.0)]));
        assert_eq!((untimed.outcome, &untimed.verdict[..]), (Outcome::Undecided, "s: not measured."));
        assert_eq!(found(&BOUNDING_VOLUMES, rays(&[])).outcome, Outcome::Undecided);
    }
}
