//! Kinds of rays, devices, and what is done beside tracing.

use super::super::table::{Row, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Subject, Table, Variant, scenes};
use super::pareto::fast_options;
use super::{ALL_KINDS, CAMERA, SPREAD, by_scene, error_note, mean, with};
use crate::device::Limits;
use crate::error::{Error, Result};
use crate::options::{Accel, Intersector, TraceOptions};
use crate::shared::{Hit, TraceRay};
use serde_json::json;

pub const INTERSECTION: Study = Study {
    name: "intersection",
    title: "Triangle tests a second",
    claim: "Thesis, table 5.1 (section 5.4.3): brute force on 5 to 30 cubes makes 442 to 406 million tests a second, 9 % fewer at the end; it is \
            bound by arithmetic, not by memory. Changing clocks showed that there; here tests a second must stay alike while the triangles grow \
            sixfold, and come nearer to the device's limit of arithmetic than to those of reading.",
    run: intersection,
};

/// Moller and Trumbore's test: two edges 6, two cross products 18, four dot products 20, the origin's difference 3, the reciprocal 1, three
/// products with it 3.
const FLOPS_A_TEST: f64 = 51.0;
/// Three vertices of four floats.
const BYTES_A_TEST: f64 = 48.0;
/// Rays of the thesis's picture.
const FRAME: f64 = 640.0 * 480.0;

fn intersection(lab: &mut Lab) -> Result<Findings> {
    let counts: &[u32] = if lab.quick { &[5, 15, 30] } else { &[5, 10, 15, 20, 25, 30] };
    let options = TraceOptions { intersector: Intersector::MollerTrumbore, ..with(Accel::Brute) };
    let mut rows = Vec::new();
    for &count in counts {
        let subject = lab.subject("cubes", scenes::cubes(count)?)?;
        let variant = Variant::new("brute force, moller-trumbore", options).with("cubes", count);
        for mut found in lab.compare(&subject, &[variant], &[CAMERA])? {
            if let Some(rate) = number(&found, "mrays_per_s") {
                let tests = rate * subject.triangle_count as f64;
                found.extend(row([
                    ("frames_per_s", json!(rate * 1e6 / FRAME)),
                    ("tests_per_s", json!(tests)),
                    ("flops_a_test", json!(FLOPS_A_TEST)),
                    ("flop_per_byte", json!(FLOPS_A_TEST / BYTES_A_TEST)),
                    ("gflops", json!(tests * FLOPS_A_TEST / 1e3)),
                ]));
            }
            rows.push(found);
        }
    }
    let tests: Vec<f64> = rows.iter().filter_map(|row| number(row, "tests_per_s")).collect();
    let (low, high) = tests.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), &t| (low.min(t), high.max(t)));
    let spread = low / high;
    let shares = match (lab.device, rows.last()) {
        (Some(device), Some(last)) if high > 0.0 => {
            (lab.progress)("limits of the device");
            shares_of_limits(&Limits::measure(device, lab.cache)?, last)
        }
        _ => Vec::new(),
    };
    let share = |i: usize| shares.get(i).and_then(|row: &Row| number(row, "limit_share")).unwrap_or(0.0);
    let is_arithmetic = shares.is_empty() || share(0) > share(1).max(share(2));
    let of_limits = shares
        .iter()
        .map(|row| format!("{:.0} % of {}", 100.0 * number(row, "limit_share").unwrap_or(0.0), name(row, "limit")));
    let of_limits = of_limits.collect::<Vec<_>>().join(", ");
    let table = Table::new("rays", "Brute force on cubes", rows);
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| Chart::new(ChartKind::Lines, &table, name, title, ["cubes", y]);
    let mut charts = vec![
        chart("tests", "Triangle tests a second by the number of cubes", "tests_per_s").caption(format!(
            "Camera rays, every triangle tested for every ray; {:.2} operations a byte of vertices, all of which fit into the smallest cache. {note}",
            FLOPS_A_TEST / BYTES_A_TEST
        )),
        chart("frames", "Frames of 640 x 480 a second", "frames_per_s").caption("The same measurements; the table has the operations a second."),
    ];
    let mut tables = vec![table];
    if !shares.is_empty() {
        let caption = format!("With {} cubes; limits by kernels that do nothing else", counts[counts.len() - 1]);
        let limits = Table::new("limits", caption, shares);
        charts.push(
            Chart::new(ChartKind::Bars, &limits, "limits", "Triangle tests by the device's limits", ["limit", "limit_share"])
                .caption("What of each limit the tests take, all measured on this device. No operation is fused, neither in the tests nor in the limit."),
        );
        tables.push(limits);
    }
    let mut verdict = format!(
        "From {} to {} cubes tests a second are within {spread:.2} of each other, at {low:.0} to {high:.0} million.",
        counts[0],
        counts[counts.len() - 1]
    );
    if !of_limits.is_empty() {
        verdict += &format!(" They take {of_limits}.");
    }
    Ok(Findings {
        holds: (tests.len() > 1).then_some(spread > 0.8 && is_arithmetic),
        verdict,
        notes: Vec::new(),
        tables,
        charts,
    })
}

