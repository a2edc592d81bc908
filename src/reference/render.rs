//! Twin of `cl/kernels/render.cl` and of `cl/shade/{scene,local_light,camera}.cl`: the colour of one pixel. The reasons are there.

use super::footprint::{RayCone, footprint_at};
use super::light::{LightSample, blinn_phong, limit_radiance, sample_light};
use super::math::{clamp01, dot3, fma3, max_component, normalize3};
use super::memory::{Work, load_shading};
use super::procedural::solid_position;
use super::ray::Ray;
use super::surface::{Surface, SurfacePoint, leave_surface, lift_point, surface_at, surface_hit, surface_point};
use super::texture::surface_colour;
use super::traverse::{closest_hit, traverse};
use super::whitted::{PendingRay, RayKind, push_secondary_rays};
use crate::options::{PictureOptions, Terminator, TextureFilter, TraceOptions};
use crate::pack::SceneBuffers;
use crate::shared::{
    COUNTERS, CameraSample, MAX_SHADOW_LAYERS, Material, NO_PRIMITIVE, NO_TEXTURE, RenderParams, SurfaceHit,
    TextureRequest,
};
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
    fn count(&mut self, kind: RayKind, hit: bool) {
        self.rendered.counts[kind as usize] += 1;
        self.rendered.counts[kind as usize + 1] += u32::from(hit);
    }

    #[inline(always)]
    fn light_visibility(&mut self, from: &SurfacePoint, sample: &LightSample) -> Vec3 {
        let mut ray = leave_surface(from, sample.to_light, sample.t_far);
        if self.buffers.params.has_transparent == 0 {
            let hit = traverse(self.buffers, self.options, &ray, true, &mut self.rendered.secondary_work);
            let blocked = hit.primitive != NO_PRIMITIVE;
            self.count(RayKind::Shadow, blocked);
            return Vec3::splat(if blocked { 0.0 } else { 1.0 });
        }
        let mut tint = Vec3::ONE;
        for _ in 0..MAX_SHADOW_LAYERS {
            let hit = closest_hit(self.buffers, self.options, &ray, &mut self.rendered.secondary_work);
            if hit.primitive == NO_PRIMITIVE {
                self.count(RayKind::Shadow, false);
                return tint;
            }
            let material = &self.buffers.materials[load_shading(self.buffers, hit.primitive).material as usize];
            if material.transparent == 0 {
                break;
            }
            tint *= material.transmission_ior.xyz();
            let passed = surface_hit(self.buffers, self.options, &ray, &hit);
            let point = surface_point(self.buffers, self.options, &passed);
            let direction =
                if sample.t_far == 1.0 { from.position + sample.to_light - point.position } else { sample.to_light };
            ray = leave_surface(&point, direction, sample.t_far);
        }
        self.count(RayKind::Shadow, true);
        Vec3::ZERO
    }

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
                radiance += reflected * self.light_visibility(&start, &sample);
            }
        }
        radiance
    }

    #[inline(always)]
    fn radiance_along(&mut self, first: PendingRay) -> Vec3 {
        let mut radiance = Vec3::ZERO;
        self.stack.clear();
        self.stack.push(first);
        while let Some(pending) = self.stack.pop() {
            let direction = normalize3(pending.ray.direction, Vec3::ZERO);
            let work = match pending.kind {
                RayKind::Camera => &mut self.rendered.camera_work,
                _ => &mut self.rendered.secondary_work,
            };
            let hit = closest_hit(self.buffers, self.options, &pending.ray, work);
            self.count(pending.kind, hit.primitive != NO_PRIMITIVE);
            if hit.primitive == NO_PRIMITIVE {
                radiance += pending.weight * limit_radiance(background(self.buffers, direction));
                continue;
            }
            let at = surface_hit(self.buffers, self.options, &pending.ray, &hit);
            let surface = surface_at(self.buffers, self.options, &pending.ray, &at);
            let material = &self.buffers.materials[surface.material as usize];
            radiance += pending.weight * limit_radiance(self.local_light(&surface, material, &pending, direction));
            if pending.depth < self.params.max_depth {
                let kill_weight = self.params.kill_weight;
                push_secondary_rays(&surface, material, &pending, direction, kill_weight, &mut self.stack);
            }
        }
        radiance
    }
}

