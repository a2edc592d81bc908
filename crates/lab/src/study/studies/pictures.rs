//! Whole pictures: samples and depth, one kernel or several, textures.

use super::super::lab::PictureVariant;
use super::super::lookup::{Clock, speedup};
use super::super::outcome::{Outcome, Rounds};
use super::super::table::{Row, name, number};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, scenes};
use super::device::kernel_row;
use super::{PICTURE, Verdict, by_scene, ratio_of, scenes_of, with};
use raybrook::Result;
use raybrook::low_level::device::{Looked, kernel_resources};
use raybrook::low_level::options::{Kernels, PictureOptions, StructureKind, TexturePass, TraceOptions};
use raybrook::low_level::scene::Scene;

/// Seconds of a picture's fastest and slowest round.
const SPREAD: [&str; 2] = ["wall_low", "wall_high"];

/// The user's scenes, or five that need little and much; in a hurry one.
pub(super) fn picture_scenes(lab: &Lab) -> Result<Vec<(String, Scene)>> {
    if !lab.scenes.is_empty() {
        return Ok(lab.scenes.to_vec());
    }
    // A boulder alone sends no ray on.
    let own = scenes::own(lab.quick).filter(|own| own.name != "boulder");
    own.map(|own| Ok((own.name.to_owned(), own.scene(lab.quick)?))).collect()
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
                "Exact hits. FLIP to a picture of {converged} samples a pixel and chains of {MOST_DEPTH} rays; \"error \
                 E\" asks for so many 8-bit steps. Pictures a second are by the wall clock. Left and high is better."
            ))
        },
    )
}

pub const KERNELS: Study = Study {
    name: "kernels",
    title: "One kernel or several",
    claim: "Thesis, section 5.2.1: one mega-kernel needs many registers, several kernels need traffic between them; \
            the thesis takes the one. The claim tested: the mega-kernel is the faster one.",
    own_shapes: None,
    source: include_str!("pictures.rs"),
    measure: kernels,
    judge: judge_kernels,
};

const MEGA: &str = "mega";
const WAVEFRONT: &str = "wavefront";

