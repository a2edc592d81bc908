//! Where on the device things lie, and in which order.

use super::super::table::{Row, name};
use super::super::{ChartKind, Findings, Lab, Study, Table, Variant};
use super::{ALL_KINDS, CAMERA, SPREAD, by_scene, error_note, mean, with};
use crate::error::Result;
use crate::options::{Accel, Layout, Memory, NodeOrder, TraceOptions, TriangleOrder};

pub const MEMORY_KIND: Study = Study {
    name: "memory-kind",
    title: "Kinds of memory",
    claim: "Thesis, sections 5.7 and 6.2.2: textures over global memory and constant memory are worth the trouble, because GPUs cache them.",
    run: memory_kind,
};

fn memory_kind(lab: &mut Lab) -> Result<Findings> {
    let mut left_out = Vec::new();
    let mut variants = Vec::new();
    for &memory in Memory::ALL {
        let has_images = lab.device.is_none_or(|device| device.info.images);
        if matches!(memory, Memory::BufferImage | Memory::Image2d) && !has_images {
            left_out.push(memory.name());
            continue;
        }
        variants.push(
            Variant::new(memory.name(), TraceOptions { memory, ..with(Accel::Kd) }).with("memory", memory.name()),
        );
    }
    let subjects = lab.usual_subjects()?;
    let kinds: &[usize] = if lab.quick { &[CAMERA] } else { &ALL_KINDS };
    let rows = lab.compare_all(&subjects, &variants, kinds)?;
    let ratio = |memory: Memory| {
        let speed = |memory: Memory| mean(&rows, "mrays_per_s", |row| name(row, "method") == memory.name());
        Some(speed(memory)? / speed(Memory::Global)?)
    };
    let ratios: Vec<_> = Memory::ALL
        .iter()
        .filter(|&&memory| memory != Memory::Global)
        .filter_map(|&memory| Some((memory.name(), ratio(memory)?)))
        .collect();
    let holds = (!ratios.is_empty()).then(|| ratios.iter().any(|(_, ratio)| *ratio > 1.05));
    let mut parts: Vec<_> = ratios.iter().map(|(memory, ratio)| format!("{memory} has {ratio:.2} times")).collect();
    if parts.is_empty() {
        parts.push("nothing was measured against".to_owned());
    }
    let mut notes = Vec::new();
    if lab.device.is_none() {
        notes.push("The reference has one kind of memory: all of these are the same there.".to_owned());
    }
    if !left_out.is_empty() {
        notes.push(format!("The device has no images; left out: {}.", left_out.join(", ")));
    }
    Ok(bars(
        rows,
        holds,
        format!("{} the speed of plain global memory.", parts.join(", ")),
        notes,
        "Speed by kind of memory",
    ))
}

pub const LAYOUT: Study = Study {
    name: "layout",
    title: "Layout of triangles and nodes",
    claim: "Thesis, section 5.7.1: vertices apart from shading data are \"surely better\" (not measured there); section 5.7.2: nodes in pre-order.",
    run: layout,
};

fn layout(lab: &mut Lab) -> Result<Findings> {
    let base = with(Accel::Kd);
    let mut variants = vec![
        Variant::new("split, pre-order", base),
        Variant::new("whole triangles", TraceOptions { layout: Layout::Whole, ..base }),
    ];
    if !lab.quick {
        variants.extend([
            Variant::new("breadth-first nodes", TraceOptions { node_order: NodeOrder::BreadthFirst, ..base }),
            Variant::new("van Emde Boas nodes", TraceOptions { node_order: NodeOrder::VanEmdeBoas, ..base }),
            Variant::new("triangles in leaf order", TraceOptions { triangles: TriangleOrder::LeafOrder, ..base }),
        ]);
    }
    let subjects = lab.usual_subjects()?;
    let kinds: &[usize] = if lab.quick { &[CAMERA] } else { &ALL_KINDS };
    let rows = lab.compare_all(&subjects, &variants, kinds)?;
    let speed = |method: &str| mean(&rows, "mrays_per_s", |row| name(row, "method") == method);
    let ratios: Vec<_> = variants
        .iter()
        .skip(1)
        .filter_map(|variant| Some((variant.label.clone(), speed(&variant.label)? / speed("split, pre-order")?)))
        .collect();
    let holds = ratios.first().map(|(_, ratio)| *ratio < 1.0);
    let parts: Vec<_> = ratios.iter().map(|(method, ratio)| format!("{method}: {ratio:.2}")).collect();
    let verdict = format!(
        "Relative to vertices apart from shading data and nodes in pre-order, over all scenes and rays: {}.",
        parts.join(", ")
    );
    Ok(bars(rows, holds, verdict, Vec::new(), "Speed by layout"))
}

/// Findings with a chart of speeds for each scene.
fn bars(rows: Vec<Row>, holds: Option<bool>, verdict: String, notes: Vec<String>, title: &str) -> Findings {
    let note = error_note(&rows);
    let table = Table::new("rays", format!("{title}: all measurements"), rows);
    let charts = by_scene(ChartKind::Bars, &table, "speed", title, ["method", "mrays_per_s"], |chart| {
        let caption = format!("kd-tree by surface areas, full stack, exact hits. {note}");
        chart.by("rays_of").spread(SPREAD).caption(caption)
    });
    Findings { holds, verdict, notes, tables: vec![table], charts }
}