/// How near the measurement of a row comes to each limit of the device.
fn shares_of_limits(limits: &Limits, measured: &Row) -> Vec<Row> {
    const BYTES_A_RAY: usize = size_of::<TraceRay>() + size_of::<Hit>();
    let tests_per_s = 1e6 * number(measured, "tests_per_s").unwrap_or(0.0);
    let rays_per_s = 1e6 * number(measured, "mrays_per_s").unwrap_or(0.0);
    let share = |limit: &str, unit: &str, reached: f64, most: f64| {
        let mut out = row([
            ("limit", json!(limit)),
            ("unit", json!(unit)),
            ("reached", json!(reached / 1e9)),
            ("limit_value", json!(most / 1e9)),
            ("limit_share", json!(reached / most)),
        ]);
        out.extend(["wrong", "tested"].map(|column| (column.to_owned(), measured[column].clone())));
        out
    };
    vec![
        share("arithmetic", "Gflop/s", tests_per_s * FLOPS_A_TEST, limits.flops),
        share("reads of a cache", "GB/s", tests_per_s * BYTES_A_TEST, limits.cached_bytes),
        share("memory", "GB/s", rays_per_s * BYTES_A_RAY as f64, limits.memory_bytes),
    ]
}

pub const RAY_KIND: Study = Study {
    name: "ray-kind",
    title: "Kinds of rays",
    claim: "Thesis, note 9: secondary rays cost more than primary ones, each, because neighbours go different ways.",
    run: ray_kind,
};

fn ray_kind(lab: &mut Lab) -> Result<Findings> {
    let mut variants = vec![Variant::new("kd", with(Accel::Kd)), Variant::new("bvh2", with(Accel::Bvh2))];
    if lab.is_cpu() {
        variants.push(Variant::new("bvh8 in packets", fast_options(lab)));
    }
    if lab.quick {
        variants.remove(1);
    }
    let mut rows = Vec::new();
    for subject in lab.usual_subjects()? {
        rows.extend(lab.compare(&subject, &variants, &ALL_KINDS)?);
        let secondary = subject.secondary(lab.seed);
        rows.extend(lab.compare(&secondary, &variants, &ALL_KINDS)?);
    }
    let mut parts = Vec::new();
    let mut holds = true;
    for variant in &variants {
        let speed = |kind: &str| {
            mean(&rows, "mrays_per_s", |row| name(row, "method") == variant.label && name(row, "rays_of") == kind)
        };
        let Some(camera) = speed("camera") else { continue };
        let ratio = |kind: &str| speed(kind).map(|speed| speed / camera);
        let (Some(reflected), Some(diffuse)) = (ratio("reflected"), ratio("diffuse")) else { continue };
        holds &= reflected < 1.0 && diffuse < 1.0;
        let shuffled = ratio("shuffled").unwrap_or(f64::NAN);
        parts.push(format!(
            "{}: reflected rays have {reflected:.2}, diffuse {diffuse:.2} and shuffled camera rays {shuffled:.2} of the speed of camera rays",
            variant.label
        ));
    }
    let note = error_note(&rows);
    let table = Table::new("rays", "All kinds of rays", rows);
    let charts =
        by_scene(ChartKind::Bars, &table, "speed", "speed by kind of rays", ["rays_of", "mrays_per_s"], |chart| {
            chart.by("method").spread(SPREAD).caption(format!("Exact hits. {note}"))
        });
    let verdict = if parts.is_empty() { "No ray hit anything.".to_owned() } else { parts.join("; ") + "." };
    Ok(Findings {
        holds: (!parts.is_empty()).then_some(holds),
        verdict,
        notes: Vec::new(),
        tables: vec![table],
        charts,
    })
}

pub const TRANSFER: Study = Study {
    name: "transfer",
    title: "What is done beside tracing",
    claim: "Thesis, sections 5.1 and 5.2.2: sending data to the device and back is dear. The claim tested: building, compiling and moving data take \
            longer than one pass of the kernel.",
    run: transfer,
};

