//! Measures: methods over the same rays by turns, each with its errors and its counted work.

mod cases;
mod pictures;
mod subject;

pub use pictures::PictureVariant;
pub use subject::Subject;

use super::bound::{lower_bound, upper_bound};
use super::journal::Journal;
use super::lookup::Clock;
use super::peers::Peer;
use super::scenes;
use super::table::{Row, number, row};
use raybrook::Result;
use raybrook::low_level::accel::{Aabb, BuildOptions, KdTree, Measure, expected_cost};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::choose::tune::Batch;
use raybrook::low_level::device::{Cache, DeviceContext, DeviceHandle, DeviceKind};
use raybrook::low_level::options::{PacketSize, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::WorkCounter;
use raybrook::low_level::stats::median;
use raybrook::low_level::tracer::{Backend, TraceJob, require_clock};
use raybrook::low_level::work::WorkSum;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Rays of a batch whose work is counted, at most: the reference does that, ray by ray.
const MOST_COUNTED: usize = 1 << 15;

/// With fewer nothing is ever decided (see [`Rounds`](super::outcome::Rounds)).
const FEWEST_ROUNDS: usize = 5;
/// Measurements that take longer have [`FEWEST_ROUNDS`].
const LONGEST_ROUNDS: Duration = Duration::from_secs(120);

/// Triangles of all structures that are kept at a time: each takes up to a kilobyte, on the host and on the device.
const MOST_TRIANGLES_AT_A_TIME: usize = 8_000_000;

/// Where studies are made, and how thoroughly.
pub struct Lab<'a> {
    /// The device; `None`: the reference.
    pub device: Option<&'a DeviceHandle>,
    /// Where compiled kernels are kept.
    pub cache: Option<&'a Cache>,
    /// The user's scenes, by name; empty: those of the program.
    pub scenes: &'a [(String, Scene)],
    /// A minute instead of an hour.
    pub quick: bool,
    /// Of all random numbers.
    pub seed: u64,
    /// What is being done.
    pub progress: &'a (dyn Fn(&str) + Sync),
    /// How much memory each structure may take; `None`: what there is when it is built.
    pub memory: Option<MemoryBudget>,
    /// Results of other tracers, which `pareto` shows beside the program's own.
    pub peers: Vec<Peer>,
    pub(super) journal: Journal,
    /// The device, held open, so that its tracers share compiled kernels.
    opened: Option<DeviceContext>,
}

/// A method as it is told of, and its parameters as columns.
pub struct Variant {
    /// Its name.
    pub label: String,
    /// What it is.
    pub options: TraceOptions,
    /// Further columns of its rows.
    pub columns: Row,
}

impl Variant {
    /// A method of that name.
    pub fn new(label: impl Into<String>, options: TraceOptions) -> Variant {
        Variant { label: label.into(), options, columns: Row::new() }
    }

    /// With a further column.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Variant {
        self.columns.insert(name.to_owned(), value.into());
        self
    }
}

/// A method that is ready to trace, and what came of it.
struct Run {
    tracer: Box<dyn Backend>,
    /// Seconds of each pass of each batch.
    seconds: [Vec<f64>; 3],
    rows: [Row; 3],
}

/// The device, opened. Why it does not open the first tracer tells.
fn hold_open(device: Option<&DeviceHandle>) -> Option<DeviceContext> {
    device.and_then(|device| DeviceContext::open(device).ok())
}

