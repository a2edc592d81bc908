//! One of the wavefront kernels, and its launches.

use crate::device::launch::LaunchPlan;
use crate::device::{Event, Kernel, KernelArg, Program};
use crate::error::Result;

/// Arguments that change while a picture is rendered, counted from the end: the last of `WAVEFRONT_ARGUMENTS`.
#[derive(Debug, Clone, Copy)]
pub(super) enum Late {
    End = 1,
    First,
    Light,
    OtherQueue,
    Queue,
    BatchPixels,
    FirstPixel,
}

/// One kernel, and its launches that nobody has waited for yet.
pub(super) struct Step {
    pub kernel: Kernel,
    /// Whether its work-items trace rays, which takes most of the time.
    pub traces: bool,
    running: Vec<Event>,
}

impl Step {
    pub fn new(program: &Program, name: &str, traces: bool) -> Result<Self> {
        let mut step = Step { kernel: program.kernel(name)?, traces, running: Vec::new() };
        step.set(Late::Light, 0)?; // for the kernels that do not look at it
        Ok(step)
    }

    pub fn set<'a>(&mut self, argument: Late, value: impl Into<KernelArg<'a>>) -> Result<()> {
        self.kernel.set_arg(self.kernel.arg_count() - argument as usize, value)
    }

    /// Starts the kernel over items `0..total`, in parts that `plan` sizes. Returns the items of the largest.
    pub fn launch(&mut self, plan: &LaunchPlan, total: usize, work_group: usize) -> Result<usize> {
        let (mut first, mut largest) = (0, 0);
        while first < total {
            let items = plan.next(total - first, work_group);
            self.set(Late::First, first as u32)?;
            self.set(Late::End, (first + items) as u32)?;
            self.running.push(self.kernel.launch(&[items.next_multiple_of(work_group)], Some(&[work_group]))?);
            first += items;
            largest = largest.max(items);
        }
        Ok(largest)
    }

    /// Forgets launches that nobody has waited for.
    pub fn forget(&mut self) {
        self.running.clear();
    }

    /// Waits for all launches; how many they were, and their seconds of device time.
    pub fn wait(&mut self) -> Result<(u64, f64)> {
        let launches = self.running.len() as u64;
        let seconds: Result<f64> = self.running.drain(..).map(|event| event.wait()).sum();
        Ok((launches, seconds?))
    }
}
