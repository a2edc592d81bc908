//! Whole pictures: samples and depth, one kernel or several, textures.

use super::super::lab::PictureVariant;
use super::super::table::{Row, known, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Table, scenes};
use super::{by_scene, mean, scenes_of, with};
use crate::device::kernel_resources;
use crate::error::Result;
use crate::options::{Accel, Kernels, TexturePass, TraceOptions};
use crate::scene::Scene;
use serde_json::json;

/// Seconds of a picture's slowest and fastest pass.
const SPREAD: [&str; 2] = ["seconds_low", "seconds_high"];

/// The user's scenes, or a still life.
fn picture_scenes(lab: &Lab) -> Result<Vec<(String, Scene)>> {
    if lab.scenes.is_empty() {
        let detail = if lab.quick { 24 } else { 96 };
        return Ok(vec![("still life".to_owned(), scenes::still_life(detail, false)?)]);
    }
    Ok(lab.scenes.to_vec())
}

/// Speed against error of whole pictures: a table and a chart for each scene.
pub(super) fn tradeoff(lab: &mut Lab) -> Result<(Table, Vec<Chart>)> {
    let (samples, depths, converged): (&[u32], &[u32], u32) =
        if lab.quick { (&[1, 4], &[2], 16) } else { (&[1, 2, 4, 8, 16, 32, 64], &[1, 2, 4], 256) };
    let options = super::pareto::fast_options(lab);
    let most_depth = 8;
    let mut variants: Vec<_> = samples
        .iter()
        .map(|&samples| {
            PictureVariant::new(
                format!("{samples} sample{}", if samples == 1 { "" } else { "s" }),
                options,
                samples,
                most_depth,
            )
        })
        .collect();
    let many = if lab.quick { 1 } else { 16 };
    variants.extend(depths.iter().map(|&depth| {
        let label = format!("{many} sample{}, depth {depth}", if many == 1 { "" } else { "s" });
        PictureVariant::new(label, options, many, depth)
    }));
    let errors: &[f32] = if lab.quick { &[4.0] } else { &[4.0, 2.0, 1.0, 0.5] };
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, most_depth)));
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, Some((converged, most_depth)))?);
    }
    let table = Table::new("pictures", "Whole pictures: time against error", rows);
    let charts = by_scene(
        ChartKind::Front,
        &table,
        "pictures",
        "pictures a second against error",
        ["flip", "frames_per_s"],
        |chart| {
            chart.log(true, true).caption(format!(
                "Exact hits. FLIP to a picture of {converged} samples a pixel and chains of {most_depth} rays; \"error E\" asks for so many 8-bit steps, and \
                 the host's decisions count. Left and high is better."
            ))
        },
    );
    Ok((table, charts))
}

pub const KERNELS: Study = Study {
    name: "kernels",
    title: "One kernel or several",
    claim: "Thesis, section 5.2.1: one mega-kernel needs many registers, several kernels need traffic between them; the thesis takes the one. The claim \
            tested: the mega-kernel is the faster one.",
    run: kernels,
};

fn kernels(lab: &mut Lab) -> Result<Findings> {
    let base = with(Accel::Bvh2);
    let split = TraceOptions { kernels: Kernels::Split, ..base };
    let mut variants = vec![
        PictureVariant::new("mega", base, 1, 8).with("kernels", "mega"),
        PictureVariant::new("split", split, 1, 8).with("kernels", "split"),
    ];
    if !lab.quick {
        for paths in [1 << 12, 1 << 16] {
            let options = TraceOptions { paths_in_flight: Some(paths), ..split };
            variants.push(
                PictureVariant::new(format!("split, {paths} paths at a time"), options, 1, 8).with("kernels", "split"),
            );
        }
    }
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, None)?);
    }
    let (parts, ratios) = ratios(&rows, "mega", "split", "the split kernels take", "of the mega-kernel");
    let resources = resources(lab, &variants[..2])?;
    let mut notes = Vec::new();
    if lab.device.is_none() {
        notes.push("The reference does the work of either in one way.".to_owned());
    }
    let table = Table::new("pictures", "Pictures by kernels", rows);
    let charts = charts(&table, "seconds by kernels");
    Ok(Findings {
        holds: (!ratios.is_empty()).then(|| ratios.iter().all(|ratio| *ratio > 1.0)),
        verdict: parts.join("; ") + ".",
        notes,
        tables: vec![
            table,
            Table::new("resources", "What each kernel takes of the device, as far as the driver tells", resources),
        ],
        charts,
    })
}

