//! Twin of `cl/shade/local_light.cl`: the light that a surface sends back, in pieces. The reasons are there.

use super::camera::count_ray;
use super::footprint::footprint_at;
use super::light::LightSample;
use super::procedural::solid_position;
use super::scene::height_of;
use super::surface::{Surface, SurfacePoint, leave_surface, surface_at, surface_hit, surface_point};
use super::texture::surface_colour;
use super::whitted::RayKind;
use crate::options::{PictureOptions, Terminator, TextureFilter, TraceOptions};
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{clamp01, dot3, fma3, normalize3};
use crate::reference::shared::memory::{Work, load_shading};
use crate::reference::shared::ray::Ray;
use crate::reference::traverse::query::closest_hit;
use crate::reference::traverse::traverse;
use crate::shared::{COUNTERS, MAX_SHADOW_LAYERS, Material, NO_PRIMITIVE, SurfaceHit, TextureRequest};
use glam::Vec3;

/// The colour that the material's texture, which it must have, gives the surface to a ray along unit `direction` whose
/// cone has this width there.
#[inline(always)]
pub fn texture_colour(
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
        picture: PictureOptions {
            terminator: Terminator::Hard,
            texture_filter: options.picture.texture_filter,
            ..PictureOptions::DEFAULT
        },
        ..TraceOptions::DEFAULT
    };
    let surface = surface_at(buffers, &options, &ray, &SurfaceHit { weight0, u, v, primitive });
    let material = &buffers.materials[surface.material as usize];
    let direction = normalize3(ray.direction, Vec3::ZERO);
    texture_colour(buffers, &options, &surface, material, direction, direction_width.w)
}

/// What arrives without any lamp at a surface with unit `normal` that is seen along unit `direction`.
#[inline(always)]
pub fn sky_light(buffers: &SceneBuffers, normal: Vec3, direction: Vec3) -> Vec3 {
    let params = &buffers.params;
    let bottom = params.sky_bottom.xyz();
    let sky = fma3(params.sky_top.xyz() - bottom, height_of(buffers, normal), bottom);
    fma3(params.sky_viewer.xyz(), clamp01(-dot3(normal, direction)), sky)
}

/// How much of a light that stands there arrives, by channel; traces what is in the way.
#[inline(always)]
pub fn light_visibility(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    from: &SurfacePoint,
    sample: &LightSample,
    counts: &mut [u32; COUNTERS],
    work: &mut impl Work,
) -> Vec3 {
    let mut ray = leave_surface(from, sample.to_light, sample.t_far);
    if buffers.params.has_transparent == 0 {
        let hit = traverse(buffers, options, &ray, true, work);
        let blocked = hit.primitive != NO_PRIMITIVE;
        count_ray(counts, RayKind::Shadow, blocked);
        return Vec3::splat(if blocked { 0.0 } else { 1.0 });
    }
    let mut tint = Vec3::ONE;
    for _ in 0..MAX_SHADOW_LAYERS {
        let hit = closest_hit(buffers, options, &ray, work);
        if hit.primitive == NO_PRIMITIVE {
            count_ray(counts, RayKind::Shadow, false);
            return tint;
        }
        let material = &buffers.materials[load_shading(buffers, hit.primitive).material as usize];
        if material.transparent == 0 {
            break;
        }
        tint *= material.transmission_ior.xyz();
        let passed = surface_hit(buffers, options, &ray, &hit);
        let point = surface_point(buffers, options, &passed);
        let direction =
            if sample.t_far == 1.0 { from.position + sample.to_light - point.position } else { sample.to_light };
        ray = leave_surface(&point, direction, sample.t_far);
    }
    count_ray(counts, RayKind::Shadow, true);
    Vec3::ZERO
}
