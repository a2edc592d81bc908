//! Kinds of rays, devices, and what is done beside tracing.

use super::super::lookup::geometric_mean;
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Subject, Table, Variant, scenes};
use super::pareto::fast_options;
use super::{ALL_KINDS, BATCH, CAMERA, SPREAD, Verdict, by_scene, error_note, scenes_of, with};
use raybrook::low_level::device::Limits;
use raybrook::low_level::options::{Intersector, StructureKind, TraceOptions};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::{Error, Result};
use serde_json::json;

pub const INTERSECTION: Study = Study {
    name: "intersection",
    title: "Triangle tests a second",
    claim: "Thesis, table 5.1 (section 5.4.3): brute force on 5 to 30 cubes makes 442 to 406 million tests a second, 9 % fewer at the end; it is \
            bound by arithmetic, not by memory. Changing clocks showed that there; here tests a second must stay alike while the triangles grow \
            sixfold, and come nearer to the device's limit of arithmetic than to those of reading.",
    own_shapes: Some("cubes"),
    measure: intersection,
    judge: judge_intersection,
};

/// Moller and Trumbore's test: two edges 6, two cross products 18, four dot products 20, the origin's difference 3, the
/// reciprocal 1, three products with it 3.
const FLOPS_A_TEST: f64 = 51.0;
/// Three vertices of four floats.
const BYTES_A_TEST: f64 = 48.0;
/// Rays of the thesis's picture.
const FRAME: f64 = 640.0 * 480.0;

fn intersection(lab: &mut Lab) -> Result<Vec<Table>> {
    let counts: &[u32] = if lab.quick { &[5, 15, 30] } else { &[5, 10, 15, 20, 25, 30] };
    let options = TraceOptions { intersector: Intersector::MollerTrumbore, ..with(StructureKind::Brute) };
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
    let shares = match (lab.device, rows.last()) {
        (Some(device), Some(last)) if last.contains_key("tests_per_s") => {
            (lab.progress)("limits of the device");
            shares_of_limits(&Limits::measure(device, lab.cache)?, last)
        }
        _ => Vec::new(),
    };
    let mut tables = vec![Table::new("rays", "Brute force on cubes", rows)];
    if !shares.is_empty() {
        let caption = format!("With {} cubes; limits by kernels that do nothing else", counts[counts.len() - 1]);
        tables.push(Table::new("limits", caption, shares));
    }
    Ok(tables)
}

const ARITHMETIC: &str = "arithmetic";
const CACHE: &str = "reads of a cache";
const MEMORY: &str = "memory";

fn judge_intersection(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["cubes"])?;
    let limits = match found.tables.iter().any(|table| table.name == "limits") {
        true => Some(found.table("limits", &["limit"])?),
        false => None,
    };
    let mut verdict = Verdict::default();
    let tests = || table.rows.iter().filter_map(|row| Some((number(row, "tests_per_s")?, name(row, "cubes"))));
    let (low, high) = tests().fold((f64::INFINITY, 0.0_f64), |(low, high), (t, _)| (low.min(t), high.max(t)));
    match (tests().next(), tests().next_back()) {
        (Some((_, first)), Some((_, last))) if first != last => {
            let spread = low / high;
            verdict.say(spread > 0.8, format!(
                "From {first} to {last} cubes tests a second are within {spread:.2} of each other, at {low:.0} to {high:.0} million"
            ));
        }
        _ => verdict.not_measured("tests a second"),
    }
    verdict.holds.push(limits.as_ref().map_or(Ok(None), is_bound_by_arithmetic)?);
    let mut text = verdict.text();
    if let Some(limits) = &limits {
        let share = |row: &Row| Some(format!("{:.0} % of {}", 100.0 * number(row, "limit_share")?, name(row, "limit")));
        let shares = limits.rows.iter().filter_map(share).collect::<Vec<_>>();
        text += &format!(" They take {}.", shares.join(", "));
    } else if !found.header.is_reference() {
        text += " The device's limits were not measured.";
    }
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| Chart::new(ChartKind::Lines, &table, name, title, ["cubes", y]);
    let mut charts = vec![
        chart("tests", "Triangle tests a second by the number of cubes", "tests_per_s").caption(format!(
            "Camera rays, every triangle tested for every ray; {:.2} operations a byte of vertices, all of which fit into the smallest cache. {note}",
            FLOPS_A_TEST / BYTES_A_TEST
        )),
        chart("frames", "Frames of 640 x 480 a second", "frames_per_s").caption("The same measurements; the table has the operations a second."),
    ];
    charts.extend(limits.as_ref().map(|limits| {
        Chart::new(ChartKind::Bars, limits, "limits", "Triangle tests by the device's limits", ["limit", "limit_share"])
            .caption("What of each limit the tests take, all measured on this device. No operation is fused, neither in the tests nor in the limit.")
    }));
    let tables = std::iter::once(table).chain(limits).collect();
    Ok(Findings { verdict: text, ..verdict.findings(tables, charts) })
}

