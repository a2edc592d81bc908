//! What lies on the device between two of the wavefront kernels.

use super::step::Step;
use crate::device::picture::PictureBuffers;
use crate::device::scene::DeviceScene;
use crate::device::{Buffer, DeviceContext};
use crate::error::Result;
use crate::features::Features;
use crate::layout::Float4;
use crate::shared::{
    NO_PATH, QUEUE_SHADOWS, RenderParams, SurfaceHit, TextureRequest, WaitingRay, WavefrontShadow, WavefrontSlot,
    WavefrontSurface, WavefrontYield,
};

/// Memory for the paths in flight and their batch: at 970 bytes each with a depth of 8 room for 270,000, more than the
/// largest GPUs run work-items at a time. Smaller devices give half of the memory that they have left.
const STATE_BYTES: u64 = 256 << 20;

/// A batch has this many paths for each slot, or more where a single pixel has more samples: so many of its waves are
/// full before slots run out of work.
const PATHS_PER_SLOT: usize = 16;

/// What the kernels were made for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setup {
    pub lights: usize,
    pub features: Features,
    /// Whether the host evaluates textures.
    pub host_textures: bool,
    /// Whether there is a second pass.
    pub defers: bool,
    /// The paths in flight that were asked for.
    pub paths_in_flight: Option<u32>,
}

/// How much there is of everything.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    setup: Setup,
    /// Paths that are followed at a time.
    pub slots: usize,
    /// Pixels of a batch.
    pub batch_pixels: usize,
    /// Rays of a path that wait.
    depth: usize,
    pub samples: usize,
}

impl Shape {
    /// Bytes that one more slot takes: in all arrays, and in the largest.
    fn slot_bytes(&self) -> (u64, u64) {
        let rays = self.depth * size_of::<WaitingRay>();
        let path_radiance = PATHS_PER_SLOT * size_of::<Float4>();
        let request = if self.setup.host_textures { size_of::<TextureRequest>() + size_of::<Float4>() } else { 0 };
        let state = size_of::<WavefrontSlot>()
            + size_of::<SurfaceHit>()
            + size_of::<WavefrontSurface>()
            + size_of::<WavefrontYield>();
        let shadow_and_lists = size_of::<WavefrontShadow>() + 3 * size_of::<u32>();
        let all = rays + path_radiance + request + state + shadow_and_lists;
        (all as u64, rays.max(path_radiance) as u64)
    }

    /// For a picture: as many slots as the device has memory for, unless a number was asked for; never more than paths.
    pub fn new(context: &DeviceContext, params: &RenderParams, setup: Setup) -> Self {
        let (pixels, samples) = (params.film_len(), params.sample_count as usize);
        let depth = setup.features.pending_rays(params.max_depth) as usize;
        let mut shape = Shape { setup, slots: 0, batch_pixels: 0, depth, samples };
        let (all_bytes, largest_bytes) = shape.slot_bytes();
        let info = context.info();
        let known = |limit: u64| if limit == 0 { u64::MAX } else { limit };
        let free_bytes = known(info.global_memory_bytes).saturating_sub(context.allocated_bytes()) / 2;
        let fitting = (STATE_BYTES.min(free_bytes) / all_bytes).min(known(info.max_alloc_bytes) / largest_bytes);
        // Every slot asks for paths once more than there are some in the batch, and the number of these has 32 bits.
        let countable = u32::MAX as usize / (PATHS_PER_SLOT + 1);
        let slots = setup.paths_in_flight.map_or(fitting as usize, |wanted| wanted as usize).clamp(1, countable);
        shape.slots = slots.min(pixels * samples);
        shape.batch_pixels = (PATHS_PER_SLOT * slots / samples.max(1)).clamp(1, pixels.max(1));
        shape
    }
}

pub(super) struct State {
    slots: Buffer<WavefrontSlot>,
    rays: Buffer<WaitingRay>,
    hits: Buffer<SurfaceHit>,
    surfaces: Buffer<WavefrontSurface>,
    yields: Buffer<WavefrontYield>,
    shadows: Buffer<WavefrontShadow>,
    pub requests: Buffer<TextureRequest>,
    pub colours: Buffer<Float4>,
    path_radiance: Buffer<Float4>,
    pub lengths: Buffer<u32>,
    deferred: Buffer<u32>,
    pub queues: [Buffer<u32>; 2],
}

impl State {
    pub fn new(context: &DeviceContext, shape: &Shape) -> Result<Self> {
        let slots = shape.slots;
        let requests = if shape.setup.host_textures { slots } else { 0 };
        let idle = WavefrontSlot { path: NO_PATH, ..WavefrontSlot::default() };
        Ok(State {
            slots: Buffer::read_write(context, "paths in flight", &vec![idle; slots])?,
            rays: Buffer::empty(context, "pending rays", slots * shape.depth)?,
            hits: Buffer::empty(context, "hits of paths", slots)?,
            surfaces: Buffer::empty(context, "surfaces that paths meet", slots)?,
            yields: Buffer::empty(context, "radiance of rays", slots)?,
            shadows: Buffer::empty(context, "shadow rays", slots)?,
            requests: Buffer::empty(context, "texture requests", requests)?,
            colours: Buffer::empty(context, "texture colours", requests)?,
            path_radiance: Buffer::empty(context, "radiance of paths", shape.batch_pixels * shape.samples)?,
            lengths: Buffer::empty(context, "lengths of queues", QUEUE_SHADOWS as usize + shape.setup.lights)?,
            deferred: Buffer::empty(context, "deferred rays", if shape.setup.defers { slots + 1 } else { 1 })?,
            queues: [Buffer::empty(context, "queue", slots)?, Buffer::empty(context, "other queue", slots)?],
        })
    }

    /// Sets the arguments that stay the same for a picture.
    pub fn set_arguments(&self, step: &mut Step, scene: &DeviceScene, picture: &PictureBuffers) -> Result<()> {
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
            .set(&self.path_radiance)?
            .set(&self.lengths)?
            .set(&self.deferred)?
            .set(self.slots.len() as u32)?;
        Ok(())
    }

    /// Lists all slots, and empties the other queues.
    pub fn begin_batch(&self) -> Result<()> {
        let all: Vec<u32> = (0..self.slots.len() as u32).collect();
        self.queues[0].write(&all)?;
        self.lengths.write(&vec![0; self.lengths.len()])
    }
}
