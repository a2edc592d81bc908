//! From a scene and a choice of device to a tracer that is ready: what the CLI, tests and benches all begin with.

use crate::adaptive::{Adaptive, MOST_SAMPLES, render_adaptive, sample_sequence};
use crate::device::{Cache, CompiledAhead, DeviceHandle, OpenClTracer};
use crate::error::Result;
use crate::features::Features;
use crate::options::TraceOptions;
use crate::pack::{SceneBuffers, sample_positions};
use crate::reference::ReferenceTracer;
use crate::scene::{Camera, Samples, Scene};
use crate::shared::RenderParams;
use crate::tracer::{Progress, RenderResult, Task, Tracer};
use glam::Vec3;
use std::sync::Arc;

/// Longest chain of rays unless something else is asked for, the camera ray counted as 1.
pub const DEFAULT_DEPTH: u32 = 8;
/// Ambient light that is added together with the key light.
const KEY_AMBIENT: f32 = 0.15;

/// Opens a tracer of `buffers`, which were built with `options`: on `device`, or the reference when there is none.
///
/// # Errors
/// The device cannot be opened, its compiler refuses the kernels, or the scene does not fit into its memory; [`Error::Option`](crate::Error::Option) when the
/// buffers were built for another structure.
pub fn open_tracer(
    device: Option<&DeviceHandle>,
    buffers: &Arc<SceneBuffers>,
    options: &TraceOptions,
    max_depth: u32,
    cache: Option<&Cache>,
) -> Result<Box<dyn Tracer>> {
    Ok(match device {
        Some(device) => Box::new(OpenClTracer::new(device, buffers, options, max_depth, cache)?),
        None => {
            buffers.check_made_for(options)?;
            Box::new(ReferenceTracer::new(buffers.clone(), *options))
        }
    })
}

/// Builds what `options` ask for of `scene`, and opens a tracer of it as [`open_tracer`] does, which is prepared for `tasks`. The device
/// is opened, and compiles, while the structure is built.
///
/// # Errors
/// Those of [`SceneBuffers::new`], [`open_tracer`] and [`Tracer::prepare`].
pub fn build_and_open(
    device: Option<&DeviceHandle>,
    scene: &Scene,
    options: &TraceOptions,
    max_depth: u32,
    cache: Option<&Cache>,
    tasks: &[Task],
) -> Result<(Arc<SceneBuffers>, Box<dyn Tracer>)> {
    let (buffers, ahead) = std::thread::scope(|scope| {
        let features = Features::of_scene(scene);
        let compile = |device| move || CompiledAhead::new(device, features, options, max_depth, cache, tasks);
        let ahead = device.map(|device| scope.spawn(compile(device)));
        let buffers = SceneBuffers::new(scene, options);
        // What failed is done again below, and fails there.
        (buffers, ahead.and_then(|thread| thread.join().ok()?.ok()))
    });
    let buffers = Arc::new(buffers?);
    let mut tracer: Box<dyn Tracer> = match device {
        Some(device) => Box::new(OpenClTracer::after(ahead, device, &buffers, options, max_depth, cache)?),
        None => open_tracer(None, &buffers, options, max_depth, cache)?,
    };
    tasks.iter().try_for_each(|&task| tracer.prepare(task))?;
    Ok((buffers, tracer))
}

/// Gives a scene what it needs to be rendered in a picture of `aspect` = width / height: a camera that frames it, and a key light
/// with a little ambient light when it has no lamp of its own.
pub fn complete(scene: &mut Scene, aspect: f32) {
    let camera = scene.camera.unwrap_or_else(|| {
        let primitives = scene.hittable();
        Camera::framing(primitives.iter().flat_map(|&i| scene.vertices(i as usize)), aspect)
    });
    scene.camera = Some(camera);
    if scene.lights.is_empty() {
        scene.lights.push(Scene::key_light(&camera));
        scene.ambient = scene.ambient.max(Vec3::splat(KEY_AMBIENT));
    }
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
    /// Weight below which secondary rays are not cast; `None`: where they cannot change an 8-bit pixel, or by half of the error asked for.
    pub kill_weight: Option<f32>,
}

impl Picture {
    fn params(&self, buffers: &SceneBuffers, samples: Samples) -> RenderParams {
        buffers.render_params(&self.camera, self.size, samples, self.depth, self.kill_weight)
    }
}

/// Renders the full picture in place of what `picture` says of samples: every pixel has [`MOST_SAMPLES`], those of a pixel of which
/// [`Samples::Error`] needs them all.
///
/// # Errors
/// As [`render`].
pub fn render_full(
    tracer: &mut dyn Tracer,
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
    tracer: &mut dyn Tracer,
    buffers: &SceneBuffers,
    picture: &Picture,
    progress: Progress,
) -> Result<RenderResult> {
    picture.samples.check(picture.size)?;
    let params = picture.params(buffers, picture.samples);
    match picture.samples {
        Samples::Error(error) => render_adaptive(tracer, &params, Adaptive::of_error(error), progress),
        fixed => tracer.render(&params, &sample_positions(fixed), progress),
    }
}
