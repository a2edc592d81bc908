//! Whole pictures: samples and depth, one kernel or several, textures.

use super::super::lab::PictureVariant;
use super::super::table::{Row, known, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, scenes};
use super::{PICTURE, Verdict, by_scene, ratio_of, scenes_of, with};
use raybrook::Result;
use raybrook::low_level::device::kernel_resources;
use raybrook::low_level::options::{Kernels, PictureOptions, StructureKind, TexturePass, TraceOptions};
use raybrook::low_level::scene::Scene;
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

/// Longest chain of rays of most pictures.
const MOST_DEPTH: u32 = 8;

/// Samples a pixel of the picture that others are compared with.
fn converged(is_quick: bool) -> u32 {
    if is_quick { 16 } else { 256 }
}

/// Speed against error of whole pictures.
pub(super) fn tradeoff(lab: &mut Lab) -> Result<Table> {
    let (samples, depths): (&[u32], &[u32]) =
        if lab.quick { (&[1, 4], &[2]) } else { (&[1, 2, 4, 8, 16, 32, 64], &[1, 2, 4]) };
    let options = super::pareto::fast_options(lab);
    let mut variants: Vec<_> = samples
        .iter()
        .map(|&samples| {
            let label = format!("{samples} sample{}", if samples == 1 { "" } else { "s" });
            PictureVariant::new(label, options, samples, MOST_DEPTH)
        })
        .collect();
    let many = if lab.quick { 1 } else { 16 };
    variants.extend(depths.iter().map(|&depth| {
        let label = format!("{many} sample{}, depth {depth}", if many == 1 { "" } else { "s" });
        PictureVariant::new(label, options, many, depth)
    }));
    let errors: &[f32] = if lab.quick { &[4.0] } else { &[4.0, 2.0, 1.0, 0.5] };
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, MOST_DEPTH)));
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, Some((converged(lab.quick), MOST_DEPTH)))?);
    }
    Ok(Table::new("pictures", "Whole pictures: time against error", rows))
}

/// The charts of these pictures, one for each scene.
pub(super) fn tradeoff_charts(table: &Table, is_quick: bool) -> Vec<Chart> {
    let converged = converged(is_quick);
    by_scene(
        ChartKind::Front,
        table,
        "pictures",
        "pictures a second against error",
        ["flip", "frames_per_s"],
        |chart| {
            chart.log(true, true).caption(format!(
                "Exact hits. FLIP to a picture of {converged} samples a pixel and chains of {MOST_DEPTH} rays; \"error E\" asks for so many 8-bit steps, and \
                 the host's decisions count. Left and high is better."
            ))
        },
    )
}

pub const KERNELS: Study = Study {
    name: "kernels",
    title: "One kernel or several",
    claim: "Thesis, section 5.2.1: one mega-kernel needs many registers, several kernels need traffic between them; the thesis takes the one. The claim \
            tested: the mega-kernel is the faster one.",
    own_shapes: None,
    measure: kernels,
    judge: judge_kernels,
};

const MEGA: &str = "mega";
const SPLIT: &str = "split";

fn kernels(lab: &mut Lab) -> Result<Vec<Table>> {
    let base = with(StructureKind::Bvh2);
    let split = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..base.picture }, ..base };
    let mut variants = vec![
        PictureVariant::new(MEGA, base, 1, 8).with("kernels", "mega"),
        PictureVariant::new(SPLIT, split, 1, 8).with("kernels", "split"),
    ];
    if !lab.quick {
        for paths in [1 << 12, 1 << 16] {
            let options =
                TraceOptions { picture: PictureOptions { paths_in_flight: Some(paths), ..split.picture }, ..split };
            variants.push(
                PictureVariant::new(format!("split, {paths} paths at a time"), options, 1, 8).with("kernels", "split"),
            );
        }
    }
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, None)?);
    }
    let resources = resources(lab, &variants[..2])?;
    Ok(vec![
        Table::new("pictures", "Pictures by kernels", rows),
        Table::new("resources", "What each kernel takes of the device, as far as the driver tells", resources),
    ])
}

