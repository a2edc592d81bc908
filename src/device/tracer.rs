//! The OpenCL tracer: uploads a scene once, then traces batches and renders pictures on the device.

use super::adaptive::{AdaptiveProgram, DevicePixels};
use super::all_hits::Lister;
use super::batch::{DeviceBatch, Order};
use super::defaults::{who_decides, work_group_size};
use super::deferred::Deferred;
use super::definitions::Definitions;
use super::entry::Entry;
use super::in_place::Place;
use super::launch::{Arguments, FIRST_ITEMS, FIRST_ITEMS_GPU, LaunchPlan};
use super::on_host::{Host, OnHost};
use super::passes::Passes;
use super::picture::{Launches, PictureBuffers, RenderLists, Rendered, items_of};
use super::points::PointProgram;
use super::rows::Rows;
use super::scene::DeviceScene;
use super::stream::{PINNED_BYTES, StreamBuffers, Streaming, is_worth_streaming, transferred_bytes};
use super::wavefront::WavefrontPipeline;
use super::{Buffer, Cache, DeviceContext, DeviceHandle, DeviceInfo, DeviceKind, Kernel};
use crate::blocks::Blocks;
use crate::error::{Error, Result};
use crate::features::Features;
use crate::io::film::{Film, FilmPlace};
use crate::layout::Float4;
use crate::options::{Decisions, Intersector, Kernels, Memory, PacketSize, RayOrder, TraceOptions};
use crate::pack::SceneBuffers;
use crate::ray_order::{SortRoom, Sorted};
use crate::reference::extreme::{all_extreme, answer_extreme};
use crate::shared::{COUNTERS, CameraSample, Hit, Light, RenderParams};
use crate::tracer::{
    Adaptive, AllHits, AllHitsJob, Backend, Candidates, CandidatesJob, Progress, RayStream, RenderResult, Spent, Task,
    TraceJob, TraceResult, check_lights,
};
use crate::work::{PixelWork, RayWork};
use bytemuck::Pod;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// How many samples of a pixel a launch traces at most where each is an item: a GPU's lanes that run in step then have
/// the samples of one pixel or two. showcase.toml, 4096 x 4096, 64 samples, on an H200: 7.9 s with 8, 7.0 with 16, 6.4
/// with 32, 6.1 with 64, and 10.8 with pixels as items.
const MOST_SAMPLES_APART: u32 = 64;
/// The most items that are samples for which there is room on a device: 64 MiB on CPUs, 256 MiB on GPUs, where twice as
/// many gain 3 %.
fn most_apart(kind: DeviceKind) -> u64 {
    if kind == DeviceKind::Gpu { 1 << 24 } else { 1 << 22 }
}
/// With less it is not worth while.
const LEAST_APART: u64 = 1 << 16;
/// They take no more of the memory that a device has left than one part in so many.
const PART_OF_MEMORY: u64 = 4;

/// Of how many samples each pixel must be for them to be apart. Packets of samples of few pixels are faster than
/// packets of pixels where rays part at curved surfaces: PoCL, two cores, 512 x 512, 16 samples: gears 1.71, glass.toml
/// 1.37, showcase.toml 1.32 times as fast, with 4 samples 1.18, 1.14, 1.11. Without secondary rays bunny .98, sponza
/// 1.02, with 4 samples .97 and .95.
fn least_samples_apart(kind: DeviceKind, features: Features, options: &TraceOptions) -> u32 {
    match options.packet_size {
        _ if kind == DeviceKind::Gpu => 2,
        PacketSize::Sixteen if features.in_kernels(options.picture.features).send_rays() => 4,
        _ => u32::MAX,
    }
}

/// What parts of a picture have in common: the camera, and how often a pixel is sampled.
type PlanKey = ([Float4; 4], u32);

fn plan_key(params: &RenderParams) -> PlanKey {
    ([params.eye, params.forward, params.right, params.up], params.sample_count)
}