/// What the kernels for pictures take. Where decisions are left to a second pass, its kernels have the same names; the first ones do nearly
/// all of the work.
fn resources(lab: &Lab, variants: &[PictureVariant]) -> Result<Vec<Row>> {
    let Some(device) = lab.device else { return Ok(Vec::new()) };
    let mut rows: Vec<Row> = Vec::new();
    let (_, scene) = picture_scenes(lab)?.swap_remove(0);
    for variant in variants {
        (lab.progress)(&format!("registers: {}", variant.label));
        let buffers = lab.pack(&scene, &variant.options)?;
        let programs = kernel_resources(device, &buffers, &variant.options, variant.depth)?;
        for kernel in programs.into_iter().flat_map(|program| program.kernels) {
            let is_known = rows.iter().any(|row| name(row, "kernels") == kernel.kernel);
            if kernel.kernel.starts_with("trace") || is_known {
                continue;
            }
            let mut out = row([("method", json!(variant.label)), ("kernels", json!(kernel.kernel))]);
            out.extend(known([
                ("registers", kernel.registers),
                ("private_bytes", kernel.private_memory_bytes),
                ("work_group", kernel.max_work_group_size),
            ]));
            rows.push(out);
        }
    }
    Ok(rows)
}

pub const TEXTURING: Study = Study {
    name: "texturing",
    title: "Procedural textures",
    claim: "Thesis, section 5.2.2: evaluating procedural textures inside the kernel is impractical; the host should do it in a pass of its own. The claim \
            tested: the host pass is the faster one.",
    run: texturing,
};

fn texturing(lab: &mut Lab) -> Result<Findings> {
    let base = with(Accel::Bvh2);
    let split = TraceOptions { kernels: Kernels::Split, ..base };
    let host = TraceOptions { textures: TexturePass::HostPass, ..split };
    let detail = if lab.quick { 24 } else { 96 };
    let mut rows = Vec::new();
    let one =
        |label: &str, options, textures: &str| PictureVariant::new(label, options, 1, 8).with("textures", textures);
    let plain = [one("no textures, mega", base, "none"), one("no textures, split", split, "none")];
    let textured = [
        one("in the kernel, mega", base, "in-kernel"),
        one("in the kernel, split", split, "in-kernel"),
        one("by the host, split", host, "host-pass"),
    ];
    let own = lab.scenes.is_empty();
    if own {
        rows.extend(lab.pictures("still life", &scenes::still_life(detail, false)?, &plain, None)?);
        rows.extend(lab.pictures(
            "still life of marble and wood",
            &scenes::still_life(detail, true)?,
            &textured,
            None,
        )?);
    } else {
        for (scene_name, scene) in lab.scenes {
            rows.extend(lab.pictures(scene_name, scene, &textured, None)?);
        }
    }
    let (mut parts, ratios) = ratios(
        &rows,
        "in the kernel, split",
        "by the host, split",
        "the host pass takes",
        "of textures in the split kernels",
    );
    let seconds = |method: &str| mean(&rows, "seconds", |row| name(row, "method") == method);
    if let (true, Some(plain), Some(textured)) = (own, seconds("no textures, mega"), seconds("in the kernel, mega")) {
        parts.push(format!(
            "in the mega-kernel marble and wood take {:.2} times the time of plain colours",
            textured / plain
        ));
    }
    let table = Table::new("pictures", "Pictures by who evaluates textures", rows);
    let charts = charts(&table, "seconds by who evaluates textures");
    Ok(Findings {
        holds: (!ratios.is_empty()).then(|| ratios.iter().all(|ratio| *ratio < 1.0)),
        verdict: parts.join("; ") + ".",
        notes: Vec::new(),
        tables: vec![table],
        charts,
    })
}

