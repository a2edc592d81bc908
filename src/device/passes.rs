//! The kernels of a tracer, which are compiled when they are first needed, and the second pass: rays and pixels that the first one
//! leaves in doubt (`cl/shared/memory.cl`) are traced again by kernels that can decide everything.

use super::definitions::Definitions;
use super::launch::{FIRST_ITEMS, LaunchPlan, Shape, launch};
use super::{Buffer, Cache, CompileOptions, DeviceContext, DeviceInfo, Kernel, Program, ProgramSource, build};
use crate::error::Result;
use crate::options::{Kernels, PacketSize, TraceOptions};
use crate::shared::PACKETS_OF_ITEM;
use std::cell::Cell;

/// What traces batches.
pub(super) const TRACE_FILE: &str = "cl/kernels/trace.cl";
/// The same for packets of rays.
const TRACE_PACKETS_FILE: &str = "cl/kernels/trace_packets.cl";
const RENDER_PACKETS_FILE: &str = "cl/kernels/render_packets.cl";
const RENDER_FILE: &str = "cl/kernels/render.cl";
/// The kernels that [`super::wavefront`] starts.
pub(super) const WAVEFRONT_FILE: &str = "cl/kernels/wavefront.cl";

/// Whether the kernels of this file shade; the others trace batches.
pub(super) fn is_shading(file: &str) -> bool {
    ![TRACE_FILE, TRACE_PACKETS_FILE].contains(&file)
}

/// A kernel that the host starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    Render,
    TraceClosest,
    TraceAny,
    TraceNext,
    TraceClosestPackets,
    TraceAnyPackets,
    RenderPackets,
}

impl Entry {
    const ALL: [Entry; 7] = [
        Entry::Render,
        Entry::TraceClosest,
        Entry::TraceAny,
        Entry::TraceNext,
        Entry::TraceClosestPackets,
        Entry::TraceAnyPackets,
        Entry::RenderPackets,
    ];

    /// What traces a batch.
    pub fn of_batch(any_hit: bool, packet_size: PacketSize) -> Entry {
        match (any_hit, packet_size) {
            (false, PacketSize::One) => Entry::TraceClosest,
            (true, PacketSize::One) => Entry::TraceAny,
            (false, PacketSize::Sixteen) => Entry::TraceClosestPackets,
            (true, PacketSize::Sixteen) => Entry::TraceAnyPackets,
        }
    }

    /// What renders a picture, if one kernel does.
    pub fn of_picture(packet_size: PacketSize) -> Entry {
        match packet_size {
            PacketSize::One => Entry::Render,
            PacketSize::Sixteen => Entry::RenderPackets,
        }
    }

    /// What traces again what this one leaves in doubt: one item each.
    fn second(self) -> Entry {
        match self {
            Entry::TraceClosestPackets => Entry::TraceClosest,
            Entry::TraceAnyPackets => Entry::TraceAny,
            Entry::RenderPackets => Entry::Render,
            other => other,
        }
    }

    /// Whether work-items take items from a queue.
    fn has_queue(self) -> bool {
        self == Entry::RenderPackets
    }

    /// How many items a work-item has, or takes at a time.
    fn items_of_one(self) -> usize {
        match self {
            Entry::TraceClosestPackets | Entry::TraceAnyPackets | Entry::RenderPackets => {
                PACKETS_OF_ITEM as usize * PacketSize::Sixteen.rays()
            }
            Entry::TraceClosest | Entry::TraceAny | Entry::TraceNext | Entry::Render => 1,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Entry::Render => "render",
            Entry::TraceClosest => "trace_closest",
            Entry::TraceAny => "trace_any",
            Entry::TraceNext => "trace_next",
            Entry::TraceClosestPackets => "trace_closest_packets",
            Entry::TraceAnyPackets => "trace_any_packets",
            Entry::RenderPackets => "render_packets",
        }
    }

    /// The file that has it.
    fn file(self) -> &'static str {
        match self {
            Entry::Render => RENDER_FILE,
            Entry::RenderPackets => RENDER_PACKETS_FILE,
            Entry::TraceClosestPackets | Entry::TraceAnyPackets => TRACE_PACKETS_FILE,
            Entry::TraceClosest | Entry::TraceAny | Entry::TraceNext => TRACE_FILE,
        }
    }
}

/// The kernels of a tracer.
pub(super) struct Passes {
    /// Those that were needed so far.
    kernels: Vec<(Pass, Entry, Kernel)>,
    definitions: Definitions,
    cache: Option<Cache>,
    /// Seconds that compilers took so far.
    pub compile_s: f64,
    /// What [`crate::tracer::Backend::notes`] tells.
    pub notes: Vec<String>,
}

