//! The OpenCL tracer: uploads a scene once, then traces batches and renders pictures on the device.

use super::passes::{Doubts, Entry, Passes};
use super::scene::DeviceScene;
use super::{Buffer, Cache, CompileOptions, DeviceContext, DeviceHandle, DeviceKind, Kernel, KernelArg};
use crate::error::Result;
use crate::film::Film;
use crate::layout::Float4;
use crate::options::{Intersector, TraceOptions};
use crate::pack::SceneBuffers;
use crate::shared::{COUNTER_SLOTS, COUNTERS, Hit, RenderParams, TILE_SIDE};
use crate::tracer::{Progress, RenderResult, TraceJob, TraceResult, Tracer};
use crate::work::{PixelWork, RayWork};
use bytemuck::Pod;
use std::time::Instant;

/// Work is cut into launches of about this length, so that desktops stay alive and watchdogs (typically 2 s) quiet.
const LAUNCH_S: f64 = 0.1;
/// The first launch of a kernel, whose speed is not known yet, has this many samples or rays: 0.1 s at 40,000 rays a second, which
/// is slower than any device that was seen.
pub(super) const FIRST_ITEMS: usize = 4096;
/// GPUs are not full with that; 16 times as much is still a moment on the smallest.
const FIRST_ITEMS_GPU: usize = 1 << 16;
/// A launch is at most this many times as large as the largest one before: one part of a picture may be much slower than another.
const GROWTH: usize = 2;

/// How many work-items a launch may have, learnt from the launches before.
#[derive(Debug)]
pub(super) struct LaunchPlan {
    largest: usize,
    seconds_per_item: f64,
}

impl LaunchPlan {
    /// A plan whose first launch has about `first` items.
    pub fn starting_with(first: usize) -> Self {
        LaunchPlan { largest: first.max(1).div_ceil(GROWTH), seconds_per_item: 0.0 }
    }

    /// Items of the next launch when `left` remain; a multiple of `multiple` unless it is the last.
    fn next(&self, left: usize, multiple: usize) -> usize {
        let in_time = (LAUNCH_S / self.seconds_per_item.max(1e-12)) as usize;
        let items = in_time.clamp(1, GROWTH * self.largest).next_multiple_of(multiple);
        // A rest of less than half a launch goes along: its own launch would leave units idle twice.
        if items + items / 2 >= left { left } else { items }
    }

    fn learn(&mut self, items: usize, seconds: f64) {
        if items > 0 {
            self.seconds_per_item = seconds / items as f64;
            self.largest = self.largest.max(items);
        }
    }
}

/// A tracer on an OpenCL device.
pub struct OpenClTracer {
    context: DeviceContext,
    scene: DeviceScene,
    passes: Passes,
    trace_plan: LaunchPlan,
    first_items: usize,
    work_group: usize,
    counters: bool,
    compile_s: f64,
    upload_s: f64,
    notes: Vec<String>,
}

/// Passes arguments to a kernel one after the other.
pub(super) struct Arguments<'a> {
    kernel: &'a mut Kernel,
    next: usize,
}

impl<'k> Arguments<'k> {
    fn of(kernel: &'k mut Kernel) -> Self {
        Arguments { kernel, next: 0 }
    }

    pub fn set<'a>(mut self, value: impl Into<KernelArg<'a>>) -> Result<Self> {
        self.kernel.set_arg(self.next, value)?;
        self.next += 1;
        Ok(self)
    }

    /// Passes the array of work records, which only kernels that count have as an argument.
    pub fn set_work<T: Pod>(self, work: &Option<Buffer<T>>) -> Result<Self> {
        match work {
            Some(work) => self.set(work),
            None => Ok(self),
        }
    }
}

