//! One batch by several devices at once, run by run, with the answers of one device.

use super::{BatchJob, Runs, TracedRuns, trace_runs_at};
use crate::error::Result;
use crate::pack::SceneBuffers;
use crate::several::{Devices, HandOn, Pace, Pieces, Watcher, share_out};
use crate::tracer::{Backend, DeviceShare, Progress};

/// Takes runs that are finished, each once; called by the threads of the devices.
pub type TakeRuns<'a> = &'a (dyn Fn(TracedRuns) -> Result<()> + Sync);

/// The runs of a batch.
struct RunsOf<'a> {
    job: &'a BatchJob<'a>,
    runs: Runs,
    take: TakeRuns<'a>,
}

impl Pieces for RunsOf<'_> {
    fn work(
        &self,
        tracer: (&mut dyn Backend, &SceneBuffers),
        (numbers, pace): (&[usize], &mut Pace),
        hand_on: HandOn,
        progress: Progress,
    ) -> Result<()> {
        let mut done = |traced: TracedRuns| {
            let numbers: Vec<usize> = traced.runs.clone().collect();
            let mut traced = Some(traced);
            hand_on(&numbers, &mut || traced.take().map_or(Ok(()), self.take));
            Ok(())
        };
        trace_runs_at(pace, tracer, self.job, (self.runs, numbers), &mut done, progress)
    }
}

/// Traces the `wanted` runs of a batch by all of `devices`, in any order. Returns what each did.
///
/// # Errors
/// The last device has failed, too; and those of `take` and of `watcher`.
pub fn trace_by_several(
    devices: Devices,
    job: &BatchJob,
    (runs, wanted): (Runs, &[usize]),
    take: TakeRuns,
    watcher: &dyn Watcher,
) -> Result<Vec<DeviceShare>> {
    let units = wanted.iter().map(|&run| vec![run]).collect();
    share_out(devices, units, &RunsOf { job, runs, take }, watcher)
}