/// Which of the passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    First,
    Second,
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

/// The files with the kernels of both passes: of batches, and those that render. A program has the kernels of one.
pub(super) fn entry_files(options: &TraceOptions) -> Vec<&'static str> {
    let packets = options.packet_size == PacketSize::Sixteen;
    let mut files = vec![TRACE_FILE];
    files.extend(packets.then_some(TRACE_PACKETS_FILE));
    match options.kernels {
        Kernels::Mega => {
            files.push(RENDER_FILE);
            files.extend(packets.then_some(RENDER_PACKETS_FILE));
        }
        Kernels::Split => files.push(WAVEFRONT_FILE),
    }
    files
}

/// Work-groups of the second pass that a compute unit is to have before any has more than one item. An H200, Mrays/s of gears' camera
/// rays with 3,836 items in groups of 1, 2, 8, 64: 4,122, 3,745, 3,018, 2,193; with 30,688 items 6,093, 7,136, 8,639, 8,349.
const SECOND_GROUPS_OF_UNIT: usize = 16;

/// Work-items of a compute unit where they take items from a queue. On CPUs, where these are work-groups of their own, PoCL gives a thread at
/// least 32 of them at once, which it runs one after the other: all threads are to have some.
const WORKERS_OF_UNIT: usize = 64;

impl Passes {
    /// `notes`: those that there are before anything is compiled. A driver that keeps compiled kernels is left to it: asked for a
    /// binary, PoCL compiles every kernel once more, for work-groups of any size, a quarter of all the time that compiling takes.
    pub fn new(definitions: Definitions, cache: Option<&Cache>, info: &DeviceInfo, notes: Vec<String>) -> Self {
        let cache = cache.filter(|_| !info.keeps_kernels());
        Passes { kernels: Vec::new(), definitions, cache: cache.cloned(), compile_s: 0.0, notes }
    }

    /// What they are compiled with.
    pub fn definitions(&self) -> &Definitions {
        &self.definitions
    }

    /// Whether the first pass leaves anything to the second.
    pub fn defers(&self) -> bool {
        self.definitions.defers
    }

    /// Compiles one pass of the kernels in `file`, and no others: compilers take long.
    pub fn program(&mut self, context: &DeviceContext, pass: Pass, file: &str) -> Result<Program> {
        let options = self.definitions.of_pass(pass, file);
        self.build(context, &ProgramSource::kernels(&[file]), &options)
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

    /// A kernel, which is compiled with the others of its file when it is first needed.
    fn kernel(&mut self, context: &DeviceContext, pass: Pass, entry: Entry) -> Result<&mut Kernel> {
        if !self.kernels.iter().any(|known| (known.0, known.1) == (pass, entry)) {
            let program = self.program(context, pass, entry.file())?;
            for other in Entry::ALL.into_iter().filter(|other| other.file() == entry.file()) {
                self.kernels.push((pass, other, program.kernel(other.name())?));
            }
        }
        let known = self.kernels.iter_mut().find(|known| (known.0, known.1) == (pass, entry));
        Ok(&mut known.expect("it was just added").2)
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
        let kernel = self.kernel(context, Pass::First, entry)?;
        set(kernel)?;
        let units = (context.info().compute_units as usize).max(1);
        // A work-group has as many items whatever a work-item has of them, if it has not more: what these keep shall stay in cache.
        let shape = |total, entry: Entry| {
            let items_of_one = entry.items_of_one();
            let workers = entry.has_queue().then_some(WORKERS_OF_UNIT * units);
            Shape { total, work_group: work_group.div_ceil(items_of_one), items_of_one, workers }
        };
        let mut seconds = launch(kernel, plan, shape(total, entry), &mut progress)?;
        if !self.defers() {
            return Ok(seconds);
        }
        let count = doubts.take_count()?;
        if count > 0 {
            let kernel = self.kernel(context, Pass::Second, entry.second())?;
            set(kernel)?;
            // How long such items take is not known from the others. The first launch takes most lists whole: a small one would
            // leave a GPU idle for as long as its slowest item takes. Nor are items put into one work-group while units are free: each
            // would wait for whatever exact integers the others compute.
            let mut plan = LaunchPlan::starting_with(FIRST_ITEMS, context.info().kind);
            let work_group = (count / (SECOND_GROUPS_OF_UNIT * units)).clamp(1, work_group);
            let shape = Shape { work_group, ..shape(count, entry.second()) };
            seconds += launch(kernel, &mut plan, shape, |_| progress(0))?;
            doubts.items.write(&[0])?;
        }
        Ok(seconds)
    }
}
