//! The one interface of everything that traces rays: OpenCL devices and the scalar reference (thesis, section 6.2.2).

mod all_hits;
mod candidates;

pub use all_hits::{AllHits, AllHitsJob};
pub use candidates::{Candidates, CandidatesJob};

use crate::blocks::Blocks;
use crate::error::{Error, Result};
use crate::io::film::{Film, FilmPlace, FilmWindow};
use crate::layout::Float4;
use crate::names::as_name;
use crate::options::Decisions;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::parallel;
pub use crate::parallel::rays_in_caches;
use crate::shared::{COUNTERS, CameraSample, Hit, Light, NO_PRIMITIVE, RenderParams, TraceRay};
use crate::work::{PixelWork, RayWork};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Launches of calls that may be stopped aim at so many seconds: who moves a camera sees pictures follow.
pub const STOPPABLE_LAUNCH_S: f64 = 0.02;

/// A ray of a batch that tracing space cannot hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtremeRay {
    /// Its number in the batch.
    pub index: usize,
    /// Where it starts, world units.
    pub origin: Vec3,
    /// Whether that is so of the secondary ray alone.
    pub is_second: bool,
}

/// A batch of rays to trace. All coordinates and distances are in tracing space: see [`SceneBuffers::trace_ray`].
#[derive(Debug, Clone, Copy)]
pub struct TraceJob<'a> {
    /// The rays.
    pub rays: &'a [TraceRay],
    /// Directions (x, y, z; w unused) of secondary rays that start where the first ones hit; as many as rays. Only with
    /// closest hits.
    pub next_directions: Option<&'a [Float4]>,
    /// Those of the rays, or of their secondary rays, that tracing space cannot hold; [`SceneBuffers::batch`] finds
    /// them.
    pub extreme: &'a [ExtremeRay],
    /// Whether any hit will do: then only `primitive != NO_PRIMITIVE` means something in the answer; t, u and v of a
    /// hit are 0.
    pub any_hit: bool,
    /// How often to trace the batch, for timing; at least 1.
    pub repeat: u32,
}

/// What became of a batch.
#[derive(Debug, Clone, Default)]
pub struct TraceResult {
    /// One for each ray; t in units of |direction|, as in world space. What is farther than every float is not hit.
    pub hits: Vec<Hit>,
    /// The secondary rays' hits, if they were asked for.
    pub next_hits: Option<Vec<Hit>>,
    /// With [`crate::options::TraceOptions::counters`] the work on each ray.
    pub work: Option<Vec<RayWork>>,
    /// The same of the secondary rays; none on a ray that was not cast because the first one missed.
    pub next_work: Option<Vec<RayWork>>,
    /// How many rays, over all repeats, only exact integers could decide, in a second pass; `None` where there is no
    /// such pass.
    pub second_pass: Option<u64>,
    /// Seconds of device time of each repeat, transfers left out; secondary rays included. See [`Backend::has_clock`].
    pub kernel_s: Vec<f64>,
    /// Seconds that it took to send the rays.
    pub upload_s: f64,
    /// Seconds that it took to fetch the hits.
    pub read_s: f64,
    /// Seconds that it took to sort the rays, once for all repeats, and to copy them into that order and their hits
    /// back, where that is done; `None` where they were traced in the caller's order.
    pub sort_s: Option<f64>,
    /// Seconds that the host took for extreme rays; `None` where there were none.
    pub extreme_s: Option<f64>,
}

/// Takes the hits of the rays from a number on, each once. Called by many threads, for whole pieces of
/// [`RayStream::PIECE`], up to the last one.
pub type TakeHits<'a> = &'a (dyn Fn(usize, &[Hit]) + Sync);

/// Has hits taken that are in memory, those of the rays from a number on.
pub(crate) fn take_in_pieces(take: TakeHits, first: usize, hits: &[Hit]) {
    parallel::each(hits.chunks(RayStream::PIECE).enumerate(), |(piece, hits)| {
        take(first + piece * RayStream::PIECE, hits);
    });
}

