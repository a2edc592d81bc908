//! Kinds of rays, devices, and what is done beside tracing.

use super::super::lookup::{Clock, speedup};
use super::super::outcome::{Outcome, Rounds};
use super::super::table::{Row, name, number, row, values};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Subject, Table, Variant, scenes};
use super::pareto::fast_options;
use super::{ALL_KINDS, BATCH, CAMERA, SPREAD, Verdict, by_scene, error_note, in_packets, scenes_of, told, with};
use glam::DVec3;
use raybrook::low_level::device::{DeviceHandle, DeviceKind, Limits, Selection, select};
use raybrook::low_level::options::{Intersector, StructureKind, TraceOptions};
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::{Error, Result};
use serde_json::json;

pub const INTERSECTION: Study = Study {
    name: "intersection",
    title: "Triangle tests a second",
    claim: "Thesis, table 5.1 (section 5.4.3): brute force on 5 to 30 cubes makes 442 to 406 million tests a second, 9 \
            % fewer at the end; it is bound by arithmetic, not by memory. Changing clocks showed that there; here \
            tests a second must stay alike while the triangles grow sixfold, and come nearer to the device's limit of \
            arithmetic than to those of reading.",
    own_shapes: Some("cubes"),
    source: include_str!("rays.rs"),
    measure: intersection,
    judge: judge_intersection,
};