/// A tracer on an OpenCL device.
pub struct OpenClBackend {
    context: DeviceContext,
    scene: DeviceScene,
    passes: Passes,
    /// What renders in place of the mega-kernel, once it was needed.
    wavefront: Option<Box<WavefrontPipeline>>,
    /// What decides which pixels have more samples, once it was needed.
    adaptive: Option<AdaptiveProgram>,
    /// What finds triangles near points, once it was needed.
    points: Option<PointProgram>,
    /// What is kept of batches that stream, once there was one.
    stream: Option<StreamBuffers>,
    /// The same of batches that are traced in place.
    place: Option<Place>,
    buffers: Arc<SceneBuffers>,
    options: TraceOptions,
    /// Whether the host settles few items that are deferred.
    asks_host: bool,
    trace_plan: LaunchPlan,
    first_items: usize,
    work_group: usize,
    /// Of how many samples each pixel must be for each to be an item of its own, where there is room for that.
    least_samples_apart: u32,
    upload_s: f64,
    /// How the launches of the last picture went, for the next part of it; and what tells that it is one.
    picture_plan: Option<(PlanKey, LaunchPlan)>,
    /// Seconds that a sample of the last pictures took where they took most, if something may stop them.
    dearest_sample_s: f64,
}

/// Kernels that are compiled while the scene's structure is built.
pub(crate) struct CompiledAhead {
    context: DeviceContext,
    passes: Passes,
}

impl CompiledAhead {
    /// Opens `device` and compiles what a tracer with `options` takes for `tasks` in nearly all scenes of such
    /// `features`.
    ///
    /// # Errors
    /// As [`OpenClBackend::new`] and [`Backend::prepare`].
    pub fn new(
        device: &DeviceHandle,
        features: Features,
        options: &TraceOptions,
        max_depth: u32,
        cache: Option<&Cache>,
        tasks: &[Task],
    ) -> Result<Self> {
        check_runtime(&device.info, options)?;
        let context = DeviceContext::open(device)?;
        let definitions = Definitions::of_features(features, options, max_depth);
        let mut passes = Passes::new(definitions, cache, context.info(), notes_on(context.info()));
        // What is in constant memory the scene decides; wavefront kernels are compiled when their pipeline is made.
        if options.arrays.memory != Memory::Constant && options.picture.kernels == Kernels::Mega {
            for entry in tasks.iter().filter_map(|&task| Entry::of_task(task, options)) {
                passes.prepare(&context, entry)?;
            }
        }
        Ok(CompiledAhead { context, passes })
    }
}

/// Refuses what a runtime is known to get wrong; `tests/runtimes.sh` tells how that was found.
fn check_runtime(info: &DeviceInfo, options: &TraceOptions) -> Result<()> {
    // Mesa 22.3.6: whole traces return hits that no triangle has (t = u = v = 0), although the test alone is right.
    if options.intersector == Intersector::Exact && info.platform_name == "rusticl" && info.name.contains("llvmpipe") {
        let message = format!(
            "exact gives wrong hits on device '{}': the driver miscompiles it; nearest: `intersector = watertight` \
             `kernels = wavefront`, or another `device`",
            info.name
        );
        return Err(Error::option(Intersector::OPTION, message));
    }
    Ok(())
}

/// What the device does to numbers, for `-v`.
fn notes_on(info: &DeviceInfo) -> Vec<String> {
    let flushes = "the device does not promise to keep numbers below 1.2e-38: a t, u or v that small may be 0";
    if info.denormals { Vec::new() } else { vec![flushes.to_owned()] }
}

impl OpenClBackend {
    /// Sends the scene to the device. The kernels for `options` are compiled, or loaded from `cache`, by
    /// [`Backend::prepare`]; the `cache` is not used where the driver [keeps kernels](DeviceInfo::keeps_kernels) by
    /// itself.
    ///
    /// `max_depth` is the longest chain of rays that [`Backend::render`] will be asked for.
    ///
    /// # Errors
    /// The device cannot be opened, its driver is known to get the options wrong, or the scene does not fit into its
    /// memory, or was built for another structure.
    pub fn new(
        device: &DeviceHandle,
        buffers: &Arc<SceneBuffers>,
        options: &TraceOptions,
        max_depth: u32,
        cache: Option<&Cache>,
    ) -> Result<Self> {
        Self::after(None, device, buffers, options, max_depth, cache)
    }