/// A batch whose rays are made where the device reads them, and whose hits are taken where it writes them. Rays are
/// made and hits taken by many threads, each once, in pieces of [`RayStream::PIECE`] rays from a multiple of that on;
/// the last piece may have fewer.
pub struct RayStream<'a> {
    /// How many rays there are.
    pub count: usize,
    /// As [`TraceJob::any_hit`].
    pub any_hit: bool,
    /// Makes the rays from a number on, as many as there are places, in tracing space.
    pub make: &'a (dyn Fn(usize, &mut [TraceRay]) + Sync),
    /// Is told of a ray, by its number, whose hit is still open, before hits are taken of which that is one: all such
    /// rays are to be traced by [`Backend::trace`], once the stream has ended.
    pub defer: &'a (dyn Fn(usize, &TraceRay) + Sync),
    /// Takes their hits.
    pub take: TakeHits<'a>,
}

impl RayStream<'_> {
    /// Rays of a piece.
    pub const PIECE: usize = 1 << 12;
}

/// A rendered picture and what it took.
#[derive(Debug, Clone)]
pub struct RenderResult {
    /// Linear radiance.
    pub film: Film,
    /// Rays by [`crate::shared::COUNTER_NAMES`].
    pub counts: [u64; COUNTERS],
    /// With [`crate::options::TraceOptions::counters`] the work on the rays of each pixel, top row first.
    pub work: Option<Vec<PixelWork>>,
    /// How many pixels had a ray that only exact integers could decide, and were rendered in a second pass; of
    /// wavefront kernels how many rays. `None` where there is no such pass.
    pub second_pass: Option<u64>,
    /// Seconds of device time, transfers left out. See [`Backend::has_clock`].
    pub kernel_s: f64,
    /// Seconds that it took to send the places of the rays, and to fetch the picture.
    pub read_s: f64,
    /// Seconds for which nothing was traced because rows were still being taken, where they are taken while others are
    /// traced.
    pub taking_s: Option<f64>,
    /// How the wavefront kernels went, where they rendered.
    pub wavefront: Option<WavefrontStats>,
    /// How the picture was sampled, where its error was bounded.
    pub adaptive: Option<AdaptiveStats>,
    /// How each pixel was, where that was asked for, too.
    pub sampling: Option<Sampling>,
}

/// How each pixel of a picture by its error was sampled, top row first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sampling {
    /// How many samples it has; 0 where it is interpolated.
    pub samples: Vec<u32>,
    /// The root of its mean squared error, as estimated, in steps of 8-bit sRGB. The root of the mean of the squares of
    /// all of them is the picture's ([`AdaptiveStats::estimated_error`]).
    pub errors: Vec<f32>,
}

impl RenderResult {
    /// A film, and nothing that it took yet.
    pub fn of_film(film: Film) -> Self {
        RenderResult {
            film,
            counts: [0; COUNTERS],
            work: None,
            second_pass: None,
            kernel_s: 0.0,
            read_s: 0.0,
            taking_s: None,
            wavefront: None,
            adaptive: None,
            sampling: None,
        }
    }

    /// Adds what a list of rays took to what the picture takes.
    pub(crate) fn add(&mut self, list: &RenderResult) {
        (0..COUNTERS).for_each(|i| self.counts[i] += list.counts[i]);
        self.kernel_s += list.kernel_s;
        self.read_s += list.read_s;
        if let Some(second) = list.second_pass {
            *self.second_pass.get_or_insert(0) += second;
        }
        if let Some(wavefront) = list.wavefront {
            self.wavefront.get_or_insert_with(WavefrontStats::default).add(&wavefront);
        }
    }
}

/// What became of blocks of a picture of bounded error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Refined {
    /// What is left of the squared error, in the units in which blocks are decided about.
    pub error: u64,
    /// Pixels by [`LEVEL_SAMPLES`].
    pub pixels: [u64; LEVEL_SAMPLES.len()],
    /// How often it was decided what is traced next, in the block where that was most often.
    pub rounds: u32,
}

impl Refined {
    /// Adds what became of other blocks. A journal may say anything: sums end at the largest number.
    pub fn add(&mut self, other: &Refined) {
        self.error = self.error.saturating_add(other.error);
        self.pixels.iter_mut().zip(other.pixels).for_each(|(sum, count)| *sum = sum.saturating_add(count));
        self.rounds = self.rounds.max(other.rounds);
    }
}