pub const SUBSAMPLING: Study = Study {
    name: "subsampling",
    title: "Adaptive subsampling",
    claim: "Thesis, section 2.2.1: a lattice of pixels is traced, others only where neighbours differ, the rest is interpolated; that is tens of percent \
            faster. The claim tested: 0.9 of the time of one sample in every pixel or less, with an error that is no larger.",
    run: subsampling,
};

fn subsampling(lab: &mut Lab) -> Result<Findings> {
    let options = super::pareto::fast_options(lab);
    let mut variants = vec![PictureVariant::new("every pixel", options, 1, 8)];
    // From error 2, 4 and 8 on the lattice has every second, fourth and eighth pixel.
    let errors: &[f32] = if lab.quick { &[2.0, 8.0] } else { &[1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] };
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, 8)));
    let (mut rows, mut parts, mut holds) = (Vec::new(), Vec::new(), true);
    for (scene_name, scene) in picture_scenes(lab)? {
        let found = lab.pictures(&scene_name, &scene, &variants, Some((if lab.quick { 64 } else { 256 }, 8)))?;
        let value = |row: &Row, column| number(row, column).unwrap_or(f64::INFINITY);
        let (full, others) = found.split_first().expect("a row for each variant");
        let as_good = others.iter().filter(|row| value(row, "error") <= value(full, "error"));
        let fastest = as_good.min_by(|a, b| value(a, "seconds").total_cmp(&value(b, "seconds")));
        let share = |column| fastest.map(|row| value(row, column) / value(full, column));
        holds &= share("seconds").is_some_and(|share| share <= 0.9);
        parts.push(match (fastest, share("seconds"), share("rays")) {
            (Some(row), Some(time), Some(rays)) => format!(
                "{scene_name}: error {:.2} of one sample in every pixel in {time:.2} of its time with {rays:.2} of its rays ({}: {:.2})",
                value(full, "error"),
                name(row, "method"),
                value(row, "error")
            ),
            _ => format!("{scene_name}: nothing is as good as one sample in every pixel"),
        });
        rows.extend(found);
    }
    let table = Table::new("pictures", "Pictures by their error, beside one sample in every pixel", rows);
    let charts = by_scene(ChartKind::Front, &table, "rays", "error against rays", ["error", "frames_per_s"], |chart| {
        chart.log(true, true).caption("Exact hits; the time of device and host. Left and high is better.")
    });
    Ok(Findings {
        holds: (!lab.quick).then_some(holds),
        verdict: parts.join("; ") + ".",
        notes: vec![
            "Counted is the device's time and what the host takes between the rounds to decide what is traced next."
                .to_owned(),
        ],
        tables: vec![table],
        charts,
    })
}

/// For each scene how many times the time of method `a` method `b` takes: as sentences and as numbers.
fn ratios(rows: &[Row], a: &str, b: &str, takes: &str, of: &str) -> (Vec<String>, Vec<f64>) {
    let seconds = |scene: &str, method: &str| {
        let row = rows.iter().find(|row| name(row, "scene") == scene && name(row, "method") == method)?;
        number(row, "seconds")
    };
    let ratios = scenes_of(rows).into_iter().filter_map(|scene| {
        let ratio = seconds(&scene, b)? / seconds(&scene, a)?;
        Some((format!("{scene}: {takes} {ratio:.2} times the time {of}"), ratio))
    });
    ratios.unzip()
}

/// Bars of seconds for each scene.
fn charts(table: &Table, title: &str) -> Vec<Chart> {
    let differing: f64 = table.rows.iter().filter_map(|row| number(row, "wrong_pixels")).sum();
    by_scene(ChartKind::Bars, table, "seconds", title, ["method", "seconds"], |chart| {
        chart.spread(SPREAD).caption(format!(
            "Whole pictures, exact hits. {differing} pixels differ from those of the scalar reference."
        ))
    })
}
