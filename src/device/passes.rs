//! The kernels of a tracer, which are compiled when they are first needed, and the second pass: rays and pixels that
//! the first one defers (`cl/memory/deferral.cl`) are traced again by kernels that can decide everything.

use super::deferred::Deferred;
use super::definitions::Definitions;
use super::entry::{Entry, Pass, files_with};
use super::launch::{FIRST_ITEMS, LaunchPlan, Shape, begin_launch, launch};
use super::on_host::{MOST_ITEMS, MOST_S, OnHost};
use super::{Cache, CompileOptions, DeviceContext, DeviceInfo, Event, Kernel, Program, ProgramSource, build};
use crate::error::Result;
use std::ops::Range;
use std::time::Instant;

/// The kernels of a tracer.
pub(super) struct Passes {
    /// Those that were needed so far.
    kernels: Vec<(Pass, Entry, Kernel)>,
    definitions: Definitions,
    cache: Option<Cache>,
    /// Seconds that the host took for what it settled.
    pub on_host_s: f64,
    /// Seconds that compilers took so far.
    pub compile_s: f64,
    /// What [`crate::tracer::Backend::notes`] tells.
    pub notes: Vec<String>,
}

/// Work-items of a compute unit where they take items from a queue. On CPUs, where these are work-groups of their own,
/// PoCL gives a thread at least 32 of them at once, which it runs one after the other: all threads are to have some.
const WORKERS_OF_UNIT: usize = 64;

impl Passes {
    /// `notes`: those that there are before anything is compiled. A driver that keeps compiled kernels is left to it:
    /// asked for a binary, PoCL compiles every kernel once more, for work-groups of any size, a quarter of all the time
    /// that compiling takes.
    pub fn new(definitions: Definitions, cache: Option<&Cache>, info: &DeviceInfo, notes: Vec<String>) -> Self {
        let cache = cache.filter(|_| !info.keeps_kernels());
        Passes { kernels: Vec::new(), definitions, cache: cache.cloned(), on_host_s: 0.0, compile_s: 0.0, notes }
    }

    /// What they are compiled with.
    pub fn definitions(&self) -> &Definitions {
        &self.definitions
    }

    /// Whether the first pass leaves anything to the second.
    pub fn defers(&self) -> bool {
        self.definitions.defers
    }

    /// Compiles one pass of the kernels in `file` and of what goes with them, and no others: compilers take long.
    pub fn program(&mut self, context: &DeviceContext, pass: Pass, file: &'static str) -> Result<Program> {
        let options = self.definitions.of_pass(pass, file);
        self.build(context, &ProgramSource::kernels(&files_with(file)), &options)
    }

    /// Compiles what has nothing to do with tracing.
    pub fn build(
        &mut self,
        context: &DeviceContext,
        source: &ProgramSource,
        options: &CompileOptions,
    ) -> Result<Program> {
        let built = build(context, source, options, self.cache.as_ref())?;
        self.compile_s += built.compile_s;
        self.notes.extend(built.notes);
        Ok(built.program)
    }

    /// Compiles the first pass of what runs `entry`, if it is not there yet.
    pub fn prepare(&mut self, context: &DeviceContext, entry: Entry) -> Result<()> {
        self.kernel(context, Pass::First, entry).map(|_| ())
    }

    fn has(&self, pass: Pass, entry: Entry) -> bool {
        self.kernels.iter().any(|known| (known.0, known.1) == (pass, entry))
    }

    /// A kernel, which is compiled with the others of its file when it is first needed.
    fn kernel(&mut self, context: &DeviceContext, pass: Pass, entry: Entry) -> Result<&mut Kernel> {
        if !self.has(pass, entry) {
            let program = self.program(context, pass, entry.file())?;
            let files = files_with(entry.file());
            // What needs more files than its own has a program of its own.
            let comes_along = |other: &Entry| files.contains(&other.file()) && files_with(other.file()).len() == 1;
            for other in Entry::ALL.into_iter().filter(|other| other.file() == entry.file() || comes_along(other)) {
                self.kernels.push((pass, other, program.kernel(other.name())?));
            }
        }
        let known = self.kernels.iter_mut().find(|known| (known.0, known.1) == (pass, entry));
        Ok(&mut known.expect("it was just added").2)
    }

    /// Runs a kernel that takes next to no time over `items` in work-groups of `work_group`, at once; `set` sets
    /// all arguments but the last two. Returns seconds of device time.
    pub fn run_short(
        &mut self,
        context: &DeviceContext,
        entry: Entry,
        set: &dyn Fn(&mut Kernel) -> Result<()>,
        (items, work_group): (Range<usize>, usize),
    ) -> Result<f64> {
        let kernel = self.kernel(context, Pass::First, entry)?;
        set(kernel)?;
        let mut plan = LaunchPlan::on(context, items.len());
        let shape = Shape { items, work_group, items_of_one: entry.items_of_one(), workers: None };
        launch(kernel, &mut plan, shape, |_| ())
    }

