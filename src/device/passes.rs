//! The kernels of a tracer, and the second pass: rays and pixels that the first one leaves in doubt (`cl/shared/memory.cl`) are
//! traced again by kernels that can decide everything, and are compiled when the first doubt arises.

use super::launch::{FIRST_ITEMS, LaunchPlan, launch};
use super::{Buffer, Built, Cache, CompileOptions, DeviceContext, Kernel, Program, ProgramSource, build};
use crate::error::Result;
use crate::options;
use std::cell::Cell;

const TRACE_FILE: &str = "cl/kernels/trace.cl";
const RENDER_FILE: &str = "cl/kernels/render.cl";
/// The kernels that [`super::split`] starts.
pub(super) const SPLIT_FILE: &str = "cl/kernels/split.cl";

/// A kernel that the host starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    Render,
    TraceClosest,
    TraceAny,
    TraceNext,
}

impl Entry {
    /// The one that renders first.
    const ALL: [Entry; 4] = [Entry::Render, Entry::TraceClosest, Entry::TraceAny, Entry::TraceNext];

    fn name(self) -> &'static str {
        match self {
            Entry::Render => "render",
            Entry::TraceClosest => "trace_closest",
            Entry::TraceAny => "trace_any",
            Entry::TraceNext => "trace_next",
        }
    }

    /// The file that has it.
    fn file(self) -> &'static str {
        if self == Entry::Render { RENDER_FILE } else { TRACE_FILE }
    }
}

/// Kernels by what they do.
#[derive(Default)]
struct Kernels(Vec<(Entry, Kernel)>);

impl Kernels {
    fn add(&mut self, program: &Program, entry: Entry) -> Result<()> {
        self.0.push((entry, program.kernel(entry.name())?));
        Ok(())
    }

    fn get(&mut self, entry: Entry) -> Option<&mut Kernel> {
        self.0.iter_mut().find(|(known, _)| *known == entry).map(|(_, kernel)| kernel)
    }
}

/// Both passes.
pub(super) struct Passes {
    first: Kernels,
    /// Those that were needed so far.
    second: Kernels,
    /// Whether the first pass leaves anything to the second.
    pub defers: bool,
    options: CompileOptions,
    cache: Option<Cache>,
}

/// The items that the first pass left in doubt, and how many there were in all.
pub(super) struct Doubts {
    /// Their number, then which.
    pub items: Buffer<u32>,
    resolved: Cell<Option<u64>>,
}

impl Doubts {
    /// Room for `count` items, if there are doubts at all.
    pub fn new(context: &DeviceContext, defers: bool, count: usize) -> Result<Self> {
        let items = Buffer::empty(context, "items in doubt", if defers { count + 1 } else { 1 })?;
        items.write(&[0])?;
        Ok(Doubts { items, resolved: Cell::new(defers.then_some(0)) })
    }

    /// How many items took the second pass; `None` when there was none to take.
    pub fn resolved(&self) -> Option<u64> {
        self.resolved.get()
    }

    fn take_count(&self) -> Result<usize> {
        let mut count = [0];
        self.items.read_into(0, &mut count)?;
        self.resolved.set(self.resolved.get().map(|n| n + u64::from(count[0])));
        Ok(count[0] as usize)
    }
}

/// The files with the kernels of the first pass: of batches, and those that render.
pub(super) fn entry_files(kernels: options::Kernels) -> [&'static str; 2] {
    match kernels {
        options::Kernels::Mega => [TRACE_FILE, RENDER_FILE],
        options::Kernels::Split => [TRACE_FILE, SPLIT_FILE],
    }
}

/// The definitions of the first pass, which leaves something to the second where it `defers`.
pub(super) fn first_pass(options: CompileOptions, defers: bool) -> CompileOptions {
    if defers { options.define("DEFER_DOUBTS", 1) } else { options }
}

/// The definitions of the second pass.
pub(super) fn second_pass(options: CompileOptions) -> CompileOptions {
    options.define("RESOLVE_DOUBTS", 1)
}

impl Passes {
    /// Compiles the first pass, with one of both kinds of kernels that render; returns the program, too.
    pub fn new(
        context: &DeviceContext,
        kernels: options::Kernels,
        options: CompileOptions,
        defers: bool,
        cache: Option<&Cache>,
    ) -> Result<(Self, Built)> {
        let entries = match kernels {
            options::Kernels::Mega => &Entry::ALL[..],
            options::Kernels::Split => &Entry::ALL[1..],
        };
        let first_options = first_pass(options.clone(), defers);
        let built = build(context, &ProgramSource::kernels(&entry_files(kernels)), &first_options, cache)?;
        let mut first = Kernels::default();
        entries.iter().try_for_each(|&entry| first.add(&built.program, entry))?;
        let passes = Passes { first, second: Kernels::default(), defers, options, cache: cache.cloned() };
        Ok((passes, built))
    }

    /// Compiles the second pass of the kernels in `file`, and no others: compilers take long for these.
    pub fn second_program(&self, context: &DeviceContext, file: &str) -> Result<Built> {
        let options = second_pass(self.options.clone());
        build(context, &ProgramSource::kernels(&[file]), &options, self.cache.as_ref())
    }

    /// Runs a kernel over `total` items in work-groups of `work_group`, and again over those that were left in doubt; `set` sets all
    /// arguments but the last two. Returns seconds of device time.
    #[allow(clippy::too_many_arguments)] // of which a struct would only be made to be taken apart
    pub fn run(
        &mut self,
        context: &DeviceContext,
        entry: Entry,
        set: &dyn Fn(&mut Kernel) -> Result<()>,
        plan: &mut LaunchPlan,
        (total, work_group): (usize, usize),
        doubts: &Doubts,
        mut progress: impl FnMut(usize),
    ) -> Result<f64> {
        let kernel = self.first.get(entry).expect("all were added");
        set(kernel)?;
        let mut seconds = launch(kernel, plan, (total, work_group), &mut progress)?;
        if !self.defers {
            return Ok(seconds);
        }
        let count = doubts.take_count()?;
        if count > 0 {
            let kernel = self.second(context, entry)?;
            set(kernel)?;
            // How long such items take is not known from the others. The first launch takes most lists whole: a small one would
            // leave a GPU idle for as long as its slowest item takes.
            let mut plan = LaunchPlan::starting_with(FIRST_ITEMS);
            seconds += launch(kernel, &mut plan, (count, work_group), |_| progress(0))?;
            doubts.items.write(&[0])?;
        }
        Ok(seconds)
    }

    fn second(&mut self, context: &DeviceContext, entry: Entry) -> Result<&mut Kernel> {
        if self.second.get(entry).is_none() {
            let built = self.second_program(context, entry.file())?;
            self.second.add(&built.program, entry)?;
        }
        Ok(self.second.get(entry).expect("it was just added"))
    }
}