/// What blocks of a picture took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spent {
    /// Rays by [`crate::shared::COUNTER_NAMES`].
    pub counts: [u64; COUNTERS],
    /// As [`RenderResult::second_pass`].
    pub second_pass: Option<u64>,
    /// As [`RenderResult::kernel_s`].
    pub kernel_s: f64,
    /// As [`RenderResult::read_s`].
    pub read_s: f64,
    /// As [`AdaptiveStats::decide_s`].
    pub decide_s: f64,
    /// What became of them, where their error was bounded.
    pub refined: Refined,
}

impl Spent {
    /// What a picture took so far, apart from what became of its blocks.
    pub(crate) fn of(result: &RenderResult, decide_s: f64) -> Spent {
        let RenderResult { counts, second_pass, kernel_s, read_s, .. } = *result;
        Spent { counts, second_pass, kernel_s, read_s, decide_s, refined: Refined::default() }
    }

    /// What was spent after `earlier` was.
    pub(crate) fn since(&self, earlier: &Spent) -> Spent {
        Spent {
            counts: std::array::from_fn(|i| self.counts[i] - earlier.counts[i]),
            second_pass: self.second_pass.map(|all| all - earlier.second_pass.unwrap_or(0)),
            kernel_s: self.kernel_s - earlier.kernel_s,
            read_s: self.read_s - earlier.read_s,
            decide_s: self.decide_s - earlier.decide_s,
            refined: self.refined,
        }
    }

    /// Adds what other blocks took. A journal may say anything: sums end at the largest number.
    pub fn add(&mut self, other: &Spent) {
        self.counts.iter_mut().zip(other.counts).for_each(|(sum, count)| *sum = sum.saturating_add(count));
        self.kernel_s += other.kernel_s;
        self.read_s += other.read_s;
        self.decide_s += other.decide_s;
        self.refined.add(&other.refined);
        if let Some(second) = other.second_pass {
            self.second_pass = Some(self.second_pass.unwrap_or(0).saturating_add(second));
        }
    }
}

/// What one of several devices did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceShare {
    /// The device.
    pub name: String,
    /// Blocks of the picture that are its, or runs of the batch.
    pub pieces: usize,
    /// Seconds that it was at work.
    pub busy_s: f64,
}

/// Blocks of a picture that are finished.
#[derive(Debug, Clone, Copy)]
pub struct Finished<'a> {
    /// Their numbers.
    pub blocks: &'a [usize],
    /// Where their pixels are, among others that may be anything.
    pub film: FilmWindow<'a>,
    /// What they took since others were finished before.
    pub spent: Spent,
}

/// What rendering by several kernels took ([`crate::options::Kernels::Wavefront`]).
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct WavefrontStats {
    /// Paths that were followed at a time.
    pub paths_in_flight: usize,
    /// Waves; in each of them every path in flight has one ray traced.
    pub waves: u64,
    /// Launches of all kernels.
    pub launches: u64,
    /// Hits whose colours the host computed.
    pub host_colours: u64,
    /// Seconds that fetching those hits, computing and sending the colours took.
    pub host_pass_s: f64,
}

impl WavefrontStats {
    /// Adds what another picture took.
    pub fn add(&mut self, other: &WavefrontStats) {
        self.paths_in_flight = self.paths_in_flight.max(other.paths_in_flight);
        self.waves += other.waves;
        self.launches += other.launches;
        self.host_colours += other.host_colours;
        self.host_pass_s += other.host_pass_s;
    }
}

/// How a picture is sampled whose error is bounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptive {
    /// Root of the mean squared error of the picture's channels that is asked for, in steps of 8-bit sRGB.
    pub error: f32,
    /// Pixels from one point of the first lattice to the next; 1, or 0: every pixel is traced.
    pub lattice: u32,
    /// Rays of one list at most, but for those of one patch or tile of pixels. Fewer take less memory, more keep a
    /// device busy.
    pub list_rays: usize,
}

impl Adaptive {
    /// Rays of a list: few enough for the memory of any device, enough to keep it busy.
    pub const LIST_RAYS: usize = 1 << 21;

    pub(crate) fn step(&self) -> usize {
        self.lattice.max(1) as usize
    }