    /// Runs a kernel over `items` in work-groups of `work_group`, and again over those that it defers, unless `on_host`
    /// settles them; `set` sets all arguments but the last two. Returns seconds of device time, with the host's.
    #[allow(clippy::too_many_arguments)] // of which a struct would only be made to be taken apart
    pub fn run(
        &mut self,
        context: &DeviceContext,
        entry: Entry,
        set: &dyn Fn(&mut Kernel) -> Result<()>,
        plan: &mut LaunchPlan,
        (items, work_group): (Range<usize>, usize),
        (deferred, on_host): (&Deferred, Option<OnHost>),
        mut progress: impl FnMut(usize),
    ) -> Result<f64> {
        let kernel = self.kernel(context, Pass::First, entry)?;
        set(kernel)?;
        let seconds = launch(kernel, plan, shape_of(context, entry, items, work_group), &mut progress)?;
        if !self.defers() {
            return Ok(seconds);
        }
        let count = deferred.take_count()?;
        if count == 0 {
            return Ok(seconds);
        }
        let second_s = match self.settle(entry, deferred, count, on_host)? {
            Some(on_host_s) => on_host_s,
            None => self.run_second(context, entry, set, (deferred, count), || progress(0))?,
        };
        Ok(seconds + second_s)
    }

    /// The first pass of [`Passes::run`], without waiting for it if it is one launch. Of others `done` is told, with
    /// the items and the seconds of each.
    pub fn begin_first(
        &mut self,
        context: &DeviceContext,
        entry: Entry,
        set: &dyn Fn(&mut Kernel) -> Result<()>,
        plan: &mut LaunchPlan,
        (items, work_group): (usize, usize),
        done: impl FnMut(usize, f64),
    ) -> Result<Option<Event>> {
        let kernel = self.kernel(context, Pass::First, entry)?;
        set(kernel)?;
        begin_launch(kernel, plan, shape_of(context, entry, 0..items, work_group), done)
    }

    /// Has the host settle what the first pass has deferred, where that takes less than to compile the second one.
    /// Returns the seconds that took, which stand for the device's.
    fn settle(
        &mut self,
        entry: Entry,
        deferred: &Deferred,
        count: usize,
        on_host: Option<OnHost>,
    ) -> Result<Option<f64>> {
        let is_compiled = self.has(Pass::Second, entry.second());
        let Some(on_host) = on_host.filter(|_| !is_compiled && count <= MOST_ITEMS && self.on_host_s < MOST_S) else {
            return Ok(None);
        };
        let start = Instant::now();
        let mut items = vec![0; count];
        deferred.items.read_into(1, &mut items)?;
        on_host(&items)?;
        deferred.items.write(&[0])?;
        let seconds = start.elapsed().as_secs_f64();
        self.on_host_s += seconds;
        Ok(Some(seconds))
    }

    /// Traces what the first pass has deferred again; `progress` is called after each launch. Returns seconds of device
    /// time.
    fn run_second(
        &mut self,
        context: &DeviceContext,
        entry: Entry,
        set: &dyn Fn(&mut Kernel) -> Result<()>,
        (deferred, count): (&Deferred, usize),
        mut progress: impl FnMut(),
    ) -> Result<f64> {
        let kernel = self.kernel(context, Pass::Second, entry.second())?;
        set(kernel)?;
        // How long such items take is not known from the others. The first launch takes most lists whole: a small one
        // would leave a GPU idle for as long as its slowest item takes. Each item has a work-group of its own. In one
        // with others it would wait for whatever exact integers these compute; PoCL compiles a kernel anew for each
        // size; and what NVIDIA's compiler makes of calls this deep goes wrong where the lanes of a warp part: an H200
        // failed with illegal addresses. 33,522 rays along edges take 2.4 times as long so; few batches defer as many.
        let mut plan = LaunchPlan::on(context, FIRST_ITEMS);
        let shape = shape_of(context, entry.second(), 0..count, 1);
        let seconds = launch(kernel, &mut plan, shape, |_| progress())?;
        deferred.items.write(&[0])?;
        Ok(seconds)
    }
}

fn units_of(context: &DeviceContext) -> usize {
    (context.info().compute_units as usize).max(1)
}

/// A work-group has as many items whatever a work-item has of them, if it has not more: what these keep shall stay in
/// cache.
fn shape_of(context: &DeviceContext, entry: Entry, items: Range<usize>, work_group: usize) -> Shape {
    let items_of_one = entry.items_of_one();
    let workers = entry.has_queue().then_some(WORKERS_OF_UNIT * units_of(context));
    Shape { items, work_group: work_group.div_ceil(items_of_one), items_of_one, workers }
}
