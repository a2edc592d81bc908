//! From a scene and a choice of device to a tracer that is ready: what the CLI, tests and benches all begin with.

mod blocks;
mod crop;
mod fall_back;
mod kept;
mod several;
mod stored;

pub use blocks::{PictureBlocks, render_blocks};
pub use crop::{Crop, render_part, render_part_noting};
pub use fall_back::{FallBack, OnLoss};
pub use kept::{Kept, KeptBlock, KeptRows, Part, PictureId, PictureJournal, read_kept};
pub use several::{TakeBlocks, render_by_several};
pub use stored::{RowsInOrder, StoredBlocks};

use crate::adaptive::{PART_PIXELS, estimated_bytes, sample_sequence};
use crate::blocks::LARGEST_PATCH;
use crate::budget::MemoryBudget;
use crate::device::{Cache, CompiledAhead, DeviceHandle, OpenClBackend};
use crate::error::Result;
use crate::features::Features;
use crate::io::film::{Film, ImageFormat};
use crate::io::rows::writing_bytes;
use crate::options::{Decisions, Kernels, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::ReferenceBackend;
use crate::scene::{Aim, Camera, Placed, Samples, Scene, WideCamera, up_by_shape};
use crate::shared::RenderParams;
use crate::tracer::{Backend, MOST_SAMPLES, Progress, RenderResult, Task};
use crate::work::PixelWork;
use std::sync::{Arc, LazyLock};

/// Width and height of a picture unless something else is asked for.
pub const DEFAULT_SIZE: (u32, u32) = (1024, 768);
/// Longest chain of rays unless something else is asked for, the camera ray counted as 1.
pub const DEFAULT_DEPTH: u32 = 8;

/// Opens a tracer of `buffers`, which were built with `options`: on `device`, or the reference when there is none.
///
/// # Errors
/// The device cannot be opened, its compiler refuses the kernels, or the scene does not fit into its memory;
/// [`Error::Option`](crate::Error::Option) when the buffers were built for another structure.
pub fn open_tracer(
    device: Option<&DeviceHandle>,
    buffers: &Arc<SceneBuffers>,
    options: &TraceOptions,
    max_depth: u32,
    cache: Option<&Cache>,
) -> Result<Box<dyn Backend>> {
    Ok(match device {
        Some(device) => Box::new(OpenClBackend::new(device, buffers, options, max_depth, cache)?),
        None => {
            buffers.check_made_for(options)?;
            Box::new(ReferenceBackend::new(buffers.clone(), *options))
        }
    })
}

/// Builds what `options` ask for of `scene`, and opens a tracer of it as [`open_tracer`] does, which is prepared for
/// `tasks`. The device is opened, and compiles, while the structure is built.
///
/// # Errors
/// Those of [`SceneBuffers::new`], [`open_tracer`] and [`Backend::prepare`].
pub fn build_and_open(
    device: Option<&DeviceHandle>,
    scene: &Scene,
    options: &TraceOptions,
    max_depth: u32,
    cache: Option<&Cache>,
    tasks: &[Task],
) -> Result<(Arc<SceneBuffers>, Box<dyn Backend>)> {
    build_and_open_within(device, scene, options, max_depth, cache, tasks, &MemoryBudget::available())
}

/// As [`build_and_open`], with no more memory than `budget` has.
///
/// # Errors
/// As there, and [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn build_and_open_within(
    device: Option<&DeviceHandle>,
    scene: &Scene,
    options: &TraceOptions,
    max_depth: u32,
    cache: Option<&Cache>,
    tasks: &[Task],
    budget: &MemoryBudget,
) -> Result<(Arc<SceneBuffers>, Box<dyn Backend>)> {
    if device.is_some_and(|device| device.info.shares_host_memory()) {
        SceneBuffers::check_memory(scene, options, budget, COMPILER_BYTES)?;
    }
    let (buffers, ahead) = std::thread::scope(|scope| {
        let features = Features::of_scene(scene);
        let compile = |device| move || CompiledAhead::new(device, features, options, max_depth, cache, tasks);
        let ahead = device.map(|device| scope.spawn(compile(device)));
        let buffers = SceneBuffers::within(scene, options, budget);
        // What failed is done again below, and fails there.
        (buffers, ahead.and_then(|thread| thread.join().ok()?.ok()))
    });
    let buffers = Arc::new(buffers?);
    let mut tracer: Box<dyn Backend> = match device {
        Some(device) => Box::new(OpenClBackend::after(ahead, device, &buffers, options, max_depth, cache)?),
        None => open_tracer(None, &buffers, options, max_depth, cache)?,
    };
    tasks.iter().try_for_each(|&task| tracer.prepare(task))?;
    Ok((buffers, tracer))
}