/// The definitions of kernels that trace `buffers` with `options`, in chains of at most `max_depth` rays.
pub(super) fn compile_options(buffers: &SceneBuffers, options: &TraceOptions, max_depth: u32) -> CompileOptions {
    // A deeper stack than needed costs memory on every work-item, a recompilation for every depth costs seconds: steps of 16
    // and 8 bound both.
    let compile_options = CompileOptions::new()
        .define("TRAVERSE", options.cl_traverse())
        .define("INTERSECT", options.intersector.cl_function())
        .define("NEARER", options.intersector.cl_nearer())
        .define("STACK_SIZE", buffers.build_options.max_depth.max(1).next_multiple_of(16))
        .define("SHORT_STACK_SIZE", options.short_stack_size())
        .define("MAX_PENDING", (max_depth + 1).next_multiple_of(8));
    DeviceScene::define(compile_options, buffers, options)
}

/// Whether rare decisions are left to a second pass. Kernels that count keep them: what they count is the point, not their speed.
pub(super) fn defers(options: &TraceOptions) -> bool {
    options.intersector == Intersector::Exact && !options.counters
}

/// Passes the scene, with which every kernel's arguments begin.
pub(super) fn geometry_arguments<'k>(scene: &DeviceScene, kernel: &'k mut Kernel) -> Result<Arguments<'k>> {
    let mut arguments = Arguments::of(kernel)
        .set(&scene.nodes)?
        .set(&scene.references)?
        .set(&scene.vertices)?
        .set(&scene.bounds)?
        .set(&scene.transforms)?;
    if let Some(nodes) = &scene.constant_nodes {
        arguments = arguments.set(nodes)?;
    }
    if let Some(vertices) = &scene.surface_vertices {
        arguments = arguments.set(vertices)?;
    }
    arguments.set(&scene.params)
}

/// Launches `kernel` over items `0..total` in parts, its last two arguments being the first item and the end of a part. Returns
/// seconds of device time.
pub(super) fn launch(
    kernel: &mut Kernel,
    plan: &mut LaunchPlan,
    (total, work_group): (usize, usize),
    mut progress: impl FnMut(usize),
) -> Result<f64> {
    let bounds = kernel.arg_count() - 2;
    let mut seconds = 0.0;
    let mut first = 0;
    while first < total {
        let items = plan.next(total - first, work_group);
        kernel.set_arg(bounds, first as u32)?;
        kernel.set_arg(bounds + 1, (first + items) as u32)?;
        let event = kernel.launch(&[items.next_multiple_of(work_group)], Some(&[work_group]))?;
        let launch_s = event.wait()?;
        plan.learn(items, launch_s);
        seconds += launch_s;
        first += items;
        progress(items);
    }
    Ok(seconds)
}

impl OpenClTracer {
    /// Compiles the kernels for `options` (or loads them from `cache`) and sends the scene to the device.
    ///
    /// `max_depth` is the longest chain of rays that [`Tracer::render`] will be asked for.
    ///
    /// # Errors
    /// The device cannot be opened, its compiler refuses the kernels, or the scene does not fit into its memory.
    pub fn new(
        device: &DeviceHandle,
        buffers: &SceneBuffers,
        options: &TraceOptions,
        max_depth: u32,
        cache: Option<&Cache>,
    ) -> Result<Self> {
        let context = DeviceContext::open(device)?;
        let compile_options = compile_options(buffers, options, max_depth);
        let (passes, compile_s, notes) = Passes::new(&context, compile_options, defers(options), cache)?;

        let start = Instant::now();
        let scene = DeviceScene::upload(&context, buffers, options)?;
        // CPU runtimes run a work-group as a loop on one thread and keep its private arrays at once: small groups stay in cache.
        let (work_group, first_items) = match context.info().kind {
            DeviceKind::Gpu => (64, FIRST_ITEMS_GPU),
            _ => (16, FIRST_ITEMS),
        };
        Ok(OpenClTracer {
            passes,
            trace_plan: LaunchPlan::starting_with(first_items),
            first_items,
            counters: options.counters,
            work_group: work_group.min(context.info().max_work_group_size.max(1)),
            compile_s,
            upload_s: start.elapsed().as_secs_f64(),
            notes,
            scene,
            context,
        })
    }