    /// For this error the lattice that misses too little to matter. Features that fell between its points made errors
    /// of 0.39 steps of gears (2 pixels, 1024 x 1024) and 0.59 (4 pixels, 512 x 512), and at most 0.03 of the bunny,
    /// sponza and coffee.
    pub fn of_error(error: f32) -> Adaptive {
        let lattice = [8, 4, 2].into_iter().find(|&lattice| error >= lattice as f32).unwrap_or(1);
        Adaptive { error, lattice, list_rays: Adaptive::LIST_RAYS }
    }
}

/// Samples of a pixel at each level. At level 0 it is interpolated. Nets are good at powers of 4: of four scenes two
/// samples a pixel were as wrong as one, and the squared error went down by 3.2 to 3.8 from 4 samples to 8, by 3.5 to
/// 5.0 to 16, and by only 1.9 to 2.6 to 32.
pub const LEVEL_SAMPLES: [u32; 6] = [0, 1, 4, 16, 64, 256];
/// The level of the most samples.
pub(crate) const LAST_LEVEL: u8 = LEVEL_SAMPLES.len() as u8 - 1;
/// The most samples of a pixel: those of the full picture.
pub const MOST_SAMPLES: u32 = LEVEL_SAMPLES[LAST_LEVEL as usize];

/// What an adaptive picture took.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct AdaptiveStats {
    /// The error that was asked for, see [`Adaptive::error`].
    pub error: f32,
    /// The error that is left, as estimated.
    pub estimated_error: f32,
    /// Pixels by [`LEVEL_SAMPLES`].
    pub pixels: [u64; LEVEL_SAMPLES.len()],
    /// How often it was decided what is traced next.
    pub rounds: u32,
    /// Who decided: [`Decisions::Host`] or [`Decisions::Device`].
    #[serde(serialize_with = "as_name")]
    pub decided_by: Decisions,
    /// Seconds that the host took between the rays: to take note of what was traced and to decide what is traced next,
    /// or to start the kernels that do.
    pub decide_s: f64,
}

/// A device that failed in the middle of its work.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LostDevice {
    /// Its name.
    pub device: String,
    /// What failed.
    pub error: String,
}

/// Called from time to time with the part of the work that is done, 0..=1.
pub type Progress<'a> = &'a (dyn Fn(f64) + Sync);

/// What a tracer can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// [`Backend::trace`].
    Batch,
    /// [`Backend::trace_all`] that only counts hits.
    Counts,
    /// [`Backend::trace_all`] that lists them.
    AllHits,
    /// [`Backend::find_candidates`].
    Points,
    /// [`Backend::render`].
    Picture,
}

/// Something that traces rays through one scene. It may be sent to another thread.
pub trait Backend: Send {
    /// The device's name.
    fn device_name(&self) -> &str;

    /// Compiles what `task` needs, if that is not done yet. Without it the first job of that kind does; the small
    /// program that decides of pictures by their error is compiled by the first of these in any case.
    ///
    /// # Errors
    /// The device's compiler refuses the kernels.
    fn prepare(&mut self, task: Task) -> Result<()> {
        let _ = task;
        Ok(())
    }

    /// Seconds that compiling (or loading) kernels took so far.
    fn compile_s(&self) -> f64 {
        0.0
    }

    /// Seconds that sending the scene took.
    fn upload_s(&self) -> f64 {
        0.0
    }

    /// What it was opened with.
    fn options(&self) -> &TraceOptions;

    /// Whether the device times its commands. Where it does not, times of the device's are the host's: from a command's
    /// start to its end, those before it included. Some devices refuse only when they are asked for the first time.
    fn has_clock(&self) -> bool {
        true
    }

    /// The most pixels of a picture that it is best given at a time: those that a processor's caches hold.
    fn pixels_at_a_time(&self) -> u64 {
        u64::MAX
    }

    /// Has calls end with [`Error::Stopped`] as soon as `stop` is true: between two launches, which are short from now
    /// on ([`STOPPABLE_LAUNCH_S`]). The tracer is as good as before; `stop` is to be false again before the next call.
    /// It takes the place of the flag that did so before. Who wants long launches unwinds through [`Progress`].
    fn stop_when(&mut self, stop: Arc<AtomicBool>);

    /// What a curious user should know, such as a kernel cache that cannot be used; one sentence each.
    fn notes(&self) -> &[String] {
        &[]
    }

    /// The device that was lost, where the reference has taken its place
    /// ([`FallBack`](crate::renderer::FallBack)).
    fn lost(&self) -> Option<&LostDevice> {
        None
    }

