//! Rendering with several kernels (`cl/kernels/split.cl`): what pixels keep on the device from wave to wave, and the host's part of a
//! wave, which is to launch each kernel over the right number of slots and, where it is asked to, to evaluate textures.

use super::launch::LaunchPlan;
use super::scene::DeviceScene;
use super::tracer::{PictureBuffers, Rendered};
use super::{Buffer, CompileOptions, DeviceContext, Event, Kernel, Program};
use crate::error::Result;
use crate::layout::Float4;
use crate::options::{TexturePass, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::texture_colours;
use crate::shared::{
    Hit, NO_PIXEL, QUEUE_ACTIVE, QUEUE_PIXELS, QUEUE_SHADOWS, QUEUE_TEXTURED, RenderParams, SplitRay, SplitShadow,
    SplitSlot, SplitSurface, SplitYield, TextureRequest,
};
use crate::tracer::{Progress, SplitStats};
use std::sync::Arc;
use std::time::Instant;

/// Memory for the state of the pixels in flight: at 660 bytes each with a depth of 8 room for 400,000, which is more than the largest
/// GPUs run work-items at a time. Smaller devices give half of the memory that they have left.
const STATE_BYTES: u64 = 256 << 20;

/// One kernel, and its launches that nobody has waited for yet.
struct Step {
    kernel: Kernel,
    running: Vec<Event>,
}

/// The number, counted from the end, of an argument that changes from launch to launch: the last of `SPLIT_ARGUMENTS`.
const QUEUE: usize = 5;
const OTHER_QUEUE: usize = 4;
const LIGHT: usize = 3;
const FIRST: usize = 2;
const END: usize = 1;

impl Step {
    fn new(program: &Program, name: &str) -> Result<Self> {
        Ok(Step { kernel: program.kernel(name)?, running: Vec::new() })
    }

    fn set_late<'a>(&mut self, from_end: usize, value: impl Into<super::KernelArg<'a>>) -> Result<()> {
        self.kernel.set_arg(self.kernel.arg_count() - from_end, value)
    }

    /// Starts the kernel over items `0..total`, in parts that `plan` sizes. Returns the items of the largest.
    fn launch(&mut self, plan: &LaunchPlan, total: usize, work_group: usize) -> Result<usize> {
        let (mut first, mut largest) = (0, 0);
        while first < total {
            let items = plan.next(total - first, work_group);
            self.set_late(FIRST, first as u32)?;
            self.set_late(END, (first + items) as u32)?;
            self.running.push(self.kernel.launch(&[items.next_multiple_of(work_group)], Some(&[work_group]))?);
            first += items;
            largest = largest.max(items);
        }
        Ok(largest)
    }

    /// Waits for all launches; how many they were, and their seconds.
    fn wait(&mut self) -> Result<(u64, f64)> {
        let launches = self.running.len() as u64;
        let seconds: Result<f64> = self.running.drain(..).map(|event| event.wait()).sum();
        Ok((launches, seconds?))
    }
}

/// The kernels.
pub(super) struct SplitPipeline {
    camera: Step,
    trace: Step,
    request: Step,
    shade: Step,
    light: Step,
    shadow: Step,
    light_count: u32,
    pixels_in_flight: Option<u32>,
    /// The scene, where the host evaluates its textures.
    host_textures: Option<Arc<SceneBuffers>>,
}

/// Everything that lies on the device between two kernels.
struct State {
    slots: Buffer<SplitSlot>,
    rays: Buffer<SplitRay>,
    hits: Buffer<Hit>,
    surfaces: Buffer<SplitSurface>,
    yields: Buffer<SplitYield>,
    shadows: Buffer<SplitShadow>,
    requests: Buffer<TextureRequest>,
    colours: Buffer<Float4>,
    lengths: Buffer<u32>,
    queues: [Buffer<u32>; 2],
}

impl State {
    /// Bytes of one slot, `depth` pending rays and, with `host_textures`, a request among them: of all arrays, and of the largest.
    fn slot_bytes(depth: usize, host_textures: bool) -> (u64, u64) {
        let rays = depth * size_of::<SplitRay>();
        let requests = if host_textures { size_of::<TextureRequest>() + size_of::<Float4>() } else { 0 };
        let others = [size_of::<SplitSlot>(), size_of::<Hit>(), size_of::<SplitSurface>(), size_of::<SplitYield>()];
        let shadows_and_queues = size_of::<SplitShadow>() + 2 * size_of::<u32>();
        let all = rays + requests + others.iter().sum::<usize>() + shadows_and_queues;
        (all as u64, rays.max(size_of::<SplitSurface>()) as u64)
    }