impl<'a> Lab<'a> {
    /// A lab on `device`, or on the reference when there is none.
    pub fn new(
        device: Option<&'a DeviceHandle>,
        cache: Option<&'a Cache>,
        scenes: &'a [(String, Scene)],
        quick: bool,
        seed: u64,
        progress: &'a (dyn Fn(&str) + Sync),
    ) -> Lab<'a> {
        Lab {
            device,
            cache,
            scenes,
            quick,
            seed,
            progress,
            memory: None,
            peers: Vec::new(),
            journal: Journal::default(),
            opened: hold_open(device),
        }
    }

    /// Has the next tracer compile its kernels, or load them from a cache, as in a new process.
    pub(super) fn forget_programs(&self) {
        if let Some(device) = &self.opened {
            device.forget_programs();
        }
    }

    /// What `measure` measures on another device; `None`: on the reference.
    pub(super) fn on<T>(
        &mut self,
        device: Option<&DeviceHandle>,
        measure: impl FnOnce(&mut Lab) -> Result<T>,
    ) -> Result<T> {
        let Lab { cache, scenes, quick, seed, progress, memory, .. } = *self;
        let journal = std::mem::take(&mut self.journal);
        let opened = hold_open(device);
        let mut other =
            Lab { device, cache, scenes, quick, seed, progress, memory, peers: Vec::new(), journal, opened };
        let found = measure(&mut other);
        self.journal = other.journal;
        found
    }

    /// Packs a scene in the memory that there may be.
    pub(super) fn pack(&self, scene: &Scene, options: &TraceOptions) -> Result<SceneBuffers> {
        SceneBuffers::within(scene, options, &self.memory.unwrap_or_else(MemoryBudget::available))
    }

    /// Rounds in which everything is timed by turns. Of five rounds the sign test decides if all agree, of nine if
    /// eight do.
    pub fn rounds(&self) -> usize {
        if self.quick { FEWEST_ROUNDS } else { 9 }
    }

    /// Whether another round is due, when so many are done since `start`.
    fn goes_on(&self, done: usize, start: Instant) -> bool {
        done < FEWEST_ROUNDS || done < self.rounds() && start.elapsed() < LONGEST_ROUNDS
    }

    /// Width and height of the picture whose camera rays are traced; on the reference fewer.
    pub fn side(&self) -> u32 {
        match (self.quick, self.device.is_some()) {
            (true, false) => 32,
            (true, true) => 128,
            (false, false) => 128,
            (false, true) => 512,
        }
    }

    /// The same where rays look at hundreds or thousands of triangles each: fewer unless the device is a GPU.
    pub fn side_for_lists(&self) -> u32 {
        match self.device {
            Some(device) if device.info.kind == DeviceKind::Gpu => self.side(),
            _ => (self.side() / 4).max(16),
        }
    }

    /// The user's scenes, or else those that `own` makes.
    ///
    /// # Errors
    /// As [`Subject::new`].
    pub fn subjects(&self, own: &[(&str, &dyn Fn() -> Result<Scene>)]) -> Result<Vec<Subject>> {
        if self.scenes.is_empty() {
            return own.iter().map(|(name, make)| self.subject(name, make()?)).collect();
        }
        self.scenes.iter().map(|(name, scene)| self.subject(name, scene.clone())).collect()
    }

    /// A scene with as many rays as the lab traces.
    ///
    /// # Errors
    /// As [`Subject::new`].
    pub fn subject(&self, name: &str, scene: Scene) -> Result<Subject> {
        Subject::new(name, scene, self.side(), self.seed)
    }

    /// The scenes of studies of structures: the user's, or one that is round and even, and, unless in a hurry, one of
    /// long thin triangles that lie askew.
    ///
    /// # Errors
    /// As [`Subject::new`].
    pub fn usual_subjects(&self) -> Result<Vec<Subject>> {
        let [boulder, hall] = ["boulder", "hall"].map(|name| move || scenes::named(name, self.quick));
        match self.quick {
            true => self.subjects(&[("boulder", &boulder)]),
            false => self.subjects(&[("boulder", &boulder), ("hall", &hall)]),
        }
    }

    /// Traces rays of `kinds` (numbers of batches) by turns with all `variants`, and tells of each what it took, what
    /// was wrong and, counted by the reference's twin on a part of the rays, its work: one row for each variant and
    /// kind that has rays. Of large scenes only as many structures are kept at a time as memory may hold, and take
    /// turns.
    ///
    /// # Errors
    /// As [`SceneBuffers::new`], [`open_tracer`] and [`Backend::trace`].
    pub fn compare(&mut self, subject: &Subject, variants: &[Variant], kinds: &[usize]) -> Result<Vec<Row>> {
        let at_a_time = (MOST_TRIANGLES_AT_A_TIME / subject.triangle_count.max(1)).max(1);
        let parts = variants.chunks(at_a_time).map(|variants| self.compare_by_turns(subject, variants, kinds));
        Ok(parts.collect::<Result<Vec<_>>>()?.concat())
    }

    fn compare_by_turns(&mut self, subject: &Subject, variants: &[Variant], kinds: &[usize]) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants.iter().map(|v| json!([v.label, v.options, v.columns])).collect();
        let batches: Vec<_> = subject.batches.iter().map(|batch| json!([batch.name, batch.rays.len()])).collect();
        let key = json!(["compare", subject.name, subject.fingerprint, batches, settings, kinds]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        let kinds: Vec<_> = kinds.iter().copied().filter(|&kind| !subject.batches[kind].rays.is_empty()).collect();
        let mut runs = Vec::new();
        for (i, variant) in variants.iter().enumerate() {
            (self.progress)(&format!("{}: {} of {}: {}", subject.name, i + 1, variants.len(), variant.label));
            runs.push(self.start(subject, variant, &kinds)?);
        }
        let start = Instant::now();
        let mut round = 0;
        while self.goes_on(round, start) {
            for &kind in &kinds {
                // Each time another one begins: what a pause before it does to clocks and caches is shared out.
                for turn in 0..runs.len() {
                    let next = (turn + round) % runs.len();
                    let result = runs[next].tracer.trace(&job(&subject.batches[kind]), &|_| ())?;
                    require_clock(runs[next].tracer.as_ref())?;
                    // Sorting a shuffled batch is part of tracing it.
                    let sorting = result.sort_s.unwrap_or(0.0);
                    runs[next].seconds[kind].extend(result.kernel_s.iter().map(|seconds| seconds + sorting));
                }
            }
            round += 1;
        }
        let mut rows = Vec::new();
        for Run { seconds, rows: mut unfinished, .. } in runs {
            for &kind in &kinds {
                let ray_count = subject.batches[kind].rays.len();
                rows.push(with_rate(std::mem::take(&mut unfinished[kind]), ray_count, &seconds[kind]));
            }
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }

    /// Builds, compiles, traces each batch once without timing it (drivers do much at a first launch), judges and
    /// counts.
    fn start(&self, subject: &Subject, variant: &Variant, kinds: &[usize]) -> Result<Run> {
        let options = variant.options;
        let buffers = Arc::new(self.pack(&subject.scene, &options)?);
        let mut tracer = open_tracer(self.device, &buffers, &options, 1, self.cache)?;
        let device_bytes = buffers.size_bytes(&options);
        let mut rows = [(); 3].map(|()| Row::new());
        for &kind in kinds {
            let batch = &subject.batches[kind];
            let result = tracer.trace(&job(batch), &|_| ())?;
            let (wrong, largest_t_ulp) = subject.judge(kind, &result.hits);
            let mut out = row([
                ("scene", json!(subject.name)),
                ("triangles", json!(subject.triangle_count)),
                ("method", json!(variant.label)),
                ("rays_of", json!(batch.name)),
            ]);
            out.insert("structure".into(), json!(options.kind().name()));
            out.extend(variant.columns.clone());
            out.extend(promise(&options));
            out.extend(tree_cost(&buffers, &options));
            out.extend(errors(wrong, batch.rays.len()));
            out.insert("largest_t_ulp".into(), json!(largest_t_ulp));
            out.extend(self.count(&buffers, &options, batch)?);
            out.extend(row([
                ("build_s", json!(buffers.build_s)),
                ("compile_s", json!(tracer.compile_s())),
                ("upload_s", json!(tracer.upload_s())),
                ("rays_upload_s", json!(result.upload_s)),
                ("read_s", json!(result.read_s)),
                ("device_bytes", json!(device_bytes)),
                ("bytes_per_triangle", json!(device_bytes as f64 / subject.triangle_count.max(1) as f64)),
            ]));
            rows[kind] = out;
        }
        Ok(Run { tracer, seconds: [const { Vec::new() }; 3], rows })
    }

    /// Means of the counted work on rays spread over the batch. The twin counts what the device does, ray by ray.
    fn count(&self, buffers: &Arc<SceneBuffers>, options: &TraceOptions, batch: &Batch) -> Result<Row> {
        let step = batch.rays.len().div_ceil(if self.quick { MOST_COUNTED / 16 } else { MOST_COUNTED }).max(1);
        let rays: Vec<_> = batch.rays.iter().step_by(step).copied().collect();
        let options = TraceOptions { counters: true, packet_size: PacketSize::One, ..*options };
        let buffers = match buffers.check_made_for(&options) {
            Ok(()) => buffers.clone(),
            // A tree for packets has leaves of its own: counted ray by ray it would not say what the packets did.
            Err(_) => return Ok(Row::new()),
        };
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: batch.any_hit, repeat: 1 };
        let work = ReferenceBackend::new(buffers, options).trace(&job, &|_| ())?.work.unwrap_or_default();
        let sum = WorkSum::new(rays.len() as u64, work);
        let mean = |counter| json!(sum.mean(counter));
        Ok(row([
            ("steps", mean(WorkCounter::Steps)),
            ("leaves", mean(WorkCounter::Leaves)),
            ("tests", mean(WorkCounter::Tests)),
            ("restarts", mean(WorkCounter::Restarts)),
            ("node_bytes", mean(WorkCounter::NodeBytes)),
            ("triangle_bytes", mean(WorkCounter::TriangleBytes)),
            ("bytes_a_ray", json!(sum.mean(WorkCounter::NodeBytes) + sum.mean(WorkCounter::TriangleBytes))),
            ("deepest_stack", json!(sum.get(WorkCounter::DeepestStack))),
        ]))
    }
}

