//! The kernels of a tracer, and the second pass: rays and pixels that the first one leaves in doubt (`cl/shared/memory.cl`) are
//! traced again by kernels that can decide everything, and are compiled when the first doubt arises.

use super::tracer::{FIRST_ITEMS, LaunchPlan, launch};
use super::{Buffer, Cache, CompileOptions, DeviceContext, Kernel, Program, ProgramSource, build};
use crate::error::Result;
use std::cell::Cell;

/// A kernel that the host starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    Render,
    TraceClosest,
    TraceAny,
    TraceNext,
}

/// One build of the kernels.
struct Kernels {
    render: Kernel,
    trace_closest: Kernel,
    trace_any: Kernel,
    trace_next: Kernel,
}

impl Kernels {
    fn of(program: &Program) -> Result<Self> {
        Ok(Kernels {
            render: program.kernel("render")?,
            trace_closest: program.kernel("trace_closest")?,
            trace_any: program.kernel("trace_any")?,
            trace_next: program.kernel("trace_next")?,
        })
    }

    fn get(&mut self, entry: Entry) -> &mut Kernel {
        match entry {
            Entry::Render => &mut self.render,
            Entry::TraceClosest => &mut self.trace_closest,
            Entry::TraceAny => &mut self.trace_any,
            Entry::TraceNext => &mut self.trace_next,
        }
    }
}

/// Both passes.
pub(super) struct Passes {
    first: Kernels,
    second: Option<Kernels>,
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

impl Passes {
    /// Compiles the first pass; returns what that took, and notes.
    pub fn new(
        context: &DeviceContext,
        options: CompileOptions,
        defers: bool,
        cache: Option<&Cache>,
    ) -> Result<(Self, f64, Vec<String>)> {
        let first_options = if defers { options.clone().define("DEFER_DOUBTS", 1) } else { options.clone() };
        let built = build(context, &ProgramSource::kernels(), &first_options, cache)?;
        let first = Kernels::of(&built.program)?;
        let passes = Passes { first, second: None, defers, options, cache: cache.cloned() };
        Ok((passes, built.compile_s, built.notes))
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
        let kernel = self.first.get(entry);
        set(kernel)?;
        let mut seconds = launch(kernel, plan, (total, work_group), &mut progress)?;
        if !self.defers {
            return Ok(seconds);
        }
        let count = doubts.take_count()?;
        if count > 0 {
            let kernel = self.second(context)?.get(entry);
            set(kernel)?;
            // How long such items take is not known from the others. The first launch takes most lists whole: a small one would
            // leave a GPU idle for as long as its slowest item takes.
            let mut plan = LaunchPlan::starting_with(FIRST_ITEMS);
            seconds += launch(kernel, &mut plan, (count, work_group), |_| progress(0))?;
            doubts.items.write(&[0])?;
        }
        Ok(seconds)
    }

    fn second(&mut self, context: &DeviceContext) -> Result<&mut Kernels> {
        if self.second.is_none() {
            let options = self.options.clone().define("RESOLVE_DOUBTS", 1);
            let built = build(context, &ProgramSource::kernels(), &options, self.cache.as_ref())?;
            self.second = Some(Kernels::of(&built.program)?);
        }
        Ok(self.second.as_mut().expect("it was just built"))
    }
}