    /// How many slots the device has memory for, unless so many are `wanted`; never more than pixels.
    fn slot_count(
        context: &DeviceContext,
        (pixel_count, depth): (usize, usize),
        host_textures: bool,
        wanted: Option<u32>,
    ) -> usize {
        let info = context.info();
        let (all_bytes, largest_bytes) = Self::slot_bytes(depth, host_textures);
        // A limit of 0 is unknown.
        let known = |limit: u64| if limit == 0 { u64::MAX } else { limit };
        let free_bytes = known(info.global_memory_bytes).saturating_sub(context.allocated_bytes()) / 2;
        let fitting = (STATE_BYTES.min(free_bytes) / all_bytes).min(known(info.max_alloc_bytes) / largest_bytes);
        let slots = wanted.map_or(fitting as usize, |wanted| wanted as usize).max(1);
        // Every slot asks for pixels once more than there are some, and that number has 32 bits.
        slots.min(pixel_count).min((u32::MAX as usize).saturating_sub(pixel_count))
    }

    fn new(
        context: &DeviceContext,
        slot_count: usize,
        depth: usize,
        light_count: u32,
        host_textures: bool,
    ) -> Result<Self> {
        let idle = SplitSlot { pixel: NO_PIXEL, ..SplitSlot::default() };
        let all_slots: Vec<u32> = (0..slot_count as u32).collect();
        let requests = if host_textures { slot_count } else { 0 };
        Ok(State {
            slots: Buffer::read_write(context, "pixels in flight", &vec![idle; slot_count])?,
            rays: Buffer::empty(context, "pending rays", slot_count * depth)?,
            hits: Buffer::empty(context, "hits", slot_count)?,
            surfaces: Buffer::empty(context, "surfaces", slot_count)?,
            yields: Buffer::empty(context, "radiance of rays", slot_count)?,
            shadows: Buffer::empty(context, "shadow rays", slot_count)?,
            requests: Buffer::empty(context, "texture requests", requests)?,
            colours: Buffer::empty(context, "texture colours", requests)?,
            lengths: Buffer::read_write(
                context,
                "lengths of queues",
                &vec![0; (QUEUE_SHADOWS + light_count) as usize],
            )?,
            queues: [
                Buffer::read_write(context, "queue", &all_slots)?,
                Buffer::read_write(context, "other queue", &all_slots)?,
            ],
        })
    }

    /// Sets all arguments but those of the launch.
    fn set_arguments(&self, step: &mut Step, scene: &DeviceScene, picture: &PictureBuffers) -> Result<()> {
        picture
            .arguments(scene, &mut step.kernel)?
            .set(&self.slots)?
            .set(&self.rays)?
            .set(&self.hits)?
            .set(&self.surfaces)?
            .set(&self.yields)?
            .set(&self.shadows)?
            .set(&self.requests)?
            .set(&self.colours)?
            .set(&self.lengths)?
            .set(self.slots.len() as u32)?
            .set(&self.queues[0])?
            .set(&self.queues[1])?
            .set(0u32)?;
        Ok(())
    }
}

impl SplitPipeline {
    /// Adds the definitions that its kernels look at.
    pub fn define(compile: CompileOptions, options: &TraceOptions) -> CompileOptions {
        compile.define("HOST_TEXTURES", u32::from(options.textures == TexturePass::HostPass))
    }

    pub fn new(program: &Program, buffers: &Arc<SceneBuffers>, options: &TraceOptions) -> Result<Self> {
        Ok(SplitPipeline {
            camera: Step::new(program, "split_camera")?,
            trace: Step::new(program, "split_trace")?,
            request: Step::new(program, "split_request")?,
            shade: Step::new(program, "split_shade")?,
            light: Step::new(program, "split_light")?,
            shadow: Step::new(program, "split_shadow")?,
            light_count: buffers.params.light_count,
            pixels_in_flight: options.pixels_in_flight,
            host_textures: (options.textures == TexturePass::HostPass).then(|| buffers.clone()),
        })
    }

    fn steps(&mut self) -> [&mut Step; 6] {
        [&mut self.camera, &mut self.trace, &mut self.request, &mut self.shade, &mut self.light, &mut self.shadow]
    }