    /// The same with what was compiled ahead with the same options, as far as it is what this scene takes.
    pub(crate) fn after(
        ahead: Option<CompiledAhead>,
        device: &DeviceHandle,
        buffers: &Arc<SceneBuffers>,
        options: &TraceOptions,
        max_depth: u32,
        cache: Option<&Cache>,
    ) -> Result<Self> {
        buffers.check_made_for(options)?;
        check_runtime(&device.info, options)?;
        let (context, compiled) = match ahead {
            Some(CompiledAhead { context, passes }) => (context, Some(passes)),
            None => (DeviceContext::open(device)?, None),
        };
        let definitions = Definitions::new(buffers, options, max_depth);
        let passes = match compiled.filter(|passes| *passes.definitions() == definitions) {
            Some(passes) => passes,
            None => Passes::new(definitions, cache, context.info(), notes_on(context.info())),
        };
        let start = Instant::now();
        let scene = DeviceScene::upload(&context, buffers, options)?;
        let first_items = if context.info().kind == DeviceKind::Gpu { FIRST_ITEMS_GPU } else { FIRST_ITEMS };
        Ok(OpenClBackend {
            passes,
            wavefront: None,
            adaptive: None,
            points: None,
            stream: None,
            place: None,
            picture_plan: None,
            buffers: buffers.clone(),
            options: *options,
            asks_host: device.asks_host,
            trace_plan: LaunchPlan::on(&context, first_items),
            first_items,
            work_group: work_group_size(context.info()).0,
            least_samples_apart: least_samples_apart(context.info().kind, buffers.features, options),
            upload_s: start.elapsed().as_secs_f64(),
            dearest_sample_s: 0.0,
            scene,
            context,
        })
    }

    /// Whether each sample of a pixel is to be an item of its own; the pictures are the same. GPUs trace them so.
    #[doc(hidden)]
    pub fn take_samples_apart(&mut self, apart: bool) {
        self.least_samples_apart = if apart { 2 } else { u32::MAX };
    }

    /// Seconds that the host took for what it settled: see [`DeviceHandle::ask_host`].
    #[doc(hidden)]
    pub fn on_host_s(&self) -> f64 {
        self.passes.on_host_s
    }

    /// Has large transfers go through pinned memory, and batches stream, whatever the device. A GPU does so by itself
    /// once it pays.
    #[doc(hidden)]
    pub fn stage_transfers(&self) {
        self.context.stage_transfers();
    }

    /// Room for `count` work records, if the kernels count.
    fn work_buffer<T: Pod>(&self, count: usize) -> Result<Option<Buffer<T>>> {
        self.options.counters.then(|| Buffer::empty(&self.context, "work records", count)).transpose()
    }
}

impl Backend for OpenClBackend {
    fn device_name(&self) -> &str {
        &self.context.info().name
    }

    fn compile_s(&self) -> f64 {
        self.passes.compile_s
    }

    fn upload_s(&self) -> f64 {
        self.upload_s
    }

    fn options(&self) -> &TraceOptions {
        &self.options
    }

    fn has_clock(&self) -> bool {
        self.context.has_clock()
    }

    fn pixels_at_a_time(&self) -> u64 {
        self.context.info().pixels_at_a_time()
    }

    fn stop_when(&mut self, stop: Arc<AtomicBool>) {
        self.context.stop_when(stop);
        self.trace_plan = LaunchPlan::on(&self.context, self.first_items);
    }

    fn notes(&self) -> &[String] {
        &self.passes.notes
    }

    fn prepare(&mut self, task: Task) -> Result<()> {
        match (task, self.options.picture.kernels) {
            (Task::Batch | Task::Counts | Task::AllHits, _) | (Task::Picture, Kernels::Mega) => {
                Entry::of_task(task, &self.options).map_or(Ok(()), |entry| self.passes.prepare(&self.context, entry))
            }
            (Task::Points, _) => {
                if self.points.is_none() {
                    self.points = Some(PointProgram::new(&self.context, &mut self.passes, &self.buffers)?);
                }
                Ok(())
            }
            (Task::Picture, Kernels::Wavefront) => {
                if self.wavefront.is_none() {
                    let pipeline =
                        WavefrontPipeline::new(&self.context, &mut self.passes, &self.buffers, &self.options)?;
                    self.wavefront = Some(Box::new(pipeline));
                }
                Ok(())
            }
        }
    }

    fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        check_lights(&self.buffers, lights)?;
        // The host has the old ones.
        self.asks_host = false;
        self.scene.lights.write(lights)
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        self.prepare(Task::Batch)?;
        let order = self.order().of(job, &mut SortRoom::default())?;
        let mut result = self.trace_batch(job, order, progress)?;
        answer_extreme(job, &self.options, &self.buffers, &mut result);
        Ok(result)
    }

    fn trace_stream(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
        let (options, kind) = (&self.options, self.context.info().kind);
        if !options.has_independent_hits() || options.counters {
            return Ok(None);
        }
        let keeps_order = match options.ray_order {
            RayOrder::Kept => true,
            RayOrder::Sorted => false,
            RayOrder::Auto => !options.gains_by_sorted_rays(Some(kind)),
        };
        self.prepare(Task::Batch)?;
        let streamed = match keeps_order && is_worth_streaming(stream.count) {
            true => self.trace_streaming(stream, progress)?,
            false => None,
        };
        match streamed {
            None if self.context.info().shares_host_memory() => self.trace_in_place(stream, progress),
            _ => Ok(streamed),
        }
    }

    fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits> {
        if job.asks_for_closest() && self.options.is_exact() && !self.options.counters {
            return Ok(AllHits::of_closest(self.trace(&job.closest(), progress)?));
        }
        let extreme = all_extreme(job, &self.buffers);
        let entry = match job.wants_hits {
            true => Entry::of_lists(&self.options, job.most),
            false => Entry::of_counts(&self.options),
        };
        let work = self.work_buffer::<RayWork>(job.rays.len())?;
        let order = self.order();
        let mut lister = Lister {
            deferred: Deferred::new(&self.context, false, 0)?,
            plan: LaunchPlan::on(&self.context, self.first_items),
            work_group: self.work_group,
            context: &self.context,
            scene: &self.scene,
            passes: &mut self.passes,
        };
        let mut result = match entry {
            Entry::ListHitsPackets => lister.list_in_packets(job, &order, &extreme, progress)?,
            entry => lister.count_and_list((job, entry), &order, (&extreme, &work), progress)?,
        };
        let start = Instant::now();
        result.work = work.map(|work| work.read()).transpose()?;
        result.read_s += start.elapsed().as_secs_f64();
        extreme.list_in(&mut result);
        Ok(result)
    }

    fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates> {
        self.prepare(Task::Points)?;
        let points = self.points.as_mut().expect("it was just prepared");
        let of_rays = Arc::ptr_eq(job.scene.buffers(), &self.buffers).then_some(&self.scene);
        points.run(&self.context, &mut self.passes, of_rays, job, self.work_group, progress)
    }

    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult> {
        let read = |film: &Buffer<Float4>| film.read_as(|pixel| [pixel.x, pixel.y, pixel.z]);
        let (mut rendered, pixels) = self.render_and_take(params, samples, progress, read)?;
        rendered.film.pixels = pixels;
        Ok(rendered)
    }

    fn render_into(
        &mut self,
        params: &RenderParams,
        samples: &[CameraSample],
        place: FilmPlace,
        progress: Progress,
    ) -> Result<RenderResult> {
        let put = |film: &Buffer<Float4>| film.look_at(|pixels| place.put(pixels, |pixel| [pixel.x, pixel.y, pixel.z]));
        Ok(self.render_and_take(params, samples, progress, put)?.0)
    }

    fn render_by_error(
        &mut self,
        params: &RenderParams,
        adaptive: Adaptive,
        blocks: &Blocks,
        progress: Progress,
    ) -> Result<Option<(RenderResult, Spent)>> {
        let (decided_by, _) = who_decides(self.options.picture.decisions, self.context.info());
        if decided_by == Decisions::Host || self.options.counters {
            return Ok(None);
        }
        self.prepare(Task::Picture)?;
        let program = match self.adaptive.take() {
            Some(program) => program,
            None => AdaptiveProgram::new(&self.context, &mut self.passes)?,
        };
        let may_be_host = self.options.picture.decisions == Decisions::Auto;
        let result = match DevicePixels::new(self, &program, params, (adaptive, *blocks)) {
            Ok(pixels) => pixels.render(adaptive, progress).map(Some),
            // The host needs none of the device's memory for what is known of the pixels.
            Err(Error::TooLarge { .. }) if may_be_host => Ok(None),
            Err(error) => Err(error),
        };
        self.adaptive = Some(program);
        result
    }
}

