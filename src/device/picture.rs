//! Buffers of a picture on a device, what rendering it took, and what its launches have in common.

use super::deferred::Deferred;
use super::launch::{Arguments, LaunchPlan};
use super::scene::DeviceScene;
use super::{Buffer, DeviceContext, Kernel};
use crate::error::Result;
use crate::io::film::Film;
use crate::layout::Float4;
use crate::shared::{COUNTERS, CameraSample, RenderParams, TAKEN_TILES, TILE_PIXELS, TILE_SIDE};
use crate::tracer::{RenderResult, WavefrontStats};

/// The counters before a launch.
const NO_COUNTS: [u32; TAKEN_TILES as usize + 1] = [0; TAKEN_TILES as usize + 1];

/// What every rendering kernel takes beside the scene.
pub(super) struct PictureBuffers {
    pub params: Buffer<RenderParams>,
    pub samples: Buffer<CameraSample>,
    pub film: Buffer<Float4>,
    /// What each sample of a launch gives, where samples are apart.
    pub radiances: Buffer<Float4>,
    counters: Buffer<u32>,
}

impl PictureBuffers {
    pub fn new(context: &DeviceContext, params: &RenderParams, samples: Buffer<CameraSample>) -> Result<Self> {
        Ok(PictureBuffers {
            params: Buffer::from_slice(context, "picture parameters", &[*params])?,
            samples,
            film: Buffer::empty(context, "picture", params.film_len())?,
            radiances: Buffer::empty(context, "samples of a launch", params.samples_apart as usize)?,
            counters: Buffer::read_write(context, "counters", &NO_COUNTS)?,
        })
    }

    /// Room for lists of so many rays, whose positions kernels write.
    pub fn of_lists(context: &DeviceContext, params: &RenderParams, rays: usize) -> Result<Self> {
        Self::new(context, &params.of_list(rays as u32), Buffer::empty(context, "samples", rays)?)
    }

    /// Sets the arguments with which every rendering kernel begins.
    pub fn arguments<'k>(&self, scene: &DeviceScene, kernel: &'k mut Kernel) -> Result<Arguments<'k>> {
        self.arguments_into(&self.film, scene, kernel)
    }

    /// The same of a kernel that writes somewhere else than into the film.
    pub fn arguments_into<'k>(
        &self,
        film: &Buffer<Float4>,
        scene: &DeviceScene,
        kernel: &'k mut Kernel,
    ) -> Result<Arguments<'k>> {
        scene.scene_arguments(kernel)?.set(&self.params)?.set(&self.samples)?.set(film)?.set(&self.counters)
    }

    /// Adds the device's counters to `counts`, and clears them for the next launch.
    pub fn take_counts(&self, counts: &mut [u64; COUNTERS]) -> Result<()> {
        for slot in self.counters.read()?.chunks_exact(COUNTERS) {
            for (count, &value) in counts.iter_mut().zip(slot) {
                *count += u64::from(value);
            }
        }
        self.counters.write(&NO_COUNTS)
    }
}

/// What rendering took, apart from the picture.
#[derive(Default)]
pub(super) struct Rendered {
    pub counts: [u64; COUNTERS],
    pub kernel_s: f64,
    pub second_pass: Option<u64>,
    pub wavefront: Option<WavefrontStats>,
}

impl Rendered {
    /// The same with the picture.
    pub fn with_film(self, film: Film) -> RenderResult {
        let Rendered { counts, kernel_s, second_pass, wavefront } = self;
        RenderResult { counts, kernel_s, second_pass, wavefront, ..RenderResult::of_film(film) }
    }
}

/// What the launches of one picture after the other have in common.
pub(super) struct Launches {
    pub deferred: Deferred,
    pub plan: LaunchPlan,
}

impl Launches {
    /// The next rays are others than those before.
    pub fn begin_list(&mut self) {
        self.plan.begin_others();
    }
}

/// Items of a picture, or of a list: the pixels of its tiles.
pub(super) fn items_of(params: &RenderParams) -> usize {
    let tiles = params.width.div_ceil(TILE_SIDE) as usize * params.height.div_ceil(TILE_SIDE) as usize;
    tiles * TILE_PIXELS as usize
}

/// What renders lists of rays into buffers of the device.
pub(super) trait RenderLists {
    /// The device.
    fn context(&self) -> &DeviceContext;

    /// Work-items of a work-group.
    fn work_group(&self) -> usize;

    /// What launches of lists no longer than this have in common.
    fn launches(&self, params: &RenderParams) -> Result<Launches>;

    /// Renders into the film of `rays`.
    fn render_list(
        &mut self,
        rays: &PictureBuffers,
        params: &RenderParams,
        launches: &mut Launches,
    ) -> Result<Rendered>;
}
