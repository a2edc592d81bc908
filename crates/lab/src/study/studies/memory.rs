//! Where on the device things lie, and in which order.

use super::super::lookup::Clock;
use super::super::outcome::{Outcome, Rounds};
use super::super::table::{name, values};
use super::super::{ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{BATCH, SPREAD, Verdict, by_scene, error_note, usual_rays, with};
use raybrook::Result;
use raybrook::low_level::options::{
    ArrayOptions, KdOptions, Layout, Memory, NodeOrder, Structure, StructureKind, TraceOptions, TriangleOrder,
};

const MEMORY_TITLE: &str = "Speed by kind of memory";
const LAYOUT_TITLE: &str = "Speed by layout";

pub const MEMORY_KIND: Study = Study {
    name: "memory-kind",
    title: "Kinds of memory",
    claim: "Thesis, sections 5.7 and 6.2.2: textures over global memory and constant memory are worth the trouble, \
            because GPUs cache them.",
    own_shapes: None,
    source: include_str!("memory.rs"),
    measure: memory_kind,
    judge: judge_memory_kind,
};

fn memory_kind(lab: &mut Lab) -> Result<Vec<Table>> {
    let has_images = lab.device.is_none_or(|device| device.info.images);
    let can_be = |memory: Memory| has_images || !is_image(memory);
    let variants: Vec<_> = Memory::ALL
        .iter()
        .filter(|&&memory| can_be(memory))
        .map(|&memory| {
            Variant::new(
                memory.name(),
                TraceOptions {
                    arrays: ArrayOptions { memory, ..with(StructureKind::Kd).arrays },
                    ..with(StructureKind::Kd)
                },
            )
            .with("memory", memory.name())
        })
        .collect();
    usual_rays(lab, &variants, MEMORY_TITLE)
}

fn is_image(memory: Memory) -> bool {
    matches!(memory, Memory::BufferImage | Memory::Image2d)
}

fn judge_memory_kind(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let has = |memory: &Memory| table.rows.iter().any(|row| name(row, "method") == memory.name());
    let others = || Memory::ALL.iter().filter(|&&memory| memory != Memory::Global);
    let mut verdict = Verdict::default();
    for memory in others().filter(|memory| has(memory)) {
        match over_all(&table, memory.name(), Memory::Global.name())? {
            Some(ratio) => {
                verdict.say(ratio.above(1.0), format!("{memory} has {ratio} times the speed of plain global memory"))
            }
            None => verdict.not_measured(memory.name()),
        }
    }
    let mut notes = Vec::new();
    if found.header.is_reference() {
        notes.push("The reference has one kind of memory: all of these are the same there.".to_owned());
    }
    let left_out: Vec<_> = others().filter(|&&memory| is_image(memory)).filter(|memory| !has(memory)).collect();
    if !left_out.is_empty() && !table.rows.is_empty() {
        let names: Vec<_> = left_out.iter().map(|memory| memory.name()).collect();
        notes.push(format!("The device has no images; left out: {}.", names.join(", ")));
    }
    // One kind that is worth it is enough.
    let outcome = verdict.any();
    Ok(bars(table, outcome, verdict.text(), notes, MEMORY_TITLE).on(found.header))
}

/// How many times the speed of method `b` method `a` has, over all scenes and rays.
fn over_all(table: &Table, a: &str, b: &str) -> Result<Option<Rounds>> {
    table.speedup(Clock::Ray, &[("method", a)], &[("method", b)], &["scene", "rays_of"])
}

pub const LAYOUT: Study = Study {
    name: "layout",
    title: "Layout of triangles and nodes",
    claim: "Thesis, section 5.7.1: vertices apart from shading data are \"surely better\" (not measured there); \
            section 5.7.2: nodes in pre-order.",
    own_shapes: None,
    source: include_str!("memory.rs"),
    measure: layout,
    judge: judge_layout,
};

/// Vertices apart from shading data, nodes in pre-order.
const PLAIN: &str = "split, pre-order";
/// As the thesis has not measured it.
const WHOLE: &str = "whole triangles";

fn layout(lab: &mut Lab) -> Result<Vec<Table>> {
    let base = with(StructureKind::Kd);
    let mut variants = vec![
        Variant::new(PLAIN, base),
        Variant::new(WHOLE, TraceOptions { arrays: ArrayOptions { layout: Layout::Whole, ..base.arrays }, ..base }),
    ];
    if !lab.quick {
        variants.extend([
            Variant::new(
                "breadth-first nodes",
                TraceOptions {
                    structure: Structure::Kd(KdOptions { node_order: NodeOrder::BreadthFirst, ..base.kd() }),
                    ..base
                },
            ),
            Variant::new(
                "van Emde Boas nodes",
                TraceOptions {
                    structure: Structure::Kd(KdOptions { node_order: NodeOrder::VanEmdeBoas, ..base.kd() }),
                    ..base
                },
            ),
            Variant::new(
                "triangles in leaf order",
                TraceOptions { arrays: ArrayOptions { triangles: TriangleOrder::LeafOrder, ..base.arrays }, ..base },
            ),
        ]);
    }
    usual_rays(lab, &variants, LAYOUT_TITLE)
}

fn judge_layout(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let mut verdict = Verdict::default();
    for method in values(&table.rows, "method").iter().filter(|method| *method != PLAIN) {
        match over_all(&table, method, PLAIN)? {
            Some(ratio) if method == WHOLE => verdict.say(ratio.below(1.0), format!("{method}: {ratio}")),
            Some(ratio) => verdict.add(format!("{method}: {ratio}")),
            None => verdict.not_measured(method),
        }
    }
    if table.rows.iter().all(|row| name(row, "method") != WHOLE) {
        verdict.not_measured(WHOLE);
    }
    let text = format!(
        "Speed relative to that of vertices apart from shading data and nodes in pre-order, over all scenes and rays: \
         {}",
        verdict.text()
    );
    Ok(bars(table, verdict.all(), text, Vec::new(), LAYOUT_TITLE))
}

/// Findings with a chart of speeds for each scene.
fn bars(table: Table, outcome: Outcome, verdict: String, notes: Vec<String>, title: &str) -> Findings {
    let note = error_note(&table.rows);
    let charts = by_scene(ChartKind::Bars, &table, "speed", title, ["method", "mrays_per_s"], |chart| {
        let caption = format!("kd-tree by surface areas, full stack, exact hits. {note}");
        chart.by("rays_of").spread(SPREAD).caption(caption)
    });
    Findings { outcome, verdict, notes, tables: vec![table], charts }
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, of_reference, rays};
    use super::*;

    #[test]
    fn a_kind_of_memory_is_worth_it_where_it_is_faster_than_global() {
        let rows = |constant: f64| rays(&[("s", "global", 10.0), ("s", "constant", constant), ("s", "image2d", 9.0)]);
        let better = judge(&MEMORY_KIND, rows(12.0), &header(false)).unwrap();
        assert_eq!(better.outcome, Outcome::Holds, "{}", better.verdict);
        let words = "constant has 1.20 [1.20, 1.20] times the speed of plain global memory; image2d has 0.90";
        assert!(better.verdict.starts_with(words), "{}", better.verdict);
        assert_eq!(judge(&MEMORY_KIND, rows(8.0), &header(false)).unwrap().outcome, Outcome::Fails);
        // As published: a difference that is smaller than the spread said that it holds.
        let close = judge(&MEMORY_KIND, rows(10.0), &header(false)).unwrap();
        assert_eq!((close.outcome, close.judgement()), (Outcome::Undecided, "Not decided here: "), "{}", close.verdict);
        assert!(close.verdict.contains("memory (not decided at this spread)"), "{}", close.verdict);
        assert_eq!(judge(&MEMORY_KIND, rows(12.0), &of_reference()).unwrap().outcome, Outcome::Undecided);
        // A scene that one side lacks would shift its mean.
        let lacking = rays(&[("s", "global", 10.0), ("s", "constant", 8.0), ("t", "constant", 1000.0)]);
        let message = judge(&MEMORY_KIND, lacking, &header(false)).unwrap_err().to_string();
        assert!(message.contains("scene 't'"), "{message}");
        assert_eq!(judge(&MEMORY_KIND, rays(&[]), &header(false)).unwrap().outcome, Outcome::Undecided);
    }

    #[test]
    fn the_verdict_on_layouts_is_that_of_whole_triangles() {
        let rows = |whole: f64| rays(&[("s", PLAIN, 10.0), ("s", WHOLE, whole), ("s", "breadth-first nodes", 7.0)]);
        assert_eq!(judge(&LAYOUT, rows(9.0), &header(false)).unwrap().outcome, Outcome::Holds);
        assert_eq!(judge(&LAYOUT, rows(11.0), &header(false)).unwrap().outcome, Outcome::Fails);
        assert_eq!(judge(&LAYOUT, rows(10.0), &header(false)).unwrap().outcome, Outcome::Undecided);
        // Not that of whatever comes first.
        let lacking = rays(&[("s", PLAIN, 10.0), ("s", "breadth-first nodes", 7.0)]);
        assert_eq!(judge(&LAYOUT, lacking, &header(false)).unwrap().outcome, Outcome::Undecided);
        let twice = rays(&[("s", PLAIN, 10.0), ("s", WHOLE, 9.0), ("s", WHOLE, 90.0)]);
        assert!(judge(&LAYOUT, twice, &header(false)).unwrap_err().to_string().contains("twice"));
    }
}