/// Whether the tests come nearer to the limit of arithmetic than to those of reading.
fn is_bound_by_arithmetic(limits: &Table) -> Result<Option<bool>> {
    let share = |limit: &str| Ok(limits.one(&[("limit", limit)])?.and_then(|row| number(row, "limit_share")));
    let (Some(arithmetic), Some(cache), Some(memory)) = (share(ARITHMETIC)?, share(CACHE)?, share(MEMORY)?) else {
        return Ok(None);
    };
    Ok(Some(arithmetic > cache.max(memory)))
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
        share(ARITHMETIC, "Gflop/s", tests_per_s * FLOPS_A_TEST, limits.flops),
        share(CACHE, "GB/s", tests_per_s * BYTES_A_TEST, limits.cached_bytes),
        share(MEMORY, "GB/s", rays_per_s * BYTES_A_RAY as f64, limits.memory_bytes),
    ]
}

pub const RAY_KIND: Study = Study {
    name: "ray-kind",
    title: "Kinds of rays",
    claim: "Thesis, note 9: secondary rays cost more than primary ones, each, because neighbours go different ways.",
    own_shapes: None,
    measure: ray_kind,
    judge: judge_ray_kind,
};

fn ray_kind(lab: &mut Lab) -> Result<Vec<Table>> {
    let mut variants =
        vec![Variant::new("kd", with(StructureKind::Kd)), Variant::new("bvh2", with(StructureKind::Bvh2))];
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
    Ok(vec![Table::new("rays", "All kinds of rays", rows)])
}

fn judge_ray_kind(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &BATCH)?;
    let has = |scene: &str, kind: &str| {
        table.rows.iter().any(|row| name(row, "scene") == scene && name(row, "rays_of") == kind)
    };
    let (hit, missed): (Vec<_>, Vec<_>) =
        scenes_of(&table.rows).into_iter().partition(|scene| has(scene, "reflected") && has(scene, "diffuse"));
    let mut verdict = Verdict::default();
    for method in values(&table.rows, "method") {
        let ratio = |kind: &str| -> Result<Option<f64>> {
            let of_scene = |scene: &String| {
                let key = |kind| [("scene", scene.as_str()), ("method", method.as_str()), ("rays_of", kind)];
                table.ratio("mrays_per_s", &key(kind), &key("camera"), &[])
            };
            Ok(geometric_mean(hit.iter().map(of_scene).collect::<Result<Vec<_>>>()?))
        };
        match (ratio("reflected")?, ratio("diffuse")?, ratio("shuffled")?) {
            (Some(reflected), Some(diffuse), Some(shuffled)) => verdict.say(
                reflected < 1.0 && diffuse < 1.0,
                format!(
                    "{method}: reflected rays have {reflected:.2}, diffuse {diffuse:.2} and shuffled camera rays {shuffled:.2} of the speed of camera rays"
                ),
            ),
            _ if hit.is_empty() => {}
            _ => verdict.not_measured(&method),
        }
    }
    for scene in missed {
        verdict.add(format!("{scene}: no ray hit anything"));
    }
    let note = error_note(&table.rows);
    let charts =
        by_scene(ChartKind::Bars, &table, "speed", "speed by kind of rays", ["rays_of", "mrays_per_s"], |chart| {
            chart.by("method").spread(SPREAD).caption(format!("Exact hits. {note}"))
        });
    Ok(verdict.findings(vec![table], charts))
}