    /// Renders a picture; `first_items`: of the first launch of each kernel.
    pub fn render(
        &mut self,
        context: &DeviceContext,
        scene: &DeviceScene,
        picture: &PictureBuffers,
        params: &RenderParams,
        (first_items, work_group): (usize, usize),
        progress: Progress,
    ) -> Result<Rendered> {
        let pixel_count = params.width as usize * params.height as usize;
        // A ray at the depth limit leaves no others, and each one before leaves one more than it was itself.
        let depth = params.max_depth.max(1) as usize;
        let host_textures = self.host_textures.is_some();
        let slot_count = State::slot_count(context, (pixel_count, depth), host_textures, self.pixels_in_flight);
        let state = State::new(context, slot_count, depth, self.light_count, host_textures)?;
        for step in self.steps() {
            state.set_arguments(step, scene, picture)?;
        }

        let mut rendered = Rendered::default();
        let mut stats =
            SplitStats { pixels_in_flight: slot_count, waves: 0, launches: 0, host_colours: 0, host_pass_s: 0.0 };
        let mut plan = LaunchPlan::starting_with(first_items);
        let (mut active, mut largest) = (slot_count, 0);
        let mut uncounted = 0;
        loop {
            self.camera.launch(&plan, active, work_group)?;
            // Waits for the wave before, too, whose lists of shadow rays are still there.
            let lengths = state.lengths.read()?;
            let shadow_rays: usize = lengths[QUEUE_SHADOWS as usize..].iter().map(|&n| n as usize).sum();
            let traced = if stats.waves > 0 { active } else { 0 };
            let tracing_s = self.wait(&mut rendered, &mut stats)?;
            plan.learn_from_several(largest, traced + shadow_rays, tracing_s);
            active = lengths[QUEUE_ACTIVE as usize] as usize;
            let pixels_left = pixel_count.saturating_sub(lengths[QUEUE_PIXELS as usize] as usize) + active;
            progress(1.0 - pixels_left as f64 / pixel_count.max(1) as f64);
            // A counter has 32 bits, and in one wave none is raised more often than this.
            let most = active * (1 + self.light_count as usize);
            uncounted += most;
            if active == 0 || uncounted > u32::MAX as usize {
                picture.take_counts(&mut rendered.counts)?;
                uncounted = most;
            }
            if active == 0 {
                break;
            }

            stats.waves += 1;
            let queue = &state.queues[(stats.waves % 2) as usize];
            let other_queue = &state.queues[(1 - stats.waves % 2) as usize];
            for step in self.steps() {
                step.set_late(QUEUE, queue)?;
                step.set_late(OTHER_QUEUE, other_queue)?;
            }
            largest = self.trace.launch(&plan, active, work_group)?;
            self.evaluate_textures(&state, &plan, (active, work_group), &mut stats)?;
            self.shade.launch(&plan, active, work_group)?;
            for light in 0..self.light_count {
                for step in [&mut self.light, &mut self.shadow] {
                    step.set_late(LIGHT, light)?;
                    // The lists' lengths are only known to the device; items behind their ends have nothing to do.
                    step.launch(&plan, active, work_group)?;
                }
            }
        }
        rendered.split = Some(stats);
        Ok(rendered)
    }

    /// Waits for all kernels; returns the seconds of those that trace rays.
    fn wait(&mut self, rendered: &mut Rendered, stats: &mut SplitStats) -> Result<f64> {
        let mut tracing_s = 0.0;
        for (i, step) in self.steps().into_iter().enumerate() {
            let (launches, seconds) = step.wait()?;
            stats.launches += launches;
            rendered.kernel_s += seconds;
            const TRACING: [usize; 2] = [1, 5];
            tracing_s += if TRACING.contains(&i) { seconds } else { 0.0 };
        }
        Ok(tracing_s)
    }

    /// The host's pass between tracing and shading (thesis, section 5.2.2), where there is one: fetches the hits on textured surfaces,
    /// evaluates the textures as the twin does, sends the colours.
    fn evaluate_textures(
        &mut self,
        state: &State,
        plan: &LaunchPlan,
        (active, work_group): (usize, usize),
        stats: &mut SplitStats,
    ) -> Result<()> {
        let Some(buffers) = &self.host_textures else { return Ok(()) };
        self.request.launch(plan, active, work_group)?;
        let mut lengths = [0; QUEUE_TEXTURED as usize + 1];
        state.lengths.read_into(0, &mut lengths)?;
        let start = Instant::now();
        let mut requests = vec![TextureRequest::default(); lengths[QUEUE_TEXTURED as usize] as usize];
        state.requests.read_into(0, &mut requests)?;
        state.colours.write(&texture_colours(buffers, &requests))?;
        stats.host_colours += requests.len() as u64;
        stats.host_pass_s += start.elapsed().as_secs_f64();
        Ok(())
    }
}
