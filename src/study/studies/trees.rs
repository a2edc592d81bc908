//! Structures: how they are built, how deep, and how rays go through them.

use super::super::table::{Row, name, number};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Subject, Table, Variant, scenes};
use super::{ALL_KINDS, CAMERA, MOST_FOR_LISTS, SPREAD, by_scene, error_note, largest, mean, scenes_of, with};
use crate::error::Result;
use crate::options::{Accel, Build, Intersector, TraceOptions, Traversal};
use crate::scene::Scene;
use serde_json::json;

pub const LEAF_SIZE: Study = Study {
    name: "leaf-size",
    title: "Triangles in a leaf of the kd-tree",
    claim: "Thesis, graph 5.1 (section 5.5.2): the median kd-tree is fastest with 30 to 60 triangles in a leaf.",
    run: leaf_size,
};

fn leaf_size(lab: &mut Lab) -> Result<Findings> {
    let sizes: &[u32] = if lab.quick { &[1, 8, 32, 128] } else { &[1, 2, 4, 8, 12, 16, 24, 32, 48, 64, 128, 256] };
    let variant = |&size: &u32| {
        let options = TraceOptions { build: Build::Median, leaf_size: Some(size), ..with(Accel::Kd) };
        Variant::new(format!("median, {size}"), options).with("leaf_size", size)
    };
    let variants: Vec<_> = sizes.iter().map(variant).collect();
    let subjects = lab.usual_subjects()?;
    let rows = lab.compare_all(&subjects, &variants, &[CAMERA])?;
    let is_claimed = |row: &Row| number(row, "leaf_size").is_some_and(|size| (30.0..=60.0).contains(&size));
    let mut sentences = Vec::new();
    let mut holds = true;
    for scene in scenes_of(&rows) {
        let of_scene: Vec<Row> = rows.iter().filter(|row| name(row, "scene") == scene).cloned().collect();
        let (Some(best), Some(claimed)) =
            (largest(&of_scene, "mrays_per_s"), largest(of_scene.iter().filter(|row| is_claimed(row)), "mrays_per_s"))
        else {
            continue;
        };
        holds &= is_claimed(best);
        let ratio = number(claimed, "mrays_per_s").unwrap_or(0.0) / number(best, "mrays_per_s").unwrap_or(1.0);
        sentences.push(format!(
            "{scene} is fastest with at most {} triangles a leaf; with 30 to 60 it has {ratio:.2} of that speed",
            name(best, "leaf_size")
        ));
    }
    let note = error_note(&rows);
    let table = Table::new("rays", "Camera rays by the most triangles of a leaf", rows);
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
    Ok(Findings {
        holds: (!sentences.is_empty()).then_some(holds),
        verdict: sentence(&sentences),
        notes: Vec::new(),
        tables: vec![table],
        charts,
    })
}

/// Several findings as one sentence.
fn sentence(parts: &[String]) -> String {
    match parts {
        [] => "Nothing could be measured.".to_owned(),
        parts => parts.join("; ") + ".",
    }
}

pub const DEPTH: Study = Study {
    name: "depth",
    title: "Depth of the tree, and one huge plane",
    claim: "Thesis, graph 5.2 (section 5.5.2): with scenes of about 700 triangles a plane of 2 huge triangles ruins the median kd-tree, which may \
            then be slower than brute force.",
    run: depth,
};