/// Gives a scene what it needs to be rendered in a picture of `aspect` = width / height: a camera that frames it, and
/// light when it has none of its own, as its [`DefaultLight`](crate::scene::DefaultLight) says.
pub fn complete(scene: &mut Scene, aspect: f32) {
    complete_as(scene, aspect, &Aim::default());
}

/// As [`complete`], with the parts of the camera that `aim` says in place of the scene's. Where it sees nothing,
/// [`Placed::check`] says so.
pub fn complete_as(scene: &mut Scene, aspect: f32, aim: &Aim) -> Placed {
    let camera = WideCamera::choose(scene.camera, &std::mem::take(&mut scene.wide_cameras), aspect);
    let placed = place(scene, camera, aspect, aim);
    scene.camera = Some(placed.camera);
    if !scene.has_light() {
        scene.add_default_light(&placed);
    }
    placed
}

/// Places the camera of a scene whose own is `camera`, as `aim` says.
fn place(scene: &Scene, camera: Option<Camera>, aspect: f32, aim: &Aim) -> Placed {
    let hittable = LazyLock::new(|| scene.hittable());
    let triangle = |i: usize| scene.vertices(hittable[i] as usize);
    let shape_up = || up_by_shape(hittable.len(), &triangle);
    aim.place(camera, scene.up, shape_up, aspect, |framing| framing.camera((0..hittable.len()).map(triangle)))
}

/// What a device's compiler takes of the host's memory where it runs in the process: 150 MB of PoCL's for a kernel that
/// renders.
const COMPILER_BYTES: u64 = 150 << 20;

/// What a run takes beside what is counted: its threads, and what they keep of memory that they have freed.
const RUN_BYTES: u64 = 4 << 20;

/// What a device's driver takes in the process where it is the host's: PoCL's program, queues and threads.
const DRIVER_BYTES: u64 = 32 << 20;

/// The most that paths in flight of wavefront kernels take, and bytes for each pixel where there are fewer.
const WAVEFRONT_BYTES: u64 = 256 << 20;
const WAVEFRONT_PIXEL_BYTES: u64 = 256;

/// Bytes of a device's picture, of which a pixel has four numbers.
const DEVICE_PIXEL_BYTES: u64 = 16;

/// About how many bytes of the host's memory [`render`] and writing the picture to `format` take at the most at a time,
/// on `device`, or on the reference when there is none.
pub fn picture_bytes(
    size: (u32, u32),
    samples: Samples,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    format: Option<ImageFormat>,
) -> u64 {
    let pixels = u64::from(size.0) * u64::from(size.1);
    let on_device = pixels.min(most_on_device(samples, options, device));
    let of_file = format.map_or(0, |format| writing_bytes(format, pixels));
    let of_sampling = sampling_bytes(size, samples, options, device);
    Film::PIXEL_BYTES * pixels + of_sampling.max(of_file) + device_bytes(on_device, options, device)
}

/// The same of a picture that is written by rows ([`crate::low_level::rows`]), of blocks that nobody keeps in memory.
/// Without a `format` it is kept, and not written. `devices`: one of how many.
pub fn picture_bytes_by_rows(
    (size, part): ((u32, u32), Option<Crop>),
    samples: Samples,
    options: &TraceOptions,
    (device, devices): (Option<&DeviceHandle>, usize),
    format: Option<ImageFormat>,
) -> u64 {
    let in_flight = PictureBlocks::new(size, samples, part).in_flight(most_on_device(samples, options, device));
    let of_file = format.map_or(0, |format| bytes_of_rows(part.map_or(size, |part| part.size), format));
    // Blocks of areas are gathered before they are appended to a journal; bands are traced while those before them are
    // taken.
    let (width, height) = part.map_or(size, |part| part.size);
    let waiting = if devices > 1 { stored::MOST_WAITING as u64 } else { 0 };
    let of_film = match samples {
        Samples::Error(_) => 2 * in_flight * devices as u64,
        _ => (2 * in_flight * devices as u64 + waiting).min(u64::from(width) * u64::from(height)),
    };
    let of_blocks = Film::PIXEL_BYTES * of_film + sampling_bytes(size, samples, options, device);
    let on_device = in_flight.min(most_on_device(samples, options, device));
    of_blocks + of_file + device_bytes(on_device, options, device)
}

/// About how many bytes it takes at the most to write a picture from journals.
pub fn bytes_of_rows((width, height): (u32, u32), format: ImageFormat) -> u64 {
    let strip = Film::PIXEL_BYTES * u64::from(width) * u64::from(height).min(LARGEST_PATCH as u64);
    let pixels = u64::from(width) * u64::from(height);
    strip.max(stored::GROUP_BYTES.min(Film::PIXEL_BYTES * pixels)) + writing_bytes(format, pixels)
}