fn job(batch: &Batch) -> TraceJob<'_> {
    TraceJob { extreme: &[], rays: &batch.rays, next_directions: None, any_hit: batch.any_hit, repeat: 1 }
}

/// The expected cost of a kd-tree, counted alike for all.
fn tree_cost(buffers: &SceneBuffers, options: &TraceOptions) -> Row {
    if options.kind() != StructureKind::Kd {
        return Row::new();
    }
    let bounds = Aabb { low: buffers.params.low.xyz(), high: buffers.params.high.xyz() };
    let tree = KdTree { nodes: buffers.nodes.clone(), references: buffers.references.clone(), bounds };
    let costs = BuildOptions { cost_traverse: 1.0, cost_intersect: 1.0, ..buffers.build_options };
    row([("tree_cost", json!(expected_cost(&tree, Measure::Surface, &costs)))])
}

/// The columns of so many wrong answers of so many.
pub fn errors(wrong: usize, tested: usize) -> Row {
    let (low, high) = (lower_bound(wrong as u64, tested as u64), upper_bound(wrong as u64, tested as u64));
    row([
        ("wrong", json!(wrong)),
        ("tested", json!(tested)),
        ("wrong_per_million", json!(wrong as f64 * 1e6 / tested.max(1) as f64)),
        ("wrong_low", json!(low * 1e6)),
        ("wrong_bound", json!(high * 1e6)),
    ])
}