/// Operations of Moller and Trumbore's test up to each place where it may end: after u two edges 6, a cross product 9,
/// two dot products 10, the reciprocal 1, the origin's difference 3 and a product 1; after v another cross product 9,
/// dot product 5, product 1 and the sum 1; after t a dot product 5 and a product 1. A compiler may let a test run on to
/// its end, as those do that trace several rays in step: the first number is the least, the last the most that one
/// takes.
const FLOPS_UP_TO: [f64; 3] = [30.0, 46.0, 52.0];
/// Tests that are looked at to count the operations, at most.
const MOST_COUNTED: usize = 1 << 20;
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
        let flops = least_flops(&subject);
        for mut found in lab.compare(&subject, &[variant], &[CAMERA])? {
            if let Some(rate) = number(&found, "mrays_per_s") {
                let tests = rate * subject.triangle_count as f64;
                found.extend(row([
                    ("frames_per_s", json!(rate * 1e6 / FRAME)),
                    ("tests_per_s", json!(tests)),
                    ("flops_a_test", json!(flops)),
                    ("most_flops_a_test", json!(FLOPS_UP_TO[2])),
                    ("flop_per_byte", json!(flops / BYTES_A_TEST)),
                    ("gflops", json!(tests * flops / 1e3)),
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

/// Operations of a test, on average over tests of the subject's camera rays, if each ends as soon as it can.
fn least_flops(subject: &Subject) -> f64 {
    let rays = subject.camera_rays();
    let count = subject.triangle_count.max(1);
    let step = (rays.len() * count).div_ceil(MOST_COUNTED).max(1);
    let ends = rays.iter().step_by(step).flat_map(|&(origin, direction)| {
        subject.triangles().map(move |corners| FLOPS_UP_TO[end_of_test(origin, direction, corners)])
    });
    let (sum, tests) = ends.fold((0.0, 0.0), |(sum, tests), flops| (sum + flops, tests + 1.0));
    if tests > 0.0 { sum / tests } else { FLOPS_UP_TO[2] }
}

/// Which of [`FLOPS_UP_TO`] a test ends at.
fn end_of_test(origin: DVec3, direction: DVec3, [p0, p1, p2]: [DVec3; 3]) -> usize {
    let (edge1, edge2, from_p0) = (p1 - p0, p2 - p0, origin - p0);
    let p = direction.cross(edge2);
    let inv_det = 1.0 / edge1.dot(p);
    let u = from_p0.dot(p) * inv_det;
    let v = direction.dot(from_p0.cross(edge1)) * inv_det;
    match (u >= 0.0, v >= 0.0 && u + v <= 1.0) {
        (false, _) => 0,
        (true, false) => 1,
        (true, true) => 2,
    }
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
    let timed = || table.rows.iter().filter(|row| row.contains_key("tests_per_s"));
    let rate = |row: &Row| number(row, "tests_per_s").unwrap_or(0.0);
    let slowest = timed().min_by(|a, b| rate(a).total_cmp(&rate(b)));
    let fastest = timed().max_by(|a, b| rate(a).total_cmp(&rate(b)));
    match slowest.zip(fastest).and_then(|(slow, fast)| Some((slow, fast, tests_ratio(slow, fast)?))) {
        Some((slow, fast, ratio)) if slow != fast => verdict.say(
            ratio.above(0.8),
            format!(
                "With {} cubes there are {ratio} times as many tests a second as with {}: {:.0} to {:.0} million",
                name(slow, "cubes"),
                name(fast, "cubes"),
                rate(slow),
                rate(fast)
            ),
        ),
        _ => verdict.not_measured("tests a second"),
    }
    verdict.outcomes.push(limits.as_ref().map_or(Ok(Outcome::Undecided), is_bound_by_arithmetic)?);
    let mut text = verdict.text();
    if let Some(limits) = &limits {
        let share = |row: &Row| Some(format!("{:.0} % of {}", 100.0 * number(row, "limit_share")?, name(row, "limit")));
        let shares = limits.rows.iter().filter_map(share).collect::<Vec<_>>();
        text += &format!(" The tests take {}.", shares.join(", "));
    } else if !found.header.is_reference() {
        text += " The device's limits were not measured.";
    }
    let note = error_note(&table.rows);
    let chart = |name: &str, title: &str, y: &str| Chart::new(ChartKind::Lines, &table, name, title, ["cubes", y]);
    let intensity = table.rows.last().and_then(|row| number(row, "flop_per_byte")).unwrap_or(0.0);
    let mut charts = vec![
        chart("tests", "Triangle tests a second by the number of cubes", "tests_per_s").caption(format!(
            "Camera rays, every triangle tested for every ray; {intensity:.2} operations a byte of vertices, counted \
             test by test up to where each may end. The vertices fit into the smallest cache. {note}"
        )),
        chart("frames", "Frames of 640 x 480 a second", "frames_per_s")
            .caption("The same measurements; the table has the operations a second."),
    ];
    charts.extend(limits.as_ref().map(|limits| {
        Chart::new(ChartKind::Bars, limits, "limits", "Triangle tests by the device's limits", ["limit", "limit_share"])
            .caption(
                "What of each limit the tests take, all measured on this device. Operations are the fewest that the \
                 tests need: where several rays go in step, a test runs on while one of them needs it. No operation is \
                 fused, neither in the tests nor in the limit.",
            )
    }));
    let tables = std::iter::once(table).chain(limits).collect();
    Ok(Findings { verdict: text, ..verdict.findings(tables, charts) })
}

/// How many times the tests a second of `fast` there are of `slow`.
fn tests_ratio(slow: &Row, fast: &Row) -> Option<Rounds> {
    let triangles = number(slow, "triangles")? / number(fast, "triangles")?;
    Some(speedup(&[[slow, fast]], Clock::Ray)?.times(triangles))
}

/// Whether the tests come nearer to the limit of arithmetic than to those of reading. Limits are measured once, each by
/// the fastest of several launches.
fn is_bound_by_arithmetic(limits: &Table) -> Result<Outcome> {
    let share = |limit: &str| Ok(limits.one(&[("limit", limit)])?.and_then(|row| number(row, "limit_share")));
    let (Some(arithmetic), Some(cache), Some(memory)) = (share(ARITHMETIC)?, share(CACHE)?, share(MEMORY)?) else {
        return Ok(Outcome::Undecided);
    };
    Ok(Outcome::of(arithmetic > cache.max(memory)))
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
        share(ARITHMETIC, "Gflop/s", 1e9 * number(measured, "gflops").unwrap_or(0.0), limits.flops),
        share(CACHE, "GB/s", tests_per_s * BYTES_A_TEST, limits.cached_bytes),
        share(MEMORY, "GB/s", rays_per_s * BYTES_A_RAY as f64, limits.memory_bytes),
    ]
}

pub const RAY_KIND: Study = Study {
    name: "ray-kind",
    title: "Kinds of rays",
    claim: "Thesis, note 9: secondary rays cost more than primary ones, each, because neighbours go different ways.",
    own_shapes: None,
    source: include_str!("rays.rs"),
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
        let ratio = |kind: &str| -> Result<Option<Rounds>> {
            let mut pairs = Vec::new();
            for scene in &hit {
                let key = |kind| [("scene", scene.as_str()), ("method", method.as_str()), ("rays_of", kind)];
                match table.pairs(&key(kind), &key("camera"), &[])? {
                    Some(found) => pairs.extend(found),
                    None => return Ok(None),
                }
            }
            Ok(speedup(&pairs, Clock::Ray))
        };
        match (ratio("reflected")?, ratio("diffuse")?, ratio("shuffled")?) {
            (Some(reflected), Some(diffuse), Some(shuffled)) => verdict.say(
                Outcome::all([reflected.below(1.0), diffuse.below(1.0)]),
                format!(
                    "{method}: reflected rays have {reflected}, diffuse {diffuse} and shuffled camera rays {shuffled} \
                     of the speed of camera rays"
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
    claim: "Thesis, sections 5.1 and 5.2.2: sending data to the device and back is dear. The claim tested: building, \
            compiling and moving data take longer than one pass of the kernel.",
    own_shapes: None,
    source: include_str!("rays.rs"),
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
    let mut rows = Vec::new();
    for subject in lab.usual_subjects()? {
        lab.forget_programs();
        rows.extend(lab.compare(&subject, std::slice::from_ref(&variant), &[CAMERA])?);
    }
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
        let kernels = Clock::Ray.times(one).unwrap_or_default();
        let rays = number(one, "rays").unwrap_or(0.0);
        let to_kernel = kernels.iter().map(|seconds_a_ray| (total - kernel) / (seconds_a_ray * rays));
        let outcome = Rounds::new(to_kernel.collect()).map_or(Outcome::Undecided, |ratio| ratio.above(1.0));
        verdict.say(
            outcome,
            format!(
                "{scene}: of {total:.3} s the kernel takes {:.0} %, moving data {:.0} %, compiling {:.0} %, building \
                 {:.0} %",
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
    title: "The GPU against the processor",
    claim: "Thesis, section 5.8: the GPU is about 3 times as fast as the author's CPU tracer with a kd-tree, about 10 \
            times with brute force. The claim tested: at least so many times as fast as the fastest way on all cores \
            of this computer's processor.",
    own_shapes: None,
    source: include_str!("rays.rs"),
    measure: cpu_gpu,
    judge: judge_cpu_gpu,
};

/// The roles in the comparison.
const GPU: &str = "GPU";
const CPU: &str = "processor, OpenCL";

fn cpu_gpu(lab: &mut Lab) -> Result<Vec<Table>> {
    let levels: &[u32] = if lab.quick { &[3] } else { &[3, 5, 6] };
    let processor = processor(lab);
    let mut rows: Vec<Row> = Vec::new();
    if lab.scenes.is_empty() {
        for &level in levels {
            let name = format!("boulder {}", 8 << (2 * level));
            rows.extend(on_both(lab, processor.as_ref(), &name, &scenes::boulder(level)?)?);
        }
    } else {
        for (name, scene) in lab.scenes {
            rows.extend(on_both(lab, processor.as_ref(), name, scene)?);
        }
    }
    Ok(vec![Table::new("rays", "GPU, processor and reference", rows)])
}

/// The processor as an OpenCL device: the lab's own, or another one.
fn processor(lab: &Lab) -> Option<DeviceHandle> {
    match lab.device {
        Some(device) if device.info.kind == DeviceKind::Cpu => Some(device.clone()),
        // Without one the reference has to do.
        Some(_) => match select(Some("cpu")) {
            Ok(Selection::OpenCl(handle)) => Some(handle),
            _ => None,
        },
        None => None,
    }
}

/// The rows of a scene on the lab's device, on the processor, and on the reference with one core and with all.
fn on_both(lab: &mut Lab, processor: Option<&DeviceHandle>, scene_name: &str, scene: &Scene) -> Result<Vec<Row>> {
    /// Width and height of the reference's picture: brute force through the largest scene takes seconds.
    const REFERENCE_SIDE: u32 = 64;
    let fits = scene.hittable().len() <= 40_000;
    let variants = |device: &str, has_packets: bool| -> Vec<Variant> {
        let packets = has_packets.then(|| ("kd", in_packets(StructureKind::Kd)));
        let kd = packets.unwrap_or(("kd", with(StructureKind::Kd)));
        let brute = fits.then(|| ("brute", with(StructureKind::Brute)));
        let methods = [Some(kd), brute].into_iter().flatten();
        methods.map(|(name, options)| Variant::new(name, options).with("device", device)).collect()
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut rows = Vec::new();
    let subject = Subject::new(scene_name, scene.clone(), lab.side_for_lists(), lab.seed)?;
    if lab.device.is_some_and(|device| device.info.kind != DeviceKind::Cpu) {
        rows.extend(lab.compare(&subject, &variants(GPU, false), &[CAMERA])?);
    }
    if let Some(processor) = processor {
        rows.extend(lab.on(Some(processor), |lab| lab.compare(&subject, &variants(CPU, true), &[CAMERA]))?);
    }
    let small = Subject::new(scene_name, scene.clone(), REFERENCE_SIDE.min(lab.side()), lab.seed)?;
    for threads in if cores > 1 { vec![1, cores] } else { vec![1] } {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|error| Error::NoDevice(format!("no {threads} threads could be started: {error}")))?;
        let variants = variants(&reference_on(threads), false);
        rows.extend(pool.install(|| lab.on(None, |lab| lab.compare(&small, &variants, &[CAMERA])))?);
    }
    Ok(rows)
}

/// The reference on so many cores, as it is called beside the device.
fn reference_on(cores: usize) -> String {
    format!("reference, {cores} core{}", if cores == 1 { "" } else { "s" })
}

fn judge_cpu_gpu(found: &Measured) -> Result<Findings> {
    let table = found.table("rays", &["scene", "device", "method"])?;
    let mut verdict = Verdict::default();
    let has = |device: &str| table.rows.iter().any(|row| name(row, "device") == device);
    let ratio = |a: &str, b: &str, method: &str| {
        let key = |device| [("device", device), ("method", method)];
        table.speedup(Clock::Ray, &key(a), &key(b), &["scene"])
    };
    match (has(GPU), has(CPU)) {
        (true, true) => {
            let (kd, brute) = (ratio(GPU, CPU, "kd")?, ratio(GPU, CPU, "brute")?);
            let limits = [(&kd, 3.0), (&brute, 10.0)];
            let outcomes =
                limits.map(|(ratio, limit)| ratio.as_ref().map_or(Outcome::Undecided, |ratio| ratio.above(limit)));
            verdict.say(
                Outcome::all(outcomes),
                format!(
                    "the GPU has {} times the speed of the processor with the kd-tree (there in packets) and {} times \
                     with brute force",
                    told(kd.as_ref()),
                    told(brute.as_ref())
                ),
            );
        }
        (true, false) => verdict.leave_open(
            "this computer's processor is no OpenCL device here, so that the GPU was measured against the slow \
             reference alone"
                .to_owned(),
        ),
        (false, _) => verdict.leave_open("no GPU was measured".to_owned()),
    }
    let fast = if has(GPU) { GPU } else { CPU };
    if let (Some(kd), Some(brute)) = (ratio(fast, &reference_on(1), "kd")?, ratio(fast, &reference_on(1), "brute")?) {
        verdict.add(format!("the {fast} has {kd:.0} and {brute:.0} times the speed of one core of the reference"));
    }
    let note = error_note(&table.rows);
    let charts = by_scene(
        ChartKind::Bars,
        &table,
        "speed",
        "GPU, processor and reference",
        ["device", "mrays_per_s"],
        |chart| {
            let caption = format!("Camera rays, exact hits; the processor's kd-tree in packets, on all cores. {note}");
            chart.by("method").spread(SPREAD).log(false, true).caption(caption)
        },
    );
    Ok(verdict.findings(vec![table], charts))
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge, rays, rounds, timed, with_columns};
    use super::*;

    fn cubes(rates: &[(u32, f64)], shares: Option<[f64; 3]>) -> Vec<Table> {
        let rows = rates.iter().map(|(cubes, rate)| {
            let triangles = f64::from(12 * cubes);
            let mut out = row([("cubes", json!(cubes)), ("triangles", json!(triangles)), ("tests_per_s", json!(rate))]);
            out.extend(row([("wrong", json!(0)), ("tested", json!(9))]));
            out.extend(timed(rate / triangles));
            out
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
        assert_eq!(found.outcome, Outcome::Holds);
        assert!(
            found.verdict.starts_with("With 30 cubes there are 0.90 [0.90, 0.90] times as many"),
            "{}",
            found.verdict
        );
        assert_eq!(holds(&alike, Some([0.01, 0.5, 0.4])).outcome, Outcome::Fails);
        assert_eq!(holds(&[(5, 100.0), (30, 70.0)], Some([0.01, 0.3, 0.4])).outcome, Outcome::Fails);
        // Without the limits one half of the claim may still fail, and none can hold.
        assert_eq!(holds(&alike, None).outcome, Outcome::Undecided);
        assert_eq!(holds(&[(5, 100.0), (30, 70.0)], None).outcome, Outcome::Fails);
    }

    #[test]
    fn kinds_of_rays_are_compared_scene_by_scene() {
        let found = |reflected: f64| {
            let kinds = ["camera", "reflected", "diffuse", "shuffled", "camera"];
            let rates = [10.0, reflected, 5.0, 4.0, 1000.0];
            let scenes = ["s", "s", "s", "s", "nothing to hit"];
            let mut rows = rays(&scenes.map(|scene| (scene, "kd", 1.0)));
            for (row, (kind, rate)) in rows[0].rows.iter_mut().zip(kinds.iter().zip(rates)) {
                row.extend(super::row([("rays_of", json!(kind))]));
                row.extend(timed(rate));
            }
            judge(&RAY_KIND, rows, &header(false)).unwrap()
        };
        // The scene without hits has fast camera rays, and no others to divide by them.
        assert_eq!(found(8.0).outcome, Outcome::Holds, "{}", found(8.0).verdict);
        assert!(
            found(8.0)
                .verdict
                .contains("reflected rays have 0.80 [0.80, 0.80], diffuse 0.50 [0.50, 0.50] and shuffled")
        );
        assert!(found(8.0).verdict.contains("nothing to hit: no ray hit anything"));
        assert_eq!(found(11.0).outcome, Outcome::Fails);
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
                out.extend(kernel.map(|seconds| ("rounds_s".to_owned(), rounds(seconds))));
                out
            });
            judge(&TRANSFER, rows, &header(false)).unwrap()
        };
        let outcome = |kernel: f64| found(Some(kernel)).outcome;
        assert_eq!([outcome(0.4), outcome(0.6)], [Outcome::Holds, Outcome::Fails]);
        // The rounds lie on either side.
        assert_eq!(outcome(0.4995), Outcome::Undecided);
        assert!(found(Some(0.5)).verdict.contains("the kernel takes 50 %, moving data 30 %"));
        assert_eq!((found(None).outcome, &found(None).verdict[..]), (Outcome::Undecided, "s: not measured."));
    }

    #[test]
    fn the_gpu_is_compared_with_the_fastest_way_on_the_processor() {
        let found = |brute: f64, processor: &str| {
            let devices =
                [GPU, processor, "reference, 1 core", "reference, 16 cores", GPU, processor, "reference, 1 core"];
            let methods = ["kd", "kd", "kd", "kd", "brute", "brute", "brute"];
            let rates = [50.0, 10.0, 0.1, 1000.0, brute, 1.0, 0.01];
            let mut rows = rays(&methods.map(|method| ("s", method, 1.0)));
            for (row, (device, rate)) in rows[0].rows.iter_mut().zip(devices.iter().zip(rates)) {
                row.insert("device".into(), json!(device));
                row.extend(timed(rate));
            }
            judge(&CPU_GPU, rows, &header(false)).unwrap()
        };
        let holds = found(12.0, CPU);
        assert_eq!(holds.outcome, Outcome::Holds, "{}", holds.verdict);
        let ratios = ["has 5.00 [5.00, 5.00] times", "and 12.00 [12.00, 12.00] times", "has 500 [500, 500] and 1200"];
        assert!(ratios.iter().all(|ratio| holds.verdict.contains(ratio)), "{}", holds.verdict);
        assert_eq!(found(9.0, CPU).outcome, Outcome::Fails);
        // The slow reference is no measure.
        assert_eq!(found(12.0, "something else").outcome, Outcome::Undecided);
    }
}