    /// Room for `count` work records, if the kernels count.
    fn work_buffer<T: Pod>(&self, count: usize) -> Result<Option<Buffer<T>>> {
        self.counters.then(|| Buffer::empty(&self.context, "work records", count)).transpose()
    }
}

impl Tracer for OpenClTracer {
    fn device_name(&self) -> &str {
        &self.context.info().name
    }

    fn compile_s(&self) -> f64 {
        self.compile_s
    }

    fn upload_s(&self) -> f64 {
        self.upload_s
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        let total = job.rays.len();
        let start = Instant::now();
        let rays = Buffer::from_slice(&self.context, "rays", job.rays)?;
        let hits = Buffer::<Hit>::empty(&self.context, "hits", total)?;
        let directions = Buffer::from_slice(&self.context, "next directions", job.next_directions.unwrap_or_default())?;
        let next_hits = Buffer::<Hit>::empty(&self.context, "next hits", job.next_directions.map_or(0, <[_]>::len))?;
        let ray_work = self.work_buffer::<RayWork>(total)?;
        let next_work = self.work_buffer::<RayWork>(next_hits.len())?;
        self.context.finish()?;
        let mut result = TraceResult { upload_s: start.elapsed().as_secs_f64(), ..TraceResult::default() };

        let doubts = Doubts::new(&self.context, self.passes.defers, total)?;
        let OpenClTracer { context, scene, passes, trace_plan, work_group, .. } = self;
        let first_entry = if job.any_hit { Entry::TraceAny } else { Entry::TraceClosest };
        let set_first = |kernel: &mut Kernel| {
            geometry_arguments(scene, kernel)?
                .set(&rays)?
                .set(&hits)?
                .set_work(&ray_work)?
                .set(&doubts.items)
                .map(|_| ())
        };
        let set_next = |kernel: &mut Kernel| {
            let arguments = geometry_arguments(scene, kernel)?.set(&directions)?.set(&hits)?.set(&next_hits)?;
            arguments.set_work(&next_work)?.set(&doubts.items).map(|_| ())
        };
        let mut done = 0;
        let work = (total * job.repeat as usize).max(1) as f64;
        for _ in 0..job.repeat {
            let shape = (total, *work_group);
            let mut seconds = passes.run(context, first_entry, &set_first, trace_plan, shape, &doubts, |items| {
                done += items;
                progress(done as f64 / work);
            })?;
            if job.next_directions.is_some() {
                seconds += passes.run(context, Entry::TraceNext, &set_next, trace_plan, shape, &doubts, |_| ())?;
            }
            result.kernel_s.push(seconds);
        }
        result.second_pass = doubts.resolved();

        let start = Instant::now();
        result.hits = hits.read()?;
        result.next_hits = job.next_directions.map(|_| next_hits.read()).transpose()?;
        result.work = ray_work.map(|work| work.read()).transpose()?;
        result.next_work = next_work.filter(|_| job.next_directions.is_some()).map(|work| work.read()).transpose()?;
        result.read_s = start.elapsed().as_secs_f64();
        Ok(result)
    }