    /// Has `lights` shine from now on in place of those of the scene; as many of them, and no brighter. What
    /// [`SceneBuffers::packed_light`] makes.
    ///
    /// # Errors
    /// [`Error::Option`] for another number of lights; the device failed.
    fn set_lights(&mut self, lights: &[Light]) -> Result<()>;

    /// Traces a batch of rays.
    ///
    /// # Errors
    /// The device failed or cannot hold the batch.
    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult>;

    /// Traces a stream of rays, if the tracer is sooner done so than by [`Backend::trace`]. What that took, without
    /// hits; `None`: whatever hits were taken count for nothing.
    ///
    /// # Errors
    /// As [`Backend::trace`].
    fn trace_stream(&mut self, stream: &RayStream, progress: Progress) -> Result<Option<TraceResult>> {
        let _ = (stream, progress);
        Ok(None)
    }

    /// Finds all hits of the rays of a batch, in the order of the job.
    ///
    /// # Errors
    /// As [`Backend::trace`]; [`Error::OutOfMemory`] when the system has no memory for so many hits.
    fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits>;

    /// Finds the triangles that may be the nearest ones of points.
    ///
    /// # Errors
    /// As [`Backend::trace`].
    fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates>;

    /// Renders a picture; `samples` are positions in the pixel, [`RenderParams::sample_count`] of them, and what each
    /// stands for. Of a list of rays ([`RenderParams::of_list`]) they are positions in the picture, in pixels from its
    /// upper left corner, and the film is one row.
    ///
    /// # Errors
    /// The device failed or cannot hold the picture.
    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult>;

    /// As [`Backend::render`], into the place of those pixels among others. The result's film has none.
    ///
    /// # Errors
    /// As there.
    fn render_into(
        &mut self,
        params: &RenderParams,
        samples: &[CameraSample],
        place: FilmPlace,
        progress: Progress,
    ) -> Result<RenderResult> {
        let mut rendered = self.render(params, samples, progress)?;
        place.put(&std::mem::replace(&mut rendered.film, Film::none()).pixels, |pixel| *pixel);
        Ok(rendered)
    }

    /// Renders a picture by its error, or an area of one ([`RenderParams::cropped`]), if the tracer decides by itself
    /// what is traced ([`crate::options::Decisions`]). `blocks` are those of the area alone; its pixels are those of
    /// [`crate::adaptive::render_adaptive`], which asks first.
    ///
    /// # Errors
    /// The device failed or cannot hold the area.
    fn render_by_error(
        &mut self,
        params: &RenderParams,
        adaptive: Adaptive,
        blocks: &Blocks,
        progress: Progress,
    ) -> Result<Option<(RenderResult, Spent)>> {
        let _ = (params, adaptive, blocks, progress);
        Ok(None)
    }
}

/// Checks that as many lights take the place of those of `buffers`.
pub(crate) fn check_lights(buffers: &SceneBuffers, lights: &[Light]) -> Result<()> {
    let (given, had) = (lights.len(), buffers.lights.len());
    if given == had {
        return Ok(());
    }
    Err(Error::option("lights", format!("{given} cannot take the place of {had}; give as many")))
}

/// Refuses a device whose times are not its own, where times are what is asked for.
pub fn require_clock(tracer: &dyn Backend) -> Result<()> {
    if tracer.has_clock() {
        return Ok(());
    }
    let message = format!(
        "device '{}' does not time its commands (clGetEventProfilingInfo fails, or there are no queues with \
         CL_QUEUE_PROFILING_ENABLE), so that nothing can be measured on it; choose another with `device`",
        tracer.device_name()
    );
    Err(Error::NoDevice(message))
}

impl SceneBuffers {
    /// A ray in world units as the tracers take it. Extreme numbers lose bits; [`SceneBuffers::batch`] looks after
    /// them.
    #[inline]
    pub fn trace_ray(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> TraceRay {
        TraceRay {
            origin_t_min: Float4::new(origin * self.params.scale, t_min),
            direction_t_max: Float4::new(direction, t_max),
        }
    }
}

/// Whether a ray hit something.
pub fn is_hit(hit: &Hit) -> bool {
    hit.primitive != NO_PRIMITIVE
}
