//! What the device is, what each kernel takes of it, and how full it gets.
//!
//! Occupancy is the part of the warps that a multiprocessor can hold which fit there at a time. Of NVIDIA's GPUs it
//! follows from a kernel's registers, which the compiler tells, and the limits of the generation: NVIDIA, "CUDA C++
//! Programming Guide", table "Technical Specifications per Compute Capability". Other drivers tell no registers.

use super::super::outcome::Outcome;
use super::super::table::{Row, known, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table};
use super::pareto::fast_options;
use super::pictures::picture_scenes;
use super::{Verdict, with};
use raybrook::Result;
use raybrook::low_level::device::{DeviceInfo, KernelResources, Looked, kernel_resources};
use raybrook::low_level::options::{Kernels, PictureOptions, StructureKind, TraceOptions};
use serde_json::{Value, json};

pub const STUDY: Study = Study {
    name: "occupancy",
    title: "The device, and how full kernels leave it",
    claim: "Thesis, table 5.2 and section 5.8.1: the figures of the author's GPU; the kernel takes 42 registers, so \
            that only 25 % of the warps that a multiprocessor can hold fit there. The claim tested: the kernels that \
            trace and render have an occupancy of 25 % or more.",
    own_shapes: None,
    source: include_str!("device.rs"),
    measure,
    judge,
};

/// The thesis's occupancy.
const CLAIMED: f64 = 0.25;
/// Chains of rays in pictures.
const DEPTH: u32 = 8;
/// The kernels that do nearly all of the work.
const MAIN: [&str; 4] = ["trace", "trace_packets", "render", "render_packets"];

fn measure(lab: &mut Lab) -> Result<Vec<Table>> {
    let Some(device) = lab.device else { return Ok(vec![device_table(&[]), kernel_table(Vec::new())]) };
    let (_, scene) = picture_scenes(lab)?.swap_remove(0);
    let fast = fast_options(lab);
    let bvh2 = with(StructureKind::Bvh2);
    let wavefront = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..bvh2.picture }, ..bvh2 };
    let mut options = vec![("kd", with(StructureKind::Kd)), ("bvh2", bvh2), ("bvh2, wavefront kernels", wavefront)];
    if fast != bvh2 {
        options.push(("bvh8 in packets", fast));
    }
    let mut rows: Vec<Row> = Vec::new();
    for (label, options) in options {
        (lab.progress)(&format!("registers: {label}"));
        let buffers = lab.pack(&scene, &options)?;
        let programs = kernel_resources(device, &buffers, &options, DEPTH, Looked::FirstPass)?;
        let kernels = programs.iter().flat_map(|program| &program.kernels);
        rows.extend(kernels.map(|kernel| kernel_row(label, kernel, &device.info)));
    }
    Ok(vec![device_table(&figures(&device.info)), kernel_table(rows)])
}

fn device_table(figures: &[(&str, Value)]) -> Table {
    let rows = figures.iter().map(|(figure, value)| row([("figure", json!(figure)), ("value", value.clone())]));
    Table::new("device", "The device", rows.collect())
}

fn kernel_table(rows: Vec<Row>) -> Table {
    Table::new("kernels", "What each kernel takes, as far as the driver tells", rows)
}

/// What the device says of itself; what it does not tell is left out.
fn figures(info: &DeviceInfo) -> Vec<(&'static str, Value)> {
    let [major, minor] = info.compute_capability;
    let mib = |bytes: u64| json!(format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)));
    let kib = |bytes: u64| json!(format!("{:.0} KiB", bytes as f64 / 1024.0));
    let all = [
        ("kind", json!(info.kind.name()), true),
        ("compute units", json!(info.compute_units), info.compute_units > 0),
        ("highest clock (MHz)", json!(info.clock_mhz), info.clock_mhz > 0),
        ("memory", mib(info.global_memory_bytes), info.global_memory_bytes > 0),
        ("largest buffer", mib(info.max_alloc_bytes), info.max_alloc_bytes > 0),
        ("constant memory", kib(info.constant_memory_bytes), info.constant_memory_bytes > 0),
        ("local memory of a work-group", kib(info.local_memory_bytes), info.local_memory_bytes > 0),
        ("largest work-group", json!(info.max_work_group_size), info.max_work_group_size > 0),
        ("compute capability", json!(format!("{major}.{minor}")), major > 0),
        ("registers of a compute unit", json!(info.registers), info.registers > 0),
        ("warps that a compute unit holds", json!(most_warps(info)), major > 0),
    ];
    all.into_iter().filter(|(.., is_told)| *is_told).map(|(figure, value, _)| (figure, value)).collect()
}