fn depth(lab: &mut Lab) -> Result<Findings> {
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
        vec![Variant::new("brute force", with(Accel::Brute)).with("max_depth", 0).with("build", "brute force")];
    for &build in builds {
        variants.extend(depths.iter().filter(|&&depth| depth > 0).map(|&depth| {
            let options = TraceOptions { build, leaf_size: Some(1), max_depth: Some(depth), ..with(Accel::Kd) };
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
    let mut sentences = Vec::new();
    let mut holds = None;
    for scene in scenes_of(&rows) {
        let best = |build: &str, plane: &str| {
            let of = rows.iter().filter(|row| {
                name(row, "scene") == scene && name(row, "build") == build && name(row, "plane") == plane
            });
            number(largest(of, "mrays_per_s")?, "mrays_per_s")
        };
        let median = Build::Median.name();
        if let (Some(with), Some(without), Some(brute)) =
            (best(median, "with"), best(median, "without"), best("brute force", "with"))
        {
            holds = Some(holds.unwrap_or(false) || with < brute);
            sentences.push(format!(
                "{scene}: the best median tree has {:.2} of its speed when the plane is there, {:.1} times that of brute force",
                with / without,
                with / brute
            ));
        }
    }
    let note = error_note(&rows);
    let table = Table::new("rays", "Camera rays by the limit of the tree's depth", rows);
    let charts = by_scene(ChartKind::Lines, &table, "scene", "speed by depth", ["max_depth", "mrays_per_s"], |chart| {
        let caption = format!("Camera rays, exact hits; depth 0 is brute force. {note}");
        chart.by("panel").spread(SPREAD).log(false, true).caption(caption)
    });
    Ok(Findings { holds, verdict: sentence(&sentences), notes: Vec::new(), tables: vec![table], charts })
}

pub const TRIANGLES: Study = Study {
    name: "triangles",
    title: "Time by the number of triangles",
    claim: "Thesis, graph 5.3 (section 5.6.2): at 70,000 triangles a kd-tree is over 20 times as fast as brute force, at some hundred no faster; \
            and the time of a ray in a tree grows with the logarithm of the triangles.",
    run: triangles,
};

fn triangles(lab: &mut Lab) -> Result<Findings> {
    let levels = match (lab.quick, lab.device.is_some()) {
        (true, _) => 0..=4,
        (false, false) => 0..=7,
        // 8 million triangles.
        (false, true) => 0..=10,
    };
    let structures =
        if lab.quick { &[Accel::Kd, Accel::Bvh2][..] } else { &[Accel::Kd, Accel::Bvh2, Accel::Bvh8, Accel::Grid] };
    let mut rows = Vec::new();
    let mut measure = |name: &str, scene: Scene, lab: &mut Lab| -> Result<()> {
        let variants: Vec<_> = structures.iter().map(|&accel| Variant::new(accel.name(), with(accel))).collect();
        let subject = lab.subject(name, scene.clone())?;
        rows.extend(lab.compare(&subject, &variants, &[CAMERA])?);
        if subject.triangle_count <= if lab.quick { 600 } else { 40_000 } {
            let fewer = Subject::new(name, scene, lab.side_for_lists(), lab.seed)?;
            rows.extend(lab.compare(&fewer, &[Variant::new("brute", with(Accel::Brute))], &[CAMERA])?);
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
    let speed = |method: &str, triangles: f64| {
        mean(&rows, "mrays_per_s", |row| name(row, "method") == method && number(row, "triangles") == Some(triangles))
    };
    let mut counts: Vec<f64> = rows.iter().filter_map(|row| number(row, "triangles")).collect();
    counts.sort_by(f64::total_cmp);
    counts.dedup();
    let ratio = |count: f64| Some(speed("kd", count)? / speed("brute", count)?);
    let ratios: Vec<_> = counts.iter().filter_map(|&count| Some((count, ratio(count)?))).collect();
    let large = ratios.iter().find(|(count, _)| *count >= 30_000.0);
    let small = ratios.iter().find(|(count, _)| (100.0..1000.0).contains(count));
    let mut sentences: Vec<String> = ratios
        .iter()
        .map(|(count, ratio)| format!("{count} triangles: the kd-tree has {ratio:.1} times the speed of brute force"))
        .collect();
    if let (Some(&first), Some(&last)) = (counts.first(), counts.last())
        && let (Some(a), Some(b)) = (speed("kd", first), speed("kd", last))
        && last > first
    {
        let doublings = (last / first).log2();
        sentences.push(format!(
            "in the kd-tree a ray costs {:.2} ns more for each doubling",
            (1e3 / b - 1e3 / a) / doublings
        ));
    }
    let holds = large.zip(small).map(|((_, large), (_, small))| *large > 20.0 && *small < 2.0);
    let note = error_note(&rows);
    let table = Table::new("rays", "Camera rays by the number of triangles", rows);
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
    Ok(Findings { holds, verdict: sentence(&sentences), notes: Vec::new(), tables: vec![table], charts })
}

pub const SPLIT_RULE: Study = Study {
    name: "split-rule",
    title: "Where a kd-tree is split",
    claim: "Thesis, section 5.5: the probability that a ray hits a cell is its share of the VOLUME; children that are nearly alike (within 5 %) end \
            the division. The law is surface area (MacDonald and Booth 1990). The claim \
            tested: trees by volumes are as fast, within 5 %, as trees by areas.",
    run: split_rule,
};

fn split_rule(lab: &mut Lab) -> Result<Findings> {
    let mut variants: Vec<_> =
        Build::ALL.iter().map(|&build| Variant::new(build.name(), TraceOptions { build, ..with(Accel::Kd) })).collect();
    let mut similar = TraceOptions { build: Build::Median, ..with(Accel::Kd) };
    // Both children keep more than this share of the triangles.
    similar.kd.similar_children = Some(0.95);
    if similar.validate().is_ok() {
        variants.push(Variant::new("median, similar children 5 %", similar));
    }
    let subjects = lab.usual_subjects()?;
    let kinds: &[usize] = if lab.quick { &[CAMERA] } else { &ALL_KINDS };
    let rows = lab.compare_all(&subjects, &variants, kinds)?;
    let speed = |method: Build, scene: &str| {
        mean(&rows, "mrays_per_s", |row| name(row, "method") == method.name() && name(row, "scene") == scene)
    };
    let ratios: Vec<_> = scenes_of(&rows)
        .into_iter()
        .filter_map(|scene| Some((speed(Build::Volume, &scene)? / speed(Build::Sah, &scene)?, scene)))
        .collect();
    let sentences: Vec<_> = ratios
        .iter()
        .map(|(ratio, scene)| format!("{scene}: trees by volumes have {ratio:.2} of the speed of trees by areas"))
        .collect();
    let holds = (!ratios.is_empty()).then(|| ratios.iter().all(|(ratio, _)| *ratio > 0.95));
    bars_of(rows, holds, &sentences, "Speed by the rule that splits", "kd-tree, full stack, exact hits")
}

/// Findings with a chart of speeds for each scene, one bar for each method and kind of rays, and one of steps and of tests.
fn bars_of(rows: Vec<Row>, holds: Option<bool>, sentences: &[String], title: &str, what: &str) -> Result<Findings> {
    let note = error_note(&rows);
    let table = Table::new("rays", format!("{title}: all measurements"), rows);
    let charts = |file: &str, title: &str, y: &str, caption: &str| {
        by_scene(ChartKind::Bars, &table, file, title, ["method", y], |chart| chart.by("rays_of").caption(caption))
    };
    let speeds = charts("speed", &lower(title), "mrays_per_s", &format!("{what}. {note}"));
    let steps = charts("steps", "steps", "steps", "Counted ray by ray on a part of the same rays.");
    let charts = speeds.into_iter().zip(steps).flat_map(|(speed, steps)| [speed.spread(SPREAD), steps]).collect();
    Ok(Findings { holds, verdict: sentence(sentences), notes: Vec::new(), tables: vec![table], charts })
}

fn lower(title: &str) -> String {
    let mut letters = title.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

pub const TRAVERSAL: Study = Study {
    name: "traversal",
    title: "How rays find their way through a kd-tree",
    claim: "Thesis, section 5.6.1: a short stack is about twice as fast as restarts; ropes take over 3 times the memory for fewer steps, perhaps more \
            accesses to memory.",
    run: traversal,
};

fn traversal(lab: &mut Lab) -> Result<Findings> {
    let mut variants = vec![
        Variant::new("stack", with(Accel::Kd)),
        Variant::new("restart", TraceOptions { traversal: Traversal::Restart, ..with(Accel::Kd) }),
        Variant::new("push-down", TraceOptions { traversal: Traversal::PushDown, ..with(Accel::Kd) }),
    ];
    let sizes: &[u32] = if lab.quick { &[4] } else { &[1, 2, 4, 8, 16] };
    variants.extend(sizes.iter().map(|&size| {
        let options = TraceOptions { traversal: Traversal::ShortStack, stack_size: Some(size), ..with(Accel::Kd) };
        Variant::new(format!("short stack of {size}"), options).with("stack_size", size)
    }));
    variants.push(Variant::new("ropes", TraceOptions { traversal: Traversal::Ropes, ..with(Accel::Kd) }));
    if !lab.quick {
        let thesis = TraceOptions { traversal: Traversal::ThesisRestart, ..with(Accel::Kd) };
        variants.push(Variant::new("restart as the thesis prints it", thesis));
    }
    let subjects = lab.usual_subjects()?;
    let kinds: &[usize] = if lab.quick { &[CAMERA] } else { &ALL_KINDS };
    let rows = lab.compare_all(&subjects, &variants, kinds)?;
    let value = |method: &str, column: &str, scene: &str| {
        mean(&rows, column, |row| name(row, "method").starts_with(method) && name(row, "scene") == scene)
    };
    let mut sentences = Vec::new();
    let mut holds = true;
    for scene in scenes_of(&rows) {
        let ratio = |a: &str, b: &str, column: &str| Some(value(a, column, &scene)? / value(b, column, &scene)?);
        let Some(short) = ratio("short stack", "restart", "mrays_per_s") else { continue };
        let (memory, steps) = (ratio("ropes", "stack", "device_bytes"), ratio("ropes", "stack", "steps"));
        let (Some(memory), Some(steps)) = (memory, steps) else { continue };
        holds &= (1.6..2.5).contains(&short) && memory > 3.0 && steps < 1.0;
        sentences.push(format!(
            "{scene}: short stacks have {short:.2} times the speed of restarts; ropes take {memory:.2} times the memory and {steps:.2} of the steps of a full stack"
        ));
    }
    let holds = (!sentences.is_empty()).then_some(holds);
    bars_of(rows, holds, &sentences, "Speed by traversal", "kd-tree by surface areas, exact hits")
}

pub const BOUNDING_VOLUMES: Study = Study {
    name: "bounding-volumes",
    title: "Bounding volumes",
    claim: "Thesis, section 2.2.2: bounding volumes make tracing over 10 times as fast, and the sphere is the cheapest to test.",
    run: bounding_volumes,
};

fn bounding_volumes(lab: &mut Lab) -> Result<Findings> {
    let levels = if lab.quick { 3 } else { 4 };
    let subjects = lab.subjects(&[
        ("boulder", &|| scenes::boulder(levels)),
        ("cubes", &|| scenes::cubes(if levels == 3 { 20 } else { 160 })),
    ])?;
    let fit: Vec<_> = subjects.into_iter().filter(|subject| subject.triangle_count <= MOST_FOR_LISTS).collect();
    let structures = [Accel::Brute, Accel::Spheres, Accel::Boxes, Accel::Octree, Accel::Grid, Accel::Bvh2];
    let variants: Vec<_> = structures
        .iter()
        .filter(|accel| !lab.quick || !matches!(accel, Accel::Octree | Accel::Grid))
        .map(|&accel| Variant::new(accel.name(), TraceOptions { intersector: Intersector::Watertight, ..with(accel) }))
        .collect();
    let rows = lab.compare_all(&fit, &variants, &[CAMERA])?;
    let mut sentences = Vec::new();
    let mut holds = true;
    for scene in scenes_of(&rows) {
        let speed = |accel: Accel| {
            mean(&rows, "mrays_per_s", |row| name(row, "method") == accel.name() && name(row, "scene") == scene)
        };
        let (Some(brute), Some(spheres), Some(boxes)) =
            (speed(Accel::Brute), speed(Accel::Spheres), speed(Accel::Boxes))
        else {
            continue;
        };
        holds &= spheres / brute > 10.0 && spheres > boxes;
        sentences.push(format!(
            "{scene}: spheres have {:.1} times and boxes {:.1} times the speed of brute force",
            spheres / brute,
            boxes / brute
        ));
    }
    if sentences.is_empty() {
        sentences.push(format!(
            "lists of volumes are measured in scenes of up to {MOST_FOR_LISTS} triangles, and there is none"
        ));
    }
    let holds = (!rows.is_empty()).then_some(holds);
    bars_of(
        rows,
        holds,
        &sentences,
        "Speed by bounding volume",
        "Camera rays, watertight test, lists of clusters and trees of boxes",
    )
}
