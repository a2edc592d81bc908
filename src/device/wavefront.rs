//! Rendering with several kernels (`cl/kernels/wavefront.cl`): the host's part of a wave, which is to launch each
//! kernel over the right number of slots and, where it is asked to, to evaluate textures.

mod state;
mod step;

use super::entry::{Pass, WAVEFRONT_FILE};
use super::launch::LaunchPlan;
use super::passes::Passes;
use super::picture::{PictureBuffers, Rendered};
use super::scene::DeviceScene;
use super::{Buffer, DeviceContext};
use crate::error::Result;
use crate::options::{TexturePass, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::texture_colours;
use crate::shared::{
    QUEUE_ACTIVE, QUEUE_PATHS, QUEUE_RESOLVED, QUEUE_SHADOWS, QUEUE_TEXTURED, RenderParams, TextureRequest,
};
use crate::tracer::{Progress, WavefrontStats};
use state::{Setup, Shape, State};
use std::mem::swap;
use std::sync::Arc;
use std::time::Instant;
use step::{Late, Step};

/// The kernels.
pub(super) struct WavefrontPipeline {
    camera: Step,
    trace: Step,
    request: Step,
    shade: Step,
    light: Step,
    shadow: Step,
    film: Step,
    /// What traces the rays that the first pass defers, if it defers any.
    second: Option<SecondPass>,
    setup: Setup,
    /// The scene, where the host evaluates its textures, and how.
    host_textures: Option<(Arc<SceneBuffers>, TraceOptions)>,
}

/// Tracing again.
struct SecondPass {
    trace: Step,
    shadow: Step,
}

/// A picture on its way.
struct Run<'a> {
    picture: &'a PictureBuffers,
    state: &'a State,
    work_group: usize,
    plan: LaunchPlan,
    /// No counter of the device was raised more often since the counts were taken.
    uncounted: usize,
    rendered: Rendered,
    stats: WavefrontStats,
}

impl Run<'_> {
    /// Makes room in the counters, which have 32 bits, for `most` more.
    fn take_counts(&mut self, most: usize) -> Result<()> {
        if self.uncounted.saturating_add(most) > u32::MAX as usize {
            self.picture.take_counts(&mut self.rendered.counts)?;
            self.uncounted = 0;
        }
        self.uncounted += most;
        Ok(())
    }
}

impl WavefrontPipeline {
    /// Compiles both passes of its kernels.
    pub fn new(
        context: &DeviceContext,
        passes: &mut Passes,
        buffers: &Arc<SceneBuffers>,
        options: &TraceOptions,
    ) -> Result<Self> {
        let first = passes.program(context, Pass::First, WAVEFRONT_FILE)?;
        let mut second = None;
        if passes.defers() {
            // Now, not at the first deferred ray: whether there is one only the device knows while it renders.
            let program = passes.program(context, Pass::Second, WAVEFRONT_FILE)?;
            second = Some(SecondPass {
                trace: Step::new(&program, "wavefront_trace", true)?,
                shadow: Step::new(&program, "wavefront_shadow", true)?,
            });
        }
        let step = |name: &str, traces: bool| Step::new(&first, name, traces);
        let host_textures = options.picture.textures == TexturePass::HostPass;
        Ok(WavefrontPipeline {
            camera: step("wavefront_camera", false)?,
            trace: step("wavefront_trace", true)?,
            request: step("wavefront_request", false)?,
            shade: step("wavefront_shade", false)?,
            light: step("wavefront_light", false)?,
            shadow: step("wavefront_shadow", true)?,
            film: step("wavefront_film", false)?,
            second,
            setup: Setup {
                lights: buffers.params.light_count as usize,
                features: buffers.features,
                host_textures,
                defers: passes.defers(),
                paths_in_flight: options.picture.paths_in_flight,
            },
            host_textures: host_textures.then(|| (buffers.clone(), *options)),
        })
    }

    fn steps(&mut self) -> impl Iterator<Item = &mut Step> {
        let WavefrontPipeline { camera, trace, request, shade, light, shadow, film, second, .. } = self;
        let second = second.iter_mut().flat_map(|second| [&mut second.trace, &mut second.shadow]);
        [camera, trace, request, shade, light, shadow, film].into_iter().chain(second)
    }

    /// Forgets launches that nobody has waited for, where a picture failed or was stopped.
    pub fn forget(&mut self) {
        self.steps().for_each(Step::forget);
    }