impl OpenClBackend {
    /// What says in which order rays are traced.
    fn order(&self) -> Order {
        Order { options: self.options, buffers: self.buffers.clone(), kind: self.context.info().kind }
    }

    /// What settles few items that are deferred.
    fn host(&self) -> Option<Host> {
        self.asks_host.then(|| Host { buffers: self.buffers.clone(), options: self.options })
    }

    /// Traces a batch, in another order than its own if one is given.
    fn trace_batch(&mut self, job: &TraceJob, sorted: Option<Sorted>, progress: Progress) -> Result<TraceResult> {
        let total = job.rays.len();
        let start = Instant::now();
        let rays = Buffer::from_slice(&self.context, "rays", job.rays)?;
        let hits = Buffer::<Hit>::empty(&self.context, "hits", total)?;
        let directions = Buffer::from_slice(&self.context, "next directions", job.next_directions.unwrap_or_default())?;
        let next_hits = Buffer::<Hit>::empty(&self.context, "next hits", job.next_directions.map_or(0, <[_]>::len))?;
        let ray_work = self.work_buffer::<RayWork>(total)?;
        let next_work = self.work_buffer::<RayWork>(next_hits.len())?;
        let deferred = Deferred::new(&self.context, self.passes.defers(), total)?;
        let batch =
            DeviceBatch::new(&self.context, (&rays, &hits, &deferred), sorted.as_ref(), || Rows::find(job.rays))?;
        self.context.finish()?;
        let upload_s = start.elapsed().as_secs_f64();
        let sort_s = sorted.map(|sorted| sorted.sort_s);
        let mut result = TraceResult { upload_s, sort_s, ..TraceResult::default() };

        let mut done = 0;
        let work = (total * job.repeat as usize).max(1) as f64;
        for _ in 0..job.repeat {
            let mut seconds = self.trace_first((&batch, total), &ray_work, job.any_hit, |items| {
                done += items;
                progress(done as f64 / work);
            })?;
            if job.next_directions.is_some() {
                let OpenClBackend { context, scene, passes, trace_plan, work_group, .. } = self;
                let set = |kernel: &mut Kernel| {
                    let arguments = scene.geometry_arguments(kernel)?.set(&rays)?.set(&directions)?;
                    batch.set_order(arguments.set(&hits)?.set(&next_hits)?.set_work(&next_work)?).map(|_| ())
                };
                let shape = (0..total, *work_group);
                seconds += passes.run(context, Entry::TraceNext, &set, trace_plan, shape, (&deferred, None), |_| ())?;
            }
            result.kernel_s.push(seconds);
        }
        result.second_pass = deferred.resolved();

        let start = Instant::now();
        result.hits = hits.read()?;
        result.next_hits = job.next_directions.map(|_| next_hits.read()).transpose()?;
        result.work = ray_work.map(|work| work.read()).transpose()?;
        result.next_work = next_work.filter(|_| job.next_directions.is_some()).map(|work| work.read()).transpose()?;
        result.read_s = start.elapsed().as_secs_f64();
        Ok(result)
    }

    /// Traces the first so many rays of a batch, in both passes; `done` is told of launches. Seconds of device time.
    fn trace_first(
        &mut self,
        (batch, rays): (&DeviceBatch, usize),
        work: &Option<Buffer<RayWork>>,
        any_hit: bool,
        done: impl FnMut(usize),
    ) -> Result<f64> {
        let host = self.host();
        let OpenClBackend { context, scene, passes, trace_plan, work_group, options, .. } = self;
        let set = |kernel: &mut Kernel| batch.set(scene.geometry_arguments(kernel)?, work).map(|_| ());
        let entry = Entry::of_batch(any_hit, options.packet_size);
        let settle =
            host.as_ref().map(|host| move |items: &[u32]| batch.settle(items, |rays| host.trace(rays, any_hit)));
        let on_host = settle.as_ref().map(|settle| settle as OnHost);
        passes.run(context, entry, &set, trace_plan, (0..rays, *work_group), (batch.deferred, on_host), done)
    }

