//! What the first pass defers, settled on the host by the reference, with the same bits, where that is sooner done than
//! compiling the second pass: a few rays of a batch, or pixels of a picture, that take exact integers.
//!
//! PoCL takes a second for the second pass of a picture and .04 s where it has it in its cache, NVIDIA's compiler 5 s.
//! Bad at: whoever is to find out whether the device's own second pass is right, and so leaves it out
//! ([`DeviceHandle::ask_host`]).

use super::DeviceHandle;
use super::picture::PictureBuffers;
use crate::error::Result;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::parallel;
use crate::reference::ReferenceBackend;
use crate::reference::kernels::render::render_one;
use crate::shared::{COUNTERS, CameraSample, Hit, RenderParams, TILE_PIXELS, TILE_SIDE, TraceRay};
use crate::tracer::{Backend, TraceJob};
use std::sync::Arc;

/// Settles deferred items, by their numbers.
pub(super) type OnHost<'a> = &'a dyn Fn(&[u32]) -> Result<()>;

/// Of more items at a time the device takes the second pass.
pub(super) const MOST_ITEMS: usize = 64;
/// Once they have taken the host so many seconds in all, too.
pub(super) const MOST_S: f64 = 0.05;

impl DeviceHandle {
    /// The same device, which asks the host about the few rays and pixels that take exact integers, as long as its
    /// kernels for them are not compiled: that may take seconds. Hits and pixels are the same.
    #[must_use]
    pub fn ask_host(mut self) -> Self {
        self.asks_host = true;
        self
    }
}

/// The reference beside a device.
pub(super) struct Host {
    pub buffers: Arc<SceneBuffers>,
    pub options: TraceOptions,
}

impl Host {
    /// The hits of rays.
    pub fn trace(&self, rays: &[TraceRay], any_hit: bool) -> Result<Vec<Hit>> {
        let job = TraceJob { rays, next_directions: None, extreme: &[], any_hit, repeat: 1 };
        Ok(ReferenceBackend::new(self.buffers.clone(), self.options).trace(&job, &|_| ())?.hits)
    }

    /// Renders pixels of a picture, whose items these are, with all their samples. Returns the rays that were counted.
    pub fn render(&self, picture: &PictureBuffers, params: &RenderParams, items: &[u32]) -> Result<[u64; COUNTERS]> {
        let pixels: Vec<(usize, usize)> = items.iter().map(|&item| pixel_of_item(params, item)).collect();
        let place = |&(x, y): &(usize, usize)| y * params.width as usize + x;
        // A list has a sample for each pixel: those of these pixels are a list of their own.
        let is_list = params.ray_count != 0;
        let mut samples = vec![CameraSample::default(); if is_list { pixels.len() } else { picture.samples.len() }];
        match is_list {
            true => pixels
                .iter()
                .zip(samples.chunks_mut(1))
                .try_for_each(|(pixel, sample)| picture.samples.read_into(place(pixel), sample))?,
            false => picture.samples.read_into(0, &mut samples)?,
        }
        let list = params.of_list(pixels.len() as u32);
        let rendered = parallel::map_numbers(pixels.len(), |i| {
            let side = TILE_SIDE as usize;
            let (params, (x, y)) = if is_list { (&list, (i % side, i / side)) } else { (params, pixels[i]) };
            render_one(&self.buffers, &self.options, params, &samples, x, y)
        });
        let mut counts = [0; COUNTERS];
        for (pixel, rendered) in pixels.iter().zip(rendered) {
            picture.film.write_from(place(pixel), &[Float4::new(rendered.radiance, 1.0)])?;
            counts.iter_mut().zip(rendered.counts).for_each(|(all, count)| *all += u64::from(count));
        }
        Ok(counts)
    }
}

/// As the function of this name in `cl/shade/camera.cl`: column and row.
fn pixel_of_item(params: &RenderParams, item: u32) -> (usize, usize) {
    let (tile, in_tile) = (item / TILE_PIXELS, item % TILE_PIXELS);
    let columns = params.width.div_ceil(TILE_SIDE);
    let x = tile % columns * TILE_SIDE + in_tile % TILE_SIDE;
    let y = tile / columns * TILE_SIDE + in_tile / TILE_SIDE;
    (x as usize, y as usize)
}