    /// Renders a picture; `first_items`: of the first launch of each kernel. What this fails in is to be forgotten.
    pub fn render(
        &mut self,
        context: &DeviceContext,
        scene: &DeviceScene,
        picture: &PictureBuffers,
        params: &RenderParams,
        (first_items, work_group): (usize, usize),
        progress: Progress,
    ) -> Result<Rendered> {
        let shape = Shape::new(context, params, self.setup);
        let state = State::new(context, &shape)?;
        for step in self.steps() {
            state.set_arguments(step, scene, picture)?;
        }
        let mut run = Run {
            picture,
            state: &state,
            work_group,
            plan: LaunchPlan::on(context, first_items),
            uncounted: 0,
            rendered: Rendered { second_pass: self.setup.defers.then_some(0), ..Rendered::default() },
            stats: WavefrontStats { paths_in_flight: shape.slots, ..WavefrontStats::default() },
        };
        let pixels = params.film_len();
        for first_pixel in (0..pixels).step_by(shape.batch_pixels) {
            let batch_pixels = shape.batch_pixels.min(pixels - first_pixel);
            for step in self.steps() {
                step.set(Late::FirstPixel, first_pixel as u32)?;
                step.set(Late::BatchPixels, batch_pixels as u32)?;
            }
            let paths = batch_pixels * shape.samples;
            self.follow_paths(&mut run, shape.slots, |given, active| {
                let done = (given.min(paths) - active) as f64 / paths.max(1) as f64;
                progress((first_pixel as f64 + done * batch_pixels as f64) / pixels as f64);
            })?;
            self.film.launch(&run.plan, batch_pixels, work_group)?;
        }
        self.wait(&mut run)?;
        picture.take_counts(&mut run.rendered.counts)?;
        run.rendered.wavefront = Some(run.stats);
        Ok(run.rendered)
    }

    /// Follows all paths of a batch to their ends. `progress` is told how many were given to slots, and how many are in
    /// flight.
    fn follow_paths(&mut self, run: &mut Run, slots: usize, progress: impl Fn(usize, usize)) -> Result<()> {
        let state = run.state;
        state.begin_batch()?;
        let [mut queue, mut other_queue] = [&state.queues[0], &state.queues[1]];
        self.set_queues(queue, other_queue)?;
        let (mut active, mut traced, mut largest) = (slots, 0, 0);
        loop {
            self.camera.launch(&run.plan, active, run.work_group)?;
            // Waits for the wave before, too, whose list of shadow rays is still there.
            let lengths = state.lengths.read()?;
            let tracing_s = self.wait(run)?;
            let shadow_rays: usize = lengths[QUEUE_SHADOWS as usize..].iter().map(|&n| n as usize).sum();
            run.plan.learn_from_several(largest, traced + shadow_rays, tracing_s);
            if let Some(resolved) = &mut run.rendered.second_pass {
                *resolved += u64::from(lengths[QUEUE_RESOLVED as usize]);
            }
            active = lengths[QUEUE_ACTIVE as usize] as usize;
            progress(lengths[QUEUE_PATHS as usize] as usize, active);
            if active == 0 {
                return Ok(());
            }
            run.take_counts(active * (1 + self.setup.lights))?;
            run.stats.waves += 1;
            traced = active;
            swap(&mut queue, &mut other_queue);
            self.set_queues(queue, other_queue)?;
            largest = self.trace.launch(&run.plan, active, run.work_group)?;
            if let Some(second) = &mut self.second {
                second.trace.launch(&run.plan, active, run.work_group)?;
            }
            self.evaluate_textures(run, active)?;
            self.shade.launch(&run.plan, active, run.work_group)?;
            for light in 0..self.setup.lights as u32 {
                let second = self.second.as_mut().map(|second| &mut second.shadow);
                for step in [&mut self.light, &mut self.shadow].into_iter().chain(second) {
                    step.set(Late::Light, light)?;
                    // Only the device knows how long their lists are; items behind the end have nothing to do.
                    step.launch(&run.plan, active, run.work_group)?;
                }
            }
        }
    }

    fn set_queues(&mut self, queue: &Buffer<u32>, other_queue: &Buffer<u32>) -> Result<()> {
        for step in self.steps() {
            step.set(Late::Queue, queue)?;
            step.set(Late::OtherQueue, other_queue)?;
        }
        Ok(())
    }

    /// Waits for all kernels; returns the seconds of those that trace rays.
    fn wait(&mut self, run: &mut Run) -> Result<f64> {
        let mut tracing_s = 0.0;
        for step in self.steps() {
            let (launches, seconds) = step.wait()?;
            run.stats.launches += launches;
            run.rendered.kernel_s += seconds;
            if step.traces {
                tracing_s += seconds;
            }
        }
        Ok(tracing_s)
    }

    /// The host's pass between tracing and shading (thesis, section 5.2.2), where there is one: fetches the hits on
    /// textured surfaces, evaluates the textures as the twin does, and sends the colours.
    fn evaluate_textures(&mut self, run: &mut Run, active: usize) -> Result<()> {
        let Some((buffers, options)) = &self.host_textures else { return Ok(()) };
        self.request.launch(&run.plan, active, run.work_group)?;
        let mut lengths = [0; QUEUE_TEXTURED as usize + 1];
        run.state.lengths.read_into(0, &mut lengths)?;
        let start = Instant::now(); // the kernels before are done
        let mut requests = vec![TextureRequest::default(); lengths[QUEUE_TEXTURED as usize] as usize];
        run.state.requests.read_into(0, &mut requests)?;
        run.state.colours.write(&texture_colours(buffers, options, &requests))?;
        run.stats.host_colours += requests.len() as u64;
        run.stats.host_pass_s += start.elapsed().as_secs_f64();
        Ok(())
    }
}