    fn render(&mut self, params: &RenderParams, samples: &[[f32; 2]], progress: Progress) -> Result<RenderResult> {
        let pixel_count = params.width as usize * params.height as usize;
        let render_params = Buffer::from_slice(&self.context, "picture parameters", &[*params])?;
        let sample_buffer = Buffer::from_slice(&self.context, "samples", samples)?;
        let film = Buffer::<Float4>::empty(&self.context, "picture", pixel_count)?;
        let counters = Buffer::<u32>::read_write(&self.context, "counters", &[0; COUNTER_SLOTS as usize * COUNTERS])?;
        let work = self.work_buffer::<PixelWork>(pixel_count)?;
        let tiles = params.width.div_ceil(TILE_SIDE) as usize * params.height.div_ceil(TILE_SIDE) as usize;
        let items = tiles * (TILE_SIDE * TILE_SIDE) as usize;
        let doubts = Doubts::new(&self.context, self.passes.defers, items)?;
        let OpenClTracer { context, scene, passes, .. } = self;
        let set = |kernel: &mut Kernel| {
            geometry_arguments(scene, kernel)?
                .set(&scene.shading)?
                .set(&scene.materials)?
                .set(&scene.lights)?
                .set(&scene.textures)?
                .set(&scene.texels)?
                .set(&scene.srgb_to_linear)?
                .set(&render_params)?
                .set(&sample_buffer)?
                .set(&film)?
                .set(&counters)?
                .set_work(&work)?
                .set(&doubts.items)
                .map(|_| ())
        };
        let mut counts = [0; COUNTERS];
        let mut done = 0;
        let mut failed = None;
        // A work-item traces all samples of its pixel.
        let mut plan = LaunchPlan::starting_with(self.first_items / samples.len().max(1));
        let kernel_s =
            passes.run(context, Entry::Render, &set, &mut plan, (items, self.work_group), &doubts, |launched| {
                done += launched;
                progress((done as f64 / items as f64).min(1.0));
                // After every launch, because a 32-bit counter could overflow over a whole picture.
                failed = failed.take().or(take_counts(&counters, &mut counts).err());
            })?;
        if let Some(error) = failed {
            return Err(error);
        }

        let start = Instant::now();
        let pixels = film.read()?.into_iter().map(|pixel| [pixel.x, pixel.y, pixel.z]).collect();
        let film = Film { width: params.width, height: params.height, pixels };
        let work = work.map(|work| work.read()).transpose()?;
        let second_pass = doubts.resolved();
        Ok(RenderResult { film, counts, work, second_pass, kernel_s, read_s: start.elapsed().as_secs_f64() })
    }
}

/// Adds the device's counters to `counts` and clears them.
fn take_counts(counters: &Buffer<u32>, counts: &mut [u64; COUNTERS]) -> Result<()> {
    for slot in counters.read()?.chunks_exact(COUNTERS) {
        for (count, &value) in counts.iter_mut().zip(slot) {
            *count += u64::from(value);
        }
    }
    counters.write(&[0; COUNTER_SLOTS as usize * COUNTERS])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Plans `total` items on a device that takes `seconds(item)` for each; returns the launches' items and seconds.
    fn launches(total: usize, first: usize, seconds: impl Fn(usize) -> f64) -> Vec<(usize, f64)> {
        let mut plan = LaunchPlan::starting_with(first);
        let mut all = Vec::new();
        let mut done = 0;
        while done < total {
            let items = plan.next(total - done, 64);
            let time = (done..done + items).map(&seconds).sum();
            plan.learn(items, time);
            all.push((items, time));
            done += items;
        }
        assert_eq!(done, total);
        all
    }

    #[test]
    fn no_launch_is_long_on_slow_devices_or_in_slow_parts() {
        // 50,000 rays a second; a part that takes twice as long; a cost that grows a hundredfold across the picture.
        for all in [
            launches(200_000, FIRST_ITEMS, |_| 2e-5),
            launches(1_000_000, FIRST_ITEMS, |i| if (400_000..500_000).contains(&i) { 1e-5 } else { 5e-6 }),
            launches(1_000_000, FIRST_ITEMS_GPU, |i| 1e-8 + 1e-6 * (i as f64 / 1e6)),
        ] {
            let longest = all.iter().map(|launch| launch.1).fold(0.0, f64::max);
            assert!(longest <= 0.3, "{longest} s");
        }
    }

    #[test]
    fn fast_devices_get_few_launches() {
        let all = launches(16 << 20, FIRST_ITEMS_GPU, |_| 2.5e-10);
        assert!(all.len() <= 10, "{all:?}");
    }
}