fn kernels(lab: &mut Lab) -> Result<Vec<Table>> {
    let base = with(StructureKind::Bvh2);
    let wavefront = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..base.picture }, ..base };
    let mut variants = vec![
        PictureVariant::new(MEGA, base, 1, 8).with("kernels", "mega"),
        PictureVariant::new(WAVEFRONT, wavefront, 1, 8).with("kernels", "wavefront"),
    ];
    if !lab.quick {
        for paths in [1 << 12, 1 << 16] {
            let options = TraceOptions {
                picture: PictureOptions { paths_in_flight: Some(paths), ..wavefront.picture },
                ..wavefront
            };
            variants.push(
                PictureVariant::new(format!("wavefront, {paths} paths at a time"), options, 1, 8)
                    .with("kernels", "wavefront"),
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
        match time_ratio(&table, [&scene, WAVEFRONT], [&scene, MEGA])? {
            Some(ratio) => verdict.say(
                ratio.above(1.0),
                format!("{scene}: the wavefront kernels take {ratio} times the time of the mega-kernel"),
            ),
            None => verdict.not_measured(&scene),
        }
    }
    let note = match found.header.is_reference() {
        true => ONE_WAY,
        false => WAITED,
    };
    let charts = charts(&table, "seconds by kernels");
    let tables = vec![table, found.table("resources", &["kernels"])?];
    Ok(Findings { notes: vec![note.to_owned()], ..verdict.findings(tables, charts) }.on(found.header))
}

/// What is to be known of comparisons that only a device can make.
const ONE_WAY: &str = "The reference does the work of either in one way: nothing was compared.";

/// What seconds of pictures are.
pub(super) const WAITED: &str =
    "Seconds are what a user waits for, by the wall clock: the tables have the device's beside them.";

/// How many times the time of the picture `b`, a scene and a method, the picture `a` takes.
fn time_ratio(table: &Table, a: [&str; 2], b: [&str; 2]) -> Result<Option<Rounds>> {
    let row = |[scene, method]: [&str; 2]| table.one(&[("scene", scene), ("method", method)]);
    Ok(row(a)?.zip(row(b)?).and_then(|(a, b)| speedup(&[[b, a]], Clock::Wall)))
}

/// What the kernels for pictures take; those that several variants share once.
fn resources(lab: &Lab, variants: &[PictureVariant]) -> Result<Vec<Row>> {
    let Some(device) = lab.device else { return Ok(Vec::new()) };
    let mut rows: Vec<Row> = Vec::new();
    let (_, scene) = picture_scenes(lab)?.swap_remove(0);
    for variant in variants {
        (lab.progress)(&format!("registers: {}", variant.label));
        let buffers = lab.pack(&scene, &variant.options)?;
        let programs = kernel_resources(device, &buffers, &variant.options, variant.depth, Looked::FirstPass)?;
        for kernel in programs.into_iter().flat_map(|program| program.kernels) {
            let is_known = rows.iter().any(|row| name(row, "kernels") == kernel.kernel);
            if kernel.kernel.starts_with("trace") || is_known {
                continue;
            }
            rows.push(kernel_row(&variant.label, &kernel, &device.info));
        }
    }
    Ok(rows)
}

pub const TEXTURING: Study = Study {
    name: "texturing",
    title: "Procedural textures",
    claim: "Thesis, section 5.2.2: evaluating procedural textures inside the kernel is impractical; the host should do \
            it in a pass of its own. The claim tested: the host pass is the faster one.",
    own_shapes: None,
    source: include_str!("pictures.rs"),
    measure: texturing,
    judge: judge_texturing,
};

const PLAIN_SCENE: &str = scenes::STILL_LIFE;
const TEXTURED_SCENE: &str = scenes::TEXTURED_STILL_LIFE;
const PLAIN_MEGA: &str = "no textures, mega";
const IN_MEGA: &str = "in the kernel, mega";
const IN_WAVEFRONT: &str = "in the kernel, wavefront";
const BY_HOST: &str = "by the host, wavefront";

fn texturing(lab: &mut Lab) -> Result<Vec<Table>> {
    let base = with(StructureKind::Bvh2);
    let wavefront = TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..base.picture }, ..base };
    let host =
        TraceOptions { picture: PictureOptions { textures: TexturePass::HostPass, ..wavefront.picture }, ..wavefront };
    let mut rows = Vec::new();
    let one =
        |label: &str, options, textures: &str| PictureVariant::new(label, options, 1, 8).with("textures", textures);
    let plain = [one(PLAIN_MEGA, base, "none"), one("no textures, wavefront", wavefront, "none")];
    let textured =
        [one(IN_MEGA, base, "in-kernel"), one(IN_WAVEFRONT, wavefront, "in-kernel"), one(BY_HOST, host, "host-pass")];
    if lab.scenes.is_empty() {
        rows.extend(lab.pictures(PLAIN_SCENE, &scenes::named(PLAIN_SCENE, lab.quick)?, &plain, None)?);
        rows.extend(lab.pictures(TEXTURED_SCENE, &scenes::named(TEXTURED_SCENE, lab.quick)?, &textured, None)?);
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
            verdict.leave_open(format!("{scene}: no ray met a procedural texture: nothing was compared"));
            continue;
        }
        match time_ratio(&table, [scene, BY_HOST], [scene, IN_WAVEFRONT])? {
            Some(ratio) => verdict.say(
                ratio.below(1.0),
                format!("{scene}: the host pass takes {ratio} times the time of textures in the wavefront kernels"),
            ),
            None => verdict.not_measured(scene),
        }
    }
    let of_plain = match is_own {
        true => time_ratio(&table, [TEXTURED_SCENE, IN_MEGA], [PLAIN_SCENE, PLAIN_MEGA])?,
        false => None,
    };
    if let Some(ratio) = of_plain {
        verdict.add(format!("in the mega-kernel marble and wood take {ratio} times the time of plain colours"));
    }
    let charts = charts(&table, "seconds by who evaluates textures");
    let note = match found.header.is_reference() {
        true => ONE_WAY,
        false => WAITED,
    };
    Ok(Findings { notes: vec![note.to_owned()], ..verdict.findings(vec![table], charts) }.on(found.header))
}

pub const SUBSAMPLING: Study = Study {
    name: "subsampling",
    title: "Adaptive subsampling",
    claim: "Thesis, section 2.2.1: a lattice of pixels is traced, others only where neighbours differ, the rest is \
            interpolated; that is tens of percent faster. The claim tested: a picture by its error (`--error`) takes \
            at most 0.9 of the time of 1, 2, 4 and 8 samples in every pixel, each with an error that is no larger.",
    own_shapes: None,
    source: include_str!("pictures.rs"),
    measure: subsampling,
    judge: judge_subsampling,
};

/// Samples in every pixel that pictures by their error are measured by.
const BASELINES: [u32; 4] = [1, 2, 4, 8];
/// The part of their time that shall do.
const MOST_TIME: f64 = 0.9;

fn every_pixel(samples: u32) -> String {
    format!("{samples} in every pixel")
}