pub const TRANSFER: Study = Study {
    name: "transfer",
    title: "What is done beside tracing",
    claim: "Thesis, sections 5.1 and 5.2.2: sending data to the device and back is dear. The claim tested: building, compiling and moving data take \
            longer than one pass of the kernel.",
    own_shapes: None,
    measure: transfer,
    judge: judge_transfer,
};

/// The parts of a run and their columns.
const STEPS: [(&str, &str); 6] = [
    ("build", "build_s"),
    ("compile", "compile_s"),
    ("upload of the scene", "upload_s"),
    ("upload of rays", "rays_upload_s"),
    ("kernel, one pass", "kernel_s"),
    ("read-back of hits", "read_s"),
];

fn transfer(lab: &mut Lab) -> Result<Vec<Table>> {
    let variant = Variant::new("default", fast_options(lab));
    let subjects = lab.usual_subjects()?;
    let rows = lab.compare_all(&subjects, &[variant], &[CAMERA])?;
    Ok(vec![Table::new("rays", "The measurement", rows)])
}

fn judge_transfer(found: &Measured) -> Result<Findings> {
    let measured = found.table("rays", &["scene"])?;
    let mut rows = Vec::new();
    let mut verdict = Verdict::default();
    for one in &measured.rows {
        let scene = name(one, "scene");
        let seconds: Option<Vec<f64>> = STEPS.iter().map(|(_, column)| number(one, column)).collect();
        let Some(seconds) = seconds.filter(|seconds| seconds.iter().sum::<f64>() > 0.0) else {
            verdict.not_measured(&scene);
            continue;
        };
        let total: f64 = seconds.iter().sum();
        for ((step, _), &seconds) in STEPS.iter().zip(&seconds) {
            let mut out = row([("scene", json!(scene)), ("triangles", one["triangles"].clone())]);
            out.extend(row([
                ("step", json!(step)),
                ("seconds", json!(seconds)),
                ("share", json!(seconds / total)),
                ("rays", one["rays"].clone()),
            ]));
            out.extend(["wrong", "tested"].map(|column| (column.to_owned(), one[column].clone())));
            rows.push(out);
        }
        let [build, compile, upload, rays_upload, kernel, read] = seconds[..] else { continue };
        let percent = |seconds: f64| 100.0 * seconds / total;
        verdict.say(
            total - kernel > kernel,
            format!(
                "{scene}: of {total:.3} s the kernel takes {:.0} %, moving data {:.0} %, compiling {:.0} %, building {:.0} %",
                percent(kernel),
                percent(upload + rays_upload + read),
                percent(compile),
                percent(build)
            ),
        );
    }
    let table = Table::new("steps", "Seconds of each part", rows);
    let note = error_note(&measured.rows);
    let charts = vec![
        Chart::new(ChartKind::Bars, &table, "steps", "Where the time of a batch goes", ["step", "seconds"])
            .by("scene")
            .log(false, true)
            .caption(format!("Camera rays. Compiling is loading from a cache where there is one. {note}")),
    ];
    Ok(verdict.findings(vec![table, measured], charts))
}

pub const CPU_GPU: Study = Study {
    name: "cpu-gpu",
    title: "The device against the scalar reference",
    claim: "Thesis, section 5.8: the GPU is about 3 times as fast as the author's CPU tracer with a kd-tree, about 10 times with brute force. The \
            claim tested: at least so many times as fast as one core of the reference.",
    own_shapes: None,
    measure: cpu_gpu,
    judge: judge_cpu_gpu,
};

