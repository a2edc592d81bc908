//! What a picture's pixels show at their centres, beside light: computed on the host, from hits that any tracer has
//! found, by the functions that twin and kernels shade with. So nothing of it is compiled for a device, and its bits
//! are the same everywhere.

use super::shade::camera::{camera_direction, camera_sample, first_of_path};
use super::shade::local_light::texture_colour;
use super::shade::surface::{Surface, surface_at, surface_hit};
use super::shared::math::{max_or, normalize3};
use crate::fma::with_fma;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::shared::{CameraSample, Hit, NO_PRIMITIVE, NO_TEXTURE, RenderParams, SurfaceHit, TraceRay};
use glam::Vec3;
use std::ops::Range;

/// What a camera ray hits.
#[derive(Debug, Clone, Copy)]
pub struct FirstHit {
    /// The ray's t: its direction has the length 1 along the view, so that this is the distance along the view, world
    /// units.
    pub depth: f32,
    /// World units.
    pub position: Vec3,
    /// Unit, interpolated, towards the side the ray came from.
    pub normal: Vec3,
    /// Unit, the triangle's, towards that side.
    pub geometric_normal: Vec3,
    /// Diffuse colour times that of the texture, linear RGB.
    pub albedo: Vec3,
    /// Texture coordinates.
    pub uv: [f32; 2],
    /// The primitive, or [`NO_PRIMITIVE`].
    pub primitive: u32,
    /// The material among those that are used.
    pub material: u32,
}

impl FirstHit {
    /// Nothing is hit.
    pub const NONE: FirstHit = FirstHit {
        depth: f32::INFINITY,
        position: Vec3::ZERO,
        normal: Vec3::ZERO,
        geometric_normal: Vec3::ZERO,
        albedo: Vec3::ZERO,
        uv: [0.0; 2],
        primitive: NO_PRIMITIVE,
        material: NO_PRIMITIVE,
    };
}

/// A picture's camera rays, one a pixel.
#[derive(Debug, Clone, Copy)]
pub struct CameraRays {
    /// The picture, or a part of it.
    pub params: RenderParams,
    /// Where in its pixel each ray passes.
    pub centre: CameraSample,
}

impl CameraRays {
    /// Where the ray of this pixel passes, counted row by row.
    #[inline(always)]
    fn at(&self, pixel: usize) -> CameraSample {
        let width = self.params.width as usize;
        camera_sample(&self.params, &[self.centre], (pixel % width, pixel / width), 0)
    }
}

with_fma! {
    /// The directions of the rays of `pixels`.
    pub fn directions_of(rays: &CameraRays, pixels: Range<usize>) -> Vec<Vec3> {
        let mut directions = Vec::with_capacity(pixels.len());
        for pixel in pixels {
            let at = rays.at(pixel);
            directions.push(camera_direction(&rays.params, at.x, at.y));
        }
        directions
    }
}

/// What the ray of `pixel` has hit. `traced`: the ray as it was traced, which starts nowhere where tracing space cannot
/// hold it.
#[inline(always)]
fn first_hit(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    at: CameraSample,
    params: &RenderParams,
    (traced, hit): (&TraceRay, &Hit),
    wants_albedo: bool,
) -> FirstHit {
    if hit.primitive == NO_PRIMITIVE {
        return FirstHit::NONE;
    }
    let path = first_of_path(params, at);
    let is_extreme = traced.origin_t_min.x.is_nan();
    let on_triangle = match is_extreme {
        // The weight that exact integers would find belongs to another ray than this one, rounded as it is.
        true => {
            SurfaceHit { weight0: max_or(0.0, (1.0 - hit.u) - hit.v), u: hit.u, v: hit.v, primitive: hit.primitive }
        }
        false => surface_hit(buffers, options, &path.ray, hit),
    };
    let surface = surface_at(buffers, options, &path.ray, &on_triangle);
    let width = path.cone.at(path.ray.origin, surface.point.position).width;
    FirstHit {
        depth: hit.t,
        position: surface.point.position / buffers.params.scale,
        normal: surface.normal,
        geometric_normal: surface.geometric_normal,
        albedo: match wants_albedo {
            true => albedo(buffers, options, &surface, normalize3(path.ray.direction, Vec3::ZERO), width),
            false => Vec3::ZERO,
        },
        uv: surface.texture_uv,
        primitive: hit.primitive,
        material: surface.material,
    }
}

/// What light from all sides is multiplied by, as the picture's local light has it.
#[inline(always)]
fn albedo(buffers: &SceneBuffers, options: &TraceOptions, surface: &Surface, direction: Vec3, width: f32) -> Vec3 {
    let material = &buffers.materials[surface.material as usize];
    let diffuse = material.diffuse.xyz();
    match material.texture {
        NO_TEXTURE => diffuse,
        _ => diffuse * texture_colour(buffers, options, surface, material, direction, width),
    }
}

with_fma! {
    /// What the rays of the pixels from `first` on have hit: `traced` are the rays as they were traced, `hits` the
    /// answers. Albedo is that of nothing unless it is wanted.
    pub fn first_hits(
        buffers: &SceneBuffers,
        options: &TraceOptions,
        rays: &CameraRays,
        first: usize,
        traced: &[TraceRay],
        hits: &[Hit],
        wants_albedo: bool,
    ) -> Vec<FirstHit> {
        let mut all = Vec::with_capacity(traced.len());
        for (pixel, traced) in (first..).zip(traced.iter().zip(hits)) {
            all.push(first_hit(buffers, options, rays.at(pixel), &rays.params, traced, wants_albedo));
        }
        all
    }
}