fn subsampling(lab: &mut Lab) -> Result<Vec<Table>> {
    let options = super::pareto::fast_options(lab);
    let baseline = |&samples: &u32| PictureVariant::new(every_pixel(samples), options, samples, MOST_DEPTH);
    let mut variants: Vec<_> = BASELINES.iter().map(baseline).collect();
    // From error 2, 4 and 8 on the lattice has every second, fourth and eighth pixel.
    let errors: &[f32] =
        if lab.quick { &[1.0, 2.0, 8.0] } else { &[0.4, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0, 16.0] };
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, MOST_DEPTH)));
    let mut rows = Vec::new();
    for (scene_name, scene) in picture_scenes(lab)? {
        rows.extend(lab.pictures(&scene_name, &scene, &variants, Some((converged(lab.quick), MOST_DEPTH)))?);
    }
    Ok(vec![Table::new("pictures", "Pictures by their error, beside samples in every pixel", rows)])
}

fn judge_subsampling(found: &Measured) -> Result<Findings> {
    let table = found.table("pictures", &PICTURE)?;
    let mut verdict = Verdict::default();
    for scene in scenes_of(&table.rows) {
        let of_scene = || table.rows.iter().filter(|row| name(row, "scene") == scene);
        let by_error: Vec<&Row> = of_scene().filter(|row| row.contains_key("asked")).collect();
        let mut parts = Vec::new();
        for samples in BASELINES {
            let full = table.one(&[("scene", &scene), ("method", &every_pixel(samples))])?;
            let (outcome, part) = against(full, &by_error);
            verdict.outcomes.push(outcome);
            parts.push(format!("{samples}: {part}"));
        }
        verdict.add(format!("{scene}: of the time of samples in every pixel, {}", parts.join(", ")));
    }
    let charts = by_scene(
        ChartKind::Front,
        &table,
        "rays",
        "pictures a second against error",
        ["error", "frames_per_s"],
        |chart| chart.log(true, true).caption("Exact hits; by the wall clock. Left and high is better."),
    );
    Ok(Findings { notes: vec![WAITED.to_owned()], ..verdict.findings(vec![table], charts) })
}

/// The part of the time of `full` that the fastest picture by its error takes which is as good, in words and as an
/// answer to the claim.
fn against(full: Option<&Row>, by_error: &[&Row]) -> (Outcome, String) {
    let measured = full.and_then(|full| Some((full, number(full, "error")?, number(full, "wall_s")?)));
    let Some((full, error, _)) = measured else { return (Outcome::Undecided, "not measured".to_owned()) };
    let as_good = by_error.iter().filter(|row| number(row, "error").is_some_and(|other| other <= error));
    let timed = as_good.filter_map(|row| Some((*row, speedup(&[[full, *row]], Clock::Wall)?)));
    match timed.min_by(|a, b| a.1.ratio().total_cmp(&b.1.ratio())) {
        Some((row, time)) => {
            let rays = ratio_of(row, full, "rays").map_or(String::new(), |rays| format!(" with {rays:.2} of the rays"));
            (time.below(MOST_TIME), format!("{time}{rays} ({})", name(row, "method")))
        }
        None if by_error.is_empty() => (Outcome::Undecided, "not measured".to_owned()),
        None => (Outcome::Fails, "none is as good".to_owned()),
    }
}