/// The colour that the material's texture, which it must have, gives the surface to a ray along unit `direction` whose cone has this width
/// there.
#[inline(always)]
fn texture_colour(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    surface: &Surface,
    material: &Material,
    direction: Vec3,
    width: f32,
) -> Vec3 {
    let footprint = match options.picture.texture_filter {
        TextureFilter::Footprint => Some(footprint_at(buffers, surface, direction, width)),
        TextureFilter::Bilinear => None,
    };
    surface_colour(buffers, material.texture, surface.texture_uv, footprint.as_ref(), solid_position(surface))
}

/// The same for a hit of a device that asks for it.
#[inline(always)]
pub fn requested_colour(buffers: &SceneBuffers, options: &TraceOptions, request: &TextureRequest) -> Vec3 {
    // Of the ray only the direction matters here.
    let TextureRequest { direction_width, weight0, u, v, primitive } = *request;
    let ray = Ray::new(Vec3::ZERO, direction_width.xyz(), 0.0, f32::INFINITY, NO_PRIMITIVE);
    let options = TraceOptions {
        picture: PictureOptions { terminator: Terminator::Hard, ..options.picture },
        ..TraceOptions::DEFAULT
    };
    let surface = surface_at(buffers, &options, &ray, &SurfaceHit { weight0, u, v, primitive });
    let material = &buffers.materials[surface.material as usize];
    let direction = normalize3(ray.direction, Vec3::ZERO);
    texture_colour(buffers, &options, &surface, material, direction, direction_width.w)
}

#[inline(always)]
fn background(buffers: &SceneBuffers, direction: Vec3) -> Vec3 {
    let bottom = buffers.params.background_bottom.xyz();
    let height = clamp01(0.5f32.mul_add(direction.y, 0.5));
    fma3(buffers.params.background_top.xyz() - bottom, height, bottom)
}

/// Camera ray through the point (x, y) of the picture, in pixels from its upper left corner.
#[inline(always)]
pub fn camera_ray(params: &RenderParams, x: f32, y: f32) -> Ray {
    Ray::new(params.eye.xyz(), camera_direction(params, x, y), 0.0, f32::INFINITY, NO_PRIMITIVE)
}

/// Direction of that ray; its component along the view is 1.
#[inline(always)]
pub fn camera_direction(params: &RenderParams, x: f32, y: f32) -> Vec3 {
    let right = x.mul_add(params.pixel_width, -1.0);
    let up = (-y).mul_add(params.pixel_height, 1.0);
    fma3(params.right.xyz(), right, fma3(params.up.xyz(), up, params.forward.xyz()))
}

/// The camera ray of a pixel's sample, or that of a list which has this place in the film.
#[inline(always)]
fn first_of_path(params: &RenderParams, samples: &[CameraSample], (x, y): (usize, usize), sample: usize) -> PendingRay {
    let (CameraSample { x, y, footprint }, from) = match params.ray_count {
        0 => (samples[sample], (x as f32, y as f32)),
        _ => (samples[y * params.width as usize + x], (0.0, 0.0)),
    };
    let direction = camera_direction(params, from.0 + x, from.1 + y);
    PendingRay {
        ray: Ray::new(params.eye.xyz(), direction, 0.0, f32::INFINITY, NO_PRIMITIVE),
        weight: Vec3::ONE,
        depth: 1,
        kind: RayKind::Camera,
        cone: RayCone { width: 0.0, spread: footprint * params.pixel_size / dot3(direction, direction) },
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
        sum += pixel.radiance_along(first_of_path(params, samples, (x, y), sample));
    }
    RenderedPixel { radiance: sum * params.sample_weight, ..pixel.rendered }
}