/// The columns of so many answers of so many that name another triangle than exact arithmetic, or none.
pub fn differences(differing: usize, tested: usize) -> Row {
    let (count, of) = (differing as u64, tested as u64);
    row([
        ("differing", json!(differing)),
        ("differing_low", json!(lower_bound(count, of) * 1e6)),
        ("differing_bound", json!(upper_bound(count, of) * 1e6)),
    ])
}

/// What is claimed of methods whose hits are those of exact arithmetic.
pub const EXACT: &str = "exact by construction";

/// What is claimed of a method, whatever a run finds.
fn promise(options: &TraceOptions) -> Row {
    let is_exact = options.is_exact();
    is_exact.then(|| ("promise".to_owned(), json!(EXACT))).into_iter().collect()
}

/// A row of an earlier version of the program as this one has it: its bound of wrong answers was k/N or 3/N, its
/// seconds left out the host's pass over textures, and the wavefront kernels had another name.
pub(super) fn bring_up_to_date(row: &mut Row) {
    for column in ["method", "kernels"] {
        if let Some(name) = row.get(column).and_then(Value::as_str).and_then(with_wavefront_kernels) {
            row.insert(column.to_owned(), json!(name));
        }
    }
    let count = |row: &Row, column: &str| row.get(column).and_then(Value::as_u64);
    if let (true, Some(wrong), Some(tested)) =
        (row.contains_key("wrong_bound"), count(row, "wrong"), count(row, "tested"))
    {
        row.extend(errors(wrong as usize, tested as usize));
    }
    let Some(host_s) = row.shift_remove("host_pass_s").and_then(|seconds| seconds.as_f64()).filter(|s| *s > 0.0) else {
        return;
    };
    for column in ["seconds", "seconds_low", "seconds_high"] {
        if let Some(seconds) = number(row, column) {
            row.insert(column.to_owned(), json!(seconds + host_s));
        }
    }
    if let Some(seconds) = number(row, "seconds") {
        row.insert("frames_per_s".into(), json!(1.0 / seconds));
    }
    row.insert("textures_s".into(), json!(host_s));
}