fn cpu_gpu(lab: &mut Lab) -> Result<Vec<Table>> {
    /// Width and height of the reference's picture: brute force through the largest scene takes seconds.
    const REFERENCE_SIDE: u32 = 64;
    let levels: &[u32] = if lab.quick { &[3] } else { &[3, 5, 6] };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let methods = [StructureKind::Kd, StructureKind::Brute];
    let mut rows: Vec<Row> = Vec::new();
    let mut measure = |scene_name: &str, scene: raybrook::low_level::scene::Scene, lab: &mut Lab| -> Result<()> {
        let fits = scene.hittable().len() <= 40_000;
        let variants = |device: &str| -> Vec<Variant> {
            let methods = methods.iter().filter(|&&accel| fits || accel != StructureKind::Brute);
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
            let label = reference_on(threads);
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
    Ok(vec![Table::new("rays", "Device and reference", rows)])
}

/// The reference on so many cores, as it is called beside the device.
fn reference_on(cores: usize) -> String {
    format!("reference, {cores} core{}", if cores == 1 { "" } else { "s" })
}

fn judge_cpu_gpu(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "device", "method"])?;
    let mut verdict = Verdict::default();
    if found.header.is_reference() {
        verdict.say(None, "The reference was measured alone: there is nothing to compare it with".to_owned());
    } else {
        let ratio = |accel: StructureKind| {
            let key = |device| [("device", device), ("method", accel.name())];
            table.ratio("mrays_per_s", &key(&found.header.device), &key(&reference_on(1)), &["scene"])
        };
        let (kd, brute) = (ratio(StructureKind::Kd)?, ratio(StructureKind::Brute)?);
        let times = |ratio: Option<f64>| ratio.map_or("(not measured)".to_owned(), |ratio| format!("{ratio:.1}"));
        verdict.say(
            kd.map(|kd| kd >= 3.0),
            format!(
                "The device has {} times the speed of one core of the reference with the kd-tree and {} times with brute force",
                times(kd),
                times(brute)
            ),
        );
        verdict.holds.push(brute.map(|brute| brute >= 10.0));
    }
    let note = error_note(&table.rows);
    let charts =
        by_scene(ChartKind::Bars, &table, "speed", "device and reference", ["device", "mrays_per_s"], |chart| {
            let caption = format!("Camera rays, exact hits. {note}");
            chart.by("method").spread(SPREAD).log(false, true).caption(caption)
        });
    Ok(verdict.findings(vec![table], charts))
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, rays, with_columns};
    use super::*;

    fn cubes(rates: &[(u32, f64)], shares: Option<[f64; 3]>) -> Vec<Table> {
        let rows = rates.iter().map(|(cubes, rate)| {
            row([("cubes", json!(cubes)), ("tests_per_s", json!(rate)), ("wrong", json!(0)), ("tested", json!(9))])
        });
        let limits = shares.map(|shares| {
            // In another order than they are measured in: names tell them apart.
            let rows = [MEMORY, CACHE, ARITHMETIC].iter().zip(shares);
            let rows = rows.map(|(limit, share)| row([("limit", json!(limit)), ("limit_share", json!(share))]));
            Table::new("limits", "", rows.collect())
        });
        std::iter::once(Table::new("rays", "", rows.collect())).chain(limits).collect()
    }

    #[test]
    fn tests_are_bound_by_arithmetic_where_they_stay_alike_and_come_nearest_to_it() {
        let alike = [(5, 100.0), (15, 95.0), (30, 90.0)];
        let holds = |rates: &[(u32, f64)], shares| judge(&INTERSECTION, cubes(rates, shares), &header(false)).unwrap();
        let found = holds(&alike, Some([0.01, 0.3, 0.4]));
        assert_eq!(found.holds, Some(true));
        assert!(found.verdict.starts_with("From 5 to 30 cubes tests a second are within 0.90"), "{}", found.verdict);
        assert_eq!(holds(&alike, Some([0.01, 0.5, 0.4])).holds, Some(false));
        assert_eq!(holds(&[(5, 100.0), (30, 70.0)], Some([0.01, 0.3, 0.4])).holds, Some(false));
        // Without the limits one half of the claim may still fail, and none can hold.
        assert_eq!(holds(&alike, None).holds, None);
        assert_eq!(holds(&[(5, 100.0), (30, 70.0)], None).holds, Some(false));
    }

    #[test]
    fn kinds_of_rays_are_compared_scene_by_scene() {
        let found = |reflected: f64| {
            let kinds = ["camera", "reflected", "diffuse", "shuffled", "camera"];
            let rates = [10.0, reflected, 5.0, 4.0, 1000.0];
            let scenes = ["s", "s", "s", "s", "nothing to hit"];
            let mut rows = rays(&scenes.map(|scene| (scene, "kd", 1.0)));
            for (row, (kind, rate)) in rows[0].rows.iter_mut().zip(kinds.iter().zip(rates)) {
                row.extend(super::row([("rays_of", json!(kind)), ("mrays_per_s", json!(rate))]));
            }
            judge(&RAY_KIND, rows, &header(false)).unwrap()
        };
        // The scene without hits has fast camera rays, and no others to divide by them.
        assert_eq!(found(8.0).holds, Some(true), "{}", found(8.0).verdict);
        assert!(found(8.0).verdict.contains("reflected rays have 0.80, diffuse 0.50 and shuffled camera rays 0.40"));
        assert!(found(8.0).verdict.contains("nothing to hit: no ray hit anything"));
        assert_eq!(found(11.0).holds, Some(false));
    }

    #[test]
    fn what_is_done_beside_tracing_is_compared_with_the_kernel() {
        let found = |kernel: Option<f64>| {
            let rows = with_columns(rays(&[("s", "default", 1.0)]), |_| {
                let mut out = row(STEPS.map(|(_, column)| (column, json!(0.1))));
                out.extend(row([("triangles", json!(12)), ("rays", json!(100))]));
                match kernel {
                    Some(seconds) => out.insert("kernel_s".into(), json!(seconds)),
                    None => out.remove("kernel_s"),
                };
                out
            });
            judge(&TRANSFER, rows, &header(false)).unwrap()
        };
        assert_eq!((found(Some(0.4)).holds, found(Some(0.6)).holds), (Some(true), Some(false)));
        assert!(found(Some(0.5)).verdict.contains("the kernel takes 50 %, moving data 30 %"));
        assert_eq!((found(None).holds, &found(None).verdict[..]), (None, "s: not measured."));
    }

    #[test]
    fn the_device_is_compared_with_one_core_of_the_reference() {
        let found = |brute: f64| {
            let devices = [
                "a device",
                "reference, 1 core",
                "reference, 16 cores",
                "reference board",
                "a device",
                "reference, 1 core",
            ];
            let methods = ["kd", "kd", "kd", "kd", "brute", "brute"];
            let rates = [50.0, 10.0, 1000.0, 7000.0, brute, 1.0];
            let mut rows = rays(&methods.map(|method| ("s", method, 1.0)));
            for (row, (device, rate)) in rows[0].rows.iter_mut().zip(devices.iter().zip(rates)) {
                row.extend(super::row([("device", json!(device)), ("mrays_per_s", json!(rate))]));
            }
            judge(&CPU_GPU, rows, &header(false)).unwrap()
        };
        assert_eq!(found(12.0).holds, Some(true));
        assert!(found(12.0).verdict.contains("5.0 times") && found(12.0).verdict.contains("12.0 times"));
        assert_eq!(found(9.0).holds, Some(false));
    }
}