    /// Has a batch stream, if that is sooner done.
    fn trace_streaming(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
        let entry = Entry::of_batch(stream.any_hit, self.options.packet_size);
        let OpenClBackend { context, scene, passes, trace_plan, work_group, stream: kept, .. } = self;
        let memory_and_bytes = (PINNED_BYTES, transferred_bytes(stream.count));
        let streamed = context.streamed(memory_and_bytes, |pinned| {
            let known = kept.take().map_or_else(|| StreamBuffers::new(context, passes.defers()), Ok);
            let buffers = match known {
                Ok(buffers) => kept.insert(buffers),
                Err(Error::TooLarge { .. }) => return Ok(None),
                Err(error) => return Err(error),
            };
            let (plan, work_group) = (trace_plan, *work_group);
            let streaming = Streaming { context, scene, passes, plan, buffers, pinned, entry, work_group };
            let kernel_s = vec![streaming.run(stream, progress)?];
            Ok(Some(TraceResult { kernel_s, ..TraceResult::default() }))
        });
        streamed.unwrap_or(Ok(None))
    }

    /// Traces a batch in memory that the device shares with the host, if it has some.
    fn trace_in_place(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
        let known = self.place.take().filter(|place| place.has_room_for(stream));
        let mut place = match known.map_or_else(|| Place::new(&self.context, self.passes.defers(), stream), Ok) {
            Ok(place) => place,
            Err(Error::TooLarge { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        let order = self.order();
        let result = place.run(&self.context.clone(), stream, &order, |batch, rays| {
            let mut done = rays.start;
            self.trace_first((batch, rays.len()), &None, stream.any_hit, |items| {
                done += items;
                progress(done as f64 / stream.count as f64);
            })
        });
        self.place = Some(place);
        result.map(Some)
    }

    /// What launches of pictures of this size, or of lists that are no longer, have in common.
    fn launches_of(&self, params: &RenderParams) -> Result<Launches> {
        let samples_of_item = if params.samples_apart == 0 { self.samples_of_launch(params) } else { 1 };
        let mut plan = LaunchPlan::on(&self.context, self.first_items / samples_of_item as usize);
        // The camera may have moved away from what was dear.
        plan.expect(0.5 * self.dearest_sample_s * f64::from(samples_of_item));
        let items = if params.samples_apart == 0 { items_of(params) } else { params.samples_apart as usize };
        Ok(Launches { deferred: Deferred::new(&self.context, self.passes.defers(), items)?, plan })
    }

    /// The same picture, with samples that are items of their own if this device is to trace them so: at the end of a
    /// launch most of a GPU waits for the slowest items, and those of pixels with several samples are slower.
    fn with_samples_apart(&self, params: &RenderParams) -> RenderParams {
        // What is counted of a pixel is stored once, and wavefront kernels take samples otherwise.
        let may_be_apart = !self.options.counters && self.wavefront.is_none();
        let samples = MOST_SAMPLES_APART.min(params.sample_count);
        let items = items_of(params) as u64 * u64::from(samples);
        let DeviceInfo { global_memory_bytes, max_alloc_bytes, .. } = self.context.info();
        let left = global_memory_bytes.saturating_sub(self.context.allocated_bytes());
        let room = (left / PART_OF_MEMORY).min(*max_alloc_bytes) / size_of::<Float4>() as u64;
        let room = room.min(most_apart(self.context.info().kind)).min(items);
        // Items are numbered in 32 bits.
        let are_apart = may_be_apart
            && samples >= self.least_samples_apart
            && room >= LEAST_APART.min(items)
            && items <= u64::from(u32::MAX);
        RenderParams { samples_apart: if are_apart { room as u32 } else { 0 }, ..*params }
    }

    /// How many samples of each pixel one launch traces. A pixel that is an item with several is traced again with all
    /// of them if it is deferred, of which more than one seldom is, and a GPU waits for the slowest pixel with all its
    /// samples; but the next launch finds less in caches. Milliseconds of 16 samples, 16, 4 and 1 at a time: H200, 1024
    /// x 1024: bunny 8.7, 7.0, 7.0; gears 13.9, 11.4, 12.9; coffee 480, 370, 314; showcase.toml 2257, 426, 389. PoCL,
    /// two cores, 512 x 512: coffee 11460, 9600, 9340; bunny 580, 740, 710.
    fn samples_of_launch(&self, params: &RenderParams) -> u32 {
        let most = match self.context.info().kind {
            _ if params.samples_apart != 0 => MOST_SAMPLES_APART,
            // What is counted of a pixel is stored once.
            _ if self.options.counters => u32::MAX,
            DeviceKind::Gpu => 4,
            _ => 16,
        };
        most.min(params.sample_count).max(1)
    }

    /// Renders a picture, whose pixels `take` takes from the device; the result's film has none.
    fn render_and_take<T>(
        &mut self,
        params: &RenderParams,
        samples: &[CameraSample],
        progress: Progress,
        take: impl FnOnce(&Buffer<Float4>) -> Result<T>,
    ) -> Result<(RenderResult, T)> {
        self.prepare(Task::Picture)?;
        let start = Instant::now();
        let params = &self.with_samples_apart(params);
        let samples = Buffer::from_slice(&self.context, "samples", samples)?;
        let mut launches = self.launches_of(params)?;
        let picture = PictureBuffers::new(&self.context, params, samples)?;
        let send_s = start.elapsed().as_secs_f64();
        let work = self.work_buffer::<PixelWork>(params.film_len())?;
        // Another part of the same picture begins where the last one ended, not with small launches again.
        if let Some((_, mut plan)) = self.picture_plan.take().filter(|(key, _)| *key == plan_key(params)) {
            plan.begin_others();
            launches.plan = plan;
        }
        let rendered = self.render_to(&picture, &work, params, &mut launches, progress)?;
        self.picture_plan = Some((plan_key(params), launches.plan));

        let start = Instant::now();
        let taken = take(&picture.film)?;
        let (width, height) = params.film_size();
        let work = work.map(|work| work.read()).transpose()?;
        let read_s = send_s + start.elapsed().as_secs_f64();
        let film = Film { width, height, pixels: Vec::new() };
        Ok((RenderResult { work, read_s, ..rendered.with_film(film) }, taken))
    }

    /// Renders into the film of `picture`.
    fn render_to(
        &mut self,
        picture: &PictureBuffers,
        work: &Option<Buffer<PixelWork>>,
        params: &RenderParams,
        launches: &mut Launches,
        progress: Progress,
    ) -> Result<Rendered> {
        match &mut self.wavefront {
            Some(pipeline) => {
                let shape = (self.first_items, self.work_group);
                let rendered = pipeline.render(&self.context, &self.scene, picture, params, shape, progress);
                if rendered.is_err() {
                    pipeline.forget();
                }
                rendered
            }
            None => self.render_mega(picture, work, params, launches, progress),
        }
    }

    /// Renders with the mega-kernel.
    fn render_mega(
        &mut self,
        picture: &PictureBuffers,
        work: &Option<Buffer<PixelWork>>,
        params: &RenderParams,
        Launches { deferred, plan }: &mut Launches,
        progress: Progress,
    ) -> Result<Rendered> {
        let before = deferred.resolved();
        let at_a_time = self.samples_of_launch(params);
        let entry = Entry::of_picture(self.options.packet_size);
        let of_picture = self.host();
        let OpenClBackend { context, scene, passes, work_group, dearest_sample_s, .. } = self;
        let mut rendered = Rendered::default();
        let on_host_counts = Cell::new([0; COUNTERS]);
        let mut done = 0;
        let mut failed = None;
        let (pixels, samples) = (items_of(params), params.sample_count);
        // As many pixels at a time as there is room for their samples of one launch.
        let pixels_at_a_time = match params.samples_apart {
            0 => pixels,
            room => pixels.div_ceil(pixels.div_ceil(room as usize / at_a_time as usize)),
        };
        let parts = (0..pixels).step_by(pixels_at_a_time).map(|from| from..pixels.min(from + pixels_at_a_time));
        let firsts = (0..samples).step_by(at_a_time as usize);
        for (part, first_sample) in parts.flat_map(|part| firsts.clone().map(move |first| (part.clone(), first))) {
            let end_sample = samples.min(first_sample + at_a_time);
            let launched = (end_sample - first_sample) as usize;
            let [samples_of_item, apart] = if params.samples_apart == 0 { [launched, 1] } else { [1, launched] };
            let set = |kernel: &mut Kernel| {
                let film = if apart > 1 { &picture.radiances } else { &picture.film };
                let arguments = picture.arguments_into(film, scene, kernel)?;
                arguments.set_work(work)?.set(&deferred.items)?.set(first_sample)?.set(end_sample).map(|_| ())
            };
            let shape = (part.start * apart..part.end * apart, *work_group);
            // Whole pixels.
            let host = of_picture.as_ref().filter(|_| apart == 1 && launched == samples as usize);
            let on_host = host.map(|host| {
                |items: &[u32]| {
                    let counts = host.render(picture, params, items)?;
                    let all = on_host_counts.get();
                    on_host_counts.set(std::array::from_fn(|kind| all[kind] + counts[kind]));
                    Ok(())
                }
            });
            let on_host = on_host.as_ref().map(|on_host| on_host as OnHost);
            let seconds = passes.run(context, entry, &set, plan, shape, (deferred, on_host), |items| {
                done += items * samples_of_item;
                progress((done as f64 / (pixels * samples as usize) as f64).min(1.0));
                // After every launch, because a 32-bit counter could overflow over a whole picture.
                failed = failed.take().or(picture.take_counts(&mut rendered.counts).err());
            });
            // What was stopped has taught something, too.
            *dearest_sample_s = plan.dearest_s() / samples_of_item as f64;
            rendered.kernel_s += seconds?;
            if apart > 1 {
                let set = |kernel: &mut Kernel| {
                    let arguments = Arguments::of(kernel).set(&picture.params)?.set(&picture.radiances)?;
                    arguments.set(&picture.film)?.set(first_sample)?.set(end_sample).map(|_| ())
                };
                rendered.kernel_s += passes.run_short(context, Entry::AddSamples, &set, (part, *work_group))?;
            }
        }
        let on_host = on_host_counts.get();
        rendered.counts.iter_mut().zip(on_host).for_each(|(all, count)| *all += count);
        rendered.second_pass = deferred.resolved().map(|all| all - before.unwrap_or(0));
        failed.map_or(Ok(rendered), Err)
    }
}

impl RenderLists for OpenClBackend {
    fn context(&self) -> &DeviceContext {
        &self.context
    }

    fn work_group(&self) -> usize {
        self.work_group
    }

    fn launches(&self, params: &RenderParams) -> Result<Launches> {
        self.launches_of(params)
    }

    fn render_list(
        &mut self,
        rays: &PictureBuffers,
        params: &RenderParams,
        launches: &mut Launches,
    ) -> Result<Rendered> {
        self.render_to(rays, &None, params, launches, &|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_info::sample_info;

    #[test]
    fn what_a_runtime_gets_wrong_is_refused() {
        let rusticl = "rusticl".to_owned();
        let info = DeviceInfo { platform_name: rusticl, name: "llvmpipe (LLVM 15.0.6)".to_owned(), ..sample_info() };
        let watertight = TraceOptions { intersector: Intersector::Watertight, ..TraceOptions::DEFAULT };
        let message = check_runtime(&info, &TraceOptions::DEFAULT).unwrap_err().to_string();
        assert!(message.starts_with("option intersector: exact gives wrong hits on device 'llvmpipe"), "{message}");
        assert!(check_runtime(&info, &watertight).is_ok());
        assert!(check_runtime(&sample_info(), &TraceOptions::DEFAULT).is_ok());
    }
}
