//! Twin of `cl/kernels/render.cl`: the colour of one pixel. The reasons are there.

use crate::fma::with_fma;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shade::camera::{camera_sample, count_ray, first_of_path};
use crate::reference::shade::light::{blinn_phong, limit_radiance, sample_light};
use crate::reference::shade::local_light::{light_visibility, sky_light, texture_colour};
use crate::reference::shade::roulette::Killing;
use crate::reference::shade::scene::background;
use crate::reference::shade::surface::{Surface, lift_point, surface_at, surface_hit};
use crate::reference::shade::whitted::{PendingRay, RayKind, push_secondary_rays};
use crate::reference::shared::math::{max_component, normalize3};
use crate::reference::shared::memory::{NoWork, Work};
use crate::reference::traverse::query::closest_hit;
use crate::shared::{COUNTERS, CameraSample, Material, NO_PRIMITIVE, NO_TEXTURE, RenderParams};
use crate::work::{PixelWork, RayWork};
use glam::Vec3;

/// What every step needs: the scene, how to trace it, and where to count.
struct Pixel<'a, W> {
    buffers: &'a SceneBuffers,
    options: &'a TraceOptions,
    params: &'a RenderParams,
    rendered: RenderedPixel<W>,
    stack: Vec<PendingRay>,
}

impl<W: Work> Pixel<'_, W> {
    #[inline(always)]
    fn local_light(
        &mut self,
        surface: &Surface,
        material: &Material,
        pending: &PendingRay,
        view_direction: Vec3,
    ) -> Vec3 {
        let mut diffuse = material.diffuse.xyz();
        let mut radiance = material.ambient.xyz();
        if material.texture != NO_TEXTURE {
            let width = pending.cone.at(pending.ray.origin, surface.point.position).width;
            let colour = texture_colour(self.buffers, self.options, surface, material, view_direction, width);
            diffuse *= colour;
            radiance *= colour;
        }
        radiance += diffuse * sky_light(self.buffers, surface.normal, view_direction);
        radiance += material.emission.xyz();
        let mut start = surface.point;
        lift_point(&mut start, surface.lift);
        for light in &self.buffers.lights {
            let mut sample = sample_light(light, surface.point.position);
            let reflected = blinn_phong(surface, material, diffuse, view_direction, &sample);
            if sample.t_far == 1.0 {
                sample.to_light -= surface.lift;
            }
            if max_component(reflected) > 0.0 {
                let RenderedPixel { counts, secondary_work, .. } = &mut self.rendered;
                radiance +=
                    reflected * light_visibility(self.buffers, self.options, &start, &sample, counts, secondary_work);
            }
        }
        radiance
    }

    #[inline(always)]
    fn radiance_along(&mut self, at: CameraSample) -> Vec3 {
        let killing = Killing::of_path(self.params, at);
        let mut radiance = Vec3::ZERO;
        self.stack.clear();
        self.stack.push(first_of_path(self.params, at));
        while let Some(pending) = self.stack.pop() {
            let direction = normalize3(pending.ray.direction, Vec3::ZERO);
            let work = match pending.kind {
                RayKind::Camera => &mut self.rendered.camera_work,
                _ => &mut self.rendered.secondary_work,
            };
            let hit = closest_hit(self.buffers, self.options, &pending.ray, work);
            count_ray(&mut self.rendered.counts, pending.kind, hit.primitive != NO_PRIMITIVE);
            if hit.primitive == NO_PRIMITIVE {
                radiance += pending.weight * limit_radiance(background(self.buffers, direction));
                continue;
            }
            let at = surface_hit(self.buffers, self.options, &pending.ray, &hit);
            let surface = surface_at(self.buffers, self.options, &pending.ray, &at);
            let material = &self.buffers.materials[surface.material as usize];
            radiance += pending.weight * limit_radiance(self.local_light(&surface, material, &pending, direction));
            if killing.depth(pending.depth) < self.params.max_depth {
                push_secondary_rays(&surface, material, &pending, direction, &killing, &mut self.stack);
            }
        }
        radiance
    }
}

/// A rendered pixel and what it took.
#[derive(Debug, Clone, Copy, Default)]
pub struct RenderedPixel<W> {
    /// Linear radiance.
    pub radiance: Vec3,
    /// Rays by kind and outcome.
    pub counts: [u32; COUNTERS],
    /// Work on the camera rays.
    pub camera_work: W,
    /// Work on all other rays.
    pub secondary_work: W,
}

/// Renders pixel (x, y).
#[inline(always)]
pub fn render_pixel<W: Work>(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    params: &RenderParams,
    samples: &[CameraSample],
    x: usize,
    y: usize,
) -> RenderedPixel<W> {
    let mut pixel = Pixel { buffers, options, params, rendered: RenderedPixel::default(), stack: Vec::new() };
    let mut sum = Vec3::ZERO;
    for sample in 0..params.sample_count as usize {
        sum += pixel.radiance_along(camera_sample(params, samples, (x, y), sample));
    }
    RenderedPixel { radiance: sum * params.sample_weight, ..pixel.rendered }
}

/// One row of a picture: what is written to it.
pub struct PixelRow<'a> {
    /// Its number, the top one's being 0.
    pub y: usize,
    /// Linear radiance.
    pub pixels: &'a mut [[f32; 3]],
    /// Rays by kind and outcome; those of the row are added.
    pub counts: &'a mut [u64; COUNTERS],
}

#[inline(always)]
fn render_row_counting<W: Work>(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    params: &RenderParams,
    samples: &[CameraSample],
    row: PixelRow,
    mut done: impl FnMut(usize, RenderedPixel<W>),
) {
    for (x, out) in row.pixels.iter_mut().enumerate() {
        let pixel = render_pixel(buffers, options, params, samples, x, row.y);
        *out = pixel.radiance.to_array();
        for (total, count) in row.counts.iter_mut().zip(pixel.counts) {
            *total += u64::from(count);
        }
        done(x, pixel);
    }
}

with_fma! {
    /// Renders one row of pixels; counts the work if there is room for it.
    pub fn render_row(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        params: &RenderParams,
        samples: &[CameraSample],
        row: PixelRow,
        work: Option<&mut [PixelWork]>,
    ) {
        match work {
            None => render_row_counting::<NoWork>(buffers, options, params, samples, row, |_, _| ()),
            Some(work) => render_row_counting::<RayWork>(buffers, options, params, samples, row, |x, pixel| {
                work[x] = PixelWork { camera: pixel.camera_work, secondary: pixel.secondary_work };
            }),
        }
    }
}

with_fma! {
    /// Renders pixel (x, y) without counting the work.
    pub fn render_one(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        params: &RenderParams,
        samples: &[CameraSample],
        x: usize,
        y: usize,
    ) -> RenderedPixel<NoWork> {
        render_pixel(buffers, options, params, samples, x, y)
    }
}
