//! Where on the device things lie, and in which order.

use super::super::table::{name, values};
use super::super::{ChartKind, Findings, Lab, Measured, Study, Table, Variant};
use super::{BATCH, SPREAD, by_scene, error_note, usual_rays, with};
use raybrook::Result;
use raybrook::low_level::options::{
    ArrayOptions, KdOptions, Layout, Memory, NodeOrder, Structure, StructureKind, TraceOptions, TriangleOrder,
};

const MEMORY_TITLE: &str = "Speed by kind of memory";
const LAYOUT_TITLE: &str = "Speed by layout";

pub const MEMORY_KIND: Study = Study {
    name: "memory-kind",
    title: "Kinds of memory",
    claim: "Thesis, sections 5.7 and 6.2.2: textures over global memory and constant memory are worth the trouble, because GPUs cache them.",
    own_shapes: None,
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
    let mut ratios = Vec::new();
    for memory in others().filter(|memory| has(memory)) {
        ratios.push((memory.name(), over_all(&table, memory.name(), Memory::Global.name())?));
    }
    let told = |(memory, ratio): &(&str, Option<f64>)| match ratio {
        Some(ratio) => format!("{memory} has {ratio:.2} times"),
        None => format!("{memory} was not measured against"),
    };
    let mut parts: Vec<_> = ratios.iter().map(told).collect();
    if parts.is_empty() {
        parts.push("nothing was measured against".to_owned());
    }
    let known: Vec<f64> = ratios.iter().filter_map(|(_, ratio)| *ratio).collect();
    let is_worth_it = known.iter().any(|ratio| *ratio > 1.05);
    let mut notes = Vec::new();
    if found.header.is_reference() {
        notes.push("The reference has one kind of memory: all of these are the same there.".to_owned());
    }
    let left_out: Vec<_> = others().filter(|&&memory| is_image(memory)).filter(|memory| !has(memory)).collect();
    if !left_out.is_empty() && !table.rows.is_empty() {
        let names: Vec<_> = left_out.iter().map(|memory| memory.name()).collect();
        notes.push(format!("The device has no images; left out: {}.", names.join(", ")));
    }
    let holds = (is_worth_it || !known.is_empty() && known.len() == ratios.len()).then_some(is_worth_it);
    let verdict = format!("{} the speed of plain global memory.", parts.join(", "));
    Ok(bars(table, holds, verdict, notes, MEMORY_TITLE).on(found.header))
}

/// How many times the speed of method `b` method `a` has, over all scenes and rays.
fn over_all(table: &Table, a: &str, b: &str) -> Result<Option<f64>> {
    table.ratio("mrays_per_s", &[("method", a)], &[("method", b)], &["scene", "rays_of"])
}

pub const LAYOUT: Study = Study {
    name: "layout",
    title: "Layout of triangles and nodes",
    claim: "Thesis, section 5.7.1: vertices apart from shading data are \"surely better\" (not measured there); section 5.7.2: nodes in pre-order.",
    own_shapes: None,
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
    let mut parts = Vec::new();
    for method in values(&table.rows, "method").iter().filter(|method| *method != PLAIN) {
        parts.push(match over_all(&table, method, PLAIN)? {
            Some(ratio) => format!("{method}: {ratio:.2}"),
            None => format!("{method}: not measured"),
        });
    }
    let verdict = format!(
        "Relative to vertices apart from shading data and nodes in pre-order, over all scenes and rays: {}.",
        parts.join(", ")
    );
    let holds = over_all(&table, WHOLE, PLAIN)?.map(|ratio| ratio < 1.0);
    Ok(bars(table, holds, verdict, Vec::new(), LAYOUT_TITLE))
}

/// Findings with a chart of speeds for each scene.
fn bars(table: Table, holds: Option<bool>, verdict: String, notes: Vec<String>, title: &str) -> Findings {
    let note = error_note(&table.rows);
    let charts = by_scene(ChartKind::Bars, &table, "speed", title, ["method", "mrays_per_s"], |chart| {
        let caption = format!("kd-tree by surface areas, full stack, exact hits. {note}");
        chart.by("rays_of").spread(SPREAD).caption(caption)
    });
    Findings { holds, verdict, notes, tables: vec![table], charts }
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, of_reference, rays};
    use super::*;

    #[test]
    fn a_kind_of_memory_is_worth_it_where_it_is_faster_than_global() {
        let rows = |constant: f64| rays(&[("s", "global", 10.0), ("s", "constant", constant), ("s", "image2d", 9.0)]);
        let better = judge(&MEMORY_KIND, rows(12.0), &header(false)).unwrap();
        assert_eq!(better.holds, Some(true), "{}", better.verdict);
        assert!(better.verdict.starts_with("constant has 1.20 times, image2d has 0.90 times"), "{}", better.verdict);
        assert_eq!(judge(&MEMORY_KIND, rows(8.0), &header(false)).unwrap().holds, Some(false));
        assert_eq!(judge(&MEMORY_KIND, rows(12.0), &of_reference()).unwrap().holds, None);
        // A scene that one side lacks would shift its mean.
        let lacking = rays(&[("s", "global", 10.0), ("s", "constant", 8.0), ("t", "constant", 1000.0)]);
        let lacking = judge(&MEMORY_KIND, lacking, &header(false)).unwrap();
        assert_eq!((lacking.holds, lacking.verdict.contains("not measured")), (None, true), "{}", lacking.verdict);
    }

    #[test]
    fn the_verdict_on_layouts_is_that_of_whole_triangles() {
        let rows = |whole: f64| rays(&[("s", PLAIN, 10.0), ("s", WHOLE, whole), ("s", "breadth-first nodes", 7.0)]);
        assert_eq!(judge(&LAYOUT, rows(9.0), &header(false)).unwrap().holds, Some(true));
        assert_eq!(judge(&LAYOUT, rows(11.0), &header(false)).unwrap().holds, Some(false));
        // Not that of whatever comes first.
        let lacking = rays(&[("s", PLAIN, 10.0), ("s", "breadth-first nodes", 7.0)]);
        assert_eq!(judge(&LAYOUT, lacking, &header(false)).unwrap().holds, None);
        let twice = rays(&[("s", PLAIN, 10.0), ("s", WHOLE, 9.0), ("s", WHOLE, 90.0)]);
        assert!(judge(&LAYOUT, twice, &header(false)).unwrap_err().to_string().contains("twice"));
    }
}