/// What is known of the pixels beside their light.
fn sampling_bytes(size: (u32, u32), samples: Samples, options: &TraceOptions, device: Option<&DeviceHandle>) -> u64 {
    match (samples, options.counters) {
        (Samples::Error(_), counters) => {
            estimated_bytes(size, counters, device.is_some_and(|device| device.info.shares_host_memory()))
        }
        (_, true) => 2 * size_of::<PixelWork>() as u64 * u64::from(size.0) * u64::from(size.1),
        (_, false) => 0,
    }
}

/// The most pixels that the host has a device render at a time.
fn most_on_device(samples: Samples, options: &TraceOptions, device: Option<&DeviceHandle>) -> u64 {
    match samples {
        // The host keeps the pixels, and has them rendered in parts.
        Samples::Error(_) if options.picture.decisions != Decisions::Device => PART_PIXELS as u64,
        // What is counted of each pixel comes in one piece.
        _ if options.counters => u64::MAX,
        _ => device.map_or(u64::MAX, |device| device.info.pixels_at_a_time()),
    }
}

/// What a run takes, and a device that has so many pixels at a time, if its memory is the host's.
fn device_bytes(pixels: u64, options: &TraceOptions, device: Option<&DeviceHandle>) -> u64 {
    let of_device = match options.picture.kernels {
        Kernels::Mega => DEVICE_PIXEL_BYTES * pixels,
        Kernels::Wavefront => DEVICE_PIXEL_BYTES * pixels + WAVEFRONT_BYTES.min(WAVEFRONT_PIXEL_BYTES * pixels),
    };
    RUN_BYTES + if device.is_some_and(|device| device.info.shares_host_memory()) { DRIVER_BYTES + of_device } else { 0 }
}

/// From how many bytes of pixels on a picture is large: all else of one takes no more, so that a picture which is not
/// in memory whole is done within 1 GiB.
pub const LARGE_FROM: u64 = 512 << 20;

/// Whether a picture of this size is so large that it should not be in memory whole.
pub fn is_large(size: (u32, u32)) -> bool {
    Film::PIXEL_BYTES * u64::from(size.0) * u64::from(size.1) > LARGE_FROM
}

/// A picture to render.
#[derive(Debug, Clone, Copy)]
pub struct Picture {
    /// Where from.
    pub camera: Camera,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Where camera rays pass.
    pub samples: Samples,
    /// Longest chain of rays, the camera ray counted as 1.
    pub depth: u32,
    /// Weight below which secondary rays are not cast; `None`: where they cannot change an 8-bit pixel, or by half of
    /// the error asked for.
    pub kill_weight: Option<f32>,
}

impl Picture {
    fn params(&self, buffers: &SceneBuffers, samples: Samples) -> RenderParams {
        buffers.render_params(&self.camera, self.size, samples, self.depth, self.kill_weight)
    }
}

/// Renders the full picture in place of what `picture` says of samples: every pixel has [`MOST_SAMPLES`], those of a
/// pixel of which [`Samples::Error`] needs them all. No ray is killed at random.
///
/// # Errors
/// As [`render`].
pub fn render_full(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    picture: &Picture,
    progress: Progress,
) -> Result<RenderResult> {
    let mut params = picture.params(buffers, Samples::PerPixel(MOST_SAMPLES));
    // No more is left out than of the picture that is compared with it.
    params.kill_weight = params.kill_weight.min(picture.params(buffers, picture.samples).kill_weight);
    tracer.render(&params, &sample_sequence(), progress)
}

/// Renders a picture of the scene that `tracer` was opened with.
///
/// # Errors
/// The picture has no such samples, or the device failed or cannot hold it.
pub fn render(
    tracer: &mut dyn Backend,
    buffers: &SceneBuffers,
    picture: &Picture,
    progress: Progress,
) -> Result<RenderResult> {
    render_part(tracer, buffers, picture, None, progress)
}

/// What kernels need to know of a picture, of which rays are killed as the tracer's options say.
fn rendered_params(tracer: &dyn Backend, buffers: &SceneBuffers, picture: &Picture) -> RenderParams {
    let roulette_weight = tracer.options().picture.roulette.unwrap_or(0.0);
    RenderParams { roulette_weight, ..picture.params(buffers, picture.samples) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_by_rows_does_not_depend_on_the_size() {
        let options = TraceOptions::DEFAULT;
        let formats = [ImageFormat::Png8, ImageFormat::Png16, ImageFormat::Exr, ImageFormat::Pfm];
        for samples in [Samples::PerPixel(1), Samples::PerPixel(64), Samples::Error(1.0), Samples::Error(8.0)] {
            for format in formats {
                let of = |size| picture_bytes_by_rows((size, None), samples, &options, (None, 1), Some(format));
                let (large, largest) = (of((65535, 4096)), of((65535, 65535)));
                assert!(large == largest && largest < 1 << 30, "{samples:?} {format:?}: {large} {largest}");
                assert!(picture_bytes((65535, 65535), samples, &options, None, Some(format)) > 40 << 30);
            }
        }
    }
}