/// A row of what a kernel takes.
pub(super) fn kernel_row(label: &str, kernel: &KernelResources, info: &DeviceInfo) -> Row {
    let mut out = row([("method", json!(label)), ("kernels", json!(kernel.kernel))]);
    out.extend(known([
        ("registers", kernel.registers),
        ("spilled_bytes", kernel.spill_store_bytes),
        ("frame_bytes", kernel.stack_frame_bytes),
        ("private_bytes", kernel.private_memory_bytes),
        ("local_bytes", kernel.local_memory_bytes),
        ("work_group", kernel.max_work_group_size),
    ]));
    let occupancy = kernel.registers.and_then(|registers| occupancy(registers, info));
    out.extend(occupancy.map(|occupancy| ("occupancy".to_owned(), json!(occupancy))));
    out
}

/// Work-items of a warp.
const WARP: u64 = 32;
/// Registers are given to warps in pieces of so many.
const PIECE: u64 = 256;

/// Warps that a multiprocessor of this generation holds at most.
fn most_warps(info: &DeviceInfo) -> u64 {
    match info.compute_capability {
        [7, 5] => 32,
        [8, 6 | 7 | 9] | [12, _] => 48,
        _ => 64,
    }
}

/// The part of a multiprocessor's warps that fit there with so many registers a work-item; `None` where the device does
/// not tell how many it has.
fn occupancy(registers: u64, info: &DeviceInfo) -> Option<f64> {
    let of_warp = (registers.max(1) * WARP).next_multiple_of(PIECE);
    let most = most_warps(info);
    let fit = (u64::from(info.registers) / of_warp).min(most);
    (info.registers > 0 && info.compute_capability[0] > 0).then(|| fit as f64 / most as f64)
}

fn judge(found: &Measured) -> Result<Findings> {
    let device = found.table("device", &["figure"])?;
    let kernels = found.table("kernels", &["method", "kernels"])?;
    let mut verdict = Verdict::default();
    let main = kernels.rows.iter().filter(|row| MAIN.contains(&name(row, "kernels").as_str()));
    for row in main {
        let Some(occupancy) = number(row, "occupancy") else { continue };
        let (kernel, method, registers) = (name(row, "kernels"), name(row, "method"), name(row, "registers"));
        let part =
            format!("{kernel} of {method} takes {registers} registers, {:.0} % of the warps fit", 100.0 * occupancy);
        verdict.outcomes.push(Outcome::of(occupancy >= CLAIMED));
        verdict.add(part);
    }
    if verdict.outcomes.is_empty() {
        verdict.leave_open("the driver tells no registers, from which occupancy follows".to_owned());
    }
    let charts = [
        ("occupancy", "Occupancy by kernel", "What of the warps of a compute unit fits there at a time."),
        ("private_bytes", "Private memory by kernel", "Of a work-item, as far as the driver tells."),
    ];
    let is_told = |column: &str| kernels.rows.iter().any(|row| row.contains_key(column));
    let charts = charts.into_iter().filter(|(column, ..)| is_told(column)).map(|(column, title, caption)| {
        let file = column.replace('_', "-");
        Chart::new(ChartKind::Bars, &kernels, &file, title, ["kernels", column]).by("method").caption(caption)
    });
    let charts = charts.collect();
    Ok(verdict.findings(vec![device, kernels], charts))
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{self, header};
    use super::*;

    fn judged(occupancy: Option<f64>) -> Findings {
        let mut render = row([("method", json!("bvh2")), ("kernels", json!("render")), ("registers", json!(56))]);
        render.extend(occupancy.map(|part| ("occupancy".to_owned(), json!(part))));
        let other = row([("method", json!("bvh2")), ("kernels", json!("clear")), ("occupancy", json!(0.1))]);
        let tables = vec![device_table(&[]), kernel_table(vec![render, other])];
        rows_of::judge(&STUDY, tables, &header(false)).unwrap()
    }

    #[test]
    fn the_kernels_that_trace_must_leave_room() {
        let holds = judged(Some(0.5));
        assert_eq!(holds.outcome, Outcome::Holds);
        assert_eq!(holds.verdict, "render of bvh2 takes 56 registers, 50 % of the warps fit.");
        assert_eq!(judged(Some(0.2)).outcome, Outcome::Fails);
        assert_eq!(judged(None).outcome, Outcome::Undecided);
    }
}