/// The name of a method that called its wavefront kernels split, as it is now.
fn with_wavefront_kernels(old: &str) -> Option<String> {
    match old.split_once(", ") {
        None if old == "split" => Some("wavefront".to_owned()),
        Some((textures, "split")) => Some(format!("{textures}, wavefront")),
        Some(("split", paths)) if paths.ends_with("paths at a time") => Some(format!("wavefront, {paths}")),
        _ => None,
    }
}

/// The shortest and the longest of some times.
fn spread_of(seconds: &[f64]) -> [f64; 2] {
    [f64::INFINITY, f64::NEG_INFINITY]
        .map(|start| seconds.iter().copied().fold(start, if start > 0.0 { f64::min } else { f64::max }))
}

/// The row with the speed of `rays` rays in passes that took these `seconds`.
pub(super) fn with_rate(mut out: Row, rays: usize, seconds: &[f64]) -> Row {
    let rate = |seconds: f64| json!(rays as f64 / seconds / 1e6);
    let [shortest, longest] = spread_of(seconds);
    out.insert("rays".into(), json!(rays));
    out.insert("passes".into(), json!(seconds.len()));
    out.insert(Clock::Ray.column().into(), json!(seconds));
    // A clock that saw no time pass tells no speed.
    if let Some(middle) = median(seconds).filter(|_| shortest > 0.0) {
        out.extend(row([
            ("kernel_s", json!(middle)),
            ("mrays_per_s", rate(middle)),
            ("mrays_low", rate(longest)),
            ("mrays_high", rate(shortest)),
        ]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::table::name;
    use super::*;

    /// Of a report of an earlier version: none of N stood at 3/N, and the host's pass over textures was left out.
    #[test]
    fn rows_of_earlier_versions_are_brought_up_to_date() {
        let mut old = row([("seconds", json!(0.9)), ("seconds_low", json!(0.8)), ("host_pass_s", json!(15.0))]);
        old.extend(row([("wrong", json!(1)), ("tested", json!(1000)), ("wrong_bound", json!(1000.0))]));
        bring_up_to_date(&mut old);
        let values = ["seconds", "seconds_low", "textures_s"].map(|column| number(&old, column));
        assert_eq!(values, [Some(15.9), Some(15.8), Some(15.0)]);
        assert!(number(&old, "wrong_bound") > Some(4000.0) && !old.contains_key("host_pass_s"), "{old:?}");
        // What is up to date stays.
        let mut again = old.clone();
        bring_up_to_date(&mut again);
        assert_eq!(again, old);
    }

    #[test]
    fn wavefront_kernels_of_earlier_versions_have_their_name() {
        for (old, new) in [
            ("split", "wavefront"),
            ("split, 4096 paths at a time", "wavefront, 4096 paths at a time"),
            ("by the host, split", "by the host, wavefront"),
            // A layout, in the study of memory.
            ("split, pre-order", "split, pre-order"),
            ("mega", "mega"),
        ] {
            let mut row = row([("method", json!(old)), ("kernels", json!("split"))]);
            bring_up_to_date(&mut row);
            assert_eq!([name(&row, "method"), name(&row, "kernels")], [new, "wavefront"]);
        }
    }
}