fn judge_kernels(found: &Measured) -> Result<Findings> {
    let table = found.table("pictures", &PICTURE)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        match seconds_ratio(&table, [&scene, SPLIT], [&scene, MEGA])? {
            Some(ratio) => verdict.say(
                ratio > 1.0,
                format!("{scene}: the wavefront kernels take {ratio:.2} times the time of the mega-kernel"),
            ),
            None => verdict.not_measured(&scene),
        }
    }
    let note = match found.header.is_reference() {
        true => ONE_WAY,
        false => {
            "Seconds are the device's: what the host does between the launches of the wavefront kernels is not counted."
        }
    };
    let charts = charts(&table, "seconds by kernels");
    let tables = vec![table, found.table("resources", &["kernels"])?];
    Ok(Findings { notes: vec![note.to_owned()], ..verdict.findings(tables, charts) }.on(found.header))
}

/// What is to be known of comparisons that only a device can make.
const ONE_WAY: &str = "The reference does the work of either in one way: nothing was compared.";

/// How many times the time of the picture `b`, a scene and a method, the picture `a` takes: of device and host
/// together.
fn seconds_ratio(table: &Table, a: [&str; 2], b: [&str; 2]) -> Result<Option<f64>> {
    let row = |[scene, method]: [&str; 2]| table.one(&[("scene", scene), ("method", method)]);
    Ok(row(a)?.zip(row(b)?).and_then(|(a, b)| ratio_of(a, b, "seconds")))
}

/// What the kernels for pictures take. Where decisions are left to a second pass, its kernels have the same names; the
/// first ones do nearly all of the work.
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
    own_shapes: None,
    measure: texturing,
    judge: judge_texturing,
};

const PLAIN_SCENE: &str = "still life";
const TEXTURED_SCENE: &str = "still life of marble and wood";
const PLAIN_MEGA: &str = "no textures, mega";
const IN_MEGA: &str = "in the kernel, mega";
const IN_SPLIT: &str = "in the kernel, split";
const BY_HOST: &str = "by the host, split";

fn texturing(lab: &mut Lab) -> Result<Vec<Table>> {
    let base = with(StructureKind::Bvh2);
    let split = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..base.picture }, ..base };
    let host = TraceOptions { picture: PictureOptions { textures: TexturePass::HostPass, ..split.picture }, ..split };
    let detail = if lab.quick { 24 } else { 96 };
    let mut rows = Vec::new();
    let one =
        |label: &str, options, textures: &str| PictureVariant::new(label, options, 1, 8).with("textures", textures);
    let plain = [one(PLAIN_MEGA, base, "none"), one("no textures, split", split, "none")];
    let textured =
        [one(IN_MEGA, base, "in-kernel"), one(IN_SPLIT, split, "in-kernel"), one(BY_HOST, host, "host-pass")];
    if lab.scenes.is_empty() {
        rows.extend(lab.pictures(PLAIN_SCENE, &scenes::still_life(detail, false)?, &plain, None)?);
        rows.extend(lab.pictures(TEXTURED_SCENE, &scenes::still_life(detail, true)?, &textured, None)?);
    } else {
        for (scene_name, scene) in lab.scenes {
            rows.extend(lab.pictures(scene_name, scene, &textured, None)?);
        }
    }
    Ok(vec![Table::new("pictures", "Pictures by who evaluates textures", rows)])
}

fn judge_texturing(found: &Measured) -> Result<Findings> {
    let table = found.table("pictures", &PICTURE)?;
    let is_own = found.header.scenes.is_empty();
    let mut verdict = Verdict::default();
    // The program's own scene without textures is only to be compared with.
    for scene in scenes_of(&table.rows).iter().filter(|scene| !is_own || *scene != PLAIN_SCENE) {
        let by_host = table.one(&[("scene", scene), ("method", BY_HOST)])?;
        if by_host.and_then(|row| number(row, "host_colours")) == Some(0.0) {
            verdict.say(None, format!("{scene}: no ray met a procedural texture: nothing was compared"));
            continue;
        }
        match seconds_ratio(&table, [scene, BY_HOST], [scene, IN_SPLIT])? {
            Some(ratio) => verdict.say(
                ratio < 1.0,
                format!("{scene}: the host pass takes {ratio:.2} times the time of textures in the wavefront kernels"),
            ),
            None => verdict.not_measured(scene),
        }
    }
    let of_plain = match is_own {
        true => seconds_ratio(&table, [TEXTURED_SCENE, IN_MEGA], [PLAIN_SCENE, PLAIN_MEGA])?,
        false => None,
    };
    if let Some(ratio) = of_plain {
        verdict.add(format!("in the mega-kernel marble and wood take {ratio:.2} times the time of plain colours"));
    }
    let charts = charts(&table, "seconds by who evaluates textures");
    let note = match found.header.is_reference() {
        true => ONE_WAY,
        false => {
            "Seconds are the device's and, where the host evaluates textures, what it takes to fetch the hits, to compute and \
             to send the colours."
        }
    };
    Ok(Findings { notes: vec![note.to_owned()], ..verdict.findings(vec![table], charts) }.on(found.header))
}