fn transfer(lab: &mut Lab) -> Result<Findings> {
    const STEPS: [(&str, &str); 6] = [
        ("build", "build_s"),
        ("compile", "compile_s"),
        ("upload of the scene", "upload_s"),
        ("upload of rays", "rays_upload_s"),
        ("kernel, one pass", "kernel_s"),
        ("read-back of hits", "read_s"),
    ];
    let variant = Variant::new("default", fast_options(lab));
    let mut rows = Vec::new();
    let mut parts = Vec::new();
    let mut holds = true;
    let subjects = lab.usual_subjects()?;
    let found = lab.compare_all(&subjects, &[variant], &[CAMERA])?;
    for measured in &found {
        let seconds = |column: &str| number(measured, column).unwrap_or(0.0);
        let total: f64 = STEPS.iter().map(|(_, column)| seconds(column)).sum();
        for (step, column) in STEPS {
            let mut out = row([
                ("scene", json!(name(measured, "scene"))),
                ("triangles", measured["triangles"].clone()),
                ("step", json!(step)),
                ("seconds", json!(seconds(column))),
                ("share", json!(seconds(column) / total.max(f64::MIN_POSITIVE))),
                ("rays", measured["rays"].clone()),
            ]);
            out.extend(["wrong", "tested"].map(|column| (column.to_owned(), measured[column].clone())));
            rows.push(out);
        }
        let moved = seconds("upload_s") + seconds("rays_upload_s") + seconds("read_s");
        holds &= total > 2.0 * seconds("kernel_s");
        parts.push(format!(
            "{}: of {total:.3} s the kernel takes {:.0} %, moving data {:.0} %, compiling {:.0} %, building {:.0} %",
            name(measured, "scene"),
            100.0 * seconds("kernel_s") / total,
            100.0 * moved / total,
            100.0 * seconds("compile_s") / total,
            100.0 * seconds("build_s") / total
        ));
    }
    let table = Table::new("steps", "Seconds of each part", rows);
    let note = error_note(&found);
    let charts = vec![
        Chart::new(ChartKind::Bars, &table, "steps", "Where the time of a batch goes", ["step", "seconds"])
            .by("scene")
            .log(false, true)
            .caption(format!("Camera rays. Compiling is loading from a cache where there is one. {note}")),
    ];
    Ok(Findings {
        holds: (!parts.is_empty()).then_some(holds),
        verdict: parts.join("; ") + ".",
        notes: Vec::new(),
        tables: vec![table, Table::new("rays", "The measurement", found)],
        charts,
    })
}

pub const CPU_GPU: Study = Study {
    name: "cpu-gpu",
    title: "The device against the scalar reference",
    claim: "Thesis, section 5.8: the GPU is about 3 times as fast as the author's CPU tracer with a kd-tree, about 10 times with brute force.",
    run: cpu_gpu,
};

fn cpu_gpu(lab: &mut Lab) -> Result<Findings> {
    /// Width and height of the reference's picture: brute force through the largest scene takes seconds.
    const REFERENCE_SIDE: u32 = 64;
    let levels: &[u32] = if lab.quick { &[3] } else { &[3, 5, 6] };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let methods = [Accel::Kd, Accel::Brute];
    let mut rows: Vec<Row> = Vec::new();
    let mut measure = |scene_name: &str, scene: crate::scene::Scene, lab: &mut Lab| -> Result<()> {
        let fits = scene.hittable().len() <= 40_000;
        let variants = |device: &str| -> Vec<Variant> {
            let methods = methods.iter().filter(|&&accel| fits || accel != Accel::Brute);
            methods.map(|&accel| Variant::new(accel.name(), with(accel)).with("device", device)).collect()
        };
        if let Some(device) = lab.device {
            let subject = Subject::new(scene_name, scene.clone(), lab.side_for_lists(), lab.seed)?;
            rows.extend(lab.compare(&subject, &variants(&device.info.name), &[CAMERA])?);
        }
        let small = Subject::new(scene_name, scene, REFERENCE_SIDE.min(lab.side()), lab.seed)?;
        for threads in if cores > 1 { vec![1, cores] } else { vec![1] } {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|error| Error::NoDevice(format!("no {threads} threads could be started: {error}")))?;
            let label = format!("reference, {threads} core{}", if threads == 1 { "" } else { "s" });
            let device = lab.device.take();
            let found = pool.install(|| lab.compare(&small, &variants(&label), &[CAMERA]));
            lab.device = device;
            rows.extend(found?);
        }
        Ok(())
    };
    if lab.scenes.is_empty() {
        for &level in levels {
            measure(&format!("boulder {}", 8 << (2 * level)), scenes::boulder(level)?, lab)?;
        }
    } else {
        for (scene_name, scene) in lab.scenes {
            measure(scene_name, scene.clone(), lab)?;
        }
    }
    let ratio = |accel: Accel| {
        let speed = |device: &dyn Fn(&str) -> bool| {
            mean(&rows, "mrays_per_s", |row| name(row, "method") == accel.name() && device(&name(row, "device")))
        };
        let is_reference = |device: &str| device.starts_with("reference, 1 ");
        Some(speed(&|device| !device.starts_with("reference"))? / speed(&is_reference)?)
    };
    let (holds, verdict) = match (ratio(Accel::Kd), ratio(Accel::Brute)) {
        (Some(kd), brute) => {
            let brute_text = brute.map_or_else(String::new, |brute| format!(" and {brute:.1} times with brute force"));
            let holds = brute.map(|brute| kd >= 3.0 && brute >= 10.0);
            (
                holds,
                format!(
                    "The device has {kd:.1} times the speed of one core of the reference with the kd-tree{brute_text}."
                ),
            )
        }
        _ => (None, "The reference was measured alone: there is nothing to compare it with.".to_owned()),
    };
    let note = error_note(&rows);
    let table = Table::new("rays", "Device and reference", rows);
    let charts =
        by_scene(ChartKind::Bars, &table, "speed", "device and reference", ["device", "mrays_per_s"], |chart| {
            let caption = format!("Camera rays, exact hits. {note}");
            chart.by("method").spread(SPREAD).log(false, true).caption(caption)
        });
    Ok(Findings { holds, verdict, notes: Vec::new(), tables: vec![table], charts })
}
