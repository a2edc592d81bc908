//! A device that is lost in the middle of its work, and the reference that goes on in its place with the same bits.
//!
//! Bad at: hiding the loss. The reference is scalar code, many times as slow as a GPU.

use crate::blocks::Blocks;
use crate::error::{Error, Result};
use crate::io::film::FilmPlace;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::ReferenceBackend;
use crate::shared::{CameraSample, Light, RenderParams};
use crate::tracer::{
    Adaptive, AllHits, AllHitsJob, Backend, Candidates, CandidatesJob, LostDevice, Progress, RayStream, RenderResult,
    Spent, Task, TraceJob, TraceResult,
};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Is told of a device that is lost, at once.
pub type OnLoss = Box<dyn FnMut(&LostDevice) + Send>;

/// A tracer whose calls the reference does over, and all later ones, once a call of the driver has failed. What fails
/// before a call, such as the opening of the device, its compiler, or a scene larger than its memory, remains an error;
/// memory that the driver refuses in a call is a loss.
pub struct FallBack {
    tracer: Box<dyn Backend>,
    buffers: Arc<SceneBuffers>,
    lost: Option<LostDevice>,
    on_loss: OnLoss,
    /// What the reference is to be told when it takes over.
    lights: Option<Vec<Light>>,
    stop: Option<Arc<AtomicBool>>,
}

impl FallBack {
    /// Of a tracer of `buffers`.
    pub fn new(tracer: Box<dyn Backend>, buffers: &Arc<SceneBuffers>, on_loss: OnLoss) -> FallBack {
        FallBack { tracer, buffers: buffers.clone(), lost: None, on_loss, lights: None, stop: None }
    }

    /// Has the tracer do something, and the reference if that loses the device.
    fn done<T>(&mut self, mut call: impl FnMut(&mut dyn Backend) -> Result<T>) -> Result<T> {
        match call(self.tracer.as_mut()) {
            Err(error) if self.lost.is_none() && error.is_lost_device() => {
                self.lose(&error)?;
                call(self.tracer.as_mut())
            }
            other => other,
        }
    }

    fn lose(&mut self, error: &Error) -> Result<()> {
        let mut reference = ReferenceBackend::new(self.buffers.clone(), *self.tracer.options());
        if let Some(stop) = &self.stop {
            reference.stop_when(stop.clone());
        }
        self.lights.as_deref().map_or(Ok(()), |lights| reference.set_lights(lights))?;
        let lost = std::mem::replace(&mut self.tracer, Box::new(reference));
        let device = lost.device_name().to_owned();
        // A driver that failed may hang in the release of what is left.
        std::mem::forget(lost);
        (self.on_loss)(self.lost.insert(LostDevice { device, error: error.to_string() }));
        Ok(())
    }
}

impl Backend for FallBack {
    fn device_name(&self) -> &str {
        self.tracer.device_name()
    }

    fn lost(&self) -> Option<&LostDevice> {
        self.lost.as_ref()
    }

    fn prepare(&mut self, task: Task) -> Result<()> {
        self.tracer.prepare(task)
    }

    fn compile_s(&self) -> f64 {
        self.tracer.compile_s()
    }

    fn upload_s(&self) -> f64 {
        self.tracer.upload_s()
    }

    fn options(&self) -> &TraceOptions {
        self.tracer.options()
    }

    fn has_clock(&self) -> bool {
        self.tracer.has_clock()
    }

    fn pixels_at_a_time(&self) -> u64 {
        self.tracer.pixels_at_a_time()
    }

    fn stop_when(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop.clone());
        self.tracer.stop_when(stop);
    }

    fn notes(&self) -> &[String] {
        self.tracer.notes()
    }

    fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        self.done(|tracer| tracer.set_lights(lights))?;
        self.lights = Some(lights.to_vec());
        Ok(())
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        self.done(|tracer| tracer.trace(job, progress))
    }

    fn trace_stream(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
        self.done(|tracer| tracer.trace_stream(stream, progress))
    }

    fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits> {
        self.done(|tracer| tracer.trace_all(job, progress))
    }

    fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates> {
        self.done(|tracer| tracer.find_candidates(job, progress))
    }

    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult> {
        self.done(|tracer| tracer.render(params, samples, progress))
    }

    fn render_into(
        &mut self,
        params: &RenderParams,
        samples: &[CameraSample],
        mut place: FilmPlace,
        progress: Progress,
    ) -> Result<RenderResult> {
        self.done(|tracer| tracer.render_into(params, samples, place.again(), progress))
    }

    fn render_by_error(
        &mut self,
        params: &RenderParams,
        adaptive: Adaptive,
        blocks: &Blocks,
        progress: Progress,
    ) -> Result<Option<(RenderResult, Spent)>> {
        self.done(|tracer| tracer.render_by_error(params, adaptive, blocks, progress))
    }
}