pub const SUBSAMPLING: Study = Study {
    name: "subsampling",
    title: "Adaptive subsampling",
    claim: "Thesis, section 2.2.1: a lattice of pixels is traced, others only where neighbours differ, the rest is interpolated; that is tens of percent \
            faster. The claim tested: 0.9 of the time of one sample in every pixel or less, with an error that is no larger.",
    own_shapes: None,
    measure: subsampling,
    judge: judge_subsampling,
};

const EVERY_PIXEL: &str = "every pixel";

fn subsampling(lab: &mut Lab) -> Result<Vec<Table>> {
    let options = super::pareto::fast_options(lab);
    let mut variants = vec![PictureVariant::new(EVERY_PIXEL, options, 1, MOST_DEPTH)];
    // From error 2, 4 and 8 on the lattice has every second, fourth and eighth pixel.
    let errors: &[f32] = if lab.quick { &[2.0, 8.0] } else { &[1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] };
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, MOST_DEPTH)));
    let converged = (if lab.quick { 64 } else { 256 }, MOST_DEPTH);
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, Some(converged))?);
    }
    Ok(vec![Table::new("pictures", "Pictures by their error, beside one sample in every pixel", rows)])
}

fn judge_subsampling(found: &Measured) -> Result<Findings> {
    let table = found.table("pictures", &PICTURE)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let full = table.one(&[("scene", &scene), ("method", EVERY_PIXEL)])?;
        let Some((full, error)) = full.and_then(|full| Some((full, number(full, "error")?))) else {
            verdict.not_measured(&scene);
            continue;
        };
        let others =
            || table.rows.iter().filter(|row| name(row, "scene") == scene && name(row, "method") != EVERY_PIXEL);
        let as_good = others().filter(|row| number(row, "error").is_some_and(|other| other <= error));
        let timed =
            as_good.filter_map(|row| Some((row, ratio_of(row, full, "seconds")?, ratio_of(row, full, "rays")?)));
        match timed.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((row, time, rays)) => verdict.say(
                time <= 0.9,
                format!(
                    "{scene}: error {error:.2} of one sample in every pixel in {time:.2} of its time with {rays:.2} of its rays ({}: {:.2})",
                    name(row, "method"),
                    number(row, "error").unwrap_or(0.0)
                ),
            ),
            None => {
                let is_timed = number(full, "seconds").is_some() && others().any(|row| row.contains_key("seconds"));
                let nothing = format!("{scene}: nothing is as good as one sample in every pixel");
                verdict.say(is_timed.then_some(false), nothing);
            }
        }
    }
    let charts = by_scene(
        ChartKind::Front,
        &table,
        "rays",
        "pictures a second against error",
        ["error", "frames_per_s"],
        |chart| chart.log(true, true).caption("Exact hits; the time of device and host. Left and high is better."),
    );
    let holds = verdict.all().filter(|_| !found.header.quick);
    let notes = vec![
        "Counted is the device's time and what the host takes between the rounds to decide what is traced next."
            .to_owned(),
    ];
    Ok(Findings { holds, notes, ..verdict.findings(vec![table], charts) })
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

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, of_reference};
    use super::*;

    fn pictures(rows: &[(&str, &str, f64, Row)]) -> Vec<Table> {
        let rows = rows.iter().map(|(scene, method, seconds, columns)| {
            let mut out = row([("scene", json!(scene)), ("method", json!(method)), ("seconds", json!(seconds))]);
            out.extend(columns.clone());
            out
        });
        vec![Table::new("pictures", "", rows.collect()), Table::new("resources", "", Vec::new())]
    }

    #[test]
    fn the_mega_kernel_is_compared_with_split_kernels_of_every_path() {
        let rows = |split: f64| {
            let limited = ("s", "split, 4096 paths at a time", 0.1, Row::new());
            pictures(&[("s", MEGA, 1.0, Row::new()), limited, ("s", SPLIT, split, Row::new())])
        };
        let slower = judge(&KERNELS, rows(3.2), &header(false)).unwrap();
        assert_eq!(slower.holds, Some(true));
        assert!(slower.verdict.contains("3.20 times the time of the mega-kernel"), "{}", slower.verdict);
        assert_eq!(judge(&KERNELS, rows(0.9), &header(false)).unwrap().holds, Some(false));
        assert_eq!(judge(&KERNELS, rows(0.9), &of_reference()).unwrap().holds, None);
        let alone = judge(&KERNELS, pictures(&[("s", MEGA, 1.0, Row::new())]), &header(false)).unwrap();
        assert_eq!((alone.holds, &alone.verdict[..]), (None, "s: not measured."));
    }

    /// As published of the H200: the kernels of the host's pass take 1.11 times the time, the pass takes 14 times as
    /// long.
    #[test]
    fn the_time_of_the_host_counts_where_it_evaluates_textures() {
        let rows = |host_s: f64| {
            pictures(&[
                (PLAIN_SCENE, PLAIN_MEGA, 0.5, Row::new()),
                (TEXTURED_SCENE, IN_MEGA, 0.6, Row::new()),
                (TEXTURED_SCENE, IN_SPLIT, 1.0, row([("host_pass_s", json!(0.0))])),
                (TEXTURED_SCENE, BY_HOST, 0.9, row([("host_pass_s", json!(host_s))])),
            ])
        };
        let slow = judge(&TEXTURING, rows(15.0), &header(false)).unwrap();
        assert_eq!(slow.holds, Some(false));
        assert!(slow.verdict.contains("takes 15.90 times") && slow.verdict.contains("take 1.20"), "{}", slow.verdict);
        let by_host = &slow.tables[0].rows[3];
        assert_eq!((number(by_host, "seconds"), number(by_host, "textures_s")), (Some(15.9), Some(15.0)));
        // What is up to date stays: judged again, nothing is added again.
        assert_eq!(judge(&TEXTURING, slow.tables.clone(), &header(false)).unwrap(), slow);
        assert_eq!(judge(&TEXTURING, rows(0.05), &header(false)).unwrap().holds, Some(true));
        let untextured =
            pictures(&[("s", IN_SPLIT, 1.0, Row::new()), ("s", BY_HOST, 0.9, row([("host_colours", json!(0))]))]);
        let untextured = judge(&TEXTURING, untextured, &header(false)).unwrap();
        assert_eq!((untextured.holds, untextured.verdict.contains("nothing was compared")), (None, true));
    }

    #[test]
    fn subsampling_must_be_faster_with_an_error_that_is_no_larger() {
        let picture = |method: &'static str, seconds: f64, error: f64| {
            ("s", method, seconds, row([("error", json!(error)), ("rays", json!(seconds * 100.0))]))
        };
        let full = picture(EVERY_PIXEL, 1.0, 2.0);
        // What is fastest is worse, what is best is slower.
        let others = [picture("error 8", 0.1, 5.0), picture("error 1", 3.0, 0.5)];
        let found = |middle: f64| {
            let rows = [&[full.clone(), picture("error 3", middle, 1.9)][..], &others].concat();
            judge(&SUBSAMPLING, pictures(&rows), &header(false)).unwrap()
        };
        assert_eq!(found(0.8).holds, Some(true));
        assert!(found(0.8).verdict.contains("in 0.80 of its time with 0.80 of its rays (error 3: 1.90)"));
        assert_eq!(found(0.95).holds, Some(false));
        let without_error = judge(&SUBSAMPLING, pictures(&[("s", EVERY_PIXEL, 1.0, Row::new())]), &header(false));
        assert_eq!(without_error.unwrap().holds, None);
        let nothing = judge(&SUBSAMPLING, pictures(&[full.clone(), others[0].clone()]), &header(false)).unwrap();
        assert_eq!(nothing.holds, Some(false));
    }
}