/// Bars of seconds for each scene.
fn charts(table: &Table, title: &str) -> Vec<Chart> {
    let sum = |column: &str| table.rows.iter().filter_map(|row| number(row, column)).sum::<f64>();
    let (differing, checked) = (sum("wrong_pixels"), sum("checked_pixels"));
    by_scene(ChartKind::Bars, table, "seconds", title, ["method", "wall_s"], |chart| {
        chart.spread(SPREAD).caption(format!(
            "Whole pictures, exact hits. {differing} of {checked} pixels differ from those of the scalar reference."
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, of_reference, rounds};
    use super::*;
    use crate::study::table::row;
    use serde_json::json;

    fn pictures(rows: &[(&str, &str, f64, Row)]) -> Vec<Table> {
        let rows = rows.iter().map(|(scene, method, seconds, columns)| {
            let mut out = row([("scene", json!(scene)), ("method", json!(method)), ("wall_s", json!(seconds))]);
            out.extend(row([("wall_rounds_s", rounds(*seconds))]));
            out.extend(columns.clone());
            out
        });
        vec![Table::new("pictures", "", rows.collect()), Table::new("resources", "", Vec::new())]
    }

    #[test]
    fn the_mega_kernel_is_compared_with_wavefront_kernels_of_every_path() {
        let rows = |wavefront: f64| {
            let limited = ("s", "wavefront, 4096 paths at a time", 0.1, Row::new());
            pictures(&[("s", MEGA, 1.0, Row::new()), limited, ("s", WAVEFRONT, wavefront, Row::new())])
        };
        let slower = judge(&KERNELS, rows(3.2), &header(false)).unwrap();
        assert_eq!(slower.outcome, Outcome::Holds);
        assert!(slower.verdict.contains("3.20 [3.20, 3.20] times the time of the mega-kernel"), "{}", slower.verdict);
        assert_eq!(judge(&KERNELS, rows(0.9), &header(false)).unwrap().outcome, Outcome::Fails);
        assert_eq!(judge(&KERNELS, rows(0.9), &of_reference()).unwrap().outcome, Outcome::Undecided);
        let alone = judge(&KERNELS, pictures(&[("s", MEGA, 1.0, Row::new())]), &header(false)).unwrap();
        assert_eq!((alone.outcome, &alone.verdict[..]), (Outcome::Undecided, "s: not measured."));
    }

    /// As published of the H200: the kernels of the host's pass take 1.11 times the time, the pass takes 14 times as
    /// long. The wall clock knows both.
    #[test]
    fn the_time_of_the_host_counts_where_it_evaluates_textures() {
        let rows = |by_host: f64| {
            pictures(&[
                (PLAIN_SCENE, PLAIN_MEGA, 0.5, Row::new()),
                (TEXTURED_SCENE, IN_MEGA, 0.6, Row::new()),
                (TEXTURED_SCENE, IN_WAVEFRONT, 1.0, row([("seconds", json!(0.9))])),
                (TEXTURED_SCENE, BY_HOST, by_host, row([("seconds", json!(0.8))])),
            ])
        };
        let slow = judge(&TEXTURING, rows(15.9), &header(false)).unwrap();
        assert_eq!(slow.outcome, Outcome::Fails);
        let words = ["takes 15.90 [15.90, 15.90] times", "take 1.20 [1.20, 1.20]"];
        assert!(words.iter().all(|words| slow.verdict.contains(words)), "{}", slow.verdict);
        // Judged again, nothing changes.
        assert_eq!(judge(&TEXTURING, slow.tables.clone(), &header(false)).unwrap(), slow);
        assert_eq!(judge(&TEXTURING, rows(0.95), &header(false)).unwrap().outcome, Outcome::Holds);
        let untextured =
            pictures(&[("s", IN_WAVEFRONT, 1.0, Row::new()), ("s", BY_HOST, 0.9, row([("host_colours", json!(0))]))]);
        let untextured = judge(&TEXTURING, untextured, &header(false)).unwrap();
        let says = untextured.verdict.contains("nothing was compared");
        assert_eq!((untextured.outcome, says), (Outcome::Undecided, true));
    }

    /// As published of the H200: beside one sample a pixel a picture by its error looked good, and eight samples beat
    /// it.
    #[test]
    fn pictures_by_their_error_must_beat_every_number_of_samples() {
        let full = |samples: u32, error: f64| {
            let columns = row([("error", json!(error)), ("rays", json!(100 * samples)), ("samples", json!(samples))]);
            ("s", every_pixel(samples), f64::from(samples), columns)
        };
        let by_error = |method: &str, seconds: f64, error: f64| {
            let columns = row([("error", json!(error)), ("rays", json!(seconds * 100.0)), ("asked", json!(1))]);
            ("s", method.to_owned(), seconds, columns)
        };
        let found = |best: f64, middle: f64| {
            let mut rows: Vec<_> =
                BASELINES.iter().zip([2.0, 1.0, 0.7, 0.5]).map(|(&samples, error)| full(samples, error)).collect();
            // What is fastest is worse than any.
            rows.push(by_error("error 8", 0.1, 5.0));
            rows.extend([
                by_error("error 3", middle, 1.9),
                by_error("error 1", 1.7, 0.6),
                by_error("error .4", best, 0.4),
            ]);
            let rows: Vec<_> =
                rows.iter().map(|(scene, method, s, row)| (*scene, &method[..], *s, row.clone())).collect();
            judge(&SUBSAMPLING, pictures(&rows), &header(false)).unwrap()
        };
        let holds = found(5.0, 0.8);
        assert_eq!(holds.outcome, Outcome::Holds, "{}", holds.verdict);
        let words =
            "s: of the time of samples in every pixel, 1: 0.80 [0.80, 0.80] with 0.80 of the rays (error 3), 2: 0.85";
        assert!(holds.verdict.starts_with(words), "{}", holds.verdict);
        assert_eq!([found(5.0, 0.95).outcome, found(9.0, 0.8).outcome], [Outcome::Fails, Outcome::Fails]);
        let nothing = pictures(&[("s", &every_pixel(1), 1.0, Row::new())]);
        assert_eq!(judge(&SUBSAMPLING, nothing, &header(false)).unwrap().outcome, Outcome::Undecided);
        let (_, method, seconds, columns) = full(1, 2.0);
        let (_, other, other_s, worse) = by_error("error 8", 0.1, 5.0);
        let rows = [("s", &method[..], seconds, columns), ("s", &other[..], other_s, worse)];
        let worse = judge(&SUBSAMPLING, pictures(&rows), &header(false)).unwrap();
        assert!(worse.outcome == Outcome::Fails && worse.verdict.contains("1: none is as good"), "{}", worse.verdict);
    }
}
